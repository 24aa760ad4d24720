"""The variance of the noise that is left, with its degrees of freedom.

What an effect explains is no noise, but the best of many effects and shapes always explains
something: with few rows the rest after all of them would be far too small, and chance would get a
name. So only what is significant beside what was taken before is taken out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from ecm.io.arrays import F, I
from ecm.regression.f_test import omnibus_test
from ecm.regression.normal_equations import explained_by_blocks, projected_out

_MOST = 8
"""Effects that are taken out."""


@dataclass(frozen=True)
class Shapes:
    """Columns of every shape of every effect among those of a design."""

    columns: Sequence[tuple[int, ...]]
    ids: Sequence[str]
    """The effect of each shape."""


def significant_columns(
    equations: tuple[F, F],
    squares: float,
    freedom: int,
    fixed: Sequence[int],
    shapes: Shapes,
    level: float,
) -> I:
    """Return the columns of the effects that are significant, each beside those before it.

    Parameters
    ----------
    equations
        Matrix (K, K) and vector (K,) of all columns.
    squares
        Sum of squares that the fixed columns leave, of so many degrees of `freedom`.
    fixed
        Columns of the base.
    level
        Chance that any is taken where none explains anything, by Bonferroni over the shapes.

    Examples
    --------
    >>> x = np.random.default_rng(0).standard_normal((40, 3))
    >>> y = 3.0 * x[:, 1] + 0.1 * np.cos(np.arange(40.0))
    >>> shapes = Shapes([(0,), (1,), (2,)], ["a", "b", "c"])
    >>> significant_columns((x.T @ x, x.T @ y), float(y @ y), 40, (), shapes, 0.01).tolist()
    [1]
    """
    taken: list[int] = []
    present: set[str] = set()
    for _ in range(_MOST):
        tried = [i for i, id in enumerate(shapes.ids) if id not in present]
        left = projected_out(*equations, (*fixed, *taken))
        blocks = [shapes.columns[i] for i in tried]
        gains = np.minimum(explained_by_blocks(equations, left, blocks), squares)
        sizes = np.array([len(block) for block in blocks], dtype=np.int64)
        rest = freedom - sizes
        ratio = gains / sizes / np.maximum(squares - gains, 1e-12 * squares) * rest
        p = np.where(rest > 0, special.fdtrc(sizes, np.maximum(rest, 1), ratio), 1.0)
        if len(tried) == 0 or p.min() * len(shapes.columns) >= level:
            break
        # Of several that are certain, the one that explains most.
        best = int(np.lexsort((-gains, p))[0])
        taken += blocks[best]
        present.add(shapes.ids[tried[best]])
        squares, freedom = squares - float(gains[best]), int(rest[best])
    return np.array(taken, dtype=np.int64)


def noise_variance(response: F, weights: F, known: F, smooth: F, level: float) -> tuple[float, int]:
    """Return the variance beside base and effects, and its degrees of freedom.

    Parameters
    ----------
    response
        (N, m) whitened residual.
    weights
        (N,) of the rows.
    known
        (N, m, k) columns of the base and of the significant effects.
    smooth
        (N, m, q) smooth functions, which are taken out together where they are significant.
    level
        Chance that they are where nothing is there.

    Returns
    -------
    The variance, 1 where the noise is right, and 0 degrees of freedom where too few rows are left.
    """
    test = omnibus_test(response, smooth, known, weights)
    squares, freedom = test.rest, test.dof_error
    if not (freedom > 0 and test.p < level):
        squares, freedom = squares + max(test.explained, 0.0), freedom + test.dof
    return (squares / freedom, int(freedom)) if freedom > 0 else (1.0, 0)
