"""Conventions in which a user may have meant a table: signs, axes, units, points, rotations.

Each is a sentence, what looks wrong, and a change, which gives pose and wrench as they were meant.
Who asks which one holds fits something to every one of them: the diagnosis its base or the model
that was given, and `wrong_convention` an energy. A body that nothing drives pushes back: the
Hessian H = d(f, J'tau)/dp of its energy is symmetric, and positive definite where the body rests
stably (docs/explain/mechanics.md). A column that is negated or exchanged breaks one of both: no
energy has such loads, or a load falls along a direction that the poses take. No model and no stated
body is needed.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property, partial
from typing import Any, Literal

import numpy as np

from ecm._native import EnergyEvaluator, left_jacobians, rotation_matrices, rotation_vectors
from ecm.errors import EcmError, InputError, Remedy
from ecm.io.arrays import B, F, evenly, rest_of
from ecm.io.columns import POSE, WRENCH, factor_of
from ecm.io.description import ColumnSource, changed
from ecm.io.se3 import ORDERS, read_in_other_order, rotate, rotation, transpose, turn_wrench
from ecm.io.settings import toml_value
from ecm.io.table import Table

Change = Callable[[F, F], tuple[F, F]]
"""(poses (N, 6), wrenches (N, 6)) as stated -> the same as they may have been meant."""

Columns = tuple[tuple[str, str, float], ...]
"""(column, the stated column that it is, 1 or -1) of each column that changes."""

WRENCH_REVERSED = "the wrench's sign looks reversed"
"""Words of the convention in which the reaction was written down."""
_SINGLE = 9
"""Turns about one axis, which come first."""


@dataclass(frozen=True)
class Convention:
    """What looks wrong with a table, and the change that mends it."""

    words: str
    change: Change
    of_pose: bool
    """Whether the poses change, so that the columns of a base change as well."""
    of_pose_unit: bool = False
    """Whether the poses only get another size."""
    columns: Columns = ()
    """The columns that change, where some are only negated, exchanged, or in another unit."""


def conventions(length_m: float | None) -> Iterator[Convention]:
    """Yield the conventions that users take for the table's, the simplest first.

    Parameters
    ----------
    length_m
        Length of the mechanism, for positions from its other end; None where it is not known.
    """
    yield from signs()
    yield from exchanges()
    yield from _units()
    yield from _axes()
    yield from _points(length_m)
    yield from _rotations()


def rarer_conventions() -> Iterator[Convention]:
    """Yield more that only a model with fixed numbers tells: powers of ten, and the tool's axes.

    A sensor that moves with the top has its own axes: turned, reversed or exchanged there, the
    wrench in base axes is wrong in another way at each pose.
    """
    yield _scaled("the positions look 10 times too large", position=0.1)
    yield _scaled("the positions look 1000 times too small", position=1e3)
    yield _scaled("the torque looks 1000 times too small", torque=1e3)
    for item in (*signs(), *exchanges(), *_axes()):
        if not item.of_pose:
            words = f"{item.words}, in the axes of the tool"
            yield replace(item, words=words, change=_in_tool(item.change), columns=())


def _in_tool(change: Change) -> Change:
    return lambda poses, wrench: _from_top(poses, change(*_to_top(poses, wrench))[1])


def signs() -> Iterator[Convention]:
    """Yield what a reversed sign mends: of the wrench, of the pose, of one column."""
    groups = (
        (WRENCH_REVERSED, WRENCH),
        ("the force's sign looks reversed", WRENCH[:3]),
        ("the torque's sign looks reversed", WRENCH[3:]),
        ("the pose's sign looks reversed", POSE),
        ("the position's sign looks reversed", POSE[:3]),
        ("the rotation looks transposed (its sign reversed)", POSE[3:]),
        *((f"the sign of {_short(name)} looks reversed", (name,)) for name in (*WRENCH, *POSE)),
    )
    for words, names in groups:
        yield of_columns(words, {name: (name, -1.0) for name in names})


def exchanges() -> Iterator[Convention]:
    """Yield what an exchange of columns mends: two of one quantity, or of all of wrench or pose."""
    pairs = list(itertools.combinations(range(3), 2))
    for quantity in (WRENCH[:3], WRENCH[3:], POSE[:3], POSE[3:]):
        for a, b in pairs:
            words = f"{_short(quantity[a])} and {_short(quantity[b])} look exchanged"
            yield of_columns(words, _exchanged(quantity, (a, b)))
    for names, word in ((WRENCH, "wrench"), (POSE, "pose")):
        for a, b in pairs:
            words = f"the columns {'xyz'[a]} and {'xyz'[b]} of the {word} look exchanged"
            yield of_columns(words, _exchanged(names, (a, b), (a + 3, b + 3)))
    three = _exchanged(WRENCH, (0, 3), (1, 4), (2, 5))
    yield of_columns("the force and torque columns look exchanged", three)


def of_columns(words: str, changed: Mapping[str, tuple[str, float]]) -> Convention:
    """Return the convention in which some columns are others, or negated.

    Parameters
    ----------
    words
        What looks wrong.
    changed
        The stated column and its factor, by the column that it is.

    Examples
    --------
    >>> item = of_columns("y and z look exchanged", {"y_m": ("z_m", 1.0), "z_m": ("y_m", 1.0)})
    >>> item.change(np.array([[0.1, 0.2, 0.3, 0.0, 0.0, 0.0]]), np.zeros((1, 6)))[0]
    array([[0.1, 0.3, 0.2, 0. , 0. , 0. ]])
    """
    names = (*POSE, *WRENCH)
    places, factors = np.arange(len(names)), np.ones(len(names))
    for name, (stated, factor) in changed.items():
        places[names.index(name)], factors[names.index(name)] = names.index(stated), factor

    def change(poses: F, wrench: F) -> tuple[F, F]:
        taken = np.hstack([poses, wrench])[:, places] * factors
        return np.ascontiguousarray(taken[:, : len(POSE)]), taken[:, len(POSE) :]

    of_pose = any(name in POSE for name in changed)
    columns = tuple((name, *source) for name, source in changed.items())
    return Convention(words, change, of_pose, columns=columns)


def in_words(items: list[Convention]) -> str:
    """Return conventions of which each is as likely in words.

    Examples
    --------
    >>> in_words([item for item in signs() if item.columns[0][0] == "fx_N"][-1:])
    'the sign of fx looks reversed'
    >>> in_words([item for item in signs() if len(item.columns) == 1][:2])
    'the sign of fx or of fy looks reversed'
    """
    begin, end = "the sign of ", " looks reversed"
    if all(item.words.startswith(begin) and item.words.endswith(end) for item in items) and items:
        names = (item.words.removeprefix(begin).removesuffix(end) for item in items)
        return f"{begin}{' or of '.join(names)}{end}"
    return " or ".join(item.words for item in items)


def _exchanged(names: tuple[str, ...], *pairs: tuple[int, int]) -> dict[str, tuple[str, float]]:
    """The columns of these pairs in each other's place: stated column and factor by column."""
    both = {a: b for pair in pairs for a, b in (pair, pair[::-1])}
    return {names[a]: (names[both[a]], 1.0) for a in sorted(both)}


