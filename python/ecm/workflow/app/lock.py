"""One server at a time in a session folder; a killed one leaves no lock."""

from __future__ import annotations

import sys
from pathlib import Path

from ecm.errors import InputError

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl


class FolderLock:
    """The lock of a folder, held until `release` or the end of the process.

    Raises
    ------
    InputError
        Where another process holds it.
    """

    def __init__(self, folder: Path) -> None:
        self._file = (folder / ".lock").open("a+b")
        try:
            if sys.platform == "win32":
                msvcrt.locking(self._file.fileno(), msvcrt.LK_NBLCK, 1)
            else:
                fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            self._file.close()
            raise InputError(
                f"{folder}: another `ecm app` has this session open. Use its page, end it, or name "
                "another folder with --session."
            ) from None

    def release(self) -> None:
        """Let another server have the folder."""
        self._file.close()
