"""Fit with noise in the pose as well as in the wrench (errors in variables).

Maximum likelihood over the coefficients and the true poses p_i of

    sum_i |h_i - h(p_i)|^2_(Sigma_w^-1) + |p~_i - p_i|^2_(Sigma_p^-1),

p~ the measured poses. The poses are eliminated to first order: with K_s at the present p_i, in
rotation increments of base axes, and delta_i = p~_i - p_i,

    e_i = h_i - h(p_i) - K_s delta_i,      Sigma_i = Sigma_w + K_s Sigma_p K_s',
    delta_i <- -Sigma_p K_s' Sigma_i^-1 e_i,

and the coefficients follow by generalised least squares of h_i - K_s delta_i on the columns at
p_i. At the fixed point both gradients of the sum are zero. Weights Sigma_i alone, with the columns
at the measured poses, would leave every stiffness too small by the share of the pose noise in the
spread of the poses, however many rows there are (attenuation).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from ecm._native import inverse_left_jacobians
from ecm.effects import Rows
from ecm.io.arrays import F, I
from ecm.io.columns import POSE
from ecm.io.events import Progress
from ecm.io.table import Table
from ecm.models.maps import FittedMap, Solved, StiffnessMap
from ecm.regression.noise import Noise, whiteners
from ecm.regression.normal_equations import in_blocks, triangles_of_folds, without_each
from ecm.regression.rows import columns_of, inputs_of

Solve = Callable[[F, F, F], Solved]
"""Generalised least squares of all rows: poses, wrenches, covariance (N, m, m)."""


class LinearFit(Protocol):
    """Generalised least squares of a map's family, which reads the rows block by block."""

    def frame(self, poses: F) -> Any:
        """What all blocks share, such as the scale of the coordinates."""

    def reduce(self, frame: Any, poses: F, wrenches: F, covariance: F) -> Any:
        """What the fit needs of a block of rows; called from several threads."""

    def solve(self, frame: Any, parts: Sequence[Any], rows: int) -> Solved:
        """The fit of the blocks, which hold so many rows."""


