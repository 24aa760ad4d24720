"""Signs and columns of a table that an elastic body contradicts.

A body that nothing drives pushes back: the Hessian H = d(f, J'tau)/dp of its energy is symmetric,
and positive definite where the body rests stably (docs/explain/mechanics.md). A column that is
negated or exchanged breaks one of both. So every simple reading of the table
(`ecm.io.restated`) is asked how well an energy fits it, and whether a load falls along a direction
that the poses take. No model and no stated body is needed.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ecm._native import EnergyModel, left_jacobians
from ecm.errors import EcmError, InputError, Remedy
from ecm.io.arrays import B, F, evenly, rest_of
from ecm.io.columns import POSE, WRENCH
from ecm.io.description import ColumnSource
from ecm.io.restated import (
    WRENCH_REVERSED,
    Columns,
    Restatement,
    exchanges,
    in_words,
    restatements,
    signs,
)

if TYPE_CHECKING:
    from ecm.io.table import Table

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
"""Share of the error to which a reading must bring an energy."""
_MOST_ERROR = 0.2
"""Largest error over the loads at which an energy counts as fitting."""
_EQUAL = 1.5
"""Readings that leave up to so many times the least error are said as well."""
_MOST_SAID = 3


@dataclass(frozen=True)
class Misread:
    """What looks wrong with the signs or the columns of a table.

    Parameters
    ----------
    what
        The readings that mend it, in words; empty where none does.
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
    changed
        The same as (column, the stated column that it is, 1 or -1).
    """

    what: str
    columns: tuple[str, ...]
    decided: bool
    falls: tuple[str, ...] = ()
    error_stated: float | None = None
    error_mended: float | None = None
    mend: tuple[str, ...] = ()
    changed: Columns = ()

    def sentence(self) -> str:
        """Return what looks wrong and why, in plain words.

        Examples
        --------
        >>> print(Misread("the sign of fx looks reversed", ("fx_N",), False, ("fx_N",)).sentence())
        fx_N falls where its coordinate grows: the sign of fx looks reversed, or the mechanism is \
