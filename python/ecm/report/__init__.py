"""Self-contained HTML reports: one file per report, a section returns its data and its figures."""

from ecm.report.page import FigureBlock, Section, TableBlock, TextBlock, write_page

__all__ = ["FigureBlock", "Section", "TableBlock", "TextBlock", "write_page"]
