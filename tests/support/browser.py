"""Opens a page in headless Chromium: what its document became, and a screenshot of it."""

from __future__ import annotations

import base64
import gzip
import json
import re
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from support.programs import need_program


@dataclass(frozen=True)
class Seen:
    """What the browser made of a page."""

    html: str

    def attribute(self, name: str) -> str | None:
        """data-NAME of the document's root, set by the page's own script."""
        found = re.search(rf'<html[^>]*\bdata-{name}="([^"]*)"', self.html)
        return None if found is None else found.group(1)


def open_page(path: Path, *, screenshot: Path | None = None, height: int = 9000) -> Seen:
    """Load a file in Chromium, let its scripts run, and return the document."""
    program = need_program("chromium", "chromium-browser", "google-chrome")
    common = [
        program,
        "--headless=new",
        "--no-sandbox",
        "--disable-gpu",
        "--disable-dev-shm-usage",
        "--hide-scrollbars",
        f"--window-size=1200,{height}",
        "--virtual-time-budget=20000",
    ]
    if screenshot is not None:
        subprocess.run(
            [*common, f"--screenshot={screenshot}", path.resolve().as_uri()],
            check=True,
            capture_output=True,
            timeout=120,
        )
    shown = subprocess.run(
        [*common, "--dump-dom", path.resolve().as_uri()],
        check=True,
        capture_output=True,
        timeout=120,
    )
    return Seen(shown.stdout.decode("utf-8", errors="replace"))


def figures_of(path: Path) -> list[dict[str, Any]]:
    """The figures that a report page holds, in plotly's dict form."""
    page = path.read_text(encoding="utf-8")
    found = re.search(r'id="packed-figures">([A-Za-z0-9+/=]*)<', page)
    assert found is not None
    figures: list[dict[str, Any]] = json.loads(gzip.decompress(base64.b64decode(found.group(1))))
    return figures
