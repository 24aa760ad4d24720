"""Conventions in which a user may have meant a table: signs, axes, units, points, rotations.

Each is a sentence, what looks wrong, and a change, which gives pose and wrench as they were meant.
Who asks which one holds fits something to every one of them: `ecm.io.sanity` an energy, the
diagnosis its base or the model that was given.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ecm._native import rotation_matrices, rotation_vectors
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.io.frames import ORDERS, read_in_other_order
from ecm.io.se3 import rotate, rotation, transpose, turn_wrench
from ecm.io.units import factor_of

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
    """The columns that change, where it is only that some are negated or exchanged."""


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


def _scaled(
    words: str,
    *,
    position: float = 1.0,
    angle: float = 1.0,
    force: float = 1.0,
    torque: float = 1.0,
) -> Convention:
    """Return the convention in which pose and wrench are this many times what is stated."""
    of_pose = (position, angle) != (1.0, 1.0)
    turns = [factor * np.eye(3) for factor in (position, angle, force, torque)]
    return replace(_turned(words, *turns), of_pose=of_pose, of_pose_unit=of_pose)


def _turned(
    words: str, position: F | None, angle: F | None, force: F | None, torque: F | None
) -> Convention:
    """Return the convention of other axes: what is stated is a (3, 3) times what is meant."""
    turns = [np.eye(3) if turn is None else turn for turn in (position, angle, force, torque)]

    def change(poses: F, wrench: F) -> tuple[F, F]:
        parts = (poses[:, :3], poses[:, 3:], wrench[:, :3], wrench[:, 3:])
        turned = [part @ turn for part, turn in zip(parts, turns, strict=True)]
        return np.hstack(turned[:2]), np.hstack(turned[2:])

    return Convention(words, change, of_pose=position is not None)


def _axes() -> Iterator[Convention]:
    """Yield other axes of the wrench, of the pose, of both: about one axis, left-handed, others."""
    turns = list(_axis_turns())
    yield from _of_turns(turns[:_SINGLE])
    for axis, sign in zip("xyz", 1.0 - 2.0 * np.eye(3), strict=True):
        flip = np.diag(sign)
        words = f"the {axis} axis of the {{}} looks reversed (left-handed axes)"
        yield _turned(words.format("wrench"), None, None, flip, -flip)
        yield _turned(words.format("pose"), flip, -flip, None, None)
    yield from _of_turns(turns[_SINGLE:])


def _of_turns(turns: list[tuple[str, F]]) -> Iterator[Convention]:
    for words, turn in turns:
        yield _turned(f"the wrench's axes look {words}", None, None, turn, turn)
    for words, turn in turns:
        yield _turned(f"the pose's axes look {words}", turn, turn, None, None)
    for words, turn in turns:
        yield _turned(f"the axes of pose and wrench look {words}", turn, turn, turn, turn)


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
        (
            "the torque looks taken about the base's origin, not the top's",
            lambda p, h: (p, np.hstack([h[:, :3], h[:, 3:] - np.cross(p[:, :3], h[:, :3])])),
        ),
        (
            "the torque looks taken a length too far",
            lambda p, h: (p, np.hstack([h[:, :3], h[:, 3:] + np.cross(p[:, :3], h[:, :3])])),
        ),
    ]
    for words, change in changes:
        yield Convention(words, change, of_pose=False)
    if length_m is not None:
        along = np.array([length_m, 0.0, 0.0, 0.0, 0.0, 0.0])
        words = "the positions look measured from the rest pose, not from the base"
        yield Convention(words, lambda p, h: (p + along, h), of_pose=True)


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
