"""The report page: complete in itself, shown by a real browser, and safe with hostile text."""

from __future__ import annotations

import html
import json
import re
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from plotly.subplots import make_subplots

from ecm.comparison import compare
from ecm.report import FigureBlock, Report, Section, TableBlock, TextBlock
from ecm.report import figures as draw
from ecm.report.blocks import Block, CodeBlock, Shown, number, text_of
from support.campaigns import campaign, model
from support.chromium import Page
from support.report_pages import figures_of, open_page

HOSTILE = '</script><script>document.documentElement.dataset.owned = "1"</script><b>&'


def sections() -> list[Section]:
    rng = np.random.default_rng(0)
    values = rng.normal(0.0, 0.1, (200, 6))
    return [
        Section(
            HOSTILE,
            [
                TextBlock(HOSTILE, strong=True),
                TableBlock(HOSTILE, ("a", HOSTILE), [[HOSTILE, "1"]]),
                FigureBlock(
                    HOSTILE,
                    draw.histograms(
                        {HOSTILE: values}, draw.COMPONENT_LABELS, limit=0.5, x_title=HOSTILE
                    ),
                ),
            ],
        ),
        Section(
            "Figures",
            [
                FigureBlock(
                    "scatter",
                    draw.actual_predicted(values, values + 0.01, draw.COMPONENT_LABELS),
                ),
                FigureBlock("one", draw.histogram({"n": values[:, 0]}, x_title="x", y_title="n")),
                FigureBlock(
                    "times",
                    draw.histogram(
                        {"a": [0.1, 0.2], "b": [1e-5, 2e-5]}, x_title="x", y_title="n", log=True
                    ),
                ),
                FigureBlock(
                    "lines",
                    draw.lines({"a": ([1, 2], [3, 4])}, x_title="x", y_title="y", log_y=True),
                ),
                FigureBlock("bars", draw.bars({"a": [1.0, 2.0]}, ["p", "q"], y_title="y")),
                FigureBlock("map", draw.stiffness_map(np.diag(np.arange(1.0, 7.0)), "K")),
                FigureBlock("cloud", draw.pose_cloud(values)),
            ],
        ),
    ]


