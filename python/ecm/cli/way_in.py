"""Files that are no table: a log to import, a model in the place of the table."""

from __future__ import annotations

import json
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ecm.cli import command
from ecm.errors import EcmError, InputError, Remedy
from ecm.io.table import Table

_UNITS = (["SI"], ["mm", "deg", "N", "N m"])
_TRIED: tuple[dict[str, Any], ...] = (
    {},
    {"axis": "x"},
    *({"units": units} for units in _UNITS),
    *({"axis": "x", "units": units} for units in _UNITS),
)
"""What a log may leave open, by the options of `ecm import` that say it."""


def refuse_models(paths: Sequence[Path]) -> None:
    """Raise InputError where a model is given in place of a table, with the right order."""
    for path in filter(_is_model, paths):
        verb, *others = command.typed
        others.pop([Path(word) for word in others].index(path))
        first = [] if verb == "fit" else [str(path)]
        remedy = Remedy(
            "give only tables" if verb == "fit" else "give the model first",
            shlex.join(["ecm", verb, *first, *others]),
        )
        raise InputError(f"{path} is a model, expected a table of measurements", remedy=remedy)


def way_in(paths: Sequence[Path]) -> Remedy | None:
    """Return what to type for files that cannot be read as a table; None where nothing is known.

    Parameters
    ----------
    paths
        The files that were given as tables.
    """
    if len(paths) != 1:
        return None
    from ecm.logs.importing import import_log, read_log  # noqa: PLC0415 - a sixth of the start

    (path,) = paths
    try:
        log = read_log(path, ())
    except (EcmError, OSError, ValueError):
        return None
    for options in _TRIED:
        try:
            table = import_log(log, **options).table
        except (EcmError, OSError, ValueError):
            continue
        if table.pose_columns and table.wrench_columns:
            return _import_of(path, options, table)
    return None


def _is_model(path: Path) -> bool:
    """Whether a file is a fitted model."""
    if path.suffix != ".json":
        return False
    try:
        document = json.loads(path.read_bytes())
    except (OSError, ValueError):
        return False
    return isinstance(document, dict) and "training" in document


def _import_of(path: Path, options: dict[str, Any], table: Table) -> Remedy:
    """The command that makes a table of a log."""
    words, more = ["import it, since it is a log of another program"], []
    if "axis" in options:
        axis = "z" if all(name.endswith("_rad") for name in table.pose_columns) else "x"
        more += ["--axis", axis]
        words.append(f"its axis is taken as {axis} (x is along the mechanism, y and z across it)")
    if "units" in options:
        more += ["--units", ",".join(options["units"])]
        words.append(f"its numbers without a unit are taken as {', '.join(options['units'])}")
    out = path.with_name(f"{path.stem}-table.csv")
    return Remedy(
        "; ".join(words), shlex.join(["ecm", "import", str(path), *more, "--out", str(out)])
    )
