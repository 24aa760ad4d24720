"""Where the pages come from: docs/, four files of the root, and what the code writes itself."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from os.path import relpath
from pathlib import Path, PurePosixPath

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
OF_THE_ROOT = ("ARCHITECTURE", "CONTRIBUTING", "CHANGELOG", "SECURITY", "CODE_OF_CONDUCT")
"""Files of the root that are pages, where they are there: `project/NAME.md`."""

_CODE = re.compile(r"^(```|~~~).*?^\1[^\n]*$|`[^`\n]+`", re.MULTILINE | re.DOTALL)
_LINK = re.compile(r"(!?\[[^\]]*\]\()([^)\s]+)(\))")
_HEADING = re.compile(r"^#{1,6} +(.+?) *$", re.MULTILINE)


@dataclass(frozen=True)
class Link:
    """A link of a page: as it is written, the file that it means, and the heading."""

    written: str
    file: Path
    anchor: str


def source_pages() -> dict[str, Path]:
    """Every page that a person writes, by its name in the site."""
    pages = {path.relative_to(DOCS).as_posix(): path for path in sorted(DOCS.rglob("*.md"))}
    for name in OF_THE_ROOT:
        if (ROOT / f"{name}.md").is_file():
            pages[f"project/{name.lower()}.md"] = ROOT / f"{name}.md"
    return pages


def outside_code(text: str, change: Callable[[str], str]) -> str:
    """Return a page with what is not code changed."""
    parts, end = [], 0
    for match in _CODE.finditer(text):
        parts += [change(text[end : match.start()]), match.group()]
        end = match.end()
    return "".join([*parts, change(text[end:])])


def links(page: Path, text: str) -> Iterator[Link]:
    """Links of a page to files of the repository or to headings; the web is left out."""
    found: list[str] = []

    def note(piece: str) -> str:
        found.extend(match.group(2) for match in _LINK.finditer(piece))
        return piece

    outside_code(text, note)
    for written in found:
        if "://" not in written and not written.startswith("mailto:"):
            name, _, anchor = written.partition("#")
            file = (page.parent / name).resolve() if name else page
            yield Link(written, file, anchor)


def anchors(text: str) -> set[str]:
    """Names of the headings of a page, as the site gives them."""
    names: set[str] = set()
    for heading in _HEADING.findall(_CODE.sub(_inline_only, text)):
        name = base = slug(heading)
        number = 0
        while name in names:
            number += 1
            name = f"{base}_{number}"
        names.add(name)
    return names


def slug(heading: str) -> str:
    """Return the anchor of a heading: letters, digits and hyphens."""
    plain = re.sub(r"\[([^\]]*)\]\([^)]*\)|[`*]", r"\1", heading)
    plain = plain.encode("ascii", "ignore").decode()
    return re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", plain).strip().lower())


def _inline_only(match: re.Match[str]) -> str:
    return match.group() if match.group(1) is None else ""


def with_site_links(
    name: str, source: Path, text: str, pages: dict[str, Path]
) -> tuple[str, set[Path]]:
    """Return a page whose links fit the site, and the files of the repository that it needs."""
    staged = {path: other for other, path in pages.items()}
    folder = PurePosixPath(name).parent
    files: set[Path] = set()

    def fitted(match: re.Match[str]) -> str:
        before, written, after = match.groups()
        path, hash_, anchor = written.partition("#")
        if "://" in written or written.startswith("mailto:") or not path:
            return match.group()
        file = (source.parent / path).resolve()
        if file in staged:
            goal = staged[file]
        elif file.is_file() and not file.is_relative_to(DOCS):
            files.add(file)
            goal = file_name(file)
        else:
            return match.group()
        return f"{before}{relpath(goal, folder)}{hash_}{anchor}{after}"

    return outside_code(text, lambda piece: _LINK.sub(fitted, piece)), files


def file_name(file: Path) -> str:
    """Name in the site of a file of the repository that is no page."""
    return f"files/{file.relative_to(ROOT).as_posix()}"
