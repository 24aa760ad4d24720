"""The linearised problem: whitened residual, base columns and score columns of every effect.

What an effect explains is no noise, but the best of many effects and shapes always explains
something: with few rows the rest after all of them would be far too small, and chance would get a
name. So only what is significant beside what was taken before is taken out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy import special

from ecm.comparison.residuals import feature_columns
from ecm.diagnosis.score_columns import effect_columns, score_columns
from ecm.diagnosis.settings import DEFAULTS, DiagnosisSettings
from ecm.effects import Effect, Missing, Rows
from ecm.io.arrays import B, F, I
from ecm.models.joint_fit import JointFit, base_columns, error_columns, joint_fit
from ecm.models.noise_estimate import declared_or_fitted, estimate_noise
from ecm.regression.f_test import omnibus_test
from ecm.regression.folds import row_groups
from ecm.regression.noise import Noise, is_exact, some_rows, weighed_by_rest, whiteners
from ecm.regression.normal_equations import (
    NormalEquations,
    explained_by_blocks,
    explained_squares,
    projected_out,
)
from ecm.regression.rows import is_whole

if TYPE_CHECKING:
    from ecm.io.table import Table
    from ecm.models.maps import StiffnessMap


_MOST = 8
"""Effects that are taken out."""


@dataclass(frozen=True)
class Shapes:
    """Columns of every shape of every effect among those of a design."""

    columns: Sequence[tuple[int, ...]]
    ids: Sequence[str]
    """The effect of each shape."""


def significant_columns(
    equations: tuple[F, F],
    squares: float,
    freedom: int,
    fixed: Sequence[int],
    shapes: Shapes,
    level: float,
) -> I:
    """Return the columns of the effects that are significant, each beside those before it.

    Parameters
    ----------
    equations
        Matrix (K, K) and vector (K,) of all columns.
    squares
        Sum of squares that the fixed columns leave, of so many degrees of `freedom`.
    fixed
        Columns of the base.
    level
        Chance that any is taken where none explains anything, by Bonferroni over the shapes.

    Examples
    --------
    >>> x = np.random.default_rng(0).standard_normal((40, 3))
    >>> y = 3.0 * x[:, 1] + 0.1 * np.cos(np.arange(40.0))
    >>> shapes = Shapes([(0,), (1,), (2,)], ["a", "b", "c"])
    >>> significant_columns((x.T @ x, x.T @ y), float(y @ y), 40, (), shapes, 0.01).tolist()
    [1]
    """
    taken: list[int] = []
    present: set[str] = set()
    for _ in range(_MOST):
        tried = [i for i, id in enumerate(shapes.ids) if id not in present]
        left = projected_out(*equations, (*fixed, *taken))
        blocks = [shapes.columns[i] for i in tried]
        gains = np.minimum(explained_by_blocks(equations, left, blocks), squares)
        sizes = np.array([len(block) for block in blocks], dtype=np.int64)
        rest = freedom - sizes
        ratio = gains / sizes / np.maximum(squares - gains, 1e-12 * squares) * rest
        p = np.where(rest > 0, special.fdtrc(sizes, np.maximum(rest, 1), ratio), 1.0)
        if len(tried) == 0 or p.min() * len(shapes.columns) >= level:
            break
        # Of several that are certain, the one that explains most.
        best = int(np.lexsort((-gains, p))[0])
        taken += blocks[best]
        present.add(shapes.ids[tried[best]])
        squares, freedom = squares - float(gains[best]), int(rest[best])
    return np.array(taken, dtype=np.int64)


def noise_variance(response: F, weights: F, known: F, smooth: F, level: float) -> tuple[float, int]:
    """Return the variance beside base and effects, and its degrees of freedom.

    Parameters
    ----------
    response
        (N, m) whitened residual.
    weights
        (N,) of the rows.
    known
        (N, m, k) columns of the base and of the significant effects.
    smooth
        (N, m, q) smooth functions, which are taken out together where they are significant.
    level
        Chance that they are where nothing is there.

    Returns
    -------
    The variance, 1 where the noise is right, and 0 degrees of freedom where too few rows are left.
    """
    test = omnibus_test(response, smooth, known, weights)
    squares, freedom = test.rest, test.dof_error
    if not (freedom > 0 and test.p < level):
        squares, freedom = squares + max(test.explained, 0.0), freedom + test.dof
    return (squares / freedom, int(freedom)) if freedom > 0 else (1.0, 0)


_OF_STATED_NOISE = 0.25
"""Least variance over noise from repeats or figures, which may be twice too large."""
_OF_A_GOOD_RIG = 1e-3
"""The same over the noise of a common rig: one that is thirty times better."""


_UNLIKE = 0.5
"""Robust weight below which a row counts as unlike all others."""
_MANY_UNLIKE = 0.005
"""Share of such rows that is no chance: of Gaussian noise there is one in 10,000."""


@dataclass(frozen=True)
class Candidate:
    """One shape of one effect and the places of its columns in the design."""

    effect: Effect
    columns: tuple[int, ...]

    @property
    def id(self) -> str:
        """The effect's id."""
        return self.effect.id

    @property
    def parameters(self) -> int:
        """Number of fitted values; the choice of the shape is not counted."""
        return len(self.columns)


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
    whitener: F
    response: F
    """(N, m)."""
    design: F
    """(N, m, K): base columns, then every candidate's, each of unit length."""
    norms: F
    """(K,) lengths of the columns before they were made unit."""
    n_base: int
    """Number of base columns in the design: of its coefficients, then those of its known errors,
    whose size has a normal prior of standard deviation 1."""
    projected_base: F
    """(N, m, b) orthogonal columns of a base that is too large for the design; else b = 0."""
    candidates: tuple[Candidate, ...]
    imitators: tuple[Candidate, ...]
    """Effects that cannot be tested with these rows, but can look like another effect."""
    untestable: dict[str, Missing]
    normal: NormalEquations
    """Normal equations of the design by group of rows."""
    scale: float
    """Variance that no column explains; 1 where the noise is right."""
    scale_freedom: int
    """Its degrees of freedom; 0 where the rows do not tell it."""
    base_error: float
    """Whitened rms of the base's own error."""
    settings: DiagnosisSettings
    reduced: tuple[F, F] | None = None
    """Normal equations in place of those of the rows, to study a stage."""

    @property
    def size(self) -> int:
        """Rows times components."""
        return int((self.weights > 0.0).sum() * self.response.shape[1])

    @property
    def base_index(self) -> tuple[int, ...]:
        """Columns of the base."""
        return tuple(range(self.n_base))

    @property
    def base_block(self) -> F:
        """(N, m, k) columns of the base, which a test must give its degrees of freedom."""
        return self.design[:, :, : self.n_base] if self.n_base else self.projected_base

    @cached_property
    def squares_beside_base(self) -> float:
        """Weighted squares of the response that the base leaves."""
        matrix, vector, total = self.normal.total()
        return max(total - explained_squares(matrix, vector, self.base_index), 0.0)

    @cached_property
    def equations(self) -> tuple[F, F]:
        """Matrix (K, K) and vector (K,) of all rows over the noise scale; do not change them."""
        if self.reduced is not None:
            return self.reduced
        matrix, vector, _ = self.normal.total()
        return matrix / self.scale, vector / self.scale

    def in_units(self, whitened: F) -> F:
        """Return whitened (N, m) numbers in the units of their columns."""
        return np.asarray(np.linalg.solve(self.whitener, whitened[:, :, None])[:, :, 0])

    @property
    def unlike_rows(self) -> list[int]:
        """Rows that are unlike all others and count less; none where chance gives as many."""
        rows = np.flatnonzero(self.weights < _UNLIKE).tolist()
        return rows if len(rows) > max(3.0, _MANY_UNLIKE * len(self.weights)) else []

    def rms(self, errors: F) -> F:
        """(m,) root mean square of errors (N, m); rows that are unlike all others count less."""
        weights = np.where(self.scored, self.weights, 0.0)
        return np.asarray(np.sqrt(weights @ errors**2 / weights.sum()))

    def without_effect(self, id: str) -> Problem:
        """Return the problem in which an effect is no candidate."""
        return replace(self, candidates=tuple(c for c in self.candidates if c.id != id))

    @cached_property
    def leading(self) -> I:
        """Columns of each effect's best shape: what they do not explain is noise."""
        matrix, vector, _ = self.normal.total()
        left = projected_out(matrix, vector, self.base_index)
        offered = (*self.candidates, *self.imitators)
        gains = explained_by_blocks(
            (matrix, vector), left, [candidate.columns for candidate in offered]
        )
        best: dict[str, tuple[float, Candidate]] = {}
        for candidate, gain in zip(offered, gains.tolist(), strict=True):
            if candidate.id not in best or gain > best[candidate.id][0]:
                best[candidate.id] = (gain, candidate)
        return np.array([c for _, item in best.values() for c in item.columns], dtype=np.int64)

    @cached_property
    def signs(self) -> F:
        """(K,) 1 where a coefficient may not be negative, -1 where not positive, else 0."""
        signs = np.zeros(self.normal.rows.shape[1])
        for item in (*self.candidates, *self.imitators):
            for column, parameter in zip(item.columns, item.effect.parameters, strict=True):
                signs[column] = float(parameter.lower >= 0.0) - float(parameter.upper <= 0.0)
        return signs

    @cached_property
    def smooth_columns(self) -> F:
        """(N, m, q) smooth functions that test for any structure; see `omnibus_columns`."""
        return omnibus_columns(self)

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
) -> Problem:
    """Fit the base, estimate the noise, whiten, weight, and drop what cannot be tested.

    Parameters
    ----------
    base
        Map against which effects are named.
    table
        Measured rows, N of them.
    effects
        Effects to test.
    noise
        Noise of the rows; default: estimated from repeats, else declared or assumed.
    settings
        Limits of the procedure.
    """
    rows = Rows(table, base)
    if noise is None:
        base = joint_fit(base, (), table, declared_or_fitted(base, table)).base
        rows = Rows(table, base)
        noise = estimate_noise(rows, rows.sensor_load, fallback=declared_or_fitted(base, table))
    fit = joint_fit(base, (), table, noise)
    base, rows = fit.base, fit.rows
    whitener = whiteners(noise.covariance(rows, base.error))
    base_block = whitener @ base_columns(rows, base)
    columns = effect_columns(
        rows,
        effects,
        whitener=whitener,
        response=fit.whitened,
        base_block=base_block,
        base_kind=base.kind,
    )
    response, kept, projection = fit.whitened, columns.kept, columns.projection
    weights, untestable = columns.weights, columns.untestable
    projected = base_block[:, :, :0]
    if base_block.shape[2] > settings.most_base_columns:
        # Too many columns to carry along: project them out once, for all refits.
        response = projection.rest(response[:, :, None])[:, :, 0]
        kept = [replace(one, columns=projection.orthogonalised(one.columns)) for one in kept]
        projected = projection.basis.reshape(*response.shape, -1) / projection.root[:, None, None]
        base_block = base_block[:, :, :0]
    free = base_block.shape[2]
    if free:
        errs = whitener @ error_columns(rows, base)
        base_block = np.concatenate([base_block, errs], axis=2)
    design = np.concatenate([base_block, *(one.columns for one in kept)], axis=2)
    norms = np.sqrt(np.einsum("nmk,nmk->k", design, design))
    norms = np.where(norms > 0.0, norms, 1.0)
    design /= norms
    precision = np.zeros(len(norms))
    precision[free : base_block.shape[2]] = 1.0 / norms[free : base_block.shape[2]] ** 2
    ends = base_block.shape[2] + np.cumsum([one.columns.shape[2] for one in kept], dtype=np.int64)
    placed = [
        (one.imitates, Candidate(one.effect, tuple(range(end - one.columns.shape[2], end))))
        for one, end in zip(kept, ends.tolist(), strict=True)
    ]
    # The columns are in the design: a second copy is a large part of the memory.
    del columns, kept
    groups = row_groups(table)
    problem = Problem(
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
        design=design,
        norms=norms,
        n_base=base_block.shape[2],
        projected_base=projected,
        candidates=tuple(candidate for imitates, candidate in placed if not imitates),
        imitators=tuple(candidate for imitates, candidate in placed if imitates),
        untestable=untestable,
        normal=NormalEquations.of(design, response, groups, weights, precision),
        scale=1.0,
        scale_freedom=0,
        base_error=_base_error(base, rows, whitener),
        settings=settings,
    )
    return _scaled(problem)


