"""What a command prints: results on stdout, warnings and progress with the time left on stderr."""

from __future__ import annotations

import math
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from types import TracebackType
from typing import Any

from ecm.cli import interrupt
from ecm.errors import visible
from ecm.io import events

_LINE_EVERY_S = 10.0
_FIRST_LINE_S = 2.0
_MOST_COUNTED = 100
_LONGER = 0.2
"""Least share of the time since the last word that a work still takes."""


class Console:
    """Lines and progress bars; `quiet` leaves only errors.

    On a terminal a bar is drawn; elsewhere a line says how far the work is, after two seconds and
    then every ten.
    """

    def __init__(self, *, quiet: bool = False) -> None:
        self.quiet = quiet
        self._progress: Any = None

    def print(self, text: str = "") -> None:
        """Print a line of the result."""
        if not self.quiet:
            self._write(sys.stdout, text)

    def note(self, text: str = "") -> None:
        """Print a line on stderr."""
        if not self.quiet:
            self._write(sys.stderr, text)

    def warn(self, text: str, *, wrong: bool = False) -> None:
        """Print a warning about the input, in red on a terminal where the input looks wrong."""
        if not self.quiet:
            line = f"warning: {text}"
            red = wrong and sys.stderr.isatty()
            self._write(sys.stderr, f"\x1b[31m{line}\x1b[0m" if red else line)

    def progress(self, title: str) -> Callable[..., None] | None:
        """Return a callback (done, total[, phase]) that shows the progress; None when quiet."""
        if self.quiet:
            return None
        self.close()
        return self._bar(title) if sys.stderr.isatty() else _lines(title)

    @contextmanager
    def working(self, title: str) -> Iterator[Callable[..., None]]:
        """Say how long work has taken: first after two seconds, then again.

        The block gets a callback (done, total[, step]); what it was told last is said too, with
        the time left.
        """
        steps = _Steps()
        if self.quiet:
            yield steps.tell
            return
        ended = threading.Event()
        # On a terminal one line counts the seconds; elsewhere each is a line of its own.
        alone = sys.stderr.isatty()
        begin, end = ("\r", "\x1b[K") if alone else ("", "\n")

        def say() -> None:
            start = now = time.monotonic()
            due, shown = start + _FIRST_LINE_S, False
            while not ended.wait(min(events.EVERY_S, max(0.0, due - now))):
                now = time.monotonic()
                events.tell_progress(*steps.at(title, now))
                if now < due:
                    continue
                due = now + (1.0 if alone else _LINE_EVERY_S)
                if self._progress is None:
                    so_far = f"{_duration(now - start)} so far"
                    line = visible(steps.line(title, so_far, now))
                    sys.stderr.write(f"{begin}{line}{end}")
                    sys.stderr.flush()
                    shown = alone
            if shown and self._progress is None:
                sys.stderr.write("\r\x1b[K")
                sys.stderr.flush()

        thread = threading.Thread(target=say, daemon=True)
        thread.start()
        try:
            yield steps.tell
        finally:
            ended.set()
            thread.join()

    def on_interrupt(self, message: str) -> None:
        """Set what an interruption leaves behind and how to go on: the end of its sentence."""
        interrupt.describe(lambda: message)

    def close(self) -> None:
        """Stop the bar that is drawn."""
        if self._progress is not None:
            self._progress.stop()
            self._progress = None

    def __enter__(self) -> Console:
        interrupt.describe(None)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _write(self, stream: Any, text: str) -> None:
        self.close()
        stream.write(visible(text) + "\n")
        stream.flush()

    def _bar(self, title: str) -> Callable[..., None]:
        rich = import_module("rich.progress")  # loaded only where a bar is drawn
        progress = rich.Progress(
            rich.TextColumn("{task.description}"),
            rich.BarColumn(bar_width=30),
            rich.MofNCompleteColumn(),
            rich.TimeRemainingColumn(compact=True),
            rich.TextColumn("left"),
            console=import_module("rich.console").Console(stderr=True),
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
                description=visible(", ".join([title, *map(str, words)])),
            )

        return show


class _Phase:
    """A phase of the work with a count of its own."""

    def __init__(self) -> None:
        self.first = self._done = self._total = 0.0
        self.start = time.monotonic()

    def begins(self, done: float, total: float) -> bool:
        """Whether a new phase, with a new count, begins with this call."""
        new = total != self._total or done < self._done
        if new:
            self.first, self.start = done, time.monotonic()
        self._done, self._total = done, total
        return new

    def left(self, now: float) -> str:
        """', 12 s left' at the speed so far."""
        seconds = self.seconds_left(now)
        return f", {_duration(seconds)} left" if seconds > 0.0 else ""

    def seconds_left(self, now: float) -> float:
        """Seconds to the end at the speed so far; 0 where nothing tells them."""
        gained = self._done - self.first
        if not (self._total and gained > 0 and self._done < self._total):
            return 0.0
        return (now - self.start) * (self._total - self._done) / gained


class _Steps:
    """The step that a work is at, as it was told last."""

    def __init__(self) -> None:
        self._phase, self._words, self._at = _Phase(), "", (0.0, 0.0)
        self._since = self._expected = 0.0

    def tell(self, done: float, total: float, *words: Any) -> None:
        """Take the part that is done, the whole, and the name of the step that goes on."""
        self._phase.begins(done, total)
        self._words, self._at = ", ".join(filter(None, map(str, words))), (done, total)
        self._since = time.monotonic()
        self._expected = self._phase.seconds_left(self._since)

    def at(self, title: str, now: float) -> tuple[str, float, float, float]:
        """What goes on, the part that is done, the whole, and the seconds left.

        A whole or a time of 0 is not known.
        """
        done, total = self._at
        # Parts take unlike times, and one that lasts longer than was expected is not over at once.
        taken = now - self._since
        left = max(self._expected - taken, _LONGER * taken) if self._expected else 0.0
        if left:
            done += (total - done) * taken / (taken + left)
        return ", ".join(filter(None, (title, self._words))), done, total, left

    def line(self, title: str, so_far: str, now: float) -> str:
        """The line that is shown, with the time left where a step has ended."""
        what, done, total, left = self.at(title, now)
        if not total:
            return f"{title}: {so_far}"
        what_left = f", about {_duration(left)} left" if left else ""
        # What is more than a few is easier to read as a share.
        few = 1 < total <= _MOST_COUNTED
        share = f"{int(self._at[0])} of {total:.0f}" if few else f"{100.0 * done / total:.0f} %"
        return f"{what}, {so_far}: {share}{what_left}"


def _lines(title: str) -> Callable[..., None]:
    phase = _Phase()
    last = phase.start - _LINE_EVERY_S + _FIRST_LINE_S
    told = -math.inf
    complete = False

    def show(done: int, total: int, *words: Any) -> None:
        nonlocal last, told, complete
        now = time.monotonic()
        if phase.begins(done, total):
            complete = False
        finished = bool(total) and done >= total
        what = ", ".join([title, *map(str, words)])
        if finished or now - told >= events.EVERY_S:
            told = now
            events.tell_progress(what, done, total, phase.seconds_left(now))
        slow = now - phase.start > _LINE_EVERY_S
        if complete or (now - last < _LINE_EVERY_S and not (finished and slow)):
            return
        last, complete = now, finished
        count = f"{done}{f' of {total}' if total else ''}"
        sys.stderr.write(f"{visible(what)}: {count}{phase.left(now)}\n")
        sys.stderr.flush()

    return show


def _duration(seconds: float) -> str:
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 5400.0 else f"{seconds / 3600.0:.1f} h"
