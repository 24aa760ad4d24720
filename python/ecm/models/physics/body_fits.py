"""One energy per body from FEM at few chosen poses, and the family of these energies.

The wrench box of the paper's Table I, scaled to the body's own stiffness at rest, drives a Cosserat
rod of that stiffness. The rod takes microseconds for each pose, and the FEM needs only the poses.
Loads and rotations go a tenth beyond the workspace, so that it lies inside.

All bodies are fitted at the same poses with the same weights: one design matrix, many right sides.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ecm._native import convert_stiffness, d_optimal, mid_frame, rod_poses
from ecm.errors import ComputationError
from ecm.fem.simulate import TABLE_I_MAX, TABLE_I_MIN
from ecm.io.arrays import B, F, central_differences, lstsq, rms, rms_of_columns
from ecm.models.literature import rod_sections
from ecm.models.maps import EnergyTerms, Symmetry
from ecm.models.physics.family import POWER, PhysicsFamily, poisson_ratio
from ecm.regression.noise import whiteners

ROTATION_LIMIT_RAD = 0.8
MARGIN = 1.1
NECK_BENDING_NM2 = 0.657
"""EI of a rod like the paper's neck, to which Table I belongs (0.65 MPa, r = 33 mm)."""
NOISE = (37e-6, 6e-4, 0.3, 0.010)
"""Standard deviations of the rig: m, rad, N, N m."""
_DRAWS = 256  # solved together; the poses do not depend on it
_CANDIDATES = 800
_MOST_DRAWS = 800_000
_DEGREE = 6
LENGTH_M = 0.1034
"""Length at which every shape is solved, that of the paper's neck."""


def rod_like(stiffness: F, length_m: float) -> dict[str, float]:
    """EA, GA, EI, GJ of the rod with the (6, 6) stiffness at rest, without couplings of axes."""
    compliance = np.diag(np.linalg.inv(stiffness))
    if not np.all(compliance > 0.0):
        raise ComputationError(
            "the body is not stable at rest: the inverse of its stiffness has a negative diagonal; "
            "check the mesh's faces and the material"
        )
    return rod_sections(compliance, length_m)


def workspace_poses(
    stiffness: F,
    count: int,
    *,
    seed: int,
    margin: float = MARGIN,
    rotation_limit_rad: float = ROTATION_LIMIT_RAD,
    usual_rad: float = ROTATION_LIMIT_RAD,
    more_force: tuple[float, float] = (1.0, 1.0),
) -> F:
    """(count, 6) random poses of the workspace, `margin` times its loads and rotations.

    Of a body whose usual rotation is smaller the loads are smaller; its forces along the axis and
    across it are `more_force` times those.
    """
    sections = rod_like(stiffness, LENGTH_M)
    # Loads of bodies of one length scale with EI.
    size = sections["bending_stiffness_Nm2"] / NECK_BENDING_NM2
    # Where loads go with EI, the strain of a moment goes with r / L, of a force with its square.
    share = np.minimum(1.0, np.array([usual_rad, rotation_limit_rad]) / ROTATION_LIMIT_RAD)
    less = np.repeat(share ** [2, 1], 3)
    less[:3] *= np.repeat(more_force, [1, 2])
    low, high = (less * (margin * (size * np.asarray(end))) for end in (TABLE_I_MIN, TABLE_I_MAX))
    random = np.random.default_rng([seed, 3])
    usable: list[F] = []
    number = drawn = 0
    while number < count:
        if drawn >= _MOST_DRAWS:
            raise ComputationError(
                f"only {number} of {drawn} loads turn the platform by less than "
                f"{rotation_limit_rad} rad; is the body far softer in bending than in shear?"
            )
        wrenches = random.uniform(low, high, (_DRAWS, 6))
        poses, converged = rod_poses(wrenches, length_m=LENGTH_M, **sections)
        rotation = np.linalg.norm(poses[:, 3:], axis=1)
        usable.append(poses[converged & (rotation <= margin * rotation_limit_rad)])
        number += len(usable[-1])
        drawn += _DRAWS
    return np.ascontiguousarray(np.concatenate(usable)[:count])