@pytest.mark.browser
def test_every_figure_is_drawn_and_hostile_text_stays_text(tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    Report(HOSTILE, HOSTILE, sections()).write(path)
    seen = open_page(path)
    assert seen.attribute("error") is None
    assert seen.attribute("blocked") is None
    assert seen.attribute("owned") is None
    assert seen.attribute("figures") == "8"
    assert seen.html.count('<svg class="figure"') == 8
    assert seen.html.count("<circle") > 1000


@pytest.mark.browser
def test_the_names_of_bars_are_whole_however_long(page: Page, tmp_path: Path) -> None:
    names = ["sensor_temperature_degC", *"abcdefgh", "constant_in_body"]
    block = FigureBlock("bars", draw.bars({"a": [1.0] * len(names)}, names, y_title="y"))
    path = tmp_path / "bars.html"
    Report("bars", "", [Section("Bars", [block])]).write(path)
    page.open(path.resolve().as_uri())
    page.until("!!document.documentElement.dataset.figures")
    box = "getBoundingClientRect()"
    outside = "own.left < place.left || own.bottom > place.bottom + 1 ? [text.textContent] : []"
    cut = (
        f"(place => [...document.querySelectorAll('svg.figure text')].flatMap(text => "
        f"(own => {outside})(text.{box})))(document.querySelector('svg.figure').{box})"
    )
    assert page.js(cut) == []


@pytest.mark.browser
def test_the_mechanism_stands_before_the_first_table_and_shares_the_marks(
    page: Page, tmp_path: Path
) -> None:
    path = tmp_path / "compare.html"
    compare(model(), campaign("payload", 1.0, 0)).report().write(path)
    text = path.read_text(encoding="utf-8")
    assert text.index('id="mechanism-0"') < text.index("<table>")
    page.open(path.resolve().as_uri())
    page.until("!!document.documentElement.dataset.figures")
    page.js("document.querySelector('tr[data-row]').click()")
    row = page.js("document.querySelector('tr[data-row]').dataset.row")
    assert page.js("[...modules.selection.marked].join()") == row
    page.js("document.querySelector('.space canvas').focus()")
    page.keys("Escape", "n", " ")
    first = page.js("[...modules.selection.marked].join()")
    assert page.js("document.documentElement.dataset.marked") == first
    drawn = "document.querySelector('.space canvas').getContext('2d').getImageData(0, 0, 2e3, 2e3)"
    assert page.js(f"new Set(new Uint32Array({drawn}.data.buffer)).size") > 500


def test_a_dark_page_has_dark_figures_and_a_phone_can_scroll_over_them(
    page: Page, tmp_path: Path
) -> None:
    Report("t", "l", sections()[1:]).write(tmp_path / "page.html")
    ink = "getComputedStyle(document.querySelector('#figure-0 text')).fill"
    page.size(360, 800, dark=True)
    page.open((tmp_path / "page.html").as_uri())
    page.until("document.querySelectorAll('#figure-0 text').length > 0")
    assert page.js(ink) == "rgb(232, 236, 242)"
    assert page.js("document.getElementById('figure-0').offsetWidth") >= 640
    assert page.js("document.documentElement.scrollWidth") <= 360
    page.size(1200, 800)
    page.until(f"{ink} === 'rgb(23, 32, 43)'")


def test_on_a_phone_a_long_name_breaks_and_the_numbers_of_a_stiffness_stand_apart(
    page: Page, tmp_path: Path
) -> None:
    """A model's name has no spaces; a scroll shows the cells that a phone has no room for."""
    cells = [["-0.00033 ± 0.0069"] * 6 for _ in range(6)]
    blocks = [FigureBlock("ΔK", draw.text_map(np.zeros((6, 6)), cells, limit=20.0))]
    name = "poly:1+hysteresis+stress_relaxation against measurements"
    Report(name, "l", [Section("Where", blocks)]).write(tmp_path / "page.html")
    page.size(360, 800)
    page.open((tmp_path / "page.html").as_uri())
    page.until("document.querySelectorAll('#figure-0 text').length > 0")
    assert page.js("document.documentElement.scrollWidth") <= 360
    rights_and_lefts = page.js(
        "[...document.querySelectorAll('#figure-0 text')].filter(t => t.textContent.includes('±'))"
        ".slice(0, 6).map(t => t.getBoundingClientRect()).map(r => [r.right, r.left])"
    )
    for (right, _), (_, left) in pairwise(rights_and_lefts):
        assert right < left


def test_on_a_wide_page_no_sentence_has_to_be_scrolled(page: Page, tmp_path: Path) -> None:
    """Neither in a column before the last one, nor where a command prints lines."""
    said = "q1_rad, q2_rad, q3_rad, q4_rad, q5_rad, q6_rad, q7_rad, q1_dir, q2_dir, q3_dir, " * 2
    table = TableBlock("Not testable", ("why", "what to record", "effects"), [["no", said, said]])
    blocks: list[Block] = [table, CodeBlock("ecm check", said * 2)]
    Report("t", "l", [Section("First", blocks)]).write(tmp_path / "page.html")
    page.size(1400, 900)
    page.open((tmp_path / "page.html").as_uri())
    page.until("!!document.documentElement.dataset.figures")
    wide = "[...document.querySelectorAll('.scroll, pre')].map(e => e.scrollWidth - e.clientWidth)"
    assert max(page.js(wide)) <= 0


def test_a_printed_report_cuts_no_table_and_numbers_its_sections_once(
    page: Page, tmp_path: Path
) -> None:
    """On A4 no table is wider than the sheet, and a short one does not go over an edge."""
    rows = [
        [f"a rather long name of effect {i}", 1.0, "words that go on for a while"]
        for i in range(12)
    ]
    blocks: list[Block] = [
        TableBlock("Errors.", ("effect", "size", "what"), rows) for _ in range(4)
    ]
    Report("t", "l", [Section("First", blocks), *sections()[1:]]).write(tmp_path / "page.html")
    page.size(690, 1000)  # A4 without its margins, at 96 dots an inch
    page.open((tmp_path / "page.html").as_uri())
    page.until("!!document.documentElement.dataset.figures")
    page.call("Emulation.setEmulatedMedia", media="print")
    assert page.js("document.documentElement.scrollWidth") <= 690
    breaks = "f => getComputedStyle(f).breakInside"
    found = page.js(f"[...document.querySelectorAll('figure.table')].map({breaks}).join()")
    assert found == ",".join(["avoid"] * 4)
    assert page.js("getComputedStyle(document.querySelector('nav')).display") == "none"
    number = "getComputedStyle(document.querySelectorAll('h2')[1], '::before').content"
    assert "counter(section)" in page.js(number)
    assert len(page.call("Page.printToPDF", preferCSSPageSize=True)["data"]) > 10_000
    page.call("Emulation.setEmulatedMedia", media="")


def test_the_page_asks_for_nothing_from_outside_and_is_small(tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    Report("title", "lead", sections()).write(path)
    text = path.read_text(encoding="utf-8")
    for own in (text, json.dumps(figures_of(path))):
        assert "http:" not in own
        assert "https:" not in own
    assert len(text) < 3e5


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (24585.3, "24585"),
        (3.14159, "3.14"),
        (0.01234, "0.0123"),
        (123.456, "123"),
        (1.5e6, "1.50e+06"),
        (float("nan"), "–"),
        (-0.5, "-0.5"),
    ],
)
def test_numbers_have_significant_digits(value: float, text: str) -> None:
    assert number(value) == text


