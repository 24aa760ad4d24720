"""Is a table sane: its signs and columns, its units of time, its rotations, its rows.

A body that nothing drives pushes back: the Hessian H = d(f, J'tau)/dp of its energy is symmetric,
and positive definite where the body rests stably (docs/explain/mechanics.md). A column that is
negated or exchanged breaks one of both. So an energy is fitted to the table in every simple
convention (`ecm.io.conventions`), and it is asked whether a load falls along a direction that the
poses take. No model and no stated body is needed.

Rows of a continuous log that are no measurement of the mechanism are found by their own pattern, in
each run. Nothing is left out here: `ecm check` shows what was found, and `ecm check --leave-out`
records it in `[leave_out]` of the description.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ecm._native import EnergyModel, left_jacobians
from ecm.errors import EcmError, InputError, Remedy
from ecm.io.arrays import B, F, I, evenly, rest_of
from ecm.io.cache import write_atomically
from ecm.io.columns import POSE, WRENCH
from ecm.io.conventions import (
    WRENCH_REVERSED,
    Convention,
    conventions,
    exchanges,
    in_words,
    signs,
)
from ecm.io.description import (
    ColumnSource,
    read_meta,
    row_ranges,
    rows_of,
    shown_ranges,
    with_leave_out,
)
from ecm.io.frames import order_warning
from ecm.io.table import Table, read_table, unreadable_rows

_ROWS = 150
"""Rows that are compared, spread over the table."""
_Kind = tuple[Literal["alike", "revolution", "general"], int]
_ENERGIES: tuple[_Kind, ...] = (
    ("alike", 4), ("revolution", 4), ("general", 2), ("general", 3),
)  # fmt: skip
"""Energies that are asked, from a body of revolution to any body, and their degree."""
_LEAST_T = 6.0
"""A slope counts from so many standard deviations."""
_LEAST_SHARE = 0.05
"""A load falls where its work along a direction is less than minus this share of its size."""
_LEAST_SPREAD = 0.05
"""Directions whose poses spread less than this share of the widest are not judged."""
_MENDED = 0.5
"""Share of the error to which a convention must bring an energy."""
_MOST_ERROR = 0.2
"""Largest error over the loads at which an energy counts as fitting."""
_EQUAL = 1.5
"""Conventions that leave up to so many times the least error are said as well."""
_MOST_SAID = 3


@dataclass(frozen=True)
class WrongConvention:
    """What looks wrong with the signs or the columns of a table.

    Parameters
    ----------
    what
        The conventions that mend it, in words; empty where none does.
    columns
        Names of the columns in question.
    decided
        Whether the other columns prove it: else the mechanism may also be one that does not rest,
        or origins and rotations may be meant in another way.
    falls
        Loads that fall where their own coordinate grows; empty where only the energy contradicts.
    error_stated, error_mended
        Error of an energy over the size of the loads, as stated and mended; None where too few
        columns or rows are there.
    mend
        Entries of [columns] in the description that mend it; empty where none do.
    """

    what: str
    columns: tuple[str, ...]
    decided: bool
    falls: tuple[str, ...] = ()
    error_stated: float | None = None
    error_mended: float | None = None
    mend: tuple[str, ...] = ()

    def sentence(self) -> str:
        """Return what looks wrong and why, in plain words.

        Examples
        --------
        >>> wrong = WrongConvention("the sign of fx looks reversed", ("fx_N",), False, ("fx_N",))
        >>> print(wrong.sentence())
        fx_N falls where its coordinate grows: the sign of fx looks reversed, or the mechanism is \
