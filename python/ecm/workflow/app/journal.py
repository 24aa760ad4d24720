"""The journal of a session: one JSON record a line, only ever appended; a disk that is full.

A step has a record when it begins and one when it ends. A step without an end, in a session that
nobody works on, was interrupted.
"""

from __future__ import annotations

import json
import os
import threading
import time
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


DATA = ("upload", "example", "import", "campaign")
"""Steps that change the data."""
CHANGES = (*DATA, "fit", "refit")
"""Steps that change the data or the model. Undo takes the last of them back, with all after it."""
_FIRST = b'{"event": "begin"'
"""How each journal begins."""


_BEGUN = ("number", "verb", "request", "argv", "inputs", "outputs", "begun_s")
"""What of a step is known when it begins."""


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
    begun_s: float = field(default_factory=lambda: round(time.time(), 3))
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
            step = Step(**{name: record[name] for name in _BEGUN})
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

    def own_name(self, table: str) -> str:
        """Return the name under which a table, or the log that it is of, was dropped."""
        for step in self.steps.values():
            if table in step.outputs:
                source = step.argv[1] if step.verb == "import" else step.request.get("describes")
                return self.own_name(source) if source else str(step.request.get("name") or table)
        return table

    def can_undo(self) -> bool:
        """Whether a change of data or model is left."""
        return self._last_change() is not None

    def _last_change(self) -> int | None:
        places = [i for i, n in enumerate(self.active) if self.steps[n].verb in CHANGES]
        return places[-1] if places else None


class Journal:
    """The file `steps.jsonl` of a session folder, which one server writes.

    Raises
    ------
    InputError
        Where the file is there and is no journal.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock = threading.Lock()
        self._records: list[dict[str, Any]] | None = None
        """Those of the file; None: to be read."""
        with suppress(FileNotFoundError), path.open("rb") as file:
            if not _FIRST.startswith(file.read(len(_FIRST))):  # a kill may have cut the first one
                raise InputError(
                    f"{path} is there already, and is no journal of `ecm app`: name another "
                    "folder with --session"
                )

    def begin(self, step: Step) -> Step:
        """Write that a step begins."""
        self.append(event="begin", **{name: getattr(step, name) for name in _BEGUN})
        return step

    def append(self, **record: Any) -> None:
        """Write one record to the disk.

        Raises
        ------
        DiskError
            Where it cannot be written; a part of it is left out by `read`.
        """
        line = json.dumps(record, ensure_ascii=False).encode() + b"\n"
        with self._lock:
            known, self._records = self._records, None  # where it fails, the file is read again
            with writing(self.path), self.path.open("ab+") as file:
                # A kill in the middle of a record leaves a line without an end.
                file.seek(max(file.tell() - 1, 0))
                file.write(line if file.read(1) in (b"", b"\n") else b"\n" + line)
                file.flush()
                os.fsync(file.fileno())
            if known is not None:
                self._records = [*known, json.loads(line)]

    def read(self) -> History:
        """Return the history; a line that a kill has cut is left out."""
        with self._lock:
            if self._records is None:
                self._records = []
                for line in self.path.read_bytes().split(b"\n") if self.path.exists() else ():
                    with suppress(ValueError):
                        self._records.append(json.loads(line))
            records = self._records
        history = History()
        for record in records:
            history.take(record)
        return history
