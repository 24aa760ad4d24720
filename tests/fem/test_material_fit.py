"""`ecm material fit`: closed forms, recovery of known constants, real rubber, refusals."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from ecm.cli.main import run as main
from ecm.errors import ComputationError, InputError
from ecm.fem.material_fit import MaterialTest, fit_material, read_test
from ecm.io.arrays import F
from ecm.io.mechanism import TESTS, Material, Mechanism
from support.neck import ROOT

RUBBER = ROOT.parent / "shared" / "data" / "rubber"
needs_data = pytest.mark.skipif(
    not RUBBER.is_dir(), reason="../shared/data/rubber is not beside this checkout"
)
TRUE = {
    "neo_hookean": {"young_modulus_Pa": 6e5},
    "mooney_rivlin": {"c10_Pa": 8e4, "c01_Pa": 2e4},
    "yeoh": {"c1_Pa": 1e5, "c2_Pa": -1e3, "c3_Pa": 5e2},
    "ogden": {"mu_Pa": [1.7e5, 3e4], "alpha": [1.8, -2.2]},
    "gent": {"shear_modulus_Pa": 2e5, "j_m": 20.0},
}
STRETCH = np.linspace(0.6, 2.2, 25)


def material(model: str) -> Material:
    return Material(model, {**TRUE[model], "poisson_ratio": 0.49})  # type: ignore[dict-item]


def all_tests(law: Material) -> list[MaterialTest]:
    return [MaterialTest(mode, STRETCH, law.nominal_stress(mode, STRETCH)) for mode in TESTS]


def energy(law: Material, a: F, b: F) -> F:
    """W of an incompressible solid at principal stretches a, b, 1/(a b), written independently."""
    c = 1.0 / (a * b)
    i1 = a**2 + b**2 + c**2 - 3.0
    i2 = (a * b) ** 2 + (b * c) ** 2 + (a * c) ** 2 - 3.0
    p = {k: np.asarray(v) for k, v in law.parameters.items()}
    if law.model == "neo_hookean":
        return np.asarray(0.5 * law.shear_modulus_Pa * i1)
    if law.model == "mooney_rivlin":
        return np.asarray(p["c10_Pa"] * i1 + p["c01_Pa"] * i2)
    if law.model == "yeoh":
        return np.asarray(p["c1_Pa"] * i1 + p["c2_Pa"] * i1**2 + p["c3_Pa"] * i1**3)
    if law.model == "gent":
        return np.asarray(-0.5 * p["shear_modulus_Pa"] * p["j_m"] * np.log(1.0 - i1 / p["j_m"]))
    terms = [
        2.0 * mu / al**2 * (a**al + b**al + c**al - 3.0)
        for mu, al in zip(p["mu_Pa"], p["alpha"], strict=True)
    ]
    return np.asarray(sum(terms))


@pytest.mark.parametrize("model", TRUE)
def test_stress_is_the_derivative_of_the_energy(model: str) -> None:
    law = material(model)
    h = 1e-6
    for mode, second, share in (
        ("uniaxial", lambda x: x**-0.5, 1.0),
        ("equibiaxial", lambda x: x, 0.5),  # two directions do work
        ("pure_shear", np.ones_like, 1.0),
    ):
        up, down = (energy(law, STRETCH + s * h, second(STRETCH + s * h)) for s in (1, -1))
        found = law.nominal_stress(mode, STRETCH)
        np.testing.assert_allclose(found, share * (up - down) / (2.0 * h), rtol=1e-6, atol=1e-2)


@pytest.mark.parametrize("model", TRUE)
def test_known_constants_are_found_again(model: str) -> None:
    law = material(model)
    found = fit_material(all_tests(law), model)
    assert found.material.young_modulus_Pa == pytest.approx(law.young_modulus_Pa, rel=1e-4)
    assert max(found.rms.values()) < 1e-5
    if model != "ogden":  # its two terms may change places
        for name, value in TRUE[model].items():
            assert found.material.parameters[name] == pytest.approx(value, rel=1e-3)


def test_standard_deviations_are_those_of_repeated_tests() -> None:
    law = material("mooney_rivlin")
    rng = np.random.default_rng(5)
    values, sds = [], []
    for _ in range(60):
        noisy = [
            MaterialTest(t.mode, t.stretch, t.stress_Pa + rng.normal(0.0, 4e3, len(STRETCH)))
            for t in all_tests(law)
        ]
        found = fit_material(noisy, "mooney_rivlin")
        values.append(found.values)
        sds.append(found.sd)
    spread, expected = np.std(values, axis=0), np.mean(sds, axis=0)
    np.testing.assert_array_less(spread / expected, 1.6)
    np.testing.assert_array_less(expected / spread, 2.2)


def test_auto_finds_the_law_behind_noise() -> None:
    rng = np.random.default_rng(1)
    law = material("gent")
    noisy = [
        MaterialTest(t.mode, t.stretch, t.stress_Pa * (1.0 + rng.normal(0.0, 0.01, len(STRETCH))))
        for t in all_tests(law)
    ]
    assert fit_material(noisy).material.model == "gent"


def test_extrapolation_is_warned_about() -> None:
    law = material("neo_hookean")
    stretch = np.linspace(1.0, 1.4, 12)
    only = [MaterialTest("uniaxial", stretch, law.nominal_stress("uniaxial", stretch))]
    text = " ".join(fit_material(only, "yeoh", use=(0.5, 1.6)).warnings)
    assert "extrapolation" in text
    assert "only uniaxial" in text
    wide = [*only, MaterialTest("equibiaxial", STRETCH, law.nominal_stress("equibiaxial", STRETCH))]
    # An equibiaxial stretch of 2.2 is a compression to 0.21.
    assert not fit_material(wide, "neo_hookean", use=(0.5, 1.4)).warnings


@needs_data
def test_a_modulus_that_no_rubber_has_asks_for_the_unit() -> None:
    stretch = np.linspace(0.8, 1.6, 9)
    rubber = Material("neo_hookean", {"young_modulus_Pa": 6e5})
    stress = rubber.nominal_stress("uniaxial", stretch)
    for factor, asked in ((1e-6, "1e+06 times"), (1e-3, "1000 times"), (1e6, "1e-06 times")):
        fit = fit_material([MaterialTest("uniaxial", stretch, factor * stress)], "neo_hookean")
        assert f"0.01 to 100 MPa: is the unit of the stresses {asked}" in fit.warnings[0]


def test_treloars_rubber() -> None:
    """Steinmann, Hossain and Possart 2012 find mu about 0.3 to 0.4 MPa for these data."""
    folder = RUBBER / "Treloar_1944"
    tests = [
        read_test(folder / name / "stress_stretch.txt", mode, unit="MPa", order="stress-stretch")
        for name, mode in (("UT", "uniaxial"), ("ET", "equibiaxial"), ("PS", "pure_shear"))
    ]
    found = fit_material(tests)
    assert 0.28e6 < found.material.shear_modulus_Pa < 0.42e6
    assert max(found.rms.values()) < 0.15
    poor = fit_material(tests, "neo_hookean")
    assert poor.aicc > found.aicc + 50.0


@needs_data
def test_the_command_writes_a_material_for_the_mechanism(tmp_path: Path) -> None:
    folder = RUBBER / "Meunier_2008"
    out, result = tmp_path / "m.toml", tmp_path / "m.json"
    arguments = ["material", "fit", "--unit", "MPa", "--order", "stress-stretch", "--quiet"]
    for name, option in (("UT", "uniaxial"), ("ET", "equibiaxial"), ("PS", "pure-shear")):
        arguments += [f"--{option}", str(folder / name / "stress_stretch.txt")]
    assert main([*arguments, "--out", str(out), "--json", str(result)]) == 0
    document = json.loads(result.read_text(encoding="utf-8"))
    neck = {"builtin": "cylinder", "length_m": 0.1034, "radius_m": 0.033}
    body = Mechanism.from_dict(neck | {"material": document["material"]})
    assert body.young_modulus_Pa == pytest.approx(document["young_modulus_Pa"])
    assert body.fem().solve_wrenches(np.zeros((1, 6))).status == ["solved"]
    assert "[mechanism.material]" in out.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("text", "options", "expected"),
    [
        ("1 2\n2 3\n3 4\n", [], "unit = ''"),
        ("1 2\n2 3\n3 4\n", ["--unit", "MPa"], "order = ''"),
        ("stretch,stress_MPa\n1.1,0.2\n1.2,x\n1.3,0.4\n", [], "line 3"),
        ("stretch,stress_MPa\n1.1,0.2\n", [], "expected at least 3"),
        ("stretch,stress_psi\n1.1,0.2\n1.2,0.3\n1.3,0.4\n", [], "unit = 'psi'"),
        ("strain,stress_MPa\n0.1,0.2\n0.2,0.3\n0.3,0.4\n", [], "stretch is 1 + strain"),
        ("stretch,stress_MPa\n0.1,0.2\n0.2,0.3\n0.3,0.4\n", [], "wrong sign"),
        ("stretch,stress_MPa\n1.1,nan\n1.2,0.3\n1.3,0.4\n", [], "not finite"),
    ],
)
def test_bad_tests_are_refused(
    text: str, options: list[str], expected: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "test.csv"
    path.write_text(text, encoding="utf-8")
    assert main(["material", "fit", "--uniaxial", str(path), *options]) == 2
    assert expected in capsys.readouterr().err


def test_too_few_rows_and_no_test_are_said() -> None:
    with pytest.raises(InputError, match="no test"):
        fit_material([])
    law = material("neo_hookean")
    few = np.array([1.1, 1.2, 1.3])
    test = MaterialTest("uniaxial", few, law.nominal_stress("uniaxial", few))
    with pytest.raises(ComputationError, match="cannot give"):
        fit_material([test], "yeoh")
    with pytest.raises(InputError, match=r"poisson_ratio is 0.6; expected .* at most 0.5"):
        fit_material([test], poisson_ratio=0.6)
