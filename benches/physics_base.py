"""The physics base: time to build, error against FEM that it has not seen, refit, time a call.

    python benches/physics_base.py [SHAPE ...] [--cold] [--rows 100] [--bodies 4] [--draws 20]
                                   [--reach 2.4] [--box 700]

Shapes: neck, slim, tube, hourglass, stacked_discs, yeoh, cone, ellipse (the last two are meshes of
their own). `--cold` builds into an empty folder and prints the time, else the cache is used.
Errors are whitened: 1 is the noise of one row of the rig (37 um, 0.6 mrad, 0.3 N, 10 mN m).
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ecm._native import Fem, Mesh, mid_frame
from ecm.fem.simulate import Workspace, fem_poses, simulate
from ecm.io.columns import POSE, WRENCH
from ecm.io.description import Meta
from ecm.io.mechanism import Material, Mechanism
from ecm.io.table import Table
from ecm.models import PhysicsMap, physics_map
from ecm.models.physics.body_fits import NOISE, noise_whiteners, workspace_poses
from ecm.models.physics.build import diameter, with_poisson_ratio
from ecm.models.physics.family import PARAMETERS
from ecm.models.physics.refit import refit_physics
from ecm.regression.blas import one_blas_thread
from ecm.regression.noise import Noise

F = NDArray[np.float64]

YEOH = Material("yeoh", {"c1_Pa": 1.09e5, "c2_Pa": 4e3, "c3_Pa": 100.0, "poisson_ratio": 0.49})
BODIES = {
    "neck": Mechanism(),
    "slim": replace(Mechanism(), radius_m=0.015, poisson_ratio=0.45),
    "tube": replace(Mechanism(), builtin="tube", inner_radius_m=0.022),
    "hourglass": replace(Mechanism(), builtin="hourglass", waist_radius_m=0.024),
    "stacked_discs": replace(
        Mechanism(), builtin="stacked_discs", waist_radius_m=0.022, disc_count=4
    ),
    "yeoh": replace(Mechanism(), material=YEOH, young_modulus_Pa=YEOH.young_modulus_Pa),
}
OWN_MESHES = {"cone": (0.85, 0.85), "ellipse": (1.0, 0.92)}
"""Factors at the top on the cylinder's y and z; the ellipse is the same all along."""


@contextmanager
def body_named(name: str) -> Iterator[Mechanism]:
    """A shape; one with a mesh of its own lives in a temporary file."""
    if name in BODIES:
        yield BODIES[name]
        return
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{name}.msh"
        write_gmsh(path, *OWN_MESHES[name], tapered=name == "cone")
        yield replace(Mechanism(), builtin="", radius_m=0.0, mesh_file=path)


def write_gmsh(path: Path, y: float, z: float, *, tapered: bool) -> None:
    """Gmsh 4.1 ASCII of the neck's mesh, its cross-section stretched by y and z."""
    mesh = Mechanism().mesh()
    share = mesh.nodes_m[:, 0] / mesh.length_m if tapered else np.ones(len(mesh.nodes_m))
    nodes = mesh.nodes_m.copy()
    nodes[:, 1] *= 1.0 + (y - 1.0) * share
    nodes[:, 2] *= 1.0 + (z - 1.0) * share
    # Gmsh's second-order tetrahedron: the last two mid-edge nodes change places.
    cells = mesh.tetrahedra[:, [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]] + 1
    faces = [triangles(mesh, mesh.base_nodes), triangles(mesh, mesh.top_nodes)]
    lines = ["$MeshFormat", "4.1 0 8", "$EndMeshFormat", "$PhysicalNames", "3"]
    lines += ['2 1 "base"', '2 2 "top"', '3 3 "body"', "$EndPhysicalNames", "$Entities", "0 0 2 1"]
    box = "-1 -1 -1 1 1 1"
    lines += [f"1 {box} 1 1 0", f"2 {box} 1 2 0", f"1 {box} 1 3 0", "$EndEntities"]
    lines += ["$Nodes", f"1 {len(nodes)} 1 {len(nodes)}", f"3 1 0 {len(nodes)}"]
    lines += [str(i + 1) for i in range(len(nodes))]
    lines += [" ".join(repr(float(v)) for v in row) for row in nodes]
    count = len(cells) + sum(len(face) for face in faces)
    lines += ["$EndNodes", "$Elements", f"3 {count} 1 {count}"]
    tag = 1
    for entity, kind, rows in [(1, 9, faces[0]), (2, 9, faces[1]), (1, 11, cells)]:
        lines.append(f"{3 if kind == 11 else 2} {entity} {kind} {len(rows)}")
        for row in rows:
            lines.append(" ".join(map(str, [tag, *row])))
            tag += 1
    path.write_text("\n".join([*lines, "$EndElements", ""]), encoding="ascii")


