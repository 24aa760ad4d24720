"""A person with weights, a ruler and a protractor as mover, sensor and camera."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH

_SHOWN = {"x_m": ("x", "mm", 1e3), "y_m": ("y", "mm", 1e3), "z_m": ("z", "mm", 1e3)}


class Manual:
    """Asks a person at the terminal; each entry is checked at once.

    Parameters
    ----------
    sd_m, sd_rad
        Standard deviation of what is read off, for the table.
    ask_for
        Reads a line after a prompt; default: the terminal.
    """

    def __init__(
        self,
        *,
        sd_m: float = 5e-4,
        sd_rad: float = 5e-3,
        ask_for: Callable[[str], str] = input,
    ) -> None:
        self._sd = np.repeat([sd_m, sd_rad], 3)
        self._ask_for = ask_for
        self._pose = np.full(6, np.nan)
        self._stopped = False

    def start(self, pose: F) -> None:
        """Tell where the platform is to be brought."""
        self._pose, self._stopped = np.asarray(pose, dtype=np.float64), False
        self.ask(f"bring the platform to {_words(self._pose)}")

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
        self._ask_for(f"{text}. Enter when it is done: ")

    def pose(self, window_s: float) -> tuple[F, F]:
        """Ask for the pose as it was read off."""
        del window_s
        text = " ".join(f"{name}" for name in POSE)
        return self._numbers(
            f"pose as you read it ({text}), Enter: as asked: ", self._pose
        ), self._sd

    def wrench(self, window_s: float) -> F:
        """Ask for the wrench; one sample of it."""
        del window_s
        text = " ".join(WRENCH)
        return self._numbers(f"wrench on the platform ({text}): ", None)[None]

    def _numbers(self, prompt: str, empty: F | None) -> F:
        while True:
            words = self._ask_for(prompt).replace(",", " ").split()
            if not words and empty is not None and np.isfinite(empty).all():
                return empty
            try:
                numbers = [float(word) for word in words]
            except ValueError:
                numbers = []
            if len(numbers) == 6 and all(map(math.isfinite, numbers)):
                return np.asarray(numbers)
            print(f"found {len(words)} entries in `{' '.join(words)}`, expected 6 numbers")


def _words(pose: F) -> str:
    """A pose for a person: mm and degrees.

    Examples
    --------
    >>> _words(np.array([0.1, 0.002, 0.0, 0.0, 0.0, 0.1]))
    'x 100 mm, y 2 mm, z 0 mm, rotation vector 0 0 5.73 degrees'
    """
    place = ", ".join(
        f"{name} {scale * value:.4g} {unit}"
        for value, (name, unit, scale) in zip(pose[:3], _SHOWN.values(), strict=True)
    )
    turn = " ".join(f"{angle:.3g}" for angle in np.rad2deg(pose[3:6]))
    return f"{place}, rotation vector {turn} degrees"
