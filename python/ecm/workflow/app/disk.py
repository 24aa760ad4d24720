"""A file that cannot be written, as on a full disk: which one, and what to do."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ecm.errors import EcmError


class DiskError(EcmError):
    """A file of the session cannot be written."""


@contextmanager
def writing(path: Path, name: str = "") -> Iterator[None]:
    """Turn an error of the file system into one that names the file and the next step.

    Parameters
    ----------
    path
        The file that is written.
    name
        What a person calls it; by default the name of the file.

    Raises
    ------
    DiskError
        In place of OSError.
    """
    try:
        yield
    except OSError as error:
        raise DiskError(sentence(error, path, name)) from None


def sentence(error: OSError, path: Path | None = None, name: str = "") -> str:
    """Return what could not be written, why, and what to do."""
    at = path or Path(str(error.filename or "a file"))
    where = f" to {at.parent.resolve()}" if at.is_absolute() or path else ""
    return (
        f"{name or at.name}: cannot be written{where} ({error.strerror or error}). Free some space "
        "there, or mend its permissions, and do this step again; what is finished is kept."
    )
