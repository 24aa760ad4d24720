"""Effects that scale the elastic wrench: temperature, age, largest load so far (Mullins)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ecm.effects.protocol import (
    Effect,
    LinearEffect,
    LookAlike,
    Missing,
    Need,
    Parameter,
    needs_full,
    needs_varying,
    optional,
)
from ecm.io.arrays import F
from ecm.io.table import Table
from ecm.regression.approach import largest_so_far, memory_options
from ecm.regression.folds import repeat_visits
from ecm.regression.rows import Rows

_LEAST_AGAIN = 5


def needs_again(record: str) -> Need:
    """Missing without time, or where every pose is visited once: then time and pose are one."""

    def need(table: Table) -> Missing | None:
        lacking = needs_varying("time_s", 1.0)(table)
        if lacking is None and repeat_visits(table) < _LEAST_AGAIN:
            return Missing("no pose was measured again", record, imitates=True)
        return lacking

    return need


@dataclass(eq=False)
class TemperatureModulus(LinearEffect):
    """h (1 - beta (T - T0)); T0 is the table's mean, the modulus takes what is left."""

    id = "temperature_modulus"
    physics = "The modulus follows the temperature of the material, and the whole wrench with it."
    parameters = (Parameter("beta", "1/K", 3e-3, -0.05, 0.05),)
    outside = LookAlike(
        "anything that follows the temperature: a sensor that warms, a clamp that grows, moisture",
        "the same poses warm and cold, in both orders",
    )
    signature = "proportional to h, follows T"
    needs = "temperature that varies (temperature_degC)"
    requires = (needs_varying("temperature_degC", 0.25),)
    kind = "time"
    rivals = {"ageing": "warm_and_cold", "stress_relaxation": "hold_60_s"}

    reference_degC: float | None = optional(None)
    """Temperature at which the correction is zero; None: the mean of the table."""

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """Referred to the mean temperature of the table."""
        return (TemperatureModulus(round(float(table.column("temperature_degC").mean()), 3)),)

    def columns(self, rows: Rows) -> F:
        """-(T - T0) h."""
        temperature = rows.table.column("temperature_degC")
        zero = temperature.mean() if self.reference_degC is None else self.reference_degC
        return np.asarray(-((temperature - zero)[:, None] * rows.wrench)[:, :, None])


class Ageing(LinearEffect):
    """h (1 + alpha t)."""

    id = "ageing"
    physics = "The material stiffens or softens steadily with time, at rest as well as in use."
    parameters = (Parameter("alpha", "1/s", 1e-6, -1e-3, 1e-3),)
    outside = LookAlike(
        "anything that scales the wrench over the hours: drying, a gain that drifts, the room",
        "the first poses again at the end, and next day",
    )
    signature = "proportional to h, monotone in t"
    needs = "time (time_s), and poses that are measured again"
    requires = (needs_again("repeat the first set at the end, and next day"),)
    kind = "time"
    rivals = {
        "temperature_modulus": "repeat_next_day",
        "mullins_softening": "repeat_first_poses",
    }

    def columns(self, rows: Rows) -> F:
        """t h."""
        return np.asarray((rows.time_s()[:, None] * rows.wrench)[:, :, None])


@dataclass(eq=False)
class MullinsSoftening(LinearEffect):
    """h (1 - eta (1 - W / W_max)), W_max the largest strain energy so far in the run.

    In joined tables the memory may also be `kept` over all runs.

    W = h (p - p0) / 2, that of a linear body. With a `width` the loss is complete a width below the
    maximum: h (1 - eta tanh((W_max - W) / (width W_typical))), W_typical the median. In place of
    the energy the largest `bend` or distance (`reach`) may count, m: h (1 - eta u / (u + width b)),
    u = m_max - m and b the median, or a straight line without a width.
    """

    id = "mullins_softening"
    physics = "A filled rubber is softer below the largest deformation that it has had."
    parameters = (Parameter("eta", "1", 0.03, -0.2, 0.9),)
    outside = LookAlike(
        "anything that stays softer after a large pose: a bond that opens, a clamp that settles",
        "five cycles to the largest pose, then the first poses again; clamp anew",
    )
    signature = "first visit above later ones, only below the past maximum"
    needs = "order (time_s), and poses that are measured again"
    requires = (needs_full, needs_again("repeat the first 10 poses"))
    kind = "time"
    rivals = {
        "ageing": "conditioning_cycles",
        "stress_relaxation": "hold_60_s",
        "hysteresis": "conditioning_cycles",
        "strain_stiffening": "conditioning_cycles",
    }

    width: float = optional(0.0)
    """Width over which the loss sets in, over the median of the measure; 0: a straight line."""
    measure: str = optional("energy")
    """What the largest load is: `energy`, `bend` or `reach`."""
    history: str = optional("run")
    """Whether the memory ends with a `run` or is `kept` over all runs."""

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """A straight line and three widths for each measure of the largest load."""
        return tuple(
            MullinsSoftening(w, measure, kept)
            for kept in memory_options(table)
            for measure in ("energy", "bend", "reach")
            for w in (0.0, 0.25, 0.7, 2.0)
        )

    def columns(self, rows: Rows) -> F:
        """The share that is lost, times -h."""
        if self.measure != "energy":
            return self._of_deflection(rows)
        energy = 0.5 * np.abs(((rows.poses - rows.rest_pose) * rows.wrench).sum(axis=1))
        largest = largest_so_far(rows.table, energy, self.history)
        if self.width > 0.0:
            typical = float(np.median(energy[~rows.unloaded])) if not rows.unloaded.all() else 1.0
            lost = np.tanh((largest - energy) / max(self.width * typical, 1e-300))
        else:
            lost = 1.0 - energy / np.where(largest > 0.0, largest, 1.0)
        return np.asarray(-(lost[:, None] * rows.wrench)[:, :, None])

    def _of_deflection(self, rows: Rows) -> F:
        """(N, 6, 1) loss by the largest tilt and twist, or by the largest distance from rest."""
        away = rows.poses - rows.rest_pose
        size = np.linalg.norm(away[:, 3:], axis=1)
        if self.measure == "reach":
            size = np.hypot(np.linalg.norm(away[:, :3], axis=1), rows.length_m * size)
        size = np.where(rows.unloaded, 0.0, size)
        largest = largest_so_far(rows.table, size, self.history)
        below = largest - size
        if self.width > 0.0:
            typical = float(np.median(size[~rows.unloaded])) if not rows.unloaded.all() else 1.0
            lost = below / np.maximum(below + self.width * typical, 1e-300)
        else:
            lost = below / np.where(largest > 0.0, largest, 1.0)
        return np.asarray(-(lost[:, None] * rows.wrench)[:, :, None])


EFFECTS = (MullinsSoftening(), TemperatureModulus(), Ageing())
