"""Which columns of a log become standard columns: proposed by names, refused where unclear."""

from __future__ import annotations

import re
import shlex
from collections import Counter
from collections.abc import Collection, Mapping, Sequence

import numpy as np

from ecm.errors import InputError
from ecm.io.columns import (
    POSE,
    WRENCH,
    Unit,
    actuation_columns,
    is_standard,
    likely_name,
)
from ecm.logs.log import Log, unique_names
from ecm.logs.names import (
    ABOUT,
    QUANTITIES,
    Answer,
    Guess,
    Named,
    Question,
    find_unit,
    is_no_reading,
    missing,
    named_as,
    read_name,
    trailing_units,
    words_of,
)
from ecm.logs.sources import (
    COUNT,
    ColumnMap,
    RotationSource,
    Source,
    UserChoices,
    ask_units,
    check_rotation_word,
    chosen_source,
    known_column,
    stated_unit,
)


def rotation_of(
    named: Mapping[str, Named],
    choices: UserChoices,
    log: Log,
    source: str,
    used: set[str],
    found: Mapping[str, Source],
) -> RotationSource | None:
    """The columns that are one rotation, by the user's word or by their names."""
    if any(name in found for name in POSE[3:]):
        return None
    word, colon, listed = choices.rotation.partition(":")
    groups = _groups(named, used)
    if word:
        count = check_rotation_word(word)
        columns = _columns_of(word, named, groups)
        if colon:
            option = f"--rotation {choices.rotation}"
            columns = [known_column(name.strip(), log, option) for name in listed.split(",")]
        if len(columns) != count:
            raise InputError(
                f"--rotation {word}: expected {count} columns, found {len(columns)} "
                f"({', '.join(columns) or 'none'}). Name them: --rotation {word}:COLUMN,COLUMN,..."
            )
    elif len(groups) == 1:
        ((kind, columns),) = groups.items()
        word = _word(kind, columns, named, source)
    elif groups:
        shown = " or ".join(f"{kind} ({', '.join(names)})" for kind, names in groups.items())
        raise Question(
            f"{source}: the rotation may be {shown}. Say which with --rotation WORD:COLUMN,...",
            *(
                Answer({"rotation": f"{QUANTITIES[kind].rotation[0]}:{','.join(names)}"},
                       f"{', '.join(names)} are taken as {QUANTITIES[kind].rotation[0]}")
                for kind, names in groups.items()
            ),
        )  # fmt: skip
    else:
        return None
    if COUNT.get(word, 3) != 3:
        if word == "xyzw" and named[columns[0]].part("quaternion") == "w":
            columns = [*columns[1:], columns[0]]
        return RotationSource(word, tuple(Source(name, Unit("", "number")) for name in columns))
    sources = {
        standard: Source(name, stated_unit(name, standard, named[name], choices))
        for standard, name in zip(POSE[3:], columns, strict=True)
    }
    ask_units(sources, log, source)
    return RotationSource(word, tuple(sources.values()))


def _word(kind: str, columns: Sequence[str], named: Mapping[str, Named], source: str) -> str:
    """Word of a group of columns; InputError where it may be one of two."""
    words, parts = QUANTITIES[kind].rotation, "".join(named[name].part(kind) for name in columns)
    orders = [word for word in words if word in columns[0].lower()]
    if kind == "quaternion" and "w" in parts:
        return "wxyz" if parts == "wxyz" else "xyzw"
    if kind == "quaternion" and len(orders) == 1:
        return orders[0]
    if len(words) == 1 or (kind == "matrix" and len(parts) == 18):
        return words[0]
    first, second = words
    raise Question(
        f"{source}: {', '.join(columns)} may be {QUANTITIES[kind].question}. Say which: "
        f"--rotation {first} or --rotation {second}",
        *(
            Answer({"rotation": word}, f"{', '.join(columns)} are taken as {word}")
            for word in words
        ),
    )


_ORDER = {part: i for i, part in enumerate(
    ["w", "x", "y", "z", "roll", "pitch", "yaw", "flexion", "adduction", "internal"]
)}  # fmt: skip


def _groups(named: Mapping[str, Named], used: set[str]) -> dict[str, list[str]]:
    """Columns of each kind of rotation that is complete, in the order of their parts."""
    groups: dict[str, list[str]] = {}
    for kind, quantity in QUANTITIES.items():
        names = [name for name, own in named.items() if name not in used and own.part(kind)]
        if kind == "rotation":  # r11 is of a matrix, angle without axis is no group
            names = [name for name in names if named[name].part(kind) in ("x", "y", "z")]
        if quantity.rotation and len(names) == COUNT.get(quantity.rotation[0], 3):
            parts = {name: named[name].part(kind) for name in names}
            groups[kind] = sorted(names, key=lambda n: (_ORDER.get(parts[n], 99), parts[n]))
    if "quaternion" in groups or "matrix" in groups:
        groups.pop("rotation", None)
    return groups


