"""The mechanism under the arm: its wrench at 1 kHz, and the controller's model of it.

The simulated mechanism is an energy model fitted to FEM poses of the plan. It is conservative by
construction and has degree 6, or 4 if few poses are solved.

The plant of the rig (`ecm.rig.plant`) models friction, relaxation, softening, cable, stop, slip,
weights and temperature. Its wrench at the present pose and history, minus that of the bare
mechanism, is added to the elastic one. It is computed five times a second and interpolated
linearly, since the plant evaluates a whole series of visits. The history in motion begins with each
trip; that of the readings begins with the campaign.

The controller's model is a file that is exported as C and compiled here: other code than that of
the simulated mechanism, so that what the controller knows and what is true stay apart.
"""

from __future__ import annotations

import ctypes
import hashlib
import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ecm._native import (
    EnergyEvaluator,
    ModelError,
    PolynomialEvaluator,
    export_model,
    open_model,
    seal_model,
)
from ecm.errors import ComputationError, InputError
from ecm.io.arrays import F, I, rms_of_columns
from ecm.io.cache import write_atomically
from ecm.io.columns import POSE, WRENCH
from ecm.io.extras import compiled
from ecm.rig.elastic import (
    SYMMETRY,
    UNIFORM,
    Elastic,
    Progress,
    SolvedPoses,
    Source,
    fitted_energy,
    solve_cached,
)  # fmt: skip
from ecm.rig.physics import Physics
from ecm.rig.plan import Visit
from ecm.rig.plant import Plant, visits_of
from ecm.rig.timeline import Climate

_ENOUGH = 90
"""Solved poses for a surrogate; with fewer, poses on the way to each are solved too."""
_SHARES = (0.35, 0.7)
_FEW = 20
"""With fewer solved poses, poses near rest are solved too, or the model may be unstable there."""
_NEAR_LENGTHS, _NEAR_RAD = 0.03, 0.15
_PUSH_DEGREE = 2
"""Degree of the energy whose wrench an actuator adds: 1 to 2 % of the spread; 3 needs rows."""


@dataclass(frozen=True)
class Surrogate:
    """An energy model as plain numbers, which can be sent to another process."""

    length_m: float
    degree: int
    scale: F
    coefficients: F
    rms: F
    """Root mean square error of its wrench at the FEM poses that it was fitted to, (6,)."""
    pushes: tuple[tuple[F, F], ...] = ()
    """Scale and coefficients of an energy for each actuator: the wrench per unit of its input."""

    def model(self) -> EnergyEvaluator:
        """Return the energy model, without actuators."""
        return self._energy(self.degree, SYMMETRY, self.scale, self.coefficients)

    def _energy(self, degree: int, symmetry: Any, scale: F, coefficients: F) -> EnergyEvaluator:
        return EnergyEvaluator.from_coefficients(
            length_m=self.length_m, degree=degree, symmetry=symmetry,
            scale=scale, coefficients=coefficients,
        )  # fmt: skip

    def wrench(self) -> Callable[[F], F]:
        """Return h of rows (N, 6 + m), poses with the inputs of the actuators."""
        passive = self.model().predict
        pushes = [self._energy(_PUSH_DEGREE, "general", *push).predict for push in self.pushes]
        if not pushes:
            return passive

        def driven(rows: F) -> F:
            poses = np.ascontiguousarray(rows[:, :6])
            wrench: F = passive(poses)
            for push, amount in zip(pushes, rows[:, 6:].T, strict=True):
                wrench = wrench + amount[:, None] * push(poses)
            return wrench

        return driven


def fem_pairs(
    source: Source, solved: SolvedPoses, folder: Path | None, progress: Progress
) -> tuple[F, F, F]:
    """Return poses (N, 6 + m), wrenches (N, 6) and G (N, 6, m): the solved ones, and more if few.

    A free pose has no load and tells what the inputs do.
    """
    driven = solved.poses.shape[1] > 6
    loaded = solved.good & (driven | (np.linalg.norm(solved.wrenches, axis=1) > 0.0))
    poses, rest = solved.poses[loaded], solved.poses[0]
    pairs = SolvedPoses(poses, solved.wrenches[loaded], solved.stiffness[loaded], ())
    if len(poses) < _ENOUGH:
        extra = [rest + share * (poses - rest) for share in _SHARES]
        if len(poses) < _FEW:
            sizes = np.repeat([_NEAR_LENGTHS * float(rest[0]), _NEAR_RAD], 3)
            steps = np.diag(sizes) @ np.eye(6, len(rest))
            extra += [rest + steps, rest - steps]
        more = solve_cached(source, np.concatenate(extra), UNIFORM, folder, progress)
        ok = more.good
        pairs = pairs.joined(SolvedPoses(more.poses[ok], more.wrenches[ok], more.stiffness[ok], ()))
    return pairs.poses, pairs.wrenches, pairs.stiffness[:, :, 6:]


def fit_surrogate(poses: F, wrenches: F, length_m: float, slopes: F | None = None) -> Surrogate:
    """Fit the surrogate to FEM pairs; InputError if there are too few of them.

    Parameters
    ----------
    slopes
        G (N, 6, m) of a body with actuators, whose poses are (N, 6 + m).
    """
    fits: list[EnergyEvaluator] = []
    if slopes is not None and slopes.shape[2]:
        inputs, poses = poses[:, 6:], np.ascontiguousarray(poses[:, :6])
        for g, a in zip(np.ascontiguousarray(np.moveaxis(slopes, 2, 0)), inputs.T, strict=True):
            push = EnergyEvaluator.fit(
                poses, g, length_m=length_m, degree=_PUSH_DEGREE, symmetry="general"
            )
            wrenches = wrenches - a[:, None] * push.predict(poses)
            fits.append(push)
    if len(poses) < 6:
        raise InputError(
            f"the plan has {len(poses)} solved poses, those between included; the simulated "
            "mechanism needs 6 or more. Add poses to the plan"
        )
    # What the pushes err would be fitted by a higher degree, and grow without end beyond the plan.
    model, degree = fitted_energy(poses, wrenches, length_m, 4 if fits else 6)
    error = rms_of_columns(model.predict(poses) - wrenches)
    pushes = tuple((one.scale, one.coefficients) for one in fits)
    return Surrogate(length_m, degree, model.scale, model.coefficients, error, pushes)


