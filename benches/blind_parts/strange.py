"""Five effects that no catalogue has, as wrenches on the rows of a table."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ecm.io.table import Table

F = NDArray[np.float64]
Law = Callable[[Table, np.random.Generator], F]
_ARM = np.array([1.0, 1.0, 1.0, 0.033, 0.033, 0.033])


def magnet(table: Table, random: np.random.Generator) -> F:
    """Attraction to a point, falling with the cube of the distance."""
    azimuth = random.uniform(0.0, 2.0 * np.pi)
    place = np.array(
        [table.poses[:, 0].max() + 0.02, 0.05 * np.cos(azimuth), 0.05 * np.sin(azimuth)]
    )
    way = place - table.poses[:, :3]
    distance = np.linalg.norm(way, axis=1, keepdims=True)
    force = way / distance * (0.05 / distance) ** 3
    return np.concatenate([force, np.zeros_like(force)], axis=1)


def mains_beat(table: Table, random: np.random.Generator) -> F:
    """A disturbance that beats with the sampling: a wave in time of some minutes."""
    period, phase = random.uniform(500.0, 1200.0), random.uniform(0.0, 6.28)
    wave = np.sin(2.0 * np.pi * table.column("time_s") / period + phase)
    return np.outer(wave, random.standard_normal(6) * _ARM)


def three_fold(table: Table, random: np.random.Generator) -> F:
    """A body with three ribs: radial force in the third harmonic of the azimuth."""
    y, z = table.poses[:, 1:3].T
    radius, azimuth = np.hypot(y, z), np.arctan2(z, y)
    size = radius**2 * np.cos(3.0 * azimuth + random.uniform(0.0, 6.28))
    out = np.zeros((len(y), 6))
    out[:, 1], out[:, 2] = size * np.cos(azimuth), size * np.sin(azimuth)
    return out


def remembered_pose(table: Table, random: np.random.Generator) -> F:
    """A share of the wrench at the visit before, whatever was done in between."""
    before = np.roll(table.wrenches, 1, axis=0)
    before[0] = 0.0
    mix = random.standard_normal((6, 6))
    return before @ (_ARM[:, None] * mix / _ARM).T


def gear_ripple(table: Table, random: np.random.Generator) -> F:
    """A wave in one direction of space, some millimetres long, on the torque about it."""
    direction = random.standard_normal(3)
    direction /= np.linalg.norm(direction)
    along = (table.poses[:, :3] - table.poses[:, :3].mean(axis=0)) @ direction
    wave = np.sin(2.0 * np.pi * along / random.uniform(0.008, 0.015))
    return np.outer(wave, np.concatenate([direction, 0.033 * random.standard_normal(3)]))


STRANGE: dict[str, Law] = {
    "magnet": magnet,
    "mains_beat": mains_beat,
    "three_fold": three_fold,
    "remembered_pose": remembered_pose,
    "gear_ripple": gear_ripple,
}


def smooth_misfit(table: Table, random: np.random.Generator) -> F:
    """A smooth error of the base itself: random quadratics and cubics of the pose."""
    poses = table.poses
    u = (poses - poses.mean(axis=0)) / np.maximum(poses.std(axis=0), 1e-12)
    features = [u[:, i] * u[:, j] for i in range(6) for j in range(i, 6)]
    features += [u[:, i] ** 3 for i in range(6)]
    block = np.stack(features, axis=1)
    return np.asarray(block @ random.standard_normal((block.shape[1], 6)) * _ARM)