def _columns_of(
    word: str, named: Mapping[str, Named], groups: Mapping[str, list[str]]
) -> list[str]:
    """The columns that a word of a rotation can be of, by their names."""
    angles = ("euler", "rotation", "rotvec")
    for kind in angles if word not in COUNT else QUANTITIES:
        if kind not in groups or (word in COUNT and word not in QUANTITIES[kind].rotation):
            continue
        if word == "columns":  # one after the other as in the log, whatever their indices
            return [name for name in named if name in groups[kind]]
        if word in COUNT:
            return groups[kind]
        if len(set(word.lower())) < 3:  # ZYZ: no name says which turn about z is meant
            return []
        by_axis = dict(zip("xyz", groups[kind], strict=True))
        return [by_axis[axis] for axis in word.lower()]
    return []


_UNIT, _MOST_ROWS = 1e-3, 0.9
"""Error of a unit quaternion's length, and the share of rows in which four numbers are one."""
_WITHOUT_AXIS = ("position", "rotation", "force", "torque")
_AXES = ("x", "y", "z")


def propose(log: Log, choices: UserChoices, source: str) -> ColumnMap:
    """Return the mapping of a log's columns.

    Raises
    ------
    InputError
        For what has two guesses; the message gives both and the option that decides.
    """
    named = _read_names(log)
    found: dict[str, Source] = {}
    for standard, choice in choices.columns.items():
        found[standard] = chosen_source(standard, choice, log, named, choices)
    used = {entry.column for entry in found.values()}
    rotation = rotation_of(named, choices, log, source, used, found)
    used |= {entry.column for entry in rotation.sources} if rotation is not None else set()
    sure = {n.guesses[0].quantity for n in named.values() if len(n.guesses) == 1}
    told = {n.guesses[0].standard() for n in named.values() if len(n.guesses) == 1}
    poses = rotation is not None or any(name in POSE for name in choices.columns)
    needed = poses and any(name in WRENCH for name in choices.columns)
    posed = rotation is not None or not {"position", "rotvec"}.isdisjoint(sure)
    notes: list[str] = []
    for name, own in named.items():
        if name in used:
            continue
        guesses = _settled(own.guesses, sure, rotation)
        standards = {s for r in guesses if (s := r.standard()) is not None}
        # Beside Fx a force without an axis is likely its size, whatever axis others get.
        beside = bool(not standards and told & _doubtful(guesses, standards))
        if not beside:
            standards = {s for r in guesses if (s := r.standard(choices.axis)) is not None}
        doubtful = _doubtful(guesses, standards)
        # Whoever has named pose and wrench need not say what each other column is.
        if doubtful and (needed or beside or doubtful <= choices.columns.keys()):
            notes.append(
                f"column '{name}' may be {' or '.join(sorted(doubtful))}, and is kept as your own: "
                "--map decides"
            )
            continue
        if len(standards) > 1:
            first, second = sorted(standards)[:2]
            # The time first, and of tx what the log lacks, a pose or a wrench.
            likely = sorted(standards, key=lambda n: (n != "time_s", (n in POSE) == posed, n))
            raise Question(
                f"{source}: column '{name}' may be {first} or {second}. Say which: "
                f"--map {first}={name} or --map {second}={name}",
                *(named_as(standard, name) for standard in likely),
            )
        if doubtful:
            _ask_axis(name, guesses[0], source, sure)
        for standard in standards - choices.columns.keys():
            if standard in found:
                first = found[standard].column
                raise Question(
                    f"{source}: columns '{first}' and '{name}' may both be "
                    f'{standard}. Say which: --map "{standard}={name}" or '
                    f'--map "{standard}={first}"',
                    named_as(standard, first),
                    named_as(standard, name),
                )
            found[standard] = Source(name, stated_unit(name, standard, own, choices))
            used.add(name)
    ask_units(found, log, source)
    twin, others = _twins(log, found)
    if others:
        listed = ", ".join(others)
        notes.append(
            f"{listed} hold the same columns as {twin}: logs of their own, left aside. Import each "
            "by itself"
        )
    within = tuple(f"{one}." for one in others)
    left = [name for name in named if name not in used and not name.startswith(within)]
    notes += _unnumbered_pressures(left, named, found)
    turned = rotation is not None or not found.keys().isdisjoint(POSE[3:])
    if not turned and not needed and (asked := _unnamed_turns(left, named, found, source)):
        raise asked
    own_names = unique_names(map(_own_name, left), taken=found)
    known = {*found, *used, *(POSE[3:] if rotation is not None else ())}
    return ColumnMap(
        found,
        rotation,
        dict(zip(left, own_names, strict=True)),
        tuple(notes),
        missing(log, named, known),
    )


