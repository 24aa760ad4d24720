"""CONFIG: one TOML file that describes a whole identification, from mesh to report.

Each table is a frozen dataclass with its defaults; the plain default is the neck of the paper at
real size. The rig's four tables belong to `ecm.rig.settings`, the workspace to `ecm.simulate`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from ecm.errors import InputError
from ecm.mechanism import Mechanism
from ecm.rig.settings import TABLES as RIG_TABLES
from ecm.rig.settings import RigSettings
from ecm.settings import read_settings
from ecm.simulate import Workspace
from ecm.toml_file import check_keys, read_toml

TABLES = ("mechanism", "workspace", "simulate", "select", "design", *RIG_TABLES)


@dataclass(frozen=True)
class SimulateSettings:
    """[simulate]: step 1, wrench-pose pairs by FEM."""

    n: int = 1700
    """Pairs to keep, test pairs included."""
    n_test: int = 300
    """Of these, pairs that are only for testing."""

    def __post_init__(self) -> None:
        if self.n < 2:
            raise InputError(f"n = {self.n}: expected at least 2 pairs")
        if not 0 < self.n_test < self.n:
            raise InputError(f"n_test = {self.n_test}: expected above 0 and below n = {self.n}")


@dataclass(frozen=True)
class SelectSettings:
    """[select]: step 2, which model."""

    degrees: tuple[int, ...] = (1, 2, 3)
    """Polynomials of Table II."""
    thresholds: tuple[float, ...] = (0.0, 0.1, 0.5)
    """PCR drops singular values of the normalised regressor below these."""
    energy_degrees: tuple[int, ...] = (4, 6)
    """Symmetric energy models that are shown below the polynomials."""
    energy_poses: tuple[int, ...] = (20, 50, 200)
    """Numbers of poses that they are trained on."""

    def __post_init__(self) -> None:
        for name in ("degrees", "thresholds"):
            if not getattr(self, name):
                raise InputError(f"{name} = []: expected at least one entry")
        for degree in self.degrees:
            if not 1 <= degree <= 5:
                raise InputError(f"degrees holds {degree}: expected 1 to 5")
        if list(self.degrees) != sorted(set(self.degrees)):
            raise InputError(f"degrees = {list(self.degrees)}: expected growing numbers")
        for threshold in self.thresholds:
            if threshold < 0.0:
                raise InputError(f"thresholds holds {threshold}: expected at least 0")
        for degree in self.energy_degrees:
            if degree not in (4, 5, 6):
                raise InputError(f"energy_degrees holds {degree}: expected 4, 5 or 6")
        for count in self.energy_poses:
            if count < 5:
                raise InputError(f"energy_poses holds {count}: expected at least 5")


@dataclass(frozen=True)
class DesignSettings:
    """[design]: step 2, which poses are worth measuring."""

    n: int = 200
    """Poses in each design."""
    starts: int = 10
    """Random starts of the exchange; the best is kept."""

    def __post_init__(self) -> None:
        if self.n < 1:
            raise InputError(f"n = {self.n}: expected at least 1 pose")
        if self.starts < 1:
            raise InputError(f"starts = {self.starts}: expected at least 1")


@dataclass(frozen=True)
class Config:
    """A whole CONFIG file; the default is the neck at the paper's size."""

    mechanism: Mechanism = field(default_factory=Mechanism)
    workspace: Workspace = field(default_factory=Workspace)
    simulate: SimulateSettings = field(default_factory=SimulateSettings)
    select: SelectSettings = field(default_factory=SelectSettings)
    design: DesignSettings = field(default_factory=DesignSettings)
    rig: RigSettings = field(default_factory=RigSettings)
    """The tables [rig] [instrument] [plant] [hidden]."""
    source: str = ""
    """File it was read from, for messages."""

    def check_job(self) -> None:
        """InputError where the tables of the whole job do not fit each other."""
        pairs = self.simulate.n - self.simulate.n_test
        if self.design.n > pairs:
            raise InputError(
                f"{self._where}[design] n = {self.design.n}: expected at most the {pairs} training "
                "pairs of [simulate] (n - n_test)"
            )
        degree = max(self.select.degrees)
        needed = math.comb(degree + 6, 6)
        if pairs < needed:
            raise InputError(
                f"{self._where}[simulate] n - n_test = {pairs}: expected at least {needed}, the "
                f"coefficients of [select] degrees {degree}"
            )

    @property
    def _where(self) -> str:
        return f"{self.source}: " if self.source else ""


def config_from_dict(
    document: Mapping[str, Any], where: str = "CONFIG", *, base: Path | None = None
) -> Config:
    """A parsed CONFIG; InputError naming file, table, key and the nearest known key.

    Parameters
    ----------
    base
        Directory of a relative mesh file.
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

    def section(name: str) -> Any:
        return document.get(name, {})

    try:
        return Config(
            mechanism=mechanism,
            workspace=read_settings(Workspace, section("workspace"), f"{where} [workspace]"),
            simulate=read_settings(SimulateSettings, section("simulate"), f"{where} [simulate]"),
            select=read_settings(SelectSettings, section("select"), f"{where} [select]"),
            design=read_settings(DesignSettings, section("design"), f"{where} [design]"),
            rig=RigSettings.from_dict({k: document[k] for k in RIG_TABLES if k in document}, where),
            source=where,
        )
    except InputError as error:
        text = str(error)
        raise InputError(text if text.startswith(where) else f"{where}: {text}") from None


def read_config(path: str | Path) -> Config:
    """CONFIG of a TOML file."""
    file = Path(path)
    return config_from_dict(read_toml(file, "configuration"), str(file), base=file.parent)


def read_rig(path: str | Path) -> RigSettings:
    """RIG.toml: the tables [rig] [instrument] [plant] [hidden] of a CONFIG."""
    file = Path(path)
    return RigSettings.from_dict(read_toml(file, "rig file"), str(file))


def with_rig(config: Config, path: str | Path) -> Config:
    """The job on the rig of another file; its own [hidden] stays where that file has none."""
    file = Path(path)
    document = read_toml(file, "rig file")
    rig = RigSettings.from_dict(document, str(file))
    if "hidden" not in document:
        rig = replace(rig, hidden=config.rig.hidden)
    return replace(config, rig=rig)
