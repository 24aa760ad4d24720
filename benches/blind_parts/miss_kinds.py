"""The kinds of effects that held-out tests missed, each by a law of its own, on rods.

Stops, cables with slack, permanent set, debonding, length, hysteresis, a small effect beside a
larger one. Each law gives a wrench on the rows before noise, which a set scales to its strength.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from blind_parts.other_hidden import KNOWN, Law, Made
from blind_parts.rod import Rod, cross, turn

F = NDArray[np.float64]


def _moved(m: Made, motion: F) -> F:
    """The change of the wrench where the body's end, or its foot, has moved by so much."""
    section, held = m.body.section, m.at.held
    assert section is not None
    assert held is not None
    poses = m.poses - motion
    return Rod(section).solve(poses, np.zeros(len(poses)), held).wrench - m.wrenches


def _bumper(m: Made) -> F:
    """A rubber block under one side of the rim: a power of its depth, along its own direction."""
    azimuth = m.random.uniform(0.0, 2.0 * np.pi)
    rim = 0.3 * m.body.length_m * np.array([0.0, np.cos(azimuth), np.sin(azimuth)])
    arm = turn(m.poses[:, 3:]) @ rim
    height = m.poses[:, 0] + arm[:, 0]
    top = np.quantile(height, m.random.uniform(0.25, 0.5))
    depth = np.maximum(0.0, top - height)
    # It pushes the rim away from the base; the sensor must hold against it.
    force = np.zeros_like(arm)
    force[:, 0] = -(depth**1.5)
    return np.hstack([force, cross(arm, force)])


def _slack_cable(m: Made) -> F:
    """A cord from the platform to a post: nothing while it is slack, then a spring."""
    azimuth = m.random.uniform(0.0, 2.0 * np.pi)
    side = np.array([0.0, np.cos(azimuth), np.sin(azimuth)])
    post = m.body.length_m * (np.array([1.3, 0.0, 0.0]) + 1.5 * side)
    arm = turn(m.poses[:, 3:]) @ (0.25 * m.body.length_m * side)
    way = post - (m.poses[:, :3] + arm)
    long = np.linalg.norm(way, axis=1)
    taut = np.maximum(0.0, long - np.quantile(long, m.random.uniform(0.3, 0.5)))
    force = -(taut / long)[:, None] * way
    return np.hstack([force, cross(arm, force)])


def _permanent_set(m: Made) -> F:
    """Each pose pulls the rest pose after it by a share that saturates; the body is held there."""
    rest = np.r_[m.body.length_m, np.zeros(5)]
    away = m.poses - rest
    size = np.linalg.norm(away / np.where(away.std(axis=0) > 0.0, away.std(axis=0), 1.0), axis=1)
    flow = away * np.clip(size - np.quantile(size, 0.7), 0.0, None)[:, None] ** 2
    total = np.cumsum(np.vstack([np.zeros((1, 6)), flow[:-1]]), axis=0)
    return _moved(m, 0.002 * total / max(float(np.abs(total).max()), 1e-12))


def _debonding(m: Made) -> F:
    """A glued foot that opens under tension: it lifts, and tilts with the moment there."""
    force, moment = m.wrenches[:, :3], m.wrenches[:, 3:]
    at_foot = moment + cross(m.poses[:, :3], force)
    pull = np.maximum(0.0, force[:, 0] / np.sqrt((force[:, 0] ** 2).mean()))
    tilt = np.tanh(pull)[:, None] * at_foot / np.sqrt((at_foot**2).mean())
    foot = np.zeros_like(m.poses)
    foot[:, 0] = 1e-4 * pull
    foot[:, 4:] = 1e-3 * tilt[:, 1:]
    foot[:, :3] += cross(foot[:, 3:], m.poses[:, :3])
    return _moved(m, foot)


def _small_beside_larger(m: Made) -> F:
    """A payload, and a third of it a modulus that follows the temperature."""
    parts = [KNOWN[name][0](m) for name in ("payload", "temperature_modulus")]
    loads = np.sqrt((m.wrenches**2).mean(axis=0))
    sizes = [float(np.sqrt(((part / loads) ** 2).mean())) for part in parts]
    return parts[0] / sizes[0] + parts[1] / (3.0 * sizes[1])


def _softer_in_tension(m: Made) -> F:
    """A body whose stiffness falls in proportion to its tension."""
    pull = np.maximum(0.0, m.wrenches[:, :1]) / np.sqrt((m.wrenches[:, 0] ** 2).mean())
    return -0.05 * pull * m.wrenches


UNSAID = "hysteresis without `approach`"
"""The kind whose tables do not say from where each pose was reached."""
MISSES: dict[str, tuple[Law, tuple[str, ...]]] = {
    "stops and bumpers": (_bumper, ("contact_stop",)),
    "cables with slack": (_slack_cable, ("cable_drag",)),
    "permanent set": (_permanent_set, ("permanent_set",)),
    "debonding": (_debonding, ("debonding",)),
    "length": (KNOWN["length_error"][0], ("length_error",)),
    "hysteresis": (KNOWN["hysteresis"][0], ("hysteresis",)),
    "small beside larger": (_small_beside_larger, ("payload", "temperature_modulus")),
    UNSAID: (KNOWN["hysteresis"][0], ("hysteresis",)),
    "softer in tension": (_softer_in_tension, ("strain_stiffening",)),
}
"""Law of each kind, and the names that are right."""
