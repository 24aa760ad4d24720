"""The linearised problem: whitened residual, base columns and score columns of every effect.

What an effect explains is no noise, but the best of many effects and shapes always explains
something: with few rows the rest after all of them would be far too small, and chance would get a
name. So only what is significant beside what was taken before is taken out.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from itertools import compress
from typing import Any, TypeVar, cast

import numpy as np
from scipy import special

from ecm.comparison.residuals import features, in_each_component
from ecm.diagnosis.settings import DEFAULTS, FORM_SHARE, LEFT_SHARE, DiagnosisSettings
from ecm.effects import Effect, Missing, Rows
from ecm.effects.protocol import (
    ABSORBED,
    UNKNOWN_LENGTH,
    UNKNOWN_TORQUES,
    guesses_torques,
    jacobian_of,
)
from ecm.errors import ModelError
from ecm.io.arrays import B, F, I, lstsq
from ecm.io.columns import POSE
from ecm.io.table import Table
from ecm.models.joint_fit import (
    JointFit,
    base_columns,
    declared_or_fitted,
    error_columns,
    estimate_noise,
    further_columns,
    joint_fit,
)
from ecm.models.known import KnownMap
from ecm.models.left_out import LeftOut
from ecm.models.maps import StiffnessMap
from ecm.models.shapes import SOME_ROUNDS, refined
from ecm.regression.f_test import (
    explained_by_span,
    omnibus_test,
    orthonormal,
    outlying_squares,
)
from ecm.regression.folds import row_groups
from ecm.regression.noise import (
    Noise,
    grown_by_rest,
    is_exact,
    shared_zero_error,
    some_rows,
    weighed_by_rest,
)
from ecm.regression.normal_equations import (
    NormalEquations,
    explained_by_blocks,
    explained_squares,
    in_threads,
)
from ecm.regression.rows import UnknownLength, actuators_of, driven_by, is_whole
from ecm.regression.slow_noise import SlowPart, Whitener

ABSORBED_SHARE = 1.0 - FORM_SHARE
"""An effect of which a base absorbs more cannot be tested: it leaves no more than its form errs."""
_MOST_ABSORBED = 0.995
"""The same for a physics base: its one or two coefficients absorb nothing by chance. And for
effects of time and order beside all six poses: of few rows a base of many coefficients takes in
most of them, and as much of what their form errs."""

_ROUNDING = 1e-9
_BENT = 0.02
"""Change of columns, as a share of them, from which they are those of another base."""
_AT_ONCE = 64
"""Columns that are projected together, about."""


@dataclass(frozen=True)
class ScoreColumns:
    """One shape of one effect."""

    effect: Effect
    columns: F
    """(N, m, k) whitened derivative of the correction at zero."""
    imitates: bool = False
    """It cannot be tested with these data, but its columns may look like another effect."""
    lengths: F | float = 1.0
    """(k,) what the columns were divided by."""

    @property
    def id(self) -> str:
        """The effect's id."""
        return self.effect.id


T = TypeVar("T", bound=Any)


def best_of_each(items: Sequence[T], values: Sequence[float]) -> dict[str, tuple[float, T]]:
    """Return the largest value and its item for each id, in the order of the items."""
    best: dict[str, tuple[float, T]] = {}
    for item, value in zip(items, values, strict=True):
        if item.id not in best or value > best[item.id][0]:
            best[item.id] = (value, item)
    return best


def weighted(columns: F, root: F) -> F:
    """(N m, k) of columns (N, m, k), or (N m,) of (N, m): rows times the roots of their weights."""
    n, m, *k = columns.shape  # named, for a reshape of no columns
    each = root.reshape(-1, *[1] * (columns.ndim - 1))
    return np.asarray((columns * each).reshape(n * m, *k))


