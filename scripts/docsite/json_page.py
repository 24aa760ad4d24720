"""The page of the JSON that commands write, from the schemas that the tests validate it with."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from docsite.pages import DOCS

SCHEMAS = DOCS / "schemas"
_HEAD = """# JSON of the commands

`--json FILE` writes the result of a command; `--json -` prints it. A model file is JSON as well.
Each layout below has a [JSON Schema](https://json-schema.org) that the tests validate real outputs
with. A later version may add keys; none goes, and none changes its meaning, without a new number
in `schema`. Rows are counted from 1. Numbers that are not known are `null`.
"""


def page() -> str:
    """Return the page of all layouts."""
    parts = [_HEAD]
    for path in sorted(SCHEMAS.glob("*.json")):
        schema = json.loads(path.read_text(encoding="utf-8"))
        parts += [f"\n## {schema['title']}\n", f"[Schema](../schemas/{path.name}).\n"]
        parts += ["| key | type | meaning |", "|---|---|---|", *_rows(schema, "")]
    return "\n".join(parts) + "\n"


def _rows(schema: dict[str, Any], place: str) -> Iterator[str]:
    """A row for each key, and one for each key inside it."""
    for name, value in schema.get("properties", {}).items():
        words = value["description"]
        if "enum" in value:
            words += ": " + ", ".join(f"`{choice}`" for choice in value["enum"])
        yield f"| `{place}{name}` | {_kind(value)} | {words} |"
        yield from _rows(value, f"{place}{name}.")
        inner = value.get("items") or value.get("additionalProperties")
        if isinstance(inner, dict):
            yield from _rows(inner, f"{place}{name}[].")


def _kind(value: dict[str, Any]) -> str:
    if "const" in value:
        return f"`{json.dumps(value['const'])}`"
    kinds = value["type"]
    return " or ".join([kinds] if isinstance(kinds, str) else kinds)
