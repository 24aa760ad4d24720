"""Score columns: whitened derivatives of the effects' corrections, screened against the base."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from ecm.effects import Effect, Missing, Rows
from ecm.effects.protocol import UNKNOWN_LENGTH, jacobian_of
from ecm.io.arrays import F, I
from ecm.regression.blocks import in_threads
from ecm.regression.f_test import explained_by_span, orthonormal
from ecm.regression.rows import UnknownLength, is_whole

OUTLIER_CHANCE = 1e-4
"""Rows less likely than this under the noise count less."""
_ABSORBED_SHARE = 0.9
"""An effect of which a base absorbs more cannot be tested."""
_ABSORBED_BY_PHYSICS = 0.995
"""The same for a physics base: its one or two coefficients absorb nothing by chance."""
SHAPE_REFINEMENTS = 4
"""Rounds in which the shape of an effect is refined between grid points."""

_ROUNDING = 1e-9
_AT_ONCE = 64
"""Columns that are projected together, about."""


@dataclass(frozen=True)
class ScoreColumns:
    """One shape of one effect."""

    effect: Effect
    columns: F
    """(N, m, k) whitened derivative of the correction at zero."""
    imitates: bool
    """It cannot be tested with these data, but its columns may look like another effect."""


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
        flat = (block * root[:, None, None]).reshape(-1, block.shape[2])
        return Projection(orthonormal(flat, dependent=1e-10), root)

    def flat(self, columns: F) -> F:
        """Return (N m, k) weighted columns."""
        return (columns * self.root[:, None, None]).reshape(-1, columns.shape[2])

    def rest(self, columns: F) -> F:
        """Return the columns (N, m, k) without their part in the base; weights stay outside."""
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

        def of_part(part: Sequence[F]) -> list[float]:
            flat, cuts = self._together(part)
            total = (flat**2).sum(axis=0)
            inside = ((self.basis.T @ flat) ** 2).sum(axis=0)
            shares = np.where(total > 0.0, inside / np.where(total > 0.0, total, 1.0), 1.0)
            return [float(own.min(initial=1.0)) for own in np.split(shares, cuts)]

        return _of_parts(of_part, blocks)

    def explained_by_each(self, blocks: Sequence[F], response: F) -> list[float]:
        """Return the squares of the response (N m,) that columns (N, m, k) of each add to the base.

        A product with a large base reads all of it: with one block at a time that is all its work.
        """

        def of_part(part: Sequence[F]) -> list[float]:
            flat, cuts = self._together(part)
            flat -= self.basis @ (self.basis.T @ flat)
            return [explained_by_span(own, response)[0] for own in np.split(flat, cuts, axis=1)]

        return _of_parts(of_part, blocks)

    def _together(self, part: Sequence[F]) -> tuple[F, I]:
        """Return (N m, k) weighted columns of some blocks, and where each but the first begins."""
        flat = np.concatenate([self.flat(block) for block in part], axis=1)
        return flat, np.cumsum([block.shape[2] for block in part])[:-1]


def _of_parts(work: Callable[[Sequence[F]], list[float]], blocks: Sequence[F]) -> list[float]:
    """Return the numbers of `work` for each block (N, m, k); blocks are given some at a time."""
    ends = np.cumsum([block.shape[2] for block in blocks]) // _AT_ONCE
    parts = [
        [blocks[i] for i in np.flatnonzero(ends == place).tolist()] for place in np.unique(ends)
    ]
    return [number for numbers in in_threads(work, parts) for number in numbers]


@dataclass(frozen=True)
class EffectColumns:
    """The columns that are compared, and the weights and base directions they rest on."""

    kept: list[ScoreColumns]
    untestable: dict[str, Missing]
    weights: F
    """(N,) robust weight of each row."""
    projection: Projection


def effect_columns(
    rows: Rows,
    effects: Sequence[Effect],
    *,
    whitener: F,
    response: F,
    base_block: F,
    base_kind: str,
) -> EffectColumns:
    """Return the columns of all effects that the base does not absorb, with robust weights.

    Parameters
    ----------
    whitener
        (N, m, m) of the rows.
    response
        (N, m) whitened residual of the base.
    base_block
        (N, m, b) whitened columns of the base.
    base_kind
        "physics", "energy" or "polynomial".
    """
    every, untestable = all_score_columns(rows, whitener, effects)
    first = _leading_shapes(every, response, Projection.of(base_block, np.ones(len(response))))
    blocks = [base_block, *(one.columns for one in first)]
    weights = robust_weights(response, blocks, OUTLIER_CHANCE)
    projection = Projection.of(base_block, np.sqrt(weights))
    every += _refined_shapes(rows, whitener, response, every, projection)
    kept, absorbed = _not_absorbed(every, projection, base_kind, is_whole(rows.base))
    return EffectColumns(kept, untestable | absorbed, weights, projection)


def all_score_columns(
    rows: Rows, whitener: F, effects: Sequence[Effect]
) -> tuple[list[ScoreColumns], dict[str, Missing]]:
    """Return every variant of every effect that has columns, and what cannot be tested."""
    table = rows.whole.table

    def of_effect(effect: Effect) -> tuple[list[ScoreColumns], Missing | None]:
        lacking = effect.missing(table)
        if effect.kind == "noise" or (lacking is not None and not lacking.imitates):
            return [], lacking
        variants = effect.variants(table) if lacking is None else lacking.forms or (effect,)
        try:
            return [
                ScoreColumns(v, score_columns(rows, whitener, v), lacking is not None)
                for v in variants
            ], lacking
        except UnknownLength:
            return [], lacking or UNKNOWN_LENGTH

    columns: list[ScoreColumns] = []
    untestable: dict[str, Missing] = {}
    for effect, (own, lacking) in zip(effects, in_threads(of_effect, effects), strict=True):
        columns += own
        if lacking is not None:
            untestable[effect.id] = lacking
    return columns, untestable


def score_columns(rows: Rows, whitener: F, effect: Effect) -> F:
    """Return (N, m, k) whitened derivative of the effect's correction at zero."""
    jacobian = jacobian_of(effect, rows, np.zeros(len(effect.parameters)))
    return np.asarray(whitener @ jacobian)


