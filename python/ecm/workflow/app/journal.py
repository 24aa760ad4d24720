"""The journal of a session: one JSON record a line, only ever appended; a disk that is full.

A step has a record when it begins and one when it ends. A step without an end, in a session that
nobody works on, was interrupted.
"""

from __future__ import annotations

import json
import os
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ecm.errors import EcmError, InputError


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


DATA = ("upload", "example", "import", "campaign")
"""Steps that change the data."""
CHANGES = (*DATA, "fit", "refit")
"""Steps that change the data or the model. Undo takes the last of them back, with all after it."""
_FIRST = b'{"event": "begin"'
"""How each journal begins."""


@dataclass
class Step:
    """One step of the session."""

    number: int
    verb: str
    request: dict[str, Any]
    """What the page asked for, to run it again."""
    argv: list[str]
    """Arguments of `ecm`; empty where no command is run."""
    inputs: dict[str, Any]
    outputs: list[str]
    """Files of the session folder that the step writes."""
    begun_s: float
    status: str = "running"
    message: str = ""
    remedy: dict[str, Any] | None = None
    """The way out of a refusal: words and, where one helps, a command."""
    seconds: float | None = None


@dataclass
class History:
    """All steps, and which of them count."""

    steps: dict[int, Step] = field(default_factory=dict)
    active: list[int] = field(default_factory=list)
    undone: list[list[int]] = field(default_factory=list)
    """Groups of steps that redo brings back, the last one first."""
    accepted: set[tuple[int, str]] = field(default_factory=set)
    """Warnings that the person takes responsibility for, with their check."""
    records: int = 0

    def last(self, *verbs: str, **inputs: Any) -> Step | None:
        """Return the last step that counts of these verbs with these inputs."""
        for number in reversed(self.active):
            step = self.steps[number]
            if step.verb in verbs and all(step.inputs.get(k) == v for k, v in inputs.items()):
                return step
        return None

    def take(self, record: Mapping[str, Any]) -> None:
        """Change the history by one record."""
        self.records += 1
        event = record["event"]
        if event == "begin":
            names = ("number", "verb", "request", "argv", "inputs", "outputs", "begun_s")
            step = Step(**{name: record[name] for name in names})
            self.steps[step.number] = step
        elif event == "end":
            step = self.steps[record["number"]]
            step.status, step.message = record["status"], record["message"]
            step.seconds, step.remedy = record["seconds"], record.get("remedy")
            if step.status == "done":
                self.active.append(step.number)
                if step.verb in CHANGES:  # one that only looks leaves what was undone
                    self.undone.clear()
        elif event == "undo":
            at = self._last_change()
            if at is not None:
                self.undone.append(self.active[at:])
                del self.active[at:]
        elif event == "redo" and self.undone:
            self.active += self.undone.pop()
        elif event == "accept":
            self.accepted.add((record["number"], record["warning"]))

    def can_undo(self) -> bool:
        """Whether a change of data or model is left."""
        return self._last_change() is not None

    def _last_change(self) -> int | None:
        places = [i for i, n in enumerate(self.active) if self.steps[n].verb in CHANGES]
        return places[-1] if places else None


class Journal:
    """The file `steps.jsonl` of a session folder.

    Raises
    ------
    InputError
        Where the file is there and is no journal.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock = threading.Lock()
        self._forget()
        self._require_own()

    def _require_own(self) -> None:
        try:
            with self.path.open("rb") as file:
                first = file.read(len(_FIRST))
        except FileNotFoundError:
            return
        if not _FIRST.startswith(first):  # a kill may have cut the first record
            raise InputError(
                f"{self.path} is there already, and is no journal of `ecm app`: name another "
                "folder with --session"
            )

    def append(self, **record: Any) -> None:
        """Write one record to the disk.

        Raises
        ------
        DiskError
            Where it cannot be written; a part of it is left out by `read`.
        """
        line = json.dumps(record, ensure_ascii=False) + "\n"
        with self._lock, writing(self.path), self.path.open("ab+") as file:
            # A kill in the middle of a record leaves a line without an end.
            if file.tell() and not _ends_line(file):
                line = "\n" + line
            file.write(line.encode())
            file.flush()
            os.fsync(file.fileno())

    def read(self) -> History:
        """Return the history; a line that a kill has cut is left out."""
        history = History()
        for record in self._all():
            history.take(record)
        return history

    def _all(self) -> list[dict[str, Any]]:
        """Return the records; of the file, only what is new is read."""
        with self._lock:
            try:
                anew, whole, under_way = self._file.read()
            except FileNotFoundError:
                self._forget()
                return []
            if anew:
                self._records.clear()
            self._records += _records(whole)
            return self._records + _records(under_way)

    def _forget(self) -> None:
        self._file = AppendedFile(self.path)
        self._records: list[dict[str, Any]] = []


def _records(lines: bytes) -> list[dict[str, Any]]:
    found = []
    for line in lines.split(b"\n"):
        with suppress(ValueError):  # a line that a kill has cut
            found.append(json.loads(line))
    return found


def _ends_line(file: Any) -> bool:
    file.seek(-1, os.SEEK_END)
    return bool(file.read(1) == b"\n")
