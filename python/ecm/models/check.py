"""`ecm check`: what a table holds, what was never excited, and which effects it can test."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecm.effects import Effect, effects_of
from ecm.effects.protocol import missing_beside_columns
from ecm.io.columns import KINDS, POSE, TEXT, WRENCH, is_standard
from ecm.io.conventions import WrongConvention
from ecm.io.events import Printed, Progress, Steps, fields_json, tell_part
from ecm.io.extras import require
from ecm.io.sanity import (
    SuspectRows,
    doubts,
    excitation_sentences,
    never_excited,
    suspect_rows,
    unstated,
    whole_turns,
    zero_column_sentences,
    zero_columns,
)
from ecm.io.table import MetaLike, Table, TableLike, need_a_pose, takes_table
from ecm.models.actuated import misread
from ecm.regression.blas import one_blas_thread
from ecm.regression.folds import repeated_poses
from ecm.regression.history import has_order
from ecm.regression.noise import noise_source
from ecm.report.blocks import CodeBlock, Report, Section, TableBlock, TextBlock

_COLUMNS, _TESTABLE, _REPEATS, _SUSPECT = (
    "columns", "testable effects", "repeats", "rows that are no measurements",
)  # fmt: skip
_UNITS = ("degC", "Nm", "rad", "N", "m", "s", "Pa", "m3")


@dataclass(frozen=True)
class ColumnCheck:
    """One column: what it is and what it spans."""

    name: str
    unit: str
    role: str
    """pose, wrench, covariate, text, or standard for the rest."""
    minimum: float | None = field(metadata={"json": "min"})
    maximum: float | None = field(metadata={"json": "max"})
    distinct: int
    unknown: int
    """Empty cells."""

    @property
    def constant(self) -> bool:
        """Whether all known values are the same."""
        return self.distinct <= 1

    def cells(self) -> list[str]:
        """Return its row in the table of a report."""
        ends = ["" if end is None else f"{end:.4g}" for end in (self.minimum, self.maximum)]
        what = self.role + ", constant" * self.constant
        what += f", {self.unknown} unknown" if self.unknown else ""
        return [self.name, self.unit, *ends, str(self.distinct), what]


@dataclass(frozen=True)
class NotTestable:
    """An effect that these data cannot test, why, and what to record."""

    id: str
    reason: str
    record: str


_MOST_LINES = 6
_MOST_NAMES = 6


def lines_by_reason(listed: Sequence[NotTestable]) -> list[str]:
    """At most six lines of effects and what to record, the most frequent reason first.

    Of a long group the first names are there, and their number. The last line has each remaining
    effect beside what it needs.

    Examples
    --------
    >>> listed = [NotTestable("ageing", "no time", "time_s"), NotTestable("set", "no time", "")]
    >>> lines_by_reason(listed)
    ['  no time: ageing, set -> time_s']
    """
    groups: dict[str, list[NotTestable]] = {}
    for item in listed:
        groups.setdefault(item.reason, []).append(item)
    ordered = sorted(groups.items(), key=lambda group: -len(group[1]))
    own = len(ordered) if len(ordered) <= _MOST_LINES else _MOST_LINES - 1
    lines = []
    for reason, items in ordered[:own]:
        names = ", ".join(item.id for item in items[:_MOST_NAMES])
        if len(items) > _MOST_NAMES:
            names += f" and {len(items) - _MOST_NAMES} more (all in --json)"
        records = dict.fromkeys(item.record for item in items if item.record)
        lines.append(f"  {reason}: {names} -> {', or '.join(records)}")
    if ordered[own:]:
        pairs = [f"{', '.join(i.id for i in own)} -> {own[0].record}" for _, own in ordered[own:]]
        lines.append(f"  each for its own reason (--json): {'; '.join(pairs)}")
    return lines


@dataclass(frozen=True, repr=False)
class Check(Printed):
    """What a table holds and what it can test; `print` shows it in plain words."""

    source: str
    rows: int
    kinds: dict[str, int]
    """Number of rows of each kind."""
    runs: int
    columns: tuple[ColumnCheck, ...]
    never_excited: tuple[str, ...]
    """Pose and wrench columns that are constant: nothing can be learnt about them."""
    zero_columns: tuple[str, ...] = field(metadata={"json": "padding"})
    """Pose and wrench columns that are 0 in every row: left out when effects are tested."""
    missing: tuple[str, ...]
    """Pose and wrench columns that are not there."""
    groups: int | None
    repeated_poses: int
    """Poses that were visited more than once."""
    noise: str
    """Where the noise floor will come from: repeats, declared or assumed."""
    testable: tuple[str, ...]
    not_testable: tuple[NotTestable, ...]
    warnings: tuple[str, ...]
    suspect: tuple[SuspectRows, ...] = ()
    """Rows of a continuous log that are likely no measurement."""
    misread: WrongConvention | None = None
    """What looks wrong with the signs or the columns; its sentence is among the warnings."""
    remarks: tuple[str, ...] = ()
    """What else a continuous log shows, in sentences."""

    def to_dict(self) -> dict[str, Any]:
        """Return the report as plain JSON."""
        return {"schema": 1} | fields_json(self) | {"noise": {"source": self.noise}}

    def __str__(self) -> str:
        return "\n".join(self.sentences())

    def report(self) -> Report:
        """Return what the command prints and its page shows."""
        header = ("column", "unit", "from", "to", "distinct", "what")
        effects = TextBlock(", ".join(self.testable) or "none")
        lines = "\n".join(lines_by_reason(self.not_testable)) or "none"
        sections = [
            Section("Table", [TextBlock(sentence) for sentence in self.sentences()]),
            Section("Columns", [TableBlock("", header, [own.cells() for own in self.columns])]),
            Section(f"Testable effects ({len(self.testable)})", [effects]),
            Section("Not testable with these columns", [CodeBlock("", lines)]),
        ]
        return Report("Check of a table", self.source, sections, self.warnings)

    def to_pandas(self) -> Any:
        """Return a DataFrame with a row for each column of the table."""
        rows = [fields_json(column) for column in self.columns]
        return require("pandas", "data", "Check.to_pandas").DataFrame(rows).set_index("name")

    def sentences(self) -> list[str]:
        """Return what matters, in plain words."""
        return list(self._sentences())

    def _sentences(self) -> Iterator[str]:
        yield f"{self.source}: {self.rows} rows in {self.runs} run{'s' * (self.runs != 1)}."
        yield from excitation_sentences(self.never_excited)
        if len(self.missing) == len(POSE) + len(WRENCH):
            yield (
                "No pose and no wrench column is there: nothing can be fitted, compared or "
                "diagnosed. Name at least one of each as in x_m and fx_N, or map your own names in "
                "the TOML beside the data ([columns])."
            )
        elif self.missing:
            yield f"Not there: {', '.join(self.missing)}."
        if self.groups is not None:
            yield f"Held-out splits keep {self.groups} groups of rows together."
        n = self.repeated_poses
        why = f"repeats of {n} pose{'s' * (n != 1)} are too few" if n else "no pose is repeated"
        yield _NOISE_WORDS[self.noise].format(n=n, why=why)
        yield from self.remarks
        if self.suspect:
            yield "Likely no measurements (ecm check --leave-out leaves them out for good):"
            yield from (f"  {found.sentence()}" for found in self.suspect)


_NOISE_WORDS = {
    "repeats": "The noise floor comes from {n} repeated poses.",
    "declared": "The noise floor comes from [instrument]: {why}.",
    "assumed": (
        "The noise floor is that of the model's own data, or assumed: {why}, and [instrument] "
        "lacks a figure for some of the columns (or all figures are 0)."
    ),
}


@takes_table()
@one_blas_thread()
def check(table: TableLike, *, meta: MetaLike = None, progress: Progress | None = None) -> Check:
    """Check columns, excitation, repeats and testable effects of a measurement table.

    Parameters
    ----------
    table
        Measurements, as a table, a data frame, a dict or a file.
    meta
        Description of the data, as a dict of what the TOML beside it would hold, or that file.
    progress
        Called with the part that is done, the whole, and the step that goes on.

    Examples
    --------
    >>> import ecm
    >>> result = ecm.check({"x_m": [0.0, 1e-3, 2e-3], "fx_N": [0.0, 9.0, 21.0]})
    >>> result.noise, result.never_excited
    ('assumed', ())
    """
    need_a_pose(table)
    steps = Steps({_COLUMNS: 2, _TESTABLE: 6, _REPEATS: 2, _SUSPECT: 2}, progress)
    steps.begin(_COLUMNS)
    columns = tuple(_column(name, values) for name, values in table.columns.items())
    missing = [name for name in (*POSE, *WRENCH) if not table.has(name)]
    kind = table.text("kind")
    kinds = {name: int(np.count_nonzero(kind == name)) for name in KINDS}
    kinds["pose"] = int(table.of_poses.sum())
    groups = table.groups()
    zeros = zero_columns(table)
    tried = table.drop(*zeros)
    effects = effects_of(tried)
    not_testable = tuple(_lacking(effects, tried, steps.within(_TESTABLE)))
    lacking = {one.id for one in not_testable}
    steps.begin(_REPEATS)
    repeated, noise = repeated_poses(table), noise_source(table)
    steps.begin(_SUSPECT)
    wrong = misread(table)
    return Check(
        source=table.source,
        rows=len(table),
        kinds={name: count for name, count in kinds.items() if count},
        runs=len(np.unique(table.column("run"))) if table.has("run") else 1,
        columns=columns,
        never_excited=never_excited(table),
        zero_columns=zeros,
        missing=tuple(missing),
        groups=None if groups is None else len(np.unique(groups)),
        repeated_poses=repeated,
        noise=noise,
        testable=tuple(effect.id for effect in effects if effect.id not in lacking),
        not_testable=not_testable,
        warnings=(*table.warnings, *doubts(table, wrong)),
        suspect=tuple(suspect_rows(table)),
        misread=wrong,
        remarks=(*zero_column_sentences(zeros), *_sampling(table), *whole_turns(table)),
    )


def _sampling(table: Table) -> list[str]:
    """Say that the table may be a continuous test, or in which order its rows are taken."""
    if not table.has("time_s") and has_order(table):
        return [
            "No time_s: the rows go step by step, so their order is taken as that of measuring."
        ]
    return unstated(table)


def _column(name: str, values: NDArray[Any]) -> ColumnCheck:
    if name in TEXT:
        known = [value for value in values.tolist() if value]
        return ColumnCheck(name, "", "text", None, None, len(set(known)), len(values) - len(known))
    numbers = values[np.isfinite(values)]
    role = "standard" if is_standard(name) else "covariate"
    role = "pose" if name in POSE else "wrench" if name in WRENCH else role
    unit = name.rpartition("_")[2]
    return ColumnCheck(
        name=name,
        unit=unit.replace("Nm", "N m") if unit in _UNITS and unit != name else "",
        role=role,
        minimum=float(numbers.min()) if len(numbers) else None,
        maximum=float(numbers.max()) if len(numbers) else None,
        distinct=len(np.unique(numbers)),
        unknown=len(values) - len(numbers),
    )


def _lacking(
    effects: Sequence[Effect], table: Table, progress: Progress | None
) -> Iterator[NotTestable]:
    """Yield the effects that the table cannot test, with reason and remedy."""
    for i, effect in enumerate(effects):
        tell_part(progress, i, len(effects))
        missing = effect.missing(table) or missing_beside_columns(effect, table)
        if missing is not None:
            yield NotTestable(effect.id, missing.reason, missing.record)
