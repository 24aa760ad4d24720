"""Geometry of the tendons: their lengths at a pose, and the wrench of their forces on the head.

A tendon runs from its guide g in the base to its anchor a on the head. With the unit vector u from
anchor to guide the force t pulls with t u at the point r + R a, so that its wrench about the
origin of the top frame is t (u, R a x u). The columns (u, R a x u) are also minus the derivative
of the length to a twist of the head.
"""

from __future__ import annotations

import numpy as np

from ecm.io.arrays import F
from ecm.rig.frames import rotation
from ecm.workflow.head.settings import Tendons


def tendon_lengths(tendons: Tendons, pose: F) -> F:
    """(4,) m from guide to anchor at a pose (6,).

    Examples
    --------
    >>> tendons = Tendons(twist_rad=0.0)
    >>> tendon_lengths(tendons, np.array([0.1, 0, 0, 0, 0, 0]))
    array([0.1, 0.1, 0.1, 0.1])
    """
    return np.asarray(np.linalg.norm(_spans(tendons, pose)[0], axis=1))


def tendon_matrix(tendons: Tendons, pose: F) -> F:
    """A (6, 4): the wrench on the head, base axes about the top frame's origin, is A t.

    Examples
    --------
    Straight tendons press the neck and turn nothing about its axis.

    >>> A = tendon_matrix(Tendons(twist_rad=0.0), np.array([0.1, 0, 0, 0, 0, 0]))
    >>> wrench = A @ np.full(4, 10.0)
    >>> bool(np.allclose(wrench, [-40, 0, 0, 0, 0, 0]))
    True
    """
    spans, arms = _spans(tendons, pose)
    along = spans / np.linalg.norm(spans, axis=1, keepdims=True)
    return np.asarray(np.concatenate([along, np.cross(arms, along)], axis=1).T)


def _spans(tendons: Tendons, pose: F) -> tuple[F, F]:
    arms = tendons.anchors_m @ rotation(pose[None, 3:])[0].T
    return tendons.guides_m - pose[:3] - arms, arms
