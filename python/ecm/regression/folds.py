"""Groups of rows and folds of cross-validation through which a missing effect cannot leak.

Repeats of a pose are never split. Effects of the pose are tested on contiguous blocks of time,
effects of time on clusters of poses, several runs of a continuous test run by run.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from ecm.io.arrays import B, F, I
from ecm.io.table import Table
from ecm.regression.approach import order_of_visits
from ecm.regression.sensor_zero import is_zero, zero_times

_STRETCHES = 12


def row_groups(table: Table) -> I:
    """(N,) group of each row: `[columns] group`, else pose_id, else the row itself.

    Home and unloaded rows are each a group of their own; samples of a continuous test are grouped
    in stretches of time.
    """
    n = len(table)
    own = np.arange(n, dtype=np.int64)
    if is_continuous(table):
        return _stretches(table)
    names = [name for name in table.meta.group if table.has(name)]
    if not names and table.has("pose_id"):
        names = ["pose_id"]
    if not names:
        return own
    keys = np.stack([_codes(table, name) for name in names], axis=1)
    _, codes = np.unique(keys, axis=0, return_inverse=True)
    groups = np.asarray(codes, dtype=np.int64).ravel()
    if table.has("kind"):
        checks = ~is_pose_row(table)
        groups = np.where(checks, groups.max() + 1 + own, groups)
    _, packed = np.unique(groups, return_inverse=True)
    return np.asarray(packed, dtype=np.int64).ravel()


def is_continuous(table: Table) -> bool:
    """Whether the rows are samples of a continuous test."""
    return table.meta.file.kind == "continuous" and table.has("time_s")


def held_out_by(table: Table, kind: str) -> Literal["time", "pose", "run"]:
    """Folds for an effect of this kind: by time for `pose`, else by pose; or run by run."""
    if is_continuous(table):
        several = table.has("run") and len(np.unique(table.column("run"))) > 1
        return "run" if several else "time"
    return "time" if kind == "pose" else "pose"


def split_words(table: Table, parts: int) -> str:
    """Return in words how `row_groups` are divided into so many parts of held-out rows.

    Examples
    --------
    >>> from ecm import as_table
    >>> table = as_table({"x_m": [0.0, 1.0, 2.0], "fx_N": [0.0, 1.0, 2.0], "pose_id": [0, 0, 1]})
    >>> split_words(table, 10)
    '2 parts of poses, repeats together'
    """
    groups = int(row_groups(table).max()) + 1
    what = "rows"
    if is_continuous(table):
        what = f"stretches of time, {_STRETCHES} a run"
    elif table.meta.group:
        what = f"groups by {', '.join(table.meta.group)}"
    elif table.has("pose_id"):
        what = "poses, repeats together"
    return f"{min(parts, groups)} parts of {what}"


def _stretches(table: Table) -> I:
    """(N,) number of the stretch of time that each sample is in, twelve a run."""
    stretches = np.zeros(len(table), dtype=np.int64)
    first = 0
    for rows in order_of_visits(table):
        pieces = min(_STRETCHES, len(rows))
        stretches[rows] = first + np.arange(len(rows)) * pieces // len(rows)
        first += pieces
    return stretches


def is_pose_row(table: Table) -> B:
    """(N,) rows that measure a pose: neither home checks nor unloaded readings."""
    kind = table.text("kind")
    return np.asarray((kind == "") | (kind == "pose"), dtype=np.bool_)


def without_zero_readings(table: Table) -> Table:
    """The table without unloaded readings of exactly zero, from which the zero was taken.

    Their times are kept in `zeros_s`.
    """
    return replace(table.select(rows_without_zero_readings(table)), zeros_s=zero_times(table))


def rows_without_zero_readings(table: Table) -> I:
    """Index of the rows that `without_zero_readings` keeps."""
    return np.flatnonzero(~is_zero(table))


def distinct_rows(table: Table) -> I:
    """Index of the rows that are no copies of an earlier row, by pose and wrench.

    Unloaded rows are never left out, because a zeroed sensor may read the same twice, nor samples
    of a continuous test, which repeat at rest.
    """
    if is_continuous(table):
        return np.arange(len(table), dtype=np.int64)
    names = (*table.pose_columns, *table.wrench_columns)
    values = np.stack([table.column(name) for name in names], axis=1)
    _, first = np.unique(values, axis=0, return_index=True)
    keep = ~is_pose_row(table)
    keep[first] = True
    return np.flatnonzero(keep)


def _codes(table: Table, name: str) -> I:
    values = table.columns[name]
    if values.dtype == object:
        values = np.array([str(v) for v in values])
    _, codes = np.unique(values, return_inverse=True)
    return np.asarray(codes, dtype=np.int64).ravel()


def folds(table: Table, poses: F, groups: I, by: Literal["time", "pose", "run"], n: int = 5) -> I:
    """(N,) fold of each row; groups are not split, fewer groups than n give fewer folds."""
    if by == "run" and table.has("run"):
        return _codes(table, "run")
    count = int(groups.max()) + 1
    n = max(2, min(n, count))
    if by == "time":
        when = table.column("time_s") if table.has("time_s") else np.arange(len(table)) * 1.0
        middle = np.bincount(groups, weights=when) / np.bincount(groups)
        order = np.argsort(middle, kind="stable")
        block = np.empty(count, dtype=np.int64)
        block[order] = np.arange(count) * n // count
        return np.asarray(block[groups])
    sizes = np.bincount(groups)
    centres = np.stack(
        [np.bincount(groups, weights=poses[:, j]) / sizes for j in range(poses.shape[1])], axis=1
    )
    return np.asarray(_clusters(centres, n)[groups])


def _clusters(points: F, n: int) -> I:
    """Equal-sized clusters: recursive cuts along the longest principal axis, no random start."""
    spread = points.std(axis=0)
    scaled = (points - points.mean(axis=0)) / np.where(spread > 0.0, spread, 1.0)
    labels = np.zeros(len(points), dtype=np.int64)
    parts: list[tuple[I, int]] = [(np.arange(len(points)), n)]
    label = 0
    while parts:
        members, pieces = parts.pop()
        if pieces == 1:
            labels[members] = label
            label += 1
            continue
        centred = scaled[members] - scaled[members].mean(axis=0)
        _, _, axes = np.linalg.svd(centred, full_matrices=False)
        order = members[np.argsort(centred @ axes[0], kind="stable")]
        left = pieces // 2
        cut = len(order) * left // pieces
        parts.append((order[cut:], pieces - left))
        parts.append((order[:cut], left))
    return labels