@dataclass(frozen=True)
class AllRows:
    """A fit that takes all rows at once."""

    whole: Solve

    def frame(self, poses: F) -> None:
        """Nothing is shared."""

    def reduce(self, frame: None, poses: F, wrenches: F, covariance: F) -> tuple[F, F, F]:
        """The rows themselves."""
        return poses, wrenches, covariance

    def solve(self, frame: None, parts: Sequence[tuple[F, F, F]], rows: int) -> Solved:
        """The fit of all rows."""
        return self.whole(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


_MAX_ITERATIONS = 20
_TOLERANCE = 0.01
"""The iteration ends when no coefficient changes by this share of its standard deviation."""
_TYPICAL_PASSES, _TYPICAL_RATE = 6, 0.2
"""Passes of an energy's fit, and the share of a change that the next pass makes."""
_LARGEST_SHIFT = 6.0
"""Largest shift of a pose, in standard deviations of the pose noise."""


def fit_with_pose_noise(
    table: Table,
    start: StiffnessMap,
    noise: Noise,
    family: LinearFit,
    *,
    near: bool = False,
    progress: Progress | None = None,
) -> FittedMap:
    """Maximum likelihood fit of the coefficients and the true poses.

    Parameters
    ----------
    table
        N measured rows.
    start
        Map of the family, where the iteration starts.
    noise
        Noise of pose and wrench.
    family
        Generalised least squares of the map's family.
    near
        Whether the start is near the result, as that of other rows of the same campaign.
    progress
        Called with the share that is done, by the number of passes that are likely needed.
    """
    passes = _Passes(progress)
    base, rows = start, _NoisyRows.of(table, start)
    before, covariance, variance = base.coefficients, np.zeros((0, 0)), np.nan
    change = np.inf
    if near:
        rows = rows.moved(base, noise)
    for step in range(_MAX_ITERATIONS):
        frame = family.frame(rows.poses)

        def reduced(block: slice) -> Any:
            return rows.of_rows(block).reduced(base, noise, family, frame)  # noqa: B023

        parts = in_blocks(len(table), reduced, passes.part)
        base, covariance, variance = family.solve(frame, parts, len(table))
        sd = np.sqrt(np.diag(covariance))
        changes = np.abs(base.coefficients - before) / np.where(sd > 0.0, sd, np.inf)
        before, last = base.coefficients, change
        change = float(changes.max())
        # Near the end each change is the same share of the one before, and the next one is known.
        ahead = change * min(1.0, change / last) if near and step > 1 else change
        if ahead < _TOLERANCE or (change > last and change < 0.1):
            break
        passes.ended(change, change / last)
        rows = rows.moved(base, noise)
    return FittedMap(base, noise, covariance, variance, change < 0.1)


class _Passes:
    """Tells how far an iteration is: nobody knows its passes before its end, so they are judged."""

    def __init__(self, progress: Progress | None) -> None:
        self._progress, self._done = progress, 0
        self._left, self._share = _TYPICAL_PASSES, 0.0

    def part(self, done: float, rows: float, words: str) -> None:
        """Take the rows that this pass has read."""
        if self._progress is not None:
            at = self._done + done / rows
            passes = self._done + self._left
            self._share = max(self._share, at / passes)
            about = min(passes, _MAX_ITERATIONS)
            self._progress(self._share, 1.0, f"pass {self._done + 1} of about {about}")

    def ended(self, change: float, ratio: float) -> None:
        """Take the change of a pass, and over that of the pass before, where it is not the last."""
        # Far from the end changes do not fall evenly yet.
        near = change < 1.0 and ratio > 0.0
        rate = min(max(ratio, 0.01), 0.9) if near else _TYPICAL_RATE
        self._done += 1
        self._left = max(1, math.ceil(math.log(_TOLERANCE / change) / math.log(rate)))


def fits_without_folds(
    table: Table,
    fitted: StiffnessMap,
    noise: Noise,
    family: LinearFit,
    fold: I,
    progress: Progress | None = None,
) -> list[StiffnessMap]:
    """Map without each fold, one step from a fit to all rows: true poses and weights are its own.

    Parameters
    ----------
    table
        N measured rows.
    fitted
        Map that was fitted to all rows.
    noise
        Noise of pose and wrench.
    family
        Generalised least squares whose parts are triangles (c, c).
    fold
        (N,) number of each row's fold, from 0.
    progress
        Called with the rows that are read, of all.
    """
    rows = _NoisyRows.of(table, fitted).moved(fitted, noise)
    frame = family.frame(rows.poses)

    def triangle(own: I) -> F:
        return np.asarray(rows.of_rows(own).reduced(fitted, noise, family, frame))

    parts = triangles_of_folds(fold, triangle, progress)
    return without_each(fold, parts, lambda own, count: family.solve(frame, own, count)[0])


@dataclass(frozen=True)
class _NoisyRows:
    """Rows with their most likely true poses."""

    table: Table
    """Source of the description."""
    inputs: tuple[str, ...]
    measured: F
    """(N, n) measured poses."""
    wrenches: F
    """(N, m)."""
    driven: F
    """(N, a) inputs of actuators after the pose, which are taken as exact."""
    poses: F
    """(N, n) most likely true poses."""
    shift: F
    """(N, n) measured minus most likely pose, rotations as increments in base axes."""

    @staticmethod
    def of(table: Table, base: StiffnessMap) -> _NoisyRows:
        """Each pose where it was measured."""
        measured = table.matrix(base.inputs)
        wrenches = np.ascontiguousarray(table.matrix(base.outputs))
        driven = inputs_of(base, table)[:, len(base.inputs) :]
        still = np.zeros_like(measured)
        return _NoisyRows(table, base.inputs, measured, wrenches, driven, measured, still)

    def of_rows(self, rows: slice | I) -> _NoisyRows:
        """Some of the rows."""
        arrays = (self.measured, self.wrenches, self.driven, self.poses, self.shift)
        return _NoisyRows(self.table, self.inputs, *(array[rows] for array in arrays))

    def under(self, base: StiffnessMap) -> Rows:
        """Rows of the true poses under a map."""
        columns = columns_of(base, np.hstack([self.poses, self.driven]))
        return Rows(Table(columns, self.table.meta, self.table.source), base)

    def reduced(self, base: StiffnessMap, noise: Noise, family: LinearFit, frame: Any) -> Any:
        """Part of the linear fit."""
        rows = self.under(base)
        moved = self.wrenches - np.einsum("nij,nj->ni", rows.acting_stiffness, self.shift)
        inputs = np.hstack([self.poses, self.driven])
        return family.reduce(frame, inputs, moved, noise.covariance(rows))

    def moved(self, base: StiffnessMap, noise: Noise) -> _NoisyRows:
        """The rows with each pose where it most likely was under a map."""

        def of_block(block: slice) -> tuple[F, F]:
            own = self.of_rows(block)
            shift = _pose_shift(own.under(base), own.wrenches, own.shift, noise)
            return shift, _shifted(own.measured, shift, own.inputs)

        found = in_blocks(len(self.measured), of_block)
        shift, poses = (np.concatenate(arrays) for arrays in zip(*found, strict=True))
        return replace(self, poses=poses, shift=shift)


def _pose_shift(rows: Rows, wrenches: F, shift: F, noise: Noise) -> F:
    """(N, n) measured minus most likely pose, rotations as increments in base axes."""
    k_s, sd = rows.acting_stiffness, noise.pose_sd(rows.base.inputs)
    whitener = whiteners(noise.covariance(rows))
    e = wrenches - rows.wrench - np.einsum("nij,nj->ni", k_s, shift)
    weighted = np.einsum("nji,nj->ni", whitener, np.einsum("nij,nj->ni", whitener, e))
    shift = -np.einsum("nij,ni->nj", k_s, weighted) * sd**2
    return np.asarray(np.clip(shift, -_LARGEST_SHIFT * sd, _LARGEST_SHIFT * sd))


def _shifted(measured: F, shift: F, inputs: tuple[str, ...]) -> F:
    """Poses with p~ - p = shift; exp([shift]x) R(theta) = R(theta~) to first order."""
    poses = measured - shift
    if inputs == POSE:
        inverse = inverse_left_jacobians(np.ascontiguousarray(measured[:, 3:]))
        poses[:, 3:] = measured[:, 3:] - np.einsum("nij,nj->ni", inverse, shift[:, 3:])
    return np.ascontiguousarray(poses)
