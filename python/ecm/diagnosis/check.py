"""`ecm check`: what a table holds, what was never excited, and which effects it can test."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecm.io.columns import POSE, TEXT, WRENCH, is_standard
from ecm.io.table import Table
from ecm.regression.repeats import noise_source, repeated_poses

_UNITS = ("degC", "Nm", "rad", "N", "m", "s")
_STILL = 1e-12
"""A column that spans less than this share of its size is constant."""


@dataclass(frozen=True)
class ColumnCheck:
    """One column: what it is and what it spans."""

    name: str
    unit: str
    role: str
    """pose, wrench, covariate, text, or standard for the rest."""
    minimum: float | None
    maximum: float | None
    distinct: int
    unknown: int
    """Empty cells."""

    @property
    def constant(self) -> bool:
        """Whether all known values are the same."""
        return self.distinct <= 1


@dataclass(frozen=True)
class Check:
    """The report of `ecm check`."""

    source: str
    rows: int
    kinds: dict[str, int]
    runs: int
    columns: tuple[ColumnCheck, ...]
    never_excited: tuple[str, ...]
    """Pose and wrench columns that are constant: nothing can be learnt about them."""
    missing: tuple[str, ...]
    """Pose and wrench columns that are not there."""
    groups: int | None
    repeated_poses: int
    """Poses that were visited more than once."""
    noise: str
    """Where the noise floor will come from: repeats, declared or assumed."""
    testable: tuple[str, ...]
    not_testable: tuple[tuple[str, str, str], ...]
    """(effect, reason, what to record)."""
    warnings: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON."""
        return {
            "schema": 1,
            "source": self.source,
            "rows": self.rows,
            "kinds": self.kinds,
            "runs": self.runs,
            "columns": [
                {
                    "name": column.name,
                    "unit": column.unit,
                    "role": column.role,
                    "min": column.minimum,
                    "max": column.maximum,
                    "distinct": column.distinct,
                    "unknown": column.unknown,
                }
                for column in self.columns
            ],
            "never_excited": list(self.never_excited),
            "missing": list(self.missing),
            "groups": self.groups,
            "repeated_poses": self.repeated_poses,
            "noise": {"source": self.noise},
            "testable": list(self.testable),
            "not_testable": [
                {"id": id, "reason": reason, "record": record}
                for id, reason, record in self.not_testable
            ],
            "warnings": list(self.warnings),
        }

    def sentences(self) -> list[str]:
        """What matters, in plain words."""
        said = [f"{self.source}: {self.rows} rows in {self.runs} run{'s' * (self.runs != 1)}."]
        said.extend(excitation_sentences(self.never_excited))
        if self.missing:
            said.append(f"Not there: {', '.join(self.missing)}.")
        if self.groups is not None:
            said.append(f"Held-out splits keep {self.groups} groups of rows together.")
        n = self.repeated_poses
        why = f"repeats of {n} pose{'s' * (n != 1)} are too few" if n else "no pose is repeated"
        said.append(_NOISE_WORDS[self.noise].format(n=n, why=why))
        return said


_NOISE_WORDS = {
    "repeats": "The noise floor comes from {n} repeated poses.",
    "declared": "The noise floor comes from [instrument]: {why}.",
    "assumed": (
        "The noise floor is that of the model's own data, or assumed: {why}, and [instrument] "
        "lacks a figure for some of the columns (or all figures are 0)."
    ),
}
_WORDS = {
    **dict(zip(POSE, ("x position", "y position", "z position"), strict=False)),
    **{f"theta_{axis}_rad": f"{axis} rotation" for axis in "xyz"},
    **{f"f{axis}_N": f"{axis} force" for axis in "xyz"},
    **{f"tau_{axis}_Nm": f"{axis} torque" for axis in "xyz"},
}


def never_excited(table: Table) -> tuple[str, ...]:
    """Pose and wrench columns that are constant over the measured poses."""
    measured = table.measured()
    names = (*measured.pose_columns, *measured.wrench_columns)
    return tuple(name for name in names if _is_constant(measured.column(name)))


def excitation_sentences(names: Sequence[str]) -> list[str]:
    """One sentence for each column that is never excited."""
    return [
        f"The {_WORDS.get(name, name)} ({name}) is never excited: nothing can be learnt about it."
        for name in names
    ]


def check(table: Table) -> Check:
    """Columns, excitation, repeats and testable effects of a measurement table."""
    columns = tuple(_column(name, values) for name, values in table.columns.items())
    still = never_excited(table)
    missing = [name for name in (*POSE, *WRENCH) if not table.has(name)]
    kind = table.text("kind")
    kinds = {
        name: int(np.count_nonzero((kind == name) | ((kind == "") & (name == "pose"))))
        for name in ("pose", "home", "unloaded")
    }
    groups = table.groups()
    testable, not_testable = _effects(table, still)
    return Check(
        source=table.source,
        rows=len(table),
        kinds={name: count for name, count in kinds.items() if count},
        runs=len(np.unique(table.column("run"))) if table.has("run") else 1,
        columns=columns,
        never_excited=still,
        missing=tuple(missing) if len(missing) < 12 else (),
        groups=None if groups is None else len(np.unique(groups)),
        repeated_poses=repeated_poses(table),
        noise=noise_source(table),
        testable=testable,
        not_testable=not_testable,
        warnings=table.warnings,
    )


def _column(name: str, values: NDArray[Any]) -> ColumnCheck:
    if name in TEXT:
        known = [value for value in values.tolist() if value]
        return ColumnCheck(name, "", "text", None, None, len(set(known)), len(values) - len(known))
    numbers = values[np.isfinite(values)]
    role = "standard"
    if name in POSE or name in WRENCH:
        role = "pose" if name in POSE else "wrench"
    elif not is_standard(name):
        role = "covariate"
    return ColumnCheck(
        name=name,
        unit=next((unit for unit in _UNITS if name.endswith(f"_{unit}")), "").replace("Nm", "N m"),
        role=role,
        minimum=float(numbers.min()) if len(numbers) else None,
        maximum=float(numbers.max()) if len(numbers) else None,
        distinct=len(np.unique(numbers)),
        unknown=len(values) - len(numbers),
    )


def _is_constant(values: NDArray[np.float64]) -> bool:
    return bool(np.ptp(values) <= _STILL * np.max(np.abs(values)))


def _effects(
    table: Table, still: Sequence[str]
) -> tuple[tuple[str, ...], tuple[tuple[str, str, str], ...]]:
    """The ids that the table's columns allow, and the others with reason and remedy."""
    from ecm.effects import all_effects

    testable: list[str] = []
    not_testable: list[tuple[str, str, str]] = []
    for effect in all_effects():
        missing = effect.missing(table)
        if missing is not None:
            not_testable.append((effect.id, missing.reason, missing.record))
        elif still:
            not_testable.append((effect.id, f"{still[0]} is never excited", f"vary {still[0]}"))
        else:
            testable.append(effect.id)
    return tuple(testable), tuple(not_testable)
