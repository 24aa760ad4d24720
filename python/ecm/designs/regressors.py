"""Settings of a design, its nominal model, and the information rows of a pose.

Every row is whitened. Without a nominal base the components have one default noise each, as in
the binary `ecm-design`; with one a row's covariance Sigma = Sigma_w + K_s Sigma_p K_s' depends on
the pose, so that poses where the mechanism is stiff carry less information. A design comes before
the measurement, so its stiffness is nominal: that of a given model, of the simulated wrenches among
the candidates, or of the FEM of their `[mechanism]`.

I-optimal designs average over the rows of a prediction's variance, in units of one reading's noise,
and `design_sizes` takes its expected errors from them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ecm import _native
from ecm._native import criteria, polynomial_regressor, rows_inside
from ecm.effects import Effect, Rows
from ecm.effects.protocol import jacobian_of
from ecm.errors import DesignError, InputError
from ecm.io.arrays import F, I
from ecm.io.columns import POSE, WRENCH
from ecm.io.description import Meta
from ecm.io.events import Progress
from ecm.io.mechanism import Mechanism
from ecm.io.se3 import wrench_adjoint
from ecm.io.settings import Checked, setting
from ecm.io.table import Table
from ecm.models import (
    EnergyModel,
    Model,
    PolynomialModel,
    StiffnessMap,
    fit_model,
    parse_model,
    physics_map,
    surrogate_of,
)
from ecm.models.actuated import ActuatedModel
from ecm.models.maps import EnergyTerms
from ecm.models.partial import seen_combinations
from ecm.regression.noise import Noise, declared_noise, whiteners
from ecm.regression.rows import actuators_of
from ecm.rig.instruments import Camera, ForceTorqueSensor, sd_of
from ecm.rig.settings import RigSettings

_NOMINAL_ACTUATED = "actuated4"
_MIN_POSES = 100
"""Number of simulated poses from which a physics map can be fitted and tested."""


@dataclass(frozen=True)
class NominalModel:
    """A nominal map, the instruments' noise, and the description of the candidates.

    Parameters
    ----------
    base
        Map from (N, 6) poses, or (N, 6 + m) with the inputs of actuators, to (N, 6) wrenches.
    noise
        Noise of one row.
    meta
        Mechanism, scene and instruments of the candidates.

    Examples
    --------
    >>> import numpy as np
    >>> from ecm import as_table
    >>> bent = np.random.default_rng(0).normal(0.0, 0.01, (60, 6))
    >>> pairs = np.hstack([bent + [0.1, 0.0, 0.0, 0.0, 0.0, 0.0], 100.0 * bent])
    >>> meta = Meta(mechanism={"length_m": 0.1})
    >>> nominal = nominal_model(as_table(dict(zip((*POSE, *WRENCH), pairs.T)), meta=meta))
    >>> nominal.whiteners(pairs[:2, :6]).shape
    (2, 6, 6)
    """

    base: StiffnessMap
    noise: Noise
    meta: Meta

    def rows(self, poses: F) -> Rows:
        """Rows at (N, 6) poses, or (N, 6 + m), their wrenches predicted."""
        return Rows(self.table(poses), self.base)

    def table(self, poses: F) -> Table:
        """A table of (N, 6) poses, or (N, 6 + m), with the nominal wrenches."""
        names = (*POSE, *actuators_of(self.base))[: np.shape(poses)[1]]
        columns = dict(zip(names, np.asarray(poses, dtype=np.float64).T.copy(), strict=True))
        wrenches = self.base.predict(np.ascontiguousarray(poses))
        columns |= dict(zip(self.base.outputs, wrenches.T.copy(), strict=True))
        return Table(columns, self.meta, "nominal")

    def whiteners(self, poses: F) -> F:
        """(N, 6, 6) W with W' W = Sigma^-1, Sigma = Sigma_w + K_s Sigma_p K_s'."""
        return whiteners(self.noise.covariance(self.rows(poses)))

    def effect_columns(self, poses: F, effects: Sequence[Effect]) -> tuple[F, F]:
        """(N, 6, q) wrench per parameter of the effects that act at a pose, and (q,) sizes.

        Effects of time, order or approach are a matter of the plan, not of the poses.
        """
        rows = self.rows(poses)
        blocks, scales = [np.zeros((len(poses), len(self.base.outputs), 0))], []
        for effect in effects:
            if effect.missing(rows.table) is not None:
                continue
            variant = effect.variants(rows.table)[0]
            blocks.append(jacobian_of(variant, rows))
            scales += [parameter.scale for parameter in variant.parameters]
        return np.concatenate(blocks, axis=2), np.asarray(scales)


def nominal_model(
    candidates: Table,
    model: Model | None = None,
    *,
    physics: bool = False,
    noise: Noise | None = None,
    threads: int = 0,
    progress: Progress | None = None,
) -> NominalModel:
    """The nominal model of a table of candidates.

    Its map is that of `model`, else it is fitted to the candidates' wrenches, else it is the FEM of
    their `[mechanism]`.

    Parameters
    ----------
    candidates
        Table with the six pose columns.
    model
        A fitted model.
    physics
        Accept only the physics map: of `model`, or the FEM of `[mechanism]` with its sensitivities
        to E and Poisson's ratio (solved once per shape, minutes).
    noise
        Noise of one row; by default that of the candidates' `[instrument]`.
    threads
        Threads of the FEM; 0: all.
    progress
        Called with the load cases done, their number and what is being done.

    Returns
    -------
    NominalModel
        Map, noise and description.

    Raises
    ------
    InputError
        None of the three is there, or a pose column is missing.

    Examples
    --------
    >>> import numpy as np
    >>> from ecm import as_table
    >>> bent = np.random.default_rng(0).normal(0.0, 0.01, (60, 6))
    >>> pairs = np.hstack([bent + [0.1, 0.0, 0.0, 0.0, 0.0, 0.0], 100.0 * bent])
    >>> meta = Meta(mechanism={"length_m": 0.1})
    >>> nominal = nominal_model(as_table(dict(zip((*POSE, *WRENCH), pairs.T)), meta=meta))
    >>> nominal.base.kind, nominal.noise.source
    ('energy', 'assumed')
    """
    where = candidates.source
    if candidates.pose_columns != POSE:
        raise InputError(
            f"{where}: the noise and the effects of a pose need the six pose columns, "
            f"found {', '.join(candidates.pose_columns)}; leave --base and --rig out, or give all "
            f"of {', '.join(POSE)}"
        )
    noise = declared_noise(candidates) if noise is None else noise
    meta = Meta(
        mechanism=candidates.meta.mechanism,
        scene=candidates.meta.scene,
        instrument=candidates.meta.instrument,
    )
    body = candidates.meta.elastic_body()
    if physics:
        own = _physics(where, body, model, threads, progress)
        return NominalModel(own, noise, meta.with_length(own.length_m))
    if model is not None:
        return NominalModel(model.base, noise, meta.with_length(model.base.length_m))
    length = candidates.meta.length_m
    if candidates.actuation_columns and candidates.wrench_columns == WRENCH and length is not None:
        return NominalModel(fit_model(candidates, _NOMINAL_ACTUATED).base, noise, meta)
    if candidates.wrench_columns == WRENCH and length is not None:
        return NominalModel(_fitted_map(candidates, length, known=body is not None), noise, meta)
    if body is not None:
        return NominalModel(physics_map(body, threads=threads, progress=progress), noise, meta)
    raise InputError(
        f"{where}: the nominal stiffness is not known; give --base MODEL, simulated wrenches "
        "beside the poses with [mechanism] length_m, or a [mechanism] that FEM can solve"
    )


def _physics(
    where: str, body: Mechanism | None, model: Model | None, threads: int, progress: Progress | None
) -> StiffnessMap:
    """The physics map, whose E and (where it is tabulated) Poisson's ratio are unknown."""
    if model is not None:
        if model.base.kind == "physics":
            return model.base
        raise InputError(
            f"--base: a {model.base.kind} model, but --model physics needs the physics base; leave "
            "--base out where the candidates have a [mechanism], or give a physics model"
        )
    if body is None:
        raise InputError(
            f"{where}: --model physics needs a [mechanism] that FEM can solve; add builtin, its "
            "dimensions and young_modulus_Pa to the TOML beside the candidates"
        )
    return physics_map(body, threads=threads, progress=progress)


