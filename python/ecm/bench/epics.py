"""Devices behind process variables of EPICS, by Channel Access: the client of caproto, pure Python.

Where the servers are is told as to every program of EPICS, by EPICS_CA_ADDR_LIST and its kin in the
environment.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from functools import cache
from typing import Any

import numpy as np

from ecm.bench.devices import DeviceError
from ecm.io.arrays import F
from ecm.io.extras import require

_INVALID = 3
"""Severity of an alarm from which EPICS itself does not trust the value."""
_POLL_S = 0.005


@cache
def _context() -> Any:
    """The one client of this process, as in every program of EPICS."""
    return require("caproto.threading.client", "epics", 'A device = "epics"').Context()


class _Channels:
    """Some process variables as one row of numbers in SI units."""

    def __init__(
        self, names: str | Sequence[str], scale: float | Sequence[float], timeout_s: float
    ):
        self.names = [names] if isinstance(names, str) else list(names)
        self._scale, self._timeout_s = np.asarray(scale, dtype=np.float64), timeout_s
        self._pvs: list[Any] = _context().get_pvs(*self.names, timeout=timeout_s)
        with self._told():
            for pv in self._pvs:
                pv.wait_for_connection(timeout=timeout_s)

    def read(self) -> tuple[F, tuple[float, ...]]:
        """Values (k,) and the time stamps of their variables."""
        with self._told():
            answers = [pv.read(data_type="time", timeout=self._timeout_s) for pv in self._pvs]
        for name, answer in zip(self.names, answers, strict=True):
            if answer.metadata.severity >= _INVALID:
                raise DeviceError(f"{name}: its value is in the alarm INVALID")
        values = np.concatenate([np.ravel(answer.data) for answer in answers]) * self._scale
        return values, tuple(answer.metadata.timestamp for answer in answers)

    def six(self) -> tuple[F, tuple[float, ...]]:
        """As `read`, of six numbers."""
        values, stamps = self.read()
        if values.shape != (6,):
            raise DeviceError(f"{self.names[0]}: {len(values)} numbers, expected six in all")
        return values, stamps

    def window(self, window_s: float) -> tuple[F, bool]:
        """Values (n, 6), one for each change of a time stamp, and whether there was a change."""
        until = time.monotonic() + window_s
        (values, stamps), rows = self.six(), list[F]()
        last = stamps
        while time.monotonic() < until:
            time.sleep(_POLL_S)
            values, stamps = self.six()
            if stamps != last:
                rows.append(values)
                last = stamps
        return np.stack(rows or [values]), bool(rows)

    def pose(self, window_s: float) -> tuple[F, F]:
        """Mean and standard deviation (6,) over a window."""
        samples, _ = self.window(window_s)
        return samples.mean(axis=0), samples.std(axis=0)

    def write(self, values: F) -> None:
        """Set the variables without waiting until what they drive has come to rest."""
        parts = np.asarray(values, dtype=np.float64) / self._scale
        shares = [parts] if len(self._pvs) == 1 else np.split(parts, len(self._pvs))
        with self._told():
            for pv, share in zip(self._pvs, shares, strict=True):
                pv.write(share.tolist(), wait=False, timeout=self._timeout_s)

    def close(self) -> None:
        """Leave the variables; the connection to their server is that of the whole process."""
        for pv in self._pvs:
            pv.go_idle()

    @contextmanager
    def _told(self) -> Iterator[None]:
        """Errors of the client as errors of the device: the names that are not connected first."""
        error_type = require("caproto", "epics", 'A device = "epics"').CaprotoError
        try:
            yield
        except error_type as error:
            away = [pv.name for pv in self._pvs if not pv.connected] or self.names
            raise DeviceError(f"{away[0]}: no answer within {self._timeout_s:g} s") from error


class Epics:
    """Six numbers, or a temperature, that process variables hold.

    Parameters
    ----------
    pvs
        One name of a waveform, or one name a number.
    scale
        What a number is multiplied by to be in m, rad, N or N m; one for all, or one each.
    timeout_s
        Longest silence.
    """

    def __init__(
        self,
        pvs: str | Sequence[str],
        *,
        scale: float | Sequence[float] = 1.0,
        timeout_s: float = 2.0,
    ) -> None:
        self._timeout_s, self._channels = timeout_s, _Channels(pvs, scale, timeout_s)
        self.close = self._channels.close

    def wrench(self, window_s: float) -> F:
        """Samples (n, 6): one for each time that the variables were set within the window."""
        until = time.monotonic() + self._timeout_s
        samples, new = self._channels.window(window_s)
        while not new:
            if time.monotonic() > until:
                raise DeviceError(
                    f"{self._channels.names[0]}: not set for {self._timeout_s:g} s; a sensor that "
                    "runs sets it all the time"
                )
            samples, new = self._channels.window(window_s)
        return samples

    def pose(self, window_s: float) -> tuple[F, F]:
        """Mean and standard deviation (6,) over a window."""
        return self._channels.pose(window_s)

    def temperature(self) -> F:
        """Temperature of the mechanism, degrees Celsius; a second variable is the sensor's."""
        return self._channels.read()[0]


