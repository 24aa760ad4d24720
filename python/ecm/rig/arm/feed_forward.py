"""The controller's model inside the loop: C code exported from an ecm-poly model, compiled here.

The mechanism is computed by other code (`simulation.py`), so that what the controller knows and
what is true stay apart.
"""

from __future__ import annotations

import ctypes
import hashlib
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from ecm._native import export_model
from ecm.errors import ComputationError
from ecm.io.arrays import F

_NAME = "controller"
_FILE = "controller-"


class ControllerModel:
    """h and K of the exported model at one pose, written into arrays of its own."""

    def __init__(self, evaluate: Callable[[], object], pose: F, wrench: F, stiffness: F) -> None:
        self.evaluate = evaluate
        """Reads `pose` (6,), writes `wrench` (6,) and `stiffness` (6, 6)."""
        self.pose = pose
        self.wrench = wrench
        self.stiffness = stiffness


def compiled(library: Path) -> ControllerModel:
    """The functions of a library that `build` has made."""
    pose, wrench, stiffness = np.zeros(6), np.zeros(6), np.zeros((6, 6))
    function = getattr(ctypes.CDLL(str(library)), f"{_NAME}_value_and_stiffness")
    function.restype = None
    function.argtypes = [ctypes.c_void_p] * 3
    places = [ctypes.c_void_p(a.ctypes.data) for a in (pose, wrench, stiffness)]

    def evaluate() -> None:
        function(*places)

    return ControllerModel(evaluate, pose, wrench, stiffness)


def need_library(folder: Path) -> None:
    """ComputationError where none is kept in a folder and none could be made.

    Which one a plan needs is known after its FEM; `build` asks again then.
    """
    if not any(folder.glob(f"{_FILE}*.so")):
        need_compiler()


def need_compiler() -> str:
    """The C compiler of this machine, or a ComputationError."""
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        raise ComputationError(
            "the controller's model is C code, and no C compiler (cc, gcc, clang) was found; "
            "install one"
        )
    return compiler


def build(model: str, folder: Path) -> Path:
    """Exports a sealed model, compiles it and keeps the library under a hash of its source.

    Raises
    ------
    ComputationError
        Where there is no C compiler, or it refuses the code.
    """
    files = export_model(model, _NAME, target="c")
    text = files[f"{_NAME}.h"] + files[f"{_NAME}.c"]
    library = folder / f"{_FILE}{hashlib.sha256(text.encode()).hexdigest()[:32]}.so"
    if library.exists():
        return library
    compiler = need_compiler()
    folder.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=folder) as place:
        for name in (f"{_NAME}.h", f"{_NAME}.c"):
            (Path(place) / name).write_text(files[name], encoding="utf-8")
        made = Path(place) / "library.so"
        done = subprocess.run(
            [compiler, "-std=c99", "-O2", "-fPIC", "-shared", f"{_NAME}.c", "-o", str(made)],
            cwd=place, capture_output=True, text=True, check=False,
        )  # fmt: skip
        if done.returncode != 0:
            raise ComputationError(f"{compiler} refuses the exported model: {done.stderr[:300]}")
        made.replace(library)
    return library
