"""Rows of a candidate table that are worth measuring, and how good that choice is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, cast, get_args

import numpy as np
from numpy.typing import ArrayLike

from ecm._native import d_optimal, maximin
from ecm.designs.nominal import NominalModel
from ecm.designs.prediction import prediction_region
from ecm.designs.regressors import regressor
from ecm.effects import Effect
from ecm.errors import InputError
from ecm.io.arrays import F, I
from ecm.io.columns import POSE

Progress = Callable[[int, int], object] | None
Criterion = Literal["d", "i", "a", "g", "di", "maximin"]

_WORDS = {
    "d": "D-efficiency",
    "i": "average variance of h and K",
    "a": "summed coefficient variance",
    "g": "largest prediction variance",
    "di": "D- and I-efficiency together",
    "maximin": "smallest distance",
}


@dataclass(frozen=True)
class Design:
    """Chosen rows of the candidates and how good they are."""

    indices: I
    criterion: str
    value: float
    """log det(M/n)/k, a variance in units of the noise's, or the smallest distance."""
    bound: float
    """No design of this size can pass this value."""
    efficiency: float
    """Certified share of what is possible, at most 1."""
    status: str

    def sentence(self) -> str:
        """One line for people."""
        least = "at least " if self.criterion in ("g", "maximin") else ""
        return (
            f"{len(self.indices)} poses, {_WORDS[self.criterion]} {least}"
            f"{100.0 * self.efficiency:.1f} % of what is possible"
        )


def optimal_design(
    poses: F,
    n: int,
    *,
    criterion: str = "d",
    model: str = "cubic",
    length_m: float | None = None,
    seed: int = 0,
    threads: int = 0,
    starts: int = 10,
    iterations: int = 0,
    time_limit_s: float = 0.0,
    include: ArrayLike = (),
    exclude: ArrayLike = (),
    measured: F | None = None,
    replicates: bool = False,
    base: NominalModel | None = None,
    effects: Sequence[Effect] = (),
    share: float = 0.5,
    ridge: float = 0.0,
    method: Literal["search", "paper"] = "search",
    metres_per_radian: float | None = None,
    columns: Sequence[str] = POSE,
    progress: Progress = None,
) -> Design:
    """n of the candidate poses, (N, d) in any consistent units, besides those of `include`.

    Parameters
    ----------
    criterion
        d, i, a, g for `model`: i averages the variances of h and of K times half the range; di: D
        in `share`, I in the rest; maximin: the Euclidean distance in
        coordinates normalised to [-1, 1], or of positions and rotations with
        `metres_per_radian`.
    model
        poly:D, energyD with its length, or physics with `base`.
    include, exclude
        Rows that must be in, and that must not be chosen.
    measured
        (M, d) poses measured before: they count but are not chosen again.
    base
        Weighs every row by the instruments' noise at its pose.
    effects
        The design determines their parameters too, as far as the poses can.
    ridge
        Information known beforehand on every coefficient but a polynomial's constant: the design
        for a ridge fit with this lambda (Bayesian D, I, A).
    method
        search: the best there is; paper: Fedorov's exchange for d, simple exchange for maximin.
    columns
        Names of the coordinates, for `metres_per_radian`.
    """
    if criterion not in get_args(Criterion):
        raise InputError(f"criterion {criterion!r}: expected {', '.join(get_args(Criterion))}")
    inside = np.unique(np.asarray(include, dtype=np.int64))
    outside = np.asarray(exclude, dtype=np.int64)
    if not replicates:
        outside = np.union1d(outside, repeated(poses, inside, outside)).astype(np.int64)
    poses = np.ascontiguousarray(poses, dtype=np.float64)
    low, high = poses.min(axis=0), poses.max(axis=0)
    moving = high > low
    if not moving.any():
        raise InputError("design: all candidate poses are the same")
    if criterion == "maximin":
        scale, middle = _distance_scale(poses, metres_per_radian, columns)
        done = None if measured is None else np.ascontiguousarray((measured - middle) * scale)
        found = maximin(
            np.ascontiguousarray((poses - middle) * scale), n + len(inside), starts=starts,
            iterations=iterations, seed=seed, threads=threads, time_limit_s=time_limit_s,
            include=inside, exclude=outside, measured=done, progress=progress,
            method="exchange" if method == "paper" else "search",
        )  # fmt: skip
    else:
        rows = regressor(
            poses, model, length_m=length_m, measured=measured, base=base, effects=effects,
            ridge=ridge,
        )  # fmt: skip
        region = None
        if criterion in ("i", "di"):
            region = prediction_region(poses, model, length_m, base, rows.rows.shape[1])
        found = d_optimal(
            rows.rows, n + len(inside), rows_per_pose=rows.rows_per_pose, starts=starts,
            iterations=iterations, seed=seed, threads=threads, time_limit_s=time_limit_s,
            include=inside, exclude=outside, measured=rows.measured, prior=rows.prior,
            replicates=replicates, share=share, region=region, progress=progress,
            method="fedorov" if method == "paper" else "search",
            criterion=cast(Literal["d", "i", "a", "g", "di"], criterion),
        )  # fmt: skip
    return Design(
        indices=np.asarray(found.indices, dtype=np.int64),
        criterion=criterion,
        value=found.value,
        bound=found.bound,
        efficiency=found.efficiency,
        status=found.status,
    )


def repeated(poses: F, include: I, exclude: I) -> I:
    """Rows with the coordinates of an earlier one that may be chosen, or of an included one."""
    # + 0.0 makes -0 and 0 the same pose.
    keys = [row.tobytes() for row in np.ascontiguousarray(poses) + 0.0]
    kept = set(include.tolist())
    out = set(exclude.tolist())
    seen = {keys[i] for i in kept if 0 <= i < len(keys)}
    found = []
    for i, key in enumerate(keys):
        if i in kept or i in out:
            continue
        if key in seen:
            found.append(i)
        seen.add(key)
    return np.asarray(found, dtype=np.int64)


def _distance_scale(
    poses: F, metres_per_radian: float | None, columns: Sequence[str]
) -> tuple[F, F]:
    """(d,) factor and origin of the coordinates of distances."""
    low, high = poses.min(axis=0), poses.max(axis=0)
    if metres_per_radian is None:
        width = np.where(high > low, high - low, np.inf)
        return 2.0 / width, 0.5 * (low + high)
    if not (metres_per_radian > 0.0 and np.isfinite(metres_per_radian)):
        raise InputError(f"metres per radian = {metres_per_radian}: expected a positive number")
    lengths = [metres_per_radian if name.endswith("_rad") else 1.0 for name in columns]
    return np.asarray(lengths), np.zeros(len(lengths))