def rig_noise(settings: RigSettings) -> Noise:
    """Noise of one averaged row, as the campaigns of a rig declare it.

    Parameters
    ----------
    settings
        Instruments and averaging window of the rig.

    Returns
    -------
    Noise
        Its source is `declared`.

    Raises
    ------
    InputError
        A figure is 0.

    Examples
    --------
    >>> from ecm.rig import RigSettings
    >>> rig_noise(RigSettings()).source
    'declared'
    """
    instrument, window = settings.instrument, settings.rig.window_s
    adjoint = wrench_adjoint(instrument.top_from_sensor)
    wrench = sd_of(ForceTorqueSensor(instrument).row_covariance(window, adjoint))
    sd = np.array([*Camera(instrument).row_sd(window), *wrench])
    if not (sd > 0.0).all():
        raise InputError(
            f"--rig: its noise of position, rotation, force and torque is {sd.tolist()}; a design "
            "needs positive figures in [instrument]"
        )
    return Noise().with_parameters(sd, "declared")


def _fitted_map(candidates: Table, length_m: float, *, known: bool) -> StiffnessMap:
    """A map fitted to simulated wrenches: physics where the body is known, else a free energy."""
    poses, wrenches = candidates.poses, candidates.wrenches
    if known and len(poses) >= _MIN_POSES:
        tested = np.arange(len(poses)) % 5 == 4
        return surrogate_of(
            poses[~tested],
            wrenches[~tested],
            length_m,
            test_poses=poses[tested],
            test_wrenches=wrenches[tested],
            mechanism=dict(candidates.meta.mechanism),
        )
    return EnergyTerms(length_m, 4).fit(poses, wrenches)


