"""Rendered images of two marker boards whose pose is known, read as a camera's images are."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ecm.bench.aruco import Aruco
from ecm.bench.devices import DeviceError, opened
from ecm.errors import InputError
from ecm.io.arrays import F

LENS = np.array([[2000.0, 0.0, 800.0], [0.0, 2000.0, 600.0], [0.0, 0.0, 1.0]])
SIZE = (1600, 1200)
BOARD: dict[str, Any] = {"square_m": 0.007, "marker_m": 0.005}
MARGIN = 0.004
DOTS = 20_000.0
"""Dots in a metre of the printed boards."""
BASE = np.array([-0.085, -0.02, 0.3, 0.15, 0.1, 0.05])
"""The base's board in the camera's frame, which looks at it from above."""
HALF = 0.5**0.5
TOP_FROM_BOARD = (0.01, -0.02, 0.005, HALF, 0.0, HALF, 0.0)
BASE_FROM_BOARD = (-0.03, 0.0, 0.01, HALF, 0.0, HALF, 0.0)


def calibration(folder: Path) -> str:
    """The file that OpenCV's calibration writes."""
    path = str(folder / "camera.yml")
    file = cv2.FileStorage(path, cv2.FILE_STORAGE_WRITE)
    file.write("camera_matrix", LENS)
    file.write("distortion_coefficients", np.zeros(5))
    file.release()
    return path


def put(image: Any, board: Any, pose: F) -> None:
    """Draw a printed board with a white margin at a pose (6,) in the camera's frame."""
    margin, square = round(DOTS * MARGIN), round(DOTS * BOARD["square_m"])
    columns, rows = board.getChessboardSize()
    dots = (columns * square + 2 * margin, rows * square + 2 * margin)
    printed = board.generateImage(dots, marginSize=margin)
    turn = Rotation.from_rotvec(pose[3:]).as_matrix()
    plane = LENS @ np.column_stack([turn[:, 0], turn[:, 1], pose[:3]])
    # The middle of a dot counts, and that of a pixel; drawn four times as fine.
    metres = np.diag([1.0 / DOTS, 1.0 / DOTS, 1.0])
    metres[:2, 2] = 0.5 / DOTS - MARGIN
    fine = np.diag([4.0, 4.0, 1.0])
    fine[:2, 2] = 1.5
    where, big = fine @ plane @ metres, (4 * SIZE[0], 4 * SIZE[1])
    drawn = cv2.warpPerspective(printed, where, big)
    mask = cv2.warpPerspective(np.full_like(printed, 255), where, big)
    small = [cv2.resize(part, SIZE, interpolation=cv2.INTER_AREA) for part in (drawn, mask)]
    inside = small[1] > 250
    image[inside] = small[0][inside]


def picture(eye: Aruco, poses: list[F], seed: int = 0) -> Any:
    """An image of both boards, with noise."""
    image = np.full(SIZE[::-1], 150, dtype=np.uint8)
    for board, pose in zip(eye.boards, poses, strict=True):
        put(image, board, pose)
    noise = np.random.default_rng(seed).normal(0.0, 2.0, image.shape)
    return np.clip(image + noise, 0, 255).astype(np.uint8)


def matrix(pose: F) -> F:
    """T (4, 4) of position and rotation vector, or of position and quaternion w x y z."""
    turn = (
        Rotation.from_rotvec(pose[3:])
        if len(pose) == 6
        else Rotation.from_quat(np.roll(pose[3:], -1))
    )
    whole = np.eye(4)
    whole[:3, :3], whole[:3, 3] = turn.as_matrix(), pose[:3]
    return whole


def scene(seed: int) -> tuple[F, list[F]]:
    """Pose (6,) of the platform, and of both boards in the camera's frame."""
    random = np.random.default_rng(seed)
    spread = random.uniform(-1.0, 1.0, 6) * ([0.01] * 3 + [0.3] * 3)
    between = np.array([0.09, 0.0, 0.0, 0.0, 0.0, 0.0]) + spread
    base_from_top = (
        matrix(np.array(BASE_FROM_BOARD))
        @ matrix(between)
        @ np.linalg.inv(matrix(np.array(TOP_FROM_BOARD)))
    )
    platform = matrix(BASE) @ matrix(between)
    boards = [six(platform), BASE]
    return six(base_from_top), boards


def six(whole: F) -> F:
    """Position and rotation vector of T (4, 4)."""
    return np.concatenate([whole[:3, 3], Rotation.from_matrix(whole[:3, :3]).as_rotvec()])


@pytest.fixture
def eye(tmp_path: Path) -> Any:
    """A camera whose images are files, none yet but an empty one."""
    cv2.imwrite(str(tmp_path / "frame_000.png"), np.full(SIZE[::-1], 150, dtype=np.uint8))
    return camera(tmp_path)


def camera(folder: Path, **settings: Any) -> Any:
    """The device on the images of a folder."""
    frames = {"top_from_board": TOP_FROM_BOARD, "base_from_board": BASE_FROM_BOARD}
    files = {"calibration": calibration(folder), "camera": str(folder / "frame_%03d.png")}
    return opened("aruco", files | frames | BOARD | settings, "bench.toml [pose]")


def test_the_pose_of_the_platform_in_rendered_images(eye: Any) -> None:
    scenes = [scene(seed) for seed in range(8)]
    seen = [eye.seen(picture(eye, boards, seed)) for seed, (_, boards) in enumerate(scenes)]
    errors = np.stack(seen) - np.stack([pose for pose, _ in scenes])
    scatter = np.sqrt((errors**2).mean(axis=0))
    assert scatter[:3].max() < 6e-5  # measured: 4.6e-5 m and 1.3e-3 rad
    assert scatter[3:].max() < 2e-3


def test_the_images_of_a_window_are_averaged_and_those_that_show_too_little_left_out(
    eye: Any, tmp_path: Path
) -> None:
    pose, boards = scene(0)
    for seed in range(1, 5):
        image = picture(eye, boards, seed)
        if seed == 2:
            image[:, 800:] = 0  # a hand before the platform's board
        cv2.imwrite(str(tmp_path / f"frame_{seed:03d}.png"), image)
    own = camera(tmp_path)
    mean, spread = own.pose(5.0)
    single = [own.seen(cv2.imread(str(tmp_path / f"frame_00{i}.png"))) for i in (1, 2, 3, 4)]
    assert single[1] is None
    kept = np.stack([one for one in single if one is not None])
    assert mean.tolist() == kept.mean(axis=0).tolist()
    assert spread.tolist() == kept.std(axis=0).tolist()
    assert np.abs(mean - pose)[:3].max() < 2e-4
    own.close()


def test_what_a_camera_lacks_is_told(eye: Any, tmp_path: Path) -> None:
    with pytest.raises(DeviceError, match="no image of the camera after 1 that show too little"):
        eye.pose(0.1)
    with pytest.raises(DeviceError, match=r"\[pose\]: camera = 'nowhere.png': OpenCV cannot"):
        camera(tmp_path, camera="nowhere.png")
    with pytest.raises(InputError, match="50 markers, two boards of 9 by 6 squares have 54"):
        camera(tmp_path, columns=9)
    with pytest.raises(InputError, match="OpenCV has no DICT_4X4; take 4X4_50"):
        camera(tmp_path, dictionary="4X4")
    (tmp_path / "spoilt.yml").write_text("camera_matrix: 3")
    with pytest.raises(InputError, match=r"spoilt\.yml"):
        camera(tmp_path, calibration=str(tmp_path / "spoilt.yml"))
    with pytest.raises(InputError, match="this file does not exist"):
        camera(tmp_path, calibration="lens.yml")
