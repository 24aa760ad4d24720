"""The command `ecm`: each command is a function, its options are its signature and docstring."""

from __future__ import annotations

from ecm.cli import interrupt

TYPE_CHECKING = False  # typing takes long to load
if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["run"]


def main() -> None:
    """Entry point of the command `ecm`."""
    interrupt.install()  # before anything that takes time to import
    from ecm.cli.main import main as run_command  # noqa: PLC0415 - see above

    run_command()


def run(arguments: Sequence[str] | None = None) -> int:
    """Run one command line and return its exit code.

    Parameters
    ----------
    arguments
        Arguments without the program's name; by default those of the process.

    Returns
    -------
    int
        0 done, 1 the computation failed, 2 bad input, 130 interrupted.

    Examples
    --------
    >>> from ecm.cli import run
    >>> run(["effects", "payload", "--quiet"])
    0
    """
    from ecm.cli.main import run as run_command  # noqa: PLC0415 - a library may import the package

    return run_command(arguments)
