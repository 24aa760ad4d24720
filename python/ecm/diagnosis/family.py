"""The family of a cause whose form is not known: what its error follows.

The driver of a family is what the error follows: time, a temperature, the time at rest, the way to
the pose, the largest load so far, a recorded column. Each driver is a smooth process d = C w of few
columns C, the base projected out, w ~ N(0, s^2 I): with the noise's variance integrated over its
inverse gamma prior, the evidence of a size s is

    log p(y | s) = -sum_j log(1 + s^2 d_j^2) / 2 - (v + n) / 2 log(f + y'y - sum_j g_j (u_j'y)^2),

g_j = s^2 d_j^2 / (1 + s^2 d_j^2), U D V' = C; f is v and what one cause may leave of the most that
a process explains: with little noise it would else tell all. Sizes are summed over a grid. The
posterior compares the drivers with each other, with a process of the pose, which is no family, with
nothing, and with effects that may be named: a process of their columns, each of one length.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ecm.comparison.residuals import KNOWN, candidate_covariates, in_one_order
from ecm.diagnosis.left_over import draft_of
from ecm.diagnosis.problem import Candidates, Problem
from ecm.diagnosis.search import ONE_CAUSE_SHARE, bounded_estimate
from ecm.diagnosis.settings import FORM_SHARE, MOST_IN_CLASS
from ecm.effects.experiments import get_experiment
from ecm.effects.relaxation import hereditary, time_constants
from ecm.effects.sensor import warmth_of
from ecm.io.arrays import F, eigh, evenly, rms, rms_of_columns, svd
from ecm.io.columns import POSE, TEXT, WRENCH
from ecm.io.table import Table
from ecm.models.actuated import ActuatedMap
from ecm.models.joint_fit import further_columns
from ecm.models.maps import EnergyMap
from ecm.models.partial import whole_map
from ecm.regression.f_test import orthonormal
from ecm.regression.history import before_each, has_order, largest_so_far, row_before, speeds
from ecm.regression.rows import Rows, inputs_of

_SIZES = np.geomspace(0.1, 30.0, 13)
"""Rms of a process over the noise, each as likely."""
_EVERY_TAU = 4
"""Every fourth time constant of a relaxation is tried: a process has any form."""
_KNOWN, _UNKNOWN = 30.0, 1.0
"""Degrees of freedom of what is known of the noise: of repeats or figures, and of none."""
_MOST_ROWS = 600
_ZERO = 1e-6
"""Coefficient that is zero but for the slack of its bound."""
_ASYMMETRIC = (2, 4)
"""Degrees of an energy without symmetry that may be what a symmetric one lacks."""
_NO_OTHER = 0.95
"""Rank correlation from which a driver is no other than the pose."""
SURE = 0.9
"""Probability from which a family is said, as that of a name."""
FURTHER_CAUSE = (1.0 - SURE) / SURE
"""Odds of each cause after the first, or after those that a model holds: one is likelier."""


@dataclass(frozen=True)
class Driver:
    """What an error may follow, and the smooth processes of it."""

    name: str
    """In words, as in "the time at rest"."""
    like: tuple[str, ...]
    """Effects of the catalogue that it drives."""
    experiment: str
    """Id or action of the experiment that shows its form."""
    column: str = ""
    """Column of the table that it is; empty where it follows from the order of the rows."""
    history: Mapping[str, tuple[str, F]] = field(default_factory=dict)
    """What else drives it, by name: Python text for a draft, and values (N,)."""


@dataclass(frozen=True)
class Family:
    """A known driver of what is missing, or several of which one is; the form is not known."""

    driver: str
    """In words, the likeliest first; several are joined by "or"."""
    drivers: int
    """How many they are."""
    columns: tuple[str, ...]
    """Their columns in the table; a driver that follows from the order of the rows has none."""
    draft: str
    """Python text of an effect of the likeliest driver."""
    like: tuple[str, ...]
    """Effects of the catalogue that follow the same drivers, none of which fits."""
    experiment: str
    """What to do next, in words."""
    minutes: int
    """Its time at the rig."""
    probability: float = 0.0
    """That one of the drivers is right."""


def drives(one: Driver | Family, classes: Sequence[Sequence[str]]) -> bool:
    """Whether each class has an effect that follows the driver, or one of the family."""
    return all(set(one.like).intersection(members) for members in classes)


@dataclass(frozen=True)
class Posterior:
    """The probability of everything that may explain what the base leaves; the sum is 1."""

    drivers: tuple[Driver, ...]
    of_drivers: tuple[float, ...]
    of_pose: float
    """That of a smooth process of the pose."""
    of_effects: float
    """That of the effects that may be named; 0 where none may."""
    of_nothing: float

    @property
    def nothing_is_likeliest(self) -> bool:
        """Whether no process and no effect is as likely as nothing."""
        return self.of_nothing > max(*self.of_drivers, self.of_pose, self.of_effects)


def find_family(
    problem: Problem, chances: Posterior, classes: Sequence[Sequence[str]]
) -> Family | None:
    """Return the family of what the base leaves; None where no three drivers are sure together.

    The posterior is that with the effects, of these classes, that pass every check and are no names
    all the same.
    """
    likeliest = _by_probability(chances, classes)[:MOST_IN_CLASS]
    fewest = int(np.searchsorted(np.cumsum([p for _, p in likeliest]), SURE)) + 1
    if fewest > len(likeliest):
        return None
    said = [one for one, _ in likeliest[:fewest]]
    if fewest == 1:
        said += _in_its_order(problem, said[0], chances.drivers)
    # Of several, one that a user can set tells them apart: time goes on with all of them.
    apart = next((one for one in said if one.column not in ("time_s", "row")), said[0])
    experiment = get_experiment(apart.experiment)
    return Family(
        driver=" or ".join(one.name for one in said),
        drivers=len(said),
        columns=tuple(one.column for one in said if problem.table.has(one.column)),
        draft=draft_of(problem, said[0].column, said[0].history),
        like=tuple(dict.fromkeys(id for one in said[:fewest] for id in one.like)),
        experiment=experiment.words(problem.table),
        minutes=experiment.minutes,
    )


def _by_probability(
    chances: Posterior, classes: Sequence[Sequence[str]]
) -> list[tuple[Driver, float]]:
    """The drivers, the likeliest first, where the effects are no names.

    Their weight is that of the drivers which all of them follow, in equal parts.
    """
    follow = [drives(one, classes) for one in chances.drivers]
    part = chances.of_effects / max(sum(follow), 1)
    found = [
        (one, p + part * follows)
        for one, p, follows in zip(chances.drivers, chances.of_drivers, follow, strict=True)
    ]
    return sorted(found, key=lambda item: -item[1])


def _in_its_order(problem: Problem, best: Driver, drivers: Sequence[Driver]) -> list[Driver]:
    """Return the drivers whose columns are in the order of that of the best one."""
    table = problem.table
    by_column = {one.column: one for one in drivers if table.has(one.column)}
    by_column = {column: one for column, one in by_column.items() if column not in TEXT}
    if by_column.pop(best.column, None) is None:
        return []
    own = _values(table, best.column)
    return [one for column, one in by_column.items() if in_one_order(own, _values(table, column))]


def posterior(problem: Problem, named: Candidates = (), others: Candidates = ()) -> Posterior:
    """Return how likely drivers, pose, named effects and nothing are, beside other effects."""
    rows = evenly(len(problem.table), _MOST_ROWS)
    m = problem.response.shape[1]
    numbers = (m * rows[:, None] + np.arange(m)).ravel()
    there = [column for item in others for column in item.columns]
    blocks = [problem.coefficient_block, problem.design[:, :, there]]
    base = orthonormal(problem.flat(np.concatenate(blocks, axis=2))[numbers])

    def beside(columns: F) -> F:
        some = problem.flat(columns)[numbers]
        return np.asarray(some - base @ (base.T @ some))

    # The base's own errors D have coefficients N(0, 1): beside them all is in units of I + D D'.
    errors, sizes, _ = svd(beside(problem.own_errors))
    less = 1.0 - 1.0 / np.sqrt(1.0 + sizes**2 / problem.scale)

    def beside_base(columns: F) -> F:
        some = beside(columns)
        return np.asarray(some - errors @ (less[:, None] * (errors.T @ some)))

    y = beside_base(problem.response[:, :, None])[:, 0] / np.sqrt(problem.scale)
    known = _UNKNOWN if problem.noise.is_assumed else _KNOWN
    freedom = y.size - base.shape[1]

    accepted = frozenset(item.id for item in (*named, *others))

    def fitted(forms: Iterable[F]) -> list[tuple[F, F]]:
        return [_of_sizes(beside_base(problem.whitener.in_time(form)), y) for form in forms]

    # Each form is dropped when it is fitted: those of all drivers are a large part of the memory.
    told = [(driver, fitted(forms)) for driver, forms in _drivers(problem, accepted)]
    drivers = tuple(driver for driver, _ in told)
    fits = [*(fit for _, fit in told), fitted(_of_pose(problem))]
    if named:
        # What an effect would explain beyond a bound of zero is not this effect.
        fit = bounded_estimate(problem, named, named)
        zero = fit.at_bound & (np.abs(fit.theta) < _ZERO)
        within = (fit.columns >= problem.n_base) & ~zero
        fits.append([_of_sizes(beside_base(problem.design[:, :, fit.columns[within]]), y)])
    # A process is no more exact than the form of an effect: what that may lose tells nothing, and
    # what may be left without a word is as noise. Nor does what an effect of the model may lose.
    held = 0.0 if named else problem.held
    explained = float(y @ y) - min(float(left.min()) for some in fits for left, _ in some)
    floor = known + ONE_CAUSE_SHARE * max(explained, held)

    def gain(left: F, cost: F) -> float:
        fall = np.log((floor + y @ y) / (floor + left))
        return _mean_of_logs(0.5 * (known + freedom) * fall - cost)

    of_all = [_mean_of_logs([gain(*one) for one in some]) for some in fits]
    gains = np.array([*of_all, 0.0])
    unit = max(1.0, FORM_SHARE * max(float(gains.max()), 0.5 * held))
    shares = np.exp((gains - gains.max()) / unit)
    # Before the data nothing is as likely as all else together.
    shares[-1] *= len(fits)
    if named:
        # One cause is likelier than two that act together as one.
        shares[-2] *= FURTHER_CAUSE ** (len(named) - 1)
    *of_each, of_nothing = (shares / shares.sum()).tolist()
    of_effects = of_each.pop() if named else 0.0
    *of_drivers, of_pose = of_each
    return Posterior(drivers, tuple(of_drivers), of_pose, of_effects, of_nothing)


def _of_sizes(columns: F, y: F) -> tuple[F, F]:
    """Squares that a process of columns (r, q) leaves with each of its sizes, and their cost."""
    u, d, _ = svd(columns)
    if not d.size or d[0] <= 1e-9:
        return np.array([y @ y]), np.array([np.inf])
    d = d / np.sqrt((d**2).sum() / y.size)
    gain = (_SIZES[:, None] * d) ** 2
    left = y @ y - (gain / (1.0 + gain)) @ (u.T @ y) ** 2
    return left, 0.5 * np.log1p(gain).sum(axis=1)


def _mean_of_logs(logs: Sequence[float] | F) -> float:
    """Return the log of the mean of what these are the logs of."""
    return float(np.logaddexp.reduce(logs) - np.log(len(logs)))


_SLOW = ("ageing", "fts_drift"), "repeat_first_poses", 6
_COLUMNS = {
    "time_s": ("time", *_SLOW),
    "temperature_degC": (
        "the temperature of the body",
        ("temperature_modulus", "thermal_expansion"), "warm_and_cold", 4,
    ),
    "sensor_temperature_degC": (
        "the temperature of the sensor", ("fts_thermal_drift",), "zero_warm_and_cold", 4
    ),
}  # fmt: skip
"""Column -> words, effects that it drives, experiment, cosines of it."""


def _drivers(problem: Problem, accepted: frozenset[str]) -> Iterator[tuple[Driver, Iterable[F]]]:
    """Yield the drivers that vary, each with (N, m, q) processes, each as likely.

    The processes are whitened row by row.
    """
    table = problem.table
    named = candidate_covariates(table, problem.base.inputs, problem.base.outputs)
    own = [name for name in named if name not in KNOWN]
    of_user = {n: (n, (f"unused_column:{n}",), f"vary {n} alone", 4) for n in own}
    # Without a time the order of the rows stands for it.
    order = {} if table.has("time_s") else {"row": ("the order of the rows", *_SLOW)}
    known = dict(_COLUMNS)
    if (followed := warmth_of(table)) == "temperature_degC":  # it stands for that of the sensor
        words, like, action, cosines = known[followed]
        known[followed] = words, like + known["sensor_temperature_degC"][1], action, cosines
    for column, (words, like, experiment, count) in (known | order | of_user).items():
        values = _values(table, column)
        # Along one loading curve a variable cannot be told from the pose.
        of_pose = any(in_one_order(values, own, least=_NO_OTHER) for own in problem.rows.poses.T)
        if np.ptp(values) > 0.0 and not of_pose:
            yield Driver(words, like, experiment, column), _of_column(problem, column, count)
    rest = np.log(np.maximum(_values(table, "dwell_s"), 0.1))
    if np.ptp(rest) > 0.0:
        forms = _factors(problem, _cosines(rest, 3))
        yield Driver("the time at rest", ("stress_relaxation",), "three_dwells", "dwell_s"), forms
    if has_order(table) or table.has("approach"):
        yield from _of_history(problem, accepted)


def _values(table: Table, column: str) -> F:
    if column == "row":
        return table.row_numbers.astype(np.float64)
    return np.nan_to_num(table.column(column)) if table.has(column) else np.zeros(len(table))


def _lagging(rows: Rows, column: str) -> Iterator[F]:
    """Yield (N,) the temperature as a thick body takes it on, by some time constants."""
    if column == "temperature_degC":
        values = _values(rows.whole.table, column)
        for ahead in _fading(rows, values[:, None]):
            yield rows.of_whole(values) - ahead[:, 0]


def _of_column(problem: Problem, column: str, count: int) -> Iterator[F]:
    """Yield (N, m, q) what follows a column: functions of it, and factors on the wrench."""
    for values in (_values(problem.table, column), *_lagging(problem.rows, column)):
        functions = _cosines(values, count)
        for factor in _factors(problem, functions):
            yield np.concatenate([_free(problem, functions), factor], axis=2)


def _of_history(problem: Problem, accepted: frozenset[str]) -> Iterator[tuple[Driver, Iterable[F]]]:
    """Yield the drivers that follow from the poses before."""
    rows = problem.rows
    before = _before(rows)
    spread = rms_of_columns(rows.poses - rows.middle_pose) + 1e-12
    continuous = rows.whole.table.continuous
    known = np.where(np.isfinite(before), rows.poses - before, 0.0) / spread
    step = _velocities(rows) if continuous else known
    if not step.any():
        return
    side = step / np.maximum(np.linalg.norm(step, axis=1), 0.3)[:, None]
    stiffness = problem.whitener.each @ rows.stiffness * spread
    shifted = stiffness / max(rms(stiffness), 1e-300) * side[:, None, :]
    way = np.concatenate([_free(problem, np.hstack([side, np.tanh(step)])), shifted], axis=2)
    # Of the table: a base may take inputs that the model of a draft does not have.
    names = [(j, name, f"rows.table.column('{name}')") for j, name in enumerate(rows.base.inputs)]
    like = ("hysteresis", "backlash", "fts_hysteresis")
    text = "np.sign(np.diff({0}, prepend={0}[0]))"
    signs = {
        f"the way along {name}": (text.format(at), np.sign(step[:, j])) for j, name, at in names
    }
    yield Driver("the way to the pose", like, "both_sides", "approach", signs), [way]
    whole = rows.whole
    moved = (whole.measured.poses - rows.middle_pose) / spread
    of_pose = [j for j, name, _ in names if name in POSE]
    visit = np.where(np.isfinite(before), before - rows.middle_pose, 0.0) / spread
    text = "np.r_[{0}[:1], {0}[:-1]]"
    visits = {f"{name} before": (text.format(at), visit[:, j]) for j, name, at in names}
    if not (continuous and accepted & set(like)):
        # Along the path of a log a free process of it takes in friction that has a name as well.
        # There the row before is no more than the row itself.
        places = [*(() if continuous else (visit,)), *_fading(rows, moved[:, of_pose])]
        poses_before = Driver("the poses before", ("stress_relaxation",), "both_sides", "", visits)
        yield poses_before, (_free(problem, one) for one in places)
    if has_order(problem.table):
        sizes = _sizes_of_load(whole)
        text = "np.maximum.accumulate(np.linalg.norm(rows.wrench, axis=1))"
        load = np.maximum.accumulate(np.linalg.norm(rows.wrench, axis=1))
        so_far = Driver("the largest deflection so far", ("mullins_softening",),
                        "conditioning_cycles", "",
                        {"the largest wrench so far": (text, load)})  # fmt: skip
        yield so_far, (f for one in sizes for f in _factors(problem, _of_memory(rows, one)))


def _velocities(rows: Rows) -> F:
    """(N, n) velocities of the inputs of a continuous test, each over its rms.

    By the rows on both sides: a step from the row before holds the noise of the row's own pose, and
    so does its residual.
    """
    known = speeds(rows.table)
    of_each = [known.get(f"v_{name}", np.zeros(len(rows))) for name in rows.base.inputs]
    return np.stack([one / (rms(one) + 1e-300) for one in of_each], axis=1)


def _fading(rows: Rows, driven: F) -> Iterator[F]:
    """Yield (N, k) what time constants leave of changes (n, k) of all rows; none without time."""
    table = rows.whole.table
    if table.has("time_s"):
        for tau in time_constants(table)[::_EVERY_TAU]:
            yield rows.of_whole(hereditary(table, driven, tau, rows.quiet))


def _work(rows: Rows) -> F:
    """(N,) size of wrench times way from the middle pose, over the axes that have both."""
    known = dict(zip(rows.base.outputs, rows.wrench.T, strict=True))
    known |= dict(zip(rows.base.inputs, (rows.poses - rows.middle_pose).T, strict=True))
    axes = (pair for pair in zip(POSE, WRENCH, strict=True) if known.keys() >= set(pair))
    return np.abs(sum((known[name] * known[other] for name, other in axes), np.zeros(len(rows))))


def _of_memory(rows: Rows, size: F) -> F:
    """(N, 4) what smooth functions of size and largest so far have beside those of the size.

    The size, of all rows, is a function of the pose; beside the last largest there is no memory.
    """
    most = rows.of_whole(largest_so_far(rows.whole.table, size))
    own = rows.of_whole(size) + 0.05
    below, after = (np.log((one + 0.05) / own) for one in (most, size.max()))
    waves = np.arange(1, 4) * np.pi / after.max()
    memory = np.cos(np.outer(below, waves)) - np.cos(np.outer(after, waves))
    return np.column_stack([(below - after) / after.max(), memory / np.arange(1, 4) ** 1.5])


def _before(rows: Rows) -> F:
    """(N, n) pose before each row; NaN where it is not known."""
    if tuple(rows.base.inputs) == tuple(POSE) and rows.has_length:
        return rows.came_from
    whole = rows.whole
    return rows.of_whole(before_each(whole.poses, row_before(whole.table)))


def _of_pose(problem: Problem) -> Iterator[F]:
    """Yield (N, m, q) smooth processes of the pose: in each component, and forms of a body.

    These are a factor on the wrench that follows the deflection or the work, as every nonlinear
    material has, and what an energy of two degrees more holds, or one of low degree without
    symmetry. Beside them alone the largest deflection so far has a meaning: in a test that grows it
    is much like the deflection itself; and readings that mix axes: those of a skewed body do.
    """
    rows = problem.rows
    # A base of actuators errs in what drives it as well.
    driven = inputs_of(problem.base, rows.table)[:, rows.poses.shape[1] :]
    at = np.hstack([rows.poses - rows.middle_pose, driven - driven.mean(axis=0)])
    at = at / (rms_of_columns(at) + 1e-12)
    some = at[np.random.default_rng(0).permutation(len(at))[:40]]

    def kernel(a: F, b: F) -> F:
        squares = ((a[:, None] - b[None]) ** 2).sum(axis=2)
        return np.asarray(np.exp(-squares / (3.0 * at.shape[1])))

    values, vectors = eigh(kernel(some, some) + 1e-6 * np.eye(len(some)))
    yield _free(problem, (kernel(at, some) @ vectors / np.sqrt(values))[:, ::-1][:, :24])
    for size in _sizes_of_load(rows.whole):
        yield from _factors(problem, _cosines(rows.of_whole(size), 4))
    base = whole_map(problem.base)
    if isinstance(base, EnergyMap) and base.terms.symmetry != "general":  # that has thousands
        more = replace(base.terms, degree=base.terms.degree + 2)
        free = [replace(more, degree=d, symmetry="general", groups=()) for d in _ASYMMETRIC]
        outputs = [WRENCH.index(name) for name in problem.base.outputs]
        for terms in (more, *free):
            yield _of_rms_one(problem, terms.regressor(rows.poses, base.model.scale)[:, outputs])
    if isinstance(base, ActuatedMap) and base.terms.body != "general":
        yield _of_rms_one(problem, further_columns(rows, problem.base))


def _of_rms_one(problem: Problem, columns: F) -> F:
    """Columns (N, m, k) in units of the noise, each over its rms."""
    columns = problem.whitener.each @ columns
    return np.asarray(columns / (np.sqrt((columns**2).mean(axis=(0, 1))) + 1e-300))


def _sizes_of_load(rows: Rows) -> list[F]:
    """(N,) deflection and work, each over its rms: stiff directions add more to the work."""
    moved = rows.measured.poses - rows.middle_pose
    moved = moved / (rms_of_columns(moved) + 1e-12)
    sizes = np.sqrt((moved**2).sum(axis=1)), _work(rows)
    return [one / rms(one) for one in sizes if np.ptp(one) > 0.0]


def _cosines(values: F, count: int) -> F:
    """(N, 1 + count) a line and smooth functions, half by ranks, the slow ones the largest."""
    rank = np.argsort(np.argsort(values, kind="stable"), kind="stable") / (len(values) - 1)
    along = (values - values.min()) / np.ptp(values)
    at = 0.5 * rank + 0.5 * along
    waves = [np.cos(np.pi * k * at) / k**1.5 for k in range(1, count + 1)]
    return np.stack([2.0 * along - 1.0, *waves], axis=1)


def _free(problem: Problem, functions: F) -> F:
    """(N, m, m q) each function (N, q) in each whitened component."""
    n, m = problem.response.shape
    return np.asarray(np.einsum("nq,ij->niqj", functions, np.eye(m)).reshape(n, m, -1))


def _factors(problem: Problem, functions: F) -> tuple[F, F]:
    """Each function (N, q) as a factor on the wrench (N, m, q), on each component (N, m, m q)."""
    load = problem.whitener.each @ problem.rows.wrench[:, :, None]
    load = load / max(rms(load), 1e-300)
    return load * functions[:, None, :], load * _free(problem, functions)
