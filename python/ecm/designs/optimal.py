"""Optimal designs: the rows of a candidate table worth measuring, how good, and how many pay.

The error is that of the noise alone; the error of the model itself does not fall with n.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ecm._native import d_optimal, maximin, repeated_rows
from ecm.designs.regressors import (
    AVERAGED,
    CRITERIA,
    DesignSettings,
    NominalModel,
    Regressor,
    predicted_columns,
    prediction_region,
    regressor,
)
from ecm.errors import DesignError, InputError
from ecm.io.arguments import check_arguments
from ecm.io.arrays import LARGEST, F, I, eigh
from ecm.io.events import Printed
from ecm.regression.blas import one_blas_thread

Progress = Callable[[int, int], object] | None
_DEFAULT = DesignSettings()
_SMALLER = ("energy4", "poly:2", "linear")
"""Models that are tried where the rows do not determine the one that was asked for."""


@dataclass(frozen=True, repr=False, eq=False)
class Design(Printed):
    """Chosen rows of the candidates and how good they are.

    Parameters
    ----------
    indices
        (n,) rows of the candidates, from 0, growing.
    criterion
        Name of the criterion.
    value
        log det(M/n)/k, a variance in units of the noise's, or the smallest distance.
    bound
        Value that no design of this size can pass.
    efficiency
        Certified share of what is possible, at most 1.
    status
        How the search ended.

    Examples
    --------
    >>> import numpy as np
    >>> Design(np.array([0, 4, 8]), "d", -0.3, -0.2, 0.905, "converged").sentence()
    '3 poses, D-efficiency 90.5 % of what is possible'
    """

    indices: I
    criterion: str
    value: float
    bound: float
    efficiency: float
    status: str

    def __str__(self) -> str:
        return self.sentence()

    def sentence(self) -> str:
        """The design in one line."""
        least = "" if self.criterion in ("d", "i", "a", "di") else "at least "
        return (
            f"{len(self.indices)} poses, {CRITERIA[self.criterion]} {least}"
            f"{100.0 * self.efficiency:.1f} % of what is possible"
        )


@one_blas_thread()
def optimal_design(
    poses: F,
    n: int,
    settings: DesignSettings = _DEFAULT,
    *,
    include: ArrayLike = (),
    exclude: ArrayLike = (),
    measured: F | None = None,
    base: NominalModel | None = None,
    progress: Progress = None,
) -> Design:
    """Choose n of the candidate poses.

    Parameters
    ----------
    poses
        (N, d) candidates, in any consistent units.
    n
        Number of poses to choose, besides those of `include`.
    settings
        Criterion, model and search.
    include, exclude
        Rows that must be in, and rows that must not be chosen, from 0.
    measured
        (M, d) poses measured before: they count but are not chosen again.
    base
        Nominal model: weighs every row by the instruments' noise at its pose.
    progress
        Called with the work done and the whole work.

    Returns
    -------
    Design
        Chosen rows, growing, with the certified share of what is possible.

    Raises
    ------
    InputError
        No candidates, or all the same; a coordinate that is not finite or above 1e100 in size; a
        model that lacks its length or its nominal model.
    DesignError
        The candidates or `n` do not determine the model.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.linspace(-1.0, 1.0, 9)
    >>> poses = np.column_stack([x, x**2])
    >>> chosen = optimal_design(poses, 3, DesignSettings(model="linear", iterations=5))
    >>> [int(row) for row in chosen.indices]
    [0, 4, 8]
    """
    check_arguments(optimal_design, locals())
    poses = _checked(poses, "candidates")
    if measured is not None:
        measured = _checked(measured, "measured")
    inside = np.unique(_indices("include", include))
    outside = _indices("exclude", exclude)
    if not settings.replicates:
        again = repeated_rows(poses, inside.tolist(), outside.tolist())
        outside = np.union1d(outside, again).astype(np.int64)
    if not (np.ptp(poses, axis=0) > 0.0).any():
        raise InputError("design: all candidate poses are the same")
    paper = settings.method == "paper"
    names = ("starts", "iterations", "seed", "threads", "time_limit_s")
    search: dict[str, Any] = {name: getattr(settings, name) for name in names}
    search |= {"include": inside, "exclude": outside, "progress": progress}
    if settings.criterion == "maximin":
        scale, middle = _distance_scale(poses, settings)
        result = maximin(
            np.ascontiguousarray((poses - middle) * scale),
            n + len(inside),
            measured=None
            if measured is None
            else np.ascontiguousarray((measured - middle) * scale),
            method="exchange" if paper else "search",
            **search,
        )
    else:

        def searched(of: DesignSettings, rows: Regressor, **search: Any) -> Any:
            averaged, terms = of.criterion in AVERAGED, rows.rows.shape[1]
            return d_optimal(
                rows.rows,
                n + len(inside),
                criterion=of.criterion,
                rows_per_pose=rows.rows_per_pose,
                measured=rows.measured,
                prior=rows.prior,
                replicates=of.replicates,
                share=of.share,
                region=prediction_region(poses, of, base, terms) if averaged else None,
                method="fedorov" if paper else "search",
                **search,
            )

        rows = regressor(poses, settings, measured=measured, base=base)

        def determines(name: str) -> bool:
            """Whether the poses determine this smaller model, tried by one step of a search."""
            # An energy of few columns is none; a wrong list is wrong for every model.
            with suppress(InputError, DesignError):
                smaller = replace(settings, model=name)
                fewer = regressor(poses, smaller, measured=measured, base=base)
                if fewer.rows.shape[1] < rows.rows.shape[1]:
                    short = {"starts": 1, "iterations": 1, "progress": None}
                    searched(smaller, fewer, **search | short)
                    return True
            return False

        try:
            result = searched(settings, rows, **search)
        except DesignError as error:
            smaller = next(filter(determines, _SMALLER), None)
            if smaller is None:
                raise
            raise DesignError(f"{error}, for example --model {smaller}") from None
    return Design(
        indices=np.asarray(result.indices, dtype=np.int64),
        criterion=settings.criterion,
        value=result.value,
        bound=result.bound,
        efficiency=result.efficiency,
        status=result.status,
    )


def _checked(poses: F, name: str) -> F:
    """(N, d) finite numbers whose squares do not overflow."""
    poses = np.ascontiguousarray(poses, dtype=np.float64)
    if poses.ndim != 2 or 0 in poses.shape:
        raise InputError(
            f"design: {name} has shape {poses.shape}, expected rows of coordinates (N, d); "
            "give at least one pose"
        )
    bad = np.argwhere(~(np.abs(poses) <= LARGEST))
    if len(bad):
        row, column = (int(i) for i in bad[0])
        raise InputError(
            f"design: {name}: row {row}, column {column} is {poses[row, column]:g}, expected a "
            f"number of at most {LARGEST:g} in size; correct or leave out this row"
        )
    return poses


def _indices(name: str, given: ArrayLike) -> I:
    """Places of rows (N,); InputError for anything else."""
    values = np.asarray(given)
    if values.ndim != 1 or (len(values) and values.dtype.kind not in "iu"):
        raise InputError(f"{name}: expected a list of row numbers from 0, whole numbers")
    return values.astype(np.int64)


def _distance_scale(poses: F, settings: DesignSettings) -> tuple[F, F]:
    """(d,) factor and origin of the coordinates of distances."""
    low, high = poses.min(axis=0), poses.max(axis=0)
    if settings.metres_per_radian is None:
        width = np.where(high > low, high - low, np.inf)
        return 2.0 / width, 0.5 * (low + high)
    of_radian = settings.metres_per_radian
    if other := [name for name in settings.columns if not name.endswith(("_m", "_rad"))]:
        raise InputError(
            f"metres_per_radian: {', '.join(other)} is no length and no angle; leave "
            "metres_per_radian out, so that every column counts by its range"
        )
    lengths = [of_radian if name.endswith("_rad") else 1.0 for name in settings.columns]
    return np.asarray(lengths), np.zeros(len(lengths))


_DEFAULT_SIZES = DesignSettings(iterations=60)
_SAMPLE = 300
"""Number of poses over which the error is averaged."""
_MAX_ERROR = 100.0
"""Largest error that is shown, over the noise of a reading; the fewest poses may exceed it."""


@dataclass(frozen=True)
class Size:
    """A number of poses and the error that its design leaves.

    Parameters
    ----------
    n
        Number of poses.
    efficiency
        Certified share of what is possible with n poses.
    wrench_error
        Standard deviation of a predicted component over that of one reading, rms.
    stiffness_error
        The same of K times half the range of the pose: the error of K over the workspace.
    knee
        Whether further poses pay less from here on.

    Examples
    --------
    >>> Size(20, 0.98, 0.41, 0.55).to_dict()["n"]
    20
    """

    n: int
    efficiency: float
    wrench_error: float
    stiffness_error: float
    knee: bool = False

    def to_dict(self) -> dict[str, Any]:
        """For --json."""
        return dict(vars(self))


def design_sizes(
    poses: F,
    sizes: Sequence[int] = (),
    settings: DesignSettings = _DEFAULT_SIZES,
    *,
    most: int | None = None,
    base: NominalModel | None = None,
    progress: Progress = None,
) -> list[Size]:
    """Expected errors of the best designs of some sizes, and where further poses pay least.

    Parameters
    ----------
    poses
        (N, d) candidates, in any consistent units.
    sizes
        Numbers of poses; empty: from the fewest that determine the model to `most`.
    settings
        Criterion, model and search of each design; by default 60 iterations.
    most
        Largest number of poses; by default eight times the fewest.
    base
        Nominal model: weighs every row by the instruments' noise at its pose.
    progress
        Called with the sizes done and their number.

    Returns
    -------
    list of Size
        Errors in units of one reading's noise; one size is marked as the knee.

    Raises
    ------
    InputError
        A size does not determine the model or exceeds the candidates.

    Examples
    --------
    >>> import numpy as np
    >>> poses = np.random.default_rng(0).uniform(-1.0, 1.0, (40, 2))
    >>> sizes = design_sizes(poses, [4, 8, 16], DesignSettings(model="linear", iterations=5))
    >>> [size.n for size in sizes], sum(size.knee for size in sizes)
    ([4, 8, 16], 1)
    """
    poses = np.ascontiguousarray(poses, dtype=np.float64)
    rows = regressor(poses, settings, base=base)
    terms = rows.rows.shape[1]
    least = -(-terms // rows.rows_per_pose)
    given = len(sizes) > 0
    if not given:
        top = 8 * least if most is None else most
        most = max(least + 1, min(len(poses), top))
        sizes = np.unique(np.geomspace(least + 1, most, 12).round().astype(int)).tolist()
    if min(sizes) < least or max(sizes) > len(poses):
        raise InputError(
            f"--how-many: sizes from {min(sizes)} to {max(sizes)}, expected {least} (fewer poses "
            f"do not determine {settings.model}) to {len(poses)} (the candidates)"
        )
    seen = np.random.default_rng([settings.seed, 5]).permutation(len(poses))[:_SAMPLE]
    values, slopes = predicted_columns(poses, seen, settings, base)
    # Columns of unit length: their scale changes the rounding of the errors alone.
    norms = np.linalg.norm(rows.rows, axis=0)
    values, slopes = values / norms, slopes / norms
    blocks = (rows.rows / norms).reshape(len(poses), rows.rows_per_pose, terms)
    results: list[Size] = []
    for done, n in enumerate(sizes):
        try:
            design = optimal_design(poses, n, settings, base=base)
        except DesignError:
            # An energy model needs more poses than its terms over six.
            if given or n == sizes[-1]:
                raise
            continue
        chosen = blocks[design.indices].reshape(-1, terms)
        errors = [_error(chosen, part.reshape(-1, terms)) for part in (values, slopes)]
        if given or errors[0] < _MAX_ERROR:
            results.append(Size(n, design.efficiency, errors[0], errors[1]))
        if progress is not None:
            progress(done + 1, len(sizes))
    at = knee([size.n for size in results], [size.wrench_error for size in results])
    return [replace(size, knee=i == at) for i, size in enumerate(results)]


def _error(chosen: F, rows: F) -> float:
    """Root mean variance of the predicted rows; infinite where the design is singular."""
    values, vectors = eigh(chosen.T @ chosen)
    if values[0] <= 1e-14 * values[-1]:
        return float("inf")
    variance = ((rows @ vectors) ** 2 / values).sum(axis=1)
    return float(np.sqrt(variance.mean()))


def knee(n: ArrayLike, error: ArrayLike) -> int:
    """Position of the point farthest below the chord of a falling curve, both axes scaled to 1."""
    x, y = np.asarray(n, dtype=np.float64), np.asarray(error, dtype=np.float64)
    if len(x) < 3 or x[-1] <= x[0] or y[0] <= y[-1]:
        return len(x) - 1
    u, v = (x - x[0]) / (x[-1] - x[0]), (y - y[-1]) / (y[0] - y[-1])
    return int((1.0 - u - v).argmax())
