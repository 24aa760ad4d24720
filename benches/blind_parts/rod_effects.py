"""What can be hidden in the rod: mechanism, its history, its mount, loads.

Each draw returns a first size and the physics at a size. Formulas are those of a text book other
than the catalogue's: Bouc-Wen a component, hereditary integrals over the whole path, Ogden-like
stiffening, contact with friction.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from blind_parts.rod import cross, turn, turn_back
from blind_parts.rod_state import Physics, RodState
from blind_parts.rod_visits import Visits

F = NDArray[np.float64]
Made = tuple[float, Callable[[float], Physics]]
Draw = Callable[[np.random.Generator, RodState], Made]
G = np.array([-9.81, 0.0, 0.0])


def _sign(random: np.random.Generator) -> float:
    return float(random.choice([-1.0, 1.0]))


def _unit(random: np.random.Generator, n: int) -> F:
    v = random.uniform(0.4, 1.0, n) * random.choice([-1.0, 1.0], n)
    return np.asarray(v / np.linalg.norm(v))


def _section(first: float, **names: Callable[[float], object]) -> Made:
    return first, lambda size: Physics({name: make(size) for name, make in names.items()})


def _factor(first: float, law: Callable[[float, Visits], F]) -> Made:
    def physics(size: float) -> Physics:
        return Physics(wrench=[lambda h, p, c: h * law(size, c)[:, None]])

    return first, physics


# --- body ---------------------------------------------------------------------------------------
def anisotropy(random: np.random.Generator, rod_state: RodState) -> Made:
    """Second moments of area that differ about two axes."""
    angle = float(random.uniform(0.0, np.pi))
    return _section(0.02, uneven=lambda s: s, uneven_angle_rad=lambda s: angle)


def strain_stiffening(random: np.random.Generator, rod_state: RodState) -> Made:
    return _section(0.1, hardening=lambda s: s)


def _of_either_sign(first: float, name: str) -> Draw:
    """A property of the section that may be larger or smaller."""

    def draw(random: np.random.Generator, rod_state: RodState) -> Made:
        sign = _sign(random)
        return _section(first, **{name: lambda s: sign * s})

    return draw


def face_tilt(random: np.random.Generator, rod_state: RodState) -> Made:
    a = float(random.uniform(0.0, 2.0 * np.pi))
    return _section(2e-3, face_tilt=lambda s: (s * np.cos(a), s * np.sin(a)))


def pre_curvature(random: np.random.Generator, rod_state: RodState) -> Made:
    a = float(random.uniform(0.0, 2.0 * np.pi))
    return _section(0.02, curvature=lambda s: (s * np.cos(a), s * np.sin(a)))


def base_compliance(random: np.random.Generator, rod_state: RodState) -> Made:
    shares = random.uniform([0.1, 0.8, 0.8], [0.4, 1.2, 1.2])
    give = random.uniform([0.0, 0.02, 0.02], [0.01, 0.06, 0.06]) * rod_state.section.length_m**2
    return _section(
        5e-4, base_turn=lambda s: tuple(s * shares), base_give=lambda s: tuple(s * give)
    )


def own_weight(random: np.random.Generator, rod_state: RodState) -> Made:
    return _section(0.3, weight_N_m=lambda s: (-9.81 * s / rod_state.section.length_m, 0.0, 0.0))


def debonding(random: np.random.Generator, rod_state: RodState) -> Made:
    """The bond lifts off in tension: softer on one side."""
    return _section(0.05, lift_off=lambda s: s)


# --- history ------------------------------------------------------------------------------------
def temperature_modulus(random: np.random.Generator, rod_state: RodState) -> Made:
    """Williams, Landel and Ferry: a shift of the modulus, bent in T."""
    mean = float(rod_state.first.temperature_degC.mean())

    def law(size: float, c: Visits) -> F:
        change = c.temperature_degC - mean
        return np.asarray(np.exp(-size * 60.0 * change / (60.0 + change)))

    return _factor(0.01, law)


def ageing(random: np.random.Generator, rod_state: RodState) -> Made:
    end = float(rod_state.first.time_s[-1]) * float(random.uniform(0.5, 1.5))
    sign = _sign(random)
    return _factor(0.02, lambda size, c: 1.0 - sign * size * np.expm1(-c.time_s / end))


def stress_relaxation(random: np.random.Generator, rod_state: RodState) -> Made:
    """Generalised Maxwell: the hereditary integral over the whole path, home and back included."""
    taus = np.array([1.2, 9.0, 70.0]) * random.uniform(0.7, 1.4, 3)
    shares = random.dirichlet([4.0, 4.0, 4.0])

    def held(h: F, c: Visits) -> F:
        state, here = np.zeros((3, 6)), np.zeros(6)
        out = np.zeros_like(h)
        for i, way in enumerate(c.ways):
            if c.rested[i]:
                state, here = np.zeros((3, 6)), np.zeros(6)
            for goal, travel, rest in way:
                target = np.zeros(6) if goal < 0 else h[goal]
                fade = np.exp(-travel / taus)[:, None]
                ramp = (taus / travel)[:, None] * (1.0 - fade) * (target - here)
                state = (state * fade + ramp) * np.exp(-rest / taus)[:, None]
                here = target
            out[i] = shares @ state
        return out

    return 0.05, lambda size: Physics(wrench=[lambda h, p, c: h + size * held(h, c)])


def hysteresis(random: np.random.Generator, rod_state: RodState) -> Made:
    """Bouc-Wen, each coordinate by itself, along the way from pose to pose."""
    length = rod_state.section.length_m
    reach = float(random.uniform(0.02, 0.05)) * length
    power = float(random.uniform(1.0, 2.0))
    metric = np.array([1.0, 1.0, 1.0, length, length, length])

    def states(c: Visits) -> F:
        z, here = np.zeros(6), c.rest
        out = np.zeros((len(c.poses), 6))
        for i, way in enumerate(c.ways):
            if c.rested[i]:
                z, here = np.zeros(6), c.rest
            for goal, _, _ in way:
                target = c.rest if goal < 0 else c.poses[goal]
                dx = (target - here) * metric / reach
                steps = int(np.clip(np.ceil(np.abs(dx).max() / 0.2), 1, 80))
                for _ in range(steps):
                    part = dx / steps
                    rate = part - np.abs(z) ** power * (
                        0.6 * np.sign(z) * np.abs(part) + 0.4 * part
                    )
                    z = np.clip(z + rate, -1.0, 1.0)
                here = target
            out[i] = z
        return out

    kept = states(rod_state.visits)
    s = rod_state.section
    stiffness = np.array(
        [s.axial_N, 0.2 * s.shear_N, 0.2 * s.shear_N, s.torsion_Nm2, s.bending_Nm2, s.bending_Nm2]
    ) / np.array([length] * 3 + [length] * 3)

    def physics(size: float) -> Physics:
        return Physics(wrench=[lambda h, p, c: h + size * kept * stiffness / metric])

    return 1e-4, physics


def mullins_softening(random: np.random.Generator, rod_state: RodState) -> Made:
    """Softer below the largest bend so far: a hyperbolic tangent of what is lacking to it."""
    bend = np.linalg.norm(rod_state.visits.poses[:, 3:], axis=1)
    bend = np.where(rod_state.loaded, bend, 0.0)
    largest = np.maximum.accumulate(bend)
    first = len(rod_state.first.poses)
    width = float(random.uniform(0.2, 0.5)) * float(largest[:first].max())
    return _factor(0.03, lambda size, c: 1.0 - size * np.tanh((largest - bend) / width))


def permanent_set(random: np.random.Generator, rod_state: RodState) -> Made:
    """Creep that stays: the rest pose follows each large pose a little."""
    visits = rod_state.visits
    length = visits.rest[0]
    metric = np.array([1.0, 1.0, 1.0, length, length, length])
    away = (visits.poses - visits.rest) * rod_state.loaded[:, None]
    far = np.linalg.norm(away * metric, axis=1)
    first = len(rod_state.first.poses)
    limit = float(np.quantile(far[:first][rod_state.loaded[:first]], random.uniform(0.6, 0.8)))
    flow = np.maximum(0.0, 1.0 - limit / np.maximum(far, 1e-12))[:, None] * away
    total = np.cumsum(flow, axis=0)
    total = np.concatenate([np.zeros((1, 6)), total[:-1]])
    total /= max(float(np.abs((total * metric)[:first]).max()), 1e-12)
    return 1e-4, lambda size: Physics(felt=[lambda p, _, c: p - size * total])


def platform_slip(random: np.random.Generator, rod_state: RodState) -> Made:
    at = float(random.uniform(0.3, 0.7)) * float(rod_state.first.time_s[-1])
    direction = _unit(random, 6) * np.repeat([1.0, 10.0], 3)

    def physics(size: float) -> Physics:
        def felt(p: F, _: F, c: Visits) -> F:
            jump = size * direction * (c.time_s > at)[:, None]
            matrices = turn(p[:, 3:])
            place = p[:, :3] + np.einsum("nij,nj->ni", matrices, jump[:, :3])
            return np.concatenate([place, turn_back(matrices @ turn(jump[:, 3:]))], axis=1)

        return Physics(felt=[felt])

    return 1e-4, physics


# --- surroundings -------------------------------------------------------------------------------
def contact_stop(random: np.random.Generator, rod_state: RodState) -> Made:
    """A ring that the platform's rim meets beyond a tilt: a true kink, with Coulomb friction."""
    poses = rod_state.first.poses
    tilt = np.linalg.norm(poses[:, 4:], axis=1)
    limit = float(np.quantile(tilt[rod_state.first.loaded], random.uniform(0.5, 0.75)))
    friction, radius = float(random.uniform(0.1, 0.3)), 0.033

    def physics(size: float) -> Physics:
        def push(h: F, p: F, c: Visits) -> F:
            angle = np.linalg.norm(p[:, 4:], axis=1)
            depth = radius * np.maximum(0.0, angle - limit)
            side = np.zeros_like(p[:, :3])
            side[:, 1:] = p[:, 4:] / np.maximum(angle, 1e-12)[:, None]
            # The rim that goes down: a quarter turn about x from the axis of tilt.
            arm = np.stack([np.zeros(len(p)), side[:, 2], -side[:, 1]], axis=1)
            normal = size * depth
            # The ring pushes the rim up along x; the sensor must hold against it.
            force = np.zeros_like(side)
            force[:, 0] = -normal * np.where(c.loaded, 1.0, 0.0)
            force += friction * force[:, :1] * arm
            down = radius * arm * np.array([1.0, 1.0, 1.0])
            return np.concatenate([force, cross(down, force)], axis=1)

        return Physics(load=[push])

    return 2000.0, physics


