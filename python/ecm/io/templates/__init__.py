"""Commented files to begin from, in this folder; `ecm new` writes them, each valid as it stands."""

from __future__ import annotations

from importlib.resources import files

NEXT_STEP = {
    "config": "Next: ecm identify {path} --out DIR",
    "rig": "Next: ecm campaign PLAN.csv --rig {path} --out data.csv",
    "data": "Next: put your rows in, then: ecm check {path}",
}


def template(name: str) -> str:
    """Return the text of config.toml, rig.toml, data.csv or data.toml."""
    return (files(__name__) / name).read_text(encoding="utf-8")