not passive there (pre-loaded, near buckling, driven)
        """
        falls = " and ".join(filter(None, (", ".join(self.falls[:-1]), *self.falls[-1:])))
        grows = f"{falls} falls where its coordinate grows"
        if len(self.falls) > 1:
            grows = f"{falls} fall where their coordinates grow"
        if not self.decided and self.error_mended is None:
            what = self.what or "a column is wrong"
            active = "the mechanism is not passive there (pre-loaded, near buckling, driven)"
            return f"{grows}: {what}, or {active}"
        why = [grows] if self.falls else []
        if self.error_stated is not None and self.error_mended is not None:
            why.append(
                f"no elastic body has these loads as stated (an energy errs "
                f"{100 * self.error_stated:.2g} % of them, with that mended "
                f"{100 * self.error_mended:.2g} %)"
            )
        return f"{self.what}: {', and '.join(why)}"

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as plain JSON, and the sentence."""
        return asdict(self) | {"sentence": self.sentence()}

    def refusal(self, source: str) -> InputError:
        """Return the error of a table that is fitted all the same, and the entry that mends it."""
        words = "mend the table, then check it again"
        if self.mend:
            entries = "\n".join(self.mend)
            words = (
                "mend the columns in the TOML beside the table:\n"
                f"[columns]\n{entries}\nThen check it again"
            )
        return InputError(
            f"{source}: {self.sentence()}. --force (force=True in Python) takes the table as it "
            "is.",
            remedy=Remedy(words, "ecm check DATA", force=True),
        )


def wrong_convention(table: Table, *, refuse: bool = False) -> WrongConvention | None:
    """Return what looks wrong with the signs and columns of a table; None where nothing does.

    Parameters
    ----------
    refuse
        Refuse a table of which one convention is proven wrong.

    Raises
    ------
    InputError
        With the convention, and the entry of [columns] that mends it.

    Examples
    --------
    >>> from ecm.io.table import as_table
    >>> x = np.linspace(-1e-3, 1e-3, 20)
    >>> wrong_convention(as_table({"x_m": x, "fx_N": 1e4 * x})) is None
    True
    >>> wrong_convention(as_table({"x_m": x, "fx_N": -1e4 * x})).falls
    ('fx_N',)
    """
    rows = table.measured()
    if len(rows) == 0 or not rows.pose_columns or not rows.wrench_columns:
        return None
    found = _Elastic(rows.select(evenly(len(rows), _ROWS))).found()
    if refuse and found is not None and found.decided:
        raise found.refusal(table.source)
    return found


