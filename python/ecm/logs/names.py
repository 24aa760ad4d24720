"""What a column of a log is, by its name: quantity, axis and unit; and what names leave open.

Case and separators do not matter. `QUANTITIES` is the table of all that a name may tell. A name
that tells two quantities gets both: who asks decides by what else the log holds, or asks the user.
A question knows the answers that may be right, the likeliest first; `answered` of importing.py
tries them, so that a refusal ends in an import that works.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from ecm.errors import InputError, shortened
from ecm.io import columns
from ecm.io.columns import POSE, WRENCH, Unit, is_other_unit, is_standard
from ecm.io.settings import closest
from ecm.logs.log import Log


class Quantity(NamedTuple):
    """A row of the table: what columns may measure, and how they are called."""

    dimension: str
    words: str
    """Words of a name that tell it."""
    parts: str = "[xyz0-3]?"
    """Pattern of what may follow: an axis, a component."""
    standard: tuple[str, ...] = ()
    """The standard columns, along x, y and z, or a single one."""
    rotation: tuple[str, ...] = ()
    """Words for how the columns are a rotation (sources.py)."""
    question: str = ""
    """What the first two of these words mean."""


QUANTITIES = {
    "position": Quantity(
        "length",
        "pos position p u d disp displ displacement deflection translation trans location loc "
        "coordinate extension stroke elongation travel crosshead weg verschiebung",
        standard=POSE[:3],
    ),
    "force": Quantity("force", "f force load kraft", standard=WRENCH[:3]),
    "torque": Quantity("torque", "m torque moment tau trq mom drehmoment", standard=WRENCH[3:]),
    "rotvec": Quantity(
        "angle", "theta rotvec rv rodrigues axisangle", standard=POSE[3:], rotation=("rotvec",)
    ),
    "rotation": Quantity(
        "angle",
        "r rot rotation angle ang euler winkel deviation phi alpha",
        standard=POSE[3:],
        rotation=("rotvec", "xyz"),
        question="a rotation vector, or Euler angles of a sequence",
    ),
    "quaternion": Quantity(
        "number",
        "q quat quaternion orientation ori",
        parts="[xyzw0-4]",
        rotation=("wxyz", "xyzw"),
        question="a quaternion with its scalar first or last",
    ),
    "matrix": Quantity(
        "number",
        "r rot rotation matrix dcm",
        parts="[0-9]{1,2}|[xyz]{2}",
        rotation=("rows", "columns"),
        question="a rotation matrix row by row or column by column",
    ),
    "euler": Quantity("angle", "", rotation=("xyz",)),
    "clinical": Quantity(
        "angle",
        "",
        rotation=("grood-suntay-right", "grood-suntay-left"),
        question="a right knee or a left one",
    ),
    "time": Quantity(
        "time", "t time timestamp stamp timestamps elapsed zeit clock", "", ("time_s",)
    ),
    "dwell": Quantity("time", "dwell dwelltime", "", ("dwell_s",)),
    "temperature": Quantity("temperature", "temp temperature", "", ("temperature_degC",)),
    "sensor temperature": Quantity("temperature", "", "", ("sensor_temperature_degC",)),
    "strain": Quantity("strain", "strain stretch dehnung"),
    "stress": Quantity("stress", "stress"),
}


@dataclass(frozen=True)
class Guess:
    """What a name may mean.

    Parameters
    ----------
    quantity
        A key of `QUANTITIES`, or `standard` for a name of this project.
    part
        Axis, component of a quaternion or matrix, angle's name; empty where the name has none.
    """

    quantity: str
    part: str = ""

    @property
    def dimension(self) -> str:
        """Dimension of the quantity; empty for a name of this project, which has its unit."""
        return "" if self.quantity == "standard" else QUANTITIES[self.quantity].dimension

    def standard(self, axis: str = "") -> str | None:
        """Return the standard column; None where there is none, or its axis is not known."""
        if self.quantity == "standard":
            return self.part
        names = QUANTITIES[self.quantity].standard
        if len(names) == 1:
            return names[0]
        part = self.part or axis
        several = self.quantity == "rotation" and self.part != ""  # asked about as a whole
        return None if several or not names or part not in _AXES else names[_AXES.index(part)]


@dataclass(frozen=True)
class Named:
    """What a name may mean, likeliest first, and the unit that it states."""

    guesses: tuple[Guess, ...]
    unit: Unit | None = None

    @property
    def may_be_measured(self) -> bool:
        """Whether it may be of a pose or of a wrench, by its name."""
        return any(
            guess.dimension in _COLUMN_OF or guess.part in (*POSE, *WRENCH)
            for guess in self.guesses
        )

    def part(self, quantity: str) -> str:
        """Return the part of this quantity; empty where the name does not tell it."""
        return next((guess.part for guess in self.guesses if guess.quantity == quantity), "")


_AXES = ("x", "y", "z")
_QUANTITIES: dict[str, list[str]] = {}
for _quantity, _row in QUANTITIES.items():
    for _name in _row.words.split():
        _QUANTITIES.setdefault(_name, []).append(_quantity)
_LONG_WORDS = sorted((word for word in _QUANTITIES if len(word) > 2), key=len, reverse=True)
_ANGLES = {
    "euler": {"roll": "roll", "pitch": "pitch", "yaw": "yaw"},
    "clinical": {
        "flexion": "flexion flex extensionflexion",
        "adduction": "adduction varus varusvalgus",
        "internal": "internal internalrotation axialrotation internalrot introtation introt "
        "axialrot tibialrotation tibialrot internalexternal internalexternalrotation",
    },
}
"""Words of angles that have names of their own."""
ABOUT = {"roll": "x", "pitch": "y", "yaw": "z"}
"""Their axis where the others are 0."""
_NAMED_ANGLES = {
    word: Guess(quantity, part)
    for quantity, parts in _ANGLES.items()
    for part, words in parts.items()
    for word in words.split()
}
_AMONG_OTHERS = frozenset({"roll", "pitch", "yaw", "adduction", "varus", "flexion"})
"""Those that tell the angle beside any other words."""
_IGNORED = frozenset(
    {"pose", "tool", "tcp", "tip", "top", "platform", "marker", "rigid", "body", "ft", "fts", "ati"}
    | {"sensor", "measured", "actual", "meas", "robot", "ee", "end", "effector", "wrench", "msg"}
    | {"transform", "data", "value", "raw", "mean", "avg", "signal", "channel", "ch", "stamped"}
    | {"joint", "the", "of", "in", "about", "component", "wxyz", "xyzw", "mocap", "vicon"}
)
"""Words that say where or how something was measured, not what."""
_OF_SENSOR = frozenset({"sensor", "ft", "fts", "ati"})
"""Words before a temperature that is that of the sensor; a temperature sensor is a thermometer."""
_SIDES = frozenset({"r", "l", "right", "left"})
"""Last words that say which of two limbs: ankle_angle_r."""
_NOT_MEASURED = frozenset(
    {"error", "err", "limit", "commanded", "command", "cmd", "target", "desired", "setpoint"}
    | {"reference", "ref", "std", "sd", "sigma", "variance", "max", "min", "bias", "tare", "arm"}
    | {"velocity", "speed", "rate", "acceleration", "twist"}
)
"""Words of numbers that belong to a pose or wrench but are no reading of it."""


_OF_LOGS = {
    "time": dict.fromkeys(("d", "day", "days"), 86400.0)
    | dict.fromkeys(("week", "weeks"), 604800.0),
    "pressure": {"pa": 1.0, "kpa": 1e3, "mpa": 1e6, "mbar": 100.0, "bar": 1e5, "psi": 6894.757293},
    "volume": {"m3": 1.0, "cm3": 1e-6, "mm3": 1e-9, "l": 1e-3, "ml": 1e-6, "µl": 1e-9, "ul": 1e-9},
}
"""Units of pressures and volumes, of chambers and of a stress, and of long times: `x_d` of a table
is no time, nor is a column `day`."""
_STRAINS = {"%": 0.01, "pct": 0.01, "percent": 0.01} | {
    word: factor
    for factor, words in (
        (1.0, "mm/mm m/m in/in"), (1e-6, "um/m µm/m ue µe µε ustrain µstrain microstrain"),
    )
    for word in words.split()
}  # fmt: skip
_OF_ANYTHING = frozenset({"%", "pct", "percent"})
"""Units of a strain that alone do not tell one."""
_BRACKET = re.compile(r"(.*?)[\s_]*[\[(［（]\s*([^\[\]()［］（）]*?)\s*[\])］）]\s*")
"""A name, and the unit in brackets at its end."""
_WITH_UNIT = re.compile(r"(?P<name>.*?)[\s_]*[\s_\[(](?P<unit>[a-z]+)[\])]?")
_ACTUATORS = {
    "pressure": ("pressure", "Pa", "p pressure druck chamber kammer bellows balg"),
    "tension": ("force", "N", "tension tendon seilkraft"),
}
"""Inputs of a body: dimension and unit, and the words that tell one beside its number."""
_OF_TENDONS = frozenset({"tendon", "cable", "seil"})
_COUNTS = ("pose_id", "run", "repeat")
"""Standard columns of whole numbers without a unit, which other programs write in capitals."""


def find_unit(word: str) -> Unit | None:
    """Return the unit of a word, also of a pressure, a volume or days; None for no unit.

    Examples
    --------
    >>> find_unit("bar"), find_unit("N mm").factor
    (Unit(word='bar', dimension='pressure', factor=100000.0, offset=0.0), 0.001)
    """
    return columns.find_unit(word) or _of_logs(word)


def _of_logs(word: str) -> Unit | None:
    bare = word.strip(" []()")
    small = bare.lower().replace("³", "3").replace("^", "")
    dimension = next((name for name, own in _OF_LOGS.items() if small in own), "")
    return Unit(bare, dimension, _OF_LOGS[dimension][small]) if dimension else None


def unknown_unit(column: str, log: Log) -> str:
    """Return what stands in the place of a column's unit and is none that is known; else "".

    Examples
    --------
    >>> [unknown_unit(name, Log({})) for name in ("Force (furlong)", "Force (lbf)", "Force")]
    ['furlong', '', '']
    """
    bracket = _BRACKET.fullmatch(column)
    word = log.units.get(column, "") or (bracket[2] if bracket is not None else "")
    return "" if find_unit(word) is not None or is_other_unit(word) else word


def is_no_reading(name: str) -> bool:
    """Whether a name says that its numbers belong to a pose or wrench and are no reading of it.

    Examples
    --------
    >>> is_no_reading("twist"), is_no_reading("actual_TCP_speed"), is_no_reading("tcp_pose")
    (True, True, False)
    """
    return not _NOT_MEASURED.isdisjoint(words_of(name))


SI = {"length": "m", "angle": "rad", "force": "N", "torque": "Nm", "time": "s",
      "temperature": "degC", "pressure": "Pa", "volume": "m3"}  # fmt: skip


def given_units(words: Sequence[str]) -> dict[str, Unit]:
    """Return the unit of each dimension from words such as `mm`, `bar`, or `SI` for all.

    Raises
    ------
    InputError
        For an unknown word, or two units of one dimension.

    Examples
    --------
    >>> units = given_units(["mm", "N mm", "bar"])
    >>> units["torque"].factor, units["pressure"].factor
    (0.001, 100000.0)
    """
    usual: dict[str, Unit] = {}
    stated: dict[str, Unit] = {}
    for word in filter(None, (word.strip() for word in words)):
        if word.upper() == "SI":
            usual = {unit.dimension: unit for unit in filter(None, map(find_unit, SI.values()))}
            continue
        unit = find_unit(word)
        if unit is None:
            near = closest(word, columns.UNITS)
            hint = f"did you mean '{near}'?" if near else "known are m, mm, deg, N, N mm, lbf, SI"
            raise InputError(f"--units: '{word}' is no unit, {hint}")
        first = stated.setdefault(unit.dimension, unit)
        if first.factor != unit.factor:
            raise InputError(
                f"--units: '{first.word}' and '{unit.word}' are both units of "
                f"{unit.dimension}; give one, and --map NAME=COLUMN:UNIT for what differs"
            )
    return usual | stated


def read_name(name: str, unit_word: str = "") -> Named:
    """Return what a column's name may mean.

    Parameters
    ----------
    name
        As in the log.
    unit_word
        Unit that the log states for this column elsewhere.

    Examples
    --------
    >>> named = read_name("Force-X (lbf)")
    >>> named.guesses[0], named.unit.factor
    (Guess(quantity='force', part='x'), 4.4482216152605)
    >>> [guess.quantity for guess in read_name("tx").guesses]
    ['position', 'torque']
    >>> read_name("Force X (V)").guesses, read_name("Force X limit").guesses
    ((), ())
    >>> [read_name(name).guesses[0].standard() for name in ("FT temp [K]", "Temp sensor [degC]")]
    ['sensor_temperature_degC', 'temperature_degC']
    >>> read_name("P1 [kPa]").guesses[0].part, read_name("Run").guesses[0].part
    ('pressure_1_Pa', 'run')
    """
    if (sure := _sure(name, unit_word)) is not None:
        return sure
    unit = find_unit(unit_word) if unit_word else None
    bracket = _BRACKET.fullmatch(name)
    if bracket is not None and bracket[1]:
        unit_word = unit_word or bracket[2]
        name, unit = bracket[1], unit or find_unit(bracket[2])
    comma = re.fullmatch(r"(.*\w)\s*,\s*([^,]+)", name)
    if comma is not None and find_unit(comma[2]) is not None:
        name, unit = comma[1], unit or find_unit(comma[2])
    tokens = words_of(name)
    material = _of_material(tokens, unit_word)
    last = tokens[-1] if len(tokens) > 1 else ""
    if material is not None or is_other_unit(unit_word) or is_other_unit(last):
        return material or Named((), Unit(unit_word or last, "other"))
    for size in (2, 1):
        found = find_unit("".join(tokens[-size:])) if len(tokens) > size else None
        if found is None or _NOT_MEASURED.intersection(tokens[:-size]):
            continue
        guesses = _guesses(tokens[:-size])
        fitting = tuple(r for r in guesses if r.dimension == found.dimension)
        if fitting:
            return Named(fitting, found)  # time_min is in minutes, fx_min is a smallest force
    if _NOT_MEASURED.intersection(tokens):
        return Named(())
    guesses = _guesses(tokens)
    outer = re.match(r"[^./]*[./](?=.*[A-Za-z])", name)
    if not guesses and outer is not None and name[outer.end() :].strip().lower() not in _AXES:
        # log.t of a struct, /rig/ft/force.x of a topic; gyro.x is no position
        return read_name(name[outer.end() :], unit.word if unit is not None else unit_word)
    if unit is not None:
        guesses = tuple(r for r in guesses if r.dimension == unit.dimension)
    return Named(guesses, unit) if guesses or unit is not None else _of_unit_alone(name)


def _of_unit_alone(name: str) -> Named:
    """What a name that is nothing but a unit tells: 'deg' is some angle, in degrees."""
    unit = columns.find_unit(name)
    if unit is None or len(unit.word) < 2 or unit.word.lower() in _ALSO_WORDS:
        return Named(())
    fitting = (one for one in _BY_UNIT if QUANTITIES[one].dimension == unit.dimension)
    return Named(tuple(Guess(one) for one in fitting), unit)


_BY_UNIT = ("position", "force", "torque", "rotation", "time", "temperature")
"""A quantity of each dimension, whose axis is asked for."""
_ALSO_WORDS = ("in", "ft", "rev")
"""Units that are names of other things: an input, a sensor of force and torque, a revision."""


def _sure(name: str, unit_word: str) -> Named | None:
    """What a name of this project means, and a numbered pressure or tension with its unit."""
    if is_standard(name):
        return Named((Guess("standard", name),))
    bare = "_".join(words_of(name))
    if bare in _COUNTS:
        return Named((Guess("standard", bare),))
    found = _WITH_UNIT.fullmatch(f"{name} {unit_word}".strip().lower())
    unit = None if found is None else find_unit(found["unit"])
    if found is None or unit is None:
        return None
    numbers = re.findall(r"[0-9]+", found["name"])
    words = set(re.findall(r"[^\W\d_]+", found["name"])) - _IGNORED
    for kind, (dimension, si, telling) in _ACTUATORS.items():
        told = words.intersection(telling.split())
        # One number counts them; further words may say that it is something else's pressure.
        plain = told and words - told <= _OF_TENDONS and len(numbers) == 1
        if unit.dimension == dimension and plain and not numbers[0].startswith("0"):
            return Named((Guess("standard", f"{kind}_{numbers[0]}_{si}"),), unit)
    return None


def _of_material(tokens: Sequence[str], unit_word: str) -> Named | None:
    """The strain or stress that words and unit tell; None for anything else."""
    for kind in ("strain", "stress"):
        known = set(QUANTITIES[kind].words.split())
        own = _small(unit_word)
        telling = kind == "strain" and own in _STRAINS.keys() - _OF_ANYTHING
        if not (telling or known.intersection(tokens)) or _NOT_MEASURED.intersection(tokens):
            continue
        for word in (unit_word, *("".join(tokens[-size:]) for size in (2, 1))):
            small = _small(word)
            factor = (_STRAINS if kind == "strain" else _OF_LOGS["pressure"]).get(small)
            if factor is not None:
                return Named((Guess(kind),), Unit(word, kind, factor))
        return None if unit_word else Named((Guess(kind),))
    return None


def _small(word: str) -> str:
    """A unit's word without spaces in small letters; both letters for micro are one."""
    return columns.plain(word).strip().lower()


