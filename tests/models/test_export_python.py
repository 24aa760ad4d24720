"""Exports in Python: joint forces in Pinocchio, the ROS node and its bags, the loader's steps."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pytest

from ecm.io.arrays import F
from support.exports import fitted, thousand_poses, written
from support.models import with_time
from support.programs import need_program
from support.ros import WRENCH_STAMPED, follow, quaternion, stamped, typestore


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """All exports in Python of `neck` and, with effects of time, `slow`; they can be imported."""
    need_program("cc")
    folder = tmp_path_factory.mktemp("exports")
    for target in ("pinocchio", "ros2", "drake"):
        written(fitted("energy6"), folder, target)
        written(with_time(fitted("energy4")), folder, target, name="slow")
    sys.path.insert(0, str(folder))
    yield folder
    sys.path.remove(str(folder))
    for name in [name for name in sys.modules if name.startswith(("neck_", "slow_"))]:
        del sys.modules[name]


def test_pinocchio_gets_the_model_on_moving_frames(folder: Path) -> None:
    pin = pytest.importorskip("pinocchio", reason="pinocchio is not installed (group dev)")
    exported = import_module("neck_pinocchio")
    wrenches = fitted("energy6").base.predict(thousand_poses())
    robot, inertia = pin.Model(), pin.Inertia(0.5, np.zeros(3), 5e-4 * np.eye(3))
    pin.seed(3)
    frames, places = [], [pin.SE3.Random(), pin.SE3.Random()]
    for name, place in zip(("base", "top"), places, strict=True):
        joint = robot.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), name)
        robot.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
        frames.append(robot.addFrame(pin.Frame(name, joint, 0, place, pin.FrameType.OP_FRAME)))
    data, found, total = robot.createData(), np.zeros_like(wrenches), 0.0
    for row, pose in zip(found, thousand_poses(), strict=True):
        base, relative = pin.SE3.Random(), pin.SE3(pin.exp3(pose[3:]), pose[:3])
        ends = [base * places[0].inverse(), base * relative * places[1].inverse()]
        pin.framesForwardKinematics(robot, data, np.hstack([pin.SE3ToXYZQUAT(e) for e in ends]))
        forces = exported.forces(robot, data, *frames)
        on_top = places[1].actInv(forces[2])
        row[:] = [*(-relative.rotation @ on_top.linear), *(-relative.rotation @ on_top.angular)]
        both = data.oMi[1].act(forces[1]) + data.oMi[2].act(forces[2])
        total = max(total, float(np.abs(both.vector).max()))
    error = np.abs(found - wrenches).max(axis=0) / np.abs(wrenches).max(axis=0)
    assert error.max() < 1e-11
    assert total < 1e-9 * np.abs(wrenches).max()


def test_the_ros_node_answers_with_the_model_and_a_bag_keeps_it(
    folder: Path, tmp_path: Path
) -> None:
    rosbag2 = pytest.importorskip("rosbags.rosbag2", reason="rosbags is not installed (extra logs)")
    wrenches = follow(import_module("neck_node"))
    expected = fitted("energy6").base.predict(thousand_poses())
    error = np.abs(wrenches - expected).max(axis=0) / np.abs(expected).max(axis=0)
    assert error.max() < 1e-12
    with rosbag2.Writer(tmp_path / "bag", version=9) as bag:
        connection = bag.add_connection("/wrench", WRENCH_STAMPED, typestore=typestore())
        for n, h in enumerate(wrenches.tolist()):
            bag.write(connection, n * 1_000_000, stamped(n, h))
    with rosbag2.Reader(tmp_path / "bag") as bag:
        for (connection, time, raw), h in zip(bag.messages(), wrenches, strict=True):
            message = typestore().deserialize_cdr(raw, connection.msgtype)
            force, torque = message.wrench.force, message.wrench.torque
            assert [force.x, force.y, force.z, torque.x, torque.y, torque.z] == h.tolist()
            stamp = message.header.stamp
            assert stamp.sec * 1_000_000_000 + stamp.nanosec == time


def test_the_ros_node_steps_from_stamp_to_stamp(folder: Path) -> None:
    follower = import_module("slow_node").Follower()
    controller = with_time(fitted("energy4")).controller()
    controller.init(thousand_poses()[0])
    times = [1.0, 1.5, 1.6, 8.0]
    for time, before, pose in zip(times, [1.0, *times], thousand_poses(), strict=False):
        h, _ = controller.step(pose, time - before)
        found = follower.wrench(time, pose[:3].tolist(), quaternion(pose[3:]))
        np.testing.assert_allclose(found, h, rtol=1e-9, atol=1e-9)
    # A stamp that goes back starts anew; a turned sign of the quaternion is the same rotation.
    pose = thousand_poses()[7]
    turned = [-part for part in quaternion(pose[3:])]
    again = follower.wrench(0.5, pose[:3].tolist(), turned)
    controller.init(pose)
    np.testing.assert_allclose(again, controller.step(pose, 0.0)[0], rtol=1e-9, atol=1e-9)


def test_the_ros_node_takes_temperature_and_age(folder: Path) -> None:
    follower = import_module("slow_node").Follower(age_s=50.0)
    controller = with_time(fitted("energy4")).controller()
    pose = thousand_poses()[3]
    controller.init(pose)
    follower.wrench(7.0, pose[:3].tolist(), quaternion(pose[3:]))
    follower.temperature_degC = 35.0
    found = follower.wrench(9.0, pose[:3].tolist(), quaternion(pose[3:]))
    controller.step(pose, 0.0)
    warm, _ = controller.step(pose, 2.0, temperature_degC=35.0, age_s=52.0)
    np.testing.assert_allclose(found, warm, rtol=1e-9, atol=1e-9)
    text = (folder / "slow_node.py").read_text(encoding="utf-8")
    assert 'create_subscription(Temperature, "temperature", warm, 10)' in text
    assert 'declare_parameter("age_s", 0.0)' in text


class _System:
    """As much of Drake's LeafSystem as the export uses, with one value for each port."""

    def __init__(self) -> None:
        self.declared: dict[str, int] = {}

    def DeclareAbstractInputPort(self, name: str, value: object) -> None:
        self.declared[name] = 0

    def DeclareVectorInputPort(self, name: str, size: int) -> None:
        self.declared[name] = size

    def GetInputPort(self, name: str) -> SimpleNamespace:
        assert name in self.declared
        return SimpleNamespace(
            HasValue=lambda context: name in context, Eval=lambda context: context[name]
        )

    def __getattr__(self, name: str) -> Callable[..., None]:
        assert name.startswith("Declare")
        return lambda *_: None


