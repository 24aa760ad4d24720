"""The true elastic map: FEM solved at the commanded poses, a smooth map only for the increments.

Around a solved pose a, which is a commanded one with FEM wrench h_a and stiffness K_a,

    h(p) = h_a + K_a d + [s(p) - s(a) - S(a) d],    d = p - a

where s with S = ds/dp is any smooth map fitted to the solved poses: value and slope are the FEM's,
the surrogate gives the curvature of a sub-millimetre step only.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Literal, Protocol

import numpy as np

from ecm._native import EnergyEvaluator, FemResults
from ecm.errors import ComputationError, InputError
from ecm.io.arrays import B, F, I
from ecm.io.cache import array_key, read_arrays, write_arrays
from ecm.io.events import with_words
from ecm.io.mechanism import Material, Mechanism


class FemSource:
    """A mechanism file as a source of solved poses."""

    def __init__(self, mechanism: Mechanism, *, threads: int = 0) -> None:
        self._mechanism = mechanism
        self._threads = threads

    @property
    def length_m(self) -> float:
        return self._mechanism.length_m

    def key(self) -> str:
        return self._mechanism.key()

    def solve(self, poses: F, grade: str, progress: Progress = None) -> SolvedPoses:
        """FEM wrench, K and G at each pose, with the modulus graded over the cross-section."""
        fem = changed(self._mechanism, grade).fem(
            element_modulus_scale=modulus_grade(self._mechanism, grade)
        )
        told = with_words(progress, "plant" if grade == UNIFORM else f"plant ({grade})")
        results = fem.solve_poses(poses, threads=self._threads, progress=told)
        return SolvedPoses(poses, results.wrenches, _slopes(results), tuple(results.status))

    def free_poses(self, inputs: F) -> SolvedPoses:
        """The pose that the body takes without a load at each row of inputs (k, m)."""
        loads = np.hstack([np.zeros((len(inputs), 6)), inputs])
        results = self._mechanism.fem().solve_wrenches(loads, threads=self._threads)
        rows = np.hstack([results.poses, inputs])
        return SolvedPoses(
            rows, np.zeros_like(rows[:, :6]), _slopes(results), tuple(results.status)
        )

    def surrogate(self, solved: SolvedPoses) -> Smooth | None:
        """A symmetric energy of the loaded poses: it gives curvature, never the value."""
        few = solved.good.sum() < ENOUGH_FOR_SURROGATE
        if few or self._mechanism.actuators:  # no energy of the pose alone goes through them
            return None
        return fitted_energy(*solved.loaded, self.length_m)[0]


def _slopes(results: FemResults) -> F:
    """(N, 6, 6 + m) K, and G of m actuators beside it."""
    return np.concatenate([results.stiffness, results.actuation_jacobians[0]], axis=2)


def changed(mechanism: Mechanism, grade: str) -> Mechanism:
    """The body that a grade solves: thicker, or of a rubber that stiffens; else the same."""
    if grade == THICK:
        radii = ("radius_m", "inner_radius_m", "waist_radius_m")
        thicker = {name: (1.0 + CONTRAST) * getattr(mechanism, name) for name in radii}
        return replace(mechanism, **thicker)
    if grade == STIFF:
        nu = mechanism.poisson_ratio
        c1 = mechanism.young_modulus_Pa / (4.0 * (1.0 + nu))
        stiffer = {"c1_Pa": c1, "c2_Pa": 4.0 * CONTRAST * c1, "c3_Pa": 0.0, "poisson_ratio": nu}
        return replace(mechanism, material=Material("yeoh", stiffer))
    return mechanism


def modulus_grade(mechanism: Mechanism, grade: str) -> F | None:
    """(M,) factor on E per tetrahedron, by the place of its centre; None: the same everywhere.

    1 + CONTRAST (rho/R)^2 cos 2 phi (or sin), phi the azimuth from y; 1 + CONTRAST (2 x/L - 1).
    """
    if grade not in (COS2, SIN2, TAPER):
        return None
    mesh = mechanism.mesh()
    corners: F = mesh.nodes_m[mesh.tetrahedra[:, :4]]
    if grade == TAPER:
        along = corners.mean(axis=1)[:, 0] / mechanism.length_m
        return np.asarray(1.0 + CONTRAST * (2.0 * along - 1.0))
    wave = {COS2: np.cos, SIN2: np.sin}[grade]
    y, z = corners.mean(axis=1)[:, 1:].T
    squared = y**2 + z**2
    radius_squared = float(np.max(np.sum(mesh.nodes_m[:, 1:] ** 2, axis=1)))
    return np.asarray(1.0 + CONTRAST * squared / radius_squared * wave(2.0 * np.arctan2(z, y)))


def fitted_energy(
    poses: F, wrenches: F, length_m: float, most: int = 6
) -> tuple[EnergyEvaluator, int]:
    """A symmetric energy of these poses and wrenches (N, 6), and its degree."""
    degree = most if len(poses) >= 60 else 4
    model = EnergyEvaluator.fit(
        poses, wrenches, length_m=length_m, degree=degree, symmetry=SYMMETRY
    )
    return model, degree


SYMMETRY: Literal["revolution"] = "revolution"
ENOUGH_FOR_SURROGATE = 20
"""Below so many solved poses the increment is the linear one of the nearest K."""


Progress = Callable[[int, int, str], object] | None

REST_INDEX = 0
"""The rest pose is the first solved pose of every campaign."""
UNIFORM, COS2, SIN2 = "plain", "cos2", "sin2"
TAPER, THICK, STIFF = "taper", "thick", "stiff"
CONTRAST = 0.05
"""Contrast of the graded modulus whose FEM solution is subtracted from the plain one."""


class Source(Protocol):
    """What `CampaignOptions.source` asks of a mechanism that the rig measures in place of its FEM.

    Examples
    --------
    A spring; `examples/head/neck.py` has an elastic neck that also moves a robot.

    >>> class Spring:
    ...     length_m = 0.1
    ...     def key(self):
    ...         return "spring-1"
    ...     def solve(self, poses, grade, progress):
    ...         k = np.tile(1000.0 * np.eye(6), (len(poses), 1, 1))
    ...         wrenches = 1000.0 * (poses - [0.1, 0, 0, 0, 0, 0])
    ...         return SolvedPoses(poses, wrenches, k, ("solved",) * len(poses))
    ...     def surrogate(self, solved):
    ...         return None
    >>> source: Source = Spring()
    >>> source.solve(np.full((1, 6), 0.1), "plain", None).wrenches[0, :2]
    array([  0., 100.])
    """

    @property
    def length_m(self) -> float: ...
    def key(self) -> str:
        """Names everything that the solution depends on."""
        ...

    def solve(self, poses: F, grade: str, progress: Progress) -> SolvedPoses:
        """Modulus E (plain), E (1 + CONTRAST rho^2/R^2 cos or sin 2 phi), E (1 + CONTRAST
        (2 x/L - 1)) (taper), a body thicker by CONTRAST, or a rubber that stiffens (Yeoh)."""
        ...

    def surrogate(self, solved: SolvedPoses) -> Smooth | None:
        """A smooth map fitted to solved poses; None where they are too few, or inputs vary."""
        ...


class Smooth(Protocol):
    """A smooth map fitted to the solved poses."""

    def predict(self, poses: F) -> F: ...
    def stiffness(self, poses: F) -> F: ...


@dataclass(frozen=True)
class SolvedPoses:
    """Solutions at (N, 6) poses; `status` other than "solved" marks rows not to be visited.

    Of a mechanism with m actuators the poses are (N, 6 + m) with their inputs after them, and the
    stiffness is (N, 6, 6 + m), K and G.

    Examples
    --------
    >>> SolvedPoses(np.zeros((1, 6)), np.zeros((1, 6)), np.zeros((1, 6, 6)), ("solved",)).status
    ('solved',)
    """

    poses: F
    wrenches: F
    stiffness: F
    status: tuple[str, ...]

    def joined(self, others: SolvedPoses) -> SolvedPoses:
        """These solutions, then the others."""
        return SolvedPoses(
            np.concatenate([self.poses, others.poses]),
            np.concatenate([self.wrenches, others.wrenches]),
            np.concatenate([self.stiffness, others.stiffness]),
            self.status + others.status,
        )

    @property
    def good(self) -> B:
        """Which rows are solved, (N,)."""
        return np.asarray([status == "solved" for status in self.status])

    @cached_property
    def place(self) -> dict[bytes, int]:
        """The row of each pose, by its bytes."""
        return {pose.tobytes(): i for i, pose in enumerate(self.poses)}

    @property
    def loaded(self) -> tuple[F, F]:
        """Solved poses and wrenches (n, 6); the rest pose tells nothing that an energy does not."""
        rows = self.good & (np.linalg.norm(self.wrenches, axis=1) > 0.0)
        return self.poses[rows], self.wrenches[rows]

    def __post_init__(self) -> None:
        # In the order in which a file gives them back: sums of another one end in other bits.
        for name in ("poses", "wrenches", "stiffness"):
            object.__setattr__(self, name, np.ascontiguousarray(getattr(self, name)))


def wrench_change(stiffness: F, steps: F) -> F:
    """Changes of the wrench (N, 6) by stiffness (N, 6, m) and steps (N, m)."""
    return np.asarray(np.einsum("nij,nj->ni", stiffness, steps))


class Elastic:
    """h(p) and K(p) near the solved poses, which may have the actuators' inputs after them."""

    def __init__(self, solved: SolvedPoses, smooth: Smooth | None = None) -> None:
        self.solved = solved
        self.smooth = smooth
        """The smooth map through the solved poses, where they are enough for one."""
        if smooth is not None:
            self._s = smooth.predict(solved.poses)
            self._slope = smooth.stiffness(solved.poses)

    @property
    def rest_stiffness(self) -> F:
        """K (6, 6) of the mechanism at rest."""
        return self.solved.stiffness[REST_INDEX, :, :6]

    def wrench(self, nearest: I, poses: F) -> F:
        """h at (N, 6) or (N, 6 + m), each near the solved pose of that index (N,)."""
        step = poses - self.solved.poses[nearest]
        h = self.solved.wrenches[nearest] + wrench_change(self.solved.stiffness[nearest], step)
        if self.smooth is not None:
            line = self._s[nearest] + wrench_change(self._slope[nearest], step)
            h = h + self.smooth.predict(poses) - line
        return h

    def pushed(self, nearest: I, poses: F) -> F:
        """(N, 6) G a: what the inputs a of actuators push of h there. No material is in it."""
        if poses.shape[1] == 6:
            return np.zeros(poses.shape)
        return wrench_change(self._slopes(nearest, poses)[:, :, 6:], poses[:, 6:])

    def at_points(self, points: F, *, of_material: bool = False) -> F:
        """h at way points (k, 6 + m): the solver's at solved poses, the smooth map's between.

        Of the material it is h - G a.

        Raises
        ------
        ComputationError
            for a point that is not solved, where there is no smooth map.
        """
        known = self.solved.place
        index = np.asarray([known.get(point.tobytes(), -1) for point in points], dtype=np.int64)
        h: F = self.solved.wrenches[index]
        between = index < 0
        if between.any():
            if self.smooth is None:
                raise ComputationError(
                    f"plant: the way passes {points[between][0].tolist()}, which is none of the "
                    f"{len(known)} solved poses, and there is no smooth map between them. Plan 20 "
                    "poses or more, or hide no effect that remembers its way"
                )
            h[between] = self.smooth.predict(points[between])
        if of_material and points.shape[1] > 6:
            slopes: F = self.solved.stiffness[index]
            if between.any() and self.smooth is not None:
                slopes[between] = self.smooth.stiffness(points[between])
            h = h - wrench_change(slopes[:, :, 6:], points[:, 6:])
        return h

    def stiffness(self, nearest: I, poses: F) -> F:
        """K = dh/dp at the poses: (N, 6, 6)."""
        return self._slopes(nearest, poses)[:, :, :6]

    def _slopes(self, nearest: I, poses: F) -> F:
        """K, and G after it: (N, 6, 6 + m)."""
        slopes: F = self.solved.stiffness[nearest]
        if self.smooth is not None:
            slopes = slopes + self.smooth.stiffness(poses) - self._slope[nearest]
        return slopes


