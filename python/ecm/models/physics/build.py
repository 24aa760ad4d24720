"""Builds the family of energies of a shape from FEM at nine bodies: three nu times three D/L.

FEM gives at every pose the wrench and the stiffness: 6 + 21 numbers of one energy. All bodies are
solved at the same poses and fitted with the same weights, so that their coefficients change
smoothly in spite of truncation and mesh. Other poses, also of bodies between the nine, give the
error and choose the degree.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from ecm._native import Fem, Mesh, convert_stiffness
from ecm.errors import ComputationError
from ecm.io.arrays import B, F
from ecm.io.cache import Stage
from ecm.io.events import Progress, tell_part
from ecm.io.mechanism import ROD_SECTIONS, Material, Mechanism
from ecm.io.mesh import CAD_SUFFIXES
from ecm.models.literature import RodMap
from ecm.models.maps import Symmetry
from ecm.models.physics.body_fits import (
    LENGTH_M,
    ROTATION_LIMIT_RAD,
    SHEAR_MODULUS_PA,
    BodyFits,
    Nodes,
    Solved,
    Unseen,
    best_family,
    spread_poses,
    workspace_poses,
)
from ecm.models.physics.family import MeshDifference, PhysicsFamily, compressibility, poisson_ratio

_CANDIDATES_OF_A_WIDE_POSE = 2
"""A load holds the neck in every second pose that a rod takes beyond 0.8 rad."""
_FEWEST_POSES = 20
_SCREEN = 12
"""Number of the screening among the parts of a build; the bodies have 0 to 11."""
_MESH_POSES, _MESH_SEED, _MESH_DEGREE = 16, 22, 4
"""The difference of two meshes rests on these: the neck's errs by at most 10 % of itself."""


@dataclass(frozen=True)
class BuildSettings:
    """Numbers of FEM poses; part of the key of the cache."""

    poses: int = 80
    test_poses: int = 30
    seed: int = 20
    rotation_limit_rad: float = ROTATION_LIMIT_RAD


def shape_of(mechanism: Mechanism) -> Mechanism:
    """The body scaled to the neck's length and shear modulus, the same for all sizes of a shape.

    Ratios are rounded to twelve digits, so that a body and its scaled copy are the same shape.
    """
    if mechanism.builtin == "rod":
        return scaled_rod(stated_rod(mechanism))
    length = mechanism.checked_length_m()
    across = {
        name: LENGTH_M * round(getattr(mechanism, name) / length, 12)
        for name in ("radius_m", "inner_radius_m", "waist_radius_m")
    }
    material = mechanism.material
    if material is not None:
        material = _rounded(material.scaled(SHEAR_MODULUS_PA / material.shear_modulus_Pa))
    return _at_neck_size(mechanism, material=material, **across)


def _at_neck_size(mechanism: Mechanism, **own: Any) -> Mechanism:
    """The neck's length and shear modulus, no weight and no preload, and what else is given."""
    own["young_modulus_Pa"] = 2.0 * SHEAR_MODULUS_PA * (1.0 + mechanism.poisson_ratio)
    return replace(mechanism, length_m=LENGTH_M, density_kg_m3=0.0, free_length_m=0.0, **own)


_MOST_STRAIN = 0.4
"""Largest strain of the outermost fibre in the usual workspace; the neck has 0.26 there."""


def usual_rotation_rad(shape: Mechanism) -> float:
    """Largest rotation of the workspace of a shape, where no data ask for more: 0.8 rad.

    Of a body thicker than it is long less: at 0.8 rad its outer fibres would lose all their length,
    and a quarter of the poses have no stable state, which takes FEM long to find out.
    """
    if shape.builtin == "rod":
        return ROTATION_LIMIT_RAD
    across, length = 2.0 * shape.radius_m, shape.length_m
    if shape.mesh_file is not None:
        mesh = shape.mesh()
        across, length = diameter(mesh), mesh.length_m
    # In digits that a copy of other size shares.
    return min(ROTATION_LIMIT_RAD, float(f"{2.0 * _MOST_STRAIN * length / across:.6g}"))


