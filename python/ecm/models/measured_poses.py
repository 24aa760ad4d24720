"""Poses at which a model was measured, and effects of the pose folded into its base there.

A fit keeps some hundred of its rows' poses in the model file. Export, control loop, the linear part
for MuJoCo and `inside` all take their poses from here: measured rows, and mixes of near ones, in
mid-frame coordinates, in which equal loads lie on straight lines as far as the mechanism is linear.
The inputs of a map's actuators follow its poses, and count as coordinates of their own.
Older files hold none: their poses are those that loads bend the model to inside its domain.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from math import comb
from typing import Any

import numpy as np

from ecm import _native
from ecm._native import ModelError, mid_frame
from ecm.errors import InputError
from ecm.io.arrays import B, F, eigh, evenly
from ecm.io.columns import POSE, WRENCH, same_unit
from ecm.io.description import Meta
from ecm.io.se3 import poses_of
from ecm.io.settings import MOST_OF_ONE_INPUT, POLYNOMIAL_DEGREES
from ecm.io.table import Table
from ecm.models.actuated import ActuatedMap
from ecm.models.errors import worst_over
from ecm.models.evaluation import EvaluatedModel
from ecm.models.maps import EnergyMap, EnergyTerms, PolynomialMap, StiffnessMap, Symmetry
from ecm.models.physics.map import PhysicsMap
from ecm.regression.folds import spread_rows
from ecm.regression.rows import is_whole, taken_by

_MOST_STORED = 200
"""Poses that a model file holds, beside those at the ends of each coordinate."""
_SAME = 0.1
"""Share of the poses of the fit from which on rows with the same ones may be the rows of the fit:
of a later campaign only those at rest come again to the last digit."""
_MOST_LOAD = 1.2
"""Force and torque of a mix of poses over the largest at a measured one."""
_NEIGHBOURS = 6
"""Rows with which a row is mixed."""
_SEED = 11
_MARGIN = 1.01
"""Size over that of the data: fits average repeated poses, so that measured ones lie beyond."""
_ROUNDED = 1e-6
"""Share of a coordinate that files and single precision may round away: one that never varies has
no other extent."""
_THINNEST = 0.03
"""Least extent of a coordinate, over the largest one of its unit, that counts as measured."""


def sample_of(table: Table, inputs: Sequence[str]) -> list[list[float]]:
    """Poses of a table for its model's file: spread over its rows, and the ends of each coordinate.

    Home checks, also with the mechanism, count where they lie outside what the others span.

    Examples
    --------
    >>> from ecm import as_table
    >>> table = as_table({"x_m": 1e-4 * np.arange(5000.0), "fx_N": np.arange(5000.0)})
    >>> poses = sample_of(table, ("x_m",))
    >>> len(poses), min(poses), max(poses)
    (201, [0.0], [0.4999])
    """
    poses = table.matrix(tuple(inputs))
    counts = np.isfinite(poses).all(axis=1) & ~table.unloaded
    poses, of_poses = poses[counts], table.of_poses[counts]
    chosen = np.flatnonzero(of_poses)
    seen = [poses, coordinates(poses, 0.0)] if tuple(inputs[:6]) == POSE else [poses]
    if len(chosen) > _MOST_STORED:
        own = [x[chosen] for x in seen]
        ends = [x.argmin(axis=0) for x in own] + [x.argmax(axis=0) for x in own]
        alone = Table(dict(zip(inputs, own[0].T, strict=True)), Meta(), "poses")
        chosen = chosen[np.union1d(spread_rows(alone, _MOST_STORED), np.concatenate(ends))]
    for x in seen:  # and all rows are inside what they span
        for _ in range(10 if 1 < len(chosen) < len(x) else 0):
            outside = np.flatnonzero(~Reach.of(x[chosen], inputs).contains(x))
            if not len(outside):
                break
            away = np.linalg.norm(
                (x[outside] - x.mean(axis=0)) / np.maximum(x.std(axis=0), 1e-300), axis=1
            )
            chosen = np.union1d(chosen, outside[np.argsort(-away)[:10]])
    return _rounded(poses[chosen])


def has_rows_of_fit(model: EvaluatedModel, table: Table) -> bool:
    """Whether rows of a table may be those that a model was fitted to; True where it is not told.

    Also with other columns or rows beside them.
    """
    of_fit = set(map(tuple, model.training.get("poses", ())))
    here = map(tuple, _rounded(table.matrix(taken_by(model.base))))
    return len(of_fit.intersection(here)) >= _SAME * len(of_fit)


def _rounded(poses: F) -> list[list[float]]:
    """Eight digits, 10 nm of a neck: far below what any sensor tells."""
    return [[float(f"{x:.8g}") for x in pose] for pose in poses]


def has_measured_poses(model: EvaluatedModel) -> bool:
    """Whether the model file says at which poses it was measured."""
    return bool(model.training.get("poses"))


def measured_poses(model: EvaluatedModel) -> F:
    """(N, n) poses that the model was measured at, some hundred of all, with actuators' inputs.

    Examples
    --------
    >>> import ecm
    >>> y = np.linspace(-0.01, 0.01, 9)
    >>> model = ecm.fit({"y_m": y, "fy_N": 3000.0 * y}, "linear")
    >>> measured_poses(model).shape
    (9, 1)
    """
    if has_measured_poses(model):
        return np.array(model.training["poses"], dtype=np.float64)
    return _loaded_poses(model)


def near_poses(model: EvaluatedModel, count: int, *, around: float = 0.0) -> F:
    """(count, n) mixes of near measured poses, under at most 1.2 times their largest load.

    `around` moves each coordinate of a mix by so much of the largest deviation of its unit.
    """
    rows = measured_poses(model)
    if len(rows) < 2:
        return np.repeat(rows, count, axis=0)
    length, turns = model.known_length_m or 0.0, model.base.inputs == POSE
    q = coordinates(rows, length) if turns else rows
    extents = _extents(q, taken_by(model.base))
    near = _nearest(q / extents)
    most = _MOST_LOAD * _loads(model, rows).max(axis=0)
    random = np.random.default_rng(_SEED)
    found = np.zeros((0, rows.shape[1]))
    for _ in range(20):
        first = random.integers(len(rows), size=count)
        second = near[first, random.integers(near.shape[1], size=count)]
        share = random.uniform(0.0, 1.0, (count, 1))
        mixed = (1.0 - share) * q[first] + share * q[second]
        mixed += around * extents * random.standard_normal(mixed.shape)
        mixed = poses_of(mixed, length) if turns else mixed
        kept = (_loads(model, mixed) <= most).all(axis=1)
        found = np.vstack([found, mixed[kept]])
        if len(found) >= count:
            break
    return found[:count]


def poses_like_measured(model: EvaluatedModel, count: int) -> F:
    """(count, n) measured poses, then mixes of near ones where there are fewer."""
    rows = measured_poses(model)
    if len(rows) >= count:
        return rows[evenly(len(rows), count)]
    return np.vstack([rows, near_poses(model, count - len(rows))])


def noise_sd(model: EvaluatedModel) -> F:
    """(m,) root mean square noise of a row of each component over the measured poses."""
    rows = model.rows_at(measured_poses(model))
    return np.asarray(np.sqrt(np.einsum("njj->j", model.noise.covariance(rows)) / len(rows)))


def coordinates(poses: F, length_m: float) -> F:
    """(N, 6 + m) mid-frame coordinates q = (c, theta) of poses (N, 6 + m); m inputs stay."""
    return np.hstack([mid_frame(np.ascontiguousarray(poses[:, :6]), length_m), poses[:, 6:]])


@dataclass(frozen=True)
class Reach:
    """Where a model counts as inside its data: a box of coordinates, and an ellipsoid in it.

    A pose x is inside where low <= x <= high and |factor (x - centre)| <= 1. The box alone would
    hold corners that no load reaches; the ellipsoid, by the covariance of the measured poses,
    alone would hold twice the largest load along each axis.

    Examples
    --------
    >>> reach = Reach.of(np.array([[-1.0, -1.0], [0.0, 0.1], [1.0, 1.0]]), ("x_m", "y_m"))
    >>> reach.contains(np.array([[0.9, 0.9], [0.9, -0.9], [1.1, 1.1]]))
    array([ True, False, False])
    """

    low: F
    high: F
    centre: F
    factor: F
    """(n, n) lower triangle."""

    @staticmethod
    def of(q: F, inputs: Sequence[str]) -> Reach:
        """The reach of measured coordinates (N, n); `inputs` name their units."""
        extents = _extents(q, inputs)
        low, high = q.min(axis=0), q.max(axis=0)
        more = np.maximum(0.5 * (_MARGIN - 1.0) * (high - low), 0.5 * _THINNEST * extents)
        centre = q.mean(axis=0)
        z = (q - centre) / extents
        values, vectors = eigh(z.T @ z / len(z))
        values = np.maximum(values, _THINNEST**2 * max(values[-1], 1e-300))
        covariance = (vectors * values) @ vectors.T * np.outer(extents, extents)
        factor = np.linalg.inv(np.linalg.cholesky(covariance))
        farthest = np.sqrt(((q - centre) @ factor.T) ** 2 @ np.ones(len(centre))).max()
        size = _MARGIN * max(float(farthest), 1.0)
        return Reach(low - more, high + more, centre, np.tril(factor) / size)

    def contains(self, q: F) -> B:
        """(N,) whether coordinates (N, n) are inside."""
        boxed = ((self.low <= q) & (q <= self.high)).all(axis=1)
        away = np.abs((q - self.centre) @ self.factor.T)
        near = (away <= 1.0).all(axis=1)  # beyond, squares may overflow
        return np.asarray(boxed & near & ((np.minimum(away, 1.0) ** 2).sum(axis=1) <= 1.0))

    def document(self) -> dict[str, list[float]]:
        """For the exported code: the rows of the triangle one after the other."""
        triangle = self.factor[np.tril_indices(len(self.centre))]
        return {
            "low": self.low.tolist(),
            "high": self.high.tolist(),
            "centre": self.centre.tolist(),
            "factor": triangle.tolist(),
        }


def reach_of(model: EvaluatedModel, base: StiffnessMap) -> Reach | None:
    """The reach of a model in the coordinates of a map that is exported in its place.

    Mid-frame coordinates of an energy, else the pose columns; None where the model file holds no
    poses, and the map's own ranges are all that is known.
    """
    if not has_measured_poses(model):
        return None
    names = taken_by(base)
    rows = measured_poses(model)[:, : len(names)]
    return Reach.of(_coordinates_of(base, rows), names[: rows.shape[1]])


def are_inside(model: EvaluatedModel, poses: F) -> B:
    """(N,) whether poses (N, n) are where the model was measured: `inside` of its export.

    Of a file that holds no measured poses: whether each column is inside its range.

    Examples
    --------
    >>> import ecm
    >>> y = np.linspace(-0.01, 0.01, 9)
    >>> model = ecm.fit({"y_m": y, "fy_N": 3000.0 * y}, "linear")
    >>> are_inside(model, np.array([[0.009], [0.02]]))
    array([ True, False])
    """
    reach = reach_of(model, model.base)
    if reach is not None:
        padded = np.zeros((len(poses), len(taken_by(model.base))))
        padded[:, : poses.shape[1]] = poses
        return reach.contains(_coordinates_of(model.base, padded)[:, : len(reach.low)])
    everywhere = (-np.inf, np.inf)
    low, high = np.array([model.domain.get(name, everywhere) for name in model.base.inputs]).T
    poses = poses[:, : len(low)]
    return np.asarray(((low <= poses) & (poses <= high)).all(axis=1))


def beyond_inputs(model: EvaluatedModel, table: Table) -> str:
    """What to say of actuators' inputs that go beyond those of the fit; empty where none does."""
    rows, said = measured_poses(model), []
    for place, name in enumerate(taken_by(model.base)[: rows.shape[1]]):
        if name in table.actuation_columns:
            known, own = rows[:, place], table.measured().column(name)
            more = 0.5 * (_MARGIN - 1.0) * np.ptp(known)
            if own.max() > known.max() + more or own.min() < known.min() - more:
                ranges = [f"{x.min():.4g} to {x.max():.4g}" for x in (own, known)]
                said.append(f"{name} is {ranges[0]}, fitted {ranges[1]}")
    return "".join(f"; {words}" for words in said)


