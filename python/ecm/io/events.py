"""What another program reads of a command at work: a line of JSON for each step and each error.

They are appended to the file that ECM_EVENTS of the environment names. The page's server reads
them; the words on the terminal are for people and may change.
"""

from __future__ import annotations

import json
import os
from contextlib import suppress
from pathlib import Path
from typing import Any

VARIABLE = "ECM_EVENTS"
EVERY_S = 0.3
"""Seconds between two lines about the same step."""


def tell(**event: Any) -> None:
    """Append one line; where nobody asked for them, or the disk is full, there is none."""
    path = os.environ.get(VARIABLE)
    if path:
        with suppress(OSError), open(path, "a", encoding="utf-8") as file:
            file.write(json.dumps(event) + "\n")


def tell_progress(what: str, done: float, total: float, left_s: float) -> None:
    """Tell how far a work is; a total or a time left of 0 is not known."""
    tell(what=what, done=done, total=total or None, left_s=left_s or None)


def last(path: Path, name: str) -> dict[str, Any] | None:
    """The last event that holds this key; None where there is none.

    Examples
    --------
    >>> last(Path("no such file"), "what") is None
    True
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError:
        return None
    for line in reversed(lines):
        with suppress(ValueError):  # the last line may be half written
            event = json.loads(line)
            if isinstance(event, dict) and name in event:
                return event
    return None