def payload(random: np.random.Generator, rod_state: RodState) -> Made:
    centre = random.uniform([0.01, -0.02, -0.02], [0.06, 0.02, 0.02])

    def physics(size: float) -> Physics:
        def weight(h: F, p: F, c: Visits) -> F:
            force = np.tile(-size * G, (len(p), 1)) * c.planned.payload_on[:, None]
            arm = np.einsum("nij,j->ni", turn(p[:, 3:]), centre)
            return np.concatenate([force, cross(arm, force)], axis=1)

        return Physics(load=[weight])

    return 0.1, physics


def cable_drag(random: np.random.Generator, rod_state: RodState) -> Made:
    """A cable: its hanging weight, and a pull that grows with the square of its stretch."""
    azimuth = float(random.uniform(0.0, 2.0 * np.pi))
    away = np.array([0.05, 0.25 * np.cos(azimuth), 0.25 * np.sin(azimuth)])
    arm_top = np.array([0.01, 0.03 * np.cos(azimuth), 0.03 * np.sin(azimuth)])
    free = 0.9 * float(np.linalg.norm(away - arm_top))
    heavy = float(random.uniform(0.005, 0.02))

    def physics(size: float) -> Physics:
        def pull(h: F, p: F, c: Visits) -> F:
            arm = np.einsum("nij,j->ni", turn(p[:, 3:]), arm_top)
            way = c.rest[:3] + away - (p[:, :3] + arm)
            long = np.linalg.norm(way, axis=1, keepdims=True)
            stretch = np.maximum(0.0, long - free)
            tension = size * (0.2 * stretch + stretch**2 / free)
            force = -tension * way / long - size * heavy * free * G / 9.81
            return np.concatenate([force, cross(arm, force)], axis=1)

        return Physics(load=[pull])

    return 50.0, physics


BODY: dict[str, Draw] = {
    "anisotropy": anisotropy,
    "strain_stiffening": strain_stiffening,
    "compressibility": _of_either_sign(0.02, "twist_share"),
    "pretension": _of_either_sign(1e-3, "free_stretch"),
    "taper": _of_either_sign(0.02, "taper"),
    "length_error": _of_either_sign(1e-4, "base_shift_m"),
    "diameter_error": _of_either_sign(0.01, "thicker"),
    "face_tilt": face_tilt,
    "pre_curvature": pre_curvature,
    "base_compliance": base_compliance,
    "own_weight": own_weight,
    "debonding": debonding,
    "temperature_modulus": temperature_modulus,
    "ageing": ageing,
    "stress_relaxation": stress_relaxation,
    "hysteresis": hysteresis,
    "mullins_softening": mullins_softening,
    "permanent_set": permanent_set,
    "platform_slip": platform_slip,
    "contact_stop": contact_stop,
    "payload": payload,
    "cable_drag": cable_drag,
}
