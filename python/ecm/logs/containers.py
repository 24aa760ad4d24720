"""Files of arrays: MATLAB, HDF5, NumPy, Parquet, and ROS 2 bags (extra `logs`)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ecm.errors import InputError
from ecm.io.events import Progress
from ecm.io.extras import read_parquet, readable, require
from ecm.logs.log import Log, Stream, join_streams, log_of_arrays
from ecm.logs.names import Answer, Question

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
Sample = tuple[str, dict[str, float]]
"""Frame or joint set of a sample, and its numbers by name."""


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
    streams: list[Stream] = []
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
        kind, stamped, samples = _MESSAGES[_kind(connection.msgtype)]
        message = reader.deserialize(raw, connection.msgtype)
        begin = received_ns if begin is None else begin
        received = (received_ns - begin) * 1e-9
        for one in message.transforms if hasattr(message, "transforms") else [message]:
            stamp = received
            if stamped and (one.header.stamp.sec or one.header.stamp.nanosec):
                own = one.header.stamp.sec * 1_000_000_000 + one.header.stamp.nanosec
                stamp = (own - begin) * 1e-9
            frame, numbers = samples(one)
            key = (f"{connection.topic}{frame and ':' + frame}", kind, connection.topic)
            rows.setdefault(key, []).append((stamp, received, numbers))
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


def _transform(message: Any) -> Sample:
    moved = message.transform
    return message.child_frame_id, _placed(moved.translation, moved.rotation)


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


_MESSAGES: dict[str, tuple[str, bool, Callable[[Any], Sample]]] = {
    "WrenchStamped": ("wrench", True, lambda m: ("", _wrench(m.wrench))),
    "Wrench": ("wrench", False, lambda m: ("", _wrench(m))),
    "PoseStamped": ("pose", True, lambda m: ("", _placed(m.pose.position, m.pose.orientation))),
    "Pose": ("pose", False, lambda m: ("", _placed(m.position, m.orientation))),
    "TransformStamped": ("pose", True, _transform),
    "TFMessage": ("pose", True, _transform),
    "JointState": ("joints", True, lambda m: ("", _joints(m))),
}


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
