"""CONFIG, one TOML file that describes an identification from mesh to report; and its job at work.

Each table is a frozen dataclass with its defaults; the plain default is the neck of the paper at
real size. The rig's four tables belong to `ecm.rig.settings`, the workspace to `ecm.fem.simulate`.

Each campaign of a job is kept among its stages under a hash of its plan, rig and seed, also an
interrupted one. Its table is copied beside the results, where it replaces only what the job has put
there: a table that was edited, or that is from a real rig, stays.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

from ecm._native import __version__
from ecm.errors import InputError
from ecm.fem.simulate import Workspace
from ecm.io.arguments import path_of
from ecm.io.arrays import F
from ecm.io.cache import Stage, file_sha256, hash_of, write_atomically
from ecm.io.mechanism import Mechanism
from ecm.io.settings import (
    ENERGY_DEGREES,
    POLYNOMIAL_DEGREES,
    Checked,
    check_keys,
    read_sections,
    read_toml,
    setting,
)
from ecm.io.table import Table, read_table
from ecm.report.blocks import Section, text_of
from ecm.rig import CampaignOptions, run_campaign
from ecm.rig.readings import BESIDE, clear_beside, robot_path
from ecm.rig.run import require_possible
from ecm.rig.settings import TABLES as RIG_TABLES
from ecm.rig.settings import RigSettings

_TESTED = 300


@dataclass(frozen=True)
class SimulateTable(Checked):
    """[simulate]: step 1, wrench-pose pairs by FEM."""

    n: int = setting(1700, low=2)
    """Pairs to keep, test pairs included."""
    n_test: int = setting(0, low=0)
    """Pairs of these that are only for testing; 0: 300, or 20 % of fewer pairs."""

    def _check_together(self) -> None:
        if self.n_test == 0:
            object.__setattr__(self, "n_test", min(_TESTED, max(1, self.n // 5)))
        if self.n_test >= self.n:
            raise InputError(f"n_test = {self.n_test}: expected above 0 and below n = {self.n}")


@dataclass(frozen=True)
class SelectTable(Checked):
    """[select]: step 2, which model."""

    degrees: tuple[int, ...] = setting(
        (1, 2, 3), low=POLYNOMIAL_DEGREES[0], high=POLYNOMIAL_DEGREES[1], any_size=True
    )
    """Polynomials of Table II."""
    thresholds: tuple[float, ...] = setting((0.0, 0.1, 0.5), low=0.0, any_size=True)
    """PCR drops singular values of the normalised regressor below these."""
    energy_degrees: tuple[int, ...] = setting(
        (4, 6), low=ENERGY_DEGREES[0] - 1, high=ENERGY_DEGREES[1], any_size=True
    )
    """Symmetric energy models; 3 where there are actuators."""
    energy_poses: tuple[int, ...] = setting((20, 50, 200), low=5, any_size=True)
    """Numbers of poses that they are trained on."""

    def _check_together(self) -> None:
        for name in ("degrees", "thresholds"):
            if not getattr(self, name):
                raise InputError(f"{name} = []: expected at least one entry")
        if list(self.degrees) != sorted(set(self.degrees)):
            raise InputError(f"degrees = {list(self.degrees)}: expected increasing numbers")


@dataclass(frozen=True)
class DesignTable(Checked):
    """[design]: step 2, which poses are worth measuring."""

    n: int = setting(200, low=1)
    """Poses in each design."""
    starts: int = setting(10, low=1)
    """Random starts of the exchange; the best is kept."""


_TABLES: dict[str, Any] = {
    "workspace": Workspace,
    "simulate": SimulateTable,
    "select": SelectTable,
    "design": DesignTable,
}
"""Settings by table; [mechanism] and those of the rig are read by their own."""


@dataclass(frozen=True)
class Config:
    """The tables of a CONFIG file; the default is the neck at the paper's size.

    Examples
    --------
    >>> from ecm.workflow.config import Config, DesignTable
    >>> Config(design=DesignTable(n=60)).mechanism.length_m
    0.1034
    """

    mechanism: Mechanism = field(default_factory=Mechanism)
    workspace: Workspace = field(default_factory=Workspace)
    simulate: SimulateTable = field(default_factory=SimulateTable)
    select: SelectTable = field(default_factory=SelectTable)
    design: DesignTable = field(default_factory=DesignTable)
    rig: RigSettings = field(default_factory=RigSettings)
    """The tables [rig] [instrument] [plant] [hidden]."""
    source: str = ""
    """File it was read from, for messages."""

    def check_job(self) -> None:
        """Raise InputError where the tables do not fit each other for the main job."""
        pairs = self.simulate.n - self.simulate.n_test
        where = f"{self.source}: " if self.source else ""
        if self.design.n > pairs:
            raise InputError(
                f"{where}[design] n = {self.design.n}: expected at most the {pairs} training "
                "pairs of [simulate] (n - n_test)"
            )
        lowest = min(self.select.energy_degrees, default=ENERGY_DEGREES[0])
        if lowest < ENERGY_DEGREES[0] and not self.mechanism.actuators:
            raise InputError(
                f"{where}[select] energy_degrees holds {lowest}: expected {ENERGY_DEGREES[0]} to "
                f"{ENERGY_DEGREES[1]}; degree {lowest} is for mechanisms with actuators"
            )
        degree = max(self.select.degrees)
        inputs = 6 + len(self.mechanism.actuators)
        needed = math.comb(degree + inputs, inputs)
        for name, count in (("[simulate] n - n_test", pairs), ("[design] n", self.design.n)):
            if count < needed:
                raise InputError(
                    f"{where}{name} = {count}: expected at least {needed}, the "
                    f"coefficients of [select] degrees {degree} in {inputs} inputs"
                )


def config_from_dict(
    document: Mapping[str, Any], where: str = "CONFIG", *, base: Path | None = None
) -> Config:
    """Make a Config of a parsed CONFIG.

    Parameters
    ----------
    document
        The tables of the file.
    where
        Name of the file for messages.
    base
        Directory of a relative mesh file.

    Raises
    ------
    InputError
        Naming file, table, key and the nearest known key.
    """
    check_keys(document, ("mechanism", *_TABLES, *RIG_TABLES), where)
    mechanism = Mechanism()
    if "mechanism" in document:
        mechanism = Mechanism.from_dict(document["mechanism"], f"{where} [mechanism]", base=base)
        if not mechanism.has_body:
            raise InputError(
                f'{where} [mechanism]: expected a body for FEM: builtin = "cylinder" (or mesh = '
                '"file.msh") with young_modulus_Pa'
            )
    return Config(
        mechanism=mechanism,
        **read_sections(_TABLES, document, where),
        rig=RigSettings.from_dict({k: document[k] for k in RIG_TABLES if k in document}, where),
        source=where,
    )


def read_config(path: str | Path) -> Config:
    """Read a CONFIG file."""
    file = path_of(path)
    return config_from_dict(read_toml(file, "configuration"), str(file), base=file.parent)


def read_rig(path: str | Path) -> RigSettings:
    """Read a RIG.toml: the tables [rig] [instrument] [plant] [hidden] of a CONFIG."""
    file = path_of(path)
    return RigSettings.from_dict(read_toml(file, "rig file"), str(file))


def with_rig(config: Config, path: str | Path) -> Config:
    """Return the job on the rig of another file; [hidden] stays where that file has none."""
    file = path_of(path)
    document = read_toml(file, "rig file")
    rig = RigSettings.from_dict(document, str(file))
    if "hidden" not in document:
        rig = replace(rig, hidden=config.rig.hidden)
    return replace(config, rig=rig)


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
    sections: list[Section] = field(default_factory=list)
    """What the report says, in the order of the work."""

    @property
    def of_paper(self) -> bool:
        """Whether the body is the neck of the paper, whose numbers then stand beside ours."""
        return self.config.mechanism == Mechanism()

    @property
    def stages(self) -> Path:
        """Folder of what is kept between runs."""
        return self.out / "stages"

    def show(self, section: Section) -> None:
        """Print what a section of the report says, and keep it for the page."""
        self.sections.append(section)
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
