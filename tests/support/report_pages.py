"""What a browser makes of a report, and the figures that the report holds."""

from __future__ import annotations

import base64
import gzip
import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from support.chromium import open_chromium


@dataclass(frozen=True)
class Seen:
    """What the browser made of a page."""

    html: str

    def attribute(self, name: str) -> str | None:
        """data-NAME of the document's root, set by the page's own script."""
        found = re.search(rf'<html[^>]*\bdata-{name}="([^"]*)"', self.html)
        return None if found is None else found.group(1)


def open_page(path: Path, *, done: str = "figures") -> Seen:
    """Load a file, let its scripts run until data-DONE or data-error is set; the document then."""
    root = "document.documentElement"
    with open_chromium() as page:
        page.size(1200, 2000)
        page.open(path.resolve().as_uri())
        page.until(f"'{done}' in {root}.dataset || 'error' in {root}.dataset")
        assert page.problems() == [] or page.js(f"'error' in {root}.dataset")
        return Seen(page.js(f"{root}.outerHTML"))


def figures_of(path: Path) -> list[dict[str, Any]]:
    """The figures that a report page holds, in plotly's dict form."""
    page = path.read_text(encoding="utf-8")
    found = re.search(r'id="packed-figures">([A-Za-z0-9+/=]*)<', page)
    assert found is not None
    figures: list[dict[str, Any]] = json.loads(gzip.decompress(base64.b64decode(found.group(1))))
    return figures
