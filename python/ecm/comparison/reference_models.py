"""Four reference models side by side, and the family of the missing effect that they point to.

Each is the held-out error in units of the noise: of the physics base, of the symmetric energy
model, of the ceiling (base and a free cubic of the pose), and of the noise itself: 1. What the
energy can fit and the physics cannot is symmetric: elasticity or geometry. What the ceiling can fit
and the energy cannot is asymmetric or not conservative. What the ceiling cannot fit is no function
of the pose: history, time or noise.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from ecm.errors import ModelError, Remedy
from ecm.io.columns import POSE, WRENCH
from ecm.io.events import fields_json
from ecm.io.table import Table
from ecm.models.errors import NEAR_NOISE, ceiling_rms, held_out
from ecm.models.fit import symmetric_energy
from ecm.models.joint_fit import joint_fit
from ecm.models.maps import StiffnessMap
from ecm.models.model import Model
from ecm.models.physics.map import FREE, PhysicsMap, kept_physics, poses_meant
from ecm.models.refit import is_far_behind
from ecm.regression.folds import held_out_by, without_zero_readings
from ecm.regression.noise import Noise

_FAMILIES = {
    "symmetric": "elasticity or geometry that keeps the symmetry",
    "asymmetric": "something asymmetric or not conservative",
    "other": "history, time or noise",
}
HELD_OUT = {"pose": "clusters of poses", "time": "blocks of time", "run": "each run in turn"}
FEM_REMEDY = Remedy(
    "the physics base is left out: the FEM of this body did not run yet (up to ten minutes, once)",
    "ecm fit DATA --model physics --out physics.json && AGAIN",
)
USELESS = 1e4
"""Held-out errors beyond so many times the noise are no errors of a prediction."""
_NOTHING = 0.03
"""Excess in squares below which nothing is said about a family."""


@dataclass(frozen=True)
class ReferenceModels:
    """Held-out whitened rms of each reference; None where the data do not allow it."""

    physics: float | None
    energy: float | None
    ceiling: float | None
    floor: float = 1.0
    by: str = field(default="pose", metadata={"json": "held_out_by"})
    """What the held-out parts are: clusters of the `pose`, blocks of `time`, or each `run`."""
    fem_needed: bool = False
    """Whether the physics is left out because the FEM of the table's body did not run yet."""
    missing: bool = True
    """Whether the comparison sees that something is missing; else the errors differ by chance."""
    own: float | None = field(default=None, metadata={"json": ""})
    """Error over the noise of the model that is compared, as it stands."""

    def levels(self) -> dict[str, float]:
        """Return the known errors by name."""
        named = {
            "physics base": self.physics,
            "symmetric energy": self.energy,
            "ceiling": self.ceiling,
            "noise floor": self.floor,
        }
        return {name: value for name, value in named.items() if value is not None}

    @property
    def outdone(self) -> bool:
        """Whether the model errs far less than each of them, so that they tell nothing of it."""
        known = [one for one in (self.physics, self.energy, self.ceiling) if one is not None]
        return self.own is not None and bool(known) and is_far_behind(min(known), self.own)

    def shares(self) -> dict[str, float]:
        """Return the share of the excess, in squares, of each family that can be separated.

        None where nothing is missing, or where the model errs far less than the references.
        """
        if not self.missing or self.outdone:
            return {}
        falls: dict[str, float] = {}
        above = self.physics
        for name, level in zip(_FAMILIES, (self.energy, self.ceiling, self.floor), strict=True):
            if level is not None and above is not None:
                falls[name] = max(above**2 - level**2, 0.0)
            above = min((one for one in (above, level) if one is not None), default=None)
        total = sum(falls.values())
        return {name: fall / total for name, fall in falls.items()} if total > _NOTHING else {}

    def sentence(self) -> str:
        """Return one plain sentence."""
        shares = self.shares()
        is_noise = not self.missing and (self.own is None or self.own <= NEAR_NOISE)
        if self.outdone and not is_noise:
            return "Each of these errs far more than the model: they do not tell what it lacks."
        if not shares and is_noise:
            return "What is left is noise: no family of effects stands out."
        if not shares:
            return "No family of effects stands out."
        best = max(shares, key=shares.__getitem__)
        text = f"{shares[best]:.0%} of the excess points to {_FAMILIES[best]}"
        rest = [f"{v:.0%} to {_FAMILIES[k]}" for k, v in shares.items() if k != best and v > 0.15]
        return text + (f", {' and '.join(rest)}." if rest else ".")

    def to_dict(self) -> dict[str, Any]:
        """Return plain JSON."""
        return fields_json(self) | {"shares": self.shares(), "sentence": self.sentence()}


def fit_reference_models(
    model: Model, table: Table, noise: Noise, *, missing: bool, own: float
) -> ReferenceModels | None:
    """Fit the reference models; None for a table without all six pose and wrench columns.

    The physics base is that of the model, where it is one, else that of the table's `[mechanism]`:
    it is left out where its FEM, which takes minutes, is not in the cache yet.

    Parameters
    ----------
    missing, own
        Of the comparison: whether the model lacks something, and its error over the noise.
    """
    if not table.has(*POSE, *WRENCH) or noise.components is not None:
        return None
    kept = without_zero_readings(table)
    physics: StiffnessMap | None = model.base
    body, fem_needed = kept.physics_body, False
    if not isinstance(physics, PhysicsMap) and body is not None:
        physics = kept_physics(body, poses=poses_meant(table))
        fem_needed = physics is None
    if not isinstance(physics, PhysicsMap):
        physics = None
    elif physics.family is not None:
        physics = physics.with_free(*FREE)
    fits = [None if b is None else joint_fit(b, (), kept, noise) for b in (physics, _energy(kept))]
    if not any(fits) and not fem_needed:
        return None
    ceilings = [ceiling_rms(fit, kept, noise) for fit in fits if fit is not None]
    known = [item.whitened for item in ceilings if item is not None]
    return ReferenceModels(
        physics=None if fits[0] is None else held_out(fits[0]),
        energy=None if fits[1] is None else held_out(fits[1]),
        ceiling=min(known) if known else None,
        by=held_out_by(kept, "time"),
        fem_needed=fem_needed,
        missing=missing,
        own=own,
    )


def _energy(table: Table) -> StiffnessMap | None:
    """Return the symmetric energy, where the length is known and there are enough rows."""
    if table.meta.length_m is None:
        return None
    try:
        return symmetric_energy(table)
    except ModelError:
        return None