def row_list(option: str, text: str, count: int) -> I:
    """Rows (from 0) of a list that counts data rows from 1."""
    try:
        return np.asarray(_native.row_list(text, count), dtype=np.int64)
    except DesignError as error:
        raise InputError(f"{option}: {error}") from None


def list_or_region(option: str, text: str, table: Table) -> I:
    """Rows (from 0) that a list names or that lie in a region of the pose columns."""
    if not set("<>=") & set(text):
        return row_list(option, text, len(table))
    names = list(table.pose_columns)
    try:
        rows = rows_inside(text, names, np.ascontiguousarray(table.matrix(names)))
    except DesignError as error:
        raise InputError(f"{option}: {error}") from None
    return np.asarray(rows, dtype=np.int64)


CRITERIA = {name: meaning for name, meaning, _ in criteria()}
"""Criteria by name, with what a design's sentence says of them."""

AVERAGED = tuple(name for name, _, averaged in criteria() if averaged)
"""Criteria that average over a region."""


@dataclass(frozen=True)
class DesignSettings(Checked):
    """What a design is for and how it is searched.

    Raises
    ------
    InputError
        A value outside its range.

    Examples
    --------
    >>> DesignSettings(criterion="maximin", starts=3).criterion
    'maximin'
    """

    criterion: str = setting("d", choices=tuple(CRITERIA))
    """d: largest determinant; i: smallest average variance of h and of K times half the range; a:
    smallest sum of the variances of coefficients; g: smallest largest variance; di: D in `share`, I
    in the rest; maximin: largest smallest distance, in coordinates normalised to [-1, 1] or in
    metres with `metres_per_radian`."""
    model: str = setting("cubic")
    """`poly:D`, `linear`, `quadratic`, `cubic`, `energyD` or `actuatedD` with its length, or
    `physics` with a nominal model."""
    length_m: float | None = setting(None, above=0.0)
    """Length of the mechanism in m, for energies; by default that of the nominal model."""
    effects: tuple[Effect, ...] = setting((), any_size=True)
    """Effects whose parameters the design determines too, as far as the poses can."""
    ridge: float = setting(0.0, low=0.0)
    """Information that is known before on all coefficients but a polynomial's constant, in units of
    the rows' information: the design for a fit with this `ridge`."""
    share: float = setting(0.5, low=0.0, high=1.0)
    """Share of D in the criterion di."""
    metres_per_radian: float | None = setting(None, above=0.0)
    """Length in m that counts as much as a radian in distances; none: normalised coordinates."""
    columns: tuple[str, ...] = setting(POSE, any_size=True)
    """Names of the pose columns, for `metres_per_radian`."""
    replicates: bool = setting(False)
    """Whether a pose may be chosen more than once."""
    method: Literal["search", "paper"] = setting("search", choices=("search", "paper"))
    """search: the best that is found; paper: the exchange of the paper for d, or for maximin."""
    starts: int = setting(10, low=1)
    """Random starts; the best one is kept."""
    iterations: int = setting(0, low=0)
    """Iterations of the search; 0: until nothing improves."""
    time_limit_s: float = setting(0.0, low=0.0)
    """Limit of the search in s; 0: none. With a limit another run may give another design."""
    seed: int = setting(0)
    """Seed of the random generator."""
    threads: int = setting(0, low=0)
    """Threads; 0: all."""


