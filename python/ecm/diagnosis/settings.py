"""Settings of a diagnosis, and the limits that several of its parts share.

All other limits stand beside their use.
"""

from __future__ import annotations

from dataclasses import dataclass

from ecm.io.settings import Checked, setting

MOST_IN_CLASS = 3
"""Members of a class, the nearest first."""
SEPARABLE = 0.1
"""Effects are alike when a rival leaves less than this share."""
FORM_SHARE = 0.06
"""Share that the form of a right effect may leave: a rival that looks alike and loses no more may
be the truth."""
CHANCE_DEVIATIONS = 1.645
"""Standard deviations of what is left that may be chance: more is so in 1 of 20."""
LEFT_SHARE = 0.15
"""Unknown beyond this share of the structure, less by what an effect must explain beyond another
for each further one: right ones leave the misfit of their form, wrong ones come in numbers and
leave more."""
REFUTED_SHARE = 0.15
"""A later run refutes a rival that leaves this share of what the effect explains there."""
REFUTED_BY = 12.0
"""The same as chi²: with the rival true and d² between the two, the excess is normal with mean -d²
and variance 4 d², beyond 12 in 3 of 10000 runs at most."""


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
    ecm.errors.InputError: level = 2.0: expected a number from 0 to 1 (chance of a wrong rejection)
    """

    most_rows: int = setting(3000, low=20, high=100_000)
    """Rows that are used of a larger table, spread over runs, time and poses."""
    most_base_columns: int = setting(80, low=0)
    """Columns of a base that are carried along; a larger base is projected out."""
    level: float = setting(0.01, low=0.0, high=1.0)
    """Chance of a wrong rejection."""
    least_bic: float = setting(6.0, low=0.0)
    """Fall of BIC that a name needs."""
    most_effects: int = setting(4, low=1)
    """Effects in the largest set that is searched."""
    held_out: str = setting("blocks", choices=("blocks", "random"))
    """Rows held out: blocks of time or of poses, or groups of rows at random."""
    held_out_errors: float = setting(1.0)
    """Fall of the held-out error that a name needs, in its standard errors."""


DEFAULTS = DiagnosisSettings()
"""The settings of the blind benchmark."""
