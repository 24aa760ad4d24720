"""`ecm effects`: the catalogue."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ecm.cli.console import Console
from ecm.cli.options import HiddenSeed, HiddenThreads, Json, Quiet, load_effects, output, save_json
from ecm.cli.text import columns

if TYPE_CHECKING:
    from ecm.effects import Effect

_SIDES = {
    "physics": "acts on the controller as well",
    "measurement": "acts on the instruments alone",
}
_KINDS = {
    "pose": "a function of the pose",
    "time": "follows time, order or a covariate",
    "noise": "changes the noise alone",
}


def add_to(app: typer.Typer) -> None:
    """Make the command known."""
    app.command("effects", short_help="The physical effects that can be named.")(effects)


def effects(
    *,
    id: Annotated[str | None, typer.Argument(metavar="[ID]", help="One effect in full.")] = None,
    json: Json = None,
    seed: HiddenSeed = 0,
    threads: HiddenThreads = 0,
    quiet: Quiet = False,
) -> None:
    """The physical effects that diagnose can name."""
    from ecm.effects import all_effects, get_effect

    with Console(quiet=quiet) as console:
        output(json)
        load_effects()
        found = list(all_effects()) if id is None else [get_effect(id)]
        save_json(json, {"schema": 1, "effects": [_document(effect) for effect in found]})
        if id is None:
            rows = [(effect.id, _first_sentence(effect.physics)) for effect in found]
            console.say(columns(rows, header=False))
            console.say(f"\n{len(found)} effects. `ecm effects ID` shows one in full.")
        else:
            _print(found[0], console)


def _print(effect: Effect, console: Console) -> None:
    console.say(effect.id)
    console.say(textwrap.fill(effect.physics, 78, initial_indent="  ", subsequent_indent="  "))
    console.say(f"signature: {effect.signature}" if effect.signature else "")
    console.say(f"needs: {_needs(effect)}")
    console.say(f"side: {effect.side}, {_SIDES[effect.side]}")
    console.say(f"kind: {effect.kind}, {_KINDS[effect.kind]}")
    rows = [("parameter", "unit", "ordinary size", "from", "to")]
    for item in effect.parameters:
        ends = (f"{item.lower:g}", f"{item.upper:g}")
        rows.append((item.name, item.unit, f"{item.scale:g}", *ends))
    console.say(columns(rows))
    for rival, action in _rivals(effect).items():
        console.say(f"confused with {rival}: {action}")


def _rivals(effect: Effect) -> dict[str, str]:
    """Return what separates the effect from each rival, in words."""
    from ecm.effects.experiments import get_experiment

    return {rival: get_experiment(name).action for rival, name in effect.rivals.items()}


def _needs(effect: Effect) -> str:
    return effect.needs or "nothing beside pose and wrench"


def _first_sentence(text: str) -> str:
    return text.partition(". ")[0].strip().rstrip(".")


def _document(effect: Effect) -> dict[str, Any]:
    return {
        "id": effect.id,
        "physics": effect.physics,
        "signature": effect.signature,
        "needs": effect.needs,
        "side": effect.side,
        "kind": effect.kind,
        "parameters": [
            {
                "name": item.name,
                "unit": item.unit,
                "scale": item.scale,
                "lower": _bound(item.lower),
                "upper": _bound(item.upper),
            }
            for item in effect.parameters
        ],
        "rivals": _rivals(effect),
    }


def _bound(value: float) -> float | None:
    return value if abs(value) < float("inf") else None
