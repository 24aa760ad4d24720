"""What use, time and temperature do to the material: softening, ageing, a permanent set."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ecm.effects.pairs import needs_order
from ecm.effects.protocol import (
    Effect,
    LinearEffect,
    LookAlike,
    Missing,
    Parameter,
    TimedEffect,
    listed,
    needs_columns,
    needs_varying,
    optional,
)
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.io.table import Table
from ecm.regression.history import largest_so_far, memory_options, order_of_visits
from ecm.regression.rows import Rows

_LEAST_AGAIN = 5
_SOON = 0.35
"""Shortest time that is tried for what settles, over that of the table."""
_WIDTHS = (0.0, 0.25, 0.7, 2.0)
"""Widths that are tried, over the median; 0: a straight line."""


_UNLOADING = "time (time_s), or rows step by step, and loads after larger ones"
"""What the next function asks for, in words."""


def _needs_unloading(table: Table) -> Missing | None:
    """Missing without an order, or where no row lies below an earlier, larger load."""
    if (lacking := needs_order(table)) is not None:
        return lacking
    if not table.wrench_columns:
        return Missing("no wrench column", "a force or a torque", absent=True)
    load = _measured_load(table)
    if int((largest_so_far(table, load) > 1.05 * load).sum()) < _LEAST_AGAIN:
        return Missing("no load after a larger one", "a second cycle, and smaller loads after it")
    return None


_YIELDS = (0.3, 0.55, 0.8)
"""Shares of the rows that leave no set, of the yields that are tried."""


def _load(wrenches: F, outputs: tuple[str, ...]) -> F:
    """(N,) size of the force; of the moment where no force is known."""
    counts = [outputs.index(name) for name in _of_load(outputs)]
    return np.asarray(np.linalg.norm(wrenches[:, counts], axis=1))


def _measured_load(table: Table) -> F:
    """(N,) the same of the readings."""
    return _load(table.matrix(table.wrench_columns), table.wrench_columns)


def _of_load(outputs: tuple[str, ...]) -> tuple[str, ...]:
    """The columns of force; those of the moment where there are none."""
    return tuple(name for name in outputs if name in WRENCH[:3]) or outputs


def settling_times(table: Table) -> tuple[float, ...]:
    """Times that are tried for what settles; the first is infinite: a steady change."""
    span = float(np.ptp(table.column("time_s")))
    return np.inf, *(round(span * share, 1) for share in (_SOON, 1.0))


def settled(time_s: F, tau_s: float) -> F:
    """t, or tau (1 - exp(-t / tau)), which begins as fast; before the start a straight line."""
    if np.isinf(tau_s):
        return time_s
    return np.asarray(np.minimum(time_s, 0.0) - tau_s * np.expm1(-np.maximum(time_s, 0.0) / tau_s))


_CURVES, _CURVED_K = (0.5, 0.15), 30.0
"""Curves of a modulus that are tried, over the range of temperatures, and the least range: within
less any rubber is straight, and more shapes would only fit more noise."""


@dataclass(eq=False)
class OfTemperature(LinearEffect):
    """What is proportional to the temperature over a reference."""

    kind = "time"

    reference_degC: float | None = optional(None)
    """Temperature at which the correction is zero; None: the mean of the table."""

    def beside_base(self, known: Mapping[str, float] | None) -> Effect:
        """The same; without a reference where the base, which holds there, is open as well."""
        return replace(self, reference_degC=None) if known is None else super().beside_base(known)

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """Referred to the temperature of a known base, else to the mean of the table.

        One that has a reference keeps it.
        """
        if self.reference_degC is not None:
            return (self,)
        own = float(table.column("temperature_degC").mean())
        mean = self.base_means.get("temperature_degC", own)
        return (replace(self, reference_degC=round(mean, 3)),)

    def columns(self, rows: Rows) -> F:
        """(T - T0), or what is made of it, times that of one kelvin."""
        temperature = rows.table.column("temperature_degC")
        zero = self.reference_degC
        if zero is None:
            zero = float(rows.taken("mean_degC", temperature.mean))
        over = self.grown_K(temperature - zero)
        return np.asarray((over[:, None] * self.of_one_kelvin(rows))[:, :, None])

    def grown_K(self, over_K: F) -> F:
        """(N,) what the correction is proportional to, of kelvins over the reference."""
        return over_K

    def of_one_kelvin(self, rows: Rows) -> F:
        """(N, m) correction of one kelvin over the reference, of a parameter of 1."""
        raise NotImplementedError(f"effect {self.id} has no correction of one kelvin")


@dataclass(eq=False)
class TemperatureModulus(OfTemperature):
    """h (1 - beta g(T - T0)); T0 is the table's mean, the modulus takes what is left.

    g(d) = d, or s (1 - exp(-d / s)): each kelvin does more when it is cold, as in a rubber that
    comes near its glass. Of either sign: an ideal rubber has beta = -1 / T, that is -0.0034 / K at
    20 degrees C.

    Parameters: beta: share of the stiffness lost per kelvin, at T0.

    Source: Treloar, The Physics of Rubber Elasticity, 3rd edition, 1975 (ideal rubber).
    """

    id = "temperature_modulus"
    physics = "The modulus follows the temperature of the material, and so does its wrench."
    parameters = (Parameter("beta", "1/K", 3e-3, -0.05, 0.05),)
    outside = LookAlike(
        "anything that follows the temperature: a sensor that warms, a clamp that grows, moisture",
        "the same poses warm and cold, in both orders",
    )
    signature = "proportional to h, follows T"
    needs = "temperature that varies (temperature_degC)"
    requires = (needs_varying("temperature_degC", 0.25),)
    rivals = {"ageing": "warm_and_cold", "stress_relaxation": "hold_60_s"}

    curve_K: float = optional(np.inf)
    """Kelvins s over which the slope falls to 1/e; infinite for a straight line."""

    def __post_init__(self) -> None:
        if np.isfinite(self.curve_K):
            self.physics = (
                "The modulus follows the temperature of the material, each kelvin more when cold."
            )

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """A straight line; where they range widely curves over parts of the temperatures too."""
        span = float(np.ptp(table.column("temperature_degC")))
        curved = _CURVES if span > _CURVED_K else ()
        curves = (np.inf, *(round(share * span, 3) for share in curved))
        at_mean: Any = super().variants(table)[0]
        return tuple(replace(at_mean, curve_K=curve) for curve in curves)

    def refined(self, table: Table, round_: int) -> tuple[Effect, ...]:
        """Curves between this one and its neighbours; none of a straight line."""
        return self.nearby("curve_K", (_CURVES[0] / _CURVES[1]) ** (0.5 ** (round_ + 1)))

    def grown_K(self, over_K: F) -> F:
        """(N,) d, or s (1 - exp(-d / s))."""
        if np.isinf(self.curve_K):
            return over_K
        return np.asarray(-self.curve_K * np.expm1(-over_K / self.curve_K))

    def of_one_kelvin(self, rows: Rows) -> F:
        """-h."""
        return -rows.material_wrench


@dataclass(eq=False)
class ThermalExpansion(OfTemperature):
    """alpha (T - T0) (2 f - K_f c, 3 m - K_m c), c the platform's place; T0 is the table's mean.

    A body that is larger by g in all directions has at a place c the forces g^2 f(c / g) and the
    moments g^3 m(c / g) of the plain one: along the axis the same pose compresses it.

    Parameters: alpha: growth per kelvin.

    Source: Treloar, The Physics of Rubber Elasticity, 3rd edition, 1975 (2e-4 / K for rubber; 3e-4
    / K is usual for silicone).
    """

    id = "thermal_expansion"
    physics = "The body grows in all directions with its temperature."
    parameters = (Parameter("alpha", "1/K", 3e-4, -0.01, 0.01),)
    outside = LookAlike(
        "anything that grows with the temperature: the frame or a bracket of the camera",
        "the free length unclamped, warm and cold",
    )
    signature = "2 f - K_f c and 3 m - K_m c, most along the axis, follows T"
    needs = "temperature that varies (temperature_degC), and the length"
    requires = (needs_columns("x_m"), needs_varying("temperature_degC", 0.25))
    rivals = {"temperature_modulus": "warm_and_cold", "fts_thermal_drift": "zero_warm_and_cold"}

    def of_one_kelvin(self, rows: Rows) -> F:
        """(N, m) (2 f - K_f c, 3 m - K_m c)."""
        outputs, inputs = rows.base.outputs, rows.base.inputs
        powers = np.array([2.0 if name in WRENCH[:3] else 3.0 for name in outputs])
        at = [j for j, name in enumerate(inputs) if name in POSE[:3]]
        # Without a length x_m may count from the rest pose.
        free = np.array([rows.length_m if inputs[j] == "x_m" else 0.0 for j in at])
        place = rows.poses[:, at] - rows.middle_pose[at] + free
        smaller = np.einsum("nij,nj->ni", rows.stiffness[:, :, at], place)
        return np.asarray(powers * rows.wrench - smaller)


@dataclass(eq=False)
class Settling(LinearEffect):
    """What grows with g(t) = t, or with tau (1 - exp(-t / tau)) where it settles."""

    needs = "time (time_s)"
    grows_with_time = True

    tau_s: float = optional(np.inf)
    """Time in which it settles; infinite for a steady change."""

    def refined(self, table: Table, round_: int) -> tuple[Effect, ...]:
        """Times between this one and its neighbours; none of a steady change."""
        return self.nearby("tau_s", _SOON ** -(0.5 ** (round_ + 1)))


@dataclass(eq=False)
class Ageing(Settling, TimedEffect):
    """h (1 + alpha g(t)), g(t) = t, or tau (1 - exp(-t / tau)) for a material that settles.

    Parameters: alpha: share of the stiffness gained per second at the start.
    """

    id = "ageing"
    physics = "The material stiffens or softens with time, at rest as well as in use."
    parameters = (Parameter("alpha", "1/s", 1e-6, -1e-3, 1e-3),)
    outside = LookAlike(
        "anything that scales the wrench over the hours: drying, a gain that drifts, the room",
        "the first poses again at the end, and next day",
    )
    signature = "proportional to h, monotone in t"
    requires = (needs_varying("time_s", 1.0),)
    rivals = {"temperature_modulus": "repeat_next_day", "mullins_softening": "repeat_first_poses"}

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """Steady, and settling within the campaign."""
        return tuple(Ageing(tau) for tau in settling_times(table))

    def columns(self, rows: Rows) -> F:
        """g(t) h."""
        grown = settled(rows.grown_s(), self.tau_s)
        return np.asarray((grown[:, None] * rows.material_wrench)[:, :, None])


@dataclass(eq=False)
class MullinsSoftening(TimedEffect):
    """h (1 - eta (1 - W / W_max)), W_max the largest strain energy so far in the run.

    In joined tables the memory may also be `kept` over all runs.

    W = h (p - p0) / 2, that of a linear body. With a `width` the loss is complete a width below the
    maximum: h (1 - eta tanh((W_max - W) / (width W_typical))), W_typical the median. In place of
    the energy the largest `bend` or distance (`reach`) may count, m: h (1 - eta u / (u + width b)),
    u = m_max - m and b the median, or a straight line without a width.

    Parameters: eta: share of the stiffness that is lost far below the largest load so far.

    Source: Mullins, Softening of rubber by deformation, Rubber Chemistry and Technology 42, 1969;
    the form with a width: Ogden and Roxburgh, A pseudo-elastic model for the Mullins effect in
    filled rubber, Proc. R. Soc. A 455, 1999, who have the error function in place of tanh.
    """

    id = "mullins_softening"
    physics = "A filled rubber is softer below the largest deformation that it has had."
    parameters = (Parameter("eta", "1", 0.03, -0.2, 0.9),)
    outside = LookAlike(
        "anything that stays softer after a large pose: a bond that opens, a clamp that settles",
        "five cycles to the largest pose, then the first poses again; clamp anew",
    )
    signature = "first visit above later ones, only below the past maximum"
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
    """Whether the memory ends with a `run` or is `kept` over all runs; with `no` memory the largest
    load of all rows counts from the first one on (the plain form)."""
    load_width: float | None = optional(None)
    """With fewer than the twelve columns the size of force or moment counts, and sets in over this
    width, N or N m; 0: a straight line."""

    def __post_init__(self) -> None:
        if self.load_width is not None:
            self.physics = "The material is softer below the largest load that it has had."
            self.needs = _UNLOADING
        if self.history == "no":
            # Softer below the largest load at any time is stiffer at larger loads.
            self.id = "strain_stiffening"

    def missing(self, table: Table) -> Missing | None:
        """Needs what `requires` says; with fewer columns a load below an earlier one."""
        return super().missing(table) if self.load_width is None else _needs_unloading(table)

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """A straight line and some widths for each measure of the largest load."""
        if self.load_width is not None:
            load = _measured_load(table.measured())
            widths = [float(f"{w * np.median(load):.4g}") for w in _WIDTHS[:3]]
            return tuple(MullinsSoftening(load_width=width) for width in widths)
        return tuple(
            MullinsSoftening(w, measure, kept)
            for kept in memory_options(table)
            for measure in ("energy", "bend", "reach")
            for w in _WIDTHS
        )

    def plain_form(self) -> Effect | None:
        """The same without memory: what is softer before the largest load as well is no wear."""
        return None if self.history == "no" else replace(self, history="no")

    def refined(self, table: Table, round_: int) -> tuple[Effect, ...]:
        """Widths between this one and its neighbours; none of a straight line."""
        name = "width" if self.load_width is None else "load_width"
        return self.nearby(name, (_WIDTHS[3] / _WIDTHS[2]) ** (0.5 ** (round_ + 1)))

    def columns(self, rows: Rows) -> F:
        """The share that is lost, times -h."""
        size = self._size(rows)
        largest = np.full(len(size), size.max(initial=0.0))
        if self.history != "no":
            largest = largest_so_far(rows.table, size, self.history)
        below, width = largest - size, self.load_width or self.width
        if self.load_width is None and not rows.unloaded.all():
            middle = rows.taken(f"middle_{self.measure}", lambda: np.median(size[~rows.unloaded]))
            width *= float(middle)
        if not (self.load_width or self.width):
            lost = below / np.where(largest > 0.0, largest, 1.0)
        elif self.is_hyperbolic:
            lost = below / np.maximum(below + width, 1e-300)
        else:
            lost = np.tanh(below / max(width, 1e-300))
        return np.asarray(-(lost[:, None] * rows.material_wrench)[:, :, None])

    def _size(self, rows: Rows) -> F:
        """(N,) the measure of load: a force, the energy, the largest tilt and twist, or reach."""
        if self.load_width is not None:
            return _load(rows.material_wrench, rows.base.outputs)
        away = rows.poses - rows.rest_pose
        if self.measure == "energy":
            return np.asarray(0.5 * np.abs((away * rows.material_wrench).sum(axis=1)))
        of_pose, _ = self.weights(rows.base.outputs, rows.length_m)
        return rows.loaded(np.linalg.norm(away * of_pose, axis=1))

    def weights(self, outputs: tuple[str, ...], length_m: float | None) -> list[list[float]]:
        """(2, 6) a and b of the load W, W^2 = |a (p - p0)|^2 + |b h|^2; zeros: it is the energy."""
        if self.load_width is not None:
            counts = _of_load(outputs)
            return [[0.0] * 6, [float(name in counts) for name in WRENCH]]
        places = {"energy": 0.0, "bend": 0.0, "reach": 1.0}[self.measure]
        turns = {"energy": 0.0, "bend": 1.0, "reach": length_m or 1.0}[self.measure]
        return [[places] * 3 + [turns] * 3, [0.0] * 6]

    @property
    def is_hyperbolic(self) -> bool:
        """Whether the loss is u / (u + width), u what lies below the largest load; else a tanh."""
        return self.load_width is None and self.measure != "energy"


@dataclass(eq=False)
class PermanentSet(TimedEffect):
    """-K_s p_set; p_set follows the largest pose so far, or sums what exceeds a yield length.

    `summed`: each visit adds a share of (1 - y / |x|) (p - p0) where |x| > y, |x| the deflection
    with rotations times the length; `each` coordinate with a share of its own, where no home checks
    show the set by itself. It ends with a run, or is `kept` in joined tables. With fewer than the
    twelve columns p_set follows the largest load so far, beyond a `yield_load`.

    Parameters: share*: part of the largest pose that stays as a set.
    """

    id = "permanent_set"
    physics = "After large poses the mechanism rests a little on the side to which it was bent."
    parameters = listed(Parameter("share", "1", 5e-3, 0.0, 0.5))
    outside = LookAlike(
        "anything that shifts the rest pose for good: a slipped clamp, a moved target, swelling",
        "the home pose after every sample, with a look at clamp and target",
    )
    signature = "the wrench at home grows after large poses"
    needs = "order (time_s), and home checks (kind home)"
    rivals = {
        "marker_motion": "home_after_every_sample",
        "fts_drift": "home_after_every_sample",
        "mullins_softening": "repeat_first_poses",
    }

    memory: str = "largest"
    """`largest`: the set follows the largest pose; `summed` or `each`: all beyond the yield
    length, with one share or one for each coordinate."""
    yield_m: float = optional(0.0)
    """Deflection in m that leaves no set."""
    history: str = optional("run")
    """Whether the set ends with a `run` or is `kept` over all runs."""
    yield_load: float | None = optional(None)
    """With fewer than the twelve columns the force or moment, N or N m, that leaves no set."""

    def __post_init__(self) -> None:
        if self.yield_load is not None:
            self.physics = "The rest moves to the side of the largest load that there was."
            self.needs = _UNLOADING
        if self.memory == "each":
            (share,) = PermanentSet.parameters
            names = (name.rsplit("_", 1)[0] for name in POSE)
            self.parameters = tuple(replace(share, name=f"share_{name}") for name in names)

    def missing(self, table: Table) -> Missing | None:
        """Needs order, and home checks; without these it imitates other effects."""
        if self.yield_load is not None:
            return _needs_unloading(table)
        lacking = super().missing(table)
        if lacking is not None or _has_home(table):
            return lacking
        record = "home pose after every sample"
        return Missing("no home checks", record, imitates=True, forms=self.variants(table))

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """Both memories, the second with four yield lengths; without home checks also `each`."""
        if self.yield_load is not None:
            load = _measured_load(table.measured())
            loads = (float(f"{np.quantile(load, share):.4g}") for share in _YIELDS)
            return tuple(PermanentSet(yield_load=own) for own in (0.0, *loads))
        length = table.meta.length_m
        poses = table.measured().poses
        rest = np.array([np.median(poses[:, 0]) if length is None else length, 0, 0, 0, 0, 0])
        far = _far(poses - rest, float(rest[0]))
        yields = [0.0, *(round(float(np.quantile(far, s)), 5) for s in _YIELDS)]
        memories = ("summed",) if _has_home(table) else ("summed", "each")
        forms = (("largest", 0.0), *((memory, y) for memory in memories for y in yields))
        return tuple(PermanentSet(*form, kept) for kept in memory_options(table) for form in forms)

    def refined(self, table: Table, round_: int) -> tuple[Effect, ...]:
        """Yield lengths between this one and its neighbours."""
        name = "yield_m" if self.yield_load is None else "yield_load"
        return self.nearby(name, 1.0 + 0.2 * 0.5**round_)

    def columns(self, rows: Rows) -> F:
        """-K (p_largest - p0), or -K times the sum of all earlier deflections."""
        if self.yield_load is not None:
            size, load = _load(rows.material_wrench, rows.base.outputs), rows.material_wrench
            at = largest_so_far(rows.table, size, self.history, index=True).astype(np.int64)
            beyond = np.maximum(0.0, size - self.yield_load) / np.maximum(size, 1e-300)
            largest = (load * beyond[:, None])[at]
            moved = largest @ np.linalg.pinv(rows.mean_stiffness[:, rows.of_pose]).T
            return np.asarray(-(rows.stiffness[:, :, rows.of_pose] @ moved[:, :, None]))
        deflection = rows.loaded(rows.poses - rows.rest_pose)
        if self.memory != "largest":
            far = _far(deflection, rows.length_m)
            excess = np.maximum(0.0, far - self.yield_m) / np.maximum(far, 1e-12)
            deflection = deflection * excess[:, None]
            past = np.zeros_like(deflection)
            orders = order_of_visits(rows.table, self.history)
            longest = rows.taken("longest_run", lambda: max(map(len, orders)))
            for order in orders:
                own = deflection[order]
                past[order] = (np.cumsum(own, axis=0) - own) / np.sqrt(longest)
        else:
            energy = 0.5 * np.abs((deflection * rows.material_wrench).sum(axis=1))
            largest = largest_so_far(rows.table, energy, self.history, index=True)
            past = deflection[largest.astype(np.int64)]
        if self.memory == "each":
            return np.asarray(-rows.stiffness * past[:, None, :])
        return np.asarray(-(rows.stiffness @ past[:, :, None]))


def _has_home(table: Table) -> bool:
    return bool((table.text("kind") == "home").any())


def _far(deflection: F, length_m: float) -> F:
    """(N,) length of deflections, rotations times the length."""
    metric = np.array([1.0, 1.0, 1.0, length_m, length_m, length_m])
    return np.asarray(np.sqrt(((deflection * metric) ** 2).sum(axis=1)))


EFFECTS = (
    MullinsSoftening(),
    TemperatureModulus(),
    ThermalExpansion(),
    Ageing(),
    PermanentSet(),
)
FEW = (MullinsSoftening(load_width=0.0), Ageing(), PermanentSet(yield_load=0.0))
