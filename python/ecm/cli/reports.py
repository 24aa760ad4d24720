"""HTML pages of the commands: the same numbers as on the terminal, and what they look like."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from ecm.comparison import Comparison


def write_comparison(path: Path, found: Comparison, warnings: Sequence[str] = ()) -> None:
    """Components, references, and the residuals in units of the noise."""
    from ecm.comparison.residual_figures import residual_section
    from ecm.comparison.sections import compare_section, references_section
    from ecm.report import write_page

    sections = [
        compare_section(found, warnings),
        references_section(found),
        residual_section(found.where()),
    ]
    lead = f"{found.rows} rows"
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
    from ecm.diagnosis import sections as part
    from ecm.diagnosis.sections import ranking_table
    from ecm.report import FigureBlock, Section, write_page

    sections = [part.verdict_section(document), part.unknown_section(document)]
    if compared is not None:
        from ecm.comparison.residual_figures import residual_figure, residual_section

        unknown = document["unknown"]
        follows = [] if unknown is None else unknown["variables"]
        section = residual_section(compared.where(), follows)
        if predicted is not None:
            drawn = FigureBlock(
                "What the answer predicts (crosses) on the residuals of the model before.",
                residual_figure(compared.where(), predicted=predicted),
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
