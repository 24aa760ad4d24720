"""Energies of pose and actuation, fitted: `actuatedD`, a stated body's, exchanged columns."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from scipy.optimize import least_squares

from ecm.errors import InputError
from ecm.io.arrays import F, I, svd
from ecm.io.columns import POSE, WRENCH, amount_columns
from ecm.io.conventions import WrongConvention, entries_of, wrong_convention
from ecm.io.events import Progress, tell_part
from ecm.io.settings import setting
from ecm.io.table import Table
from ecm.models.actuated_energy import ORDER, ActuatedMap, ActuatedTerms, kind_of, name_of
from ecm.models.errors_in_variables import AllRows, fit_with_pose_noise
from ecm.models.joint_fit import declared_or_fitted
from ecm.models.layout import Layout, array, items, number, one_of, record, text
from ecm.models.maps import (
    SYMMETRIES,
    FittedMap,
    ModelSpecification,
    StiffnessMap,
    Symmetry,
    Weights,
    length_of,
)
from ecm.models.partial import fit_measured, is_partial, measured_part, need_pose
from ecm.regression.noise import whiteners
from ecm.regression.rows import Rows, inputs_of, taken_by

__all__ = ["ActuatedMap", "ActuatedModel", "ActuatedTerms", "exchanged", "misread"]

_LEAST_DEGREE, _MOST_DEGREE, _MOST_ORDER = 3, 6, 4
_WEIGHED = 2
"""Fits with amounts weighed by what the fit before left."""
_LEAST_SHARE = 1e-4
"""Least error of a measured amount over its spread."""
_CONJUGATE = {"volume": "pressure", "length": "tension"}
"""Kind of the input that an amount belongs to."""
_SINGULAR = 1e-10
"""Least singular value over the largest: below it a direction of the coefficients is unknown."""
_EXCHANGED = 1.2
"""Least fall of the error by which columns of actuators count as exchanged."""
_ZERO = 0.1
"""Share of the largest tension that the zero of a load cell may be off."""
_ALL_ORDERS = 4
"""Number of actuators up to which every order is tried; of more only two exchanged."""


def exchanged(table: Table, model: ActuatedModel) -> WrongConvention | None:
    """Which columns of the actuators stand exchanged: in another order they fit far better.

    A model that knows how the actuators stand round the axis errs where two columns are exchanged.
    The error is the geometric mean of the components', for a pressure may show in one alone.
    None where no other order fits 1.2 times better, and for a model without symmetry. Tensions of
    the wrong sign come first, for every model.
    """
    names, low = table.actuation_columns, replace(model, degree=_LEAST_DEGREE)
    if (pushing := _pushing(table, names)) is not None:
        return pushing
    if len(names) < 2 or model.symmetry == "general":
        return None
    kinds = tuple(map(kind_of, names))
    if 3 * len(table) < ActuatedTerms(1.0, kinds, low.degree, low.order, low.symmetry).count():
        return None
    plain = table.drop(*amount_columns(table.columns))

    truth = plain.matrix(plain.wrench_columns)

    def error(order: tuple[str, ...]) -> float:
        columns = {name: table[other] for name, other in zip(names, order, strict=True)}
        own = plain.with_columns(columns)
        fitted = low.fit_map(own, "spread").base
        left = measured_part(fitted, own).predict(own.matrix((*POSE, *names))) - truth
        share = left.std(axis=0) / np.maximum(truth.std(axis=0), 1e-300)
        return float(np.exp(np.mean(np.log(share + 1e-300))))

    if len(names) <= _ALL_ORDERS:
        orders = list(itertools.permutations(names))
    else:
        swaps = [(names[i], names[j]) for j in range(len(names)) for i in range(j + 1)]
        orders = [tuple({a: b, b: a}.get(name, name) for name in names) for a, b in swaps]
    orders = [order for order in orders if tuple(map(kind_of, order)) == kinds]
    errors = {order: error(order) for order in orders}
    best = min(orders, key=lambda order: errors[order])
    if errors[names] <= _EXCHANGED * errors[best]:
        return None
    own = tuple(
        (name, other, 1.0) for name, other in zip(names, best, strict=True) if name != other
    )
    columns = tuple(name for name, *_ in own)
    what = (
        f"{' and '.join(columns)} look exchanged (chambers or tendons swapped): an energy of equal "
        f"actuators errs {100.0 * errors[names]:.2g} % of the spread, with that mended "
        f"{100.0 * errors[best]:.2g} %"
    )
    return WrongConvention(what, columns, decided=True, mend=entries_of(table, own))


def _pushing(table: Table, names: tuple[str, ...]) -> WrongConvention | None:
    """Tendons that would push: below 0 for the most part, and by more than the zero of a cell."""
    ends = {name: (table[name].min(), table[name].max()) for name in names}
    pulls = {name: ends[name] for name in names if kind_of(name) == "tension"}
    zero = _ZERO * max((max(-low, high) for low, high in pulls.values()), default=0.0)
    own = tuple(name for name, (low, high) in pulls.items() if -low > max(zero, high))
    if not own:
        return None
    what = (
        f"the sign of {' and '.join(own)} looks reversed: a tendon only pulls, and readings go "
        f"down to {min(pulls[name][0] for name in own):.3g} N"
    )
    mend = entries_of(table, tuple((name, name, -1.0) for name in own))
    return WrongConvention(what, own, decided=True, mend=mend)


def misread(table: Table, symmetry: Symmetry = "alike") -> WrongConvention | None:
    """What looks wrong with the signs or the columns of a table, those of its actuators too.

    Examples
    --------
    >>> from ecm.io.table import as_table
    >>> x = np.linspace(-1e-3, 1e-3, 20)
    >>> misread(as_table({"x_m": x, "fx_N": -1e4 * x})).falls
    ('fx_N',)
    """
    wrong = wrong_convention(table)
    rows = table.measured()
    if wrong is not None or table.meta.length_m is None or not rows.has(*POSE, *WRENCH):
        return wrong
    return exchanged(rows, ActuatedModel(symmetry=symmetry))


@dataclass(frozen=True)
class ActuatedModel(ModelSpecification):
    """A polynomial energy of pose and actuation; short name `actuatedD`.

    Columns pressure_1_Pa, pressure_2_Pa, ... are inputs beside the pose. Where the volumes of the
    chambers were measured (volume_1_m3, ...), they are more data on the same coefficients; so are
    the shortenings of tendons.

    Parameters
    ----------
    degree
        Degree of the energy without actuation; each input takes one away.
    symmetry
        `alike`: equal actuators round the axis and both ends alike. `revolution`: the ends may
        differ. `general`: no symmetry.
    order
        Largest power of the inputs.

    Examples
    --------
    >>> ActuatedModel(degree=4, symmetry="general").name
    'actuated4-general'
    """

    degree: int = setting(4, low=_LEAST_DEGREE, high=_MOST_DEGREE)
    """Degree of the energy."""
    symmetry: Symmetry = setting("alike", choices=SYMMETRIES)
    """Symmetry of the body."""
    order: int = setting(ORDER, low=1, high=_MOST_ORDER)
    """Largest power of the inputs."""

    kind = "actuated"
    weighted = True
    takes_inputs = True
    usage = (
        f"actuatedD with D from {_LEAST_DEGREE} to {_MOST_DEGREE}, alone or with -revolution or "
        f"-general, then with :ORDER from 1 to {_MOST_ORDER}"
    )

    @property
    def name(self) -> str:
        """`actuatedD`, with `-revolution` or `-general`, and `:ORDER` where it is not 3."""
        return name_of(self.degree, self.order, self.symmetry)

    @classmethod
    def from_name(cls, name: str) -> ActuatedModel | None:
        """`actuatedD`, `actuatedD-revolution`, `actuatedD-general`, each with `:ORDER`."""
        found = re.fullmatch(r"actuated(\d+)(?:-([^:]+))?(?::(\d+))?", name)
        if found is None:
            return None
        degree, symmetry, order = found.groups()
        return cls(int(degree), cast(Symmetry, symmetry or "alike"), int(order or ORDER))

    def fit_map(
        self, table: Table, weights: Weights, progress: Progress | None = None
    ) -> FittedMap:
        """Errors in variables by the declared noise of wrench and pose, else by the spreads."""
        actuation = table.actuation_columns
        if not actuation:
            raise InputError(
                f"{table.source}: {self.name} needs the actuators' columns, pressure_1_Pa, "
                "pressure_2_Pa, ...; without them take another model (ecm fit --model choose)"
            )
        need_pose(table, self.name)
        rows = table.matrix((*POSE, *actuation))
        base = self.empty_map(rows, length_of(table, self.name), actuation)
        _refuse_unmoved(table, base)
        if is_partial(table):  # as an energy of the pose: amounts are not taken
            return fit_measured(base, table, weights == "spread", progress)
        wrenches = table.wrenches
        amounts, of = _measured_amounts(table, actuation)
        _refuse_few(table, base, len(of))
        spreads = [_spread(values) for values in (wrenches, amounts)]
        whitener = np.broadcast_to(np.diag(1.0 / spreads[0]), (len(table), 6, 6))
        fitted, covariance, variance = _fitted(
            base, rows, wrenches, whitener, amounts, spreads[1], of
        )
        noise = declared_or_fitted(fitted, table)
        if weights == "spread" or noise.source != "declared":
            return FittedMap(fitted, noise, variance * covariance)
        for _ in range(_WEIGHED if of else 1):
            # Nothing is known of an amount's noise but what the fit before left.
            left = amounts - fitted.amounts(rows)[:, of] if of else amounts
            sd = np.maximum(left.std(axis=0), _LEAST_SHARE * spreads[1])

            def solve(at: F, moved: F, noisy: F, sd: F = sd) -> tuple[ActuatedMap, F, float]:
                return _fitted(base, at, moved, whiteners(noisy), amounts, sd, of)

            # By the weights alone first: from the fit by spreads poses may run away.
            covariances = noise.covariance(Rows(table, fitted))
            fitted, covariance, variance = solve(rows, wrenches, covariances)
            family = AllRows(solve) if of else _Triangles(base)
            found = fit_with_pose_noise(table, fitted, noise, family, progress=progress)
            if not found.converged:
                found = FittedMap(fitted, noise, covariance, variance, converged=False)
            fitted = cast(ActuatedMap, found.base)
        return found

    def maps_without(
        self, table: Table, fold: I, fitted: StiffnessMap | None, progress: Progress | None = None
    ) -> list[StiffnessMap] | None:
        """From the fit to all rows on; None with amounts, or where no noise is known."""
        if is_partial(table) or amount_columns(table.columns):
            return None
        whole = self.fit_map(table, "auto")
        start, noise, count = cast(ActuatedMap, whole.base), whole.noise, int(fold.max()) + 1
        if noise.source != "declared":
            return None
        family = _Triangles(start)

        def without(part: int) -> StiffnessMap:
            tell_part(progress, part, count, "the rows without one part")
            others = table.select(fold != part)
            _refuse_unmoved(others, start)
            _refuse_few(others, start)
            if whole.converged:
                found = fit_with_pose_noise(others, start, noise, family, near=True)
                return found.base if found.converged else self.fit_map(others, "noise").base
            inputs, covariances = inputs_of(start, others), noise.covariance(Rows(others, start))
            return family.solve(
                None, [family.reduce(None, inputs, others.wrenches, covariances)], len(others)
            )[0]

        return [without(part) for part in range(count)]

    def empty_map(self, rows: F, length_m: float, actuators: tuple[str, ...]) -> ActuatedMap:
        """The map whose coefficients are all 0, in the scales of rows (N, 6 + m)."""
        kinds = tuple(map(kind_of, actuators))
        terms = ActuatedTerms(length_m, kinds, self.degree, self.order, self.symmetry)
        alike = np.array(kinds)[:, None] == np.array(kinds)
        return ActuatedMap(
            terms,
            np.asarray(terms.of_pose.frame(np.ascontiguousarray(rows[:, :6]))),
            np.where(alike, np.abs(rows[:, 6:]).max(axis=0), 0.0).max(axis=1),
            np.zeros(terms.count()),
            np.zeros(len(terms.pure())),
            actuators,
        )

    @staticmethod
    def layout(n: int, m: int) -> Layout:
        """Layout of the family's own keys in a model file."""
        parameters = {
            "actuators": items(text, least=1),
            "degree": number(positive=True),
            "order": number(positive=True),
            "symmetry": one_of(*SYMMETRIES),
            "scale": array(None, positive=True),
            "coefficients_J": array(None),
            "pure_J": array(None),
        }
        own = {"length_m": number(positive=True), "parameters": record(parameters)}
        return record(own, others=True)

    map_from_document = staticmethod(ActuatedMap.from_document)