def spread_poses(
    stiffness: F,
    count: int,
    *,
    seed: int,
    threads: int = 0,
    **limits: Any,
) -> F:
    """(count, 6) poses of the workspace: half D-optimal for an energy, half random.

    The first half lies at the limits of the workspace, the second also in its middle. The limits
    are those of `workspace_poses`.
    """
    pool = workspace_poses(stiffness, _CANDIDATES, seed=seed, **limits)
    bounding = count // 2
    regressor = EnergyTerms(LENGTH_M, _DEGREE).regressor(pool, np.array([LENGTH_M, 1.0]))
    position, rotation, force, torque = NOISE
    variance = (stiffness[:, :3] ** 2).sum(axis=1) * position**2
    variance += (stiffness[:, 3:] ** 2).sum(axis=1) * rotation**2
    variance += np.array([force] * 3 + [torque] * 3) ** 2
    rows = regressor / np.sqrt(variance)[:, None]
    chosen = d_optimal(
        np.ascontiguousarray(rows.reshape(-1, rows.shape[2])),
        bounding,
        rows_per_pose=6,
        starts=1,
        seed=seed,
        threads=threads,
        method="rowwise",
    ).indices
    others = np.setdiff1d(np.arange(_CANDIDATES), chosen)[: count - bounding]
    return np.ascontiguousarray(pool[np.concatenate([chosen, others])])


SHEAR_MODULUS_PA = 0.65e6 / 2.98
"""Shear modulus with which every shape is solved: a family belongs to a shape, not to a size."""
_S_STEP = 0.2
_S_MOST = 1.45
_NEAR = 0.01
_STEP_IN_D = 0.1
_STEP = np.array([2e-3] * 3 + [4e-2] * 3)
"""Weights of stiffness against wrench: its change over such a step, m and rad."""
_GOAL = 0.04
"""Error over the rig's noise that is small enough to take a form."""
_FORMS: tuple[tuple[Symmetry, int], ...] = (
    ("alike", 6),
    ("alike", 7),
    ("alike", 8),
    ("revolution", 6),
    ("revolution", 8),
    ("general", 4),
    ("general", 5),
    ("general", 6),
)


@dataclass(frozen=True)
class Solved:
    """FEM results at the poses of one body."""

    wrenches: F
    stiffness: F
    ok: B

    def cut(self, rows: B) -> Solved:
        """Only these poses."""
        return Solved(self.wrenches[rows], self.stiffness[rows], self.ok[rows])


class Unseen:
    """Test poses of a body that no fit has used."""

    def __init__(self, poses: F, solved: Solved, s: float, x: float) -> None:
        self.poses, self.wrenches = poses, solved.wrenches
        self.whiteners = noise_whiteners(poses, solved.stiffness)
        self._nu, self._across = poisson_ratio(s), float(np.exp(x))

    def values(self, diameter_over_length: float) -> dict[str, float]:
        """The body's parameters."""
        return {
            "young_modulus_Pa": 2.0 * SHEAR_MODULUS_PA * (1.0 + self._nu),
            "poisson_ratio": self._nu,
            "length_m": LENGTH_M,
            "diameter_m": diameter_over_length * LENGTH_M * self._across,
        }


@dataclass(frozen=True)
class Nodes:
    """Bodies to solve: their s = mu/kappa and x = ln of the factor on D."""

    centre: float
    s: F
    x: F

    @staticmethod
    def around(centre: float) -> Nodes:
        """The stated s, and one far from it on each side where the range allows."""
        low, high = max(0.0, centre - _S_STEP), min(centre + _S_STEP, _S_MOST)
        s = np.array([low, centre, high])
        if centre - low < _NEAR:
            s = np.array([centre, 0.5 * (centre + high), high])
        elif high - centre < _NEAR:
            s = np.array([low, 0.5 * (low + centre), centre])
        return Nodes(centre, s, np.log(1.0 + _STEP_IN_D * np.array([-1.0, 0.0, 1.0])))

    @property
    def nominal(self) -> int:
        """Number of the stated body among the nine."""
        return 3 * int(np.argmin(np.abs(self.s - self.centre))) + 1

    @property
    def s_range(self) -> tuple[float, float]:
        """Range of s, extended to the incompressible s = 0 where that is near."""
        return max(0.0, self.centre - _S_STEP), float(self.s.max())

    @property
    def unseen(self) -> tuple[tuple[float, float], ...]:
        """The stated body, one between the nodes of s, and one between those of both."""
        between = float(self.s[1:].mean() if self.nominal > 1 else self.s[:2].mean())
        return ((self.centre, 0.0), (between, 0.0), (between, 0.5 * float(self.x[2])))

    def table(self, values: F) -> F:
        """(3, 3, k) coefficients by powers of t and x, from (9, k) values body by body."""
        in_t = np.vander((self.s - self.centre) / _S_STEP, 3, increasing=True)
        in_x = np.vander(self.x, 3, increasing=True)
        free = values.reshape(3, 3, -1) / np.exp(POWER * self.x)[None, :, None]
        by_t = np.linalg.solve(in_t, free.reshape(3, -1)).reshape(free.shape)
        swapped = np.linalg.solve(in_x, np.swapaxes(by_t, 0, 1).reshape(3, -1))
        # In the order in which the cache gives it back: sums of another one end in other bits.
        return np.ascontiguousarray(np.swapaxes(swapped.reshape(free.shape), 0, 1))


