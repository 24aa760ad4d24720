"""All families of models: short names such as `energy6`, and model files.

A file is JSON with a checksum (docs/schemas/model.json); it names the training data.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ecm._native import ModelError, open_model, seal_model
from ecm.effects import with_shape
from ecm.errors import InputError
from ecm.io.arguments import path_of
from ecm.io.arrays import F
from ecm.io.cache import hash_of, write_atomically
from ecm.io.settings import read_text
from ecm.io.table import Table
from ecm.models.actuated import ActuatedModel
from ecm.models.energy import EnergyModel
from ecm.models.expression import Expression
from ecm.models.joint_fit import FittedEffect
from ecm.models.layout import anything, check_document, items, named, record, text
from ecm.models.literature import (
    ConstantCurvatureModel,
    GaussianProcessModel,
    NeuralNetworkModel,
    RodModel,
)
from ecm.models.maps import ModelSpecification, StiffnessMap
from ecm.models.partial import MEASURED, MeasuredMap
from ecm.models.physics.refit import PhysicsModel
from ecm.models.polynomial import PolynomialModel, Threshold
from ecm.regression.rows import taken_by

MODELS: tuple[type[ModelSpecification], ...] = (
    PolynomialModel,
    EnergyModel,
    ActuatedModel,
    PhysicsModel,
    RodModel,
    ConstantCurvatureModel,
    GaussianProcessModel,
    NeuralNetworkModel,
    Expression,
)
"""Every family; a new one is one more line here."""


def parse_model(model: str | ModelSpecification, *, pcr: Threshold = None) -> ModelSpecification:
    """Return the specification that a short name stands for.

    Parameters
    ----------
    model
        Short name: `poly:D`, `linear`, `quadratic`, `cubic`, `energyD`, `energyD-revolution`,
        `energyD-general`, each energy also with `+GROUP`, `actuatedD`, `physics`, `rod`,
        `constant-curvature`, `gp`, `mlp`. A specification is returned as it is.
    pcr
        Threshold of principal component regression, for polynomials only.

    Raises
    ------
    InputError
        For an unknown name, a degree out of range, or a threshold without a polynomial.

    Examples
    --------
    >>> parse_model("energy6-revolution")
    EnergyModel(degree=6, symmetry='revolution', groups=())
    >>> parse_model("cubic", pcr=0.1)
    PolynomialModel(degree=3, pcr=0.1)
    """
    specification = _of_name(model) if isinstance(model, str) else model
    if not isinstance(specification, ModelSpecification):
        raise InputError(
            f"model: found a {type(model).__name__}, expected a short name such as 'energy6', a "
            "specification such as ecm.EnergyModel(degree=6), an ecm.Expression, or a function"
        )
    if pcr is None:
        return specification
    if not isinstance(specification, PolynomialModel):
        raise InputError(
            f"model {specification.name}: a PCR threshold belongs to polynomials; leave it out"
        )
    return replace(specification, pcr=pcr)


def _of_name(name: str) -> ModelSpecification:
    try:
        for family in MODELS:
            specification = family.from_name(name)
            if specification is not None:
                return specification
    except InputError as error:
        raise InputError(f"model {name!r}: {error}") from None
    known = "; ".join(family.usage or family.kind for family in MODELS)
    raise InputError(f"model {name!r}: expected {known}")


def map_from_document(document: dict[str, Any]) -> StiffnessMap:
    """Return the map of an opened model file, whose layout is checked; InputError where wrong."""
    measured = document["kind"] == MEASURED
    base: StiffnessMap = _measured(document) if measured else _whole(document, "")
    check_document(document, len(base.coefficients), len(taken_by(base)))
    return base


def _whole(document: dict[str, Any], place: str) -> StiffnessMap:
    """The map of a document at some place of the file, which is checked by its family's layout."""
    family = next((family for family in MODELS if family.kind == document.get("kind")), None)
    if family is None:
        known = ", ".join(family.kind for family in MODELS)
        raise InputError(f"kind = {document.get('kind')!r} (expected one of {known})")
    family.layout(len(document["inputs"]), len(document["outputs"]))(document, place)
    return family.map_from_document(document)


def _measured(document: dict[str, Any]) -> MeasuredMap:
    """Some wrench columns of a whole map, which is a document of its own."""
    record({"parameters": named(anything)}, others=True)(document, "")
    own, names = dict(document["parameters"]), tuple(document["outputs"])
    columns = record({"inputs": items(text), "outputs": items(text)}, others=True)
    columns(own, "parameters")
    whole = _whole(own, "parameters")
    if not set(names) < set(whole.outputs) or whole.inputs != tuple(document["inputs"]):
        raise InputError(f"outputs = {list(names)} of a map of {', '.join(whole.outputs)}")
    return MeasuredMap(whole, names)


def training_of(table: Table) -> dict[str, Any]:
    """Hash of the numbers, number of rows, and the file's name without its folder."""
    return {
        "hash": hash_of(dict(table.columns), ""),
        "rows": len(table),
        "source": Path(table.source).name if table.source else "",
        "seed": None,
    }


def was_trained_on(training: Mapping[str, Any], table: Table) -> bool:
    """Whether these very rows are the training data that a model file names."""
    known = training.get("hash")
    # A hash reads every number: only where there are as many rows as the fit had.
    if known is None or training.get("rows") not in (None, len(table)):
        return False
    return bool(known == training_of(table)["hash"])


