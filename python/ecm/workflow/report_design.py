"""The page of `ecm design --report`: the chosen poses, what they can show, and how many pay."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ecm.designs import Size
from ecm.diagnosis.identifiability import Identifiability
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
from ecm.workflow.design_figures import pose_figure, size_figure


def write_design(path: Path, planned: PlannedDesign) -> None:
    """Write the chosen poses among the candidates, effects, and n against expected error."""
    sections = [Section("The poses", _poses(planned))]
    if planned.effects:
        sections.append(Section("Effects", _effects(planned.effects)))
    if planned.sizes:
        sections.append(Section("How many", _sizes(planned.sizes)))
    write_page(path, "Poses to measure", planned.design.sentence(), sections)


def _poses(planned: PlannedDesign) -> list[Block]:
    """The design in numbers, and among all candidates, two coordinates a figure."""
    candidates, design = planned.candidates, planned.design
    rows = [
        ["poses", str(len(design.indices))],
        ["candidates", str(len(candidates))],
        [design.criterion, number(design.value, 6)],
        ["certified bound", number(design.bound, 6)],
        ["share of what is possible", f"{100.0 * design.efficiency:.2f} %"],
    ]
    if planned.minutes is not None:
        rows.append(["minutes on the rig", f"{planned.minutes:.0f}"])
    names = candidates.pose_columns
    return [
        TextBlock(design.sentence(), strong=True),
        TableBlock("The design; no other of its size can pass the bound.", ("", ""), rows),
        *(
            FigureBlock(
                f"Chosen poses among the candidates, {x} and {y}.",
                pose_figure(candidates, design, x, y),
            )
            for x, y in zip(names[0:-1:2], names[1::2], strict=False)
        ),
    ]


def _effects(effects: Sequence[Identifiability]) -> list[Block]:
    listed = [[item.id, number(item.size), item.unit] for item in effects if not item.reason]
    caption = "The size that the plan sees with chance 0.9, before anything is measured."
    return [
        TableBlock(caption, ("effect", "from", "unit"), listed),
        *(TextBlock(item.sentence()) for item in effects if not item.named),
    ]


def _sizes(sizes: Sequence[Size]) -> list[Block]:
    knee = next(size for size in sizes if size.knee)
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
        FigureBlock(
            "Expected error from noise alone over the number of poses.", size_figure(sizes, knee)
        ),
        TableBlock(
            "In units of one reading's noise; the error of the model itself does not fall.",
            ("n", "h", "K", "share of what is possible"),
            rows,
        ),
    ]
