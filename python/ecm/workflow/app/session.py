"""Changes of a session: steps, tables brought in, undo and redo, and the script of it all."""

from __future__ import annotations

import shlex
import shutil
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ecm.errors import EcmError, InputError, Remedy, remedy_of
from ecm.io.cache import write_atomically
from ecm.workflow.app.contents import LOGS, Contents, copy_beside, sealed_description, suffix_of
from ecm.workflow.app.journal import DATA, History, Step, writing
from ecm.workflow.app.state import state_of, way_out
from ecm.workflow.app.steps import DEMO_FILES, PLAN, Files, command_of, write_demo

_SCRIPT = """#!/bin/sh
# The steps of this session as commands. They write the same files, byte for byte:
#   sh script.sh NEW_FOLDER
set -e
from=$(cd "$(dirname "$0")" && pwd)
to=${1:?"give a new folder: sh script.sh NEW_FOLDER"}
[ -f "$from/steps.jsonl" ] || { echo "put this script into the session folder" >&2; exit 1; }
mkdir "$to"
"""


def script_of(contents: Contents) -> str:
    """Return the commands of the steps that count, as a shell script."""
    history = contents.journal.read()
    steps = [history.steps[number] for number in history.active]
    given = [name for step in steps if not step.argv for name in step.outputs]
    given += [name for name in DEMO_FILES if (contents.folder / name).is_file()]
    lines = [f'cp "$from"/{shlex.quote(name)} "$to"/' for name in dict.fromkeys(given)]
    lines.append('cd "$to"')
    lines += [shlex.join(["ecm", *step.argv]) for step in steps if step.argv]
    return _SCRIPT + "\n".join(lines) + "\n"


INCOMING = ".ecm-incoming-"
"""Begin of the name of a file that is on its way here."""
INTERRUPTED = "the server was stopped in the middle of it"


class Session(Contents):
    """A session folder that is worked on.

    Parameters
    ----------
    folder
        Made where it is not there.
    """

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
        history = self.journal.read()
        files = self.files(history)
        number = self._next_number(history)
        if verb in ("fit", "refit", "compare", "diagnose"):
            self._require_checked(history)
        command = command_of(verb, request, files, number)
        if verb == "example" and request["name"] == "neck":
            with writing(self.folder / PLAN):
                write_demo(self.folder)
        inputs: dict[str, Any] = {"data": files.data, "model": files.model}
        if verb in DATA:
            inputs["data_after"] = [*_kept(verb, request, files), command.outputs[0]]
        return self._begin(number, verb, request, command.argv, inputs, command.outputs)

    def way_out(self, error: EcmError) -> dict[str, Any] | None:
        """Return the way out of a request that was refused; None where it has none.

        As that of a refused step: with the request of the step that does it, where one does.
        """
        remedy = remedy_of(error)
        if remedy is None:
            return None
        files = self.files(self.journal.read())
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
        history = self.journal.read()
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
        files = self.files(history)
        data = files.data if suffix in LOGS else [*(files.data if more else []), target.name]
        dropped = [*(files.dropped if more else []), target.name]
        return self._add_upload(number, name, outputs, files.data, after=(data, dropped))

    def add_description(self, source: Path, name: str) -> Step:
        """Put a description (TOML) beside the last table, or the last log, of the session.

        A table of the simulated rig keeps its sealed truth.

        Raises
        ------
        InputError
            Where there is neither, or the description is no TOML.
        """
        history = self.journal.read()
        files = self.files(history)
        last = (files.dropped or files.data)[-1:] if not files.data else files.data[-1:]
        if not last:
            raise InputError(f"{name}: drop the table first, then its description")
        number = self._next_number(history)
        table = self.folder / last[0]
        target = self.folder / f"upload-{number}{table.suffix}"
        described = sealed_description(source, table, name)
        with writing(target, name):
            shutil.copyfile(table, target)
            extras = copy_beside(table, target, without=(".toml",))
            source.replace(target.with_suffix(".toml"))
            if described is not None:
                write_atomically(target.with_suffix(".toml"), described)
        outputs = [target.name, target.with_suffix(".toml").name, *extras]
        renamed = {last[0]: target.name}
        after = tuple([renamed.get(d, d) for d in of] for of in (files.data, files.dropped))
        return self._add_upload(number, name, outputs, files.data, after=after)

    def following(self, step: Step) -> tuple[str, dict[str, Any]] | None:
        """Return the import of the next log that was dropped with that of a step."""
        if step.verb != "import":
            return None
        logs = self.files(self.journal.read()).dropped
        at = logs.index(step.argv[1]) + 1
        return (
            None if at == len(logs) else ("import", {**step.request, "log": logs[at], "more": True})
        )

    def accept(self, warning: str) -> None:
        """Record that the person takes responsibility for a warning of the check."""
        history = self.journal.read()
        step = self.check_step(history, self.files(history))
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

    def state(self) -> dict[str, Any]:
        """Return all that the page shows; it depends on the files of the folder only."""
        return state_of(self)

    def script(self) -> str:
        """Return the commands of the steps that count, as a shell script."""
        return script_of(self)

    # --- parts -------------------------------------------------------------
    def _begin(
        self,
        number: int,
        verb: str,
        request: dict[str, Any],
        argv: Sequence[str],
        inputs: dict[str, Any],
        outputs: Sequence[str],
    ) -> Step:
        step = Step(
            number=number,
            verb=verb,
            request=request,
            argv=list(argv),
            inputs=inputs,
            outputs=list(outputs),
            begun_s=round(time.time(), 3),
        )
        record = {name: getattr(step, name) for name in ("number", "verb", "request", "argv")}
        record |= {"inputs": inputs, "outputs": step.outputs, "begun_s": step.begun_s}
        self.journal.append(event="begin", **record)
        return step

    def _add_upload(
        self,
        number: int,
        name: str,
        outputs: Sequence[str],
        before: Sequence[str],
        *,
        after: tuple[Sequence[str], ...],
    ) -> Step:
        """Record an upload; `after`: the tables that count then, and the files to import."""
        inputs = {"data": before, "data_after": list(after[0]), "dropped_after": list(after[1])}
        step = self._begin(number, "upload", {"name": name}, [], inputs, outputs)
        self.end(step.number, "done", "", 0.0)
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

    def _require_checked(self, history: History) -> None:
        check = self.check_step(history, self.files(history))
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


def _kept(verb: str, request: dict[str, Any], files: Files) -> list[str]:
    """Return the tables to which a step adds one; none where it replaces them."""
    return files.data if verb == "campaign" or (verb == "import" and request.get("more")) else []
