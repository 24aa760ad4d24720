"""Ctrl-C, SIGTERM and SIGHUP end a command with exit code 130 and one line, at any moment.

While a command works, the signal raises KeyboardInterrupt, and the work cleans up. Elsewhere an
exception would be lost or shown as a traceback: in the first moments, while modules are imported,
in destructors, and while the interpreter shuts down. There the process ends at once. No file can be
cut by that: each is written under another name first, and `uninterrupted` lets the signal wait.

This module is loaded before all others, so it imports little.
"""

from __future__ import annotations

import atexit
import os
import signal
import sys
from contextlib import suppress

from ecm.io.interrupts import last_words, wait_to_interrupt

TYPE_CHECKING = False  # the module typing takes longer to load than all of this
if TYPE_CHECKING:
    from collections.abc import Callable
    from types import FrameType

INTERRUPTED = 130
"""Exit code of an interrupted command."""
NOTHING_WRITTEN = "nothing was written. Run the same command again."
COMPLETE = "the command had ended, and its files are complete."


class _State:
    working = False
    """Whether KeyboardInterrupt is caught."""
    signals = 0
    code: int | None = None
    """Exit code of a command that has ended."""
    kept: Callable[[], str] | None = None


def install() -> None:
    """Catch Ctrl-C, SIGTERM and SIGHUP from now to the end of the process."""
    for number in (signal.SIGINT, signal.SIGTERM, getattr(signal, "SIGHUP", signal.SIGTERM)):
        # A shell starts background jobs with SIGINT ignored, nohup with SIGHUP: it stays so.
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _on_signal)
    sys.unraisablehook = _unraisable
    atexit.register(_exit)  # what is registered first runs last


def begin() -> None:
    """From now on KeyboardInterrupt is caught."""
    _State.working = True


def finish(code: int) -> None:
    """The command has ended with this exit code; the interpreter shuts down."""
    _State.code = code
    _State.working = False


def describe(kept: Callable[[], str] | None) -> None:
    """Set what tells, when a command is interrupted, what is kept and how to go on."""
    _State.kept = kept


def line() -> str:
    """Return the line that an interrupted command prints."""
    if _State.code == 0:
        return f"Interrupted; {COMPLETE}"
    kept = _State.kept() if _State.kept else NOTHING_WRITTEN
    return f"Interrupted; {kept}{last_words()}"


def _on_signal(_number: int, frame: FrameType | None) -> None:
    _State.signals += 1
    if _State.signals == 1 and _State.working:
        if wait_to_interrupt():
            return
        if not _importing(frame):
            raise KeyboardInterrupt
    _end()


def _importing(frame: FrameType | None) -> bool:
    """Whether a module is being imported: a compiled one would print the exception."""
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            return True
        frame = frame.f_back
    return False


def _unraisable(lost: sys.UnraisableHookArgs) -> None:
    """End the process where KeyboardInterrupt was raised in a destructor, which swallows it."""
    if lost.exc_type is KeyboardInterrupt:
        _end()
    sys.__unraisablehook__(lost)


def _end() -> None:
    """Print the line and end the process at once."""
    if _State.code != INTERRUPTED:  # else it is printed already
        terminal = os.isatty(2)
        # A new line after the ^C, and the cursor, which a progress bar hides.
        text = f"\n{line()}\n\x1b[?25h" if terminal else f"{line()}\n"
        with suppress(OSError):
            os.write(2, text.encode())
    os._exit(INTERRUPTED)


def _exit() -> None:
    """End the process before the interpreter gives the signals their default action back."""
    if _State.code is None:
        return
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):
            stream.flush()
    os._exit(_State.code)
