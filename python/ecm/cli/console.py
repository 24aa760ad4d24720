"""What a command tells while it works: lines on stdout, progress with the time left on stderr."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from types import TracebackType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.progress import Progress

_LINE_EVERY_S = 10.0


class Console:
    """Lines and bars; `quiet` leaves only errors.

    On a terminal a bar is drawn; elsewhere a line every ten seconds says how far it is.
    """

    def __init__(self, *, quiet: bool = False) -> None:
        self.quiet = quiet
        self._progress: Progress | None = None

    def say(self, text: str = "") -> None:
        """A line of the result."""
        if not self.quiet:
            self.close()
            sys.stdout.write(text + "\n")
            sys.stdout.flush()

    def warn(self, text: str) -> None:
        """A line about the input, on stderr."""
        if not self.quiet:
            self.close()
            sys.stderr.write(f"warning: {text}\n")
            sys.stderr.flush()

    def bar(self, title: str) -> Callable[..., None] | None:
        """A callback (done, total[, word]) that shows how far the work is; None when quiet."""
        if self.quiet:
            return None
        self.close()
        return self._drawn(title) if sys.stderr.isatty() else _lines(title)

    def close(self) -> None:
        """End the bar that is being drawn."""
        if self._progress is not None:
            self._progress.stop()
            self._progress = None

    def __enter__(self) -> Console:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _drawn(self, title: str) -> Callable[..., None]:
        from rich.console import Console as RichConsole
        from rich.progress import (
            BarColumn,
            MofNCompleteColumn,
            Progress,
            TextColumn,
            TimeRemainingColumn,
        )

        progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(bar_width=30),
            MofNCompleteColumn(),
            TimeRemainingColumn(compact=True),
            TextColumn("left"),
            console=RichConsole(stderr=True),
        )
        progress.start()
        self._progress = progress
        task = progress.add_task(title, total=None)

        def show(done: int, total: int, *_: Any) -> None:
            progress.update(task, completed=done, total=total or None)
            if total and done >= total and self._progress is progress:
                self.close()

        return show


def _lines(title: str) -> Callable[..., None]:
    start = time.monotonic()
    last = start

    def show(done: int, total: int, *_: Any) -> None:
        nonlocal last
        now = time.monotonic()
        finished = bool(total) and done >= total
        if now - last < _LINE_EVERY_S and not (finished and now - start >= _LINE_EVERY_S):
            return
        last = now
        left = ""
        if total and 0 < done < total:
            left = f", {_duration((now - start) * (total - done) / done)} left"
        sys.stderr.write(f"{title}: {done}{f' of {total}' if total else ''}{left}\n")
        sys.stderr.flush()

    return show


def _duration(seconds: float) -> str:
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 5400.0 else f"{seconds / 3600.0:.1f} h"
