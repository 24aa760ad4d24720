"""Least squares on group-wise normal equations: refits, folds and draws without the rows.

For whitened rows y = Z theta + noise, everything that a comparison of models needs is in
G_g = Z_g' Z_g, c_g = Z_g' y_g and s_g = y_g' y_g of each group g of rows. Tables of many rows are
worked on in blocks, so that memory and time grow with the rows alone; the blocks do not depend on
the number of threads, and neither do the bits of a result.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar

import numpy as np
from scipy.linalg import lapack

from ecm._native import merged_triangle
from ecm.io.arrays import F, I, eigh
from ecm.io.events import Progress
from ecm.io.extras import own_cores
from ecm.io.table import Table

RIDGE = 1e-10
_WEIGHED = 512
"""Rows that are weighed at once: a copy of all of them would be a large part of the memory."""
_WORK_PER_COLUMN = 64
"""Workspace of LAPACK for blocks of its largest usual size."""
_LEAST_SEEN = 1e-9
"""Share of a column's squares that the other rows must hold; below it is rounding."""


@dataclass(frozen=True)
class NormalEquations:
    """Normal equations of groups of rows, formed when they are first used.

    With hundreds of columns the matrices of all groups are far larger than the rows, and the rows
    are most of what there is: they are weighed a part at a time, not copied.
    """

    design: F
    """(N, m, k) rows as they were given; do not change them."""
    order: I
    """(N,) places of the rows, group after group."""
    root: F
    """(N,) square root of the weight of each row."""
    response: F
    """(N m,) weighted, group after group."""
    bounds: I
    """(g + 1,) where each group begins in the response."""
    squares: F
    """(g,)."""
    precision: F
    """(k,) 1 / variance of a normal prior of each coefficient around zero; 0: nothing is known."""

    @staticmethod
    def of(
        design: F, response: F, groups: I, row_weights: F | None = None, precision: F | None = None
    ) -> NormalEquations:
        """Whitened design (N, m, k) and response (N, m), groups (N,) from 0 on.

        `precision`: (k,), see the class.
        """
        n, m, k = design.shape
        root = np.ones(n) if row_weights is None else np.sqrt(row_weights)
        count = int(groups.max()) + 1
        order = np.argsort(groups, kind="stable")
        y = response * root[:, None]
        bounds = np.searchsorted(groups[order], np.arange(count + 1)) * m
        squares = np.asarray(np.bincount(groups, (y**2).sum(axis=1), count), dtype=np.float64)
        return NormalEquations(
            design,
            order,
            root,
            y[order].ravel(),
            bounds.astype(np.int64),
            squares,
            np.zeros(k) if precision is None else precision,
        )

    def rows(self, columns: Sequence[int] | None = None, part: slice | I = slice(None)) -> F:
        """(r, k) weighted rows of some columns, group after group; of a part of their order."""
        places = self.order[part]
        if columns is None:
            rows = self.design[places]
        else:
            component = np.arange(self.design.shape[1])[:, None]
            at = np.asarray(columns, dtype=np.int64)
            rows = self.design[places[:, None, None], component, at]
        return self._weighed(rows, places)

    def _weighed(self, rows: F, places: I) -> F:
        """(r, k) of rows (n, m, k) at these places, which are overwritten."""
        rows *= self.root[places, None, None]
        return rows.reshape(rows.shape[0] * rows.shape[1], rows.shape[2])

    @cached_property
    def total(self) -> tuple[F, F, float]:
        """G, c, s of all groups together."""
        matrix, vector = self._products(None)
        matrix[np.diag_indices_from(matrix)] += self.precision
        return matrix, vector, float(self.squares.sum())

    def _products(self, others: F | None) -> tuple[F, F]:
        """(k, q) and (q,) products of the columns, and of the response, with others (N, m, q).

        Default: with the columns themselves.
        """
        m = self.design.shape[1]

        def of_part(part: slice) -> tuple[F, F]:
            rows, places = self.rows(part=part), self.order[part]
            right = rows if others is None else self._weighed(others[places], places)
            return rows.T @ right, self.response[m * part.start : m * part.stop] @ right

        parts = [slice(a, a + _WEIGHED) for a in range(0, max(len(self.order), 1), _WEIGHED)]
        matrix, vector = of_part(parts[0])
        for of_rows, of_response in _in_threads(of_part, parts[1:]):
            matrix += of_rows
            vector += of_response
        return matrix, vector

    def with_columns(self, design: F, more: int) -> NormalEquations:
        """The equations of a design that ends with so many columns more, of which nothing is known.

        What is known of all groups together is not formed again.
        """
        precision = np.pad(self.precision, (0, more))
        wider = replace(self, design=design, precision=precision)
        if "total" in vars(self) and more:
            matrix, vector, squares = self.total
            beside, own = wider._products(design[:, :, -more:])
            left = np.concatenate([matrix, beside[:-more].T])
            total = np.concatenate([left, beside], axis=1), np.concatenate([vector, own]), squares
            vars(wider).update(total=total)
        return wider

    def beside(self, rows: F, response: F) -> NormalEquations:
        """The equations of the same groups for other columns (r, k) and another response (r,)."""
        sizes = np.diff(self.bounds)
        group = np.repeat(np.arange(len(sizes)), sizes)
        squares = np.asarray(np.bincount(group, response**2, len(sizes)), dtype=np.float64)
        every, weights = np.arange(len(response)), np.ones(len(response))
        precision = np.zeros(rows.shape[1])
        return NormalEquations(
            rows[:, None, :], every, weights, response, self.bounds, squares, precision
        )

    def held_out(
        self,
        columns: Sequence[int],
        fold_of_group: I,
        scored: F,
        known: tuple[F, F] | None = None,
        projected: F | None = None,
    ) -> F:
        """(g,) held-out sum of squares of each group, fitted without its fold.

        Parameters
        ----------
        scored
            (g,) 1 for groups that count, 0 for others (their squares are set to 0).
        known
            Whitened rows (r, k) of these columns, and their response (r,), that no fold leaves out.
        projected
            (r, b) orthonormal columns that rows and response are without; they are fitted as well.
        """
        take = np.asarray(columns, dtype=np.int64)
        matrix, vector = self.total[0][np.ix_(take, take)], self.total[1][take]
        if known is not None:
            matrix, vector = matrix + known[0].T @ known[0], vector + known[1] @ known[0]
        result = np.zeros(len(self.squares))
        group = np.repeat(np.arange(len(self.squares)), np.diff(self.bounds))
        of_row = group[:: self.design.shape[1]]
        # By the rows of each fold: a matrix of each group would hold k times as much as all rows.
        for fold in np.unique(fold_of_group):
            inside = np.flatnonzero((fold_of_group == fold)[group])
            response = self.response[inside]
            rows = self.rows(columns, np.flatnonzero((fold_of_group == fold)[of_row]))
            others, read = rows, response
            if projected is not None and projected.shape[1]:
                both = _without_them(projected[inside], np.column_stack([rows, response]))
                others, read = both[:, :-1], both[:, -1]
            theta = solve(*difference((matrix, vector), (rows.T @ others, read @ rows)))
            left = (read - others @ theta) ** 2
            result += np.bincount(group[inside], left, len(result))
        return np.where(scored > 0.0, result, 0.0)


