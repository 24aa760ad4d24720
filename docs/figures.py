"""Draws the pictures of the explanation and of the gallery: python docs/figures.py docs.

frames.svg and midframe.svg show where the frames are; models.svg and stiffness.svg are made from
examples/neck_measured.csv. chambers.svg shows an arm with chambers; potential.svg and valve.svg are
made from examples/wound_arm_pairs.csv. Each record of measurements in benches/results has one
picture of its name.
"""

from __future__ import annotations

import csv
import re
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray
from picture import BLUE, INK, ORANGE, centre_line

import ecm
from ecm.models import Model

F = NDArray[np.float64]
LENGTH_M, RADIUS_M = 0.1034, 0.033
BENT = np.array([0.088, 0.040, 0.0, 0.0, 0.0, 0.75])
EXAMPLE = Path(__file__).parents[1] / "examples" / "neck_measured.csv"
ARM = EXAMPLE.with_name("wound_arm_pairs.csv")
ARM_LENGTH_M, ARM_RADIUS_M, INNER_M, OUTER_M = 0.1, 0.02, 0.0075, 0.0165
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


def arm_model() -> Model:
    """The energy of pose and pressures of the wound arm, its volumes among the data."""
    return ecm.fit(ecm.read_table(ARM), "actuated4")


def chambers() -> plt.Figure:
    """The arm from above and from the side: chambers, a tendon, frames, inputs and amounts."""
    figure, (above, side) = plt.subplots(
        1, 2, figsize=(7.6, 4.4), width_ratios=(1.0, 1.25), layout="constrained"
    )
    for axes in (above, side):
        axes.set(aspect="equal")
        axes.axis("off")
    turn = np.linspace(0.0, 2.0 * np.pi, 90)
    circle = np.array([np.cos(turn), np.sin(turn)])
    above.fill(*(1e3 * ARM_RADIUS_M * circle), color=INK, alpha=0.15, lw=0)
    middle, radius = 500.0 * (INNER_M + OUTER_M), 500.0 * (OUTER_M - INNER_M)
    for k in range(3):
        at = middle * np.array([np.cos(2.0 * np.pi * k / 3.0), np.sin(2.0 * np.pi * k / 3.0)])
        above.fill(*(at[:, None] + radius * circle), color=BLUE, alpha=0.35, lw=0)
        above.text(*at, f"$P_{k + 1}$", color=INK, ha="center", va="center")
        on = 18.5 / middle * at
        above.plot(*on, "o", ms=5, color=ORANGE)
    above.text(20.5, 2.5, "$T_1$", color=ORANGE)
    for letter, tip in (("y", (31.0, 0.0)), ("z", (0.0, 31.0))):
        above.annotate("", tip, (0, 0), arrowprops={"arrowstyle": "->", "color": INK, "lw": 1.4})
        above.text(*(1.08 * np.array(tip)), letter, color=INK, ha="center", va="center")
    above.set(xlim=(-26, 36), ylim=(-30, 36), title="from the platform, x towards you")

    bent, _ = arm_model().free_pose(np.array([4e4, 0.0, 0.0]))
    line, tangent = centre_line(bent, ARM_LENGTH_M)
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
    normal /= np.linalg.norm(normal, axis=1)[:, None]

    def along(offset_m: float) -> F:
        return 1e3 * (line[:, :2] + offset_m * normal)[:, ::-1]

    def band(low_m: float, high_m: float, colour: str, alpha: float) -> None:
        outline = np.concatenate([along(low_m), along(high_m)[::-1]])
        side.fill(*outline.T, color=colour, alpha=alpha, lw=0)

    band(-ARM_RADIUS_M, ARM_RADIUS_M, INK, 0.15)
    band(INNER_M, OUTER_M, BLUE, 0.45)
    side.plot(*along(0.0185).T, color=ORANGE, lw=1.6)
    side.plot([-32, 32], [-1.5, -1.5], color=INK, lw=4)
    end = np.stack([along(-ARM_RADIUS_M)[-1], along(ARM_RADIUS_M)[-1]])
    side.plot(*end.T, color=INK, lw=4)
    frame(side, (0.0, 0.0), 0.0, "")
    frame(side, (bent[0], bent[1]), bent[5], "")
    side.text(*(along(0.031)[16]), "$P_1, V_1$", color=BLUE, va="center")
    side.text(*(along(0.023)[28]), "$T_1$", color=ORANGE, va="center")
    side.text(36, -9, "base", color=INK, ha="right", fontsize=9)
    side.text(*(end[1] + np.array([4, -4])), "platform: pose p", color=INK, fontsize=9)
    side.set(xlim=(-90, 75), ylim=(-14, 135), title="pressure in chamber 1 bends it away")
    return figure


