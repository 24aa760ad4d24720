"""What is left: the gate, the same question after the accepted effects, patterns, and words for it.

The gate looks for smooth functions. A period of some readings, a stiffness that changes with the
hour, or a trace of the reading before are not smooth in any column. Three kinds of tests look for
them before `none` is said; the smallest chance of all tests, times their number (Holm's first
step), decides, so that the rate of false alarms is held.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from types import MappingProxyType

import numpy as np
from scipy import special

from ecm.comparison.residuals import (
    covariates,
    dependence_variables,
    factors,
    features,
)
from ecm.comparison.structure import LEAST_STRENGTH
from ecm.diagnosis.problem import (
    ABSORBED_SHARE,
    Candidates,
    Problem,
    Projection,
    omnibus_columns,
)
from ecm.diagnosis.search import (
    ONE_CAUSE_SHARE,
    Estimate,
    best_shapes,
    bounded_estimate,
    delta_chi2,
)
from ecm.diagnosis.settings import CHANCE_DEVIATIONS, LEFT_SHARE
from ecm.diagnosis.statements import WrongStatement
from ecm.io.arrays import B, F, lstsq, rest_of
from ecm.io.columns import JOINTS, unit_of
from ecm.regression.f_test import Beside, FTest, lack_of_fit, omnibus_test, orthonormal
from ecm.regression.folds import repeat_cells
from ecm.regression.history import row_before, speeds
from ecm.regression.slow_noise import SlowNoise


@dataclass(frozen=True)
class Gate:
    """Whether anything is missing: the more significant of two tests of the base's residual."""

    F: float
    p: float
    rejected: bool = field(metadata={"json": ""})
    """Whether something is missing at the level of the settings."""
    smooth: FTest = field(metadata={"json": ""})
    """Test against smooth functions of pose and covariates."""
    structure: float = field(metadata={"json": ""})
    """Squares beyond chance that smooth functions explain, over the noise scale."""


@dataclass(frozen=True)
class Leftover:
    """What smooth functions still explain after the accepted effects."""

    beyond_chance: float
    """Squares beyond chance, over the noise scale."""
    dof: float
    share: float
    """The same over the structure before."""
    p: float
    remains: bool = field(metadata={"json": ""})
    """Whether it is seen, strong, and more than the form of right effects may leave."""

    def strength(self, problem: Problem) -> float:
        """Return the structure that is left, rms in noise units."""
        return float(np.sqrt(self.beyond_chance / problem.size))


def gate(problem: Problem) -> Gate:
    """Test the base's residual against repeats and against smooth functions; either may reject."""
    beside = _beside(problem, np.ones(problem.response.shape[1]))
    smooth = beside.omnibus_test()
    by_component, test = beside, smooth
    if problem.noise.source == "assumed":
        # Nothing is known of the noise: what scatters more than was assumed is no structure.
        spread = np.sqrt((problem.response**2).mean(axis=0))
        by_component = _beside(problem, np.where(spread > 0.0, spread, 1.0))
        test = by_component.omnibus_test()
    # Components that err together are no independent readings.
    tests = [by_component.with_sign_chance(test)]
    cells = lack_of_fit(
        problem.response,
        repeat_cells(problem.table),
        len(problem.base.coefficients),
        problem.weights * problem.scored,
    )
    if cells is not None:
        tests.append(cells)
    best = min(tests, key=lambda test: test.p)
    p = min(1.0, best.p * len(tests))
    structure = max(0.0, smooth.explained / problem.scale - smooth.dof)
    return Gate(best.F, p, p < problem.settings.level, smooth, structure)


def _beside(problem: Problem, spread: F) -> Beside:
    """Response and smooth functions beside the base, each component over its spread."""
    return Beside.of(
        problem.response / spread,
        omnibus_columns(problem) / spread[:, None],
        problem.base_block / spread[:, None],
        problem.weights,
        overwrite=True,
    )