class _Discrete(dict[str, F]):
    def get_discrete_state_vector(self) -> SimpleNamespace:
        return SimpleNamespace(CopyToVector=self["state"].copy)

    def set_value(self, numbers: F) -> None:
        self["state"] = numbers


def test_the_drake_system_takes_temperature_and_age(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without Drake, on stand-ins of its classes; `benches/export_targets.py` runs Drake itself."""
    for name in ("common.value", "math", "multibody.math", "multibody.plant", "systems.framework"):
        module = MagicMock(LeafSystem=_System)
        monkeypatch.setitem(sys.modules, f"pydrake.{name}", module)
    system = import_module("slow_drake").Mechanism(None, None, 0.5)
    pose = thousand_poses()[3]
    system.pose = lambda context: pose
    controller = with_time(fitted("energy4")).controller()
    for conditions in ({}, {"conditions": np.array([35.0, 80.0])}):
        start = import_module("slow_model").init(pose)
        context = _Discrete(state=np.concatenate([start, np.zeros(6)]), **conditions)
        system._update(context, context)
        controller.init(pose)
        told = dict(
            zip(("temperature_degC", "age_s"), conditions.get("conditions", ()), strict=False)
        )
        expected, _ = controller.step(pose, 0.5, **told)
        np.testing.assert_allclose(system._wrench(context), expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", ["neck", "slow"])
def test_the_ros_node_refuses_what_means_nothing(folder: Path, name: str) -> None:
    follower = import_module(f"{name}_node").Follower()
    place = thousand_poses()[0, :3].tolist()
    with pytest.raises(ValueError, match="orientation of length 0"):
        follower.wrench(0.0, place, (0.0, 0.0, 0.0, 0.0))
    with pytest.raises(ValueError, match="of no numbers"):  # as no turn was taken
        follower.wrench(0.0, place, (0.0, 0.0, 0.0, np.nan))
    for bad in ([np.nan, 0.0, 0.0], [np.inf, 0.0, 0.0]):
        with pytest.raises(ValueError, match="no wrench at pose"):
            follower.wrench(0.0, bad, (0.0, 0.0, 0.0, 1.0))
    # The length of a quaternion does not matter.
    pose = thousand_poses()[1]
    first = follower.wrench(0.0, place, quaternion(pose[3:]))
    again = follower.wrench(0.0, place, [1e-13 * part for part in quaternion(pose[3:])])
    np.testing.assert_allclose(again, first, rtol=1e-9)


def test_the_loader_refuses_what_means_nothing(folder: Path) -> None:
    neck, slow = import_module("neck_model"), import_module("slow_model")
    half_turn = [0.1, 0.0, 0.0, 0.0, 0.0, 3.2]
    assert np.isnan(neck.value_and_stiffness(half_turn)[0]).all()
    assert neck.inside(thousand_poses()[0])
    assert not neck.inside(half_turn)
    assert not hasattr(neck, "step")
    with pytest.raises(ValueError, match="no wrench at pose"):
        slow.init(half_turn)
    state = slow.init(thousand_poses()[0])
    kept = state.copy()
    with pytest.raises(ValueError, match="no step of -1"):
        slow.step(state, thousand_poses()[0], -1.0)
    np.testing.assert_array_equal(state, kept)
    # C would read and write past their ends.
    for call in (neck.value_and_stiffness, neck.inside, slow.init, lambda p: slow.step(kept, p, 0)):
        for short in ([0.1, 0.0, 0.0], np.zeros((1, 6)), 0.1):
            with pytest.raises(ValueError, match=r"pose of shape .*: expected \(6,\)"):
                call(short)
    for other in (kept[:6], kept.astype(np.float32), kept.tolist(), np.repeat(kept, 2)[::2]):
        with pytest.raises(ValueError, match=r"state: expected the \(49,\) numbers of init"):
            slow.step(other, thousand_poses()[0], 0.0)
    warm, _ = slow.step(state.copy(), thousand_poses()[0], 0.0, temperature_degC=31.0)
    cold, _ = slow.step(state.copy(), thousand_poses()[0], 0.0)
    assert np.abs(warm).sum() < np.abs(cold).sum()


def test_the_drake_system_is_python(folder: Path) -> None:
    """It runs in `benches/export_targets.py`, where Drake is installed."""
    for name in ("neck_drake", "slow_drake"):
        compile((folder / f"{name}.py").read_text(encoding="utf-8"), name, "exec")
