"""A film of the first poses of a campaign of the arm, and the paper's Fig. 7 of one of them.

    .venv/bin/python benches/arm_pictures.py plan.csv --rig examples/robot.toml \\
        --film film.gif --phases phases.png

The film shows the arm and a close view of the mechanism, by MuJoCo, at four times their speed. The
mechanism is no body of the scene; it is drawn as a row of cylinders along the cubic curve that is
tangent to the axes of the base and of the top frame.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import ecm
from ecm.errors import ComputationError, InputError
from ecm.io.arrays import F
from ecm.io.cache import cache_directory
from ecm.io.extras import require
from ecm.io.table import Table
from ecm.rig import RigSettings, Source, fem_source
from ecm.rig.arm.campaign import RobotCampaign, first_reached, full_trace, require_arm
from ecm.rig.arm.procedure import ArmSetup, SimulatedArm
from ecm.rig.arm.simulation import Simulation, mujoco
from ecm.rig.arm.trips import COLOURS, PANELS, Stop, TripResult
from ecm.rig.elastic import Progress
from ecm.rig.plan import rest_pose
from ecm.workflow.config import read_rig

WIDTH, HEIGHT = 480, 400
NEAR_WIDTH = 260
"""Width of the view of the mechanism, right of the arm."""
FRAMES_PER_S = 12
FASTER = 4.0
"""Simulated time divided by filmed time."""
_PIECES = 12
_UNLOADED, _LOADED = np.array([0.55, 0.75, 0.95, 1.0]), np.array([0.95, 0.35, 0.25, 1.0])
_FILMED, _RADIUS_M = 3, 0.033
"""Poses; radius that is drawn if the plan's mechanism names none."""
_FULL_N = 120.0
"""Force at which the mechanism is drawn red."""


class Film:
    """Collects frames; `frame` is the callback of a `SimulatedArm`."""

    def __init__(self, length_m: float, radius_m: float) -> None:
        self._library = mujoco()
        self._length_m, self._radius_m = length_m, radius_m
        self._context = gl_context(WIDTH + NEAR_WIDTH, HEIGHT)
        self._drawing: Any = None
        self._last_s = -1.0
        self._title = ""
        self.images: list[NDArray[np.uint8]] = []

    def begin(self, title: str = "") -> None:
        """Begin a trip, whose clock starts again."""
        self._last_s = -1.0
        self._title = title

    def frame(self, simulation: Simulation, phase: str) -> None:
        """Add a frame if enough time has passed."""
        if simulation.time_s - self._last_s < FASTER / FRAMES_PER_S - 1e-9:
            return
        self._last_s = simulation.time_s
        library = self._library
        if self._drawing is None:
            self._drawing = self._begin_drawing(simulation)
        scene, option, canvas, views = self._drawing
        image_area = library.MjrRect(0, 0, WIDTH + NEAR_WIDTH, HEIGHT)
        for camera, place in views:
            library.mjv_updateScene(
                simulation.model, simulation.data, option, None, camera,
                library.mjtCatBit.mjCAT_ALL.value, scene,
            )  # fmt: skip
            self._draw_mechanism(scene, simulation)
            library.mjr_render(place, scene, canvas)
        force = float(np.linalg.norm(simulation.wrench[:3]))
        library.mjr_overlay(
            library.mjtFont.mjFONT_NORMAL.value, library.mjtGridPos.mjGRID_TOPRIGHT.value,
            views[0][1],
            f"{self._title}\nphase\ntime\nforce",
            f" \n{phase}\n{simulation.time_s:.1f} s\n{force:.0f} N", canvas,
        )  # fmt: skip
        image = np.zeros((HEIGHT, WIDTH + NEAR_WIDTH, 3), dtype=np.uint8)
        library.mjr_readPixels(image, None, image_area, canvas)
        self.images.append(image[::-1].copy())

    def write(self, path: Path) -> None:
        """Write an animated GIF."""
        write_gif(path, self.images, FRAMES_PER_S)

    def close(self) -> None:
        """Release the graphics context."""
        self._drawing = None
        self._context.free()

    def _begin_drawing(self, simulation: Simulation) -> Any:
        library = self._library
        canvas = library.MjrContext(simulation.model, library.mjtFontScale.mjFONTSCALE_100.value)
        library.mjr_setBuffer(library.mjtFramebuffer.mjFB_OFFSCREEN.value, canvas)
        # MuJoCo's free cameras have z up; here x is up, so the scene has cameras of its own.
        views = []
        for number, (left, width) in enumerate(((0, WIDTH), (WIDTH, NEAR_WIDTH))):
            camera = library.MjvCamera()
            camera.type = library.mjtCamera.mjCAMERA_FIXED.value
            camera.fixedcamid = number
            views.append((camera, library.MjrRect(left, 0, width, HEIGHT)))
        scene = library.MjvScene(simulation.model, maxgeom=200)
        return scene, library.MjvOption(), canvas, views

    def _draw_mechanism(self, scene: Any, simulation: Simulation) -> None:
        library = self._library
        load = min(1.0, float(np.linalg.norm(simulation.wrench[:3])) / _FULL_N)
        colour = ((1.0 - load) * _UNLOADED + load * _LOADED).astype(np.float32)
        points = centre_line(
            simulation.position, simulation.data.site_xmat[0].reshape(3, 3), self._length_m
        )
        for start, end in pairwise(points):
            if scene.ngeom >= scene.maxgeom:
                return
            piece = scene.geoms[scene.ngeom]
            kind = library.mjtGeom.mjGEOM_CYLINDER.value
            library.mjv_initGeom(piece, kind, np.zeros(3), np.zeros(3), np.eye(3).ravel(), colour)
            library.mjv_connector(piece, kind, self._radius_m, start, end)
            scene.ngeom += 1


