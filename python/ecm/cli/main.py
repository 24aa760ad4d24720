"""The entry point: every exception becomes a message and an exit code.

0 done, 1 the computation failed, 2 bad input, 130 interrupted. Tracebacks are shown only with
`ECM_DEBUG=1` in the environment.
"""

from __future__ import annotations

import errno
import os
import sys
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress

from typer import Abort, Exit
from typer.main import get_command

from ecm.cli import command, interrupt
from ecm.cli.app import app
from ecm.errors import EcmError, document_of, exit_code, visible
from ecm.io import events
from ecm.regression.blas import one_blas_thread_later

_BROKEN_PIPE = -1


def main() -> None:
    """Run the command line of this process and end it."""
    if not os.environ.get("ECM_DEBUG"):
        warnings.simplefilter("ignore")
    for stream in (sys.stdout, sys.stderr):  # a terminal that lacks a letter costs no result
        with suppress(AttributeError, OSError, ValueError):
            stream.reconfigure(errors="backslashreplace")  # type: ignore[union-attr]
    try:
        interrupt.begin()
        code = run()
        # The buffers of a pipe whose reader has gone may still hold text.
        with suppress(OSError, ValueError):
            sys.stdout.flush()
        if code == _BROKEN_PIPE:
            with suppress(OSError):
                os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            code = 1
        interrupt.finish(code)
    except KeyboardInterrupt:  # between two of these lines
        code = _interrupted()
        interrupt.finish(code)
    sys.exit(code)


def run(arguments: Sequence[str] | None = None) -> int:
    """Run one command line and return its exit code, see `ecm.cli.run`."""
    return reported(lambda: _invoke(arguments))


def reported(work: Callable[[], int]) -> int:
    """Return the exit code of work; an exception is printed as a message and has a code, too."""
    try:
        code = work()
    except BaseException as error:  # a panic of the Rust core is no Exception
        unknown = not isinstance(error, (KeyboardInterrupt, EOFError, BrokenPipeError))
        if isinstance(error, (SystemExit, GeneratorExit)):
            raise
        if unknown and os.environ.get("ECM_DEBUG"):
            raise
        code = _code(error)
    # The parser turns Ctrl-C into a code.
    return _interrupted() if code == interrupt.INTERRUPTED else code


def _invoke(arguments: Sequence[str] | None) -> int:
    command.typed = tuple(sys.argv[1:] if arguments is None else arguments)
    with one_blas_thread_later():
        result = get_command(app).main(
            args=None if arguments is None else list(arguments),
            prog_name="ecm",
            standalone_mode=False,
        )
    return result if isinstance(result, int) else 0


def _code(error: BaseException) -> int:  # noqa: PLR0911 - a code per kind of error
    """Print an error with what to do, and return its exit code."""
    if isinstance(error, (KeyboardInterrupt, EOFError, Abort)):
        return interrupt.INTERRUPTED
    if isinstance(error, BrokenPipeError):
        return _BROKEN_PIPE
    if isinstance(error, Exit):
        return int(error.exit_code)
    if isinstance(error, OSError):
        return _system_error(error)
    if isinstance(error, MemoryError):
        _print_error("not enough memory. Use fewer rows, a coarser mesh or fewer --threads.")
        return 1
    show, code = getattr(error, "show", None), getattr(error, "exit_code", None)
    if callable(show) and isinstance(code, int):  # the parser: unknown option, missing argument
        show()
        words = getattr(error, "format_message", None)
        events.tell(error=str(words() if callable(words) else error))
        return code
    if isinstance(error, EcmError):
        found = document_of(error)
        events.tell(error=found["message"], remedy=found["remedy"])
        _print(f"error: {error}")
        return exit_code(error)
    _print_error(
        f"something unexpected happened ({type(error).__name__}: {error}).\n"
        "This is a fault of ecm: please report it with the command line and, if you can, the "
        "files.\nWith ECM_DEBUG=1 in the environment the command shows where it happened."
    )
    return 1


def _system_error(error: OSError) -> int:
    place = f"{error.filename}: " if error.filename else ""
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        _print_error(
            f"{place}the disk is full. Finished parts are kept: free some space, run again."
        )
    else:
        _print_error(f"{place}{error.strerror or error}. Check the path and its permissions.")
    return 1


def _interrupted() -> int:
    start = "\n" if sys.stderr.isatty() else ""  # after the ^C
    _print(f"{start}{interrupt.line()}")
    return interrupt.INTERRUPTED


def _print_error(text: str) -> None:
    events.tell(error=text)
    _print(f"error: {text}")


def _print(text: str) -> None:
    with suppress(OSError, ValueError):
        sys.stderr.write(visible(text) + "\n")
        sys.stderr.flush()
