"""Materials from tests: read stretches and stresses, fit a model, estimate its errors."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from ecm._native import material_decode, material_start
from ecm.errors import ComputationError, InputError
from ecm.io.arrays import F, central_differences
from ecm.io.csv import number_of
from ecm.io.events import Printed, Progress, Steps, tell_part
from ecm.io.mechanism import MODELS, RUBBER_PA, TESTS, WITH_TERMS, Material
from ecm.io.settings import did_you_mean, read_text

_STRESS_UNITS = {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6}
_ORDERS = ("stretch-stress", "stress-stretch")
_LARGEST_STRETCH = 20.0
_START_SHIFTS = (0.0, -1.0, 1.0)
"""Changes of the last free variable, one for each start of the fit."""


@dataclass(frozen=True)
class MaterialTest:
    """One quasi-static test: stretches (N,), 1 where undeformed, and nominal stresses (N,)."""

    mode: str
    stretch: F
    stress_Pa: F
    source: str = ""

    def __post_init__(self) -> None:
        place = self.source or self.mode
        if self.mode not in TESTS:
            raise InputError(f"{place}: mode = '{self.mode}': {did_you_mean(self.mode, TESTS)}")
        if self.stretch.shape != self.stress_Pa.shape or self.stretch.ndim != 1:
            raise InputError(
                f"{place}: found {self.stretch.shape} stretches and {self.stress_Pa.shape} "
                "stresses, expected as many of both"
            )
        if not (np.isfinite(self.stretch).all() and np.isfinite(self.stress_Pa).all()):
            raise InputError(f"{place}: a number is not finite")
        if np.any(self.stretch <= 0.0) or np.any(self.stretch > _LARGEST_STRETCH):
            raise InputError(
                f"{place}: stretches from {self.stretch.min():g} to {self.stretch.max():g}, "
                f"expected between 0 and {_LARGEST_STRETCH:g} (1 is undeformed): are the columns "
                "swapped, or are these strains?"
            )
        wrong = (self.stretch - 1.0) * self.stress_Pa < 0.0
        if wrong.sum() > max(1, len(wrong) // 10):
            raise InputError(
                f"{place}: {wrong.sum()} of {len(wrong)} stresses have the wrong sign for their "
                "stretch: are the columns swapped, or are these strains?"
            )


def read_test(path: Path, mode: str, *, unit: str = "", order: str = "") -> MaterialTest:
    """Read two columns of text, separated by commas or spaces; `#` begins a comment.

    The header `stretch,stress_MPa` (or Pa, kPa; in any order) states units and order; without it
    `unit` and `order` (stretch-stress or stress-stretch) do. InputError names file and line.
    """
    lines = read_text(path, "material test").splitlines()
    cells = [(i, line.replace(",", " ").split()) for i, line in enumerate(lines, start=1)]
    cells = [(i, row) for i, row in cells if row and not row[0].startswith("#")]
    if cells and number_of(cells[0][1][0]) is None:
        header = cells.pop(0)[1]
        stress = [name for name in header if name.startswith("stress_")]
        if len(header) != 2 or "stretch" not in header or not stress:
            raise InputError(
                f"{path}: header {' '.join(header)}, expected stretch and stress_Pa, stress_kPa "
                "or stress_MPa (stretch is 1 + strain; stress is force over undeformed area)"
            )
        unit = stress[0].removeprefix("stress_")
        order = _ORDERS[header.index("stretch")]
    advice = "or a header stretch,stress_MPa"
    if unit not in _STRESS_UNITS:
        raise InputError(f"{path}: unit = '{unit}', expected Pa, kPa or MPa: give --unit {advice}")
    if order not in _ORDERS:
        raise InputError(
            f"{path}: order = '{order}', expected {' or '.join(_ORDERS)}: give --order {advice}"
        )
    rows = []
    for number, row in cells:
        values = [number_of(cell) for cell in row]
        if None in values or len(values) != 2:
            raise InputError(
                f"{path}, line {number}: found '{' '.join(row)}', expected two numbers"
            )
        rows.append(values)
    if len(rows) < 3:
        raise InputError(f"{path}: {len(rows)} rows, expected at least 3")
    table = np.array(rows)[:, :: 1 if order == _ORDERS[0] else -1]
    return MaterialTest(mode, table[:, 0].copy(), table[:, 1] * _STRESS_UNITS[unit], str(path))


@dataclass(frozen=True, repr=False)
class MaterialFit(Printed):
    """A material identified from tests, and what is known about its errors."""

    material: Material
    names: tuple[str, ...]
    """Names of the values, e.g. `c1_Pa` or `mu_Pa[0]`."""
    values: F
    sd: F
    """Standard deviation of each value, from the scatter around the fit."""
    rms: dict[str, float]
    """Relative root mean square misfit per kind of test."""
    aicc: float
    """Akaike's information criterion with correction for few rows."""
    covered: tuple[float, float]
    """Uniaxial stretches that the tests cover; an equibiaxial one at l counts as l^-2."""
    warnings: tuple[str, ...]

    def sentences(self) -> list[str]:
        """The modulus, the misfit to each kind of test, and each value."""
        pairs = zip(self.names, self.values, self.sd, strict=True)
        misfit = ", ".join(f"{mode} {share:.1%}" for mode, share in self.rms.items())
        modulus = f"E = {self.material.young_modulus_Pa:.4g} Pa"
        values = [f"{name} = {value:.5g} +- {sd:.2g}" for name, value, sd in pairs]
        return [f"{self.material.model}: {modulus}, misfit {misfit} (rms)", *values]

    def __str__(self) -> str:
        return "\n".join([*self.sentences(), *self.warnings])


