"""The mechanism: dimensions, moduli, sections of a rod, hashes."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ecm.errors import FemError, InputError
from ecm.io.mechanism import Mechanism

NECK = {
    "builtin": "cylinder",
    "length_m": 0.1034,
    "radius_m": 0.033,
    "young_modulus_Pa": 0.65e6,
    "poisson_ratio": 0.49,
}


def test_the_default_is_the_neck() -> None:
    assert Mechanism.from_dict(NECK) == Mechanism()
    assert Mechanism().has_body


def test_a_law_states_the_moduli_at_small_strain() -> None:
    yeoh = {"model": "yeoh", "c1_Pa": 2e5, "c2_Pa": 1e4, "c3_Pa": 0.0}
    body = Mechanism(material=yeoh)  # type: ignore[arg-type]
    table = {"builtin": "cylinder", "length_m": 0.1034, "radius_m": 0.033, "material": yeoh}
    assert body == Mechanism.from_dict(table)
    assert body.young_modulus_Pa == pytest.approx(4 * 2e5 * 1.49)


def test_dictionaries_go_round() -> None:
    for table in (
        NECK,
        {"length_m": 0.2},
        NECK | {"builtin": "tube", "inner_radius_m": 0.01, "density_kg_m3": 1100.0},
        NECK | {"builtin": "hourglass", "waist_radius_m": 0.02, "quality": "fine"},
    ):
        body = Mechanism.from_dict(table)
        assert Mechanism.from_dict(body.to_dict()) == body


def test_a_bare_length_is_no_body() -> None:
    bare = Mechanism.from_dict({"length_m": 0.2})
    assert not bare.has_body
    with pytest.raises(InputError, match="gives no shape"):
        bare.mesh()
    with pytest.raises(InputError, match="young_modulus_Pa"):
        bare.fem()
    with pytest.raises(InputError, match="a rod needs"):
        bare.rod_sections()


def test_the_necks_figures_are_no_defaults_of_another_body() -> None:
    body = Mechanism.from_dict({"builtin": "cylinder", "length_m": 0.2, "radius_m": 0.05})
    assert body.young_modulus_Pa == 0.0
    assert not body.has_body
    with pytest.raises(InputError, match="young_modulus_Pa"):
        body.fem()
    with pytest.raises(InputError, match="needs the key 'radius_m'"):
        Mechanism.from_dict({"builtin": "cylinder", "length_m": 0.2})


def test_sections_of_the_neck_are_those_of_a_circle() -> None:
    sections = Mechanism().rod_sections()
    modulus, radius, nu = 0.65e6, 0.033, 0.49
    assert sections["axial_stiffness_N"] == pytest.approx(modulus * math.pi * radius**2)
    assert sections["bending_stiffness_Nm2"] == pytest.approx(modulus * math.pi * radius**4 / 4)
    shear_modulus = modulus / (2 * (1 + nu))
    assert sections["torsion_stiffness_Nm2"] == pytest.approx(
        shear_modulus * math.pi * radius**4 / 2
    )
    # Cowper 1966, circle: 6 (1 + nu) / (7 + 6 nu).
    correction = 6 * (1 + nu) / (7 + 6 * nu)
    assert sections["shear_stiffness_N"] == pytest.approx(
        correction * shear_modulus * math.pi * radius**2
    )


def test_a_thin_tube_has_cowpers_shear_correction() -> None:
    tube = Mechanism(builtin="tube", inner_radius_m=0.033 * 0.9999)
    sections = tube.rod_sections()
    area = math.pi * (0.033**2 - tube.inner_radius_m**2)
    shear_modulus = 0.65e6 / (2 * 1.49)
    # Cowper 1966, thin-walled round tube: 2 (1 + nu) / (4 + 3 nu).
    expected = 2 * 1.49 / (4 + 3 * 0.49)
    assert sections["shear_stiffness_N"] / (shear_modulus * area) == pytest.approx(
        expected, rel=1e-4
    )


def test_a_rod_may_be_given_by_its_sections() -> None:
    given = {
        "axial_stiffness_N": 2000.0,
        "shear_stiffness_N": 600.0,
        "bending_stiffness_Nm2": 0.6,
        "torsion_stiffness_Nm2": 0.4,
    }
    rod = Mechanism.from_dict({"builtin": "rod", "length_m": 0.1, **given})
    assert rod.rod_sections() == given


def test_the_key_depends_on_what_matters_and_not_on_where_a_mesh_lies(tmp_path: Path) -> None:
    keys = {
        Mechanism().key(),
        Mechanism(length_m=0.1035).key(),
        Mechanism(young_modulus_Pa=0.66e6).key(),
        Mechanism(quality="fine").key(),
    }
    assert len(keys) == 4
    assert Mechanism().key() == Mechanism().key()
    for name in ("a", "b"):
        (tmp_path / f"{name}.msh").write_text("the same", encoding="utf-8")
    first = replace(Mechanism(), builtin="", mesh_file=tmp_path / "a.msh")
    assert first.key() == replace(first, mesh_file=tmp_path / "b.msh").key()
    (tmp_path / "b.msh").write_text("another", encoding="utf-8")
    assert first.key() != replace(first, mesh_file=tmp_path / "b.msh").key()


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"builtin": "cilinder"}, "did you mean 'cylinder'?"),
        ({"length_m": 103.4}, "from 0.001 to 10 (undeformed length in metres, not millimetres"),
        ({"length_m": -0.1}, "length_m = -0.1: expected a number from 0.001"),
        ({"radius_m": 33.0}, "expected metres for both"),
        ({"young_modulus_Pa": 0.65}, "looks like MPa"),
        ({"poisson_ratio": 0.51}, "expected a number from 0 to 0.5"),
        ({"builtin": "tube"}, "needs the key 'inner_radius_m'"),
        ({"builtin": "tube", "inner_radius_m": 0.04}, "below radius_m"),
        ({"builtin": "hourglass", "waist_radius_m": 0.05}, "at most radius_m"),
        ({"quality": "super"}, "expected one of standard, fine"),
        ({"mesh": "x.msh"}, "found both builtin and mesh"),
        ({"radius": 0.03}, "unknown key 'radius', did you mean 'radius_m'?"),
        ({"young_modulus_Pa": "0.65 MPa"}, "expected a number"),
        ({"material": {"model": "yeho"}}, "did you mean 'yeoh'?"),
    ],
)
def test_refusals(change: dict[str, Any], expected: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        Mechanism.from_dict(NECK | {"length_m": 0.1034} | change, tmp_path / "neck.toml")
    message = str(caught.value)
    assert expected in message or ("mesh" in change and "does not exist" in message)


def test_a_material_table_gives_the_moduli() -> None:
    table = {k: v for k, v in NECK.items() if k not in ("young_modulus_Pa", "poisson_ratio")}
    material = {"model": "neo_hookean", "young_modulus_Pa": 0.65e6, "poisson_ratio": 0.49}
    assert Mechanism.from_dict(table | {"material": material}) == Mechanism()


def _scales(low: float, high: float) -> st.SearchStrategy[float]:
    """Numbers between two limits, as many in each decade."""
    return st.floats(math.log(low), math.log(high)).map(math.exp)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    shape=st.sampled_from(["cylinder", "tube", "hourglass", "stacked_discs"]),
    length=_scales(1.1e-3, 9.9),
    slender=_scales(1e-6, 9.9),
    share=_scales(1e-4, 0.999),
    discs=st.integers(2, 8),
    quality=st.sampled_from(["standard", "fine"]),
)
def test_every_body_is_meshed_or_refused_by_the_name_of_a_dimension(
    shape: str, length: float, slender: float, share: float, discs: int, quality: str
) -> None:
    radius = slender * length
    body = Mechanism(
        builtin=shape,
        length_m=length,
        radius_m=radius,
        inner_radius_m=(1.0 - share) * radius,
        waist_radius_m=share * radius,
        disc_count=discs,
        quality=quality,
    )
    if share >= 0.01 and slender * share >= 2e-5:
        assert body.mesh().volume_m3 > 0.0
        return
    with suppress(FemError):  # some are still meshed
        body.mesh()
        return
    with pytest.raises(FemError, match=r"^(radius_m|inner_radius_m|waist_radius_m) is .*expected"):
        body.mesh()
