"""What the steps of the main job share: settings, stages on disk, measured tables, numbers.

Each campaign is kept among the stages under a hash of its plan, rig and seed, also an interrupted
one. Its table is copied beside the results, where it replaces only what the job has put there: a
table that was edited, or that is from a real rig, stays.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

from ecm._native import __version__
from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.cache import Stage, file_sha256, hash_of, write_atomically
from ecm.io.mechanism import Mechanism
from ecm.io.table import Table, read_table
from ecm.report.blocks import Section, text_of
from ecm.rig import CampaignOptions, RigSettings, run_campaign
from ecm.rig.readings import BESIDE, clear_beside, robot_path
from ecm.rig.run import require_possible
from ecm.workflow.config import Config


class Console(Protocol):
    """What a job needs of its caller, as the command line has it."""

    def print(self, text: str = "") -> None:
        """Print a line for the reader."""

    def progress(self, title: str) -> Callable[..., None] | None:
        """Return a callback (done, total[, phase]) for the work that comes next, or None."""
        return None


class Silent(Console):
    """A console that prints nothing."""

    def print(self, text: str = "") -> None:
        """Drop the line."""


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

    @property
    def of_paper(self) -> bool:
        """Whether the body is the neck of the paper, whose numbers then stand beside ours."""
        return self.config.mechanism == Mechanism()

    @property
    def stages(self) -> Path:
        """Folder of what is kept between runs."""
        return self.out / "stages"

    def show(self, section: Section) -> None:
        """Print what a section of the report says."""
        self.console.print(text_of(section.blocks) + "\n")

    def stage(self, name: str, *inputs: Any) -> Stage:
        """Return the stage of a step; its key holds seed, version and inputs."""
        return Stage(self.stages, name, {"seed": self.seed, "version": __version__}, inputs)

    @contextmanager
    def step(self, name: str, title: str) -> Iterator[None]:
        """Print the title of a step and measure its time."""
        self.console.print(title)
        start = time.perf_counter()
        yield
        self.stages_s[name] = round(time.perf_counter() - start, 3)

    def measure(self, plan: Table, name: str, rig: RigSettings) -> Table:
        """Measure a plan on the simulated rig, as `NAME.csv`; a finished campaign is read again.

        Raises
        ------
        InputError
            There is a table that the job has not measured.
        """
        # Processes may change while a campaign is interrupted.
        same = replace(rig, arm=replace(rig.arm, processes=0))
        key = hash_of(dict(plan.columns), same.to_dict(), self.seed, __version__)
        kept = self.stages / f"{name}-{key[:16]}.csv"
        self.require_possible(name, rig)
        if not kept.exists() or (rig.rig.mode == "robot" and not robot_path(kept).exists()):
            run_campaign(
                plan,
                rig,
                kept,
                seed=self.seed,
                progress=self.console.progress(name),
                overwrite=True,  # one that lacks its record
                options=CampaignOptions(threads=self.threads, folder=self.stages / "anchors"),
            )
        return self._copied(kept, name)

    def require_possible(self, name: str, rig: RigSettings) -> None:
        """Raise InputError where a campaign could not run, or would replace another table."""
        path = self.out / f"{name}.csv"
        require_possible(rig, path, overwrite=True)
        if path.exists() and not self._measured(path):
            raise InputError(
                f"{path}: this table is not the one that the job measured there, and "
                "measurements are not overwritten. Move it away, or choose another --out"
            )

    def _measured(self, path: Path) -> bool:
        """Whether a table is of this folder's campaigns, by its bytes."""
        content = path.read_bytes()
        if any(f.read_bytes() == content for f in self.stages.glob(f"{path.stem}-*.csv")):
            return True
        # Earlier versions kept the sum of the table alone.
        total = file_sha256(path)
        return any(total in f.read_text() for f in self.stages.glob(f"{path.stem}-*.json"))

    def _copied(self, kept: Path, name: str) -> Table:
        """Return the table of a campaign, copied with what belongs to it beside the results."""
        path = self.out / f"{name}.csv"
        beside = [suffix for suffix in BESIDE if kept.with_suffix(suffix).exists()]
        clear_beside(path, beside)
        files = {suffix: kept.with_suffix(suffix).read_bytes() for suffix in (*beside, ".csv")}
        files[".toml"] = read_table(kept).meta.beside(path).to_toml().encode()
        for suffix, content in files.items():
            target = path.with_suffix(suffix)
            if not target.exists() or target.read_bytes() != content:
                write_atomically(target, content)
        return read_table(path)
