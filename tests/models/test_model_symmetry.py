"""K_sym, K_skew, with and without the load's geometric part; energies have no other skew part."""

from __future__ import annotations

import numpy as np
import pytest

from ecm import _native
from ecm.models import EnergyMap, fit_model
from ecm.models.prediction import symmetry_of
from support.campaigns import campaign, workspace_poses


@pytest.mark.parametrize(
    "name", ["energy4", "energy6", "energy5-revolution", "energy4-general", "energy6+face_tilt"]
)
def test_an_energys_skew_part_is_that_of_its_load(name: str) -> None:
    base = fit_model(campaign(seed=3), name).base
    assert isinstance(base, EnergyMap)
    poses = workspace_poses(50, 21)
    k, h = base.stiffness(poses), base.predict(poses)
    found = symmetry_of(k, poses, h)
    size = np.abs(k).max(axis=(1, 2))
    assert np.all(np.abs(found.skew_left).max(axis=(1, 2)) < 1e-12 * size)
    np.testing.assert_allclose(found.share_without_geometry, 1.0, atol=1e-12)
    # The load's part is there: K alone is not symmetric.
    assert np.all(np.abs(found.skew).max(axis=(1, 2)) > 1e-6 * size)
    np.testing.assert_allclose(found.symmetric + found.skew, k, atol=1e-14 * size.max())
    generalised = base.stiffness(poses, "generalised")
    turned = np.swapaxes(generalised, 1, 2)
    assert np.all(np.abs(generalised - turned).max(axis=(1, 2)) <= 1e-12 * size)


def test_a_free_cubic_is_left_with_a_skew_part_of_its_own() -> None:
    base = fit_model(campaign(seed=3), "cubic").base
    poses = workspace_poses(50, 21)
    found = symmetry_of(base.stiffness(poses), poses, base.predict(poses))
    rotation = found.skew_left[:, 3:, 3:]
    assert np.median(np.abs(rotation).max(axis=(1, 2))) > 1e-3
    assert np.all(found.share <= 1.0 + 1e-12)
    # At rest without load nothing is to be taken away.
    home = np.array([[0.1034, 0.0, 0.0, 0.0, 0.0, 0.0]])
    rest = symmetry_of(base.stiffness(home), home, np.zeros((1, 6)))
    np.testing.assert_allclose(rest.share, rest.share_without_geometry, rtol=1e-12)


def test_kinds_of_stiffness_by_hand() -> None:
    """A pure torque on a body whose K_s is its load's geometric part alone plus a unit matrix."""
    torque = np.array([[0.0, 0.0, 0.0, 0.3, -0.2, 0.5]])
    pose = np.array([[0.1034, 0.0, 0.0, 0.0, 0.0, 0.0]])
    cross = np.array([[0.0, -0.5, -0.2], [0.5, 0.0, -0.3], [0.2, 0.3, 0.0]])
    screw = np.eye(6)[None].copy()
    screw[0, 3:, 3:] -= 0.5 * cross
    k = _native.convert_stiffness(screw, pose, torque, source="screw", target="partial")
    found = symmetry_of(k, pose, torque)
    np.testing.assert_allclose(found.skew_left, 0.0, atol=1e-15)
    assert found.share[0] < 1.0
