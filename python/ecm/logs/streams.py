"""Streams of samples with their own times, joined to rows by interpolation.

The slower stream gives the times, so that no row is made of samples that were never taken. Rows in
a gap of a faster stream are left out: a straight line over a long gap is no measurement.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ecm.errors import InputError
from ecm.io.arrays import B, F
from ecm.logs.log import Log

_GAP = 5.0
"""Times that are farther apart than so many median steps are a gap."""


@dataclass(frozen=True)
class Stream:
    """Samples of one source.

    Parameters
    ----------
    name
        Topic, and frame where a topic has several.
    kind
        `pose`, `wrench` or `joints`.
    time_s
        (N,) stamp of each sample.
    columns
        (N,) numbers by name; `orientation.x` to `orientation.w` is a quaternion.
    units
        Unit word by column.
    received_s
        (N,) when each sample was written.
    """

    name: str
    kind: str
    time_s: F
    columns: Mapping[str, F]
    units: Mapping[str, str]
    received_s: F

    @property
    def step_s(self) -> float:
        """Median time between samples."""
        return float(np.median(np.diff(self.time_s))) if len(self.time_s) > 1 else 0.0

    def sentence(self) -> str:
        """Return number, rate, largest gap and latency in words."""
        rate = f"{1.0 / self.step_s:.3g} Hz" if self.step_s > 0.0 else "no rate"
        gap = float(np.diff(self.time_s).max()) if len(self.time_s) > 1 else 0.0
        late = float(np.median(self.received_s - self.time_s))
        return (
            f"{self.name}: {len(self.time_s)} samples at {rate}, largest gap {gap:.3g} s, written "
            f"{round(1e3 * late, 3) + 0.0:.3g} ms after their stamp"
        )


def join_streams(streams: Sequence[Stream], source: str) -> Log:
    """Return rows at the times of the slowest stream, the others interpolated.

    Positions and wrenches are interpolated along straight lines, orientations along great circles.

    Raises
    ------
    InputError
        Where the streams do not overlap in time.

    Examples
    --------
    >>> t = np.arange(5.0)
    >>> slow = Stream("/ft", "wrench", t, {"force.x": t}, {"force.x": "N"}, t)
    >>> fast = Stream("/x", "pose", t / 2, {"position.x": t}, {"position.x": "m"}, t / 2)
    >>> join_streams([slow, fast], "bag").columns["position.x"]
    array([0., 2., 4.])
    """
    ordered = [_in_order(stream) for stream in streams]
    slowest = max(ordered, key=lambda stream: stream.step_s)
    time = slowest.time_s
    inside = np.ones(len(time), dtype=bool)
    near = np.ones(len(time), dtype=bool)
    for stream in ordered:
        inside &= (time >= stream.time_s[0]) & (time <= stream.time_s[-1])
        near &= _without_gap(stream, time)
    if not (inside & near).any():
        raise InputError(
            f"{source}: the streams have no common time: "
            + "; ".join(f"{s.name} {s.time_s[0]:.3f} to {s.time_s[-1]:.3f} s" for s in ordered)
        )
    rows = inside & near
    columns: dict[str, F] = {"time": time[rows] - time[rows][0]}
    units = {"time": "s"}
    for stream in ordered:
        columns |= _interpolated(stream, time[rows])
        units |= stream.units
    notes = [stream.sentence() for stream in ordered]
    if len(ordered) > 1:
        notes.append(f"joined at the times of {slowest.name}, the others interpolated")
        for lost, why in ((~inside, "outside the common time"), (inside & ~near, "in a gap")):
            if lost.any():
                notes.append(f"{int(lost.sum())} samples {why} left out")
    return Log(columns, {}, units, tuple(notes))


def _in_order(stream: Stream) -> Stream:
    """The stream with growing times, each once."""
    _, first = np.unique(stream.time_s, return_index=True)
    columns = {name: values[first] for name, values in stream.columns.items()}
    return Stream(
        stream.name, stream.kind, stream.time_s[first], columns, stream.units,
        stream.received_s[first],
    )  # fmt: skip


def _without_gap(stream: Stream, time: F) -> B:
    """Whether each time is on a sample, or between samples that follow each other closely."""
    if len(stream.time_s) < 2:
        return np.asarray(time == stream.time_s[0])
    after = np.clip(np.searchsorted(stream.time_s, time), 1, len(stream.time_s) - 1)
    step = stream.time_s[after] - stream.time_s[after - 1]
    exact = (time == stream.time_s[after]) | (time == stream.time_s[after - 1])
    return np.asarray(exact | (step <= _GAP * stream.step_s))


def _interpolated(stream: Stream, time: F) -> dict[str, F]:
    found = {
        name: np.interp(time, stream.time_s, values) for name, values in stream.columns.items()
    }
    quaternion = [f"orientation.{axis}" for axis in "xyzw"]
    if all(name in found for name in quaternion) and len(stream.time_s) > 1:
        values = np.column_stack([stream.columns[name] for name in quaternion])
        good = np.linalg.norm(values, axis=1) > 0.5
        if good.sum() > 1 and (time >= stream.time_s[good][0]).all():
            from scipy.spatial.transform import (  # noqa: PLC0415 - scipy takes long to load
                Rotation,
                Slerp,
            )

            known = stream.time_s[good]
            turn = Slerp(known, Rotation.from_quat(values[good]))(np.minimum(time, known[-1]))
            found |= dict(zip(quaternion, turn.as_quat().T, strict=True))
    return found
