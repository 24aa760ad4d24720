"""The report of a result: text, a notebook's HTML, and a page without external requests.

All text is escaped by the template; figures are plotly's, drawn by its script that the page
carries once. Script and figures are compressed, and unpacked by the browser.
"""

from __future__ import annotations

import base64
import gzip
import json
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from ecm.errors import MissingExtra
from ecm.io.cache import write_atomically
from ecm.io.extras import require
from ecm.report.blocks import FigureBlock, MechanismBlock, Section, TableBlock, text_of

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

    def write(self, path: Path) -> None:
        """Write one HTML file that loads nothing from outside; MissingExtra without `report`."""
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(path, self.page().encode("utf-8"))

    def page(self) -> str:
        """Return the HTML text of the page."""
        plotly = require_report()[1]
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
            "page",
            title=self.title,
            lead=self.lead,
            sections=sections,
            look=look(),
            figures=_packed(json.dumps(figures, allow_nan=False)),
            views=_packed(json.dumps(views, allow_nan=False)),
            space=_packed(script_of_space()),
            plotly=_packed_script(plotly.get_plotlyjs),
        )


class Shown:
    """A result that prints, and that a notebook shows, as the first section of its report."""

    def report(self) -> Report:
        """Return what terminal, notebook and page show."""
        raise NotImplementedError

    def __str__(self) -> str:
        return text_of(self.report().sections[0].blocks)

    def _repr_html_(self) -> str | None:
        """Show text and tables in a notebook; None without the extra `report`."""
        drawn = FigureBlock | MechanismBlock
        blocks = [b for b in self.report().sections[0].blocks if not isinstance(b, drawn)]
        try:
            return _rendered("blocks", section=Section("", blocks))
        except MissingExtra:
            return None


def _rendered(template: str, **values: Any) -> str:
    """Fill a template; figures and mechanisms are counted over the whole page."""
    jinja2 = require("jinja2", "report", "The HTML report")
    environment = jinja2.Environment(
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        loader=jinja2.DictLoader({"page": _TEMPLATE, "blocks": _BLOCKS}),
    )
    counts: dict[str, int] = {}

    def place(kind: str) -> int:
        counts[kind] = counts.get(kind, -1) + 1
        return counts[kind]

    text: str = environment.get_template(template).render(
        kind=lambda block: type(block).__name__, place=place, **values
    )
    return text


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


_BLOCKS = """{% for block in section.blocks %}
{% if kind(block) == "TextBlock" %}
<p{% if block.strong %} class="lead"{% endif %}>{{ block.text }}</p>
{% elif kind(block) == "CodeBlock" %}
<figure class="table"><figcaption>{{ block.caption }}</figcaption>
<pre>{{ block.text }}</pre></figure>
{% elif kind(block) == "TableBlock" %}
<figure class="table"><figcaption>{{ block.caption }}</figcaption>
<div class="scroll"><table>
{% set words = block.words %}
{% if block.header | join %}
<thead><tr>{% for h in block.header %}<th scope="col"
 {%- if words[loop.index0] %} class="words"{% endif %}>{{ h }}</th>{% endfor %}</tr></thead>
{% endif %}
<tbody>{% for row in block.cells %}
<tr{% if block.link %} data-link="{{ block.link }}" data-row="{{ row[0] }}" tabindex="0"
 {% endif %}>{% for cell in row %}<td{% if words[loop.index0] %} class="words"{% endif %}>
 {{- cell }}</td>{% endfor %}</tr>{% endfor %}
</tbody></table></div>
{% elif kind(block) == "MechanismBlock" %}
<figure><div id="mechanism-{{ place("mechanism") }}"></div>
<figcaption>{{ block.caption }}</figcaption></figure>
{% else %}
<figure><div class="scroll"><div id="figure-{{ place("figure") }}"
 {%- if "xaxis2" in block.figure.layout %} class="panels"{% endif %}
 style="height:{{ block.figure.layout.height | default(420) }}px"></div></div>
<figcaption>{{ block.caption }}</figcaption></figure>
{% endif %}
{% endfor %}
"""

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
{% for section in sections %}
<section id="{{ section.anchor }}">
<h2>{{ section.title }}</h2>
{% include "blocks" %}
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
