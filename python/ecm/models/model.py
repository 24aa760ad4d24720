"""A model: base map, effects, noise, where it comes from and where it is valid."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from ecm._native import convert_stiffness
from ecm.effects import Effect, Missing, Rows, effects_for, get_effect
from ecm.effects.protocol import correction_of, missing_length
from ecm.errors import EcmError, InputError
from ecm.io.arguments import check_arguments
from ecm.io.arrays import B, F
from ecm.io.columns import POSE
from ecm.io.description import Meta, Scene
from ecm.io.events import Progress, Steps
from ecm.io.extras import require
from ecm.io.table import Table, TableLike, takes_table
from ecm.models import file
from ecm.models.controller import Controller
from ecm.models.file import (
    conditions_of,
    domain_of,
    noise_for,
    training_of,
    was_trained_on,
)
from ecm.models.history import FitRecord, RecordedFit, correlations_of, fit_records, fit_report
from ecm.models.joint_fit import (
    CoefficientPrior,
    FittedEffect,
    best_shape,
    effect_shares,
    effect_sizes,
    joint_fit,
)
from ecm.models.maps import (
    StiffnessMap,
    central_differences,
    finite,
    leverages,
    variances_of,
    wrench_variances,
)
from ecm.models.measured_poses import are_inside, folded, sample_of
from ecm.models.partial import MeasuredMap
from ecm.models.plots import history_figure
from ecm.models.pose_error import pose_error, report_rows
from ecm.models.registry import map_from_document
from ecm.models.time_effects import time_effects
from ecm.regression.blocks import MANY_ROWS
from ecm.regression.folds import HOW, RowsUsed, spread_rows, without_zero_readings
from ecm.regression.noise import Noise
from ecm.regression.rows import is_whole

_NOISE, _FORM, _ALL, _RECORD = "noise", "form of {}", "all values together", "errors"
"""Steps of a fit with effects."""
_SAID_OF_A_FIT = ("misread", "prior", "pose_error", "rows_used")
"""Parts of `training` that have a sentence in the fit report."""


@dataclass(frozen=True, repr=False)
class Model:
    """A base map with effects: h(p) of the base plus the corrections of the effects.

    `fit_model` and `load_model` make one; it prints itself as its fit report.

    Examples
    --------
    >>> from ecm.io.table import as_table
    >>> from ecm.models import fit_model
    >>> x = np.linspace(-0.01, 0.01, 9)
    >>> model = fit_model(as_table({"x_m": x, "fx_N": 2000.0 * x}), "linear")
    >>> model.fit_report().splitlines()[0]
    'model poly:1: 2 coefficients in the base'
    >>> model.predict(np.array([[0.005]])).round(6)
    array([[10.]])
    >>> model.extrapolates(np.array([[0.005], [0.02]]))
    array([False,  True])
    """

    base: StiffnessMap
    noise: Noise = field(default_factory=Noise)
    effects: tuple[FittedEffect, ...] = ()
    covariance: F | None = None
    """(k, k) covariance of the base's coefficients; None where it is not known."""
    training: Mapping[str, Any] = field(default_factory=dict)
    """Training data: hash, rows, source."""
    domain: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Range of each pose column in the training data."""
    conditions: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Range of temperature_degC and time_s in the training data, where it has them."""
    length_m: float | None = None
    """Length of the mechanism, for effects that need it where the base does not state it."""
    scene: Scene = field(default_factory=Scene)
    """Scene of the fit: bare poses are under its gravity; a table states its own."""
    base_frozen: bool = False
    """Whether `fit` keeps the base's coefficients."""
    history: tuple[FitRecord, ...] = ()
    """One record for each fit (history.py)."""
    correlations: tuple[tuple[str, str, float], ...] = ()
    """Pairs of fitted parameters with large correlation, the largest first."""
    previous: Model | None = None
    """The model before the last fit; of a model changed since then, as that fit left it."""
    changed: bool = False
    """Whether an effect was added, removed or frozen since the last fit."""

    def __repr__(self) -> str:
        """The fit report."""
        return self.fit_report()

    @property
    def name(self) -> str:
        """Name of the base and ids of the effects, joined by `+`."""
        return "+".join([self.base.name, *(item.id for item in self.effects)])

    @property
    def inputs(self) -> tuple[str, ...]:
        """Pose columns."""
        return self.base.inputs

    @property
    def outputs(self) -> tuple[str, ...]:
        """Wrench columns."""
        return self.base.outputs

    @property
    def known_length_m(self) -> float | None:
        """Length of the mechanism, m: the base's own, else that of the data it was fitted to."""
        return self.base.length_m or self.length_m

    def rest_pose(self, purpose: str) -> F:
        """(1, 6) undeformed pose (L, 0, 0, 0, 0, 0).

        Raises
        ------
        InputError
            Where the model has fewer columns or no length; the message begins with `purpose`.
        """
        length = self.known_length_m
        if not is_whole(self.base) or length is None:
            raise InputError(
                f"{purpose} needs all six pose and wrench columns and the mechanism's length: "
                "give [mechanism] length_m in the data's TOML"
            )
        return np.array([[length, 0.0, 0.0, 0.0, 0.0, 0.0]])

    @takes_table(name="data", or_array=True)
    def predict(self, data: TableLike | F, *, skip_untestable: bool = False) -> F:
        """(N, m) wrench, N and N m, at poses (N, n), or expected readings of a table.

        One pose (n,) gives one wrench (m,). A table's rows have time, temperature and approach, so
        that all effects act; bare poses get the base map and the effects of physics that need the
        pose alone.

        Parameters
        ----------
        data
            A table, a data frame or a dict of columns, or poses (N, n) or (n,) in m and rad.
        skip_untestable
            Leave out effects whose columns the table lacks (`left_out` names them) instead of
            refusing.
        """
        if isinstance(self.base, MeasuredMap) and self.effects:
            whole = replace(self, base=self.base.whole)
            found = whole.predict(data, skip_untestable=skip_untestable)
            return np.ascontiguousarray(found[..., self.base.places])
        if isinstance(data, np.ndarray):
            found = self._at_poses(_rows_of_poses(data, self.inputs))
            return found if data.ndim != 1 else np.asarray(found[0])
        rows = Rows(data, self.base)
        lacking = self.left_out(data)
        for id, why in lacking.items():
            if not skip_untestable:
                raise InputError(
                    f"{data.source}: effect {id} cannot be predicted here, "
                    f"{why.reason}; record {why.record}, or remove the effect"
                )
        acting = [item for item in self.effects if item.id not in lacking]
        return self._with_corrections(rows.sensor_load, rows, acting)

    def left_out(self, table: Table) -> dict[str, Missing]:
        """Effects of the model whose columns a table lacks, by id.

        Columns that only have to vary for a fit need not vary here.
        """
        # A table of poses has no wrench, which a prediction does not need.
        absent = {n: np.zeros(len(table)) for n in self.outputs if not table.has(n)}
        filled = table.with_columns(absent)
        lacking = {item.id: item.effect.missing(filled) for item in self.effects}
        return {id: why for id, why in lacking.items() if why is not None and why.absent}

    def predict_sd(self, data: Table | F) -> F | None:
        """(N, m) standard deviation of the base's wrench from its coefficients, where known."""
        if self.covariance is None:
            return None
        if isinstance(data, Table):
            data = Rows(data, self.base).poses
        poses = _rows_of_poses(data, self.inputs)
        covariance, base = self.covariance, self.base

        def of_coefficients() -> F:
            variance = wrench_variances(base, covariance, poses)
            return np.asarray(np.sqrt(np.maximum(variance, 0.0) + base.error**2))

        return finite("the deviation", of_coefficients)

    def reading_sd(self, poses: F) -> F | None:
        """(N, m) standard deviation of a new reading around the prediction, where known.

        From the coefficients and the noise of one row, the latter widened where the training
        residuals are larger.
        """
        poses = _rows_of_poses(poses, self.inputs)
        sd = self.predict_sd(poses)
        if sd is None:
            return None
        factor = max(1.0, float(self.training.get("residual_variance", 1.0)))
        variance = np.einsum("njj->nj", self.noise.covariance(self.rows_at(poses)))
        return finite("the deviation", lambda: np.sqrt(sd**2 + factor * variance))

    def leverage(self, poses: F) -> F | None:
        """(N,) uncertainty of the prediction over the noise of one row, where known."""
        poses = _rows_of_poses(poses, self.inputs)
        if self.covariance is None or self.noise.components is not None or self.inputs != POSE:
            return None
        return leverages(self.base, self.covariance, self.noise, poses)

    def extrapolates(self, poses: F) -> B:
        """(N,) whether the model is asked beyond its measured poses.

        There `inside` of the exported model is 0. A file that holds no measured poses has the range
        of each pose column.
        """
        return ~are_inside(self, _rows_of_poses(poses, self.inputs))

    def stiffness_sd(self, poses: F) -> F | None:
        """(N, m, n) standard deviation of K = dh/dp from the coefficients, where known."""
        if self.covariance is None:
            return None
        poses = _rows_of_poses(poses, self.inputs)
        covariance = self.covariance

        def of_coefficients() -> F:
            variances = [
                variances_of(slope, covariance)
                for slope in central_differences(self.base.columns, poses, 1e-5)
            ]
            return np.asarray(np.sqrt(np.maximum(np.stack(variances, axis=2), 0.0)))

        return finite("the deviation", of_coefficients)

    def stiffness(self, poses: F, kind: str = "partial") -> F:
        """(N, m, n) stiffness of the base and of the effects of physics on the pose.

        One pose (n,) gives one stiffness (m, n).
        """
        rows = _rows_of_poses(poses, self.inputs)
        acting = self.acting_at_poses
        found = self._changed_stiffness(rows, kind) if acting else self.base.stiffness(rows, kind)
        return found if np.ndim(poses) != 1 else np.asarray(found[0])

    def wrench_and_stiffness(self, poses: F, kind: str = "partial") -> tuple[F, F]:
        """`predict` and `stiffness` of poses (N, n) or of one pose (n,), in one call.

        Examples
        --------
        >>> import ecm
        >>> y = np.linspace(-0.01, 0.01, 9)
        >>> model = ecm.fit_model({"y_m": y, "fy_N": 3000.0 * y}, "linear")
        >>> wrench, stiffness = model.wrench_and_stiffness(np.array([0.005]))
        >>> wrench.round(6), stiffness.round(6)
        (array([15.]), array([[3000.]]))
        """
        rows = _rows_of_poses(poses, self.inputs)
        if self.acting_at_poses:
            wrench, stiffness = self._at_poses(rows), self._changed_stiffness(rows, kind)
        else:
            wrench, stiffness = self.base.wrench_and_stiffness(rows, kind)
        return (wrench, stiffness) if np.ndim(poses) != 1 else (wrench[0], stiffness[0])

    def _changed_stiffness(self, poses: F, kind: str) -> F:
        """(N, m, n) of the base and the effects, by central differences."""
        partial = np.stack(central_differences(self._at_poses, poses, 1e-6), axis=2)
        if kind == "partial":
            return partial
        target: Any = kind
        return convert_stiffness(
            partial, poses, self._at_poses(poses), source="partial", target=target
        )

    def controller(self) -> Controller:
        """Return the model in steps of any length: wrench and tangent with effects of time.

        Effects of the pose are folded into one energy, as `ecm export` does.

        Raises
        ------
        InputError
            A model of fewer than the six pose and wrench columns.

        Examples
        --------
        >>> from ecm.io.columns import POSE, WRENCH
        >>> from ecm.io.table import as_table
        >>> from ecm.models import fit_model
        >>> random = np.random.default_rng(0)
        >>> poses = np.array([0.1, 0, 0, 0, 0, 0]) + 0.01 * random.standard_normal((60, 6))
        >>> wrenches = (poses - [0.1, 0, 0, 0, 0, 0]) * [2e4, 3e3, 3e3, 4.0, 16.0, 16.0]
        >>> columns = dict(zip((*POSE, *WRENCH), np.hstack([poses, wrenches]).T))
        >>> controller = fit_model(as_table(columns), "linear").controller()
        >>> controller.init(poses[0])
        True
        >>> wrench, tangent = controller.step(poses[1], 0.001)
        >>> bool(np.allclose(wrench, wrenches[1])), tangent.shape
        (True, (6, 6))
        """
        if not is_whole(self.base):
            raise InputError(
                f"{self.name}: a controller needs a model of all six pose and wrench columns"
            )
        bare = replace(self, effects=(), history=(), correlations=())
        if self.acting_at_poses:
            bare = replace(bare, base=folded(self)[0], covariance=None)
        return Controller(json.dumps(bare.document()), time_effects(self))

    @takes_table()
    def measured_at(self, table: TableLike) -> Model:
        """The model with the poses of these rows for its measured ones.

        An export is judged at them, and there `inside` is 1: for model files that hold none.

        Examples
        --------
        >>> import ecm
        >>> y = np.linspace(-0.01, 0.01, 9)
        >>> model = ecm.fit({"y_m": y, "fy_N": 3000.0 * y}, "linear")
        >>> model.measured_at({"y_m": [0.0, 0.004]}).training["poses"]
        [[0.0], [0.004]]
        """
        poses = sample_of(table, self.inputs)
        return replace(self, training={**self.training, "poses": poses})

    @property
    def acting_at_poses(self) -> list[FittedEffect]:
        """Effects of physics that need the pose alone."""
        return [i for i in self.effects if i.effect.kind == "pose" and i.effect.side == "physics"]

    def _at_poses(self, poses: F) -> F:
        wrench = self.base.predict(poses)
        acting = self.acting_at_poses
        if not acting:
            return wrench
        return self._with_corrections(wrench, self.rows_at(poses), acting)

    def _with_corrections(self, wrench: F, rows: Rows, acting: Sequence[FittedEffect]) -> F:
        """(N, m) wrenches with the corrections of some effects."""
        if not acting:
            return np.array(wrench)

        def whole() -> F:
            corrections = [correction_of(i.effect, rows, i.values) for i in acting]
            return np.asarray(wrench + np.sum(corrections, axis=0))

        return finite("the prediction", whole)

    def rows_at(self, poses: F) -> Rows:
        """Rows of poses (N, n) without a table, of the model's mechanism in the model's scene."""
        columns = {name: poses[:, j] for j, name in enumerate(self.inputs)}
        length = self.known_length_m
        known = {} if length is None else {"length_m": length}
        meta = Meta(mechanism=known, scene=self.scene)
        return Rows(Table(columns, meta, "poses"), self.base)

    def add(self, *effects: str | Effect) -> Model:
        """The model with these effects, given by id or as such; they are zero until `fit`."""
        present = {item.id for item in self.effects}
        added = []
        for item in effects:
            effect = get_effect(item) if isinstance(item, str) else item
            if not isinstance(effect, Effect):
                raise InputError(
                    f"effect {item!r}: expected the id of an effect (ecm effects), or an effect"
                )
            if effect.id in present:
                raise InputError(f"effect {effect.id} is in the model already: remove it first")
            if effect.kind == "noise":
                raise InputError(
                    f"effect {effect.id} acts on the noise and adds no term: diagnose weighs the "
                    "rows by it and lists it under noise"
                )
            present.add(effect.id)
            added.append(FittedEffect.unfitted(effect))
        return self._changed(effects=(*self.effects, *added))

    def undo(self, name: str | None = None) -> Model:
        """The model before the last fit or change, or the last one that had this name."""
        earlier = self.previous
        while earlier is not None and name is not None and earlier.name != name:
            earlier = earlier.previous
        if earlier is None:
            wanted = "an earlier fit" if name is None else name
            known = ", ".join(record.name for record in self.history) or "none"
            raise InputError(f"nothing to undo: {wanted} is not in this session's fits ({known})")
        return earlier

    def _changed(self, **to: Any) -> Model:
        """The model with these fields; undo reverts all changes since the last fit at once."""
        return replace(self, **to, previous=self.previous if self.changed else self, changed=True)

    def fit_report(self) -> str:
        """Values with errors and correlations, and the history of fits with its tests."""
        text = fit_report(
            self.name,
            self.base,
            self.effects,
            self.correlations,
            self.history,
            self.covariance,
        )
        parts = (self.training.get(name) for name in _SAID_OF_A_FIT)
        return "\n  ".join([text, *(part["sentence"] for part in parts if part is not None)])

    def plot(self) -> Any:
        """Return a plotly figure of the errors in the history of fits.

        Raises
        ------
        InputError
            Before the first fit with `fit`.
        """
        if not self.history:
            raise InputError("the model has no history of fits to plot: call fit(table) first")
        return history_figure(self.history)

    def to_pandas(self) -> Any:
        """Return a DataFrame with a row for each fitted parameter of the effects."""
        rows = [
            (item.id, parameter.name, value, sd, parameter.unit, item.frozen)
            for item in self.effects
            for parameter, value, sd in zip(
                item.effect.parameters, item.values, item.sd, strict=True
            )
        ]
        columns = ["effect", "parameter", "value", "sd", "unit", "frozen"]
        pandas = require("pandas", "data", "Model.to_pandas")
        return pandas.DataFrame(rows, columns=columns)

    def remove(self, *ids: str) -> Model:
        """The model without these effects; the others keep their values until `fit`."""
        self._check(ids)
        return self._changed(effects=tuple(i for i in self.effects if i.id not in ids))

    def freeze(self, *ids: str) -> Model:
        """The model whose `fit` keeps the values of these effects, or of the `base`."""
        self._check([id for id in ids if not isinstance(id, str) or id != "base"])
        for item in self.effects:
            if item.id in ids and not np.all(np.isfinite(item.sd)):
                raise InputError(
                    f"effect {item.id} was never fitted and has no values to keep: "
                    "fit the model with it first"
                )
        effects = tuple(replace(i, frozen=True) if i.id in ids else i for i in self.effects)
        return self._changed(effects=effects, base_frozen=self.base_frozen or "base" in ids)

    def save(self, path: str | Path) -> None:
        """Write a model file with its checksum."""
        check_arguments(Model.save, locals())
        file.write_document(self.document(), path)

    def document(self) -> dict[str, Any]:
        """The document of a model file, without its checksum."""
        return {
            "format": file.FORMAT,
            "version": file.VERSION,
            **self.base.document(),
            "length_m": self.known_length_m,
            "scene": asdict(self.scene),
            **file.covariance_document(self.covariance, self.base),
            "noise": self.noise.to_dict(),
            "effects": [file.effect_document(item) for item in self.effects],
            "base_frozen": self.base_frozen,
            "correlations": [list(pair) for pair in self.correlations],
            "domain": {name: list(pair) for name, pair in self.domain.items()},
            "conditions": {name: list(pair) for name, pair in self.conditions.items()},
            "training": dict(self.training),
            "history": [step.to_dict() for step in self.history],
        }

    def _check(self, ids: Sequence[str]) -> None:
        present = [item.id for item in self.effects]
        for id in ids:
            if not isinstance(id, str) or id not in present:
                listed = ", ".join(present) if present else "none"
                raise InputError(f"the model has no effect {id}; it has: {listed}")

    @takes_table()
    def fit(
        self,
        table: TableLike,
        *,
        noise: Noise | None = None,
        most_rows: int = MANY_ROWS,
        prior: CoefficientPrior | None = None,
        progress: Progress | None = None,
    ) -> Model:
        """Refit the base's coefficients and all effects that are not frozen, jointly.

        Each effect takes the shape among its variants that fits best. The history gets a record.

        Parameters
        ----------
        table
            Measured rows, as a table, a data frame or a dict; zero readings are left out.
        noise
            Default that of the table: from its repeats, else declared, else the model's.
        most_rows
            Of a larger table so many rows are fitted, spread over runs, time and poses, and the
            fit report says so; what depends on earlier rows is computed on all of them.
        prior
            What is known of the base's coefficients beside the rows.
        progress
            Called with the part that is done, the whole, and the step that begins.

        Raises
        ------
        InputError
            Where the table cannot determine an effect; the message names the column to record.
        """
        table, freeze_base = without_zero_readings(table), self.base_frozen
        training = training_of(table)
        training["poses"] = sample_of(table, self.inputs)
        same_rows = was_trained_on(self.training, table)
        domain, conditions = domain_of(table, self.inputs), conditions_of(table)
        if len(table) > most_rows:
            total, table = len(table), table.subsample(spread_rows(table, most_rows))
            fitted_rows = RowsUsed(total, len(table), HOW, "the errors of the values are theirs")
            training["rows_used"] = fitted_rows.to_dict()
        free = [item.id for item in self.effects if not item.frozen]
        steps = Steps(
            {_NOISE: 1, **{_FORM.format(id): 6 for id in free}, _ALL: 6, _RECORD: 5}, progress
        )
        steps.begin(_NOISE)
        used = noise
        if used is None:
            used = noise_for(self.base, table, self.noise, same_rows=same_rows)
        forms = self._forms_of(table)
        # Beside the others the shape of one is chosen: a new effect needs one that has columns.
        first = {
            i: form
            for i, form in forms.items()
            if form is not self.effects[i].effect or self.effects[i].is_new
        }
        shaped = self._with_effects({i: form.variants(table.full)[0] for i, form in first.items()})
        for position, form in forms.items():
            steps.begin(_FORM.format(form.id))
            effects = shaped.effects
            others = (*effects[:position], *effects[position + 1 :])
            best = best_shape(self.base, others, form, table, used, freeze_base=freeze_base)
            shaped = shaped._with_effects({position: best})
        steps.begin(_ALL)
        joint = joint_fit(
            shaped.base, shaped.effects, table, used, freeze_base=freeze_base, prior=prior
        )
        if joint.smallest_taken:
            training["smallest_taken"] = True
        if prior is not None:
            training["prior"] = {"sentence": prior.sentence}
        if any(item.effect.shape.get("overstress") for item in joint.effects):
            # A branch follows it, or has its sign, also in a controller, which has no table.
            training["mean_stiffness"] = joint.rows.stiffness.mean(axis=0).tolist()
        training["effect_sizes"] = effect_sizes(joint, used)
        training["effect_shares"] = effect_shares(joint)
        if not used.is_residual:
            training["over_noise"] = float(np.sqrt((joint.whitened**2).mean()))
        k = 0 if freeze_base else len(joint.base.coefficients)
        fitted = replace(
            shaped,
            base=joint.base,
            effects=joint.effects,
            noise=used,
            length_m=table.meta.length_m or self.length_m,
            scene=table.meta.scene,
            covariance=self.covariance if freeze_base else joint.covariance[:k, :k],
            training=training,
            domain=domain,
            conditions=conditions,
            correlations=correlations_of(joint, freeze_base),
            previous=self.previous if self.changed else self,
            changed=False,
        )
        steps.begin(_RECORD)
        shown = report_rows(table)
        errors = table.matrix(self.outputs)[shown] - fitted.predict(table)[shown]
        training["pose_error"] = pose_error(fitted, table.select(shown), errors).to_dict()
        fit = RecordedFit(fitted.name, joint, table, used, training["hash"])
        # From the same base, whose stiffness weighs the rows: else the sums cannot be compared.
        records = fit_records(fit, self.base, self.history, frozen=freeze_base)
        return replace(fitted, history=(*self.history, *records))

    def _forms_of(self, table: Table) -> dict[int, Effect]:
        """The free effects in the forms that these columns call for, by position; all testable."""
        whole = table.full.with_length(self.known_length_m)
        forms = {}
        for position, item in enumerate(self.effects):
            if item.frozen and not (
                (lacks := item.effect.missing(whole)) is not None and lacks.absent
            ):
                continue
            (form,) = effects_for((*self.inputs, *self.outputs), (item.effect,))
            lacking = form.missing(whole) or missing_length(form, whole)
            if lacking is not None:
                raise InputError(
                    f"{table.source}: effect {item.id} cannot be fitted, {lacking.reason}; "
                    f"record {lacking.record}"
                )
            forms[position] = form
        return forms

    def _with_effects(self, new: dict[int, Effect]) -> Model:
        """The model with other effects at some positions, their values zero."""
        effects = list(self.effects)
        for position, effect in new.items():
            effects[position] = FittedEffect.unfitted(effect)
        return replace(self, effects=tuple(effects))


