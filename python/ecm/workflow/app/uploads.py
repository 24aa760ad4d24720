"""Files that a person brings in: which are taken, and what belongs to a table."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

from ecm.errors import InputError
from ecm.io.toml import read_toml, write_toml

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
