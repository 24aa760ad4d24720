"""What a residual shows: structure that is no chance, its signature, runs that are outliers.

One function answers for every command. Two tests look at the residual of the model as it stands:
its lack of fit against repeats, and smooth functions of the pose, the order, the motion of a
continuous test and every other column.
Both compare with what is left in the same rows, so that noise that was stated too small or too
large does not decide.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.special import chdtrc

from ecm.comparison.residuals import KNOWN, chebyshev, features, in_each_component, second_degree
from ecm.io.arrays import B, F, I, eigh, rms
from ecm.io.columns import JOINT_SIGNS, JOINTS, VELOCITY
from ecm.io.settings import MOST_OF_ONE_INPUT, POLYNOMIAL_DEGREES
from ecm.io.table import Table
from ecm.models.errors import NEAR_NOISE
from ecm.models.refit import FAR_BEYOND_NOISE
from ecm.regression.f_test import Beside, explained_by_span, lack_of_fit
from ecm.regression.folds import repeat_cells
from ecm.regression.history import order_of_visits, speeds, values_before
from ecm.regression.normal_equations import in_threads
from ecm.regression.rows import Rows, driven_by, is_whole
from ecm.regression.slow_noise import deviance_in_time

LEVEL = 0.01
"""Chance of a wrong rejection."""
_NOTHING = "nothing in it follows the pose, the order or another column"
_ALIKE, _SURE = 0.2, 5.0
"""Correlation of neighbouring residuals that is said, and how far beyond chance it must be."""
LEAST_STRENGTH = 0.15
"""Structure weaker than this, in units of the noise, does not count: no base is better."""


@dataclass(frozen=True)
class StructureTest:
    """The more significant of two tests of a residual.

    Examples
    --------
    >>> StructureTest(F=8.0, p=1e-6, strength=0.5).found
    True
    >>> StructureTest(F=8.0, p=1e-6, strength=0.05).found
    False
    """

    F: float
    p: float
    strength: float
    """Root mean square of what the tests explain beyond chance, in units of the noise."""

    @property
    def found(self) -> bool:
        """Whether structure is seen, and strong enough to count."""
        return self.p < LEVEL and self.strength >= LEAST_STRENGTH


def structure_test(rows: Rows, whitened: F, whitener: F, *, fitted: F | None) -> StructureTest:
    """Test the residual of a model for structure.

    Where neighbours of a log err alike, structure counts that makes the residual likelier than such
    noise does.

    Parameters
    ----------
    rows
        N rows with their map; of a log `quieted`.
    whitened
        (N, m) residual over its noise.
    whitener
        (N, m, m) of the rows.
    fitted
        (N, m, k) whitened columns of the coefficients that were fitted to these rows; None: none.
    """
    n, m = whitened.shape
    scored = rows.table.of_poses
    own = np.zeros((n, m, 0)) if fitted is None else fitted
    weights = scored.astype(np.float64)
    known, motion = features(rows, max(1, min(90, n // 3)))[0], _motion(rows)
    inputs = rows.base.inputs
    bent = _higher_degrees(rows, 6 if len(inputs) <= 2 else 3)
    every = np.hstack([known, other_columns(rows), bent, motion])
    beside = [Beside.of(whitened, in_each_component(whitener, every), own, weights, overwrite=True)]
    # Of few rows little is left beside all functions together: these are few. Friction and play of
    # visits follow the last step, and a stop degrees beyond all those that a model may have.
    steps = _changes(rows, () if rows.table.continuous else inputs, np.nan)
    beyond = 3 + (MOST_OF_ONE_INPUT if len(inputs) == 1 else POLYNOMIAL_DEGREES[1])
    few = (motion, steps, _higher_degrees(rows, beyond))
    beside += [beside[0].of_others(in_each_component(whitener, f)) for f in few if f.shape[1]]
    tests = [one.with_sign_chance(one.omnibus_test()) for one in beside]
    repeated = lack_of_fit(whitened, repeat_cells(rows.table), own.shape[2], weights)
    if repeated is not None:
        tests.append(repeated)
    finite = [test for test in tests if np.isfinite(test.F)]
    if not finite:
        return StructureTest(float("nan"), 1.0, 0.0)
    best = min(finite, key=lambda test: test.p)
    # Over the noise of the row, not over the rest: so far the noise is believed.
    chance = best.dof * best.rest / best.dof_error
    beyond = max(0.0, best.explained - chance) / max(1.0, float(weights.sum()) * m)
    p = min(1.0, best.p * len(finite))
    if p < LEVEL and rows.table.continuous:
        seen = beside[min(range(len(beside)), key=lambda i: tests[i].p)]
        p = max(p, _chance_in_slow_noise(rows.table.select(scored), seen, scored))
    return StructureTest(best.F, p, float(np.sqrt(beyond)))


def beside_coefficients(whitened: F, columns: F, covariance: F) -> F:
    """(N, m) residual on rows that coefficients were not fitted to, over noise and their errors.

    Parameters
    ----------
    whitened
        (N, m) residual over the noise alone.
    columns
        (N, m, k) whitened columns of the coefficients.
    covariance
        (k, k) of the coefficients, from the rows that they were fitted to.

    Examples
    --------
    >>> beside_coefficients(np.array([[2.0]]), np.ones((1, 1, 1)), np.array([[3.0]]))
    array([[1.]])
    """
    values, vectors = eigh(covariance)
    images = columns.reshape(-1, len(values)) @ (vectors * np.sqrt(np.maximum(values, 0.0)))
    squares, turn = eigh(images.T @ images)
    root = np.sqrt(1.0 + np.maximum(squares, 0.0))  # of the covariance I + images images'
    own = images @ turn
    along = (own.T @ whitened.ravel()) / (root * (root + 1.0))
    return np.asarray(whitened - (own @ along).reshape(whitened.shape))


def _chance_in_slow_noise(log: Table, beside: Beside, scored: B) -> float:
    """Chance that columns make a residual likelier by so much, each in its likeliest noise.

    Twice the logarithm of the likelihood ratio has a chi-squared distribution, or is less: columns
    that were fitted as if rows erred independently take less of slow noise.
    """
    before, after = (deviance_in_time(log, left[scored]) for left in (beside.residual, beside.rest))
    if before is None or after is None:
        return 0.0
    return float(chdtrc(beside.span.rank, max(before - after, 0.0)))


def _higher_degrees(rows: Rows, most: int) -> F:
    """Return (N, q) polynomials above the quadratic in each coordinate, up to degree `most`."""
    poses = rows.poses
    moved = [pose for pose in poses.T if np.ptp(pose) > 0.0]
    return np.hstack([np.zeros((len(poses), 0)), *(chebyshev(p, most)[:, 3:] for p in moved)])


def _changes(rows: Rows, names: Sequence[str], rest: float) -> F:
    """Return (N, q) the last change of each of these columns, where it varies, and its sign."""
    if not names:
        return np.zeros((len(rows), 0))
    before = values_before(rows.table, names, np.full(len(names), rest))
    changes = np.nan_to_num(rows.table.matrix(names) - before)
    changes = changes[:, np.ptp(changes, axis=0) > 0.0]
    return np.hstack([changes / changes.std(axis=0), np.sign(changes)])


def _motion(rows: Rows) -> F:
    """Return (N, q) velocities and ways of a continuous test; of few columns loops over the pose.

    A damper follows the velocity, a loop its sign, and the width of a loop the pose. What is wrong
    of an input of an actuator follows its last change or the sign of that, of visits as well.
    """
    columns = list(_changes(rows, driven_by(rows.base), 0.0).T)
    found = speeds(rows.table) if rows.table.continuous else {}
    few = len(rows.base.inputs) <= 2
    for j, name in enumerate(rows.base.inputs):
        velocity = found.get(f"v_{name}")
        if velocity is None:
            continue
        way = np.sign(velocity)
        columns += [velocity / velocity.std(), way]
        if few:
            columns += list(way * chebyshev(rows.poses[:, j], 4)[:, 1:].T)
    return np.stack(columns, axis=1) if columns else np.zeros((len(rows), 0))


def nothing_follows(over_noise: float, alike: float | None) -> str:
    """Return what is said of an error beyond the noise without structure.

    Parameters
    ----------
    over_noise
        Error over the noise.
    alike
        Correlation of neighbouring rows where it is no chance: `neighbours_alike`.

    Examples
    --------
    >>> nothing_follows(1.04, None)
    'and nothing in it follows the pose, the order or another column'
    """
    if alike is not None:
        return (
            f"and {_NOTHING}, but neighbouring rows err alike (correlation {alike:.2f}), which the "
            "noise of single readings does not: a period, a memory, or noise that changes slowly"
        )
    if over_noise <= NEAR_NOISE:
        return f"and {_NOTHING}"
    why = "that noise is too small"
    if over_noise > 2.0 * FAR_BEYOND_NOISE:
        why = "a few rows hold most of it (--report lists the worst)"
    return f"but {_NOTHING}: {why}, or these rows are too few to show what is missing"


def neighbours_alike(table: Table, rows: I, whitened: F) -> float | None:
    """Return the correlation of the residuals of rows that follow each other in time, if it is one.

    Parameters
    ----------
    rows
        (n,) rows of the table.
    whitened
        (n, m) their residuals over the noise.

    Returns
    -------
    float or None
        None without time, or where chance gives as much.
    """
    if not table.has("time_s"):
        return None
    place = np.full(len(table), -1)
    place[rows] = np.arange(len(rows))
    together, count = 0.0, 0
    for order in order_of_visits(table):
        own = place[order]
        first, second = own[:-1], own[1:]
        both = (first >= 0) & (second >= 0)
        together += float((whitened[first[both]] * whitened[second[both]]).sum())
        count += int(both.sum()) * whitened.shape[1]
    if count == 0:
        return None
    correlation = together / count / max(float((whitened**2).mean()), 1e-300)
    return correlation if correlation > max(_ALIKE, _SURE / np.sqrt(count)) else None


def other_columns(rows: Rows) -> F:
    """Return (N, q) standardised velocities, joints, their signs and tendons: no `features`."""
    table = rows.table
    names = [name for name in (*VELOCITY, *JOINTS, *JOINT_SIGNS) if table.has(name)]
    names += [name for name in table.columns if name.startswith("tendon")]
    values = [np.nan_to_num(table.column(name)) for name in names]
    varying = [(v - v.mean()) / v.std() for v in values if float(np.ptp(v)) > 0.0]
    return np.stack(varying, axis=1) if varying else np.zeros((len(rows), 0))


def signature_shares(
    rows: Rows, whitened: F, whitener: F, weights: F | None = None, scale: float = 1.0
) -> dict[str, float]:
    """Return the share of the residual's squares, beyond chance, that each family explains alone.

    Parameters
    ----------
    whitened, whitener
        (N, 6) residuals over their noise, and (N, 6, 6) the matrices that whiten a row.
    weights
        (N,) robust weights of the rows.
    scale
        Mean square of noise alone.

    Returns
    -------
    dict
        Share by signature; empty for tables without all six pose and wrench columns.
    """
    if not is_whole(rows.base) or not rows.has_length:
        return {}
    n, m = whitened.shape
    root = np.ones(n) if weights is None else np.sqrt(weights)
    y = (whitened * root[:, None]).ravel()
    total = float(y @ y)
    deflection = rows.poses - rows.rest_pose
    loaded = (~rows.unloaded).astype(np.float64)
    scaled = deflection / np.maximum(deflection.std(axis=0), 1e-12) * loaded[:, None]
    identity = np.broadcast_to(np.eye(6), (n, 6, 6))
    in_each = partial(in_each_component, identity)
    named: dict[str, F] = {
        "proportional": rows.wrench[:, :, None],
        "constant_in_base": identity,
        "constant_in_body": rows.base_from_top,
        "odd": in_each(scaled),
        "even": in_each(second_degree(scaled)),
    }
    values, names = features(rows, 90)
    for covariate in (*KNOWN, "approach"):
        own = [j for j, name in enumerate(names) if covariate in name.split("*")]
        if own:
            named[covariate] = in_each(values[:, own])

    def share(columns: F) -> float | None:
        z = whitener @ columns
        z = (z * root[:, None, None]).reshape(n * m, -1)
        if z.shape[1] >= n * m // 2:
            return None
        explained, rank = explained_by_span(z, y)
        return float(np.clip((explained - scale * rank) / total, 0.0, 1.0))

    shares = zip(named, in_threads(share, named.values()), strict=True)
    return {name: value for name, value in shares if value is not None}


_DEGREE = 3
_OUTLYING = 1.5
"""A run is an outlier where the curves of the others miss it so many times more than they miss each
other, and more than its readings scatter."""
_AS_FAR = 2.0
"""Ratio of the ways of two runs below which they move about as far."""
_SWAPPED = 0.5


@dataclass(frozen=True)
class RunOutlier:
    """One run that does not agree with the others."""

    run: int
    error: float
    """Error of the other runs' curves, over the size of the run's own reading."""
    others: float
    """The same error among the others."""
    swapped: bool
    """Whether it agrees with its pose and wrench columns exchanged."""

    def sentence(self) -> str:
        """Return one plain sentence."""
        text = (
            f"run {self.run} differs from the others: what they say of it is off by "
            f"{self.error:.2g} of its spread, among themselves by {self.others:.2g}"
        )
        return text + (
            "; its pose and wrench columns look exchanged: with them exchanged back it fits"
            if self.swapped
            else "; look at the specimen and the columns of that file"
        )


def run_outliers(table: Table, inputs: Sequence[str], outputs: Sequence[str]) -> list[RunOutlier]:
    """Return the runs that the others do not predict, for one pose and one wrench column.

    A cubic through each other run is compared with each run; of two runs or more that move about as
    far only through them, for the loop of a wide run says nothing of a narrow one. Strange is one
    that is unlike most runs and unlike its nearest as well: fast ones agree among themselves. Fewer
    than three runs give none: of two nobody can tell which one is wrong.
    """
    if len(inputs) != 1 or len(outputs) != 1 or not table.has("run"):
        return []
    x, y = table.column(inputs[0]), table.column(outputs[0])
    run = table.column("run")
    numbers = np.unique(run)
    if len(numbers) < 3:
        return []
    curves = [(x[run == n], y[run == n]) for n in numbers]

    def error(of: tuple[F, F], left_out: int) -> F:
        """(2,) against the other runs, the median and the nearest: neither sees one strange run."""
        others = [curve for i, curve in enumerate(curves) if i != left_out]
        way = np.ptp(of[0])
        alike = [by for by in others if way / _AS_FAR < np.ptp(by[0]) < way * _AS_FAR]
        misses = [_miss(of, by) for by in (alike if len(alike) > 1 else others)]
        return np.array([np.median(misses), np.min(misses)]) / rms(of[1])

    errors = np.array([error(own, i) for i, own in enumerate(curves)])
    outliers = []
    for i, number in enumerate(numbers):
        others = np.median(np.delete(errors, i, axis=0), axis=0)
        if (errors[i] > _OUTLYING * np.maximum(others, _noise(curves[i]))).all():
            again = error(_exchanged(curves[i], x[run != number], y[run != number]), i)[0]
            swapped = bool(again < min(_SWAPPED * errors[i, 0], _OUTLYING * others[0]))
            said = (float(errors[i, 0]), float(others[0]))
            outliers.append(RunOutlier(int(number), *said, swapped))
    return outliers


def _miss(of: tuple[F, F], by: tuple[F, F]) -> float:
    """Return the root mean square error at `of` of a cubic that is fitted to `by`."""
    low, high = float(by[0].min()), float(by[0].max())
    span = max(high - low, 1e-300)
    inside = np.clip(of[0], low - 0.1 * span, high + 0.1 * span)
    # Beyond the range of `by` the curve is constant, and the distance counts as a difference.
    beyond = (of[0] - inside) / span
    miss = of[1] - _curve(by, inside)
    scale = rms(by[1])
    return float(np.sqrt((miss**2).mean() + (scale * beyond) ** 2 @ np.ones(len(miss)) / len(miss)))


def _curve(by: tuple[F, F], at: F) -> F:
    """Return (n,) at these poses of a cubic, or what the rows allow, that is fitted to a run."""
    return np.asarray(np.polynomial.Polynomial.fit(*by, min(_DEGREE, len(by[0]) - 1))(at))


def _noise(of: tuple[F, F]) -> float:
    """Return the noise of readings one after the other, over their size: of a small stroke it is a
    large share, which no other run tells."""
    left = of[1] - _curve(of, of[0])
    return rms(np.diff(left, 2)) / np.sqrt(6.0) / rms(of[1]) if len(left) > 2 else 0.0


def _exchanged(pair: tuple[F, F], x: F, y: F) -> tuple[F, F]:
    """Return the pair with pose and wrench exchanged, each in the unit of the others."""
    new_x, new_y = pair[1], pair[0]
    return new_x * _decade(x, new_x), new_y * _decade(y, new_y)


def _decade(like: F, values: F) -> float:
    ratio = float(np.abs(like).max()) / max(float(np.abs(values).max()), 1e-300)
    return float(10.0 ** (3.0 * round(np.log10(max(ratio, 1e-300)) / 3.0)))