def test_columns_of_words_stand_left_and_numbers_right() -> None:
    rows = [["fts_gain", "1e-3", "1", "0.2 to 0.9"], ["payload", "–", "kg m", "1 to 2"]]
    assert TableBlock("", ("effect", "size", "unit", "range"), rows).words == [
        True, False, True, False,
    ]  # fmt: skip


def test_a_terminal_shows_the_blocks_in_lines_of_its_width() -> None:
    """Words of wide columns go on below; figures, and most rows of a linked table, are left out."""
    words = "what the base leaves on the rows that no fold of the fit has seen before this one"
    blocks = [
        TextBlock("One sentence that is longer than forty characters is broken.", strong=True),
        TableBlock(
            "Errors.", ("name", "rms", "what"), [["fx_N", 0.12345, words], ["fy_N", None, ""]]
        ),
        FigureBlock("Not shown.", draw.bars({"a": [1.0]}, ["p"], y_title="y")),
        TableBlock("Rows.", ("row", "size"), [[i, 0.5] for i in range(9)], link="rows"),
        CodeBlock("A command.", "ecm compare model.json measured.csv --report page.html"),
    ]
    text = text_of(blocks, 40)
    code = blocks[-1].text
    assert all(len(line) <= 40 for line in text.splitlines() if line != code)
    assert code in text
    assert re.search(r"^fx_N +0\.123  what the base leaves on the$", text, re.MULTILINE)
    assert re.search(r"^fy_N +–$", text, re.MULTILINE)
    assert "Not shown." not in text
    assert text.count("0.5\n") == 3
    assert "... and 6 more" in text
    whole = text_of(blocks)
    assert f"0.123  {words}\n" in whole


def test_a_result_shows_the_same_words_in_terminal_notebook_and_page(tmp_path: Path) -> None:
    result = compare(model(), campaign("payload", 1.0, 0))
    notebook = html.unescape(result._repr_html_() or "")
    assert "<table>" in notebook
    assert "figure-0" not in notebook
    result.report().write(tmp_path / "page.html")
    page = html.unescape((tmp_path / "page.html").read_text(encoding="utf-8"))
    shown = [block for block in result.blocks() if isinstance(block, TableBlock)]
    said = [result.sentence(), *(cell for table in shown for cell in table.cells[0])]
    for text in (str(result).replace("\n", " "), notebook, page):
        assert all(word in text for word in said)
    assert HOSTILE not in (Hostile()._repr_html_() or "")


class Hostile(Shown):
    """A result whose words are markup."""

    def blocks(self) -> list[Block]:
        """Return it."""
        return [TextBlock(HOSTILE), TableBlock("", ("",), [[HOSTILE]])]


