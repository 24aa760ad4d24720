"""A film of one motion under several controllers side by side, the wanted head as a shadow."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from experiment import Record, Robot, errors
from plant import HeadPlant
from robot import F, rotation

WIDTH, HEIGHT, CURVE = 340, 400, 130
"""Pixels of the picture of one controller, and height of the curves of the error below."""
FRAMES_PER_S = 12
_NECK = np.array([0.55, 0.75, 0.95, 1.0], dtype=np.float32)
_WANTED = np.array([0.2, 0.7, 0.3, 0.35], dtype=np.float32)
_CURVES = ((173, 69, 0), (0, 96, 156), (0, 102, 74))
_RADIUS_M, _PIECES = 0.033, 12
_HEAD_M, _HALF_AXES_M = np.array([0.10, 0.005, 0.0]), np.array([0.09, 0.075, 0.075])


def write_film(path: Path, robot: Robot, records: Sequence[tuple[str, Record]]) -> int:
    """Write an animated GIF; return the number of frames.

    Parameters
    ----------
    path
        File to write.
    robot
        Whose head moved; its controller does not matter.
    records
        Title and record of each picture, from left to right, of one motion.
    """
    dt = robot.settings.control.dt_s
    plant = HeadPlant(robot.settings, robot.neck, robot.plugin)
    missed = [errors(record.wanted, record.reached) for _, record in records]
    frames = []
    with mujoco.Renderer(plant.model, HEIGHT, WIDTH) as renderer:
        for i in range(0, len(records[0][1].reached), round(1.0 / FRAMES_PER_S / dt)):
            views = [_view(renderer, plant, record, i) for _, record in records]
            image = Image.new("RGB", (WIDTH * len(records), HEIGHT + CURVE), "white")
            image.paste(Image.fromarray(np.hstack(views)))
            draw = ImageDraw.Draw(image)
            _curves(draw, [mm for mm, _ in missed], i, WIDTH * len(records), dt)
            for number, ((title, _), (mm, deg)) in enumerate(zip(records, missed, strict=True)):
                text = f"{title}\n{i * dt:.1f} s\n{mm[i]:.1f} mm {deg[i]:.1f} deg"
                draw.text((number * WIDTH + 10, 10), text, fill=_CURVES[number % 3], font_size=16)
            frames.append(image.quantize(96))
    frames[0].save(
        path, save_all=True, append_images=frames[1:], duration=round(1000 / FRAMES_PER_S), loop=0
    )
    return len(frames)


def _curves(
    draw: ImageDraw.ImageDraw, missed: Sequence[F], now: int, width: int, dt: float
) -> None:
    """Draw how far each head is off over the time, up to now: an error is too small to be seen."""
    left, bottom, tall = 46, HEIGHT + CURVE - 22, CURVE - 44
    most, count = max(float(mm.max()) for mm in missed), len(missed[0])
    draw.line([(left, bottom), (width - 8, bottom)], fill=(120, 120, 130))
    for value in (most, 0.5 * most):
        y = bottom - tall * value / most
        draw.line([(left, y), (width - 8, y)], fill=(225, 225, 230))
        draw.text((4, y - 8), f"{value:.1f} mm", fill=(60, 60, 70), font_size=12)
    draw.text((left, HEIGHT + 2), "error of the position", fill=(20, 20, 30), font_size=13)
    draw.text((width - 60, bottom + 4), f"{count * dt:.0f} s", fill=(60, 60, 70), font_size=12)
    for mm, colour in zip(missed, _CURVES, strict=False):
        at = np.linspace(0, now, min(now + 1, width)).astype(int)
        points = [(left + (width - 8 - left) * k / count, bottom - tall * mm[k] / most) for k in at]
        draw.line(points if len(points) > 1 else points * 2, fill=colour, width=2)


def _view(
    renderer: mujoco.Renderer, plant: HeadPlant, record: Record, step: int
) -> NDArray[np.uint8]:
    """Picture of a step: what MuJoCo knows, the neck, and the wanted head."""
    plant.at(record.reached[step], record.forces_N[step])
    renderer.update_scene(plant.data, camera="film")
    cylinder, ellipsoid = mujoco.mjtGeom.mjGEOM_CYLINDER, mujoco.mjtGeom.mjGEOM_ELLIPSOID
    for start, end in pairwise(_centre_line(record.reached[step], plant.model.body("head").pos[0])):
        piece = _new(renderer.scene, cylinder, np.zeros(3), np.zeros(3), np.eye(3), _NECK)
        mujoco.mjv_connector(piece, cylinder, _RADIUS_M, start, end)
    wanted = record.wanted[step]
    axes = rotation(wanted[3:])
    place = wanted[:3] + axes @ _HEAD_M
    _new(renderer.scene, ellipsoid, 1.02 * _HALF_AXES_M, place, axes, _WANTED)
    return np.asarray(renderer.render())


def _new(
    scene: mujoco.MjvScene, kind: int, size: F, place: F, axes: F, colour: NDArray[np.float32]
) -> mujoco.MjvGeom:
    piece = scene.geoms[scene.ngeom]
    mujoco.mjv_initGeom(piece, kind, size, place, axes.ravel(), colour)
    scene.ngeom += 1
    return piece


def _centre_line(pose: F, length_m: float) -> F:
    """Points (n, 3) of the cubic curve from the base, along x, to the top, along its own x."""
    u = np.linspace(0.0, 1.0, _PIECES + 1)[:, None]
    begin, end = length_m * np.array([1.0, 0.0, 0.0]), length_m * rotation(pose[3:])[:, 0]
    line = (u**3 - 2 * u**2 + u) * begin + (3 * u**2 - 2 * u**3) * pose[:3] + (u**3 - u**2) * end
    return np.asarray(line)