def trailing_units(name: str) -> tuple[str, dict[str, Unit]]:
    """Return the name of an array without the units at its end, and these by dimension.

    Examples
    --------
    >>> name, units = trailing_units("Wrench [N, N mm]")
    >>> name, {dimension: unit.word for dimension, unit in units.items()}
    ('Wrench', {'force': 'N', 'torque': 'Nmm'})
    >>> trailing_units("position_mm")[0], trailing_units("force")
    ('position', ('force', {}))
    """
    bracket = _BRACKET.fullmatch(name)
    if bracket is not None and bracket[1]:
        given = [find_unit(word) for word in bracket[2].split(",")]
        return bracket[1], {unit.dimension: unit for unit in given if unit is not None}
    units: dict[str, Unit] = {}
    while True:
        cut = re.fullmatch(r"(.*[A-Za-z0-9])[\s_.-]+([A-Za-z°µ]+)", name)
        found = find_unit(cut[2]) if cut is not None else None
        if cut is None or found is None or found.dimension in units:
            return name, units
        name, units[found.dimension] = cut[1], found


def words_of(name: str) -> list[str]:
    """Words of a name: 'ForceX', 'force_x' and 'Force X' are ['force', 'x']."""
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z0-9])|(?<=[A-Z])(?=[A-Z][a-z])", " ", name)
    return [token.lower() for token in re.split(r"[^A-Za-z0-9°µ]+", spaced) if token]


