"""The mechanism at 1 kHz, a smooth surrogate of its FEM, and the model the controller is given.

Both are energy models, so the simulated mechanism is conservative; the true one has degree 6 (4
where few poses are solved), the controller's is of degree 4 unless a model file is named.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from ecm._native import EnergyModel, ModelError, PolynomialModel, open_model, seal_model
from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.rig.elastic import UNIFORM, Anchors, Progress, Source, solve_cached

ENOUGH = 90
"""Solved poses for a surrogate of degree 6; with fewer, poses on the way to each are solved too."""
_SHARES = (0.35, 0.7)
_FEW = 20
"""Below so many, poses near rest are solved too: a model of few far ones can be unstable there."""
_NEAR_LENGTHS, _NEAR_RAD = 0.03, 0.15
_ENERGY4 = 12
"""Pairs from which on the controller gets an energy; with fewer it gets a linear map."""
_SYMMETRY: Literal["revolution"] = "revolution"


@dataclass(frozen=True)
class Surrogate:
    """An energy model by its numbers, so that it can be sent to another process."""

    length_m: float
    degree: int
    scale: F
    coefficients: F
    rms: F
    """Of its wrench against the FEM poses that it was fitted to, (6,)."""

    def model(self) -> EnergyModel:
        """The model itself."""
        return EnergyModel.from_coefficients(
            length_m=self.length_m,
            degree=self.degree,
            symmetry=_SYMMETRY,
            scale=self.scale,
            coefficients=self.coefficients,
        )


def fem_pairs(
    source: Source, anchors: Anchors, folder: Path | None, progress: Progress
) -> tuple[F, F]:
    """Poses and wrenches (N, 6): the solved anchors, and points on the way where they are few."""
    solved = np.asarray([s == "solved" for s in anchors.status])
    moving = solved & (np.linalg.norm(anchors.wrenches, axis=1) > 0.0)
    poses, wrenches = anchors.poses[moving], anchors.wrenches[moving]
    if len(poses) >= ENOUGH:
        return poses, wrenches
    rest = anchors.poses[0]
    between = np.concatenate([rest + share * (poses - rest) for share in _SHARES])
    if len(poses) < _FEW:
        between = np.concatenate([between, rest + _near(float(rest[0]))])
    more = solve_cached(source, between, UNIFORM, folder, progress)
    kept = np.asarray([s == "solved" for s in more.status])
    return (
        np.concatenate([poses, more.poses[kept]]),
        np.concatenate([wrenches, more.wrenches[kept]]),
    )


def _near(length_m: float) -> F:
    """(12, 6) small steps from rest along each axis, both ways."""
    size = np.repeat([_NEAR_LENGTHS * length_m, _NEAR_RAD], 3)
    return np.concatenate([np.diag(size), -np.diag(size)])


def surrogate(poses: F, wrenches: F, length_m: float) -> Surrogate:
    """Fitted to FEM pairs.

    Raises
    ------
    InputError
        Where they are too few to fix even degree 4.
    """
    degree = 6 if len(poses) >= 60 else 4
    if len(poses) < 6:
        raise InputError(
            f"the plan has {len(poses)} solved poses and points between; the mechanism at 1 kHz "
            "needs 6 or more. Add poses to the plan"
        )
    fitted = EnergyModel.fit(poses, wrenches, length_m=length_m, degree=degree, symmetry=_SYMMETRY)
    rms = np.sqrt(((fitted.predict(poses) - wrenches) ** 2).mean(axis=0))
    return Surrogate(length_m, degree, fitted.scale, fitted.coefficients, rms)


def controller_model(path: str, poses: F, wrenches: F, length_m: float) -> str:
    """What the controller believes, sealed: a model file, or energy4 fitted to FEM pairs.

    Raises
    ------
    InputError
        Where a model file cannot be read, or its effects change the mechanism: the controller
        runs its base alone.
    """
    if path:
        return _read(Path(path))
    if len(poses) >= _ENERGY4:
        fitted = EnergyModel.fit(poses, wrenches, length_m=length_m, degree=4)
        return seal_model(json.dumps(fitted.document()))
    linear = PolynomialModel.fit(poses, wrenches, 1)
    return seal_model(json.dumps(linear.document(POSE, WRENCH)))


def _read(path: Path) -> str:
    try:
        text = path.read_text(encoding="utf-8")
        document = open_model(text)
    except (OSError, UnicodeDecodeError, ModelError) as error:
        raise InputError(f"[rig] controller_model = {path}: {error}") from None
    acting = [item["id"] for item in document["effects"] or () if item.get("side") == "physics"]
    if acting:
        raise InputError(
            f"[rig] controller_model = {path}: it holds {', '.join(acting)}, and the arm's "
            "controller runs the base of a model alone; remove them (ecm refit --remove), or name "
            "the model before them"
        )
    return text
