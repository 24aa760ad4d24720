"""Quaternions whose scalar was read at the wrong end: a body near rest looks half a turn away."""

from __future__ import annotations

import numpy as np

from ecm.io.arrays import F

ORDERS = {"wxyz": "xyzw", "xyzw": "wxyz"}
"""The other order of each."""
_FAR = 2.0
"""Median turn, rad, from which poses of a clamped body are doubted."""
_NEAR = 1.0
"""Median turn, rad, below which the other order is believed; nine tenths are below twice that."""


def read_in_other_order(vectors: F, stated: str) -> F:
    """Return rotation vectors (N, 3) of the same four numbers with the scalar at the other end.

    Parameters
    ----------
    vectors
        (N, 3) rad, of the quaternions in the stated order.
    stated
        `wxyz` or `xyzw`.

    Examples
    --------
    >>> read_in_other_order(np.array([[np.pi, 0.0, 0.0]]), "xyzw").round(9) + 0.0
    array([[0., 0., 0.]])
    """
    angle = np.linalg.norm(vectors, axis=1, keepdims=True)
    w, v = np.cos(0.5 * angle), 0.5 * np.sinc(angle / (2.0 * np.pi)) * vectors
    x, y, z = v[:, :1], v[:, 1:2], v[:, 2:]
    # Four numbers in the stated order, then their parts in the other one.
    scalar, vector = (z, [w, x, y]) if stated == "wxyz" else (x, [y, z, w])
    turned = np.hstack(vector) * np.where(scalar < 0.0, -1.0, 1.0)
    size = np.linalg.norm(turned, axis=1, keepdims=True)
    full = 2.0 * np.arctan2(size, np.abs(scalar))
    return np.asarray(turned * np.where(size > 0.0, full / np.where(size > 0.0, size, 1.0), 2.0))


def likely_order(vectors: F, stated: str = "") -> str:
    """Return the order in which quaternions were likely meant; empty where the stated may be right.

    A body whose base is clamped is turned little. Read in the wrong order it is turned by half a
    turn, about x where the scalar was first and about z where it was last.

    Parameters
    ----------
    vectors
        (N, 3) rad.
    stated
        Order that was stated; default: either.

    Examples
    --------
    >>> likely_order(np.array([[3.1, 0.02, 0.0], [3.0, 0.0, 0.1]]))
    'wxyz'
    >>> likely_order(np.array([[0.1, 0.02, 0.0], [0.3, 0.0, 0.1]]))
    ''
    """
    known = vectors[np.isfinite(vectors).all(axis=1)]
    if not len(known) or np.median(np.linalg.norm(known, axis=1)) < _FAR:
        return ""
    for order, meant in ORDERS.items():
        turns = np.linalg.norm(read_in_other_order(known, order), axis=1)
        near = np.median(turns) < _NEAR and np.quantile(turns, 0.9) < 2.0 * _NEAR
        if stated in ("", order) and near:
            return meant
    return ""


def order_warning(vectors: F, stated: str = "") -> str:
    """Return what looks wrong with the order of quaternions, in words; empty where nothing does.

    Examples
    --------
    >>> order_warning(np.array([[0.0, 0.1, 3.1]]))[:58]
    'the rotations look read from quaternions in the order wxyz'
    """
    meant = likely_order(vectors, stated)
    if not meant:
        return ""
    turn = np.degrees(np.nanmedian(np.linalg.norm(vectors, axis=1)))
    other = np.linalg.norm(read_in_other_order(vectors, ORDERS[meant]), axis=1)
    return (
        f"the rotations look read from quaternions in the order {ORDERS[meant]}, which are {meant}:"
        f" half of them are turned by more than {turn:.0f} degrees, in the other order by "
        f"{np.degrees(np.nanmedian(other)):.0f}; import again with --rotation {meant}, unless the "
        "frames are meant to stand half a turn apart"
    )
