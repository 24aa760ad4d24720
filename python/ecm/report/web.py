"""The files that every page shares: its look, and the modules that draw the mechanism in space."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

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