def triangles(mesh: Mesh, face: NDArray[np.int64]) -> list[list[int]]:
    """Six node numbers, from 1, of every triangle whose nodes are all on the face."""
    mid = {(0, 1): 4, (1, 2): 5, (0, 2): 6, (0, 3): 7, (1, 3): 8, (2, 3): 9}
    on = set(face.tolist())
    faces = []
    for cell in mesh.tetrahedra:
        for a, b, c in ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3)):
            nodes = [a, b, c, mid[a, b], mid[b, c], mid[a, c]]
            if all(int(cell[i]) in on for i in nodes):
                faces.append([int(cell[i]) + 1 for i in nodes])
    return faces


def whitened(poses: F, stiffness: F, residual: F) -> F:
    """(N,) root mean square over the six components of each row."""
    white = np.einsum("nij,nj->ni", noise_whiteners(poses, stiffness), residual)
    return np.asarray(np.sqrt((white**2).mean(axis=1)))


def total(rows: F) -> float:
    """Root mean square over rows."""
    return float(np.sqrt((rows**2).mean())) if len(rows) else float("nan")


def between(values: F, rows: F, edges: tuple[float, ...], scale: float, unit: str) -> str:
    """Error by the size of something."""
    parts = []
    for low, high in pairwise(edges):
        inside = (values >= low) & (values < high)
        if inside.any():
            limits = f"{scale * low:g}..{scale * high:g} {unit}"
            parts.append(f"{limits}: {total(rows[inside]):.3f} ({inside.sum()})")
    return ", ".join(parts)


def unseen_loads(base: PhysicsMap, body: Mechanism, rows: int) -> None:
    """FEM under random wrenches of the workspace, as campaigns are simulated."""
    poses, wrenches = fem_poses(body, rows, seed=301)
    error = whitened(poses, base.stiffness(poses), base.predict(poses) - wrenches)
    rmse = np.sqrt(((base.predict(poses) - wrenches) ** 2).mean(axis=0))
    print(f"  unseen loads ({rows}): {total(error):.3f} of the noise, worst row {error.max():.3f}")
    print("    rmse fx fy fz N, tau N m: " + " ".join(f"{v:.2g}" for v in rmse))
    bend = np.linalg.norm(poses[:, 4:], axis=1)
    print("    by |bend|: " + between(bend, error, (0.0, 0.2, 0.4, 0.6, 0.81), 1.0, "rad"))

    shift = np.linalg.norm(mid_frame(poses, base.length_m or 1.0)[:, :3], axis=1)
    edges = tuple((base.length_m or 1.0) * v for v in (0.0, 0.1, 0.2, 0.3, 0.6))
    print("    by |c|: " + between(shift, error, edges, 1e3, "mm"))


def whole_box(base: PhysicsMap, body: Mechanism, rows: int) -> None:
    """FEM under random wrenches of the whole box of Table I: the error as a share of the wrench."""
    pairs = simulate(body, rows, Workspace(full_box=True), seed=77)
    sizes = np.repeat([1.0, 1.0 / (base.length_m or 1.0)], 3)
    left = (base.predict(pairs.poses) - pairs.wrenches) * sizes
    share = np.linalg.norm(left, axis=1) / np.linalg.norm(pairs.wrenches * sizes, axis=1)
    turned = np.linalg.norm(pairs.poses[:, 3:], axis=1)
    edges = (0.0, 0.8, 1.2, 1.6, 2.0, 3.2)
    print(f"  whole box ({rows}), % of |h|, moments over L: worst row {100 * share.max():.2f}")
    print("    by |theta|: " + between(turned, 100.0 * share, edges, 1.0, "rad"))


def unseen_bodies(base: PhysicsMap, body: Mechanism, bodies: int, rows: int) -> None:
    """Pose-driven FEM of bodies with other nu and D, drawn from the whole range."""
    assert base.family is not None
    assert base.values is not None
    random = np.random.default_rng(17)
    limits = base.family.bounds(base.values)
    mesh = body.mesh()
    for _ in range(bodies):
        nu = random.uniform(*limits["poisson_ratio"])
        across = float(np.exp(random.uniform(*base.family.x_range)))
        fixed = base.at(poisson_ratio=nu, diameter_m=across * diameter(mesh))
        fem = stretched(body, across, nu)
        poses = workspace_poses(fem.rest_stiffness(), mesh.length_m, rows, seed=5, margin=1.0)
        solved = fem.solve_poses(poses)
        ok = np.array([status == "solved" for status in solved.status])
        left = fixed.predict(poses[ok]) - solved.wrenches[ok]
        error = whitened(poses[ok], solved.stiffness[ok], left)
        print(
            f"  unseen body nu {nu:.4f}, D x {across:.3f} ({ok.sum()}): {total(error):.3f} of the "
            f"noise, worst row {error.max():.3f}"
        )


def stretched(body: Mechanism, across: float, nu: float):  # type: ignore[no-untyped-def]
    """FEM of the body with all diameters times `across`, at its own E."""
    mesh = body.mesh()
    other = Mesh.from_arrays(
        np.ascontiguousarray(mesh.nodes_m * np.array([1.0, across, across])),
        mesh.tetrahedra,
        base_nodes=mesh.base_nodes,
        top_nodes=mesh.top_nodes,
    )
    if body.material is None:
        return Fem(other, young_modulus_Pa=body.young_modulus_Pa, poisson_ratio=nu)
    law = with_poisson_ratio(body.material, nu)
    law = law.scaled(body.young_modulus_Pa / law.young_modulus_Pa)
    return Fem(other, model=law.model, parameters=dict(law.parameters))