COMPONENT_SD = np.array([0.9, 0.3, 0.3, 0.010, 0.012, 0.012])
"""One row's default noise: N and N m; fx carries the pose noise of the stiff axis."""
_FAR = 10.0
"""Prior standard deviation of an effect's parameters over their ordinary size."""


@dataclass(frozen=True)
class Regressor:
    """Information rows of candidates and of poses measured before."""

    rows: F
    """(N * rows_per_pose, k)."""
    rows_per_pose: int
    measured: F | None
    prior: F | None = None
    """(k, k) information known beforehand."""


def polynomial_degree(model: str) -> int | None:
    """Degree of a polynomial by its short name; None for an energy or physics.

    Raises
    ------
    InputError
        For other models: their design needs the parameters that it is to determine.

    Examples
    --------
    >>> polynomial_degree("cubic"), polynomial_degree("energy4")
    (3, None)
    """
    if model == "physics":
        return None
    specification = parse_model(model)
    if isinstance(specification, PolynomialModel):
        return specification.degree
    if isinstance(specification, (EnergyModel, ActuatedModel)):
        return None
    raise InputError(f"model {model!r}: designs are for polynomials, energies and physics")


def regressor(
    poses: F,
    settings: DesignSettings,
    *,
    measured: F | None = None,
    base: NominalModel | None = None,
) -> Regressor:
    """Information rows of `poses` (N, d) for a model, with the effects that act at a pose."""
    everything = poses if measured is None else np.concatenate([poses, measured])
    effects = settings.effects
    prior: F | None = None
    degree = polynomial_degree(settings.model)
    if degree is None:
        blocks = model_columns(everything, settings, base)
        if base is not None and blocks.shape[1] == len(WRENCH):
            blocks = blocks[:, [WRENCH.index(name) for name in base.base.outputs]]
        if effects:
            blocks, prior = _with_effects(blocks, everything, _needed(base, "effects"), effects)
        if base is None:
            blocks = blocks / COMPONENT_SD[None, :, None]
        else:
            blocks = base.whiteners(everything) @ blocks
        per_pose = blocks.shape[1]
    else:
        if effects:
            raise InputError(
                f"model {settings.model!r}: a free polynomial absorbs most effects; "
                "give --model energyD or physics with --effects"
            )
        blocks = _polynomial(poses, everything, degree)[:, None, :]
        if base is not None:
            # One row for six outputs: weighted by the geometric mean of their precisions.
            _, log_det = np.linalg.slogdet(base.whiteners(everything))
            blocks = blocks * np.exp(log_det / len(base.base.outputs))[:, None, None]
        per_pose = 1
    rows = np.ascontiguousarray(blocks.reshape(-1, blocks.shape[2]))
    split = len(poses) * per_pose
    if settings.ridge > 0.0:
        known = np.full(rows.shape[1], settings.ridge)
        known[: 1 if per_pose == 1 else 0] = 0.0
        prior = np.diag(known) if prior is None else prior + np.diag(known)
    if degree is None and per_pose < len(WRENCH):
        # Fewer columns may tell nothing of some coefficients, as three forces of an energy's pure
        # turns, or not tell some apart, as those of physics: the design is for what they tell.
        seen = seen_combinations(rows)
        rows, prior = rows @ seen, None if prior is None else seen.T @ prior @ seen
    return Regressor(
        rows[:split].copy(), per_pose, None if measured is None else rows[split:].copy(), prior
    )