def leftover(problem: Problem, gate: Gate, effects: Candidates) -> Leftover:
    """Return what the accepted effects leave, and whether it matters.

    It must be seen by the smooth functions, exceed a share of what was there, and a strength below
    which neither the base nor the form of an effect can be trusted.
    """
    settings = problem.settings
    fit = bounded_estimate(problem, effects, effects)
    response, fitted = _at_bounds(problem, fit)
    total = np.concatenate([problem.projected_base, fitted], axis=2)
    # Not by random signs as at the gate: in few rows they hide what no library holds (a ripple of
    # three times the noise became `none`), for one weak effect in fifty.
    test = omnibus_test(response, omnibus_columns(problem), total, problem.weights, overwrite=True)
    after = max(fit.lost, (test.F - 1.0) * test.dof) if np.isfinite(test.F) else fit.lost
    strong = after > problem.size * _least_strength(problem) ** 2
    # What the effects explain was structure, whether smooth functions see it or not.
    before = max(gate.structure, delta_chi2(problem, effects))
    allowed = max(0.0, LEFT_SHARE - ONE_CAUSE_SHARE * (len(effects) - 1)) * before
    allowed = max(allowed if effects else 0.0, ONE_CAUSE_SHARE * problem.held)
    # Chance adds to what is left: it must be more than the form of an effect may leave.
    spread = float(np.sqrt(2.0 * test.dof + 4.0 * allowed))
    large = not (effects or problem.held) or after > allowed + CHANCE_DEVIATIONS * spread
    p = min(test.p, float(special.chdtrc(max(1, int(fit.at_bound.sum())), fit.lost)))
    return Leftover(
        beyond_chance=after,
        dof=test.dof,
        share=after / before if before > 0.0 else 0.0,
        p=p,
        remains=bool(p < settings.level and strong and large),
    )


def _least_strength(problem: Problem) -> float:
    """Return the rms in noise units below which neither base nor form can be trusted."""
    return max(LEAST_STRENGTH, 1.5 * problem.base_error)


def residual_after(problem: Problem, effects: Candidates, base: Projection | None = None) -> F:
    """Return the (N, m) whitened residual after base and effects, or another base that holds it."""
    response, fitted = _at_bounds(problem, bounded_estimate(problem, effects, effects))
    if base is not None:
        response, fitted = base.rest(response), base.orthogonalised(fitted)
    theta = lstsq(problem.flat(fitted), problem.flat(response), rcond=1e-10)
    return np.asarray(response - fitted @ theta)


def _at_bounds(problem: Problem, fit: Estimate) -> tuple[F, F]:
    """Return the response without the parameters at a bound, and the columns of the others.

    A parameter that would explain more beyond its bound stays at the bound: what it would explain
    there is not this effect.
    """
    fixed = fit.columns[fit.at_bound]
    response = problem.response - problem.design[:, :, fixed] @ fit.theta[fit.at_bound]
    return response, problem.design[:, :, fit.columns[~fit.at_bound]]


_WHITE_LEVEL = 0.001
"""Chance that white noise is said to follow something. It adds to that of the gate, and what is not
white shows far below it."""

_LEAST_ROWS = 24
_MOST_PERIODS = 1500
_LAGS = 3
"""Neighbours that are compared: the next, and so many further ones."""
_LEAST_DISTINCT = 12


@dataclass(frozen=True)
class Pattern:
    """What a residual follows that no smooth function shows."""

    variable: str
    """Column that it follows; `row` is the order of the rows; empty where it follows none."""
    words: str
    p: float
    """Chance of as much in white noise, times the number of tests."""
    strength: float
    """Root mean square, in units of the noise."""
    period: float | None = field(default=None, metadata={"optional": True})
    """Period in the unit of the column."""
    explained: float = field(default=0.0, metadata={"json": ""})
    """Sum of squares that it explains beyond chance, over the noise scale."""


def find_pattern(problem: Problem) -> Pattern | None:
    """Return the most significant pattern of the base's residual; None where it is white."""
    counted = problem.scored & (problem.weights > 0.5)
    if int(counted.sum()) < _LEAST_ROWS:
        return None
    left = residual_after(problem, ())[counted] / np.sqrt(problem.scale)
    left = left - left.mean(axis=0)
    found = [
        *_periods(problem, left, counted),
        *_neighbours(problem, left, counted),
        *_memory(problem),
    ]
    best = min(found, key=lambda item: item.p, default=None)
    if best is None or best.strength < _least_strength(problem):
        return None
    p = min(1.0, best.p * len(found))
    return replace(best, p=p) if p < _WHITE_LEVEL else None