def _rounded(material: Material) -> Material:
    def digits(value: float | list[float]) -> float | list[float]:
        if isinstance(value, (list, tuple)):
            return [float(f"{v:.12g}") for v in value]
        return float(f"{value:.12g}")

    return replace(material, parameters={k: digits(v) for k, v in material.parameters.items()})


def build_family(
    shape: Mechanism,
    settings: BuildSettings,
    *,
    more_force: tuple[float, float] = (1.0, 1.0),
    stage: Stage | None = None,
    threads: int = 0,
    progress: Progress | None = None,
) -> PhysicsFamily:
    """Solve nine bodies by FEM and fit the family; finished bodies are kept in `stage`.

    The forces of its poses along the axis and across it are `more_force` times the usual ones.

    Raises
    ------
    ComputationError
        Too few poses have a stable state in all nine bodies.
    """
    nodes = Nodes.around(compressibility(shape.poisson_ratio))
    made = _Rods(shape) if shape.builtin == "rod" else _Bodies(shape)
    rest = made.fem(nodes.centre, 0.0).rest_stiffness()
    # Where only near poses are asked for, forces fall like the rotations.
    near = math.sqrt(ROTATION_LIMIT_RAD * settings.rotation_limit_rad)
    usual = min(usual_rotation_rad(shape), near)
    limits: dict[str, Any] = {
        "rotation_limit_rad": settings.rotation_limit_rad,
        "usual_rad": usual,
        "more_force": more_force,
    }
    wide, done = settings.rotation_limit_rad > usual or max(more_force) > 1.0, 0
    count = settings.poses * (_CANDIDATES_OF_A_WIDE_POSE if wide else 1)
    poses = spread_poses(rest, count, seed=settings.seed, threads=threads, **limits)

    def solved_at(index: int, s: float, x: float, at: F, counts: tuple[int, int]) -> Solved:
        """One body, kept in `stage`; `counts` are the poses solved before, and all."""
        part = None if stage is None else stage.load_part(index)
        if part is not None:
            return Solved(part["wrenches"], part["stiffness"], part["ok"].astype(np.bool_))
        found = _solved(made.fem(s, x), at, threads, progress, counts)
        with suppress(OSError):  # a cache that cannot be written only costs time
            if stage is not None:
                stage.save_part(index, dict(vars(found)))
        return found

    if wide:
        done = len(poses)
        most = done + 9 * settings.poses + 3 * settings.test_poses
        first = solved_at(_SCREEN, nodes.centre, 0.0, poses, (0, most))
        poses = np.ascontiguousarray(poses[held_by_loads(poses, first)][: settings.poses])
    unseen = workspace_poses(
        rest, settings.test_poses, seed=settings.seed + 1, margin=1.0, **limits
    )
    bodies = [(s, x, poses) for s in nodes.s for x in nodes.x]
    bodies += [(s, x, unseen) for s, x in nodes.unseen]
    total = done + sum(len(p) for _, _, p in bodies)
    solved: list[Solved] = []
    for index, (s, x, at) in enumerate(bodies):
        solved.append(solved_at(index, s, x, at, (done, total)))
        done += len(at)
    tell_part(progress, total, total, "fitting")
    common = np.logical_and.reduce([body.ok for body in solved[:9]])
    if common.sum() < _FEWEST_POSES:  # what few poses leave open counts in the error of the others
        raise ComputationError(
            f"only {common.sum()} of {len(poses)} poses have a stable state in all nine bodies "
            "around this shape: the physics model cannot be built for it; check mesh and material"
        )
    fit = BodyFits(poses[common], [body.cut(common) for body in solved[:9]], nodes.nominal)
    tests = []
    for body, node in zip(solved[9:], nodes.unseen, strict=True):
        good = held_by_loads(unseen, body) if wide else body.ok
        tests.append(Unseen(unseen[good], body.cut(good), *node))
    return best_family(fit, tests, nodes, made.diameter_over_length)


