"""The physical truths of the plant against closed forms and independent integration."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ecm.errors import ComputationError
from ecm.io.arrays import F
from ecm.io.se3 import rotate, rotation, seen_from
from ecm.rig.instruments import zero_at
from ecm.rig.physics import Conditions
from ecm.rig.physics.body import FaceTilt, NaturalBend, PlatformSlip
from ecm.rig.physics.camera import BaseFrame, MarkerMotion, TipTarget
from ecm.rig.physics.load import BasePlate, Cable, Payload
from ecm.rig.physics.material import Hysteresis, Relaxation, Softening, Temperature
from ecm.rig.physics.sensor import SensorWarmUp
from support.stand_in import REST, L, some_poses, stiffness, wrench

ROOT = np.array([1.0, 1.0, 1.0, L, L, L])


class TestHysteresis:
    friction = Hysteresis(1e-3, yield_m=2e-3, exponent=1.5, beta=0.6)

    def test_a_long_way_ends_on_the_unit_ball_along_the_way(self) -> None:
        way = np.array([0.0, 0.02, -0.01, 0.2, 0.0, 0.3])
        state = self.friction.states([(np.stack([REST, REST + way]), True)], L)[0]
        assert state == pytest.approx(way * ROOT / np.linalg.norm(way * ROOT), abs=1e-3)

    def test_the_held_wrench_is_the_elastic_one_of_the_size(self) -> None:
        k0 = stiffness(REST[None])[0]
        along_y = np.array([[0.0, 1.0, 0.0, 0.0, 0.0, 0.0]])
        held = self.friction.wrench(along_y, k0, L)[0]
        assert held == pytest.approx(1e-3 * k0[:, 1])

    def test_the_same_pose_from_two_sides_differs_and_a_loop_costs_work(self) -> None:
        end = REST + np.array([0.0, 0.01, 0.0, 0.0, 0.0, 0.0])
        beyond = REST + np.array([0.0, 0.03, 0.0, 0.0, 0.0, 0.0])
        legs = [
            (np.stack([REST, end]), True),
            (np.stack([end, beyond, end]), False),
            (np.stack([end, REST]), False),
        ]
        out, back, _ = self.friction.states(legs, L)
        assert out[1] > 0.99
        assert back[1] < -0.99

    def test_the_transition_is_that_of_the_differential_equation(self) -> None:
        n, beta, u = 1.5, 0.6, 2e-3

        def rate(s: float, z: F) -> F:
            work = z[0]
            return np.array([1.0 - z[0] * abs(z[0]) ** (n - 2) * (beta * abs(work) + 0.4 * work)])

        distance = 1.3 * u
        exact = solve_ivp(rate, (0.0, distance / u), [1e-9], rtol=1e-9).y[0, -1]
        end = REST + np.array([0.0, distance, 0.0, 0.0, 0.0, 0.0])
        state = self.friction.states([(np.stack([REST, end]), True)], L)[0]
        assert state[1] == pytest.approx(exact, abs=0.01)

    def test_a_rest_forgets(self) -> None:
        way = np.stack([REST, REST + np.array([0.0, 0.02, 0.0, 0.0, 0.0, 0.0])])
        states = self.friction.states([(way, True), (way[::-1], True)], L)
        assert states[1] == pytest.approx(-states[0])


def test_temperature_has_the_slope_of_its_size_and_bends() -> None:
    hot = Temperature(-0.01, reference_degC=22.0)
    step = 1e-3

    def factor(*degrees: float) -> F:
        return hot.factor(Conditions(L, temperature_degC=np.array(degrees)))

    slope = np.diff(factor(22.0 - step, 22.0 + step))[0] / (2 * step)
    assert slope == pytest.approx(-0.01, rel=1e-6)
    below, above = factor(12.0, 32.0) - 1.0
    assert abs(below + above) > 1e-3


class TestBasePlate:
    plate = BasePlate(2e-3, uneven=0.2)

    def test_plate_and_mechanism_are_in_equilibrium(self) -> None:
        poses = some_poses(20)
        world = self.plate.solve(poses, L, wrench)
        at_base = world.copy()
        at_base[:, 3:] += np.cross(poses[:, :3], world[:, :3])
        moved = self.plate.compliance(L) * at_base
        relative = wrench(seen_from(moved, poses))
        turn = rotation(moved[:, 3:])
        assert rotate(turn, relative[:, :3]) == pytest.approx(world[:, :3], abs=1e-6)
        assert rotate(turn, relative[:, 3:]) == pytest.approx(world[:, 3:], abs=1e-7)

    def test_it_softens(self) -> None:
        pose = REST[None] + np.array([[0.0, 0.01, 0.0, 0.0, 0.0, 0.0]])
        assert 0.0 < self.plate.solve(pose, L, wrench)[0, 1] < wrench(pose)[0, 1]

    def test_a_plate_that_holds_nothing_is_an_error(self) -> None:
        with pytest.raises(ComputationError, match="no equilibrium"):
            BasePlate(5.0).solve(some_poses(5), L, wrench)


def test_a_turned_target_is_seen_turned_in_the_axes_of_the_platform() -> None:
    poses = some_poses(10)
    target = TipTarget(0.01, axis=(0.0, 0.0, 1.0), shift_m_rad=(0.02, 0.0, 0.0))
    seen = target.measured(poses, Conditions(L))
    offset = seen_from(poses, seen)
    assert offset == pytest.approx(np.tile([2e-4, 0, 0, 0, 0, 0.01], (10, 1)), abs=1e-12)


def test_weight_pulls_along_gravity_wherever_the_platform_looks() -> None:
    poses = some_poses(10)
    gravity = np.array([-9.81, 0.0, 0.0])
    shares, places = (0.7, 0.3), ((0.03, 0.0, 0.01), (0.0, 0.02, 0.0))
    weight = Payload(0.5, shares=shares, places_m=places).weight(poses, gravity)
    assert weight[:, :3] == pytest.approx(np.tile(0.5 * gravity, (10, 1)))
    centre = 0.7 * np.array(places[0]) + 0.3 * np.array(places[1])
    arm = rotate(rotation(poses[:, 3:]), np.tile(centre, (10, 1)))
    assert weight[:, 3:] == pytest.approx(np.cross(arm, weight[:, :3]))


def test_a_taut_cable_pulls_towards_its_clamp_and_a_slack_one_does_not() -> None:
    poses = some_poses(10)
    taut = Cable(50.0, clamp_m=(0.1, 0.4, 0.0), free_m=0.2)
    at = Conditions(L, poses=poses)
    pull = taut.load(at)
    place = poses[:, :3] + rotate(rotation(poses[:, 3:]), np.tile(taut.place_m, (10, 1)))
    way = np.array([0.1, 0.4, 0.0]) - place
    assert np.cross(pull[:, :3], way) == pytest.approx(np.zeros((10, 3)), abs=1e-9)
    stretch = np.linalg.norm(way, axis=1) - 0.2
    assert np.linalg.norm(pull[:, :3], axis=1) == pytest.approx(50.0 * stretch, rel=0.01)
    assert pull[:, 3:] == pytest.approx(np.cross(place - poses[:, :3], pull[:, :3]))
    assert np.abs(Cable(50.0, clamp_m=(0.1, 0.4, 0.0), free_m=1.0).load(at)).max() < 0.02


def test_a_slip_changes_the_poses_after_it_and_keeps_the_work() -> None:
    poses, at = some_poses(10), Conditions(L, time_s=np.linspace(0.0, 100.0, 10))
    slip = PlatformSlip(0.002, direction=(0.0, 1.0, 0.0, 0.0, 0.0, 0.5), at_s=50.0)
    felt = slip.body_pose(poses, at)
    assert felt[:5] == pytest.approx(poses[:5])
    jump = np.array([0.0, 0.002, 0.0, 0.0, 0.0, 0.01])
    assert seen_from(poses[5:], felt[5:]) == pytest.approx(np.tile(jump, (5, 1)), abs=1e-12)
    h = wrench(felt)
    moved = slip.platform_wrench(h, poses, felt, at)
    # A wrench about two points does the same work on a rotation about the platform's origin.
    spin = np.array([0.1, -0.2, 0.3])
    velocity = np.cross(spin, felt[:, :3] - poses[:, :3])
    power = np.sum(h[:, :3] * velocity, axis=1) + h[:, 3:] @ spin
    assert moved[:, 3:] @ spin == pytest.approx(power)


def test_a_marker_that_creeps_moves_everything_the_other_way() -> None:
    poses, at = some_poses(3), Conditions(L, time_s=np.array([0.0, 600.0, 3600.0]))
    creep = MarkerMotion(1e-3, direction=(0.0, 1.0, 0.0, 0.0, 0.0, 0.0), time_s=600.0)
    shift = (creep.measured(poses, at) - poses)[:, 1]
    assert shift == pytest.approx([0.0, -1e-3 * np.log(2.0) / np.log(7.0), -1e-3])


def test_a_base_frame_error_moves_the_base_itself() -> None:
    error = BaseFrame(0.01, axis=(0.0, 0.0, 1.0), shift_m_rad=(0.0, 0.1, 0.0))
    at_base = error.measured(np.zeros((1, 6)), Conditions(L))
    assert at_base == pytest.approx(np.array([[0.0, 1e-3, 0.0, 0.0, 0.0, 0.01]]))


def test_relaxation_is_the_maxwell_chain_under_a_ramp() -> None:
    tau, travel, dwell = 3.0, 5.0, 4.0
    chain = Relaxation(0.2, shares=(1.0,), times_s=(tau,))

    def rate(t: float, stress: F) -> F:
        return (1.0 / travel if t < travel else 0.0) - stress / tau

    options = {"rtol": 1e-9, "atol": 1e-12, "max_step": 0.01}
    held = solve_ivp(rate, (0.0, travel + dwell), [0.0], **options).y[0, -1]
    at = Conditions(L, travel_s=np.array([travel]), dwell_s=np.array([dwell]))
    factor = chain.factor(at)[0]
    assert factor == pytest.approx(1.0 + 0.2 * held, rel=1e-3)


def test_relaxation_goes_on_along_a_way_of_several_pieces() -> None:
    tau, size = 3.0, 0.2
    chain = Relaxation(size, shares=(1.0,), times_s=(tau,))
    time, path = np.array([0.0, 2.0, 5.0, 7.0, 9.0]), np.array([0.0, 1.0, 1.0, -0.5, 0.0])

    def rate(t: float, stress: F) -> F:
        piece = min(int(np.searchsorted(time, t, side="right")), 4)
        return (path[piece] - path[piece - 1]) / (time[piece] - time[piece - 1]) - stress / tau

    options = {"rtol": 1e-9, "atol": 1e-12, "max_step": 0.01}
    exact = solve_ivp(rate, (0.0, 9.0), [0.0], t_eval=time, **options).y[0]
    h = np.zeros((5, 6))
    h[:, 2] = path
    held = chain.held(h, time, np.zeros(5, dtype=bool))
    assert held[:, 2] == pytest.approx(size * exact, abs=1e-4)
    # A single ramp and its rest is what a reading at rest has.
    at = Conditions(L, travel_s=np.array([2.0]), dwell_s=np.array([3.0]))
    factor = chain.factor(at)[0]
    assert held[2, 2] == pytest.approx(factor - 1.0, rel=1e-12)
    restart = np.array([False, False, True, False, False])
    assert chain.held(h, time, restart)[2] == pytest.approx(np.zeros(6), abs=0.0)


def test_relaxing_stress_turns_with_the_middle_of_the_body() -> None:
    """A pull along x that has not relaxed yet, after a turn of the top by 0.6 rad about z."""
    chain = Relaxation(0.2, shares=(1.0,), times_s=(1e9,))
    angle, reach, pull = 0.6, 0.1, 50.0
    along = np.array([np.cos(0.5 * angle), np.sin(0.5 * angle), 0.0])
    poses = np.zeros((3, 6))
    poses[:2, 0] = reach
    poses[2, :3], poses[2, 5] = reach * along, angle
    h = np.zeros((3, 6))
    h[1, 0] = pull
    h[2, :3] = pull * along
    found = chain.along(poses, h, np.arange(3.0), np.zeros(3, dtype=bool))
    # The section's resultant has not changed by the turn: no torque, the same pull along it.
    assert found[2, :3] == pytest.approx(0.2 * pull * along, rel=1e-8)
    assert found[2, 3:] == pytest.approx(np.zeros(3), abs=1e-9)


def test_softening_spares_first_visits_and_takes_later_ones() -> None:
    factor = Softening(0.1, energy_J=0.3).factor_of(np.array([0.1, 0.5, 1.5, 0.5, 1.5]))
    assert factor[[0, 1, 2, 4]] == pytest.approx(1.0)
    assert 0.9 < factor[3] < 0.95


@pytest.mark.parametrize("part", [FaceTilt(0.01, 0.7), NaturalBend(0.01, 0.7)])
def test_a_remount_turns_what_is_the_mechanisms_own(part: FaceTilt | NaturalBend) -> None:
    # A body that is turned by a half turn with its defect looks as one with the opposite defect.
    poses, h = some_poses(10, 3), np.random.default_rng(4).normal(size=(10, 6))
    opposite = replace(part, size=-part.size)
    half, straight = (Conditions(L, mount_rad=np.full(10, turn)) for turn in (np.pi, 0.0))
    body = part.body_pose(poses, half)
    same = opposite.body_pose(poses, straight)
    assert body == pytest.approx(same, abs=1e-12)
    turned = opposite.platform_wrench(h, poses, same, straight)
    assert part.platform_wrench(h, poses, body, half) == pytest.approx(turned, abs=1e-12)
    assert not np.allclose(body, part.body_pose(poses, straight), atol=1e-4)


def test_linear_compensation_leaves_only_the_curvature_of_the_warm_up() -> None:
    time = np.linspace(0.0, 3600.0, 100)
    warm_up = SensorWarmUp(1.0, time_s=3600.0)
    at = Conditions(L, time_s=time, walk=np.zeros((100, 6)))
    drift = warm_up.reading(np.zeros((100, 6)), at)
    ends = np.array([0, 99])
    left = drift - zero_at(time, time[ends], drift[ends], "linear")
    assert np.abs(left[:, 0]).max() == pytest.approx(0.0779, abs=1e-4)
    lost = drift - zero_at(time, time[ends], drift[ends], "linear", later_readings_lost=True)
    assert lost[-1, 0] == pytest.approx(1.0 - np.exp(-1.0))


def test_before_takes_the_last_reading() -> None:
    zero = zero_at(np.array([0.5, 1.5, 2.0]), np.array([0.0, 1.0]), np.eye(6)[:2], "before")
    assert zero == pytest.approx(np.eye(6)[[0, 1, 1]])
    none = zero_at(np.array([0.5]), np.array([0.0]), np.eye(6)[:1], "none")
    assert none == pytest.approx(np.zeros((1, 6)))