def _guesses(tokens: list[str]) -> tuple[Guess, ...]:
    labview = tokens == ["x", "value"]  # LabVIEW's first column, which mostly is time
    if len(tokens) > 1 and tokens[0] in _OF_SENSOR and _quantities(tokens[1]) == ["temperature"]:
        return (Guess("sensor temperature"),)
    tokens = [token for token in tokens if token not in _IGNORED] or tokens[-1:]
    for word in ("".join(tokens), *(token for token in tokens if token in _AMONG_OTHERS)):
        if word in _NAMED_ANGLES:
            return (_NAMED_ANGLES[word],)
    if len(tokens) > 1 and tokens[-1] in _SIDES:
        tokens = tokens[:-1]
    stem, part = _split_axis(tokens)
    found = [q for q in _quantities(stem) if re.fullmatch(QUANTITIES[q].parts, part)]
    if stem in ("", "own") and part in _AXES:
        found = ["time", "position"] if labview else ["position"]
    elif stem == "t" and part:
        found = ["position", "torque"]
    elif stem in ("u", "d") and part not in _AXES:
        found = []  # a voltage, a number of a sample
    return tuple(Guess(q, "" if q in ("time", "dwell") else part) for q in found)


def _quantities(stem: str) -> list[str]:
    """Quantities of a stem; of two words the last known one counts, so 'wrench torque' is one."""
    if stem in _QUANTITIES:
        return _QUANTITIES[stem]
    ends = (word for word in _LONG_WORDS if stem.endswith(word))
    begins = (word for word in _LONG_WORDS if stem.startswith(word))
    word = next(ends, None) or next(begins, None)
    return [] if word is None else _QUANTITIES[word]


