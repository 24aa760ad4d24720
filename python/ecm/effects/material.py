"""Effects of the material: they scale or turn the elastic wrench itself."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ecm.effects.history import largest_so_far, pose_before, sides
from ecm.effects.mid_frame import stretched
from ecm.effects.protocol import (
    Effect,
    EffectBase,
    LinearEffect,
    Missing,
    Parameter,
    Shape,
    needs_full,
    needs_varying,
)
from ecm.effects.rows import Rows

if TYPE_CHECKING:
    from ecm.table import Table

F = NDArray[np.float64]


class TemperatureModulus(LinearEffect):
    """h (1 - beta (T - T0)); T0 is the table's mean, the modulus takes what is left."""

    id = "temperature_modulus"
    physics = "The modulus follows the temperature of the material, and the whole wrench with it."
    parameters = (Parameter("beta", "1/K", 3e-3, -0.05, 0.05),)
    signature = "proportional to h, follows T"
    kind = "time"

    def __init__(self, reference_degC: float | None = None) -> None:
        self._reference_degC = reference_degC

    @property
    def rivals(self) -> dict[str, str]:
        """Effects that look like it, and what separates them."""
        return {"ageing": "repeat 10 poses warm and cold", "stress_relaxation": "hold 60 s"}

    @property
    def shape(self) -> Shape:
        """The temperature at which the correction is zero."""
        return {} if self._reference_degC is None else {"reference_degC": self._reference_degC}

    def missing(self, table: Table) -> Missing | None:
        """Needs a temperature that varies by more than a quarter of a degree."""
        return needs_varying(table, "temperature_degC", 0.25)

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """Referred to the mean temperature of the table."""
        return (TemperatureModulus(round(float(table.column("temperature_degC").mean()), 3)),)

    def columns(self, rows: Rows) -> F:
        """-(T - T0) h."""
        temperature = rows.table.column("temperature_degC")
        zero = temperature.mean() if self._reference_degC is None else self._reference_degC
        return np.asarray(-((temperature - zero)[:, None] * rows.wrench)[:, :, None])


class Ageing(LinearEffect):
    """h (1 + alpha t)."""

    id = "ageing"
    physics = "The material stiffens or softens steadily with time, at rest as well as in use."
    parameters = (Parameter("alpha", "1/s", 1e-6, -1e-3, 1e-3),)
    signature = "proportional to h, monotone in t"
    kind = "time"

    @property
    def rivals(self) -> dict[str, str]:
        """Effects that look like it, and what separates them."""
        return {
            "temperature_modulus": "repeat the first set at the end, and next day",
            "mullins_softening": "repeat the first 10 poses",
        }

    def missing(self, table: Table) -> Missing | None:
        """Needs time."""
        return needs_varying(table, "time_s", 1.0)

    def columns(self, rows: Rows) -> F:
        """t h."""
        return np.asarray((rows.time_s()[:, None] * rows.wrench)[:, :, None])


class StressRelaxation(LinearEffect):
    """h (1 + g exp(-d / tau)), d the time at rest; tau from a small grid."""

    id = "stress_relaxation"
    physics = "After a move the stress decays at rest, so a short dwell reads a larger wrench."
    parameters = (Parameter("g", "1", 0.02, -0.2, 1.0),)
    signature = "proportional to h, decays at rest, zero at home"
    kind = "time"

    def __init__(self, tau_s: float = 10.0) -> None:
        self._tau_s = tau_s

    @property
    def rivals(self) -> dict[str, str]:
        """Effects that look like it, and what separates them."""
        return {"ageing": "hold one pose for 60 s", "hysteresis": "dwell of 2, 8 and 60 s"}

    @property
    def shape(self) -> Shape:
        """The time constant."""
        return {"tau_s": self._tau_s}

    def missing(self, table: Table) -> Missing | None:
        """Needs dwell times that differ at least by half."""
        found = needs_varying(table, "dwell_s", 1e-3)
        if found is None:
            dwell = table.measured().column("dwell_s")
            if dwell.max() < 1.5 * max(float(dwell.min()), 1e-9):
                return Missing("dwell_s does not vary", "dwell_s of 2, 8 and 60 s")
        return found

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """Time constants that the dwell times can tell apart."""
        dwell = table.measured().column("dwell_s")
        low, high = max(float(dwell.min()), 0.1), float(dwell.max())
        return tuple(StressRelaxation(float(t)) for t in np.geomspace(low, high, 4))

    def columns(self, rows: Rows) -> F:
        """exp(-d / tau) h."""
        dwell = rows.table.column("dwell_s")
        decay = np.exp(-np.where(np.isfinite(dwell), dwell, np.inf) / self._tau_s)
        return np.asarray((decay[:, None] * rows.wrench)[:, :, None])


class MullinsSoftening(LinearEffect):
    """h (1 - eta (1 - W / W_max)), W_max the largest strain energy so far in the run.

    W = h (p - p0) / 2, that of a linear body: only its ratio counts.
    """

    id = "mullins_softening"
    physics = "A filled rubber is softer below the largest deformation that it has had."
    parameters = (Parameter("eta", "1", 0.03, -0.2, 0.9),)
    signature = "first visit above later ones, only below the past maximum"
    kind = "time"

    @property
    def rivals(self) -> dict[str, str]:
        """Effects that look like it, and what separates them."""
        return {
            "ageing": "5 conditioning cycles, then repeat the first 10 poses",
            "stress_relaxation": "hold 60 s",
        }

    def missing(self, table: Table) -> Missing | None:
        """Needs time, so that the order of visits is known."""
        return needs_full(table) or needs_varying(table, "time_s", 1.0)

    def columns(self, rows: Rows) -> F:
        """-(1 - W / W_max) h."""
        energy = 0.5 * np.abs(((rows.poses - rows.rest_pose) * rows.wrench).sum(axis=1))
        largest = largest_so_far(rows.table, energy)
        below = 1.0 - energy / np.where(largest > 0.0, largest, 1.0)
        return np.asarray(-(below[:, None] * rows.wrench)[:, :, None])


