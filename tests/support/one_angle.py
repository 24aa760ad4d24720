"""One angle and one torque over time, with physics written by other formulas than the effects'."""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp

from ecm.io.arrays import F
from ecm.io.table import Table

NOISE_NM = 0.01
META = {"instrument": {"torque_sd_Nm": NOISE_NM, "pose_rotation_sd_rad": 1e-5}}


def spring(angle: F) -> F:
    """A cubic spring, N m."""
    return 2.0 * angle + 1.5 * angle**3


def cycles(rows: int = 400) -> tuple[F, F]:
    """Times in s and angles in rad: four cycles of different sizes."""
    time = 0.25 * np.arange(rows)
    phase = 8.0 * np.pi * time / time[-1]
    return time, 0.5 * (0.6 + 0.4 * np.sin(0.37 * phase + 0.3)) * np.sin(phase)


def one_angle(kind: str, seed: int = 0) -> Table:  # noqa: PLR0912 - one branch an effect
    """Four cycles of a spring with one effect; the id of the effect, or "" for none."""
    time, angle = cycles()
    columns: dict[str, F] = {}
    torque = spring(angle)
    if kind == "hysteresis":
        torque = torque + 0.04 * bouc_wen(angle, 0.03)
    elif kind == "hysteresis:behind a play":
        torque = torque + 0.1 * _behind_a_play(angle, 0.06, 0.01)
    elif kind == "backlash":
        torque = spring(prandtl_play(angle, 0.015))
    elif kind == "stress_relaxation":
        torque = torque + _standard_linear_solid(time, angle)
    elif kind == "viscous_damping":
        late = 2.0 + (time - 60.0) / 7.0
        angle = 0.5 * np.sin(2.0 * np.pi * np.where(time < 60.0, time / 30.0, late))
        torque = spring(angle) + 0.3 * np.tanh(np.gradient(angle, time) / 2.0)
    elif kind == "kink":
        torque = torque + 0.03 * np.logaddexp(0.0, (angle - 0.2) / 0.01)
    elif kind == "dead_zone":
        torque = 2.5 * angle - 0.15 * np.tanh(angle / 0.1)
    elif kind == "higher_degree":
        torque = torque + 0.2 * np.sin(9.0 * angle)
    elif kind == "mullins_softening":
        angle = (0.15 + 0.35 * time / time[-1]) * np.sin(16.0 * np.pi * time / time[-1])
        damage = 1.0 - np.exp(-(np.maximum.accumulate(angle**2) - angle**2) / 0.02)
        torque = spring(angle) * (1.0 - 0.12 * damage)
    elif kind == "temperature_modulus":
        columns["temperature_degC"] = 22.0 + 2.0 * np.sin(time / 3.0)
        torque = torque * np.exp(-0.02 * (columns["temperature_degC"] - 22.0))
    elif kind == "fts_drift":
        torque = torque + 0.05 * -np.expm1(-time / 200.0)
    elif kind == "fts_offset":
        columns["run"] = (time > 50.0).astype(np.float64)
        torque = torque + 0.03 * columns["run"]
    elif kind == "jump":
        torque = torque - 0.03 * (time > 61.1)
    elif kind == "jump:clamp":
        torque = spring(np.where(time > 41.3, angle - 0.01, angle))
    elif kind == "unused_column:slider_mm":
        columns["slider_mm"] = np.repeat([0.0, 10.0, 20.0, 5.0], 100)
        torque = torque * (1.0 + 0.004 * columns["slider_mm"])
    elif kind:
        raise ValueError(kind)
    torque = torque + NOISE_NM * np.random.default_rng(seed).standard_normal(len(time))
    return Table({"theta_z_rad": angle, "tau_z_Nm": torque, "time_s": time} | columns, META, kind)


def bouc_wen(path: F, yield_rad: float) -> F:
    """z' = x' (1 - (b sign(x' z) + g) |z|) in 10 steps between readings, b = g = 1/2."""
    state, states = 0.0, [0.0]
    for step in np.diff(path) / yield_rad:
        for part in np.full(10, step / 10.0):
            state += part * (1.0 - (0.5 * np.sign(part * state) + 0.5) * abs(state))
        states.append(state)
    return np.array(states)


def _behind_a_play(path: F, width: float, soft: float) -> F:
    """A brake behind a pin in a wider hole: the pin is free over twice the width, then its contact
    hardens, and the brake begins to creep before it slips; 20 steps between readings."""

    def contact(away: float) -> float:
        return float(np.sign(away) * -np.expm1(-max(abs(away) - width, 0.0) / soft))

    away, states = 0.0, [0.0]
    for step in np.diff(path):
        for part in np.full(20, step / 20.0):
            touch = contact(away)
            away += part * (1.0 - touch**4 if touch * part > 0.0 else 1.0)
        states.append(contact(away))
    return np.array(states)


def prandtl_play(path: F, width: float) -> F:
    """Prandtl's play operator."""
    state, states = 0.0, []
    for value in path:
        state = min(max(state, value - width), value + width)
        states.append(state)
    return np.array(states)


def _standard_linear_solid(time: F, path: F) -> F:
    """A Maxwell branch of 0.4 times the spring with 6 s: its dashpot is an ordinary differential
    equation."""

    def dashpot(t: float, y: F) -> F:
        return (0.4 * spring(np.interp([t], time, path)) - y) / 6.0

    solved = solve_ivp(dashpot, (0.0, time[-1]), [0.0], t_eval=time, max_step=0.5)
    return np.asarray(0.4 * spring(path) - solved.y[0])