def _short(name: str) -> str:
    return name.rsplit("_", 1)[0]


def _units() -> Iterator[Convention]:
    for unit in ("N mm", "N cm", "kgf cm", "lbf in", "lbf ft"):
        yield _scaled(f"the torque looks stated in {unit}, not N m", torque=factor_of(unit))
    for unit in ("kN", "mN", "gf", "kgf", "lbf"):
        yield _scaled(f"the force looks stated in {unit}, not N", force=factor_of(unit))
    yield _scaled("the positions look stated in mm, not m", position=1e-3)
    yield _scaled("the positions look stated in cm, not m", position=1e-2)
    yield _scaled("the angles look stated in degrees, not rad", angle=np.pi / 180)
    yield _scaled("the angles look divided by 57.3 once too often", angle=180 / np.pi)


_PARTS = {
    "position": POSE[:3], "angle": POSE[3:], "force": WRENCH[:3], "torque": WRENCH[3:]
}  # fmt: skip


def _scaled(words: str, **factors: float) -> Convention:
    """Return the convention in which parts of pose and wrench are so many times what is stated."""
    of_pose = not {"position", "angle"}.isdisjoint(factors)
    turns = {part: factor * np.eye(3) for part, factor in factors.items()}
    columns = tuple((name, name, x) for part, x in factors.items() for name in _PARTS[part])
    unit = replace(_turned(words, **turns), of_pose=of_pose, columns=columns)
    return replace(unit, of_pose_unit=of_pose)


