"""Other readings of a table: points, axes, signs and units with which a base fits far better.

A frame that is turned by 90 degrees, a reversed torque or degrees for radians leave an error that
effects can imitate in part. Each other reading (`ecm.io.conventions`) is fitted by the same
base; one that brings the error down to a third, and far below what the accepted effects leave, is
named as what it is. A polynomial takes in most wrong readings. Where no length is stated, so that
nothing else serves as base, an energy without symmetry is asked: any elastic body has one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.optimize import least_squares

from ecm._native import EnergyModel
from ecm.diagnosis.problem import Candidate, Problem
from ecm.errors import EcmError, ModelError
from ecm.io.arrays import F, I, evenly, rest_of
from ecm.io.columns import POSE, WRENCH
from ecm.io.conventions import Convention, conventions, falling_loads, in_words
from ecm.io.se3 import rotation
from ecm.models.joint_fit import joint_fit
from ecm.models.maps import EnergyMap, StiffnessMap
from ecm.models.refit import FAR_BEYOND_NOISE

if TYPE_CHECKING:
    pass

LEAST_WRONG_ERROR = 2.0
"""Error over the noise from which other readings of the table are tried."""
MENDED_SHARE = 1.0 / 3.0
"""Share of the error to which another reading must bring it to be named."""


_LEAST_SHARE = 0.01
"""A point nearer than this share of the length is a matter of calibration."""
_MOST_SHARE = 1.0
_STEPS = 20
_STARTS = [
    np.zeros(3),
    *(s * axis for s in (-0.2, -0.1, -0.04, 0.04, 0.1, 0.2) for axis in np.eye(3)),
]
"""Shares of the length; the search begins at the best: there are other minima far away."""

Left = Callable[[F, F], F]
"""(poses, wrench) -> what a base fitted to them leaves, a vector."""


def moved_points(length_m: float, poses: F, wrench: F, left: Left) -> Iterator[Convention]:
    """Yield the points that fit these rows best, one for each kind.

    Parameters
    ----------
    length_m
        Length of the mechanism, which a shift along the axis may put right as well.
    left
        What the base leaves of other rows; its squares are minimised over the three coordinates.
    """
    kinds = (
        (_from_point, "the positions look measured from a point {0} away", True),
        (_of_point, "the pose looks that of another point of the top, {0} away", True),
        (_about_point, "the torque looks taken about a point {0} away", False),
        (
            _about_top_point,
            "the torque looks taken about a point of the top {0} away",
            False,
        ),
    )
    for move, words, of_pose in kinds:
        at = _best_point(move, length_m, poses, wrench, left)
        if at is None:
            continue
        said = words.format(f"({', '.join(f'{1e3 * c:.1f}' for c in at)}) mm")
        if of_pose and abs(at[0]) > 3.0 * float(np.hypot(at[1], at[2])):
            said += f", or the length looks {length_m + at[0]:.4g} m, not {length_m:.4g} m"
        yield Convention(said, partial(move, at), of_pose)


def _best_point(
    move: Callable[[F, F, F], tuple[F, F]], length_m: float, poses: F, wrench: F, left: Left
) -> F | None:
    """Return the point (3,) in m; None where it is too near, too far, or cannot be found."""

    def rest(shares: F) -> F:
        return left(*move(length_m * shares, poses, wrench))

    try:
        begin = min(_STARTS, key=lambda start: float((rest(start) ** 2).sum()))
        found = least_squares(rest, begin, max_nfev=_STEPS, diff_step=[1e-4] * 3, x_scale=0.1)
    except (EcmError, ValueError, np.linalg.LinAlgError):
        return None
    far = float(np.abs(found.x).max())
    return length_m * found.x if _LEAST_SHARE < far < _MOST_SHARE else None


def _from_point(at: F, poses: F, wrench: F) -> tuple[F, F]:
    return poses - np.r_[at, 0.0, 0.0, 0.0], wrench


def _of_point(at: F, poses: F, wrench: F) -> tuple[F, F]:
    return np.hstack([poses[:, :3] - _turned(at, poses), poses[:, 3:]]), wrench


def _about_point(at: F, poses: F, wrench: F) -> tuple[F, F]:
    return poses, _with_lever(np.broadcast_to(at, (len(poses), 3)), wrench)


def _about_top_point(at: F, poses: F, wrench: F) -> tuple[F, F]:
    return poses, _with_lever(_turned(at, poses), wrench)


def _turned(at: F, poses: F) -> F:
    """(N, 3) of a point of the top in base axes."""
    return np.asarray(rotation(poses[:, 3:]) @ at)


def _with_lever(lever: F, wrench: F) -> F:
    return np.hstack([wrench[:, :3], wrench[:, 3:] + np.cross(lever, wrench[:, :3])])


EQUAL = 1.5
"""What leaves up to so many times the least squares is said as well."""
_MOST_SAID = 2


@dataclass(frozen=True)
class WrongStatement:
    """A reading of the table that fits far better than the one that was stated."""

    what: str
    error_before: float
    """Error of the base, or of the model that was given, over the noise, as stated."""
    error_after: float
    """The same with the other reading."""

    def sentence(self) -> str:
        """Return what looks wrong, and what it rests on."""
        return (
            f"{self.what}: with that mended the error falls from {self.error_before:.3g} to "
            f"{self.error_after:.3g} times the noise"
        )


def best_readings(
    base: StiffnessMap, poses: F, wrench: F, length_m: float | None, share: float
) -> list[Convention]:
    """Return the readings of which a base leaves the least, the simplest first.

    Parameters
    ----------
    base
        Its coefficients are fitted to each reading.
    poses, wrench
        (N, 6) as stated, m and rad, N and N m.
    length_m
        Length of the mechanism; None where it is not known, then no origins are searched, and no
        units of the pose are tried.
    share
        Largest share of the error that the best may leave; none are returned above it.
    """
    as_stated = _columns(base, poses)
    if as_stated is None:
        return []

    def left_by(poses: F, wrench: F) -> F:
        columns = _columns(base, poses)
        if columns is None:
            raise ModelError("no such pose")
        return _rest(columns, wrench)

    if length_m is None:
        # Every symmetric stiffness has an energy where the rotations are small enough.
        listed = [item for item in conventions(None) if not item.of_pose_unit]
    else:
        listed = [*conventions(length_m), *moved_points(length_m, poses, wrench, left_by)]
    left: list[tuple[float, Convention]] = []
    for item in listed:
        try:
            own_poses, own_wrench = item.change(poses, wrench)
        except EcmError:
            continue
        columns = _columns(base, own_poses) if item.of_pose else as_stated
        if columns is not None:
            left.append((_misfit(columns, own_wrench), item))
    return best_of(left, share**2 * _misfit(as_stated, wrench))


def best_of(left: Sequence[tuple[float, Convention]], most: float) -> list[Convention]:
    """Return the readings that leave about the least squares; none where that is above `most`."""
    least = min((value for value, _ in left), default=np.inf)
    if not least <= most:
        return []
    return [item for value, item in left if value <= EQUAL * least][:_MOST_SAID]


def _columns(base: StiffnessMap, poses: F) -> tuple[F, F] | None:
    """Return the wrench (n, 6) and its derivative (n, 6, k) to the coefficients; None: no pose."""
    try:
        poses = np.ascontiguousarray(poses)
        found = base.predict(poses), base.columns(poses)
    except EcmError:
        return None
    return found if all(np.isfinite(part).all() for part in found) else None


def _misfit(base: tuple[F, F], wrench: F) -> float:
    """Return the share of the squares of force and of torque that the base leaves."""
    return float((_rest(base, wrench) ** 2).mean())


def _rest(base: tuple[F, F], wrench: F) -> F:
    """Return (6 n,) what the fitted base leaves, over the rms of force and of torque."""
    predicted, columns = base
    size = np.repeat([np.sqrt((part**2).mean()) for part in (wrench[:, :3], wrench[:, 3:])], 3)
    size = np.where(size > 0.0, size, 1.0)
    y = ((wrench - predicted) / size).ravel()
    z = (columns / size[:, None]).reshape(len(y), -1)
    return rest_of(z, y)


_ROWS = 150
"""Rows on which the readings are compared; the best is checked on all."""
_BETTER = 0.5
"""Share of the error of the polynomial that an energy may leave, where it errs more than noise."""
_GENERAL_TERMS = {4: 209, 3: 83, 2: 27}
"""Terms of an energy without symmetry by its degree."""


def find_wrong_statement(
    problem: Problem, effects: Sequence[Candidate], before: float, after: float
) -> WrongStatement | None:
    """Try other readings of the table; None where none explains it, or the effects do.

    Parameters
    ----------
    effects
        The accepted effects.
    before, after
        Whitened rms of the base alone, and with the accepted effects.
    """
    base, table = problem.base, problem.table
    if not table.has(*POSE, *WRENCH):
        return None
    if base.kind == "polynomial":
        return _of_any_elastic_body(problem, before)
    length = problem.rows.length_m if problem.rows.has_length else None
    if before < LEAST_WRONG_ERROR or length is None:
        return None
    rows = _compared_rows(problem)
    poses, wrench = table.matrix(POSE)[rows], table.wrenches[rows]
    for body in _bodies(base):
        best = best_readings(body, poses, wrench, length, MENDED_SHARE)
        mended = _error(problem, body, best[0]) if best else None
        if mended is None or mended > MENDED_SHARE * before:
            continue
        if not effects or mended <= 0.5 * after:
            return WrongStatement(in_words(best), before, mended)
    return None


def _bodies(base: StiffnessMap) -> list[StiffnessMap]:
    """Return the base, and after a symmetric energy that of a body whose ends differ."""
    if not isinstance(base, EnergyMap) or base.model.symmetry != "alike":
        return [base]
    own = base.model
    terms: dict[str, Any] = {
        "length_m": own.length_m, "degree": own.degree, "symmetry": "revolution"
    }  # fmt: skip
    count = EnergyModel.regressor(np.array([[own.length_m, *[0.0] * 5]]), scale=own.scale, **terms)
    zeros = np.zeros(count.shape[2])
    unlike = EnergyModel.from_coefficients(scale=own.scale, coefficients=zeros, **terms)
    return [base, EnergyMap(unlike)]


def _of_any_elastic_body(problem: Problem, before: float) -> WrongStatement | None:
    """Try the readings where no length is stated: one that gives the wrench an energy is right."""
    table, rows = problem.table, _compared_rows(problem)
    degrees = [d for d, terms in _GENERAL_TERMS.items() if 2 * terms <= 6 * len(rows)]
    poses, wrench = table.matrix(POSE)[rows], table.wrenches[rows]
    # The origin along the axis is free in an energy with all terms; it only gives a scale.
    length = float(np.linalg.norm(poses[:, :3].mean(axis=0)))
    if not degrees or not length > 0.0:
        return None

    def energy(poses: F, wrench: F) -> StiffnessMap:
        return EnergyMap(
            EnergyModel.fit(poses, wrench, length_m=length, degree=degrees[0], symmetry="general")
        )

    as_stated = _error(problem, energy(poses, wrench), None)
    most = max(FAR_BEYOND_NOISE, _BETTER * before)
    if as_stated is None or as_stated < LEAST_WRONG_ERROR:
        return None
    best = best_readings(energy(poses, wrench), poses, wrench, None, MENDED_SHARE)
    upright = [item for item in best if not _falls(*item.change(poses, wrench))]
    for item in (upright or best)[:1]:
        mended = _error(problem, energy(*item.change(poses, wrench)), item)
        if mended is not None and mended <= min(MENDED_SHARE * as_stated, most):
            return WrongStatement(in_words(upright or best), as_stated, mended)
    return None


def _falls(poses: F, wrench: F) -> bool:
    """Whether a load falls where its coordinate grows."""
    return bool(falling_loads(poses, wrench, np.full(12, True)))


def _named(poses: F, wrench: F) -> dict[str, F]:
    return dict(zip((*POSE, *WRENCH), np.hstack([poses, wrench]).T, strict=True))


def _compared_rows(problem: Problem) -> I:
    rows = np.flatnonzero(problem.scored & (problem.weights > 0.0))
    return rows[evenly(len(rows), _ROWS)]


def _error(problem: Problem, base: StiffnessMap, reading: Convention | None) -> float | None:
    """Return the whitened rms that a base leaves of a reading; None where it cannot be fitted."""
    table = problem.table
    if reading is not None:
        table = table.with_columns(_named(*reading.change(table.matrix(POSE), table.wrenches)))
    try:
        fit = joint_fit(base, (), table, problem.noise)
    except (EcmError, np.linalg.LinAlgError):
        return None
    squares = (fit.whitened**2).sum(axis=1)[problem.scored]
    # Some bad rows shall not decide.
    kept = np.sort(squares)[: max(1, int(0.98 * len(squares)))]
    return float(np.sqrt(kept.mean() / fit.whitened.shape[1]))
