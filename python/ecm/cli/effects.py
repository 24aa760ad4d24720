"""`ecm effects`: the catalogue."""

from __future__ import annotations

import math
import textwrap
from typing import Any

from ecm.cli.session import Session
from ecm.effects import Effect, all_effects, effects_for, get_effect, load_installed
from ecm.effects.experiments import get_experiment
from ecm.effects.registry import effects_of_actuators
from ecm.report.blocks import columns

_FEW = ("theta_z_rad", "tau_z_Nm")
"""Columns of the smallest table: effects have forms along them."""
_SIDES = {
    "physics": "acts on the controller as well",
    "measurement": "acts on the instruments alone",
}
_KINDS = {
    "pose": "a function of the pose",
    "time": "follows time, order or a covariate",
    "noise": "changes the noise alone",
}


def effects(session: Session, id: str | None = None) -> None:
    """List the physical effects that diagnose can name, or show one in full.

    Parameters
    ----------
    id : [ID]
        One effect in full.
    """
    load_installed()
    listed = list(all_effects()) if id is None else [get_effect(id)]
    session.write_json({"schema": 1, "effects": [_document(effect) for effect in listed]})
    if id is None:
        rows = [(effect.id, _first_sentence(effect.physics)) for effect in listed]
        session.print(columns(rows, header=False))
        known = {effect.id for effect in listed}
        few = [effect for effect in effects_for(_FEW) if effect.id not in known]
        also = [(effect.id, _first_sentence(effect.physics)) for effect in few]
        session.print("\nWith fewer than the twelve columns of pose and wrench also:")
        session.print(columns(also, header=False))
        of_actuators = effects_of_actuators()
        driven = [(effect.id, _first_sentence(effect.physics)) for effect in of_actuators]
        session.print("\nWith columns of actuators (pressure_1_Pa, ...) also:")
        session.print(columns(driven, header=False))
        more = len(also) + len(driven)
        session.print(
            f"\n{len(listed)} effects, and {more} more; most of those that need time have a "
            "form along the columns that exist. `ecm effects ID` shows one in full."
        )
    else:
        _print(listed[0], session)
        form = effects_for(_FEW, listed)[0]
        if form is not listed[0]:
            session.print("\nWith fewer than the twelve columns of pose and wrench:")
            session.print(_indented(form.physics))
            session.print(f"needs: {form.needs or 'nothing beside pose and wrench'}")


def _print(effect: Effect, session: Session) -> None:
    session.print(effect.id)
    session.print(_indented(effect.physics))
    session.print(f"signature: {effect.signature}" if effect.signature else "")
    session.print(f"needs: {effect.needs or 'nothing beside pose and wrench'}")
    session.print(f"side: {effect.side}, {_SIDES[effect.side]}")
    session.print(f"kind: {effect.kind}, {_KINDS[effect.kind]}")
    rows = [("parameter", "unit", "ordinary size", "from", "to")]
    for item in effect.parameters:
        ends = (f"{item.lower:g}", f"{item.upper:g}")
        rows.append((item.name, item.unit, f"{item.scale:g}", *ends))
    session.print(columns(rows))
    for rival, action in _rivals(effect).items():
        session.print(f"confused with {rival}: {action}")
    if effect.outside:
        session.print(f"  or {effect.outside.what} -> {effect.outside.apart}")


def _rivals(effect: Effect) -> dict[str, str]:
    """What separates the effect from each rival, in words."""
    return {rival: get_experiment(name).action for rival, name in effect.rivals.items()}


def _indented(text: str) -> str:
    return textwrap.fill(text, 78, initial_indent="  ", subsequent_indent="  ")


def _first_sentence(text: str) -> str:
    return text.partition(". ")[0].strip().rstrip(".")


def _document(effect: Effect) -> dict[str, Any]:
    fields = ("id", "physics", "signature", "needs", "side", "kind")
    return {name: getattr(effect, name) for name in fields} | {
        "parameters": [
            {
                "name": item.name,
                "unit": item.unit,
                "scale": item.scale,
                "lower": item.lower if math.isfinite(item.lower) else None,
                "upper": item.upper if math.isfinite(item.upper) else None,
            }
            for item in effect.parameters
        ],
        "rivals": _rivals(effect),
        "outside": {"what": effect.outside.what, "apart": effect.outside.apart},
    }
