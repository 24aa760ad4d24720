"""Frames of a log: a table in other axes, about other points, is the same table once it is read."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import ecm
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.io.table import Meta, as_table, read_table
from support.neck import columns_of

ROWS = 30
TOLERANCE = 1e-12


class Motion:
    """A rigid motion R, t of scipy's rotations, one or (N,)."""

    def __init__(self, rotation: Rotation, position: F) -> None:
        self.rotation, self.position = rotation, position

    @classmethod
    def random(cls, seed: int) -> Motion:
        rng = np.random.default_rng(seed)
        return cls(Rotation.random(rng=rng), rng.normal(size=3) * 0.3)

    def __matmul__(self, other: Motion) -> Motion:
        return Motion(
            self.rotation * other.rotation, self.rotation.apply(other.position) + self.position
        )

    def inverse(self) -> Motion:
        back = self.rotation.inv()
        return Motion(back, -back.apply(self.position))

    def toml(self) -> list[float]:
        x, y, z, w = self.rotation.as_quat()
        return [*map(float, self.position), float(w), float(x), float(y), float(z)]


@pytest.fixture
def base() -> dict[str, F]:
    """Poses of the top frame in the base frame, and wrenches about its origin in base axes."""
    rng = np.random.default_rng(1)
    poses = np.column_stack(
        [[0.1, 0.0, 0.0] + 0.02 * rng.normal(size=(ROWS, 3)), 0.4 * rng.normal(size=(ROWS, 3))]
    )
    return columns_of(poses, rng.normal(size=(ROWS, 6)))


def tops(base: dict[str, F]) -> Motion:
    values = np.column_stack([base[name] for name in POSE])
    return Motion(Rotation.from_rotvec(values[:, 3:]), values[:, :3])


def read(columns: dict[str, F], **tables: Any) -> ecm.Table:
    return as_table(columns, meta=Meta.from_dict(tables, "t.toml"))


def log_of(base: dict[str, F], tool: Motion) -> dict[str, F]:
    """The columns with the tool's pose in the robot's base."""
    poses = np.column_stack([tool.position, tool.rotation.as_rotvec()])
    return base | dict(zip(POSE, poses.T, strict=True))


def with_wrench(base: dict[str, F], axes: Motion, point: F) -> dict[str, F]:
    """The wrench columns in the axes of a frame and about a point, both in base axes."""
    force = np.column_stack([base[name] for name in WRENCH[:3]])
    moment = np.column_stack([base[name] for name in WRENCH[3:]])
    top = np.column_stack([base[name] for name in POSE[:3]])
    moment = moment + np.cross(top - point, force)
    back = axes.rotation.inv()
    parts = np.hstack([back.apply(force), back.apply(moment)])
    return base | dict(zip(WRENCH, parts.T, strict=True))


def same(table: ecm.Table, base: dict[str, F]) -> None:
    for name in (*POSE, *WRENCH):
        np.testing.assert_allclose(table[name], base[name], atol=TOLERANCE, err_msg=name)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("frame", ["robot", "tool", "top", "base", "sensor below", "sensor above"])
def test_a_random_motion_of_every_frame_is_undone(
    base: dict[str, F], frame: str, seed: int
) -> None:
    base_from_robot, top_from_tool, sensor = (Motion.random(10 * seed + i) for i in range(3))
    top = tops(base)
    tool = top @ top_from_tool
    frames = {
        "robot": base_from_robot,
        "tool": tool,
        "top": top,
        "base": Motion(Rotation.identity(), np.zeros(3)),
        "sensor below": sensor,
        "sensor above": top @ sensor,
    }
    own = frames[frame]
    columns = with_wrench(base, own, own.position)
    columns = log_of(columns, base_from_robot.inverse() @ tool)
    word = frame.split(" ", maxsplit=1)[0]
    said: dict[str, Any] = {
        "base_from_robot": base_from_robot.toml(),
        "top_from_tool": top_from_tool.toml(),
        "wrench_axes": word,
        "wrench_point": word,
    }
    instrument = {}
    if frame == "sensor below":
        said["base_from_sensor"] = sensor.toml()
    elif frame == "sensor above":
        instrument = {"top_from_sensor": sensor.toml()}
    same(read(columns, frames=said, instrument=instrument), base)
    # The wrench that the mechanism exerts is the opposite one.
    columns |= {name: -columns[name] for name in WRENCH}
    same(read(columns, frames=said | {"wrench_by": "mechanism"}, instrument=instrument), base)


