"""One visit of the arm as a line of the journal: motion and reading, or the reason for none."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from typing import Any

from ecm.errors import InputError

HEADER = "one JSON object per visit: motion of the arm, then the reading"


@dataclass(frozen=True)
class VisitRecord:
    """A finished visit; poses are (x, y, z, theta_x, theta_y, theta_z)."""

    visit: int
    """Index in the planned timeline."""
    time_s: float
    travel_s: float
    dwell_s: float
    approach: str
    way: list[list[float]]
    """Poses (k, 6) from the previous reading to this one, or to where the arm stopped."""
    after: list[list[float]]
    """Poses from there on; home if the sortie ends here."""
    reached: list[float]
    """Mean pose over the window."""
    shift_s: float
    """Delay against the plan after this visit."""
    reading: str
    """Line of the quasi-static journal."""
    joints_rad: list[float]
    directions: list[float]
    goal: list[float]
    """Commanded pose, calibration error of the arm included."""
    after_impedance: list[float]
    reason: str = ""
    """Why there is no reading; empty if there is one."""
    fault: bool = False
    """Whether the reason is a fault of an instrument, not of the arm."""
    phases: list[list[Any]] = field(default_factory=list)
    """Name, begin and end in s of each phase."""
    off_known_m: float = 0.0
    """Largest distance from the known workspace."""

    def text(self) -> str:
        """Return one line of JSON."""
        return json.dumps(asdict(self))

    @staticmethod
    def parse(text: str, source: str) -> VisitRecord:
        """Read one line of JSON; InputError if it is damaged."""
        try:
            return VisitRecord(**json.loads(text))
        except (json.JSONDecodeError, TypeError):
            raise InputError(
                f"{source}: damaged line `{text[:40]}`. Remove the journal to start again"
            ) from None