@dataclass(frozen=True)
class Projection:
    """The directions of the base among weighted rows."""

    basis: F
    """(N m, b) orthonormal."""
    root: F
    """(N,) square roots of the rows' weights."""

    @staticmethod
    def of(block: F, root: F) -> Projection:
        """Return the projection for whitened base columns (N, m, b)."""
        return Projection(orthonormal(weighted(block, root), dependent=1e-10), root)

    def flat(self, columns: F) -> F:
        """`weighted` by the weights of the rows."""
        return weighted(columns, self.root)

    def rest(self, columns: F) -> F:
        """Return (N, m, k) or (N, m) without their part in the base; weights stay outside."""
        if columns.ndim == 2:
            return self.rest(columns[:, :, None])[:, :, 0]
        flat = self.flat(columns)
        left = flat - self.basis @ (self.basis.T @ flat)
        safe = np.where(self.root > 0.0, self.root, 1.0)
        return np.asarray(left.reshape(columns.shape) / safe[:, None, None])

    def orthogonalised(self, columns: F) -> F:
        """Return the same, with zeros where only rounding errors of a column are left."""
        left = self.rest(columns)
        before, after = (np.sqrt((part**2).sum(axis=(0, 1))) for part in (columns, left))
        return np.where(after > _ROUNDING * before, left, 0.0)

    def absorbed_by_each(self, blocks: Sequence[F]) -> list[float]:
        """Return the share that the base takes of the best visible parameter of each block."""

        def of_part(flat: F, cuts: I) -> list[float]:
            total = (flat**2).sum(axis=0)
            inside = ((self.basis.T @ flat) ** 2).sum(axis=0)
            shares = np.divide(inside, total, out=np.ones_like(total), where=total > 0.0)
            return [float(own.min(initial=1.0)) for own in np.split(shares, cuts)]

        return self._of_each(blocks, of_part)

    def explained_by_each(self, blocks: Sequence[F], response: F) -> list[float]:
        """Return the squares of the response (N m,) that columns (N, m, k) of each add to the base.

        A product with a large base reads all of it: with one block at a time that is all its work.
        """

        def of_part(flat: F, cuts: I) -> list[float]:
            flat -= self.basis @ (self.basis.T @ flat)
            return [explained_by_span(own, response)[0] for own in np.split(flat, cuts, axis=1)]

        return self._of_each(blocks, of_part)

    def _of_each(self, blocks: Sequence[F], work: Callable[[F, I], list[float]]) -> list[float]:
        """Return a number of each block (N, m, k), which are worked on some at a time.

        `work` is given their weighted columns (N m, k), and where each but the first begins.
        """
        ends = np.cumsum([block.shape[2] for block in blocks]) // _AT_ONCE

        def of_place(place: int) -> list[float]:
            part = [blocks[i] for i in np.flatnonzero(ends == place).tolist()]
            flat = np.concatenate([self.flat(block) for block in part], axis=1)
            return work(flat, np.cumsum([block.shape[2] for block in part])[:-1])

        found = in_threads(of_place, np.unique(ends).tolist())
        return [number for numbers in found for number in numbers]


def zero_errors(rows: Rows, noise: Noise) -> F:
    """(N, m, z) what one standard deviation of each of the sensor's zeros does."""
    return shared_zero_error(rows, rows.table.matrix(rows.base.outputs), noise)


def all_score_columns(
    rows: Rows, whitener: Whitener, effects: Sequence[Effect]
) -> tuple[list[ScoreColumns], dict[str, Missing]]:
    """Return every variant of every effect that has columns, and what cannot be tested."""
    table, base = rows.whole.table, cast(StiffnessMap, rows.base)

    def of_effect(effect: Effect) -> tuple[list[ScoreColumns], Missing | None]:
        lacking = effect.missing(table)
        if effect.kind == "noise" or (lacking is not None and not lacking.imitates):
            return [], lacking
        variants = effect.variants(table) if lacking is None else lacking.forms or (effect,)
        try:
            if base.kind != "physics":  # the two numbers of a stated body follow from the forces
                variants = tuple(v for v in variants if not guesses_torques(v, rows))
            if not variants:
                return [], lacking or UNKNOWN_TORQUES
            return [
                ScoreColumns(v, score_columns(rows, whitener, v), lacking is not None)
                for v in variants
            ], lacking
        except UnknownLength:
            return [], lacking or UNKNOWN_LENGTH

    found = list(zip(effects, in_threads(of_effect, effects), strict=True))
    untestable = {effect.id: lacking for effect, (_, lacking) in found if lacking is not None}
    return [one for _, (own, _) in found for one in own], untestable


def score_columns(rows: Rows, whitener: Whitener, effect: Effect) -> F:
    """Return (N, m, k) whitened derivative of the effect's correction at zero."""
    return whitener @ jacobian_of(effect, rows)


def _half_way(
    rows: Rows, whitener: Whitener, projection: Projection, y: F, one: ScoreColumns
) -> ScoreColumns:
    """Return the columns half way to the values that explain most: they give the whole change.

    What an input does that is off by much follows from G between the recorded and the acting one.
    """
    own = projection.flat(projection.rest(one.columns))
    parameters = one.effect.parameters
    values = np.clip(lstsq(own, y), [p.lower for p in parameters], [p.upper for p in parameters])
    columns = whitener @ jacobian_of(one.effect, rows, 0.5 * values)
    return replace(one, columns=columns)