@dataclass(frozen=True)
class Grading:
    """Change of wrench and stiffness at the solved poses per unit contrast of a graded modulus."""

    wrenches: F
    stiffness: F

    def wrench(self, nearest: I, step: F) -> F:
        """At `step` (N, 6) away from the solved poses."""
        return self.wrenches[nearest] + wrench_change(self.stiffness[nearest], step)


def solve_cached(
    source: Source, poses: F, grade: str, folder: Path | None, progress: Progress = None
) -> SolvedPoses:
    """`source.solve`, stored on disk under a hash of the mechanism and the poses."""
    name = f"anchors-1|{source.key()}|{grade}|{CONTRAST}"
    return _kept(folder, name, poses, lambda: source.solve(poses, grade, progress))


def free_cached(source: Source, inputs: F, folder: Path | None) -> SolvedPoses:
    """`source.free_poses`, stored on disk in the same way."""
    solve = getattr(source, "free_poses", None)
    if solve is None:
        raise InputError(
            "the plan's columns offset_x_m, ... start at the free poses of a driven mechanism, and "
            "this source has no free_poses(inputs); add it, or take the columns out"
        )
    return _kept(folder, f"free-1|{source.key()}", inputs, lambda: solve(inputs))


_KEPT = ("wrenches", "stiffness", "status")