_LONGER = 6
"""A parameter more makes a fit so many times longer (measured)."""
_LOOP = 0.05


def _loop_warnings(tests: Sequence[MaterialTest]) -> tuple[str, ...]:
    """Say where loading and unloading differ, which no elastic material does."""
    warnings = []
    for test in tests:
        if (gap := _loop_gap(test)) > _LOOP:
            warnings.append(
                f"{test.source or test.mode}: loading and unloading differ by {gap:.0%} of the "
                "largest stress, and an elastic material has one curve: keep the rows up to the "
                "largest stretch (first loading), or those of one branch of the last cycle if the "
                "mechanism is used after many; ecm diagnose names the cause on the mechanism "
                "itself (hysteresis, stress_relaxation, mullins_softening)"
            )
    return tuple(warnings)


def _loop_gap(test: MaterialTest) -> float:
    """Mean distance of the stress before the largest stretch from that after it, over its size."""
    away = np.abs(test.stretch - 1.0)
    top = int(np.argmax(away))
    first, later = slice(0, top + 1), slice(top, None)
    if top < 2 or len(away) - top < 3:
        return 0.0
    low = max(away[first].min(), away[later].min())
    at = np.linspace(low, away[top], 50)
    curves = []
    for part in (first, later):
        order = np.argsort(away[part], kind="stable")
        curves.append(np.interp(at, away[part][order], np.abs(test.stress_Pa[part])[order]))
    largest = float(np.abs(test.stress_Pa).max())
    return float(np.abs(curves[0] - curves[1]).mean()) / largest if largest > 0.0 else 0.0


