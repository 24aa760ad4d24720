"""OpenSim loads the bushing and evaluates it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import opensim

from ecm.models.export.simulators import deflections
from ecm.models.measured_poses import noise_sd, poses_like_measured
from support.exports import fitted, written


def run(folder: Path) -> Iterator[str]:
    """Lines of results."""
    fit = fitted("energy6")
    written(fit, folder, "opensim")
    model = opensim.Model(str(folder / "neck.osim"))
    state = model.initSystem()
    force = opensim.ExpressionBasedBushingForce.safeDownCast(model.getForceSet().get("neck"))
    joint = model.getJointSet().get(0)
    coordinates = [joint.get_coordinates(i) for i in (3, 4, 5, 0, 1, 2)]
    poses = poses_like_measured(fit, 1000)
    found = np.zeros((len(poses), 6))
    for row, at in zip(found, deflections(poses)[0].tolist(), strict=True):
        for coordinate, value in zip(coordinates, at, strict=True):
            coordinate.setValue(state, value, False)
        model.realizeDynamics(state)
        values = force.getRecordValues(state)
        row[:] = [-values.get(i) for i in range(6, 12)]  # on the platform
    error = found - fit.base.predict(poses)
    noise = np.sqrt((error**2).mean(axis=0)) / noise_sd(fit)
    if not noise.max() < 0.3:
        raise SystemExit(f"differs from the model by {noise} of the noise")
    yield f"{opensim.GetVersion()}: {len(poses)} poses, {noise.max():.2g} of the noise (rms, worst)"
