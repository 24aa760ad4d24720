"""How many poses does each model need: learning tables on FEM data of the neck.

    python benches/models_learning.py --out out/learning            (its own FEM data, minutes)
    python benches/models_learning.py --data SIMULATED.csv --out out/learning

Plain cubic and energies of degree 4, 5, 6 from 10 to 1400 poses, drawn at random or D-optimal,
without noise and with the rig's; the goals of both weights of a fit without noise; what decides
the error of the cubic; then bodies that are not quite symmetric, with and without groups. Writes
NAME.md and NAME.json of each part into the folder of --out; --part NAME makes one alone.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ecm import _native
from ecm.effects import Rows
from ecm.errors import EcmError
from ecm.fem.simulate import TABLE_I_MAX, TABLE_I_MIN, Workspace, simulate
from ecm.io.columns import POSE, WRENCH
from ecm.io.description import Instrument, Meta
from ecm.io.mechanism import Mechanism
from ecm.io.table import Table, read_table
from ecm.models import fit_model
from ecm.models.specification import Weights
from ecm.regression.noise import Noise, whiteners

F = NDArray[np.float64]
I = NDArray[np.int64]
Figures = dict[str, object]
L, RADIUS, MODULUS, POISSON = 0.1034, 0.033, 0.65e6, 0.49
TEST = 300
SIZES = (10, 20, 50, 100, 200, 1400)
MODELS = ("cubic", "energy4", "energy5", "energy6")
RIG = Noise(source="declared")
NO_NOISE = Noise(0.0, 0.0, 0.0, 0.0, source="declared")
DESIGN_STEPS = 5
"""Budget of the D-optimal exchange, in disturbances of each chain: no clock, so reproducible."""
BROKEN = ("anisotropy", "precurvature", "face_tilt")
DRAWS = 8
GOAL_DRAWS = 32
"""A median of eight is off by a fifth from another eight."""


def table_of(poses: F, wrenches: F, noise: Noise = NO_NOISE) -> Table:
    columns = dict(zip(POSE, poses.T, strict=True)) | dict(zip(WRENCH, wrenches.T, strict=True))
    instrument = Instrument(
        pose_position_sd_m=noise.position_sd_m,
        pose_rotation_sd_rad=noise.rotation_sd_rad,
        force_sd_N=noise.force_sd_N,
        torque_sd_Nm=noise.torque_sd_Nm,
    )
    return Table(columns, Meta(mechanism={"length_m": L}, instrument=instrument), "bench")


def measured(poses: F, wrenches: F, noise: Noise, seed: list[int]) -> tuple[F, F]:
    """With the noise of pose (rotations as increments in base axes) and of wrench."""
    random = np.random.default_rng(seed)
    turn = noise.rotation_sd_rad * random.standard_normal((len(poses), 3))
    jacobian = _native.left_jacobians(np.ascontiguousarray(poses[:, 3:]))
    change = np.hstack(
        [
            noise.position_sd_m * random.standard_normal((len(poses), 3)),
            np.linalg.solve(jacobian, turn[:, :, None])[:, :, 0],
        ]
    )
    sd = np.repeat([noise.force_sd_N, noise.torque_sd_Nm], 3)
    return poses + change, wrenches + sd * random.standard_normal(wrenches.shape)


def designed(poses: F, wrenches: F, model: str, n: int) -> I | None:
    """D-optimal rows for a model; None where there are fewer equations than coefficients."""
    if model == "cubic":
        regressor = _native.polynomial_regressor(poses, 3, poses.min(axis=0), poses.max(axis=0))
        if n < regressor.shape[1]:
            return None
        design = _native.d_optimal(regressor, n, starts=1, seed=0, iterations=100 * DESIGN_STEPS)
    else:
        base = fit_model(table_of(poses, wrenches), model).base
        columns = base.columns(poses) / wrenches.std(axis=0)[:, None]
        flat = columns.reshape(-1, columns.shape[2])
        flat = flat / np.linalg.norm(flat, axis=0)
        if 6 * n < flat.shape[1]:
            return None
        design = _native.d_optimal(
            np.ascontiguousarray(flat),
            n,
            rows_per_pose=6,
            starts=1,
            seed=0,
            iterations=DESIGN_STEPS,
        )
    return np.asarray(design.indices)


class Body:
    """Pairs of one body, the last of them held out."""

    def __init__(self, poses: F, wrenches: F, test: int = TEST) -> None:
        order = np.random.default_rng(0).permutation(len(poses))
        self.test, self.pool = order[:test], order[test:]
        self.poses, self.wrenches = poses, wrenches
        self.designs: dict[tuple[str, int], I | None] = {}
        reference = fit_model(table_of(poses, wrenches), "energy6").base
        rows = Rows(table_of(poses[self.test], wrenches[self.test]), reference)
        self.whitener = whiteners(RIG.covariance(rows))

    def errors(
        self, model: str, rows: I, noise: Noise | None, seed: int, weights: Weights = "auto"
    ) -> tuple[F, float]:
        """(6,) RMSE and the whitened one on exact held-out pairs, of a fit to these rows."""
        poses, wrenches = self.poses[rows], self.wrenches[rows]
        if noise is not None:
            poses, wrenches = measured(poses, wrenches, noise, [seed, len(rows)])
        table = table_of(poses, wrenches, NO_NOISE if noise is None else noise)
        try:
            base = fit_model(table, model, weights=weights).base
        except EcmError:
            return np.full(6, np.inf), np.inf
        left = base.predict(self.poses[self.test]) - self.wrenches[self.test]
        white = np.einsum("nij,nj->ni", self.whitener, left)
        return np.sqrt((left**2).mean(axis=0)), float(np.sqrt((white**2).mean()))

    def line(
        self,
        model: str,
        n: int,
        noise: Noise | None,
        *,
        design: bool,
        weights: Weights = "auto",
        draws: int = DRAWS,
    ) -> dict[str, object]:
        """One row of a table: median and quartiles over draws."""
        pool = self.pool
        n = min(n, len(pool))
        if design:
            if (model, n) not in self.designs:
                pairs = self.poses[pool].copy(), self.wrenches[pool].copy()
                self.designs[model, n] = designed(*pairs, model, n)
            picked = self.designs[model, n]
            rows = [] if picked is None else [pool[picked]] * (1 if noise is None else draws)
        else:
            rows = [
                np.sort(np.random.default_rng([d, n]).permutation(pool)[:n])
                for d in range(draws if n < len(pool) else 1 if noise is None else 3)
            ]
        errors = [self.errors(model, r, noise, d, weights) for d, r in enumerate(rows)]
        if not errors:
            errors = [(np.full(6, np.inf), np.inf)]
        each = np.array([rmse for rmse, _ in errors])
        white = np.array([whitened for _, whitened in errors])
        quartiles = np.percentile(white, [25, 75]) if np.isfinite(white).all() else [np.inf] * 2
        return {
            "model": model,
            "poses": n,
            "rmse": np.median(each, axis=0).tolist(),
            "whitened": float(np.median(white)),
            "quartiles": [float(q) for q in quartiles],
        }


def bent_mesh(kind: str) -> _native.Mesh:
    """The neck's mesh with moved nodes."""
    mesh = _native.Mesh.cylinder(length_m=L, radius_m=RADIUS)
    x = mesh.nodes_m.copy()
    share = x[:, 0] / L
    if kind == "precurvature":  # 1 mm in the middle, ends square
        x[:, 1] += 1e-3 * np.sin(np.pi * share) ** 2
    if kind == "face_tilt":  # the top face leans by one degree
        x[:, 0] += np.tan(np.deg2rad(1.0)) * share * x[:, 1]
    return _native.Mesh.from_arrays(
        x, mesh.tetrahedra, base_nodes=mesh.base_nodes, top_nodes=mesh.top_nodes
    )


