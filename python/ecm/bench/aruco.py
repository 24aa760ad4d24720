"""A camera that sees two chessboards with ArUco markers, on the platform and on the base."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ecm.bench.devices import DeviceError
from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.extras import readable, require
from ecm.io.se3 import OWN, platform_pose

_STALE = 5
"""Images that a camera's driver may hold from the time before the window."""
_PURPOSE = 'The device "aruco"'


class Aruco:
    """Pose of the platform's board in the frame of the base's board, image by image.

    The camera may stand anywhere, and may be pushed between two readings.

    Parameters
    ----------
    camera
        Number of a camera, or an address or file that OpenCV opens (also frame_%03d.png).
    calibration
        File of OpenCV's calibration (YAML or XML) with camera_matrix and distortion_coefficients.
    square_m, marker_m
        Edges of a square of the boards and of the marker in it, as printed, m.
    columns, rows
        Squares of each board.
    dictionary
        Of the markers: 4X4_50, 5X5_100, ... The platform's board has the first of them, the base's
        board those after.
    top_from_board, base_from_board
        Where the boards are, in the frames of the platform and of the base: m and quaternion w x y
        z. A board's origin is the outer corner of its first square, x along the first row, y along
        the first column.
    timeout_s
        Longest time without both boards in one image.
    """

    def __init__(  # noqa: PLR0913 - each is a setting of its own
        self,
        calibration: str,
        *,
        square_m: float,
        marker_m: float,
        camera: int | str = 0,
        columns: int = 8,
        rows: int = 6,
        dictionary: str = "4X4_50",
        top_from_board: Sequence[float] = OWN,
        base_from_board: Sequence[float] = OWN,
        timeout_s: float = 2.0,
    ) -> None:
        cv = self._cv = require("cv2", "camera", _PURPOSE)
        aruco = cv.aruco
        name = f"DICT_{dictionary}"
        if not hasattr(aruco, name):
            raise InputError(f"dictionary = '{dictionary}': OpenCV has no {name}; take 4X4_50")
        self._lens = _calibrated(cv, calibration)
        known = aruco.getPredefinedDictionary(getattr(aruco, name))
        count, size = columns * rows // 2, (columns, rows)
        if 2 * count > len(known.bytesList):
            raise InputError(
                f"dictionary = '{dictionary}': {len(known.bytesList)} markers, two boards of "
                f"{columns} by {rows} squares have {2 * count}"
            )
        self.boards = [
            aruco.CharucoBoard(size, square_m, marker_m, known, np.arange(count) + first)
            for first in (0, count)
        ]
        """That of the platform and that of the base: `generateImage` draws them."""
        fine = aruco.DetectorParameters()
        fine.cornerRefinementMethod = aruco.CORNER_REFINE_SUBPIX
        within = aruco.CharucoParameters()
        self._detectors = [aruco.CharucoDetector(board, within, fine) for board in self.boards]
        self._least, self._timeout_s = (columns - 1) * (rows - 1) // 2, timeout_s
        self._pose = platform_pose(top_from_board, base_from_board)
        self._stale = _STALE if isinstance(camera, int) else 0
        self._camera = cv.VideoCapture(camera)
        if not self._camera.isOpened():
            raise DeviceError(f"camera = {camera!r}: OpenCV cannot open it")

    def pose(self, window_s: float) -> tuple[F, F]:
        """Mean and standard deviation (6,) of the platform's pose in the images of a window."""
        for _ in range(self._stale):
            self._camera.grab()
        until = time.monotonic() + window_s
        seen, images = list[F](), 0
        while time.monotonic() < until or not seen:
            good, image = self._camera.read()
            if not good and not seen:
                raise DeviceError(f"no image of the camera after {images} that show too little")
            if not good:
                break
            images += 1
            pose = self.seen(image)
            if pose is not None:
                seen.append(pose)
            elif time.monotonic() > until + self._timeout_s and not seen:
                raise DeviceError(
                    f"none of {images} images shows {self._least} corners of both boards; look at "
                    "the light and at what stands in the way"
                )
        poses = np.stack(seen)
        return poses.mean(axis=0), poses.std(axis=0)

    def seen(self, image: Any) -> F | None:
        """Pose (6,) of the platform in an image; None where half of a board hides."""
        places = []
        for board, detector in zip(self.boards, self._detectors, strict=True):
            corners, names, _, _ = detector.detectBoard(image)
            if names is None or len(names) < self._least:
                return None
            places.append(self._placed(*board.matchImagePoints(corners, names)))
        return self._pose(*places)

    def _placed(self, points: Any, pixels: Any) -> F:
        """Pose (6,) of a board in the camera's frame."""
        # A flat board allows two poses; IPPE takes the one that fits better.
        flat = self._cv.SOLVEPNP_IPPE
        _, turn, place = self._cv.solvePnP(points, pixels, *self._lens, flags=flat)
        turn, place = self._cv.solvePnPRefineLM(points, pixels, *self._lens, turn, place)
        return np.concatenate([place[:, 0], turn[:, 0]])

    def close(self) -> None:
        """Give the camera back."""
        self._camera.release()


def _calibrated(cv: Any, path: str) -> tuple[F, F]:
    """Matrix (3, 3) and distortion of a camera, as OpenCV's calibration writes them."""
    if not Path(path).is_file():
        raise InputError(f"calibration = '{path}': this file does not exist")
    with readable(Path(path), "calibration of OpenCV"):
        file = cv.FileStorage(path, cv.FILE_STORAGE_READ)
        found = [file.getNode(n).mat() for n in ("camera_matrix", "distortion_coefficients")]
        file.release()
    if any(matrix is None for matrix in found) or found[0].shape != (3, 3):
        raise InputError(f"{path}: expected camera_matrix (3, 3) and distortion_coefficients")
    return found[0], found[1]