def _leading_shapes(
    every: Sequence[ScoreColumns], response: F, projection: Projection
) -> list[ScoreColumns]:
    """Return the shape of each effect that explains most of the response beyond the base."""
    y = _rest_of_response(response, projection)
    best: dict[str, tuple[float, ScoreColumns]] = {}
    gains = projection.explained_by_each([item.columns for item in every], y)
    for item, gain in zip(every, gains, strict=True):
        if item.effect.id not in best or gain > best[item.effect.id][0]:
            best[item.effect.id] = (gain, item)
    return [item for _, item in best.values()]


def _refined_shapes(
    rows: Rows,
    whitener: F,
    response: F,
    every: list[ScoreColumns],
    projection: Projection,
) -> list[ScoreColumns]:
    """Return better shapes between the best of a coarse grid and its neighbours."""
    y = _rest_of_response(response, projection)
    table = rows.whole.table

    def refined(id: str) -> ScoreColumns | None:
        own = [item for item in every if item.effect.id == id]
        if not any(item.effect.refined(table, 0) for item in own):
            return None
        gains = projection.explained_by_each([item.columns for item in own], y)
        best, first = max(zip(gains, own, strict=True), key=lambda pair: pair[0])
        start = first
        for round_ in range(SHAPE_REFINEMENTS):
            for shape in first.effect.refined(table, round_):
                trial = ScoreColumns(shape, score_columns(rows, whitener, shape), False)
                gain = projection.explained_by_each([trial.columns], y)[0]
                if gain > best:
                    best, first = gain, trial
        return None if first is start else first

    ids = dict.fromkeys(item.effect.id for item in every if not item.imitates)
    return [item for item in in_threads(refined, ids) if item is not None]


def _rest_of_response(response: F, projection: Projection) -> F:
    """Return (N m,) weighted response without its part in the base."""
    left = projection.rest(response[:, :, None])[:, :, 0]
    return np.asarray((left * projection.root[:, None]).ravel())


def _not_absorbed(
    every: Sequence[ScoreColumns],
    projection: Projection,
    base_kind: str,
    whole: bool,
) -> tuple[list[ScoreColumns], dict[str, Missing]]:
    """Return the columns that the base does not absorb, and why the others are left out."""
    physics = base_kind == "physics"
    most = _ABSORBED_BY_PHYSICS if physics else _ABSORBED_SHARE
    kept: list[ScoreColumns] = []
    absorbed: dict[str, Missing] = {}
    shares = projection.absorbed_by_each([item.columns for item in every])
    for item, share in zip(every, shares, strict=True):
        own = getattr(item.effect, "most_absorbed", None)
        if share <= (own or (_ABSORBED_SHARE if item.imitates else most)):
            kept.append(item)
        elif not item.imitates:
            absorbed[item.effect.id] = Missing(
                f"the base absorbs it ({100.0 * share:.0f} %)",
                _record(base_kind, whole),
            )
    seen = {item.effect.id for item in kept}
    return kept, {id: why for id, why in absorbed.items() if id not in seen}


def _record(base_kind: str, whole: bool) -> str:
    """Return what separates an effect from a base that absorbs it."""
    if base_kind == "physics":
        return "pure axial and pure torsion poses, or a second specimen"
    if not whole:
        return "the same poses again, in another order and at another speed"
    return "[mechanism], so that the physics model is the base"


def robust_weights(response: F, blocks: Sequence[F], outlier_chance: float) -> F:
    """Return (N,) weights: rows that no column explains and no Gaussian gives count less."""
    n, m = response.shape
    design = np.concatenate(blocks, axis=2)
    norms = np.sqrt(np.einsum("nmk,nmk->k", design, design))
    design /= np.where(norms > 0.0, norms, 1.0)
    flat = design.reshape(n * m, -1)
    if flat.shape[1] >= n * m // 2:
        flat = flat[:, : blocks[0].shape[2]]
    limit = float(special.chdtri(m, outlier_chance))
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