def broken_body(kind: str, wrenches: F, folder: Path) -> tuple[F, F]:
    """Pairs of a body that is not quite symmetric; stored in the folder."""
    path = folder / f"{kind}.npz"
    if path.exists():
        stored = np.load(path)
        return stored["poses"], stored["wrenches"]
    scale = None
    if kind == "anisotropy":
        mesh = _native.Mesh.cylinder(length_m=L, radius_m=RADIUS)
        centres = mesh.nodes_m[mesh.tetrahedra[:, :4]].mean(axis=1)
        scale = 1.0 + 0.02 * np.cos(2.0 * np.arctan2(centres[:, 2], centres[:, 1]))
    else:
        mesh = bent_mesh(kind)
    fem = _native.Fem(
        mesh, young_modulus_Pa=MODULUS, poisson_ratio=POISSON, element_modulus_scale=scale
    )
    cases = fem.solve_wrenches(np.ascontiguousarray(wrenches))
    ok = np.array([s == "solved" for s in cases.status])
    np.savez(path, poses=cases.poses[ok], wrenches=cases.wrenches[ok])
    return cases.poses[ok], cases.wrenches[ok]


def shown(lines: list[dict[str, object]]) -> list[str]:
    """A markdown table."""
    text = [
        "| model | poses | fx | fy | fz | tau_x | tau_y | tau_z | over noise | quartiles |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for line in lines:
        rmse: list[float] = line["rmse"]  # type: ignore[assignment]
        if not np.isfinite(rmse).all():
            text.append(f"| {line['model']} | {line['poses']} |" + " too few |" + " |" * 7)
            continue
        low, high = line["quartiles"]  # type: ignore[misc]
        text.append(
            f"| {line['model']} | {line['poses']} | "
            + " | ".join(f"{v:.2g}" for v in rmse)
            + f" | {line['whitened']:.3g} | {low:.2g}..{high:.2g} |"
        )
    return text


def floor_line(lines: list[dict[str, object]]) -> list[str]:
    """The fewest poses whose held-out error with noise is within 5 % of the floor."""
    limit = np.sqrt(1.05**2 - 1.0)
    text = []
    for model in dict.fromkeys(str(line["model"]) for line in lines):
        enough = [
            int(line["poses"])  # type: ignore[call-overload]
            for line in lines
            if line["model"] == model and float(line["whitened"]) <= limit  # type: ignore[arg-type]
        ]
        text.append(f"{model}: {min(enough) if enough else 'more than 1400'}")
    return text


def part_sizes(neck: Body, figures: Figures) -> list[str]:
    """Random and designed poses, without noise and with it."""
    text = []
    for title, noise, design in (
        ("random poses, no noise", None, False),
        ("D-optimal poses, no noise", None, True),
        ("random poses, the rig's noise", RIG, False),
        ("D-optimal poses, the rig's noise", RIG, True),
    ):
        start = time.perf_counter()
        lines = [
            neck.line(model, n, noise, design=design)
            for model in MODELS
            for n in SIZES
            if not (design and n > 200)
        ]
        figures[title] = lines
        text += [f"### Neck, {title}", "", *shown(lines), ""]
        if noise is not None:
            text += ["Within 5 % of the noise floor from: " + "; ".join(floor_line(lines)), ""]
        print(f"{title}: {time.perf_counter() - start:.0f} s", flush=True)
    return text


def part_goals(neck: Body, figures: Figures) -> list[str]:
    """Degree 4 from 10 and degree 6 from 50 poses: how many times better than the cubic from 200.

    Each weight of the fit, each way to choose the poses; the cubic's are chosen the same way.
    """
    goals, text = [], []
    for design in (False, True):
        cubic = neck.line("cubic", 200, None, design=design, draws=GOAL_DRAWS)
        for weights in ("spread", "noise"):
            for model, n in (("energy4", 10), ("energy6", 50)):
                own = neck.line(model, n, None, design=design, weights=weights, draws=GOAL_DRAWS)
                times = np.array(cubic["rmse"]) / np.array(own["rmse"])
                where = "D-optimal" if design else "random"
                goals.append(
                    {
                        "poses": where,
                        "weights": weights,
                        "model": model,
                        "n": n,
                        "times": times.tolist(),
                    }
                )
                shares = " | ".join(f"{v:.3g}" for v in times)
                text.append(f"| {model} from {n} | {where} | {weights} | {shares} |")
    figures["goals"] = goals
    return [
        "### Goals without noise: error of the cubic from 200 poses over that of the energy",
        "",
        "| model | poses | weights | fx | fy | fz | tau_x | tau_y | tau_z |",
        "|---|---|---|---|---|---|---|---|---|",
        *text,
        "",
    ]


def part_reach(neck: Body, figures: Figures) -> list[str]:
    """Cut by the shift of the mid frame."""
    reach = np.linalg.norm(_native.mid_frame(neck.poses, L)[:, :3], axis=1)
    lines = []
    for limit in (0.015, 0.020, 0.025, 0.030, 0.045):
        part = Body(neck.poses[reach < limit], neck.wrenches[reach < limit], test=60)
        for model, n in (("cubic", 200), ("energy4", 10), ("energy4", 50), ("energy6", 50)):
            line = part.line(model, n, None, design=False)
            line["model"] = f"{model}, \\|c\\| < {1e3 * limit:.0f} mm"
            lines.append(line)
    figures["reach"] = lines
    title = "### Neck, by the reach of the workspace, random poses, no noise"
    return [title, "", *shown(lines), ""]


def part_loads(neck: Body, figures: Figures, folder: Path) -> list[str]:
    """What decides the cubic's error: rotation, reach, axial load, load box, degree."""
    angle = np.linalg.norm(neck.poses[:, 3:], axis=1)
    reach = np.linalg.norm(_native.mid_frame(neck.poses, L)[:, :3], axis=1)
    force = neck.wrenches
    whole = np.ones(len(angle), dtype=np.bool_)
    cuts = [
        ("whole box", whole),
        ("rotation < 0.5 rad", angle < 0.5),
        ("\\|c\\| < 20 mm", reach < 0.020),
        ("\\|fy, fz\\| < 50 N", np.hypot(force[:, 1], force[:, 2]) < 50.0),
        ("\\|fx\\| < 40 N", np.abs(force[:, 0]) < 40.0),
    ]
    bodies = [(name, Body(neck.poses[m], neck.wrenches[m], test=60)) for name, m in cuts]
    bodies.append(("half the box", Body(*smaller_box(0.5, 400, folder), test=60)))
    lines = []
    for name, body in bodies:
        fits = [("cubic", 200), ("cubic", 5000)]
        if name == "whole box":
            fits += [("poly:4", 5000), ("poly:5", 5000)]
        if "box" in name:
            fits += [("energy4", 10), ("energy4", 50), ("energy5", 15), ("energy6", 50)]
        for model, n in fits:
            line = body.line(model, n, None, design=False)
            line["model"] = f"{model}, {name}"
            lines.append(line)
    figures["loads"] = lines
    return ["### Neck, what decides the error of the cubic, no noise", "", *shown(lines), ""]


def smaller_box(share: float, count: int, folder: Path) -> tuple[F, F]:
    """FEM pairs of a smaller load box, all six components by the same share."""
    box = Workspace(
        wrench_min=tuple(share * v for v in TABLE_I_MIN),
        wrench_max=tuple(share * v for v in TABLE_I_MAX),
    )
    pairs = simulate(Mechanism(), count, box, seed=3, directory=folder / f"box-{share}")
    return pairs.poses, pairs.wrenches


def part_full(count: int, figures: Figures, folder: Path) -> list[str]:
    """Every stable solution of the paper's load box, however far it turns."""
    far = simulate(Mechanism(), count, Workspace(full_box=True), seed=4, directory=folder / "full")
    body = Body(far.poses, far.wrenches, test=100)
    angle = np.linalg.norm(far.poses[:, 3:], axis=1)
    text = [
        f"Rotation of the {len(angle)} poses: median {np.median(angle):.2f} rad, nine tenths below "
        f"{np.quantile(angle, 0.9):.2f}, largest {angle.max():.2f}.",
        "",
    ]
    for title, noise in (("no noise", None), ("the rig's noise", RIG)):
        lines = [
            body.line(model, n, noise, design=False)
            for model in MODELS
            for n in (10, 20, 50, 100, 200, count)
        ]
        figures[f"full, {title}"] = lines
        text += [f"### Neck, the full workspace, random poses, {title}", "", *shown(lines), ""]
    return text


def part_broken(wrenches: F, figures: Figures, folder: Path) -> list[str]:
    """Bodies that are not quite symmetric, with and without the group of the fault."""
    text = []
    for kind in BROKEN:
        uneven = Body(*broken_body(kind, wrenches, folder), test=60)
        lines = [
            uneven.line(model, n, noise, design=False)
            for noise in (None, RIG)
            for model in ("cubic", "energy4", f"energy4+{kind}", "energy6", f"energy6+{kind}")
            for n in (50, 200, 400)
        ]
        figures[kind] = lines
        half = len(lines) // 2
        for title, part_lines in (("no noise", lines[:half]), ("the rig's noise", lines[half:])):
            text += [f"### Neck with {kind}, random poses, {title}", "", *shown(part_lines), ""]
        print(kind, flush=True)
    return text


PARTS = ("sizes", "goals", "reach", "loads", "full", "broken")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--part", choices=PARTS, action="append")
    parser.add_argument("--broken", type=int, default=360, help="pairs per unsymmetric body")
    parser.add_argument("--full", type=int, default=500, help="pairs of the full workspace")
    arguments = parser.parse_args()
    out: Path = arguments.out
    out.mkdir(parents=True, exist_ok=True)
    if arguments.data is None:
        pairs = simulate(Mechanism(), 1700, directory=out / "fem")
        poses, wrenches = pairs.poses, pairs.wrenches
    else:
        data = read_table([arguments.data])
        poses, wrenches = data.poses.copy(), data.wrenches.copy()
    neck = Body(poses, wrenches)
    for part in arguments.part or PARTS:
        figures: Figures = {"rows": len(poses)}
        if part == "sizes":
            text = part_sizes(neck, figures)
        elif part == "goals":
            text = part_goals(neck, figures)
        elif part == "reach":
            text = part_reach(neck, figures)
        elif part == "loads":
            text = part_loads(neck, figures, out)
        elif part == "full":
            text = part_full(arguments.full, figures, out)
        else:
            text = part_broken(wrenches[: arguments.broken], figures, out)
        (out / f"{part}.md").write_text("\n".join(text), encoding="utf-8")
        (out / f"{part}.json").write_text(json.dumps(figures, indent=1), encoding="utf-8")
        print("\n".join(text), flush=True)


if __name__ == "__main__":
    main()
