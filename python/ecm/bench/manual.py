"""A person with weights, a ruler and a protractor as mover, sensor and camera."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from ecm.bench.devices import DeviceError
from ecm.errors import InputError
from ecm.io.arrays import F, float_of
from ecm.io.columns import POSE, WRENCH, find_unit

_DIMENSIONS = ("length", "angle", "force", "torque")
_WEIGHTS = {"g": "gf", "kg": "kgf"}
"""What is hung on a string is said in grams."""


class Manual:
    """Asks a person at the terminal; each entry is checked at once.

    An entry is a number in SI units, or one with its unit: `12 deg`, `3.5 mm`, `200 g` for what
    hangs there, `40 N mm`; several are parted by commas.

    Parameters
    ----------
    sd_m, sd_rad
        Standard deviation of what is read off, for the table.
    ask_for
        Reads a line after a prompt; default: the terminal.
    """

    by_hand = True
    """No watchdog waits for an answer, and nothing is asked while the person moves."""

    def __init__(
        self, *, sd_m: float = 5e-4, sd_rad: float = 5e-3, ask_for: Callable[[str], str] = input
    ) -> None:
        self._sd = np.repeat([sd_m, sd_rad], 3)
        self._ask_for = ask_for
        self._pose = np.full(6, np.nan)
        self._asked = np.empty(0)
        self._stopped = False
        self.columns: Sequence[str] = (*POSE, *WRENCH)
        """What is told and asked; the rest of a pose is taken to be as planned."""

    def start(self, pose: F) -> None:
        """Tell where the platform is to be brought."""
        self._pose, self._stopped = np.asarray(pose, dtype=np.float64), False
        self.ask(f"bring the platform to {_words(self._pose, self.columns)}")

    def settled(self) -> bool:
        """The person said so."""
        return True

    def stop(self) -> None:
        """Tell the person to let go."""
        if not self._stopped:
            self._stopped = True
            print("STOP: bring the platform back to rest")

    def ask(self, text: str) -> None:
        """Ask for something to be done, and wait for Enter."""
        self._answer(f"{text}. Enter when it is done: ")

    def _answer(self, prompt: str) -> str:
        try:
            return self._ask_for(prompt).strip()
        except EOFError:
            raise DeviceError("nobody answers at the terminal") from None

    def pose(self, window_s: float) -> tuple[F, F]:
        """Ask for the pose as it was read off."""
        del window_s
        return self._numbers("pose as you read it", POSE, self._pose), self._sd

    def wrench(self, window_s: float) -> F:
        """Ask for the wrench; one sample of it."""
        del window_s
        return self._numbers("wrench on the platform", WRENCH, None)[None]

    def actuate(self, values: F) -> None:
        """Tell what the actuators are to be set to."""
        self._asked = np.asarray(values)
        self.ask("set the actuators to " + ", ".join(f"{value:g}" for value in self._asked))

    def actuation(self) -> F:
        """What the person was told to set."""
        return self._asked

    def _numbers(self, what: str, names: Sequence[str], empty: F | None) -> F:
        """Ask for the numbers of some columns; those that are not asked for are as in `empty`."""
        asked = [i for i, name in enumerate(names) if name in self.columns]
        prompt = f"{what} ({' '.join(names[i] for i in asked)})"
        prompt += ": " if empty is None else ", Enter: as asked: "
        numbers = np.zeros(6) if empty is None else np.array(empty)
        while True:
            line = self._answer(prompt)
            if not line and empty is not None and np.isfinite(empty).all():
                return numbers
            words = [word.strip() for word in line.split(",")]
            if len(words) == 1 < len(asked):
                words = line.split()
            try:
                if len(words) != len(asked):
                    raise InputError(f"found {len(words)}, expected {len(asked)} numbers")
                for i, word in zip(asked, words, strict=True):
                    numbers[i] = _number(word, names[i])
            except InputError as error:
                print(f"`{line}`: {error}")
            else:
                return numbers


def _number(word: str, name: str) -> float:
    """An entry in SI units.

    Examples
    --------
    >>> _number("200 g", "fz_N"), _number("40 Nmm", "tau_z_Nm"), round(_number("5 deg", POSE[5]), 4)
    (1.96133, 0.04, 0.0873)
    """
    digits = word.rstrip("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ°µ ")
    said = word[len(digits) :].strip()
    value = float_of(digits)
    if not math.isfinite(value):
        raise InputError(f"`{word}` is no number")
    if not said:
        return value
    unit = find_unit(_WEIGHTS.get(said, said))
    if unit is None or unit.dimension != _DIMENSIONS[(*POSE, *WRENCH).index(name) // 3]:
        raise InputError(f"`{said}` is no unit of {name}")
    return unit.factor * value


def _words(pose: F, columns: Sequence[str] = POSE) -> str:
    """A pose for a person: mm and degrees.

    Examples
    --------
    >>> _words(np.array([0.1, 0.002, 0.0, 0.0, 0.0, 0.1]))
    'x 100 mm, y 2 mm, z 0 mm, theta_x 0 deg, theta_y 0 deg, theta_z 5.73 deg'
    >>> _words(np.array([0.1, 0.002, 0.0, 0.0, 0.0, 0.1]), ["theta_z_rad", "tau_z_Nm"])
    'theta_z 5.73 deg'
    """
    return ", ".join(
        f"{name[:-2]} {1e3 * value:.4g} mm"
        if name.endswith("_m")
        else f"{name[:-4]} {math.degrees(value):.3g} deg"
        for name, value in zip(POSE, pose[:6], strict=True)
        if name in columns
    )