def _unnumbered_pressures(
    left: Sequence[str], named: Mapping[str, Named], found: Mapping[str, Source]
) -> list[str]:
    """What to say of pressures that may be of a chamber, of the air or of a supply."""
    if actuation_columns(found):
        return []
    stated = {name: find_unit(own.unit.word) for name in left if (own := named[name]).unit}
    pressures = [name for name, unit in stated.items() if unit and unit.dimension == "pressure"]
    return [
        f"column '{name}' is a pressure, not said of what: of a chamber that drives the body, "
        f"counted from the air around it, it is --map {shlex.quote(f'pressure_{number}_Pa={name}')}"
        for number, name in enumerate(pressures, 1)
    ]


def _twins(log: Log, found: Mapping[str, Source]) -> tuple[str, list[str]]:
    """The struct that holds the time, and those that hold the same columns, time and all."""
    stem, _, time = found["time_s"].column.rpartition(".") if "time_s" in found else ("", "", "")
    stems = [name.removesuffix(f".{time}") for name in log.columns if stem]
    inside = {
        one: {name.removeprefix(f"{one}.") for name in log.columns if name.startswith(f"{one}.")}
        for one in stems
    }
    return stem, [one for one, own in inside.items() if one != stem and own == inside[stem]]


def _doubtful(guesses: Sequence[Guess], standards: set[str]) -> set[str]:
    """Standard names between which a name does not decide; empty where it does, or says nothing."""
    if len(standards) > 1:
        return standards
    if guesses and not standards and guesses[0].quantity in _WITHOUT_AXIS:
        return set(QUANTITIES[guesses[0].quantity].standard)
    return set()


def _read_names(log: Log) -> dict[str, Named]:
    """The guesses of every column; arrays state units at the end of their name: position_mm."""
    named: dict[str, Named] = {}
    for name, shown in zip(log.columns, _renamed(log), strict=True):
        own = read_name(shown, log.units.get(name, ""))
        repeated = re.fullmatch(r"(.*)_[2-9]", name)
        first = None if repeated is None else named.get(repeated[1])
        if first is not None and not any(guess.standard("x") for guess in own.guesses):
            own = first  # a name that is there twice is asked about
        units = trailing_units(name.rpartition(".")[0])[1] if shown != name else {}
        stated = tuple(guess for guess in own.guesses if guess.dimension in units)
        if own.unit is None and stated:
            own = Named(stated, units[stated[0].dimension])
        named[name] = own
    # Whatever it is called, what alone is in °C is the temperature; one letter may be any unit.
    warm = [name for name, own in named.items() if own.unit is not None
            and own.unit.dimension == "temperature" and len(own.unit.word) > 1]  # fmt: skip
    if len(warm) == 1 and not named[warm[0]].guesses:
        named[warm[0]] = Named((Guess("temperature"),), named[warm[0]].unit)
    # And what alone grows in s is the time, where nothing is called so.
    timed = [name for name, own in named.items()
             if any(guess.standard() == "time_s" for guess in own.guesses)
             or (own.unit is not None and own.unit.dimension == "time"
                 and (np.diff(log.columns[name]) > 0.0).all())]  # fmt: skip
    if len(timed) == 1 and not named[timed[0]].guesses:
        named[timed[0]] = Named((Guess("time"),), named[timed[0]].unit)
    _name_threes(log, named)
    # Beside x, y and z the fourth number of a quaternion is its scalar: Q0, Qx, Qy, Qz.
    quaternion = {part: name for name, own in named.items() if (part := own.part("quaternion"))}
    if len(quaternion) == len(_AXES) + 1 and (scalar := quaternion.keys() - _AXES) <= {"0", "4"}:
        name = quaternion[scalar.pop()]
        named[name] = Named((Guess("quaternion", "w"),), named[name].unit)
    # About one axis the angle is the rotation vector, whatever three would be.
    turned = {
        name: part
        for name, own in named.items()
        if (part := own.part("rotation") or ABOUT.get(own.part("euler"), "")) in _AXES
    }
    others = {"rotvec", "quaternion", "clinical"}
    if len(turned) == 1 and not any(own.part(kind) for own in named.values() for kind in others):
        ((name, part),) = turned.items()
        named[name] = Named((Guess("rotvec", part),), named[name].unit)
    return named


