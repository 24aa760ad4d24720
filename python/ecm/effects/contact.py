"""Contact that begins or ends: a stop that is reached, a bond that opens."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ecm import _native
from ecm.effects.history import step_times
from ecm.effects.mid_frame import wrench_of
from ecm.effects.protocol import Effect, Kind, LinearEffect, Missing, Parameter, Shape, needs_full
from ecm.effects.rod_strain import rest_stiffness, rod_strain
from ecm.effects.rows import Rows

if TYPE_CHECKING:
    from ecm.table import Table

F = NDArray[np.float64]

_SHARES = (0.5, 0.7, 0.85)
"""Quantiles of the bend at which a stop is tried."""
_AZIMUTHS = 8


class ContactStop(LinearEffect):
    """V = k max(0, bend - bend_c)^2 / 2, the bend in all directions or towards one azimuth."""

    id = "contact_stop"
    physics = "Beyond some bend the mechanism touches a stop."
    parameters = (Parameter("stiffness", "N m/rad", 0.5, 0.0, 1e4),)
    signature = "a kink, one-sided, only at large poses; conservative"

    def __init__(self, bend_rad: float = 0.3, azimuth_rad: float | None = None) -> None:
        self._bend_rad = bend_rad
        self._azimuth_rad = azimuth_rad

    @property
    def shape(self) -> Shape:
        """Where it begins, and on which side if not on all."""
        found: Shape = {"bend_rad": self._bend_rad}
        return found if self._azimuth_rad is None else found | {"azimuth_rad": self._azimuth_rad}

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """Three places of a stop all around, and two of a stop on each of eight sides."""
        poses = table.measured().poses
        bend = np.hypot(poses[:, 4], poses[:, 5])
        around = [ContactStop(round(float(np.quantile(bend, s)), 4)) for s in _SHARES]
        sides = []
        for i in range(_AZIMUTHS):
            azimuth = 2.0 * np.pi * i / _AZIMUTHS
            towards = np.cos(azimuth) * poses[:, 4] + np.sin(azimuth) * poses[:, 5]
            towards = towards[towards > 0.0]
            if len(towards) > 10:
                places = (float(np.quantile(towards, s)) for s in _SHARES[1:])
                sides += [ContactStop(round(c, 4), round(azimuth, 6)) for c in places]
        return (*around, *sides)

    @property
    def rivals(self) -> dict[str, str]:
        """Effects that look like it, and what separates them."""
        return {"strain_stiffening": "fine sweep through the kink"}

    def columns(self, rows: Rows) -> F:
        """Moment max(0, bend - bend_c) along the bend, in mid-frame coordinates."""
        theta = rows.poses[:, 4:6]
        if self._azimuth_rad is None:
            bend = np.sqrt((theta**2).sum(axis=1))
            towards = theta / np.where(bend > 1e-12, bend, 1.0)[:, None]
        else:
            direction = np.array([np.cos(self._azimuth_rad), np.sin(self._azimuth_rad)])
            bend, towards = theta @ direction, np.broadcast_to(direction, theta.shape)
        force = np.zeros((len(rows), 6))
        force[:, 4:6] = np.maximum(0.0, bend - self._bend_rad)[:, None] * towards
        wrench = wrench_of(rows.poses, force)
        wrench[rows.unloaded] = 0.0
        return wrench[:, :, None]


class Debonding(LinearEffect):
    """Where the bond has opened the mechanism is softer: in tension only, or from t* on."""

    id = "debonding"
    physics = "The bond to the platform opens: softer in tension, or softer after it tore."
    parameters = (Parameter("loss", "1", 0.03, 0.0, 1.0),)
    signature = "odd-even split in fx, or a step in order; proportional to h"

    def __init__(self, opens: str = "tension", at_s: float = 0.0) -> None:
        self._opens = opens
        self._at_s = at_s
        self.kind: Kind = "pose" if opens in ("tension", "face") else "time"

    @property
    def shape(self) -> Shape:
        """`tension` (of the centre line), `face` (of each point of it), or `torn` at a moment."""
        return {"opens": self._opens} | ({"at_s": self._at_s} if self._opens == "torn" else {})

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """In tension, at the edge of the face, and torn at a few moments where time is known."""
        found = [Debonding("tension"), Debonding("face")]
        if table.has("time_s") and float(np.ptp(table.column("time_s"))) > 1.0:
            found += [Debonding("torn", t) for t in step_times(table, 5)]
        return tuple(found)

    def refined(self, table: Table, round_: int) -> tuple[Effect, ...]:
        """Moments between a tear and its neighbours."""
        if self._opens != "torn":
            return ()
        time = np.sort(table.column("time_s"))
        place = int(np.searchsorted(time, self._at_s))
        step = round(len(time) / 6 / 2.0 ** (round_ + 1))
        near = [i for i in (place - step, place + step) if step > 0 and 0 < i < len(time)]
        return tuple(Debonding("torn", float(0.5 * (time[i - 1] + time[i]))) for i in near)

    @property
    def rivals(self) -> dict[str, str]:
        """Effects that look like it, and what separates them."""
        return {
            "strain_stiffening": "a pair of push and pull poses",
            "mullins_softening": "repeat the first 10 poses",
            "ageing": "repeat the first 10 poses",
        }

    def missing(self, table: Table) -> Missing | None:
        """Needs all columns."""
        return needs_full(table)

    def columns(self, rows: Rows) -> F:
        """-h after the tear, or the slope of -EA L max(0, e)^2 / 2."""
        if self._opens == "torn":
            after = (rows.time_s() > self._at_s).astype(np.float64)
            return np.asarray(-(after[:, None] * rows.wrench)[:, :, None])
        if self._opens == "face":
            strain = rod_strain(rows)
            pulled = -np.maximum(0.0, strain.axial) * (strain.along < 0.0)
            return strain.wrench(rows, pulled, np.zeros_like(strain.shear))[:, :, None]
        known = rest_stiffness(rows)
        stretch = _native.mid_frame(rows.poses, known.length_m)[:, 0]
        force = np.zeros((len(rows), 6))
        force[:, 0] = -known.axial * np.maximum(0.0, stretch)
        wrench = wrench_of(rows.poses, force)
        wrench[rows.unloaded] = 0.0
        return wrench[:, :, None]


EFFECTS: Sequence[Effect] = (ContactStop(), Debonding())