class FilmedArm(SimulatedArm):
    """An arm that is filmed while it moves."""

    def __init__(self, setup: ArmSetup, film: Film) -> None:
        self._film = film
        super().__init__(setup)

    def _tick(self, torque: F, phase: str) -> None:
        self._film.frame(self.simulation, phase)
        super()._tick(torque, phase)


def centre_line(top_m: F, top_axes: F, length_m: float) -> F:
    """Points (n, 3) of the cubic curve from the base, along x, to the top, along its own x."""
    u = np.linspace(0.0, 1.0, _PIECES + 1)[:, None]
    begin, end = length_m * np.array([1.0, 0.0, 0.0]), length_m * top_axes[:, 0]
    line: F = (u**3 - 2 * u**2 + u) * begin + (3 * u**2 - 2 * u**3) * top_m + (u**3 - u**2) * end
    return line


def write_film(
    setup: ArmSetup, stops: Sequence[Stop], path: Path, radius_m: float, progress: Progress = None
) -> int:
    """Film each stop as a trip of its own; return the number of frames.

    ComputationError if this machine cannot draw without a screen.
    """
    film = Film(setup.surrogate.length_m, radius_m)
    try:
        arm = FilmedArm(setup, film)
        for i, stop in enumerate(stops):
            film.begin(f"pose {i + 1} of {len(stops)}")
            arm.trip([stop])
            if progress is not None:
                progress(i + 1, len(stops), "filming")
        film.write(path)
    finally:
        film.close()
    return len(film.images)


def write_gif(path: Path, images: Sequence[NDArray[np.uint8]], frames_per_s: float) -> None:
    """Write images (height, width, 3) as an animated GIF.

    Raises
    ------
    ComputationError
        The file cannot be written.
    """
    pillow = require("PIL.Image", "robot", "--film")
    frames = [pillow.fromarray(image).quantize(96) for image in images]
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        frames[0].save(
            path, format="GIF", save_all=True, append_images=frames[1:],
            duration=round(1000.0 / frames_per_s), loop=0,
        )  # fmt: skip
    except OSError as error:
        raise ComputationError(f"{path}: the film cannot be written: {error}") from None


def gl_context(width: int, height: int) -> Any:
    """Create a context for drawing without a screen: EGL, OSMesa, or a hidden window.

    Raises
    ------
    ComputationError
        This machine cannot draw without a screen.
    """
    tried = []
    for name in ("egl", "osmesa", "glfw"):
        try:
            context = import_module(f"mujoco.{name}").GLContext(width, height)
            context.make_current()
            return context
        except Exception as error:  # whatever a graphics driver raises
            tried.append(f"{name}: {error}")
    raise ComputationError(
        "the film needs a graphics library that draws without a screen; install libegl1 or "
        f"libosmesa6 ({'; '.join(tried)[:300]})"
    )


