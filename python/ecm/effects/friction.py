"""Internal friction of the material."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ecm._native import mid_frame
from ecm.effects.pairs import (
    columns_of_pairs,
    listed_numbers,
    names_of,
    needs_both_ways,
    numbers,
    per_pair,
    resisting_pairs,
    short,
    spans,
)
from ecm.effects.protocol import (
    Effect,
    LinearEffect,
    LookAlike,
    Missing,
    Parameter,
    Shape,
    beside,
    listed,
    needs_full,
    needs_time,
    optional,
)
from ecm.effects.relaxation import stretch, stretch_together
from ecm.effects.rod import rest_stiffness, wrench_of
from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.columns import POSE
from ecm.io.table import Table
from ecm.regression.history import approach_cosines, from_both_sides, order_of_visits
from ecm.regression.rows import Rows

_PATHS = (0.02, 0.05, 0.12)
"""Paths to the slip that are tried, over the spread of the poses."""
_SPRINGS, _MEAN_PATHS, _LONGEST = 5, (0.15, 0.4), 0.6
"""Springs side by side, and their mean paths over the spread of each coordinate. Most must slip:
what never does is a stiffness."""
_SLIPS = (0.002, 0.03, 0.1, 0.3)
"""The same along single pose columns, over the range of each."""
_PLAY, _PLAY_SLIPS = 0.5, (0.07, 0.15, 0.3)
"""Share of the path that is play, and the paths with which it is tried."""

_STRAIGHT = 0.95
"""Cosine between way and deflection from which the way follows from the pose."""


@dataclass(eq=False)
class Hysteresis(LinearEffect):
    """c K p^, p^ = d / sqrt(d' M d), d = p - p_from: rate-independent friction of the material.

    With a memory (yield_m > 0) the friction is c k z / y of springs that slip: z follows each
    coordinate of the path, from reading to reading over the pose before, and is limited to |z| = y.
    Coordinates are those of the mid frame, where the stiffness k at rest is diagonal (`middle`), or
    those of the pose with a c for each (`each`).

    With fewer than the twelve columns there is no frame, and the stiffness may be far from that of
    the friction: then springs slip along pairs of columns (`of`), c z / y in N or N m, and c > 0
    where the loops of the motion lose work. A spring behind a play g y, as in gears, pins and
    tendons, pulls once that is used up: c sign(z) max(0, |z| - g y) / (y - g y). What rubs in
    several directions at once, as strands or pressed faces do, pulls against the way: there the
    limit is that of the vector z / y of all these columns, |z / y| <= 1 (`together`).

    Parameters: c: displacement whose static wrench is the friction; c_*: the same for this
    coordinate; friction_*: force or moment that the friction holds.

    Source: Iwan, A distributed-element model for hysteresis and its steady-state dynamic response,
    J. Applied Mechanics 33, 1966 (springs that slip, there many beside each other).
    """

    id = "hysteresis"
    physics = "Internal friction: the wrench depends on the side from which a pose is approached."
    parameters = listed(Parameter("c", "m", 1e-4, -5e-3, 5e-3))
    outside = LookAlike(
        "anything that depends on the way: play in the rig, a shutter's lag, a slow filter",
        "the same poses from both sides at half the speed, and after a rest of a minute",
    )
    signature = "odd in the side of approach, not conservative, zero mean for balanced approaches"
    needs = "poses reached from both sides (approach, or the order of time_s)"
    kind = "time"
    rivals = {
        "stress_relaxation": "both_sides",
        "backlash": "joint_reversal",
        "fts_hysteresis": "load_and_unload_weights",
    }

    stiffness: str = "local"
    """Stiffness that the friction follows: `local`, at `rest`; with a memory `middle` or `each`."""
    yield_m: float = optional(0.0)
    """Path in m to the slip; 0: no memory."""
    springs: int = optional(1)
    """Springs side by side that slip one after the other, evenly between 0 and twice the path: a
    smooth loop, whose height depends on the way back."""
    of: str | None = optional(None)
    """Pairs of columns (`ecm.effects.pairs`) along which springs slip; None: all twelve."""
    slip: str = optional("")
    """Path to the slip of each pose column, m or rad: of the pairs, or of `each` coordinate."""
    play: float = optional(0.0)
    """Share of the path, from 0 to below 1, along which a spring of the pairs does not pull."""
    together: bool = optional(False)
    """Whether the springs of the pairs have one limit, that of their vector; without a play."""

    def __post_init__(self) -> None:
        if self.of is not None:
            self.physics = (
                "Internal friction: the wrench depends on the direction of motion, at any speed."
            )
            self.needs = "time (time_s), or rows step by step, and motion both ways"
            self.parameters = per_pair(self.of, "friction", lower=0.0)
            lacking = [name for name in names_of(self.of) if name not in numbers(self.slip)]
            if lacking:
                raise InputError(f"effect {self.id}: slip has no path of {', '.join(lacking)}")
        elif self.stiffness == "each":
            c = Hysteresis.parameters[0]
            self.parameters = tuple(replace(c, name=f"c_{short(name)}") for name in POSE)

    @property
    def shape(self) -> Shape:
        """The fields; along pairs the stiffness has no part."""
        shape = super().shape
        if self.of is not None:
            del shape["stiffness"]
        return shape

    def missing(self, table: Table) -> Missing | None:
        """Needs poses approached from both sides, with a memory also time; or a continuous test."""
        if self.of is not None:
            return needs_both_ways(table)
        by_time = table.continuous or self.yield_m > 0.0 or bool(self.slip)
        lacking = needs_full(table) or (needs_time(table) if by_time else None)
        if lacking is not None or table.continuous:
            return lacking
        if not table.has("approach") and not table.has("time_s"):
            return Missing("no column approach", "approach, or time_s", absent=True)
        cosines = approach_cosines(table)
        known = cosines[cosines != 0.0]
        if len(known) == 0:
            return Missing("the approach of every row is unknown", "approach")
        one_sided = min(float((known > 0).mean()), float((known < 0).mean())) < 0.05
        if one_sided and float(np.median(np.abs(known))) > _STRAIGHT:
            return Missing("one approach direction", "approach from both sides", imitates=True)
        return None

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """Local stiffness, or that at rest; with time also springs that slip after three paths.

        A continuous test has the path itself, along which all of them slip.
        """
        if self.of is not None:
            of = ",".join(resisting_pairs(table))
            span = {name: spans(table)[name] for name in names_of(of)}
            forms = [(s, 0.0, False) for s in _SLIPS] + [(s, _PLAY, False) for s in _PLAY_SLIPS]
            if len(span) > 1:
                forms += [(s, 0.0, True) for s in _SLIPS]
            return tuple(
                Hysteresis(of=of, slip=listed_numbers(span, s), play=play, together=together)
                for s, play, together in forms
            )
        if needs_time(table) is not None:
            return (Hysteresis("local"), Hysteresis("rest"))
        slipping = [Hysteresis(k, path) for k in ("middle", "each") for path in _paths(table)]
        spread = _spread(table)
        if all(spread.values()):
            slips = (listed_numbers(spread, share) for share in _MEAN_PATHS)
            slipping += [Hysteresis("each", springs=_SPRINGS, slip=slip) for slip in slips]
        if table.continuous:
            return (slipping[1], slipping[0], *slipping[2:])
        return (Hysteresis("local"), slipping[1], Hysteresis("rest"), slipping[0], *slipping[2:])

    def variants_that_step(self, table: Table) -> tuple[Effect, ...]:
        """Springs that slip, where the path is known."""
        forms = () if self.of is not None else self.variants(table)
        return tuple(one for one in forms if one.shape.keys() & {"yield_m", "slip"})

    def refined(self, table: Table, round_: int) -> tuple[Effect, ...]:
        """Paths to the slip between this one and its neighbours, and the share that is play."""
        if self.slip:
            longest = np.inf
            if self.of is None:
                longest = _LONGEST * _spread(table)["x_m"] / numbers(self.slip)["x_m"]
            factors = (one for one in beside(1.0, 2.0 ** (0.5**round_)) if one < longest)
            slips = (listed_numbers(numbers(self.slip), factor) for factor in factors)
            has_play = self.of is not None and not self.together
            pulls = beside(1.0 - self.play, 2.0 ** (0.5**round_)) if has_play else ()
            plays = (float(f"{max(0.0, 1.0 - share):.3g}") for share in pulls)
            return (
                *(replace(self, slip=slip) for slip in slips),
                *(replace(self, play=play) for play in plays if play != self.play),
            )
        return self.nearby("yield_m", 2.4 ** (0.5 ** (round_ + 1)), 1.01 * max(_paths(table)))

    def columns(self, rows: Rows) -> F:
        """K p^; zero where the approach is unknown or nothing moved."""
        if self.of is not None:
            springs = dict(zip(names_of(self.of), self._of_pairs(rows).T, strict=True))
            return columns_of_pairs(rows, self.of, springs.__getitem__)
        if self.yield_m > 0.0 or self.slip:
            return self._of_slipping_springs(rows)
        step = rows.poses - rows.came_from
        step = np.where(np.isfinite(step), step, 0.0)
        metric = np.array([1.0, 1.0, 1.0] + [rows.length_m**2] * 3)
        size = np.sqrt((step**2) @ metric)
        direction = step / np.where(size > 1e-9, size, np.inf)[:, None]
        stiffness = rows.stiffness
        if self.stiffness == "rest":
            rest = rows.base.stiffness(rows.rest_pose[None, :])
            stiffness = rows.loaded(np.broadcast_to(rest, stiffness.shape))
        return np.asarray(stiffness @ direction[:, :, None])

    def _of_pairs(self, rows: Rows) -> F:
        """(N, k) force over c along each pose column, from the first row of each run."""
        names = names_of(self.of or "")
        limits = np.array([numbers(self.slip)[name] for name in names])
        values = rows.table.matrix(names)
        last = from_both_sides(rows.table, values) if rows.quiet else values
        found = np.zeros(values.shape)
        stretched = stretch_together if self.together else stretch
        for order in order_of_visits(rows.table):
            path, own = ((one[order] - values[order[0]]) / limits for one in (values, last))
            found[order] = stretched(path, 1.0, own)
        return (found - np.clip(found, -self.play, self.play)) / (1.0 - self.play)

    def _of_slipping_springs(self, rows: Rows) -> F:
        """(N, 6, k) force of springs that slip: one column, or one for each coordinate."""
        length = rows.length_m
        metric = np.array([1.0, 1.0, 1.0, length, length, length])
        path = rows.measured
        before = path.known_before
        rest = rows.base.stiffness(rows.rest_pose[None, :])[0]
        if self.stiffness == "each":
            at, came, last = (one - rows.rest_pose for one in (path.poses, before, rows.poses))
        else:
            at, came, last = (mid_frame(one, length) for one in (path.poses, before, rows.poses))
        slip = np.full(6, self.yield_m)
        if self.slip:
            slip = metric * [numbers(self.slip)[name] for name in POSE]
        friction = np.zeros_like(at)
        for order in order_of_visits(rows.table):
            way, own = (
                np.stack([came[order], one[order]], axis=1).reshape(-1, 6) * metric
                for one in (at, last)
            )
            if rows.table.continuous:  # as at `init` unstretched where a log begins
                way, own = way - way[0], own - way[0]
            for share in (2.0 * np.arange(self.springs) + 1.0) / self.springs:
                friction[order] += stretch(way, share * slip, own)[1::2]
        friction *= (~rows.unloaded)[:, None] / (self.springs * slip)
        if self.stiffness == "each":
            return np.asarray((friction * np.diag(rest) / metric)[:, :, None] * np.eye(6))
        k = rest_stiffness(rows).along
        return wrench_of(rows.poses, friction * k / metric)[:, :, None]


@dataclass(eq=False)
class SealFriction(LinearEffect):
    """(c + g a) z / y along pairs of columns: springs that slip, as of `hysteresis`.

    What presses the sliding faces together is the input a of an actuator: the pressure behind a
    seal, the tension in a sheath. Both c and g lose work.

    Parameters: *_growth: growth of the friction with the input; friction_*: force or moment that
    the friction holds at no input.
    """

    id = "seal_friction"
    physics = "Friction of a seal or sheath grows with the input of an actuator."
    outside = LookAlike(
        "anything that lags behind the motion by more at more pressure: a long tube, a regulator",
        "the same motion at a third of the speed, at two pressures",
    )
    signature = "changes its sign with the direction of motion, and grows with the input"
    needs = "time (time_s), motion both ways, and pressure_1_Pa that varies"
    kind = "time"
    rivals = {"hysteresis": "both_sides", "viscous_damping": "two_speeds"}

    of: str = ""
    """Pairs of columns (`ecm.effects.pairs`) along which springs slip."""
    slip: str = ""
    """Path to the slip of each pose column of the pairs, m or rad."""
    by: str = ""
    """Column of the input."""

    def __post_init__(self) -> None:
        constant = per_pair(self.of, "friction", lower=0.0)
        growth = [
            replace(one, name=f"{one.name}_growth", unit=f"{one.unit}/{unit}", scale=scale)
            for one in constant
            for unit, scale in [("Pa", 1e-5 * one.scale) if "Pa" in self.by else ("N", 0.1)]
        ]
        self.parameters = (*constant, *growth)
        if self.by:
            self.physics = f"Friction of a seal or sheath grows with {self.by}."

    def missing(self, table: Table) -> Missing | None:
        """Needs an input that varies, and motion both ways."""
        if not any(np.ptp(table.column(name)) > 0.0 for name in table.actuation_columns):
            return Missing("no input of an actuator varies", "pressure_1_Pa at two pressures")
        return needs_both_ways(table)

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """Springs of each path, by each input that varies."""
        plain = Hysteresis(of="").variants(table)
        return tuple(
            SealFriction(str(form.shape["of"]), str(form.shape["slip"]), name)
            for name in table.actuation_columns
            if np.ptp(table.column(name)) > 0.0
            for form in plain
            if form.shape.keys() == {"of", "slip"}
        )

    def plain_form(self) -> Hysteresis:
        """Friction that is alike at every input."""
        return Hysteresis(of=self.of, slip=self.slip)

    def refined(self, table: Table, round_: int) -> tuple[Effect, ...]:
        """Paths to the slip between this one and its neighbours."""
        others = self.plain_form().refined(table, round_)
        plain = (other.shape for other in others if "play" not in other.shape)
        return tuple(replace(self, slip=str(shape["slip"])) for shape in plain)

    def columns(self, rows: Rows) -> F:
        """(N, m, 2 k) the springs' forces, and these times the input."""
        springs = self.plain_form().columns(rows)
        a = rows.table.column(self.by)[:, None, None]
        return np.concatenate([springs, a * springs], axis=2)


def _spread(table: Table) -> dict[str, float]:
    """Standard deviation of each pose column."""
    return dict(zip(POSE, table.measured().poses.std(axis=0).tolist(), strict=True))


def _paths(table: Table) -> list[float]:
    """Paths to the slip in m: a spring that never slips would be a stiffness."""
    poses = table.measured().poses
    length = float(table.meta.mechanism.get("length_m", np.median(poses[:, 0])))
    far = poses[:, :3].std(axis=0).max() + length * poses[:, 3:].std(axis=0).max()
    return [float(f"{share * far:.3g}") for share in _PATHS]


EFFECTS = (Hysteresis(),)
FEW = (Hysteresis(of=""),)
ACTUATED_FEW = (SealFriction(),)
"""Effects of tables with actuators and fewer than the twelve columns."""
