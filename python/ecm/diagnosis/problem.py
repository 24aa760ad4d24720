"""The linearised problem: whitened residual, base columns and the tangents of every effect."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ecm.comparison.residuals import features
from ecm.diagnosis.score_columns import (
    all_score_columns,
    basis_of,
    leading_shapes,
    orthogonalised,
    projected_columns,
    refined_shapes,
    robust_weights,
    score_columns,
    without_absorbed,
)
from ecm.effects import Effect, Missing, Rows
from ecm.io.arrays import B, F, I
from ecm.models.joint_fit import JointFit, base_columns, joint_fit
from ecm.models.noise_estimate import declared_or_fitted, estimate_noise
from ecm.regression.f_test import omnibus_test
from ecm.regression.folds import is_pose_row, row_groups
from ecm.regression.noise import Noise, whiteners
from ecm.regression.normal_equations import NormalEquations, explained_by_blocks, projected_out

if TYPE_CHECKING:
    from ecm.io.table import Table
    from ecm.models.maps import StiffnessMap


_MOST_BASE_IN_GRAM = 80


@dataclass(frozen=True)
class Candidate:
    """One shape of one effect and where its columns stand in the design."""

    effect: Effect
    columns: tuple[int, ...]

    @property
    def id(self) -> str:
        """The effect's id."""
        return self.effect.id

    @property
    def parameters(self) -> int:
        """Fitted numbers; which of several shapes it is, is not counted."""
        return len(self.columns)


@dataclass(frozen=True)
class Problem:
    """Everything the search works on; all arrays whitened and robustly weighted."""

    table: Table
    base: StiffnessMap
    rows: Rows
    noise: Noise
    fit: JointFit
    """Of the base alone."""
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
    """(K,) lengths taken out of the columns."""
    n_base: int
    apart: F
    """(N, m, b) orthogonal columns of a base too large for the design; b = 0 where it is there."""
    candidates: tuple[Candidate, ...]
    shadows: tuple[Candidate, ...]
    """Effects that cannot be tested here, and yet may stand behind the name of another."""
    untestable: dict[str, Missing]
    gram: NormalEquations
    scale: float
    """Variance that no column explains; 1 where the noise is right."""
    base_error: float
    """Whitened rms of the base's own error."""

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
        return self.design[:, :, : self.n_base] if self.n_base else self.apart

    @cached_property
    def equations(self) -> tuple[F, F]:
        """G and c over all groups, divided by the noise scale; not to be written into."""
        matrix, vector, _ = self.gram.total()
        return matrix / self.scale, vector / self.scale

    @cached_property
    def leading(self) -> I:
        """Columns of each effect's best shape: what stays is noise, and enough of it is left."""
        matrix, vector, _ = self.gram.total()
        left = projected_out(matrix, vector, self.base_index)
        offered = (*self.candidates, *self.shadows)
        found = explained_by_blocks(
            (matrix, vector), left, [candidate.columns for candidate in offered]
        )
        best: dict[str, tuple[float, Candidate]] = {}
        for candidate, gain in zip(offered, found.tolist(), strict=True):
            if candidate.id not in best or gain > best[candidate.id][0]:
                best[candidate.id] = (gain, candidate)
        return np.array([c for _, item in best.values() for c in item.columns], dtype=np.int64)

    @cached_property
    def signs(self) -> F:
        """(K,) 1 where a coefficient may not be negative, -1 where not positive, else 0."""
        found = np.zeros(self.gram.rows.shape[1])
        for item in (*self.candidates, *self.shadows):
            for column, parameter in zip(item.columns, item.effect.parameters, strict=True):
                found[column] = float(parameter.lower >= 0.0) - float(parameter.upper <= 0.0)
        return found

    @property
    def ids(self) -> tuple[str, ...]:
        """Testable ids in the order of the catalogue."""
        return tuple(dict.fromkeys(c.id for c in self.candidates))


