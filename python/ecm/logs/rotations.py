"""Rotations as logs write them, to rotation vectors and back: R is that of the top frame.

| word | columns | R |
|---|---|---|
| `rotvec` | 3 | exp of the vector |
| `wxyz`, `xyzw` | 4 | of the quaternion, scalar first or last |
| `rows`, `columns` | 9 | the matrix, its rows (or columns) one after the other |
| `ZYX`, ... (capitals) | 3 | turns about the moving axes, in this order (intrinsic) |
| `xyz`, ... (small) | 3 | turns about the fixed axes, in this order (extrinsic) |
| `grood-suntay-right`, `-left` | 3 | flexion, adduction, internal rotation of a knee |

Grood and Suntay (1983), with x to the right, y to the front and z up of the femur, and flexion f,
adduction a and internal rotation i: R = Rx(-f) Ry(-a) Rz(i) of a right knee, Rx(-f) Ry(a) Rz(-i)
of a left one.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from ecm._native import rotation_matrices, rotation_vectors
from ecm.errors import InputError
from ecm.io.arrays import B, F
from ecm.io.frames import ORDERS, quaternions_of, vectors_of

COUNT = {
    "rotvec": 3, "wxyz": 4, "xyzw": 4, "rows": 9, "columns": 9,
    "grood-suntay-right": 3, "grood-suntay-left": 3,
}  # fmt: skip
"""Number of columns of each word; sequences of Euler angles have three."""
_NORM = 1e-3
"""Quaternions and matrices that are farther from unit size are said."""
_UNUSABLE = 0.5
"""A quaternion shorter than this, or a matrix this far from a rotation, has no direction."""


def is_rotation_word(word: str) -> bool:
    """Whether a word names a rotation: of the table above, or a sequence such as `ZYX` or `xyz`."""
    sequence = re.fullmatch(r"[XYZ]{3}|[xyz]{3}", word)
    return word in COUNT or (sequence is not None and word[0] != word[1] and word[1] != word[2])


def check_rotation_word(word: str) -> int:
    """Return the number of columns; InputError for an unknown word."""
    if not is_rotation_word(word):
        raise InputError(
            f"rotation '{word}': expected {', '.join(COUNT)}, or a sequence of Euler angles, e.g. "
            "ZYX about moving axes or xyz about fixed axes"
        )
    return COUNT.get(word, 3)


def to_rotation_vectors(word: str, values: F) -> tuple[F, B, str]:
    """Return rotation vectors of length below pi from what a log holds.

    Parameters
    ----------
    word
        One of the table above.
    values
        (N, k) columns; angles in rad.

    Returns
    -------
    vectors, usable, note
        (N, 3) rad; (N,) whether the row holds a rotation (else its vector is NaN); what was
        normalised, in words.

    Examples
    --------
    >>> half = np.sqrt(0.5)
    >>> to_rotation_vectors("wxyz", np.array([[half, 0.0, 0.0, half]]))[0].round(4)
    array([[0.    , 0.    , 1.5708]])
    """
    check_rotation_word(word)
    usable: B = np.asarray(np.isfinite(values).all(axis=1))
    note = ""
    if word in ORDERS:
        size = np.linalg.norm(np.where(usable[:, None], values, 1.0), axis=1)
        usable &= size > _UNUSABLE
        off = usable & (np.abs(size - 1.0) > _NORM)
        if off.any():
            worst = size[off][np.argmax(np.abs(size[off] - 1.0))]
            note = f"{int(off.sum())} quaternions were normalised (norm up to {worst:.4g})"
    elif word in ("rows", "columns"):
        matrices = values.reshape(-1, 3, 3)
        gram = np.einsum("nij,nkj->nik", matrices, matrices) - np.eye(3)
        error = np.abs(np.where(usable[:, None, None], gram, 0.0)).max(axis=(1, 2))
        usable &= (error < _UNUSABLE) & (np.linalg.det(np.nan_to_num(matrices)) > 0.0)
        if (usable & (error > _NORM)).any():
            note = f"{int((usable & (error > _NORM)).sum())} matrices were made orthogonal"
    elif word == "rotvec":
        long = usable & (np.linalg.norm(np.nan_to_num(values), axis=1) >= np.pi)
        if long.any():
            note = f"{int(long.sum())} rotation vectors beyond pi were turned the shorter way round"
    vectors = np.full((len(values), 3), np.nan)
    if usable.any():
        vectors[usable] = _vectors(word, values[usable])
    return vectors, usable, note


def _vectors(word: str, values: F) -> F:
    if word == "rotvec":
        return _shorter(values)
    if word in ORDERS:
        return vectors_of(values, word)
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - scipy takes long to load

    if word in ("rows", "columns"):
        matrices = values.reshape(-1, 3, 3)
        turned = matrices if word == "rows" else matrices.transpose(0, 2, 1)
        return np.asarray(Rotation.from_matrix(turned).as_rotvec())
    if word.startswith("grood"):
        return np.asarray(Rotation.from_euler("XYZ", values * _signs(word)).as_rotvec())
    return np.asarray(Rotation.from_euler(word, values).as_rotvec())


def rotation_columns(word: str, vectors: F) -> dict[str, F]:
    """Return what a log would hold, as columns, from rotation vectors (N, 3) in rad.

    Angles are in rad: those of Grood and Suntay and of three different axes have the middle one
    between -pi/2 and pi/2. Quaternions have a scalar part of at least 0.

    Where the middle angle leaves the other two undetermined (a gimbal lock), the third is 0, and
    scipy warns.

    Raises
    ------
    InputError
        An unknown word.

    Examples
    --------
    >>> knee = rotation_columns("grood-suntay-right", np.array([[-0.5, 0.0, 0.0]]))
    >>> [(name, float(angle[0].round(3)) + 0.0) for name, angle in knee.items()]
    [('flexion_rad', 0.5), ('adduction_rad', 0.0), ('internal_rotation_rad', 0.0)]
    """
    check_rotation_word(word)
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - scipy takes long to load

    turn = Rotation.from_rotvec(vectors)
    if word == "rotvec":
        names, values = ["rx_rad", "ry_rad", "rz_rad"], vectors
    elif word in ORDERS:
        names = [f"q{letter}" for letter in word]
        values = quaternions_of(vectors, word)
    elif word in ("rows", "columns"):
        pairs = [(i, j) for i in range(3) for j in range(3)]
        pairs = pairs if word == "rows" else [(j, i) for i, j in pairs]
        names = [f"r{i + 1}{j + 1}" for i, j in pairs]
        values = turn.as_matrix()[:, [i for i, _ in pairs], [j for _, j in pairs]]
    elif word.startswith("grood"):
        names = ["flexion_rad", "adduction_rad", "internal_rotation_rad"]
        values = turn.as_euler("XYZ") * _signs(word)
    else:
        names = [f"euler{i + 1}_{axis}_rad" for i, axis in enumerate(word)]
        sequence: Any = word  # checked above
        values = turn.as_euler(sequence)
    return dict(zip(names, np.asarray(values).T, strict=True))


def _signs(word: str) -> F:
    """Signs of Rx, Ry and Rz in flexion, adduction and internal rotation."""
    side = -1.0 if word.endswith("right") else 1.0
    return np.array([-1.0, side, -side])


def _shorter(values: F) -> F:
    """The same rotations as vectors of length below pi."""
    vectors = np.array(values)
    long = np.linalg.norm(values, axis=1) >= np.pi
    if long.any():
        vectors[long] = rotation_vectors(rotation_matrices(np.ascontiguousarray(values[long])))
    return vectors