def _refuse_unmoved(table: Table, base: ActuatedMap) -> None:
    """Raise InputError where nothing tells what an actuator does."""
    moved = np.ptp(table.matrix(base.actuators), axis=0) > 0.0
    kinds = np.array(base.terms.kinds)
    for i, name in enumerate(base.actuators):
        # Without symmetry no other actuator tells what this one does.
        if not np.any(moved[i] if base.terms.body == "general" else moved[kinds == kinds[i]]):
            raise InputError(
                f"{table.source}: {name} is the same in every row: nothing tells {base.name} "
                "what it does; give rows in which it varies, or leave the column out"
            )


def _refuse_few(table: Table, base: ActuatedMap, amounts: int = 0) -> None:
    """Raise InputError where the rows give fewer equations than coefficients."""
    count, equations = base.terms.count(), len(table) * (len(WRENCH) + amounts)
    if equations < count + (len(base.pure_J) if amounts else 0):
        raise InputError(
            f"{table.source}: {base.name} has {count} coefficients, {len(table)} rows "
            f"give {equations} equations: give more rows, or take a lower degree"
        )


def _measured_amounts(table: Table, actuation: tuple[str, ...]) -> tuple[F, list[int]]:
    """(N, v) amounts that were measured, and the actuator of each."""
    inputs = [(kind_of(name), name.split("_")[1]) for name in actuation]
    names = amount_columns(table.columns)
    of = []
    for name in names:
        kind, number_ = name.split("_")[:2]
        own = (_CONJUGATE[kind], number_)
        if own not in inputs:
            raise InputError(
                f"{table.source}: {name} has no {own[0]}_{number_} beside it; add that column, or "
                f"leave {name} out"
            )
        of.append(inputs.index(own))
    return table.matrix(names) if names else np.zeros((len(table), 0)), of


