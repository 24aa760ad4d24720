"""Which form of an effect a table of these columns calls for."""

from __future__ import annotations

from collections.abc import Iterable

from ecm.effects.few import elastic, friction, history
from ecm.effects.protocol import Effect
from ecm.io.columns import POSE, WRENCH

FORMS: dict[str, Effect] = {
    effect.id: effect
    for forms in (friction.FORMS, history.FORMS, history.FEW_ONLY, elastic.FORMS)
    for effect in forms
}
"""Plain forms by id; the last two groups exist for few columns only."""


def is_full(names: Iterable[str]) -> bool:
    """Whether all six pose and six wrench columns are among the names."""
    return {*POSE, *WRENCH} <= set(names)
