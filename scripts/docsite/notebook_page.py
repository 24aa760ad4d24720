"""Notebooks (`# %%` cells in plain Python files, as Jupyter and editors read them) as pages."""

from __future__ import annotations

import re
from pathlib import Path

from docsite.pages import DOCS

NOTEBOOKS = sorted((DOCS / "notebooks").glob("*.py"))
_CELL = re.compile(r"^# %%( \[markdown\])?[^\n]*\n", re.MULTILINE)


def name_of(path: Path) -> str:
    """Name of the page of a notebook."""
    return f"notebooks/{path.stem}.md"


def page(path: Path) -> str:
    """Return a notebook as a page: text as it is, code in blocks."""
    pieces = _CELL.split(path.read_text(encoding="utf-8"))
    parts = []
    for markdown, body in zip(pieces[1::2], pieces[2::2], strict=True):
        if markdown:
            parts.append(re.sub(r"^# ?", "", body, flags=re.MULTILINE).strip())
        else:
            parts.append(f"```python\n{body.strip()}\n```")
    where = path.relative_to(DOCS.parent).as_posix()
    run = f"`python {where}` runs this page; Jupyter with jupytext opens the file as a notebook."
    return "\n\n".join([parts[0], run, *parts[1:]]) + "\n"
