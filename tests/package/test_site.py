"""The site of the documentation is built, loads nothing from elsewhere, and draws formulas."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

from docsite import build
from docsite.maths import with_maths
from support.chromium import open_chromium
from support.programs import need_packages

LOADED = re.compile(r'<(?:script|img|link|iframe)\b[^>]*?(?:src|href)="([^"]+)"')

FOUND = "[...document.querySelectorAll('div')].find(part => part.shadowRoot).shadowRoot"
"""The window of the search."""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, built into a folder of its own."""
    if sys.version_info < (3, 11):
        pytest.skip("zensical needs Python 3.11")
    need_packages("zensical", "latex2mathml")
    return build.build(tmp_path_factory.mktemp("docs"))


def test_every_page_is_there_and_loads_only_files_of_the_site(site: Path) -> None:
    pages = sorted(site.rglob("*.html"))
    assert len(pages) > 20
    loaded = {(page, name) for page in pages for name in LOADED.findall(page.read_text("utf-8"))}
    assert len(loaded) > len(pages)
    missing = {
        name
        for page, name in loaded
        if not name.startswith("data:") and not (page.parent / name.partition("?")[0]).is_file()
    }
    assert missing == set()


@pytest.mark.browser
def test_a_page_opened_from_the_disk_searches_and_asks_nobody(site: Path) -> None:
    with open_chromium() as page:
        page.size(360, 800)
        page.open((site / "explain" / "mechanics.html").as_uri())
        page.until("document.querySelectorAll('math').length > 3")
        assert page.js("document.documentElement.scrollWidth") <= 360
        page.size(1280, 900)
        page.until("document.readyState === 'complete'")
        page.click(".md-search__button")
        page.until(f"{FOUND}.activeElement.tagName === 'INPUT'")
        page.call("Input.insertText", text="lack-of-fit")
        page.until(f"{FOUND}.textContent.includes('F statistic')")
        assert [asked for asked in page.problems() if not asked.startswith("file:")] == []


def test_formulas_become_mathml_and_code_stays() -> None:
    need_packages("latex2mathml")
    page = "Cost $5.\n\n$K_s$ and `$x$`\n\n$$\n\\frac{a}{b}\n$$\n\n```sh\necho $HOME $PATH\n```\n"
    made = with_maths(page)
    assert made.count("<math") == 2
    assert "<mfrac>" in made
    assert "`$x$`" in made
    assert "echo $HOME $PATH" in made