def _scaled(problem: Problem) -> Problem:
    """Return the problem with the variance that neither effects nor smooth functions explain."""
    known = _significant(problem)
    smooth = omnibus_columns(problem, problem.size // (3 * problem.response.shape[1]))
    variance, freedom = noise_variance(
        problem.response, problem.weights, known, smooth, problem.settings.level
    )
    if not freedom:
        return problem
    return replace(problem, scale=max(variance, _least_scale(problem)), scale_freedom=freedom)


def _least_scale(problem: Problem) -> float:
    """Return the least variance over that of the noise: what is known of it may be too large."""
    noise = problem.noise
    if noise.is_residual:
        # It is taken from the residual, which may be tiny.
        return 1e-6
    assumed = noise.source == "assumed" and not is_exact(problem.table)
    return _OF_A_GOOD_RIG if assumed else _OF_STATED_NOISE


def _significant(problem: Problem) -> F:
    """Return the (N, m, k) whitened columns of the base and of the significant effects."""
    matrix, vector, _ = problem.normal.total()
    offered = (*problem.candidates, *problem.imitators)
    taken = significant_columns(
        (matrix, vector),
        problem.squares_beside_base,
        problem.size - problem.base_block.shape[2],
        problem.base_index,
        Shapes([item.columns for item in offered], [item.id for item in offered]),
        problem.settings.level,
    )
    return np.concatenate([problem.base_block, problem.design[:, :, taken]], axis=2)


def noise_by_rest(problem: Problem) -> Noise:
    """Return the noise; where it is only assumed, with the ratios that the residual shows."""
    noise, base = problem.noise, problem.base
    if noise.source != "assumed" or noise.components is not None or not is_whole(base):
        return noise
    smooth = omnibus_columns(problem, problem.size // (6 * problem.response.shape[1]))
    take = some_rows(len(problem.table))
    parts = (problem.projected_base, _significant(problem), smooth)
    columns = np.concatenate([part[take] for part in parts], axis=2)
    in_units = np.linalg.solve(problem.whitener[take], columns)
    return weighed_by_rest(problem.rows, problem.fit.residual, in_units, noise)


def with_more(problem: Problem, effects: Sequence[Effect]) -> tuple[Problem, list[Candidate]]:
    """Return the problem with the columns of more effects appended, and their candidates."""
    blocks = [score_columns(problem.rows, problem.whitener, effect) for effect in effects]
    norms = [np.sqrt((block**2).sum(axis=(0, 1))) for block in blocks]
    at = problem.design.shape[2]
    candidates = []
    for effect, block in zip(effects, blocks, strict=True):
        candidates.append(Candidate(effect, tuple(range(at, at + block.shape[2]))))
        at += block.shape[2]
    scaled = [block / np.where(n > 0.0, n, 1.0) for block, n in zip(blocks, norms, strict=True)]
    design = np.concatenate([problem.design, *scaled], axis=2)
    precision = np.pad(problem.normal.precision, (0, at - len(problem.norms)))
    wider = replace(
        problem,
        design=design,
        norms=np.concatenate([problem.norms, *norms]),
        normal=NormalEquations.of(
            design, problem.response, problem.groups, problem.weights, precision
        ),
    )
    return wider, candidates


def omnibus_columns(problem: Problem, most: int = 90) -> F:
    """Return (N, m, q) whitened smooth functions of pose and covariates, in each component."""
    n = len(problem.response)
    return feature_columns(problem.rows, problem.whitener, max(1, min(most, 90, n // 3)))


def _base_error(base: StiffnessMap, rows: Rows, whitener: F) -> float:
    loaded = (~rows.unloaded).astype(np.float64)
    variance = np.einsum("nij,j,nij,n->", whitener, base.error**2, whitener, loaded)
    return float(np.sqrt(variance / whitener.shape[0] / whitener.shape[1]))
