"""What the steps of the main job share: settings, stages on disk, numbers and figures."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ecm._native import __version__
from ecm.io.arrays import F
from ecm.io.cache import Stage, hash_of
from ecm.io.table import Table
from ecm.rig import RigSettings
from ecm.workflow.campaign_files import campaign_table
from ecm.workflow.config import Config
from ecm.workflow.console import Console, Silent


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
