"""Settings of a diagnosis: every limit that decides about a name, with its meaning and range."""

from __future__ import annotations

from dataclasses import dataclass

from ecm.io.settings import Checked, setting
from ecm.models.refit import FAR_BEYOND_NOISE


@dataclass(frozen=True)
class DiagnosisSettings(Checked):
    """Limits of the procedure; the defaults are those of the blind benchmark.

    Shares are shares of whitened sums of squares. `chi²` is such a sum over the noise scale.

    Examples
    --------
    >>> DiagnosisSettings(level=0.001).least_bic
    6.0
    >>> DiagnosisSettings(level=2.0)
    Traceback (most recent call last):
    ecm.errors.InputError: level = 2.0: expected a number from 0 to 1 (Chance of a wrong rejection)
    """

    # Rows
    most_rows: int = setting(
        3000,
        low=20,
        high=100_000,
        doc="Rows that are used of a larger table, spread over runs, time and poses.",
    )
    least_rows_of_log: int = setting(
        100,
        low=20,
        doc="Least rows used of a log whose neighbours err alike; else as many as would tell as "
        "much if they were independent.",
    )
    # The linearised problem
    most_base_columns: int = setting(
        80, low=0, doc="Columns of a base that are carried along; a larger base is projected out."
    )
    outlier_chance: float = setting(
        1e-4, above=0.0, high=1.0, doc="Rows less likely than this under the noise count less."
    )
    absorbed_share: float = setting(
        0.9, low=0.0, high=1.0, doc="An effect of which a base absorbs more cannot be tested."
    )
    absorbed_by_physics: float = setting(
        0.995,
        low=0.0,
        high=1.0,
        doc="The same for a physics base: its one or two coefficients absorb nothing by chance.",
    )
    shape_refinements: int = setting(
        4, low=0, doc="Rounds in which the shape of an effect is refined between grid points."
    )
    noise_effect_deviations: float = setting(
        4.0, low=0.0, doc="An effect of the noise is reported beyond so many standard deviations."
    )
    held_out: str = setting(
        "blocks",
        choices=("blocks", "random"),
        doc="Rows held out: blocks of time or of poses, or groups of rows at random.",
    )
    # Gate and search
    level: float = setting(0.01, low=0.0, high=1.0, doc="Chance of a wrong rejection.")
    white_level: float = setting(
        0.001,
        low=0.0,
        high=1.0,
        doc="Chance that white noise is said to follow something. It adds to that of the gate, and "
        "what is not white shows far below it.",
    )
    least_bic: float = setting(6.0, low=0.0, doc="Fall of BIC that a name needs.")
    material_share: float = setting(
        0.10,
        low=0.0,
        high=1.0,
        doc="Share of all that is explained that each further effect must explain: what the form "
        "of a first effect leaves (4 to 9 %) stays below.",
    )
    one_cause_share: float = setting(
        0.03,
        low=0.0,
        high=1.0,
        doc="Share that two effects must explain beyond any single one: one cause is likelier.",
    )
    most_effects: int = setting(4, low=1, doc="Effects in the largest set that is searched.")
    beam: int = setting(5, low=1, doc="Best sets at each size of the search.")
    # Acceptance
    held_out_errors: float = setting(
        1.0, doc="Fall of the held-out error that a name needs, in its standard errors."
    )
    chosen_share: float = setting(
        0.8, low=0.0, high=1.0, doc="Share of group bootstraps that must choose a name or class."
    )
    bootstrap_draws: int = setting(
        2000, low=1, doc="Most group bootstraps; 400 where one name wins nearly all of them."
    )
    contender_share: float = setting(
        0.3,
        low=0.0,
        high=1.0,
        doc="An effect that explains less than this share of the chosen one wins no bootstrap.",
    )
    kept_within_bounds: float = setting(
        0.8, low=0.0, high=1.0, doc="Share that parameters within their bounds must still explain."
    )
    # Confusion classes
    separable: float = setting(
        0.1, low=0.0, high=1.0, doc="Effects are alike when a rival leaves less than this share."
    )
    most_in_class: int = setting(3, low=1, doc="Members of a class, the nearest first.")
    form_share: float = setting(
        0.06,
        low=0.0,
        high=1.0,
        doc="Share that the form of a right effect may leave: a rival that looks alike and loses "
        "no more may be the truth.",
    )
    refuted_share: float = setting(
        0.15,
        low=0.0,
        high=1.0,
        doc="A later run refutes a rival that leaves this share of what the effect explains there.",
    )
    refuted_by: float = setting(
        12.0,
        low=0.0,
        doc="The same as chi²: with the rival true and d² between the two, the excess is normal "
        "with mean -d² and variance 4 d², beyond 12 in 3 of 10000 runs at most.",
    )
    near_share: float = setting(
        0.3,
        low=0.0,
        high=1.0,
        doc="Beside another effect, or a body that is not the stated one, a rival may lose this "
        "share of a name.",
    )
    near_share_in_doubt: float = setting(
        0.6, low=0.0, high=1.0, doc="The same where the form of the effect is in doubt."
    )
    close_bic: float = setting(
        20.0, low=0.0, doc="A rival that wins some bootstraps is close within this loss of BIC."
    )
    some_bootstraps: float = setting(
        0.02, low=0.0, high=1.0, doc="Some bootstraps: more than this share of them."
    )
    rival_bootstraps: float = setting(
        0.1, low=0.0, high=1.0, doc="A rival that wins more than this share of them is a member."
    )
    # What is left, and the verdict
    left_share: tuple[float, ...] = setting(
        (1.0, 0.15, 0.12, 0.08),
        low=0.0,
        high=1.0,
        doc="Unknown beyond this share of the structure after 0, 1, 2, 3 or more effects: right "
        "ones leave the misfit of their form, wrong ones come in numbers and leave more.",
    )
    left_deviations: float = setting(
        1.645, low=0.0, doc="Standard deviations by which that share must be exceeded."
    )
    least_strength: float = setting(
        0.15, low=0.0, doc="Structure weaker than this, in noise units, is never unknown."
    )
    doubtful_share: float = setting(
        0.04, low=0.0, high=1.0, doc="The form is in doubt where more than this share is left."
    )
    doubtful_p: float = setting(
        0.05, low=0.0, high=1.0, doc="And where what is left is seen with this chance."
    )
    most_left_error: float = setting(
        FAR_BEYOND_NOISE,
        above=1.0,
        doc="Largest error after the accepted effects, over the noise, for a name: a little more "
        "than a noise that was stated half as large. Beyond it they explain a part only.",
    )
    other_body_single: float = setting(
        1.5,
        low=0.0,
        doc="Structure left beside one name, in noise units, from which the body is doubted.",
    )
    other_body_several: float = setting(
        0.5, low=0.0, doc="The same beside several names, which may imitate a body, or none."
    )
    taken_by_energy: float = setting(
        0.9, low=0.0, high=1.0, doc="Share of it that a symmetric energy must explain."
    )
    most_modulus_factor: float = setting(
        5.0, low=1.0, doc="Largest error of the stated E; beyond it a sign or a unit is wrong."
    )
    least_wrong_error: float = setting(
        2.0, low=1.0, doc="Error over the noise from which other readings of the table are tried."
    )
    mended_share: float = setting(
        1.0 / 3.0,
        above=0.0,
        high=1.0,
        doc="Share of the error to which another reading must bring it to be named.",
    )
    # Unknown effects
    most_terms: int = setting(3, low=1, doc="Terms of a description in words.")
    least_term_gain: float = setting(
        0.05, low=0.0, high=1.0, doc="Share of the explained squares that a further term needs."
    )
    # Reports
    power: float = setting(
        0.9, above=0.0, high=0.999, doc="Chance with which an effect of the limit's size is named."
    )
    worst_fold: float = setting(
        1.1, low=1.0, doc="Largest growth of the error of a fold that a richer form may cause."
    )
    # Next experiment
    shapes_compared: int = setting(3, low=1, doc="Shapes of each member that are compared.")
    reading_deviations: float = setting(
        3.0, low=0.0, doc="A reading by hand of so many deviations is more than nothing."
    )
    set_up_minutes: int = setting(
        5, low=0, doc="Minutes of a campaign that a session needs only once."
    )
    session_minutes: int = setting(180, low=1, doc="Longest session: an afternoon.")
    session_gain: float = setting(
        0.02, low=0.0, doc="Chance of the right names that a part of a session must add."
    )
    gain_per_minute: float = setting(
        5e-4, low=0.0, doc="Chance of the right names that a minute must add."
    )
    separated: float = setting(
        0.9, low=0.0, high=1.0, doc="Chance from which two members count as told apart."
    )
    most_compared: int = setting(6, low=2, doc="Rivals of a longer class that are compared.")
    most_experiments: int = setting(6, low=1, doc="Experiments that are listed.")
    pause_s: float = setting(600.0, low=0.0, doc="Pause before a second campaign, in seconds.")


DEFAULTS = DiagnosisSettings()
"""The settings of the blind benchmark."""
