"""Commented files to begin from, in this folder; `ecm new` writes them, each valid as it stands."""

from __future__ import annotations

from importlib.resources import files

NEXT_STEP = {
    "config": "Next: ecm identify {path} --out DIR",
    "arm": "Next: ecm identify {path} --out DIR",
    "rig": "Next: ecm campaign PLAN.csv --rig {path} --out data.csv",
    "bench": "Next: ecm measure PLAN.csv --rig {path} --out data.csv --dry-run",
    "data": "Next: put your rows in, then: ecm check {path}",
}
DEGREES_OF_FREEDOM = (1, 3, 6)
"""Tables of measurements: one angle and one torque, three of each, all six poses and wrenches."""


def template(name: str) -> str:
    """Return the text of a file of this folder, such as config.toml or rig.toml."""
    return (files(__name__) / name).read_text(encoding="utf-8")


def data_template(dof: int) -> str:
    """Return the text of a table of measurements with so many degrees of freedom."""
    return template("data.csv" if dof == 6 else f"data_{dof}.csv")


def description_template(dof: int) -> str:
    """Return the text of the description beside `data_template`."""
    return template("data.toml" if dof == 6 else "data_few.toml")
