"""Files of logs: text with any separator, MATLAB, HDF5, NumPy, Parquet, ROS 2 bags (extra `logs`).

Text has a preamble, comments, a row of units, decimal points or commas.
"""

from __future__ import annotations

import contextlib
import math
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecm.errors import InputError, shown
from ecm.io.arrays import F
from ecm.io.columns import TEXT, is_other_unit
from ecm.io.csv import RawTable, grouped_names, read_lines
from ecm.io.events import Progress, tell_part
from ecm.io.extras import read_parquet, readable, require
from ecm.io.settings import OTHER_FILES
from ecm.logs.log import (
    DECIMAL_COMMA,
    HEADERS_AGAIN,
    Log,
    Stream,
    join_streams,
    log_of_arrays,
    number,
    numbers_in_words,
    unique_names,
)
from ecm.logs.names import Answer, Question, find_unit

_REMARKS = frozenset({"comment", "comments", "kommentar", "note", "notes", "remark", "remarks"})
"""Names of a last column that has no cells in most rows, as LabVIEW writes it."""
_THOUSANDS = re.compile(r"^[+-]?[1-9]\d{0,2}(,\d{3})+(\.\d+)?$")
_DECIMAL_POINT = re.compile(r"^[+-]?[\d,]*\.\d+([eE][+-]?\d+)?$")


def has_decimal_comma(lines: list[str], separator: str | None, path: Path) -> bool:
    """Whether commas are decimal; InputError where they may separate thousands."""
    found = ""
    for line in lines:
        for cell in map(str.strip, split(line, separator) if "," in line else ()):
            if _THOUSANDS.match(cell):
                found = found or cell
            elif DECIMAL_COMMA.match(cell):
                return True
    if found and any(
        _DECIMAL_POINT.match(cell.strip()) for line in lines for cell in split(line, separator)
    ):
        raise InputError(
            f"{path}: {shown(found)} may be thousands or a decimal comma: other cells have a "
            "decimal point. Save the log without separators of thousands."
        )
    return bool(found)


def is_number(cell: str, comma: bool) -> bool:
    """Whether a cell is a number; with `comma` also one with a decimal comma."""
    return not math.isnan(number(cell, comma))


SEPARATORS = {"semicolons": ";", "tabs": "\t", "commas": ",", "bars": "|", "spaces": None}
"""What stands between the cells of a line, by its word; None: any number of spaces."""


def split(line: str, separator: str | None) -> list[str]:
    """The cells of a line; commas inside quotes are none."""
    if separator == "," and '"' in line:
        return re.findall(r'(?:^|,)("(?:[^"]|"")*"|[^,]*)', line)
    return line.split(separator)


def ends_with_remark(cells: list[str], width: int) -> bool:
    """Whether a line of names has one more, for a remark that most rows do not have."""
    return len(cells) == width + 1 and cells[-1].strip().lower() in _REMARKS


def of_width(cells: list[str], width: int, remarks: bool) -> list[str]:
    """The cells, without one at the end that is empty or a remark where they are one too many."""
    if len(cells) == width:
        return cells
    return cells[:width] if remarks and len(cells) == width + 1 else trimmed(cells)


def trimmed(cells: list[str]) -> list[str]:
    """The cells without one empty cell that a separator at the end of the line makes."""
    return cells[:-1] if len(cells) > 1 and not cells[-1].strip() else cells


_SAMPLE = 400
"""Lines from which separator and first row of numbers are found."""
_COMMENT = re.compile(r"^\s*(#|%|//|!|\*)")


