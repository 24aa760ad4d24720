"""The page of an imported log: frames, poses and forces on the mechanism, and its columns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ecm.io.arrays import evenly
from ecm.io.columns import POSE, WRENCH
from ecm.io.table import Table
from ecm.logs.importing import ImportedLog
from ecm.report.blocks import Block, Cell, FigureBlock, Section, TableBlock, TextBlock
from ecm.report.figures import lines, mechanism_blocks
from ecm.report.page import Report

_CURVE = 2000
"""Points of a curve over time."""


def import_report(imported: ImportedLog) -> Report:
    """Return the mechanism in the poses of a log, where its columns come from, and their curves."""
    table = imported.table
    sections = [
        Section("Mechanism", _mechanism(table)),
        Section("Columns", _columns(imported, table)),
        Section("Over the rows", _curves(table)),
    ]
    return Report(f"Import of {imported.source}", f"{len(table)} rows", sections)


def _mechanism(table: Table) -> list[Block]:
    if not table.has(*POSE):
        missing = [name for name in POSE if not table.has(name)]
        return [TextBlock(f"Not drawn in space: {', '.join(missing)} are not in the log.")]
    force, forces = np.ones(len(table)), table.has(*WRENCH[:3])
    if forces:
        force = np.linalg.norm(table.matrix(WRENCH[:3]), axis=1)
    caption = (
        "The mechanism at rest and bent into some poses, with the frames of base and top (x red, y "
        "green, z blue); lines are forces on the platform. Where poses do not lie about the end of "
        "the mechanism, or bodies fold, a frame or a unit is wrong."
    )
    blocks = mechanism_blocks(
        table,
        caption,
        rows=np.arange(len(table)),
        values=force,
        title="force" if forces else "rows",
        unit="N" if forces else "",
    )
    return [replace(block, view={**block.view, "forces": forces}) for block in blocks]


def _columns(imported: ImportedLog, table: Table) -> list[Block]:
    origin, header = imported.meta.origin, ("column", "from", "smallest", "largest")
    columns = {name: table.column(name) for name in imported.columns}
    rows: list[list[Cell]] = [
        [name, str(origin.get(name, "")), float(values.min()), float(values.max())]
        for name, values in columns.items()
    ]
    said = [TextBlock(note) for note in (*imported.notes, *table.warnings)]
    return [TableBlock("What each column was read from.", header, rows), *said]


def _curves(table: Table) -> list[Block]:
    rows = evenly(len(table), _CURVE)
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