def test_frames_are_applied_once(base: dict[str, F], tmp_path: Path) -> None:
    motion = Motion.random(5)
    columns = log_of(base, motion.inverse() @ tops(base))
    meta = Meta.from_dict({"frames": {"base_from_robot": motion.toml()}}, "t.toml")
    table = as_table(columns, meta=meta)
    assert table.meta.frames.empty
    table.write(tmp_path / "t.csv")
    again = read_table(tmp_path / "t.csv")
    np.testing.assert_array_equal(again.poses, table.poses)
    same(again, base)


def test_three_forces_are_turned_without_moments(base: dict[str, F]) -> None:
    turned = with_wrench(base, tops(base), np.zeros(3))
    columns = {name: turned[name] for name in (*POSE, *WRENCH[:3])}
    table = read(columns, frames={"wrench_axes": "top"})
    for name in WRENCH[:3]:
        np.testing.assert_allclose(table[name], base[name], atol=TOLERANCE)


@pytest.mark.parametrize(
    ("drop", "frames", "message"),
    [
        (["z_m"], {"wrench_axes": "tool"}, "z_m is missing: .* --map z_m=COLUMN"),
        (["fz_N"], {"wrench_axes": "top"}, "only fx_N, fy_N are there"),
        ([], {"wrench_point": "sensor"}, "base_from_sensor, or .instrument. top_from_sensor"),
        ([], {"base_from_robot": [0, 0, 0, 1, 1, 0, 0]}, "a unit quaternion w x y z"),
        ([], {"wrench_axes": "tcp"}, "wrench_axes"),
    ],
)
def test_what_is_missing_is_named(
    base: dict[str, F], drop: list[str], frames: dict[str, Any], message: str
) -> None:
    columns = {name: values for name, values in base.items() if name not in drop}
    with pytest.raises(ecm.InputError, match=message):
        read(columns, frames=frames)


def test_a_position_in_the_robots_base_is_no_millimetre(base: dict[str, F]) -> None:
    columns = base | {"y_m": base["y_m"] - 0.53}
    with pytest.raises(ecm.InputError, match="base_from_robot") as error:
        read(columns, mechanism={"length_m": 0.1})
    assert "millimetre" not in str(error.value)
    said = {"base_from_robot": [0.0, 0.53, 0.0, 1.0, 0.0, 0.0, 0.0]}
    same(read(columns, mechanism={"length_m": 0.1}, frames=said), base)
    with pytest.raises(ecm.InputError, match="millimetres"):
        read(base | {"y_m": base["y_m"] * 1e3}, mechanism={"length_m": 0.1})


def test_a_tool_that_points_straight_down_is_no_mistake(base: dict[str, F]) -> None:
    """Turns about y of a tool that is turned by half a turn about x are half turns themselves."""
    down = Motion(Rotation.from_quat([1.0, 0.0, 0.0, 0.0]), np.zeros(3))
    angles = np.linspace(-0.2, 0.2, ROWS)
    flat = base | {"theta_x_rad": 0.0 * angles, "theta_y_rad": angles, "theta_z_rad": 0.0 * angles}
    columns = log_of(flat, tops(flat) @ down)
    assert (np.linalg.norm([columns[name] for name in POSE[3:]], axis=0) >= np.pi).any()
    same(read(columns, frames={"top_from_tool": down.toml()}), flat)
    with pytest.raises(ecm.InputError, match="less than pi"):
        read(columns)