def fit_material(
    tests: Sequence[MaterialTest],
    model: str = "auto",
    *,
    terms: int = 2,
    use: tuple[float, float] = (0.5, 1.6),
    poisson_ratio: float = 0.49,
    progress: Progress | None = None,
) -> MaterialFit:
    """Fit a material model to tests by least squares; every test has the same weight.

    Parameters
    ----------
    tests
        Uniaxial, equibiaxial and pure shear tests, at least one.
    model
        A material model by name (docs/fem.md), or auto: the one of smallest AICc.
    terms
        Number of terms of Ogden's model.
    use
        Uniaxial stretches that the mechanism reaches; a warning says where the tests do not.
    poisson_ratio
        Poisson's ratio, which these tests cannot show.
    progress
        Called with the part that is done, the whole, and the model that is fitted.

    Returns
    -------
    MaterialFit
        The material, its parameters with standard deviations, and warnings.

    Raises
    ------
    InputError
        For no tests or an unknown model.
    ComputationError
        Where the model has too many parameters for the rows, or no fit converges.

    Examples
    --------
    >>> stretch = np.linspace(0.8, 1.6, 9)
    >>> rubber = Material("neo_hookean", {"young_modulus_Pa": 6e5})
    >>> test = MaterialTest("uniaxial", stretch, rubber.nominal_stress("uniaxial", stretch))
    >>> fit = fit_material([test], "neo_hookean", use=(0.9, 1.5))
    >>> round(fit.material.young_modulus_Pa), fit.names
    (600000, ('young_modulus_Pa',))
    >>> fit.warnings[0][:19]
    'only uniaxial tests'
    """
    if not tests:
        raise InputError(f"no test: give at least one of {', '.join(TESTS)}")
    # A Poisson's ratio out of its range is no fault of the tests.
    Material("neo_hookean", {"young_modulus_Pa": 1.0, "poisson_ratio": poisson_ratio})
    loops = _loop_warnings(tests)
    if model in MODELS:
        told = Steps({model: 1}, progress).within(model)
        fit = _fit(tests, model, terms, use, poisson_ratio, told)
        return replace(fit, warnings=(*loops, *fit.warnings))
    if model != "auto":
        raise InputError(f"model = '{model}': {did_you_mean(model, (*MODELS, 'auto'))}")
    fits = []
    sizes = {name: len(material_start(name, 1.0, terms)) for name in MODELS}
    steps = Steps({name: _LONGER**size for name, size in sizes.items()}, progress)
    for name in MODELS:
        with suppress(ComputationError):
            fits.append(_fit(tests, name, terms, use, poisson_ratio, steps.within(name)))
    if not fits:
        raise ComputationError("no model fits these tests: check units and columns")
    best = min(fits, key=lambda fit: fit.aicc)
    return replace(best, warnings=(*loops, *best.warnings))


def _fit(
    tests: Sequence[MaterialTest],
    model: str,
    terms: int,
    use: tuple[float, float],
    poisson_ratio: float,
    progress: Progress | None,
) -> MaterialFit:
    """Fit one model, from several starts."""
    scales = [float(np.sqrt(np.mean(t.stress_Pa**2) * len(t.stretch))) for t in tests]
    start = material_start(model, _guess_shear_modulus(tests), terms)
    rows, size = sum(len(t.stretch) for t in tests), len(start)
    if rows <= size:
        raise ComputationError(f"{rows} rows cannot give the {size} parameters of {model}")

    def misfit(x: F) -> F:
        _, own = _named(model, material_decode(model, x))
        try:
            solid = Material(model, own | {"poisson_ratio": poisson_ratio})
            parts = [
                (solid.nominal_stress(t.mode, t.stretch) - t.stress_Pa) / scale
                for t, scale in zip(tests, scales, strict=True)
            ]
        except InputError:  # a parameter below or above every number
            return np.full(rows, np.inf)
        return np.concatenate(parts)

    best = _minimise(misfit, start, progress)
    if best is None or not np.isfinite(best.cost):
        raise ComputationError(f"the fit of {model} does not converge: check units and columns")
    values = material_decode(model, best.x)
    variance = 2.0 * best.cost / (rows - size)
    jacobian = np.asarray(best.jac, dtype=np.float64)
    covariance = np.linalg.pinv(jacobian.T @ jacobian) * variance
    step = 1e-6 * np.maximum(1.0, np.abs(best.x))
    decoded = central_differences(lambda x: material_decode(model, x), best.x, step)
    slopes = np.column_stack(decoded)
    sd = np.sqrt(np.maximum(np.diag(slopes @ covariance @ slopes.T), 0.0))
    parts = np.split(misfit(best.x), np.cumsum([len(t.stretch) for t in tests])[:-1])
    rms: dict[str, float] = {}
    for test, part in zip(tests, parts, strict=True):
        rms[test.mode] = math.hypot(rms.get(test.mode, 0.0), float(np.linalg.norm(part)))
    names, own = _named(model, values)
    material = Material(model, own | {"poisson_ratio": poisson_ratio})
    covered = _covered_stretches(tests)
    warnings = [*_modulus_warnings(material), *_range_warnings(tests, covered, use)]
    warnings += [
        f"{name} = {value:.3g} +- {error:.2g} is not determined by these tests"
        for name, value, error in zip(names, values, sd, strict=True)
        if error > 0.5 * abs(value)
    ]
    aicc = _aicc(best.cost, rows, size + 1)
    return MaterialFit(material, names, values, sd, rms, aicc, covered, tuple(warnings))