def _refined_shapes(
    rows: Rows, whitener: Whitener, projection: Projection, y: F, every: Sequence[ScoreColumns]
) -> list[ScoreColumns]:
    """Return better shapes between the best of a coarse grid and its neighbours."""
    table = rows.whole.table

    def gain(shape: Effect) -> float:
        return projection.explained_by_each([score_columns(rows, whitener, shape)], y)[0]

    def refined_of(id: str) -> ScoreColumns | None:
        own = [item for item in every if item.id == id]
        if not any(item.effect.refined(table, 0) for item in own):
            return None
        gains = projection.explained_by_each([item.columns for item in own], y)
        best, start = best_of_each(own, gains)[id]
        _, shape = refined(gain, start.effect, best, table, SOME_ROUNDS)
        if shape is start.effect:
            return None
        return ScoreColumns(shape, score_columns(rows, whitener, shape))

    ids = dict.fromkeys(item.id for item in every if not item.imitates)
    return [item for item in in_threads(refined_of, ids) if item is not None]


def _not_absorbed(
    every: Sequence[ScoreColumns], projection: Projection, base: StiffnessMap
) -> tuple[list[ScoreColumns], dict[str, Missing]]:
    """Return the columns that the base does not absorb, and why the others are left out."""
    most, record = ABSORBED_SHARE, "[mechanism], so that the physics model is the base"
    if base.kind == "physics":
        most = _MOST_ABSORBED
        record = "pure axial and pure torsion poses, or a second specimen"
    elif actuators_of(base):
        record = "a test of its own: an energy of pose and inputs takes it in"
    elif not is_whole(base):
        again = "the same poses again, in another order and at another speed"
        record = f"{again}; or a gauge of known zero and gain" if driven_by(base) else again
    kept: list[ScoreColumns] = []
    rest: list[ScoreColumns] = []
    absorbed: dict[str, Missing] = {}
    shares = projection.absorbed_by_each([item.columns for item in every])
    for item, share in zip(every, shares, strict=True):
        own = getattr(item.effect, "most_absorbed", None)
        usual = ABSORBED_SHARE if item.imitates else most
        if item.effect.kind == "time" and base.inputs == POSE and not item.imitates:
            usual = _MOST_ABSORBED
        if share <= (own or usual):
            kept.append(item)
        elif not item.imitates:
            absorbed[item.id] = Missing(f"{ABSORBED} ({100.0 * share:.0f} %)", record)
            if share <= _MOST_ABSORBED:
                rest.append(replace(item, imitates=True))
    seen = {item.id for item in kept}
    # What acts in all rows may be what another effect looks like, though from a moment on it shows.
    kinds = {(item.id, item.effect.kind) for item in kept}
    kept += [item for item in rest if (item.id, item.effect.kind) not in kinds]
    return kept, {id: why for id, why in absorbed.items() if id not in seen}


