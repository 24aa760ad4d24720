"""What the steps of the main job share: settings, stages on disk, measured tables, numbers.

A job replaces only what it has measured itself, as the checksums in its stages say: a table that
was edited, or that is from a real rig, stays. `NAME.begun.json` says on which rig a campaign began.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

from ecm._native import __version__
from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.cache import Stage, file_sha256, hash_of, write_json
from ecm.io.table import Table, read_table
from ecm.report.blocks import Section, text_of
from ecm.rig import CampaignOptions, RigSettings, run_campaign
from ecm.rig.arm.run import robot_path
from ecm.rig.readings import journal_path
from ecm.rig.run import require_possible
from ecm.workflow.config import Config


class Console(Protocol):
    """What a job needs of its caller; the command line draws progress bars."""

    def print(self, text: str = "") -> None:
        """Print a line for the reader."""

    def progress(self, title: str) -> Callable[..., None] | None:
        """Return a callback (done, total[, phase]) for the work that comes next, or None."""


class Silent:
    """A console that prints nothing."""

    def print(self, text: str = "") -> None:
        """Drop the line."""

    def progress(self, title: str) -> Callable[..., None] | None:
        """Return None: nobody follows the progress."""
        return None


@dataclass
class Job:
    """A run of the main job."""

    config: Config
    out: Path
    """Folder of the results."""
    seed: int = 0
    threads: int = 0
    console: Console = field(default_factory=Silent)
    summary: dict[str, Any] = field(default_factory=dict)
    """Numbers for `summary.json`, one entry a step."""
    figures: dict[str, F] = field(default_factory=dict)
    """Arrays for the figures of the report."""
    stages_s: dict[str, float] = field(default_factory=dict)
    """Seconds of each step."""

    def show(self, section: Section) -> None:
        """Print what a section of the report says."""
        self.console.print(text_of(section.blocks) + "\n")

    def stage(self, name: str, *inputs: Any) -> Stage:
        """Return the stage of a step; its key holds seed, version and inputs."""
        return Stage(self.out / "stages", name, {"seed": self.seed, "version": __version__}, inputs)

    @contextmanager
    def step(self, name: str, title: str) -> Iterator[None]:
        """Print the title of a step and measure its time."""
        self.console.print(title)
        start = time.perf_counter()
        yield
        self.stages_s[name] = round(time.perf_counter() - start, 3)

    def measure(self, plan: Table, name: str, rig: RigSettings) -> Table:
        """Run a campaign of the job; one that is finished is read again."""
        return campaign_table(
            self.out / f"{name}.csv",
            self.stage(name, hash_of(dict(plan.columns)), rig.to_dict()),
            plan,
            rig,
            seed=self.seed,
            threads=self.threads,
            progress=self.console.progress(name),
        )


def require_free(
    out: Path, stages: Path, names: tuple[str, ...], rig: RigSettings, seed: int
) -> None:
    """Raise InputError before the work where campaigns could not run, or would replace data.

    Parameters
    ----------
    out
        Folder of the tables.
    stages
        Folder of the job's stages.
    names
        Names of the tables without a suffix.
    rig
        Settings of the rig that will measure them.
    seed
        Seed of the job.
    """
    for name in names:
        path = out / f"{name}.csv"
        require_possible(rig, path, overwrite=True)
        _require_own(path, stages)
        _require_same_rig(path, stages, rig, seed)


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
    """Run a campaign on the simulated rig; one that is finished is read again.

    Parameters
    ----------
    path
        File of the table.
    stage
        Stage of this plan, rig and seed, with the name of the table.
    plan
        The visits.
    rig
        Settings of the rig.
    seed
        Seed of the campaign.
    threads
        0: all cores.
    progress
        Called with visits done, their number, and a phase.

    Raises
    ------
    InputError
        There is another table at `path`, or half a campaign on another rig.
    """
    if not _finished(path, stage, rig):
        _require_own(path, stage.directory)
        _require_same_rig(path, stage.directory, rig, seed)
        if not journal_path(path).exists():  # else it says on which rig that campaign began
            write_json(_begun_path(path, stage.directory), {"rig": _identity(rig, seed)})
        run_campaign(
            plan,
            rig,
            path,
            seed=seed,
            progress=progress,
            overwrite=True,  # the job's own
            options=CampaignOptions(threads=threads, folder=stage.directory / "anchors"),
        )
        stage.save({"data": path.name, "sum": file_sha256(path), "rig": _identity(rig, seed)})
    return read_table(path)


def _finished(path: Path, stage: Stage, rig: RigSettings) -> bool:
    """Whether all files are there; another rig may have replaced the table since: check its sum."""
    complete = path.exists() and (rig.rig.mode != "robot" or robot_path(path).exists())
    return complete and stage.done() and stage.load().get("sum") == file_sha256(path)


def _require_own(path: Path, stages: Path) -> None:
    if path.exists() and not _records(path, stages):
        raise InputError(
            f"{path}: this table is not the one that the job measured there, and measurements are "
            "not overwritten. Move it away, or choose another --out"
        )


def _records(path: Path, stages: Path) -> list[dict[str, Any]]:
    """Records of all stages, under any settings, that have measured this very table."""
    total, records = file_sha256(path), []
    for file in stages.glob(f"{path.stem}-*.json"):
        with suppress(OSError, ValueError, KeyError, TypeError):
            record: dict[str, Any] = json.loads(file.read_bytes())["result"]
            if record["sum"] == total:
                records.append(record)
    return records


def _require_same_rig(path: Path, stages: Path, rig: RigSettings, seed: int) -> None:
    journal, identity = journal_path(path), _identity(rig, seed)
    if not journal.exists():
        return
    if path.exists() and any(r.get("rig") == identity for r in _records(path, stages)):
        return  # on this rig it is finished
    begun: dict[str, Any] = {}
    with suppress(OSError, ValueError):
        begun = json.loads(_begun_path(path, stages).read_bytes())
    if begun and begun.get("rig") != identity:
        raise InputError(
            f"{journal}: a campaign that was interrupted, on another rig or with another seed. "
            "Finish it with those, remove the journal to measure again from the beginning, or "
            "choose another --out"
        )


def _begun_path(path: Path, stages: Path) -> Path:
    return stages / f"{path.stem}.begun.json"


def _identity(rig: RigSettings, seed: int) -> str:
    """Hash of rig and seed; rehearsed faults and processes may change during an interruption."""
    return hash_of(replace(rig, arm=replace(rig.arm, fault="", processes=0)).to_dict(), seed)
