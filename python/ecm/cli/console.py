"""What a command prints: results on stdout, warnings and progress with the time left on stderr."""

from __future__ import annotations

import sys
import threading
import time
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from operator import itemgetter
from typing import Any

from ecm.cli import interrupt
from ecm.errors import visible
from ecm.io import events

_LINE_EVERY_S = 10.0
_FIRST_LINE_S = 2.0
_MOST_COUNTED = 100
_LONGER = 0.2
"""Least share of the time since a count moved that a work still takes."""
_ANOTHER_COUNT = 0.5
"""What falls below this share of what was done begins anew; a smaller step back corrects it."""


class Console:
    """Lines and the progress of the work that goes on; `quiet` leaves only errors."""

    def __init__(self, *, quiet: bool = False) -> None:
        self.quiet = quiet
        self._progress: _Progress | None = None

    def print(self, *lines: str) -> None:
        """Print lines of the result."""
        for text in () if self.quiet else lines:
            self._write(sys.stdout, text)

    def note(self, text: str = "") -> None:
        """Print a line on stderr."""
        if not self.quiet:
            self._write(sys.stderr, text)

    def warn(self, *texts: str, wrong: bool = False) -> None:
        """Print warnings about the input, in red on a terminal where the input looks wrong."""
        red = wrong and sys.stderr.isatty()
        for text in texts:
            self.note(f"\x1b[31mwarning: {text}\x1b[0m" if red else f"warning: {text}")

    def progress(self, title: str) -> Callable[..., None] | None:
        """Return a callback (done, total[, step]) that is said from time to time; None when quiet.

        The first line comes after two seconds. On a terminal it then counts the seconds; elsewhere
        each line is one of its own. What comes next, or is printed, ends it.
        """
        if self.quiet:
            return None
        self.close()
        self._progress = _Progress(title)
        self._progress.start()
        return self._progress.tell

    @contextmanager
    def working(self, title: str) -> Iterator[Callable[..., None]]:
        """Say the same of the work of a block, and how long it takes where it tells nothing."""
        try:
            yield self.progress(title) or _Progress(title).tell
        finally:
            self.close()

    def on_interrupt(self, message: str) -> None:
        """Set what an interruption leaves behind and how to go on: the end of its sentence."""
        interrupt.describe(lambda: message)

    def close(self) -> None:
        """End the progress that is said."""
        if self._progress is not None:
            self._progress.stop()
            self._progress = None

    def __enter__(self) -> Console:
        interrupt.describe(None)
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _write(self, stream: Any, text: str) -> None:
        self.close()
        # Line by line: of one long write without buffers Python loses what a pipe did not take.
        stream.writelines(f"{line}\n" for line in visible(text).split("\n"))
        stream.flush()


class _Progress(threading.Thread):
    """How far a work is: what it told last, with the time left at the speed so far."""

    def __init__(self, title: str) -> None:
        super().__init__(daemon=True)
        self._title, self._words = title, ""
        self._begun = self._told = time.monotonic()
        self._done = self._total = 0.0
        self._marks: list[tuple[float, float]] = []
        """When the count was how far: each time that it moved."""
        self._expected = 0.0
        """Seconds to the end when it moved last; 0 where nothing tells them."""
        self._ended = threading.Event()

    def tell(self, done: float, total: float, *words: Any) -> None:
        """Take the part that is done, the whole, and the name of the step that goes on."""
        now = time.monotonic()
        if total != self._total or done < _ANOTHER_COUNT * self._done:
            self._marks.clear()
        if done != self._done or not self._marks:
            # A count that goes back a little was too high before.
            del self._marks[bisect_left(self._marks, done, key=itemgetter(1)) :]
            self._marks.append((now, done))
            self._told = now
            # At the speed of the later half of the time: parts get slower, or faster.
            half = bisect_right(self._marks, 0.5 * (self._marks[0][0] + now), key=itemgetter(0))
            begun, first = self._marks[max(half - 1, 0)]
            gained = done - first
            left = max(total - done, 0.0)
            self._expected = (now - begun) * left / gained if gained else 0.0
        self._done, self._total = done, total
        self._words = ", ".join(filter(None, map(str, words)))

    def at(self, now: float) -> tuple[str, float, float, float]:
        """What goes on, the part that is done, the whole, and the seconds left.

        A whole or a time of 0 is not known.
        """
        done, total = self._done, self._total
        # Parts take different times; one that lasts longer than expected is not over at once.
        taken = now - self._told
        left = max(self._expected - taken, _LONGER * taken) if self._expected else 0.0
        if left:
            done += (total - done) * taken / (taken + left)
        return ", ".join(filter(None, (self._title, self._words))), done, total, left

    def line(self, now: float) -> str:
        """The line that is shown."""
        so_far = f"{_duration(now - self._begun)} so far"
        what, done, total, left = self.at(now)
        if not total:
            return f"{what}: {so_far}"
        what_left = f", about {_duration(left)} left" if left else ""
        # What is more than a few is easier to read as a share.
        few = 1 < total <= _MOST_COUNTED
        share = f"{int(self._done)} of {total:.0f}" if few else f"{100.0 * done / total:.0f} %"
        return f"{what}, {so_far}: {share}{what_left}"

    def run(self) -> None:
        """Show the line until the end, and tell other programs."""
        alone = sys.stderr.isatty()
        begin, end, every_s = ("\r", "\x1b[K", 1.0) if alone else ("", "\n", _LINE_EVERY_S)
        due, now = self._begun + _FIRST_LINE_S, self._begun
        shown = False
        while not self._ended.wait(min(events.EVERY_S, max(0.0, due - now))):
            now = time.monotonic()
            what, done, total, left_s = self.at(now)
            events.tell(what=what, done=done, total=total or None, left_s=left_s or None)
            if now < due:
                continue
            due = now + every_s
            if not self._total or self._done < self._total:  # what follows the end tells nothing
                shown = alone
                sys.stderr.write(f"{begin}{visible(self.line(now))}{end}")
                sys.stderr.flush()
        if shown:
            sys.stderr.write("\r\x1b[K")
            sys.stderr.flush()

    def stop(self) -> None:
        """End it, and wipe its line."""
        self._ended.set()
        if self.is_alive():  # an interruption can come before it is: it ends by itself then
            self.join()


def _duration(seconds: float) -> str:
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 5400.0 else f"{seconds / 3600.0:.1f} h"