def robust_weights(response: F, base: F, every: Sequence[ScoreColumns]) -> F:
    """Return (N,) weights: rows that no column explains and no Gaussian gives count less.

    Beside the base and the effects that explain most, as many as half of the readings can hold:
    without these all rows that one effect touches were outliers. What explains few rows that are
    unlike all others, and leaves a part of them, is no effect but a likeness of them.
    """
    n, m = response.shape
    plain = Projection.of(base, np.ones(n))
    y = plain.flat(plain.rest(response))
    first = best_of_each(every, plain.explained_by_each([one.columns for one in every], y))
    by_gain = sorted(first.values(), key=lambda found: found[0], reverse=True)
    unlike = _weights_beside(response, [base]) < _UNLIKE
    if 0 < unlike.sum() <= _FEW_UNLIKE * n:
        others = Projection.of(base, np.where(unlike, 0.0, 1.0))
        z = others.flat(others.rest(response))
        gains = others.explained_by_each([one.columns for _, one in by_gain], z)
        least = (1.0 - LEFT_SHARE) * float(y @ y - z @ z)
        by_gain = [
            found
            for found, elsewhere in zip(by_gain, gains, strict=True)
            if found[0] >= least or elsewhere >= LEFT_SHARE * found[0]
        ]
    effects = [one.columns for _, one in by_gain]
    ends = base.shape[2] + np.cumsum([block.shape[2] for block in effects])
    few = effects[: int(np.searchsorted(ends, n * m // 2))]
    return _weights_beside(response, [base, *few])


def _weights_beside(response: F, blocks: Sequence[F]) -> F:
    """(N,) weights of rows by what blocks of columns (N, m, k) leave of them."""
    n, m = response.shape
    design = np.concatenate(blocks, axis=2)
    design /= _lengths(design)
    flat, y = design.reshape(n * m, -1), response.ravel()
    limit, middle = outlying_squares(m)
    weights = np.ones(n)
    for _ in range(3):
        root = np.repeat(np.sqrt(weights), m)
        z = flat * root[:, None]
        normal = z.T @ z
        normal[np.diag_indices_from(normal)] += 1e-9
        theta = np.linalg.solve(normal, z.T @ (y * root))
        squares = ((y - flat @ theta).reshape(n, m) ** 2).sum(axis=1)
        scale = max(float(np.median(squares)) / middle, 1e-12)
        excess = np.maximum(squares, 1e-12 * limit * scale) / (limit * scale)
        weights = np.minimum(1.0, excess**-2.0)
    return weights


_FEW_UNLIKE = 0.1
"""Share of the rows up to which those that are unlike all others may be no measurements."""
_MOST = 8
"""Effects that are taken out."""
_OF_STATED_NOISE = 0.25
"""Least variance over noise from repeats or figures, which may be twice too large."""
_OF_A_GOOD_RIG = 1e-3
"""The same over the noise of a common rig: one that is thirty times better."""
_UNLIKE = 0.5
"""Robust weight below which a row counts as unlike all others."""
_MANY_UNLIKE = 0.005
"""Share of such rows that is no chance: of Gaussian noise there is one in 10,000."""


def significant_columns(
    equations: tuple[F, F],
    squares: float,
    freedom: int,
    fixed: Sequence[int],
    shapes: Sequence[tuple[str, tuple[int, ...]]],
    level: float,
) -> I:
    """Return the columns of the effects that are significant, each beside those before it.

    The fixed columns leave the squares, of so many degrees of freedom. Of the shapes, id and
    columns of each, any is taken with the chance `level` where none explains anything (Bonferroni).
    """
    taken: list[int] = []
    present: set[str] = set()
    for _ in range(_MOST):
        tried = [shape for shape in shapes if shape[0] not in present]
        blocks = [columns for _, columns in tried]
        gains = explained_by_blocks(*equations, (*fixed, *taken), blocks)
        gains = np.minimum(gains, squares)
        sizes = np.array([len(block) for block in blocks], dtype=np.int64)
        rest = freedom - sizes
        ratio = gains / sizes / np.maximum(squares - gains, 1e-12 * squares or 1.0) * rest
        p = np.where(rest > 0, special.fdtrc(sizes, np.maximum(rest, 1), ratio), 1.0)
        if len(tried) == 0 or p.min() * len(shapes) >= level:
            break
        # Of several that are certain, the one that explains most.
        best = int(np.lexsort((-gains, p))[0])
        taken += blocks[best]
        present.add(tried[best][0])
        squares, freedom = squares - float(gains[best]), int(rest[best])
    return np.array(taken, dtype=np.int64)


def noise_variance(response: F, weights: F, known: F, smooth: F, level: float) -> tuple[float, int]:
    """Return the variance, 1 where the noise is right, that columns leave, and its freedom.

    The known ones, and the smooth ones together where they are significant at the level; these are
    overwritten. Of too few rows it is 1, with 0 degrees of freedom.
    """
    test = omnibus_test(response, smooth, known, weights, overwrite=True)
    squares, freedom = test.rest, test.dof_error
    if not (freedom > 0 and test.p < level):
        squares, freedom = squares + max(test.explained, 0.0), freedom + test.dof
    return (squares / freedom, int(freedom)) if freedom > 0 else (1.0, 0)


@dataclass(frozen=True)
class Candidate:
    """One shape of one effect and the places of its columns in the design."""

    effect: Effect
    columns: tuple[int, ...]

    @cached_property
    def id(self) -> str:
        """The effect's id."""
        return self.effect.id

    @cached_property
    def parameters(self) -> int:
        """Number of fitted values; the choice of the shape is not counted."""
        return len(self.columns)


Candidates = Sequence[Candidate]
"""Shapes that are chosen together, or that are offered."""


@dataclass(frozen=True)
class Problem:
    """All that the stages work on: N rows of m components, whitened and robustly weighted."""

    table: Table
    base: StiffnessMap
    rows: Rows
    noise: Noise
    fit: JointFit
    """Fit of the base alone."""
    weights: F
    """(N,) robust weight of each row."""
    groups: I
    scored: B
    """(N,) rows that count in held-out errors."""
    whitener: Whitener
    response: F
    """(N, m)."""
    design: F
    """(N, m, K): base columns, then every candidate's, each of unit length."""
    norms: F
    """(K,) lengths of the columns before they were made unit."""
    n_base: int
    """Number of base columns in the design: of its coefficients, then those of its known errors,
    whose size has a normal prior of standard deviation 1; the sensor's `zeros` are last."""
    projected_base: F
    """(N, m, b) orthogonal columns of a base that is too large for the design; else b = 0."""
    candidates: tuple[Candidate, ...]
    imitators: tuple[Candidate, ...]
    """Effects that cannot be tested with these rows, but can look like another effect."""
    untestable: dict[str, Missing]
    normal: NormalEquations
    """Normal equations of the design by group of rows."""
    base_error: float
    """Whitened rms of the base's own error."""
    settings: DiagnosisSettings
    scale: float = 1.0
    """Variance that no column explains; 1 where the noise is right."""
    scale_freedom: int = 0
    """Its degrees of freedom; 0 where the rows do not tell it."""
    zeros: int = 0
    """Number of errors of the sensor's zeros."""
    left_out: LeftOut | None = None
    """What the base leaves out of the next degree; None of one that is projected out."""
    reduced: tuple[F, F] | None = None
    """Normal equations in place of those of the rows, to study a stage."""
    held: float = 0.0
    """Squares beside the base, over the noise scale, that the model's effects explain; they are
    taken off the response."""
    holds: tuple[Effect, ...] = ()
    """These effects."""

    @property
    def size(self) -> int:
        """Rows times components."""
        return int((self.weights > 0.0).sum() * self.response.shape[1])

    @property
    def base_index(self) -> tuple[int, ...]:
        """Columns of the base."""
        return tuple(range(self.n_base))

    def columns_of(self, chosen: Candidates) -> tuple[int, ...]:
        """Columns of the base and of some candidates."""
        return self.base_index + tuple(c for item in chosen for c in item.columns)

    @property
    def offered(self) -> tuple[Candidate, ...]:
        """Every shape that may explain what the base leaves, testable or not."""
        return (*self.candidates, *self.imitators)

    @property
    def base_block(self) -> F:
        """(N, m, k) columns of the base, which a test must give its degrees of freedom."""
        return self.design[:, :, : self.n_base] if self.n_base else self.projected_base

    @property
    def coefficient_block(self) -> F:
        """(N, m, k) columns of the base's coefficients, without those of its own errors."""
        if not self.n_base:
            return self.projected_base
        return self.design[:, :, : len(self.base.coefficients)]

    @property
    def own_errors(self) -> F:
        """(N, m, e) what one standard deviation of each of the base's own errors does."""
        own = slice(len(self.base.coefficients), self.n_base)
        return np.asarray(self.design[:, :, own] * self.norms[own])

    @cached_property
    def normal_of_projected(self) -> NormalEquations:
        """Those of the base that is too large for the design, in the order of `normal`."""
        return NormalEquations.of(self.projected_base, self.response, self.groups, self.weights)

    @cached_property
    def squares_beside_base(self) -> float:
        """Weighted squares of the response that the base leaves."""
        matrix, vector, total = self.normal.total
        return max(total - explained_squares(matrix, vector, self.base_index), 0.0)

    @cached_property
    def equations(self) -> tuple[F, F]:
        """Matrix (K, K) and vector (K,) of all rows over the noise scale; do not change them."""
        if self.reduced is not None:
            return self.reduced
        matrix, vector, _ = self.normal.total
        return matrix / self.scale, vector / self.scale

    def squares_of(self, whitened: F) -> float:
        """Weighted squares of whitened (N, m) numbers."""
        return float((whitened**2).sum(axis=1) @ self.weights)

    def in_each_component(self, values: F) -> F:
        """(N, m, m q) whitened functions (N, q), each by itself in each of the m components."""
        return self.whitener.in_time(in_each_component(self.whitener.each, values))

    def flat(self, columns: F) -> F:
        """`weighted` by the robust weights of the rows."""
        return weighted(columns, np.sqrt(self.weights))

    @property
    def outlying_rows(self) -> list[int]:
        """Rows that are unlike all others and count less; none where chance gives as many."""
        rows = np.flatnonzero(self.weights < _UNLIKE).tolist()
        return rows if len(rows) > max(3.0, _MANY_UNLIKE * len(self.weights)) else []

    def rms(self, errors: F) -> F:
        """(m,) root mean square of errors (N, m); rows that are unlike all others count less."""
        weights = np.where(self.scored, self.weights, 0.0)
        return np.asarray(np.sqrt(weights @ errors**2 / weights.sum()))

    def fit_with(self, chosen: Candidates = (), base: StiffnessMap | None = None) -> JointFit:
        """Fit the base, or another one, together with effects; a ModelError where it runs away."""
        effects = [item.effect for item in chosen]
        base = self.base if base is None else base
        return joint_fit(base, effects, self.table, self.noise, row_weights=self.weights)

    def without_effect(self, id: str) -> Problem:
        """Return the problem in which an effect is no candidate."""
        fewer = replace(self, candidates=tuple(c for c in self.candidates if c.id != id))
        # The rows are the same, and so is all that columns explain; not what is asked of fewer.
        known = {"equations": self.equations, "explained": self.explained}
        vars(fewer).update(known, gains=dict(self.gains))
        return fewer

    @cached_property
    def explained(self) -> Callable[[tuple[int, ...]], float]:
        """Squares that columns explain, over the noise scale; a search asks for the same often."""
        return cache(partial(explained_squares, *self.equations))

    @cached_property
    def gains(self) -> dict[tuple[int, ...], F]:
        """Chosen columns -> (K,) what each effect explains beside them, at its first column."""
        return {}

    @cached_property
    def signs(self) -> F:
        """(K,) 1 where a coefficient may not be negative, -1 where not positive, else 0."""
        signs = np.zeros(len(self.norms))
        for item in self.offered:
            for column, parameter in zip(item.columns, item.effect.parameters, strict=True):
                signs[column] = float(parameter.lower >= 0.0) - float(parameter.upper <= 0.0)
        return signs

    @property
    def ids(self) -> tuple[str, ...]:
        """Testable ids in the order of the catalogue."""
        return tuple(dict.fromkeys(c.id for c in self.candidates))


def assemble(
    base: StiffnessMap,
    table: Table,
    effects: Sequence[Effect],
    noise: Noise | None = None,
    settings: DiagnosisSettings = DEFAULTS,
    around: StiffnessMap | None = None,
) -> Problem:
    """Fit the base, estimate the noise, whiten, weight, and drop what cannot be tested.

    The noise is by default estimated from repeats, else declared or assumed. All is linear around
    the base as it is fitted alone, or as it is beside effects.
    """
    if noise is None:
        base = joint_fit(base, (), table, declared_or_fitted(base, table)).base
        rows = Rows(table, base)
        noise = estimate_noise(rows, rows.sensor_load, fallback=declared_or_fitted(base, table))
    fit = here = joint_fit(base, (), table, noise)
    if around is not None:
        here = joint_fit(around, (), table, noise, freeze_base=True)
    base = here.base
    whitener = noise.whitener(here.rows, base.error)
    rows = here.rows.quieted
    base_block = whitener @ base_columns(rows, base)
    response = whitener @ here.residual
    every, untestable = all_score_columns(rows, whitener, effects)
    weights = robust_weights(response, base_block, every)
    projection = Projection.of(base_block, np.sqrt(weights))
    y = projection.flat(projection.rest(response))
    every += _refined_shapes(rows, whitener, projection, y, every)
    if around is not None:
        every = in_threads(partial(_half_way, rows, whitener, projection, y), every)
    kept, absorbed = _not_absorbed(every, projection, base)
    del every  # the columns are a large part of the memory
    none, groups = base_block[:, :, :0], row_groups(table)
    bare = Problem(
        table=table,
        base=base,
        rows=rows,
        noise=noise,
        fit=fit,
        weights=weights,
        groups=groups,
        scored=table.of_poses,
        whitener=whitener,
        response=response,
        design=none,
        norms=np.zeros(0),
        n_base=0,
        projected_base=none,
        candidates=(),
        imitators=(),
        untestable=untestable | absorbed,
        normal=NormalEquations.of(none, response, groups, weights),
        base_error=_base_error(base, rows, whitener.each),
        settings=settings,
    )
    return _filled(bare, base_block, kept, projection)


def _filled(bare: Problem, block: F, shapes: list[ScoreColumns], projection: Projection) -> Problem:
    """Return the problem with a base's columns (N, m, b) and these shapes; `shapes` is emptied."""
    response, projected = bare.response, block[:, :, :0]
    if len(bare.base.coefficients) > bare.settings.most_base_columns:
        # Too many columns to carry along: project them out once, for all refits.
        response = projection.rest(response)
        for i, one in enumerate(shapes):
            shapes[i] = replace(one, columns=projection.orthogonalised(one.columns))
        projected = projection.basis.reshape(*response.shape, -1) / projection.root[:, None, None]
        block = block[:, :, :0]
    free = block.shape[2]
    left_out: LeftOut | None = None
    if not projected.shape[2]:
        errs, terms = (
            bare.whitener @ part(bare.rows, bare.base) for part in (error_columns, further_columns)
        )
        zeros = bare.whitener @ zero_errors(bare.rows, bare.noise)
        left_out = LeftOut.of(projection.flat(block), projection.flat(terms))
        block = np.concatenate((block, errs, left_out.columns(block, terms), zeros), axis=2)
        bare = replace(bare, zeros=zeros.shape[2])
    norms = _lengths(block)
    precision = np.zeros(len(norms))
    precision[free:] = 1.0 / norms[free:] ** 2
    design = block / norms
    del block
    problem, placed = with_shapes(
        replace(
            bare,
            response=response,
            design=design,
            norms=norms,
            n_base=len(norms),
            projected_base=projected,
            normal=NormalEquations.of(design, response, bare.groups, bare.weights, precision),
            left_out=left_out,
        ),
        shapes,
    )
    imitates = np.array([one.imitates for one in shapes], dtype=np.bool_)
    shapes.clear()  # the columns are in the design: a second copy is a large part of the memory
    testable, others = (tuple(compress(placed, which)) for which in (~imitates, imitates))
    return _scaled(replace(problem, candidates=testable, imitators=others))


def along_time(problem: Problem, slow: SlowPart) -> Problem:
    """Return the problem with its rows whitened along time as well, in noise of this slow part."""
    whitener = Whitener(problem.whitener.each, slow.along(problem.table))
    moved = replace(
        problem,
        design=whitener.in_time(problem.design),
        projected_base=whitener.in_time(problem.projected_base),
    )
    block, shapes = _coefficients_of(moved), _shapes_of(moved)
    projection = Projection.of(block, np.sqrt(problem.weights))
    bare = replace(
        problem,
        noise=replace(problem.noise, slow=slow),
        whitener=whitener,
        response=whitener.in_time(problem.response),
    )
    return _filled(bare, block, shapes, projection)


def _coefficients_of(problem: Problem) -> F:
    """(N, m, b) columns of the base's coefficients in their own size."""
    block = problem.coefficient_block
    return block * problem.norms[: block.shape[2]] if problem.n_base else block


def _shapes_of(problem: Problem, without: Container[str] = ()) -> list[ScoreColumns]:
    """Return all shapes of the design, those of some effects left out."""
    return [
        ScoreColumns(
            item.effect,
            problem.design[:, :, item.columns[0] : item.columns[-1] + 1],
            imitates,
            problem.norms[list(item.columns)],
        )
        for imitates, items in ((False, problem.candidates), (True, problem.imitators))
        for item in items
        if item.id not in without
    ]


def with_forms(
    problem: Problem, forms: Sequence[Effect], columns: Callable[[Effect], F]
) -> Problem:
    """Return the problem with these forms alone of their effects, by their whitened columns.

    The rows are weighed anew beside them.
    """
    shapes = _shapes_of(problem, {form.id for form in forms})
    shapes += [ScoreColumns(form, columns(form)) for form in forms]
    block = _coefficients_of(problem)
    weights = robust_weights(problem.response, block, shapes)
    projection = Projection.of(block, np.sqrt(weights))
    return _filled(replace(problem, weights=weights), block, shapes, projection)


def base_beside(problem: Problem, chosen: Candidates) -> StiffnessMap | None:
    """Return the base as it is beside effects; None where their columns stay as they are.

    What is missing bends the base that is fitted without it, and so the columns that follow from
    the base: what a pressure that is off does is the base's own G = dh/da. None, too, where base
    and effects do not converge together.
    """
    try:
        with np.errstate(over="raise", invalid="raise"):
            fit = problem.fit_with(chosen)
    except (ModelError, FloatingPointError):
        # Not accepted yet: what runs away from the rows is nothing to linearise around.
        return None
    for item in chosen:
        before, after = (
            score_columns(rows, problem.whitener, item.effect) for rows in (problem.rows, fit.rows)
        )
        if np.linalg.norm(after - before) > _BENT * np.linalg.norm(before):
            return fit.base
    return None


def with_shapes(
    problem: Problem, shapes: Sequence[ScoreColumns]
) -> tuple[Problem, list[Candidate]]:
    """Return the problem with the columns of more shapes in its design, and their places there."""
    at = problem.design.shape[2]
    design = np.concatenate([problem.design, *(one.columns for one in shapes)], axis=2)
    norms = _lengths(design[:, :, at:])
    design[:, :, at:] /= norms
    sizes = [one.columns.shape[2] for one in shapes]
    ends = at + np.cumsum(sizes, dtype=np.int64)
    known = [np.broadcast_to(one.lengths, size) for one, size in zip(shapes, sizes, strict=True)]
    wider = replace(
        problem,
        design=design,
        norms=np.concatenate([problem.norms, norms * np.concatenate([np.zeros(0), *known])]),
        normal=problem.normal.with_columns(design, len(norms)),
    )
    return wider, [
        Candidate(one.effect, tuple(range(end - size, end)))
        for one, size, end in zip(shapes, sizes, ends.tolist(), strict=True)
    ]


def _lengths(columns: F) -> F:
    """(k,) lengths of columns (N, m, k); 1 where a column is zero."""
    norms = np.sqrt(np.einsum("nmk,nmk->k", columns, columns))
    return np.where(norms > 0.0, norms, 1.0)


def _scaled(problem: Problem) -> Problem:
    """Return the problem with the variance that neither effects nor smooth functions explain."""
    known = np.concatenate([problem.base_block, _significant(problem)], axis=2)
    smooth = omnibus_columns(problem, problem.size // (3 * problem.response.shape[1]))
    variance, freedom = noise_variance(
        problem.response, problem.weights, known, smooth, problem.settings.level
    )
    scale = max(variance, _least_scale(problem)) if freedom else 1.0
    return replace(problem, scale=scale, scale_freedom=freedom)


def _least_scale(problem: Problem) -> float:
    """Return the least variance over that of the noise: what is known of it may be too large."""
    noise = problem.noise
    if isinstance(problem.base, KnownMap):
        return problem.base.left**2
    if noise.is_residual:
        # It is taken from the residual, which may be tiny.
        return 1e-6
    assumed = noise.source == "assumed" and not is_exact(problem.table)
    return _OF_A_GOOD_RIG if assumed else _OF_STATED_NOISE


def _significant(problem: Problem) -> F:
    """Return the (N, m, k) whitened columns of the significant effects."""
    matrix, vector, _ = problem.normal.total
    taken = significant_columns(
        (matrix, vector),
        problem.squares_beside_base,
        problem.size - problem.base_block.shape[2],
        problem.base_index,
        [(item.id, item.columns) for item in problem.offered],
        problem.settings.level,
    )
    return problem.design[:, :, taken]


def noise_by_rest(problem: Problem) -> Noise:
    """Return the noise; where it is only assumed, as the residual shows it.

    Of the six columns its ratios, of others how it grows with the load.
    """
    noise, base = problem.noise, problem.base
    if noise.source != "assumed" or not (noise.components or is_whole(base)):
        return noise
    smooth = omnibus_columns(problem, problem.size // (6 * problem.response.shape[1]))
    if noise.components:
        parts = (problem.base_block, _significant(problem), smooth)
        basis = orthonormal(problem.flat(np.concatenate(parts, axis=2)))
        y = problem.flat(problem.response)
        left = np.maximum(1.0 - (basis**2).sum(axis=1), 0.1)
        squares = (y - basis @ (basis.T @ y)) ** 2 / left
        squares = squares.reshape(problem.response.shape) * np.square(noise.components)
        return grown_by_rest(noise, problem.rows, squares)
    take = some_rows(len(problem.table))
    # Not the base's own errors: each is about the noise, and of a large base so many that no
    # reading would be left to tell the ratios.
    parts = (problem.coefficient_block, _significant(problem), smooth)
    columns = np.concatenate([part[take] for part in parts], axis=2)
    in_units = np.linalg.solve(problem.whitener.each[take], columns)
    return weighed_by_rest(problem.rows, problem.fit.residual, in_units, noise)


def with_more(problem: Problem, effects: Sequence[Effect]) -> tuple[Problem, list[Candidate]]:
    """Return the problem with the columns of more effects appended, and their candidates."""
    rows, whitener = problem.rows, problem.whitener
    columns = [score_columns(rows, whitener, effect) for effect in effects]
    if not problem.n_base:
        basis = problem.flat(problem.projected_base)
        projection = Projection(basis, np.sqrt(problem.weights))
        columns = [projection.orthogonalised(one) for one in columns]
    return with_shapes(problem, list(map(ScoreColumns, effects, columns)))


def omnibus_columns(problem: Problem, most: int = 90) -> F:
    """Return (N, m, q) whitened smooth functions of pose and covariates, in each component."""
    n = len(problem.response)
    return problem.in_each_component(features(problem.rows, max(1, min(most, 90, n // 3)))[0])


def _base_error(base: StiffnessMap, rows: Rows, whitener: F) -> float:
    loaded = (~rows.unloaded).astype(np.float64)
    variance = np.einsum("nij,j,nij,n->", whitener, base.error**2, whitener, loaded)
    return float(np.sqrt(variance / whitener.shape[0] / whitener.shape[1]))
