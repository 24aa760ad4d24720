"""Number of poses against the expected error of wrench and stiffness, with the knee.

The error is that of the noise alone; the error of the model itself does not fall with n.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ecm.designs.nominal import NominalModel
from ecm.designs.optimal import Progress, optimal_design
from ecm.designs.prediction import predicted_columns
from ecm.designs.regressors import regressor
from ecm.designs.settings import DesignSettings
from ecm.errors import DesignError, InputError
from ecm.io.arrays import F

_DEFAULT = DesignSettings(iterations=60)
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
    settings: DesignSettings = _DEFAULT,
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
    values, vectors = np.linalg.eigh(chosen.T @ chosen)
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
