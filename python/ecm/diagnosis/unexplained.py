"""Structure that no known effect explains: variables, words, nearest effect, effect template.

y_c ~ GP(0, s^2 exp(-sum_j w_j (u_j - u_j')^2 / 2) + n^2), the weights w_j >= 0 of the standardised
variables u_j shared by all residual components c, by maximum likelihood. A weight near 0 means
that the residual does not depend on that variable (Rasmussen and Williams, section 5.1).
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize

from ecm.comparison.residuals import covariates, factors, features
from ecm.diagnosis.problem import Candidate, Problem
from ecm.diagnosis.readings import WrongStatement
from ecm.diagnosis.search import rank
from ecm.diagnosis.whiteness import Pattern
from ecm.io.arrays import F, evenly
from ecm.io.columns import unit_of
from ecm.regression.correlation import SlowNoise
from ecm.regression.f_test import orthonormal

_MOST_ROWS = 220
_ITERATIONS = 40
_LOG_BOUNDS = (-9.0, 4.0)
_FADES = 0.02


def ard_relevance(variables: F, targets: F) -> F:
    """Return (q,) the share of each variable in what the process explains; sums to 1, or all 0.

    Parameters
    ----------
    variables
        (N, q), each of zero mean and unit spread.
    targets
        (N, c) residual along the directions in which something is seen.
    """
    take = evenly(len(variables), _MOST_ROWS)
    u = variables[take]
    y = targets[take] - targets[take].mean(axis=0)
    spread = y.std(axis=0)
    if u.shape[1] == 0 or not np.any(spread > 0.0):
        return np.zeros(u.shape[1])
    y = y[:, spread > 0.0] / spread[spread > 0.0]
    squares = (u[:, None, :] - u[None, :, :]) ** 2
    start = np.concatenate([np.full(u.shape[1], -2.5), [np.log(0.5), np.log(0.5)]])
    result = minimize(
        _negative_log_likelihood,
        start,
        args=(squares, y),
        jac=True,
        method="L-BFGS-B",
        bounds=[_LOG_BOUNDS] * u.shape[1] + [(-7.0, 3.0), (-5.0, 1.0)],
        options={"maxiter": _ITERATIONS},
    )
    return _shares(result.x, squares, y)


def _negative_log_likelihood(log: F, squares: F, y: F) -> tuple[float, F]:
    weights, signal, noise = np.exp(log[:-2]), np.exp(log[-2]), np.exp(log[-1])
    kernel = signal * np.exp(-0.5 * (squares @ weights))
    covariance = kernel + (noise + 1e-8) * np.eye(len(y))
    factor = cho_factor(covariance, lower=True)
    alpha = cho_solve(factor, y)
    inverse = cho_solve(factor, np.eye(len(y)))
    count = y.shape[1]
    value = 0.5 * float((y * alpha).sum()) + count * float(np.log(np.diag(factor[0])).sum())
    # d/dx = tr((c V^-1 - alpha alpha') dV/dx) / 2.
    inner = count * inverse - alpha @ alpha.T
    weighted = inner * kernel
    slope = np.empty_like(log)
    slope[:-2] = -0.25 * weights * np.tensordot(weighted, squares, axes=([0, 1], [0, 1]))
    slope[-2] = 0.5 * weighted.sum()
    slope[-1] = 0.5 * noise * float(np.trace(inner))
    return value, slope


def _shares(log: F, squares: F, y: F) -> F:
    """Return the loss of what is explained without each variable, over the sum of the losses."""
    weights, signal, noise = np.exp(log[:-2]), np.exp(log[-2]), np.exp(log[-1])
    kernel = signal * np.exp(-0.5 * (squares @ weights))
    alpha = np.linalg.solve(kernel + (noise + 1e-8) * np.eye(len(y)), y)
    total = kernel @ alpha
    losses = np.zeros(len(weights))
    for j in range(len(weights)):
        # The kernel averaged over the variable: the prediction of the other variables alone.
        others = np.where(np.arange(len(weights)) == j, 0.0, weights)
        blind = signal * np.exp(-0.5 * (squares @ others))
        blind = blind * float(np.exp(-0.5 * weights[j] * squares[:, :, j]).mean())
        losses[j] = ((total - blind @ alpha) ** 2).mean()
    losses = np.where(losses > _FADES * losses.max(initial=0.0), losses, 0.0)
    total = losses.sum()
    return np.asarray(losses / total if total > 0.0 else losses)


_STANDARD = {"approach": "sides(rows.table)", "row": "np.arange(len(rows))"}


def effect_template(terms: Sequence[tuple[Sequence[str], str]], outputs: Sequence[str]) -> str:
    """Return Python text of ten lines that registers an effect.

    Parameters
    ----------
    terms
        (factors, component) pairs, such as (("time_s", "x_m"), "fx_N"); no factor: a constant.
    outputs
        Wrench columns of the base.
    """
    factors, component = terms[0] if terms else ((), outputs[0])
    feature = "*".join(factors) or "constant"
    unit = _unit(component, factors)
    columns = sorted(set(factors) - {"row"})
    kind = ', kind="time"' if "row" in factors else ""
    extra = ", sides" if "approach" in factors else ""
    value = " * ".join(_value(name) for name in factors) or "1.0"
    index = list(outputs).index(component)
    return "\n".join(
        [
            "import numpy as np",
            f"from ecm.effects import effect{extra}",
            "",
            f'@effect("my_effect", physics={_quoted(f"{component} follows {feature}.")}, '
            f'parameters={{"size": {_quoted(unit)}}}, needs={tuple(columns)!r}{kind})',
            "def my_effect(rows):",
            *(
                ["    def u(name): v = rows.table.column(name); return v - v.mean()"]
                if any(name not in _STANDARD for name in factors)
                else []
            ),
            f"    columns = np.zeros((len(rows), {len(outputs)}))",
            f"    columns[:, {index}] = {value}",
            "    return columns",
            "",
        ]
    )


def _unit(component: str, factors: Sequence[str]) -> str:
    """Return 'N/(s m)': the component's unit over the units at the end of the factors' names."""
    over = [name.rsplit("_", 1)[1] for name in factors if "_" in name and name not in _STANDARD]
    force = unit_of(component)
    if not over:
        return force
    return f"{force}/{over[0]}" if len(over) == 1 else f"{force}/({' '.join(over)})"


def _value(name: str) -> str:
    if name in _STANDARD:
        return _STANDARD[name]
    return f"u({_quoted(name)})"


def _quoted(text: str) -> str:
    """Return a Python string literal: names come from data files and must stay text."""
    return json.dumps(text, ensure_ascii=False)


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
