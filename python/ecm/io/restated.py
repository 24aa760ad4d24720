"""Other readings of a table that a user may have meant: axes, signs, units, rotations, origins."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from ecm._native import rotation_matrices, rotation_vectors
from ecm.io.arrays import F, I
from ecm.io.columns import POSE, WRENCH
from ecm.io.frames import ORDERS, read_in_other_order
from ecm.io.se3 import rotate, rotation, transpose, turn_wrench
from ecm.io.units import factor_of

Change = Callable[[F, F], tuple[F, F]]
"""(poses (N, 6), wrenches (N, 6)) as stated -> the same as they may have been meant."""

Columns = tuple[tuple[str, str, float], ...]
"""(column, the stated column that it is, 1 or -1) of each column that changes."""

WRENCH_REVERSED = "the wrench's sign looks reversed"
"""Words of the reading in which the reaction was written down."""
_SINGLE = 9
"""Turns about one axis, which come first."""


@dataclass(frozen=True)
class Restatement:
    """One wrong statement, and the change that mends it."""

    words: str
    change: Change
    of_pose: bool
    """Whether the poses change, so that the columns of a base change as well."""
    of_pose_unit: bool = False
    """Whether the poses only get another size."""
    columns: Columns = ()
    """The columns that change, where it is only that some are negated or exchanged."""


def restatements(length_m: float | None) -> Iterator[Restatement]:
    """Yield what users state wrongly, the simplest first.

    Parameters
    ----------
    length_m
        Length of the mechanism, for positions from its other end; None where it is not known.
    """
    yield from signs()
    yield from exchanges()
    yield from _units()
    turns = list(_axis_turns())
    yield from _turns(turns[:_SINGLE])
    yield from _mirrors()
    yield from _turns(turns[_SINGLE:])
    yield from _points(length_m)
    yield from _rotations()


def rarer_restatements() -> Iterator[Restatement]:
    """Yield more that only a model with fixed numbers tells: powers of ten, and the tool's axes.

    A sensor that moves with the top has its own axes: turned, reversed or exchanged there, the
    wrench in base axes is wrong in another way at each pose.
    """
    for words, place in (("10 times too large", 0.1), ("1000 times too small", 1e3)):
        scaled = _scaled_pose(np.array([place] * 3 + [1.0] * 3))
        yield Restatement(f"the positions look {words}", scaled, True, of_pose_unit=True)
    words = "the torque looks 1000 times too small"
    yield Restatement(words, _scaled_wrench(np.array([1.0] * 3 + [1e3] * 3)), False)
    turns = list(_axis_turns())
    for item in (
        *signs(),
        *exchanges(),
        *_turns(turns[:_SINGLE]),
        *_mirrors(),
        *_turns(turns[_SINGLE:]),
    ):
        if not item.of_pose:
            yield Restatement(f"{item.words}, in the axes of the tool", _in_tool(item), False)


def _in_tool(item: Restatement) -> Change:
    def change(poses: F, wrench: F) -> tuple[F, F]:
        return _from_top(poses, item.change(*_to_top(poses, wrench))[1])

    return change


def signs() -> Iterator[Restatement]:
    """Yield what a reversed sign mends: of the wrench, of the pose, of one column."""
    groups = (
        (WRENCH_REVERSED, WRENCH),
        ("the force's sign looks reversed", WRENCH[:3]),
        ("the torque's sign looks reversed", WRENCH[3:]),
        ("the pose's sign looks reversed", POSE),
        ("the position's sign looks reversed", POSE[:3]),
        ("the rotation looks transposed (its sign reversed)", POSE[3:]),
    )
    for words, names in groups:
        yield of_columns(words, {name: (name, -1.0) for name in names})
    for name in (*WRENCH, *POSE):
        yield of_columns(f"the sign of {_short(name)} looks reversed", {name: (name, -1.0)})


def exchanges() -> Iterator[Restatement]:
    """Yield what an exchange of columns mends: two of one quantity, or of all of wrench or pose."""
    pairs = list(itertools.combinations(range(3), 2))
    for quantity in (WRENCH[:3], WRENCH[3:], POSE[:3], POSE[3:]):
        for a, b in pairs:
            words = f"{_short(quantity[a])} and {_short(quantity[b])} look exchanged"
            yield of_columns(words, _exchanged(quantity[a], quantity[b]))
    for names, word in ((WRENCH, "wrench"), (POSE, "pose")):
        for a, b in pairs:
            both = _exchanged(names[a], names[b]) | _exchanged(names[a + 3], names[b + 3])
            yield of_columns(
                f"the columns {'xyz'[a]} and {'xyz'[b]} of the {word} look exchanged", both
            )
    three = {name: (WRENCH[(j + 3) % 6], 1.0) for j, name in enumerate(WRENCH)}
    yield of_columns("the force and torque columns look exchanged", three)


def of_columns(words: str, changed: Mapping[str, tuple[str, float]]) -> Restatement:
    """Return the reading in which some columns are others, or negated.

    Parameters
    ----------
    words
        What looks wrong.
    changed
        The stated column and its factor, by the column that it is.

    Examples
    --------
    >>> reading = of_columns("y and z look exchanged", {"y_m": ("z_m", 1.0), "z_m": ("y_m", 1.0)})
    >>> reading.change(np.array([[0.1, 0.2, 0.3, 0.0, 0.0, 0.0]]), np.zeros((1, 6)))[0]
    array([[0.1, 0.3, 0.2, 0. , 0. , 0. ]])
    """
    names = (*POSE, *WRENCH)
    places, factors = np.arange(len(names)), np.ones(len(names))
    for name, (stated, factor) in changed.items():
        places[names.index(name)], factors[names.index(name)] = names.index(stated), factor
    return Restatement(
        words,
        partial(_taken, places, factors),
        of_pose=any(name in POSE for name in changed),
        columns=tuple((name, *source) for name, source in changed.items()),
    )


def in_words(items: Sequence[Restatement]) -> str:
    """Return readings of which each is as likely in words.

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


