"""Steps of a work, told to who waits for it, and to other programs as lines of JSON.

They are appended to the file that ECM_EVENTS of the environment names, and those of a measurement
to NAME.live.jsonl beside its table. The page's server reads them; the words on the terminal are for
people and may change.
"""

from __future__ import annotations

import json
import os
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import fields, is_dataclass
from html import escape
from pathlib import Path
from typing import Any, TypeVar

T = TypeVar("T")

Progress = Callable[[float, float, str], object]
"""Called with the part that is done, the whole, and the name of the step that goes on."""
_MANY_PARTS = 20
"""From so many parts on, doing one of them before costs little."""


def tell_part(progress: Progress | None, done: float, total: float, words: str = "") -> None:
    """Tell how much of a work is done, where somebody waits.

    Examples
    --------
    >>> tell_part(lambda *what: print(what), 1, 3, "maps")
    (1, 3, 'maps')
    >>> tell_part(None, 1, 3)
    """
    if progress is not None:
        progress(done, total, words)


class Steps:
    """Tells which step begins and how much of the work is done before it.

    Parameters
    ----------
    shares
        Share of each step in the time, in order, as whole numbers.
    progress
        Called when a step begins; None: nobody waits.

    Examples
    --------
    >>> told = []
    >>> steps = Steps({"errors": 2, "maps": 1}, lambda *what: told.append(what))
    >>> steps.begin("errors")
    >>> steps.begin("maps")
    >>> told
    [(0, 3, 'errors'), (2, 3, 'maps')]

    A step that counts its own parts gets a callback of its own:

    >>> steps = Steps({"read": 1, "fit": 3}, lambda *what: told.append(what))
    >>> part = steps.within("fit")
    >>> part(50, 100, "")
    >>> told[-1]
    (2.5, 4, 'fit')
    """

    def __init__(self, shares: Mapping[str, int], progress: Progress | None) -> None:
        self._shares, self._progress = dict(shares), progress

    def begin(self, name: str) -> None:
        """Tell that this step begins."""
        tell_part(self._progress, self._before(name), sum(self._shares.values()), name)

    def within(self, name: str) -> Progress | None:
        """Begin this step and return what tells its own parts; None: nobody waits."""
        progress = self._progress
        if progress is None:
            return None
        self.begin(name)
        before, share, whole = self._before(name), self._shares[name], sum(self._shares.values())

        def part(done: float, total: float, words: str) -> None:
            progress(before + share * done / total, whole, ", ".join(filter(None, (name, words))))

        return part

    def _before(self, name: str) -> int:
        names = list(self._shares)
        return sum(self._shares[before] for before in names[: names.index(name)])


def after_a_part(
    work: Callable[[int], T], whole: int, part: int, progress: Progress | None, words: str = ""
) -> T:
    """Result of a work that grows with a number, and that tells nothing before its end.

    Where somebody waits and the whole is many times a part, the part is done before, so that its
    time tells that of the whole.

    Examples
    --------
    >>> told = []
    >>> after_a_part(abs, 900, 10, lambda *w: told.append(w))
    900
    >>> told
    [(0, 910, ''), (10, 910, '')]
    """
    if progress is not None and whole >= _MANY_PARTS * part:
        progress(0, whole + part, words)
        work(part)
        progress(part, whole + part, words)
    return work(whole)


VARIABLE = "ECM_EVENTS"
EVERY_S = 0.3
"""Seconds between two lines about the same step."""
_LATEST = 20_000
"""Bytes of a file that are looked at: the events of the last seconds."""


_BESIDE: list[Path] = []
"""Files that hear all events besides."""


def tell(**event: Any) -> None:
    """Append one line; where nobody asked for them, or the disk is full, there is none."""
    for path in filter(None, [os.environ.get(VARIABLE, ""), *map(str, _BESIDE)]):
        with suppress(OSError), open(path, "a", encoding="utf-8") as file:
            file.write(json.dumps(event) + "\n")


def live_path(table: Path) -> Path:
    """Where a measurement tells its state while its table grows.

    Examples
    --------
    >>> live_path(Path("data.csv")).name
    'data.live.jsonl'
    """
    return table.with_name(table.stem + ".live.jsonl")


@contextmanager
def told_beside(table: Path) -> Iterator[None]:
    """Tell events beside a table as well, until it is written; a stop is told with its reason.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder, told_beside(Path(folder) / "data.csv"):
    ...     tell(measured={"row": 0})
    ...     live_path(Path(folder) / "data.csv").read_text()
    '{"measured": {"row": 0}}\\n'
    """
    path = live_path(table)
    _BESIDE.append(path)
    try:
        yield
    except BaseException as error:
        tell(ended=str(error) or "interrupted")
        raise
    finally:
        _BESIDE.remove(path)
    path.unlink(missing_ok=True)


