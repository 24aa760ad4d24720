"""The finite elements from Python: materials, elements, own weight, wrenches of one's own."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ecm._native import Fem, FemError, Mesh, WarmStart
from ecm.errors import InputError
from ecm.fem.simulate import (
    TABLE_I_MAX,
    TABLE_I_MIN,
    Workspace,
    fem_poses,
    simulate,
    solve_wrenches,
)
from ecm.io.mechanism import Mechanism
from ecm.io.table import read_table
from support.meshes import block_mesh
from support.neck import Command, saved

WRENCH = np.array([[-20.0, 10.0, 5.0, 0.2, -0.3, 0.3]])
NECK = {"builtin": "cylinder", "length_m": 0.1034, "radius_m": 0.033}


def test_a_yeoh_solid_without_higher_terms_is_neo_hookean() -> None:
    plain = Mechanism()
    mu = plain.young_modulus_Pa / (2.0 * (1.0 + plain.poisson_ratio))
    material = {"model": "yeoh", "c1_Pa": 0.5 * mu, "c2_Pa": 0.0, "c3_Pa": 0.0}
    yeoh = Mechanism.from_dict(NECK | {"material": material})
    assert yeoh.young_modulus_Pa == pytest.approx(plain.young_modulus_Pa, rel=1e-12)
    assert Mechanism.from_dict(yeoh.to_dict()) == yeoh
    a, b = (m.fem().solve_wrenches(WRENCH) for m in (plain, yeoh))
    np.testing.assert_allclose(a.poses, b.poses, rtol=1e-8, atol=1e-10)
    assert yeoh.key() != plain.key()


@pytest.mark.parametrize(
    "material",
    [
        {"model": "mooney_rivlin", "c10_Pa": 8e4, "c01_Pa": 3e4},
        {"model": "ogden", "mu_Pa": [1.6e5, 6e4], "alpha": [1.7, -2.0]},
        {"model": "gent", "shear_modulus_Pa": 2.2e5, "j_m": 30.0, "poisson_ratio": 0.495},
        {
            "model": "neo_hookean",
            "young_modulus_Pa": 0.65e6,
            "fibre_direction": [1.0, 0.0, 0.0],
            "fibre_k1_Pa": 5e4,
            "fibre_k2": 1.0,
        },
    ],
)
def test_materials_scale_with_their_modulus(material: dict[str, object]) -> None:
    body = Mechanism.from_dict(NECK | {"material": material})
    law = body.material and body.material.scaled(2.0)
    double = replace(body, material=law, young_modulus_Pa=2.0 * body.young_modulus_Pa)
    poses = body.fem().solve_wrenches(WRENCH)
    assert poses.status == ["solved"]
    scaled = double.fem().solve_wrenches(2.0 * WRENCH)
    np.testing.assert_allclose(scaled.poses, poses.poses, rtol=1e-8, atol=1e-10)


def test_wrong_materials_are_refused() -> None:
    for material, word in (
        ({"model": "gent", "shear_modulus_Pa": 2e5}, "j_m"),
        ({"model": "gent", "shear_modulus_Pa": 2e5, "jm": 3.0}, "unknown key 'jm'"),
        ({"model": "yeoh", "c1_Pa": "a", "c2_Pa": 0.0, "c3_Pa": 0.0}, "expected a number"),
        ({"model": "yeoh", "c1_Pa": 1e5, "c2_Pa": -1e5, "c3_Pa": 1.0}, "'yeoh': c_Pa.*C1"),
    ):
        with pytest.raises(InputError, match=word):
            Mechanism.from_dict(NECK | {"material": material})


def test_elements_bracket_and_unknown_ones_are_refused() -> None:
    mesh = Mesh.cylinder(length_m=0.1034, radius_m=0.033)
    stiffness = [
        Fem(mesh, young_modulus_Pa=0.72e6, poisson_ratio=0.49, element=element).rest_stiffness()[
            1, 1
        ]
        for element in ("P2/P0", "P2/P1", "P2")
    ]
    assert stiffness[0] < 4000.0 < stiffness[1] < stiffness[2]
    with pytest.raises(FemError, match="P2/P1"):
        Fem(mesh, young_modulus_Pa=0.72e6, poisson_ratio=0.49, element="P1")  # type: ignore[arg-type]


def test_arrays_make_a_mesh() -> None:
    mesh = Mesh.cylinder(length_m=0.1, radius_m=0.03)
    faces = {"base_nodes": mesh.base_nodes, "top_nodes": mesh.top_nodes}
    again = Mesh.from_arrays(mesh.nodes_m, mesh.tetrahedra, **faces)
    assert again.volume_m3 == pytest.approx(mesh.volume_m3)
    wrong = mesh.tetrahedra.copy()
    wrong[3, 2] = -1
    with pytest.raises(FemError, match="tetrahedron 3"):
        Mesh.from_arrays(mesh.nodes_m, wrong, **faces)
    with pytest.raises(FemError, match="expected 10"):
        Mesh.from_arrays(mesh.nodes_m, np.ascontiguousarray(wrong[:, :4]), **faces)


def test_own_weight_sags() -> None:
    body = replace(Mechanism(), density_kg_m3=1100.0)
    rest = np.zeros((1, 6))
    hanging = body.fem(gravity_m_s2=(-9.81, 0.0, 0.0)).solve_wrenches(rest)
    # A free column sags by rho g L^2 / (2 E); the bonded one a little less.
    free = 1100.0 * 9.81 * body.length_m**2 / (2.0 * body.young_modulus_Pa)
    assert 0.8 < (body.length_m - hanging.poses[0, 0]) / free < 1.0


def test_results_say_why_and_how_far() -> None:
    mesh = Mesh.cylinder(length_m=0.1034, radius_m=0.033, quality="1x4x6")
    body = Fem(mesh, young_modulus_Pa=0.65e6, poisson_ratio=0.49)
    found = body.solve_wrenches(np.array([[-260.0, 0.0, 0.0, 0.0, 0.0, 0.0], WRENCH[0]]))
    assert found.status == ["unstable", "solved"]
    assert found.reason[0].startswith("buckling")
    assert found.reason[1] == ""
    np.testing.assert_allclose(found.hessian[1], found.hessian[1].T, rtol=1e-6, atol=1e-6)
    assert 0.3 < found.stretch_ratio[1] < 1.0


def test_a_picture_is_of_a_wrench_or_of_a_pose(tmp_path: Path) -> None:
    with pytest.raises(FemError, match="either wrench or pose"):
        Mechanism().fem().write_vtu(str(tmp_path / "neck.vtu"))


def test_stacked_discs_are_softer_than_the_cylinder() -> None:
    discs = Mechanism.from_dict(
        NECK
        | {
            "builtin": "stacked_discs",
            "waist_radius_m": 0.025,
            "disc_count": 4,
            "young_modulus_Pa": 0.65e6,
        }
    )
    assert Mechanism.from_dict(discs.to_dict()) == discs
    soft, plain = discs.fem().rest_stiffness(), Mechanism().fem().rest_stiffness()
    assert (np.diag(soft) < 0.9 * np.diag(plain)).all()
    with pytest.raises(InputError, match="disc_count"):
        replace(discs, disc_count=1)


def test_hostile_meshes_loads_and_warm_starts_are_refused_by_the_package() -> None:
    with pytest.raises(FemError, match="at most 200000"):
        Mesh.cylinder(length_m=0.1, radius_m=0.03, quality="200x200x200")
    body = Fem(Mesh.cylinder(length_m=0.1, radius_m=0.03, quality="1x2x4"), young_modulus_Pa=1e6)
    # Degree 1000 would ask for all memory.
    hostile = np.array([1000, 462], dtype="<u4").tobytes() + bytes(48 + 4 * 462)
    with pytest.raises(FemError, match="not a warm start"):
        WarmStart(hostile)
    for value in (np.nan, np.inf):
        with pytest.raises(FemError, match="finite"):
            body.solve_wrenches(np.full((1, 6), value))
    far = body.solve_wrenches(np.full((1, 6), 1e300))
    assert far.status[0] != "solved"
    with pytest.raises(FemError, match="shear modulus times volume"):
        Fem(Mesh.cylinder(length_m=1e-100, radius_m=1e-100), young_modulus_Pa=1e-100)


def test_wrenches_of_ones_own_are_solved_in_their_order(tmp_path: Path) -> None:
    saved(tmp_path / "block.msh", block_mesh())
    soft = {"mesh": "block.msh", "young_modulus_Pa": 1e5, "poisson_ratio": 0.49}
    block = Mechanism.from_dict(soft, base=tmp_path)
    wrenches = np.concatenate([WRENCH, [[-500.0, 0, 0, 0, 0, 0]], 0.5 * WRENCH])
    pairs = solve_wrenches(block, wrenches.tolist())
    assert pairs.status == ("solved", "unstable", "solved")
    assert pairs.counts == {"solved": 2, "unstable": 1, "failed": 0}
    np.testing.assert_array_equal(pairs.wrenches, wrenches)
    assert np.isnan(pairs.poses[1]).all()
    assert np.isnan(pairs.stiffness[1]).all()
    # The body carries the wrench at this pose: the other direction finds it again.
    back = block.fem().solve_poses(np.ascontiguousarray(pairs.poses[[0, 2]]))
    np.testing.assert_allclose(back.wrenches, wrenches[[0, 2]], atol=1e-5)
    table = pairs.table()
    np.testing.assert_array_equal(table.wrenches, wrenches[[0, 2]])
    none = solve_wrenches(block, np.empty((0, 6)))
    assert none.status == ()
    assert none.stiffness.shape == (0, 6, 6)


@pytest.mark.parametrize(
    ("wrenches", "words"),
    [
        (np.zeros(6), r"shape \(6,\), expected \(N, 6\).*list of its own"),
        (np.zeros((3, 5)), r"shape \(3, 5\), expected \(N, 6\)"),
        (3, r"shape \(\), expected \(N, 6\)"),
        ("a file.csv", "a str that is no array of numbers"),
        ([[1.0, 2.0], [3.0]], "a list that is no array of numbers"),
        (np.full((2, 6), [[0.0], [np.nan]]), "row 1, fx_N is nan, expected a finite number"),
    ],
)
def test_what_is_no_wrench_is_refused(wrenches: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        solve_wrenches(Mechanism(), wrenches)


def test_a_box_that_hardly_moves_the_body_is_warned_about() -> None:
    pairs = solve_wrenches(Mechanism(length_m=8.0, radius_m=2.0), WRENCH)
    assert "move the body by at most" in pairs.warnings[0]
    assert "8000 mm, and E, 6.5e+05 Pa" in pairs.warnings[0]
    assert not solve_wrenches(Mechanism(), WRENCH).warnings


def test_a_modulus_in_kilopascal_is_asked_about(tmp_path: Path, ecm_command: Command) -> None:
    box = f"wrench_min = {[-0.01] * 6}\nwrench_max = {[0.01] * 6}"
    shape = 'builtin = "cylinder"\nlength_m = 0.1\nradius_m = 0.03\nyoung_modulus_Pa = 650.0'
    config = f"[mechanism]\n{shape}\n[workspace]\n{box}\n[simulate]\nn = 2\n"
    path = saved(tmp_path / "soft.toml", config)
    done = ecm_command("simulate", path, "--out", tmp_path / "pairs.csv").good()
    assert "E = 650 Pa, and rubber has 1e4 or more: is it in Pa?" in done.err


def test_pairs_in_another_folder_find_their_mesh(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    body = Mechanism(mesh_file=saved(Path("block.msh"), block_mesh()), young_modulus_Pa=1e6)
    Path("out").mkdir()
    solve_wrenches(body, 0.1 * WRENCH).table().write("out/pairs.csv")
    assert 'mesh = "../block.msh"' in Path("out/pairs.toml").read_text(encoding="utf-8")
    found = read_table(Path("out/pairs.csv")).physics_body
    assert found is not None
    assert found.mesh().length_m == pytest.approx(0.1)


def test_functions_that_draw_point_to_the_one_that_solves_given_wrenches() -> None:
    for function in (simulate, fem_poses):
        draw: Any = function
        with pytest.raises(InputError, match=r"ecm\.solve_wrenches\(mechanism, wrenches\)"):
            draw(Mechanism(), WRENCH)
        with pytest.raises(InputError, match=r"a str, expected an ecm\.Mechanism"):
            draw("neck.toml", 3)
    solve: Any = solve_wrenches
    with pytest.raises(InputError, match=r"a dict, expected an ecm\.Mechanism"):
        solve(NECK, WRENCH)


def test_loads_that_nobody_states_are_those_of_the_body() -> None:
    neck, small = Mechanism(), Mechanism(length_m=0.06, radius_m=0.012, young_modulus_Pa=4e5)
    low, high = Workspace().box(neck)
    np.testing.assert_array_equal(low, TABLE_I_MIN)
    # E I / L^2 of forces, E I / L of moments, to that of the neck.
    moment = 4.0 / 6.5 * (12.0 / 33.0) ** 4 / (0.06 / 0.1034)
    expected = high * np.repeat([moment / (0.06 / 0.1034), moment], 3)
    np.testing.assert_allclose(Workspace().box(small)[1], expected)
    np.testing.assert_array_equal(Workspace(wrench_max=TABLE_I_MAX).box(small)[1], TABLE_I_MAX)
