"""Chambers, tendons and windings from the settings of a mechanism to the table of its pairs."""

from __future__ import annotations

import numpy as np
import pytest

from ecm.errors import InputError
from ecm.fem.simulate import Workspace, solve_wrenches
from ecm.io.mechanism import Mechanism, Tendon

SHAPE = {
    "builtin": "chambered",
    "length_m": 0.1,
    "radius_m": 0.02,
    "chamber_count": 3,
    "chamber_inner_m": 0.0075,
    "chamber_outer_m": 0.0165,
    "young_modulus_Pa": 3e5,
}
NECK = {"builtin": "cylinder", "length_m": 0.1, "radius_m": 0.03, "young_modulus_Pa": 6.5e5}


def arm(**more: object) -> Mechanism:
    return Mechanism.from_dict(SHAPE | more)


def test_tendons_and_windings_reach_the_table_and_come_back_from_their_file() -> None:
    body = arm(tendon_count=3, tendon_offset_m=0.0185, tendon_guides=3, winding_stiffness_N_m=2e4)
    assert Mechanism.from_dict(body.to_dict()) == body
    table = solve_wrenches(
        body, np.zeros((1, 6)), pressures_Pa=[[1e4, 0.0, 0.0]], tensions_N=[[0.5, 0.0, 0.0]]
    ).table()
    assert table.actuation_columns == body.actuators
    assert table.actuation_columns[2:4] == ("pressure_3_Pa", "tension_1_N")
    assert table.matrix(body.actuators).tolist() == [[1e4, 0.0, 0.0, 0.5, 0.0, 0.0]]
    # The tendon at +y is wound in, the two beyond the axis let out.
    wound_in = table.matrix(body.amounts)[0, 3:]
    assert wound_in[0] > 0.0 > max(wound_in[1:])


def test_windings_turn_swelling_into_lengthening() -> None:
    def lengthened(**winding: float) -> float:
        pairs = solve_wrenches(arm(**winding), np.zeros((1, 6)), pressures_Pa=[[2e4] * 3])
        return float(pairs.poses[0, 0]) - 0.1

    rings, fibres = (
        lengthened(winding_stiffness_N_m=5e4, winding_angle_rad=angle) for angle in (0.0, 1.3)
    )
    assert rings > 0.0 > fibres  # McKibben's muscle shortens below 54.7 degrees to the axis


def test_threads_through_a_region_turn_the_arm_where_they_are_one_screw() -> None:
    def tip(second: float | None) -> np.ndarray:
        body = arm(
            winding_on="body",
            winding_stiffness_Pa=1e6,
            winding_angle_rad=0.6,
            winding_second_angle_rad=second,
        )
        assert Mechanism.from_dict(body.to_dict()) == body
        pairs = solve_wrenches(body, np.zeros((1, 6)), pressures_Pa=[[2e4] * 3])
        assert pairs.status == ("solved",)
        return np.asarray(pairs.poses[0])

    both, rings, screw = (tip(second) for second in (None, 0.0, 0.6))
    assert abs(both[3]) < 1e-3
    # A right-handed screw that is swollen turns back.
    assert screw[3] < 1.5 * rings[3] < -0.05


def test_given_volumes_and_lengths_are_the_other_side_of_pressures_and_tensions() -> None:
    body = arm(tendons=[{"base_m": [[0, 0.03, 0]], "platform_m": [[0.1, 0.03, 0]]}])
    load = np.array([[0.5, 0.1, 0.0, 0.0, 0.0, 0.0]])
    given = {"pressures_Pa": [[8e3, 1e3, 0.0]], "tensions_N": [[0.8]]}
    driven = solve_wrenches(body, load, **given)
    held = solve_wrenches(
        body, load, volumes_m3=driven.amounts[:, :3], lengths_m=driven.amounts[:, 3:]
    )
    np.testing.assert_allclose(held.actuation, driven.actuation, rtol=1e-5, atol=1e-2)
    np.testing.assert_allclose(held.poses, driven.poses, atol=1e-8)
    with pytest.raises(InputError, match="found both pressures_Pa and volumes_m3"):
        solve_wrenches(body, load, pressures_Pa=[[0.0] * 3], volumes_m3=[[0.0] * 3])
    with pytest.raises(InputError, match=r"tensions_N has shape \(1, 2\), expected \(1, 1\)"):
        solve_wrenches(body, load, tensions_N=[[0.0] * 2])


def test_a_tendon_of_points_of_its_own_bends_the_neck_towards_it() -> None:
    neck = Mechanism.from_dict(
        NECK | {"tendons": [{"base_m": [[0, 0.04, 0]], "platform_m": [[0.1, 0.035, 0]]}]}
    )
    assert neck.tendons == (Tendon(base_m=((0.0, 0.04, 0.0),), platform_m=((0.1, 0.035, 0.0),)),)
    pairs = solve_wrenches(neck, np.zeros((1, 6)), lengths_m=[[5e-3]])
    assert pairs.status == ("solved",)
    assert pairs.actuation[0, 0] > 1.0
    assert pairs.poses[0, 5] > 0.05
    assert pairs.amounts[0, 0] == pytest.approx(5e-3, rel=1e-6)


def test_wrong_actuators_are_refused_in_the_words_of_their_settings() -> None:
    with pytest.raises(InputError, match="tendon_count needs tendon_offset_m"):
        arm(tendon_count=3)
    with pytest.raises(InputError, match=r"tendons\[0\].*a tendon has 1 points"):
        arm(tendons=[{"base_m": [[0, 0, 0]]}])
    with pytest.raises(InputError, match=r"base_m: found \[0\.0, 0\.0\], expected \[x, y, z\]"):
        arm(tendons=[{"base_m": [[0, 0]], "platform_m": [[0, 0]]}])
    with pytest.raises(InputError, match="has either winding_stiffness_N_m, on a surface, or wind"):
        arm(winding_stiffness_N_m=1e4, winding_stiffness_Pa=1e6).mesh()
    with pytest.raises(InputError, match="winding on `sleeve`: the mesh has no such region"):
        arm(winding_stiffness_Pa=1e6, winding_on="sleeve").mesh()
    with pytest.raises(InputError, match="winding_second_angle_rad = nan: expected a finite"):
        arm(winding_stiffness_Pa=1e6, winding_second_angle_rad=float("nan"))
    body = arm(tendon_count=2, tendon_offset_m=0.019)
    with pytest.raises(InputError, match="tension_max_N has 3 numbers, the mechanism 2 tendons"):
        Workspace(tension_max_N=(1.0, 2.0, 3.0)).box(body)
    low, high = Workspace(pressure_max_Pa=(1e4,), tension_max_N=(2.0,)).box(body)
    assert (low[6:] == 0.0).all()
    assert high[6:].tolist() == [1e4] * 3 + [2.0] * 2


def test_what_was_solved_of_bodies_without_actuators_stays_valid() -> None:
    assert Mechanism.from_dict(NECK).key() == Mechanism(**NECK).key()
    assert Mechanism().key() != arm(tendon_count=1, tendon_offset_m=0.01).key()
