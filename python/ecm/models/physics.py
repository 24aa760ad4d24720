"""The physics base: FEM of the stated body with a free factor on E, as an energy surrogate.

h(p) = factor h_FEM(p): for a hyperelastic body whose energy is proportional to E the wrench at a
given pose is too, so one factor covers every error of E exactly.
"""

from __future__ import annotations

import json
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from ecm import _native
from ecm.columns import POSE, WRENCH
from ecm.errors import InputError
from ecm.models.maps import EnergyMap, Symmetry
from ecm.stages import cache_directory, write_atomically

if TYPE_CHECKING:
    from ecm.mechanism import Mechanism

F = NDArray[np.float64]

_TRAIN = 240
_TEST = 60
_DEGREE = 6
_SEED = 20
_VERSION = 2


@dataclass(frozen=True)
class PhysicsMap:
    """factor * h0(p), h0 an energy surrogate fitted to FEM poses of the mechanism."""

    surrogate: EnergyMap
    own_error: F
    """(6,) root mean square error of the surrogate on FEM poses it has not seen."""
    mechanism: dict[str, Any]
    """The `[mechanism]` table."""
    factor: float = 1.0

    @property
    def name(self) -> str:
        """`physics`."""
        return "physics"

    @property
    def kind(self) -> Literal["polynomial", "energy", "physics"]:
        """`physics`."""
        return "physics"

    @property
    def inputs(self) -> tuple[str, ...]:
        """All six."""
        return POSE

    @property
    def outputs(self) -> tuple[str, ...]:
        """All six."""
        return WRENCH

    @property
    def length_m(self) -> float | None:
        """Length of the mechanism."""
        return self.surrogate.length_m

    @property
    def coefficients(self) -> F:
        """The factor on E."""
        return np.array([self.factor])

    @property
    def error(self) -> F:
        """The surrogate's own error, scaled like its wrench."""
        return abs(self.factor) * self.own_error

    def predict(self, poses: F) -> F:
        """(N, 6) to (N, 6)."""
        return self.factor * self.surrogate.predict(poses)

    def stiffness(self, poses: F, kind: str = "partial") -> F:
        """(N, 6, 6)."""
        return self.factor * self.surrogate.stiffness(poses, kind)

    def columns(self, poses: F) -> F:
        """(N, 6, 1): h0."""
        return np.asarray(self.surrogate.predict(poses)[:, :, None])

    def with_coefficients(self, coefficients: F) -> PhysicsMap:
        """Another factor on E."""
        return replace(self, factor=float(coefficients[0]))

    def document(self) -> dict[str, Any]:
        """The surrogate's part, the factor and the mechanism."""
        return {
            **self.surrogate.document(),
            "kind": "physics",
            "name": "physics",
            "factor": self.factor,
            "own_error": self.own_error.tolist(),
            "mechanism": self.mechanism,
        }

    @staticmethod
    def from_document(document: dict[str, Any]) -> PhysicsMap:
        """The map of an opened model file."""
        return PhysicsMap(
            surrogate=EnergyMap.from_document(document),
            own_error=np.asarray(document["own_error"], dtype=np.float64),
            mechanism=dict(document["mechanism"]),
            factor=float(document["factor"]),
        )


def surrogate_of(
    poses: F,
    wrenches: F,
    length_m: float,
    *,
    test_poses: F,
    test_wrenches: F,
    mechanism: dict[str, Any] | None = None,
    symmetry: Symmetry = "alike",
) -> PhysicsMap:
    """A physics map from noise-free poses and wrenches; its error from those it has not seen."""
    model = _native.EnergyModel.fit(
        np.ascontiguousarray(poses),
        np.ascontiguousarray(wrenches),
        length_m=length_m,
        degree=_DEGREE,
        symmetry=symmetry,
    )
    surrogate = EnergyMap(model)
    error = np.sqrt(((surrogate.predict(test_poses) - test_wrenches) ** 2).mean(axis=0))
    return PhysicsMap(surrogate, error, {} if mechanism is None else dict(mechanism))


def physics_map(mechanism: Mechanism, *, threads: int = 0, cache: Path | None = None) -> PhysicsMap:
    """The physics map of a mechanism; built once per shape and material, then read from `cache`.

    The cache is `ECM_CACHE`, else `XDG_CACHE_HOME/ecm`, else `~/.cache/ecm`.
    """
    from ecm.simulate import fem_poses

    if not mechanism.has_body:
        raise InputError(
            "the physics model needs a body: give [mechanism] builtin with its dimensions, or "
            "mesh, and young_modulus_Pa"
        )
    directory = cache_directory() if cache is None else cache
    path = directory / f"physics-{_VERSION}-{mechanism.key()}.json"
    found = _read(path)
    if found is not None:
        return found
    poses, wrenches = fem_poses(mechanism, _TRAIN + _TEST, seed=_SEED, threads=threads)
    built = surrogate_of(
        poses[:_TRAIN],
        wrenches[:_TRAIN],
        mechanism.length_m,
        test_poses=poses[_TRAIN:],
        test_wrenches=wrenches[_TRAIN:],
        mechanism=mechanism.to_dict(),
        symmetry=_symmetry(mechanism),
    )
    _write(path, built)
    return built


def _symmetry(mechanism: Mechanism) -> Symmetry:
    """Built-in bodies have alike ends; a mesh may be anything."""
    return "alike" if mechanism.mesh_file is None else "general"


def _read(path: Path) -> PhysicsMap | None:
    """A cached map; None where there is none or it cannot be read."""
    try:
        return PhysicsMap.from_document(json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, KeyError, _native.EcmError):
        return None


def _write(path: Path, built: PhysicsMap) -> None:
    """Best effort: a cache that cannot be written only costs time."""
    with suppress(OSError):
        write_atomically(path, json.dumps(built.document()))
