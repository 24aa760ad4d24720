"""How the wrench of a pose depends on modulus, Poisson's ratio, length and radius.

The wrench is proportional to E, so dh/dE = h / E exactly. The others are central differences of
the FEM on meshes of the same structure: their error is of second order in the step and far below
that of the mesh.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ecm.errors import ComputationError, InputError
from ecm.mechanism import Mechanism

F = NDArray[np.float64]

STEP = 1e-3
"""Relative step of lengths; of nu the share of 0.5 - nu."""


def wrench_sensitivities(mechanism: Mechanism, poses: F, *, threads: int = 0) -> dict[str, F]:
    """dh/d(parameter) at given poses, (N, 6) per parameter.

    Parameters
    ----------
    poses
        (N, 6), m and rad, absolute: a longer mechanism at the same pose is compressed.

    Errors
    ------
    InputError
        For a mesh of its own: its lengths are no parameters.
    ComputationError
        Where a pose has no stable state.
    """
    if mechanism.mesh_file is not None or mechanism.builtin in ("", "rod"):
        raise InputError("sensitivities need a builtin shape: cylinder, tube, hourglass, ...")
    found = {
        "young_modulus_Pa": _wrenches(mechanism, poses, threads) / mechanism.young_modulus_Pa,
    }
    if mechanism.material is None and mechanism.poisson_ratio < 0.5:
        nu = mechanism.poisson_ratio
        h = 0.05 * (0.5 - nu)
        found["poisson_ratio"] = (
            _wrenches(replace(mechanism, poisson_ratio=nu + h), poses, threads)
            - _wrenches(replace(mechanism, poisson_ratio=nu - h), poses, threads)
        ) / (2.0 * h)
    for name in ("length_m", "radius_m"):
        value = float(getattr(mechanism, name))
        up, down = value * (1.0 + STEP), value * (1.0 - STEP)
        found[name] = (
            _wrenches(_with(mechanism, name, up), poses, threads)
            - _wrenches(_with(mechanism, name, down), poses, threads)
        ) / (up - down)
    return found


def _with(mechanism: Mechanism, name: str, value: float) -> Mechanism:
    return (
        replace(mechanism, length_m=value)
        if name == "length_m"
        else replace(mechanism, radius_m=value)
    )


def _wrenches(mechanism: Mechanism, poses: F, threads: int) -> F:
    results = mechanism.fem().solve_poses(np.ascontiguousarray(poses), threads=threads)
    lost = [i for i, status in enumerate(results.status) if status != "solved"]
    if lost:
        raise ComputationError(
            f"pose {lost[0]} is {results.status[lost[0]]} ({len(lost)} of {len(poses)}): leave "
            "it out, or stay inside the workspace"
        )
    return results.wrenches