def _split_axis(tokens: list[str]) -> tuple[str, str]:
    """Stem and part: ['force', 'x'], ['fx'], ['x', 'force'] and ['q', '0'], ['r', '1', '2']."""
    text = [token for token in tokens if token not in "xyzw" and not token.isdigit()]
    parts = [token for token in tokens if token not in text]
    if parts:
        return "".join(text), "".join(parts)
    match = re.fullmatch(r"([a-z]+?)([xyzw]|[0-9]{1,2})", "".join(text))
    if match is not None and (match[1] in _QUANTITIES or match[1] == ""):
        return match[1], match[2]
    return "".join(text), ""


_KINDS = {"pose": POSE, "wrench": WRENCH}
_DIMENSIONS = {"pose": ("length", "angle"), "wrench": ("force", "torque")}
_COLUMN_OF = {
    "length": ("x_m", "mm"),
    "angle": ("theta_z_rad", "deg"),
    "force": ("fx_N", "N"),
    "torque": ("tau_z_Nm", "N mm"),
}
"""The column that one of this dimension becomes, and its unit where none is stated."""
_ALONG = {"length": POSE[:3], "angle": POSE[3:], "force": WRENCH[:3], "torque": WRENCH[3:]}
_WORDS = {"length": "displacement", "angle": "rotation", "force": "force", "torque": "torque"}
_PER_ONE = {
    "strain": ("pose", "gauge length", "50 mm"),
    "stress": ("wrench", "cross-section", "100 mm2"),
}
"""What a strain or stress is multiplied by, and the size of an example."""
_MOST_LISTED, _MOST_LINES = 8, 20


