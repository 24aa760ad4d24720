"""HTML pages of the commands: the same numbers as on the terminal, and what they look like."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from ecm.compare import Comparison
    from ecm.report import TableBlock, TextBlock


def write_comparison(path: Path, found: Comparison) -> None:
    """Components, and the residuals in units of the noise."""
    from ecm.report import FigureBlock, Section, TableBlock, TextBlock, write_page
    from ecm.report import figures as draw
    from ecm.report.page import number
    from ecm.report.where import where_section

    names = [item.name for item in found.components]
    rows = [
        [
            item.name,
            *(number(value) for value in (item.rmse, item.bias, item.floor, item.excess)),
            f"{number(item.excess_low, 2)} to {number(item.excess_high, 2)}",
        ]
        for item in found.components
    ]
    header = ("component", "RMSE", "bias", "noise floor", "excess", "90 % interval")
    floor = np.array([item.floor for item in found.components])
    shares: dict[str, Sequence[float]] = {
        "noise floor": [1.0] * len(names),
        "RMSE": [item.rmse / f for item, f in zip(found.components, floor, strict=True)],
        "excess": [item.excess / f for item, f in zip(found.components, floor, strict=True)],
    }
    blocks: list[TextBlock | TableBlock | FigureBlock] = [
        TextBlock(found.sentence(), strong=True),
        TableBlock("Residuals in the unit of each column.", header, rows),
        FigureBlock(
            "Error of each component over its noise floor.",
            draw.bars(shares, names, y_title="over the noise floor"),
        ),
        FigureBlock(
            "Residuals over their noise; noise alone would have a standard deviation of 1.",
            draw.histograms({"rows": found.whitened}, names, limit=8.0, x_title="over noise"),
        ),
    ]
    lead = f"{found.rows} rows"
    sections = [Section("Compare", blocks), where_section(found.where())]
    write_page(path, f"{found.model} against measurements", lead, sections)


def write_diagnosis(
    path: Path,
    document: Mapping[str, Any],
    compared: Comparison | None = None,
    predicted: NDArray[np.float64] | None = None,
) -> None:
    """Verdict, what is unknown, where, ranking, limits, what cannot be tested, what comes next.

    Parameters
    ----------
    compared
        The model before, on the same rows: gives the residual maps.
    predicted
        (N, m) what the effects of the answer add to the wrench of its rows.
    """
    from ecm.report import FigureBlock, Section, write_page
    from ecm.report import diagnosis as part
    from ecm.report.loop import ranking_table

    sections = [part.verdict_section(document), part.unknown_section(document)]
    if compared is not None:
        from ecm.report.where import residual_map, where_section

        section = where_section(compared.where())
        if predicted is not None:
            drawn = FigureBlock(
                "What the answer predicts (crosses) on the residuals of the model before.",
                residual_map(compared.where(), predicted=predicted),
            )
            section = Section(section.title, [section.blocks[0], drawn, *section.blocks[1:]])
        sections.append(section)
    if document["ranking"]:
        sections.append(Section("Ranking", [ranking_table(dict(document))]))
    sections += [
        part.limits_section(document),
        part.untestable_section(document),
        part.next_section(document),
    ]
    shown = [section for section in sections if section is not None]
    write_page(path, "Which effect is missing", f"verdict: {document['verdict']}", shown)
