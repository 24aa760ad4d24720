"""The page: sections in one HTML file without external requests, and the files all pages share.

All text is escaped by the template; figures are plotly's, drawn by its script that the page
carries once. Script and figures are compressed, and unpacked by the browser.
"""

from __future__ import annotations

import base64
import gzip
import json
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, TypeAlias

from ecm.io.cache import write_atomically
from ecm.io.extras import require

WEB = Path(__file__).parent / "web"
_MODULES = ("dom", "colours", "canvas", "selection", "depth", "bend", "space", "scene")
"""Each imports only from those before it."""
_IMPORT = re.compile(r'^import \{([^}]*)\} from "\./(\w+)\.js";$', re.MULTILINE)
_EXPORT = re.compile(r"^export (?=(?:async )?(?:function|const) (\w+))", re.MULTILINE)


@cache
def look() -> str:
    """Return the style sheet that all pages have."""
    return (WEB / "look.css").read_text(encoding="utf-8")


@cache
def script_of_space() -> str:
    """Return the modules as one plain script, which sets `modules`: their exports by name."""
    parts = ["const modules = {};"]
    for name in _MODULES:
        text = (WEB / f"{name}.js").read_text(encoding="utf-8")
        exported = ", ".join(_EXPORT.findall(text))
        text = _IMPORT.sub(r"const {\1} = modules.\2;", text)
        text = _EXPORT.sub("", text)
        parts.append(f"modules.{name} = (() => {{\n{text}return {{{exported}}};\n}})();")
    return "\n".join(parts) + "\n"


_WORD = re.compile(r"(?!\bto\b)[A-Za-z]{2}")
"""Two letters in a row: numbers have one at most (1e-3), and intervals have the word `to`."""


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
        Cells as text, one per column.
    link
        If not empty: a click on a row marks its point in all figures whose traces have this
        `meta`; the first cell is the row number.

    Examples
    --------
    >>> TableBlock("Errors.", ("output", "rms"), [["fx_N", "0.12"]]).words
    [True, False]
    """

    caption: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    link: str = ""

    @property
    def words(self) -> list[bool]:
        """Whether each column has words; the first one counts as words."""
        return [
            j == 0 or any(_WORD.search(row[j]) is not None for row in self.rows)
            for j in range(len(self.header))
        ]


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
    """The mechanism in space, bent into measured poses; `ecm.report.mechanism` makes it.

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


def warnings_table(warnings: Sequence[str]) -> list[Block]:
    """Return a table of warnings about the data; no block if there are none."""
    if not warnings:
        return []
    return [TableBlock("Warnings about the data.", ("",), [[text] for text in warnings])]


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


