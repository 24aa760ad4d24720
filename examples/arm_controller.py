"""Hold the tip of a soft arm at 1 kHz through valves, by its exported model and by a linear one.

    python examples/arm_controller.py

The arm of wound_arm.toml carries 10 g on its tip, and from 3 s on 10 g more. In half a second its
tip goes 7 mm up and 4 mm to the side, and is to stay there. Each millisecond the controller reads
the pose (noise of 20 um and 0.2 mrad) and the pressures, and sets three pressures, which valves
follow with a lag of first order of 50 Hz. It is the same controller with two models:

    w <- w + (h(p, a) - w) dt / T              the load on the tip, by the model
    theta, u <- those of h(r_d, theta, u) = w  one step of Newton's method, with K and G

exact: the energy of degree 4 of 60 rows of wound_arm_pairs.csv, exported to C. linear: its slopes
at rest. Without reading the pose w is the weight of the tip, which is known. The plant is another
model, of degree 5 and of other rows (wound_arm_other.csv), with the inertia of the tip and a
damping of the wall. Needs a C compiler.
"""

from __future__ import annotations

import argparse
import ctypes
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

import ecm
from ecm.io.se3 import rotation, rotation_vector

HERE = Path(__file__).parent
REST = np.array([0.1, 0.0, 0.0, 0.0, 0.0, 0.0])
TIP_KG, PAYLOAD_KG, INERTIA_KG_M2 = 0.01, 0.01, 2e-6
DAMPING_S = 4e-3
"""Damping of the wall over its stiffness at rest."""
VALVE_HZ, MOST_PA = 50.0, 4e4
DT_S, SUBSTEPS = 1e-3, 10
LOADED_S, END_S = 3.0, 6.0
OBSERVER_S = 0.3
READING_SD = np.repeat([20e-6, 2e-4], 3)
TARGET_M = np.array([0.1022, 0.0036, 0.0036])
Model = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


def exported(rows: str, name: str, count: int | None, folder: Path) -> Model:
    """h (6,) and [K | G] (6, 9) of a row (9,), by the C of a model fitted to rows of a table."""
    table = ecm.read_table(HERE / rows)
    table = table if count is None else table.select(np.arange(count))
    ecm.export(ecm.fit(table, name), "c", folder, name=name)
    source, library = folder / f"{name}.c", folder / f"{name}.so"
    subprocess.run(["cc", "-O2", "-shared", "-fPIC", source, "-o", library], check=True)
    function = ctypes.CDLL(str(library))[f"{name}_value_and_stiffness"]

    def model(row: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        given, h, k = np.ascontiguousarray(row), np.empty(6), np.empty((6, 9))
        function(*(ctypes.c_void_p(array.ctypes.data) for array in (given, h, k)))
        return h, k

    return model


def linear(model: Model) -> Model:
    """The same with the wrench and the slopes at rest."""
    rest = np.concatenate([REST, np.zeros(3)])
    h, k = model(rest)
    return lambda row: (h + k @ (row - rest), k)


class Controller:
    """Pressures that hold the tip at a place, by a model."""

    def __init__(self, model: Model, *, reads_pose: bool) -> None:
        self.model, self.reads_pose = model, reads_pose
        self.load = weight(TIP_KG)
        self.theta, self.pressures = np.zeros(3), np.zeros(3)

    def step(self, place: np.ndarray, pose: np.ndarray, pressures: np.ndarray) -> np.ndarray:
        """(3,) pressures to set, Pa, for a place (3,) and what is read."""
        if self.reads_pose:
            h, _ = self.model(np.concatenate([pose, pressures]))
            self.load = self.load + (h - self.load) * DT_S / OBSERVER_S
        h, k = self.model(np.concatenate([place, self.theta, self.pressures]))
        change = np.linalg.solve(k[:, 3:], self.load - h)
        self.theta = self.theta + change[:3]
        self.pressures = np.clip(self.pressures + change[3:], 0.0, MOST_PA)
        return self.pressures


def weight(mass_kg: float) -> np.ndarray:
    """(6,) wrench on the platform; z is up."""
    return np.array([0.0, 0.0, -9.81 * mass_kg, 0.0, 0.0, 0.0])


def settled(plant: Model, load: np.ndarray) -> np.ndarray:
    """(6,) pose of the arm without pressure under a load."""
    pose = REST.copy()
    for _ in range(20):
        h, k = plant(np.concatenate([pose, np.zeros(3)]))
        pose = pose + np.linalg.solve(k[:, :6], load - h)
    return pose


def run(plant: Model, controller: Controller, seed: int = 0) -> np.ndarray:
    """(N,) distance of the tip from where it is to be at each millisecond, m."""
    random = np.random.default_rng(seed)
    damping = DAMPING_S * plant(np.concatenate([REST, np.zeros(3)]))[1][:, :6]
    pose, pressures = settled(plant, weight(TIP_KG)), np.zeros(3)
    turn, twist, start = rotation(pose[None, 3:])[0], np.zeros(6), pose[:3].copy()
    away, dt = [], DT_S / SUBSTEPS
    follows = 1.0 - np.exp(-dt * 2.0 * np.pi * VALVE_HZ)
    for step in range(int(END_S / DT_S)):
        mass = TIP_KG + (PAYLOAD_KG if step * DT_S >= LOADED_S else 0.0)
        inertia = np.repeat([mass, INERTIA_KG_M2], 3)
        share = min(1.0, step * DT_S / 0.5)  # the place moves there in half a second
        place = start + (TARGET_M - start) * share**2 * (3.0 - 2.0 * share)
        away.append(np.linalg.norm(pose[:3] - place))
        read = pose + READING_SD * random.standard_normal(6)
        command = controller.step(place, read, pressures)
        for _ in range(SUBSTEPS):
            pressures = pressures + (command - pressures) * follows
            h, _ = plant(np.concatenate([pose, pressures]))
            twist = twist + dt * (weight(mass) - h - damping @ twist) / inertia
            turn = rotation(dt * twist[None, 3:])[0] @ turn
            pose = np.concatenate([pose[:3] + dt * twist[:3], rotation_vector(turn[None])[0]])
    return np.array(away)


def main() -> None:
    argparse.ArgumentParser(description=__doc__).parse_args()
    with tempfile.TemporaryDirectory() as folder:
        plant = exported("wound_arm_other.csv", "actuated5", None, Path(folder))
        exact = exported("wound_arm_pairs.csv", "actuated4", 60, Path(folder))
        print("| distance in mm | moving, largest | settled | payload, 0.5 s after | settled |")
        print("|---|---|---|---|---|")
        for words, reads_pose in (("without reading the pose", False), ("reads the pose", True)):
            for kind, model in (("linear", linear(exact)), ("exact", exact)):
                away = 1e3 * run(plant, Controller(model, reads_pose=reads_pose))
                begin = round(LOADED_S / DT_S)
                before, after = away[:begin], away[begin:]
                numbers = (before[:1000].max(), _rms(before[-200:]), after[500], _rms(after[-200:]))
                print(f"| {kind}, {words} | {' | '.join(f'{x:.2f}' for x in numbers)} |")


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt((values**2).mean()))


if __name__ == "__main__":
    main()