def with_words(
    progress: Callable[[int, int, str], object] | None, words: str
) -> Callable[[int, int], object] | None:
    """A callback (done, total) that tells these words besides; None: nobody waits.

    Examples
    --------
    >>> told = []
    >>> with_words(lambda *what: told.append(what), "solving")(1, 2)
    >>> told, with_words(None, "solving")
    ([(1, 2, 'solving')], None)
    """
    return progress and (lambda done, total: progress(done, total, words))


def last(told: bytes, name: str) -> dict[str, Any] | None:
    """The last event with this key among the latest of a file; None where there is none.

    Examples
    --------
    >>> last(b'{"what": "fit", "done": 1}', "what")
    {'what': 'fit', 'done': 1}
    """
    for line in reversed(told[-_LATEST:].splitlines()):
        with suppress(ValueError):  # the last line may be half written
            event = json.loads(line)
            if isinstance(event, dict) and name in event:
                return event
    return None


class Printed:
    """A result that prints its words; at a prompt it is their first line.

    A subclass says its words by `__str__`.

    Examples
    --------
    >>> class Answer(Printed):
    ...     def __str__(self) -> str:
    ...         return "error 0.9 times the noise\\nfx_N 0.9"
    >>> Answer()
    <Answer: error 0.9 times the noise>
    >>> Answer()._repr_html_()
    '<pre>error 0.9 times the noise\\nfx_N 0.9</pre>'
    """

    def __repr__(self) -> str:
        """The first line of the words."""
        return f"<{type(self).__name__}: {str(self).partition(chr(10))[0]}>"

    def _repr_html_(self) -> str | None:
        """Show the words in a notebook."""
        return f"<pre>{escape(str(self))}</pre>"


def to_json(value: Any) -> Any:
    """Return plain JSON of results: records become objects, tuples lists.

    A field's metadata may change its key (`json`; empty: left out) or leave out a value that is
    None or empty (`optional`). A `to_dict` of the record's own goes first.

    Examples
    --------
    >>> from ecm.errors import Remedy
    >>> to_json({"remedies": (Remedy("add a length", None),)})["remedies"][0]["words"]
    'add a length'
    """
    if hasattr(value, "to_dict"):
        return value.to_dict()
    if is_dataclass(value):
        return fields_json(value)
    if isinstance(value, Mapping):
        return {key: to_json(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [to_json(entry) for entry in value]
    return value


def fields_json(record: Any) -> dict[str, Any]:
    """Return the fields of a record as plain JSON."""
    pairs = [(item, getattr(record, item.name)) for item in fields(record)]
    return {
        item.metadata.get("json", item.name): to_json(value)
        for item, value in pairs
        if item.metadata.get("json", item.name)
        and not (item.metadata.get("optional") and value in (None, ()))
    }


class Follower:
    """A measurement by the events that it tells: each line of their file is read once.

    A run that goes on after a cut tells all its readings again, after a new `begun`.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     path = Path(folder) / "data.live.jsonl"
    ...     lines = ['{"begun": {"at": 1.0}}', '{"measured": {"row": 0}}', '{"ended": "why"}', ""]
    ...     _ = path.write_text("\\n".join(lines))
    ...     found = Follower().after(path, 0)
    >>> found["run"], found["rows"], found["ended"]
    (1.0, [{'row': 0}], 'why')
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._of: tuple[Path, bytes] = (Path(), b"")
        """The file, and its first line: another file of this name begins with another."""
        self._read_to = 0
        self._begun: dict[str, Any] = {}
        self._rows: list[dict[str, Any]] = []
        self._ended: str | None = None

    def after(self, path: Path, row: int) -> dict[str, Any]:
        """Return what a file tells of its last run.

        Parameters
        ----------
        path
            The file of events; it need not be there yet.
        row
            Readings that are known already.

        Returns
        -------
        dict
            `run`: when it began, and `begun`: what was told then, where no reading is known; both
            None before. `rows`: the readings after those; `ended`: why it was stopped; `age_s`:
            seconds since the last event.
        """
        with self._lock, suppress(OSError), path.open("rb") as file:
            of = path, file.readline()
            if of != self._of:
                self._of, self._read_to = of, 0
                self._begun, self._rows, self._ended = {}, [], None
            file.seek(self._read_to)
            content = file.read()
            whole = content[: content.rfind(b"\n") + 1]
            self._read_to += len(whole)
            for line in whole.splitlines():
                self._take(line)
            return {
                "run": self._begun.get("at"),
                "begun": (not row and self._begun) or None,
                "rows": self._rows[row:],
                "ended": self._ended,
                "age_s": time.time() - os.fstat(file.fileno()).st_mtime,
            }
        return {"run": None, "begun": None, "rows": [], "ended": None, "age_s": None}

    def _take(self, line: bytes) -> None:
        with suppress(ValueError):  # a kill may have cut it
            event = json.loads(line, parse_constant=lambda _: None)  # a page knows no NaN
            if "begun" in event:
                self._begun, self._rows, self._ended = event["begun"], [], None
            elif "measured" in event:
                self._rows.append(event["measured"])
            elif "ended" in event:
                self._ended = event["ended"]
