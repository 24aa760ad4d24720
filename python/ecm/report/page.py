"""The report of a result: text, a notebook's HTML, and a page without external requests.

All text is escaped by the template. The modules that draw figures and mechanism are those of
`ecm app`. Modules and figures are compressed, and unpacked by the browser.
"""

from __future__ import annotations

import base64
import gzip
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from ecm.errors import MissingExtra
from ecm.io.cache import write_atomically
from ecm.io.extras import require
from ecm.io.printed import Printed
from ecm.report.blocks import Block, FigureBlock, MechanismBlock, Section, TableBlock, text_of

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


@dataclass(frozen=True)
class Report:
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
    >>> print(report.text())
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

    def text(self, width: int | None = None) -> str:
        """Return every section as plain text, in lines of at most so many characters."""
        parts = [(s.title, text_of(s.blocks, width)) for s in self.sections]
        return "\n\n".join(f"{title}\n{'=' * len(title)}\n{text}" for title, text in parts if text)

    def write(self, path: str | Path) -> None:
        """Write one HTML file that loads nothing from outside; MissingExtra without `report`."""
        path = Path(path)
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
    jinja2 = require("jinja2", "report", "The HTML report")
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


def require_report() -> None:
    """Raise MissingExtra where what writes a page is not installed."""
    require("jinja2", "report", "The HTML report")
