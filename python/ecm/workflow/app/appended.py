"""A file that is only appended, read as it grows."""

from __future__ import annotations

import os
from pathlib import Path


class AppendedFile:
    """The lines of a file that is only appended; each is read from the disk once.

    Parameters
    ----------
    path
        Need not be there yet.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._read_to = 0

    def read(self) -> tuple[bool, bytes, bytes]:
        """Return whether the file begins anew, its new whole lines, and the line under way.

        Raises
        ------
        OSError
            Where it cannot be read.
        """
        with self.path.open("rb") as file:
            anew = file.seek(0, os.SEEK_END) < self._read_to  # another file of this name
            if anew:
                self._read_to = 0
            file.seek(self._read_to)
            content = file.read()
        whole = content.rfind(b"\n") + 1
        self._read_to += whole
        return anew, content[:whole], content[whole:]
