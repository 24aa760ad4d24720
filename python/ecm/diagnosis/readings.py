"""Readings of a table compared: which of them a base fits far better than the stated one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ecm.diagnosis.restated_points import moved_points
from ecm.errors import EcmError, ModelError
from ecm.io.arrays import F, rest_of
from ecm.io.restated import Restatement, restatements
from ecm.models.maps import StiffnessMap

EQUAL = 1.5
"""What leaves up to so many times the least squares is said as well."""
_MOST_SAID = 2


@dataclass(frozen=True)
class WrongStatement:
    """A reading of the table that fits far better than the one that was stated."""

    what: str
    error_before: float
    """Error of the base, or of the model that was given, over the noise, as stated."""
    error_after: float
    """The same with the other reading."""

    def sentence(self) -> str:
        """Return what looks wrong, and what it rests on."""
        return (
            f"{self.what}: with that mended the error falls from {self.error_before:.3g} to "
            f"{self.error_after:.3g} times the noise"
        )


def best_readings(
    base: StiffnessMap, poses: F, wrench: F, length_m: float | None, share: float
) -> list[Restatement]:
    """Return the readings of which a base leaves the least, the simplest first.

    Parameters
    ----------
    base
        Its coefficients are fitted to each reading.
    poses, wrench
        (N, 6) as stated, m and rad, N and N m.
    length_m
        Length of the mechanism; None where it is not known, then no origins are searched, and no
        units of the pose are tried.
    share
        Largest share of the error that the best may leave; none are returned above it.
    """
    as_stated = _columns(base, poses)
    if as_stated is None:
        return []

    def left_by(poses: F, wrench: F) -> F:
        columns = _columns(base, poses)
        if columns is None:
            raise ModelError("no such pose")
        return _rest(columns, wrench)

    if length_m is None:
        # Every symmetric stiffness has an energy where the rotations are small enough.
        listed = [item for item in restatements(None) if not item.of_pose_unit]
    else:
        listed = [*restatements(length_m), *moved_points(length_m, poses, wrench, left_by)]
    left: list[tuple[float, Restatement]] = []
    for item in listed:
        try:
            own_poses, own_wrench = item.change(poses, wrench)
        except EcmError:
            continue
        columns = _columns(base, own_poses) if item.of_pose else as_stated
        if columns is not None:
            left.append((_misfit(columns, own_wrench), item))
    return best_of(left, share**2 * _misfit(as_stated, wrench))


def best_of(left: Sequence[tuple[float, Restatement]], most: float) -> list[Restatement]:
    """Return the readings that leave about the least squares; none where that is above `most`."""
    least = min((value for value, _ in left), default=np.inf)
    if not least <= most:
        return []
    return [item for value, item in left if value <= EQUAL * least][:_MOST_SAID]


def _columns(base: StiffnessMap, poses: F) -> tuple[F, F] | None:
    """Return the wrench (n, 6) and its derivative (n, 6, k) to the coefficients; None: no pose."""
    try:
        poses = np.ascontiguousarray(poses)
        found = base.predict(poses), base.columns(poses)
    except EcmError:
        return None
    return found if all(np.isfinite(part).all() for part in found) else None


def _misfit(base: tuple[F, F], wrench: F) -> float:
    """Return the share of the squares of force and of torque that the base leaves."""
    return float((_rest(base, wrench) ** 2).mean())


def _rest(base: tuple[F, F], wrench: F) -> F:
    """Return (6 n,) what the fitted base leaves, over the rms of force and of torque."""
    predicted, columns = base
    size = np.repeat([np.sqrt((part**2).mean()) for part in (wrench[:, :3], wrench[:, 3:])], 3)
    size = np.where(size > 0.0, size, 1.0)
    y = ((wrench - predicted) / size).ravel()
    z = (columns / size[:, None]).reshape(len(y), -1)
    return rest_of(z, y)
