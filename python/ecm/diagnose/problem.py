"""The linearised problem: whitened residual, base columns and the tangents of every effect."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy import special

from ecm.columns import POSE, WRENCH
from ecm.compare.estimate import estimate_noise, usable_sd
from ecm.compare.folds import is_pose, row_groups
from ecm.compare.gram import Gram
from ecm.compare.lack_of_fit import omnibus
from ecm.compare.noise import Noise, declared_noise, whiteners
from ecm.compare.residuals import features
from ecm.effects import Effect, Missing, Rows
from ecm.refit import JointFit, base_columns, joint_fit

if TYPE_CHECKING:
    from ecm.models.maps import StiffnessMap
    from ecm.table import Table

F = NDArray[np.float64]
I = NDArray[np.int64]

ABSORBED = 0.9
_OUTLIER_CHANCE = 1e-4
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
        """Fitted numbers, a shape that was chosen among several counted as one."""
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
    scored: NDArray[np.bool_]
    """(N,) rows that count in held-out errors."""
    whitener: F
    response: F
    """(N, m)."""
    design: F
    """(N, m, K): base columns, then every candidate's, each of unit length."""
    norms: F
    """(K,) lengths taken out of the columns."""
    n_base: int
    candidates: tuple[Candidate, ...]
    untestable: dict[str, Missing]
    gram: Gram
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
        noise = estimate_noise(rows, rows.wrench, fallback=declared_or_fitted(base, table))
    fit = joint_fit(base, (), table, noise)
    base, rows = fit.base, fit.rows
    whitener = whiteners(noise.covariance(rows, base.error))
    response = fit.whitened
    base_block = np.einsum("nij,njk->nik", whitener, base_columns(rows, base))
    untestable: dict[str, Missing] = {}
    tangents: list[tuple[Effect, F]] = []
    for effect in effects:
        lacking = effect.missing(table)
        if lacking is not None:
            untestable[effect.id] = lacking
        if lacking is not None or effect.kind == "noise":
            continue
        for variant in effect.variants(table):
            zero = np.zeros(len(variant.parameters))
            tangent = np.einsum("nij,njk->nik", whitener, variant.jacobian(rows, zero))
            tangents.append((variant, tangent))
    weights = _robust_weights(response, [base_block, *(t for _, t in tangents)])
    root = np.sqrt(weights)
    basis = _basis(base_block, root)
    if base_block.shape[2] > _MOST_BASE_IN_GRAM:
        # Too many columns to carry along: project them out once, for all refits.
        response = _projected(response[:, :, None], basis, root)[:, :, 0]
        tangents = [(e, _projected(t, basis, root)) for e, t in tangents]
        base_block = base_block[:, :, :0]
    kept: list[tuple[Effect, F]] = []
    for effect, tangent in tangents:
        share = _absorbed(tangent, basis, root)
        if share > ABSORBED:
            untestable[effect.id] = Missing(
                f"the base absorbs it ({100.0 * share:.0f} %)",
                "[mechanism], so that the physics model is the base",
            )
        else:
            kept.append((effect, tangent))
    for effect, _ in kept:
        untestable.pop(effect.id, None)
    design = np.concatenate([base_block, *(t for _, t in kept)], axis=2)
    norms = np.sqrt((design**2).sum(axis=(0, 1)))
    norms = np.where(norms > 0.0, norms, 1.0)
    design = design / norms
    candidates, at = [], base_block.shape[2]
    for effect, tangent in kept:
        candidates.append(Candidate(effect, tuple(range(at, at + tangent.shape[2]))))
        at += tangent.shape[2]
    groups = row_groups(table)
    found = Problem(
        table=table,
        base=base,
        rows=rows,
        noise=noise,
        fit=fit,
        weights=weights,
        groups=groups,
        scored=is_pose(table),
        whitener=whitener,
        response=response,
        design=design,
        norms=norms,
        n_base=base_block.shape[2],
        candidates=tuple(candidates),
        untestable=untestable,
        gram=Gram.of(design, response, groups, weights),
        scale=1.0,
        base_error=_base_error(base, rows, whitener),
    )
    return _scaled(found)


