"""The HTML page of a diagnosis."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from ecm.comparison.comparison import Comparison
from ecm.comparison.residual_figures import residual_figure, residual_section
from ecm.comparison.sections import workspace_blocks
from ecm.diagnosis import sections as part
from ecm.io.arrays import F
from ecm.report.page import Block, FigureBlock, Section, write_page


def write_diagnosis(
    path: Path,
    document: Mapping[str, Any],
    compared: Comparison | None = None,
    predicted: F | None = None,
) -> None:
    """Write verdict, unknown structure, residual maps, ranking, limits and next experiment.

    Parameters
    ----------
    path
        File of the page.
    document
        The diagnosis as plain values (`Diagnosis.to_dict`).
    compared
        Comparison of the model before with the same rows, for the residual maps.
    predicted
        (N, m) what the effects of the answer add to the wrench of its rows.
    """
    sections = [part.verdict_section(document), part.unknown_section(document)]
    if compared is not None:
        sections.append(_residuals(document, compared, predicted))
    if document["ranking"]:
        sections.append(Section("Ranking", [part.ranking_table(dict(document))]))
    sections += [
        part.limits_section(document),
        part.untestable_section(document),
        part.next_section(document),
    ]
    shown = [section for section in sections if section is not None]
    write_page(path, "Which effect is missing", f"verdict: {document['verdict']}", shown)


def _residuals(document: Mapping[str, Any], compared: Comparison, predicted: F | None) -> Section:
    unknown = document["unknown"]
    section = residual_section(compared.where(), [] if unknown is None else unknown["variables"])
    first: list[Block] = [section.blocks[0], *workspace_blocks(compared)]
    if predicted is not None:
        caption = "What the answer predicts (crosses) on the residuals of the model before."
        figure = residual_figure(compared.where(), predicted=predicted)
        first.append(FigureBlock(caption, figure))
    return replace(section, blocks=[*first, *section.blocks[1:]])
