"""Types of numpy arrays for signatures, as `poses: F` of floats, and what many do with them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

F = NDArray[np.float64]
"""Floating-point numbers."""
I = NDArray[np.int64]
"""Whole numbers: rows, groups, folds."""
B = NDArray[np.bool_]
"""Masks."""

LARGEST = 1e100
"""Largest size of a number of a user: squares and products of larger ones overflow."""


def evenly(count: int, most: int) -> I:
    """Numbers of at most so many of `count` rows, evenly spaced, the first and the last with them.

    Examples
    --------
    >>> evenly(5, 3), evenly(2, 3)
    (array([0, 2, 4]), array([0, 1]))
    """
    return np.linspace(0, count - 1, min(count, most)).astype(np.int64)


def float_of(text: str) -> float:
    """The number that a text states; nan for any other text.

    Examples
    --------
    >>> float_of(" 2.5"), float_of("two")
    (2.5, nan)
    """
    try:
        return float(text)
    except ValueError:
        return math.nan


def rms(values: F) -> float:
    """Root mean square of numbers of any shape.

    Examples
    --------
    >>> rms(np.array([[3.0, 4.0], [0.0, 5.0]])).is_integer(), rms(np.array([2.0, -2.0]))
    (False, 2.0)
    """
    return float(np.sqrt((values**2).mean()))


def rms_of_columns(values: F) -> F:
    """(m,) root mean square of each column of (N, m).

    Examples
    --------
    >>> rms_of_columns(np.array([[2.0, 0.0], [-2.0, 0.0]]))
    array([2., 0.])
    """
    return np.asarray(np.sqrt((values**2).mean(axis=0)))


def central_differences(
    function: Callable[[F], F], at: F, step: float | Sequence[float]
) -> list[F]:
    """Derivative of a function of coordinates (..., n) to each of them in turn.

    Examples
    --------
    >>> central_differences(lambda x: x[:, 0] * x[:, 1], np.array([[2.0, 3.0]]), 0.5)
    [array([3.]), array([2.])]
    """
    slopes = []
    for change in np.diag(np.broadcast_to(step, at.shape[-1:])):
        size = 2.0 * change.sum()
        slopes.append((function(at + change) - function(at - change)) / size)
    return slopes


def svd(a: F) -> tuple[F, F, F]:
    """U (r, q), singular values (q,) and V' (q, k) of a (r, k), q = min(r, k).

    The fast algorithm gives up on some good matrices (OpenBLAS issue 3044); the slow one does not.

    Examples
    --------
    >>> svd(np.diag([2.0, 3.0]))[1].tolist()
    [3.0, 2.0]
    """
    try:
        u, values, vt = np.linalg.svd(a, full_matrices=False)
    except np.linalg.LinAlgError:
        u, values, vt = _slow("svd", a, full_matrices=False, lapack_driver="gesvd")
    return u, values, vt


def eigh(matrix: F) -> tuple[F, F]:
    """Eigenvalues (k,), rising, and vectors (k, k) of a symmetric matrix; as `svd`.

    Examples
    --------
    >>> eigh(np.diag([3.0, 2.0]))[0].tolist()
    [2.0, 3.0]
    """
    try:
        values, vectors = np.linalg.eigh(matrix)
    except np.linalg.LinAlgError:
        values, vectors = _slow("eigh", matrix, driver="ev")
    return values, vectors


def _slow(name: str, matrix: F, **options: Any) -> Any:
    """Ask scipy where the fast algorithm gave up on finite numbers."""
    if not np.isfinite(matrix).all():
        raise np.linalg.LinAlgError("not finite")
    import scipy.linalg  # noqa: PLC0415 - takes long to load

    return getattr(scipy.linalg, name)(matrix, **options)


def pinvh(matrix: F, rcond: float = 1e-15) -> F:
    """Pseudo-inverse of a symmetric matrix; eigenvalues below this share of the largest are zero.

    Examples
    --------
    >>> pinvh(np.diag([4.0, 0.0])).tolist()
    [[0.25, 0.0], [0.0, 0.0]]
    """
    values, vectors = eigh(matrix)
    sizes = np.abs(values)
    seen = sizes > rcond * sizes.max(initial=0.0)
    return np.asarray((vectors[:, seen] / values[seen]) @ vectors[:, seen].T)


def lstsq(z: F, y: F, rcond: float | None = None) -> F:
    """Shortest x (k,) or (k, q) with the least squares of y - z x, of columns z (r, k) of any rank.

    Parameters
    ----------
    rcond
        Singular values below this share of the largest count as zero; default: rounding.

    Examples
    --------
    >>> lstsq(np.ones((2, 2)), np.array([2.0, 4.0])).round(9).tolist()
    [1.5, 1.5]
    """
    try:
        return np.asarray(np.linalg.lstsq(z, y, rcond=rcond)[0])
    except np.linalg.LinAlgError:
        u, values, vt = svd(z)
        least = np.finfo(float).eps * max(z.shape) if rcond is None else rcond
        seen = values > least * values[0]
        return np.asarray((vt[seen].T / values[seen]) @ (u[:, seen].T @ y))


_EXACT = 1e-7
"""Share by which a second step may change a fit: its square is what that step itself errs by."""


def rest_of(z: F, y: F) -> F:
    """What columns z (r, k) of any size and rank leave of y, (r,) or (r, q).

    By normal equations where a second step shows that they are exact, which takes a fifth of the
    time; else by singular values.

    Examples
    --------
    >>> column = np.array([1.0, 2.0, 2.0])
    >>> rest_of(np.column_stack([column, 2.0 * column]), np.array([3.0, 0.0, 0.0])).round(9)
    array([ 2.66666667, -0.66666667, -0.66666667])
    """
    largest = np.abs(z).max(axis=0, initial=0.0)
    z = z / np.where(largest > 0.0, largest, 1.0)  # before squares, which may overflow
    norms = np.sqrt((z**2).sum(axis=0))
    z = z / np.where(norms > 0.0, norms, 1.0)
    with suppress(np.linalg.LinAlgError), np.errstate(all="ignore"):
        inverse = np.linalg.inv(z.T @ z)
        taken = z @ (inverse @ (z.T @ y))
        more = z @ (inverse @ (z.T @ (y - taken)))
        if (more**2).sum() <= _EXACT**2 * (taken**2).sum():
            return np.asarray(y - taken - more)
    return np.asarray(y - z @ lstsq(z, y, rcond=1e-10))