def potential() -> plt.Figure:
    """The potential along a way from the rest pose to a free pose, and its slope, at pressures."""
    model = arm_model()
    rest = np.array([ARM_LENGTH_M, 0.0, 0.0, 0.0, 0.0, 0.0])
    end, _ = model.free_pose(np.array([4e4, 0.0, 0.0]))
    share = np.linspace(-0.4, 1.4, 400)
    way = rest + share[:, None] * (end - rest)
    figure, (top, below) = plt.subplots(2, 1, figsize=(6.0, 5.0), sharex=True, layout="constrained")
    bend = -np.degrees(way[:, 5])
    for pressure, colour in ((0.0, INK), (2e4, ORANGE), (4e4, BLUE)):
        rows = np.tile([pressure, 0.0, 0.0], (400, 1))
        slope = model.predict(way, rows) @ (end - rest)
        rise = np.concatenate([[0.0], np.cumsum(0.5 * (slope[1:] + slope[:-1]) * np.diff(share))])
        rise -= np.interp(0.0, share, rise)
        least = int(np.argmin(rise))
        name = f"$P_1$ = {pressure / 1e3:.0f} kPa"
        top.plot(bend, 1e3 * rise, color=colour, label=name)
        top.plot(bend[least], 1e3 * rise[least], "o", color=colour)
        below.plot(bend, 1e3 * slope, color=colour)
        below.plot(bend[least], 0.0, "o", color=colour)
    below.axhline(0.0, color=INK, lw=0.8)
    top.set(ylabel="potential Π [mJ]", title="the free pose is where the potential is least")
    below.set(xlabel="bent away from chamber 1 [degrees]", ylabel="its slope, from h [mJ]")
    top.legend(frameon=False, fontsize=8)
    return figure


def valve() -> plt.Figure:
    """Force along the arm against its extension, at held pressures and at held volumes."""
    model = arm_model()
    amounts, start = model.actuated, np.full(3, 2e4)
    free, _ = model.free_pose(start)
    held = amounts.amounts(np.concatenate([free, start])[None])[0]
    extension = np.linspace(-2e-3, 2e-3, 41)
    force = np.empty((2, 41))
    for i, x in enumerate(extension):
        pose, a = free + np.array([x, 0.0, 0.0, 0.0, 0.0, 0.0]), start.copy()
        force[0, i] = model.predict(pose, a)[0]
        for _ in range(20):
            row = np.concatenate([pose, a])[None]
            a += np.linalg.solve(amounts.amount_jacobian(row)[0], held - amounts.amounts(row)[0])
        force[1, i] = model.predict(pose, a)[0]
    figure, axes = plt.subplots(figsize=(6.0, 3.6), layout="constrained")
    labels = ("valves open: pressures held, K", "valves closed: volumes held, K + G C⁻¹ Gᵀ")
    for row, label, colour in zip(force, labels, (BLUE, ORANGE), strict=True):
        axes.plot(1e3 * extension, row, color=colour, label=label)
    axes.axhline(0.0, color=INK, lw=0.8)
    axes.set(xlabel="extension of the arm [mm]", ylabel="force along it [N]")
    axes.set_title("a closed valve makes the arm stiffer")
    axes.legend(frameon=False, fontsize=8)
    return figure


