"""A control loop that holds a platform at a pose: its gains, its poles, its example code.

With the platform's mass matrix M in every gain, the loop falls apart into the modes of
M^-1 K_s v = lambda v, where K_s = K diag(I, J^-1) takes a small twist to a wrench. The error x of a
mode obeys x'' = -lambda x - u between samples, and u is held for a step dt, d steps late:

    u = w^2 (x + g S) + g lambda S + 2 w (x - x_before) / dt,    S = sum of x dt,    g = w / 4

Without delay and in small steps that is s^3 + 2 w s^2 + (lambda + w^2) (s + g): stable wherever
lambda > -w^2, also at poses where the mechanism by itself would buckle.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecm.errors import InputError
from ecm.io.arrays import B, F
from ecm.io.settings import Checked, setting

C = NDArray[np.complex128]


@dataclass(frozen=True)
class Gains:
    """Gains of the loop over M.

    Examples
    --------
    >>> loop = Gains(bandwidth_rad_s=60.0, dt_s=1e-3, delay_steps=3)
    >>> bool(loop.decay_per_s(np.array([2000.0]), np.array([2000.0]))[0] > 10.0)
    True
    """

    bandwidth_rad_s: float
    """w."""
    dt_s: float
    delay_steps: int
    """Steps between the reading of a pose and the moment from which its wrench acts."""
    factor: float = 1.0
    """On every gain: how far it may go is the gain margin."""

    @property
    def reset_per_s(self) -> float:
        """g."""
        return 0.25 * self.bandwidth_rad_s

    @property
    def noise_gain(self) -> float:
        """Noise of an acceleration u over that of the readings of x (1/s^2, rms).

        Independent readings x and x_before enter with w^2 (1 + g dt) + 2 w / dt and -2 w / dt.
        """
        w, rate = self.bandwidth_rad_s, 2.0 * self.bandwidth_rad_s / self.dt_s
        now = w * w * (1.0 + self.reset_per_s * self.dt_s) + rate
        return self.factor * float(np.hypot(now, rate))

    def decay_per_s(self, model: C | F, plant: C | F) -> F:
        """Least rate at which an error falls; below 0 it grows.

        Parameters
        ----------
        model, plant
            (N,) lambda (1/s^2) of the model that the loop knows and of the mechanism.

        Returns
        -------
        ndarray
            (N,) rates (1/s).
        """
        radius = np.abs(np.linalg.eigvals(_companion(self._polynomial(model, plant)))).max(axis=1)
        return np.asarray(-np.log(radius) / self.dt_s)

    def is_stable(self, model: C | F, plant: C | F) -> B:
        """Whether every error falls: (N,), the sign of `decay_per_s` in a tenth of its time.

        The recursion of Schur and Cohn: with a_n the constant term of the monic polynomial p and
        p* the one with conjugate coefficients in reverse order, all roots of p lie inside the unit
        circle where |a_n| < 1 and those of (p - a_n p*) / z do.
        """
        polynomial = self._polynomial(model, plant)
        stable = np.ones(len(polynomial), dtype=np.bool_)
        while polynomial.shape[1] > 1:
            last = polynomial[:, -1:]
            stable &= np.abs(last[:, 0]) < 1.0
            last = np.where(stable[:, None], last, 0.0)  # the others are decided
            reduced = (polynomial - last * polynomial[:, ::-1].conj())[:, :-1]
            polynomial = reduced / (1.0 - np.abs(last) ** 2)
        return stable

    def _polynomial(self, model: C | F, plant: C | F) -> C:
        """(N, d + 5) coefficients of the characteristic polynomial, highest power first.

        z^(d+1) (z - 1) (z^2 - 2 c z + 1) + b (z + 1) q(z), with c = cos(sqrt(lambda) dt) and
        b = (1 - c) / lambda of the held input, q(z) = z (z - 1) times the controller.
        """
        w, dt, d = self.bandwidth_rad_s, self.dt_s, self.delay_steps
        square = np.asarray(plant, dtype=np.complex128) + 1e-9  # not 0, which has the same limit
        c = np.cos(np.sqrt(square) * dt)
        one = np.ones_like(c)
        swing = np.stack([one, -2.0 * c - 1.0, 1.0 + 2.0 * c, -one], axis=1)
        known = np.asarray(model, dtype=np.complex128)
        proportional = w * w * np.outer(one, [1.0, -1.0, 0.0])
        integral = np.outer(self.reset_per_s * dt * (w * w + known), [1.0, 0.0, 0.0])
        damping = 2.0 * w / dt * np.outer(one, [1.0, -2.0, 1.0])
        q = proportional + integral + damping
        q = self.factor * ((1.0 - c) / square)[:, None] * q
        polynomial = np.zeros((len(c), d + 5), dtype=np.complex128)
        polynomial[:, :4] += swing
        polynomial[:, d + 1 : d + 4] += q
        polynomial[:, d + 2 : d + 5] += q
        return polynomial


def _companion(polynomial: C) -> C:
    """(N, n, n) matrices whose eigenvalues are the roots of monic polynomials (N, n + 1)."""
    n = polynomial.shape[1] - 1
    matrix = np.zeros((len(polynomial), n, n), dtype=np.complex128)
    matrix[:, 0, :] = -polynomial[:, 1:]
    matrix[:, np.arange(1, n), np.arange(n - 1)] = 1.0
    return matrix


SOFTNESS = (0.8, 1.0, 1.2)
"""Stiffness of the mechanism over the model's for which the loop is designed."""
_OWN_FREQUENCY = 100.0
"""rad/s of the stiffest mode where the mass is not stated."""
_MARGIN = 2.0
"""Factor on all gains, up and down, that the loop must bear."""
_LAGS = np.geomspace(0.08, 0.6, 9)
"""Bandwidth times lag that are tried."""