def _minimise(misfit: Callable[[F], F], start: F, progress: Progress | None) -> Any:
    """Return the best least-squares result of several starts; None where no start is finite."""
    best: Any = None
    for i, shift in enumerate(_START_SHIFTS):
        tell_part(progress, i, len(_START_SHIFTS), f"start {i + 1} of {len(_START_SHIFTS)}")
        guess = start.copy()
        guess[-1] += shift
        with np.errstate(over="ignore", invalid="ignore"):
            try:
                result = least_squares(misfit, guess, method="trf", x_scale="jac", max_nfev=2000)
            except ValueError:  # the misfit is not finite at this start
                continue
        if best is None or result.cost < best.cost:
            best = result
    return best


def _aicc(cost: float, rows: int, parameters: int) -> float:
    """Return AICc of a least-squares fit; `parameters` counts the noise as well."""
    k = parameters
    aicc = rows * math.log(max(2.0 * cost / rows, 1e-300)) + 2.0 * k
    return aicc + 2.0 * k * (k + 1) / max(rows - k - 1, 1)


def _guess_shear_modulus(tests: Sequence[MaterialTest]) -> float:
    """Return the neo-Hookean shear modulus, Pa, of the quarter of rows next to stretch 1."""
    ratios = []
    solid = Material("neo_hookean", {"young_modulus_Pa": 3.0, "poisson_ratio": 0.5})
    for test in tests:
        unit = solid.nominal_stress(test.mode, test.stretch)
        near = np.argsort(np.abs(test.stretch - 1.0))[: max(3, len(unit) // 4)]
        ratios.append(float(unit[near] @ test.stress_Pa[near] / (unit[near] @ unit[near])))
    return max(float(np.median(ratios)), 1.0)


def _named(model: str, values: F) -> tuple[tuple[str, ...], dict[str, float | list[float]]]:
    """Return a name for each value, and the parameters of the material."""
    parameters = MODELS[model]
    if model not in WITH_TERMS:
        return parameters, {n: float(v) for n, v in zip(parameters, values, strict=True)}
    lists = dict(zip(parameters, np.split(values, len(parameters)), strict=True))
    names = tuple(f"{name}[{i}]" for name, terms in lists.items() for i in range(len(terms)))
    return names, {name: terms.tolist() for name, terms in lists.items()}


def _covered_stretches(tests: Sequence[MaterialTest]) -> tuple[float, float]:
    """Return the range of uniaxial stretches that the tests cover."""
    low, high = 1.0, 1.0
    for test in tests:
        a, b = float(test.stretch.min()), float(test.stretch.max())
        if test.mode == "equibiaxial":
            a, b = b**-2, a**-2
        low, high = min(low, a), max(high, b)
    return low, high


def _modulus_warnings(material: Material) -> list[str]:
    """Say where no rubber has this modulus, and with which unit it would be one."""
    low, high = RUBBER_PA
    young = material.young_modulus_Pa
    if low <= young <= high:
        return []
    factors = [f"{f:g} times" for f in (1e3, 1e-3, 1e6, 1e-6) if low <= f * young <= high]
    return [
        f"E = {young:.3g} Pa, and rubber has {low / 1e6:g} to {high / 1e6:g} MPa: is "
        f"the unit of the stresses {' or '.join(factors) or 'not'} this one (header stress_MPa, or "
        "--unit)?"
    ]


def _range_warnings(
    tests: Sequence[MaterialTest], covered: tuple[float, float], use: tuple[float, float]
) -> list[str]:
    warnings = []
    if use[0] < covered[0] or use[1] > covered[1]:
        warnings.append(
            f"extrapolation: the tests cover uniaxial stretches {covered[0]:.2f} to "
            f"{covered[1]:.2f}, the mechanism uses {use[0]:.2f} to {use[1]:.2f}"
        )
    if len({test.mode for test in tests}) == 1:
        warnings.append(
            f"only {tests[0].mode} tests: other kinds of deformation are extrapolation; a second "
            "kind of test distinguishes models"
        )
    return warnings