def _coordinates_of(base: StiffnessMap, poses: F) -> F:
    """(N, n) mid-frame coordinates of poses where a map is an energy, else the poses."""
    if isinstance(base, EnergyMap | PhysicsMap | ActuatedMap):
        return coordinates(poses, base.length_m)
    return poses


def largest_coordinates(model: EvaluatedModel) -> F:
    """(2,) largest |c| (m) and |theta| (rad) of the mid frame over the measured poses."""
    q = coordinates(measured_poses(model), model.known_length_m or 0.0)
    return np.array([np.linalg.norm(part, axis=1).max() for part in (q[:, :3], q[:, 3:6])])


def _extents(q: F, inputs: Sequence[str]) -> F:
    """(n,) largest standard deviation among the coordinates of the same unit."""
    largest = (same_unit(inputs) * q.std(axis=0)).max(axis=1)
    rounded = _ROUNDED / _THINNEST * np.abs(q).max(axis=0)
    return np.asarray(np.maximum(largest, np.maximum(rounded, 1e-9)))


def _nearest(z: F) -> Any:
    """(N, k) rows that are nearest to each row."""
    apart = ((z[:, None, :] - z[None, :, :]) ** 2).sum(axis=2)
    np.fill_diagonal(apart, np.inf)
    return np.argsort(apart, axis=1)[:, : min(_NEIGHBOURS, len(z) - 1)]


