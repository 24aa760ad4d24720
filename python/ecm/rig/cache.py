"""Where solved anchors are kept between campaigns on the same poses."""

from __future__ import annotations

import hashlib
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecm.errors import ComputationError
from ecm.stages import atomic


def digest(label: str, array: NDArray[np.float64]) -> str:
    """Hash of a label and the exact bytes of an array."""
    text = f"{label}|{array.shape}|".encode()
    return hashlib.sha256(text + np.ascontiguousarray(array, dtype="<f8").tobytes()).hexdigest()


def load(path: Path) -> dict[str, NDArray[np.float64]] | None:
    """The arrays of a finished file, or None where there is none or it is damaged."""
    try:
        with path.open("rb") as stream, np.load(stream) as data:
            return {name: data[name] for name in data.files}
    except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile):
        return None


def save(path: Path, arrays: dict[str, Any]) -> None:
    """Atomic: temporary file, fsync, rename.

    Raises
    ------
    ComputationError
        Where the folder cannot be written.
    """
    try:
        with atomic(path) as stream:
            np.savez(stream, **arrays)
    except OSError as error:
        raise ComputationError(
            f"{path.parent}: solved poses cannot be kept there: {error.strerror}. Name a folder "
            "that can be written in the environment variable ECM_CACHE"
        ) from None
