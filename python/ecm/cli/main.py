"""From an exception to a message and an exit code: 0 done, 1 failed, 2 bad input, 130 interrupted.

Nobody sees a traceback; `ECM_DEBUG=1` in the environment asks for one.
"""

from __future__ import annotations

import errno
import os
import signal
import sys
import warnings
from collections.abc import Sequence
from contextlib import suppress
from types import FrameType

_INTERRUPTED = 130


def main() -> None:
    """Entry point of the command `ecm`."""
    signal.signal(signal.SIGTERM, _terminated)
    if not os.environ.get("ECM_DEBUG"):
        warnings.simplefilter("ignore")
    code = run()
    # Numbers may still be in the buffers of a pipe whose reader has gone.
    with suppress(OSError, ValueError):
        sys.stdout.flush()
    if code == _BROKEN_PIPE:
        with suppress(OSError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = 1
    sys.exit(code)


_BROKEN_PIPE = -1


def run(arguments: Sequence[str] | None = None) -> int:  # noqa: PLR0911
    """Run one command line and give its exit code.

    Parameters
    ----------
    arguments
        Without the program's name; by default those of the process.
    """
    debug = bool(os.environ.get("ECM_DEBUG"))
    try:
        code = _invoke(arguments)
        return _interrupted() if code == _INTERRUPTED else code  # the parser swallows Ctrl-C
    except (KeyboardInterrupt, EOFError):
        return _interrupted()
    except BrokenPipeError:
        return _BROKEN_PIPE
    except OSError as error:
        if debug:
            raise
        return _disk(error)
    except MemoryError:
        _say("error: not enough memory. Use fewer rows, a coarser mesh or fewer --threads.")
        return 1
    except Exception as error:
        if debug:
            raise
        return _known(error)
    except BaseException as error:  # a panic of the Rust core is no Exception
        if debug or isinstance(error, (SystemExit, GeneratorExit)):
            raise
        return _unexpected(error)


def _invoke(arguments: Sequence[str] | None) -> int:
    from typer.core import TyperGroup
    from typer.main import get_command

    from ecm.cli.app import app
    from ecm.regression.blas import one_blas_thread_later

    command = get_command(app)
    if not isinstance(command, TyperGroup):
        raise TypeError("the command line has no commands")
    with one_blas_thread_later():
        result = command.main(
            args=None if arguments is None else list(arguments),
            prog_name="ecm",
            standalone_mode=False,
        )
    return result if isinstance(result, int) else 0


def _known(error: Exception) -> int:
    """Errors that say what to do: ours, and those of the parser."""
    from typer import Abort, Exit

    if isinstance(error, Exit):
        return int(error.exit_code)
    if isinstance(error, Abort):
        return _interrupted()
    show, code = getattr(error, "show", None), getattr(error, "exit_code", None)
    if callable(show) and isinstance(code, int):  # the parser: unknown option, missing argument
        show()
        return code
    from ecm.errors import EcmError, exit_code

    if isinstance(error, EcmError):
        _say(f"error: {error}")
        return exit_code(error)
    return _unexpected(error)


def _unexpected(error: BaseException) -> int:
    kind = type(error).__name__
    _say(
        f"error: something unexpected happened ({kind}: {error}).\n"
        "This is a fault of ecm: please report it with the command line and, if you can, the "
        "files.\nWith ECM_DEBUG=1 in the environment the command shows where it happened."
    )
    return 1


def _disk(error: OSError) -> int:
    place = f"{error.filename}: " if error.filename else ""
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        _say(
            f"error: {place}the disk is full. Finished parts are kept: free some space, run again."
        )
    else:
        _say(f"error: {place}{error.strerror or error}. Check the path and its permissions.")
    return 1


def _interrupted() -> int:
    from ecm.cli.options import kept

    _say(f"\ninterrupted. {kept()}")
    return _INTERRUPTED


def _terminated(_signal: int, _frame: FrameType | None) -> None:
    raise KeyboardInterrupt


def _say(text: str) -> None:
    with suppress(OSError, ValueError):
        sys.stderr.write(text + "\n")
        sys.stderr.flush()
