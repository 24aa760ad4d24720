"""Poses of a body's workspace, chosen so that few of them determine an energy.

The wrench box of the paper's Table I, scaled to the body's own stiffness at rest, drives a Cosserat
rod of that stiffness. The rod takes microseconds for each pose, and the FEM needs only the poses.
Loads and rotations go a tenth beyond the workspace, so that it lies inside.
"""

from __future__ import annotations

import numpy as np

from ecm._native import EnergyModel, d_optimal, rod_poses
from ecm.errors import ComputationError
from ecm.fem.simulate import TABLE_I_MAX, TABLE_I_MIN
from ecm.io.arrays import F

ROTATION_LIMIT_RAD = 0.8
MARGIN = 1.1
NECK_BENDING_NM2 = 0.657
"""EI of a rod like the paper's neck, to which Table I belongs (0.65 MPa, r = 33 mm)."""
NECK_LENGTH_M = 0.1034
NOISE = (37e-6, 6e-4, 0.3, 0.010)
"""Standard deviations of the rig: m, rad, N, N m."""
_DRAWS = 256  # solved together; the poses do not depend on it
_CANDIDATES = 800
_MOST_DRAWS = 800_000
_DEGREE = 6


def rod_like(stiffness: F, length_m: float) -> dict[str, float]:
    """EA, GA, EI, GJ of the rod with the (6, 6) stiffness at rest, lateral = 1/(L/GA + L^3/12EI).

    For a clamped end; means over y and z, couplings between axes are ignored.
    """
    compliance = np.diag(np.linalg.inv(stiffness))
    if not np.all(compliance > 0.0):
        raise ComputationError(
            "the body is not stable at rest: the inverse of its stiffness has a negative diagonal; "
            "check the mesh's faces and the material"
        )
    bending = 2.0 * length_m / (compliance[4] + compliance[5])
    lateral = 0.5 * (compliance[1] + compliance[2])
    # c_yy = L/GA + L^3/(3 EI); for a body unlike a rod the shear part may be too small.
    shear = max(lateral - length_m**3 / (3.0 * bending), 0.05 * lateral)
    return {
        "axial_stiffness_N": float(length_m / compliance[0]),
        "shear_stiffness_N": float(length_m / shear),
        "bending_stiffness_Nm2": float(bending),
        "torsion_stiffness_Nm2": float(length_m / compliance[3]),
    }


def wrench_box(bending_Nm2: float, length_m: float) -> tuple[F, F]:
    """Table I for another body: forces scale with EI / L^2, moments with EI / L."""
    lever = length_m / NECK_LENGTH_M
    moment = bending_Nm2 / NECK_BENDING_NM2 / lever
    factors = np.array([moment / lever] * 3 + [moment] * 3)
    return np.asarray(TABLE_I_MIN) * factors, np.asarray(TABLE_I_MAX) * factors


def workspace_poses(
    stiffness: F,
    length_m: float,
    count: int,
    *,
    seed: int,
    margin: float = MARGIN,
    rotation_limit_rad: float = ROTATION_LIMIT_RAD,
) -> F:
    """(count, 6) random poses of the workspace, `margin` times its loads and rotations."""
    sections = rod_like(stiffness, length_m)
    low, high = wrench_box(sections["bending_stiffness_Nm2"], length_m)
    random = np.random.default_rng([seed, 3])
    usable: list[F] = []
    number = drawn = 0
    while number < count:
        if drawn >= _MOST_DRAWS:
            raise ComputationError(
                f"only {number} of {drawn} loads turn the platform by less than "
                f"{rotation_limit_rad} rad; is the body far softer in bending than in shear?"
            )
        wrenches = random.uniform(margin * low, margin * high, (_DRAWS, 6))
        poses, converged = rod_poses(wrenches, length_m=length_m, **sections)
        rotation = np.linalg.norm(poses[:, 3:], axis=1)
        usable.append(poses[converged & (rotation <= margin * rotation_limit_rad)])
        number += len(usable[-1])
        drawn += _DRAWS
    return np.ascontiguousarray(np.concatenate(usable)[:count])


def spread_poses(
    stiffness: F,
    length_m: float,
    count: int,
    *,
    seed: int,
    threads: int = 0,
    rotation_limit_rad: float = ROTATION_LIMIT_RAD,
) -> F:
    """(count, 6) poses of the workspace: half D-optimal for an energy, half random.

    The first half lies at the limits of the workspace, the second also in its middle.
    """
    pool = workspace_poses(
        stiffness, length_m, _CANDIDATES, seed=seed, rotation_limit_rad=rotation_limit_rad
    )
    bounding = count // 2
    regressor = EnergyModel.regressor(
        pool, length_m=length_m, degree=_DEGREE, symmetry="alike", scale=np.array([length_m, 1.0])
    )
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