def _turned(words: str, **turned: F) -> Convention:
    """Return the convention of other axes: what is stated is a (3, 3) times what is meant.

    turned: that of the position, angle, force and torque; a part that is not named stays.
    """
    turns = [turned.get(part, np.eye(3)) for part in _PARTS]

    def change(poses: F, wrench: F) -> tuple[F, F]:
        parts = (poses[:, :3], poses[:, 3:], wrench[:, :3], wrench[:, 3:])
        meant = [part @ turn for part, turn in zip(parts, turns, strict=True)]
        return np.hstack(meant[:2]), np.hstack(meant[2:])

    return Convention(words, change, of_pose="position" in turned)


def _axes() -> Iterator[Convention]:
    """Yield other axes of the wrench, of the pose, of both: about one axis, left-handed, others."""
    turns = list(_axis_turns())
    yield from _of_turns(turns[:_SINGLE])
    for axis, sign in zip("xyz", 1.0 - 2.0 * np.eye(3), strict=True):
        flip = np.diag(sign)
        words = f"the {axis} axis of the {{}} looks reversed (left-handed axes)"
        yield _turned(words.format("wrench"), force=flip, torque=-flip)
        yield _turned(words.format("pose"), position=flip, angle=-flip)
    yield from _of_turns(turns[_SINGLE:])


def _of_turns(turns: list[tuple[str, F]]) -> Iterator[Convention]:
    for words, turn in turns:
        yield _turned(f"the wrench's axes look {words}", force=turn, torque=turn)
    for words, turn in turns:
        yield _turned(f"the pose's axes look {words}", position=turn, angle=turn)
    for words, turn in turns:
        every = dict.fromkeys(("position", "angle", "force", "torque"), turn)
        yield _turned(f"the axes of pose and wrench look {words}", **every)


def _axis_turns() -> Iterator[tuple[str, F]]:
    """Yield the 23 turns that map axes to axes, those about one axis first."""
    single = [
        (f"turned by {90 * k if k < 3 else -90} degrees about {axis}", _about(j, k))
        for k in (1, 3, 2)
        for j, axis in enumerate("xyz")
    ]
    pairs = [
        (f"{first}, then {second[len('turned by ') :]}", b @ a)
        for first, a in single
        for second, b in single
    ]
    seen = [np.eye(3)]
    for words, turn in [*single, *pairs]:
        if not any(np.array_equal(turn, known) for known in seen):
            seen.append(turn)
            yield words, turn


def _about(axis: int, quarters: int) -> F:
    """(3, 3) so many quarter turns about an axis, its numbers exact."""
    turn = np.eye(3)
    a, b = (axis + 1) % 3, (axis + 2) % 3
    turn[[a, b]] = -turn[b], turn[a]
    return np.asarray(np.linalg.matrix_power(turn, quarters)) + 0.0


def _points(length_m: float | None) -> Iterator[Convention]:
    changes: list[tuple[str, Change]] = [
        ("the wrench looks stated in the axes of the top, not the base", _from_top),
        ("the wrench looks turned by the inverse rotation", _to_top),
        ("the torque looks taken about the base's origin, not the top's", _about_another(-1.0)),
        ("the torque looks taken a length too far", _about_another(1.0)),
    ]
    for words, change in changes:
        yield Convention(words, change, of_pose=False)
    if length_m is not None:
        along = np.array([length_m, 0.0, 0.0, 0.0, 0.0, 0.0])
        words = (
            "the positions look measured from the rest pose, not from the base (base_from_robot = "
            f"[{length_m:g}, 0, 0, 1, 0, 0, 0] under [frames] moves them)"
        )
        yield Convention(words, lambda p, h: (p + along, h), of_pose=True)


def _about_another(share: float) -> Change:
    """Return the change to a torque about a point that is this share of the position farther."""
    return lambda p, h: (p, np.hstack([h[:, :3], h[:, 3:] + share * np.cross(p[:, :3], h[:, :3])]))


def _from_top(poses: F, wrench: F) -> tuple[F, F]:
    return poses, turn_wrench(rotation(poses[:, 3:]), wrench)


def _to_top(poses: F, wrench: F) -> tuple[F, F]:
    return poses, turn_wrench(transpose(rotation(poses[:, 3:])), wrench)


def _rotations() -> Iterator[Convention]:
    yield Convention("the pose looks inverted (the base seen from the top)", _inverted, True)
    for stated, meant in ORDERS.items():
        words = f"the rotation looks read from a quaternion as {stated}, which is {meant}"
        yield _of_rotation(words, partial(read_in_other_order, stated=stated))
    for order in itertools.permutations(range(3)):
        name = "".join("xyz"[j] for j in order)
        words = f"the rotation columns look like Euler angles in the order {name}"
        yield _of_rotation(words, partial(_of_euler, order=order))


