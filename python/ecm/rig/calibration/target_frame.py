"""From a marker target to the frame that is wanted: points of the drawing, probed by the camera.

Points c_k are known in the frame (corners and bores of a plate); the camera sees a probe's tip in
them, in target axes, q_k = R c_k + t. R by singular vectors (Kabsch), the uncertainty from the
normal matrix.
"""

from __future__ import annotations

import numpy as np

from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.rig.calibration.frame_fit import FrameFit, solve_scaled
from ecm.rig.frames import rotation_vector, skew


def target_frame(points_in_frame: F, points_in_target: F) -> FrameFit:
    """The frame in target axes, from (n, 3) points known in it and (n, 3) seen in the target's.

    Raises
    ------
    InputError
        Fewer than four points, or all on one line.
    """
    n = len(points_in_frame)
    if n < 4:
        raise InputError(f"target frame: {n} points, expected at least 4")
    middle, seen = points_in_frame.mean(axis=0), points_in_target.mean(axis=0)
    own, far = points_in_frame - middle, points_in_target - seen
    if np.linalg.svd(own, compute_uv=False)[1] < 1e-6 * np.linalg.norm(own):
        raise InputError("target frame: all points lie on one line; add one beside it")
    u, _, vt = np.linalg.svd(far.T @ own)
    turn = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    place = seen - turn @ middle
    residual = points_in_target - points_in_frame @ turn.T - place
    design = np.zeros((n, 3, 6))
    design[:, :, :3] = np.eye(3)
    design[:, :, 3:] = -skew(points_in_frame @ turn.T)
    _, covariance, dof = solve_scaled(design.reshape(-1, 6), residual.ravel())
    frame = np.concatenate([place, rotation_vector(turn[None])[0]])
    return FrameFit(frame, covariance, dof)