def assemble(
    base: StiffnessMap, table: Table, effects: Sequence[Effect], noise: Noise | None
) -> Problem:
    """Fit the base, estimate the noise, whiten, weight, and drop what cannot be tested."""
    rows = Rows(table, base)
    if noise is None:
        base = joint_fit(base, (), table, declared_or_fitted(base, table)).base
        rows = Rows(table, base)
        noise = estimate_noise(rows, rows.sensor_load, fallback=declared_or_fitted(base, table))
    fit = joint_fit(base, (), table, noise)
    base, rows = fit.base, fit.rows
    whitener = whiteners(noise.covariance(rows, base.error))
    response = fit.whitened
    base_block = np.einsum("nij,njk->nik", whitener, base_columns(rows, base))
    found, untestable = all_score_columns(rows, whitener, effects)
    plain = np.ones(len(table))
    basis = basis_of(base_block, plain)
    left = projected_columns(response[:, :, None], basis, plain)[:, :, 0]
    first = leading_shapes(found, left, basis, plain)
    weights = robust_weights(response, [base_block, *(item.columns for item in first)])
    root = np.sqrt(weights)
    basis = basis_of(base_block, root)
    left = projected_columns(response[:, :, None], basis, root)[:, :, 0]
    found += refined_shapes(rows, whitener, left, found, basis=basis, root=root)
    kept, absorbed = without_absorbed(found, basis, root, base.kind)
    untestable |= absorbed
    apart = base_block[:, :, :0]
    if base_block.shape[2] > _MOST_BASE_IN_GRAM:
        # Too many columns to carry along: project them out once, for all refits.
        response = left
        kept = [replace(t, columns=orthogonalised(t.columns, basis, root)) for t in kept]
        apart = basis.reshape(*response.shape, -1) / root[:, None, None]
        base_block = base_block[:, :, :0]
    design = np.concatenate([base_block, *(item.columns for item in kept)], axis=2)
    norms = np.sqrt((design**2).sum(axis=(0, 1)))
    norms = np.where(norms > 0.0, norms, 1.0)
    design = design / norms
    candidates: list[Candidate] = []
    shadows: list[Candidate] = []
    at = base_block.shape[2]
    for item in kept:
        columns = tuple(range(at, at + item.columns.shape[2]))
        (shadows if item.shadow else candidates).append(Candidate(item.effect, columns))
        at = columns[-1] + 1
    groups = row_groups(table)
    problem = Problem(
        table=table,
        base=base,
        rows=rows,
        noise=noise,
        fit=fit,
        weights=weights,
        groups=groups,
        scored=is_pose_row(table),
        whitener=whitener,
        response=response,
        design=design,
        norms=norms,
        n_base=base_block.shape[2],
        apart=apart,
        candidates=tuple(candidates),
        shadows=tuple(shadows),
        untestable=untestable,
        gram=NormalEquations.of(design, response, groups, weights),
        scale=1.0,
        base_error=_base_error(base, rows, whitener),
    )
    return _scaled(problem)


def _scaled(problem: Problem) -> Problem:
    """With the variance that neither candidates nor smooth features explain."""
    most = max(1, problem.size // (3 * problem.response.shape[1]))
    everything = np.concatenate(
        [problem.design[:, :, problem.leading], omnibus_columns(problem, most)], axis=2
    )
    test = omnibus_test(problem.response, everything, problem.base_block, problem.weights)
    if test.dof_error <= 0:
        return problem
    # Where nothing is known of the noise the spread of the base's residual stands for it.
    least = 1e-6 if problem.noise.components and problem.noise.source == "assumed" else 0.25
    return replace(problem, scale=float(np.clip(test.rest / test.dof_error, least, np.inf)))


def with_more(problem: Problem, effects: Sequence[Effect]) -> tuple[Problem, list[Candidate]]:
    """The problem with the columns of more effects appended, and where they stand."""
    blocks = [score_columns(problem.rows, problem.whitener, effect) for effect in effects]
    norms = [np.sqrt((block**2).sum(axis=(0, 1))) for block in blocks]
    at = problem.design.shape[2]
    candidates = []
    for effect, block in zip(effects, blocks, strict=True):
        candidates.append(Candidate(effect, tuple(range(at, at + block.shape[2]))))
        at += block.shape[2]
    scaled = [block / np.where(n > 0.0, n, 1.0) for block, n in zip(blocks, norms, strict=True)]
    design = np.concatenate([problem.design, *scaled], axis=2)
    wider = replace(
        problem,
        design=design,
        norms=np.concatenate([problem.norms, *norms]),
        gram=NormalEquations.of(design, problem.response, problem.groups, problem.weights),
    )
    return wider, candidates


def omnibus_columns(problem: Problem, most: int = 90) -> F:
    """(N, m, q) whitened smooth functions, each in each component."""
    n, m = problem.response.shape
    values, _ = features(problem.rows, max(1, min(most, 90, n // 3)))
    blocks = [problem.whitener[:, :, j : j + 1] * values[:, None, :] for j in range(m)]
    return np.concatenate(blocks, axis=2)


def _base_error(base: StiffnessMap, rows: Rows, whitener: F) -> float:
    loaded = (~rows.unloaded).astype(np.float64)
    variance = np.einsum("nij,j,nij,n->", whitener, base.error**2, whitener, loaded)
    return float(np.sqrt(variance / whitener.shape[0] / whitener.shape[1]))