def _periods(problem: Problem, left: F, counted: B) -> Iterator[Pattern]:
    """Yield the best period of each component, of all together, and of a factor on the wrench."""
    table = problem.table
    name, unit = ("time_s", " s") if table.has("time_s") else ("row", " rows")
    when = table.column(name) if unit == " s" else table.row_numbers.astype(np.float64)
    when = when[counted]
    length, n = float(np.ptp(when)), len(when)
    if length <= 0.0:
        return
    turns = np.arange(2, 2 + min(n, _MOST_PERIODS)) / (2.0 * length)
    phase = 2.0 * np.pi * np.outer(when - when.min(), turns)
    cosine, sine = np.cos(phase), np.sin(phase, out=phase)
    outputs = problem.base.outputs
    # Two columns of one frequency; each frequency is a test. The base took its part before.
    freedom = max(0.0, n * (1.0 - problem.base_block.shape[2] / problem.size) - 2.0)
    load = (problem.whitener.each @ problem.rows.wrench[:, :, None])[counted, :, 0]
    once = np.ones(n)
    of_each = {outputs[j].rsplit("_", 1)[0]: [(left[:, j], once)] for j in range(len(outputs))}
    if len(outputs) > 1:
        of_each[_WHOLE] = [part for (part,) in of_each.values()]
    of_each["the stiffness"] = [((load * left).sum(axis=1), (load**2).sum(axis=1))]
    found: list[tuple[float, Pattern]] = []
    for words, parts in of_each.items():
        explained = np.sum([_explained(cosine, sine, *one) for one in parts], axis=0)
        best = int(np.argmax(explained))
        place = cosine[:, best], sine[:, best]
        chances = np.array([_chance(*place, along, own, freedom) for along, own in parts])
        # Of several components by Fisher's method.
        logs = np.log(np.maximum(chances, 1e-300)).sum()
        single = float(special.chdtrc(2 * len(parts), -2.0 * logs))
        period = float(1.0 / turns[best])
        pattern = Pattern(
            name,
            f"{words} follows {name} with period {period:.3g}{unit}",
            min(1.0, single * len(turns)),
            float(np.sqrt(max(0.0, explained[best] - 2.0 * len(parts)) / left.size)),
            period,
            float(explained[best]),
        )
        found.append((pattern.explained - 2.0 * len(parts) * np.log(n), pattern))
    # Strong ones all have a chance of 0: the first of them is said.
    yield from (pattern for _, pattern in sorted(found, key=lambda one: -one[0]))


def _explained(cosine: F, sine: F, along: F, weight: F) -> F:
    """Return (k,) squares that a cosine and a sine of each frequency explain."""
    cc, ss = weight @ cosine**2, weight @ sine**2
    cs = weight @ (cosine * sine)
    a, b = along @ cosine, along @ sine
    det = np.maximum(cc * ss - cs**2, 1e-12 * cc * ss + 1e-300)
    return np.asarray((ss * a**2 - 2.0 * cs * a * b + cc * b**2) / det)


def _chance(cosine: F, sine: F, along: F, weight: F, freedom: float) -> float:
    """Return the chance that rows that err independently follow one frequency as much.

    Each row counts once, whatever its components share, and with the size of its own rest: where a
    base leaves much, rows under large loads err more and are the heaviest in the sums as well.
    """
    root = np.sqrt(np.maximum(weight, 1e-300))
    columns = root[:, None] * np.stack([cosine, sine], axis=1)
    y = along / root
    gram = columns.T @ columns
    theta = lstsq(gram, columns.T @ y)
    rest = y - columns @ theta
    own = columns * rest[:, None]
    alike = gram * float(rest @ rest) / len(y)
    ratios = [float(lstsq(spread, gram @ theta) @ gram @ theta) for spread in (alike, own.T @ own)]
    return float((1.0 + min(ratios) / len(y)) ** (-0.5 * freedom))


def _neighbours(problem: Problem, left: F, counted: B) -> Iterator[Pattern]:
    """Yield, for each column, how alike the residuals of neighbouring values are."""
    table = problem.table
    variables = dict(dependence_variables(problem.rows)) | speeds(table)
    driven = [n for n in table.columns if n in JOINTS or n.startswith("tendon")]
    variables |= {name: np.nan_to_num(table.column(name)) for name in driven}
    for name, values in variables.items():
        own = values[counted]
        if len(np.unique(own)) < _LEAST_DISTINCT:
            continue
        ordered = left[np.argsort(own, kind="stable")]
        products = np.concatenate(
            [(ordered[k:] * ordered[:-k]).sum(axis=1) for k in range(1, _LAGS + 1)]
        )
        deviation = float(np.sqrt((products**2).sum()))
        z = float(products.sum()) / max(deviation, 1e-300)
        shared = max(0.0, float(products.mean())) / left.shape[1]
        words = f"readings next to each other in {name} err alike"
        yield Pattern(name, words, float(special.ndtr(-z)), float(np.sqrt(shared)))