def _taken(places: I, factors: F, poses: F, wrench: F) -> tuple[F, F]:
    taken = np.hstack([poses, wrench])[:, places] * factors
    return np.ascontiguousarray(taken[:, : len(POSE)]), taken[:, len(POSE) :]


def _exchanged(first: str, second: str) -> dict[str, tuple[str, float]]:
    return {first: (second, 1.0), second: (first, 1.0)}


def _short(name: str) -> str:
    return name.rsplit("_", 1)[0]


def _units() -> Iterator[Restatement]:
    for unit in ("N mm", "N cm", "kgf cm", "lbf in", "lbf ft"):
        words = f"the torque looks stated in {unit}, not N m"
        factors = np.array([1.0] * 3 + [factor_of(unit)] * 3)
        yield Restatement(words, _scaled_wrench(factors), False)
    for unit in ("kN", "mN", "gf", "kgf", "lbf"):
        words = f"the force looks stated in {unit}, not N"
        factors = np.array([factor_of(unit)] * 3 + [1.0] * 3)
        yield Restatement(words, _scaled_wrench(factors), False)
    for words, place, angle in (
        ("the positions look stated in mm, not m", 1e-3, 1.0),
        ("the positions look stated in cm, not m", 1e-2, 1.0),
        ("the angles look stated in degrees, not rad", 1.0, np.pi / 180),
        ("the angles look divided by 57.3 once too often", 1.0, 180 / np.pi),
    ):
        scaled = _scaled_pose(np.array([place] * 3 + [angle] * 3))
        yield Restatement(words, scaled, True, of_pose_unit=True)


def _turns(turns: Sequence[tuple[str, F]]) -> Iterator[Restatement]:
    """Yield turns of the axes of the wrench, of the pose, and of both."""
    for words, turn in turns:
        yield Restatement(f"the wrench's axes look {words}", _turned_wrench(turn, turn), False)
    for words, turn in turns:
        yield Restatement(f"the pose's axes look {words}", _turned_pose(turn), True)
    for words, turn in turns:
        yield Restatement(f"the axes of pose and wrench look {words}", _turned_both(turn), True)


def _mirrors() -> Iterator[Restatement]:
    """Left-handed axes."""
    for j, axis in enumerate("xyz"):
        flip = np.eye(3)
        flip[j, j] = -1.0
        words = f"the {axis} axis of the wrench looks reversed (left-handed axes)"
        yield Restatement(words, _turned_wrench(flip, -flip), False)
        words = f"the {axis} axis of the pose looks reversed (left-handed axes)"
        yield Restatement(words, _mirrored_pose(flip), True)


