"""What adding the named effects to the model that was given will bring: the promise of `ecm refit`.

The same refit and the same refusal as those of the command, so that what is promised is reached.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ecm.effects import Effect
from ecm.errors import EcmError, Remedy, remedy_of
from ecm.models.refit import refit, refuse_addition

if TYPE_CHECKING:
    from ecm.io.table import Table
    from ecm.models.model import Model


@dataclass(frozen=True)
class Addition:
    """What the named effects bring to the model that was given.

    Examples
    --------
    >>> found = Addition(("payload",), 1.48, 1.18, "", Remedy("add it", "ecm refit MODEL DATA"))
    >>> found.to_dict()["held_out"]
    {'before': 1.48, 'after': 1.18}
    """

    effects: tuple[str, ...]
    before: float | None
    """Held-out error over the noise of the model fitted to these rows; None where not known."""
    after: float | None
    """The same with the effects."""
    refused: str
    """Why `ecm refit` would refuse; empty where it adds them."""
    remedy: Remedy | None
    """The command that adds them: to this model, else to one that holds them."""

    def to_dict(self) -> dict[str, Any]:
        """For the report: plain values."""
        return {
            "effects": list(self.effects),
            "held_out": {"before": self.before, "after": self.after},
            "refused": self.refused,
            "remedy": None if self.remedy is None else self.remedy.to_dict(),
        }


def addition_to(model: Model, table: Table, effects: Sequence[Effect]) -> Addition | None:
    """Add effects to a model as `ecm refit` does; None where it has them all already."""
    present = {item.id for item in model.effects}
    new = [effect for effect in effects if effect.id not in present]
    if not new:
        return None
    ids = tuple(effect.id for effect in new)
    try:
        found = refit(model, table, add=new)
        refuse_addition(found, table, model)
    except (EcmError, np.linalg.LinAlgError) as error:
        said = getattr(error, "message", str(error))
        return Addition(ids, None, None, said, remedy_of(error))
    before, after = (record.held_out for record in found.history[-2:])
    known = not found.noise.is_residual
    options = " ".join(f"--add {id}" for id in ids)
    command = Remedy(f"add {' and '.join(ids)}", f"ecm refit MODEL DATA {options} --out OUT")
    return Addition(ids, before if known else None, after if known else None, "", command)
