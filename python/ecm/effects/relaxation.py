"""Stress relaxation of a viscoelastic material, at rest and while it is moved.

Scans along the order of rows: what fades, and play. Each row needs the state after the one before.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import lapack

from ecm._native import mid_frame
from ecm.effects.pairs import losing_pairs, turns
from ecm.effects.protocol import (
    Effect,
    LinearEffect,
    LookAlike,
    Missing,
    Parameter,
    beside,
    listed,
    needs_full,
    needs_varying,
    optional,
)
from ecm.effects.rod import generalised, rest_stiffness, wrench_of
from ecm.io.arrays import F
from ecm.io.table import Table
from ecm.regression.history import from_both_sides, order_of_visits, row_before
from ecm.regression.rows import Rows, is_whole


def fading(fades: F, grown: F, first: F) -> F:
    """(n + 1, m) states x_i = x_(i-1) fade_i + grown_i from a first one.

    Parameters
    ----------
    fades
        (n,).
    grown
        (n, m).
    first
        (m,).

    Examples
    --------
    >>> fading(np.array([0.5, 0.5]), np.array([[1.0], [0.0]]), np.zeros(1)).tolist()
    [[0.0], [1.0], [0.5]]
    """
    # x_i - fade_i x_(i-1) = grown_i: a matrix of two diagonals.
    diagonals = np.ones((2, len(fades) + 1))
    diagonals[1, :-1] = -fades
    steps = np.concatenate([first[None, :], grown])
    return np.asarray(lapack.dtbtrs(diagonals, steps, uplo="L", diag="U")[0])


def play(loads: F, width: float | F) -> F:
    """(n, m) position of sliders that each load pushes before it, with a play of +- width.

    What a spring that slips is stretched is its load less this position.

    Parameters
    ----------
    loads
        (n, m), from a slider at 0.
    width
        One, or (m,).

    Examples
    --------
    >>> play(np.array([[3.0], [2.5], [0.0]]), 1.0).tolist()
    [[2.0], [2.0], [1.0]]
    """
    # The rows are cut into about as many stretches as each has rows, and all take a step together.
    # After each row a slider is between a least and a largest position, wherever it was first.
    least, largest = _stretches(loads - width), _stretches(loads + width)
    for i in range(1, len(least)):
        low, high = least[i].copy(), largest[i].copy()
        for end in (least, largest):
            np.minimum(np.maximum(end[i - 1], low), high, out=end[i])
    begin = np.empty(least.shape[1:])
    state = np.zeros(loads.shape[1])
    for place, (low, high) in enumerate(zip(least[-1], largest[-1], strict=True)):
        begin[place] = state
        state = np.minimum(np.maximum(state, low), high)
    states = np.minimum(np.maximum(begin, least), largest)
    return np.asarray(states.swapaxes(0, 1).reshape(-1, loads.shape[1])[: len(loads)])


def stretch(path: F, width: float | F, last: F) -> F:
    """(n, m) how far a spring is stretched that slips: its load less the slider it pushes.

    Parameters
    ----------
    path
        (n, m) loads up to each row.
    width
        One, or (m,): from there on it slips.
    last
        (n, m) load of the row itself.

    Examples
    --------
    >>> path = np.array([[3.0], [2.5], [0.0]])
    >>> stretch(path, 1.0, path).tolist()
    [[1.0], [0.5], [-1.0]]
    """
    before = np.concatenate([np.zeros((1, path.shape[1])), play(path, width)[:-1]])
    return np.asarray(last - np.clip(before, last - width, last + width))


_SLIPS = 1.0 + 1e-5
"""Length over the limit from which a vector slips, in exported steps as well."""


def stretch_together(path: F, width: float, last: F) -> F:
    """(n, m) the same of springs that slip as one: the length of their vector is limited.

    Parameters
    ----------
    path
        (n, m) loads up to each row.
    width
        Length from which on the vector slips, along the way.
    last
        (n, m) load of the row itself.

    Examples
    --------
    >>> path = np.array([[3.0, 4.0], [3.0, 4.5]])
    >>> stretch_together(path, 1.0, path).round(3).tolist()
    [[0.6, 0.8], [0.419, 0.908]]
    """
    before, slider = np.empty(path.shape), np.zeros(path.shape[1])
    for i in range(len(path)):  # no bounds of a slider as in `play`: its way depends on its place
        before[i], away = slider, path[i] - slider
        if (size := float(np.sqrt(away @ away))) > _SLIPS * width:
            slider = path[i] - away * (width / size)
    away = last - before
    sizes = np.linalg.norm(away, axis=1, keepdims=True)
    # Rounding shortens none that stands still at the limit.
    return np.asarray(away / np.where(sizes > _SLIPS * width, sizes / width, 1.0))


def _stretches(values: F) -> F:
    """(length, count, m) rows (n, m) in stretches, the place in a stretch first; zeros at the end.

    A copy, in which a step of all stretches lies together.
    """
    n, m = values.shape
    length = max(1, int(np.sqrt(n)))
    count = -(-n // length)
    filled = np.zeros((count * length, m))
    filled[:n] = values
    return np.ascontiguousarray(filled.reshape(count, length, m).swapaxes(0, 1))


_TAUS = 12
"""Time constants that are tried for a continuous test; the best is refined afterwards."""
_APART = 2.0
"""Least ratio of the time constants of two branches."""


@dataclass(eq=False)
class StressRelaxation(LinearEffect):
    """h (1 + g exp(-d / tau)), d the time at rest; in a continuous test its hereditary form.

    There h(t) = h_e + g int exp(-(t - s) / tau) d(K_m p), K_m the mean stiffness of the rows of the
    fit (`linear`), or with d h_e in place of d(K_m p) (`elastic`), from the first sample of a run
    on, at which all is relaxed, as at `init` of a controller. The dwell form is the limit of both
    for a fast approach. A second branch has a time constant of its own. `visits` is
    the same integral over the path between readings, which includes the rest of earlier poses.
    In the continuous forms the factor is no share: it is what relaxes over the static load.

    In the mid `frame` a branch is a force to its coordinates q, k q with the stiffness k at rest
    or the static force, so that stress turns with the body; with k q it can only take energy.

    With fewer than the twelve columns there is no frame, and the static slope may be negative: a
    branch then has the sign with which it loses work (`loses`).

    Parameters: *: what relaxes at rest, over the static wrench.

    Source: Christensen, Theory of Viscoelasticity, 2nd edition, 1982 (hereditary integral).
    """

    id = "stress_relaxation"
    physics = "After a move the stress decays at rest, so a short dwell reads a larger wrench."
    parameters = listed(Parameter("g", "1", 0.02, -0.2, 1.0))
    outside = LookAlike(
        "any reading that settles after a move: a sensor's filter, a lag, a slipping clamp",
        "a hold of 60 s, also with a steel spring in place of the mechanism",
    )
    signature = "proportional to h, decays at rest, zero at home"
    needs = "dwell times that differ (dwell_s), or time (time_s)"
    kind = "time"
    rivals = {
        "ageing": "hold_one_pose",
        "hysteresis": "three_dwells",
        "mullins_softening": "hold_one_pose",
        "viscous_damping": "hold_one_pose",
    }

    tau_s: float = 10.0
    """Time constant."""
    overstress: str = optional("")
    """Part that relaxes in a continuous test: `linear` or `elastic`."""
    second_tau_s: float = optional(0.0)
    """Time constant of a second branch; 0: none."""
    path: str = optional("")
    """`visits`: integrated over the path between readings."""
    frame: str = optional("")
    """`middle`: the relaxing stress lies in the mid frame; else in base axes."""
    samples: str = optional("")
    """With fewer than the twelve columns what it follows: `time`, or `dwell` times; else empty."""
    loses: str = optional("")
    """Pairs of columns (`ecm.effects.pairs`) whose closed loops lose work: there a branch resists,
    whatever the static slope."""

    def __post_init__(self) -> None:
        if self.samples:
            self.physics = (
                "The wrench decays at rest after a move, and creeps where the load is held."
            )
            self.needs = "time (time_s), or dwell times that differ (dwell_s)"
        if self.overstress:
            # Over the static load: a soft adhesive carries several times that while it is moved.
            names = ("over_static", "over_static_second")[: self.branches]
            self.parameters = tuple(Parameter(name, "1", 0.1, -0.5, 50.0) for name in names)
        elif self.branches == 2:
            names = ("g", "g_second")
            self.parameters = tuple(Parameter(name, "1", 0.02, -0.2, 1.0) for name in names)

    @property
    def branches(self) -> int:
        """Number of time constants."""
        return 2 if self.second_tau_s > 0.0 else 1

    def missing(self, table: Table) -> Missing | None:
        """Needs dwell times that differ at least by half, or a continuous test.

        Time is enough with fewer than the twelve columns, or where no dwell time is recorded.
        """
        if self._by_time(table):
            return needs_varying("time_s", 1e-6)(table)
        return _needs_dwells(table)

    def _by_time(self, table: Table) -> bool:
        """Whether time alone says how long the stress had to decay: from reading to reading."""
        if self.samples:
            return table.continuous or _needs_dwells(table) is not None
        return table.continuous or (table.has("time_s") and not table.has("dwell_s"))

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """Time constants that the dwell times or the samples can distinguish.

        An effect that has two branches keeps two, and of a campaign of poses its form.
        """
        few, two = bool(self.samples), self.branches == 2
        frame = "" if few else _frame(table)
        if self._by_time(table):
            taus = self._taus(table)
            loses = ",".join(losing_pairs(table)) if few else ""
            form = StressRelaxation(frame=frame, samples="time" * few, loses=loses)
            return tuple(
                replace(form, tau_s=fast, second_tau_s=slow, overstress=overstress)
                for overstress in ("linear", "elastic")
                for fast, slow in (
                    itertools.combinations(taus[::2], 2) if two else ((tau, 0.0) for tau in taus)
                )
            )
        if two:
            # Apart by more than one step of them.
            taus = self._taus(table)
            pairs = ((fast, slow) for i, fast in enumerate(taus) for slow in taus[i + 2 :])
            return tuple(replace(self, tau_s=fast, second_tau_s=slow) for fast, slow in pairs)
        form = StressRelaxation(samples="dwell" * few)
        plain = [replace(form, tau_s=tau) for tau in form._taus(table)]
        if not table.has("time_s"):
            return tuple(plain)
        path = replace(form, path="visits", frame=frame)
        visits = [replace(path, tau_s=tau) for tau in path._taus(table)]
        return (plain[1], visits[2], *plain[:1], *plain[2:], *visits[:2], *visits[3:])

    def _taus(self, table: Table) -> list[float]:
        """Time constants that are tried, in even steps of their logarithm."""
        if self._by_time(table):
            return list(time_constants(table))
        dwell = table.measured().column("dwell_s")
        low, high = max(float(dwell.min()), 0.1), float(dwell.max())
        # Over the path between readings, branches slower than the dwell times count too.
        last = 4.0 * high if self.path else high
        count = 5 if self.path or self.branches == 2 else 4
        return [float(tau) for tau in np.geomspace(low, last, count)]

    def refined(self, table: Table, round_: int) -> tuple[Effect, ...]:
        """Time constants between these and their neighbours, of two branches each with each."""
        taus = self._taus(table)
        step = (taus[-1] / taus[0]) ** (0.5 ** (round_ + 1) / (len(taus) - 1))
        if self.branches == 1:
            return self.nearby("tau_s", step)
        pairs = itertools.product(*((tau, *beside(tau, step)) for tau in self._constants))
        return tuple(self._with_pair(*pair) for pair in pairs if pair != self._constants)

    def parts(self) -> tuple[Effect, ...]:
        """Its branches, each as an effect of one."""
        if self.branches == 1:
            return (self,)
        return tuple(replace(self, tau_s=tau, second_tau_s=0.0) for tau in self._constants)

    def refinement(self, table: Table) -> tuple[Effect, ...]:
        """The same with two branches; none where it has two already."""
        if not (self.overstress or self.path) or self.branches == 2:
            return ()
        taus = self._taus(table)
        pairs = itertools.combinations(taus[:: 2 if len(taus) == _TAUS else 1], 2)
        return tuple(self._with_pair(*pair) for pair in pairs)

    def _with_pair(self, fast_s: float, slow_s: float) -> StressRelaxation:
        """The same with two branches, which are apart: nearer ones are one, not quite right."""
        return replace(self, tau_s=fast_s, second_tau_s=max(slow_s, _APART * fast_s))

    @property
    def _constants(self) -> tuple[float, ...]:
        return (self.tau_s, self.second_tau_s)[: self.branches]

    def columns(self, rows: Rows) -> F:
        """exp(-d / tau) h, or the convolution, one column per branch."""
        taus = self._constants
        if not self.overstress and self.path:
            return np.stack([over_visits(rows, tau, self.frame) for tau in taus], axis=2)
        if not self.overstress:
            dwell = rows.table.column("dwell_s")
            rests = np.where(np.isfinite(dwell), dwell, np.inf)[:, None] / np.asarray(taus)
            return np.asarray(np.exp(-rests)[:, None, :] * rows.material_wrench[:, :, None])
        path = rows.measured
        if self.frame == "middle":
            if self.overstress == "linear":
                driven = mid_frame(path.poses, rows.length_m) * rest_stiffness(rows).along
            else:
                driven = generalised(path.poses, path.material_wrench)
            forces = [hereditary(rows.table, driven, tau, rows.quiet) for tau in taus]
            return np.stack([wrench_of(rows.poses, force) for force in forces], axis=2)
        driven = path.material_wrench
        if self.overstress == "linear":
            driven = (path.poses * rows.of_pose) @ rows.mean_stiffness.T
        made = np.stack([hereditary(rows.table, driven, tau, rows.quiet) for tau in taus], axis=2)
        if not self.loses:
            return made
        signs = turns(self.loses, rows.mean_stiffness, rows.base.inputs, rows.base.outputs)
        return made * signs[:, None]


def _needs_dwells(table: Table) -> Missing | None:
    """Missing where the dwell times do not differ at least by half."""
    lacking = needs_varying("dwell_s", 1e-3)(table)
    if lacking is None:
        dwell = table.measured().column("dwell_s")
        if dwell.max() < 1.5 * max(float(dwell.min()), 1e-9):
            return Missing("dwell_s does not vary", "dwell_s of 2, 8 and 60 s")
    return lacking


def _frame(table: Table) -> str:
    """The mid frame, where the length is known and all six columns are there."""
    known = table.meta.length_m is not None and needs_full(table) is None
    return "middle" if known else ""


def hereditary(table: Table, driven: F, tau_s: float, quiet: bool = False) -> F:
    """(N, m) int exp(-(t - s) / tau) d(driven) in each run, linear between samples.

    A run begins relaxed at its first sample, as a controller does at `init`.

    Parameters
    ----------
    quiet
        Where a column is noisy, the last step is that between the rows on both sides. The residual
        of a row holds the noise of its own pose: a memory of few rows would be most of all that
        noise, and explain it.
    """
    time = table.column("time_s")
    integral = np.zeros_like(driven)
    last = from_both_sides(table, driven) if quiet else driven
    for order in order_of_visits(table):
        steps = np.diff(time[order])
        shares = _remaining_shares(steps, tau_s)
        grown = np.diff(driven[order], axis=0) * shares[:, None]
        fades = np.exp(-steps / tau_s)
        known = fading(fades, grown, np.zeros(driven.shape[1]))
        if quiet:
            ahead = (last[order[1:]] - driven[order[:-1]]) * shares[:, None]
            known[1:] = fades[:, None] * known[:-1] + ahead
        integral[order] = known
    return integral


def over_visits(rows: Rows, tau_s: float, frame: str = "") -> F:
    """(N, m) the same integral of the base's wrench over the path from reading to reading.

    Between two readings the mechanism moves to the pose before the next one and then to that one,
    each in half of the time before the dwell; with fewer than the twelve columns straight to that.
    """
    table = rows.table
    time = table.column("time_s")
    dwell = table.column("dwell_s")
    known = np.nan_to_num(dwell)
    goals = rows.material_wrench[:, None]
    if is_whole(rows.base):
        came = rows.loaded(rows.of_material(rows.known_before))
        # The first of a run came from rest, wherever that was: it was not held for ever.
        came[(row_before(table) < 0) & ~np.isfinite(rows.came_from).all(axis=1)] = 0.0
        goals = np.stack([came, rows.material_wrench], axis=1)
    if frame == "middle":
        came = generalised(rows.known_before, came)
        goals = np.stack([came, generalised(rows.poses, rows.material_wrench)], axis=1)
    moves, m = goals.shape[1:]
    integral = np.zeros((len(rows), m))
    for order in order_of_visits(table):
        before = np.concatenate([[-np.inf], time[order][:-1]])
        legs = np.maximum(time[order] - known[order] - before, 0.0) / moves
        fades = np.exp(-legs / tau_s)
        shares = _remaining_shares(np.minimum(legs, 1e6), tau_s)
        shares[0] = 1.0
        # After an unknown dwell nothing remains, as in the dwell form.
        rests = np.exp(-np.where(np.isfinite(dwell[order]), dwell[order], np.inf) / tau_s)
        # The moves, then the rest, in which nothing grows.
        parts = np.stack([*[fades] * moves, rests], axis=1).ravel()
        steps = np.diff(goals[order].reshape(-1, m), axis=0, prepend=np.zeros((1, m)))
        grown = np.zeros((len(order), moves + 1, m))
        grown[:, :moves] = steps.reshape(-1, moves, m) * shares[:, None, None]
        integral[order] = fading(parts, grown.reshape(-1, m), np.zeros(m))[moves + 1 :: moves + 1]
    if frame == "middle":
        integral = wrench_of(rows.poses, integral)
    return rows.loaded(integral)


def _remaining_shares(steps_s: F, tau_s: float) -> F:
    """(n,) share of ramps of these durations that has not yet relaxed at their end."""
    ratio = np.asarray(steps_s) / tau_s
    safe = np.where(ratio < 1e-9, 1.0, ratio)
    return np.where(ratio < 1e-9, 1.0, -np.expm1(-safe) / safe)


def time_constants(table: Table) -> tuple[float, ...]:
    """From a few samples to a good part of the longest run."""
    time = table.column("time_s")
    orders = [order for order in order_of_visits(table) if len(order) > 2]
    if not orders:
        return (10.0,)
    step = float(np.median(np.concatenate([np.diff(time[order]) for order in orders])))
    span = max(float(np.ptp(time[order])) for order in orders)
    low = max(step, 1e-3 * span)
    return tuple(float(t) for t in np.geomspace(low, max(0.5 * span, 2.0 * low), _TAUS))


EFFECTS = (StressRelaxation(),)
FEW = (StressRelaxation(samples="time"),)