def noise_whiteners(poses: F, stiffness: F) -> F:
    """(N, 6, 6) whiteners of the rig's noise, with the pose noise through K_s, at the neck's size.

    The noise of the rig belongs to the neck; forces scale with mu L^2, moments with mu L^3.
    """
    position, rotation, force, torque = NOISE
    screw = convert_stiffness(
        stiffness, poses, np.zeros((len(poses), 6)), source="partial", target="screw"
    )
    along, about = screw[:, :, :3], screw[:, :, 3:]
    covariance = position**2 * along @ np.swapaxes(along, 1, 2)
    covariance += rotation**2 * about @ np.swapaxes(about, 1, 2)
    covariance += np.diag([force**2] * 3 + [torque**2] * 3)
    return whiteners(covariance)


class BodyFits:
    """One design matrix for all bodies: wrench and stiffness at the same poses, whitened."""

    def __init__(self, poses: F, bodies: list[Solved], nominal: int) -> None:
        self.poses, self.bodies = poses, bodies
        c = mid_frame(poses, LENGTH_M)[:, :3] / LENGTH_M
        along, across = c[:, 0], np.linalg.norm(c[:, 1:], axis=1)
        self.shifts = np.array([along.min(), along.max(), across.max()])
        self.scale = np.array(
            [np.linalg.norm(c, axis=1).max(), np.linalg.norm(poses[:, 3:], axis=1).max()]
        )
        self._whiteners = noise_whiteners(poses, bodies[nominal].stiffness)

    def coefficients(self, symmetry: Symmetry, degree: int) -> F | None:
        """(9, k) dimensionless, one row per body; None with too few poses for the terms."""
        rows = self._rows(self.poses, symmetry, degree)
        if 2 * rows.shape[2] > 27 * len(self.poses):
            return None
        slopes = central_differences(
            lambda at: self._rows(at, symmetry, degree), self.poses, [2e-5] * 3 + [2e-4] * 3
        )
        weighed = [size * slope for size, slope in zip(_STEP, slopes, strict=True)]
        matrix = np.stack([rows, *weighed], axis=2)
        target = np.stack(
            [
                np.concatenate([b.wrenches[:, :, None], b.stiffness * _STEP], axis=2)
                for b in self.bodies
            ],
            axis=3,
        )
        white = np.einsum("nij,njdk->nidk", self._whiteners, matrix).reshape(-1, rows.shape[2])
        right = np.einsum("nij,njdb->nidb", self._whiteners, target).reshape(len(white), -1)
        size = np.linalg.norm(white, axis=0)
        size = np.where(size > 0.0, size, 1.0)
        solution = lstsq(white / size, right, rcond=1e-12) / size[:, None]
        return np.asarray(solution.T / (SHEAR_MODULUS_PA * LENGTH_M**3))

    def _rows(self, poses: F, symmetry: Symmetry, degree: int) -> F:
        scale = np.array([self.scale[0] * LENGTH_M, self.scale[1]])
        return EnergyTerms(LENGTH_M, degree, symmetry).regressor(poses, scale)


def best_family(
    fit: BodyFits, tests: list[Unseen], nodes: Nodes, diameter_over_length: float
) -> PhysicsFamily:
    """The first form whose error is small against the noise, else the best one."""
    trials: list[PhysicsFamily] = []
    for symmetry, degree in _FORMS:
        values = fit.coefficients(symmetry, degree)
        if values is None:
            continue
        trial = PhysicsFamily(
            degree=degree,
            symmetry=symmetry,
            scale=fit.scale,
            table=nodes.table(values),
            centre=(nodes.centre, diameter_over_length),
            width=_S_STEP,
            s_range=nodes.s_range,
            x_range=(float(nodes.x[0]), float(nodes.x[2])),
            error=np.zeros((2, 6)),
            error_over_noise=np.zeros(3),
            shifts=fit.shifts,
        )
        trials.append(_with_errors(trial, tests))
        if trials[-1].error_over_noise[0] < _GOAL:
            break
    # The fewest poses of a build tell the terms of the first form: one was tried.
    return min(trials, key=lambda family: float(family.error_over_noise[0]))


def _with_errors(family: PhysicsFamily, tests: list[Unseen]) -> PhysicsFamily:
    residuals, whitened = [], []
    for test in tests:
        residual = family.at(test.values(family.centre[1])).predict(test.poses) - test.wrenches
        residuals.append(residual)
        whitened.append(rms(np.einsum("nij,nj->ni", test.whiteners, residual)))
    unit = SHEAR_MODULUS_PA * LENGTH_M ** np.repeat([2.0, 3.0], 3)
    errors = [rms_of_columns(np.concatenate(part)) / unit for part in (residuals[:2], residuals)]
    return replace(family, error=np.stack(errors), error_over_noise=np.array(whitened))
