"""The page of `ecm design --report`: the poses chosen, what they can tell, and how many pay."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from ecm.designs import Design, Size
    from ecm.diagnosis.identifiability import Identifiability
    from ecm.io.table import Table


def write_design(
    path: Path,
    candidates: Table,
    chosen: Design,
    *,
    told: Sequence[Identifiability],
    sizes: Sequence[Size],
    minutes: float | None,
) -> None:
    """Sentence, chosen poses among the candidates, effects, n against expected error."""
    from ecm.report import Section, TableBlock, TextBlock, write_page
    from ecm.report.page import number

    rows = [
        ["poses", str(len(chosen.indices))],
        ["candidates", str(len(candidates))],
        [chosen.criterion, number(chosen.value, 6)],
        ["certified bound", number(chosen.bound, 6)],
        ["share of what is possible", f"{100.0 * chosen.efficiency:.2f} %"],
    ]
    if minutes is not None:
        rows.append(["minutes on the rig", f"{minutes:.0f}"])
    blocks: list[Any] = [
        TextBlock(chosen.sentence(), strong=True),
        TableBlock("The design; no other of its size can pass the bound.", ("", ""), rows),
        *_poses(candidates, chosen),
    ]
    sections = [Section("The poses", blocks)]
    if told:
        seen = [item for item in told if not item.reason]
        listed = [[item.id, number(item.size), item.unit] for item in seen]
        caption = "The size that the plan sees with chance 0.9, before anything is measured."
        shown: list[Any] = [TableBlock(caption, ("effect", "from", "unit"), listed)]
        shown += [TextBlock(item.sentence()) for item in told if not item.named]
        sections.append(Section("Effects", shown))
    if sizes:
        sections.append(Section("How many", _curve(sizes)))
    write_page(path, "Poses to measure", chosen.sentence(), sections)


def _poses(candidates: Table, chosen: Design) -> list[Any]:
    """Two views of the chosen among all candidates."""
    from ecm.report import FigureBlock
    from ecm.report.figures import COLOURS

    names = candidates.pose_columns
    if len(names) < 2:
        return []
    pairs = [(names[i], names[i + 1]) for i in range(0, len(names) - 1, 2)]
    poses = candidates.matrix(names)
    at = {name: j for j, name in enumerate(names)}
    found = []
    for first, second in pairs:
        data = [
            {
                "type": "scatter",
                "mode": "markers",
                "name": name,
                "x": poses[rows, at[first]].tolist(),
                "y": poses[rows, at[second]].tolist(),
                "marker": {"color": colour, "size": size, "symbol": symbol},
            }
            for name, rows, colour, size, symbol in (
                ("candidates", np.arange(len(poses)), "#c4ccd6", 4, "circle"),
                ("chosen", chosen.indices, COLOURS[0], 7, "diamond"),
            )
        ]
        layout = {
            "xaxis": {"title": {"text": first}},
            "yaxis": {"title": {"text": second}},
            "plot_bgcolor": "white",
            "height": 420,
        }
        caption = f"Chosen poses among the candidates, {first} and {second}."
        found.append(FigureBlock(caption, {"data": data, "layout": layout}))
    return found


def _curve(sizes: Sequence[Size]) -> list[Any]:
    """Expected errors over n, the knee marked."""
    from ecm.report import FigureBlock, TableBlock, TextBlock
    from ecm.report import figures as draw
    from ecm.report.page import number

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
        TextBlock(f"From {knee.n} poses on further ones pay less.", strong=True),
        FigureBlock("Expected error from noise alone over the number of poses.", figure),
        TableBlock(
            "In units of one reading's noise; what the model cannot represent does not fall.",
            ("n", "h", "K", "share of what is possible"),
            rows,
        ),
    ]