@dataclass(frozen=True)
class LoopSettings(Checked):
    """What a control loop must know of the robot.

    Examples
    --------
    >>> LoopSettings(mass_kg=2.0, inertia_kg_m2=0.01).delay_s
    0.003
    """

    mass_kg: float | None = setting(None, low=1e-9, high=1e6)
    """Mass of the platform and what it carries; default: by the mechanism's own frequency."""
    inertia_kg_m2: float | None = setting(None, low=1e-12, high=1e6)
    """Inertia about any axis through the origin of the top frame; default: as the mass."""
    delay_s: float = setting(0.003, low=0.0)
    """Longest time between the reading of a pose and the moment from which its wrench acts."""
    dt_s: float = setting(0.001, above=0.0, high=1e6)
    """Time between two steps of the loop."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.delay_s > 50 * self.dt_s:
            raise InputError(
                f"delay_s = {self.delay_s:g}: expected at most 50 steps of dt_s = {self.dt_s:g}"
            )

    @property
    def delay_steps(self) -> int:
        """Delay in whole steps."""
        return int(np.ceil(self.delay_s / self.dt_s - 1e-9))

    @property
    def not_stated(self) -> tuple[str, ...]:
        """What of the platform is chosen by the stiffness: `mass`, `inertia`."""
        stated = {"mass": self.mass_kg, "inertia": self.inertia_kg_m2}
        return tuple(name for name, value in stated.items() if value is None)


def not_stated(
    chosen: tuple[str, ...], sizes: tuple[float, float], these: str, lest: str
) -> tuple[str, ...]:
    """What of the platform was chosen, and by what, in words; nothing where both are stated."""
    if not chosen:
        return ()
    said = {"mass": f"{sizes[0]:.3g} kg", "inertia": f"{sizes[1]:.3g} kg m2"}
    by = "own frequency" if len(chosen) == len(said) else "stiffness"
    return (
        f"Not stated: {' and '.join(chosen)} of the platform. {these} for "
        f"{' and '.join(said[name] for name in chosen)}, by the mechanism's {by}. State yours, "
        f"{lest}: --mass KG --inertia KGM2.",
    )


@dataclass(frozen=True)
class ControlLoop:
    """A designed loop and how it stands over the model's poses."""

    mass_kg: float
    inertia_kg_m2: float
    chosen: tuple[str, ...]
    """What was not stated and is chosen here: `mass`, `inertia`."""
    gains: Gains
    poses: F
    """(N, 6) poses for which it was designed."""
    holds: B
    """(N,) whether it is stable there, also with gains times 0.8 and 1.25."""
    decay_per_s: float
    """Least rate at which an error falls, over the poses where the loop holds."""
    gain_margin: tuple[float, float]
    """Least and largest factor on all gains before the loop is lost at one of these poses."""
    delay_margin_s: float
    """How much later than stated a wrench may act."""

    @property
    def held(self) -> F:
        """(6,) pose that the example holds."""
        return np.asarray(self.poses[np.argmax(self.holds)])

    @property
    def noise_gain(self) -> tuple[float, float]:
        """Noise of a command over that of the readings of the pose: N per m, N m per rad (rms)."""
        gain = self.gains.noise_gain
        return self.mass_kg * gain, self.inertia_kg_m2 * gain

    def sentences(self) -> tuple[str, ...]:
        """What the loop can bear, in words."""
        w, delay = self.gains.bandwidth_rad_s, 1e3 * self.gains.delay_steps * self.gains.dt_s
        sizes = self.mass_kg, self.inertia_kg_m2
        chosen = not_stated(self.chosen, sizes, "The loop is", "or its gains do not fit")
        stated = (
            f"{self.mass_kg:.3g} kg and {self.inertia_kg_m2:.3g} kg m2, a step of "
            f"{1e3 * self.gains.dt_s:.3g} ms and a delay of at most {delay:.3g} ms"
        )
        if not self.holds.any():
            return (
                *chosen,
                f"No control loop: with {stated} no gain holds any of {len(self.poses)} poses. "
                "A shorter delay, a heavier platform or a mechanism farther from buckling helps.",
            )
        low, high = self.gain_margin
        poses = (
            f"Control loop for {stated}: bandwidth {w:.3g} rad/s; holds {self.holds.sum()} of "
            f"{len(self.poses)} poses of the model on mechanisms up to 20 % softer and stiffer."
        )
        margins = (
            f"The slowest error falls by {self.decay_per_s:.3g} 1/s; margins: gain times "
            f"{low:.2g} to {high:.2g}, {1e3 * self.delay_margin_s:.3g} ms more delay."
        )
        force, torque = 1e-5 * self.noise_gain[0], 1e-4 * self.noise_gain[1]
        noise = (
            f"Through the loop noise of 0.01 mm and 0.1 mrad in each reading of the pose becomes "
            f"{force:.2g} N and {torque:.2g} N m (rms) of the wrench."
        )
        return *chosen, poses, margins, noise

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {
            "mass_kg": self.mass_kg,
            "inertia_kg_m2": self.inertia_kg_m2,
            "dt_s": self.gains.dt_s,
            "delay_s": self.gains.delay_steps * self.gains.dt_s,
            "bandwidth_rad_s": self.gains.bandwidth_rad_s,
            "poses": len(self.poses),
            "poses_held": int(self.holds.sum()),
            "decay_per_s": self.decay_per_s,
            "gain_margin": list(self.gain_margin),
            "delay_margin_s": self.delay_margin_s,
            "noise_gain": list(self.noise_gain),
        }