class _Elastic:
    """The rows of a table, and how well each convention of them is that of an elastic body."""

    def __init__(self, rows: Table) -> None:
        self.rows = rows
        zeros = np.zeros(len(rows))
        names = (*POSE, *WRENCH)
        values = np.column_stack([rows.column(n) if rows.has(n) else zeros for n in names])
        self.there = np.array([bool(np.ptp(column) > 0.0) for column in values.T])
        self.poses, self.wrench = values[:, :6], values[:, 6:]
        self.stated_length_m = rows.meta.length_m
        # The origin along the axis is free in these energies; it only gives a scale.
        self.length_m = self.stated_length_m or float(np.linalg.norm(values[:, :3].mean(axis=0)))
        if not rows.has("x_m"):
            self.poses[:, 0] = self.length_m

    @cached_property
    def of_columns(self) -> list[Convention]:
        """The conventions that negate or exchange columns that are there, the simplest first."""
        varying = {n for n, known in zip((*POSE, *WRENCH), self.there, strict=True) if known}
        return [
            item
            for item in (*signs(), *exchanges())
            if {stated for _, stated, _ in item.columns} <= varying
            or (item.words == WRENCH_REVERSED and varying & {*WRENCH})
        ]

    def found(self) -> WrongConvention | None:
        """Return what looks wrong; None where nothing does."""
        falling = falling_loads(self.poses, self.wrench, self.there)
        if self.energies:
            proven = self.proven(self.of_columns, tuple(self.energies), falling, decided=True)
            if proven is not None:
                return proven
            if self.there.all() and self.is_doubtful():
                # Without a length the axis may be any: then only what holds for any body counts.
                kinds = [k for k in self.energies if self.stated_length_m or k[0] == "general"]
                # What falls is wrong; another origin or rotation may be the user's choice.
                every = list(conventions(self.stated_length_m))
                proven = self.proven(every, kinds, falling, decided=bool(falling))
                if proven is not None:
                    return proven
        return self.either_or(falling) if falling else None

    @cached_property
    def energies(self) -> dict[_Kind, float]:
        """The energies whose terms these rows can tell, and their error as stated."""
        pairs = int((self.there[:6] & self.there[6:]).sum())
        if pairs < 2 or not self.length_m > 0.0:
            return {}
        return {kind: error for kind in _ENERGIES for _, error in self.errors(kind, [None])}

    def errors(
        self, kind: _Kind, items: Iterable[Convention | None]
    ) -> Iterator[tuple[Convention | None, float]]:
        """Yield conventions and the error of an energy fitted to each, where the rows can tell."""
        as_stated = self.basis(kind, self.poses)
        for item in items:
            poses, wrench = self.poses, self.wrench
            try:
                if item is not None:
                    poses, wrench = item.change(poses, wrench)
            except EcmError:
                continue
            of_pose = item is not None and item.of_pose
            basis = self.basis(kind, poses) if of_pose else as_stated
            if basis is not None:
                loads = wrench[:, self.there[6:]]
                size = _rms(loads)
                z = (basis[:, self.there[6:]] / size[:, None]).reshape(loads.size, -1)
                yield item, _rms_left(z, (loads / size).ravel())

    def basis(self, kind: _Kind, poses: F) -> F | None:
        """Return (N, 6, k) of an energy's terms; None where the rows cannot tell them."""
        symmetry, degree = kind
        try:
            terms = EnergyModel.regressor(
                poses,
                length_m=self.length_m,
                degree=degree,
                symmetry=symmetry,
                scale=EnergyModel.scale_of(poses, self.length_m),
            )
        except EcmError:
            return None
        if not np.isfinite(terms).all():
            return None
        loaded = self.there[6:]
        terms = terms[:, :, np.abs(terms[:, loaded]).max(axis=(0, 1)) > 0.0]
        return terms if 2 * terms.shape[2] <= loaded.sum() * len(poses) else None

    def is_doubtful(self) -> bool:
        """Whether every energy errs far more than a wrench that is any quadratic of the pose."""
        wrench = self.wrench[:, self.there[6:]]
        x = self.poses[:, self.there[:6]] - self.poses[:, self.there[:6]].mean(axis=0)
        x = x / np.maximum(x.std(axis=0), 1e-300)
        terms = [np.ones((len(x), 1)), x]
        first, second = np.triu_indices(x.shape[1])
        if len(x) >= 2 * (1 + x.shape[1] + len(first)):
            terms.append(x[:, first] * x[:, second])
        free = _rms_left(np.hstack(terms), wrench / _rms(wrench))
        return min(self.energies.values()) > _EQUAL * free

    def proven(
        self,
        items: Sequence[Convention],
        kinds: Sequence[_Kind],
        falling: Sequence[str],
        decided: bool,
    ) -> WrongConvention | None:
        """Return the conventions with which an energy fits far better, and nothing falls."""
        told = [item for item in items if not item.of_pose_unit]
        best: tuple[float, list[Convention]] = (np.inf, [])
        for kind in kinds:
            left = [(item, error) for item, error in self.errors(kind, told) if item is not None]
            best = min(best, self.right(left), key=lambda pair: pair[0])
        least, right = best
        stated = min(self.energies.values())
        if least > min(_MOST_ERROR, _MENDED * stated):
            return None
        return self.said(right, falling, decided, (stated, least))

    def right(self, left: Sequence[tuple[Convention, float]]) -> tuple[float, list[Convention]]:
        """Return the least error of a convention with which nothing falls, and those of it."""
        least = np.inf
        kept: list[int] = []
        for place in np.argsort([error for _, error in left], kind="stable").tolist():
            item, error = left[place]
            if error > _EQUAL * least:
                break
            if self.is_right(item):
                least = min(least, error)
                kept.append(place)
        return least, [left[place][0] for place in sorted(kept)]

    def is_right(self, item: Convention) -> bool:
        """Whether with a convention nothing falls, and the top is on the stated side of the base.

        Where the length is stated this is the side of positive x.
        """
        poses, wrench = item.change(self.poses, self.wrench)
        stated, mean = self.poses[:, 0].mean(), poses[:, 0].mean()
        known = self.there[0] and abs(stated) > np.ptp(self.poses[:, 0])
        if known and mean < 0.0 < max(stated, self.stated_length_m or 0.0):
            return False
        return not falling_loads(poses, wrench, self.there)

    def either_or(self, falling: Sequence[str]) -> WrongConvention:
        """Return which sign would mend it, where the mechanism may also be one that is driven."""
        kind = next(iter(self.energies), None)
        left: Iterable[tuple[Convention | None, float]] = ((i, 0.0) for i in self.of_columns)
        most = np.inf
        if kind is not None:
            left, most = self.errors(kind, self.of_columns), _EQUAL * self.energies[kind]
        mending = [i for i, error in left if i is not None and error <= most and self.is_right(i)]
        whole = [item for item in mending if item.words == WRENCH_REVERSED]
        of_sign = [item for item in mending if all(factor < 0.0 for *_, factor in item.columns)]
        single = [item for item in of_sign if len(item.columns) == 1]
        # A body that is about to buckle gives way in one direction or two, and not in all.
        decided = bool(whole) and len(falling) >= 3
        return self.said(whole or single or of_sign or mending, falling, decided, (None, None))

    def said(
        self,
        items: Sequence[Convention],
        falling: Sequence[str],
        decided: bool,
        errors: tuple[float | None, float | None],
    ) -> WrongConvention:
        """Return the simplest of these conventions, and the entries of [columns] of a single."""
        said = list(items)[:_MOST_SAID]
        columns = dict.fromkeys(name for item in said for name, _, _ in item.columns)
        names = tuple(columns) or tuple(falling)
        mend = self.entries(said[0]) if len(said) == 1 else ()
        return WrongConvention(in_words(said), names, decided, tuple(falling), *errors, mend)

    def entries(self, item: Convention) -> tuple[str, ...]:
        """Return the entries of [columns] that mend columns, in place of those that are there."""
        sources = self.rows.meta.applied_columns
        entries = []
        for name, stated, factor in item.columns:
            # Where the description turns the frames, its columns are not those of the table.
            if sources is None or not self.rows.has(stated):
                continue
            source = sources.get(stated, ColumnSource(stated))
            own = f'"{source.column}"' if isinstance(source.column, str) else source.column
            parts = [f"column = {own}"]
            if factor * source.scale != 1.0:
                parts.append(f"scale = {factor * source.scale!r}")
            if source.offset:
                parts.append(f"offset = {factor * source.offset!r}")
            entries.append(f"{name} = {{ {', '.join(parts)} }}")
        return tuple(entries)


