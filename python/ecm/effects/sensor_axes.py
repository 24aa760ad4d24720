"""How the force-torque sensor reads: gain, crosstalk, frame, saturation, hysteresis of its own.

All of it happens in the sensor's own axes, whatever loads it: a wrench is moved there, read
wrongly, and moved back.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ecm.effects.friction import Hysteresis
from ecm.effects.memory import play
from ecm.effects.protocol import (
    Effect,
    LinearEffect,
    LookAlike,
    Missing,
    Parameter,
    beside,
    listed,
    needs_full,
    needs_time,
    optional,
)
from ecm.effects.sensor import AXES
from ecm.io.arrays import F
from ecm.io.se3 import rotation, transpose, turn_wrench, wrench_adjoint
from ecm.io.settings import setting
from ecm.io.table import Table
from ecm.regression.folds import zero_of_rows, zero_times
from ecm.regression.rows import Rows

_KNEES = (0.3, 0.6, 0.85)
"""Quantiles of the readings of an axis at which a knee is tried."""
_LOADED = {"each": AXES, "bending": AXES[4:]}
"""Groups of axes whose load others read: bending loads the sensor most."""
_WIDTHS = (0.15, 0.5, 1.2)
"""Widths of the play that are tried, over the spread of an axis' load."""


def in_sensor(rows: Rows, wrench: F | None = None) -> tuple[F, F]:
    """(N, 6, 6) base from sensor; a wrench, its load by default, (N, 6) in its own frame."""
    top_from_sensor = wrench_adjoint(rows.table.meta.instrument.top_from_sensor)
    own = rows.sensor_load if wrench is None else wrench
    in_top = np.einsum("nji,nj->ni", rows.base_from_top, own)
    return rows.base_from_top @ top_from_sensor, in_top @ np.linalg.inv(top_from_sensor).T


class FtsGain(LinearEffect):
    """B A diag(g) A^-1 B' h: each axis of the sensor has its own gain error.

    A moves a wrench from the sensor's frame to the top frame ([instrument] top_from_sensor).
    """

    id = "fts_gain"
    physics = "The axes of the sensor are scaled wrongly, each by its own factor."
    parameters = tuple(Parameter(f"{axis}_gain", "1", 0.02, -0.5, 0.5) for axis in AXES)
    outside = LookAlike(
        "anything that scales one axis of the reading: a bridge, a bypass of the load",
        "dead weights along each axis",
    )
    signature = "body axes, proportional to the component itself"
    side = "measurement"
    rivals = {"anisotropy": "dead_weights", "fts_crosstalk": "dead_weights_on_lever"}

    def columns(self, rows: Rows) -> F:
        """B A e_j (A^-1 B' h)_j."""
        base_from_sensor, own = in_sensor(rows)
        return np.asarray(base_from_sensor * own[:, None, :])


@dataclass(eq=False)
class FtsCrosstalk(LinearEffect):
    """B A C A^-1 B' h, C without its diagonal: each axis reads a little of the others.

    Or C has one row, for an axis that reads all others, or one column, for an axis that all others
    read.
    """

    id = "fts_crosstalk"
    physics = "A load along one axis of the sensor shows in the others."
    outside = LookAlike(
        "anything that mixes axes: a turned sensor, a side load by a cable",
        "dead weights on a lever",
    )
    signature = "body axes, each component proportional to the others"
    side = "measurement"
    rivals = {
        "fts_frame": "dead_weights_on_lever",
        "tip_frame_misalignment": "dead_weights_on_lever",
        "fts_gain": "dead_weights",
    }

    to: str = optional("each")
    """Axis that reads the others, or `each`."""
    of: str = optional("each")
    """Axis that the others read, `bending` (both bending axes), or `each`."""

    def __post_init__(self) -> None:
        self._pairs = [
            (i, j)
            for i, reads in enumerate(AXES)
            for j, loaded in enumerate(AXES)
            if i != j and self.to in ("each", reads) and loaded in _LOADED.get(self.of, (self.of,))
        ]
        self.parameters = tuple(_share_of_axis(i, j) for i, j in self._pairs)

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """The full matrix, each row, each column, and the two columns of bending."""
        rows = (FtsCrosstalk(to=axis) for axis in AXES)
        columns = (FtsCrosstalk(of=axis) for axis in (*AXES, "bending"))
        return (FtsCrosstalk(), *rows, *columns)

    def columns(self, rows: Rows) -> F:
        """B A e_i (A^-1 B' h)_j."""
        base_from_sensor, own = in_sensor(rows)
        columns = [base_from_sensor[:, :, i] * own[:, j : j + 1] for i, j in self._pairs]
        return np.stack(columns, axis=2)