def read_text_log(path: Path, progress: Progress | None = None) -> Log:
    """Read a text file of numbers; InputError where no rows of numbers are found.

    `progress` is told the rows that are read, of all.
    """
    lines = _decoded(path).splitlines()
    kept = [line for line in lines if line.strip(' \t;,|"') and not _COMMENT.match(line)]
    comments = [line for line in lines if _COMMENT.match(line)]
    word, begin, width = _layout(kept[:_SAMPLE], path)
    sign = SEPARATORS[word]
    comma = word != "commas" and has_decimal_comma(kept[begin:], sign, path)
    remarks = any(ends_with_remark(split(line, sign), width) for line in kept[:begin])
    above = [of_width(split(line, sign), width, remarks) for line in kept[:begin]]
    names, units = _header(above, comments, sign, width)
    heads = {
        line for line in kept[:begin] if not any(is_number(c, True) for c in split(line, sign))
    }
    again = len(kept)
    kept[begin:] = [line for line in kept[begin:] if line not in heads]
    again -= len(kept)

    def told(rows: int) -> None:
        tell_part(progress, rows, len(kept) - begin)

    def cells_of(lines: Iterable[str], before: int) -> Iterator[tuple[int, list[str]]]:
        for place, line in enumerate(lines, before + 1):
            yield place, of_width(split(line, sign), width, remarks)

    raw = read_lines(kept[begin:], names, cells_of, told, separator=sign, comma=comma)
    columns, text, epochs = _columns(raw, comma, units)
    bad = len(raw.ragged)
    notes = [f"text with {word}{' and decimal commas' if comma else ''}, {len(kept) - begin} rows"]
    if len(kept[:begin]) > bool(above) + bool(units):
        notes.append(f"{begin} line(s) above the numbers")
    if not above and not _named_by_comment(comments, sign, width):
        notes.append("no line of names: the columns are called column_1, column_2, ...")
    if above and _counts_rows(above[-1], names, columns):
        del columns[names[0]]
        notes.append("the first column has no name and counts the rows: it was left aside")
    if again:
        notes.append(f"{again} {HEADERS_AGAIN}")
    if bad:
        notes.append(f"{bad} line(s) do not have {width} cells and were left out")
    return Log(columns, text, units, tuple(notes), epochs)


def _counts_rows(header: Sequence[str], names: Sequence[str], columns: dict[str, F]) -> bool:
    """Whether the first column is the number of the row, as data frames are written."""
    values = columns.get(names[0])
    unnamed = len(header) == len(names) > 1 and not header[0].strip(' "')
    return unnamed and values is not None and bool(np.all(np.diff(values) == 1.0))


_JAPANESE = re.compile(rb"(?:[\x81-\x9f][\x40-\x7e\x80-\xfc]){2}")
"""Two letters of two bytes side by side, as in tables that Excel writes in Japan.

One alone may be a curled quotation mark and a letter of a western table.
"""


def _decoded(path: Path) -> str:
    raw = path.read_bytes()
    wide = raw[:2] in (b"\xff\xfe", b"\xfe\xff")
    with contextlib.suppress(UnicodeDecodeError):
        if wide or b"\0" not in raw[:65536]:
            return raw.decode("utf-16" if wide else "utf-8-sig")
    if b"\0" in raw[:65536]:
        raise InputError(f"{path}: a binary file of a kind that is not known here. {OTHER_FILES}")
    with contextlib.suppress(UnicodeDecodeError):
        if _JAPANESE.search(raw):
            return raw.decode("cp932")
    return raw.decode("latin-1")