@dataclass(frozen=True)
class Answer:
    """Options of `import_log`, and what they take for granted, in words."""

    options: Mapping[str, Any] = field(default_factory=dict)
    words: str = ""


class Question(InputError):
    """A log may be read in several ways.

    Parameters
    ----------
    message
        What is open, and the options that decide.
    answers
        The ways, the likeliest first.

    Examples
    --------
    >>> question = Question("no axis", Answer({"axis": "x"}, "its axis is taken as x"))
    >>> print(question, question.answers[0].options)
    no axis {'axis': 'x'}
    """

    def __init__(self, message: str, *answers: Answer) -> None:
        super().__init__(message)
        self.answers = answers


def named_as(standard: str, column: str) -> Answer:
    """The answer that a column of the log is a standard one."""
    words = f"column '{column.rpartition(':')[0] or column}' is taken as {standard}"
    return Answer({"columns": {standard: column}}, words)


def missing(log: Log, named: Mapping[str, Named], found: Collection[str]) -> tuple[Answer, ...]:
    """What else may be the pose or the wrench that no name tells; empty where both are found.

    A strain or a stress comes first, with a length or an area to be put in; then columns of a
    fitting unit; then, as an example, any that vary and do not always rise, as the time does.

    Parameters
    ----------
    log
        The log.
    named
        What each name of its columns tells.
    found
        Standard columns that were found, and the columns of the log that they are read from.
    """
    chosen: dict[str, str] = {}
    words, examples = [], []
    taken = set(found)
    for kind, standards in _KINDS.items():
        if taken.intersection(standards):
            continue
        left = {name: values for name, values in log.columns.items() if name not in taken}
        known = _by_name(kind, {name: named[name] for name in left})
        if known is not None:
            standard, column, ending, said = known
            words.append(said)
        else:
            varying = [name for name, values in left.items() if _varies(values)]
            # Bare numbers and volts may stand for it; what has another unit is no example.
            varying = [n for n in varying if (u := named[n].unit) is None or u.dimension == "other"]
            # What always rises is a clock, or the number of a row.
            free = [n for n in varying if not (np.diff(left[n]) > 0.0).all()] or varying
            if not free:
                return ()
            turned = not taken.isdisjoint((*POSE[3:], *WRENCH[3:]))
            dimension = _DIMENSIONS[kind][turned]
            standard, ending = _COLUMN_OF[dimension]
            column, example = free[0], f"in {ending}"
            unit = named[column].unit
            if unit is not None and unit.dimension == "other":  # volts: what is one of them worth
                ending = f"1 {ending}"
                example = f"of {ending} a {unit.word}"
            examples.append(f"'{column}' stands for a {_WORDS[dimension]} {example}")
        chosen[standard] = f"{column}:{ending}" if ending else column
        taken |= {standard, column}
    if examples:
        extents = [f"{name} ({low} to {high})" for name, low, high in _extents(log)]
        listed = ", ".join(extents[:_MOST_LISTED]) + (", ..." if extents[_MOST_LISTED:] else "")
        words.append(
            f"no name tells which column is what: {' and '.join(examples)} as an example, put in "
            f"the right ones of {listed}"
        )
    return (Answer({"columns": chosen}, "; ".join(words)),) if chosen else ()


