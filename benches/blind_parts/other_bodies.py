"""Bodies other than the neck: rods of several sizes, FEM solids, a planar rod and a hinge.

None of them uses a formula of the library: rods are integrated by `blind_parts.rod`, the tube and
the square bar are solved by finite elements, the hinge is a spring written here.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blind_parts.rod import Rod, Section, Solved
from ecm._native import Fem, Mesh
from ecm.io.cache import write_atomically
from ecm.io.columns import POSE, WRENCH
from ecm.io.mechanism import Mechanism
from ecm.models import Model, physics_map

F = NDArray[np.float64]
SOLID_POSES = 160
PLANAR = [0, 1, 5]
HINGE = [5]


@dataclass(frozen=True)
class Body:
    """A plant, and what its owner states of it."""

    name: str
    length_m: float
    section: Section | None = None
    """Cross-section of a rod; None for a solid and for the hinge."""
    mesh: Callable[[], Mesh] | None = None
    axes: tuple[int, ...] = tuple(range(6))
    """Coordinates that exist."""
    stated: bool = False
    """Whether its owner knows the stiffness, else only the length."""
    load: float = 1.0
    """Loads over those of the other bodies: smaller where no base fits more than a cubic does."""

    @property
    def inputs(self) -> tuple[str, ...]:
        """Pose columns."""
        return tuple(POSE[j] for j in self.axes)

    @property
    def outputs(self) -> tuple[str, ...]:
        """Wrench columns."""
        return tuple(WRENCH[j] for j in self.axes)

    def mechanism(self) -> dict[str, Any]:
        """What is stated under `[mechanism]`."""
        if self.section is None or not self.stated:
            return {"length_m": self.length_m} if len(self.axes) == 6 else {}
        return self.section.mechanism()

    def visited(self, count: int, random: np.random.Generator, folder: Path) -> Visited:
        """Poses and wrenches in the order of the visits."""
        if self.mesh is not None:
            poses, wrenches = _solved(self, folder)
            chosen = random.choice(len(poses), count, replace=False)
            return Visited(poses[chosen], wrenches[chosen])
        if self.section is None:
            poses = drawn_poses(count, self.length_m, random) * np.array([0.0] * 5 + [1.0])
            return Visited(poses, _spring(poses[:, 5]))
        poses, held = Rod(self.section).loaded(self._loads(count, random), np.zeros(count))
        return Visited(poses, held.wrench, held)

    def changed(self, at: Visited, **sizes: float) -> F:
        """(N, 6) wrench at the same poses of the rod with changes of its section."""
        if self.section is None or at.held is None:
            raise ValueError(f"{self.name} is no rod")
        rod = Rod(replace(self.section, **sizes))
        return rod.solve(at.poses, np.zeros(len(at.poses)), at.held).wrench

    def _loads(self, count: int, random: np.random.Generator) -> F:
        """Force and moment at the base, (N, 6), of moderate bending in each coordinate."""
        s = self.section
        assert s is not None
        moment, force = s.bending_Nm2 / s.length_m, s.bending_Nm2 / s.length_m**2
        axial = min(0.02 * s.axial_N, 2.0 * force)
        size = self.load * np.array(
            [axial, 0.7 * force, 0.7 * force, 0.2 * s.torsion_Nm2 / s.length_m] + [0.6 * moment] * 2
        )
        alone = np.isin(np.arange(6), self.axes)
        loads: F = random.uniform(-1.0, 1.0, (count, 6)) * size * alone
        return loads


@dataclass(frozen=True)
class Visited:
    """Poses (N, 6) that were visited and the wrenches (N, 6) there."""

    poses: F
    wrenches: F
    held: Solved | None = None
    """What holds a rod there; None for other bodies."""

    def select(self, rows: NDArray[np.int64]) -> Visited:
        """The same at other rows, some of them again."""
        held = self.held
        if held is not None:
            held = Solved(held.wrench[rows], held.base[rows], held.inverse[rows])
        return Visited(self.poses[rows], self.wrenches[rows], held)


def _spring(angle: F) -> F:
    out = np.zeros((len(angle), 6))
    out[:, 5] = 1.2 * angle + 0.5 * np.sinh(1.5 * angle) + 0.15 * angle**2
    return out


def drawn_poses(count: int, length_m: float, random: np.random.Generator, load: float = 1.0) -> F:
    """Poses (N, 6) of a bent solid, with some shear, stretch and twist."""
    turn = load * random.uniform([-0.2, -0.4, -0.4], [0.2, 0.4, 0.4], (count, 3))
    slide = load * random.uniform(-0.06, 0.06, (count, 3))
    place = np.stack(
        [
            1.0 - (turn[:, 1] ** 2 + turn[:, 2] ** 2) / 6.0 + 0.5 * slide[:, 0],
            0.5 * turn[:, 2] + slide[:, 1],
            -0.5 * turn[:, 1] + slide[:, 2],
        ],
        axis=1,
    )
    return np.concatenate([length_m * place, turn], axis=1)


def _box(length_m: float, side_m: float) -> Mesh:
    """A square bar of quadratic tetrahedra, six to each of 2 x 2 x 6 bricks."""
    across, along = 2, 6
    steps = [2 * along, 2 * across, 2 * across]
    grid = np.stack(np.meshgrid(*(np.arange(n + 1) for n in steps), indexing="ij"), axis=-1)
    number = np.arange(grid[..., 0].size).reshape(grid.shape[:3])
    size = np.array([length_m, side_m, side_m])
    nodes = grid.reshape(-1, 3) / steps * size - np.array([0.0, side_m / 2, side_m / 2])
    elements = []
    for cell in np.ndindex(along, across, across):
        # Every second brick is mirrored: the mesh is as symmetric as the bar.
        way = 2 * np.diag(1 - 2 * (np.array(cell) % 2))
        for path in itertools.permutations(range(3)):
            corners = [2 * (np.array(cell) + np.array(cell) % 2)]
            for axis in path:
                corners.append(corners[-1] + way[axis])
            if np.linalg.det(np.diff(corners, axis=0)) < 0.0:
                corners[1], corners[2] = corners[2], corners[1]
            edges = ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))
            mid = [(corners[a] + corners[b]) // 2 for a, b in edges]
            elements.append([number[tuple(c)] for c in (*corners, *mid)])
    kept, packed = np.unique(np.array(elements), return_inverse=True)
    return Mesh.from_arrays(
        np.ascontiguousarray(nodes[kept]),
        packed.reshape(-1, 10),
        base_nodes=np.flatnonzero(nodes[kept][:, 0] == 0.0),
        top_nodes=np.flatnonzero(nodes[kept][:, 0] == length_m),
    )


def _tube() -> Mesh:
    return Mesh.tube(length_m=0.08, radius_m=0.02, inner_radius_m=0.012)


def _solved(body: Body, folder: Path) -> tuple[F, F]:
    """Poses and wrenches of a solid by finite elements, kept in `folder`."""
    path = folder / f"solid-{body.name}.json"
    if not path.exists():
        assert body.mesh is not None
        poses = drawn_poses(SOLID_POSES, body.length_m, np.random.default_rng(5), body.load)
        found = Fem(body.mesh(), young_modulus_Pa=2e6, poisson_ratio=0.47).solve_poses(poses)
        good = np.array([status == "solved" for status in found.status])
        kept = {"poses": poses[good].tolist(), "wrenches": found.wrenches[good].tolist()}
        write_atomically(path, json.dumps(kept))
    kept = json.loads(path.read_text())
    return np.array(kept["poses"]), np.array(kept["wrenches"])


def _scaled(length_m: float, softer: float) -> Section:
    """The rod of the first benchmark in another size: the same family of physics models."""
    s, size = Section(), length_m / Section().length_m
    return replace(
        s,
        length_m=length_m,
        axial_N=s.axial_N * size**2 / softer,
        shear_N=s.shear_N * size**2 / softer,
        bending_Nm2=s.bending_Nm2 * size**4 / softer,
        torsion_Nm2=s.torsion_Nm2 * size**4 / softer,
        radius_m=s.radius_m * size,
    )


_SOFT, _STIFF = _scaled(0.2, 25.0), _scaled(0.05, 1.0 / 30.0)
BODIES = {
    body.name: body
    for body in (
        Body("soft", 0.2, _SOFT, stated=True),
        Body("stiff", 0.05, _STIFF, stated=True),
        Body("tapered", 0.2, replace(_SOFT, taper=0.25)),
        Body("tube", 0.08, mesh=_tube),
        Body("square", 0.1, mesh=lambda: _box(0.1, 0.025), load=0.5),
        Body("planar", 0.2, _SOFT, axes=tuple(PLANAR), load=0.15),
        Body("hinge", 0.1, axes=tuple(HINGE)),
    )
}


def solve_bodies(folder: Path) -> None:
    """Solve the solids once, before several processes ask for them."""
    for body in BODIES.values():
        if body.mesh is not None:
            body.visited(1, np.random.default_rng(0), folder)


def stated_model(mechanism: dict[str, Any]) -> Model | None:
    """The physics model of a stated body; None where no stiffness is stated."""
    if "builtin" not in mechanism:
        return None
    return Model(base=physics_map(Mechanism.from_dict(mechanism)))
