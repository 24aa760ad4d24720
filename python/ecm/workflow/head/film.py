"""A film of a motion under two controllers side by side, the wanted head as a shadow, by MuJoCo."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecm.io.arrays import F
from ecm.io.extras import require
from ecm.rig.arm.film import centre_line, gl_context, write_gif
from ecm.rig.frames import rotation
from ecm.workflow.head.experiment import Record
from ecm.workflow.head.neck_wrench import TrueNeck
from ecm.workflow.head.plant import HeadPlant
from ecm.workflow.head.settings import HeadSettings

WIDTH, HEIGHT = 340, 400
"""Pixels of the picture of one controller."""
FRAMES_PER_S = 12
_NECK = np.array([0.55, 0.75, 0.95, 1.0], dtype=np.float32)
_WANTED = np.array([0.2, 0.7, 0.3, 0.35], dtype=np.float32)
_RADIUS_M = 0.033
_HEAD_M, _HALF_AXES_M = np.array([0.10, 0.005, 0.0]), np.array([0.09, 0.075, 0.075])


def write_film(
    path: Path, settings: HeadSettings, neck: TrueNeck, records: Sequence[tuple[str, Record]],
    *, faster: float = 1.0,
) -> int:  # fmt: skip
    """Write an animated GIF of records with their titles; return the number of frames.

    Parameters
    ----------
    path
        File to write.
    settings
        The robot.
    neck
        The true neck.
    records
        Title and record of each picture, from left to right, of one motion.
    faster
        Time of the motion over that of the film.

    Raises
    ------
    ComputationError
        This machine cannot draw without a screen.
    """
    require("PIL.Image", "robot", "--film")
    views = _Views(settings, neck, records)
    try:
        every = max(1, round(faster / FRAMES_PER_S / settings.control.dt_s))
        images = [views.image(i) for i in range(0, len(records[0][1].reached), every)]
    finally:
        views.close()
    write_gif(path, images, FRAMES_PER_S)
    return len(images)


class _Views:
    """One picture per record, drawn into one image."""

    def __init__(
        self, settings: HeadSettings, neck: TrueNeck, records: Sequence[tuple[str, Record]]
    ) -> None:
        self._plant = HeadPlant(settings, neck)
        self._library: Any = self._plant.library
        self._length = neck.length_m
        self._records = [(title, record, *record.errors()) for title, record in records]
        self._dt = settings.control.dt_s
        self._size = WIDTH * len(records), HEIGHT
        self._context = gl_context(*self._size)
        library, model = self._library, self._plant.model
        self._canvas = library.MjrContext(model, library.mjtFontScale.mjFONTSCALE_100.value)
        library.mjr_setBuffer(library.mjtFramebuffer.mjFB_OFFSCREEN.value, self._canvas)
        self._scene = library.MjvScene(model, maxgeom=200)
        self._camera = library.MjvCamera()
        self._camera.type = library.mjtCamera.mjCAMERA_FIXED.value
        self._camera.fixedcamid = 0

    def image(self, step: int) -> NDArray[np.uint8]:
        """Draw the moment of a step."""
        library, plant = self._library, self._plant
        for number, (title, record, away, turned) in enumerate(self._records):
            plant.at(record.reached[step], record.forces_N[step])
            library.mjv_updateScene(
                plant.model, plant.data, library.MjvOption(), None, self._camera,
                library.mjtCatBit.mjCAT_ALL.value, self._scene,
            )  # fmt: skip
            self._draw_neck(record.reached[step])
            self._draw_wanted(record.wanted[step])
            place = library.MjrRect(number * WIDTH, 0, WIDTH, HEIGHT)
            library.mjr_render(place, self._scene, self._canvas)
            library.mjr_overlay(
                library.mjtFont.mjFONT_NORMAL.value, library.mjtGridPos.mjGRID_TOPLEFT.value,
                place, f"{title}\ntime\nerror",
                f" \n{step * self._dt:.1f} s\n{away[step]:.1f} mm {turned[step]:.1f} deg",
                self._canvas,
            )  # fmt: skip
        image = np.zeros((self._size[1], self._size[0], 3), dtype=np.uint8)
        library.mjr_readPixels(image, None, library.MjrRect(0, 0, *self._size), self._canvas)
        return np.asarray(image[::-1])

    def close(self) -> None:
        """Release the graphics context."""
        del self._canvas
        self._context.free()

    def _draw_neck(self, pose: F) -> None:
        kind = self._library.mjtGeom.mjGEOM_CYLINDER.value
        points = centre_line(pose[:3], rotation(pose[None, 3:])[0], self._length)
        for start, end in pairwise(points):
            piece = self._new(kind, np.zeros(3), np.zeros(3), np.eye(3), _NECK)
            self._library.mjv_connector(piece, kind, _RADIUS_M, start, end)

    def _draw_wanted(self, pose: F) -> None:
        axes = rotation(pose[None, 3:])[0]
        kind = self._library.mjtGeom.mjGEOM_ELLIPSOID.value
        self._new(kind, 1.02 * _HALF_AXES_M, pose[:3] + axes @ _HEAD_M, axes, _WANTED)

    def _new(self, kind: int, size: F, place: F, axes: F, colour: NDArray[np.float32]) -> Any:
        scene = self._scene
        piece = scene.geoms[scene.ngeom]
        self._library.mjv_initGeom(piece, kind, size, place, axes.ravel(), colour)
        scene.ngeom += 1
        return piece