STEPS_BETWEEN = 200
"""Simulation steps between two evaluations of the plant."""
_WAY_POINTS = 10


@dataclass(frozen=True)
class HiddenPhysics:
    """What the plant has beyond the bare mechanism, ready to be sent to another process."""

    plant: Plant
    """With the solved poses alone, without a smooth map."""
    air: Climate
    visits: tuple[Visit, ...]
    """Visits of the planned timeline."""
    nearest: I


def with_inputs(poses: F, inputs: F) -> F:
    """Return poses (N, 6) with the same inputs (m,) of actuators after each."""
    return np.hstack([poses, np.tile(inputs, (len(poses), 1))])


class NonElasticWrench:
    """The wrench beyond elasticity along one trip."""

    def __init__(self, hidden: HiddenPhysics, surrogate: Surrogate) -> None:
        self._hidden = hidden
        # No energy of the pose alone goes through inputs: then only the slopes of the solved rows.
        smooth = None if surrogate.pushes else surrogate.model()
        elastic = Elastic(hidden.plant.elastic.solved, smooth)
        self._plant = replace(hidden.plant, elastic=elastic)
        self._bare = replace(self._plant, physics=Physics())
        self._way: list[F] = []
        self._depart_s = 0.0
        self.next_visit(0)

    def begin(self, rest: F, depart_s: float) -> None:
        """Begin a trip at home."""
        self._way = [rest.copy()]
        self._depart_s = depart_s
        self._moved_s = self._rested_s = 0.0

    def next_visit(self, visit: int) -> None:
        """Begin the leg to a visit of the planned timeline."""
        self._visit = self._hidden.visits[visit]
        self._nearest = self._hidden.nearest[visit : visit + 1]
        self._moved_s = self._rested_s = 0.0

    def at(self, pose: F, time_s: float, span_s: float, *, moving: bool) -> F:
        """Wrench (6,) at a pose and a time since the trip began; `span_s` since the last call."""
        if moving:
            if self._rested_s:
                self._moved_s = self._rested_s = 0.0
            self._moved_s += span_s
            self._way.append(pose.copy())
        else:
            self._rested_s += span_s
        index = np.unique(np.linspace(0, len(self._way) - 1, _WAY_POINTS).round().astype(int))
        visit = replace(
            self._visit, time_s=self._depart_s + time_s, travel_s=self._moved_s,
            dwell_s=self._rested_s,
            way=with_inputs(
                np.stack([*(self._way[i] for i in index), pose]), self._visit.pose[6:]
            ),
            rested=True,
        )  # fmt: skip
        visits = visits_of((visit,), pose[None].copy(), self._nearest, self._hidden.air)
        return np.asarray((self._plant.load(visits) - self._bare.load(visits))[0])


_NAME = "controller"
_FILE = "controller-"
_ENERGY_PAIRS = 12
"""Pairs for an energy model of degree 4; with fewer the controller gets a linear map."""


class ControllerModel:
    """Wrench h and stiffness K of the compiled model at one pose, in arrays of its own."""

    def __init__(self, library: Path) -> None:
        self._pose: F = np.zeros(6)
        self.wrench: F = np.zeros(6)
        self.stiffness: F = np.zeros((6, 6))
        self._function = getattr(ctypes.CDLL(str(library)), f"{_NAME}_value_and_stiffness")
        self._function.restype = None
        self._function.argtypes = [ctypes.c_void_p] * 3
        arrays = (self._pose, self.wrench, self.stiffness)
        self._addresses = [ctypes.c_void_p(a.ctypes.data) for a in arrays]

    def evaluate(self, pose: F) -> None:
        """Write `wrench` and `stiffness` at a pose (6,)."""
        self._pose[:] = pose
        self._function(*self._addresses)


def controller_document(path: str, poses: F, wrenches: F, length_m: float) -> str:
    """Return the sealed model of the controller: a model file, or one fitted to FEM pairs.

    InputError if the file cannot be read, or if it holds physical effects: the controller
    evaluates the base model only.
    """
    if path:
        return _read(Path(path))
    if len(poses) >= _ENERGY_PAIRS:
        energy = EnergyEvaluator.fit(poses, wrenches, length_m=length_m, degree=4)
        return seal_model(json.dumps(energy.document()))
    linear = PolynomialEvaluator.fit(poses, wrenches, 1)
    return seal_model(json.dumps(linear.document(POSE, WRENCH)))


def _read(path: Path) -> str:
    try:
        text = path.read_text(encoding="utf-8")
        document = open_model(text)
    except (OSError, UnicodeDecodeError, ModelError) as error:
        raise InputError(f"[rig] controller_model = {path}: {error}") from None
    if "actuators" in document.get("parameters", {}):
        raise InputError(
            f"[rig] controller_model = {path}: it takes the inputs of actuators, and the arm's "
            "controller knows poses alone; name an energy of poses, or none"
        )
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
    command = [_require_compiler(), "-std=c99", "-O2", "-fPIC", "-shared"]
    folder.mkdir(parents=True, exist_ok=True)
    content = compiled(command, files, [f"{_NAME}.c"], " the exported model")
    write_atomically(library, content)
    return library