not passive there (pre-loaded, near buckling, driven)
        """
        falls = _listed(self.falls)
        grows = f"{falls} {'falls' if len(self.falls) == 1 else 'fall'} where its coordinate grows"
        if len(self.falls) > 1:
            grows = f"{falls} fall where their coordinates grow"
        if not self.decided and self.error_mended is None:
            active = "the mechanism is not passive there (pre-loaded, near buckling, driven)"
            what = self.what or "a column is misread"
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
        lists = {"columns": [*self.columns], "falls": [*self.falls], "mend": [*self.mend]}
        document = asdict(self) | lists | {"sentence": self.sentence()}
        return {name: value for name, value in document.items() if name != "changed"}


def refuse_misread(found: Misread | None, source: str) -> None:
    """Refuse a table of which one reading is proven wrong.

    Raises
    ------
    InputError
        With the reading, and the entry of [columns] that mends it.
    """
    if found is None or not found.decided:
        return
    remedy = Remedy("mend the table, then check it again", "ecm check DATA", force=True)
    if found.mend:
        entries = "\n".join(found.mend)
        remedy = Remedy(
            "mend the columns in the TOML beside the table:\n"
            f"[columns]\n{entries}\nThen check it again",
            "ecm check DATA",
            force=True,
        )
    raise InputError(
        f"{source}: {found.sentence()}. --force (force=True in Python) takes the table as it is.",
        remedy=remedy,
    )


def misread(table: Table) -> Misread | None:
    """Return what looks wrong with the signs and columns of a table; None where nothing does.

    Examples
    --------
    >>> from ecm.io.table import as_table
    >>> x = np.linspace(-1e-3, 1e-3, 20)
    >>> misread(as_table({"x_m": x, "fx_N": 1e4 * x})) is None
    True
    >>> misread(as_table({"x_m": x, "fx_N": -1e4 * x})).falls
    ('fx_N',)
    """
    rows = table.measured()
    if len(rows) == 0 or not rows.pose_columns or not rows.wrench_columns:
        return None
    found = _Readings(rows.select(evenly(len(rows), _ROWS))).found()
    if found is None:
        return found
    sources = table.meta.applied_columns
    # Where the description turns the frames, its columns are not those of the table.
    changed = [] if sources is None else [part for part in found.changed if table.has(part[1])]
    return replace(found, mend=_entries(changed, sources or {}))


def _entries(
    changed: Sequence[tuple[str, str, float]], sources: Mapping[str, ColumnSource]
) -> tuple[str, ...]:
    """Return the entries of [columns] that mend columns, in place of those that are there."""
    entries = []
    for name, stated, factor in changed:
        source = sources.get(stated, ColumnSource(stated))
        own = f'"{source.column}"' if isinstance(source.column, str) else source.column
        parts = [f"column = {own}"]
        if factor * source.scale != 1.0:
            parts.append(f"scale = {factor * source.scale!r}")
        if source.offset:
            parts.append(f"offset = {factor * source.offset!r}")
        entries.append(f"{name} = {{ {', '.join(parts)} }}")
    return tuple(entries)


class _Readings:
    """The rows of a table, and how well each reading of them is that of an elastic body."""

    def __init__(self, rows: Table) -> None:
        zeros = np.zeros(len(rows))
        names = (*POSE, *WRENCH)
        values = np.column_stack([rows.column(n) if rows.has(n) else zeros for n in names])
        self.there = np.array([bool(np.ptp(column) > 0.0) for column in values.T])
        self.poses, self.wrench = values[:, :6], values[:, 6:]
        # The origin along the axis is free in these energies; it only gives a scale.
        self.length_m = rows.meta.length_m or float(np.linalg.norm(values[:, :3].mean(axis=0)))
        if not rows.has("x_m"):
            self.poses[:, 0] = self.length_m
        self.stated_length_m = rows.meta.length_m

    @cached_property
    def of_columns(self) -> list[Restatement]:
        """The readings that negate or exchange columns that are there, the simplest first."""
        varying = {n for n, known in zip((*POSE, *WRENCH), self.there, strict=True) if known}
        return [
            item
            for item in (*signs(), *exchanges())
            if {stated for _, stated, _ in item.columns} <= varying
            or (item.words == WRENCH_REVERSED and varying & {*WRENCH})
        ]

    def found(self) -> Misread | None:
        """Return what looks wrong; None where nothing does."""
        falling = self.falls(self.poses, self.wrench)
        if self.energies:
            proven = self.proven(self.of_columns, tuple(self.energies), falling)
            if proven is not None:
                return replace(proven, decided=True)
            if self.there.all() and self.is_doubtful():
                # Without a length the axis may be any: then only what holds for any body counts.
                kinds = [k for k in self.energies if self.stated_length_m or k[0] == "general"]
                proven = self.proven(list(restatements(self.stated_length_m)), kinds, falling)
                if proven is not None:
                    return proven
        return self.either_or(falling) if falling else None

    def falls(self, poses: F, wrench: F) -> tuple[str, ...]:
        """Return the loads that fall where the poses of a reading grow."""
        return falling_loads(poses, wrench, self.there)

    @cached_property
    def energies(self) -> dict[_Kind, float]:
        """The energies whose terms these rows can tell, and their error as stated."""
        pairs = int((self.there[:6] & self.there[6:]).sum())
        if pairs < 2 or not self.length_m > 0.0:
            return {}
        found = {kind: self.error(kind, None) for kind in _ENERGIES}
        return {kind: error for kind, error in found.items() if error is not None}

    def error(self, kind: _Kind, item: Restatement | None) -> float | None:
        """Return the error of one reading; None where the rows cannot tell the terms."""
        return next((error for _, error in self.errors(kind, [item])), None)

    def errors(
        self, kind: _Kind, items: Iterable[Restatement | None]
    ) -> Iterator[tuple[Restatement | None, float]]:
        """Yield readings and the error of an energy that is fitted to each."""
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
                yield item, _error(basis[:, self.there[6:]], wrench[:, self.there[6:]])

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
        moving, loaded = self.there[:6], self.there[6:]
        free = _error_of_quadratic(self.poses[:, moving], self.wrench[:, loaded])
        return min(self.energies.values()) > _EQUAL * free

    def proven(
        self, items: Sequence[Restatement], kinds: Sequence[_Kind], falling: Sequence[str]
    ) -> Misread | None:
        """Return the readings with which an energy fits far better, and nothing falls."""
        told = [item for item in items if not item.of_pose_unit]
        best: tuple[float, list[Restatement]] = (np.inf, [])
        for kind in kinds:
            left = [(item, error) for item, error in self.errors(kind, told) if item is not None]
            best = min(best, self.right(left), key=lambda pair: pair[0])
        least, right = best
        stated = min(self.energies.values())
        if least > min(_MOST_ERROR, _MENDED * stated):
            return None
        # What falls is wrong; another origin or rotation alone may be the user's choice.
        return _misread(right, falling, decided=bool(falling), errors=(stated, least))

    def right(self, left: Sequence[tuple[Restatement, float]]) -> tuple[float, list[Restatement]]:
        """Return the least error of a reading with which nothing falls, and the readings of it."""
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

    def is_right(self, item: Restatement) -> bool:
        """Whether with a reading nothing falls, and the top stands on the stated side of the base.

        Where the length is stated this is the side of positive x.
        """
        poses, wrench = item.change(self.poses, self.wrench)
        stated, mean = self.poses[:, 0].mean(), poses[:, 0].mean()
        known = self.there[0] and abs(stated) > np.ptp(self.poses[:, 0])
        if known and mean < 0.0 < max(stated, self.stated_length_m or 0.0):
            return False
        return not self.falls(poses, wrench)

    def either_or(self, falling: Sequence[str]) -> Misread:
        """Return which sign would mend it, where the mechanism may also be one that is driven."""
        kind = next(iter(self.energies), None)
        most = np.inf if kind is None else _EQUAL * self.energies[kind]
        mending = []
        for item in self.of_columns:
            error = None if kind is None else self.error(kind, item)
            if (error is None or error <= most) and self.is_right(item):
                mending.append(item)
        whole = [item for item in mending if item.words == WRENCH_REVERSED]
        of_sign = [item for item in mending if all(factor < 0.0 for *_, factor in item.columns)]
        single = [item for item in of_sign if len(item.columns) == 1]
        # A body that is about to buckle gives way in one direction or two, and not in all.
        decided = bool(whole) and len(falling) >= 3
        return _misread(whole or single or of_sign or mending, falling, decided=decided)


def _misread(
    items: Sequence[Restatement],
    falling: Sequence[str],
    *,
    decided: bool,
    errors: tuple[float, float] | None = None,
) -> Misread:
    said = list(items)[:_MOST_SAID]
    columns = dict.fromkeys(name for item in said for name, _, _ in item.columns)
    stated, mended = errors or (None, None)
    return Misread(
        in_words(said),
        tuple(columns) or tuple(falling),
        decided,
        tuple(falling),
        stated,
        mended,
        changed=said[0].columns if len(said) == 1 else (),
    )


def _error(basis: F, wrench: F) -> float:
    """Return the error of the fitted terms (N, m, k) over the rms of each load."""
    size = _rms(wrench)
    y = (wrench / size).ravel()
    z = (basis / size[:, None]).reshape(len(y), -1)
    return _rms_left(z, y)


def _rms_left(z: F, y: F) -> float:
    """Return the rms of what columns leave of numbers, by the degrees of freedom."""
    freedom = (len(y) - z.shape[1]) * y.size // len(y)
    return float(np.sqrt((rest_of(z, y) ** 2).sum() / max(1, freedom)))


def _error_of_quadratic(poses: F, wrench: F) -> float:
    """Return the same of a wrench whose components are each any quadratic of the pose."""
    x = poses - poses.mean(axis=0)
    x = x / np.maximum(x.std(axis=0), 1e-300)
    terms = [np.ones((len(x), 1)), x]
    first, second = np.triu_indices(x.shape[1])
    if len(x) >= 2 * (1 + x.shape[1] + len(first)):
        terms.append(x[:, first] * x[:, second])
    return _rms_left(np.hstack(terms), wrench / _rms(wrench))


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


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:-1]) + f" and {names[-1]}" if len(names) > 1 else "".join(names)
