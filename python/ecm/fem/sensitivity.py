"""Derivatives of the wrench at a pose by modulus, Poisson's ratio, length and radius.

The wrench is proportional to E, so dh/dE = h / E exactly. The others are central differences of
the FEM on meshes of the same structure: their error is of second order in the step and far below
that of the mesh.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ecm.errors import ComputationError, InputError
from ecm.io.arrays import F
from ecm.io.mechanism import Mechanism

_LENGTH_STEP = 1e-3
"""Step of a length, relative."""
_POISSON_STEP = 0.05
"""Step of Poisson's ratio, relative to 0.5 - nu."""


def wrench_sensitivities(mechanism: Mechanism, poses: F, *, threads: int = 0) -> dict[str, F]:
    """Return dh/d(parameter) at given poses.

    Parameters
    ----------
    mechanism
        A body of a builtin shape; a mesh has no dimensions to vary.
    poses
        (N, 6), m and rad, absolute: a longer mechanism at the same pose is compressed.
    threads
        0: all cores.

    Returns
    -------
    dict
        (N, 6) for each of young_modulus_Pa, poisson_ratio (only of a neo-Hookean, compressible
        material), length_m and radius_m; N and N m per unit of the parameter.

    Raises
    ------
    InputError
        For a mesh file, a rod, or a mechanism without a shape.
    ComputationError
        Where a pose has no stable equilibrium.

    Examples
    --------
    >>> neck = Mechanism()
    >>> by = wrench_sensitivities(neck, np.array([[0.1034, 0.002, 0.0, 0.0, 0.0, 0.05]]))
    >>> sorted(by)
    ['length_m', 'poisson_ratio', 'radius_m', 'young_modulus_Pa']
    >>> by["length_m"].shape
    (1, 6)
    """
    if mechanism.mesh_file is not None or mechanism.builtin in ("", "rod"):
        raise InputError("sensitivities need a builtin shape: cylinder, tube, hourglass, ...")
    sensitivities = {
        "young_modulus_Pa": _wrenches(mechanism, poses, threads) / mechanism.young_modulus_Pa,
    }
    if mechanism.material is None and mechanism.poisson_ratio < 0.5:
        nu = mechanism.poisson_ratio
        h = _POISSON_STEP * (0.5 - nu)
        above, below = (replace(mechanism, poisson_ratio=nu + step) for step in (h, -h))
        sensitivities["poisson_ratio"] = (
            _wrenches(above, poses, threads) - _wrenches(below, poses, threads)
        ) / (2.0 * h)
    for name in ("length_m", "radius_m"):
        value = float(getattr(mechanism, name))
        high, low = value * (1.0 + _LENGTH_STEP), value * (1.0 - _LENGTH_STEP)
        above, below = (
            replace(mechanism, length_m=v) if name == "length_m" else replace(mechanism, radius_m=v)
            for v in (high, low)
        )
        sensitivities[name] = (
            _wrenches(above, poses, threads) - _wrenches(below, poses, threads)
        ) / (high - low)
    return sensitivities


def _wrenches(mechanism: Mechanism, poses: F, threads: int) -> F:
    """Return the wrenches (N, 6) of poses (N, 6); ComputationError where one is not stable."""
    results = mechanism.fem().solve_poses(np.ascontiguousarray(poses), threads=threads)
    lost = [i for i, status in enumerate(results.status) if status != "solved"]
    if lost:
        raise ComputationError(
            f"pose {lost[0]} is {results.status[lost[0]]} ({len(lost)} of {len(poses)}): leave "
            "it out, or stay inside the workspace"
        )
    return results.wrenches
