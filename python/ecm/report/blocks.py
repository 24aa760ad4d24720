"""What a result shows: one report of sections and blocks for terminal, notebook and page.

A result makes its report once. `text` is what a terminal prints, `html` what a notebook shows,
`ecm.report.page` the page with the figures.
"""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import zip_longest
from typing import Any, TypeAlias

_WORD = re.compile(r"(?!\bto\b)[A-Za-z]{2}")
"""Two letters in a row: numbers have one at most (1e-3), and intervals have the word `to`."""
_LINKED_ROWS = 3
"""Rows that a terminal shows of a table that lists rows of the data."""
_NARROW = 24
"""Least width of a column whose words are broken into lines."""


@dataclass(frozen=True)
class TextBlock:
    """A paragraph.

    Parameters
    ----------
    text
        Plain text; the page escapes it.
    strong
        Whether it is the main sentence of its section.

    Examples
    --------
    >>> TextBlock("The model is within the noise.", strong=True).strong
    True
    """

    text: str
    strong: bool = False


@dataclass(frozen=True)
class CodeBlock:
    """Text in a fixed-width font, with its own line breaks.

    Parameters
    ----------
    caption
        What the text is.
    text
        The lines.

    Examples
    --------
    >>> print(CodeBlock("Next command", "ecm compare model.json data.csv").text)
    ecm compare model.json data.csv
    """

    caption: str
    text: str


Cell: TypeAlias = str | float | None
"""Text, or a number: a whole one as it is, another with three digits; None is not known."""


@dataclass(frozen=True)
class TableBlock:
    """A table; columns of numbers are aligned right, columns with words left.

    Parameters
    ----------
    caption
        What the table shows.
    header
        Name of each column.
    rows
        Cells, one per column.
    link
        If not empty: a click on a row marks its point in all figures whose traces have this
        `meta`; the first cell is the row number. A terminal shows the first rows alone.

    Examples
    --------
    >>> table = TableBlock("Errors.", ("output", "rms"), [["fx_N", 0.1234], ["fy_N", None]])
    >>> table.words
    [True, False]
    >>> table.cells
    [['fx_N', '0.123'], ['fy_N', '–']]
    """

    caption: str
    header: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    link: str = ""

    @property
    def cells(self) -> list[list[str]]:
        """The rows as text."""
        return [[_cell(value) for value in row] for row in self.rows]

    @property
    def words(self) -> list[bool]:
        """Whether each column has words; the first one counts as words."""
        return words_of(self.cells, len(self.header))


@dataclass(frozen=True)
class FigureBlock:
    """A figure.

    Parameters
    ----------
    caption
        What the figure shows.
    figure
        Figure in plotly's dict form, with `data` and `layout`.

    Examples
    --------
    >>> from ecm.report import figures
    >>> figure = figures.bars({"rms": [0.1, 0.2]}, ["fx", "fy"], y_title="N")
    >>> FigureBlock("Errors by component.", figure).figure["data"][0]["y"]
    [0.1, 0.2]
    """

    caption: str
    figure: dict[str, Any]


@dataclass(frozen=True)
class MechanismBlock:
    """The mechanism in space, bent into measured poses; `ecm.report.figures` makes it.

    Parameters
    ----------
    caption
        What the picture shows.
    view
        Outline, frames, rows and values as plain values.

    Examples
    --------
    >>> MechanismBlock("Measured poses.", {"row": [1]}).view["row"]
    [1]
    """

    caption: str
    view: dict[str, Any]


Block: TypeAlias = TextBlock | CodeBlock | TableBlock | FigureBlock | MechanismBlock


@dataclass(frozen=True)
class Section:
    """A part of the report with a title.

    Parameters
    ----------
    title
        Heading, also in the table of contents.
    blocks
        Text, code, tables and figures in their order.

    Examples
    --------
    >>> Section("2 Compare", [TextBlock("Residuals are within the noise.")]).anchor
    '2-compare'
    """

    title: str
    blocks: Sequence[Block] = field(default_factory=tuple)

    @property
    def anchor(self) -> str:
        """Name of the section in links."""
        return "".join(c if c.isalnum() else "-" for c in self.title.lower())


