"""The measured tables of a job: whose they are, and which of them may be measured again.

A job replaces only what it has measured itself, as the sums in its stages tell: a table that was
edited, or put there from a real rig, stays. `NAME.begun.json` says on which rig a campaign began.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from ecm.errors import InputError
from ecm.io.cache import Stage, file_sha256, hash_of, write_json
from ecm.io.table import Table, read_table
from ecm.rig import RigSettings, run_campaign
from ecm.rig.journal import journal_path
from ecm.rig.run import require_possible


def require_free(
    out: Path, stages: Path, names: tuple[str, ...], rig: RigSettings, seed: int
) -> None:
    """Before the work: InputError where its campaigns could not be run, or would cost data.

    Parameters
    ----------
    out
        Folder of the tables.
    stages
        Folder of the job's stages.
    names
        Of all tables, without a suffix.
    """
    for name in names:
        path = out / f"{name}.csv"
        require_possible(rig, path, overwrite=True)
        _need_own(path, stages)
        _need_same_rig(path, stages, rig, seed)


def campaign_table(
    path: Path,
    stage: Stage,
    plan: Table,
    rig: RigSettings,
    *,
    seed: int,
    threads: int = 0,
    progress: Callable[..., None] | None = None,
) -> Table:
    """A campaign on the simulated rig; one that is finished is read again.

    Its table may have been replaced by another rig's since then: the sum tells.

    Parameters
    ----------
    path
        Where the table lies.
    stage
        Of this plan, rig and seed, of the table's name.

    Raises
    ------
    InputError
        Another's table stands at `path`, or half a campaign on another rig.
    """
    if not _finished(path, stage, rig):
        _need_own(path, stage.directory)
        _need_same_rig(path, stage.directory, rig, seed)
        if not journal_path(path).exists():  # else it says whose that is
            write_json(_begun_path(path, stage.directory), {"rig": _identity(rig, seed)})
        run_campaign(
            plan,
            rig,
            path,
            seed=seed,
            threads=threads,
            progress=progress,
            folder=stage.directory / "anchors",
            overwrite=True,  # the job's own
        )
        stage.save({"data": path.name, "sum": file_sha256(path), "rig": _identity(rig, seed)})
    return read_table(path)


def _finished(path: Path, stage: Stage, rig: RigSettings) -> bool:
    whole = path.exists()
    if rig.rig.mode == "robot":
        from ecm.rig.arm.run import robot_path

        whole = whole and robot_path(path).exists()
    return whole and stage.done() and stage.load().get("sum") == file_sha256(path)


def _need_own(path: Path, stages: Path) -> None:
    if path.exists() and not _records(path, stages):
        raise InputError(
            f"{path}: this table is not the one that the job measured there, and measurements are "
            "not overwritten. Move it away, or choose another --out"
        )


def _records(path: Path, stages: Path) -> list[dict[str, Any]]:
    """Of the stages, under whatever settings, that have measured the table that stands there."""
    total, found = file_sha256(path), []
    for file in stages.glob(f"{path.stem}-*.json"):
        with suppress(OSError, ValueError, KeyError, TypeError):
            record: dict[str, Any] = json.loads(file.read_bytes())["result"]
            if record["sum"] == total:
                found.append(record)
    return found


def _need_same_rig(path: Path, stages: Path, rig: RigSettings, seed: int) -> None:
    journal, asked = journal_path(path), _identity(rig, seed)
    if not journal.exists():
        return
    if path.exists() and any(record.get("rig") == asked for record in _records(path, stages)):
        return  # on this rig it is finished
    begun: dict[str, Any] = {}
    with suppress(OSError, ValueError):
        begun = json.loads(_begun_path(path, stages).read_bytes())
    if begun and begun.get("rig") != asked:
        raise InputError(
            f"{journal}: a campaign that was interrupted, on another rig or with another seed. "
            "Finish it with those, remove the journal to measure anew, or choose another --out"
        )


def _begun_path(path: Path, stages: Path) -> Path:
    return stages / f"{path.stem}.begun.json"


def _identity(rig: RigSettings, seed: int) -> str:
    """Faults to rehearse and processes may change while a campaign is interrupted."""
    return hash_of(replace(rig, arm=replace(rig.arm, fault="", processes=0)).to_dict(), seed)