def results(name: str) -> list[dict[str, str]]:
    """Lines of a record of measurements."""
    with (EXAMPLE.parents[1] / "benches" / "results" / name).open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def models_learning() -> plt.Figure:
    """Error over noise against the number of random poses."""
    figure, axes = plt.subplots(
        1, 2, figsize=(9, 3.4), sharex=True, sharey=True, layout="constrained"
    )
    for place, noise in zip(axes, ("no noise", "the rig's noise"), strict=True):
        lines = [
            line
            for line in results("models_learning.csv")
            if line["poses_and_noise"] == f"Neck, random poses, {noise}" and line["over_noise"]
        ]
        for name in dict.fromkeys(line["model"] for line in lines):
            own = [line for line in lines if line["model"] == name]
            poses, error = ([float(line[key]) for line in own] for key in ("poses", "over_noise"))
            place.loglog(poses, error, "o-", ms=3, lw=1.2, label=name)
        place.axhline(1.0, color=INK, lw=0.6, ls=":")
        place.set(title=f"random poses, {noise}", xlabel="poses")
    axes[0].set_ylabel("error over the noise of one row")
    axes[1].legend(frameon=False)
    return figure


_WHOLE = "e6912aa7"
"""The last version of which the whole first benchmark was run."""


def blind_first() -> plt.Figure:
    """Share of right answers of the blind benchmark, with goals as lines."""
    shown = [one for one in results("blind_first.csv") if one["goal"].startswith(">=")]
    lines = [one for one in shown if one[_WHOLE] not in ("", "–")]
    figure, axes = plt.subplots(figsize=(7, 3.2), layout="constrained")
    places = np.arange(len(lines))[::-1]
    axes.barh(places, [float(one[_WHOLE].split()[0]) for one in lines], color=BLUE, height=0.6)
    goals = [float(one["goal"].split()[-1]) for one in lines]
    axes.vlines(goals, places - 0.4, places + 0.4, color=ORANGE, lw=2)
    axes.set_yticks(places, [one["figure"] for one in lines], fontsize=8)
    axes.set(xlim=(0.5, 1.0), xlabel="share of the sets (lines: goals)")
    return figure


def blind_first_beside() -> plt.Figure:
    """What goes with the blind benchmark: each value over its goal; shares that have no goal."""
    lines = results("blind_first_beside.csv")
    held = [one for one in lines if one["goal"]]
    free = [one for one in lines if not one["goal"]]
    figure, (axes, below) = plt.subplots(
        2, 1, figsize=(7, 4.4), height_ratios=(len(held), len(free)), layout="constrained"
    )
    for place, one in zip(np.arange(len(held))[::-1], held, strict=True):
        words, most = one["goal"].split(), 1.3
        goal = float(words[-1])
        low, high = {"<=": (0.0, 1.0), ">=": (1.0, most)}.get(words[0], (0.0, 0.0))
        if words[1] == "to":
            goal = 0.5 * (float(words[0]) + float(words[2]))
            low, high = float(words[0]) / goal, float(words[2]) / goal
        axes.barh(place, high - low, 0.7, low, color=BLUE, alpha=0.25)
        axes.plot(float(one["ours"]) / goal, place, "o", ms=5, color=ORANGE)
    axes.set_yticks(np.arange(len(held))[::-1], [one["beside"] for one in held], fontsize=8)
    axes.set(xlim=(0.0, 1.3), xlabel="value over its goal (band: met)")
    below.barh(np.arange(len(free))[::-1], [float(one["ours"]) for one in free], 0.6, color=BLUE)
    below.set_yticks(np.arange(len(free))[::-1], [one["beside"] for one in free], fontsize=8)
    below.set(xlim=(0.0, 1.0), xlabel="share of the sets (no goal)")
    return figure


