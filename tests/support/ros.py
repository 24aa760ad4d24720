"""Messages of ROS 2 as bytes, and the exported node's wrenches."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ecm.io.arrays import F
from support.exports import thousand_poses

WRENCH_STAMPED = "geometry_msgs/msg/WrenchStamped"


@lru_cache(maxsize=1)
def typestore() -> Any:
    """The messages of ROS 2 Humble."""
    from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415 - of the extra logs

    return get_typestore(Stores.ROS2_HUMBLE)


def stamped(milliseconds: int, wrench: Sequence[float]) -> bytes:
    """The bytes of a WrenchStamped in the frame `base`."""
    types = typestore().types
    vector, geometry = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Wrench"]
    time = types["builtin_interfaces/msg/Time"](
        milliseconds // 1000, milliseconds % 1000 * 1_000_000
    )
    header = types["std_msgs/msg/Header"](time, "base")
    message = types[WRENCH_STAMPED](header, geometry(vector(*wrench[:3]), vector(*wrench[3:])))
    return bytes(typestore().serialize_cdr(message, WRENCH_STAMPED))


def quaternion(theta: F) -> list[float]:
    """x, y, z, w of a rotation vector."""
    return list(Rotation.from_rotvec(theta).as_quat().tolist())


def follow(node: Any) -> F:
    """(1000, 6) wrenches of the exported node at the workspace's poses, 1 ms apart."""
    follower = node.Follower()
    return np.array(
        [
            follower.wrench(1e-3 * n, pose[:3].tolist(), quaternion(pose[3:]))
            for n, pose in enumerate(thousand_poses())
        ]
    )