def _without_them(projected: F, left: F) -> F:
    """(i, k) what some rows leave where the projected columns are fitted to all other rows.

    Parameters
    ----------
    projected
        (i, b) these rows of orthonormal columns.
    left
        (i, k) what they leave where these columns are fitted to all rows. What only these rows
        tell of them stays so.
    """
    shares, directions = eigh(projected.T @ projected)
    others = 1.0 - shares
    grown = np.divide(1.0, others, out=np.zeros_like(others), where=others > _LEAST_SEEN)
    along = projected @ directions
    return np.asarray(left + (along * grown) @ (along.T @ left))


def difference(whole: tuple[F, F], part: tuple[F, F]) -> tuple[F, F]:
    """Return matrix and vector of all rows less those of some of them.

    A column that is zero in all other rows leaves rounding errors, which a fit would divide by each
    other: it is set to zero.
    """
    matrix, vector = whole[0] - part[0], whole[1] - part[1]
    lost = np.diag(matrix) <= _LEAST_SEEN * np.diag(whole[0])
    matrix[lost] = 0.0
    matrix[:, lost] = 0.0
    vector[lost] = 0.0
    return matrix, vector


def solve(matrix: F, vector: F) -> F:
    """Solution of near-singular normal equations, scaled to unit diagonal."""
    if len(vector) == 0:
        return np.zeros(0)
    diagonal = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    scaled = matrix / np.outer(diagonal, diagonal)
    scaled[np.diag_indices_from(scaled)] += RIDGE
    return np.asarray(np.linalg.solve(scaled, vector / diagonal) / diagonal)


