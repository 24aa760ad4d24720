"""The page of an imported log: frames, poses and forces on the mechanism, and its columns."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ecm._native import rotation_matrices
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.io.table import Table
from ecm.logs.importing import ImportedLog
from ecm.report.figures import COLOURS, INK, lines
from ecm.report.page import Block, FigureBlock, Section, TableBlock, TextBlock, write_page

_DRAWN = 40
"""Poses that are drawn."""
_CURVE = 2000
"""Points of a curve over time."""


def write_import(path: Path, imported: ImportedLog) -> None:
    """Write the page of an imported log."""
    table = imported.table
    sections = [
        Section("Mechanism", _mechanism(table)),
        Section("Columns", _columns(imported, table)),
        Section("Over the rows", _curves(table)),
    ]
    write_page(path, f"Import of {imported.source}", f"{len(table)} rows", sections)


def _mechanism(table: Table) -> list[Block]:
    if not table.has(*POSE):
        missing = [name for name in POSE if not table.has(name)]
        return [TextBlock(f"Not drawn in space: {', '.join(missing)} are not in the log.")]
    return [
        FigureBlock(
            "The clamped face is at the origin, its axis is x. A dot with three axes (x blue, y "
            "orange, z green) is a pose of the top frame; the black line is the force on the "
            "platform. The dashed line is the mechanism at rest. Where poses do not lie about its "
            "end, a frame or a unit is wrong.",
            mechanism_figure(table),
        )
    ]


def mechanism_figure(table: Table) -> dict[str, Any]:
    """Return the figure of some poses with their axes and forces, in plotly's dict form.

    Parameters
    ----------
    table
        Rows with all six pose columns; forces are drawn where they are there.

    Examples
    --------
    >>> from ecm import as_table
    >>> rest = as_table({name: [0.1 if name == "x_m" else 0.0] for name in POSE})
    >>> [trace["name"] for trace in mechanism_figure(rest)["data"]]
    ['at rest', 'x axis', 'y axis', 'z axis', 'poses']
    """
    rows = np.unique(np.linspace(0, len(table) - 1, _DRAWN).astype(int))
    poses = table.poses[rows]
    length = table.meta.length_m or float(np.median(poses[:, 0])) or 0.1
    turns = rotation_matrices(np.ascontiguousarray(poses[:, 3:]))
    spread = float(np.ptp(poses[:, :3], axis=0).max())
    size = 0.12 * max(abs(length), spread)
    rest = np.array([[0.0, 0.0, 0.0], [length, 0.0, 0.0]])
    data = [_line("at rest", rest, {"color": INK, "dash": "dash", "width": 4})]
    for axis, name in enumerate("xyz"):
        ends = poses[:, :3] + size * turns[:, :, axis]
        data.append(_segments(f"{name} axis", poses[:, :3], ends, COLOURS[axis]))
    if table.has(*WRENCH[:3]):
        force = table.matrix(WRENCH[:3])[rows]
        largest = float(np.linalg.norm(force, axis=1).max()) or 1.0
        ends = poses[:, :3] + 3.0 * size * force / largest
        data.append(_segments(f"force (longest {largest:.3g} N)", poses[:, :3], ends, INK))
    x, y, z = (poses[:, i].tolist() for i in range(3))
    label = [f"row {row + 1}" for row in rows]
    data.append({"type": "scatter3d", "mode": "markers", "name": "poses", "x": x, "y": y, "z": z,
                 "marker": {"size": 3, "color": INK}, "text": label})  # fmt: skip
    axes = {f"{name}axis": {"title": {"text": f"{name} [m]"}} for name in "xyz"}
    layout = {
        "height": 560,
        "scene": {**axes, "aspectmode": "data"},
        "legend": {"orientation": "h"},
        "margin": {"l": 0, "r": 0, "t": 10, "b": 0},
    }
    return {"data": data, "layout": layout}


def _line(name: str, points: F, line: dict[str, Any]) -> dict[str, Any]:
    x, y, z = points.T.tolist()
    return {"type": "scatter3d", "mode": "lines", "name": name, "x": x, "y": y, "z": z,
            "line": line}  # fmt: skip


def _segments(name: str, starts: F, ends: F, colour: str) -> dict[str, Any]:
    points: list[list[float | None]] = [[], [], []]
    for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
        for i in range(3):
            points[i] += [start[i], end[i], None]
    return {"type": "scatter3d", "mode": "lines", "name": name, "x": points[0], "y": points[1],
            "z": points[2], "line": {"color": colour, "width": 3}, "hoverinfo": "skip"}  # fmt: skip


def _columns(imported: ImportedLog, table: Table) -> list[Block]:
    rows = [
        [
            name,
            str(imported.meta.origin.get(name, "")),
            f"{table.column(name).min():.4g}",
            f"{table.column(name).max():.4g}",
        ]
        for name in imported.columns
    ]
    blocks: list[Block] = [
        TableBlock(
            "What each column was read from.", ("column", "from", "smallest", "largest"), rows
        )
    ]
    return blocks + [TextBlock(note) for note in (*imported.notes, *table.warnings)]


def _curves(table: Table) -> list[Block]:
    rows = np.unique(np.linspace(0, len(table) - 1, _CURVE).astype(int))
    x = (table.column("time_s")[rows] if table.has("time_s") else rows + 1.0).tolist()
    title = "time [s]" if table.has("time_s") else "row"
    groups = (
        ("Positions.", [n for n in POSE[:3] if table.has(n)], "m"),
        ("Rotation vector.", [n for n in POSE[3:] if table.has(n)], "rad"),
        ("Forces.", [n for n in WRENCH[:3] if table.has(n)], "N"),
        ("Moments.", [n for n in WRENCH[3:] if table.has(n)], "N m"),
    )
    blocks: list[Block] = []
    for caption, names, unit in groups:
        if names:
            series = {name: (x, table.column(name)[rows].tolist()) for name in names}
            blocks.append(FigureBlock(caption, lines(series, x_title=title, y_title=f"[{unit}]")))
    return blocks