def model_columns(poses: F, settings: DesignSettings, base: NominalModel | None) -> F:
    """(N, 6, k) wrench per coefficient of an energy model or of physics.

    Physics: the sensitivities to the modulus and, where the base has it tabulated, to Poisson's
    ratio.
    """
    model, length_m = settings.model, settings.length_m
    if settings.columns[: len(POSE)] != POSE:
        raise InputError(
            f"a design for {model} needs all six pose columns, found "
            f"{', '.join(settings.columns)}: take a polynomial, as --model cubic"
        )
    if model == "physics":
        return _needed(base, "the physics model").base.columns(np.ascontiguousarray(poses))
    if length_m is None and base is not None:
        length_m = base.base.length_m
    if length_m is None:
        raise InputError(
            f"a design for {model} needs the mechanism's length: give [mechanism] length_m "
            "in the candidates' TOML"
        )
    energy = parse_model(model)
    if isinstance(energy, ActuatedModel):
        empty = energy.empty_map(poses, length_m, settings.columns[6:])
        if not empty.input_scale.all():
            raise InputError(f"model {model!r}: {settings.columns[6:]} are 0 in every candidate")
        return empty.columns(poses)
    if not isinstance(energy, EnergyModel):
        raise InputError(f"model {model!r}: expected an energy or physics")
    return energy.terms(length_m).regressor(poses, np.array([length_m, 1.0]))


def _needed(base: NominalModel | None, what: str) -> NominalModel:
    if base is None:
        raise InputError(f"a design for {what} needs a nominal base: see nominal_model")
    return base


def _with_effects(
    blocks: F, poses: F, base: NominalModel, effects: Sequence[Effect]
) -> tuple[F, F]:
    columns, scales = base.effect_columns(poses, effects)
    # What the base absorbs stays determined by the prior alone.
    prior = np.concatenate([np.zeros(blocks.shape[2]), (_FAR * scales) ** -2.0])
    return np.concatenate([blocks, columns], axis=2), np.diag(prior)


def _polynomial(candidates: F, poses: F, degree: int) -> F:
    low, high = candidates.min(axis=0), candidates.max(axis=0)
    moving = high > low
    return polynomial_regressor(
        np.ascontiguousarray(poses[:, moving]), degree, low[moving], high[moving]
    )


_REGION = 1000
"""Poses over which an I-optimal design averages at most, as in `ecm-design`."""
_STEP = 1e-4
"""Step of the derivative of the columns, over the candidates' range."""


def prediction_region(
    poses: F, settings: DesignSettings, base: NominalModel | None, terms: int
) -> F:
    """Rows whose mean variance is that of h plus that of K times half the range.

    Of evenly chosen poses; each of the d coordinates weighs 1/d in K. `terms` may exceed those of
    the model by the parameters of effects: what they add to a reading is no part of h.
    """
    stride = max(1, -(-len(poses) // _REGION))
    seen = np.arange(0, len(poses), stride)
    values, slopes = predicted_columns(poses, seen, settings, base)
    count = slopes.shape[1] // values.shape[1]
    # The mean is over all rows there: what is wanted is over the poses of the sample.
    whole = np.sqrt(1.0 + count)
    rows = [whole * values, whole / np.sqrt(count) * slopes]
    joined = np.concatenate([part.reshape(-1, part.shape[2]) for part in rows])
    return np.ascontiguousarray(np.pad(joined, ((0, 0), (0, terms - joined.shape[1]))))


def predicted_columns(
    poses: F, seen: I, settings: DesignSettings, base: NominalModel | None
) -> tuple[F, F]:
    """Columns of the sample in units of the noise, and of K times half the pose's range."""
    low, high = poses.min(axis=0), poses.max(axis=0)
    moving = np.flatnonzero(high > low)
    degree = polynomial_degree(settings.model)

    sd: F = COMPONENT_SD
    if degree is None and base is not None:  # root mean variance over the candidates
        sd = np.sqrt(base.noise.variances(base.rows(poses)).mean(axis=0))

    def columns(at: F) -> F:
        if degree is None:
            return model_columns(at, settings, base) / sd[None, :, None]
        return _polynomial(poses, at, degree)[:, None, :]

    sample = poses[seen]
    steps = []
    for j in moving:
        step = np.zeros(poses.shape[1])
        step[j] = _STEP * (high[j] - low[j])
        steps.append((columns(sample + step) - columns(sample - step)) / (4.0 * _STEP))
    return columns(sample), np.concatenate(steps, axis=1)
