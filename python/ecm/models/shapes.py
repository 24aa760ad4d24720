"""Shape of an effect in a fit: of its variants the one that explains most beside the others.

Variants are compared by what their tangents leave, by BIC. A richer form, as the second branch of a
relaxation, must in addition foretell rows that it was not fitted to: in sum better than the plain
form, and in no part of the rows much worse.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ecm.effects.protocol import Effect, jacobian_of
from ecm.io.arrays import F
from ecm.io.table import Table
from ecm.models.errors import held_out_by_part
from ecm.models.joint_fit import FittedEffect, JointFit, joint_fit
from ecm.models.maps import StiffnessMap
from ecm.regression.f_test import orthonormal
from ecm.regression.noise import Noise, whiteners

SOME_ROUNDS, ALL_ROUNDS = 4, 7
"""Times that shapes between the best and its neighbours are tried, each nearer than before: to
compare effects, and to fit one."""
_WORST_PART = 1.1
"""Largest growth of the error of a part of the rows that a richer form may cause."""


def holds_out(plain: F, richer: F) -> bool:
    """Whether a richer form foretells better than a plain one, by squares of each held-out part.

    Examples
    --------
    >>> holds_out(np.array([4.0, 1.0]), np.array([1.0, 1.1]))
    True
    >>> holds_out(np.array([4.0, 1.0]), np.array([1.0, 2.0]))  # much worse in the second part
    False
    """
    return bool(richer.sum() < plain.sum() and np.all(richer < _WORST_PART**2 * plain))


def refined(
    value: Callable[[Effect], float],
    shape: Effect,
    most: float,
    table: Table,
    rounds: int = ALL_ROUNDS,
) -> tuple[float, Effect]:
    """The best of a shape, whose value is `most`, and what lies between it and its neighbours.

    Examples
    --------
    >>> import ecm
    >>> from ecm.effects import with_shape
    >>> x = np.linspace(-1e-3, 1e-3, 40)
    >>> log = {"x_m": x, "fx_N": x, "time_s": np.arange(40.0)}
    >>> table = ecm.as_table(log, meta={"file": {"kind": "continuous"}})
    >>> start = with_shape("stress_relaxation", {"tau_s": 8.0, "samples": "time"})
    >>> near, found = refined(lambda shape: -abs(shape.shape["tau_s"] - 9.0), start, -1.0, table)
    >>> bool(-0.3 < near < 0.0), found.id
    (True, 'stress_relaxation')
    """
    for round_ in range(rounds):
        for other in shape.refined(table, round_):
            if (own := value(other)) > most:
                most, shape = own, other
    return most, shape


def best_of(
    value: Callable[[Effect], float], shapes: Sequence[Effect], table: Table
) -> tuple[float, Effect]:
    """The value of the best of some shapes, after the search around the first best, and it."""
    values = [value(shape) for shape in shapes]
    first = int(np.argmax(values))
    return refined(value, shapes[first], values[first], table)


class ColumnsOfParts:
    """Columns (..., k) of effects from those of their parts, each of which is asked for once.

    Parameters
    ----------
    of
        Columns of an effect that is one part.

    Examples
    --------
    >>> from ecm.effects import with_shape
    >>> asked = []
    >>> columns = ColumnsOfParts(lambda part: asked.append(part) or np.ones((4, 1)))
    >>> for slow in (9.0, 12.0):
    ...     shape = {"tau_s": 1.0, "second_tau_s": slow, "overstress": "elastic"}
    ...     found = columns(with_shape("stress_relaxation", shape))
    >>> found.shape, [part.shape["tau_s"] for part in asked]
    ((4, 2), [1.0, 9.0, 12.0])
    """

    def __init__(self, of: Callable[[Effect], F]) -> None:
        self._of = of
        self._known: dict[Any, F] = {}

    def __call__(self, effect: Effect) -> F:
        """Return the columns of the parts beside each other."""
        return np.concatenate([self._of_part(part) for part in effect.parts()], axis=-1)

    def _of_part(self, part: Effect) -> F:
        key = (part.id, *part.shape.items())
        if key not in self._known:
            self._known[key] = self._of(part)
        return self._known[key]


@dataclass(frozen=True)
class _Place:
    """What the base and the other effects of a model leave for the shapes of one effect."""

    base: StiffnessMap
    others: Sequence[FittedEffect]
    table: Table
    noise: Noise
    freeze_base: bool
    kept: Mapping[str, Any] | None

    def fit(self, *more: Effect) -> JointFit:
        effects = (*self.others, *(FittedEffect.unfitted(effect) for effect in more))
        return joint_fit(
            self.base, effects, self.table, self.noise,
            freeze_base=self.freeze_base, kept=self.kept,
        )  # fmt: skip

    @cached_property
    def without(self) -> tuple[JointFit, F, F]:
        """The fit without the effect, its whitener, and an orthonormal basis of its columns."""
        fit = self.fit()
        size = fit.whitened.size
        whitener = whiteners(self.noise.covariance(fit.rows, fit.base.error))
        return fit, whitener, orthonormal(fit.design.reshape(size, fit.design.shape[2]))

    @cached_property
    def left(self) -> F:
        """(M,) whitened residual that base and other effects leave."""
        fit, _, fixed = self.without
        whitened = fit.whitened.ravel()
        return np.asarray(whitened - fixed @ (fixed.T @ whitened))

    @cached_property
    def columns(self) -> ColumnsOfParts:
        """(M, k) whitened columns of a shape that base and other effects leave."""
        fit, whitener, fixed = self.without

        def of(part: Effect) -> F:
            jacobian = jacobian_of(part, fit.rows)
            columns = (whitener @ jacobian).reshape(self.left.size, -1)
            return np.asarray(columns - fixed @ (fixed.T @ columns))

        return ColumnsOfParts(of)

    def value(self, shape: Effect) -> float:
        """Log likelihood, twice, of what a shape leaves, less ln(n) for each parameter (BIC).

        The noise is as large as what is left, and never below that of the readings: of a base that
        errs many times the noise, that of one reading would make any number of parameters cheap.
        """
        left = self.columns(shape)
        if left.shape[1] == 1 and not shape.parameters[0].allows(float(left[:, 0] @ self.left)):
            return -np.inf
        own, size = orthonormal(left), self.left.size
        rest = float(self.left @ self.left) - float(((own.T @ self.left) ** 2).sum())
        variance = max(1.0, rest / size)
        return -size * math.log(variance) - rest / variance - len(shape.parameters) * math.log(size)

    def left_by(self, shape: Effect) -> float:
        """Squares that a shape leaves at its fitted size."""
        return float((self.fit(shape).whitened ** 2).sum())

    def foretells_better(self, richer: Effect, plain: Effect) -> bool:
        """Whether a richer shape foretells the parts of the rows better than a plain one."""
        parts = [held_out_by_part(self.fit(shape)) for shape in (plain, richer)]
        squares = [part[0] for part in parts if part is not None]
        return len(squares) == 2 and holds_out(*squares)


def best_shape(
    base: StiffnessMap,
    others: Sequence[FittedEffect],
    effect: Effect,
    table: Table,
    noise: Noise,
    *,
    freeze_base: bool = False,
    kept: Mapping[str, Any] | None = None,
    present: Effect | None = None,
) -> Effect:
    """The shape of an effect that explains most of the residual of base and other effects.

    Of its variants and what lies between them; of those that a controller can step where they
    explain more or foretell better, and of its richer forms where held-out rows ask for one. The
    present shape stays unless another of as many parameters leaves less at its fitted size:
    tangents at none tell little of a large effect.
    """
    whole = table.full
    variants = effect.variants(whole)
    if len(variants) == 1 and not variants[0].refinement(whole):
        return variants[0]
    place = _Place(base, others, table, noise, freeze_base, kept)
    best = _best_by_tangent(place, variants, effect, whole)
    if present is None or len(present.parameters) != len(best.parameters):
        return best
    if best.shape != present.shape and place.left_by(best) < place.left_by(present):
        return best
    return present


def _best_by_tangent(
    place: _Place, variants: Sequence[Effect], effect: Effect, whole: Table
) -> Effect:
    most, best = best_of(place.value, variants, whole)
    if (stepping := effect.variants_that_step(whole)) and best not in stepping:
        more, other = best_of(place.value, stepping, whole)
        if more > most or place.foretells_better(other, best):
            most, best = more, other
    if forms := best.refinement(whole):
        more, richer = best_of(place.value, forms, whole)
        if more > most and place.foretells_better(richer, best):
            return richer
    return best