def _loads(model: EvaluatedModel, poses: F) -> F:
    """(N, groups) norm of the force and of the torque, and each other output, at poses."""
    wrench = model.predict(np.ascontiguousarray(poses))
    names = model.base.outputs
    groups = [
        [j for j, name in enumerate(names) if name in group] for group in (WRENCH[:3], WRENCH[3:])
    ] + [[j] for j, name in enumerate(names) if name not in WRENCH]
    return np.stack([np.linalg.norm(wrench[:, g], axis=1) for g in groups if g], axis=1)


def _loaded_poses(model: EvaluatedModel) -> F:
    """(N, n) poses for a file that holds none: those of random loads that stay in its domain.

    All six columns bend under loads by the stiffness at rest, each load at most as large as takes
    one column to the end of its range, and none with more energy than the middle one: bending
    shortens a mechanism by more than any axial load. Other columns are drawn between their ends.
    """
    random = np.random.default_rng(_SEED)
    low, high = _ranges(model).T
    box = random.uniform(low, high, (_MOST_STORED, len(low)))
    if not is_whole(model.base):
        box[0], box[-1] = low, high
        return np.asarray(box)
    length = model.known_length_m
    centre = 0.5 * (low + high) if length is None else np.array([length, 0, 0, 0, 0, 0.0])
    centre = np.clip(centre, low, high)
    stiffness = model.base.stiffness(centre[None])[0]
    if np.linalg.eigvals(stiffness).real.min() <= 0.0:
        return np.asarray(centre + 0.5 * (box - 0.5 * (low + high)))
    compliance = np.linalg.inv(stiffness)
    room = np.maximum(high - centre, centre - low)[:, None]
    largest = (room / np.maximum(np.abs(compliance), 1e-300)).min(axis=0)
    energy = np.diag(compliance) * largest**2
    largest *= np.sqrt(np.minimum(1.0, np.median(energy) / energy))
    ball = random.standard_normal((50 * _MOST_STORED, 6))
    ball *= random.uniform(0.0, 1.0, (len(ball), 1)) ** (1 / 6) / np.linalg.norm(
        ball, axis=1, keepdims=True
    )
    loads = largest * ball
    poses = centre + loads @ compliance.T
    poses = poses[((low <= poses) & (poses <= high)).all(axis=1)]
    poses = poses[np.linalg.norm(poses[:, 3:], axis=1) < 3.0][: 4 * _MOST_STORED]
    sizes = [np.linalg.norm(loads[:, part], axis=1).max() for part in (slice(3), slice(3, 6))]
    excess = (_loads(model, poses) / (_MOST_LOAD * np.array(sizes))).max(axis=1)
    least = np.argsort(excess, kind="stable")[:_MOST_STORED]
    return np.asarray(poses[least[excess[least] <= max(1.0, excess[least[len(least) // 10]])]])


def _ranges(model: EvaluatedModel) -> F:
    """(n, 2) range of each pose column; where none is known, that of the map's own coordinates."""
    inputs, length = model.base.inputs, model.known_length_m or 0.1
    wide = np.array([0.1 * length] * 3 + [0.3] * 3)
    base = model.base.surrogate if isinstance(model.base, PhysicsMap) else model.base
    if isinstance(base, EnergyMap):
        wide = np.repeat(np.minimum(base.model.scale, 3.0), 3)
    rest = np.array([length, 0, 0, 0, 0, 0.0])
    known = dict(zip(POSE, np.stack([rest - wide, rest + wide], axis=1), strict=True))
    return np.array([model.domain.get(name, known.get(name, (0.0, 0.0))) for name in inputs])


Folded = EnergyMap | PolynomialMap
_ENERGIES: tuple[tuple[int, Symmetry], ...]
_ENERGIES = ((6, "alike"), (6, "revolution"), (4, "general"), (6, "general"))
"""Degree and symmetry of the energies that are tried."""
_POSES = 1000
_AROUND = 0.1
"""Share of their extent by which poses are moved: rows along a line tell no stiffness beside it."""
_SMALL_ERROR = 0.15
"""An energy whose error over the noise is smaller is near enough to fold effects into."""


def folded(model: EvaluatedModel) -> tuple[Folded, float]:
    """The smallest map that is near enough to the base with its effects, and how far it differs.

    Rms of the worst component over the noise at measured poses. An energy; of what is none, or has
    not the twelve columns and a length of one, the lowest polynomial where no energy is near.
    """
    base, length = model.base, model.known_length_m
    fits: list[Callable[[F, F], Folded]] = []
    if is_whole(base) and length is not None:
        fits = [EnergyTerms(length, *form).fit for form in _ENERGIES]
    if not fits or base.document().get("kind") not in ("energy", "physics"):
        least = base.model.degree if isinstance(base, PolynomialMap) else POLYNOMIAL_DEGREES[0]
        most = _most_degree(len(base.inputs))

        def fitted(degree: int, poses: F, wrenches: F) -> PolynomialMap:
            one = _native.PolynomialEvaluator.fit(poses, wrenches, degree)
            return PolynomialMap(one, base.inputs, base.outputs)

        fits += [partial(fitted, degree) for degree in range(least, most + 1)]
    return _first_near_enough(fits, model)


def _most_degree(inputs: int) -> int:
    """Largest degree of a polynomial that holds effects: it repeats a law, and has no noise to fit.

    A law of one column among several is of a higher degree than rows of a rig tell.

    Examples
    --------
    >>> [_most_degree(inputs) for inputs in (1, 2, 3, 4, 6)]
    [9, 9, 9, 6, 6]
    """
    degrees = range(POLYNOMIAL_DEGREES[1], MOST_OF_ONE_INPUT + 1)
    few = [degree for degree in degrees if comb(inputs + degree, degree) <= _POSES // 4]
    return max(few, default=POLYNOMIAL_DEGREES[1])


def _first_near_enough(
    fits: Sequence[Callable[[F, F], Folded]], model: EvaluatedModel
) -> tuple[Folded, float]:
    """The first of several forms whose error over the noise is small, else the best, and its error.

    Mixes of near measured poses are fitted, and the error is that at the measured ones, which lie
    around them. The form that is taken is then fitted to both.
    """
    rows, near = measured_poses(model), near_poses(model, _POSES, around=_AROUND)
    noise, truth, between = noise_sd(model), model.predict(rows), model.predict(near)
    trials: list[tuple[float, Callable[[F, F], Folded]]] = []
    for fit in fits:
        try:
            found = fit(near, between)
        except ModelError:  # more terms than these poses tell
            continue
        trials.append((worst_over(noise, found.predict(rows) - truth), fit))
        if trials[-1][0] < _SMALL_ERROR:
            break
    if not trials:
        raise InputError(
            f"{len(rows)} measured poses tell no map that effects could be folded into: measure "
            "more poses"
        )
    share, best = min(trials, key=lambda trial: trial[0])
    return best(np.vstack([rows, near]), np.vstack([truth, between])), share