def _share_of_axis(i: int, j: int) -> Parameter:
    """Parameter of the share of axis j that axis i reads."""
    alike = (i < 3) == (j < 3)
    unit, scale = ("1", 0.01) if alike else ("1/m", 0.2) if i < 3 else ("m", 5e-4)
    return Parameter(f"{AXES[i]}_from_{AXES[j]}", unit, scale)


class FtsFrame(LinearEffect):
    """The sensor is displaced by (d, w): f' = f + w x f, tau' = tau + w x tau + d x f, in body."""

    id = "fts_frame"
    physics = "The sensor is shifted or turned against its stated pose on the platform."
    parameters = (
        *(Parameter(f"sensor_d{axis}", "m", 1e-3, -0.05, 0.05) for axis in "xyz"),
        *(Parameter(f"sensor_w{axis}", "rad", 5e-3, -0.3, 0.3) for axis in "xyz"),
    )
    outside = LookAlike(
        "anything that moves the point of the torque: a spacer, a frame of another tool",
        "a pure force at three points",
    )
    signature = "torque proportional to lever times force; rotation mixes components"
    side = "measurement"
    rivals = {
        "tip_frame_misalignment": "force_at_three_points",
        "fts_crosstalk": "force_at_three_points",
    }

    def columns(self, rows: Rows) -> F:
        """Change of the wrench per unit of d and w, in body axes turned to base axes."""
        in_top = np.einsum("nji,nj->ni", rows.base_from_top, rows.sensor_load)
        columns = np.zeros((len(rows), 6, 6))
        for j, axis in enumerate(np.eye(3)):
            columns[:, 3:, j] = np.cross(axis, in_top[:, :3])
            columns[:, :3, 3 + j] = np.cross(axis, in_top[:, :3])
            columns[:, 3:, 3 + j] = np.cross(axis, in_top[:, 3:])
        return np.asarray(rows.base_from_top @ columns)


def _needs_range(table: Table) -> Missing | None:
    if table.meta.instrument.fts_range is None:
        return Missing("the sensor's range is not known", "[instrument] fts_range")
    return None


@dataclass(eq=False)
class FtsSaturation(LinearEffect):
    """Beyond a knee c one raw axis reads less: -u (|h_j| - c); u = 1 is a hard ceiling."""

    id = "fts_saturation"
    physics = "The sensor reads ever less near the end of an axis' range."
    parameters = (Parameter("lost", "1", 0.1, 0.0, 1.5),)
    outside = LookAlike(
        "any ceiling of a reading: a limit of the logger, a stop in the sensor",
        "the raw counts",
    )
    signature = "a ceiling on one raw axis"
    needs = "the sensor's range ([instrument] fts_range)"
    requires = (needs_full, _needs_range)
    side = "measurement"
    rivals = {"contact_stop": "raw_counts", "fts_gain": "dead_weights"}

    axis: str = setting("fx", choices=AXES)
    """Axis of the sensor."""
    knee: float = 0.0
    """Reading in N or N m at which the axis begins to read less."""

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """Each axis, with knees at three quantiles of its readings."""
        own = np.abs(_readings(table))
        return tuple(
            FtsSaturation(axis, round(float(np.quantile(own[:, j], share)), 5))
            for j, axis in enumerate(AXES)
            for share in _KNEES
        )

    def refined(self, table: Table, round_: int) -> tuple[Effect, ...]:
        """Knees between this one and its neighbours."""
        knees = beside(self.knee, 1.0 + 0.4 * 0.5**round_)
        return tuple(FtsSaturation(self.axis, knee) for knee in knees)

    def columns(self, rows: Rows) -> F:
        """Minus the part of the load beyond the knee."""
        base_from_sensor, own = in_sensor(rows)
        j = AXES.index(self.axis)
        beyond = np.sign(own[:, j]) * np.maximum(0.0, np.abs(own[:, j]) - self.knee)
        return np.asarray(-(base_from_sensor[:, :, j] * beyond[:, None])[:, :, None])


