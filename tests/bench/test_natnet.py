"""Frames of NatNet by the published format, sent over UDP as Motive sends them."""

from __future__ import annotations

import socket
import struct
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ecm.bench.devices import DeviceError, opened
from ecm.io.arrays import F

BASE = (2, np.array([1.0, 0.5, 2.0]), Rotation.from_rotvec([0.3, -0.2, 1.0]))


def frame(bodies: list[tuple[int, F, Rotation, bool]], version: float) -> bytes:
    """A frame of data with a set of markers, two other markers and these rigid bodies."""

    def counted(count: int, content: bytes) -> bytes:
        size = struct.pack("<i", len(content)) if version >= 4.1 else b""
        return struct.pack("<i", count) + size + content

    content = struct.pack("<i", 17)
    content += counted(1, b"all\0" + struct.pack("<i9f", 3, *range(9)))
    content += counted(2, struct.pack("<6f", *range(6)))
    content += counted(
        len(bodies),
        b"".join(
            struct.pack("<i3f4ffh", name, *place, *turn.as_quat(), 1e-4, int(tracked))
            for name, place, turn, tracked in bodies
        ),
    )
    content += counted(0, b"") * 4 + struct.pack("<iid", 0, 0, 1.5)
    return struct.pack("<HH", 7, len(content)) + content


def moved(pose: F, *, tracked: bool = True) -> list[tuple[int, F, Rotation, bool]]:
    """The base's body, and the platform's at a pose (6,) in its frame."""
    name, place, turn = BASE
    turned = turn * Rotation.from_rotvec(pose[3:])
    return [(name, place, turn, True), (5, place + turn.apply(pose[:3]), turned, tracked)]


@contextmanager
def stream(packets: list[bytes], **settings: Any) -> Iterator[Any]:
    """The device, and a sender of these packets round and round, 200 a second."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    own = {"platform": 5, "base": 2, "address": "127.0.0.1", "port": port, "timeout_s": 0.3}
    device = opened("natnet", own | settings, "bench.toml [pose]")
    over = threading.Event()

    def send() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            while not over.wait(0.005):
                for packet in packets:
                    sender.sendto(packet, ("127.0.0.1", port))

    sending = threading.Thread(target=send)
    sending.start()
    try:
        yield device
    finally:
        over.set()
        sending.join()
        device.close()


@pytest.mark.parametrize("version", [3.0, 4.1])
def test_the_platform_is_seen_in_the_frame_of_the_base(version: float) -> None:
    pose = np.array([0.1, 0.02, -0.01, 0.2, -0.1, 0.3])
    packets = [frame(moved(pose), version), frame(moved(pose, tracked=False), version)]
    packets.append(struct.pack("<HH", 1, 0))  # another message
    with stream(packets, version=version, top_from_body=[0.0, 0.0, 0.01, 1, 0, 0, 0]) as device:
        mean, spread = device.pose(0.1)
    top = pose[:3] + Rotation.from_rotvec(pose[3:]).apply([0.0, 0.0, -0.01])
    assert mean == pytest.approx([*top, *pose[3:]], abs=1e-6)  # its floats have 24 bits
    assert spread.max() < 1e-9


def test_frames_before_the_window_are_forgotten() -> None:
    before, after = np.array([0.1, 0, 0, 0, 0, 0]), np.array([0.2, 0, 0, 0, 0, 0])
    packets = [frame(moved(before), 4.1)]
    with stream(packets) as device:
        time.sleep(0.1)
        packets[0] = frame(moved(after), 4.1)
        time.sleep(0.02)
        assert device.pose(0.05)[0][0] == pytest.approx(0.2, abs=1e-6)


def test_a_body_that_is_hidden_a_wrong_version_and_silence_are_told() -> None:
    pose = np.array([0.1, 0, 0, 0, 0, 0])
    with (
        stream([frame(moved(pose, tracked=False), 4.1)]) as device,
        pytest.raises(DeviceError, match=r"bodies 5 and 2 were not both seen in [1-9]"),
    ):
        device.pose(0.05)
    with (
        stream([frame(moved(pose), 4.1)], version=3.0) as device,
        pytest.raises(DeviceError, match="are no frame of NatNet; check version"),
    ):
        device.pose(0.05)
    began = time.monotonic()
    with stream([]) as device, pytest.raises(DeviceError, match="seen in 0 frames"):
        device.pose(0.05)
    assert time.monotonic() - began < 3.0
