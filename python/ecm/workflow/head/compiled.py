"""The controller in C: the code of `ecm export` and the files of `code/`, compiled and loaded."""

from __future__ import annotations

import ctypes
import hashlib
from importlib.resources import files
from pathlib import Path

import numpy as np

from ecm.errors import ComputationError, InputError
from ecm.io.arrays import F
from ecm.io.cache import write_atomically
from ecm.io.columns import POSE, WRENCH
from ecm.io.description import Meta
from ecm.io.table import as_table
from ecm.models import EnergyModel, Model, fit_model
from ecm.models.export import export_files
from ecm.models.export.compiler import shared_library
from ecm.workflow.head.observer import Observer, design_observer
from ecm.workflow.head.settings import HeadSettings

_D = ctypes.c_double
_HISTORY = 256
"""Poses that the C code remembers: HISTORY of head.h."""


class Settings(ctypes.Structure):
    """`settings_t` of the C code."""

    _fields_ = (
        ("dt", _D), ("mass", _D), ("centre", _D * 3), ("inertia", _D * 3), ("gravity", _D * 3),
        ("guides", _D * 12), ("anchors", _D * 12),
        ("least", _D), ("most", _D), ("preferred", _D),
        ("bandwidth", _D), ("compensation", _D), ("integral", _D),
        ("gain", _D * 108), ("carry", _D * 324), ("length", _D),
        ("damping", _D), ("speed_share", _D),
        ("delay_steps", ctypes.c_int32), ("feedback", ctypes.c_int32),
    )  # fmt: skip


class State(ctypes.Structure):
    """The beginning of `state_t`; the rest belongs to the C code."""

    _fields_ = (
        ("pose", _D * 6), ("twist", _D * 6), ("unknown", _D * 6), ("forces", _D * 4),
        ("sum", _D * 4), ("drive", _D * 4),
        ("history", _D * (_HISTORY * 6)), ("steps", ctypes.c_int64),
        ("limited", ctypes.c_int32), ("reserved", ctypes.c_int32), ("wrench", _D * 6),
    )  # fmt: skip


class Inputs(ctypes.Structure):
    """`inputs_t` of the C code."""

    _fields_ = (
        ("pose", _D * 6), ("twist", _D * 6), ("acceleration", _D * 6), ("reading", _D * 6),
        ("forces", _D * 4), ("known", _D * 6), ("factor", _D), ("temperature", _D), ("pause", _D),
        ("fresh", ctypes.c_int32), ("reserved", ctypes.c_int32),
    )  # fmt: skip


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
    code = files("ecm.workflow.head") / "code"
    sources = {
        item.name: item.read_text(encoding="utf-8")
        for item in sorted(code.iterdir(), key=lambda item: item.name)
        if item.name.endswith((".c", ".h"))
    }
    options = ["-DNO_NECK"]
    if model is not None:
        exported = export_files(model, "c", "neck").files
        sources |= {name: str(exported[name]) for name in ("neck.h", "neck.c")}
        options = ["-DNECK_STEPS"] if "neck_step" in sources["neck.h"] else []
    text = "".join(sources.values()) + "".join(options)
    library = folder / f"head-{hashlib.sha256(text.encode()).hexdigest()[:32]}.so"
    if library.exists():
        return library
    names = [name for name in sources if name.endswith(".c")]
    try:
        binary = shared_library(sources, names, options=[*options, "-lm"])
    except ComputationError as error:
        raise ComputationError(f"the head's controller is C code: {error}") from None
    write_atomically(library, binary)
    return library