def _rows_of_poses(poses: F, inputs: Sequence[str]) -> F:
    """(N, n) of poses (N, n), or (1, n) of one pose (n,)."""
    try:
        rows = np.ascontiguousarray(poses, dtype=np.float64)
    except (TypeError, ValueError):
        rows = np.zeros((0, 0, 0))
    if np.ndim(poses) == 1 and rows.ndim == 1:
        rows = rows[None]
    n = len(inputs)
    if rows.ndim != 2 or rows.shape[1] != n or isinstance(poses, str | bytes | Mapping):
        shape = getattr(poses, "shape", None)
        found = f"of shape {shape}" if isinstance(shape, tuple) else f"as a {type(poses).__name__}"
        raise InputError(
            f"poses {found}: expected (N, {n}), or ({n},) for one pose, of {', '.join(inputs)}"
        )
    return rows


def _ranges(document: Any) -> dict[str, tuple[float, float]]:
    if not isinstance(document, dict):
        raise TypeError(f"ranges of columns: found {document!r}")
    return {name: (float(low), float(high)) for name, (low, high) in document.items()}


def load_model(path: str | Path) -> Model:
    """Read a model file.

    Parameters
    ----------
    path
        A file that `Model.save` or `ecm fit` wrote.

    Raises
    ------
    InputError
        Where its checksum, version or a range is wrong.

    Examples
    --------
    >>> import tempfile
    >>> from ecm.io.table import as_table
    >>> from ecm.models import fit_model
    >>> x = np.linspace(-0.01, 0.01, 9)
    >>> model = fit_model(as_table({"x_m": x, "fx_N": 2000.0 * x}), "linear")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     model.save(folder + "/model.json")
    ...     load_model(folder + "/model.json").name
    'poly:1'
    """
    check_arguments(load_model, locals())
    document = file.read_document(path)
    try:
        base = map_from_document(document)
    except (EcmError, KeyError, TypeError, ValueError, IndexError) as error:
        raise InputError(
            f"{path}: the model file lacks or misstates {error}; fit the model again"
        ) from None
    try:
        return Model(
            base=base,
            noise=Noise.from_dict(dict(document["noise"])),
            effects=tuple(file.effect_of(item) for item in document["effects"]),
            covariance=file.covariance_of(document),
            training=dict(document["training"]),
            length_m=document["length_m"],
            scene=file.scene_of(document.get("scene", {})),
            domain=_ranges(document["domain"]),
            conditions=_ranges(document.get("conditions", {})),
            base_frozen=bool(document.get("base_frozen", False)),
            correlations=tuple((a, b, float(r)) for a, b, r in document.get("correlations", ())),
            history=tuple(FitRecord(**step) for step in document.get("history", ())),
        )
    except EcmError as error:
        raise InputError(f"{path}: {error}") from None
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise InputError(
            f"{path}: the model file lacks or misstates {error}; fit the model again"
        ) from None