def write_page(path: Path, title: str, lead: str, sections: Sequence[Section]) -> None:
    """Write a report as one HTML file that loads nothing from outside.

    Parameters
    ----------
    path
        HTML file.
    title, lead
        Heading of the page, and the sentence below it.
    sections
        Parts of the report.

    Raises
    ------
    MissingExtra
        If the extra `report` is not installed.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> section = Section("Result", [TextBlock("None of the effects is significant.")])
    >>> with TemporaryDirectory() as folder:
    ...     path = Path(folder) / "report.html"
    ...     write_page(path, "Diagnosis", "The neck, 40 poses.", [section])
    ...     "None of the effects is significant." in path.read_text(encoding="utf-8")
    True
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path, render_page(title, lead, sections).encode("utf-8"))


def render_page(title: str, lead: str, sections: Sequence[Section]) -> str:
    """Return the HTML text of a report."""
    jinja2, plotly = require_report()
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined)
    figures: list[dict[str, Any]] = []
    views: list[dict[str, Any]] = []
    prepared = []
    for section in sections:
        blocks = []
        for block in section.blocks:
            entry: dict[str, Any] = {"kind": type(block).__name__, "block": block}
            if isinstance(block, FigureBlock):
                entry["index"] = len(figures)
                layout = block.figure.get("layout", {})
                entry["height"] = layout.get("height", 420)
                entry["wide"] = "xaxis2" in layout
                figures.append(block.figure)
            if isinstance(block, MechanismBlock):
                entry["index"] = len(views)
                views.append(block.view)
            blocks.append(entry)
        prepared.append({"title": section.title, "anchor": section.anchor, "blocks": blocks})
    page: str = environment.from_string(_TEMPLATE).render(
        title=title,
        lead=lead,
        sections=prepared,
        look=look(),
        figures=_packed(json.dumps(figures, allow_nan=False)),
        views=_packed(json.dumps(views, allow_nan=False)),
        space=_packed(script_of_space()),
        plotly=_packed_script(plotly.get_plotlyjs),
    )
    return page


def _packed(text: str) -> str:
    """Compress text to characters that neither end a script nor stand for anything in HTML."""
    return base64.b64encode(gzip.compress(text.encode("utf-8"), 6, mtime=0)).decode("ascii")


@cache
def _packed_script(script: Callable[[], str]) -> str:
    return _packed(script())


def require_report() -> tuple[Any, Any]:
    """Return the modules jinja2 and plotly.offline; MissingExtra where they are not installed."""
    purpose = "The HTML report"
    return require("jinja2", "report", purpose), require("plotly.offline", "report", purpose)


_TEMPLATE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; script-src 'unsafe-inline';
 style-src 'unsafe-inline'; img-src data: blob:; font-src data:">
<script>window.addEventListener("error", e => document.documentElement.dataset.error = e.message);
document.addEventListener("securitypolicyviolation",
  e => document.documentElement.dataset.blocked = e.blockedURI);</script>
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{{ title }}</title>
<link rel="icon" href="data:,">
<style>
{{ look }}
header, main { max-width: 1080px; margin: 0 auto; padding: 0 24px; }
header { padding-top: 32px; }
h1 { font-size: 28px; line-height: 1.2; margin: 0 0 8px; }
h2 { font-size: 20px; margin: 44px 0 10px; padding-top: 14px; border-top: 1px solid var(--line); }
nav { display: flex; flex-wrap: wrap; gap: 4px 18px; margin: 16px 0; font-size: 14px; }
th, td { padding: 4px 12px; text-align: right; white-space: nowrap; }
th { vertical-align: bottom; }
th.words, td.words { text-align: left; }
td.words:last-child { white-space: normal; min-width: 16em; }
tr.marked td { font-weight: 700; background: var(--band); }
figure { margin: 18px 0; }
figcaption { color: var(--soft); font-size: 14px; max-width: 100ch; padding: 4px 0; }
figure.table { margin: 22px 0; }
.panels { min-width: 640px; }
.space { aspect-ratio: 16 / 9; }
@media (max-width: 600px) { .space { aspect-ratio: 1; } header, main { padding: 0 12px; } }
@media print { nav, .views { display: none; } h2 { break-after: avoid; }
  figure { break-inside: avoid; } }
</style>
</head>
<body>
<header>
<h1>{{ title }}</h1>
<p>{{ lead }}</p>
<nav>{% for s in sections %}<a href="#{{ s.anchor }}">{{ s.title }}</a>{% endfor %}</nav>
</header>
<main>
{% for s in sections %}
<section id="{{ s.anchor }}">
<h2>{{ s.title }}</h2>
{% for e in s.blocks %}
{% if e.kind == "TextBlock" %}
<p{% if e.block.strong %} class="lead"{% endif %}>{{ e.block.text }}</p>
{% elif e.kind == "CodeBlock" %}
<figure class="table"><figcaption>{{ e.block.caption }}</figcaption>
<pre>{{ e.block.text }}</pre></figure>
{% elif e.kind == "TableBlock" %}
<figure class="table"><figcaption>{{ e.block.caption }}</figcaption>
<div class="scroll"><table>
{% set words = e.block.words %}
{% if e.block.header | join %}
<thead><tr>{% for h in e.block.header %}<th scope="col"
 {%- if words[loop.index0] %} class="words"{% endif %}>{{ h }}</th>{% endfor %}</tr></thead>
{% endif %}
<tbody>{% for row in e.block.rows %}
<tr{% if e.block.link %} data-link="{{ e.block.link }}" data-row="{{ row[0] }}" tabindex="0"
 {% endif %}>{% for cell in row %}<td{% if words[loop.index0] %} class="words"{% endif %}>
 {{- cell }}</td>{% endfor %}</tr>{% endfor %}
</tbody></table></div>
{% elif e.kind == "MechanismBlock" %}
<figure><div id="mechanism-{{ e.index }}"></div>
<figcaption>{{ e.block.caption }}</figcaption></figure>
{% else %}
<figure><div class="scroll"><div id="figure-{{ e.index }}"
 {%- if e.wide %} class="panels"{% endif %} style="height:{{ e.height }}px"></div></div>
<figcaption>{{ e.block.caption }}</figcaption></figure>
{% endif %}
{% endfor %}
</section>
{% endfor %}
</main>
<div id="tip" role="tooltip" hidden></div>
<script type="text/plain" id="packed-views">{{ views }}</script>
<script type="text/plain" id="packed-space">{{ space }}</script>
<script type="text/plain" id="packed-figures">{{ figures }}</script>
<script type="text/plain" id="packed-plotly">{{ plotly }}</script>
<script>
let figures = [], packedFigures = "";
// Colours of figures that a dark page replaces by its own.
const OWN = {"#1c2430": "--ink", "#000000": "--ink", "white": "--paper", "#ffffff": "--paper",
  "#e4e8ed": "--line", "#c4ccd6": "--line", "#8a94a2": "--soft", "#0072b2": "--point",
  "#b3261e": "--bad", "#4393c3": "--low", "#e58368": "#9c4a2e"};
const dark = matchMedia("(prefers-color-scheme: dark)");
const finger = matchMedia("(pointer: coarse)").matches;  // a finger scrolls and taps
function coloured() {
  const style = getComputedStyle(document.documentElement);
  const own = name => name.startsWith("--") ? style.getPropertyValue(name).trim() : name;
  const found = JSON.parse(packedFigures, (_, value) => dark.matches && typeof value === "string"
    && Object.hasOwn(OWN, value) ? own(OWN[value]) : value);
  const page = {paper_bgcolor: own("--paper"), plot_bgcolor: own("--paper"),
    font: {color: own("--ink")}, ...(finger ? {dragmode: false} : {})};
  return found.map(f => ({...f, layout: {...page, ...f.layout}}));
}
async function unpacked(id) {
  const packed = atob(document.getElementById(id).textContent);
  const bytes = Uint8Array.from(packed, c => c.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).text();
}
async function run(id) {
  const script = document.createElement("script");
  script.textContent = await unpacked(id);
  document.head.append(script);
}
async function drawMechanisms() {
  const views = JSON.parse(await unpacked("packed-views"));
  if (!views.length) return;
  await run("packed-space");
  views.forEach((v, i) => document.getElementById("mechanism-" + i)
    .append(modules.scene.workspace(v, v.row, v.columns, v.values, v)));
  modules.selection.onMark(() => views.forEach(v => {
    if (v.link && !marking) markAll(v.link, [...modules.selection.marked]);
  }));
  document.documentElement.dataset.mechanisms = views.length;
}
async function draw() {
  await drawMechanisms();
  await run("packed-plotly");
  packedFigures = await unpacked("packed-figures");
  figures = coloured();
  figures.forEach((f, i) => {
    Plotly.newPlot("figure-" + i, f.data, f.layout,
      {responsive: true, displaylogo: false, modeBarButtonsToRemove: ["lasso2d", "select2d"]});
    document.getElementById("figure-" + i).on("plotly_click", e => {
      const trace = e.points[0].data;
      if (trace.meta) mark(trace.meta, e.points[0].customdata);
    });
  });
  dark.addEventListener("change", () => {
    figures = coloured();
    figures.forEach((f, i) => Plotly.react("figure-" + i, f.data, f.layout));
    markAll("", []);
  });
  document.documentElement.dataset.figures = figures.length;
}
// A row marked anywhere is marked in every figure, table and mechanism of the same link.
let marked = "", marking = false;
function mark(link, row) {
  markAll(link, marked === link + row ? [] : [row]);
}
function markAll(link, rows) {
  marked = rows.length ? link + rows.join(",") : "";
  document.documentElement.dataset.marked = rows.join(",");
  const chosen = new Set(rows.map(String));
  figures.forEach((f, i) => f.data.forEach((trace, k) => {
    if (trace.meta !== link) return;
    const at = trace.customdata.flatMap((r, j) => chosen.has(String(r)) ? [j] : []);
    Plotly.restyle("figure-" + i, {selectedpoints: [marked ? at : null]}, [k]);
  }));
  document.querySelectorAll("tr[data-row]").forEach(tr => tr.classList.toggle("marked",
    tr.dataset.link === link && chosen.has(tr.dataset.row)));
  if (typeof modules === "undefined") return;
  marking = true;
  modules.selection.mark(rows.map(Number));
  marking = false;
}
document.querySelectorAll("tr[data-row]").forEach(tr => {
  tr.addEventListener("click", () => mark(tr.dataset.link, tr.dataset.row));
  tr.addEventListener("keydown", e => { if (e.key === "Enter") tr.click(); });
});
const drawn = draw().catch(e => {
  document.documentElement.dataset.error = e.message;
  document.querySelectorAll("main figure div[id]:empty").forEach(div => {
    div.textContent = "This figure needs a browser of 2023 or later: " + e.message;
  });
});
</script>
</body>
</html>
"""
