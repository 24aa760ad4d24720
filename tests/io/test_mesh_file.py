"""Bodies from files: meshio's formats with their ways of naming faces, CAD through gmsh."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from ecm._native import Mesh
from ecm.errors import InputError, MissingExtra
from ecm.io.mechanism import Mechanism
from ecm.io.mesh import read_mesh
from ecm.io.table import read_table
from ecm.models.physics.map import physics_map
from support.driven import PRESSURES
from support.neck import Command

LENGTH, RADIUS = 0.1, 0.03
BODY = Mesh.chambered(
    length_m=LENGTH, radius_m=RADIUS, chamber_count=3, chamber_inner_m=0.01, chamber_outer_m=0.025,
    chamber_angle_rad=0.0, quality="1x4x6",
)  # fmt: skip
FACES = ((0, 2, 1, 6, 5, 4), (0, 1, 3, 4, 8, 7), (1, 2, 3, 5, 9, 8), (0, 3, 2, 7, 9, 6))
MATERIAL = {"young_modulus_Pa": 0.7e6, "poisson_ratio": 0.49}


def _triangles(nodes: Any) -> np.ndarray[Any, Any]:
    on = np.isin(np.arange(len(BODY.nodes_m)), nodes)
    sides = [BODY.tetrahedra[:, face] for face in FACES]
    return np.concatenate([side[on[side].all(axis=1)] for side in sides])


def _write(path: Path, how: str, *, leave_out: str = "", straight: bool = False) -> Path:
    """The body in a format of meshio, its faces named in one of the ways of that format."""
    meshio = pytest.importorskip("meshio", reason="needs the extra `mesh` (meshio)")
    corners = 4 if straight else 10
    kinds = ("tetra", "triangle") if straight else ("tetra10", "triangle6")
    points, cells = np.asarray(BODY.nodes_m), np.asarray(BODY.tetrahedra)[:, :corners]
    named = {"base": BODY.base_nodes, "top": BODY.top_nodes, **dict(BODY.chambers)}
    named = {name: nodes for name, nodes in named.items() if name != leave_out}
    sides = {name: _triangles(nodes)[:, : 3 if straight else 6] for name, nodes in named.items()}
    blocks = [(kinds[0], cells)]
    if how == "point arrays":
        data = {n: np.isin(np.arange(len(points)), nodes) * 1.0 for n, nodes in named.items()}
        mesh = meshio.Mesh(points, blocks, point_data=data)
    elif how == "node sets":
        mesh = meshio.Mesh(points, blocks, point_sets=dict(named))
    elif how == "physical groups":
        blocks += [(kinds[1], side) for side in sides.values()]
        blocks += [(kinds[0], cells[:9])]  # a second group, as Gmsh 2.2 writes it
        tags = [np.full(len(block[1]), i, dtype=np.int32) for i, block in enumerate(blocks)]
        mesh = meshio.Mesh(
            points,
            blocks,
            cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
            field_data={name: np.array([i + 1, 2]) for i, name in enumerate(sides)},
        )
    else:
        blocks += [(kinds[1], side) for side in sides.values()]
        arrays = {
            name: [
                np.full(len(block[1]), i == k + 1, dtype=float) for i, block in enumerate(blocks)
            ]
            for k, name in enumerate(sides)
        }
        mesh = meshio.Mesh(points, blocks, cell_data=arrays)
    options = {"file_format": "gmsh22"} if path.suffix == ".msh" else {}
    meshio.write(path, mesh, **options)
    return path


@pytest.mark.parametrize(
    ("name", "how"),
    [
        ("neck.vtu", "point arrays"),
        ("neck.vtu", "triangle arrays"),
        ("neck.vtk", "triangle arrays"),
        ("neck.inp", "node sets"),
        ("neck.msh", "physical groups"),
    ],
)
def test_meshes_of_other_programs_are_the_same_body(tmp_path: Path, name: str, how: str) -> None:
    path = _write(tmp_path / name, how)
    body = Mechanism.from_dict({"mesh": name, **MATERIAL}, path.with_suffix(".toml"))
    assert body.length_m == pytest.approx(LENGTH, abs=1e-12)
    assert body.actuators == PRESSURES
    assert Mechanism(mesh_file=str(path), **MATERIAL) == body  # type: ignore[arg-type]
    found = body.mesh()
    np.testing.assert_array_equal(found.tetrahedra, BODY.tetrahedra)
    np.testing.assert_array_equal(found.top_nodes, BODY.top_nodes)
    np.testing.assert_allclose(found.nodes_m, BODY.nodes_m, atol=1e-9)
    for (own, wall), (known, nodes) in zip(found.chambers, BODY.chambers, strict=True):
        assert own == known
        np.testing.assert_array_equal(wall, nodes)


def test_an_arm_of_ones_own_mesh_is_simulated_as_typed(
    tmp_path: Path, ecm_command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What `ecm new arm` writes, with a mesh in place of its shape."""
    monkeypatch.chdir(tmp_path)
    _write(tmp_path / "body.vtu", "point arrays")
    assert ecm_command("new", "arm").code == 0
    text = Path("arm.toml").read_text(encoding="utf-8")
    assert '"body.msh"' in text
    shape = r"(?m)^(builtin|length_m|radius_m|chamber_\w+|channel_radius_m|end_wall_m) .*\n"
    text = re.sub(shape, "", text).replace("[mechanism]", '[mechanism]\nmesh = "body.vtu"\n#')
    few = text.replace("n = 100\nn_test = 20", "n = 3\nn_test = 1")
    Path("arm.toml").write_text(few, encoding="utf-8")
    ecm_command("simulate", "arm.toml", "--out", "pairs.csv").good()
    table = read_table(Path("pairs.csv"), need="fit")
    assert len(table) == 3
    assert table.matrix(PRESSURES).min() > 0.0


