"""Exported files on disk, the programs made from them, and models to export."""

from __future__ import annotations

import ctypes
from functools import lru_cache
from pathlib import Path
from typing import Any

from ecm.io.arrays import F
from ecm.models import Model, fit_model
from ecm.models.control_loop import LoopSettings
from ecm.models.export import Exported, export_files
from support.campaigns import campaign, workspace_poses
from support.programs import cargo, ended, need_program

HEAD = LoopSettings(mass_kg=0.5, inertia_kg_m2=5e-4)
"""A platform for simulations."""
_EXPORTED: dict[tuple[object, ...], tuple[Model, Exported]] = {}


def exported(
    model: Model, target: str, precision: str = "double", name: str = "neck", **how: Any
) -> Exported:
    """What `export_files` gives, once of a model, which is kept: another might get its id."""
    key = (id(model), target, precision, name, *how.items())
    if key not in _EXPORTED:
        _EXPORTED[key] = model, export_files(model, target, name, precision, **how)  # type: ignore[arg-type]
    return _EXPORTED[key][1]


def written(model: Model, folder: Path, target: str, precision: str = "double", **how: Any) -> Path:
    """The folder with the files of a target."""
    for path, content in exported(model, target, precision, **how).files.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_bytes(content.encode() if isinstance(content, str) else content)
    return folder


def loaded_library(*sources: object) -> ctypes.CDLL:
    """The shared library of C sources and what is linked to them, beside the first of them."""
    library = Path(str(sources[0])).with_suffix(".so")
    ended(need_program("gcc", "cc"), "-std=c99", "-O2", "-shared", "-fPIC", *sources, "-o", library)
    return ctypes.CDLL(str(library))


def adapter_library(folder: Path, *options: object) -> Path:
    """The static library of the exported crate `neck_adapt` in a folder, as its header says."""
    target = folder / "target"
    crate = folder / "neck_adapt"
    cargo(crate, target, "build", "--release", *options, RUSTFLAGS="-D warnings")
    return next(target.glob("**/release/libneck_adapt.a"))


@lru_cache(maxsize=4)
def fitted(name: str) -> Model:
    """A model of the closed-form mechanism."""
    return fit_model(campaign(seed=3), name)


@lru_cache(maxsize=1)
def thousand_poses() -> F:
    """(1000, 6) poses of the workspace."""
    return workspace_poses(1000, 17)