def _scaled(problem: Problem) -> Problem:
    """With the variance that neither candidates nor smooth features explain."""
    most = max(1, problem.size // (3 * problem.response.shape[1]))
    everything = np.concatenate(
        [problem.design[:, :, problem.n_base :], omnibus_columns(problem, most)], axis=2
    )
    base = problem.design[:, :, : problem.n_base]
    test = omnibus(problem.response, everything, base, problem.weights)
    if test.dof_error <= 0:
        return problem
    return replace(problem, scale=float(np.clip(test.rest / test.dof_error, 0.25, np.inf)))


def declared_or_fitted(base: StiffnessMap, table: Table) -> Noise:
    """Declared figures; for tables of other columns the spread of the base's residual."""
    if base.inputs == POSE and base.outputs == WRENCH:
        return declared_noise(table)
    rows = Rows(table, base)
    measured = np.stack([table.column(name) for name in base.outputs], axis=1)
    left = measured - rows.wrench
    dof = max(1, len(left) - len(base.coefficients) // len(base.outputs))
    spread = np.sqrt((left**2).sum(axis=0) / dof)
    return Noise(source="assumed", components=usable_sd(spread, measured))


def omnibus_columns(problem: Problem, most: int = 90) -> F:
    """(N, m, q) whitened smooth functions, each in each component."""
    n, m = problem.response.shape
    values, _ = features(problem.rows, max(1, min(most, 90, n // 3)))
    blocks = [problem.whitener[:, :, j : j + 1] * values[:, None, :] for j in range(m)]
    return np.concatenate(blocks, axis=2)


def _robust_weights(response: F, blocks: Sequence[F]) -> F:
    """Weight of each row: rows that no column explains and no Gaussian gives count less."""
    n, m = response.shape
    design = np.concatenate(blocks, axis=2)
    norms = np.sqrt((design**2).sum(axis=(0, 1)))
    flat = (design / np.where(norms > 0.0, norms, 1.0)).reshape(n * m, -1)
    if flat.shape[1] >= n * m // 2:
        flat = flat[:, : blocks[0].shape[2]]
    limit = float(special.chdtri(m, _OUTLIER_CHANCE))
    middle = float(special.chdtri(m, 0.5))
    weights = np.ones(n)
    for _ in range(3):
        root = np.repeat(np.sqrt(weights), m)
        z = flat * root[:, None]
        y = response.ravel()
        normal = z.T @ z
        normal[np.diag_indices_from(normal)] += 1e-9
        theta = np.linalg.solve(normal, z.T @ (y * root))
        squares = ((y - flat @ theta).reshape(n, m) ** 2).sum(axis=1)
        scale = max(float(np.median(squares)) / middle, 1e-12)
        weights = np.minimum(1.0, (limit * scale / np.maximum(squares, 1e-300)) ** 2)
    return weights


def _basis(block: F, root: F) -> F:
    flat = (block * root[:, None, None]).reshape(-1, block.shape[2])
    if flat.shape[1] == 0:
        return flat
    norms = np.sqrt((flat**2).sum(axis=0))
    q, r = np.linalg.qr(flat / np.where(norms > 0.0, norms, 1.0))
    return np.asarray(q[:, np.abs(np.diag(r)) > 1e-10])


def _projected(tangent: F, basis: F, root: F) -> F:
    """Columns without their part in the base; the weights stay outside."""
    safe = np.where(root > 0.0, root, 1.0)
    flat = (tangent * root[:, None, None]).reshape(-1, tangent.shape[2])
    left = flat - basis @ (basis.T @ flat)
    return np.asarray(left.reshape(tangent.shape) / safe[:, None, None])


def _absorbed(tangent: F, basis: F, root: F) -> float:
    """Share that the base takes of the effect's best visible parameter."""
    flat = (tangent * root[:, None, None]).reshape(-1, tangent.shape[2])
    whole = (flat**2).sum(axis=0)
    inside = ((basis.T @ flat) ** 2).sum(axis=0)
    shares = np.where(whole > 0.0, inside / np.where(whole > 0.0, whole, 1.0), 1.0)
    return float(shares.min(initial=1.0))


def _base_error(base: StiffnessMap, rows: Rows, whitener: F) -> float:
    loaded = (~rows.unloaded).astype(np.float64)
    variance = np.einsum("nij,j,nij,n->", whitener, base.error**2, whitener, loaded)
    return float(np.sqrt(variance / whitener.shape[0] / whitener.shape[1]))
