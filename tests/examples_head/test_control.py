"""The controller in C: allocation, observer, and set points with a model and with a wrong one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmark import exportable, largest_turns, uncontrolled
from compiled import CompiledController, build_plugin, compile_controller
from ecm import ComputationError, InputError, Model, fit
from experiment import Robot
from motions import Motions, held_pose
from observer import holding_forces, static_slope
from robot import (
    Body,
    Control,
    HeadSettings,
    PoseSensor,
    Tendons,
    displaced,
    gravity_wrench,
    tendon_lengths,
    tendon_matrix,
)
from support.head_example import closed_neck, neck_pairs
from support.neck import LENGTH_M, columns_of

POSE = ("x_m", "y_m", "z_m", "theta_x_rad", "theta_y_rad", "theta_z_rad")
WRENCH = ("fx_N", "fy_N", "fz_N", "tau_x_Nm", "tau_y_Nm", "tau_z_Nm")
SETTINGS = HeadSettings(plant_step_s=1e-3)  # half the work; test_plant.py shows convergence


def fitted(kind: str, softer: float = 1.0) -> Model:
    poses, _ = neck_pairs(120, seed=1)
    wrenches = softer * closed_neck().elastic.predict(poses)
    columns = columns_of(poses, wrenches)
    return fit(columns, kind, meta={"mechanism": {"length_m": LENGTH_M}})


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return compile_controller(fitted("energy4-revolution"), tmp_path_factory.mktemp("head"))


def test_the_wrench_of_a_tendon_is_minus_the_slope_of_its_length() -> None:
    tendons = Tendons()
    pose = np.array([0.1, 0.003, -0.002, 0.1, -0.2, 0.15])
    matrix = tendon_matrix(tendons, pose)
    for i, twist in enumerate(1e-6 * np.eye(6)):
        ahead, behind = (displaced(pose, s * twist) for s in (1.0, -1.0))
        slope = (tendon_lengths(tendons, ahead) - tendon_lengths(tendons, behind)) / 2e-6
        assert np.allclose(matrix[i], -slope, atol=1e-8)


def test_the_allocation_in_c_is_that_of_scipy_within_the_limits(library: Path) -> None:
    neck = closed_neck()
    controller = CompiledController(library, SETTINGS, neck.rest, LENGTH_M)
    random = np.random.default_rng(2)
    at_limits = 0
    for pose in neck_pairs(60, seed=3)[0]:
        wrench, stiffness = neck.statics(pose)
        need = wrench - gravity_wrench(SETTINGS, pose) + random.normal(0.0, 1.0, 6)
        forces, limited = controller.hold(pose, need, stiffness)
        expected = holding_forces(SETTINGS, pose, need, stiffness, LENGTH_M)
        assert np.allclose(forces, expected, atol=0.02)
        at_limits += limited > 0
    assert 5 < at_limits < 60  # both kinds were there


def test_a_held_pose_is_in_equilibrium_and_its_forces_are_found_again(library: Path) -> None:
    neck = closed_neck()
    turned = np.array([0.05, -0.1, 0.08])
    held = held_pose(neck, SETTINGS, turned)
    assert held.held
    wrench, stiffness = neck.statics(held.pose)
    need = wrench - gravity_wrench(SETTINGS, held.pose)
    assert np.allclose(tendon_matrix(SETTINGS.tendons, held.pose) @ held.forces_N, need, atol=1e-6)
    controller = CompiledController(library, SETTINGS, held.pose, LENGTH_M)
    assert np.allclose(controller.hold(held.pose, need, stiffness)[0], held.forces_N, atol=0.01)


def test_four_tendons_turn_the_head_and_leave_two_directions_uncontrolled() -> None:
    neck = closed_neck()
    turns = largest_turns(neck, SETTINGS, step_rad=0.05)
    assert (turns >= 0.1).all()
    assert np.allclose(turns[[0, 2], 0], turns[[0, 2], 1])  # the head is alike to both sides
    held = held_pose(neck, SETTINGS, np.zeros(3))
    left = uncontrolled(neck, SETTINGS, held.pose)
    # A change of the forces moves the equilibrium, but not along these directions.
    scale = np.repeat([1.0, LENGTH_M], 3)
    stiffness = neck.statics(held.pose)[1]
    for change in np.eye(4):
        moved = np.linalg.solve(stiffness, tendon_matrix(SETTINGS.tendons, held.pose) @ change)
        assert np.abs(left @ (scale * moved)).max() < 1e-9 * np.linalg.norm(scale * moved)
    assert np.allclose(left @ left.T, np.eye(2))


def test_a_right_model_holds_the_head_and_a_soft_one_does_not(
    library: Path, plugin: Path, tmp_path: Path
) -> None:
    neck = closed_neck()
    motions = Motions(neck, SETTINGS)
    motion = motions.set_points(((0.0, 0.1, -0.08),))
    plain = replace(SETTINGS, control=Control(integral_per_s=0.0))
    right = Robot(plain, neck, library, plugin).run(motion).figures()
    soft = compile_controller(fitted("energy4-revolution", softer=0.8), tmp_path)
    wrong = Robot(plain, neck, soft, plugin).run(motion).figures()
    assert right["settled_mm"] < 0.3
    assert right["settled_deg"] < 0.2
    assert wrong["settled_mm"] > 4.0 * right["settled_mm"]
    assert right["least_force_N"] > 0.0
    # The integral takes most of it away at rest.
    mended = Robot(SETTINGS, neck, soft, plugin).run(motion).figures()
    assert mended["settled_mm"] < 0.3 * wrong["settled_mm"]
    assert mended["settled_deg"] < 0.3 * wrong["settled_deg"]


def test_the_integral_asks_for_the_forces_that_move_the_equilibrium(library: Path) -> None:
    neck = closed_neck()
    held = held_pose(neck, SETTINGS, np.array([0.05, -0.1, 0.08]))
    stiffness = neck.statics(held.pose)[1]
    slope = static_slope(neck.statics, SETTINGS, held.pose, LENGTH_M)
    moved = np.linalg.solve(slope, tendon_matrix(SETTINGS.tendons, held.pose))
    controller = CompiledController(library, SETTINGS, held.pose, LENGTH_M)
    away = np.array([0.0, 1e-3, -5e-4, 0.01, -0.004, 0.008])
    found = controller.reach(held.pose, stiffness, held.forces_N, away)
    weighted = np.repeat([1.0, LENGTH_M], 3)[:, None] * moved
    bounded = weighted.T @ weighted + 1e-8 * np.eye(4)  # (0.1 mm/N)^2
    expected = np.linalg.solve(bounded, weighted.T @ (np.repeat([1.0, LENGTH_M], 3) * away))
    assert np.allclose(found, expected, rtol=1e-4, atol=1e-4)


def test_the_motors_do_not_wait_for_an_error_of_force(library: Path, plugin: Path) -> None:
    neck = closed_neck()
    nod = Motions(neck, SETTINGS).nod(1.5, 1.0)
    assert Robot(SETTINGS, neck, library, plugin).run(nod).figures()["tracking_deg"] < 0.3


def test_a_heavy_head_stands_still_in_its_softest_direction(library: Path, plugin: Path) -> None:
    neck, settings = closed_neck(), replace(SETTINGS, body=Body(mass_kg=4.5))
    motion = Motions(neck, settings).set_points(((-0.08, 0.1, 0.1),))
    record = Robot(settings, neck, library, plugin).run(motion)
    assert np.degrees(record.reached[-1200:, 3:].std(axis=0)).max() < 0.07
    assert record.figures()["settled_deg"] < 0.05


def test_the_observer_finds_a_push_through_late_readings(library: Path, plugin: Path) -> None:
    neck = closed_neck()
    control = replace(SETTINGS, control=Control(compensation=1.0))
    motion = Motions(neck, SETTINGS).payload()
    plain = Robot(SETTINGS, neck, library, plugin).run(motion).figures()
    better = Robot(control, neck, library, plugin).run(motion).figures()
    assert better["settled_deg"] < 0.4 * plain["settled_deg"]


def test_readings_later_than_the_controller_remembers_are_refused(library: Path) -> None:
    late = PoseSensor(delay_s=0.2)
    settings = replace(SETTINGS, sensor=late, control=Control(dt_s=5e-4))
    with pytest.raises(InputError, match=r"delay_s 0.2 is 400 steps of 0.0005 s.*remembers 255"):
        CompiledController(library, settings, closed_neck().rest, LENGTH_M)


@pytest.mark.parametrize("code", ["controller", "plugin"])
def test_a_missing_compiler_is_said(
    code: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", "")
    with pytest.raises(ComputationError, match=r"could not be built: .*install a C and a C\+\+"):
        compile_controller(None, tmp_path) if code == "controller" else build_plugin(
            closed_neck(), tmp_path
        )
    assert not list(tmp_path.iterdir())


def test_what_is_compiled_is_not_compiled_again(library: Path, plugin: Path) -> None:
    before = [path.stat().st_mtime_ns for path in (library, plugin)]
    assert compile_controller(fitted("energy4-revolution"), library.parent) == library
    assert build_plugin(closed_neck(), plugin.parent) == plugin
    assert [path.stat().st_mtime_ns for path in (library, plugin)] == before


def test_constant_curvature_is_compiled_as_an_energy_that_equals_it() -> None:
    model = fitted("constant-curvature")
    poses, others = neck_pairs(300, seed=5)[0], neck_pairs(300, seed=6)[0]
    expected = model.predict(others)
    left = exportable(model, poses).predict(others) - expected
    assert (np.abs(left).max(axis=0) < 1e-5 * np.abs(expected).max(axis=0)).all()
