"""What the pages name exists: files, names, commands, options, links and their headings."""

from __future__ import annotations

import ast
import re
import runpy
import sys
from collections.abc import Iterator
from functools import lru_cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from docsite.build import GENERATED
from docsite.pages import anchors, links, slug, source_pages
from ecm.cli.app import COMMANDS, MOVED, load_command
from ecm.errors import Remedy
from ecm.io.settings import read_toml
from support.neck import ROOT
from support.pages import blocks
from support.programs import ended

PAGES = sorted(
    [
        *ROOT.glob("*.md"),
        *(ROOT / "docs").rglob("*.md"),
        *(ROOT / "crates").glob("*/*.md"),
        *(ROOT / "examples").rglob("*.md"),
    ]
)
CODE = re.compile(r"^```\w*[^\n]*\n(.*?)^```$|`([^`\n]+)`", re.MULTILINE | re.DOTALL)
FILE = re.compile(r"[\w.*/-]+\.(?:py|rs|toml|md|html|c|h|png|svg|sh|urdf|cpp)\b")
SOURCE = re.compile(r"^[\w*]+\.(?:py|rs)$")
NAME = re.compile(r"\becm(?:\.[A-Za-z_]\w*)+")
COMMAND = re.compile(r"(?:^|[\s;&(])ecm ([a-z]+)([^\n;&|#]*)", re.MULTILINE)
OPTION = re.compile(r"(?<!\S)--[a-z][a-z-]*")

TEST = re.compile(r"(?<![\w/])(?:(test_\w+)(…?)(?!\w|\.py)|([a-z]+(?:_[a-z]+)+)…)")
SELECTED = re.compile(r"pytest (tests/[\w/.]+) -k (?:\"([^\"]+)\"|(\w+))")
FUNCTION = re.compile(r"^\s*(?:def|fn) (\w+)\(", re.MULTILINE)

PAGE = re.compile(r"(?<![\w*{}./-])[\w./-]*\w\.md\b")

WRITTEN = ("demo/", "out/", "examples/control.rs")
"""What commands write: folders of results, and a file of the exported crate."""
GONE = {"ecm.workflow.head", "ecm campaign --film", "ecm campaign --phases"}
"""Names of earlier versions that CHANGELOG.md tells of."""
ELSEWHERE = {
    "model/kuka_lwr4_gaz.urdf",
    "model/kuka_lwr4_identified.urdf",
    "orocos_kdl/tests/solvertest.cpp",
}
"""Files of other projects."""


def missing_files(page: Path, text: str) -> Iterator[str]:
    """Files that a page names and that are not in the repository.

    A path counts from the root or from the page's folder; NAME and * stand for any name. A source
    file without a folder may be anywhere, or be written by a block of the page.
    """
    own = {block.name for block in blocks(page) if block.name}
    for match in FILE.finditer(text):
        name = match.group()
        before = text[: match.start()].rsplit("\n", 1)[-1].rsplit(" ", 1)[-1]
        if "://" in before or name in ELSEWHERE | own or name.startswith(WRITTEN):
            continue
        pattern = name.removeprefix("./").replace("NAME", "*")
        if "/" in pattern:
            if not any(
                (folder / pattern).exists() or ("*" in pattern and any(folder.glob(pattern)))
                for folder in (ROOT, page.parent)
            ):
                yield name
        elif SOURCE.match(pattern) and not any(
            next((ROOT / top).rglob(pattern), None)
            for top in ("python", "crates", "tests", "benches", "docs", "scripts", "examples")
        ):
            yield name


@lru_cache(maxsize=1)
def functions_of_tests() -> set[str]:
    """Names of all functions of the tests, in Python and in Rust."""
    files = [*(ROOT / "tests").rglob("*.py"), *(ROOT / "crates").rglob("*.rs")]
    return {name for path in files for name in FUNCTION.findall(path.read_text(encoding="utf-8"))}


def missing_tests(text: str) -> list[str]:
    """Tests that a page names or selects and that do not exist; `…` is the rest of a name."""
    lacking = []
    for place, several, one in SELECTED.findall(text):
        path = ROOT / place
        files = [path] if path.is_file() else sorted(path.rglob("*.py"))
        own = "\n".join(
            name for file in files for name in FUNCTION.findall(file.read_text("utf-8"))
        )
        lacking += [word for word in (several or one).split(" or ") if word not in own]
    for python, rest, rust in TEST.findall(text):
        name, whole = python or rust, bool(python and not rest)
        known = functions_of_tests()
        if name not in known and (whole or not any(test.startswith(name) for test in known)):
            lacking.append(name)
    return lacking


