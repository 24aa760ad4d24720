"""Quaternions to rotation vectors and back, and those whose scalar was read at the wrong end.

A body near rest looks half a turn away then.
"""

from __future__ import annotations

import numpy as np

from ecm.io.arrays import F

ORDERS = {"wxyz": "xyzw", "xyzw": "wxyz"}
"""The other order of each."""
_FAR = 2.0
"""Median turn, rad, from which poses of a clamped body are doubted."""
_NEAR = 1.0
"""Median turn, rad, below which the other order is believed; nine tenths are below twice that."""


def quaternions_of(vectors: F, order: str) -> F:
    """Return unit quaternions (N, 4) of rotation vectors (N, 3), their scalar at least 0.

    Examples
    --------
    >>> quaternions_of(np.array([[0.0, 0.0, np.pi / 2]]), "xyzw").round(4)
    array([[0.    , 0.    , 0.7071, 0.7071]])
    """
    angle = np.linalg.norm(vectors, axis=1, keepdims=True)
    scalar, vector = np.cos(0.5 * angle), 0.5 * np.sinc(angle / (2.0 * np.pi)) * vectors
    sign = np.where(scalar < 0.0, -1.0, 1.0)
    parts = [vector, scalar] if order == "xyzw" else [scalar, vector]
    return np.asarray(sign * np.hstack(parts))


def vectors_of(quaternions: F, order: str) -> F:
    """Return rotation vectors (N, 3) of at most half a turn, rad, of quaternions (N, 4), any size.

    Examples
    --------
    >>> vectors_of(np.array([[1.0, 0.0, 0.0, -1.0]]), "wxyz").round(4)
    array([[ 0.    ,  0.    , -1.5708]])
    """
    last = order == "xyzw"
    scalar = quaternions[:, 3:] if last else quaternions[:, :1]
    vector = quaternions[:, :3] if last else quaternions[:, 1:]
    turned = vector * np.where(scalar < 0.0, -1.0, 1.0)
    size = np.linalg.norm(turned, axis=1, keepdims=True)
    full = 2.0 * np.arctan2(size, np.abs(scalar))
    return np.asarray(turned * np.divide(full, size, out=np.full_like(size, 2.0), where=size > 0.0))


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
    return vectors_of(quaternions_of(vectors, stated), ORDERS[stated])


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
