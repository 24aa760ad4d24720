"""Tables of many rows: worked on in blocks, so that memory and time grow with the rows alone.

The blocks do not depend on the number of threads, and neither do the bits of a result.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from threading import Thread
from typing import TypeVar

import numpy as np

from ecm._native import merged_triangle
from ecm.io.arrays import F, I
from ecm.io.events import Progress
from ecm.io.extras import own_cores
from ecm.io.table import Table

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
    """Results of `work` for each item, in order; the items are shared by the cores.

    Examples
    --------
    >>> in_threads(abs, [-1, 2])
    [1, 2]
    """
    return list(_in_threads(work, list(items)))


def _in_threads(work: Callable[[U], T], items: Sequence[U]) -> Iterator[T]:
    if len(items) < 2:
        yield from map(work, items)
        return
    with ThreadPoolExecutor(own_cores()) as pool:
        yield from pool.map(work, items)


@contextmanager
def beside(work: Callable[[], T]) -> Iterator[Future[T]]:
    """Do a work in a thread of its own while the block goes on; its `result()` waits for it.

    Examples
    --------
    >>> with beside(lambda: sum(range(10))) as total:
    ...     other = 5
    >>> total.result() + other
    50
    """
    done: Future[T] = Future()

    def run() -> None:
        try:
            done.set_result(work())
        except BaseException as error:  # raised where the result is asked for
            done.set_exception(error)

    # A daemon: who is interrupted does not wait for it.
    Thread(target=run, daemon=True).start()
    yield done


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
    """A table of many rows thinned to some thousand, evenly over its rows; else the table."""
    if len(table) < MANY_ROWS:
        return table
    return table.select(np.arange(0, len(table), len(table) // _FEW_ROWS))