def _rms_left(z: F, y: F) -> float:
    """Return the rms of what columns leave of numbers, by the degrees of freedom."""
    freedom = (len(y) - z.shape[1]) * y.size // len(y)
    return float(np.sqrt((rest_of(z, y) ** 2).sum() / max(1, freedom)))


def _rms(wrench: F) -> F:
    """(m,) root mean square of each load; the largest first, or squares would be lost."""
    largest = np.maximum(np.abs(wrench).max(axis=0), 1e-300)
    return np.asarray(largest * np.sqrt(((wrench / largest) ** 2).mean(axis=0)))


def falling_loads(poses: F, wrench: F, there: B) -> tuple[str, ...]:
    """Return the loads that fall along a direction of the poses in which their work is negative.

    The slope of all loads over all moving coordinates is taken in units of work, and only along
    directions that the poses take: poses of one load leave the others to noise.
    """
    moving, loaded = there[:6], there[6:]
    both = moving & loaded
    if not both.any():
        return ()
    loads = wrench
    if both[3:].all():
        turned = left_jacobians(np.ascontiguousarray(poses[:, 3:]))
        loads = np.hstack([wrench[:, :3], np.einsum("nji,nj->ni", turned, wrench[:, 3:])])
    x = poses[:, moving] - poses[:, moving].mean(axis=0)
    spread = _rms(x - x.mean(axis=0))
    u, s, vt = np.linalg.svd(x / spread, full_matrices=False)
    dof = len(x) - 1 - x.shape[1]
    if dof < x.shape[1] + 1:
        return ()
    taken = s > _LEAST_SPREAD * s[0]
    q = (loads[:, both] - loads[:, both].mean(axis=0)) * poses[:, both].std(axis=0)
    inverse = vt[taken].T / s[taken]
    slope = inverse @ (u[:, taken].T @ q)  # (moving, both)
    rest = q - u[:, taken] @ (u[:, taken].T @ q)
    sigma = rest.T @ rest / dof
    own = both[moving]
    # Directions taken by the poses in which only coordinates with a load of their own move.
    others = vt[taken].T[~own]
    _, w, at = np.linalg.svd(others) if len(others) else (None, np.zeros(0), np.eye(taken.sum()))
    free = at[int((w > 1e-9).sum()) :]
    directions = vt[taken].T[own] @ free.T  # (both, d)
    if directions.shape[1] == 0:
        return ()
    matrix = directions.T @ slope[own] @ directions
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    names = [name for name, is_both in zip(WRENCH, both, strict=True) if is_both]
    falling: list[str] = []
    for value, vector in zip(values, vectors.T, strict=True):
        v = directions @ vector
        of_pose = np.zeros(len(own))
        of_pose[own] = v
        variance = float(v @ sigma @ v) * float(((of_pose @ inverse) ** 2).sum())
        size = float(np.linalg.norm(slope[own].T @ v))
        if value > -_LEAST_T * np.sqrt(variance) or value > -_LEAST_SHARE * size:
            continue
        work = v * (slope[own].T @ v)
        falling += [n for n, part in zip(names, work, strict=True) if part < 0.3 * work.min()]
    return tuple(name for name in names if name in falling)