class EpicsMotors:
    """Six axes that are records of motors, or behave as they do; their places are a pose.

    Parameters
    ----------
    setpoint, readback
        Where an axis is to go and where it is; one name of a waveform, or six (.VAL and .RBV).
    done
        1 where an axis rests (.DMOV); one name or several.
    stop
        What is set to 1 to stop (.STOP); one name or several.
    scale
        What a number is multiplied by to be in m or rad: 1e-3 for mm; one for all, or six.
    tolerance_m, tolerance_rad
        An axis that rests farther than this from where it was sent has not arrived.
    timeout_s
        Longest silence.
    """

    def __init__(
        self,
        *,
        setpoint: str | Sequence[str],
        readback: str | Sequence[str],
        done: str | Sequence[str],
        stop: str | Sequence[str],
        scale: float | Sequence[float] = 1.0,
        tolerance_m: float = 1e-4,
        tolerance_rad: float = 1e-3,
        timeout_s: float = 2.0,
    ) -> None:
        self._tolerance = np.repeat([tolerance_m, tolerance_rad], 3)
        self._goal = np.full(6, np.nan)
        with ExitStack() as opened:
            self._setpoint, self._readback, self._done, self._stop = (
                opened.enter_context(closing(_Channels(names, factor, timeout_s)))
                for names, factor in (
                    (setpoint, scale),
                    (readback, scale),
                    (done, 1.0),
                    (stop, 1.0),
                )
            )
            self._setpoint.six()
            self.close = opened.pop_all().close

    def start(self, pose: F) -> None:
        """Send the axes to a pose (6,)."""
        self._goal = np.asarray(pose, dtype=np.float64)
        self._setpoint.write(self._goal)

    def settled(self) -> bool:
        """Whether all axes rest where they were sent."""
        at, done = self._readback.six()[0], self._done.read()[0]
        near = (np.abs(at - self._goal) <= self._tolerance).all()
        return bool((done != 0.0).all() and near)

    def stop(self) -> None:
        """Stop all axes."""
        self._stop.write(np.ones(len(self._stop.names)))

    def pose(self, window_s: float) -> tuple[F, F]:
        """Mean and standard deviation (6,) of where the axes are."""
        return self._readback.pose(window_s)


class EpicsActuators:
    """Pressures or tensions that process variables set and read.

    Parameters
    ----------
    setpoint, readback
        What is asked for and what is there; one name of a waveform, or one name an actuator.
    scale
        What a number is multiplied by to be in Pa or N: 1e5 for bar.
    timeout_s
        Longest silence.
    """

    def __init__(
        self,
        *,
        setpoint: str | Sequence[str],
        readback: str | Sequence[str],
        scale: float | Sequence[float] = 1.0,
        timeout_s: float = 2.0,
    ) -> None:
        with ExitStack() as opened:
            self._setpoint, self._readback = (
                opened.enter_context(closing(_Channels(names, scale, timeout_s)))
                for names in (setpoint, readback)
            )
            self.close = opened.pop_all().close

    def actuate(self, values: F) -> None:
        """Ask for (m,) pressures or tensions."""
        self._setpoint.write(values)

    def actuation(self) -> F:
        """What is there, (m,)."""
        return self._readback.read()[0]