def _layout(lines: list[str], path: Path) -> tuple[str, int, int]:
    """The word of the separator, first row of numbers, and number of cells."""
    best: tuple[float, str, int, int] | None = None
    for word, separator in SEPARATORS.items():
        cells = [split(line, separator) for line in lines]
        full = Counter(map(len, cells[len(cells) // 2 :])).most_common(1)
        # A column of remarks is empty in most rows, and a column all the same.
        if not any(full and len(row) == full[0][0] and row[-1].strip() for row in cells):
            cells = [trimmed(row) for row in cells]
        counts = [len(row) for row in cells[len(cells) // 2 :]]
        if not counts:
            continue
        width = max(set(counts), key=lambda n: (counts.count(n), n))
        shares = [_share(row, word) if len(row) == width else 0.0 for row in cells]
        late = shares[len(shares) // 2 :]
        typical = float(np.median(late))
        least = max(0.5, 0.8 * typical)
        begin = next(
            (
                i
                for i, (row, share) in enumerate(zip(cells, shares, strict=True))
                if share >= least
                or (len(row) == width + 1 and _share(row[:-1], word) >= least)  # with a remark
            ),
            None,
        )
        if begin is None or typical <= 0.0:
            continue
        score = sum(late) / len(late) + 1e-3 * width
        if best is None or score > best[0]:
            best = (score, word, begin, width)
    if best is None:
        raise InputError(
            f"{path}: no rows of numbers were found with commas, semicolons, tabs or spaces "
            "between them. Save the log as CSV with one header line."
        )
    return best[1:]


def _share(cells: list[str], word: str) -> float:
    """Share of the cells that are numbers."""
    return sum(is_number(cell, word != "commas") for cell in cells) / len(cells)


def _header(
    above: list[list[str]],
    comments: list[str],
    separator: str | None,
    width: int,
) -> tuple[list[str], dict[str, str]]:
    """Names and units from the lines above the numbers, else from the last comment."""
    rows = [row for row in above if len(row) == width]
    without_numbers = [row for row in rows if not any(is_number(cell, True) for cell in row)]
    rows = without_numbers or rows
    unit_row: list[str] = []
    if len(rows) > 1 and _is_unit_row(rows[-1]):
        unit_row = [cell.strip().strip('"') for cell in rows.pop()]
    if rows:
        names = rows[-1]
        if len(rows) > 1 and len(set(names)) < len(names):  # Force, , over X, Y, Z
            names = grouped_names([cell.strip() for cell in rows[-2]], names)
    else:
        names = _named_by_comment(comments, separator, width) or [""] * width
    words = (" ".join(name.strip().strip('"').split()) for name in names)
    names = unique_names(word or f"column_{i}" for i, word in enumerate(words, 1))
    units = {n: u for n, u in zip(names, unit_row, strict=False) if _is_unit(u)}
    return names, units


def _named_by_comment(comments: list[str], separator: str | None, width: int) -> list[str]:
    """Names in the last comment that has the width of the rows."""
    for line in reversed(comments):
        cells = trimmed(split(_COMMENT.sub("", line).strip(), separator))
        if len(cells) == width and not any(is_number(cell, True) for cell in cells):
            return cells
    return []


def _is_unit_row(cells: Sequence[str]) -> bool:
    """Whether a line holds units: each cell a unit, empty or `-`, and one of them known here."""
    words = [cell.strip().strip('[]()"') for cell in cells]
    stated = [word for word in words if word not in ("", "-", "1")]
    return all(map(_is_unit, stated)) and any(find_unit(word) is not None for word in stated)


def _is_unit(word: str) -> bool:
    return find_unit(word) is not None or is_other_unit(word)


def _columns(
    raw: RawTable, comma: bool, units: dict[str, str]
) -> tuple[dict[str, F], dict[str, NDArray[np.object_]], dict[str, float]]:
    """Numbers, text and epochs by name. Dates become seconds, which is added to `units`."""
    columns: dict[str, F] = {}
    epochs: dict[str, float] = {}
    text: dict[str, NDArray[np.object_]] = {}
    for name, cells in zip(raw.names, raw.columns, strict=True):
        if isinstance(cells, np.ndarray):
            columns[name] = cells
            continue
        values = np.array([number(str(cell), comma) for cell in cells])
        if name not in TEXT and np.isfinite(values).mean() > 0.5:
            columns[name] = values
        elif name not in TEXT and (found := numbers_in_words(cells, comma)) is not None:
            columns[name], units[name], epochs[name] = found
        else:
            text[name] = np.array([str(cell).strip().strip('"') for cell in cells], dtype=object)
    return columns, text, epochs


_HDF5 = b"\x89HDF\r\n\x1a\n"
_DEEPEST = 6
"""Structs inside structs that are looked into."""


def read_parquet_log(path: Path) -> Log:
    """Read a Parquet file; MissingExtra names the extra `data`."""
    raw = read_parquet(path)
    return log_of_arrays(dict(zip(raw.names, raw.columns, strict=True)), str(path))


def read_numpy(path: Path) -> Log:
    """Read NPZ, or NPY with names (a structured array) or with columns."""
    # np.load leaves a damaged archive open.
    with readable(path, "NumPy file of plain arrays"), path.open("rb") as file:
        loaded = np.load(file, allow_pickle=False)
        if isinstance(loaded, np.ndarray):
            arrays = {n: loaded[n] for n in loaded.dtype.names} if loaded.dtype.names else None
            return log_of_arrays(arrays or {"column": loaded}, str(path))
        with loaded:
            return log_of_arrays({name: loaded[name] for name in loaded.files}, str(path))


def read_matlab(path: Path) -> Log:
    """Read a MAT file; 7.3 is HDF5 and needs h5py (extra `logs`)."""
    if is_hdf5(path):
        return read_hdf5(path)
    from scipy.io import loadmat  # noqa: PLC0415 - scipy.io takes long to load

    with readable(path, "MAT file"):
        content = loadmat(path, simplify_cells=True)
        return log_of_arrays(dict(_leaves(content, "", 0)), str(path))


def is_hdf5(path: Path) -> bool:
    """Whether a file is HDF5; a MAT file of version 7.3 has its signature after 512 bytes."""
    with path.open("rb") as file:
        head = file.read(520)
    return head.startswith(_HDF5) or head[512:520] == _HDF5


def read_hdf5(path: Path) -> Log:
    """Read the data sets of an HDF5 file; those of a MAT file are turned back to rows."""
    h5py = require("h5py", "logs", f"Reading {path}")
    arrays: dict[str, Any] = {}

    def visit(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and not name.startswith("#"):
            value = np.asarray(item[()])
            kind = item.attrs.get("MATLAB_class")
            if kind is None:
                arrays[name.replace("/", ".")] = value
            elif kind not in (b"char", b"cell"):  # MATLAB counts the first axis fastest
                arrays[name.replace("/", ".")] = value.T

    with readable(path, "HDF5 file"):
        with h5py.File(path, "r") as file:
            file.visititems(visit)
        return log_of_arrays(arrays, str(path))


def _leaves(content: Mapping[str, Any], prefix: str, depth: int) -> Iterator[tuple[str, Any]]:
    """Arrays of nested structs, as `outer.inner`."""
    for name, value in content.items():
        if name.startswith("__"):
            continue
        label = f"{prefix}{name}"
        if isinstance(value, Mapping):
            if depth < _DEEPEST:
                yield from _leaves(value, f"{label}.", depth + 1)
        else:
            yield label, value


_NEXT = (
    "A file that was cut off is mended by `ros2 bag reindex` or `mcap recover`; messages that are "
    "not of ROS 2 have to be saved as CSV or Parquet."
)
_TOLD = 1000
"""Messages between two words of progress."""


def is_bag(path: Path) -> bool:
    """Whether a path is a bag: a folder with metadata.yaml, or a .mcap, .db3 or .bag file."""
    return (path / "metadata.yaml").is_file() or path.suffix in (".mcap", ".db3", ".bag")


def read_bag(path: Path, topics: Sequence[str] = (), progress: Progress | None = None) -> Log:
    """Read poses, wrenches and joints of a bag and join them by time.

    Parameters
    ----------
    path
        Folder of the bag, or its file.
    topics
        Topics to use, where several hold a pose or a wrench; `TOPIC:FRAME` chooses one frame of a
        topic with several.
    progress
        Told the messages that are read, of all.

    Raises
    ------
    InputError
        For a bag that cannot be read, without usable topics, or with several for one purpose.
    MissingExtra
        Where rosbags is not installed.
    """
    highlevel = require("rosbags.highlevel", "logs", f"Reading {path}")
    typesys = require("rosbags.typesys", "logs", f"Reading {path}")
    store = typesys.get_typestore(typesys.Stores.LATEST)
    with (
        readable(path, "bag", _NEXT),
        highlevel.AnyReader([path], default_typestore=store) as reader,
    ):
        used = [c for c in reader.connections if _kind(c.msgtype) in _MESSAGES]
        found = {c.topic: c.msgtype for c in reader.connections}
        streams = _streams(reader, used, progress)
    if topics:
        _check_topics(topics, streams, path)
        streams = [s for s in streams if s.name in topics or s.name.split(":")[0] in topics]
    if not streams:
        shown = ", ".join(f"{topic} ({kind})" for topic, kind in list(found.items())[:8])
        raise InputError(
            f"{path}: no pose, wrench or joint state was found; topics: {shown or 'none'}. "
            f"Read are {', '.join(sorted(_MESSAGES))}."
        )
    _check_one_of_each(streams, path)
    return join_streams(streams, str(path))


def _streams(reader: Any, connections: Sequence[Any], progress: Progress | None) -> list[Stream]:
    """One stream for each topic, and for each frame of a topic of transforms."""
    rows: dict[tuple[str, str, str], list[tuple[float, float, dict[str, float]]]] = {}
    begin: int | None = None
    whole = sum(connection.msgcount for connection in connections)
    for done, (connection, received_ns, raw) in enumerate(reader.messages(connections=connections)):
        if progress is not None and done % _TOLD == 0:
            progress(done, max(whole, done), "messages")
        kind, stamped, numbers_of = _MESSAGES[_kind(connection.msgtype)]
        message = reader.deserialize(raw, connection.msgtype)
        begin = received_ns if begin is None else begin
        received = (received_ns - begin) * 1e-9
        for one in message.transforms if hasattr(message, "transforms") else [message]:
            stamp = received
            if stamped and (one.header.stamp.sec or one.header.stamp.nanosec):
                own = one.header.stamp.sec * 1_000_000_000 + one.header.stamp.nanosec
                stamp = (own - begin) * 1e-9
            frame = getattr(one, "child_frame_id", "")
            key = (f"{connection.topic}{frame and ':' + frame}", kind, connection.topic)
            rows.setdefault(key, []).append((stamp, received, numbers_of(one)))
    several = {topic for _, _, topic in rows if sum(t == topic for _, _, t in rows) > 1}
    streams = []
    for (name, kind, topic), samples_of in rows.items():
        names = list(samples_of[0][2])
        columns = {n: np.array([row[2].get(n, np.nan) for row in samples_of]) for n in names}
        streams.append(
            Stream(
                name if topic in several else topic,
                kind,
                np.array([row[0] for row in samples_of]),
                columns,
                {n: _UNITS[n.split(".")[0]] for n in names if n.split(".")[0] in _UNITS},
                np.array([row[1] for row in samples_of]),
            )
        )
    return streams


_UNITS = {"position": "m", "force": "N", "torque": "Nm", "angle": "rad", "effort": "Nm"}


def _vector(name: str, value: Any) -> dict[str, float]:
    return {f"{name}.{axis}": float(getattr(value, axis)) for axis in "xyz"}


def _placed(position: Any, orientation: Any) -> dict[str, float]:
    turn = {f"orientation.{axis}": float(getattr(orientation, axis)) for axis in "xyzw"}
    return _vector("position", position) | turn


def _wrench(wrench: Any) -> dict[str, float]:
    return _vector("force", wrench.force) | _vector("torque", wrench.torque)


def _transform(message: Any) -> dict[str, float]:
    return _placed(message.transform.translation, message.transform.rotation)


def _joints(message: Any) -> dict[str, float]:
    """Angles and efforts: of one joint the pair `angle`, `torque`, of several q1_rad, q2_rad."""
    angles, efforts = list(message.position), list(message.effort)
    if len(angles) == 1:
        return {"angle": float(angles[0])} | (
            {"torque": float(efforts[0])} if len(efforts) == 1 else {}
        )
    return {f"q{i + 1}_rad": float(angle) for i, angle in enumerate(angles)} | {
        f"effort.{i + 1}": float(effort) for i, effort in enumerate(efforts)
    }


def _kind(msgtype: str) -> str:
    return msgtype.rsplit("/", 1)[-1]


_MESSAGES: dict[str, tuple[str, bool, Callable[[Any], dict[str, float]]]] = {
    "WrenchStamped": ("wrench", True, lambda m: _wrench(m.wrench)),
    "Wrench": ("wrench", False, _wrench),
    "PoseStamped": ("pose", True, lambda m: _placed(m.pose.position, m.pose.orientation)),
    "Pose": ("pose", False, lambda m: _placed(m.position, m.orientation)),
    "TransformStamped": ("pose", True, _transform),
    "TFMessage": ("pose", True, _transform),
    "JointState": ("joints", True, _joints),
}
"""Kind of a message, whether it has a stamp of its own, and its numbers by name."""


def _check_topics(topics: Sequence[str], streams: Sequence[Stream], path: Path) -> None:
    names = {s.name for s in streams} | {s.name.split(":")[0] for s in streams}
    for topic in topics:
        if topic not in names:
            raise InputError(
                f"{path}: no pose, wrench or joint state on '{topic}'; usable topics: "
                f"{', '.join(sorted(names)) or 'none'}"
            )


def _check_one_of_each(streams: Sequence[Stream], path: Path) -> None:
    """Raise InputError where two streams hold the same: both are readings of the log."""
    for kind in ("wrench", "pose", "joints"):
        names = [s.name for s in streams if s.kind == kind]
        if len(names) > 1:
            others = [s.name for s in streams if s.kind != kind]
            raise Question(
                f"{path}: {len(names)} streams hold a {kind.removesuffix('s')}: "
                f"{', '.join(names)}. Which one is meant? Give --topic for each that is used.",
                *(
                    Answer({"topics": [name, *others]}, f"its {kind} is taken from {name}")
                    for name in names
                ),
            )