def test_a_mesh_in_millimetres_is_said_to_be_one(tmp_path: Path) -> None:
    meshio = pytest.importorskip("meshio", reason="needs the extra `mesh` (meshio)")
    path = _write(tmp_path / "neck.vtu", "point arrays")
    mesh = meshio.read(path)
    mesh.points *= 1e3
    mesh.write(path)
    with pytest.raises(InputError, match=r"neck.vtu: this mesh is 100 m long.*scale its points by"):
        Mechanism(mesh_file=path, **MATERIAL)
    stated = Mechanism(mesh_file=path, length_m=0.1, **MATERIAL)
    for use in (stated.fem, lambda: physics_map(stated)):
        with pytest.raises(InputError, match=r"length_m = 0.1: leave .* scale its points by 0.001"):
            use()


def test_straight_tetrahedra_get_nodes_on_their_edges(tmp_path: Path) -> None:
    found = read_mesh(_write(tmp_path / "neck.vtu", "triangle arrays", straight=True))
    assert len(found.nodes_m) == len(BODY.nodes_m)
    assert len(found.base_nodes) == len(BODY.base_nodes)
    assert len(found.top_nodes) == len(BODY.top_nodes)
    assert [len(wall) for _, wall in found.chambers] == [len(wall) for _, wall in BODY.chambers]
    # Straight edges cut off the rim.
    assert 0.8 < found.volume_m3 / BODY.volume_m3 < 0.9


def test_broken_files_say_what_is_missing(tmp_path: Path) -> None:
    meshio = pytest.importorskip("meshio", reason="needs the extra `mesh` (meshio)")
    with pytest.raises(InputError, match=r"no face named `top` \(groups and arrays found: base,"):
        read_mesh(_write(tmp_path / "lid.vtu", "point arrays", leave_out="top"))
    flat = tmp_path / "flat.vtu"
    meshio.write(flat, meshio.Mesh(np.eye(3), [("triangle", [[0, 1, 2]])]))
    with pytest.raises(InputError, match=r"no tetrahedra \(cells: triangle\)"):
        read_mesh(flat)
    brick = tmp_path / "brick.vtu"
    points = np.random.default_rng(1).random((12, 3))
    cells = [("tetra", [[8, 9, 10, 11]]), ("hexahedron", [list(range(8))])]
    meshio.write(brick, meshio.Mesh(points, cells))
    with pytest.raises(InputError, match="tetrahedra only"):
        read_mesh(brick)
    (tmp_path / "empty.vtu").write_text("", encoding="utf-8")
    with pytest.raises(InputError, match="meshio cannot read"):
        read_mesh(tmp_path / "empty.vtu")
    (tmp_path / "neck.bdf").write_text("", encoding="utf-8")
    with pytest.raises(InputError, match=r"meshio cannot read.*BEGIN BULK"):
        read_mesh(tmp_path / "neck.bdf")
    (tmp_path / "neck.xyz").write_text("", encoding="utf-8")
    with pytest.raises(InputError, match="unknown kind of mesh file"):
        read_mesh(tmp_path / "neck.xyz")
    with pytest.raises(InputError, match="does not exist"):
        read_mesh(tmp_path / "none.vtu")