def refits(base: PhysicsMap, body: Mechanism, draws: int) -> None:
    """E and nu of noisy pairs of another body: how far off, in their own standard deviations."""
    assert base.family is not None
    assert base.values is not None
    low, high = base.family.bounds(base.values)["poisson_ratio"]
    nu = low + 0.7 * (high - low)
    fem = stretched(body, 1.0, nu)
    poses = workspace_poses(fem.rest_stiffness(), base.length_m or 1.0, 100, seed=8, margin=1.0)
    solved = fem.solve_poses(poses)
    ok = np.array([status == "solved" for status in solved.status])
    poses, wrenches = poses[ok], solved.wrenches[ok]
    random = np.random.default_rng(2)
    off, sd = [], np.zeros(2)
    meta = Meta(mechanism=body.to_dict())
    noise = Noise(*NOISE, source="declared")
    for _ in range(draws):
        seen = poses + random.standard_normal(poses.shape) * np.repeat(NOISE[:2], 3)
        read = wrenches + random.standard_normal(poses.shape) * np.repeat(NOISE[2:], 3)
        columns = dict(zip(POSE, seen.T, strict=True)) | dict(zip(WRENCH, read.T, strict=True))
        refitted = refit_physics(base, Table(columns, meta, "pairs"), noise)
        sd = refitted.sd
        off.append(refitted.values - [body.young_modulus_Pa, nu])
    bias, spread = np.mean(off, axis=0), np.std(off, axis=0)
    print(
        f"  refit of {draws} x {len(poses)} noisy rows, nu = {nu:.4f}: E {bias[0]:+.2g} Pa off, "
        f"spread {spread[0]:.2g}, own sd {sd[0]:.2g}; nu {bias[1]:+.2g}, {spread[1]:.2g}, "
        f"{sd[1]:.2g}; correlation {refitted.correlation[0, 1]:+.2f}"
    )
    four = refit_physics(base, Table(columns, meta, "pairs"), noise, free=PARAMETERS)
    print("  L and D free too: " + "; ".join(four.sentences()))


def calls(base: PhysicsMap) -> None:
    """One pose from Python, and many."""
    fixed = base.at()
    poses = np.tile([[base.length_m or 1.0, 0.01, 0.0, 0.1, 0.2, 0.1]], (2000, 1))
    one = np.ascontiguousarray(poses[:1])
    timed = {
        "one pose, native": (lambda: fixed.model.predict(one), 1),
        "one pose, map": (lambda: base.predict(one), 1),
        "bulk h": (lambda: fixed.model.predict(poses), 2000),
        "bulk K": (lambda: fixed.model.stiffness(poses), 2000),
        "at(...)": (base.at, 1),
    }
    parts = []
    for name, (call, rows) in timed.items():
        repeats = 2000 if rows == 1 else 20
        start = time.process_time()
        for _ in range(repeats):
            call()
        parts.append(f"{name} {1e6 * (time.process_time() - start) / repeats / rows:.2f}")
    print("  CPU us a pose: " + ", ".join(parts))


def main() -> None:
    """Prints one paragraph per shape."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("shapes", nargs="*", default=["neck"], metavar="SHAPE")
    parser.add_argument("--cold", action="store_true")
    parser.add_argument("--rows", type=int, default=100)
    parser.add_argument("--bodies", type=int, default=4)
    parser.add_argument("--draws", type=int, default=20)
    parser.add_argument("--reach", type=float, default=0.0, help="largest rotation, rad")
    parser.add_argument("--box", type=int, default=0, help="rows of the whole box of Table I")
    arguments = parser.parse_args()
    for name in arguments.shapes:
        with body_named(name) as body, tempfile.TemporaryDirectory() as empty, one_blas_thread():
            start, cpu = time.perf_counter(), time.process_time()
            cache = Path(empty) if arguments.cold else None
            base = physics_map(body, cache=cache, reach_rad=arguments.reach)
            wall, cpu = time.perf_counter() - start, time.process_time() - cpu
            family = base.family
            assert family is not None
            how = "built" if arguments.cold else "there"
            print(
                f"{name}: {how} in {wall:.1f} s ({cpu:.1f} s CPU); "
                f"energy{family.degree} {family.symmetry}, {family.table.shape[2]} terms; own "
                f"error over noise {np.round(family.error_over_noise, 3).tolist()}"
            )
            if arguments.rows:
                unseen_loads(base, body, arguments.rows)
            if arguments.box:
                whole_box(base, body, arguments.box)
            if arguments.bodies:
                unseen_bodies(base, body, arguments.bodies, 30)
            if arguments.draws:
                refits(base, body, arguments.draws)
            calls(base)


if __name__ == "__main__":
    main()
