"""What is in a session folder, and the files that a person brings in.

steps.jsonl     the journal
upload-N.csv    a table that was dropped; its own name is in the journal only
model-N.json, fit-N.json, compare-N.html …   what step N wrote
logs/           what the commands printed
views/          what the page draws, computed from the files above; may be deleted
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ecm.errors import InputError
from ecm.io.toml import read_toml, write_toml
from ecm.workflow.app.journal import DATA, History, Journal, Step
from ecm.workflow.app.steps import RIG, Files

TABLES = (".csv", ".parquet")
LOGS = (".txt", ".tsv", ".dat", ".log", ".mat", ".h5", ".hdf5", ".npz", ".mcap", ".db3")
"""Suffixes of files that `ecm import` makes a table of."""
TRUTH = ".truth.json"
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


class Contents:
    """The files of a session folder, as its journal explains them.

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

    def files(self, history: History) -> Files:
        """Return the files that count now."""
        changed = history.last(*DATA)
        data = [] if changed is None else list(changed.inputs["data_after"])
        dropped = history.last("upload")
        logs = [] if dropped is None else dropped.inputs.get("dropped_after", dropped.outputs[:1])
        model = history.last("fit", "refit", data=data)
        of_model = {"data": data, "model": None if model is None else model_of(model)}
        found = history.last("diagnose", **of_model)
        checked = history.last("check", data=data)
        answered = history.last("diagnose", data=data)
        written = [] if found is None else found.outputs
        plan = next((name for name in written if name.endswith(".csv")), None)
        sealed = next((d for d in data if self._beside(d, TRUTH).is_file()), None)
        return Files(
            data=data,
            model=None if model is None else model_of(model),
            answer=None if answered is None else answered.outputs[0],
            next_plan=plan if plan and (self.folder / plan).is_file() else None,
            dropped=logs,
            described=frozenset(d for d in logs if self._beside(d, ".toml").is_file()),
            sealed=sealed,
            simulated=sealed is not None and (self.folder / RIG).is_file(),
            skip_bad_rows=checked is not None and bool(checked.request.get("skip_bad_rows")),
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
        try:
            return (self.folder / "logs" / f"{number}.{kind}").read_bytes()
        except OSError:
            return b""

    def check_step(self, history: History, files: Files) -> Step | None:
        return history.last("check", data=files.data)

    def pending(self, history: History, check: Step) -> list[str]:
        document = self.result(check) or {}
        taken = {warning for number, warning in history.accepted if number == check.number}
        return [text for text in document.get("warnings", []) if text not in taken]

    def result(self, step: Step | None) -> Any:
        """Return the JSON document of a step, with its number."""
        if step is None:
            return None
        document = self._report(step)
        return None if document is None else {**document, "step": step.number}

    def refusal(self, step: Step) -> tuple[str, dict[str, Any] | None] | None:
        """Return why a command refused, and its way out; None where it died without a word."""
        error = (self._report(step) or {}).get("error")
        return None if error is None else (error["message"], error["remedy"])

    def _report(self, step: Step) -> Any:
        name = next((n for n in step.outputs if _is_report(n)), None)
        try:
            return json.loads((self.folder / str(name)).read_bytes())
        except (OSError, ValueError):
            return None

    def opened(self, history: History, files: Files) -> Step | None:
        """Return the last step that opened the truth of these tables; undo does not close it."""
        sealed = {self._truth(name) for name in files.data} - {None}
        for step in reversed(history.steps.values()):
            opened = step.verb == "reveal" and step.status == "done"
            if opened and self._truth(step.argv[1]) in sealed:
                return step
        return None

    def _truth(self, table: str) -> bytes | None:
        path = self._beside(table, TRUTH)
        return path.read_bytes() if path.is_file() else None

    def _beside(self, table: str, suffix: str) -> Path:
        return (self.folder / table).with_suffix(suffix)


def model_of(step: Step) -> str:
    return step.outputs[0]


def _is_report(name: str) -> bool:
    return name.endswith(".json") and not name.startswith("model-")
