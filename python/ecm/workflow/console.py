"""Where a long job prints what it does."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol


class Console(Protocol):
    """What a job needs of its caller; the command line draws progress bars."""

    def print(self, text: str = "") -> None:
        """Print a line for the reader."""

    def progress(self, title: str) -> Callable[..., None] | None:
        """Return a callback (done, total[, phase]) for the work that comes next, or None."""


class Silent:
    """A console that prints nothing."""

    def print(self, text: str = "") -> None:
        """Drop the line."""

    def progress(self, title: str) -> Callable[..., None] | None:
        """Return None: nobody follows the progress."""
        return None