def _readings(table: Table) -> F:
    """(N, 6) measured wrenches of the poses, in the sensor's frame."""
    measured = table.measured()
    in_top = turn_wrench(transpose(rotation(measured.poses[:, 3:])), measured.wrenches)
    inverse = np.linalg.inv(wrench_adjoint(table.meta.instrument.top_from_sensor))
    return np.asarray(in_top @ inverse.T)


@dataclass(eq=False)
class FtsHysteresis(LinearEffect):
    """c_j times the lag of a play operator of width w s_j behind each axis' load, s_j its spread.

    The operator follows the load at its width or less, from reading to reading and over the load of
    the pose before. Its lag while the sensor's zero is read becomes part of the zero and shifts all
    readings about it.
    """

    id = "fts_hysteresis"
    physics = "The sensor itself reads differently when its load rises than when it falls."
    parameters = listed(Parameter("lag", "1", 0.02, -1.0, 1.0))
    outside = LookAlike(
        "anything that lags the load: friction in the clamp, a settling adhesive",
        "load and unload dead weights without the mechanism",
    )
    signature = "odd in the side of approach, body axes, also without the mechanism"
    needs = "loads reached from both sides (time_s, and approach where rows do not follow directly)"
    requires = (needs_time, Hysteresis().missing)
    side = "measurement"
    kind = "time"
    rivals = {
        "hysteresis": "load_and_unload_weights",
        "fts_gain": "load_and_unload_weights",
        "stress_relaxation": "load_and_unload_weights",
    }

    width: float = 0.3
    """Width of the play over the spread of an axis' load."""
    axes: str = "alike"
    """Whether the axes are `alike`, or `each` has a parameter of its own."""

    def __post_init__(self) -> None:
        if self.axes == "each":
            self.parameters = tuple(Parameter(f"{a}_lag", "1", 0.02, -1.0, 1.0) for a in AXES)

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """Three widths, axes alike or not."""
        return tuple(FtsHysteresis(w, axes) for axes in ("alike", "each") for w in _WIDTHS)

    def refined(self, table: Table, round_: int) -> tuple[Effect, ...]:
        """Widths between this one and its neighbours."""
        widths = beside(self.width, 2.4 ** (0.5 ** (round_ + 1)))
        # A play wider than the loads never reverses, and would be a gain.
        limit = max(_WIDTHS)
        return tuple(FtsHysteresis(float(f"{w:.3g}"), self.axes) for w in widths if w < limit)

    def columns(self, rows: Rows) -> F:
        """Lag of each axis, turned to base axes."""
        base_from_sensor, own = in_sensor(rows)
        _, own_before = in_sensor(rows, rows.predict(rows.known_before))
        width = self.width * own[~rows.unloaded].std(axis=0)
        time, zeros = rows.time_s(), np.asarray(zero_times(rows.table), dtype=np.float64)
        # The sensor's history continues through all runs and through the readings of its zero.
        order = np.argsort(np.concatenate([time, zeros]), kind="stable")
        free = np.zeros((len(zeros), 2, 6))
        loads = np.concatenate([np.stack([own_before, own], axis=1), free])[order].reshape(-1, 6)
        states = np.empty((len(order), 6))
        states[order] = play(loads, width)[1::2]
        lag = states[: len(own)] - own
        lag -= zero_of_rows(time, zeros, states[len(own) :])
        columns = base_from_sensor * lag[:, None, :]
        return np.asarray(columns if self.axes == "each" else columns.sum(axis=2, keepdims=True))


EFFECTS = (FtsGain(), FtsCrosstalk(), FtsSaturation(), FtsHysteresis(), FtsFrame())
