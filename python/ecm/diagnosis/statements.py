"""Wrong statements of the user: the tool tries other readings of the table and names what fits.

A frame that is turned by 90 degrees, a reversed torque or degrees for radians leave an error that
effects can imitate in part. Each other reading (`ecm.diagnosis.restated`) is fitted by the same
base; one that brings the error down to a third, and far below what the accepted effects leave, is
named as what it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ecm.diagnosis.problem import Candidate, Problem
from ecm.diagnosis.restated import Restatement, restatements
from ecm.diagnosis.restated_points import moved_points
from ecm.errors import EcmError, ModelError
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.models.joint_fit import joint_fit
from ecm.models.maps import StiffnessMap
from ecm.regression.folds import is_pose_row

if TYPE_CHECKING:
    from ecm.io.table import Table

_ROWS = 150
"""Rows on which the readings are compared; the best is checked on all."""
_EQUAL = 1.5
"""Readings that leave up to so many times the least squares are said as well."""
_MOST_SAID = 2
_LEAST_T = 6.0
"""A slope counts from so many standard deviations."""


@dataclass(frozen=True)
class WrongStatement:
    """A reading of the table that fits far better than the one that was stated."""

    what: str
    error_before: float
    """Error of the base over the noise, as stated."""
    error_after: float
    """The same with the other reading."""

    def sentence(self) -> str:
        """Return what looks wrong, and what it rests on."""
        return (
            f"{self.what}: with that mended the error falls from {self.error_before:.3g} to "
            f"{self.error_after:.3g} times the noise"
        )


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
    settings, base, table = problem.settings, problem.base, problem.table
    length = problem.rows.length_m if problem.rows.has_length else None
    if before < settings.least_wrong_error or length is None or base.kind == "polynomial":
        return None
    if not table.has(*POSE, *WRENCH):
        return None
    best = _best_readings(problem, length)
    if not best:
        return None
    poses, wrench = best[0].change(table.matrix(POSE), table.wrenches)
    columns = dict(zip(POSE, poses.T, strict=True)) | dict(zip(WRENCH, wrench.T, strict=True))
    try:
        fit = joint_fit(base, (), table.with_columns(columns), problem.noise)
    except (EcmError, np.linalg.LinAlgError):
        return None
    squares = (fit.whitened**2).sum(axis=1)[problem.scored]
    # Some bad rows shall not decide.
    kept = np.sort(squares)[: max(1, int(0.98 * len(squares)))]
    mended = float(np.sqrt(kept.mean() / fit.whitened.shape[1]))
    if mended > settings.mended_share * before or (effects and mended > 0.5 * after):
        return None
    return WrongStatement(" or ".join(item.words for item in best), before, mended)


def _best_readings(problem: Problem, length_m: float) -> list[Restatement]:
    """Return the readings that leave the least, the simplest first; none where none helps."""
    base = problem.base
    rows = np.flatnonzero(problem.scored & (problem.weights > 0.0))
    rows = rows[np.linspace(0, len(rows) - 1, min(_ROWS, len(rows))).astype(np.int64)]
    poses, wrench = problem.table.matrix(POSE)[rows], problem.table.wrenches[rows]
    as_stated = _columns(base, poses)
    if as_stated is None:
        return []
    now = _misfit(as_stated, wrench)

    def left_by(poses: F, wrench: F) -> F:
        columns = _columns(base, poses)
        if columns is None:
            raise ModelError("no such pose")
        return _rest(columns, wrench)

    left: list[tuple[float, Restatement]] = []
    listed = [*restatements(length_m), *moved_points(length_m, poses, wrench, left_by)]
    for item in listed:
        try:
            own_poses, own_wrench = item.change(poses, wrench)
        except EcmError:
            continue
        columns = _columns(base, own_poses) if item.of_pose else as_stated
        if columns is not None:
            left.append((_misfit(columns, own_wrench), item))
    least = min(value for value, _ in left)
    if least > problem.settings.mended_share**2 * now:
        return []
    return [item for value, item in left if value <= _EQUAL * least][:_MOST_SAID]


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
    norms = np.sqrt((z**2).sum(axis=0))
    z = z / np.where(norms > 0.0, norms, 1.0)
    theta = np.linalg.lstsq(z, y, rcond=1e-10)[0]
    return np.asarray(y - z @ theta)


def reversed_sign(table: Table, inputs: Sequence[str], outputs: Sequence[str]) -> str:
    """Return which load falls where its own coordinate grows, in words; empty where none does.

    A mechanism at rest resists: the diagonal of its stiffness is positive. Where the slope of every
    force that shows one is negative, its sign is that of the reaction; so for torques.
    """
    rows = table.select(np.flatnonzero(is_pose_row(table)))
    if not inputs or not outputs or len(rows) == 0:
        return ""
    x = rows.matrix(inputs)
    x = x[:, np.ptp(x, axis=0) > 0.0]
    moving = [name for name in inputs if float(np.ptp(rows.column(name))) > 0.0]
    design = np.column_stack([np.ones(len(x)), x - x.mean(axis=0)])
    if len(design) < 2 * design.shape[1] or not moving:
        return ""
    inverse = np.linalg.pinv(design.T @ design)
    wrong: list[str] = []
    right: list[str] = []
    for position, load in zip(POSE, WRENCH, strict=True):
        if position not in moving or load not in outputs:
            continue
        y = rows.column(load)
        theta = inverse @ (design.T @ y)
        rest = float(((y - design @ theta) ** 2).sum()) / (len(y) - design.shape[1])
        j = 1 + moving.index(position)
        t = theta[j] / np.sqrt(max(rest * inverse[j, j], 1e-300))
        if abs(t) > _LEAST_T:
            (wrong if t < 0.0 else right).append(load)
    for group, words in ((WRENCH, "wrench"), (WRENCH[:3], "force"), (WRENCH[3:], "torque")):
        against = [name for name in wrong if name in group]
        if against and not any(name in group for name in right):
            listed = ", ".join(name.rsplit("_", 1)[0] for name in against)
            return f"the {words}'s sign looks reversed: {listed} falls where its coordinate grows"
    return ""


def time_unit(table: Table) -> str:
    """Return the unit that time_s seems to have where readings follow faster than they rest."""
    if not table.has("time_s") or not table.has("dwell_s"):
        return ""
    time, dwell = table.column("time_s"), table.column("dwell_s")
    order = np.argsort(time, kind="stable")
    steps, rests = np.diff(time[order]), dwell[order][1:]
    known = np.isfinite(rests) & (rests > 0.0) & (steps > 0.0)
    if int(known.sum()) < 8 or float(np.median(steps[known] / rests[known])) >= 0.9:
        return ""
    for unit, factor in (("minutes", 60.0), ("hours", 3600.0)):
        if float(np.median(factor * steps[known] / rests[known])) >= 0.9:
            return (
                f"time_s looks stated in {unit}, not s: readings follow each other faster than "
                "the mechanism rests before them (dwell_s)"
            )
    return ""