CONDITIONS = ("temperature_degC", "time_s")
"""Columns beside the pose that effects of the mechanism follow."""


def fitted_to(table: Table, inputs: Sequence[str]) -> dict[str, Any]:
    """Fields of a model that say what it was fitted to: where it holds, and under which scene.

    `domain` and `conditions` are ranges over the measured rows: of the pose columns, and of
    temperature, time and columns of one's own where the table has them.
    """
    measured = table.measured()
    names = dict.fromkeys((*CONDITIONS, *measured.covariates))
    there = {name: measured.column(name) for name in names if measured.has(name)}
    known = {name: values[np.isfinite(values)] for name, values in there.items()}
    means = {name: float(values.mean()) for name, values in known.items() if len(values)}
    return {
        "training": {**training_of(table), "means": means},
        "domain": {name: _range(measured.column(name)) for name in inputs},
        "conditions": {name: _range(values) for name, values in known.items() if len(values)},
        "scene": table.meta.scene,
    }


def _range(values: F) -> tuple[float, float]:
    return float(values.min()), float(values.max())


FORMAT = "ecm-model"
VERSION = 1
_LARGE = 150
"""Coefficients from which on a covariance is written as deviations and correlations."""
_SHARE = 0.01
"""Largest relative change of a variance that rounding the correlations may cause."""


def covariance_document(covariance: F | None, base: StiffnessMap) -> dict[str, Any]:
    """The full matrix; for a plain polynomial fit its Kronecker factors, outputs (x) terms.

    A large one that has no factors (504 coefficients refitted with effects or by pose noise) is
    written as standard deviations and the lower triangle of the correlations, with no more digits
    than the smallest variance of any prediction needs.
    """
    if covariance is None:
        return {"covariance": None}
    if base.kind == "polynomial":
        m = len(base.outputs)
        k = len(covariance) // m
        blocks = covariance.reshape(m, k, m, k)
        scale = np.einsum("aibi->ab", blocks)
        trace = float(np.trace(scale))
        if trace > 0.0:
            terms = np.einsum("aiaj->ij", blocks) / trace
            if np.allclose(np.kron(scale, terms), covariance, rtol=1e-9, atol=0.0):
                terms = 0.5 * (terms + terms.T)
                return {"covariance": terms.tolist(), "covariance_of_outputs": scale.tolist()}
    covariance = 0.5 * (covariance + covariance.T)
    sd = np.sqrt(np.diag(covariance))
    if len(sd) >= _LARGE and sd.min() > 0.0:
        correlation = covariance / np.outer(sd, sd)
        smallest = float(np.linalg.eigvalsh(correlation)[0])
        # Rounding by u in each entry changes no variance by more than about 2 u sqrt(k).
        unit = _SHARE * smallest / (2.0 * np.sqrt(len(sd)))
        if unit > 1e-12:
            digits = int(np.ceil(-np.log10(2.0 * unit)))
            rounded = np.round(correlation, digits)
            rows = [rounded[i, :i].tolist() for i in range(1, len(sd))]
            return {
                "covariance": None,
                "covariance_sd": sd.tolist(),
                "covariance_correlation": rows,
            }
    return {"covariance": covariance.tolist()}


def covariance_of(document: dict[str, Any]) -> F | None:
    """(k, k) covariance of a model file; None where it has none."""
    if document["covariance"] is None:
        if document.get("covariance_sd") is None:
            return None
        sd = np.asarray(document["covariance_sd"], dtype=np.float64)
        correlation = np.eye(len(sd))
        for i, row in enumerate(document["covariance_correlation"], 1):
            correlation[i, :i] = correlation[:i, i] = row
        return np.asarray(correlation * np.outer(sd, sd))
    covariance = np.asarray(document["covariance"], dtype=np.float64)
    outputs = document.get("covariance_of_outputs")
    if outputs is None:
        return covariance
    return np.asarray(np.kron(np.asarray(outputs, dtype=np.float64), covariance))


def write_document(document: dict[str, Any], path: str | Path) -> None:
    """Write a model file with its checksum, complete or not at all."""
    write_atomically(path_of(path), seal_model(json.dumps(document)))


def read_document(path: str | Path) -> dict[str, Any]:
    """The document of a model file; InputError where checksum, version or a range is wrong."""
    text = read_text(path_of(path), "model file of `ecm fit`")
    try:
        return open_model(text)
    except ModelError as error:
        raise InputError(f"{path}: {error}") from None


def effect_of(document: dict[str, Any]) -> FittedEffect:
    """An effect of a model file."""
    effect = with_shape(document["id"], dict(document["shape"]))
    stored, names = dict(document["parameters"]), [p.name for p in effect.parameters]
    if not set(names) & set(stored):
        # Parameters that had other names in an older version stand in the same order.
        stored = dict(zip(names, stored.values(), strict=True))
    values = [float(stored[p.name]["value"]) for p in effect.parameters]
    sds = [stored[p.name]["sd"] for p in effect.parameters]
    return FittedEffect(
        effect,
        np.array(values),
        np.array([np.inf if sd is None else float(sd) for sd in sds]),
        bool(document["frozen"]),
    )
