"""Structure that no known effect explains: variables, words, nearest effect, effect template."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ecm.comparison.residuals import covariates, factors, features
from ecm.diagnosis.ard import ard_relevance
from ecm.diagnosis.effect_template import effect_template
from ecm.diagnosis.problem import Candidate, Problem
from ecm.diagnosis.readings import WrongStatement
from ecm.diagnosis.search import rank
from ecm.diagnosis.whiteness import Pattern
from ecm.io.arrays import F
from ecm.regression.correlation import SlowNoise
from ecm.regression.f_test import orthonormal


@dataclass(frozen=True)
class Nearest:
    """The effect that explains most of what is left."""

    id: str
    share: float


@dataclass(frozen=True)
class Unknown:
    """Description of structure that no effect explains."""

    variables: tuple[str, ...]
    """Variables that the residual follows."""
    relevance: dict[str, float]
    """Share of each variable by a Gaussian process."""
    words: str
    nearest: Nearest | None
    template: str = field(metadata={"json": "skeleton"})
    """Python text of an effect that a user may complete; empty where no effect would help."""
    statement: WrongStatement | None = field(default=None, metadata={"optional": True})
    """A reading of the table that fits far better than the one that was stated."""
    misread: bool = False
    """Whether the words say what looks wrong with the table: a unit, a sign, an axis."""
    pattern: Pattern | None = field(default=None, metadata={"optional": True})
    """What the residual follows that no smooth function shows."""
    slow_noise: SlowNoise | None = field(default=None, metadata={"optional": True})
    """Noise that stays alike along time, which gives as much as any effect would."""


def misread_table(statement: WrongStatement) -> Unknown:
    """Return the description of a table of which another reading fits far better.

    Examples
    --------
    >>> misread_table(WrongStatement("the sign of fy looks reversed", 40.0, 1.0)).misread
    True
    """
    return Unknown((), {}, statement.sentence(), None, "", statement, misread=True)


def describe_residual(
    problem: Problem, residual: F, chosen: Sequence[Candidate], total: float
) -> Unknown:
    """Describe a residual: variables that it follows, words, nearest effect, effect template.

    Parameters
    ----------
    residual
        (N, m) whitened.
    chosen
        Effects that are accepted already.
    total
        Sum of squares that smooth functions explain, over the noise scale.
    """
    n = len(residual)
    values, names = features(problem.rows, max(1, min(90, n // 3)))
    terms = _terms(problem, residual, values)
    listed = [(names[j], problem.base.outputs[c], size) for j, c, size in terms]
    shares = _relevance(problem, residual, values)
    least = problem.settings.least_relevance
    variables = [name for name, share in shares.items() if share >= least]
    known = (*problem.rows.base.inputs, *covariates(problem.rows))
    products = [(factors(feature, known), component) for feature, component, _ in listed]
    variables += [part for parts, _ in products for part in parts]
    best = max(rank(problem, chosen), key=lambda item: item.drop, default=None)
    nearest: Nearest | None = None
    if best is not None:
        share = best.drop / total if total > 0.0 else 0.0
        nearest = Nearest(best.id, float(np.clip(share, 0.0, 1.0)))
    return Unknown(
        variables=tuple(dict.fromkeys(variables)),
        relevance=shares,
        words=_words(listed),
        nearest=nearest,
        template=effect_template(products, problem.base.outputs),
    )


def _terms(problem: Problem, left: F, values: F) -> list[tuple[int, int, float]]:
    """Return (feature, component, size in the component's unit) of the terms that explain most."""
    n, m = left.shape
    root = np.sqrt(problem.weights)
    y = (left * root[:, None]).ravel()
    weighted = problem.whitener * root[:, None, None]
    columns = np.einsum("nmc,nq->nmqc", weighted, values).reshape(n * m, -1)
    total = float(y @ y)
    sizes = np.sqrt((columns**2).sum(axis=0))
    usable = sizes > 1e-9 * sizes.max(initial=0.0)
    chosen: list[int] = []
    rest = y
    for _ in range(problem.settings.most_terms):
        if not usable.any():
            break
        gains = np.where(usable, ((columns.T @ rest) / np.where(usable, sizes, 1.0)) ** 2, 0.0)
        best = int(np.argmax(gains))
        if chosen and gains[best] < problem.settings.least_term_gain * max(
            total - float(rest @ rest), 1e-300
        ):
            break
        chosen.append(best)
        usable[best] = False
        theta = np.linalg.lstsq(columns[:, chosen], y, rcond=1e-10)[0]
        rest = y - columns[:, chosen] @ theta
    return [(k // m, k % m, float(size)) for k, size in zip(chosen, theta, strict=True)]


def _relevance(problem: Problem, left: F, values: F) -> dict[str, float]:
    """Return the share of each variable, by a Gaussian process on what smooth functions see."""
    rows = problem.rows
    measured = np.flatnonzero(problem.scored & (problem.weights > 0.5))
    if len(measured) < 20:
        return {}
    known = covariates(rows)
    names = (*rows.base.inputs, *known)
    variables = np.column_stack([rows.poses, *known.values()])[measured]
    spread = variables.std(axis=0)
    varied = spread > 0.0
    variables = (variables - variables.mean(axis=0))[:, varied] / spread[varied]
    # Directions of the residual in which smooth functions see most.
    basis = orthonormal(values[measured])
    seen = basis @ (basis.T @ left[measured])
    _, _, axes = np.linalg.svd(seen, full_matrices=False)
    targets = left[measured] @ axes[: problem.settings.residual_directions].T
    shares = ard_relevance(variables, targets)
    named = zip(np.array(names)[varied].tolist(), shares.tolist(), strict=True)
    ordered = sorted(named, key=lambda item: -item[1])
    return {name: round(share, 3) for name, share in ordered if share > 0.0}


def _words(listed: Sequence[tuple[str, str, float]]) -> str:
    """Return a sparse description: which component follows what, and by how much."""
    parts = []
    for feature, component, size in listed:
        name, unit = component.rsplit("_", 1)
        parts.append(f"{name} follows {feature} ({size:+.2g} {unit.replace('Nm', 'N m')})")
    return "; ".join(parts)