def _kept(folder: Path | None, name: str, rows: F, solve: Callable[[], SolvedPoses]) -> SolvedPoses:
    """What `solve` gives for the rows, read from the folder where it is there."""
    if folder is None:
        return solve()
    path = folder / f"anchors-{array_key(name, rows)[:32]}.npz"
    arrays = read_arrays(path)
    if arrays is None:
        solved = solve()
        arrays = {name: np.asarray(getattr(solved, name)) for name in _KEPT}
        if solved.poses is not rows:
            arrays["poses"] = solved.poses
        write_arrays(path, arrays)
        return solved
    wrenches, stiffness, status = (arrays[name] for name in _KEPT)
    return SolvedPoses(arrays.get("poses", rows), wrenches, stiffness, tuple(map(str, status)))


def grading(
    source: Source,
    plain: SolvedPoses,
    grade: str,
    folder: Path | None = None,
    progress: Progress = None,
) -> Grading:
    """Difference of the graded and the plain solution, per unit contrast; 0 where unsolved."""
    graded = solve_cached(source, plain.poses, grade, folder, progress)
    solved = (graded.good & plain.good)[:, None]
    stiffness = (graded.stiffness - plain.stiffness)[:, :, :6]
    return Grading(
        np.where(solved, graded.wrenches - plain.wrenches, 0.0) / CONTRAST,
        np.where(solved[:, None], stiffness, 0.0) / CONTRAST,
    )


def unique_poses(poses: F) -> tuple[F, I]:
    """Distinct rows in the order of first visit, and the index of each row in them."""
    seen: dict[bytes, int] = {}
    index = np.asarray([seen.setdefault(row.tobytes(), len(seen)) for row in poses], dtype=np.int64)
    return poses[np.unique(index, return_index=True)[1]], index
