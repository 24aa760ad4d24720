"""One visit of the arm as it stands in the journal: motion and reading, or the reason for none."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import Any

from ecm.errors import InputError

HEADER = "one JSON object per visit: motion of the arm, then the reading"


@dataclass(frozen=True)
class Line:
    """A visit that is over."""

    visit: int
    """Of the planned timeline."""
    reason: str
    """Why there is no reading; empty where there is one."""
    fault: bool
    """Whether the reason is an instrument's, not the arm's."""
    time_s: float
    travel_s: float
    dwell_s: float
    approach: str
    way: list[list[float]]
    """Poses (k, 6) since the reading before, up to this one or to where the arm gave up."""
    after: list[list[float]]
    """Poses from there on, home where the sortie ends here."""
    reached: list[float]
    shift_s: float
    """How much later than planned the arm is, after this visit."""
    reading: str
    """The line of the quasi-static journal."""
    joints_rad: list[float]
    directions: list[float]
    goal: list[float]
    """As the arm was told, its error of calibration included."""
    after_impedance: list[float]
    phases: list[list[Any]]
    off_known_m: float
    """Farthest that the way went from the known workspace."""

    def text(self) -> str:
        """One line of JSON."""
        return json.dumps(asdict(self))

    @staticmethod
    def parse(text: str, where: str) -> Line:
        """The inverse of `text`.

        Raises
        ------
        InputError
            Where the line is damaged.
        """
        try:
            return Line(**json.loads(text))
        except (json.JSONDecodeError, TypeError):
            raise InputError(
                f"{where}: damaged line `{text[:40]}`. Remove the journal to begin anew"
            ) from None