def ridge_path(matrix: F, vector: F, ridges: F) -> F:
    """(k, r) solutions of (matrix + ridge I) x = vector, one column for each of the ridges.

    The symmetric matrix is made tridiagonal once, which is a third of the work of its eigenvectors;
    then each ridge costs a few k. The reflections of `dsytrd` leave the first coordinate as it is.

    Examples
    --------
    >>> ridge_path(np.diag([1.0, 3.0]), np.array([2.0, 2.0]), np.array([1.0]))[:, 0].tolist()
    [1.0, 0.5]
    """
    if len(vector) < 2:
        return np.asarray(vector[:, None] / (matrix + ridges))
    packed, diagonal, beside, tau, _ = lapack.dsytrd(matrix, lower=1)
    reflectors = np.asfortranarray(packed[1:, :-1])

    def turned(values: F, transposed: str) -> F:
        tail = np.asfortranarray(values[1:])
        work = _WORK_PER_COLUMN * max(values.shape)
        return np.vstack(
            [values[:1], lapack.dormqr("L", transposed, reflectors, tau, tail, work)[0]]
        )

    along = turned(vector[:, None], "T")[:, 0]
    return turned(
        np.stack([lapack.dptsv(diagonal + one, beside, along)[2] for one in ridges], axis=1), "N"
    )


def projected_out(matrix: F, vector: F, fixed: Sequence[int]) -> tuple[F, F]:
    """Normal equations after projecting the fixed columns out of all columns."""
    if len(fixed) == 0:
        return matrix, vector
    cross, shares, own = _projection(matrix, vector, fixed)
    return matrix - cross.T @ shares, vector - cross.T @ own


def _projection(matrix: F, vector: F, fixed: Sequence[int]) -> tuple[F, F, F]:
    """Products (f, k) of the fixed columns with all, their shares of these, and of the response."""
    take = np.asarray(fixed, dtype=np.int64)
    diagonal = np.sqrt(np.maximum(np.diag(matrix)[take], 1e-300))
    inner = matrix[np.ix_(take, take)] / np.outer(diagonal, diagonal)
    inner[np.diag_indices_from(inner)] += RIDGE
    cross = matrix[take] / diagonal[:, None]
    right = np.column_stack([cross, vector[take] / diagonal])
    solution = np.linalg.solve(inner, right)
    return cross, solution[:, :-1], solution[:, -1]


def explained_by_blocks(
    matrix: F,
    vector: F,
    fixed: Sequence[int],
    blocks: Sequence[tuple[int, ...]],
    signs: F | None = None,
) -> F:
    """(b,) sum of squares that each block of columns explains beside the fixed ones.

    Parameters
    ----------
    matrix, vector
        (k, k) and (k,) normal equations of all columns.
    signs
        (k,) 1 or -1 for a coefficient that may only be positive or negative, else 0: columns of
        the wrong sign are left out of their block.
    """
    squares = np.zeros(len(blocks))
    ridge = RIDGE * np.maximum(np.diag(matrix), 1e-200)
    signs = np.zeros(len(ridge)) if signs is None else signs
    # Of many shapes of a few columns each: all their products would be most of the work.
    cross, shares, own = _projection(matrix, vector, fixed)
    sizes = np.array([len(block) for block in blocks], dtype=np.int64)
    for size in np.unique(sizes).tolist():
        which = np.flatnonzero(sizes == size).tolist()
        take = np.array([blocks[i] for i in which], dtype=np.int64).reshape(len(which), size)
        of_block = cross.T[take]
        matrices = matrix[take[:, :, None], take[:, None, :]]
        matrices -= of_block @ shares.T[take].swapaxes(1, 2)
        matrices[:, np.arange(size), np.arange(size)] += ridge[take]
        slopes = vector[take] - of_block @ own
        squares[which] = explained_with_signs(matrices, slopes, signs[take])
    return squares