def _memory(problem: Problem) -> Iterator[Pattern]:
    """Yield what the residual keeps of the reading before: its pose and its load."""
    table, rows = problem.table, problem.rows
    if table.sampled_from is not None or not table.has("time_s"):
        # Of a large table the reading before is not there; without a time it is not known.
        return
    before = row_before(table)
    known = before >= 0
    if int(known.sum()) < _LEAST_ROWS:
        return
    for words, values in (("pose", rows.poses), ("load", rows.wrench)):
        spread = values.std(axis=0)
        lagged = np.where(known[:, None], values[before], values.mean(axis=0))
        lagged = (lagged - values.mean(axis=0))[:, spread > 0.0] / spread[spread > 0.0]
        free = problem.in_each_component(lagged)
        beside = Beside.of(problem.response, free, problem.base_block, problem.weights)
        test = beside.with_sign_chance(beside.omnibus_test())
        if np.isfinite(test.F):
            chance = test.dof * test.rest / test.dof_error
            explained = max(0.0, test.explained - chance) / problem.scale
            said = f"it follows the {words} of the reading before"
            strength = float(np.sqrt(explained / problem.size))
            yield Pattern("time_s", said, test.p, strength, explained=explained)


_MOST_RUNS = 12


def runs_apart(problem: Problem, effects: Candidates) -> Pattern | None:
    """Return a wrench of its own for each run, where that explains more than some effects do.

    What drifts from run to run does so within them as well: the effects must err there by more
    than nothing would. Squares are over chance by the BIC of so many constants.
    """
    table = problem.table
    if not table.has("run") or not 2 <= len(np.unique(table.column("run"))) <= _MOST_RUNS:
        return None
    run = table.column("run")
    own = (run[:, None] == np.unique(run)[1:]).astype(np.float64)
    own -= own.mean(axis=0)
    free = problem.in_each_component(own)
    every, base = (block.reshape(-1, block.shape[2]) for block in (free, problem.base_block))
    left = (rest_of(base, every) ** 2).sum(axis=0)
    if (left < (1.0 - ABSORBED_SHARE) * (every**2).sum(axis=0)).any():
        return None  # an input of the base is a level of each run
    test, beside = (
        Beside.of(response, free, problem.base_block, problem.weights).omnibus_test()
        for response in (problem.response, residual_after(problem, effects))
    )
    explained = test.explained / problem.scale - test.dof * np.log(problem.size)
    named = delta_chi2(problem, effects)
    if not (np.isfinite(test.F) and explained > named and beside.rest > test.rest):
        return None
    words = (
        "each run has a wrench of its own, which no column tells: something was set or changed "
        "between the runs"
    )
    strength = float(np.sqrt(explained / problem.size))
    return Pattern("run", words, test.p, strength, explained=explained)


_MOST_TERMS = 3
"""Terms of a description in words."""
_LEAST_TERM_GAIN = 0.05
"""Share of the explained squares that a further term needs."""

_WHOLE = "the wrench"
"""In place of a component: a factor on all of them."""
_STANDARD = {"approach": "sides(rows.table)", "row": "np.arange(len(rows))"}


def effect_template(
    factors: Sequence[str],
    component: str,
    outputs: Sequence[str],
    texts: Mapping[str, str] = MappingProxyType({}),
) -> str:
    """Return Python text of ten lines that registers an effect: a component follows factors.

    Without factors it is constant. It is one of the outputs of the base, or "the wrench": a change
    of all of them by a factor. Texts stand for factors that are no columns.
    """
    feature = "*".join(factors) or "constant"
    known = {**_STANDARD, **texts}
    unit = _unit(component, factors, known)
    columns = sorted(set(factors) - {*known} | ({"approach"} & set(factors)))
    kind = ', kind="time"' if "row" in factors or set(factors) & set(texts) else ""
    extra = ", sides" if "approach" in factors else ""
    value = " * ".join(known.get(name, f"u({_quoted(name)})") for name in factors) or "1.0"
    lines = [
        "import numpy as np",
        f"from ecm.effects import effect{extra}",
        "",
        f'@effect("my_effect", physics={_quoted(f"{component} follows {feature}.")}, '
        f'parameters={{"size": {_quoted(unit)}}}, needs={tuple(columns)!r}{kind})',
        "def my_effect(rows):",
    ]
    if any(name not in known for name in factors):
        lines.append("    def u(name): v = rows.table.column(name); return v - v.mean()")
    if component == _WHOLE:
        lines.append(f"    return ({value})[:, None] * rows.wrench")
    else:
        lines += [
            f"    columns = np.zeros((len(rows), {len(outputs)}))",
            f"    columns[:, {list(outputs).index(component)}] = {value}",
            "    return columns",
        ]
    return "\n".join([*lines, ""])