def exportable(model: Model, poses: F) -> Model:
    """Return the model, or an energy fitted to it where its kind is not exported as C.

    Parameters
    ----------
    model
        A fitted model.
    poses
        (N, 6) poses at which the energy follows the model.
    """
    if model.base.document().get("kind") in ("polynomial", "energy", "physics"):
        return model
    rows = np.hstack([poses, model.predict(poses)])
    columns = dict(zip((*POSE, *WRENCH), rows.T, strict=True))
    table = as_table(columns, meta=Meta(mechanism={"length_m": model.known_length_m}))
    return fit_model(table, EnergyModel(degree=6, symmetry="revolution"))


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
    """

    def __init__(self, library: Path, settings: HeadSettings, pose: F, length_m: float) -> None:
        self._code = ctypes.CDLL(str(library))
        self._code.head_state_bytes.restype = ctypes.c_int32
        self._buffer = ctypes.create_string_buffer(int(self._code.head_state_bytes()))
        self.state = State.from_buffer(self._buffer)
        observer = design_observer(lambda at: _model(self._code, at), settings, pose, length_m)
        self.settings = c_settings(settings, length_m, observer)
        self.inputs = Inputs(factor=1.0, temperature=22.0)
        self.commands: F = np.zeros(4)
        self._code.head_init.restype = None
        self._code.head_step.restype = None
        self.restart(pose)
        self._arguments = (
            ctypes.byref(self.settings), ctypes.byref(self._buffer), ctypes.byref(self.inputs),
            ctypes.c_void_p(self.commands.ctypes.data),
        )  # fmt: skip

    def restart(self, pose: F) -> None:
        """Forget everything; the head rests at a pose (6,)."""
        self._code.head_init(ctypes.byref(self._buffer), (_D * 6)(*pose))

    def step(self) -> F:
        """Return the wanted tendon forces (4,) for what `inputs` holds."""
        self._code.head_step(*self._arguments)
        return self.commands

    def model(self, pose: F) -> tuple[F, F]:
        """Wrench (6,) and stiffness (6, 6) of the model at a pose, without effects of time."""
        return _model(self._code, pose)

    def hold(self, pose: F, wrench: F, stiffness: F) -> tuple[F, int]:
        """Forces (4,) that hold a pose under a wrench, and how many are at a limit."""
        forces = np.zeros(4)
        limited = self._code.head_hold(
            ctypes.byref(self.settings), (_D * 6)(*pose), (_D * 6)(*wrench),
            (_D * 36)(*np.ravel(stiffness)), ctypes.c_void_p(forces.ctypes.data),
        )  # fmt: skip
        return forces, int(limited)

    def reach(self, pose: F, stiffness: F, forces: F, away: F) -> F:
        """Change of the forces (4,) that moves the equilibrium nearest to a small twist (6,)."""
        change = np.zeros(4)
        self._code.head_reach(
            ctypes.byref(self.settings), (_D * 6)(*pose), (_D * 36)(*np.ravel(stiffness)),
            (_D * 4)(*forces), (_D * 6)(*away), ctypes.c_void_p(change.ctypes.data),
        )  # fmt: skip
        return change


def c_settings(settings: HeadSettings, length_m: float, observer: Observer) -> Settings:
    """Settings of the C code.

    Raises
    ------
    InputError
        Readings are later than the controller remembers poses.
    """
    control, sensor, body, tendons = (
        settings.control, settings.sensor, settings.body, settings.tendons,
    )  # fmt: skip
    delay_steps = round(sensor.delay_s / control.dt_s)
    if delay_steps >= _HISTORY:
        raise InputError(
            f"delay_s {sensor.delay_s:g} is {delay_steps} steps of {control.dt_s:g} s: the "
            f"controller remembers {_HISTORY - 1}; take a longer dt_s"
        )
    return Settings(
        dt=control.dt_s,
        mass=body.mass_kg,
        centre=(_D * 3)(*body.centre_m),
        inertia=(_D * 3)(*body.inertia_kg_m2),
        gravity=(_D * 3)(*settings.gravity_m_s2),
        guides=(_D * 12)(*tendons.guides_m.ravel()),
        anchors=(_D * 12)(*tendons.anchors_m.ravel()),
        least=tendons.least_N,
        most=tendons.most_N,
        preferred=tendons.rest_N,
        bandwidth=control.bandwidth_rad_s,
        compensation=control.compensation,
        integral=control.integral_per_s,
        gain=(_D * 108)(*observer.gain.ravel()),
        carry=(_D * 324)(*observer.carry.ravel()),
        length=length_m,
        damping=tendons.motor_damping_N_s_m,
        speed_share=control.speed_share,
        delay_steps=delay_steps,
        feedback=int(control.bandwidth_rad_s > 0.0),
    )


def _model(code: ctypes.CDLL, pose: F) -> tuple[F, F]:
    wrench, stiffness = np.zeros(6), np.zeros((6, 6))
    code.head_neck(
        (_D * 6)(*pose), ctypes.c_void_p(wrench.ctypes.data), ctypes.c_void_p(stiffness.ctypes.data)
    )
    return wrench, stiffness
