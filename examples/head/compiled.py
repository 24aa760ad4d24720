"""Two uses of `ecm export`: the controller in C with a model, and the plant's neck in MuJoCo.

A model that is exported as C is compiled with the files of `code/` and called once per millisecond.
An energy that is exported for MuJoCo is a passive plugin, built with the script beside it.
"""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory

import mujoco
import numpy as np

from ecm import ComputationError, InputError, Model
from ecm.models.export import export_files
from neck import TrueNeck
from observer import design_observer
from robot import F, HeadSettings

_CODE = Path(__file__).with_name("code")
_HISTORY = 256
"""Poses that the C code remembers: HISTORY of head.h."""
_D = ctypes.c_double


def compile_controller(model: Model | None, folder: Path) -> Path:
    """Export a model as C and compile the controller with it; return the library.

    Parameters
    ----------
    model
        Model of the neck, with its effects of time; None: a controller without a model.
    folder
        Where libraries are kept, by the hash of their source.

    Raises
    ------
    ComputationError
        No C compiler, or one that fails.
    """
    files: dict[str, str | bytes] = {
        path.name: path.read_text(encoding="utf-8") for path in sorted(_CODE.glob("*.[ch]"))
    }
    options = ["-DNO_NECK"]
    if model is not None:
        exported = export_files(model, "c", "neck").files
        files |= {name: exported[name] for name in ("neck.h", "neck.c")}
        options = ["-DNECK_STEPS"] if "neck_step" in str(files["neck.h"]) else []
    library = folder / f"head-{_digest(files, options)}.so"
    names = [name for name in files if name.endswith(".c")]
    flags = ["-std=c99", "-O2", "-s", "-shared", "-fPIC", "-fvisibility=hidden", *options]
    return _built(
        library, files, [os.environ.get("CC", "cc"), *flags, *names, "-lm", "-o", library.name]
    )


def build_plugin(neck: TrueNeck, folder: Path) -> Path:
    """Export the energy of a neck to MuJoCo and build its plugin; return the library.

    Parameters
    ----------
    neck
        The true neck; its effects act in `plant.py`.
    folder
        Where libraries are kept, by the hash of their source and the version of MuJoCo.

    Raises
    ------
    ComputationError
        No C or C++ compiler, or one that fails.
    """
    model = Model(neck.elastic)
    name = f"neck_{_digest(export_files(model, 'mujoco', 'neck').files, [mujoco.__version__])}"
    library = folder / f"lib{name}_plugin.so"
    files = export_files(model, "mujoco", name).files
    return _built(library, files, ["sh", f"{name}_build.sh", sys.executable])


def _digest(files: Mapping[str, str | bytes], more: Sequence[str]) -> str:
    text = "".join([*map(str, files.values()), *more])
    return sha256(text.encode()).hexdigest()[:16]


def _built(library: Path, files: Mapping[str, str | bytes], command: Sequence[str]) -> Path:
    """Run a command beside files that makes a library, unless it is there already."""
    library = library.resolve()
    if library.exists():
        return library
    library.parent.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=library.parent) as build:
        for path, content in files.items():
            (Path(build) / path).write_text(str(content), encoding="utf-8")
        try:
            subprocess.run(command, cwd=build, capture_output=True, text=True, check=True)
        except (OSError, subprocess.CalledProcessError) as error:
            said = getattr(error, "stderr", None) or error
            raise ComputationError(
                f"the head is C and C++ code, which could not be built: {str(said)[:300]}; "
                "install a C and a C++ compiler (cc, c++)"
            ) from None
        (Path(build) / library.name).replace(library)
    return library


class _Settings(ctypes.Structure):
    """`settings_t` of head.h."""

    _fields_ = (
        ("dt", _D), ("mass", _D), ("centre", _D * 3), ("inertia", _D * 3), ("gravity", _D * 3),
        ("guides", _D * 12), ("anchors", _D * 12), ("least", _D), ("most", _D), ("preferred", _D),
        ("bandwidth", _D), ("compensation", _D), ("integral", _D),
        ("gain", _D * 108), ("carry", _D * 324), ("length", _D), ("damping", _D),
        ("speed_share", _D), ("delay_steps", ctypes.c_int32), ("feedback", ctypes.c_int32),
    )  # fmt: skip


class _Inputs(ctypes.Structure):
    """`inputs_t` of head.h."""

    _fields_ = (
        ("pose", _D * 6), ("twist", _D * 6), ("acceleration", _D * 6), ("reading", _D * 6),
        ("forces", _D * 4), ("known", _D * 6), ("temperature", _D), ("pause", _D),
        ("fresh", ctypes.c_int32),
    )  # fmt: skip


