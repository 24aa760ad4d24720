"""CONFIG: one TOML file that describes an identification, from mesh to report.

Each table is a frozen dataclass with its defaults; the plain default is the neck of the paper at
real size. The rig's four tables belong to `ecm.rig.settings`, the workspace to `ecm.fem.simulate`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from ecm.errors import InputError
from ecm.fem.simulate import Workspace
from ecm.io.mechanism import Mechanism
from ecm.io.settings import ENERGY_DEGREES, POLYNOMIAL_DEGREES, Checked, read_settings, setting
from ecm.io.toml import check_keys, read_toml
from ecm.rig.settings import TABLES as RIG_TABLES
from ecm.rig.settings import RigSettings

TABLES = ("mechanism", "workspace", "simulate", "select", "design", *RIG_TABLES)


@dataclass(frozen=True)
class SimulateTable(Checked):
    """[simulate]: step 1, wrench-pose pairs by FEM."""

    n: int = setting(1700, low=2)
    """Pairs to keep, test pairs included."""
    n_test: int = setting(300, low=1)
    """Pairs of these that are only for testing."""

    def __post_init__(self) -> None:
        super().__post_init__()
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

    def __post_init__(self) -> None:
        super().__post_init__()
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
    check_keys(document, TABLES, where)
    mechanism = Mechanism()
    if "mechanism" in document:
        mechanism = Mechanism.from_dict(document["mechanism"], f"{where} [mechanism]", base=base)
        if not mechanism.has_body:
            raise InputError(
                f'{where} [mechanism]: expected a body for FEM: builtin = "cylinder" (or mesh = '
                '"file.msh") with young_modulus_Pa'
            )

    tables: dict[str, Any] = {
        "workspace": Workspace,
        "simulate": SimulateTable,
        "select": SelectTable,
        "design": DesignTable,
    }
    return Config(
        mechanism=mechanism,
        **{
            name: read_settings(table, document.get(name, {}), f"{where} [{name}]")
            for name, table in tables.items()
        },
        rig=RigSettings.from_dict({k: document[k] for k in RIG_TABLES if k in document}, where),
        source=where,
    )


def read_config(path: str | Path) -> Config:
    """Read a CONFIG file."""
    file = Path(path)
    return config_from_dict(read_toml(file, "configuration"), str(file), base=file.parent)


def read_rig(path: str | Path) -> RigSettings:
    """Read a RIG.toml: the tables [rig] [instrument] [plant] [hidden] of a CONFIG."""
    file = Path(path)
    return RigSettings.from_dict(read_toml(file, "rig file"), str(file))


def with_rig(config: Config, path: str | Path) -> Config:
    """Return the job on the rig of another file; [hidden] stays where that file has none."""
    file = Path(path)
    document = read_toml(file, "rig file")
    rig = RigSettings.from_dict(document, str(file))
    if "hidden" not in document:
        rig = replace(rig, hidden=config.rig.hidden)
    return replace(config, rig=rig)
