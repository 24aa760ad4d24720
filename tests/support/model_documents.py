"""Documents of small model files, one of each kind, and changes of every value in them."""

from __future__ import annotations

import copy
import json
import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

import ecm
from ecm._native import EnergyEvaluator
from ecm.effects.load import Payload
from ecm.io.description import Meta
from ecm.io.table import Table, as_table
from ecm.models import Model
from ecm.models.literature import ConstantCurvatureMap, GpMap, MlpMap, RodMap
from ecm.models.maps import EnergyMap
from ecm.models.physics.family import PARAMETERS, PhysicsFamily
from ecm.models.physics.map import PhysicsMap
from support.models import BRANCHES, FRICTION, TEMPERATURE, with_effects
from support.neck import LENGTH_M, STIFFNESS, neck_columns

Document = dict[str, Any]
NUMBERS = (0, 0.0, -1.0, 1e-320, 1e99, -1e99, 1e308, -1e308, 2**70, math.nan, math.inf, -math.inf)
"""Values for a number; the last three are no JSON, but Python and others write them."""
OTHERS: tuple[Any, ...] = (None, True, "text", "1.0", "", [], {}, [1.0], {"a": 1.0}, [[]])
"""Values of another type."""


def neck_table(rows: int = 60, **more: Any) -> Table:
    """Six poses and six wrenches, with the mechanism's length."""
    meta = Meta(mechanism={"length_m": LENGTH_M})
    return as_table(neck_columns(rows) | more, meta=meta)


def _energy() -> EnergyMap:
    coefficients = np.zeros(5)
    stiff = np.diag(STIFFNESS)
    coefficients[1:5] = 0.5 * np.array([stiff[0], stiff[1], stiff[4], stiff[3]])
    model = EnergyEvaluator.from_coefficients(
        length_m=LENGTH_M, degree=2, symmetry="alike", scale=np.ones(2), coefficients=coefficients
    )
    return EnergyMap(model)


def _family() -> PhysicsFamily:
    table = np.zeros((3, 3, 5))
    table[0, 0, 1:] = [0.9, 0.2, 0.07, 0.03]
    table[1:, 1:, 1:] = 1e-3
    return PhysicsFamily(
        degree=2, symmetry="alike", scale=np.array([0.1, 1.0]), table=table, centre=(0.03, 0.64),
        width=0.2, s_range=(0.0, 0.3), x_range=(-0.1, 0.1), error=np.full((2, 6), 1e-5),
        error_over_noise=np.full(3, 0.1), shifts=np.array([-0.1, 0.02, 0.1]),
    )  # fmt: skip


def _learned() -> tuple[GpMap, MlpMap]:
    table = neck_table(8)
    random = np.random.default_rng(3)
    columns = (tuple(neck_columns(1))[:6], tuple(neck_columns(1))[6:])
    scales = [
        np.stack([values.mean(axis=0), values.std(axis=0)])
        for values in (table.poses, table.wrenches)
    ]
    points, weights = random.normal(size=(8, 6)), random.normal(size=(8, 6))
    layers = ((random.normal(size=(6, 3)), np.zeros(3)), (random.normal(size=(3, 6)), np.ones(6)))
    return GpMap(*columns, *scales, points, np.full(6, 2.0), weights), MlpMap(
        *columns, *scales, layers
    )


def models() -> dict[str, Model]:
    """A small model of each kind; `with effects` is refitted and has effects of all kinds."""
    table = neck_table()
    turned = as_table({"theta_y_rad": np.linspace(-0.3, 0.3, 30), "tau_y_Nm": np.arange(30.0)})
    moved = as_table({"x_m": np.linspace(0.0, 1e-3, 12), "fx_N": np.linspace(0.0, 9.0, 12) ** 2})
    energy = ecm.fit(table, "energy4")
    physics = PhysicsMap(_energy(), np.full(6, 1e-3), {"length_m": LENGTH_M}, 1.1)
    values = dict(zip(PARAMETERS, (6.5e5, 0.45, LENGTH_M, 0.066), strict=True))
    family = replace(physics, family=_family(), values=values)
    gp, mlp = _learned()
    bare = replace(energy, covariance=None)
    effects = with_effects(
        energy, BRANCHES, FRICTION, TEMPERATURE, (Payload(), [0.1, 0.0, 0.01, 0.0])
    )
    refitted = ecm.refit(energy, table, add=["payload"], force=True)
    return {
        "polynomial": ecm.fit(table, "linear"),
        "one axis": ecm.fit(moved, "quadratic"),
        "one angle": ecm.fit(turned, "cubic"),
        "energy": energy,
        "physics": replace(bare, base=physics),
        "family": replace(bare, base=family),
        "rod": replace(bare, base=RodMap(LENGTH_M, np.array([1900.0, 700.0, 0.65, 0.42]))),
        "arc": replace(bare, base=ConstantCurvatureMap(LENGTH_M, np.array([2e4, 6.0, 4.0]))),
        "gp": replace(bare, base=gp),
        "mlp": replace(bare, base=mlp),
        "with effects": effects,
        "refitted": refitted,
    }


def documents() -> dict[str, Document]:
    """Documents of those models, as `json` reads them from a file."""
    found = {}
    for name, model in models().items():
        document = json.loads(json.dumps(model.document()))
        rows = document["training"]["pose_error"]["worst_rows"]
        del rows[1:]
        found[name] = document
    return found


Path = tuple[str | int, ...]


def places(value: Any, at: Path = ()) -> Iterator[Path]:
    """Where values stand in a document; of lists the first and the last place."""
    if at:
        yield at
    if isinstance(value, dict):
        for key, item in value.items():
            yield from places(item, (*at, key))
    elif isinstance(value, list):
        for index in sorted({0, len(value) - 1} if value else ()):
            yield from places(value[index], (*at, index))


def at(document: Any, place: Path) -> Any:
    """The value at a place."""
    for key in place:
        document = document[key]
    return document


def changes(value: Any) -> Iterator[Any]:
    """What may stand in the place of a value: other numbers, types and shapes."""
    yield from (other for other in OTHERS if other != value or other is not value)
    if isinstance(value, int | float) and not isinstance(value, bool):
        yield from NUMBERS
        yield from (-value, 10 * value, 0.5 * value)
    if isinstance(value, list) and value:
        yield from (value[:-1], [*value, value[-1]], [value], [*value[:-1], None])
        yield from ([*value[:-1], "1.0"], value[::-1])
        if isinstance(value[0], list):
            yield [list(column) for column in zip(*value, strict=False)]
            yield [row[:-1] for row in value]
            yield [value[0], *value[1:-1], value[-1][:-1]]
    if isinstance(value, dict):
        yield {**value, "extra": 1.0}
        for key in value:
            yield {k: v for k, v in value.items() if k != key}


def changed(document: Document, place: Path, value: Any) -> Document:
    """A copy of the document with another value at one place."""
    copied = copy.deepcopy(document)
    at(copied, place[:-1])[place[-1]] = value
    return copied