def _spread(values: F) -> F:
    """(m,) standard deviations of the columns; of a constant one that of the others."""
    spread = values.std(axis=0)
    return np.where(spread > 0.0, spread, max(float(spread.max(initial=0.0)), 1e-300))


def _fitted(
    base: ActuatedMap, rows: F, wrenches: F, whitener: F, amounts: F, amount_sd: F, of: list[int]
) -> tuple[ActuatedMap, F, float]:
    """Map, covariance (k, k) for unit noise and whitened residual square per degree of freedom.

    Parameters
    ----------
    rows
        (N, 6 + m) poses and inputs.
    wrenches, whitener
        (N, 6) and (N, 6, 6).
    amounts, amount_sd, of
        (N, v), (v,), and the v actuators whose amounts they are.
    """
    design, target = _equations(base, rows, wrenches, whitener)
    if of:
        columns = np.concatenate(base.amount_columns(rows), axis=2)[:, of] / amount_sd[:, None]
        design = np.hstack([design, np.zeros((len(design), len(base.pure_J)))])
        design = np.vstack([design, columns.reshape(-1, design.shape[1])])
        target = np.append(target, (amounts / amount_sd).ravel())
    return _solved(base, _triangle(design, target), len(target))


def _equations(base: ActuatedMap, rows: F, wrenches: F, whitener: F) -> tuple[F, F]:
    """Whitened columns (6 N, k) and wrenches (6 N,)."""
    design = (whitener @ base.columns(rows)).reshape(-1, len(base.coefficients))
    return design, np.einsum("nij,nj->ni", whitener, wrenches).ravel()


