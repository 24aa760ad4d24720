"""The command line of a blind benchmark whose sets are a file each."""

from __future__ import annotations

import argparse
import json
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from blind import code_hash
from blind_parts.workers import run_all
from ecm.diagnosis import Diagnosis, diagnose
from ecm.errors import EcmError
from ecm.io.cache import write_atomically
from ecm.io.extras import own_cores
from ecm.io.table import Table
from ecm.models import Model


def parser_of(description: str, sets: int) -> argparse.ArgumentParser:
    """Options that all of them have."""
    parser = argparse.ArgumentParser(description=description.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--sets", type=int, default=sets)
    parser.add_argument("--seed", type=int, nargs="+", default=[1])
    parser.add_argument("--workers", type=int, default=own_cores(), help="default: all cores")
    parser.add_argument("--seconds", type=float, default=np.inf, help="begin no set after that")
    parser.add_argument("--code", help="go on with the sets of that hash of the code")
    return parser


def folder_of(given: argparse.Namespace) -> Path:
    """Where the results of this code are kept."""
    folder: Path = given.out / f"sets-{given.code or code_hash()}"
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def file_of(case: Any, folder: Path) -> Path:
    """Where the result of a set is kept."""
    return folder / f"{case.seed}-{case.index:04d}.json"


def run_sets(
    given: argparse.Namespace,
    cases: list[Any],
    answer: Callable[[Any, Path], dict[str, Any]],
    solve: Callable[[Path], Any],
) -> list[dict[str, Any]]:
    """Run the sets that have no file yet, and return what all files hold.

    Parameters
    ----------
    answer
        What the file of a set holds; called with the set and the folder of the bodies.
    solve
        Prepares the bodies in a folder, before several processes ask for them.
    """
    folder = folder_of(given)
    todo = [case for case in cases if not file_of(case, folder).exists()]
    if todo:
        solve(given.out)
    work = partial(_write_one, answer=answer, folder=folder)
    run_all(todo, work, workers=given.workers, seconds=given.seconds)
    files = [file_of(case, folder) for case in cases]
    return [json.loads(file.read_text()) for file in files if file.exists()]


def _write_one(case: Any, answer: Callable[[Any, Path], dict[str, Any]], folder: Path) -> None:
    """In whichever process."""
    write_atomically(file_of(case, folder), json.dumps(answer(case, folder.parent)))


def diagnosed(
    case: Any, table: Table, model: Callable[[], Model]
) -> tuple[dict[str, Any], Diagnosis | None]:
    """What the diagnosis says of a set, for its file; None where model or table is refused."""
    began, found = time.process_time(), None
    try:
        found = diagnose(model(), table)
        verdict, answer, said = found.verdict, [list(one) for one in found.answer], found.sentence()
    except EcmError as error:
        verdict, answer, said = "refused", [], str(error)
    result = {"set": case.to_dict(), "verdict": verdict, "answer": answer, "said": said}
    return result | {"seconds": time.process_time() - began}, found


def outcome_lines(
    groups: Mapping[str, Sequence[dict[str, Any]]], outcomes: Sequence[str]
) -> list[str]:
    """Markdown: how often each outcome is in the results of each group."""
    lines = ["| hidden | sets | " + " | ".join(outcomes) + " |", "|---" * (len(outcomes) + 2) + "|"]
    for what, own in groups.items():
        counts = Counter(r["outcome"] for r in own)
        shown = " | ".join(str(counts[key] or "") for key in outcomes)
        lines.append(f"| {what} | {len(own)} | {shown} |")
    return lines


def not_right_lines(
    results: Sequence[dict[str, Any]], words: Callable[[dict[str, Any]], str]
) -> list[str]:
    """Markdown: each set that is not right, by words of its own, and what was said."""
    return [
        f"- {r['set']['index']} {words(r)}: {r['verdict']} "
        + " + ".join("|".join(members) for members in r["answer"])
        for r in results
        if r["outcome"] != "right"
    ]


def write_table(given: argparse.Namespace, text: str, found: int, cases: int) -> None:
    """Print a table and keep it."""
    print(f"\nSets: {found} of {cases}, seeds {given.seed}.\n\n{text}")
    write_atomically(given.out / "table.md", text)
