"""All families of models; the one place that reads short names such as `energy6`."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from ecm.errors import InputError
from ecm.models.actuated import ActuatedModel
from ecm.models.energy import EnergyModel
from ecm.models.expression import Expression
from ecm.models.layout import anything, check_document, items, named, record, text
from ecm.models.learned import GaussianProcessModel, NeuralNetworkModel
from ecm.models.maps import StiffnessMap
from ecm.models.partial import MEASURED, MeasuredMap
from ecm.models.physics.refit import PhysicsModel
from ecm.models.polynomial import PolynomialModel, Threshold
from ecm.models.rod import ConstantCurvatureModel, RodModel
from ecm.models.specification import ModelSpecification

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
    check_document(document, len(base.coefficients))
    return base


def _whole(document: dict[str, Any], place: str) -> StiffnessMap:
    """The map of a document at some place of the file, which is checked by its family's layout."""
    family = _family_of(document)
    family.layout(len(document["inputs"]), len(document["outputs"]))(document, place)
    return family.map_from_document(document)


def _family_of(document: dict[str, Any]) -> type[ModelSpecification]:
    for family in MODELS:
        if family.kind == document.get("kind"):
            return family
    known = ", ".join(family.kind for family in MODELS)
    raise InputError(f"kind = {document.get('kind')!r} (expected one of {known})")


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