_SAMPLED_S = 0.5
"""Rows that follow each other faster are samples of a continuous test: no rest is as short."""
_SAMPLES = 100
"""So many of them are no accident."""


def samples_s(table: Mapping[str, Any]) -> float:
    """Return the step of time of rows that are likely samples of a continuous test; 0 for none.

    Examples
    --------
    >>> round(samples_s({"time_s": 0.01 * np.arange(200.0)}), 3)
    0.01
    """
    if "time_s" not in table or len(table["time_s"]) <= _SAMPLES:
        return 0.0
    steps = np.diff(table["time_s"])
    steps = steps[steps > 0.0]
    step = float(np.median(steps)) if len(steps) else 0.0
    return step if step < _SAMPLED_S else 0.0


def likely_continuous(table: Table) -> list[str]:
    """Say that rows which follow each other closely may be samples of a continuous test."""
    step = 0.0 if table.continuous or table.has("pose_id") else samples_s(table.columns)
    if not step:
        return []
    return [
        f"Rows follow each other every {step:.3g} s: samples of a continuous test? "
        'Then say kind = "continuous" in [file], or repeats and held-out rows are judged wrongly.'
    ]


_MINUTES = {"minutes": 60.0, "hours": 3600.0}


def time_unit(table: Table) -> str:
    """Return the unit that time_s seems to have where readings follow faster than they rest."""
    if not table.has("time_s", "dwell_s"):
        return ""
    time, dwell = table.column("time_s"), table.column("dwell_s")
    order = np.argsort(time, kind="stable")
    steps, rests = np.diff(time[order]), dwell[order][1:]
    known = np.isfinite(rests) & (rests > 0.0) & (steps > 0.0)
    if int(known.sum()) < 8:
        return ""
    share = float(np.median(steps[known] / rests[known]))
    meant = next((unit for unit, factor in _MINUTES.items() if factor * share >= 0.9), "")
    if share >= 0.9 or not meant:
        return ""
    return (
        f"time_s looks stated in {meant}, not s: readings follow each other faster than "
        "the mechanism rests before them (dwell_s)"
    )


