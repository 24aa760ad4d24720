"""Rigid bodies that OptiTrack's Motive sends as NatNet over UDP.

A frame of data (message 7) as of NatNet 3.0 and later, little endian; each count is followed by a
size in bytes from 4.1 on:

    uint16 message, uint16 bytes, int32 frame
    int32 marker sets: name, zero byte, int32 markers, 3 floats each
    int32 other markers: 3 floats each
    int32 rigid bodies: int32 id, 3 floats m, 4 floats x y z w, float error, int16 (bit 0: tracked)
"""

from __future__ import annotations

import ipaddress
import socket
import struct
import time
from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from ecm.bench.devices import DeviceError
from ecm.io.arrays import F
from ecm.io.se3 import OWN, platform_pose, vectors_of

_FRAME_OF_DATA = 7
_COUNT, _BODY, _POINT_BYTES = struct.Struct("<i"), struct.Struct("<i3f4ffh"), 12
_SIZES_SINCE = 4.1


class NatNet:
    """Pose of the platform's rigid body in the frame of the base's rigid body.

    Parameters
    ----------
    platform, base
        Streaming ID of each rigid body, as Motive shows it.
    address
        Multicast group, or this machine's own address where Motive sends to it alone.
    port
        Data port.
    interface
        Own address on the network of the cameras.
    version
        Version of NatNet: 4.1, 3.0, ...
    top_from_body, base_from_body
        Where the bodies are, in the frames of the platform and of the base: m and quaternion w x y
        z.
    timeout_s
        Longest time without both bodies tracked.
    """

    def __init__(  # noqa: PLR0913 - each is a setting of its own
        self,
        *,
        platform: int,
        base: int,
        address: str = "239.255.42.99",
        port: int = 1511,
        interface: str = "0.0.0.0",
        version: float = 4.1,
        top_from_body: Sequence[float] = OWN,
        base_from_body: Sequence[float] = OWN,
        timeout_s: float = 1.0,
    ) -> None:
        self._bodies, self._timeout_s = (platform, base), timeout_s
        self._skip = _COUNT.size if version >= _SIZES_SINCE else 0
        self._pose = platform_pose(top_from_body, base_from_body)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        group = ipaddress.ip_address(address).is_multicast
        self._socket.bind(("" if group else address, port))
        if group:
            member = socket.inet_aton(address) + socket.inet_aton(interface)
            self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)

    def pose(self, window_s: float) -> tuple[F, F]:
        """Mean and standard deviation (6,) of the platform's pose over a window."""
        self._forget()
        until, seen, frames = time.monotonic() + window_s, list[F](), 0
        while time.monotonic() < until or not seen:
            left = until - time.monotonic() + (0.0 if seen else self._timeout_s)
            if left <= 0.0:
                raise DeviceError(
                    "bodies {} and {} were not both seen in ".format(*self._bodies)
                    + f"{frames} frames; check their numbers, and what hides a marker"
                )
            self._socket.settimeout(left)
            try:
                packet = self._socket.recv(65535)
            except TimeoutError:
                continue
            frames += 1
            tracked = self._tracked(packet)
            if all(name in tracked for name in self._bodies):
                seen.append(self._pose(*(tracked[name] for name in self._bodies)))
        poses = np.stack(seen)
        return poses.mean(axis=0), poses.std(axis=0)

    def _forget(self) -> None:
        """Leave out what came before the window."""
        self._socket.settimeout(0.0)
        with suppress(BlockingIOError):
            while self._socket.recv(65535):
                pass

    def _tracked(self, packet: bytes) -> dict[int, F]:
        """Poses (6,) of the rigid bodies that are tracked in a packet; none in another message."""
        try:
            if struct.unpack_from("<H", packet)[0] != _FRAME_OF_DATA:
                return {}
            count, at = self._counted(packet, 8)
            for _ in range(count):
                at = packet.index(0, at) + 1
                at += _COUNT.size + _POINT_BYTES * _COUNT.unpack_from(packet, at)[0]
            count, at = self._counted(packet, at)
            count, at = self._counted(packet, at + _POINT_BYTES * count)
            bodies = [_BODY.unpack_from(packet, at + i * _BODY.size) for i in range(count)]
        except (struct.error, ValueError):
            raise DeviceError(
                f"{len(packet)} bytes are no frame of NatNet; check version"
            ) from None
        return {
            name: np.concatenate([numbers[:3], vectors_of(np.array([numbers[3:7]]), "xyzw")[0]])
            for name, *numbers, _, state in bodies
            if state & 1
        }

    def _counted(self, packet: bytes, at: int) -> tuple[int, int]:
        """A count and where what it counts begins."""
        return _COUNT.unpack_from(packet, at)[0], at + _COUNT.size + self._skip

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()