def _triangle(design: F, target: F) -> F:
    """What a fit needs of any number of equations: the triangle of their columns and target."""
    return np.asarray(np.linalg.qr(np.column_stack([design, target]), mode="r"))


def _solved(base: ActuatedMap, triangle: F, equations: int) -> tuple[ActuatedMap, F, float]:
    """Map, covariance (k, k) and variance of as many equations with this triangle."""
    k, design, target = len(base.coefficients), triangle[:, :-1], triangle[:, -1]
    size = np.linalg.norm(design, axis=0)
    size[size == 0.0] = 1.0
    u, s, vt = svd(design / size)
    known = s > _SINGULAR * s[0]
    inverse = vt[known].T / s[known]
    # Directions that the rows do not tell stay at zero.
    solution = inverse @ (u[:, known].T @ target) / size
    left = target - design @ solution
    variance = float(left @ left) / max(equations - int(known.sum()), 1)
    covariance = (inverse @ inverse.T) / np.outer(size, size)
    pure = solution[k:] if len(solution) > k else base.pure_J
    return replace(base, coefficients=solution[:k], pure_J=pure), covariance[:k, :k], variance


@dataclass(frozen=True)
class _Triangles:
    """Generalised least squares of a map without amounts, block by block."""

    base: ActuatedMap

    def frame(self, poses: F) -> None:
        """Nothing is shared: the scales are those of the map."""

    def reduce(self, frame: None, poses: F, wrenches: F, covariance: F) -> F:
        """The triangle of a block of rows (N, 6 + m)."""
        return _triangle(*_equations(self.base, poses, wrenches, whiteners(covariance)))

    def solve(self, frame: None, parts: Sequence[F], rows: int) -> tuple[ActuatedMap, F, float]:
        """The fit of the blocks."""
        every = np.concatenate(parts)
        return _solved(self.base, _triangle(every[:, :-1], every[:, -1]), len(WRENCH) * rows)


