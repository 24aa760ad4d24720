"""What a result shows: one report of sections and blocks for terminal, notebook and page.

A result makes its report once. `text` is what a terminal prints, `html` what a notebook shows,
`page` the page with the figures, without external requests. All text is escaped by the template.
The modules that draw figures and mechanism are those of `ecm app`. Modules and figures are
compressed, and unpacked by the browser.
"""

from __future__ import annotations

import base64
import gzip
import json
import math
import re
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cache
from itertools import zip_longest
from pathlib import Path
from typing import Any, TypeAlias

from ecm.errors import MissingExtra
from ecm.io.arguments import path_of
from ecm.io.cache import write_atomically
from ecm.io.events import Printed
from ecm.io.extras import require

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


WEB = Path(__file__).parent / "web"
_LINE = 99
"""Characters of a line that `print` shows, but the first."""
_TEMPLATES = Path(__file__).parent / "template"
_IMPORT = re.compile(r'^import (?:\* as )?(\{[^}]*\}|\w+) from "\./(\w+)\.js";$', re.MULTILINE)
_EXPORT = re.compile(r"^export (?=(?:async )?(?:function|const) (\w+))", re.MULTILINE)


@cache
def web_file(name: str) -> str:
    """Return a file that several pages hold, as the style sheet of all."""
    return (WEB / name).read_text(encoding="utf-8")


@cache
def script_of(*entries: str, folders: tuple[Path, ...] = (WEB,)) -> str:
    """Return modules with those that they import as one plain script.

    It sets `modules`: the exports of each by its name.
    """
    files = {path.stem: path for folder in folders for path in folder.glob("*.js")}
    parts = {"": "const modules = {};"}

    def take(name: str) -> None:
        if name in parts:
            return
        text = files[name].read_text(encoding="utf-8")
        for _, imported in _IMPORT.findall(text):
            take(imported)
        exported = ", ".join(_EXPORT.findall(text))
        text = _EXPORT.sub("", _IMPORT.sub(r"const \1 = modules.\2;", text))
        parts[name] = f"modules.{name} = (() => {{\n{text}return {{{exported}}};\n}})();"

    for name in entries:
        take(name)
    return "\n".join(parts.values()) + "\n"


@dataclass(frozen=True, repr=False)
class Report(Printed):
    """What a result shows, made once for terminal, notebook and page.

    Parameters
    ----------
    title, lead
        Heading of the page, and the sentence below it.
    sections
        Parts of the report, the most important first.
    warnings
        About the data; the page shows them after the first section, a command on stderr.

    Examples
    --------
    >>> from ecm.report import TextBlock
    >>> section = Section("Result", [TextBlock("None of the effects is significant.")])
    >>> report = Report("Diagnosis", "The neck, 40 poses.", [section])
    >>> print(report)
    Result
    ======
    None of the effects is significant.
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     report.write(Path(folder) / "report.html")
    ...     "None of the effects" in (Path(folder) / "report.html").read_text(encoding="utf-8")
    True
    """

    title: str
    lead: str
    sections: Sequence[Section]
    warnings: Sequence[str] = ()

    def __str__(self) -> str:
        return self.text()

    def text(self, width: int | None = None) -> str:
        """Return every section as plain text, in lines of at most so many characters."""
        parts = [(s.title, text_of(s.blocks, width)) for s in self.sections]
        return "\n\n".join(f"{title}\n{'=' * len(title)}\n{text}" for title, text in parts if text)

    def write(self, path: str | Path) -> None:
        """Write one HTML file that loads nothing from outside; MissingExtra without `report`."""
        path = path_of(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(path, self.page().encode("utf-8"))

    def page(self) -> str:
        """Return the HTML text of the page."""
        sections = list(self.sections)
        if self.warnings:
            table = TableBlock(
                "Warnings about the data.", ("",), [[text] for text in self.warnings]
            )
            sections[0] = Section(sections[0].title, [*sections[0].blocks, table])
        blocks = [block for section in sections for block in section.blocks]
        figures = [block.figure for block in blocks if isinstance(block, FigureBlock)]
        views = [block.view for block in blocks if isinstance(block, MechanismBlock)]
        return _rendered(
            "page.html",
            title=self.title,
            lead=self.lead,
            sections=sections,
            look=web_file("look.css"),
            unpack=web_file("unpack.js"),
            figures=packed(json.dumps(figures, allow_nan=False)),
            views=packed(json.dumps(views, allow_nan=False)),
            modules=packed(script_of("scene", "figure")),
        )


class Shown(Printed):
    """A result that prints, and that a notebook shows, by the first blocks of its report."""

    def blocks(self) -> list[Block]:
        """Return what `print` and a notebook show."""
        raise NotImplementedError

    def __str__(self) -> str:
        first, *others = self.blocks()
        return "\n".join(filter(None, (text_of([first]), text_of(others, _LINE))))

    def _repr_html_(self) -> str | None:
        """Show text and tables in a notebook; None without the extra `report`."""
        drawn = FigureBlock | MechanismBlock
        blocks = [block for block in self.blocks() if not isinstance(block, drawn)]
        try:
            return _rendered("blocks.html", section=Section("", blocks))
        except MissingExtra:
            return None


def _rendered(template: str, **values: Any) -> str:
    """Fill a template; figures and mechanisms are counted over the whole page."""
    jinja2 = require_report()
    environment = jinja2.Environment(
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        loader=jinja2.FileSystemLoader(_TEMPLATES),
    )
    counts: dict[str, int] = {}

    def place(kind: str) -> int:
        counts[kind] = counts.get(kind, -1) + 1
        return counts[kind]

    text: str = environment.get_template(template).render(
        kind=lambda block: type(block).__name__, place=place, **values
    )
    return text


def packed(text: str) -> str:
    """Compress text to characters that neither end a script nor stand for anything in HTML."""
    return base64.b64encode(gzip.compress(text.encode("utf-8"), 6, mtime=0)).decode("ascii")


def require_report() -> Any:
    """What writes a page; MissingExtra where it is not installed."""
    return require("jinja2", "report", "The HTML report")
