"""CycloneDDS writes the same bytes of a WrenchStamped as rosbags, whose bags ROS 2 reads.

Its types need their annotations evaluated.
"""

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import version
from pathlib import Path

from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import int32, uint32

from export_tools.errors import said
from support.exports import fitted, written
from support.ros import follow, stamped


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):  # type: ignore[call-arg]
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):  # type: ignore[call-arg]
    stamp: Time
    frame_id: str


@dataclass
class Vector3(IdlStruct, typename="geometry_msgs::msg::dds_::Vector3_"):  # type: ignore[call-arg]
    x: float
    y: float
    z: float


@dataclass
class Wrench(IdlStruct, typename="geometry_msgs::msg::dds_::Wrench_"):  # type: ignore[call-arg]
    force: Vector3
    torque: Vector3


@dataclass
class WrenchStamped(IdlStruct, typename="geometry_msgs::msg::dds_::WrenchStamped_"):  # type: ignore[call-arg]
    header: Header
    wrench: Wrench


def run(folder: Path) -> Iterator[str]:
    """Lines of results."""
    written(fitted("energy6"), folder, "ros2")
    sys.path.insert(0, str(folder))
    wrenches = follow(import_module("neck_node"))
    yield f"the node's wrenches: {said(wrenches)}"
    for n, h in enumerate(wrenches.tolist()):
        header = Header(Time(n // 1000, n % 1000 * 1_000_000), "base")
        message = WrenchStamped(header, Wrench(Vector3(*h[:3]), Vector3(*h[3:])))
        if message.serialize() != stamped(n, h):
            raise SystemExit(f"message {n}: other bytes than rosbags")
    yield f"{version('cyclonedds')}: bytes of {len(wrenches)} WrenchStamped are those of rosbags"
