"""The HTML page of a comparison."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ecm.comparison.comparison import Comparison
from ecm.comparison.residual_figures import residual_section
from ecm.comparison.sections import (
    compare_section,
    pose_error_section,
    references_section,
)
from ecm.report.page import write_page


def write_comparison(path: Path, result: Comparison, warnings: Sequence[str] = ()) -> None:
    """Write error of each component, reference models, and residuals in units of the noise."""
    sections = [
        compare_section(result, warnings),
        pose_error_section(result),
        references_section(result),
        residual_section(result.where()),
    ]
    write_page(path, f"{result.model} against measurements", f"{result.rows} rows", sections)
