"""The physics model of a rod: its own Cosserat rod, not the solid of its size."""

from __future__ import annotations

import numpy as np
import pytest

from ecm import _native
from ecm.effects import get_effect
from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.description import Meta
from ecm.io.mechanism import Mechanism
from ecm.io.table import Table
from ecm.models import PhysicsMap, physics_map
from ecm.models.joint_fit import joint_fit
from ecm.models.layout import plain
from ecm.models.literature import RodMap
from ecm.models.physics.body_fits import workspace_poses
from ecm.models.physics.build import BuildSettings, build_family, shape_of, stated_rod
from ecm.models.physics.family import PARAMETERS, PhysicsFamily
from ecm.regression.noise import Noise
from support.neck import columns_of

SECTIONS = {
    "axial_stiffness_N": 2200.0,
    "shear_stiffness_N": 650.0,
    "bending_stiffness_Nm2": 0.6,
    "torsion_stiffness_Nm2": 0.4,
}
ROD = Mechanism.from_dict({"builtin": "rod", "length_m": 0.1, "radius_m": 0.033, **SECTIONS})


@pytest.fixture(scope="module")
def rod() -> PhysicsMap:
    """Built here; from the tests' cache folder where the code is the same."""
    return physics_map(ROD, settings=BuildSettings(poses=40, test_poses=10))


def poses_of(wrenches: F, mechanism: Mechanism = ROD) -> F:
    poses, ok = _native.rod_poses(
        np.ascontiguousarray(wrenches), length_m=mechanism.length_m, **mechanism.rod_sections()
    )
    assert ok.all()
    return poses


def wrenches(count: int, seed: int) -> F:
    high = np.array([30.0, 40.0, 40.0, 1.0, 2.5, 2.5])
    return np.random.default_rng(seed).uniform(-high, high, (count, 6))


def test_a_family_that_is_read_again_gives_the_bits_of_the_built_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A job that was interrupted goes on with the family of its cache: the same figures."""
    # Poses as they are drawn: to choose among many takes longer than all the rest.
    drawn = workspace_poses(np.diag([2e4, 4e3, 4e3, 4.0, 16.0, 16.0]), 30, seed=1)
    monkeypatch.setattr("ecm.models.physics.build.spread_poses", lambda *of, **options: drawn)
    built = build_family(shape_of(ROD), BuildSettings(poses=30, test_poses=8))
    read = PhysicsFamily.from_dict(plain(built))
    poses = poses_of(wrenches(20, 3))
    values = dict(zip(PARAMETERS, (0.65e6, 0.47, 0.1, 0.0653), strict=True))
    for name in values:
        expected = built.derivative(values, name).predict(poses)
        np.testing.assert_array_equal(read.derivative(values, name).predict(poses), expected)


def test_it_is_the_rod_that_was_stated(rod: PhysicsMap) -> None:
    """Cosserat rod from its own wrenches, by shooting, not from the inverse that the fit used."""
    h = wrenches(200, 1)
    error = rod.predict(poses_of(h)) - h
    noise = np.array([0.9, 0.4, 0.4, 0.012, 0.014, 0.014])
    assert float(np.sqrt(((error / noise) ** 2).mean())) < 0.1
    # The solid of that size is stiffer across: it would miss the lateral force by far more.
    assert rod.own_error[1] < 0.05


def test_modulus_and_poisson_ratio_scale_the_sections(rod: PhysicsMap) -> None:
    values = dict(rod.values or {})
    stiff, other = dict(SECTIONS), values["poisson_ratio"] - 0.03
    for name in ("shear_stiffness_N", "torsion_stiffness_Nm2"):
        stiff[name] *= (1.0 + values["poisson_ratio"]) / (1.0 + other)
    h = wrenches(100, 2)
    mechanism = Mechanism.from_dict({"builtin": "rod", "length_m": 0.1, **stiff})
    error = rod.at(poisson_ratio=other).predict(poses_of(h, mechanism)) - h
    assert np.sqrt((error**2).mean(axis=0))[:3].max() < 0.15


def test_a_rod_of_sections_alone_has_the_circle_that_they_imply() -> None:
    known = Mechanism(builtin="rod", radius_m=0.02, young_modulus_Pa=1e6)
    bare = Mechanism.from_dict({"builtin": "rod", "length_m": 0.1034, **known.rod_sections()})
    found = stated_rod(bare)
    assert found.radius_m == pytest.approx(0.02, rel=1e-9)
    assert found.young_modulus_Pa == pytest.approx(1e6, rel=1e-9)


def test_copies_of_another_size_share_a_shape() -> None:
    small = Mechanism(builtin="rod", radius_m=0.033, length_m=0.1034, young_modulus_Pa=0.65e6)
    large = Mechanism(builtin="rod", radius_m=0.066, length_m=0.2068, young_modulus_Pa=2e6)
    thick = Mechanism(builtin="rod", radius_m=0.05, length_m=0.1034, young_modulus_Pa=0.65e6)
    assert shape_of(small).key() == shape_of(large).key()
    assert shape_of(small).key() != shape_of(thick).key()


def test_a_pose_that_one_leap_does_not_reach_is_walked_to() -> None:
    """Close to buckling the linear rod is a bad first guess."""
    h = np.array([[-81.0, 28.0, 22.0, 0.24, 0.37, -2.0], [-70.0, 35.0, 64.0, 0.95, 2.9, -2.9]])
    neck = Mechanism.from_dict(
        {"builtin": "rod", "length_m": 0.1034, "axial_stiffness_N": 2224.0,
         "shear_stiffness_N": 640.0, "bending_stiffness_Nm2": 0.605,
         "torsion_stiffness_Nm2": 0.406}
    )  # fmt: skip
    poses = poses_of(h, neck)
    rod = RodMap(0.1034, np.array(list(neck.rod_sections().values())))
    found, stiffness = rod.wrench_and_stiffness(poses)
    assert np.abs(found - h).max() < 1e-6
    # The slope is that of the wrench itself.
    step = 1e-6 * np.eye(6)[1]
    ahead = (rod.predict(poses + step) - rod.predict(poses - step)) / 2e-6
    assert stiffness[:, :, 1] == pytest.approx(ahead, rel=1e-3, abs=1.0)


def test_a_body_file_of_a_rod_needs_no_modulus() -> None:
    assert ROD.young_modulus_Pa == 0.0
    assert ROD.has_body
    assert stated_rod(ROD).rod_sections() == SECTIONS


def test_gains_stay_small_where_nu_stands_at_its_bound(rod: PhysicsMap) -> None:
    """All gains and the modulus are one to the data: a bound on nu must not set them adrift."""
    softer = dict(SECTIONS)
    for name in ("shear_stiffness_N", "torsion_stiffness_Nm2"):
        softer[name] *= 0.95
    body = Mechanism.from_dict({"builtin": "rod", "length_m": 0.1, **softer})
    h = wrenches(80, 4)
    poses = poses_of(h, body)
    columns = columns_of(poses, h)
    table = Table(columns, Meta(mechanism=ROD.to_dict()), "softer")
    found = joint_fit(rod, (get_effect("fts_gain"),), table, Noise(source="declared"))
    assert found.base.coefficients[1] == pytest.approx(0.5, abs=1e-6)
    assert np.abs(found.effects[0].values).max() < 0.1
    assert np.sqrt((found.residual**2).mean(axis=0))[:3].max() < 3.0


def test_no_solid_stands_in_for_a_rod() -> None:
    with pytest.raises(InputError, match="builtin = 'cylinder'"):
        stated_rod(ROD).fem()
