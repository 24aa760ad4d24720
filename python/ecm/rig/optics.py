"""The camera: three lenses, nine LEDs on the top target, and a second target at the base.

An LED is located where at least two lenses see it, and a lens sees it while the LED's direction
and the line of sight are within an angle. Errors of localisation are common to all LEDs of a
target (then they shift and turn it as a whole) or independent (then a rigid fit to the LEDs that
are seen averages them). The camera creeps on its stand; what the base target shows of that is
taken off again.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ecm.io.arrays import B, F
from ecm.rig.frames import rotation, skew
from ecm.rig.physics.leds import LEDS
from ecm.rig.settings import Instruments

LEDS_NEEDED = 4
LENSES_NEEDED = 2
DOME_RAD = 0.5
"""Eight of the LEDs look away from the target's normal by this angle, one along it."""


@lru_cache(maxsize=1)
def _directions() -> F:
    angle = 2.0 * np.pi * np.arange(LEDS - 1) / (LEDS - 1)
    ring = np.stack(
        [
            np.sin(DOME_RAD) * np.cos(angle),
            np.sin(DOME_RAD) * np.sin(angle),
            np.full(LEDS - 1, np.cos(DOME_RAD)),
        ],
        axis=1,
    )
    return np.concatenate([[[0.0, 0.0, 1.0]], ring])


class Optics:
    """Where lenses and LEDs are, and which see which."""

    def __init__(self, settings: Instruments) -> None:
        self._settings = settings
        middle = np.asarray(settings.camera_place_m)
        self.sight = middle / np.linalg.norm(middle)
        """Unit vector from the mechanism to the middle lens, base axes."""
        # The target looks at the camera when the mechanism is at rest: its normal is the sight.
        self._target = _frame_of(self.sight)
        along = self._target[:, 0]
        spread = settings.lens_spread_m
        self._lenses = np.stack([middle - spread * along, middle, middle + spread * along])

    @property
    def directions(self) -> F:
        """(9, 3) unit directions of the LEDs in axes that are the base's at rest."""
        directions: F = _directions() @ self._target.T
        return directions

    @property
    def places_m(self) -> F:
        """(9, 3) of the LEDs about the target's middle, in the same axes."""
        places: F = self._settings.led_radius_m * self.directions
        return places

    def visible(self, poses: F) -> B:
        """(N, 9) LEDs of the top target that are located at poses (N, 6)."""
        turned = np.einsum("nij,kj->nki", rotation(poses[:, 3:]), self.directions)
        seen = np.zeros(turned.shape[:2], dtype=np.int64)
        limit = np.cos(self._settings.led_angle_rad)
        for lens in self._lenses:
            sight = lens - poses[:, :3]
            sight = sight / np.linalg.norm(sight, axis=1, keepdims=True)
            seen += np.einsum("nki,ni->nk", turned, sight) > limit
        visible: B = seen >= LENSES_NEEDED
        return visible

    def rigid(self, pose: F, errors: F) -> F:
        """(6,) shift and turn in base axes that errors (9, 3) of the LEDs at a pose make."""
        seen = self.visible(pose[None])[0]
        if seen.sum() < LEDS_NEEDED:
            seen = np.ones(LEDS, dtype=np.bool_)
        arms = self.places_m[seen] @ rotation(pose[None, 3:])[0].T
        design = np.concatenate([np.tile(np.eye(3), (len(arms), 1, 1)), -skew(arms)], axis=2)
        fitted = np.linalg.lstsq(design.reshape(-1, 6), errors[seen].ravel(), rcond=None)[0]
        return np.asarray(fitted, dtype=np.float64)

    def independent_sd(self) -> tuple[float, float]:
        """Standard deviations of `rigid` for LEDs of 1 m error each, all seen: 1, rad/m."""
        arms = self.places_m
        design = np.concatenate([np.tile(np.eye(3), (LEDS, 1, 1)), -skew(arms)], axis=2)
        flat = design.reshape(-1, 6)
        variance = np.diag(np.linalg.inv(flat.T @ flat))
        return float(np.sqrt(variance[:3].mean())), float(np.sqrt(variance[3:].mean()))


def _frame_of(normal: F) -> F:
    """A rotation whose third column is the normal, the first across the axis of the base."""
    first = np.cross([1.0, 0.0, 0.0], normal)
    size = np.linalg.norm(first)
    first = first / size if size > 1e-9 else np.array([0.0, 1.0, 0.0])
    return np.stack([first, np.cross(normal, first), normal], axis=1)
