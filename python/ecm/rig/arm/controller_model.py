"""The controller's model of the mechanism: a sealed model file, exported as C and compiled here.

The mechanism itself is simulated by other code (`surrogate.py`), so that what the controller knows
and what is true stay apart.
"""

from __future__ import annotations

import ctypes
import hashlib
import json
import shutil
import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from ecm._native import (
    EnergyModel,
    ModelError,
    PolynomialModel,
    export_model,
    open_model,
    seal_model,
)
from ecm.errors import ComputationError, InputError
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH

_NAME = "controller"
_FILE = "controller-"
_ENERGY_PAIRS = 12
"""Pairs for an energy model of degree 4; with fewer the controller gets a linear map."""


class ControllerModel:
    """Wrench h and stiffness K of the compiled model at one pose, in arrays of its own."""

    def __init__(self, library: Path) -> None:
        self.pose: F = np.zeros(6)
        self.wrench: F = np.zeros(6)
        self.stiffness: F = np.zeros((6, 6))
        self._function = getattr(ctypes.CDLL(str(library)), f"{_NAME}_value_and_stiffness")
        self._function.restype = None
        self._function.argtypes = [ctypes.c_void_p] * 3
        arrays = (self.pose, self.wrench, self.stiffness)
        self._addresses = [ctypes.c_void_p(a.ctypes.data) for a in arrays]

    def evaluate(self) -> None:
        """Read `pose`, write `wrench` and `stiffness`."""
        self._function(*self._addresses)


def controller_document(path: str, poses: F, wrenches: F, length_m: float) -> str:
    """Return the sealed model of the controller: a model file, or one fitted to FEM pairs.

    InputError if the file cannot be read, or if it holds physical effects: the controller
    evaluates the base model only.
    """
    if path:
        return _read(Path(path))
    if len(poses) >= _ENERGY_PAIRS:
        energy = EnergyModel.fit(poses, wrenches, length_m=length_m, degree=4)
        return seal_model(json.dumps(energy.document()))
    linear = PolynomialModel.fit(poses, wrenches, 1)
    return seal_model(json.dumps(linear.document(POSE, WRENCH)))


def _read(path: Path) -> str:
    try:
        text = path.read_text(encoding="utf-8")
        document = open_model(text)
    except (OSError, UnicodeDecodeError, ModelError) as error:
        raise InputError(f"[rig] controller_model = {path}: {error}") from None
    effects = [item["id"] for item in document["effects"] or () if item.get("side") == "physics"]
    if effects:
        raise InputError(
            f"[rig] controller_model = {path}: it holds {', '.join(effects)}, and the arm's "
            "controller evaluates the base model only; remove them (ecm refit --remove), or name "
            "the model before them"
        )
    return text


def require_library(folder: Path) -> None:
    """Raise ComputationError if the folder has no compiled model and none can be compiled.

    Which one a plan needs is known after its FEM; `compile_model` checks again then.
    """
    if not any(folder.glob(f"{_FILE}*.so")):
        _require_compiler()


def _require_compiler() -> str:
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        raise ComputationError(
            "the controller's model is C code, and no C compiler (cc, gcc, clang) was found; "
            "install one"
        )
    return compiler


def compile_model(document: str, folder: Path) -> Path:
    """Export a sealed model as C and compile it; the library is cached by the hash of its source.

    ComputationError if there is no C compiler, or if it fails.
    """
    files = export_model(document, _NAME, target="c")
    text = files[f"{_NAME}.h"] + files[f"{_NAME}.c"]
    library = folder / f"{_FILE}{hashlib.sha256(text.encode()).hexdigest()[:32]}.so"
    if library.exists():
        return library
    compiler = _require_compiler()
    folder.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=folder) as build:
        for name in (f"{_NAME}.h", f"{_NAME}.c"):
            (Path(build) / name).write_text(files[name], encoding="utf-8")
        output = Path(build) / "library.so"
        done = subprocess.run(
            [compiler, "-std=c99", "-O2", "-fPIC", "-shared", f"{_NAME}.c", "-o", str(output)],
            cwd=build, capture_output=True, text=True, check=False,
        )  # fmt: skip
        if done.returncode != 0:
            raise ComputationError(
                f"{compiler} cannot compile the exported model: {done.stderr[:300]}"
            )
        output.replace(library)
    return library
