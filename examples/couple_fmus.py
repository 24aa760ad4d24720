"""Two exported mechanisms carry one platform: FMUs coupled by Newton's method, without Modelica.

    ecm export a.json --to fmu --out out/a --name first
    ecm export b.json --to fmu --out out/b --name second
    python examples/couple_fmus.py out/a/first_fmi3.fmu out/b/second_fmi3.fmu

The load on the platform grows to 2 N downwards and 0.2 N m in a second and then stays. At each step
the pose is sought at which both wrenches together hold the load: K of each FMU is its directional
derivative, and a state that was read before the step is set again before each trial. Needs FMPy.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
from fmpy import extract, read_model_description
from fmpy.fmi3 import FMU3Slave

POSE = ("x_m", "y_m", "z_m", "theta_x_rad", "theta_y_rad", "theta_z_rad")
WRENCH = ("fx_N", "fy_N", "fz_N", "tau_x_Nm", "tau_y_Nm", "tau_z_Nm")
STEP_S = 0.02


class Mechanism:
    """One FMU."""

    def __init__(self, file: str) -> None:
        description = read_model_description(file)
        known = {item.name: item for item in description.modelVariables}
        self.pose = [known[name].valueReference for name in POSE]
        self.wrench = [known[name].valueReference for name in WRENCH]
        self.start = np.array([float(known[name].start) for name in POSE])
        self.fmu: Any = FMU3Slave(
            guid=description.guid,
            unzipDirectory=extract(file),
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName=description.modelName,
        )
        self.fmu.instantiate()
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()

    def tried(self, state: Any, time: float, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Wrench and K after a step from `state` to a pose."""
        self.fmu.setFMUState(state)
        self.fmu.setFloat64(self.pose, pose.tolist())
        self.fmu.doStep(time, STEP_S)
        columns = [
            self.fmu.getDirectionalDerivative(self.wrench, self.pose, seed.tolist())
            for seed in np.eye(6)
        ]
        return np.array(self.fmu.getFloat64(self.wrench)), np.array(columns).T


def coupled(files: list[str], seconds: float = 3.0) -> tuple[np.ndarray, float]:
    """(N, 6) poses of the platform, and the largest part of the load that is not held."""
    mechanisms = [Mechanism(file) for file in files]
    pose, found, worst = mechanisms[0].start.copy(), [], 0.0
    for n in range(round(seconds / STEP_S)):
        grown = min(1.0, n * STEP_S)
        load = grown * np.array([0.0, -2.0, 0.0, 0.0, 0.0, 0.2])
        states = [one.fmu.getFMUState() for one in mechanisms]
        for _ in range(20):
            both = [
                one.tried(state, n * STEP_S, pose)
                for one, state in zip(mechanisms, states, strict=True)
            ]
            missing = load - sum(h for h, _ in both)
            if np.abs(missing).max() < 1e-9:
                break
            pose = pose + np.linalg.solve(sum(k for _, k in both), missing)
        worst = max(worst, float(np.abs(missing).max()))
        for one, state in zip(mechanisms, states, strict=True):
            one.fmu.freeFMUState(state)
        found.append(pose)
    return np.array(found), worst


if __name__ == "__main__":
    poses, rest = coupled(sys.argv[1:])
    for at in range(0, len(poses), 25):
        print(
            f"{at * STEP_S:4.1f} s  y {1e3 * poses[at, 1]:7.3f} mm  theta_z {poses[at, 5]:7.4f} rad"
        )
    print(f"load held to {rest:.1g} N and N m")
