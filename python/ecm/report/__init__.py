"""Self-contained HTML reports: one file per report, a section returns its data and its figures."""

from ecm.report.page import (
    Block,
    CodeBlock,
    FigureBlock,
    Section,
    TableBlock,
    TextBlock,
    write_page,
)

__all__ = [
    "Block",
    "CodeBlock",
    "FigureBlock",
    "Section",
    "TableBlock",
    "TextBlock",
    "write_page",
]