def doubts(table: Table, wrong: WrongConvention | None) -> list[str]:
    """Return what looks wrong with the signs, the time and the rotations of a table."""
    said = [time_unit(table), "" if wrong is None else wrong.sentence()]
    if table.has(*POSE[3:]):
        said.append(order_warning(table.matrix(POSE[3:])))
    return [words for words in said if words]


def whole_turns(table: Table) -> list[str]:
    """Return a sentence for each angle that jumps by a whole turn between two samples."""
    sentences = []
    for name in POSE[3:]:
        if not (table.continuous and table.has(name)):
            continue
        values = table.column(name)
        # No motion turns by half a turn from one sample to the next.
        jumps = [rows[1:][np.abs(np.diff(values[rows])) > np.pi] for rows in _runs(table)]
        at = np.concatenate(jumps)
        if len(at):
            rows = shown_ranges(table.numbers_in_file[at].tolist())
            sentences.append(
                f"{name} jumps by a whole turn at row(s) {rows}: one rotation written in two ways. "
                "ecm import unwraps a single angle; effects of rate and lag would see a motion."
            )
    return sentences


_FEWEST = 50
"""Runs of fewer rows have no pattern."""
_LONGEST_START = 0.2
"""A start-up is at most this share of a run; a longer one is the test itself."""
_MARGIN, _MOVING = 0.02, 0.05
"""Shares of a channel's range: within the first it is in the range, by the second it has moved."""
_OUT = 3.0
"""So many times the longest usual stay, or the largest later step, is out of the usual."""
_RARE = 0.005
"""Share of the samples, or of the stays, at an end of their order that say nothing of the usual."""
_FOLLOWS = 0.9
"""Rank correlation of pose and wrench from which on the wrench follows the pose.

Rows of which half move without load have 7/8.
"""
_SWINGS = 2.0
"""A start goes to its place once; so many ranges of ways are loading."""
_PLATEAU, _STUCK = 4, 20
"""Fewest rows that stay at an end of the range to be clipped, and elsewhere to be stuck.

An end is reached in any case: there fewer rows suffice.
"""
_FEW, _FEW_SHARE = 15, 0.005
"""Most rows, and largest share of a run, that are said to set its range alone."""
_WIDER = 1.6
"""Range with these rows over range without them."""


@dataclass(frozen=True)
class SuspectRows:
    """Rows that were found for one reason.

    Examples
    --------
    >>> SuspectRows("clipped", "fx_N stays at 44.1", (3, 4, 5)).sentence()
    'clipped: fx_N stays at 44.1 (rows 3-5)'
    """

    reason: str
    """start_up, clipped, stuck, few_rows or repeated_time."""
    words: str
    rows: tuple[int, ...]
    """Numbers from 1, those of the table's file."""

    def sentence(self) -> str:
        """Return reason, channel and rows."""
        return f"{self.reason}: {self.words} (rows {shown_ranges(self.rows)})"