def number(value: float, digits: int = 3) -> str:
    """Format a number for a table with significant digits, and an exponent only if needed."""
    if math.isnan(value):
        return "–"
    if value == 0.0:
        return "0"
    size = abs(value)
    if size >= 1e5 or size < 1e-4:
        return f"{value:.{digits - 1}e}"
    decimals = max(0, digits - 1 - len(str(int(size))) + 1) if size >= 1 else digits
    return f"{value:.{decimals}f}" if size >= 1 else f"{value:.{digits}g}"


def _cell(value: Cell) -> str:
    if value is None:
        return "–"
    return number(value) if isinstance(value, float) else str(value)


def words_of(rows: Sequence[Sequence[str]], count: int) -> list[bool]:
    """Whether each of the columns has words; the first one counts as words."""
    return [j == 0 or any(_WORD.search(row[j]) is not None for row in rows) for j in range(count)]


def text_of(blocks: Iterable[Block], width: int | None = None) -> str:
    """Return blocks as plain text; figures are left out.

    Parameters
    ----------
    blocks
        Blocks in their order.
    width
        Characters of a line; None: as long as they are.

    Examples
    --------
    >>> table = TableBlock("Errors.", ("output", "rms"), [["fx_N", 0.1234], ["fy_N", None]])
    >>> print(text_of([TextBlock("The model is within the noise."), table]))
    The model is within the noise.
    <BLANKLINE>
    Errors.
    output    rms
    ------  -----
    fx_N    0.123
    fy_N        –
    """

    def wrapped(text: str) -> str:
        return text if width is None else textwrap.fill(text, width, break_on_hyphens=False)

    parts: list[str] = []
    for block in blocks:
        if isinstance(block, TextBlock):
            parts += [wrapped(block.text), "\n"]
        elif isinstance(block, CodeBlock):
            parts += ["\n", wrapped(block.caption), "\n\n", block.text, "\n\n"]
        elif isinstance(block, TableBlock):
            cells = block.cells[: _LINKED_ROWS if block.link else None]
            named = any(block.header)
            rows = columns([block.header, *cells] if named else cells, header=named, width=width)
            if len(cells) < len(block.rows):
                rows += f"\n... and {len(block.rows) - len(cells)} more"
            caption = f"\n{wrapped(block.caption)}\n" if block.caption else ""
            parts += [caption, rows, "\n\n" if block.caption else "\n"]
    return re.sub(r"\n{3,}", "\n\n", "".join(parts)).strip("\n")


def columns(rows: Sequence[Sequence[str]], *, header: bool = True, width: int | None = None) -> str:
    """Return rows as aligned columns: columns of numbers but the first flush right.

    Parameters
    ----------
    rows
        Cells; a row may end early.
    header
        Whether the first row names the columns.
    width
        Characters of a line: words of wide columns go on below; None: of any length.
    """
    count = max(len(row) for row in rows)
    filled = [[*row, *[""] * (count - len(row))] for row in rows]
    words = words_of(filled[header:], count)
    widths = [max(1, *(len(row[j]) for row in filled)) for j in range(count)]
    while width is not None and sum(widths) + 2 * (count - 1) > width:
        widest = max(range(count), key=lambda j: words[j] * widths[j])
        if widths[widest] <= _NARROW:
            break
        widths[widest] -= 1
    if header:
        filled.insert(1, ["-" * wide for wide in widths])
    lines = []
    for row in filled:
        cells = [_lines(cell, wide) for cell, wide in zip(row, widths, strict=True)]
        for parts in zip_longest(*cells, fillvalue=""):
            aligned = zip(parts, widths, words, strict=True)
            line = "  ".join(c.ljust(wide) if left else c.rjust(wide) for c, wide, left in aligned)
            lines.append(line.rstrip())
    return "\n".join(lines)


def _lines(text: str, width: int) -> list[str]:
    return [text] if len(text) <= width else textwrap.wrap(text, width)
