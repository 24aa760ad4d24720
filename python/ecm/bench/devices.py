"""What a device can do, and how a device of one's own is found.

A device is a class. What it can do is told by the methods that it has; none of them needs the
others, and one device may have all. Each is called from one thread at a time, but `stop`, which may
be called at any moment.

| part | methods |
|---|---|
| mover | `start(pose)`, `settled()`, `stop()` |
| wrench | `wrench(window_s)` |
| pose | `pose(window_s)` |
| thermometer | `temperature()` |
| person | `ask(text)` |
| actuation | `actuate(values)`, `actuation()` |
| follower | `follow(free_N)` |

A device that needs settings takes them as arguments of its class; `close()` is called at the end
where there is one. `now()` and `wait(seconds)` give a mover a clock of its own, as a simulated rig
has; `begin(visit, again, rows)` tells a device which visit comes, and the rows of the plan so far.
`by_hand` is true of a person, for whom no watchdog waits; `columns`, where it has them, become
those of the bench.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from ecm.errors import ComputationError, EcmError, InputError
from ecm.io.settings import did_you_mean

Device = Any
"""An object with the methods of one part or several."""

PARTS: Mapping[str, tuple[str, ...]] = {
    "mover": ("start", "settled", "stop"),
    "wrench": ("wrench",),
    "pose": ("pose",),
    "thermometer": ("temperature",),
    "person": ("ask",),
    "actuation": ("actuate", "actuation"),
    "follower": ("follow",),
}
"""Methods of each part of a rig. `start(pose)` takes (6,) x y z in m and the rotation vector in
rad, in the base frame; `wrench(window_s)` gives (n, 6) samples in the sensor's axes, N and N m;
`pose(window_s)` the mean (6,) and the standard deviation (6,) of the platform's pose in the base
frame; `temperature()` degrees Celsius; `actuate(values)` sets (m,) pressures or tensions in Pa and
N, `actuation()` reads them; `follow(free_N)` moves a platform that a driven mechanism pushes until
the force is below free_N, and returns when it rests there."""

NEEDED = ("mover", "wrench", "pose")
"""Parts without which nothing can be measured."""

SHIPPED = {
    "line": "ecm.bench.lines:LineDevice",
    "ati-net-ft": "ecm.bench.lines:AtiNetFt",
    "manual": "ecm.bench.manual:Manual",
    "simulated": "ecm.bench.simulated:SimulatedRig",
    "aruco": "ecm.bench.aruco:Aruco",
    "natnet": "ecm.bench.natnet:NatNet",
    "epics": "ecm.bench.epics:Epics",
    "epics-motors": "ecm.bench.epics:EpicsMotors",
    "epics-actuators": "ecm.bench.epics:EpicsActuators",
}
"""Kinds of devices of this package: module and class."""
_GROUP = "ecm.bench"


class DeviceError(ComputationError):
    """A device did not answer, or refused; the mover has been stopped."""


def device_kinds() -> dict[str, Callable[[], Any]]:
    """Return what loads the class of each kind, those of installed packages included.

    A package of your own names its class in the entry points `ecm.bench`:
    `[project.entry-points."ecm.bench"]`, `my-robot = "my_package:MyRobot"`.

    Examples
    --------
    >>> sorted(device_kinds())[:2]
    ['aruco', 'ati-net-ft']
    """
    shipped = [EntryPoint(name, place, _GROUP) for name, place in SHIPPED.items()]
    return {point.name: point.load for point in (*entry_points(group=_GROUP), *shipped)}


def opened(kind: str, settings: Mapping[str, Any], where: str) -> Device:
    """Open a device.

    Parameters
    ----------
    kind
        One of `device_kinds()`.
    settings
        Arguments of its class.
    where
        File and table of these settings, for the messages.

    Raises
    ------
    InputError
        An unknown kind, or settings that its class does not take.
    DeviceError
        Where the device cannot be reached.

    Examples
    --------
    >>> opened("lien", {}, "bench.toml [mover]")
    Traceback (most recent call last):
        ...
    ecm.errors.InputError: bench.toml [mover]: unknown device 'lien', did you mean 'line'?
    """
    kinds = device_kinds()
    if kind not in kinds:
        raise InputError(f"{where}: unknown device '{kind}', {did_you_mean(kind, kinds)}")
    try:
        return kinds[kind]()(**settings)
    except EcmError as error:
        raise type(error)(f"{where}: {error}") from None
    except TypeError as error:
        raise InputError(f"{where}: {error}; see docs/measure.md for its settings") from None
    except OSError as error:
        raise DeviceError(f"{where}: the device cannot be reached: {error}") from None
    except Exception as error:  # of a device of one's own
        raise DeviceError(
            f"{where}: the device cannot be opened: {type(error).__name__}: {error}"
        ) from error


def require_part(device: Device, part: str, where: str) -> Device:
    """Return the device; InputError where it lacks a method of this part."""
    lacking = [name for name in PARTS[part] if not callable(getattr(device, name, None))]
    if lacking:
        raise InputError(
            f"{where}: a {type(device).__name__} cannot be the {part}: it has no {lacking[0]}()"
        )
    return device


def closed(device: Device) -> None:
    """Close a device that can be closed; what it says then is too late to matter."""
    with suppress(Exception):
        getattr(device, "close", lambda: None)()
