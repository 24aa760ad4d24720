"""Effect template: a first draft of a user's effect, from the variables of the residual."""

from __future__ import annotations

import json
from collections.abc import Sequence

from ecm.io.columns import unit_of

_STANDARD = {"approach": "sides(rows.table)", "row": "np.arange(len(rows))"}


def effect_template(terms: Sequence[tuple[Sequence[str], str]], outputs: Sequence[str]) -> str:
    """Return Python text of ten lines that registers an effect.

    Parameters
    ----------
    terms
        (factors, component) pairs, such as (("time_s", "x_m"), "fx_N"); no factor: a constant.
    outputs
        Wrench columns of the base.
    """
    factors, component = terms[0] if terms else ((), outputs[0])
    feature = "*".join(factors) or "constant"
    unit = _unit(component, factors)
    columns = sorted(set(factors) - {"row"})
    kind = ', kind="time"' if "row" in factors else ""
    extra = ", sides" if "approach" in factors else ""
    value = " * ".join(_value(name) for name in factors) or "1.0"
    index = list(outputs).index(component)
    return "\n".join(
        [
            "import numpy as np",
            f"from ecm.effects import effect{extra}",
            "",
            f'@effect("my_effect", physics={_quoted(f"{component} follows {feature}.")}, '
            f'parameters={{"size": {_quoted(unit)}}}, needs={tuple(columns)!r}{kind})',
            "def my_effect(rows):",
            *(
                ["    def u(name): v = rows.table.column(name); return v - v.mean()"]
                if any(name not in _STANDARD for name in factors)
                else []
            ),
            f"    columns = np.zeros((len(rows), {len(outputs)}))",
            f"    columns[:, {index}] = {value}",
            "    return columns",
            "",
        ]
    )


def _unit(component: str, factors: Sequence[str]) -> str:
    """Return 'N/(s m)': the component's unit over the units at the end of the factors' names."""
    over = [name.rsplit("_", 1)[1] for name in factors if "_" in name and name not in _STANDARD]
    force = unit_of(component)
    if not over:
        return force
    return f"{force}/{over[0]}" if len(over) == 1 else f"{force}/({' '.join(over)})"


def _value(name: str) -> str:
    if name in _STANDARD:
        return _STANDARD[name]
    return f"u({_quoted(name)})"


def _quoted(text: str) -> str:
    """Return a Python string literal: names come from data files and must stay text."""
    return json.dumps(text, ensure_ascii=False)
