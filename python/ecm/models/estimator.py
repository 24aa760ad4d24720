"""Models as scikit-learn estimators, by duck typing: scikit-learn itself is not needed."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, field, fields, replace
from typing import Any

import numpy as np

from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.io.description import Meta
from ecm.io.extras import require
from ecm.io.table import Table
from ecm.models.fit import fit_model
from ecm.models.model import Model
from ecm.models.registry import parse_model
from ecm.models.specification import ModelSpecification, Weights


@dataclass(eq=False)
class ModelEstimator:
    """A model with `fit`, `predict` and `score`, for `clone`, `cross_val_score` and the like.

    Parameters
    ----------
    model
        A specification or its short name.
    length_m
        Length of the mechanism, m; energies, rods and constraints need it.
    weights, zero_at_home, stable, force
        As in `fit_model`.

    Attributes
    ----------
    model_
        The fitted `Model`.

    Examples
    --------
    >>> poses = np.random.default_rng(0).uniform(-0.01, 0.01, (20, 6))
    >>> wrenches = 1000.0 * poses
    >>> estimator = ModelEstimator("linear").fit(poses, wrenches)
    >>> round(estimator.score(poses, wrenches), 6)
    1.0
    >>> estimator.set_params(model="cubic").get_params()["model"]
    'cubic'
    """

    _estimator_type = "regressor"

    model: ModelSpecification | str = "cubic"
    _: KW_ONLY
    length_m: float | None = None
    weights: Weights = "auto"
    zero_at_home: bool = False
    stable: bool = False
    force: bool = False
    model_: Model = field(init=False, repr=False)

    def fit(self, X: Any, y: Any) -> ModelEstimator:
        """Fit the model to poses X (N, 6) in m and rad and wrenches y (N, 6) in N and N m.

        Raises
        ------
        InputError
            For arrays of another shape, and as `fit_model`.
        """
        columns = dict(zip(POSE, _array(X, "X").T, strict=True))
        columns |= dict(zip(WRENCH, _array(y, "y").T, strict=True))
        mechanism = {} if self.length_m is None else {"length_m": self.length_m}
        options = self.get_params(False)
        options.pop("length_m")
        self.model_ = fit_model(Table(columns, Meta(mechanism=mechanism), "X, y"), **options)
        return self

    def predict(self, X: Any) -> F:
        """(N, 6) wrenches in N and N m at poses X (N, 6)."""
        if not hasattr(self, "model_"):
            raise InputError("this estimator was not fitted yet: call fit(X, y) first")
        return self.model_.predict(_array(X, "X"))

    def score(self, X: Any, y: Any) -> float:
        """Coefficient of determination R², mean over the six wrench components."""
        truth = _array(y, "y")
        residual = ((truth - self.predict(X)) ** 2).sum(axis=0)
        total = ((truth - truth.mean(axis=0)) ** 2).sum(axis=0)
        # A component that never varies counts 1 where it is met exactly, else 0.
        constant = total == 0.0
        share = np.where(constant, residual > 0.0, residual / np.where(constant, 1.0, total))
        return float(1.0 - share.mean())

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """Options by name; with `deep` also fields of the specification as `model__degree`."""
        options = {item.name: getattr(self, item.name) for item in fields(self) if item.init}
        if deep:
            own = parse_model(self.model)
            options |= {f"model__{item.name}": getattr(own, item.name) for item in fields(own)}
        return options

    def set_params(self, **options: Any) -> ModelEstimator:
        """Change options, or fields of the specification as `model__degree`."""
        for name, value in options.items():
            known = self.get_params()
            if name not in known:
                raise InputError(f"option {name!r}: expected one of {', '.join(known)}")
            if not name.startswith("model__"):
                setattr(self, name, value)
            else:
                change: dict[str, Any] = {name.removeprefix("model__"): value}
                self.model = replace(parse_model(self.model), **change)
        return self

    def __sklearn_tags__(self) -> Any:
        """What scikit-learn asks for since its release 1.6."""
        sklearn = require("sklearn.utils", "learn", "ModelEstimator in scikit-learn")
        tags = sklearn.Tags(
            estimator_type="regressor",
            target_tags=sklearn.TargetTags(required=True, multi_output=True, single_output=False),
            regressor_tags=sklearn.RegressorTags(),
        )
        return tags


def _array(values: Any, name: str) -> F:
    array = np.ascontiguousarray(values, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != len(POSE):
        raise InputError(f"{name} has shape {array.shape}: expected (N, {len(POSE)})")
    return array
