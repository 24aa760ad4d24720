"""Structure that no known effect explains: variables, words, nearest effect, effect template."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from ecm.comparison.residuals import covariates, factors, features
from ecm.diagnosis.problem import Candidate, Problem
from ecm.diagnosis.readings import WrongStatement
from ecm.diagnosis.search import rank
from ecm.diagnosis.whiteness import Pattern
from ecm.io.arrays import F
from ecm.io.columns import unit_of
from ecm.regression.correlation import SlowNoise
from ecm.regression.f_test import orthonormal

_MOST_TERMS = 3
"""Terms of a description in words."""
_LEAST_TERM_GAIN = 0.05
"""Share of the explained squares that a further term needs."""

_WHOLE = "the wrench"
"""In place of a component: a factor on all of them."""
_STANDARD = {"approach": "sides(rows.table)", "row": "np.arange(len(rows))"}


def effect_template(
    terms: Sequence[tuple[Sequence[str], str]],
    outputs: Sequence[str],
    texts: Mapping[str, str] = MappingProxyType({}),
) -> str:
    """Return Python text of ten lines that registers an effect.

    Parameters
    ----------
    terms
        (factors, component) pairs, such as (("time_s", "x_m"), "fx_N"), or a change by a factor
        with "the wrench" as the component; no factor: a constant.
    outputs
        Wrench columns of the base.
    texts
        Python text of factors that are no columns.
    """
    factors, component = terms[0] if terms else ((), outputs[0])
    feature = "*".join(factors) or "constant"
    known = {**_STANDARD, **texts}
    unit = _unit(component, factors, known)
    columns = sorted(set(factors) - {*known} | ({"approach"} & set(factors)))
    kind = ', kind="time"' if "row" in factors or set(factors) & set(texts) else ""
    extra = ", sides" if "approach" in factors else ""
    value = " * ".join(known.get(name, f"u({_quoted(name)})") for name in factors) or "1.0"
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
                if any(name not in known for name in factors)
                else []
            ),
            *(
                [f"    return ({value})[:, None] * rows.wrench"]
                if component == _WHOLE
                else [
                    f"    columns = np.zeros((len(rows), {len(outputs)}))",
                    f"    columns[:, {list(outputs).index(component)}] = {value}",
                    "    return columns",
                ]
            ),
            "",
        ]
    )


def _unit(component: str, factors: Sequence[str], known: Collection[str]) -> str:
    """Return 'N/(s m)': the component's unit over the units at the end of the factors' names."""
    over = [name.rsplit("_", 1)[1] for name in factors if "_" in name and name not in known]
    unit = "1" if component == _WHOLE else unit_of(component)
    if not over:
        return unit
    return f"{unit}/{over[0]}" if len(over) == 1 else f"{unit}/({' '.join(over)})"


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
    return Unknown((), statement.sentence(), None, "", statement, misread=True)


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
    known = (*problem.rows.base.inputs, *covariates(problem.rows))
    products = [(factors(feature, known), component) for feature, component, _ in listed]
    variables = [part for parts, _ in products for part in parts]
    best = max(rank(problem, chosen), key=lambda item: item.drop, default=None)
    nearest: Nearest | None = None
    if best is not None:
        share = best.drop / total if total > 0.0 else 0.0
        nearest = Nearest(best.id, float(np.clip(share, 0.0, 1.0)))
    return Unknown(
        variables=tuple(dict.fromkeys(variables)),
        words=_words(listed),
        nearest=nearest,
        template=effect_template(products, problem.base.outputs),
    )


def draft_of(problem: Problem, column: str, history: Mapping[str, tuple[str, F]]) -> str:
    """Return the draft of an effect of a driver: of the forms that are tried what explains most.

    Each form is added to one component of the wrench, or is a factor on that component.

    Parameters
    ----------
    column
        Column that drives it: every smooth function with it is a form.
    history
        What else drives it, by name: Python text and values (N,).
    """
    rows, outputs = problem.rows, problem.base.outputs
    values, names = features(rows, 10_000)
    known = (*rows.base.inputs, *covariates(rows))
    forms = [(factors(name, known), values[:, j]) for j, name in enumerate(names)]
    forms = [form for form in forms if column in form[0]]
    forms += [((name,), own) for name, (_, own) in history.items()]
    root = np.sqrt(problem.weights)[:, None]
    base = orthonormal((problem.base_block * root[:, :, None]).reshape(problem.response.size, -1))
    y = (problem.response * root).ravel()
    y = y - base @ (base.T @ y)
    best: tuple[float, tuple[tuple[str, ...], str]] = (-1.0, ((), outputs[0]))
    changes = np.stack([own for _, own in forms], axis=1)[:, None]
    load = np.einsum("nij,nj->ni", problem.whitener, rows.wrench)
    along = {name: problem.whitener[:, :, c] for c, name in enumerate(outputs)} | {_WHOLE: load}
    for output, direction in along.items():
        columns = ((direction * root)[:, :, None] * changes).reshape(y.size, -1)
        left, size = columns - base @ (base.T @ columns), (columns**2).sum(axis=0)
        gains = (left.T @ y) ** 2 / ((left**2).sum(axis=0) + 1e-9 * size + 1e-300)
        top = int(np.argmax(gains))
        best = max(best, (float(gains[top]), (forms[top][0], output)))
    return effect_template([best[1]], outputs, {name: text for name, (text, _) in history.items()})


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
    for _ in range(_MOST_TERMS):
        if not usable.any():
            break
        gains = np.where(usable, ((columns.T @ rest) / np.where(usable, sizes, 1.0)) ** 2, 0.0)
        best = int(np.argmax(gains))
        if chosen and gains[best] < _LEAST_TERM_GAIN * max(total - float(rest @ rest), 1e-300):
            break
        chosen.append(best)
        usable[best] = False
        theta = np.linalg.lstsq(columns[:, chosen], y, rcond=1e-10)[0]
        rest = y - columns[:, chosen] @ theta
    return [(k // m, k % m, float(size)) for k, size in zip(chosen, theta, strict=True)]


def _words(listed: Sequence[tuple[str, str, float]]) -> str:
    """Return a sparse description: which component follows what, and by how much."""
    parts = []
    for feature, component, size in listed:
        name, unit = component.rsplit("_", 1)
        parts.append(f"{name} follows {feature} ({size:+.2g} {unit.replace('Nm', 'N m')})")
    return "; ".join(parts)