@pytest.mark.parametrize(
    ("name", "error", "kind", "message"),
    [
        ("a.vtu", ImportError("meshio"), MissingExtra, r"meshio.*\(extra mesh\)"),
        ("a.step", ImportError("gmsh"), MissingExtra, r"gmsh.*\(extra cad\)"),
        ("a.step", OSError("libGLU.so.1: cannot open"), InputError, "libglu1-mesa"),
    ],
)
def test_a_missing_extra_or_system_library_is_named(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    name: str,
    error: Exception,
    kind: type[Exception],
    message: str,
) -> None:
    monkeypatch.setattr("ecm.io.extras.import_module", Mock(side_effect=error))
    (tmp_path / name).write_text("x", encoding="utf-8")
    with pytest.raises(kind, match=message):
        read_mesh(tmp_path / name)


def _cad(
    path: Path, *, axis: int = 0, solids: int = 1, ball: bool = False, scale: float = 1.0
) -> Path:
    """A cylinder of 100 x 30 mm, as CAD programs write it: in millimetres, without names."""
    gmsh = pytest.importorskip("gmsh", reason="needs the extra `cad` (gmsh)")
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Verbosity", 0)
        # It survives finalize, and is the unit of what is written, too.
        gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
        along = [0.0, 0.0, 0.0]
        along[axis] = 100.0 * scale
        for i in range(solids):
            if ball:
                gmsh.model.occ.addSphere(0.0, 0.0, 0.0, 30.0)
            else:
                gmsh.model.occ.addCylinder(0.0, 200.0 * i, 0.0, *along, 30.0 * scale)
        gmsh.model.occ.synchronize()
        gmsh.write(str(path))
    finally:
        gmsh.finalize()
    return path


def test_a_step_file_becomes_the_same_mechanism(tmp_path: Path) -> None:
    _cad(tmp_path / "neck.step")
    body = Mechanism.from_dict({"mesh": "neck.step", **MATERIAL}, tmp_path / "neck.toml")
    assert body.length_m == pytest.approx(LENGTH, rel=1e-9)
    mesh = body.mesh()
    assert mesh.volume_m3 == pytest.approx(np.pi * RADIUS**2 * LENGTH, rel=2e-3)
    assert 400 < len(mesh.nodes_m) < 2500
    # Two meshes of one body, each within 1 % of the limit.
    own = Mechanism(length_m=LENGTH, radius_m=RADIUS, young_modulus_Pa=0.7e6)
    wrench = np.array([[-20.0, 10.0, 5.0, 0.2, -0.3, 0.3]])
    a, b = (m.fem().solve_wrenches(wrench) for m in (body, own))
    assert a.status == b.status == ["solved"]
    moved = [r.poses[0] - [LENGTH, 0.0, 0.0, 0.0, 0.0, 0.0] for r in (a, b)]
    for part in (slice(3), slice(3, 6)):
        far = np.linalg.norm((moved[0] - moved[1])[part]) / np.linalg.norm(moved[1][part])
        assert far < 0.015
    fine = Mechanism.from_dict(
        {"mesh": "neck.step", "quality": "fine", **MATERIAL}, tmp_path / "neck.toml"
    )
    assert len(fine.mesh().nodes_m) > 2 * len(mesh.nodes_m)
    assert fine.key() != body.key()


def test_cad_that_is_no_mechanism_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="found 2 solids"):
        read_mesh(_cad(tmp_path / "two.step", solids=2))
    with pytest.raises(InputError, match="no face lies flat at the smallest x"):
        read_mesh(_cad(tmp_path / "upright.step", axis=2))
    with pytest.raises(InputError, match="no face lies flat"):
        read_mesh(_cad(tmp_path / "ball.step", ball=True))
    small = _cad(tmp_path / "metres.step", scale=1e-3)
    with pytest.raises(InputError, match="is it in metres"):
        Mechanism.from_dict({"mesh": small.name, **MATERIAL}, base=tmp_path)
    (tmp_path / "text.step").write_text("no CAD", encoding="utf-8")
    with pytest.raises(InputError, match=r"text\.step: gmsh cannot mesh"):
        read_mesh(tmp_path / "text.step")