def exists(name: str) -> bool:
    """Whether a dotted name of the package can be imported, or is an attribute of what can."""
    parts = name.split(".")
    known = len(parts)
    while find_module(".".join(parts[:known])) is None:
        known -= 1
    thing: Any = import_module(".".join(parts[:known]))
    for part in parts[known:]:
        if not hasattr(thing, part):
            return False
        thing = getattr(thing, part)
    return True


def find_module(name: str) -> Any:
    """Where a module is, None where there is none of that name."""
    try:
        return find_spec(name)
    except ModuleNotFoundError:
        return None


def options_of(command: Any) -> set[str]:
    """Long options of a command, with those of its own commands."""
    own = {name for option in command.params for name in (*option.opts, *option.secondary_opts)}
    own |= {"--help"}
    return own.union(*(options_of(child) for child in getattr(command, "commands", {}).values()))


def code(text: str) -> str:
    """What a page writes as code, a piece a line; lines that go on are joined."""
    pieces = (match.group(1) or match.group(2) for match in CODE.finditer(text))
    return "\n".join(pieces).replace("\\\n", " ")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_files_that_a_page_names_exist(page: Path) -> None:
    assert sorted(set(missing_files(page, page.read_text(encoding="utf-8")))) == []


def test_pages_that_the_code_names_exist() -> None:
    missing = set()
    for path in [*(ROOT / "python").rglob("*.py*"), *(ROOT / "crates").rglob("*.rs")]:
        if path.suffix in (".py", ".pyi", ".rs"):
            for name in PAGE.findall(path.read_text(encoding="utf-8")):
                near = [folder for folder in path.parents if folder.is_relative_to(ROOT)]
                if not any((folder / name).exists() for folder in near):
                    missing.add(f"{path.relative_to(ROOT)}: {name}")
    assert sorted(missing) == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_tests_that_a_page_names_exist(page: Path) -> None:
    assert missing_tests(page.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_names_of_the_package_that_a_page_uses_exist(page: Path) -> None:
    names = {name.group() for name in NAME.finditer(page.read_text(encoding="utf-8"))}
    names -= GONE if page.name == "CHANGELOG.md" else set()
    assert [name for name in sorted(names) if not exists(name)] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_commands_and_options_that_a_page_writes_exist(page: Path) -> None:
    unknown = []
    for name, rest in COMMAND.findall(code(page.read_text(encoding="utf-8"))):
        if name in MOVED and page.name == "CHANGELOG.md":
            continue
        if name not in COMMANDS:
            unknown.append(f"ecm {name}")
        else:
            given = set(OPTION.findall(rest)) - options_of(load_command(name))
            unknown += [f"ecm {name} {option}" for option in sorted(given)]
    assert set(unknown) - (GONE if page.name == "CHANGELOG.md" else set()) == set()


@lru_cache(maxsize=1)
def generated() -> dict[Path, str]:
    """Pages that the code writes, by where they would stand among the others."""
    return {ROOT / "docs" / name: text() for name, text in GENERATED.items()}


def broken_links(page: Path, text: str) -> Iterator[str]:
    """Links of a page to a file or a heading that does not exist."""
    for link in links(page, text):
        made = generated().get(link.file)
        if made is None and not link.file.exists():
            yield link.written
        elif link.anchor and link.file.suffix == ".md":
            goal = link.file.read_text(encoding="utf-8") if made is None else made
            if link.anchor not in anchors(goal):
                yield link.written


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_of_a_page_lead_somewhere(page: Path) -> None:
    assert list(broken_links(page, page.read_text(encoding="utf-8"))) == []


@pytest.mark.parametrize("page", GENERATED)
def test_links_of_a_generated_page_lead_somewhere(page: str) -> None:
    place = ROOT / "docs" / page
    assert list(broken_links(place, generated()[place])) == []


def pages_of(nav: Any) -> Iterator[str]:
    """Names of the pages in a part of the navigation."""
    for entry in nav:
        for goal in entry.values():
            yield from [goal] if isinstance(goal, str) else pages_of(goal)


def test_the_navigation_holds_every_page_once() -> None:
    listed = sorted(pages_of(read_toml(ROOT / "zensical.toml")["project"]["nav"]))
    assert listed == sorted([*source_pages(), *GENERATED]), "see nav in zensical.toml"


def test_what_does_not_exist_is_noticed() -> None:
    page = ROOT / "docs" / "rig.md"
    text = "`python/ecm/rig/nowhere.py`, `nowhere.py`, [page](nowhere/page.md), `ecm/rig/NAME.md`"
    assert len(set(missing_files(page, text))) == 4
    assert not list(missing_files(page, "`python/ecm/rig/NAME.py`, `tests/rig/test_arm.py`"))
    selected = '`pytest tests/package -k "what_does or not_here"`'
    assert missing_tests(f"{selected}, `test_nowhere`, `test_what_does…`, nothing_is_nowhere…") == [
        "not_here",
        "test_nowhere",
        "nothing_is_nowhere",
    ]
    assert not exists("ecm.rig.nowhere")
    assert not exists("ecm.Table.nowhere")
    assert exists("ecm.Table.select")
    assert "--nowhere" not in options_of(load_command("design"))
    assert {"--rig", "--seed"} <= options_of(load_command("design"))


def test_a_broken_link_is_noticed() -> None:
    page = ROOT / "docs" / "rig.md"
    text = "[a](nowhere.md) [b](robot.md#nowhere) [c](#here) [d](robot.md)\n\n## Here\n`[e](no.md)`"
    assert list(broken_links(page, text)) == ["nowhere.md", "robot.md#nowhere", "#here"]
    assert slug("Where it `fails`: fx, [y](z.md)") == "where-it-fails-fx-y"
    assert anchors("# A b\n\n## A b\n") == {"a-b", "a-b_1"}


def test_the_index_links_every_page_that_a_person_writes() -> None:
    index = ROOT / "docs" / "index.md"
    linked = {link.file for link in links(index, index.read_text(encoding="utf-8"))}
    assert set(source_pages().values()) - {index} - linked == set()


def test_each_command_that_the_code_advises_is_a_call_in_python() -> None:
    advised = re.compile(r'"(ecm [a-z]+ (?:DATA|MODEL)\b[^"]*)"')
    texts = [path.read_text(encoding="utf-8") for path in (ROOT / "python").rglob("*.py")]
    found = {re.sub(r"\{[^}]*\}", "x", one) for text in texts for one in advised.findall(text)}
    assert len(found) > 10
    for command in found:
        ast.parse(Remedy("do it", command).shown)


def test_each_record_of_measurements_has_a_figure_beside_it_that_a_command_draws(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.syspath_prepend(ROOT / "docs")
    figures = runpy.run_path(str(ROOT / "docs" / "figures.py"))
    drawn = {draw.__name__ for draw in figures["PICTURES"]} | set(figures["RECORDS"])
    texts = [page.read_text(encoding="utf-8") for page in (ROOT / "docs").rglob("*.md")]
    lacking = [
        name for name in sorted(path.stem for path in (ROOT / "benches/results").glob("*.csv"))
        if name not in drawn or not (ROOT / "docs" / f"{name}.svg").exists()
        or not any(f"`benches/results/{name}.csv`" in text and f"({name}.svg)" in text
                   for text in texts)
    ]  # fmt: skip
    assert lacking == []


def test_the_scripts_that_draw_pages_pictures_need_no_package_of_the_tests() -> None:
    """After `make demo` the group `demo` is there, and what only the group `dev` has is not."""
    text = "".join((ROOT / "docs" / name).read_text("utf-8") for name in ("gallery.md", "app.md"))
    scripts = sorted(set(re.findall(r"python (docs/\w+\.py)", text)))
    assert len(scripts) > 4
    only_dev = ["pytest", "hypothesis", "pandas", "polars", "xarray", "statsmodels", "yaml"]
    begin = f"import runpy, sys; sys.modules.update(dict.fromkeys({only_dev})); sys.path[:0] = "
    for script in scripts:
        load = f"{begin}['docs']; runpy.run_path({script!r}, run_name='loaded')"
        ended(sys.executable, "-c", load, cwd=ROOT)
