"""The column `action` of a plan: a word, and where it needs one a number (degrees, minutes, kg)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ecm.errors import InputError
from ecm.io.toml import did_you_mean

ARGUMENT_UNITS = {
    "measure": "",
    "home": "",
    "unload": "",
    "remount": "degrees",
    "remove_payload": "",
    "warm_up": "minutes",
    "dead_weight": "kg",
}


@dataclass(frozen=True)
class Action:
    """One action of a plan: `remount:90` is ("remount", 90.0)."""

    name: str
    value: float = 0.0

    @staticmethod
    def parse(text: str, where: str) -> Action:
        """An action cell; empty means `measure`.

        Raises
        ------
        InputError
            Naming place, what was found, and the known actions.
        """
        name, colon, rest = text.strip().partition(":")
        name = name.strip() or "measure"
        if name not in ARGUMENT_UNITS:
            raise InputError(
                f"{where}: unknown action `{text}`, {did_you_mean(name, ARGUMENT_UNITS)}"
            )
        unit = ARGUMENT_UNITS[name]
        if not unit:
            if colon:
                raise InputError(f"{where}: action `{text}` takes no value; write `{name}`")
            return Action(name)
        try:
            value = float(rest)
        except ValueError:
            value = math.nan
        if not math.isfinite(value) or (name != "remount" and value <= 0.0):
            raise InputError(
                f"{where}: action `{text}`: expected a number of {unit}, such as `{name}:10`"
            )
        return Action(name, value)
