"""Energies of pose and actuation: one potential gives wrench, stiffness, volumes and their changes.

    Pi(p, a) = sum over the products a^k of the actuators' inputs of  a^k U_k(q(p))  +  f(a),

q the mid-frame coordinates, U_k a polynomial of degree D - (order of k) in them, f a polynomial of
the inputs alone, which only the volumes tell. Then

    h = dPi/dp,  q_i = -dPi/da_i,  K = dh/dp,  G = dh/da,  C = dq/da.

An input is a pressure or a tension; its amount q_i is the volume change of the chamber, or the
shortening of the tendon. n equal actuators round the axis: turning the body by 2 pi / n, mirroring
it at the plane of the axis and actuator 1, and turning it end for end move those of each kind among
each other and leave Pi as it is. Each orbit of products has one polynomial, the sum over those
elements that keep its first product; the others follow from it.

The free pose at given inputs and the inputs for a pose are found here too; parameters and errors
are those of the methods of `Model` that call them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any

import numpy as np
from scipy.optimize import Bounds, NonlinearConstraint, least_squares, minimize

from ecm._native import mid_frame
from ecm.errors import ComputationError, InputError, shown
from ecm.io.arrays import F, I, lstsq
from ecm.io.columns import POSE, WRENCH
from ecm.models.maps import EnergyMap, EnergyTerms, SixAxisMap, Symmetry
from ecm.regression.rows import equilibrium

ORDER = 3
"""Largest power of the inputs where a name tells none."""
_PURE_ORDER = 5
"""Order of f: a chamber swells more than in proportion."""
_ROUNDING = 1e-13
"""Share of the largest coefficient below which one is the rounding of the symmetry."""


@dataclass(frozen=True)
class _Orbit:
    """Products that the symmetry moves into each other, and their polynomials.

    `expansions[i] @ c` are the coefficients of the monomials in the polynomial of `products[i]`.
    """

    products: tuple[tuple[int, ...], ...]
    expansions: tuple[F, ...]


@dataclass(frozen=True)
class ActuatedTerms:
    """The terms of an energy of pose and actuation.

    Examples
    --------
    >>> terms = ActuatedTerms(0.1, ("pressure",) * 3, degree=4, order=1)
    >>> [(orbit.products, orbit.expansions[0].shape[1]) for orbit in terms.orbits()]
    [(((0, 0, 0),), 28), (((1, 0, 0), (0, 1, 0), (0, 0, 1)), 26)]
    """

    length_m: float
    kinds: tuple[str, ...]
    """Kind of each actuator; those of one kind stand round the axis in this order."""
    degree: int
    order: int
    body: Symmetry = "alike"
    """alike: equal actuators round the axis, both ends alike; revolution: the ends may differ;
    general: no symmetry."""

    @property
    def of_pose(self) -> EnergyTerms:
        """The terms of each product's polynomial, without symmetry."""
        return EnergyTerms(self.length_m, self.degree, "general")

    def orbits(self) -> tuple[_Orbit, ...]:
        """Orbits of the products, the constant one first."""
        return _orbits(self.kinds, self.degree, self.order, self.body)

    def pure(self) -> tuple[tuple[tuple[int, ...], ...], ...]:
        """Orbits of the products in the polynomial of the inputs alone."""
        return _product_orbits(self.kinds, _PURE_ORDER, self.body)[1:]

    def count(self) -> int:
        """Number of coefficients."""
        return sum(orbit.expansions[0].shape[1] for orbit in self.orbits())

    def split(self, coefficients: F) -> Iterator[tuple[tuple[int, ...], F, F]]:
        """Each product with its expansion and the coefficients of its orbit."""
        begin = 0
        for orbit in self.orbits():
            end = begin + orbit.expansions[0].shape[1]
            for product, expansion in zip(orbit.products, orbit.expansions, strict=True):
                yield product, expansion, coefficients[begin:end]
            begin = end


@cache
def exponents(degree: int) -> I:
    """(k, 6) exponents of all monomials of q up to a degree, without the constant one.

    Examples
    --------
    >>> exponents(1).tolist()[0], len(exponents(4))
    ([1, 0, 0, 0, 0, 0], 209)
    """
    zeros = np.zeros(math.comb(6 + degree, degree) - 1)
    return np.asarray(EnergyTerms(1.0, degree, "general").map(np.ones(2), zeros).model.terms)