class _Outputs(ctypes.Structure):
    """`outputs_t` of head.h."""

    _fields_ = (("commands", _D * 4), ("drive", _D * 4), ("limited", ctypes.c_int32))


class CompiledController:
    """The loaded code with its settings and its state; `step` is one call of C.

    Parameters
    ----------
    library
        As `compile_controller` returns it.
    settings
        The robot.
    pose
        (6,) where it starts, at rest.
    length_m
        What a radian counts in the allocation.

    Raises
    ------
    InputError
        Readings are later than the controller remembers poses.
    """

    def __init__(self, library: Path, settings: HeadSettings, pose: F, length_m: float) -> None:
        self._code = ctypes.CDLL(str(library))
        self._state = ctypes.create_string_buffer(int(self._code.head_state_bytes()))
        self._settings = _c_settings(settings, length_m)
        gain, carry = design_observer(self.model, settings, pose, length_m)
        self._settings.gain[:], self._settings.carry[:] = gain.ravel(), carry.ravel()
        self.inputs, self._outputs = _Inputs(temperature=22.0), _Outputs()
        # Views of the C code's numbers, newton.
        self.commands: F = np.frombuffer(self._outputs.commands)
        """(4,) wanted tendon forces of the last step."""
        self.drive: F = np.frombuffer(self._outputs.drive)
        """(4,) what the motors pull beyond them, for their own damping."""
        self.restart(pose)
        self._arguments = tuple(
            ctypes.byref(part) for part in (self._settings, self._state, self.inputs, self._outputs)
        )

    @property
    def limited(self) -> int:
        """How many tendons were at a limit in the last step."""
        return int(self._outputs.limited)

    def restart(self, pose: F) -> None:
        """Forget everything; the head rests at a pose (6,)."""
        self._code.head_init(self._state, _numbers(pose))

    def step(self) -> None:
        """Find the wanted tendon forces for what `inputs` holds."""
        self._code.head_step(*self._arguments)

    def model(self, pose: F) -> tuple[F, F]:
        """Wrench (6,) and stiffness (6, 6) of the model at a pose, without effects of time."""
        wrench, stiffness = _numbers(np.zeros(6)), _numbers(np.zeros(36))
        self._code.head_neck(_numbers(pose), wrench, stiffness)
        return np.array(wrench), np.reshape(stiffness, (6, 6))

    def hold(self, pose: F, wrench: F, stiffness: F) -> tuple[F, int]:
        """Forces (4,) that hold a pose under a wrench, and how many are at a limit."""
        forces = _numbers(np.zeros(4))
        given = map(_numbers, (pose, wrench, stiffness))
        limited = self._code.head_hold(ctypes.byref(self._settings), *given, forces)
        return np.array(forces), int(limited)

    def reach(self, pose: F, stiffness: F, forces: F, away: F) -> F:
        """Change of the forces (4,) that moves the equilibrium nearest to a small twist (6,)."""
        change = _numbers(np.zeros(4))
        given = map(_numbers, (pose, stiffness, forces, away))
        self._code.head_reach(ctypes.byref(self._settings), *given, change)
        return np.array(change)


def _numbers(values: F) -> ctypes.Array[ctypes.c_double]:
    return (_D * values.size)(*values.ravel())


def _c_settings(settings: HeadSettings, length_m: float) -> _Settings:
    control, sensor = settings.control, settings.sensor
    body, tendons = settings.body, settings.tendons
    delay_steps = round(sensor.delay_s / control.dt_s)
    if delay_steps >= _HISTORY:
        raise InputError(
            f"delay_s {sensor.delay_s:g} is {delay_steps} steps of {control.dt_s:g} s: the "
            f"controller remembers {_HISTORY - 1}; take a longer dt_s"
        )
    return _Settings(
        dt=control.dt_s, mass=body.mass_kg, centre=body.centre_m, inertia=body.inertia_kg_m2,
        gravity=settings.gravity_m_s2,
        guides=tuple(tendons.guides_m.ravel()), anchors=tuple(tendons.anchors_m.ravel()),
        least=tendons.least_N, most=tendons.most_N, preferred=tendons.rest_N,
        bandwidth=control.bandwidth_rad_s, compensation=control.compensation,
        integral=control.integral_per_s, length=length_m, damping=tendons.motor_damping_N_s_m,
        speed_share=control.speed_share, delay_steps=delay_steps,
        feedback=int(control.bandwidth_rad_s > 0.0),
    )  # fmt: skip
