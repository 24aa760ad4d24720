"""The base that a table is held against: one that cannot take in what a model may lack."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ecm.io.columns import POSE, WRENCH
from ecm.models.by_degree import polynomial, symmetric_energy
from ecm.models.fit import fit_model
from ecm.models.maps import PolynomialMap
from ecm.models.partial import is_partial, measured_part, whole_map
from ecm.models.physics.map import FREE, PhysicsMap

if TYPE_CHECKING:
    from ecm.io.table import Table
    from ecm.models.maps import StiffnessMap
    from ecm.models.model import Model


def choose_base(model: Model, table: Table) -> StiffnessMap:
    """Choose physics where there is a body, else a symmetric energy, else a polynomial.

    The first two need six pose columns, and take the wrench columns that there are.

    A polynomial of few columns that was given with a higher degree may be the base with it: what
    it does not lack is not named.

    E and nu of the physics are free; L and D enter only as effects. Degrees are chosen by
    generalised cross-validation. A rod that was fitted is no physics base: its sections absorbed a
    part of the missing effect, and with fixed ratios they would need an effect of their own.
    """
    base = whole_map(model.base)
    if isinstance(base, PhysicsMap):
        free = base if base.family is None else base.with_free(*FREE)
        return measured_part(free, table)
    body = table.meta.elastic_body()
    six = table.has(*POSE, *WRENCH) or is_partial(table)
    if six and body is not None:
        return measured_part(fit_model(table, "physics", force=True).base, table)
    if six and table.meta.length_m is not None:
        return symmetric_energy(table)
    alike = (model.inputs, model.outputs) == (table.pose_columns, table.wrench_columns)
    if isinstance(model.base, PolynomialMap) and alike and len(model.inputs) < len(POSE):
        return polynomial(table, also=model.base.model.degree)
    return polynomial(table)
