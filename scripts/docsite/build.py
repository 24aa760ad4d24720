"""Stages the pages and builds the site."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from os.path import relpath
from pathlib import Path

from docsite import (
    cli_page,
    errors_page,
    json_page,
    notebook_page,
    python_page,
    rust_page,
    settings_page,
)
from docsite.maths import with_maths
from docsite.pages import DOCS, ROOT, file_name, source_pages, with_site_links

GENERATED: dict[str, Callable[[], str]] = {
    "reference/commands.md": cli_page.page,
    "reference/toml.md": settings_page.page,
    "reference/errors.md": errors_page.page,
    "reference/json.md": json_page.page,
    "reference/rust.md": rust_page.page,
    **{
        notebook_page.name_of(path): partial(notebook_page.page, path)
        for path in notebook_page.NOTEBOOKS
    },
    **{python_page.name_of(room): partial(python_page.page, room) for room in python_page.ROOMS},
}
"""Pages that the code writes, by their name in the site."""

_FOREIGN = 'src="https://unpkg.com/iframe-worker/shim"'
_NO_ASSET = {".md", ".py", ".pyc"}


def stage(folder: Path) -> None:
    """Write every page and picture of the site into a folder."""
    shutil.rmtree(folder, ignore_errors=True)
    pages = source_pages()
    for name, source in pages.items():
        text, files = with_site_links(name, source, source.read_text(encoding="utf-8"), pages)
        _write(folder / name, with_maths(text))
        for file in files:
            _copy(file, folder / file_name(file))
    for name, text_of in GENERATED.items():
        _write(folder / name, text_of())
    for asset in DOCS.rglob("*"):
        if asset.is_file() and asset.suffix not in _NO_ASSET:
            _copy(asset, folder / asset.relative_to(DOCS))


def build(folder: Path) -> Path:
    """Write the pages and the site into a folder; a warning is an error. Returns the site's."""
    stage(folder / "pages")
    shutil.copyfile(ROOT / "zensical.toml", folder / "zensical.toml")
    site = folder / "site"
    done = subprocess.run(
        [sys.executable, "-m", "zensical", "build", "--clean", "--strict"],
        cwd=folder, capture_output=True, text=True, check=False,
    )  # fmt: skip
    if done.returncode != 0:
        raise SystemExit(f"{done.stdout}{done.stderr}")
    (site / "404.html").unlink()  # its links begin at the root of a server
    for page in site.rglob("*.html"):
        _stay_here(page, site)
    return site


def _stay_here(page: Path, site: Path) -> None:
    """Replace the one script that the theme would load from another machine by our own."""
    text = page.read_text(encoding="utf-8")
    own = relpath(site / "worker.js", page.parent)
    page.write_text(text.replace(_FOREIGN, f'src="{own}"'), encoding="utf-8")


def _write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


def _copy(source: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(source, target)