def suspect_rows(table: Table) -> list[SuspectRows]:
    """Return the rows of a continuous log that are likely no measurement, by reason.

    - start_up: the beginning of a run, until pose and wrench are first in the range of its second
      half; a rest and a first loading, which are measurements, are none;
    - clipped: several rows at exactly the largest or smallest value of a channel;
    - stuck: a channel that stays at a value while another one moves;
    - few_rows: few rows that alone set the range of a pose column;
    - repeated_time: a time stamp of an earlier row.

    Tables of static measurements have none.

    Examples
    --------
    >>> from ecm import Table
    >>> t = 0.01 * np.arange(400.0)
    >>> force = np.minimum(30.0 * np.sin(9.0 * t), 25.0)
    >>> log = {"time_s": t, "y_m": 0.01 * np.sin(9.0 * t), "fy_N": force}
    >>> table = Table(log, meta={"file": {"kind": "continuous"}})
    >>> [found.sentence() for found in suspect_rows(table)]
    ['clipped: fy_N stays at 25 (rows 12-24, 82-94, 152-164, 222-234, 292-304, 362-374)']
    """
    if not table.continuous:
        return []
    numbers = table.numbers_in_file
    found: list[SuspectRows] = []
    names = (*table.pose_columns, *table.wrench_columns)
    for rows in _runs(table):
        if len(rows) < _FEWEST:
            continue
        channels = {name: table.column(name)[rows] for name in names}
        for reason, words, own in _of_run(channels, table.column("time_s")[rows]):
            found.append(SuspectRows(reason, words, tuple(numbers[rows[own]].tolist())))
    return found


def record_leave_out(path: Path, description: Path) -> dict[str, str]:
    """Add the suspect and the unreadable rows of a table to `[leave_out]` of its description.

    Rows that it names already stay out; the rest of the description keeps every word.

    Parameters
    ----------
    path
        The table, CSV or Parquet.
    description
        Its TOML, which may not exist yet.

    Returns
    -------
    dict
        Ranges of rows by reason, as they were written.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     path = Path(folder) / "t.csv"
    ...     _ = path.write_text("x_m,fx_N\\n0,1\\n0.1,nan\\n0.2,3\\n")
    ...     record_leave_out(path, path.with_suffix(".toml"))
    {'unreadable': '2'}
    """
    meta = read_meta(description) if description.is_file() else None
    reasons: dict[str, list[int]] = {}
    if len(unreadable := unreadable_rows(path, meta)):
        reasons["unreadable"] = unreadable.tolist()
    for one in suspect_rows(read_table(path, meta=meta, skip_bad_rows=True)):
        reasons.setdefault(one.reason, []).extend(one.rows)
    for reason, ranges in ({} if meta is None else meta.leave_out).items():
        reasons.setdefault(reason, []).extend(rows_of(ranges, reason).tolist())
    found = {reason: row_ranges(rows) for reason, rows in reasons.items()}
    text = description.read_text(encoding="utf-8") if description.is_file() else ""
    if found:
        write_atomically(description, with_leave_out(text, found))
    return found


def _runs(table: Table) -> Iterator[I]:
    run = table.column("run") if table.has("run") else np.zeros(len(table))
    for number in np.unique(run):
        yield np.flatnonzero(table.of_poses & (run == number))


def _of_run(channels: Mapping[str, F], time: F) -> Iterator[tuple[str, str, I]]:
    """Reason, words and index of the rows of one run."""
    repeated = np.flatnonzero(np.diff(time) == 0.0) + 1
    if len(repeated):
        yield "repeated_time", f"{len(repeated)} time stamps of the row before", repeated
    start = _start_up(channels)
    if start:
        seconds = float(time[start] - time[0])
        yield "start_up", f"the first {seconds:.3g} s, out of the later range", np.arange(start)
    for name, values in channels.items():
        yield from _stays(name, values, channels)
        few = _few_rows(values) if name in POSE else ()
        if len(few):
            words = f"{len(few)} rows alone widen {name} to {values.min():.4g} .. "
            yield "few_rows", f"{words}{values.max():.4g}", np.asarray(few)


