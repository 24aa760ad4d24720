"""The simulated mechanism at 1 kHz: an energy model fitted to FEM poses of the plan.

It is conservative by construction and has degree 6, or 4 if few poses are solved.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from ecm._native import EnergyModel
from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.rig.elastic import UNIFORM, Anchors, Progress, Source, solve_cached

_ENOUGH = 90
"""Solved poses for a surrogate; with fewer, poses on the way to each are solved too."""
_SHARES = (0.35, 0.7)
_FEW = 20
"""With fewer solved poses, poses near rest are solved too, or the model may be unstable there."""
_NEAR_LENGTHS, _NEAR_RAD = 0.03, 0.15
_SYMMETRY: Literal["revolution"] = "revolution"


@dataclass(frozen=True)
class Surrogate:
    """An energy model as plain numbers, which can be sent to another process."""

    length_m: float
    degree: int
    scale: F
    coefficients: F
    rms: F
    """Root mean square error of its wrench at the FEM poses that it was fitted to, (6,)."""

    def model(self) -> EnergyModel:
        """Return the energy model."""
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
    """Return poses and wrenches (N, 6): the solved anchors, and more poses if they are few."""
    solved = np.asarray([s == "solved" for s in anchors.status])
    loaded = solved & (np.linalg.norm(anchors.wrenches, axis=1) > 0.0)
    poses, wrenches = anchors.poses[loaded], anchors.wrenches[loaded]
    if len(poses) >= _ENOUGH:
        return poses, wrenches
    rest = anchors.poses[0]
    extra = [rest + share * (poses - rest) for share in _SHARES]
    if len(poses) < _FEW:
        steps = np.diag(np.repeat([_NEAR_LENGTHS * float(rest[0]), _NEAR_RAD], 3))
        extra += [rest + steps, rest - steps]
    more = solve_cached(source, np.concatenate(extra), UNIFORM, folder, progress)
    ok = np.asarray([s == "solved" for s in more.status])
    return np.concatenate([poses, more.poses[ok]]), np.concatenate([wrenches, more.wrenches[ok]])


def fit_surrogate(poses: F, wrenches: F, length_m: float) -> Surrogate:
    """Fit the surrogate to FEM pairs; InputError if there are too few of them."""
    degree = 6 if len(poses) >= 60 else 4
    if len(poses) < 6:
        raise InputError(
            f"the plan has {len(poses)} solved poses, those between included; the simulated "
            "mechanism needs 6 or more. Add poses to the plan"
        )
    model = EnergyModel.fit(poses, wrenches, length_m=length_m, degree=degree, symmetry=_SYMMETRY)
    rms = np.sqrt(((model.predict(poses) - wrenches) ** 2).mean(axis=0))
    return Surrogate(length_m, degree, model.scale, model.coefficients, rms)
