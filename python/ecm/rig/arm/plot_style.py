"""Titles, colours and units of the arm's plots and messages."""

from __future__ import annotations

PANELS = ("x - L [mm]", "y [mm]", "z [mm]", "θx [mrad]", "θy [mrad]", "θz [mrad]")
"""Components of a pose minus the rest pose."""

COLOURS = {
    "impedance": "#cfe3f7",
    "settle": "#e4eefb",
    "position": "#fbe3c4",
    "rest": "#eeeeee",
    "reading": "#f6b8b0",
    "return": "#dff0d8",
}
"""Background colour of each phase of the procedure, in their order."""


def thousandths(value: float) -> str:
    """Text of a length or angle in mm or mrad, from m or rad; rounding errors as `< 1e-6`."""
    return f"{1e3 * value:.3g}" if value >= 1e-9 else "< 1e-6"
