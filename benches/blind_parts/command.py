"""The command line of a blind benchmark whose sets are a file each."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from blind import code_hash
from blind_parts.workers import run_all
from ecm.io.cache import write_atomically
from ecm.io.extras import own_cores


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


def run_sets(
    given: argparse.Namespace,
    cases: list[Any],
    run_one: Callable[..., Any],
    file_of: Callable[[Any, Path], Path],
    solve: Callable[[Path], Any],
) -> list[dict[str, Any]]:
    """Run the sets that have no file yet, and return what all files hold.

    Parameters
    ----------
    run_one
        Called with a case and `folder`; writes its file.
    solve
        Prepares the bodies in a folder, before several processes ask for them.
    """
    folder = folder_of(given)
    todo = [case for case in cases if not file_of(case, folder).exists()]
    if todo:
        solve(given.out)
    run_all(todo, partial(run_one, folder=folder), workers=given.workers, seconds=given.seconds)
    files = [file_of(case, folder) for case in cases]
    return [json.loads(file.read_text()) for file in files if file.exists()]


def write_table(given: argparse.Namespace, text: str, found: int, cases: int) -> None:
    """Print a table and keep it."""
    print(f"\nSets: {found} of {cases}, seeds {given.seed}.\n\n{text}")
    write_atomically(given.out / "table.md", text)