def draw_phases(trip: TripResult, stop: Stop, length_m: float, path: Path) -> None:
    """Draw Fig. 7 of a trip with one stop: each component of the pose, with the phases."""
    figure = require("matplotlib.figure", "report", "--phases").Figure(
        figsize=(9.0, 6.0), layout="constrained"
    )
    result = trip.stops[0]
    time_s, trace = full_trace(trip)
    rest = rest_pose(length_m)
    axes: Any = figure.subplots(2, 3, sharex=True)
    for j, axis in enumerate(axes.ravel()):
        for name, begin, end in (*result.phases, *trip.home.phases):
            axis.axvspan(begin, end, color=COLOURS[name], lw=0, label=name if j == 0 else None)
        axis.plot(time_s, 1e3 * (trace[:, j] - rest[j]), color="#204a87", lw=1.5)
        axis.axhline(1e3 * (stop.goal[j] - rest[j]), color="#a40000", lw=1.0, ls="--")
        axis.set_title(PANELS[j], fontsize=10)
        axis.margins(x=0)
    for axis in axes[1]:
        axis.set_xlabel("time [s]")
    status = f"skipped: {result.reason}" if result.reason else "reached"
    figure.suptitle(f"One pose of the procedure ({status}); dashed: goal", fontsize=11)
    figure.legend(loc="outside lower center", ncols=len(COLOURS), fontsize=9, frameon=False)
    path.parent.mkdir(parents=True, exist_ok=True)
    # Without a date the same picture gives the same bytes.
    figure.savefig(path, dpi=110, metadata={"Date": None} if path.suffix == ".svg" else {})


def campaign_of(
    plan: Table,
    rig: RigSettings,
    seed: int = 0,
    *,
    source: Source | None = None,
    folder: Path | None = None,
) -> RobotCampaign:
    """A campaign of the arm that is not carried out; InputError of a rig without one."""
    if rig.rig.mode != "robot":
        raise InputError('the pictures show the arm; set [rig] mode = "robot" in the rig file')
    folder = cache_directory() if folder is None else folder
    require_arm(folder)
    source = fem_source(plan) if source is None else source
    return RobotCampaign(plan, rig, source, seed=seed, folder=folder)


def write_pictures(
    campaign: RobotCampaign, film: Path | None, phases: Path | None, progress: Progress = None
) -> list[str]:
    """Write the requested pictures; return a line about each.

    Parameters
    ----------
    campaign
        Of which the first poses are driven.
    film
        GIF of the first poses at four times their speed.
    phases
        Fig. 7 of the first pose that is reached, PNG, SVG or PDF.
    progress
        Called while poses are filmed.
    """
    lines = []
    if phases is not None:
        trip, stop = first_reached(campaign)
        draw_phases(trip, stop, campaign.plant.length_m, phases)
        reason = trip.stops[0].reason
        lines.append(
            f"{phases}: the phases of the first pose that the arm reaches"
            if not reason
            else f"{phases}: the phases of the first pose, which the arm does not reach: {reason}"
        )
    if film is not None:
        radius = float((campaign.plan.meta.mechanism or {}).get("radius_m", _RADIUS_M))
        stops = [trip.stops[0] for trip in campaign.trips[:_FILMED]]
        frames = write_film(campaign.setup, stops, film, radius, progress)
        lines.append(f"{film}: {len(stops)} poses, {frames} frames")
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("plan", type=Path)
    parser.add_argument("--rig", type=Path, required=True)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--film", type=Path, metavar="FILE.gif")
    parser.add_argument("--phases", type=Path, metavar="FILE.png")
    given = parser.parse_args()
    try:
        plan = ecm.read_table(given.plan, need="predict")
        campaign = campaign_of(plan, read_rig(given.rig), given.seed)
        print("\n".join(write_pictures(campaign, given.film, given.phases)))
    except ecm.EcmError as error:
        sys.exit(f"error: {error}")


if __name__ == "__main__":
    main()