def _points(length_m: float | None) -> Iterator[Restatement]:
    yield Restatement(
        "the wrench looks stated in the axes of the top, not the base", _from_top, False
    )
    yield Restatement("the wrench looks turned by the inverse rotation", _to_top, False)
    yield Restatement(
        "the torque looks taken about the base's origin, not the top's",
        lambda p, h: (p, np.hstack([h[:, :3], h[:, 3:] - np.cross(p[:, :3], h[:, :3])])),
        False,
    )
    yield Restatement(
        "the torque looks taken a length too far",
        lambda p, h: (p, np.hstack([h[:, :3], h[:, 3:] + np.cross(p[:, :3], h[:, :3])])),
        False,
    )
    if length_m is not None:
        along = np.array([length_m, 0.0, 0.0, 0.0, 0.0, 0.0])
        yield Restatement(
            "the positions look measured from the rest pose, not from the base",
            lambda p, h: (p + along, h),
            True,
        )


def _rotations() -> Iterator[Restatement]:
    yield Restatement("the pose looks inverted (the base seen from the top)", _inverted, True)
    for stated, meant in ORDERS.items():
        words = f"the rotation looks read from a quaternion as {stated}, which is {meant}"
        yield Restatement(words, _of_quaternion(stated), True)
    for order in itertools.permutations(range(3)):
        name = "".join("xyz"[j] for j in order)
        words = f"the rotation columns look like Euler angles in the order {name}"
        yield Restatement(words, _of_euler(order), True)


def _axis_turns() -> Iterator[tuple[str, F]]:
    """Yield the 23 turns that map axes to axes, those about one axis first."""
    seen: list[F] = []
    quarter = np.pi / 2.0
    single = [
        (f"turned by {90 * k if k < 3 else -90} degrees about {axis}", _about(j, k * quarter))
        for k in (1, 3, 2)
        for j, axis in enumerate("xyz")
    ]
    pairs = [
        (f"{first}, then {second[len('turned by ') :]}", b @ a)
        for first, a in single
        for second, b in single
    ]
    for words, rough in [*single, *pairs]:
        turn = np.round(rough)
        if not np.array_equal(turn, np.eye(3)) and not any(np.array_equal(turn, t) for t in seen):
            seen.append(turn)
            yield words, turn


def _about(axis: int, angle: float) -> F:
    vector = np.zeros((1, 3))
    vector[0, axis] = angle if angle <= np.pi else angle - 2.0 * np.pi
    if abs(angle - np.pi) < 1e-9:
        turned = -np.eye(3)
        turned[axis, axis] = 1.0
        return turned
    return np.asarray(rotation_matrices(vector)[0])


def _scaled_wrench(factors: F) -> Change:
    return lambda poses, wrench: (poses, wrench * factors)


def _scaled_pose(factors: F) -> Change:
    return lambda poses, wrench: (poses * factors, wrench)


def _turned_wrench(force: F, torque: F) -> Change:
    """Stated = turn @ meant, so that meant = turn' @ stated."""
    return lambda poses, wrench: (poses, np.hstack([wrench[:, :3] @ force, wrench[:, 3:] @ torque]))


def _turned_pose(turn: F) -> Change:
    return lambda poses, wrench: (np.hstack([poses[:, :3] @ turn, poses[:, 3:] @ turn]), wrench)


def _turned_both(turn: F) -> Change:
    def change(poses: F, wrench: F) -> tuple[F, F]:
        return _turned_pose(turn)(poses, _turned_wrench(turn, turn)(poses, wrench)[1])

    return change


def _mirrored_pose(flip: F) -> Change:
    return lambda poses, wrench: (np.hstack([poses[:, :3] @ flip, -poses[:, 3:] @ flip]), wrench)


def _from_top(poses: F, wrench: F) -> tuple[F, F]:
    return poses, turn_wrench(rotation(poses[:, 3:]), wrench)


def _to_top(poses: F, wrench: F) -> tuple[F, F]:
    return poses, turn_wrench(transpose(rotation(poses[:, 3:])), wrench)


def _inverted(poses: F, wrench: F) -> tuple[F, F]:
    back = rotate(transpose(rotation(poses[:, 3:])), poses[:, :3])
    return np.hstack([-back, -poses[:, 3:]]), wrench


def _of_quaternion(stated: str) -> Change:
    """The same four numbers with the scalar at the other end."""
    return lambda poses, wrench: (
        np.hstack([poses[:, :3], read_in_other_order(poses[:, 3:], stated)]),
        wrench,
    )


def _of_euler(order: tuple[int, ...]) -> Change:
    def change(poses: F, wrench: F) -> tuple[F, F]:
        turned = np.broadcast_to(np.eye(3), (len(poses), 3, 3))
        for axis in order:
            single = np.zeros((len(poses), 3))
            single[:, axis] = poses[:, 3 + axis]
            turned = turned @ rotation_matrices(single)
        vectors = rotation_vectors(turned)
        return np.hstack([poses[:, :3], vectors]), wrench

    return change