@dataclass(frozen=True)
class WallStiffness(ModelSpecification):
    """An energy of a stated body whose modulus and whose inputs' gains are free.

    A body whose modulus is s times as large moves alike under s times the loads: with the energy
    Pi_0(p, a) of the stated one and gains g of the inputs, those of each kind alike,

        Pi(p, a) = s Pi_0(p, g a / s).

    The product of order k of the inputs grows by s^(1 - k) g^k, so that the result is an energy of
    the same terms. A few rows tell s and g, where those of a free energy tell none of its
    coefficients.

    Parameters
    ----------
    stated
        Energy of pose and inputs, fitted to FEM of the stated body.

    Examples
    --------
    >>> import ecm
    >>> from ecm.io.columns import POSE
    >>> from ecm.models.actuated import ActuatedTerms
    >>> terms = ActuatedTerms(0.1, ("pressure",), degree=3, order=1)
    >>> own, none = np.ones(terms.count()), np.zeros(len(terms.pure()))
    >>> stated = ActuatedMap(terms, np.ones(2), np.ones(1), own, none, ("pressure_1_Pa",))
    >>> poses = 0.1 * np.random.default_rng(0).standard_normal((8, 6))
    >>> a = np.arange(1.0, 9.0)
    >>> softer = 0.8 * stated.predict(np.column_stack([poses, a / 0.8]))
    >>> names = (*POSE, *WRENCH, "pressure_1_Pa")
    >>> rows = ecm.as_table(dict(zip(names, np.column_stack([poses, softer, a]).T, strict=True)))
    >>> WallStiffness(stated).factors(rows, "spread").round(2)
    array([0.8, 1. ])
    """

    stated: ActuatedMap

    kind = "wall stiffness"
    weighted = True
    takes_inputs = True

    @property
    def name(self) -> str:
        """That of the stated energy."""
        return self.stated.name

    def fit_map(
        self, table: Table, weights: Weights, progress: Progress | None = None
    ) -> FittedMap:
        """Least squares of modulus and gains, by the declared noise or the spreads."""
        noise = declared_or_fitted(self.stated, table)
        factors, spread, variance = self._fitted(table, weights)
        return FittedMap(self._map(factors), noise, self._covariance(factors, spread), variance)

    def factors(self, table: Table, weights: Weights = "auto") -> F:
        """(1 + k,) s, then the gain of the inputs of each kind."""
        return self._fitted(table, weights)[0]

    def _fitted(self, table: Table, weights: Weights) -> tuple[F, F, float]:
        """Factors, covariance (1 + k, 1 + k) of their logarithms, and residual variance."""
        base = self.stated
        lacking = [name for name in (*taken_by(base), *WRENCH) if not table.has(name)]
        if lacking or table.actuation_columns != base.actuators:
            raise InputError(
                f"{table.source}: the stated energy takes {', '.join(taken_by(base))}; the table "
                f"has the inputs {', '.join(table.actuation_columns) or 'none'}"
                + (f", and no {lacking[0]}" if lacking else "")
            )
        rows = inputs_of(base, table)
        noise = declared_or_fitted(base, table)
        known = weights != "spread" and noise.source == "declared"
        if known:
            whitener = whiteners(noise.covariance(Rows(table, base)))
        else:
            spread = _spread(table.wrenches)
            whitener = np.broadcast_to(np.diag(1.0 / spread), (len(table), 6, 6))

        def left(logs: F) -> F:
            made = self._map(np.exp(logs)).predict(rows) - table.wrenches
            return np.asarray(np.einsum("nij,nj->ni", whitener, made)).ravel()

        found = least_squares(left, np.zeros(1 + len(self._kinds)))
        freedom = max(6 * len(table) - len(found.x), 1)
        jacobian = np.asarray(found.jac, dtype=np.float64)
        inverse = np.linalg.pinv(jacobian.T @ jacobian)
        variance = 2.0 * float(found.cost) / freedom
        return np.exp(found.x), inverse if known else variance * inverse, variance

    @property
    def _kinds(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(self.stated.terms.kinds))

    def _orders(self, product: tuple[int, ...]) -> F:
        """(1 + k,) powers of s and of each gain in the coefficients of a product of inputs."""
        kinds = np.array(self.stated.terms.kinds)
        by_kind = [sum(np.array(product)[kinds == kind]) for kind in self._kinds]
        return np.array([1.0 - sum(product), *by_kind])

    @property
    def _powers(self) -> tuple[F, F]:
        """(c, 1 + k) and (o, 1 + k) the same of each coefficient, and of those of inputs alone."""
        terms = self.stated.terms
        sizes = [(orbit.products[0], orbit.expansions[0].shape[1]) for orbit in terms.orbits()]
        of_pose = [np.tile(self._orders(product), (size, 1)) for product, size in sizes]
        return np.vstack(of_pose), np.array([self._orders(orbit[0]) for orbit in terms.pure()])

    def _map(self, factors: F) -> ActuatedMap:
        of_pose, pure = (np.prod(factors**powers, axis=1) for powers in self._powers)
        stated = self.stated
        return replace(
            stated, coefficients=stated.coefficients * of_pose, pure_J=stated.pure_J * pure
        )

    def _covariance(self, factors: F, of_logs: F) -> F:
        """(c, c) of the coefficients, which move together."""
        slopes = self._map(factors).coefficients[:, None] * self._powers[0]
        return np.asarray(slopes @ of_logs @ slopes.T)
