"""ROS 2 bags and MCAP files: poses and wrenches at their own rates become rows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

import ecm
from ecm import import_log
from ecm.io.columns import POSE, WRENCH
from ecm.logs.importing import read_log

STORE = get_typestore(Stores.ROS2_HUMBLE)
BEGIN_NS = 1_700_000_000_000_000_000
RATE, AXIS = 0.4, np.array([0.3, -0.5, 0.2])


def message(name: str, *arguments: Any) -> Any:
    return STORE.types[name](*arguments)


def header(time_s: float) -> Any:
    nanoseconds = BEGIN_NS + round(time_s * 1e9)
    stamp = message("builtin_interfaces/msg/Time", nanoseconds // 10**9, nanoseconds % 10**9)
    return message("std_msgs/msg/Header", stamp, "base")


def vector(values: Any) -> Any:
    return message("geometry_msgs/msg/Vector3", *map(float, values))


def turn(time_s: float) -> Any:
    values = Rotation.from_rotvec(AXIS * RATE * time_s).as_quat()
    return message("geometry_msgs/msg/Quaternion", *map(float, values))


def pose_stamped(time_s: float) -> Any:
    point = message("geometry_msgs/msg/Point", 0.1, 0.01 * time_s, 0.0)
    pose = message("geometry_msgs/msg/Pose", point, turn(time_s))
    return message("geometry_msgs/msg/PoseStamped", header(time_s), pose)


def transform_stamped(time_s: float) -> Any:
    transform = message(
        "geometry_msgs/msg/Transform", vector([0.1, 0.01 * time_s, 0]), turn(time_s)
    )
    return message("geometry_msgs/msg/TransformStamped", header(time_s), "top", transform)


def wrench_stamped(time_s: float) -> Any:
    wrench = message("geometry_msgs/msg/Wrench", vector([time_s, 2, 3]), vector([0, 0, time_s]))
    return message("geometry_msgs/msg/WrenchStamped", header(time_s), wrench)


def joint_state(time_s: float) -> Any:
    parts = [np.array([v]) for v in (0.1 * time_s, 0.0, 0.2 * time_s)]
    return message("sensor_msgs/msg/JointState", header(time_s), ["hinge"], *parts)


def write_bag(path: Path, streams: dict[str, tuple[Any, Any]], mcap: bool, late_s: float) -> None:
    """A bag of topics, each with its message and times; samples are written in order of time."""
    plugin = StoragePlugin.MCAP if mcap else StoragePlugin.SQLITE3
    with Writer(path, version=9, storage_plugin=plugin) as bag:
        samples = []
        for topic, (make, times) in streams.items():
            kind = make(0.0).__msgtype__
            connection = bag.add_connection(topic, kind, typestore=STORE)
            samples += [(t, connection, STORE.serialize_cdr(make(t), kind)) for t in times]
        for time_s, connection, raw in sorted(samples, key=lambda sample: sample[0]):
            bag.write(connection, BEGIN_NS + round((time_s + late_s) * 1e9), raw)


@pytest.mark.parametrize("mcap", [False, True])
@pytest.mark.parametrize("make", [pose_stamped, transform_stamped])
def test_pose_and_wrench_are_joined_by_time(tmp_path: Path, mcap: bool, make: Any) -> None:
    fast = np.arange(0.0, 4.0, 0.01)
    fast = fast[(fast < 1.995) | (fast > 2.655)]
    slow = np.arange(0.005, 4.0, 0.1)
    streams = {"/ft": (wrench_stamped, slow), "/top": (make, fast)}
    write_bag(tmp_path / "bag", streams, mcap, late_s=0.003)
    path = next((tmp_path / "bag").glob("*.mcap")) if mcap else tmp_path / "bag"
    imported = import_log(path)
    table = imported.table
    kept = slow[((slow < 1.992) | (slow > 2.658)) & (slow <= fast[-1])]
    np.testing.assert_allclose(table["time_s"], kept - kept[0], atol=1e-6)
    np.testing.assert_allclose(table["y_m"], 0.01 * kept, atol=1e-6)
    np.testing.assert_allclose(
        np.column_stack([table[name] for name in POSE[3:]]), np.outer(RATE * kept, AXIS), atol=1e-6
    )
    np.testing.assert_allclose(table[WRENCH[0]], kept, atol=1e-6)
    text = str(imported)
    assert "/ft: 40 samples at 10 Hz" in text
    assert "written 3 ms after their stamp" in text
    assert f"{len(slow) - len(kept) - int((slow > fast[-1]).sum())} samples in a gap" in text


def test_two_wrenches_are_asked_for_and_a_joint_is_one_angle(tmp_path: Path) -> None:
    times = np.arange(0.0, 2.0, 0.1)
    streams = {
        "/a": (wrench_stamped, times),
        "/b": (wrench_stamped, times),
        "/joints": (joint_state, times),
    }
    write_bag(tmp_path / "bag", streams, mcap=False, late_s=0.0)
    with pytest.raises(ecm.InputError, match="2 streams hold a wrench: /a, /b"):
        import_log(tmp_path / "bag")
    table = import_log(tmp_path / "bag", topics=["/joints"], axis="z").table
    np.testing.assert_allclose(table["theta_z_rad"], 0.1 * times)
    np.testing.assert_allclose(table["tau_z_Nm"], 0.2 * times)


def test_messages_are_counted_while_a_bag_is_read(tmp_path: Path) -> None:
    times = np.arange(0.0, 12.0, 0.01)
    write_bag(
        tmp_path / "bag",
        {"/ft": (wrench_stamped, times), "/top": (pose_stamped, times)},
        mcap=False,
        late_s=0.0,
    )
    told: list[tuple[float, float, str]] = []
    log = read_log(tmp_path / "bag", (), progress=lambda *words: told.append(words)).log
    assert told == [(done, 2400, "messages") for done in (0, 1000, 2000)]
    assert len(next(iter(log.columns.values()))) == 1200
