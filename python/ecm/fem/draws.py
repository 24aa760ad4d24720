"""Wrenches drawn at random from a box, and the workspace that they must stay inside.

Only about one draw in five of the paper's Table I box stays inside |theta| <= 0.8 rad. So a
Cosserat rod, which takes microseconds a case, screens the draws before the FEM. The rod lacks the
stiffening of bonded ends (about 10 %), so its limit is the rotation limit times `screen_margin`: it
passes every draw that could be inside. From 64 cases on, the warm start of the FEM predicts the
pose within a per cent and screens what the rod has passed.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ecm._native import rod_poses
from ecm.errors import ComputationError, InputError
from ecm.io.arrays import B, F, I
from ecm.io.mechanism import Mechanism
from ecm.io.settings import Checked, setting

TABLE_I_MIN = (-110.0, -100.0, -100.0, -5.0, -5.0, -5.0)
"""Table I of the paper: lower corner of the wrench box, N and N m; compression is negative."""
TABLE_I_MAX = (30.0, 100.0, 100.0, 5.0, 5.0, 5.0)

_DRAW_BLOCK = 2048  # wrenches drawn and screened together
_BLOCKS_WITHOUT_CASE = 50  # after so many blocks without a case the workspace is empty


@dataclass(frozen=True)
class Workspace(Checked):
    """Limits of admissible poses, and the box that wrenches are drawn from.

    Parameters
    ----------
    rotation_limit_rad, stretch_limit
        Largest rotation angle of an admissible pose, and largest principal stretch anywhere in the
        body.
    wrench_min, wrench_max
        Corners of the box of random wrenches, N and N m; the default is Table I of the paper.
    full_box
        Accept every stable solution of the box instead.
    screen_margin
        A draw is solved by FEM if the rod predicts a rotation below this factor times the limit.

    Examples
    --------
    >>> Workspace(rotation_limit_rad=0.5).stretch_limit
    2.5
    >>> Workspace(rotation_limit_rad=45.0)
    Traceback (most recent call last):
    ...
    ecm.errors.InputError: rotation_limit_rad = 45.0: expected above 0 and at most 3.14159 \
(rotation angle in rad, not degrees)
    """

    rotation_limit_rad: float = setting(
        0.8, above=0.0, high=math.pi, doc="rotation angle in rad, not degrees"
    )
    stretch_limit: float = setting(2.5, above=0.0, doc="largest stretch of an admissible pose")
    wrench_min: tuple[float, ...] = setting(TABLE_I_MIN, doc="fx fy fz in N, taux tauy tauz in N m")
    wrench_max: tuple[float, ...] = setting(TABLE_I_MAX, doc="fx fy fz in N, taux tauy tauz in N m")
    full_box: bool = setting(False, doc="keep every stable pose; no screen, no limits")
    screen_margin: float = setting(1.2, above=0.0, doc="the rod screens at the limits times this")

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.wrench_min) != len(self.wrench_max):
            raise InputError("wrench_min and wrench_max: expected six numbers each")
        if not all(a < b for a, b in zip(self.wrench_min, self.wrench_max, strict=True)):
            raise InputError("wrench_min must be below wrench_max in each component")


class RandomWrenches:
    """Uniform wrenches of the box that pass the rod's screen, in a fixed order.

    `drawn` and `screened` count the draws so far, and those of them that passed.
    """

    def __init__(self, mechanism: Mechanism, workspace: Workspace, seed: int) -> None:
        self._rng = np.random.default_rng([seed, 1])
        self._low = np.asarray(workspace.wrench_min)
        self._high = np.asarray(workspace.wrench_max)
        self._limit = workspace.rotation_limit_rad * workspace.screen_margin
        self._sections = None if workspace.full_box else mechanism.rod_sections()
        self._length_m = mechanism.length_m
        self._pending = np.empty((0, 6))
        self._serials = np.empty(0, dtype=np.int64)
        self._next_serial = 0
        self._passed: list[I] = []
        self.drawn = 0
        self.screened = 0

    def next(self, count: int, promising: Callable[[F], B]) -> tuple[F, I]:
        """Return the next `count` draws that pass, and their serial numbers among all draws."""
        taken: list[F] = []
        serials: list[I] = []
        blocks_without_case = size = 0
        while size < count:
            if len(self._pending) == 0:
                self._draw()
            passed = np.flatnonzero(promising(self._pending))[: count - size]
            taken.append(self._pending[passed])
            serials.append(self._serials[passed])
            size += len(passed)
            # Later draws are left to the next call.
            seen = int(passed[-1]) + 1 if size == count else len(self._pending)
            self._pending, self._serials = self._pending[seen:], self._serials[seen:]
            blocks_without_case = 0 if len(passed) else blocks_without_case + 1
            if blocks_without_case >= _BLOCKS_WITHOUT_CASE:
                raise ComputationError(
                    f"none of {blocks_without_case * _DRAW_BLOCK} random wrenches gives a rotation "
                    "within [workspace] rotation_limit_rad: shrink wrench_min and wrench_max"
                )
        self._passed.append(np.concatenate(serials))
        self.drawn = int(self._passed[-1][-1]) + 1
        self.screened += count
        return np.concatenate(taken), self._passed[-1]

    def _draw(self) -> None:
        """Draw a block; those that pass the rod are pending."""
        block = self._rng.uniform(self._low, self._high, (_DRAW_BLOCK, 6))
        serials = np.arange(self._next_serial, self._next_serial + _DRAW_BLOCK, dtype=np.int64)
        self._next_serial += _DRAW_BLOCK
        if self._sections is not None:
            poses, converged = rod_poses(block, length_m=self._length_m, **self._sections)
            rotation = np.linalg.norm(poses[:, 3:], axis=1)
            # If the rod has no equilibrium, the FEM decides.
            passed = ~converged | (rotation <= self._limit)
            block, serials = block[passed], serials[passed]
        self._pending, self._serials = block, serials

    def stop_at(self, serial: int) -> None:
        """Count only draws up to and including this serial number."""
        self.drawn = serial + 1
        self.screened = int(sum((s <= serial).sum() for s in self._passed))
