"""Anchors of the plant by the finite element solver, pose-driven."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ecm._native import EnergyModel
from ecm.io.arrays import F
from ecm.io.material import Material
from ecm.io.mechanism import Mechanism
from ecm.rig.elastic import (
    CONTRAST,
    COS2,
    SIN2,
    STIFF,
    TAPER,
    THICK,
    UNIFORM,
    Anchors,
    Progress,
    Smooth,
)


class FemSource:
    """A mechanism file as a source of anchors."""

    def __init__(self, mechanism: Mechanism, *, threads: int = 0) -> None:
        self._mechanism = mechanism
        self._threads = threads

    @property
    def length_m(self) -> float:
        return self._mechanism.length_m

    def key(self) -> str:
        return self._mechanism.key()

    def solve(self, poses: F, grade: str, progress: Progress = None) -> Anchors:
        """FEM wrench and K at each pose, with the modulus graded over the cross-section."""
        fem = changed(self._mechanism, grade).fem(
            element_modulus_scale=modulus_grade(self._mechanism, grade)
        )
        word = "plant" if grade == UNIFORM else f"plant ({grade})"

        def report(done: int, total: int) -> None:
            if progress is not None:
                progress(done, total, word)

        results = fem.solve_poses(poses, threads=self._threads, progress=report)
        return Anchors(poses, results.wrenches, results.stiffness, tuple(results.status))

    def surrogate(self, anchors: Anchors) -> Smooth | None:
        """A symmetric energy model of the anchors that moved."""
        if sum(s == "solved" for s in anchors.status) < ENOUGH_FOR_SURROGATE:
            return None
        return EnergySurrogate(anchors, self.length_m)


def changed(mechanism: Mechanism, grade: str) -> Mechanism:
    """The body that a grade solves: thicker, or of a rubber that stiffens; else the same."""
    if grade == THICK:
        thicker = 1.0 + CONTRAST
        return replace(
            mechanism,
            radius_m=thicker * mechanism.radius_m,
            inner_radius_m=thicker * mechanism.inner_radius_m,
            waist_radius_m=thicker * mechanism.waist_radius_m,
        )
    if grade == STIFF:
        nu = mechanism.poisson_ratio
        c1 = mechanism.young_modulus_Pa / (4.0 * (1.0 + nu))
        stiffer = {"c1_Pa": c1, "c2_Pa": 4.0 * CONTRAST * c1, "c3_Pa": 0.0}
        return replace(mechanism, material=Material("yeoh", {**stiffer, "poisson_ratio": nu}))
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
    factor: F = 1.0 + CONTRAST * squared / radius_squared * wave(2.0 * np.arctan2(z, y))
    return factor


class EnergySurrogate:
    """A symmetric energy model fitted to the anchors: it gives curvature, never the value."""

    def __init__(self, anchors: Anchors, length_m: float) -> None:
        solved = np.asarray([s == "solved" for s in anchors.status])
        # The rest pose has h = 0 and tells the fit nothing that the energy's form does not.
        moving = solved & (np.linalg.norm(anchors.wrenches, axis=1) > 0.0)
        degree = 6 if moving.sum() >= 60 else 4
        self._model = EnergyModel.fit(
            anchors.poses[moving],
            anchors.wrenches[moving],
            length_m=length_m,
            degree=degree,
            symmetry="revolution",
        )

    def predict(self, poses: F) -> F:
        return self._model.predict(poses)

    def stiffness(self, poses: F) -> F:
        return self._model.stiffness(poses)


ENOUGH_FOR_SURROGATE = 20
"""Below so many anchors the increment is the linear one of the anchor's own K."""