PLAY = """<script>
drawn.then(() => {
const marks = () => figures.map((f, i) => [...document.querySelectorAll(`#figure-${i} .chosen`)]
  .map(node => node.dataset.row).join(" ")).filter(Boolean).join(" ");
const rows = () => [...document.querySelectorAll("tr.marked")].map(r => r.dataset.row).join(" ");
const say = (name, value) => { document.documentElement.dataset[name] = value; };
const worst = document.querySelector("tr[data-row]");
worst.click();
say("worst", worst.dataset.row); say("seen", marks()); say("rows", rows());
worst.click();
say("after", marks().trim());
// A point of the last linked figure.
const row = document.querySelectorAll("tr[data-row]")[3].dataset.row;
const point = () => [...document.querySelectorAll(`.figure [data-row="${row}"]`)].pop();
const click = () => point().dispatchEvent(new MouseEvent("click"));
click();
say("point", row); say("seenpoint", marks()); say("rowspoint", rows());
click();
say("afterpoint", marks().trim() + rows());
});
</script></body>"""
"""After the page's own script: click a row, then a point, and say what each figure marks."""


@pytest.mark.browser
def test_a_row_or_point_marked_in_one_place_is_marked_in_all(tmp_path: Path) -> None:
    """A figure without the click, or a mark by place in the trace and not by row, would show."""
    path = tmp_path / "compare.html"
    compare(model(), campaign("payload", 1.0, 0)).report().write(path)
    page = path.read_text(encoding="utf-8")
    path.write_text(page.replace("</body>", PLAY), encoding="utf-8")
    seen = open_page(path, done="afterpoint")
    assert seen.attribute("error") is None
    for clicked, marks, rows, after in (
        ("worst", "seen", "rows", "after"),
        ("point", "seenpoint", "rowspoint", "afterpoint"),
    ):
        row = seen.attribute(clicked)
        marked = (seen.attribute(marks) or "").split(" ")
        assert len(marked) >= 12
        assert set(marked) == {row}
        assert seen.attribute(rows) == row
        assert seen.attribute(after) == ""


def test_the_figures_of_a_job_draw_some_of_many_rows_and_say_so() -> None:
    """Its own figures, beside those of a comparison: 20,000 rows were 20,000 points a panel."""
    values = np.random.default_rng(0).normal(size=(20_000, 6))
    values[7] = 9.0
    time_s = np.arange(20_000.0)
    for figure, error in (
        (draw.pose_cloud(values), values),
        (draw.actual_predicted(np.zeros((20_000, 6)), values, draw.COMPONENT_LABELS), values),
        (draw.residuals_over(time_s, {"before": values, "after": values}, x_title="t"), values),
    ):
        drawn = draw.drawn_rows(error)
        assert 1000 <= len(drawn) <= 1010
        assert 7 in drawn
        points = [trace for trace in figure["data"] if trace.get("mode") == "markers"]
        assert points
        assert all(len(trace["x"]) == len(drawn) for trace in points)
        assert all(trace.get("customdata", drawn.tolist()) == drawn.tolist() for trace in points)
    assert f" {len(drawn)} of 20000 rows are drawn" in draw.drawn_sentence(values)
    assert draw.drawn_sentence(values[:1000]) == ""
    assert len(draw.pose_cloud(values[:1000])["data"][0]["x"]) == 1000


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 7])
def test_panels_lie_where_plotly_puts_subplots(n: int) -> None:
    """Worked out here: plotly's own objects take half a second to load and to check."""
    names = [f"component {i}" for i in range(n)]
    layout = draw.component_layout(names, None)
    columns = min(3, n)
    rows = -(-n // columns)
    expected = make_subplots(
        rows=rows,
        cols=columns,
        subplot_titles=[f"<b>{name}</b>" for name in names],
        horizontal_spacing=0.075,
        vertical_spacing=0.26 / rows,
    ).to_dict()["layout"]
    for i in range(n):
        for axis in "xy":
            name = f"{axis}axis{i + 1}" if i else f"{axis}axis"
            assert layout[name]["anchor"] == expected[name]["anchor"]
            assert layout[name]["domain"] == pytest.approx(expected[name]["domain"])
        for key, value in expected["annotations"][i].items():
            if key != "font":
                assert layout["annotations"][i][key] == pytest.approx(value)


def test_a_page_is_drawn_without_the_objects_of_plotly() -> None:
    code = (
        "import sys, ecm.report.figures as draw\n"
        "draw.component_layout(['fx', 'fy'], None)\n"
        "assert not any(name.startswith('plotly') for name in sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
