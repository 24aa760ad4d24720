"""Wrench errors as pose errors: against a nonlinear solution, and what is left out."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import root

import ecm
from ecm._native import rotation_matrices, rotation_vectors
from ecm.io.arrays import F
from ecm.io.table import Table
from ecm.models import Model, PhysicsMap, fit_model
from ecm.models.evaluation import pose_error
from ecm.regression.noise import Noise
from support.neck import Command, columns_of

REST = np.array([0.1034, 0.0, 0.0, 0.0, 0.0, 0.0])


def table_of(poses: F, wrenches: F) -> Table:
    columns = columns_of(poses, wrenches)
    return ecm.as_table(columns, meta={"mechanism": {"length_m": REST[0]}})


def bent_poses(count: int, seed: int) -> F:
    """Bends by up to 1 rad, on the chord of their arc, with some shear, twist and stretch."""
    random = np.random.default_rng(seed)
    poses = np.zeros((count, 6))
    poses[:, 3:] = random.uniform(-0.6, 0.6, (count, 3))
    half = rotation_matrices(0.5 * poses[:, 3:])
    bend = np.linalg.norm(poses[:, 4:], axis=1)
    chord = REST[0] * np.sinc(0.5 * bend / np.pi)
    poses[:, :3] = half[:, :, 0] * chord[:, None] + random.uniform(-2e-3, 2e-3, (count, 3))
    return poses


def test_the_change_brings_the_model_to_the_measured_wrench(neck_physics: PhysicsMap) -> None:
    """h(p + dp) = h + dh solved by Newton's method, at rotations where J is not I."""
    poses = bent_poses(12, 0)
    truth = neck_physics.predict(poses)
    dh = np.random.default_rng(1).standard_normal((12, 6)) * [1e-3, 1e-3, 1e-3, 1e-5, 1e-5, 1e-5]
    found = pose_error(Model(base=neck_physics), table_of(poses, truth + dh), dh)
    assert found.position_mm is not None
    assert found.rotation_deg is not None
    assert found.row.tolist() == list(range(1, 13))
    scale = np.array([1.0, 1.0, 1.0, 0.1, 0.1, 0.1])
    turned = np.zeros(12)
    for i, pose in enumerate(poses):

        def left(q: F, i: int = i) -> F:
            return np.asarray((neck_physics.predict(q[None])[0] - truth[i] - dh[i]) / scale)

        solved = root(left, pose, tol=1e-14).x
        np.testing.assert_allclose(found.change[i], solved - pose, rtol=2e-3, atol=1e-9)
        moved = np.linalg.norm(solved[:3] - pose[:3])
        assert found.position_mm[i] == pytest.approx(1e3 * moved, rel=2e-3)
        both = rotation_matrices(np.stack([solved[3:], pose[3:]]))
        turned[i] = np.degrees(np.linalg.norm(rotation_vectors((both[0] @ both[1].T)[None])))
    np.testing.assert_allclose(found.rotation_deg, turned, rtol=2e-3)
    plain = np.degrees(np.linalg.norm(found.change[:, 3:], axis=1))
    assert np.abs(plain / turned - 1.0).max() > 0.02, "the rotation vector's length is no angle"


def test_noise_alone_gives_what_noise_gives(neck_physics: PhysicsMap) -> None:
    """Pose noise through K and back is the pose noise; the sensor's comes on top."""
    poses, model = np.tile(REST, (4000, 1)), Model(base=neck_physics)
    poses += 1e-7 * np.random.default_rng(5).standard_normal(poses.shape)
    noise = Noise(3e-5, 2e-4, 0.05, 0.002, "declared")
    random = np.random.default_rng(6)
    wrong = poses + random.standard_normal(poses.shape) * np.repeat([3e-5, 2e-4], 3)
    dh = model.predict(wrong) - model.predict(poses)
    dh += random.standard_normal(poses.shape) * np.repeat([0.05, 0.002], 3)
    table = table_of(poses, model.predict(poses) + dh)
    found = pose_error(model, table, dh, noise=noise)
    assert found.position_mm is not None
    assert found.rotation_deg is not None
    rms = [np.sqrt((v**2).mean()) for v in (found.position_mm, found.rotation_deg)]
    assert [found.noise_mm, found.noise_deg] == pytest.approx(rms, rel=0.05)
    pose_only = pose_error(model, table, dh, noise=Noise(3e-5, 2e-4, 1e-9, 1e-9, "declared"))
    assert pose_only.noise_mm == pytest.approx(1e3 * 3e-5 * np.sqrt(3.0), rel=1e-3)