def rubber() -> plt.Figure:
    """The log of docs/howto/rubber.md: stiffness and loss angle, measured and by its model."""
    page = Path(__file__).with_name("howto") / "rubber.md"
    made, toml = re.findall(
        r"^```(?:python|toml \S+)\n(.*?)^```$", page.read_text(encoding="utf-8"), re.M | re.S
    )[:2]
    page_names: dict[str, Any] = {}
    exec(made.partition("\nbushing(")[0], page_names)
    with TemporaryDirectory() as folder:
        path, meta = (Path(folder) / f"bushing.{kind}" for kind in ("csv", "toml"))
        page_names["bushing"](path)
        meta.write_text(toml, encoding="utf-8")
        log = ecm.import_log(path, columns={"run": "block"}, axis="x", meta=meta)
    model = ecm.fit(log.table, "linear")
    model = ecm.refit(model, log.table, add=["stress_relaxation", "hysteresis"])
    measured, modelled = (ecm.dynamic_stiffness(log.table, how) for how in (None, model))
    figure, (above, below) = plt.subplots(2, 1, figsize=(7, 5), sharex=True, layout="constrained")
    amplitudes = (1e3 * measured["amplitude"]).round(1)
    for amplitude, colour in zip(np.unique(amplitudes), (BLUE, ORANGE, INK), strict=True):
        rows = amplitudes == amplitude
        for axes, name, factor in ((above, "stiffness", 1e-3), (below, "loss_angle_deg", 1.0)):
            over = measured["frequency_Hz"][rows]
            axes.plot(over, factor * measured[name][rows], "o", color=colour)
            axes.plot(over, factor * modelled[name][rows], color=colour, label=f"{amplitude} mm")
    above.set(xscale="log", ylabel="|K*| [N/mm]")
    above.legend(fontsize=8, frameon=False)
    below.set(xlabel="frequency [Hz]", ylabel="loss angle [deg]")
    return figure


def share(text: str) -> float:
    """A number of a record; `23 of 24` is a share."""
    part, _, whole = text.partition(" of ")
    return float(part) / float(whole or 1)


def record(name: str) -> plt.Figure:
    """A record of benches/results as bars: parts of a whole, or values side by side."""
    label, columns, whole, across = RECORDS[name]
    lines = results(f"{name}.csv")
    high = 0.7 if whole else 0.7 / len(columns)
    height = 0.9 + len(lines) * max(0.3, 0.0 if whole else 0.11 * len(columns))
    figure, axes = plt.subplots(figsize=(7, height), layout="constrained")
    places, left = np.arange(len(lines))[::-1], np.zeros(len(lines))
    for k, column in enumerate(columns):
        values = np.array([share(one[column]) / float(one[whole] if whole else 1) for one in lines])
        at = places if whole else places - high * (k - (len(columns) - 1) / 2)
        colour = plt.get_cmap("cividis")(k / max(1, len(columns) - 1))
        axes.barh(at, values, high, left if whole else 0.0, color=colour, label=column)
        left += values
    axes.set_yticks(places, [one[label].partition(":")[0] for one in lines], fontsize=8)
    axes.set(xlabel=across, ylim=(-0.6, len(lines) - 0.4))
    if len(columns) > 1:
        figure.legend(loc="outside upper center", ncols=4, fontsize=8, frameon=False)
    return figure


_ANSWERS = ("right", "right, and another name", "one of two", "unknown", "none",
            "class without it", "clean wrong name")  # fmt: skip
RECORDS: dict[str, tuple[str, tuple[str, ...], str, str]] = {
    "blind_second": ("--seed", ("one effect, s = 1", "s = 3"), "", "share of the sets, right"),
    "blind_third": ("--seed", ("right", "family", "unknown", "none", "no class of three",
                               "wrong class", "wrong name"), "sets", "share of the sets"),
    "blind_fourth": ("sample", ("named at s = 1", "nothing hidden", "pairs", "wrong names"), "",
                     "share of the sets"),
    "blind_kinds": ("kind", _ANSWERS, "sets", "share of the sets"),
    "blind_ablation": ("without", ("other answers",), "", "answers that change, of 47 sets"),
    "eight_effects": ("hidden", ("error_before", "error_after"), "",
                      "held-out error over the noise"),
}  # fmt: skip
"""Records: the column of labels, the columns that are drawn, that of the whole they are of, and
what the axis says."""


def main(folder: Path) -> None:
    """Write every picture."""
    plt.rcParams["svg.hashsalt"] = "ecm"
    for draw in PICTURES:
        save(draw(), folder / f"{draw.__name__}.svg")
    for name in RECORDS:
        save(record(name), folder / f"{name}.svg")


def save(figure: plt.Figure, path: Path) -> None:
    """Write a picture, the same bytes each time."""
    figure.savefig(path, metadata={"Date": None})
    plt.close(figure)


PICTURES = (
    frames, midframe, models, stiffness, chambers, potential, valve, models_learning, blind_first,
    blind_first_beside, rubber,
)  # fmt: skip


if __name__ == "__main__":
    main(Path(sys.argv[1]))