def explained_with_signs(matrix: F, slope: F, signs: F) -> F:
    """(..., b) squares that each of b blocks of k columns explains.

    Parameters
    ----------
    matrix, slope
        (..., b, k, k) and (..., b, k) normal equations of each block.
    signs
        (b, k) 1 or -1 for a coefficient that may only be positive or negative, else 0: columns of
        the wrong sign are left out of their block.
    """
    k = slope.shape[-1]
    taken = np.ones(slope.shape, dtype=np.bool_)
    theta = _solved(matrix, slope)
    for _ in range(k):
        wrong = taken & (signs * theta < 0.0)
        again = wrong.any(axis=-1)
        if not again.any():
            break
        taken &= ~wrong
        kept = taken[again]
        block = np.where(kept[:, :, None] & kept[:, None, :], matrix[again], np.eye(k))
        theta[again] = _solved(block, np.where(kept, slope[again], 0.0))
    return np.asarray(np.where(taken, slope * theta, 0.0).sum(axis=-1))


def _solved(matrices: F, vectors: F) -> F:
    """(..., k) matrices^-1 vectors."""
    if vectors.shape[-1] == 1:
        return np.asarray(vectors / matrices[..., 0])
    return np.asarray(np.linalg.solve(matrices, vectors[..., None])[..., 0])


def explained_squares(matrix: F, vector: F, columns: Sequence[int]) -> float:
    """Sum of squares that these columns explain."""
    take = np.asarray(columns, dtype=np.int64)
    if len(take) == 0:
        return 0.0
    return float(vector[take] @ solve(matrix[np.ix_(take, take)], vector[take]))


T = TypeVar("T")
U = TypeVar("U")

MANY_ROWS = 10_000
"""From this many rows on a fit starts from a part of them, and folds share one linearisation."""
_FEW_ROWS = 5_000
_BLOCK = 4096


def in_blocks(rows: int, work: Callable[[slice], T], progress: Progress | None = None) -> list[T]:
    """Results of `work` for each block of rows, in order; several blocks are shared by threads.

    `progress` is told the rows that are done, of all.
    """
    blocks = [slice(start, min(start + _BLOCK, rows)) for start in range(0, rows, _BLOCK)]
    results = []
    told = progress or (lambda done, total, words: None)
    told(0, rows, "")
    for block, result in zip(blocks, _in_threads(work, blocks), strict=True):
        results.append(result)
        told(block.stop, rows, "")
    return results


def in_threads(work: Callable[[U], T], items: Iterable[U]) -> list[T]:
    """Results of `work` for each item, in order; from the first long one on the cores share them.

    Threads of shorter work wait for each other: they take as long as one alone, and more of the
    processor.

    Examples
    --------
    >>> in_threads(abs, [-1, 2])
    [1, 2]
    """
    left = list(items)
    results: list[T] = []
    long = False
    while left and not long:
        start_s = time.perf_counter()
        results.append(work(left.pop(0)))
        long = time.perf_counter() - start_s > sys.getswitchinterval()
    return [*results, *_in_threads(work, left)]


def _in_threads(work: Callable[[U], T], items: Sequence[U]) -> Iterator[T]:
    if len(items) < 2:
        yield from map(work, items)
        return
    with ThreadPoolExecutor(own_cores()) as pool:
        yield from pool.map(work, items)


def triangles_of_folds(
    fold: I, triangle: Callable[[I], F], progress: Progress | None = None
) -> list[F]:
    """(c, c) triangle of each fold's rows.

    Parameters
    ----------
    fold
        (N,) number of each row's fold, from 0.
    triangle
        Triangle of rows of one block, given by their index.
    progress
        Called with the rows that are read, of all.
    """
    count = int(fold.max()) + 1

    def of_block(block: slice) -> list[tuple[int, F]]:
        own = fold[block]
        return [
            (part, triangle(block.start + np.flatnonzero(own == part)))
            for part in np.unique(own).tolist()
        ]

    parts: list[list[F]] = [[] for _ in range(count)]
    for found in in_blocks(len(fold), of_block, progress):
        for part, own in found:
            parts[part].append(own)
    return [merged_triangle(own) for own in parts]


def without_each(fold: I, parts: Sequence[F], solve: Callable[[Sequence[F], int], T]) -> list[T]:
    """What `solve` makes of the parts without each fold, and of their number of rows."""
    left = len(fold) - np.bincount(fold)
    return [solve([*parts[:i], *parts[i + 1 :]], int(rows)) for i, rows in enumerate(left)]


def few_rows(table: Table) -> Table:
    """Some thousand rows of a table of many, evenly spaced; of fewer rows the table itself."""
    if len(table) < MANY_ROWS:
        return table
    return table.select(np.arange(0, len(table), len(table) // _FEW_ROWS))
