"""Symmetry of a stiffness, as the paper measures it and without the geometric part of the load.

K = dh/dp of a conservative mechanism is symmetric only at theta = 0 and tau = 0. In rotation
increments of base axes, K_s = K diag(I, J^-1), its skew part is known: -[tau]x/2 in the rotation
block, by the load alone. The rest measures noise, misfit and forces that are not conservative.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ecm._native import convert_stiffness
from ecm.io.arrays import F


@dataclass(frozen=True)
class Symmetry:
    """Parts of a stiffness (N, 6, 6), SI units."""

    symmetric: F
    """(N, 6, 6) K_sym of the paper's equation (10)."""
    skew: F
    """(N, 6, 6) K_skew of the paper's equation (10)."""
    share: F
    """(N,) ||K_sym||_2 / ||K||_2."""
    skew_left: F
    """(N, 6, 6) skew part of K_s without the geometric part of the load."""
    share_without_geometry: F
    """(N,) ||K_s,sym||_2 / ||K_s - geometric part||_2: 1 for every conservative map."""


def symmetry_of(stiffness: F, poses: F, wrenches: F) -> Symmetry:
    """Symmetric and skew parts of the stiffness.

    Parameters
    ----------
    stiffness
        (N, 6, 6) K = dh/dp, SI units.
    poses, wrenches
        (N, 6) each, where the stiffness belongs.

    Source
    ------
    Deutschmann et al., equation (10); docs/explain/mechanics.md.

    Examples
    --------
    >>> poses = np.zeros((1, 6))
    >>> float(symmetry_of(np.eye(6)[None], poses, np.zeros((1, 6))).share[0])
    1.0
    """
    poses, wrenches = np.ascontiguousarray(poses), np.ascontiguousarray(wrenches)
    screw = convert_stiffness(
        np.ascontiguousarray(stiffness), poses, wrenches, source="partial", target="screw"
    )
    x, y, z = wrenches[:, 3:].T
    o = np.zeros_like(x)
    cross = np.stack([np.stack([o, -z, y]), np.stack([z, o, -x]), np.stack([-y, x, o])])
    rest = screw.copy()
    rest[:, 3:, 3:] += 0.5 * np.moveaxis(cross, 2, 0)
    symmetric, skew = _parts(stiffness)
    symmetric_left, skew_left = _parts(rest)
    return Symmetry(
        symmetric, skew, _share(symmetric, stiffness), skew_left, _share(symmetric_left, rest)
    )


def _parts(matrix: F) -> tuple[F, F]:
    transposed = np.swapaxes(matrix, 1, 2)
    return 0.5 * (matrix + transposed), 0.5 * (matrix - transposed)


def _share(part: F, matrix: F) -> F:
    top = np.linalg.norm(part, 2, axis=(1, 2))
    return np.asarray(top / np.linalg.norm(matrix, 2, axis=(1, 2)))
