"""How the arm's work is shown, on the page, in the picture and in words: colours, titles, sizes."""

from __future__ import annotations

PANELS = ("x - L [mm]", "y [mm]", "z [mm]", "θx [mrad]", "θy [mrad]", "θz [mrad]")
"""Components of a pose less the rest pose, in the unit of `thousandths`."""

COLOURS = {
    "impedance": "#cfe3f7",
    "settle": "#e4eefb",
    "position": "#fbe3c4",
    "rest": "#eeeeee",
    "reading": "#f6b8b0",
    "return": "#dff0d8",
}
"""Behind the way of a pose, phase by phase in their order."""


def thousandths(value: float) -> str:
    """In mm or mrad, from m or rad; rounding errors of the simulation are no figures."""
    return f"{1e3 * value:.3g}" if value >= 1e-9 else "< 1e-6"