def _monomials(q: F, powers: I) -> F:
    """(N, k) values of the monomials at q (N, 6)."""
    # Each coordinate to each power once: a monomial takes its six from them.
    factors = (q[..., None] ** np.arange(powers.max() + 1))[:, range(6), powers]
    return np.ascontiguousarray(np.prod(factors, axis=2))


def _elements(kinds: tuple[str, ...], body: Symmetry) -> list[tuple[F, tuple[int, ...]]]:
    """Matrices (6, 6) on q, and the actuator that comes in the place of each, of the group."""
    if body == "general":
        return [(np.eye(6), tuple(range(len(kinds))))]
    rings = [[k for k, own in enumerate(kinds) if own == kind] for kind in dict.fromkeys(kinds)]
    turns = math.gcd(*map(len, rings))

    def places(turn: int, sign: int) -> tuple[int, ...]:
        moved = list(range(len(kinds)))
        for ring in rings:
            for k, own in enumerate(ring):
                moved[own] = ring[(sign * k + turn * len(ring) // turns) % len(ring)]
        return tuple(moved)

    mirror = np.diag([1.0, 1.0, -1.0, -1.0, -1.0, 1.0])
    ends = np.diag([1.0, -1.0, 1.0, 1.0, -1.0, 1.0])
    found: list[tuple[Any, tuple[int, ...]]] = []
    for turn in range(turns):
        angle = 2.0 * np.pi * turn / turns
        turned = np.eye(3)
        turned[1:, 1:] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        matrix = np.kron(np.eye(2), turned)
        for change in (np.eye(6), ends) if body == "alike" else (np.eye(6),):
            # Turning end for end goes about the axis of actuator 1.
            sign = -1 if change is ends else 1
            found.append((matrix @ change, places(turn, sign)))
            found.append((matrix @ mirror @ change, places(turn, -sign)))
    return found


@cache
def _product_orbits(
    kinds: tuple[str, ...], order: int, body: Symmetry
) -> tuple[tuple[tuple[int, ...], ...], ...]:
    """Products up to an order that the group moves into each other, by order."""
    places = {moved for _, moved in _elements(kinds, body)} or {()}
    orbits: list[tuple[tuple[int, ...], ...]] = []
    for size in range(order + 1):
        chosen = itertools.combinations_with_replacement(range(len(kinds)), size)
        left = {tuple(own.count(k) for k in range(len(kinds))) for own in chosen}
        while left:
            members = {_moved(max(left), place) for place in places}
            orbits.append(tuple(sorted(members, reverse=True)))
            left -= members
    return tuple(orbits)


@cache
def _orbits(kinds: tuple[str, ...], degree: int, order: int, body: Symmetry) -> tuple[_Orbit, ...]:
    group = _elements(kinds, body)
    powers = exponents(degree)
    actions = [_action(matrix, powers) for matrix, _ in group]
    orbits: list[_Orbit] = []
    for members in _product_orbits(kinds, order, body):
        moved = [_moved(members[0], places) for _, places in group]
        keeping = [own for own, other in zip(actions, moved, strict=True) if other == members[0]]
        low = powers.sum(axis=1) <= max(degree - sum(members[0]), 1)
        basis = _basis(np.mean(keeping, axis=0), low)
        expansions = tuple(actions[moved.index(other)] @ basis for other in members)
        orbits.append(_Orbit(members, expansions))
    return tuple(orbits)


def _moved(product: tuple[int, ...], places: tuple[int, ...]) -> tuple[int, ...]:
    """The product after actuator k has come to places[k]."""
    moved = [0] * len(product)
    for k, power in enumerate(product):
        moved[places[k]] = power
    return tuple(moved)


def _action(matrix: F, powers: I) -> F:
    """(k, k) matrix on the coefficients of U that gives those of U(matrix^-1 q)."""
    degrees = powers.sum(axis=1)
    action = np.zeros((len(powers), len(powers)))
    random = np.random.default_rng(0)
    for degree in np.unique(degrees):
        own = np.flatnonzero(degrees == degree)
        q = random.uniform(-1.0, 1.0, (2 * len(own) + 10, 6))
        # The transpose is the inverse.
        block = lstsq(_monomials(q, powers[own]), _monomials(q @ matrix, powers[own]))
        action[np.ix_(own, own)] = np.where(np.abs(block) > 1e-9, block, 0.0)
    return action


def _basis(projector: F, low: Any) -> F:
    """(k, r) independent columns of a projector among the monomials `low`, the first ones first."""
    chosen: list[F] = []
    orthonormal: list[F] = []
    for column in projector[:, low].T:
        size = np.linalg.norm(column)
        left = column.copy()
        for known in orthonormal:
            left -= known * (known @ left)
        if size > 1e-9 and np.linalg.norm(left) > 1e-6 * size:
            orthonormal.append(left / np.linalg.norm(left))
            chosen.append(column / np.abs(column).max())
    return np.asarray(np.array(chosen).T.reshape(len(projector), len(chosen)), dtype=np.float64)


@dataclass(frozen=True)
class ActuatedMap(SixAxisMap):
    """A polynomial energy of pose and actuation: rows (N, 6 + m), or poses (N, 6) without any.

    Parameters
    ----------
    terms
        Length (m), kinds of the actuators, degree, order and symmetry.
    scale
        (2,) of length (m) and angle (rad) that make the pose dimensionless.
    input_scale
        (m,) of each input, Pa or N; those of one kind have the same one.
    coefficients
        (k,) J, by orbit.
    pure_J
        (o,) coefficients of the polynomial of the inputs alone; zero where no amount was measured.
    actuators
        Their columns: after the six of the pose.
    """

    terms: ActuatedTerms
    scale: F
    input_scale: F
    coefficients: F
    pure_J: F
    actuators: tuple[str, ...]

    kind = "actuated"

    @property
    def name(self) -> str:
        """`actuatedD`, with `-revolution` or `-general`, and `:ORDER` where it is not 3."""
        return name_of(self.terms.degree, self.terms.order, self.terms.body)

    @property
    def length_m(self) -> float:
        """Length of the mechanism, m."""
        return self.terms.length_m

    @cached_property
    def parts(self) -> list[tuple[tuple[int, ...], EnergyMap]]:
        """Powers (m,) of the inputs over `input_scale`, and the energy of the pose beside them.

        The potential is the sum of the products, but for the polynomial of the inputs alone.
        """
        split = list(self.terms.split(self.coefficients))
        coefficients = np.array([expansion @ own for _, expansion, own in split])
        # Symmetry makes most of them 0, but for rounding: monomials that nothing evaluates.
        coefficients[np.abs(coefficients) < _ROUNDING * np.abs(coefficients).max()] = 0.0
        energies = [self.terms.of_pose.map(self.scale, own) for own in coefficients]
        return [(product, energy) for (product, *_), energy in zip(split, energies, strict=True)]

    def _split(self, rows: F) -> tuple[F, F]:
        """Poses (N, 6) and dimensionless inputs (N, m) of rows (N, 6 + m), or of poses alone."""
        at = np.ascontiguousarray(rows[:, :6])
        if rows.shape[1] == at.shape[1]:
            return at, np.zeros((len(at), len(self.actuators)))
        return at, rows[:, 6:] / self.input_scale

    def predict(self, poses: F) -> F:
        """(N, 6 + m) poses and inputs to (N, 6) wrenches."""
        at, a = self._split(poses)
        return np.asarray(sum(power_of(a, k)[:, None] * u.predict(at) for k, u in self.parts))

    def stiffness(self, poses: F, kind: str = "partial") -> F:
        """(N, 6, 6) K = dh/dp at the inputs."""
        at, a = self._split(poses)
        found = np.zeros((len(at), 6, 6))
        for product, energy in self.parts:
            found += power_of(a, product)[:, None, None] * energy.stiffness(at, kind)
        return found

    def actuation_jacobian(self, poses: F) -> F:
        """(N, 6, m) G = dh/da at fixed pose: m^2 and m^3 by a pressure, 1 and m by a tension."""
        at, a = self._split(poses)
        found = np.zeros((len(at), 6, len(self.actuators)))
        for product, energy in self.parts:
            wrench = energy.predict(at)
            for i in range(len(self.actuators)):
                found[:, :, i] += slope_of(a, product, (i,))[:, None] * wrench
        return found / self.input_scale

    def columns(self, poses: F) -> F:
        """(N, 6, k) wrench of each coefficient."""
        at, a = self._split(poses)
        regressor = self.terms.of_pose.regressor(at, self.scale)

        def of(product: tuple[int, ...], expansion: F) -> F:
            used = expansion.any(axis=1)  # a few monomials of all
            return power_of(a, product)[:, None, None] * (regressor[..., used] @ expansion[used])

        return self._combined(of)

    def further_columns(self, poses: F) -> F:
        """(N, 6, k) wrench of each coefficient of an energy of one degree more."""
        terms = replace(self.terms, degree=self.terms.degree + 1)
        return replace(self, terms=terms).columns(poses)

    def _combined(self, of: Any) -> F:
        """Arrays (..., k) of the products, summed within each orbit."""
        parts = [
            sum(of(*member) for member in zip(orbit.products, orbit.expansions, strict=True))
            for orbit in self.terms.orbits()
        ]
        return np.asarray(np.concatenate(parts, axis=-1), dtype=np.float64)

    def amount_columns(self, poses: F) -> tuple[F, F]:
        """(N, m, k) and (N, m, o) amounts q of each coefficient, and of each of `pure_J`."""
        at, a = self._split(poses)
        q = mid_frame(at, self.terms.length_m) / np.repeat(self.scale, 3)
        monomials = _monomials(q, exponents(self.terms.degree))

        def slopes(product: tuple[int, ...]) -> F:
            by_input = [slope_of(a, product, (i,)) for i in range(len(self.actuators))]
            return np.asarray(-np.stack(by_input, axis=1) / self.input_scale, dtype=np.float64)

        columns = self._combined(
            lambda product, expansion: (
                slopes(product)[:, :, None] * (monomials @ expansion)[:, None, :]
            )
        )
        pure = [sum(slopes(product) for product in orbit) for orbit in self.terms.pure()]
        return columns, np.stack(pure, axis=2)

    def amounts(self, poses: F) -> F:
        """(N, m) q at poses and inputs (N, 6 + m): volume changes in m^3, shortenings in m."""
        columns, pure = self.amount_columns(poses)
        return np.asarray(columns @ self.coefficients + pure @ self.pure_J)

    def amount_jacobian(self, poses: F) -> F:
        """(N, m, m), C = dq/da at fixed pose, m^3/Pa by pressures."""
        at, a = self._split(poses)
        m = len(self.actuators)
        parts = [(product, energy.model.energy_J(at)) for product, energy in self.parts]
        for orbit, value in zip(self.terms.pure(), self.pure_J, strict=True):
            parts += [(product, np.full(len(at), value)) for product in orbit]
        found = np.zeros((len(at), m, m))
        for product, value in parts:
            for i, j in itertools.product(range(m), repeat=2):
                found[:, i, j] -= slope_of(a, product, (i, j)) * value
        return found / np.outer(self.input_scale, self.input_scale)

    def with_coefficients(self, coefficients: F) -> ActuatedMap:
        """The same terms with other coefficients (k,)."""
        return replace(self, coefficients=np.asarray(coefficients, dtype=np.float64))

    def document(self) -> dict[str, Any]:
        """Terms, scales and coefficients for a model file."""
        return self.head(
            length_m=self.terms.length_m,
            parameters={
                "actuators": list(self.actuators),
                "degree": self.terms.degree,
                "order": self.terms.order,
                "symmetry": self.terms.body,
                "scale": [*self.scale.tolist(), *self.input_scale.tolist()],
                "coefficients_J": self.coefficients.tolist(),
                "pure_J": self.pure_J.tolist(),
            },
        )

    def written_out(self) -> dict[str, Any]:
        """What the exported code is made of: `parts` beside each product, without symmetry."""
        return {
            "inputs": [*self.inputs, *self.actuators],
            "degree": self.terms.degree,
            "scale": self.scale.tolist(),
            "input_scale": self.input_scale.tolist(),
            "parts": [
                {"powers": list(product), "coefficients_J": energy.coefficients.tolist()}
                for product, energy in self.parts
            ],
        }

    @staticmethod
    def from_document(document: dict[str, Any]) -> ActuatedMap:
        """Return the map of an opened model file."""
        own = document["parameters"]
        actuators = tuple(own["actuators"])
        terms = ActuatedTerms(
            float(document["length_m"]),
            tuple(map(kind_of, actuators)),
            int(own["degree"]),
            int(own["order"]),
            own["symmetry"],
        )
        scale, coefficients, constants = (
            np.asarray(own[name], dtype=np.float64)
            for name in ("scale", "coefficients_J", "pure_J")
        )
        if len(coefficients) != terms.count() or len(constants) != len(terms.pure()):
            raise InputError(
                f"coefficients has {len(coefficients)} numbers and pure_J {len(constants)}, "
                f"expected {terms.count()} and {len(terms.pure())}"
            )
        if len(scale) not in (3, 2 + len(actuators)):
            raise InputError(
                f"scale has {len(scale)} numbers, expected length, angle and those of the "
                f"{len(actuators)} inputs, or one for all of them"
            )
        inputs = np.broadcast_to(scale[2:], len(actuators))
        return ActuatedMap(terms, scale[:2], inputs, coefficients, constants, actuators)

    def at(self, inputs: F) -> EnergyMap:
        """The energy of the pose alone at constant inputs (m,), for exports and controllers."""
        a = np.asarray(inputs, dtype=np.float64)[None] / self.input_scale
        coefficients = sum(
            power_of(a, product)[0] * energy.coefficients for product, energy in self.parts
        )
        return self.terms.of_pose.map(self.scale, np.asarray(coefficients))


def kind_of(name: str) -> str:
    return name.partition("_")[0]


def power_of(a: F, product: tuple[int, ...]) -> F:
    """(N,) values of a product of inputs (N, m)."""
    return np.asarray(np.prod(a ** np.array(product), axis=1))


def slope_of(a: F, product: tuple[int, ...], by: tuple[int, ...]) -> F:
    """(N,) derivative of a product of inputs (N, m) by some of them, one after the other."""
    factor, powers = 1.0, list(product)
    for i in by:
        factor *= powers[i]
        powers[i] -= 1
    if factor == 0.0:
        return np.zeros(len(a))
    return factor * power_of(a, tuple(powers))


def name_of(degree: int, order: int, body: Symmetry) -> str:
    suffix = "" if body == "alike" else f"-{body}"
    return f"actuated{degree}{suffix}" + ("" if order == ORDER else f":{order}")


_STARTS = (0.5, 0.0, 1.0)
"""Starts between the limits of the inputs of a search."""
_HELD_N = 1e-5
"""Largest force, and moment over the length, by which an inequality may be missed."""


def free_pose(
    energy: ActuatedMap, inputs: F, wrench: F | None = None, *, start: F | None = None
) -> tuple[F, F]:
    """Pose (6,) that takes a wrench (6,) at these inputs (m,), and its change dp/da (6, m)."""
    goal = _finite("free_pose: wrench", np.zeros(6) if wrench is None else wrench, (6,))
    a = _finite("free_pose: actuation", inputs, (len(energy.actuators),))
    rest = np.array([energy.terms.length_m, 0.0, 0.0, 0.0, 0.0, 0.0])
    pose = _finite("free_pose: start", rest if start is None else start, (6,))
    none, share, step = np.zeros((1, 0)), 0.0, 1.0
    while share < 1.0:
        aim = min(1.0, share + step)
        moved, found = equilibrium(energy.at(aim * a), pose[None], none, aim * goal, rest[0])
        if found[0]:
            pose, share = moved[0], aim
            continue
        step *= 0.5
        if step < 1.0 / 64.0:
            raise ComputationError(
                f"free_pose: no equilibrium was found beyond {100.0 * share:.0f} % of the "
                "inputs and the wrench; give smaller ones, or a start that is closer"
            )
    row = np.concatenate([pose, a])[None]
    slope = np.linalg.solve(energy.stiffness(row)[0], energy.actuation_jacobian(row)[0])
    return pose, np.asarray(-slope)


def _finite(what: str, given: Any, shape: tuple[int, ...]) -> F:
    """Return an array of this shape; InputError for another one, or a number that is not finite."""
    try:
        found = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError):
        found = np.zeros((0, 0, 0))
    if found.shape != shape or not np.isfinite(found).all():
        raise InputError(f"{what} = {shown(given)}: expected finite numbers of shape {shape}")
    return found


@dataclass(frozen=True)
class Held:
    """A pose that is held against a wrench by inputs within limits, over `input_scale`."""

    base: ActuatedMap
    at: F
    """(6,) the pose."""
    goal: F
    """(6,) the wrench, N and N m."""
    bounds: F
    """(m, 2) dimensionless."""

    @staticmethod
    def of(
        base: ActuatedMap,
        pose: F,
        wrench: F | None,
        limits: Sequence[tuple[float, float]],
        caller: str,
    ) -> Held:
        """What a caller was given; InputError for other numbers."""
        bounds = _finite(f"{caller}: limits", limits, (len(base.actuators), 2))
        for name, (low, high) in zip(base.actuators, bounds, strict=True):
            if low >= high:
                raise InputError(
                    f"{caller}: limits of {name} are {low:g} and {high:g}: expected its least "
                    "input, and a larger one"
                )
        at = _finite(f"{caller}: pose", pose, (6,))
        goal = _finite(f"{caller}: wrench", np.zeros(6) if wrench is None else wrench, (6,))
        return Held(base, at, goal, bounds / base.input_scale[:, None])

    @cached_property
    def unit(self) -> F:
        """(6,) that make moments count as forces, over the length."""
        return np.repeat([1.0, 1.0 / self.base.terms.length_m], 3)

    def row(self, a: F) -> F:
        """(1, 6 + m)."""
        return np.concatenate([self.at, a * self.base.input_scale])[None]

    def left(self, a: F) -> F:
        """(6,) wrench that is still needed, N and N m."""
        return np.asarray(self.base.predict(self.row(a))[0] - self.goal)

    def slope(self, a: F) -> F:
        """(6, m) its derivative."""
        return np.asarray(self.base.actuation_jacobian(self.row(a))[0] * self.base.input_scale)

    def nearest(self, start: F, weights: F | None = None) -> F:
        """(m,) inputs of least squares of what is left."""
        unit = self.unit if weights is None else weights

        def left(a: F) -> F:
            return self.left(a) * unit

        def slope(a: F) -> F:
            return self.slope(a) * unit[:, None]

        found = least_squares(left, start, jac=slope, bounds=tuple(self.bounds.T), x_scale="jac")
        return np.asarray(found.x)

    def closest(self) -> tuple[F, F]:
        """Inputs (m,) that leave the least, in their own units, and what is left (6,)."""
        a = self.nearest(self.bounds.mean(axis=1))
        return a * self.base.input_scale, self.left(a)

    def stiffness_range(
        self, along: str | F, tolerance: float | F
    ) -> tuple[tuple[float, F], tuple[float, F]]:
        """Least and largest stiffness along a direction, each with its inputs."""
        own = [name == along for name in POSE] if isinstance(along, str) else along
        d = np.asarray(own, dtype=np.float64)
        tolerances = np.broadcast_to(np.asarray(tolerance, dtype=np.float64), 6)
        if d.shape != (6,) or not d.any() or not (tolerances >= 0.0).all():
            raise InputError(
                f"stiffness_range: along = {along!r}, tolerance = {tolerance!r}: expected one of "
                f"{', '.join(POSE)} or a direction (6,), and 0 or more"
            )
        return self.extreme(1.0, d, tolerances), self.extreme(-1.0, d, tolerances)

    def extreme(self, sign: float, d: F, tolerance: F) -> tuple[float, F]:
        """The least (sign 1) or largest (-1) stiffness d'Kd, and its inputs in their own units."""
        at = self.at[None]
        parts = [(product, float(d @ u.stiffness(at)[0] @ d)) for product, u in self.base.parts]
        size = max(abs(value) for _, value in parts)
        m = len(self.bounds)

        def stiffness(a: F) -> float:
            return float(sum(power_of(a[None], product)[0] * value for product, value in parts))

        def worth(a: F) -> float:
            return sign * stiffness(a) / size

        def rise(a: F) -> F:
            slopes = [
                sum(slope_of(a[None], product, (i,))[0] * value for product, value in parts)
                for i in range(m)
            ]
            return np.asarray(slopes) * sign / size

        free = np.isinf(tolerance)
        unit, within = self.unit[~free], (tolerance * self.unit)[~free]

        def room(a: F) -> F:
            off = self.left(a)[~free] * unit
            return np.concatenate([within - off, within + off])

        def room_slope(a: F) -> F:
            slope = self.slope(a)[~free] * unit[:, None]
            return np.vstack([-slope, slope])

        bounds: Any = Bounds(*self.bounds.T)
        limits: Any = [NonlinearConstraint(room, 0.0, np.inf, jac=room_slope)] * (not free.all())
        best: tuple[float, F] | None = None
        worst = np.full(6, np.inf)
        for share in _STARTS:
            start = self.bounds @ np.array([1.0 - share, share])
            start = self.nearest(start, np.where(free, 0.0, self.unit))
            found = minimize(
                worth, start, jac=rise, bounds=bounds, constraints=limits, method="SLSQP"
            )
            a = np.clip(found.x, *self.bounds.T)
            beyond = np.maximum(np.abs(self.left(a)) - tolerance, 0.0) * self.unit
            if beyond.max() < worst.max():
                worst = beyond
            if beyond.max() < _HELD_N and (best is None or sign * stiffness(a) < sign * best[0]):
                best = stiffness(a), a * self.base.input_scale
        if best is None:
            j = int(np.argmax(worst))
            raise ComputationError(
                f"stiffness_range: no inputs within the limits hold the pose: {WRENCH[j]} stays "
                f"{worst[j] / self.unit[j]:.3g} beyond its tolerance; give a larger tolerance or "
                "wider limits"
            )
        return best
