"""Exported files on disk, the programs made from them, and models to export."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

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


class CompiledC:
    """The functions of exported C, by their names without that of the model.

    They take and fill arrays, and read numbers. The library stands beside the source; `linked` are
    further sources, libraries and options of the compiler.
    """

    def __init__(self, source: Path, *linked: object, name: str = "") -> None:
        library, how = source.with_suffix(".so"), ("-std=c99", "-O2", "-shared", "-fPIC")
        ended(need_program("gcc", "cc"), *how, source, *linked, "-o", library)
        self._library, self._name = ctypes.CDLL(str(library)), name or source.stem

    def __getattr__(self, name: str) -> Callable[..., int]:
        function = getattr(self._library, f"{self._name}_{name}")
        return lambda *given: int(function(*map(_as_c, given)))

    def wrenches(self, poses: F, outputs: int) -> F:
        """(N, m) wrenches at poses, each by a call."""
        found = np.zeros((len(poses), outputs))
        for pose, wrench in zip(poses, found, strict=True):
            self.value(pose, wrench)
        return found


def _as_c(given: Any) -> Any:
    if not isinstance(given, np.ndarray):
        return ctypes.c_double(given) if isinstance(given, float) else given
    assert given.flags.c_contiguous
    return given.ctypes


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
