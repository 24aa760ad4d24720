"""Draws the pictures of the explanation and of the gallery: python docs/figures.py docs.

frames.svg and midframe.svg show where the frames are; models.svg and stiffness.svg are made from
examples/neck_measured.csv.
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray
from picture import BLUE, INK, ORANGE, centre_line

import ecm

F = NDArray[np.float64]
LENGTH_M, RADIUS_M = 0.1034, 0.033
BENT = np.array([0.088, 0.040, 0.0, 0.0, 0.0, 0.75])
EXAMPLE = Path(__file__).parents[1] / "examples" / "neck_measured.csv"
MODELS = ("linear", "energy4", "energy5")


def body(axes: plt.Axes, pose: F, colour: str) -> None:
    """Outline of the bent body in the plane of bending, in mm; x points up."""
    line, tangent = centre_line(pose, LENGTH_M)
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    left, right = line[:, :2] + RADIUS_M * normal, line[:, :2] - RADIUS_M * normal
    outline = 1e3 * np.concatenate([left, right[::-1]])
    axes.fill(outline[:, 1], outline[:, 0], color=colour, alpha=0.15, lw=0)
    axes.plot(1e3 * line[:, 1], 1e3 * line[:, 0], color=colour, lw=0.8, ls=":")


def frame(axes: plt.Axes, place_m: tuple[float, float], angle: float, name: str) -> None:
    """Axes x (up at angle 0) and y of a frame, with its name."""
    at = 1e3 * np.array([place_m[1], place_m[0]])
    along = {"x": (np.sin(angle), np.cos(angle)), "y": (np.cos(angle), -np.sin(angle))}
    for letter, way in along.items():
        tip = at + 24 * np.array(way)
        axes.annotate("", tip, at, arrowprops={"arrowstyle": "->", "color": INK, "lw": 1.6})
        # A little higher, so that the letter of y at the base stands above the clamp.
        letter_at = at + 28 * np.array(way) + np.array([0, 4])
        axes.text(*letter_at, letter, color=INK, ha="center", va="center")
    axes.text(*(at + np.array([-6, -8])), name, color=INK, ha="right", fontsize=9)


def drawing(title: str) -> tuple[plt.Figure, plt.Axes]:
    """A plane in mm without a box."""
    figure, axes = plt.subplots(figsize=(5.2, 4.6), layout="constrained")
    axes.set(aspect="equal", title=title)
    axes.axis("off")
    axes.plot([-45, 45], [-1.5, -1.5], color=INK, lw=4)
    axes.set(xlim=(-60, 100), ylim=(-16, 125))
    return figure, axes


def frames() -> plt.Figure:
    """Base frame, top frame at rest and bent, force and moment."""
    figure, axes = drawing("a pose p and the wrench h that holds it")
    rest = np.array([LENGTH_M, 0.0, 0.0, 0.0, 0.0, 0.0])
    body(axes, rest, INK)
    body(axes, BENT, BLUE)
    frame(axes, (0.0, 0.0), 0.0, "base frame")
    frame(axes, (BENT[0], BENT[1]), BENT[5], "top frame")
    at = 1e3 * np.array([BENT[1], BENT[0]])
    axes.annotate("", at, (0, 0), arrowprops={"arrowstyle": "->", "color": BLUE, "lw": 1.2})
    axes.text(*(at / 2 + np.array([6, -4])), "r", color=BLUE)
    axes.annotate(
        "", (at[0] + 38, at[1] + 4), at, arrowprops={"arrowstyle": "->", "color": ORANGE, "lw": 2}
    )
    axes.text(*(at + np.array([40, 3])), "f", color=ORANGE)
    turn = np.linspace(0.4, 2.4, 40)
    arc = at[:, None] + 15 * np.array([np.cos(turn), np.sin(turn)])
    axes.plot(*arc, color=ORANGE, lw=2)
    axes.text(*(at + np.array([-4, 19])), "τ", color=ORANGE)
    axes.text(-44, 1e3 * LENGTH_M + 6, "at rest", color=INK, fontsize=9)
    return figure


def midframe() -> plt.Figure:
    """The mid-frame between base and top."""
    figure, axes = drawing("the mid-frame, turned by half the angle")
    body(axes, BENT, BLUE)
    frame(axes, (0.0, 0.0), 0.0, "base")
    frame(axes, (BENT[0], BENT[1]), BENT[5], "top: turned by θ")
    frame(axes, (BENT[0] / 2, BENT[1] / 2), BENT[5] / 2, "middle: θ / 2")
    return figure


def models() -> plt.Figure:
    """Held-out error of each row by three models, over the angle of bending."""
    table = ecm.read_table(EXAMPLE)
    poses = table.select(np.flatnonzero(table.text("kind") == "pose"))
    ids = poses.column("pose_id")
    bend = np.degrees(np.linalg.norm(poses.poses[:, 4:], axis=1))
    figure, axes = plt.subplots(figsize=(6.4, 3.6), layout="constrained")
    for name, colour in zip(MODELS, (INK, ORANGE, BLUE), strict=True):
        error = np.empty(len(poses))
        for part in range(5):
            out = ids % 5 == part
            model = ecm.fit(poses.select(np.flatnonzero(~out)), name)
            wrong = model.predict(poses.poses[out]) - poses.wrenches[out]
            error[out] = np.linalg.norm(wrong[:, :3], axis=1)
        axes.semilogy(bend, error, "o", ms=4, color=colour, label=name, alpha=0.8)
    axes.axhline(0.3 * np.sqrt(3), color=INK, ls="--", lw=1)
    axes.text(46, 0.44, "noise of the force sensor", fontsize=8, ha="right", va="top")
    axes.set(xlabel="bending [degrees]", ylabel="error of the force [N]")
    axes.set_title("rows that the fit has not seen")
    axes.legend(frameon=False, fontsize=8)
    return figure


def stiffness() -> plt.Figure:
    """Three entries of K while the neck is bent."""
    model = ecm.fit(ecm.read_table(EXAMPLE), "energy5")
    angle = np.linspace(0.0, 0.6, 40)
    pose = np.zeros((40, 6))
    pose[:, 0] = LENGTH_M * np.sinc(angle / np.pi)  # an arc of this angle
    pose[:, 1] = LENGTH_M * (1 - np.cos(angle)) / np.maximum(angle, 1e-9)
    pose[:, 5] = angle
    K = model.stiffness(pose)
    figure, axes = plt.subplots(figsize=(6.4, 3.6), layout="constrained")
    for name, i, j, colour in (
        ("K(x, x)", 0, 0, BLUE), ("K(y, y)", 1, 1, ORANGE), ("K(θz, θz)", 5, 5, INK),
    ):  # fmt: skip
        axes.plot(np.degrees(angle), K[:, i, j] / K[0, i, j], color=colour, label=name)
    axes.set(xlabel="bending [degrees]", ylabel="over its value at rest")
    axes.set_title("the stiffness changes with the pose")
    axes.legend(frameon=False, fontsize=8)
    return figure


def main(folder: Path) -> None:
    """Write every picture."""
    plt.rcParams["svg.hashsalt"] = "ecm"
    for draw in (frames, midframe, models, stiffness):
        figure = draw()
        figure.savefig(folder / f"{draw.__name__}.svg", metadata={"Date": None})
        plt.close(figure)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
