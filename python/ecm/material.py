"""Rubber-like materials: models by name, closed forms of the three classical tests, and fits.

Nominal stress of an incompressible solid with W(I1, I2) at stretch l:

- uniaxial       P = 2 (l - l^-2) (W1 + W2 / l)
- equibiaxial    P = 2 (l - l^-5) (W1 + l^2 W2)
- pure shear     P = 2 (l - l^-3) (W1 + W2)

and of Ogden's W = sum 2 mu / a^2 (l1^a + l2^a + l3^a - 3): P = sum 2 mu / a (l^a - l^b) / l with
b = -a/2, -2a, -a (Ogden 1972, 1984). An equibiaxial test at l is a compression to l^-2.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecm.errors import ComputationError, InputError
from ecm.toml_file import check_keys, nearest

F = NDArray[np.float64]

PARAMETERS: dict[str, tuple[str, ...]] = {
    "neo_hookean": ("young_modulus_Pa",),
    "mooney_rivlin": ("c10_Pa", "c01_Pa"),
    "yeoh": ("c1_Pa", "c2_Pa", "c3_Pa"),
    "ogden": ("mu_Pa", "alpha"),
    "gent": ("shear_modulus_Pa", "j_m"),
}
"""Models and their own parameters; `mu_Pa` and `alpha` of Ogden are lists."""
COMMON = ("bulk_modulus_Pa", "poisson_ratio", "fibre_direction", "fibre_k1_Pa", "fibre_k2")
"""Parameters that every model takes."""
MODES = ("uniaxial", "equibiaxial", "pure_shear")
_POWER = {"uniaxial": -0.5, "equibiaxial": -2.0, "pure_shear": -1.0}


@dataclass(frozen=True)
class Material:
    """A model with its parameters, as in `[mechanism] material = { model = "yeoh", ... }`."""

    model: str
    parameters: Mapping[str, float | list[float]]

    def __post_init__(self) -> None:
        if self.model not in PARAMETERS:
            raise InputError(f"material model = '{self.model}': {nearest(self.model, PARAMETERS)}")
        known = (*PARAMETERS[self.model], *COMMON)
        check_keys(self.parameters, known, f"material '{self.model}'")
        for name in PARAMETERS[self.model]:
            if name not in self.parameters:
                raise InputError(f"material '{self.model}': the key '{name}' is missing")
        for name, value in self.parameters.items():
            for number in value if isinstance(value, (list, tuple)) else (value,):
                if isinstance(number, bool) or not isinstance(number, (int, float)):
                    raise InputError(
                        f"material '{self.model}': {name} = {value!r}: expected "
                        "a number or a list of numbers"
                    )

    @staticmethod
    def from_dict(table: Mapping[str, Any]) -> Material:
        """From a table with `model` and its parameters."""
        return Material(
            str(table.get("model", "neo_hookean")),
            {key: value for key, value in table.items() if key != "model"},
        )

    def to_dict(self) -> dict[str, Any]:
        """The table that gives this material back."""
        return {"model": self.model, **self.parameters}

    @property
    def poisson_ratio(self) -> float:
        """Of small strain; 0.49 where the table is silent."""
        if "bulk_modulus_Pa" in self.parameters:
            kappa, mu = self._number("bulk_modulus_Pa"), self.shear_modulus_Pa
            return (3.0 * kappa - 2.0 * mu) / (6.0 * kappa + 2.0 * mu)
        return self._number("poisson_ratio") if "poisson_ratio" in self.parameters else 0.49

    @property
    def shear_modulus_Pa(self) -> float:
        """At small strain, of the matrix."""
        if self.model == "mooney_rivlin":
            return 2.0 * (self._number("c10_Pa") + self._number("c01_Pa"))
        if self.model == "yeoh":
            return 2.0 * self._number("c1_Pa")
        if self.model == "ogden":
            return float(np.sum(np.atleast_1d(np.asarray(self.parameters["mu_Pa"], dtype=float))))
        if self.model == "gent":
            return self._number("shear_modulus_Pa")
        young = self._number("young_modulus_Pa")
        if "bulk_modulus_Pa" in self.parameters:
            kappa = self._number("bulk_modulus_Pa")
            return 3.0 * kappa * young / (9.0 * kappa - young)
        return young / (2.0 * (1.0 + self.poisson_ratio))

    @property
    def young_modulus_Pa(self) -> float:
        """At small strain, of the matrix."""
        return 2.0 * self.shear_modulus_Pa * (1.0 + self.poisson_ratio)

    def scaled(self, factor: float) -> Material:
        """All moduli times `factor`."""

        def change(name: str, value: float | list[float]) -> float | list[float]:
            if not name.endswith("_Pa"):
                return value
            if isinstance(value, (list, tuple)):
                return [factor * v for v in value]
            return factor * value

        return Material(self.model, {k: change(k, v) for k, v in self.parameters.items()})

    def nominal_stress(self, mode: str, stretch: F) -> F:
        """Force per undeformed area, Pa, of the incompressible solid without fibres.

        Parameters
        ----------
        mode
            uniaxial, equibiaxial or pure_shear.
        stretch
            (N,) stretches in the pulled direction.
        """
        if mode not in MODES:
            raise InputError(f"mode = '{mode}': {nearest(mode, MODES)}")
        if np.any(stretch <= 0.0):
            raise InputError(f"stretch = {np.min(stretch)}: expected above 0 (1 is undeformed)")
        values = [self.parameters[name] for name in PARAMETERS[self.model]]
        if self.model == "neo_hookean":
            values = [self.shear_modulus_Pa]
        flat = np.concatenate([np.atleast_1d(np.asarray(v, dtype=float)) for v in values])
        return _stress(self.model, flat, mode, np.asarray(stretch, dtype=float))

    def _number(self, name: str) -> float:
        return float(self.parameters[name])  # type: ignore[arg-type]


def _stress(model: str, values: F, mode: str, stretch: F) -> F:
    """Nominal stress; neo-Hookean values are the shear modulus, Ogden's all mu, then all alpha."""
    power = _POWER[mode]
    if model == "ogden":
        mu, alpha = np.split(values, 2)
        terms = stretch[:, None] ** alpha - stretch[:, None] ** (power * alpha)
        return np.asarray((terms * 2.0 * mu / alpha).sum(axis=1) / stretch)
    squares = {
        "uniaxial": (stretch**2 + 2.0 / stretch, 1.0 / stretch),
        "equibiaxial": (2.0 * stretch**2 + stretch**-4, stretch**2),
        "pure_shear": (stretch**2 + 1.0 + stretch**-2, np.ones_like(stretch)),
    }
    first, weight = squares[mode]
    excess = first - 3.0
    slope_1: Any = 0.0
    slope_2: Any = 0.0
    if model == "neo_hookean":
        slope_1 = 0.5 * values[0]
    elif model == "mooney_rivlin":
        slope_1, slope_2 = values
    elif model == "yeoh":
        slope_1 = values[0] + 2.0 * values[1] * excess + 3.0 * values[2] * excess**2
    else:
        # Beyond the locking stretch the fit must see a steep but finite wall.
        slope_1 = 0.5 * values[0] / np.maximum(1.0 - excess / values[1], 1e-3)
    return np.asarray(
        2.0 * (stretch - stretch ** (2.0 * power - 1.0)) * (slope_1 + weight * slope_2)
    )


