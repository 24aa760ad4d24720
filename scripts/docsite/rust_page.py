"""The page of the Rust crates, from their manifests; `make docs` puts rustdoc's pages beside it."""

from __future__ import annotations

import sys
from typing import Any

from docsite.pages import ROOT

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

_HEAD = """# Rust

The numerics are four crates. Each name leads to its pages by rustdoc, with formulas, units, errors
and examples that are run as tests; `cargo doc --no-deps --open` makes the same. A page that was
not built by `make docs` has no such folder.

| crate | what it is for |
|---|---|
"""


def page() -> str:
    """Return the page of the crates that are published."""
    rows = []
    for path in sorted((ROOT / "crates").glob("*/Cargo.toml")):
        package: dict[str, Any] = tomllib.loads(path.read_text(encoding="utf-8"))["package"]
        if package.get("publish") is not False:
            folder = package["name"].replace("-", "_")
            link = f'<a href="../rust/{folder}/index.html">{package["name"]}</a>'
            rows.append(f"| {link} | {package['description']} |")
    return _HEAD + "\n".join(rows) + "\n"
