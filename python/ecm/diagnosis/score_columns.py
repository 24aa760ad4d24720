"""Whitened tangent columns of the effects, screened against the base."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from ecm.effects import Effect, Missing, Rows
from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.regression.f_test import explained_by_span

ABSORBED = 0.9
ABSORBED_BY_PHYSICS = 0.995
"""A physics base has one or two coefficients, no surplus that could swallow a form by chance: what
it leaves of an effect is still the effect's own."""
_OUTLIER_CHANCE = 1e-4
_ROUNDING = 1e-9
_REFINEMENTS = 4


@dataclass(frozen=True)
class ScoreColumns:
    """One shape of one effect."""

    effect: Effect
    columns: F
    """(N, m, k) whitened derivative of the correction at zero."""
    shadow: bool
    """Its data are not there, but its columns are: it may stand behind another's name."""


def all_score_columns(
    rows: Rows, whitener: F, effects: Sequence[Effect]
) -> tuple[list[ScoreColumns], dict[str, Missing]]:
    """Every variant of every effect that has columns, and what cannot be tested."""
    found: list[ScoreColumns] = []
    untestable: dict[str, Missing] = {}
    for effect in effects:
        lacking = effect.missing(rows.table)
        if lacking is not None:
            untestable[effect.id] = lacking
        if effect.kind == "noise" or (lacking is not None and not lacking.imitates):
            continue
        variants = effect.variants(rows.table) if lacking is None else (effect,)
        shadow = lacking is not None
        try:
            found += [ScoreColumns(v, score_columns(rows, whitener, v), shadow) for v in variants]
        except InputError:
            if rows.has_length:
                raise
            untestable[effect.id] = Missing(
                "the mechanism's length is not known", "[mechanism] length_m"
            )
    return found, untestable


def score_columns(rows: Rows, whitener: F, effect: Effect) -> F:
    """(N, m, k) whitened derivative of the correction at zero."""
    jacobian = effect.jacobian(rows, np.zeros(len(effect.parameters)))
    return np.asarray(np.einsum("nij,njk->nik", whitener, jacobian))


def leading_shapes(
    found: Sequence[ScoreColumns], response: F, basis: F, root: F
) -> list[ScoreColumns]:
    """Of each effect the shape that explains most of the response (N, m), beyond the base."""
    y = (response * root[:, None]).ravel()
    best: dict[str, tuple[float, ScoreColumns]] = {}
    for item in found:
        gain = _gain(item.columns, y, basis, root)
        if item.effect.id not in best or gain > best[item.effect.id][0]:
            best[item.effect.id] = (gain, item)
    return [item for _, item in best.values()]


def refined_shapes(
    rows: Rows, whitener: F, response: F, found: list[ScoreColumns], *, basis: F, root: F
) -> list[ScoreColumns]:
    """With shapes between the best of a coarse grid and its neighbours, the best appended."""
    y = (response * root[:, None]).ravel()
    added: list[ScoreColumns] = []
    for id in dict.fromkeys(item.effect.id for item in found if not item.shadow):
        own = [item for item in found if item.effect.id == id]
        if not any(item.effect.refined(rows.table, 0) for item in own):
            continue
        gains = [_gain(item.columns, y, basis, root) for item in own]
        best, first = max(zip(gains, own, strict=True), key=lambda pair: pair[0])
        start = first
        for round_ in range(_REFINEMENTS):
            for shape in first.effect.refined(rows.table, round_):
                trial = ScoreColumns(shape, score_columns(rows, whitener, shape), False)
                gain = _gain(trial.columns, y, basis, root)
                if gain > best:
                    best, first = gain, trial
        if first is not start:
            added.append(first)
    return added


def _gain(columns: F, y: F, basis: F, root: F) -> float:
    """Sum of squares of y, which the base has left, that the columns explain beside the base."""
    flat = (columns * root[:, None, None]).reshape(len(y), -1)
    return explained_by_span(flat - basis @ (basis.T @ flat), y)[0]


def without_absorbed(
    found: Sequence[ScoreColumns], basis: F, root: F, base_kind: str
) -> tuple[list[ScoreColumns], dict[str, Missing]]:
    """Those that the base does not absorb; the others with the share that it takes."""
    most = ABSORBED_BY_PHYSICS if base_kind == "physics" else ABSORBED
    kept: list[ScoreColumns] = []
    absorbed: dict[str, Missing] = {}
    for item in found:
        share = _absorbed(item.columns, basis, root)
        if share <= (ABSORBED if item.shadow else most):
            kept.append(item)
        elif not item.shadow:
            absorbed[item.effect.id] = Missing(
                f"the base absorbs it ({100.0 * share:.0f} %)",
                "[mechanism], so that the physics model is the base"
                if base_kind != "physics"
                else "pure axial and pure torsion poses, or a second specimen",
            )
    seen = {item.effect.id for item in kept}
    return kept, {id: why for id, why in absorbed.items() if id not in seen}


def _absorbed(columns: F, basis: F, root: F) -> float:
    """Share that the base takes of the effect's best visible parameter."""
    flat = (columns * root[:, None, None]).reshape(basis.shape[0], -1)
    whole = (flat**2).sum(axis=0)
    inside = ((basis.T @ flat) ** 2).sum(axis=0)
    shares = np.where(whole > 0.0, inside / np.where(whole > 0.0, whole, 1.0), 1.0)
    return float(shares.min(initial=1.0))


def robust_weights(response: F, blocks: Sequence[F]) -> F:
    """(N,) weight of each row: rows that no column explains and no Gaussian gives count less."""
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
        excess = np.maximum(squares, 1e-12 * limit * scale) / (limit * scale)
        weights = np.minimum(1.0, excess**-2.0)
    return weights


def projected_columns(columns: F, basis: F, root: F) -> F:
    """Columns without their part in the base; the weights stay outside."""
    safe = np.where(root > 0.0, root, 1.0)
    flat = (columns * root[:, None, None]).reshape(-1, columns.shape[2])
    left = flat - basis @ (basis.T @ flat)
    return np.asarray(left.reshape(columns.shape) / safe[:, None, None])


def orthogonalised(columns: F, basis: F, root: F) -> F:
    """The same, and zero where the base takes all of a column and leaves its rounding errors."""
    left = projected_columns(columns, basis, root)
    whole, rest = (np.sqrt((part**2).sum(axis=(0, 1))) for part in (columns, left))
    return np.where(rest > _ROUNDING * whole, left, 0.0)


def basis_of(block: F, root: F) -> F:
    """Orthonormal basis of weighted columns."""
    flat = (block * root[:, None, None]).reshape(-1, block.shape[2])
    if flat.shape[1] == 0:
        return flat
    norms = np.sqrt((flat**2).sum(axis=0))
    q, r = np.linalg.qr(flat / np.where(norms > 0.0, norms, 1.0))
    return np.asarray(q[:, np.abs(np.diag(r)) > 1e-10])