def _start_up(channels: Mapping[str, F]) -> int:
    """Number of rows before all channels are in the range of the second half; 0 for none."""
    size = len(next(iter(channels.values())))
    inside = {}
    for name, values in channels.items():
        low, high = np.quantile(values[size // 2 :], [_RARE, 1.0 - _RARE])
        margin = _MARGIN * (high - low)
        if high > low:
            inside[name] = (values >= low - margin) & (values <= high + margin)
    both = np.all([*inside.values(), np.ones(size, dtype=bool)], axis=0)
    first = int(np.argmax(both)) if both.any() else 0
    if not 3 <= first <= _LONGEST_START * size:
        return 0
    if any(_swings(values, first) for values in channels.values()):
        return 0
    outside = {name: channels[name] for name, own in inside.items() if not own[:first].all()}
    return 0 if _is_rest_or_loading(outside, first) else first


def _swings(values: F, first: int) -> bool:
    """Whether a channel goes up and down in the first rows: a test that was not repeated later."""
    some = values[evenly(first, _STUCK)]
    return float(np.abs(np.diff(some)).sum()) > _SWINGS * float(np.ptp(values))


def _is_rest_or_loading(channels: Mapping[str, F], first: int) -> bool:
    """Whether the first rows are a rest, or a first loading: the wrench follows the pose.

    Both are measurements, though a test that cycles about a mean load never comes back to them. A
    way to the place moves the pose alone, and a tracker that begins late jumps.
    """
    for values in channels.values():
        steps = np.abs(np.diff(values))
        if steps[:first].max() > _OUT * steps[first:].max():
            return False
    moves = {n: np.abs(v[:first] - v[0]) > _MOVING * np.ptp(v) for n, v in channels.items()}
    if not any(own.any() for own in moves.values()):
        return True
    for name in channels.keys() & {*POSE}:
        part = slice(int(np.argmax(moves[name])), first)
        if not moves[name].any() or part.stop - part.start < 3:
            continue
        pose = _ranks(channels[name][part])
        loads = [_ranks(v[part]) for n, v in channels.items() if n not in POSE]
        if any(abs(np.corrcoef(pose, load)[0, 1]) > _FOLLOWS for load in loads):
            return True
    return False


def _ranks(values: F) -> F:
    """(N,) places in order of size: what a hardening curve does not bend."""
    return np.asarray(np.argsort(np.argsort(values)), dtype=np.float64)


def _stays(name: str, values: F, channels: Mapping[str, F]) -> Iterator[tuple[str, str, I]]:
    """Plateaus at an end of the range, and long stays elsewhere while another channel moves."""
    begins = np.concatenate([[0], np.flatnonzero(np.diff(values) != 0.0) + 1])
    lengths = np.diff(np.append(begins, len(values)))
    if len(begins) < 3:
        return  # constant: said as never excited
    level = values[begins]
    ends = (values.min(), values.max())
    between = ~np.isin(level, ends)  # near a peak a coarse channel stays longer than elsewhere
    usual = float(np.quantile(lengths[between], 1.0 - _RARE)) if between.any() else len(values)
    long = lengths >= _OUT * usual
    for end in ends:
        own = long & (lengths >= _PLATEAU) & (level == end)
        if own.any():
            yield "clipped", f"{name} stays at {end:.4g}", np.flatnonzero(np.repeat(own, lengths))
    others = [other for key, other in channels.items() if key != name]
    stuck = long & (lengths >= _STUCK) & between
    for i in np.flatnonzero(stuck):
        part = slice(begins[i], begins[i] + lengths[i])
        stuck[i] = any(np.ptp(other[part]) > _MOVING * np.ptp(other) for other in others)
    if stuck.any():
        yield "stuck", f"{name} stays while others move", np.flatnonzero(np.repeat(stuck, lengths))


def _few_rows(values: F) -> I:
    """Index of few rows without which the range is much smaller."""
    most = min(_FEW, max(1, int(_FEW_SHARE * len(values))))
    order = np.argsort(values)
    full = float(values[order[-1]] - values[order[0]])
    best: I = np.zeros(0, dtype=np.int64)
    for below in range(most + 1):
        low, high = values[order[below]], values[order[below - most - 1]]
        margin = 0.1 * (high - low)  # only what is far outside: a smooth curve's next rows are near
        if margin > 0.0 and full > _WIDER * (high - low):
            outside = np.flatnonzero((values < low - margin) | (values > high + margin))
            if len(best) == 0 or 0 < len(outside) < len(best):
                best = outside
    return best