def _by_name(kind: str, named: Mapping[str, Named]) -> tuple[str, str, str, str] | None:
    """Standard column, own column, its unit or worth, and words of what a name or unit tells."""
    for name, own in named.items():
        for material, (of, what, size) in _PER_ONE.items():
            if of == kind and any(guess.quantity == material for guess in own.guesses):
                said = f"'{name}' is a {material}, taken with a {what} of {size} (put in yours)"
                return _KINDS[kind][0], name, size, said
    for dimension in _DIMENSIONS[kind]:
        usual_one, usual = _COLUMN_OF[dimension]
        for name, own in named.items():
            stated = own.unit is not None and own.unit.dimension == dimension
            stated = stated or dimension in trailing_units(name)[1]
            parts = [guess.part for guess in own.guesses if guess.dimension == dimension]
            if stated or parts:
                axes = dict(zip(_AXES, _ALONG[dimension], strict=True))
                standard = axes.get("".join(ABOUT.get(part, part) for part in parts[:1]), usual_one)
                ending = "" if stated else usual
                return standard, name, ending, f"'{name}' is taken as {standard}"
    return None


def _extents(log: Log) -> list[tuple[str, str, str]]:
    """Name, smallest and largest number of each column."""
    return [(n, f"{np.nanmin(v):.4g}", f"{np.nanmax(v):.4g}") for n, v in log.columns.items()]


def ranges(log: Log) -> str:
    """The first columns with their smallest and largest number or first word, a line each."""
    lines = [f"  {name}: {low} to {high}" for name, low, high in _extents(log)]
    lines += [f"  {name}: text, as '{shortened(str(own[0]))}'" for name, own in log.text.items()]
    return "\n".join(lines[:_MOST_LINES]) + ("\n  ..." if len(lines) > _MOST_LINES else "")


def _varies(values: Any) -> bool:
    known = values[np.isfinite(values)]
    return len(known) > 1 and bool(np.ptp(known) > 0.0)