def _unit(component: str, factors: Sequence[str], known: Collection[str]) -> str:
    """Return 'N/(s m)': the component's unit over the units at the end of the factors' names."""
    over = [name.rsplit("_", 1)[1] for name in factors if "_" in name and name not in known]
    unit = "1" if component == _WHOLE else unit_of(component)
    if not over:
        return unit
    return f"{unit}/{over[0]}" if len(over) == 1 else f"{unit}/({' '.join(over)})"


_quoted = partial(json.dumps, ensure_ascii=False)
"""Python string literal: names come from data files and must stay text."""


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


def describe_residual(problem: Problem, chosen: Candidates, total: float) -> Unknown:
    """Describe what chosen effects leave: what it follows, words, nearest effect, template.

    The share of the nearest effect is that in the total that smooth functions explain, over the
    noise scale.
    """
    values, names = features(problem.rows, max(1, min(90, len(problem.response) // 3)))
    terms = _terms(problem, residual_after(problem, chosen), values)
    outputs = problem.base.outputs
    listed = [(names[j], outputs[c], size) for j, c, size in terms]
    known = (*problem.rows.base.inputs, *covariates(problem.rows))
    products = [(factors(feature, known), component) for feature, component, _ in listed]
    variables = [part for parts, _ in products for part in parts]
    best = max(best_shapes(problem, chosen), key=lambda item: item.drop, default=None)
    share = best.drop / total if best is not None and total > 0.0 else 0.0
    return Unknown(
        variables=tuple(dict.fromkeys(variables)),
        words=_words(listed),
        nearest=None if best is None else Nearest(best.id, float(np.clip(share, 0.0, 1.0))),
        template=effect_template(*(products or [((), outputs[0])])[0], outputs),
    )


def draft_of(problem: Problem, column: str, history: Mapping[str, tuple[str, F]]) -> str:
    """Return the draft of an effect of a driver: of the forms that are tried what explains most.

    Forms are the smooth functions with its column, and its history (Python text and values by
    name). Each is added to one component of the wrench, or is a factor on all of it.
    """
    rows, outputs = problem.rows, problem.base.outputs
    values, names = features(rows, 10_000)
    known = (*rows.base.inputs, *covariates(rows))
    forms = [(factors(name, known), values[:, j]) for j, name in enumerate(names)]
    forms = [form for form in forms if column in form[0]]
    forms += [((name,), own) for name, (_, own) in history.items()]
    base, y = orthonormal(problem.flat(problem.base_block)), problem.flat(problem.response)
    y = y - base @ (base.T @ y)
    best: tuple[float, tuple[tuple[str, ...], str]] = (-1.0, ((), outputs[0]))
    changes = np.stack([own for _, own in forms], axis=1)[:, None]
    along = dict(zip(outputs, np.eye(len(outputs)), strict=True)) | {_WHOLE: rows.wrench}
    for output, direction in along.items():
        every = np.broadcast_to(direction, rows.wrench.shape)[:, :, None]
        columns = problem.flat(problem.whitener @ (every * changes))
        left, size = columns - base @ (base.T @ columns), (columns**2).sum(axis=0)
        gains = (left.T @ y) ** 2 / ((left**2).sum(axis=0) + 1e-9 * size + 1e-300)
        top = int(np.argmax(gains))
        best = max(best, (float(gains[top]), (forms[top][0], output)))
    return effect_template(*best[1], outputs, {name: text for name, (text, _) in history.items()})


def _terms(problem: Problem, left: F, values: F) -> list[tuple[int, int, float]]:
    """Return (feature, component, size in the component's unit) of the terms that explain most."""
    y, q = problem.flat(left), values.shape[1]
    columns = problem.flat(problem.in_each_component(values))
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
        theta = lstsq(columns[:, chosen], y, rcond=1e-10)
        rest = y - columns[:, chosen] @ theta
    return [(k % q, k // q, float(size)) for k, size in zip(chosen, theta, strict=True)]


def _words(listed: Sequence[tuple[str, str, float]]) -> str:
    """Return a sparse description: which component follows what, and by how much."""
    return "; ".join(
        f"{component.rsplit('_', 1)[0]} follows {feature} ({size:+.2g} {unit_of(component)})"
        for feature, component, size in listed
    )