class Hysteresis(LinearEffect):
    """c K p^, p^ = d / sqrt(d' M d), d = p - p_from: rate-independent friction of the material."""

    id = "hysteresis"
    physics = "Internal friction: the wrench depends on the side from which a pose is approached."
    parameters = (Parameter("c", "m", 1e-4, -5e-3, 5e-3),)
    signature = "odd in the side of approach, not conservative, zero mean for balanced approaches"
    kind = "time"

    def __init__(self, stiffness: str = "local") -> None:
        self._stiffness = stiffness

    @property
    def rivals(self) -> dict[str, str]:
        """Effects that look like it, and what separates them."""
        return {
            "stress_relaxation": "the same pose from both sides, again after 60 s",
            "backlash": "joint-wise reversal",
            "fts_hysteresis": "load and unload dead weights",
        }

    @property
    def shape(self) -> Shape:
        """Whether the friction follows the local stiffness or that at rest."""
        return {"stiffness": self._stiffness}

    def missing(self, table: Table) -> Missing | None:
        """Needs poses approached from both sides."""
        found = needs_full(table)
        if found is not None:
            return found
        if not table.has("approach"):
            return Missing("no column approach", "approach", absent=True)
        side = sides(table)
        known = side[side != 0.0]
        if len(known) == 0:
            return Missing("the approach of every row is unknown", "approach")
        if min(float((known > 0).mean()), float((known < 0).mean())) < 0.05:
            return Missing("one approach direction", "approach from both sides")
        return None

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """Local stiffness, or that at rest."""
        return (Hysteresis("local"), Hysteresis("rest"))

    def columns(self, rows: Rows) -> F:
        """K p^; zero where the approach is unknown or nothing moved."""
        step = rows.poses - pose_before(rows.table, rows.rest_pose)
        step = np.where(np.isfinite(step), step, 0.0)
        metric = np.array([1.0, 1.0, 1.0] + [rows.length_m**2] * 3)
        size = np.sqrt((step**2) @ metric)
        direction = step / np.where(size > 1e-9, size, np.inf)[:, None]
        stiffness = rows.stiffness
        if self._stiffness == "rest":
            stiffness = np.broadcast_to(
                rows.base.stiffness(rows.rest_pose[None, :])[0], stiffness.shape
            )
            stiffness = stiffness * ~rows.unloaded[:, None, None]
        return np.asarray(stiffness @ direction[:, :, None])


class Anisotropy(EffectBase):
    """EI (1 +- c) at the azimuth phi, as c cos 2 phi and c sin 2 phi.

    The bending stiffness in the plane at azimuth phi grows by c, across it falls by c. In mid-frame
    coordinates the bending part of the energy belongs to theta, and, by its share in the lateral
    compliance, to c; both are stretched by half of c, so that the change stays conservative.
    """

    id = "anisotropy"
    physics = "The section is stiffer in one bending plane than in the other."
    parameters = (
        Parameter("c_cos2phi", "1", 0.01, -0.5, 0.5),
        Parameter("c_sin2phi", "1", 0.01, -0.5, 0.5),
    )
    signature = "m = 2, conservative"

    def __init__(self, lateral: float = 1.0) -> None:
        self._lateral = lateral

    @property
    def shape(self) -> Shape:
        """Lateral anisotropy over that of a beam whose bending stiffness alone is anisotropic."""
        return {"lateral": self._lateral}

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """A beam; bonded ends, where shear takes more of the lateral compliance; shear as well."""
        return (Anisotropy(1.0), Anisotropy(0.5), Anisotropy(2.0))

    @property
    def rivals(self) -> dict[str, str]:
        """Effects that look like it, and what separates them."""
        return {"fts_gain": "remount the mechanism turned by 90 degrees"}

    def correction(self, rows: Rows, values: F) -> F:
        """Wrench of the stretched energy minus that of the base."""
        share = self._lateral * _bending_share(rows)
        c, s = 0.5 * values
        matrix = np.eye(6)
        matrix[1:3, 1:3] += share * np.array([[c, s], [s, -c]])
        # A deflection towards n = (n_y, n_z) turns the section by (theta_y, theta_z) = (-n_z, n_y).
        matrix[4:6, 4:6] += np.array([[-c, -s], [-s, c]])
        return stretched(rows, matrix, np.zeros(6)) - rows.wrench


def _bending_share(rows: Rows) -> float:
    """Share of bending in the lateral compliance of a clamped beam, k_c L^3 / (12 EI).

    K(y, y) = k_c and K(theta_z, theta_z) = EI / L + k_c L^2 / 4 at the rest pose.
    """
    stiffness = rows.base.stiffness(rows.rest_pose[None, :])[0]
    length = rows.length_m
    lateral = 0.5 * (stiffness[1, 1] + stiffness[2, 2])
    bending = 0.5 * (stiffness[4, 4] + stiffness[5, 5]) - 0.25 * lateral * length**2
    if bending <= 0.0:
        return 1.0
    return float(np.clip(lateral * length**2 / (12.0 * bending), 0.0, 1.0))


EFFECTS: Sequence[Effect] = (
    StressRelaxation(),
    Hysteresis(),
    MullinsSoftening(),
    TemperatureModulus(),
    Ageing(),
    Anisotropy(),
)