_ALIKE = ("position", "force", "torque", "rotation", "quaternion")
_UNIT = 0.01
"""By how much the squares of a quaternion may miss 1, in the digits of a log."""


def _name_threes(log: Log, named: dict[str, Named]) -> None:
    """Whatever they are called, the only x, y and z in a unit of length are the position.

    So are those of a force, of a torque and of an angle; where there are no three, the only two,
    as of a stage in a plane, or the one with a word of the quantity: cam_rz in degrees. Four
    numbers w, x, y and z whose squares sum to 1 are a quaternion.
    """
    for quantity in _ALIKE:
        dimension, words_of_it, _, standard, *_ = QUANTITIES[quantity]
        guesses = [guess for own in named.values() for guess in own.guesses]
        known = standard or POSE[3:]  # of a quaternion
        if any(guess.dimension == dimension or guess.part in known for guess in guesses):
            continue
        whole_turn = quantity == "quaternion"
        letters = ("w", *_AXES) if whole_turn else _AXES
        units = {n: own.unit for n, own in named.items() if not own.unit and not is_no_reading(n)}
        if not whole_turn:
            units = {n: unit for n in named if (unit := _stated(n, named[n], dimension))}
        threes: dict[tuple[str, ...], dict[str, str]] = {}
        telling = set()
        for name in units:
            words = words_of(name)
            # FX of a cell called LC is x of LC F: what else the names hold is alike.
            for place, word in enumerate(words):
                rest = tuple(filter(None, (*words[:place], word[:-1], *words[place + 1 :])))
                if word[-1] in letters:
                    threes.setdefault(rest, {})[word[-1]] = name
                    telling |= {rest} if word[:-1] in words_of_it.split() else set()
        if whole_turn:
            threes = {rest: own for rest, own in threes.items() if _is_unit(log, own.values())}
        most = max(map(len, threes.values()), default=0)
        whole = {rest: own for rest, own in threes.items() if len(own) == most}
        # One axis alone says little, but for a word of the quantity beside it.
        if len(whole) == 1 and (most > 1 or telling & whole.keys()):
            for axis, name in next(iter(whole.values())).items():
                named[name] = Named((Guess(quantity, axis),), units[name])


def _is_unit(log: Log, names: Collection[str]) -> bool:
    """Whether columns are the four of a unit quaternion."""
    squares = sum(log.columns[name] ** 2 for name in names)
    return len(names) == len(_AXES) + 1 and bool(np.all(np.abs(squares - 1.0) < _UNIT))


def _stated(name: str, own: Named, dimension: str) -> Unit | None:
    """The unit of a dimension that a column states, of one that is a reading."""
    unit = own.unit or trailing_units(name)[1].get(dimension)
    fits = unit is not None and unit.dimension == dimension
    return unit if fits and not is_no_reading(name) else None


def _unnamed_turns(
    left: Sequence[str], named: Mapping[str, Named], found: Mapping[str, Source], source: str
) -> Question | None:
    """What to ask where a position has no rotation, and three other columns are angles: U, V, W."""
    angles = [name for name in left if _stated(name, named[name], "angle")]
    if len(angles) != len(_AXES) or not found.keys() >= {*POSE[:3]}:
        return None
    shown, option = ", ".join(angles), ",".join(angles)
    ways = {"xyz": "fixed axes x, y and z", "XYZ": "moving axes x, y and z"}
    said = " or ".join(f'--rotation "{word}:{option}" (the {ways[word]})' for word in ways)
    return Question(
        f"{source}: {shown} are angles, and no name tells about which axes the mechanism turns, "
        f"one after the other. Say which: {said}, or another order; or keep them as columns of "
        f'your own: --map "own_angle={angles[0]}"',
        *(
            Answer(
                {"rotation": f"{word}:{option}"},
                f"{shown} are taken as turns about the {axes}, in this order",
            )
            for word, axes in ways.items()
        ),
    )


