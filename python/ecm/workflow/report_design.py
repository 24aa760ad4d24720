"""The page of `ecm design --report`: the chosen poses, what they can show, and how many pay."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ecm.designs import Design, Size
from ecm.diagnosis.identifiability import Identifiability
from ecm.io.table import Table
from ecm.report import figures as draw
from ecm.report.page import (
    Block,
    FigureBlock,
    Section,
    TableBlock,
    TextBlock,
    number,
    write_page,
)
from ecm.workflow.design import PlannedDesign


def write_design(path: Path, candidates: Table, planned: PlannedDesign) -> None:
    """Write the chosen poses among the candidates, effects, and n against expected error."""
    design = planned.design
    rows = [
        ["poses", str(len(design.indices))],
        ["candidates", str(len(candidates))],
        [design.criterion, number(design.value, 6)],
        ["certified bound", number(design.bound, 6)],
        ["share of what is possible", f"{100.0 * design.efficiency:.2f} %"],
    ]
    if planned.minutes is not None:
        rows.append(["minutes on the rig", f"{planned.minutes:.0f}"])
    poses: list[Block] = [
        TextBlock(design.sentence(), strong=True),
        TableBlock("The design; no other of its size can pass the bound.", ("", ""), rows),
        *_poses(candidates, design),
    ]
    sections = [Section("The poses", poses)]
    if planned.effects:
        sections.append(Section("Effects", _effects(planned.effects)))
    if planned.sizes:
        sections.append(Section("How many", _curve(planned.sizes)))
    write_page(path, "Poses to measure", design.sentence(), sections)


def _effects(effects: Sequence[Identifiability]) -> list[Block]:
    listed = [[item.id, number(item.size), item.unit] for item in effects if not item.reason]
    caption = "The size that the plan sees with chance 0.9, before anything is measured."
    return [
        TableBlock(caption, ("effect", "from", "unit"), listed),
        *(TextBlock(item.sentence()) for item in effects if not item.named),
    ]


def _poses(candidates: Table, design: Design) -> list[Block]:
    """The chosen poses among all candidates, two coordinates a figure."""
    names = candidates.pose_columns
    everything = np.arange(len(candidates))
    blocks: list[Block] = []
    for first, second in zip(names[0:-1:2], names[1::2], strict=False):
        data = [
            {
                "type": "scatter",
                "mode": "markers",
                "name": name,
                "x": candidates.column(first)[rows].tolist(),
                "y": candidates.column(second)[rows].tolist(),
                "marker": {"color": colour, "size": size, "symbol": symbol},
            }
            for name, rows, colour, size, symbol in (
                ("candidates", everything, "#c4ccd6", 4, "circle"),
                ("chosen", design.indices, draw.COLOURS[0], 7, "diamond"),
            )
        ]
        layout = {
            "xaxis": {"title": {"text": first}},
            "yaxis": {"title": {"text": second}},
            "plot_bgcolor": "white",
            "height": 420,
        }
        caption = f"Chosen poses among the candidates, {first} and {second}."
        blocks.append(FigureBlock(caption, {"data": data, "layout": layout}))
    return blocks


def _curve(sizes: Sequence[Size]) -> list[Block]:
    """Expected errors over n, the knee marked."""
    n = [float(size.n) for size in sizes]
    knee = next(size for size in sizes if size.knee)
    figure = draw.lines(
        {
            "wrench h": (n, [size.wrench_error for size in sizes]),
            "stiffness K, times half the range": (n, [size.stiffness_error for size in sizes]),
        },
        x_title="poses n",
        y_title="expected error / noise of a reading",
        log_x=True,
        log_y=True,
    )
    figure["data"].append(
        {
            "type": "scatter",
            "mode": "markers",
            "name": f"knee, n = {knee.n}",
            "x": [float(knee.n)] * 2,
            "y": [knee.wrench_error, knee.stiffness_error],
            "marker": {"symbol": "circle-open", "size": 18, "color": "#b3261e"},
        }
    )
    rows = [
        [
            f"{size.n}{' (knee)' if size.knee else ''}",
            number(size.wrench_error),
            number(size.stiffness_error),
            f"{100.0 * size.efficiency:.1f} %",
        ]
        for size in sizes
    ]
    return [
        TextBlock(f"Beyond {knee.n} poses each further one improves the model less.", strong=True),
        FigureBlock("Expected error from noise alone over the number of poses.", figure),
        TableBlock(
            "In units of one reading's noise; the error of the model itself does not fall.",
            ("n", "h", "K", "share of what is possible"),
            rows,
        ),
    ]
