"""Reports: what a result shows in terminal, notebook and page, from one list of blocks."""

from ecm.report.blocks import (
    Block,
    CodeBlock,
    FigureBlock,
    Report,
    Section,
    TableBlock,
    TextBlock,
)

__all__ = [
    "Block",
    "CodeBlock",
    "FigureBlock",
    "Report",
    "Section",
    "TableBlock",
    "TextBlock",
]
