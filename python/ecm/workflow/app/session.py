"""A session folder: its files, the changes of it as steps, undo and redo, and the script of it all.

steps.jsonl     the journal
upload-N.csv    a table that was dropped; its own name is in the journal only
model-N.json, fit-N.json, compare-N.html …   what step N wrote
logs/           what the commands printed
views/          what the page draws, computed from the files above; may be deleted
"""

from __future__ import annotations

import json
import re
import shlex
import shutil
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from ecm.errors import EcmError, InputError, Remedy, remedy_of
from ecm.io import events
from ecm.io.cache import write_atomically
from ecm.io.description import Meta, row_ranges, rows_of, with_leave_out
from ecm.io.settings import parse_toml, read_toml, write_toml
from ecm.io.table import read_table
from ecm.workflow.app.journal import DATA, History, Journal, Step, writing
from ecm.workflow.app.steps import DEMO_FILES, PLAN, RIG, Files, command_of, way_out, write_demo

TABLES = (".csv", ".parquet", ".pq")
LOGS = (".txt", ".tsv", ".dat", ".log", ".mat", ".h5", ".hdf5", ".npz", ".mcap", ".db3")
"""Suffixes of files that `ecm import` makes a table of."""
TRUTH = ".truth.json"
MARKED = "marked"
"""The reason of rows that a person leaves out."""
_OWN_MARKS = re.compile(rf"left out by \[leave_out\]: {MARKED} [^:]*$")
"""Tells that rows are left out as the person has marked them, and says no more."""
TYPED = ("mechanism", "instrument", "scene")
"""Sections of a description that a person types."""
BESIDE = (".toml", TRUTH, ".raw.parquet")
"""What belongs to a table, by suffix."""


def suffix_of(name: str) -> str:
    """Return the suffix of a table or a log, in small letters.

    Raises
    ------
    InputError
        For any other file.
    """
    suffix = Path(name).suffix.lower()
    if suffix not in TABLES + LOGS:
        raise InputError(f"{name}: expected a table or a log: {' '.join(TABLES + LOGS)}")
    return suffix


def copy_beside(source: Path, target: Path, without: Sequence[str] = ()) -> list[str]:
    """Copy what belongs to a table, and return the names."""
    names = []
    for extra in BESIDE:
        if extra not in without and source.with_suffix(extra).is_file():
            shutil.copyfile(source.with_suffix(extra), target.with_suffix(extra))
            names.append(target.with_suffix(extra).name)
    return names


def sealed_description(source: Path, table: Path, name: str) -> str | None:
    """Return a description with the seal of the table's own; None where there is no seal."""
    if not table.with_suffix(TRUTH).is_file():
        return None
    own = read_toml(table.with_suffix(".toml"), "description of a table").get("file", {})
    document = read_toml(source, f"description {name}")
    file = document.setdefault("file", {})
    if isinstance(file, dict):  # the check of the table refuses any other
        file.setdefault("truth_sha256", own.get("truth_sha256", ""))
    return write_toml(document)


_SCRIPT = """#!/bin/sh
# The steps of this session as commands. They write the same files, byte for byte:
#   sh script.sh NEW_FOLDER
set -e
from=$(cd "$(dirname "$0")" && pwd)
to=${1:?"give a new folder: sh script.sh NEW_FOLDER"}
[ -f "$from/steps.jsonl" ] || { echo "put this script into the session folder" >&2; exit 1; }
mkdir "$to"
"""


def _said(warning: str) -> str:
    """Return a warning without the number of the file, which changes with its description."""
    return re.sub(r"\b(upload|data)-\d+", "", warning)


INCOMING = ".ecm-incoming-"
"""Begin of the name of a file that is on its way here."""
INTERRUPTED = "the server was stopped in the middle of it"