def _renamed(log: Log) -> list[str]:
    """Names without that of a struct around all; of arrays by component: wrench.4 as torque.y."""
    names = []
    whole = {name.partition(".")[0] for name in log.columns}
    inner = [name.partition(".")[2] for name in log.columns]
    of_struct = len(whole) == 1 and all(name[:1].isalpha() for name in inner)
    begin = len(next(iter(whole))) + 1 if of_struct else 0
    arrays = _arrays(log)
    of_poses = {
        n: part for stem, own in arrays.items() for n, part in _pose_parts(log, stem, own).items()
    }
    sizes = Counter(name.rpartition(".")[0] for name in log.columns)
    for name in log.columns:
        stem, dot, index = name.rpartition(".")
        size = sizes[stem] if dot else 0
        if name in of_poses:
            names.append(of_poses[name])
        elif size == 6 and index.isdigit() and not is_no_reading(stem):
            of_wrench = any(word in stem.lower() for word in ("wrench", "ft", "load", "force"))
            first, second = ("force", "torque") if of_wrench else ("position", "rotation")
            names.append(f"{first if int(index) < 3 else second}.{'xyz'[int(index) % 3]}")
        elif size == 3 and index.isdigit() and not stem[-1:].isdigit():
            names.append(f"{trailing_units(stem)[0][begin:]}_{'xyz'[int(index)]}")
        else:
            names.append(name[begin:])
    return names if len(set(names)) == len(names) else list(log.columns)


def _arrays(log: Log) -> dict[str, list[str]]:
    """Columns that begin with the name of an array, by that name."""
    begin: dict[str, list[str]] = {}
    for name in log.columns:
        for dot in (place for place, sign in enumerate(name) if sign == "."):
            begin.setdefault(name[:dot], []).append(name)
    whole = {name.rstrip("0123456789.") for name in log.columns if name[-1:].isdigit()}
    return {stem: begin[stem] for stem in dict.fromkeys(whole) if f"{stem}.0" in log.columns
            or f"{stem}.0.0" in log.columns}  # fmt: skip


def _pose_parts(log: Log, stem: str, own: list[str]) -> dict[str, str]:
    """What the components of a whole pose are: place and rotation matrix, or place and quaternion.

    Seven numbers are a pose where four at an end are a unit quaternion: joints are not.
    """
    matrix = [f"{stem}.{i}.{j}" for i in range(3) for j in range(4)]
    if own == matrix:
        place = {f"{stem}.{i}.3": f"position.{'xyz'[i]}" for i in range(3)}
        return place | {f"{stem}.{i}.{j}": f"r{i + 1}{j + 1}" for i in range(3) for j in range(3)}
    if own != [f"{stem}.{i}" for i in range(7)]:
        return {}
    values = np.stack([log.columns[name] for name in own], axis=1)
    for first in (3, 0):
        length = np.linalg.norm(values[:, first : first + 4], axis=1)
        if np.mean(np.abs(length - 1.0) < _UNIT) > _MOST_ROWS:
            turn = {own[first + i]: f"q{i}" for i in range(4)}
            return turn | {own[(first + 4 + i) % 7]: f"position.{'xyz'[i]}" for i in range(3)}
    return {}


def _settled(
    guesses: Sequence[Guess], sure: Collection[str], rotation: RotationSource | None
) -> list[Guess]:
    """The guesses that what else the log holds, of these `sure` quantities, leaves over."""
    left = [r for r in guesses if r.quantity not in ("quaternion", "matrix", "euler", "clinical")]
    if rotation is not None:
        left = [r for r in left if r.quantity not in ("rotvec", "rotation")]
    if len(left) > 1:  # tx beside mx is a translation, beside px a torque
        left = [r for r in left if r.quantity not in sure] or left
    return left


def _ask_axis(name: str, guess: Guess, source: str, sure: Collection[str]) -> None:
    if guess.part == "":
        turns = "position" not in sure and not {"rotation", "torque"}.isdisjoint(sure)
        axis = "z" if turns else "x"
        what = "displacement" if guess.quantity == "position" else guess.quantity
        along_x = QUANTITIES[guess.quantity].standard[0]
        raise Question(
            f"{source}: column '{name}' is a {what} without an axis: along (or about) the "
            "mechanism's own axis, which is x, or across it? Say --axis x, or --axis y or z; where "
            f'several have none, each by itself: --map "{along_x}={name}"',
            Answer(
                {"axis": axis},
                f"its axis is taken as {axis} (x is along the mechanism, y and z across it)",
            ),
        )


def _own_name(name: str) -> str:
    """A name for a column that is kept as it is: letters, digits and _."""
    text = "".join(c if c.isalnum() and c.isascii() else "_" for c in name).strip("_").lower()
    text = text if text and not text[0].isdigit() else f"own_{text}"
    return f"own_{text}" if is_standard(text) or likely_name(text) else text
