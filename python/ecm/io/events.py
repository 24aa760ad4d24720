"""What another program reads of a command at work: a line of JSON for each step and each error.

They are appended to the file that ECM_EVENTS of the environment names. The page's server reads
them; the words on the terminal are for people and may change.
"""

from __future__ import annotations

import json
import os
from contextlib import suppress
from typing import Any

VARIABLE = "ECM_EVENTS"
EVERY_S = 0.3
"""Seconds between two lines about the same step."""
_LATEST = 20_000
"""Bytes of a file that are looked at: the events of the last seconds."""


def tell(**event: Any) -> None:
    """Append one line; where nobody asked for them, or the disk is full, there is none."""
    path = os.environ.get(VARIABLE)
    if path:
        with suppress(OSError), open(path, "a", encoding="utf-8") as file:
            file.write(json.dumps(event) + "\n")


def tell_progress(what: str, done: float, total: float, left_s: float) -> None:
    """Tell how far a work is; a total or a time left of 0 is not known."""
    tell(what=what, done=done, total=total or None, left_s=left_s or None)


def last(told: bytes, name: str) -> dict[str, Any] | None:
    """The last event with this key among the latest of a file; None where there is none.

    Examples
    --------
    >>> last(b'{"what": "fit", "done": 1}\n{"what": "fit", "do', "what")
    {'what': 'fit', 'done': 1}
    """
    for line in reversed(told[-_LATEST:].splitlines()):
        with suppress(ValueError):  # the last line may be half written
            event = json.loads(line)
            if isinstance(event, dict) and name in event:
                return event
    return None
