"""Model files: sealed JSON (interfaces.md)."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecm import _native
from ecm.compare.noise import Noise
from ecm.effects import with_shape
from ecm.errors import InputError
from ecm.meta import Scene
from ecm.models.backbone import backbone_from_document
from ecm.models.ladder import Rung
from ecm.models.learned import learned_from_document
from ecm.models.maps import EnergyMap, PolynomialMap, StiffnessMap
from ecm.models.model import Model
from ecm.models.physics import PhysicsMap
from ecm.refit import FittedEffect
from ecm.stages import write_atomically

F = NDArray[np.float64]

_FORMAT = "ecm-model"
_VERSION = 1


def model_document(model: Model) -> dict[str, Any]:
    """The document of a model file, without its sum."""
    return {
        "format": _FORMAT,
        "version": _VERSION,
        **model.base.document(),
        "length_m": model.known_length_m,
        "scene": asdict(model.scene),
        **_covariance_document(model),
        "noise": model.noise.to_dict(),
        "effects": [_effect_document(item) for item in model.effects],
        "base_frozen": model.base_frozen,
        "correlations": [list(pair) for pair in model.correlations],
        "domain": {name: list(pair) for name, pair in model.domain.items()},
        "training": dict(model.training),
        "history": [step.to_dict() for step in model.history],
    }


_LARGE = 150
"""Coefficients from which on a covariance is written as deviations and correlations."""
_SHARE = 0.01
"""Largest relative change of a variance that rounding the correlations may cause."""


def _covariance_document(model: Model) -> dict[str, Any]:
    """The full matrix; of a plain polynomial fit its factors, outputs (x) terms.

    A large one that has no factors (504 coefficients refitted with effects or by pose noise) is
    written as standard deviations and the lower triangle of the correlations, with no more digits
    than the smallest variance of any prediction needs.
    """
    covariance = model.covariance
    if covariance is None:
        return {"covariance": None}
    if model.base.kind == "polynomial":
        m = len(model.outputs)
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
        # Rounding by u in each entry turns no variance by more than about 2 u sqrt(k).
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


def _covariance_of(document: dict[str, Any]) -> F | None:
    if document["covariance"] is None:
        if document.get("covariance_sd") is None:
            return None
        return _from_correlations(document)
    covariance = np.asarray(document["covariance"], dtype=np.float64)
    outputs = document.get("covariance_of_outputs")
    if outputs is None:
        return covariance
    return np.asarray(np.kron(np.asarray(outputs, dtype=np.float64), covariance))


def _from_correlations(document: dict[str, Any]) -> F:
    """(k, k) of deviations and the lower triangle of correlations; refused where they misfit."""
    sd = np.asarray(document["covariance_sd"], dtype=np.float64)
    rows = document["covariance_correlation"]
    k = len(sd)
    if sd.ndim != 1 or not np.all((sd > 0.0) & np.isfinite(sd)):
        raise ValueError("covariance_sd: expected positive numbers")
    if len(rows) != k - 1 or any(len(row) != i for i, row in enumerate(rows, 1)):
        raise ValueError(f"covariance_correlation: expected {k - 1} rows of 1 to {k - 1} numbers")
    correlation = np.eye(k)
    for i, row in enumerate(rows, 1):
        correlation[i, :i] = correlation[:i, i] = row
    if not np.abs(correlation).max() <= 1.0:
        raise ValueError("covariance_correlation: expected numbers from -1 to 1")
    return np.asarray(correlation * np.outer(sd, sd))


def _effect_document(item: FittedEffect) -> dict[str, Any]:
    return {
        "id": item.id,
        "side": item.effect.side,
        "shape": item.effect.shape,
        "frozen": item.frozen,
        "parameters": {
            parameter.name: {
                "value": float(value),
                "sd": float(sd) if np.isfinite(sd) else None,
                "unit": parameter.unit,
            }
            for parameter, value, sd in zip(
                item.effect.parameters, item.values, item.sd, strict=True
            )
        },
    }


def save_model(model: Model, path: str | Path) -> None:
    """Write a sealed model file, complete or not at all."""
    text = _native.seal_model(json.dumps(model_document(model)))
    write_atomically(Path(path), text)


def load_model(path: str | Path) -> Model:
    """Read a model file; refused when its sum, version or a range is wrong."""
    file = Path(path)
    try:
        text = file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(
            f"{file}: cannot be read as a model file ({error}); give one that `ecm fit` wrote"
        ) from None
    try:
        document = _native.open_model(text)
    except _native.ModelError as error:
        raise InputError(f"{file}: {error}") from None
    try:
        return _model_of(document)
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise InputError(
            f"{file}: the model file lacks or misstates {error}; fit the model again"
        ) from None


def _model_of(document: dict[str, Any]) -> Model:
    return Model(
        base=_base_of(document),
        noise=Noise.from_dict(dict(document["noise"])),
        effects=tuple(_effect_of(item) for item in document["effects"]),
        covariance=_covariance_of(document),
        training=dict(document["training"]),
        length_m=document["length_m"],
        scene=_scene_of(document.get("scene", {})),
        domain={name: (float(a), float(b)) for name, (a, b) in document["domain"].items()},
        base_frozen=bool(document.get("base_frozen", False)),
        correlations=tuple((a, b, float(r)) for a, b, r in document.get("correlations", ())),
        history=tuple(Rung(**step) for step in document.get("history", ())),
    )


def _scene_of(document: dict[str, Any]) -> Scene:
    known = {**asdict(Scene()), **document}
    gravity = [float(g) for g in known["gravity_m_s2"]]
    return Scene(**known | {"gravity_m_s2": (gravity[0], gravity[1], gravity[2])})


def _base_of(document: dict[str, Any]) -> StiffnessMap:
    kind = document["kind"]
    if kind == "polynomial":
        return PolynomialMap.from_document(document)
    if kind == "energy":
        return EnergyMap.from_document(document)
    if kind == "physics":
        return PhysicsMap.from_document(document)
    if kind in ("gp", "mlp"):
        return learned_from_document(document)
    if kind in ("rod", "constant-curvature"):
        return backbone_from_document(document)
    raise InputError(f"model kind {kind!r}: expected polynomial, energy or physics")


def _effect_of(document: dict[str, Any]) -> FittedEffect:
    effect = with_shape(document["id"], dict(document["shape"]))
    found = document["parameters"]
    values = [float(found[p.name]["value"]) for p in effect.parameters]
    sds = [found[p.name]["sd"] for p in effect.parameters]
    return FittedEffect(
        effect,
        np.array(values),
        np.array([np.inf if sd is None else float(sd) for sd in sds]),
        bool(document["frozen"]),
    )
