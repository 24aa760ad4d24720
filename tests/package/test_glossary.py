"""Every field term that a message uses has a heading in docs/glossary.md.

Messages are the sentences in the code's strings. Their words are plain English, which
`plain_words.txt` lists, or terms, which the glossary defines. A new word fails until it is one of
both: choose a plain word, define the term, or add a word that any reader knows to the list.
"""

from __future__ import annotations

import ast
import itertools
import re
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path

import pytest

from support.neck import ROOT

PACKAGE = ROOT / "python" / "ecm"
PAGE = ROOT / "docs" / "glossary.md"
PLAIN = frozenset(Path(__file__).with_name("plain_words.txt").read_text(encoding="utf-8").split())
SENTENCE = re.compile(
    r"\b(?:a|an|and|are|as|at|be|by|expected|for|from|has|in|is|it|no|not|of|on|or|that|the|this|to"
    r"|with)\b"
)
"""A string of several words is a sentence where one of these holds it together."""
NO_WORD = re.compile(
    r"\x00\w*|`[^`]*`|\"[^\"]*\"|'[^']*'|--[\w-]+|\[[\w. {}-]+\]|<[^>]*>"
    r"|\S*[_=\\{}/@]\S*|\b\w*\d\w*"
)
"""Values that are filled in, code, options, sections, paths and numbers."""
MARKUP = re.compile(r"</|/>|=>|\(\);|\{%|[:;] ?\}|;\n|#include|<svg")
"""Pages, scripts and generated code are no messages."""
PRIVATE = {
    "imitators", "mountain", "padding", "restated", "restatement", "thinned", "unthinned",
}  # fmt: skip
"""Words of earlier versions that only their author could read."""


@cache
def messages(source: str) -> tuple[tuple[int, str], ...]:
    """Line and text of each sentence in a file's strings; values are NUL.

    Docstrings are none, but for those of settings, which refusals and help print.
    """
    tree = ast.parse(source)
    parts: set[int] = set()
    found: list[tuple[int, str]] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr | ast.JoinedStr):
            parts |= {id(own) for own in ast.iter_child_nodes(node)}
    for node in ast.walk(tree):
        for field, below in itertools.pairwise(node.body if isinstance(node, ast.ClassDef) else ()):
            if isinstance(below, ast.Expr) and "setting(" in ast.unparse(field).partition("=")[2]:
                parts.discard(id(below.value))
    for node in ast.walk(tree):
        text = ""
        if isinstance(node, ast.JoinedStr):
            held = (own.value if isinstance(own, ast.Constant) else "\0" for own in node.values)
            text = "".join(map(str, held))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            text = "" if id(node) in parts else node.value
        if len(text.split()) > 3 and SENTENCE.search(text) and not MARKUP.search(text):
            found.append((node.lineno, text))
    return tuple(found)


def words(text: str) -> set[str]:
    """The words of a sentence in small letters, without values, code and numbers."""
    found = re.findall(r"[A-Za-z]{3,}", NO_WORD.sub(" ", text))
    return {word.lower() for word in found if word[1:].islower()}


def defined(page: str) -> set[str]:
    """The terms of the glossary: its headings, in small letters."""
    return {found.lower() for found in re.findall(r"^## (.+)$", page, re.MULTILINE)}


def forms(word: str) -> set[str]:
    """A word and what it may be a form of: residuals, whitened, freezing."""
    found = {word}
    for ending, before in (
        ("s", ("",)), ("es", ("",)), ("ies", ("y",)), ("d", ("",)), ("ed", ("",)),
        ("ing", ("", "e")), ("ity", ("",)), ("ally", ("",)), ("ly", ("",)),
    ):  # fmt: skip
        if word.endswith(ending) and len(word) > len(ending) + 2:
            found |= {word.removesuffix(ending) + other for other in before}
    return found


def unknown(sources: Mapping[str, str], terms: Iterable[str], plain: Iterable[str]) -> list[str]:
    """Words of messages that are neither plain nor defined, with their place."""
    known = {*plain} | {part for term in terms for part in re.findall(r"[a-z]{3,}", term)}
    return [
        f"{where}:{line}: {word}"
        for where, source in sources.items()
        for line, text in messages(source)
        for word in sorted(words(text))
        if not forms(word) & known
    ]


@pytest.fixture(scope="module")
def sources() -> dict[str, str]:
    return {
        str(path.relative_to(ROOT)): path.read_text(encoding="utf-8")
        for path in sorted(PACKAGE.rglob("*.py"))
    }


TERMS = defined(PAGE.read_text(encoding="utf-8"))


def test_every_word_of_a_message_is_plain_or_defined(sources: dict[str, str]) -> None:
    assert unknown(sources, TERMS, PLAIN) == []


def test_a_term_without_a_heading_is_seen() -> None:
    source = 'raise InputError(f"{path}: the flux of {name} is not known")\n'
    assert unknown({"a.py": source}, TERMS, PLAIN) == ["a.py:1: flux"]
    assert unknown({"a.py": source}, {*TERMS, "flux"}, PLAIN) == []
    # Without its heading a term of today's messages is missed, too.
    noise = 'raise InputError("the residuals of this table are larger than the noise")\n'
    assert unknown({"a.py": noise}, TERMS, PLAIN) == []
    assert unknown({"a.py": noise}, TERMS - {"residual"}, PLAIN) == ["a.py:1: residuals"]


def test_docstrings_code_and_values_are_no_messages() -> None:
    source = '"""The flux of a docstring."""\nx = f"see `flux` in [flux] of {flux} at flux_N"\n'
    assert unknown({"a.py": source}, TERMS, PLAIN) == []


def test_every_term_is_one_that_a_message_uses(sources: dict[str, str]) -> None:
    used = set[str]()
    every = ""
    for source in sources.values():
        for _, text in messages(source):
            every += " " + NO_WORD.sub(" ", text).lower().replace("-", " ")
            used |= {form for word in words(text) for form in forms(word)}
    several = {term for term in TERMS if not term.isalpha()}
    # BIC is read by no reader of words, which are of three small letters at least.
    assert [term for term in sorted(TERMS - several - used) if f" {term} " not in every] == []
    assert [term for term in sorted(several) if term.replace("-", " ") not in every] == []


def test_a_term_is_no_plain_word() -> None:
    single = {term for term in TERMS if term.isalpha()}
    assert sorted(word for word in PLAIN if forms(word) & single) == []


def test_private_words_are_gone(sources: dict[str, str]) -> None:
    found = [
        f"{where}:{line}: {word}"
        for where, source in sources.items()
        for line, text in messages(source)
        for word in sorted(words(text) & PRIVATE)
    ]
    assert found == []


def test_the_glossary_is_sorted_and_each_term_once() -> None:
    headings = re.findall(r"^## (.+)$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    assert headings == sorted(set(headings), key=str.lower)


def test_messages_that_a_page_quotes_are_in_the_code(sources: dict[str, str]) -> None:
    page = (ROOT / "docs" / "howto" / "messages.md").read_text(encoding="utf-8")
    quoted = re.findall(r"^\| `([^`]+)` \|", page, re.MULTILINE)
    rust = (path.read_text(encoding="utf-8") for path in (ROOT / "crates").glob("*/src/**/*.rs"))
    said = re.sub(r'"\s*f?"', "", "\n".join([*sources.values(), *rust]))  # pieces of a string
    assert len(quoted) > 30
    assert [one for one in quoted if not all(part in said for part in one.split("…"))] == []
