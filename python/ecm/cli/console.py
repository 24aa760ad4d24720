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
        phase = _Phase()

        def show(done: int, total: int, *words: Any) -> None:
            if phase.begins(done, total):
                progress.reset(task, total=total or None)
            progress.update(
                task,
                completed=done,
                total=total or None,
                description=", ".join([title, *map(str, words)]),
            )

        return show


class _Phase:
    """Work may have phases, each with a count of its own."""

    def __init__(self) -> None:
        self.first = self._done = self._total = 0
        self.start = time.monotonic()

    def begins(self, done: int, total: int) -> bool:
        """Whether the count begins anew with this call."""
        new = total != self._total or done < self._done
        if new:
            self.first, self.start = done, time.monotonic()
        self._done, self._total = done, total
        return new

    def left(self, now: float) -> str:
        """', 12 s left' at the pace so far."""
        gained = self._done - self.first
        if not (self._total and gained > 0 and self._done < self._total):
            return ""
        return f", {_duration((now - self.start) * (self._total - self._done) / gained)} left"


def _lines(title: str) -> Callable[..., None]:
    phase = _Phase()
    last = phase.start
    told = False

    def show(done: int, total: int, *words: Any) -> None:
        nonlocal last, told
        now = time.monotonic()
        if phase.begins(done, total):
            told = False
        finished = bool(total) and done >= total
        slow = now - phase.start > _LINE_EVERY_S
        if told or (now - last < _LINE_EVERY_S and not (finished and slow)):
            return
        last, told = now, finished
        what = ", ".join([title, *map(str, words)])
        sys.stderr.write(f"{what}: {done}{f' of {total}' if total else ''}{phase.left(now)}\n")
        sys.stderr.flush()

    return show


def _duration(seconds: float) -> str:
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 5400.0 else f"{seconds / 3600.0:.1f} h"