def held_by_loads(poses: F, solved: Solved) -> B:
    """(N,) whether FEM found a state that a load holds, not only a clamp: sym K_s is positive.

    A rod takes poses where a thick body has buckled long ago. Their loads lie outside the
    workspace, and an energy that must fit them as well errs several times as much within it.
    """
    good = solved.ok
    screw = convert_stiffness(
        solved.stiffness[good], poses[good], solved.wrenches[good], source="partial", target="screw"
    )
    scale = np.repeat([1.0, 1.0 / LENGTH_M], 3)
    symmetric = (screw + np.swapaxes(screw, 1, 2)) * np.outer(scale, scale)
    held: B = np.zeros_like(solved.ok)
    held[good] = np.linalg.eigvalsh(symmetric)[:, 0] > 0.0
    return held


def mesh_difference(
    shape: Mechanism, symmetry: Symmetry, *, threads: int = 0, progress: Progress | None = None
) -> MeshDifference | None:
    """Solve the standard and the fine mesh of a shape at the same few poses.

    None for a rod, which has no mesh, for a mesh file, of which there is one size only (of a CAD
    file there are two), and where too few poses have a stable state.
    """
    file = shape.mesh_file
    if shape.builtin == "rod" or (file is not None and file.suffix.lower() not in CAD_SUFFIXES):
        return None
    s = compressibility(shape.poisson_ratio)
    standard, fine = (_Bodies(replace(shape, quality=quality)) for quality in ("standard", "fine"))
    rest = standard.fem(s, 0.0).rest_stiffness()
    usual = usual_rotation_rad(shape)
    limits: dict[str, Any] = {"rotation_limit_rad": usual, "usual_rad": usual}
    poses = workspace_poses(rest, _MESH_POSES, seed=_MESH_SEED, **limits)
    solved = [
        _solved(body.fem(s, 0.0), poses, threads, progress, (done, 2 * len(poses)))
        for body, done in ((standard, 0), (fine, len(poses)))
    ]
    both = solved[0].ok & solved[1].ok
    if not both.any():
        return None
    # The terms that both energies lack are nearly the same and fall out of the difference.
    fit = BodyFits(poses[both], [body.cut(both) for body in solved], 0)
    values = fit.coefficients(symmetry, _MESH_DEGREE)
    if values is None:
        return None
    return MeshDifference(_MESH_DEGREE, symmetry, fit.scale, values[0] - values[1])


def _solved(
    fem: Fem | RodBody, poses: F, threads: int, progress: Progress | None, counts: tuple[int, int]
) -> Solved:
    """FEM at poses; `counts` are the poses solved before, and all."""
    done, total = counts

    def report(count: int, _: int) -> None:
        tell_part(progress, done + count, total, "FEM poses")

    results = fem.solve_poses(poses, threads=threads, progress=report)
    ok = np.array([status == "solved" for status in results.status])
    return Solved(results.wrenches, results.stiffness, ok)


class _Rods:
    """The bodies of one rod: its section stiffnesses scaled."""

    def __init__(self, shape: Mechanism) -> None:
        self._shape = shape
        self.diameter_over_length = 2.0 * shape.radius_m / shape.length_m

    def fem(self, s: float, x: float) -> RodBody:
        """The rod with mu/kappa = s and its diameter times exp(x)."""
        shape = self._shape
        nominal = np.array([getattr(shape, name) for name in ROD_SECTIONS])
        young = (1.0 + poisson_ratio(s)) / (1.0 + shape.poisson_ratio)
        sections = nominal * young**_BY_YOUNG * float(np.exp(x)) ** _BY_DIAMETER
        return RodBody(RodMap(shape.length_m, sections))


class _Bodies:
    """The bodies of one shape: other s, and the transverse coordinates of the mesh stretched."""

    def __init__(self, shape: Mechanism) -> None:
        mesh = shape.mesh()
        factor = LENGTH_M / mesh.length_m
        self._nodes = factor * (mesh.nodes_m - np.array([0.0, *_axis(mesh)]))
        self._mesh = mesh
        self._material = shape.material
        self.diameter_over_length = diameter(mesh) / mesh.length_m

    def fem(self, s: float, x: float) -> Fem:
        """FEM of the body with mu/kappa = s and all diameters times exp(x)."""
        across = float(np.exp(x))
        mesh = Mesh.from_arrays(
            np.ascontiguousarray(self._nodes * np.array([1.0, across, across])),
            self._mesh.tetrahedra,
            base_nodes=self._mesh.base_nodes,
            top_nodes=self._mesh.top_nodes,
        )
        nu = poisson_ratio(s)
        if self._material is None:
            young = 2.0 * SHEAR_MODULUS_PA * (1.0 + nu)
            return Fem(mesh, young_modulus_Pa=young, poisson_ratio=nu)
        law = with_poisson_ratio(self._material, nu)
        return Fem(mesh, model=law.model, parameters=dict(law.parameters))


