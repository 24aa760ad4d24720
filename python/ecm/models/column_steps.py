"""What recorded columns of one's own do to the wrench, as a controller adds it step by step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from ecm.effects.beyond_physics import UnusedColumn
from ecm.io.arrays import F
from ecm.regression.rows import taken_by

_DAMPS = "it sets the damping, which has no step: --at exports it at one value of the column"


@dataclass
class ColumnSteps:
    """Constants of the effects of own columns on a map of n inputs and m outputs.

    Examples
    --------
    >>> import ecm, numpy as np
    >>> spring = ecm.fit({"x_m": [0.0, 0.1, 0.2], "fx_N": [0.0, 1.0, 2.0]}, "linear")
    >>> steps = ColumnSteps(spring.base)
    >>> steps.add(UnusedColumn("fan", 10.0, "adds", "fx_N", 2.0), np.array([0.5])), steps.names
    ('', ['fan'])
    """

    base: Any
    """The map that they act on."""
    effects: list[tuple[UnusedColumn, F]] = field(default_factory=list)
    """Each with its fitted values."""

    @property
    def names(self) -> list[str]:
        """The columns, each once."""
        return list(dict.fromkeys(effect.column for effect, _ in self.effects))

    def add(self, effect: UnusedColumn, values: F) -> str:
        """Add an effect with its fitted values, or say why it has no step."""
        if effect.acts == "damps":
            return _DAMPS
        self.effects.append((effect, values))
        return ""

    def sentence(self, ranges: Mapping[str, tuple[float, float]], header: str) -> str:
        """Which columns a header takes, with what was measured of them, and the other way."""
        listed = ", ".join(
            f"{name} (measured from {ranges[name][0]:.4g} to {ranges[name][1]:.4g})"
            if name in ranges
            else name
            for name in self.names
        )
        return (
            f"{header} adds what columns of your own do: {listed}. The control loop takes none of "
            "them. --at COLUMN=VALUE exports one at a fixed value instead."
        )

    def constants(self) -> dict[str, str]:
        """Constants for the template in C."""
        taken, outputs, names = taken_by(self.base), self.base.outputs, self.names
        rows: dict[str, list[str]] = {key: [] for key in ("OF", "TAU", "ZERO", "SHARE")}
        parts: dict[str, list[str]] = {"ADD": [], "SHIFT": []}
        for effect, values in self.effects:
            known = dict(zip(effect.outputs.split(","), values.tolist(), strict=False))
            rows["OF"].append(str(names.index(effect.column)))
            for key, value in (
                ("TAU", effect.lag_s),
                ("ZERO", effect.zero),
                ("SHARE", float(values[0]) if effect.acts == "scales" else 0.0),
            ):
                rows[key].append(f"R({float(value)!r})")
            for key, own, acts in (("ADD", outputs, "adds"), ("SHIFT", taken, "shifts")):
                used = [known.get(name, 0.0) if effect.acts == acts else 0.0 for name in own]
                parts[key].append(f"{{{', '.join(f'R({value!r})' for value in used)}}}")
        n, m = len(taken), len(outputs)
        return {key: ", ".join(values) for key, values in {**rows, **parts}.items()} | {
            "COLUMNS": ", ".join(names).replace("*/", "* /"),  # which would end the comment
            "TAKEN": ", ".join(taken),
            "C": str(len(names)),
            "E": str(len(self.effects)),
            "N": str(n),
            "M": str(m),
            "NM": str(n * m),
        }