@dataclass(frozen=True)
class Test:
    """One quasi-static test: stretches (N,) and nominal stresses (N,), Pa."""

    mode: str
    stretch: F
    stress_Pa: F
    source: str = ""

    __test__ = False  # not one of pytest's

    def __post_init__(self) -> None:
        place = self.source or self.mode
        if self.mode not in MODES:
            raise InputError(f"{place}: mode = '{self.mode}': {nearest(self.mode, MODES)}")
        if self.stretch.shape != self.stress_Pa.shape or self.stretch.ndim != 1:
            raise InputError(
                f"{place}: found {self.stretch.shape} stretches and "
                f"{self.stress_Pa.shape} stresses, expected as many of both"
            )
        if not (np.isfinite(self.stretch).all() and np.isfinite(self.stress_Pa).all()):
            raise InputError(f"{place}: a number is not finite")
        if np.any(self.stretch <= 0.0) or np.any(self.stretch > 20.0):
            raise InputError(
                f"{place}: stretches from {self.stretch.min():g} to "
                f"{self.stretch.max():g}, expected between 0 and 20 (1 is "
                "undeformed): are the columns swapped, or are these strains?"
            )
        wrong = (self.stretch - 1.0) * self.stress_Pa < 0.0
        if wrong.sum() > max(1, len(wrong) // 10):
            raise InputError(
                f"{place}: {wrong.sum()} of {len(wrong)} stresses have the wrong "
                "sign for their stretch: are the columns swapped, or are these "
                "strains?"
            )


_UNITS = {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6}


def read_test(path: Path, mode: str, *, unit: str = "", order: str = "") -> Test:
    """Two columns of text, with the header `stretch,stress_MPa` or with `unit` and `order`.

    Parameters
    ----------
    unit
        Pa, kPa or MPa, where no header says it.
    order
        stretch-stress or stress-stretch, where no header says it.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: found no text, expected two columns of numbers") from None
    cells = [(i + 1, line.replace(",", " ").split()) for i, line in enumerate(lines)]
    cells = [(i, row) for i, row in cells if row and not row[0].startswith("#")]
    if cells and not _is_number(cells[0][1][0]):
        header = cells.pop(0)[1]
        stress = [name for name in header if name.startswith("stress_")]
        if len(header) != 2 or "stretch" not in header or not stress:
            raise InputError(
                f"{path}: header {' '.join(header)}, expected stretch and stress_Pa, "
                "stress_kPa or stress_MPa"
            )
        unit = stress[0].removeprefix("stress_")
        order = "stretch-stress" if header[0] == "stretch" else "stress-stretch"
    if unit not in _UNITS:
        raise InputError(
            f"{path}: unit = '{unit}', expected Pa, kPa or MPa: give --unit or a "
            "header stretch,stress_MPa"
        )
    if order not in ("stretch-stress", "stress-stretch"):
        raise InputError(
            f"{path}: order = '{order}', expected stretch-stress or stress-stretch: "
            "give --order or a header stretch,stress_MPa"
        )
    for number, row in cells:
        if len(row) != 2 or not all(_is_number(cell) for cell in row):
            raise InputError(
                f"{path}, line {number}: found '{' '.join(row)}', expected two numbers"
            )
    if len(cells) < 3:
        raise InputError(f"{path}: {len(cells)} rows, expected at least 3")
    table = np.array([[float(cell) for cell in row] for _, row in cells])
    if order == "stress-stretch":
        table = table[:, ::-1]
    return Test(mode, table[:, 0].copy(), table[:, 1] * _UNITS[unit], str(path))


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


@dataclass(frozen=True)
class MaterialFit:
    """A material identified from tests, with what is known about its errors."""

    material: Material
    names: tuple[str, ...]
    values: F
    sd: F
    """Standard deviation of each value from the scatter around the fit."""
    rms: dict[str, float]
    """Relative rms misfit per test mode."""
    aicc: float
    covered: tuple[float, float]
    """Uniaxial stretches that the tests cover; an equibiaxial one at l counts as l^-2."""
    warnings: tuple[str, ...]


def fit_material(
    tests: Sequence[Test],
    model: str = "auto",
    *,
    terms: int = 2,
    use: tuple[float, float] = (0.5, 1.6),
    poisson_ratio: float = 0.49,
) -> MaterialFit:
    """The material that meets all tests best; every test has the same weight.

    Parameters
    ----------
    model
        One of the models, or auto: the one of smallest AICc.
    terms
        Number of Ogden's terms.
    use
        Uniaxial stretches that the mechanism reaches: outside the tests the fit is warned about.
    """
    if not tests:
        raise InputError("no test: give at least one of uniaxial, equibiaxial, pure_shear")
    if model == "auto":
        found = []
        for name in PARAMETERS:
            try:
                found.append(_fit_one(tests, name, terms, use, poisson_ratio))
            except ComputationError:
                continue
        if not found:
            raise ComputationError("no model fits these tests: check units and columns")
        return min(found, key=lambda f: f.aicc)
    if model not in PARAMETERS:
        raise InputError(f"model = '{model}': {nearest(model, (*PARAMETERS, 'auto'))}")
    return _fit_one(tests, model, terms, use, poisson_ratio)


def _fit_one(
    tests: Sequence[Test],
    model: str,
    terms: int,
    use: tuple[float, float],
    poisson_ratio: float,
) -> MaterialFit:
    from scipy.optimize import least_squares

    scales = [float(np.sqrt(np.mean(t.stress_Pa**2) * len(t.stretch))) for t in tests]
    count = sum(len(t.stretch) for t in tests)
    start, decode, names = _start(model, _modulus_guess(tests), terms)
    if count <= len(start):
        raise ComputationError(f"{count} rows cannot give the {len(start)} parameters of {model}")

    def misfit(x: F) -> F:
        values = decode(x)
        parts = [
            (_stress(model, values, t.mode, t.stretch) - t.stress_Pa) / scale
            for t, scale in zip(tests, scales, strict=True)
        ]
        return np.concatenate(parts)

    best = None
    for shift in (0.0, -1.0, 1.0):
        guess = start.copy()
        guess[-1] += shift
        with np.errstate(over="ignore", invalid="ignore"):
            try:
                result = least_squares(misfit, guess, method="trf", x_scale="jac", max_nfev=2000)
            except ValueError:  # the misfit was not finite at this start
                continue
        if best is None or result.cost < best.cost:
            best = result
    if best is None or not np.isfinite(best.cost):
        raise ComputationError(f"the fit of {model} does not converge: check units and columns")
    values = decode(best.x)
    variance = 2.0 * best.cost / (count - len(start))
    by_free = np.asarray(best.jac, dtype=np.float64)
    inner = np.linalg.pinv(by_free.T @ by_free) * variance
    step = 1e-6 * np.maximum(1.0, np.abs(best.x))
    by_x = np.column_stack(
        [
            (decode(best.x + h * e) - decode(best.x - h * e)) / (2.0 * h)
            for h, e in zip(step, np.eye(len(start)), strict=True)
        ]
    )
    sd = np.sqrt(np.maximum(np.diag(by_x @ inner @ by_x.T), 0.0))
    if model == "neo_hookean":
        values, sd = values * 2.0 * (1.0 + poisson_ratio), sd * 2.0 * (1.0 + poisson_ratio)
    parts = np.split(misfit(best.x), np.cumsum([len(t.stretch) for t in tests])[:-1])
    rms: dict[str, float] = {}
    for test, part in zip(tests, parts, strict=True):
        rms[test.mode] = math.hypot(rms.get(test.mode, 0.0), float(np.linalg.norm(part)))
    k = len(start) + 1
    aicc = count * math.log(max(2.0 * best.cost / count, 1e-300)) + 2.0 * k
    aicc += 2.0 * k * (k + 1) / max(count - k - 1, 1)
    material = _material(model, values, poisson_ratio)
    covered = _covered(tests)
    warnings = _warnings(tests, covered=covered, use=use, names=names, values=values, sd=sd)
    return MaterialFit(material, names, values, sd, rms, aicc, covered, warnings)


def _modulus_guess(tests: Sequence[Test]) -> float:
    """Shear modulus of the neo-Hookean solid through the smallest tenth of the stretches."""
    ratios = []
    for test in tests:
        unit = _stress("neo_hookean", np.array([1.0]), test.mode, test.stretch)
        near = np.argsort(np.abs(test.stretch - 1.0))[: max(3, len(unit) // 4)]
        ratios.append(float(unit[near] @ test.stress_Pa[near] / (unit[near] @ unit[near])))
    return max(float(np.median(ratios)), 1.0)


def _start(model: str, mu: float, terms: int) -> tuple[F, Any, tuple[str, ...]]:
    """Free variables at the start, their way to the parameters, and the parameters' names.

    Logarithms and squares keep every parameter where the energy is stable (polyconvex or, for
    Yeoh, with a positive slope): stress rises with stretch also where no test was made.
    """
    if model == "mooney_rivlin":
        x = np.array([math.log(0.4 * mu), math.log(0.1 * mu)])
        return x, np.exp, ("c10_Pa", "c01_Pa")
    if model == "yeoh":
        # C1 = e^a, C3 = e^c, C2 = sqrt(3 C1 C3) (e^b - 1): the slope has no zero.
        x = np.array([math.log(0.5 * mu), math.log(1e-6 * mu), -0.1])

        def yeoh(x: F) -> F:
            c1, c3 = np.exp(x[0]), np.exp(x[1])
            return np.array([c1, np.sqrt(3.0 * c1 * c3) * np.expm1(x[2]), c3])

        return x, yeoh, ("c1_Pa", "c2_Pa", "c3_Pa")
    if model == "ogden":
        if not 1 <= terms <= 4:
            raise InputError(f"terms = {terms}: expected 1 to 4")
        alpha = np.array([1.5, -1.5, 4.0, -4.0])[:terms]
        share = np.array([0.9, 0.08, 0.01, 0.01])[:terms] * mu
        x = np.concatenate([np.log(share), alpha])
        names = tuple(f"mu_Pa[{i}]" for i in range(terms))
        names += tuple(f"alpha[{i}]" for i in range(terms))
        return x, lambda x: np.concatenate([np.exp(x[:terms]), x[terms:]]), names
    if model == "gent":
        x = np.array([math.log(mu), math.log(50.0)])
        return x, np.exp, ("shear_modulus_Pa", "j_m")
    return np.array([math.log(mu)]), np.exp, ("young_modulus_Pa",)


def _material(model: str, values: F, poisson_ratio: float) -> Material:
    if model == "ogden":
        mu, alpha = np.split(values, 2)
        own: dict[str, float | list[float]] = {"mu_Pa": mu.tolist(), "alpha": alpha.tolist()}
    else:
        own = {n: float(v) for n, v in zip(PARAMETERS[model], values, strict=True)}
    return Material(model, own | {"poisson_ratio": poisson_ratio})


def _covered(tests: Sequence[Test]) -> tuple[float, float]:
    low, high = 1.0, 1.0
    for test in tests:
        a, b = float(test.stretch.min()), float(test.stretch.max())
        if test.mode == "equibiaxial":
            a, b = b**-2, a**-2
        low, high = min(low, a), max(high, b)
    return low, high


def _warnings(
    tests: Sequence[Test],
    *,
    covered: tuple[float, float],
    use: tuple[float, float],
    names: tuple[str, ...],
    values: F,
    sd: F,
) -> tuple[str, ...]:
    found = []
    if use[0] < covered[0] or use[1] > covered[1]:
        found.append(
            f"extrapolation: the tests cover uniaxial stretches {covered[0]:.2f} to "
            f"{covered[1]:.2f}, the mechanism is said to use {use[0]:.2f} to {use[1]:.2f}"
        )
    if len({test.mode for test in tests}) == 1:
        found.append(
            f"only {tests[0].mode} tests: other kinds of deformation are extrapolation; a second "
            "kind of test tells models apart"
        )
    for name, value, error in zip(names, values, sd, strict=True):
        if error > 0.5 * abs(value):
            found.append(f"{name} = {value:.3g} +- {error:.2g} is not determined by these tests")
    return tuple(found)