def with_poisson_ratio(material: Material, nu: float) -> Material:
    """The same law, shear modulus and all, with another bulk modulus."""
    parameters = {k: v for k, v in material.parameters.items() if k != "bulk_modulus_Pa"}
    parameters["poisson_ratio"] = nu
    if "young_modulus_Pa" in parameters:
        parameters["young_modulus_Pa"] = 2.0 * material.shear_modulus_Pa * (1.0 + nu)
    return replace(material, parameters=parameters)


def diameter(mesh: Mesh) -> float:
    """Twice the largest distance of a node from the axis, m."""
    return float(2.0 * np.linalg.norm(mesh.nodes_m[:, 1:] - _axis(mesh), axis=1).max())


def _axis(mesh: Mesh) -> F:
    """(2,) y and z of the middle of the base."""
    base = mesh.nodes_m[mesh.base_nodes][:, 1:]
    return np.asarray(0.5 * (base.min(axis=0) + base.max(axis=0)))


_BY_YOUNG = np.array([1.0, 0.0, 1.0, 0.0])
_BY_DIAMETER = np.array([2.0, 2.0, 4.0, 4.0])


def stated_rod(mechanism: Mechanism) -> Mechanism:
    """The rod with all of its four stiffnesses, radius and modulus, from those that are given.

    A rod given by its stiffnesses alone has the radius and E of the solid circle of its EI and EA:
    r = 2 sqrt(EI / EA), E = EA / (pi r^2).
    """
    sections = mechanism.rod_sections()
    axial, bending = sections["axial_stiffness_N"], sections["bending_stiffness_Nm2"]
    radius = mechanism.radius_m or 2.0 * math.sqrt(bending / axial)
    young = mechanism.young_modulus_Pa or axial / (math.pi * radius**2)
    known: dict[str, Any] = {**sections, "radius_m": radius, "young_modulus_Pa": young}
    return replace(mechanism, material=None, **known)


def scaled_rod(rod: Mechanism) -> Mechanism:
    """The shape at the neck's length and shear modulus; twelve digits, so that copies agree."""
    longer = LENGTH_M / rod.length_m
    stiffer = SHEAR_MODULUS_PA / (rod.young_modulus_Pa / (2.0 * (1.0 + rod.poisson_ratio)))
    # A rod of the same shape is thicker by the factor by which it is longer.
    sections = {
        name: float(f"{getattr(rod, name) * stiffer * longer**power:.12g}")
        for name, power in zip(ROD_SECTIONS, _BY_DIAMETER, strict=True)
    }
    return _at_neck_size(rod, radius_m=float(f"{rod.radius_m * longer:.12g}"), **sections)


@dataclass(frozen=True)
class RodBody:
    """One rod of a family, with the methods of the FEM of a body."""

    map: RodMap

    def rest_stiffness(self) -> F:
        """(6, 6) partial, at the undeformed pose."""
        rest = np.zeros((1, 6))
        rest[0, 0] = self.map.length
        return np.asarray(self.map.stiffness(rest)[0])

    def solve_poses(self, poses: F, **_: Any) -> SimpleNamespace:
        """Wrench (N, 6) and partial stiffness (N, 6, 6) at poses; status as from the FEM."""
        wrenches, stiffness = self.map.wrench_and_stiffness(poses)
        solved = np.isfinite(wrenches).all(axis=1) & np.isfinite(stiffness).all(axis=(1, 2))
        status = np.where(solved, "solved", "not_converged").tolist()
        return SimpleNamespace(wrenches=wrenches, stiffness=stiffness, status=status)