class Session:
    """A session folder that is worked on; its journal explains the files.

    Parameters
    ----------
    folder
        Made where it is not there.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "views").mkdir(exist_ok=True)
        self.journal = Journal(folder / "steps.jsonl")

    def now(self) -> tuple[History, Files]:
        """Return the history, and the files that count."""
        history = self.journal.read()
        return history, self.files(history)

    def files(self, history: History) -> Files:
        """Return the files that count now."""
        changed = history.last(*DATA)
        data = [] if changed is None else list(changed.inputs["data_after"])
        dropped = history.last("upload")
        logs = [] if dropped is None else dropped.inputs.get("dropped_after", dropped.outputs[:1])
        fitted = history.last("fit", "refit", data=data)
        model = None if fitted is None else model_of(fitted)
        found = history.last("diagnose", data=data, model=model)
        checks = [check for check in self._checks(history, data) if check.status == "done"]
        answered = history.last("diagnose", data=data)
        written = [] if found is None else found.outputs
        plan = next((name for name in written if name.endswith(".csv")), None)
        sealed = next((d for d in data if self._beside(d, TRUTH).is_file()), None)
        return Files(
            data=data,
            model=model,
            answer=None if answered is None else answered.outputs[0],
            next_plan=plan if plan and (self.folder / plan).is_file() else None,
            dropped=logs,
            described=frozenset(d for d in logs if self._beside(d, ".toml").is_file()),
            sealed=sealed,
            simulated=sealed is not None and (self.folder / RIG).is_file(),
            skip_bad_rows=any(check.request.get("skip_bad_rows") for check in checks),
        )

    def downloads(self, history: History | None = None) -> list[str]:
        """Return the names that may be asked for: outputs of finished steps, and the script.

        Sealed truths are not among them; `reveal` opens one.
        """
        history = self.journal.read() if history is None else history
        names = ["script.sh", "steps.jsonl"]
        for step in history.steps.values():
            for name in step.outputs if step.status == "done" else []:
                path = self.folder / name
                if path.is_dir():
                    inside = sorted(p for p in path.rglob("*") if p.is_file())
                    names += [p.relative_to(self.folder).as_posix() for p in inside]
                elif path.is_file() and not name.endswith(TRUTH):
                    names.append(name)
        return names

    def log(self, number: int, kind: str) -> bytes:
        """Return what the command of a step printed, `out` or `err`, or told, `events`."""
        with suppress(OSError):
            return self.log_path(number, kind).read_bytes()
        return b""

    def log_path(self, number: int, kind: str) -> Path:
        """Return where that is."""
        return self.folder / "logs" / f"{number}.{kind}"

    def told(self, number: int, name: str) -> dict[str, Any]:
        """Return the last event with this key that the command of a step told."""
        return events.last(self.log(number, "events"), name) or {}

    def pending(self, history: History, check: Step) -> list[str]:
        """Return the open warnings of a check.

        One that was accepted stays so where rows were left out, or more was said of the tables.
        """
        document = self.result(check) or {}
        checks = {step.number for step in self._checks(history, check.inputs["data"])}
        taken = {_said(warning) for number, warning in history.accepted if number in checks}
        warnings = document.get("warnings", [])
        return [w for w in warnings if _said(w) not in taken and not _OWN_MARKS.search(w)]

    def result(self, step: Step | None) -> Any:
        """Return the JSON document of a step, with its number."""
        names = [] if step is None else step.outputs
        report = next((n for n in names if n.endswith(".json") and not n.startswith("model-")), "")
        with suppress(OSError, ValueError):
            document = json.loads((self.folder / report).read_bytes())
            return {**document, "step": None if step is None else step.number}
        return None

    def opened(self, history: History, files: Files) -> Step | None:
        """Return the last step that opened the truth of these tables; undo does not close it."""
        sealed = {self._truth(name) for name in files.data} - {None}
        opened = [s for s in history.steps.values() if (s.verb, s.status) == ("reveal", "done")]
        return next((s for s in reversed(opened) if self._truth(s.argv[1]) in sealed), None)

    def _truth(self, table: str) -> bytes | None:
        path = self._beside(table, TRUTH)
        return path.read_bytes() if path.is_file() else None

    def _beside(self, table: str, suffix: str) -> Path:
        return (self.folder / table).with_suffix(suffix)

    def recover(self) -> list[int]:
        """Mark the steps that a killed server has left as interrupted; return their numbers."""
        left = [s.number for s in self.journal.read().steps.values() if s.status == "running"]
        for number in left:
            self.end(number, "interrupted", INTERRUPTED, 0.0)
        for path in self.folder.glob(f"{INCOMING}*"):
            path.unlink(missing_ok=True)
        return left

    def begin(self, verb: str, request: dict[str, Any]) -> Step:
        """Record that a step begins, with its command.

        Raises
        ------
        InputError
            Where the step is not possible now, or the request is wrong.
        """
        history, files = self.now()
        number = self._next_number(history)
        if verb in ("fit", "refit", "compare", "diagnose"):
            self._require_checked(history, files)
        command = command_of(verb, request, files, number)
        if verb == "example" and request["name"] == "neck":
            with writing(self.folder / PLAN):
                write_demo(self.folder)
        inputs: dict[str, Any] = {"data": files.data, "model": files.model}
        if verb in DATA:
            adds = verb == "campaign" or (verb == "import" and request.get("more"))
            inputs["data_after"] = [*(files.data if adds else []), command.outputs[0]]
        return self.journal.begin(
            Step(number, verb, request, command.argv, inputs, command.outputs)
        )

    def way_out(self, error: EcmError) -> dict[str, Any] | None:
        """Return the way out of a request that was refused; None where it has none.

        As that of a refused step: with the request of the step that does it, where one does.
        """
        remedy = remedy_of(error)
        if remedy is None:
            return None
        _, files = self.now()
        names = {"DATA": shlex.join(files.data), "MODEL": files.model or "MODEL"}
        return way_out(remedy.filled({**names, "OUT": "model.json"}).to_dict(), files)

    def end(
        self,
        number: int,
        status: str,
        message: str,
        seconds: float,
        remedy: dict[str, Any] | None = None,
    ) -> None:
        """Record how a step ended."""
        record = {"status": status, "message": message, "seconds": round(seconds, 3)}
        record |= {} if remedy is None else {"remedy": remedy}
        self.journal.append(event="end", number=number, **record)

    def add_table(self, source: Path, name: str, *, more: bool = False, move: bool = False) -> Step:
        """Take a table into the session; it replaces the data, or adds a run to them.

        Parameters
        ----------
        source
            The file; it is copied, with what belongs to it.
        name
            Its own name: a text that is shown, and never a path.
        more
            Add it as a run.
        move
            The file is of this session: it is moved.
        """
        history, files = self.now()
        suffix = suffix_of(name)
        number = self._next_number(history)
        target = self.folder / f"upload-{number}{suffix}"
        outputs = [target.name]
        if move:
            source.replace(target)
        else:
            with writing(target, name):
                shutil.copyfile(source, target)
                outputs += copy_beside(source, target)
        data = files.data if suffix in LOGS else [*(files.data if more else []), target.name]
        dropped = [*(files.dropped if more else []), target.name]
        after = {"data_after": data, "dropped_after": dropped}
        return self._add_upload(number, {"name": name}, outputs, files, after)

    def add_description(self, source: Path, name: str) -> Step:
        """Put a description (TOML) beside the last table, or the last log, of the session.

        A table of the simulated rig keeps its sealed truth.

        Raises
        ------
        InputError
            Where there is neither, or the description is no TOML.
        """
        files = self.now()[1]
        last = (files.data or files.dropped)[-1:]
        if not last:
            raise InputError(f"{name}: drop the table first, then its description")
        described = sealed_description(source, self.folder / last[0], name)
        content = source.read_bytes() if described is None else described.encode()
        return self._redescribe(last[0], content, {"name": name, "describes": last[0]})

    def leave_out(self, rows: Any) -> None:
        """Leave rows out of the tables, by their descriptions: the tables stay as they are.

        Raises
        ------
        InputError
            Where they are no rows of the tables, or all of them.
        """
        history, files = self.now()
        if not isinstance(rows, list) or not rows or not all(type(row) is int for row in rows):
            raise InputError("rows: expected a list of row numbers")
        numbers = [
            read_table([self.folder / name], skip_bad_rows=files.skip_bad_rows).numbers_in_file
            for name in files.data
        ]
        ends = np.cumsum([0, *map(len, numbers)])
        if min(rows) < 1 or max(rows) > ends[-1]:
            raise InputError(f"rows: expected numbers from 1 to {ends[-1]}")
        of_tables = np.split(np.isin(np.arange(1, ends[-1] + 1), rows), ends[1:-1])
        for name, own, left_out in zip(files.data, numbers, of_tables, strict=True):
            if not left_out.any():
                continue
            if left_out.all():
                raise InputError(f"{history.own_name(name)}: these are all of its rows")
            text = self._description(name)
            left = parse_toml(text, name, "description of a table").get("leave_out", {})
            marked = {*own[left_out].tolist(), *rows_of(left.get(MARKED, ""), name).tolist()}
            text = with_leave_out(text, {**left, MARKED: row_ranges(marked)})
            self._redescribe(name, text.encode(), {"name": history.own_name(name), "of": name})

    def describe(self, sections: Any) -> None:
        """Say of all tables what a person typed: keys and values by section; None takes one out.

        Raises
        ------
        InputError
            Where there is no table, or a value is not possible.
        """
        history, files = self.now()
        if not isinstance(sections, dict) or not set(sections) <= set(TYPED):
            raise InputError(f"sections: expected {' or '.join(TYPED)}")
        written = []
        for name in files.data:
            document = parse_toml(self._description(name), name, "description of a table")
            for section, given in sections.items():
                own = {**document.get(section, {}), **given}
                document[section] = {key: value for key, value in own.items() if value is not None}
                if not document[section]:
                    del document[section]
            text = write_toml(document)
            Meta.from_dict(document, history.own_name(name))
            written.append((name, text))
        for name, text in written:
            self._redescribe(name, text.encode(), {"name": history.own_name(name), "of": name})

    def following(self, step: Step) -> dict[str, Any] | None:
        """Return the import of the next log that was dropped with that of a step."""
        if step.verb != "import":
            return None
        logs = self.now()[1].dropped
        rest = logs[logs.index(step.argv[1]) + 1 :]
        return {**step.request, "verb": "import", "log": rest[0], "more": True} if rest else None

    def accept(self, warning: str) -> None:
        """Record that the person takes responsibility for a warning of the check."""
        history, files = self.now()
        step = history.last("check", data=files.data)
        if step is None or warning not in self.pending(history, step):
            raise InputError("no such warning in the check of these tables")
        self.journal.append(event="accept", number=step.number, warning=warning)

    def undo(self) -> None:
        """Take the last change of data or model back, with what followed it."""
        if not self.journal.read().can_undo():
            raise InputError("nothing to undo")
        self.journal.append(event="undo")

    def redo(self) -> None:
        """Bring back what was undone last."""
        if not self.journal.read().undone:
            raise InputError("nothing to redo")
        self.journal.append(event="redo")

    def script(self) -> str:
        """Return the commands of the steps that count, as a shell script."""
        history = self.journal.read()
        steps = [history.steps[number] for number in history.active]
        given = [name for step in steps if not step.argv for name in step.outputs]
        given += [name for name in DEMO_FILES if (self.folder / name).is_file()]
        lines = [f'cp "$from"/{shlex.quote(name)} "$to"/' for name in dict.fromkeys(given)]
        lines.append('cd "$to"')
        lines += [shlex.join(["ecm", *step.argv]) for step in steps if step.argv]
        return _SCRIPT + "\n".join(lines) + "\n"

    def described(self, files: Files) -> dict[str, Any]:
        """Return what is said of the first table in the sections that a person types."""
        document: dict[str, Any] = {}
        for name in files.data[:1]:
            with suppress(EcmError, OSError, ValueError):
                document = parse_toml(self._description(name), name, "description of a table")
        return {name: document[name] for name in TYPED if name in document}

    # --- parts -------------------------------------------------------------
    @staticmethod
    def _checks(history: History, data: list[str]) -> list[Step]:
        """Return the checks of these tables, and of them before rows were left out or more said."""
        found = []
        for step in reversed(history.steps.values()):
            if "of" in step.request and step.inputs["data_after"] == data:
                data = step.inputs["data"]
            elif step.verb == "check" and step.inputs["data"] == data:
                found.append(step)
        return found

    def _description(self, table: str) -> str:
        path = self._beside(table, ".toml")
        return path.read_text(encoding="utf-8") if path.is_file() else ""

    def _redescribe(self, table: str, content: bytes, request: dict[str, Any]) -> Step:
        """Put a description beside a copy of a table, which takes its place."""
        history, files = self.now()
        number = self._next_number(history)
        old = self.folder / table
        target = self.folder / f"upload-{number}{old.suffix}"
        with writing(target, request["name"]):
            shutil.copyfile(old, target)
            extras = copy_beside(old, target, without=(".toml",))
            write_atomically(target.with_suffix(".toml"), content)
        outputs = [target.name, target.with_suffix(".toml").name, *extras]
        renamed = {table: target.name}
        after = {
            "data_after": [renamed.get(name, name) for name in files.data],
            "dropped_after": [renamed.get(name, name) for name in files.dropped],
        }
        return self._add_upload(number, request, outputs, files, after)

    def _add_upload(
        self,
        number: int,
        request: dict[str, Any],
        outputs: list[str],
        files: Files,
        after: dict[str, list[str]],
    ) -> Step:
        """Record an upload; `after`: the tables that count then, and the files to import."""
        inputs = {"data": files.data, **after}
        step = self.journal.begin(Step(number, "upload", request, [], inputs, outputs))
        self.end(number, "done", "", 0.0)
        return step

    def _next_number(self, history: History) -> int:
        """Return a number that no file of the folder has: a person's file stays as it is."""
        number = max(history.steps, default=0) + 1
        while any(
            next(folder.glob(pattern), None) is not None
            for folder, pattern in (
                (self.folder, f"*-{number}"),
                (self.folder, f"*-{number}.*"),
                (self.folder / "logs", f"{number}.*"),
            )
        ):
            number += 1
        return number

    def _require_checked(self, history: History, files: Files) -> None:
        check = history.last("check", data=files.data)
        if check is None:
            raise InputError(
                "the tables are not checked: nothing goes on until the check passes",
                remedy=Remedy("check them", "ecm check DATA"),
            )
        pending = self.pending(history, check)
        if pending:
            raise InputError(
                f"a warning of the check is open: {pending[0]}",
                remedy=Remedy("accept it at the table, or mend the table and drop it again"),
            )


def model_of(step: Step) -> str:
    return step.outputs[0]