def _of_rotation(words: str, change: Callable[[F], F]) -> Convention:
    def changed(poses: F, wrench: F) -> tuple[F, F]:
        return np.hstack([poses[:, :3], change(poses[:, 3:])]), wrench

    return Convention(words, changed, of_pose=True)


def _inverted(poses: F, wrench: F) -> tuple[F, F]:
    back = rotate(transpose(rotation(poses[:, 3:])), poses[:, :3])
    return np.hstack([-back, -poses[:, 3:]]), wrench


def _of_euler(angles: F, order: tuple[int, ...]) -> F:
    """(N, 3) rotation vectors of turns about the moving axes in this order."""
    turned = np.broadcast_to(np.eye(3), (len(angles), 3, 3))
    for axis in order:
        turned = turned @ rotation_matrices(angles * np.eye(3)[axis])
    return rotation_vectors(turned)


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
_EACH, _ROUNDING = 5, 1e-6
"""One row in so many tells that an error is far too large, if it is by more than this."""
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
    framed
        Whether [frames] of the description turned these columns, so that they may be what is wrong.
    whole
        Whether all twelve columns are there, which another frame turns into each other.
    """

    what: str
    columns: tuple[str, ...]
    decided: bool
    falls: tuple[str, ...] = ()
    error_stated: float | None = None
    error_mended: float | None = None
    mend: tuple[str, ...] = ()
    framed: bool = False
    whole: bool = False

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
        if self.falls and not self.decided and self.error_mended is None:
            frame = " or a frame ([frames], docs/howto/frames.md)" * (self.framed or self.whole)
            what = self.what or f"a column{frame} is wrong"
            active = "the mechanism is not passive there (pre-loaded, near buckling, driven)"
            return f"{grows}: {what}, or {active}"
        why = [grows] if self.falls else []
        if self.error_stated is not None and self.error_mended is not None:
            why.append(
                f"no elastic body has these loads as stated (an energy errs "
                f"{100 * self.error_stated:.2g} % of them, with that mended "
                f"{100 * self.error_mended:.2g} %)"
            )
        by = " (wrench_by of [frames] says whose it is)"
        what = self.what + by * (self.framed and self.what == WRENCH_REVERSED)
        return ": ".join(filter(None, (what, ", and ".join(why))))

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as plain JSON, and the sentence."""
        told = {k: v for k, v in asdict(self).items() if k not in ("framed", "whole")}
        return told | {"sentence": self.sentence()}

    def refusal(self, source: str) -> InputError:
        """Return the error of a table that is fitted all the same, and the entry that mends it."""
        words = "mend it by [columns] (signs) or [frames] (docs/howto/frames.md), then check it"
        if self.framed:
            words = "mend [frames] in the TOML beside the table, then check it again"
        if self.mend:
            entries = "\n".join(self.mend)
            words = (
                "mend the columns in the TOML beside the table (ecm check --mend writes it):\n"
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


_Errors = Sequence[tuple[Convention, float]]


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
            if proven := self.proven(self.of_columns, [*self.energies], falling, decided=True):
                return proven
            if self.there.all() and self.is_doubtful():
                # Without a length the axis may be any: then only what holds for any body counts.
                kinds = [k for k in self.energies if self.stated_length_m or k[0] == "general"]
                # What falls is wrong; another origin or rotation may be the user's choice.
                every = list(conventions(self.stated_length_m))
                if proven := self.proven(every, kinds, falling, decided=bool(falling)):
                    return proven
        if falling:
            return self.either_or(falling)
        # No body is bent or pressed so far that its top never leaves the half at its clamped face.
        reach = np.linalg.norm(self.poses[:, :3], axis=1).max()
        near = self.there.all() and reach < 0.5 * self.length_m
        of_rest = [item for item in _points(self.stated_length_m) if near and item.of_pose]
        return self.said(of_rest, (), False, (None, None)) if of_rest else None

    @cached_property
    def energies(self) -> dict[_Kind, float]:
        """The energies whose terms these rows can tell, and their error as stated."""
        pairs = int((self.there[:6] & self.there[6:]).sum())
        if pairs < 2 or not self.length_m > 0.0:
            return {}
        as_stated = [of_columns("", {})]
        return {kind: error for kind in _ENERGIES for _, error in self.errors(kind, as_stated)}

    def errors(
        self, kind: _Kind, items: Iterable[Convention], most: float = np.inf
    ) -> Iterator[tuple[Convention, float]]:
        """Yield conventions and the error of an energy fitted to each, where the rows can tell.

        One that surely errs more than `most` may be left out.
        """
        as_stated = self.basis(kind, self.poses)
        for item in items:
            try:
                poses, wrench = item.change(self.poses, self.wrench)
            except EcmError:
                continue
            basis = self.basis(kind, poses) if item.of_pose else as_stated
            if basis is not None:
                loads = wrench[:, self.there[6:]]
                size = _rms(loads)
                z = (basis[:, self.there[6:]] / size[:, None]).reshape(loads.size, -1)
                if not _surely_leaves(z, y := (loads / size).ravel(), most):
                    yield item, _rms_left(z, y)

    def basis(self, kind: _Kind, poses: F) -> F | None:
        """Return (N, 6, k) of an energy's terms; None where the rows cannot tell them."""
        symmetry, degree = kind
        try:
            terms = EnergyEvaluator.regressor(
                poses,
                length_m=self.length_m,
                degree=degree,
                symmetry=symmetry,
                scale=EnergyEvaluator.scale_of(poses, self.length_m),
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
        stated = min(self.energies.values())
        most = min(_MOST_ERROR, _MENDED * stated)
        best: tuple[float, list[Convention]] = (np.inf, [])
        for kind in kinds:
            left = list(self.errors(kind, told, _EQUAL * most))
            best = min(best, self.right(left, most), key=lambda pair: pair[0])
        least, right = best
        return None if least > most else self.said(right, falling, decided, (stated, least))

    def right(self, left: _Errors, most: float) -> tuple[float, list[Convention]]:
        """Return the least error of a convention with which nothing falls, and those of it.

        Of errors above `most` any may be returned.
        """
        least = np.inf
        kept: list[int] = []
        for place in np.argsort([error for _, error in left], kind="stable").tolist():
            item, error = left[place]
            if error > _EQUAL * min(least, most):
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
        behind = known and mean < 0.0 < max(stated, self.stated_length_m or 0.0)
        return not behind and not falling_loads(poses, wrench, self.there)

    def either_or(self, falling: Sequence[str]) -> WrongConvention:
        """Return which sign would mend it, where the mechanism may also be one that is driven."""
        kind = next(iter(self.energies), None)
        most = np.inf if kind is None else _EQUAL * self.energies[kind]
        any_sign = ((item, 0.0) for item in self.of_columns)
        left = any_sign if kind is None else self.errors(kind, self.of_columns, most)
        mending = [item for item, error in left if error <= most and self.is_right(item)]
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
        mend = entries_of(self.rows, said[0].columns) if len(said) == 1 else ()
        framed = self.rows.meta.applied_columns is None
        return WrongConvention(
            in_words(said), names, decided, tuple(falling), *errors, mend, framed,
            bool(self.there.all()),
        )  # fmt: skip


def entries_of(table: Table, columns: Columns) -> tuple[str, ...]:
    """Return the entries of [columns] that mend columns of a table, in place of those there.

    Examples
    --------
    >>> from ecm.io.table import as_table
    >>> entries_of(as_table({"x_m": [0.1], "y_m": [0.2]}), (("x_m", "y_m", -1.0),))
    ('x_m = { column = "y_m", scale = -1.0 }',)
    """
    sources = table.meta.applied_columns
    entries = []
    for name, stated, factor in columns:
        # Where the description turns the frames, its columns are not those of the table.
        if sources is None or not table.has(stated):
            continue
        own = sources.get(stated, ColumnSource(stated))
        meant = replace(own, scale=factor * own.scale, offset=factor * own.offset)
        entries.append(f"{name} = {toml_value(changed(meant))}")
    return tuple(entries)


def _surely_leaves(z: F, y: F, most: float) -> bool:
    """Whether the rms of what columns leave of numbers (r,) is above this; not always seen.

    No fit to all rows leaves less of some of them than a fit to these alone, which takes a tenth of
    the time: the last number of its R is the root of the squares that it leaves.
    """
    root = np.asarray(np.linalg.qr(np.column_stack([z[::_EACH], y[::_EACH]]), mode="r"))
    left = abs(root[-1, -1]) if len(root) == root.shape[1] else 0.0
    return bool(most + _ROUNDING < left / np.sqrt(len(z) - z.shape[1]) < np.inf)


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
