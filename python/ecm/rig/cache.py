"""Where solved anchors are kept between campaigns on the same poses."""

from __future__ import annotations

import hashlib
import os
import tempfile
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecm.errors import ComputationError


def directory() -> Path:
    """ECM_CACHE, else XDG_CACHE_HOME/ecm, else ~/.cache/ecm."""
    named = os.environ.get("ECM_CACHE")
    if named:
        return Path(named)
    home = os.environ.get("XDG_CACHE_HOME")
    return (Path(home) if home else Path.home() / ".cache") / "ecm"


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
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(dir=path.parent, suffix=".tmp")
        try:
            with os.fdopen(handle, "wb") as stream:
                np.savez(stream, **arrays)
                stream.flush()
                os.fsync(stream.fileno())
            os.replace(temporary, path)
        except BaseException:
            Path(temporary).unlink(missing_ok=True)
            raise
    except OSError as error:
        raise ComputationError(
            f"{path.parent}: solved poses cannot be kept there: {error.strerror}. Name a folder "
            "that can be written in the environment variable ECM_CACHE"
        ) from None