def design_loop(
    poses: F, stiffness: F, settings: LoopSettings | None = None, stiffer: float = 0.0
) -> ControlLoop:
    """Choose the bandwidth of a loop that holds these poses.

    The loop is `ecm.models.control_loop`. Of the bandwidths that bear twice and half the gain at
    every pose, softness and delay, the one whose slowest error falls fastest is taken.

    Parameters
    ----------
    poses
        (N, 6) poses that are to be held.
    stiffness
        (N, 6, 6) K_s there: wrench per small twist (stiffness kind `screw`).
    settings
        Mass, inertia, delay and step.
    stiffer
        Share by which a sudden move meets more stiffness than K_s: what relaxes or slips.

    Returns
    -------
    ControlLoop
        The loop, where it holds, and its margins.

    Raises
    ------
    InputError
        A mechanism without positive stiffness, for which no mass can be chosen.

    Examples
    --------
    >>> K = np.diag([20e3, 4e3, 4e3, 4.0, 16.0, 16.0])[None]
    >>> loop = design_loop(np.zeros((1, 6)), K, LoopSettings(mass_kg=2.0, inertia_kg_m2=0.01))
    >>> bool(loop.holds.all()), bool(loop.gain_margin[1] > 1.9)
    (True, True)
    """
    settings = settings or LoopSettings()
    softness = (*SOFTNESS[:-1], SOFTNESS[-1] * (1.0 + stiffer))
    mass, inertia = platform_for(stiffness, settings)
    weights = 1.0 / np.array([mass] * 3 + [inertia] * 3)
    modes = np.linalg.eigvals(weights[:, None] * stiffness).astype(np.complex128)
    dt, delay = settings.dt_s, settings.delay_steps
    tried = [Gains(lag / ((delay + 1) * dt), dt, delay) for lag in _LAGS]
    critical = _critical(modes)
    gains = max(tried, key=lambda gains: _merit(gains, critical, softness))
    rates = _rates(gains, modes, softness, {0, delay // 2, delay}).min(axis=1)
    holds = rates > 0.0
    for factor in (0.8, 1.25):
        holds &= _bears(gains, modes, softness, factor).all(axis=1)
    any_held = bool(holds.any())
    critical = _critical(modes[holds]) if any_held else critical
    return ControlLoop(
        mass_kg=mass,
        inertia_kg_m2=inertia,
        chosen=settings.not_stated,
        gains=gains,
        poses=poses,
        holds=holds,
        decay_per_s=float(rates[holds].min()) if any_held else 0.0,
        gain_margin=_gain_margin(gains, critical, softness) if any_held else (1.0, 1.0),
        delay_margin_s=_delay_margin(gains, critical, softness) if any_held else 0.0,
    )


def platform_for(stiffness: F, settings: LoopSettings) -> tuple[float, float]:
    """The stated mass and inertia, or those at which the stiffest mode has 100 rad/s.

    What is stated of the two scales the other: a light platform turns easily as well.
    """
    symmetric = 0.5 * (stiffness + np.swapaxes(stiffness, 1, 2))
    largest = [np.linalg.eigvalsh(symmetric[:, s, s]).max() for s in (slice(3), slice(3, 6))]
    if not (np.isfinite(stiffness).all() and min(largest) > 0.0):
        raise InputError("stiffness: expected finite numbers and a mechanism that resists")
    weights = 1.0 / np.repeat(largest, 3)
    scale = np.abs(np.linalg.eigvals(weights[:, None] * stiffness)).max() / _OWN_FREQUENCY**2
    if settings.mass_kg is not None:
        scale = settings.mass_kg / largest[0]
    elif settings.inertia_kg_m2 is not None:
        scale = settings.inertia_kg_m2 / largest[1]
    mass, inertia = (float(f"{value * scale:.2g}") for value in largest)
    return settings.mass_kg or mass, settings.inertia_kg_m2 or inertia


def _rates(gains: Gains, modes: C, softness: tuple[float, ...], delays: Collection[int]) -> F:
    """Least rate of each mode over softness and delays."""
    flat = modes.ravel()
    rates = [
        replace(gains, delay_steps=delay).decay_per_s(flat, share * flat)
        for share in softness
        for delay in delays
    ]
    return np.asarray(np.min(rates, axis=0).reshape(modes.shape))


def _critical(modes: C) -> C:
    """The modes of the poses with the fastest, the softest and the least symmetric modes."""
    keys = (-np.abs(modes).max(axis=1), modes.real.min(axis=1), -np.abs(modes.imag).max(axis=1))
    chosen = np.unique([np.argsort(key, kind="stable")[:12] for key in keys])
    flat = modes[chosen].ravel()
    return np.asarray(flat[flat.imag >= 0.0])  # the others are their conjugates


def _bears(gains: Gains, modes: C, softness: tuple[float, ...], factor: float = 1.0) -> B:
    """Whether each mode bears all gains times a factor, without delay and with all of it."""
    flat = modes.ravel()
    bears = np.ones(flat.shape, dtype=np.bool_)
    for share in softness[::2]:
        for delay in (0, gains.delay_steps):
            changed = replace(gains, factor=factor, delay_steps=delay)
            bears &= changed.is_stable(flat, share * flat)
    return np.asarray(bears.reshape(modes.shape))


def _merit(gains: Gains, modes: C, softness: tuple[float, ...]) -> tuple[float, float]:
    """Shares of the modes that are held and that bear more and less gain, then the least rate."""
    rates = _rates(gains, modes, softness[::2], (0, gains.delay_steps))
    bears = rates > 0.0
    for factor in (1.0 / _MARGIN, _MARGIN):
        bears &= _bears(gains, modes, softness, factor)
    return float((rates > 0.0).mean() + bears.mean()), float(rates.min())


def _gain_margin(gains: Gains, modes: C, softness: tuple[float, ...]) -> tuple[float, float]:
    """The factors on the way down and up at which the loop is lost, within 3 %, at most 30."""
    found = []
    for way in (-1.0, 1.0):
        good, bad = 0.0, np.log(30.0)
        while bad - good > 0.03:
            middle = 0.5 * (good + bad)
            factor = float(np.exp(way * middle))
            if _bears(gains, modes, softness, factor).all():
                good = middle
            else:
                bad = middle
        found.append(float(np.exp(way * good)))
    return found[0], found[1]


def _delay_margin(gains: Gains, modes: C, softness: tuple[float, ...]) -> float:
    def holds(steps: int) -> bool:
        return bool(_bears(replace(gains, delay_steps=steps), modes, softness).all())

    more = 0
    while more < 100 and holds(gains.delay_steps + more + 1):
        more += 1
    return more * gains.dt_s
