"""`ecm simulate --vtu`: what ParaView is given, read back by meshio."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ecm._native import Mesh, rotation_matrices
from ecm.cli import run
from ecm.io.columns import POSE
from ecm.io.table import read_table

LENGTH, RADIUS = 0.1034, 0.033
CONFIG = f"""
[mechanism]
builtin = "cylinder"
length_m = {LENGTH}
radius_m = {RADIUS}
young_modulus_Pa = 0.65e6
poisson_ratio = 0.49

[simulate]
n = 12
n_test = 2
"""


def test_files_hold_displacement_stretch_and_stress(tmp_path: Path) -> None:
    meshio = pytest.importorskip("meshio", reason="needs the extra `mesh` (meshio)")
    (tmp_path / "neck.toml").write_text(CONFIG, encoding="utf-8")
    out, bodies = tmp_path / "pairs.csv", tmp_path / "bodies"
    arguments = ["simulate", str(tmp_path / "neck.toml"), "--out", str(out), "--vtu", str(bodies)]
    assert run([*arguments, "--quiet"]) == 0
    table = read_table(out)
    files = sorted(bodies.glob("*.vtu"))
    assert len(table) == 12
    assert [f.name for f in files] == [f"pose_{i:03d}.vtu" for i in range(10)]
    body = Mesh.cylinder(length_m=LENGTH, radius_m=RADIUS)
    for i, file in enumerate(files[:3]):
        found = meshio.read(file)
        np.testing.assert_allclose(found.points, body.nodes_m, atol=1e-12)
        (cells,) = found.cells
        assert cells.type == "tetra10"
        np.testing.assert_array_equal(cells.data, body.tetrahedra)
        # The platform's nodes follow the pose of the table, the base stays.
        moved = found.point_data["displacement_m"]
        pose = np.array([table.columns[name][i] for name in POSE])
        turn = rotation_matrices(pose[None, 3:])[0]
        arms = body.nodes_m[body.top_nodes] - [LENGTH, 0.0, 0.0]
        expected = pose[:3] + arms @ turn.T - body.nodes_m[body.top_nodes]
        np.testing.assert_allclose(moved[body.top_nodes], expected, atol=1e-6)
        assert not moved[body.base_nodes].any()
        data = {name: values[0] for name, values in found.cell_data.items()}
        # Means of an element against the largest at a point.
        largest = data["largest_stretch"].max()
        assert 1.05 < largest <= table.columns["largest_stretch"][i] * (1.0 + 1e-6)
        assert data["jacobian"].min() >= table.columns["smallest_jacobian"][i] - 1e-6
        assert abs(data["jacobian"].mean() - 1.0) < 0.01
        stress = data["stress_Pa"].reshape(-1, 3, 3)
        np.testing.assert_allclose(stress, stress.transpose(0, 2, 1), atol=1e-3)
        deviator = stress - np.trace(stress, axis1=1, axis2=2)[:, None, None] / 3.0 * np.eye(3)
        mises = np.sqrt(1.5 * (deviator**2).sum(axis=(1, 2)))
        np.testing.assert_allclose(data["von_mises_Pa"].ravel(), mises, rtol=1e-6)
        # A soft body of 0.65 MPa stretched by some per cent: kPa to MPa, not Pa or GPa.
        assert 1e4 < mises.max() < 1e7