def test_rows_that_buckle_are_left_out_with_their_count(neck_physics: PhysicsMap) -> None:
    """Shortened by 30 % the neck is past the load at which it buckles: the pose is not held."""
    poses = np.concatenate([bent_poses(8, 2), REST + np.zeros((3, 6))])
    poses[8:, 0] *= [0.69, 0.7, 0.71]
    dh = np.full((11, 6), 1e-3)
    found = pose_error(Model(base=neck_physics), table_of(poses, dh + np.arange(11)[:, None]), dh)
    assert found.left_out.tolist() == [9, 10, 11]
    assert found.row.tolist() == list(range(1, 9))
    assert "3 of 11 rows are left out" in found.sentence()
    assert found.to_dict()["left_out"] == 3


def test_a_model_that_determines_no_pose_says_so() -> None:
    """A constant curvature has no shear: K is singular everywhere."""
    poses = bent_poses(30, 3)
    wrenches = (poses - REST) * [2e4, 4e3, 4e3, 4.0, 17.0, 17.0]
    model = fit_model(table_of(poses, wrenches), "constant-curvature", force=True)
    found = ecm.compare(model, table_of(poses, wrenches)).pose_error
    assert (len(found.row), len(found.left_out)) == (0, 30)
    assert found.sentence().startswith("No pose error: 30 of 30 rows are left out")
    document = found.to_dict()
    assert document["position_mm"] is None
    assert document["worst_rows"] == []


def test_an_axis_without_stiffness_leaves_its_rows_out() -> None:
    table = ecm.as_table({name: np.linspace(-1e-2, 1e-2, 20) for name in Floating.columns})
    found = pose_error(Floating(), table, np.zeros((20, 2)))
    assert (len(found.row), len(found.left_out)) == (0, 20)


class Floating:
    """Held along z, free along y."""

    columns = ("y_m", "z_m", "fy_N", "fz_N")
    inputs, outputs = columns[:2], columns[2:]

    @property
    def base(self) -> Floating:
        return self

    def stiffness(self, poses: F, kind: str = "partial") -> F:
        return np.tile(np.diag([0.0, 3000.0]), (len(poses), 1, 1))


@pytest.mark.parametrize(
    ("columns", "axes", "mm", "degrees"),
    [
        pytest.param({"fx_N": 1e4}, ("x_m",), 0.1, None, id="one force"),
        pytest.param({"fx_N": 1e4, "fy_N": 0.0}, ("x_m",), 0.1, None, id="padded with zeros"),
        pytest.param({"tau_z_Nm": 8.0}, ("theta_z_rad",), None, 57.2957795, id="one moment"),
        pytest.param({"tau_x_Nm": 8.0}, (), None, None, id="a moment on another axis"),
    ],
)
def test_axes_without_their_wrench_are_held(
    columns: dict[str, float], axes: tuple[str, ...], mm: float | None, degrees: float | None
) -> None:
    """An error of 1 N over 1e4 N/m, of 8 N m over 8 N m/rad."""
    s = np.linspace(-0.01, 0.01, 11)
    pose = "theta_z_rad" if "tau_z_Nm" in columns else "x_m"
    data = {pose: s, "y_m": 0.0 * s} | {name: k * s for name, k in columns.items()}
    table = ecm.as_table(data)
    found = pose_error(
        fit_model(table, "linear"), table, np.tile([1.0 if mm else 8.0] * len(columns), (11, 1))
    )
    assert found.axes == axes
    for values, expected in ((found.position_mm, mm), (found.rotation_deg, degrees)):
        assert (values is None) == (expected is None)
        if values is not None and expected is not None:
            np.testing.assert_allclose(values, expected, rtol=1e-6)
    if not axes:
        assert found.sentence().startswith("No pose error: it needs a pose column that varies")


def test_every_face_says_the_same(tmp_path: Path, neck_csv: Path, ecm_command: Command) -> None:
    """`ecm fit`, the model file, its fit report, `ecm compare` with its JSON and page."""
    model, fitted, found, page = (tmp_path / name for name in ("m.json", "f", "c", "p.html"))
    done = ecm_command("fit", neck_csv, "--model", "quadratic", "--out", model, "--json", fitted)
    own = json.loads(fitted.read_text(encoding="utf-8"))["pose_error"]
    assert own["sentence"] in done.out
    opened = ecm.load_model(model)
    assert opened.training["pose_error"] == own
    assert own["sentence"] in str(opened)
    done = ecm_command("compare", model, neck_csv, "--json", found, "--report", page)
    said = json.loads(found.read_text(encoding="utf-8"))["pose_error"]
    assert said["position_mm"]["median"] == pytest.approx(own["position_mm"]["median"], rel=1e-9)
    assert said["sentence"] in done.out
    assert re.search(rf"^{said['worst_rows'][0]['row']} +[\d.]+ +[\d.]+$", done.out, re.MULTILINE)
    text = page.read_text(encoding="utf-8")
    assert said["sentence"] in text
    assert "As pose error" in text
