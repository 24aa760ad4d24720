"""A model: base map, effects, noise, where it comes from and where it is valid."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ecm.effects import Effect, effects_for, get_effect
from ecm.effects.protocol import AtColumns, missing_beside_columns
from ecm.errors import EcmError, InputError, Remedy
from ecm.io.arguments import check_arguments
from ecm.io.arrays import B, F, rms
from ecm.io.columns import POSE, WRENCH, behind
from ecm.io.description import Scene
from ecm.io.events import Progress, Steps
from ecm.io.extras import require
from ecm.io.settings import read_settings
from ecm.io.table import Table, TableLike, as_table, takes_table
from ecm.models import registry
from ecm.models.controller import Controller
from ecm.models.errors import FitRecord, history_figure
from ecm.models.evaluation import EvaluatedModel, error_of_report, rows_of_poses
from ecm.models.joint_fit import (
    CoefficientPrior,
    FittedEffect,
    JointFit,
    effect_shares,
    effect_sizes,
    joint_fit,
    noise_for,
    of_fit,
)
from ecm.models.measured_poses import are_inside, folded, sample_of
from ecm.models.parameters import FittedParameter, ParametrisedMap
from ecm.models.registry import map_from_document, was_trained_on
from ecm.models.shapes import best_shape
from ecm.models.time_effects import time_effects
from ecm.regression.blas import one_blas_thread
from ecm.regression.folds import HOW, RowsUsed, spread_rows, without_zero_readings
from ecm.regression.noise import Noise
from ecm.regression.normal_equations import MANY_ROWS
from ecm.regression.rows import actuators_of, is_whole, taken_by
from ecm.report import figures
from ecm.report.blocks import (
    Block,
    Cell,
    CodeBlock,
    FigureBlock,
    Report,
    Section,
    Shown,
    TableBlock,
    TextBlock,
)

_LARGE_CORRELATION = 0.3
_MOST_PAIRS = 12
_MOST_SHOWN = 20
_NOISE, _FORM, _ALL, _RECORD = "noise", "form of {}", "all values together", "errors"
"""Steps of a fit with effects."""
_ROUNDS = 4
"""Most times that the shapes of several effects are chosen, each beside the others."""
_SAID_OF_A_FIT = ("misread", "form", "prior", "pose_error", "rows_used", "slow_noise")
"""Parts of `training` that have a sentence in the fit report."""


@dataclass(frozen=True, repr=False, eq=False)
class Model(Shown, EvaluatedModel):
    """A base map with effects: h(p) of the base plus the corrections of the effects.

    `fit_model` and `load_model` make one; it prints its fit report, and a notebook shows `params`.

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

    EXPECTED: ClassVar[str] = "a Model, as ecm.load_model opens one"
    base_frozen: bool = False
    """Whether `fit` keeps the base's coefficients."""
    history: tuple[FitRecord, ...] = ()
    """One record for each fit (errors.py)."""
    correlations: tuple[tuple[str, str, float], ...] = ()
    """Pairs of fitted parameters with large correlation, the largest first."""
    previous: Model | None = None
    """The model before the last fit; of a model changed since then, as that fit left it."""
    changed: bool = False
    """Whether an effect was added, removed or frozen since the last fit."""

    def __str__(self) -> str:
        """The fit report."""
        return self.fit_report()

    def __repr__(self) -> str:
        """What it maps, in one line."""
        columns = f"{', '.join(self.outputs)} of {', '.join(self.inputs)}"
        columns = "wrench of pose" if is_whole(self.base) else columns
        said = f"<Model {self.name}: {columns}, {len(self.params)} parameters"
        if not self.history:
            return f"{said}>"
        return f"{said}, error {self.history[-1].held_out:.3g} times {self.noise.unit}>"

    def blocks(self) -> list[Block]:
        """Return what a notebook shows: the parameters, and the fit report."""
        params = list(self.params.items())
        rows: list[list[Cell]] = [
            [name, f"{own.value:.5g}", own.sd, own.unit, _finite(own.min), _finite(own.max)]
            for name, own in params[:_MOST_SHOWN]
        ]
        caption = "Parameters."
        caption += f" The first {_MOST_SHOWN} of {len(params)}." if params[_MOST_SHOWN:] else ""
        header = ("parameter", "value", "sd", "unit", "min", "max")
        blocks: list[Block] = [TextBlock(repr(self)[1:-1], strong=True)]
        blocks += [TableBlock(caption, header, rows)] if rows else []
        return [*blocks, CodeBlock("Fit report", self.fit_report())]

    def report(self, table: Table) -> Report:
        """Return the parameters, the fit report, and measured and modelled over displacement."""
        figure = FigureBlock(
            "Measured and modelled wrench over displacement."
            + figures.drawn_sentence(table.matrix(self.outputs)),
            self._over_displacement(table),
        )
        sections = [Section("Model", self.blocks()), Section("Measured and modelled", [figure])]
        return Report(f"Model {self.name}", f"{table.source}: {len(table)} rows", sections)

    @property
    def params(self) -> dict[str, FittedParameter]:
        """Value, standard deviation and bounds of each parameter, by name.

        Those of an effect are called `EFFECT.PARAMETER`. A physics base has `young_modulus_Pa` and
        `poisson_ratio`, an expression its own; `fx_N:x^2` of a polynomial is in N and belongs to x
        scaled to -1 to 1.

        Examples
        --------
        >>> import ecm
        >>> y = np.linspace(-0.01, 0.01, 9)
        >>> model = ecm.fit({"y_m": y, "fy_N": 3000.0 * y}, "linear")
        >>> list(model.params), round(model.params["fy_N:y"].value, 6)
        (['fy_N:1', 'fy_N:y'], 30.0)
        """
        base, k = self.base, len(self.base.coefficients)
        low, high = base.bounds or (np.full(k, -np.inf), np.full(k, np.inf))
        sd = np.full(k, np.nan)
        if self.covariance is not None:
            sd = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        fitted = zip(base.parameter_names, base.coefficients, low, high, sd, strict=True)
        found = {
            name: FittedParameter.at(
                value, (least, most), error, vary=not self.base_frozen,
                unit=base.parameter_unit,
            )
            for name, value, least, most, error in fitted
        }  # fmt: skip
        if isinstance(base, ParametrisedMap):  # those that are held, too
            held = {name: own for name, own in base.parameters.items() if not own.vary}
            found |= {
                name: FittedParameter.at(base.values[name], (own.min, own.max), np.nan, vary=False)
                for name, own in held.items()
            }
        for item in self.effects:
            for own, value, error in item.listed:
                found[f"{item.id}.{own.name}"] = FittedParameter.at(
                    value, (own.lower, own.upper), error,
                    vary=not item.frozen, unit=own.unit, effect=item.id,
                )  # fmt: skip
        return found

    def extrapolates(self, poses: TableLike | F) -> B:
        """(N,) whether the model is asked beyond its measured poses.

        There `inside` of the exported model is 0. A file that holds no measured poses has the range
        of each pose column. Inputs of actuators follow the pose; without any they are 0.
        """
        return ~are_inside(self, rows_of_poses(poses, self.base))

    def controller(self) -> Controller:
        """Return the model in steps of any length: wrench and tangent with effects of time.

        Effects of the pose are folded into one energy, as `ecm export` does.

        Raises
        ------
        InputError
            A model of fewer than the six pose and wrench columns, or with actuators.

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
        if not is_whole(self.base) or actuators_of(self.base):
            raise InputError(
                f"{self.name}: a controller in Python needs a model of all six pose and wrench "
                "columns, without the inputs of actuators",
                remedy=Remedy(
                    "export it to c, which takes all", "ecm export MODEL --to c --out OUT"
                ),
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
        poses = sample_of(table, taken_by(self.base))
        return replace(self, training={**self.training, "poses": poses})

    def at(self, columns: Mapping[str, float]) -> Model:
        """The model at fixed values of recorded columns that its effects follow.

        These effects then act at every pose: they are in `predict` and `stiffness` of poses alone,
        and go into an export as a part of its map. Such a model is not saved.

        Parameters
        ----------
        columns
            Values by the names of the columns, such as a humidity, in their units.

        Raises
        ------
        InputError
            A column that no effect follows, or a value beyond those that were measured.

        Examples
        --------
        >>> import numpy as np, ecm
        >>> y, degc = np.linspace(-0.01, 0.01, 40), 20.0 + np.arange(40) % 7
        >>> h = 3000.0 * y * (1.0 - 0.01 * (degc - 20.0))
        >>> table = ecm.as_table({"y_m": y, "fy_N": h, "temperature_degC": degc})
        >>> model = ecm.fit(table, "linear").add("temperature_modulus").fit(table)
        >>> model.at({"temperature_degC": 25.0}).stiffness(np.array([0.001])).round(1)
        array([[2850.]])
        """
        known = self.followed
        for name, value in columns.items():
            if name not in known.values():
                listed = ", ".join(sorted({*known.values()})) or "none"
                raise InputError(
                    f"{name}: no effect of {self.name} follows it and nothing else; columns that "
                    f"are followed so: {listed}"
                )
            low, high = self.conditions.get(name, (-np.inf, np.inf))
            if not low <= value <= high:
                raise InputError(
                    f"{name} = {value:.6g}: the model was measured from {low:.6g} to {high:.6g}"
                )
        fixed = {id: {name: columns[name]} for id, name in known.items() if name in columns}
        effects = tuple(
            replace(one, effect=AtColumns(one.effect, fixed[one.id])) if one.id in fixed else one
            for one in self.effects
        )
        return self._changed(effects=effects)

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
        lines = [f"model {self.name}: {len(self.base.coefficients)} coefficients in the base"]
        if isinstance(self.base, ParametrisedMap):
            lines += [f"  {line}" for line in self.base.sentences(self.covariance)]
        for side, title in (("physics", "physics"), ("measurement", "instruments")):
            for item in (i for i in self.effects if i.effect.side == side):
                shape = "".join(
                    f", {k} = {v:.4g}" if isinstance(v, float) else f", {k} = {v}"
                    for k, v in item.effect.shape.items()
                )
                lines.append(f"  {item.id} ({title}{shape}){' frozen' if item.frozen else ''}")
                one = item.taken & (self.training.get("smallest_taken", False) and not item.frozen)
                for (parameter, value, sd), bound, taken in zip(
                    item.listed, item.at_bounds, one, strict=True
                ):
                    if taken:
                        lines.append(
                            f"    {parameter.name}: one with coefficients of {self.base.name}, "
                            "these rows tell only their sum"
                        )
                        continue
                    error = f" +- {sd:.2g}" if np.isfinite(sd) else " (not fitted)"
                    at = " at its bound" if bound else ""
                    lines.append(
                        f"    {parameter.name} = {value:.4g}{error}{behind(parameter.unit)}{at}"
                    )
                least = [1e-6 * parameter.scale for parameter in item.effect.parameters]
                if (
                    not item.is_new
                    and item.at_bounds.all()
                    and np.all(np.abs(item.values) <= least)
                ):
                    lines.append("    it explains nothing: the data would need the opposite sign")
        if self.correlations:
            lines.append(f"  correlations beyond {_LARGE_CORRELATION}:")
            lines += [f"    {a} and {b}: {value:+.2f}" for a, b, value in self.correlations]
        # Where nothing is known of the noise, something else stands in its place.
        known = not self.noise.is_assumed
        over = "noise" if known else self.noise.unit
        for record in self.history:
            more = "" if record.ceiling is None else f", ceiling {record.ceiling:.3f}"
            more += f", floor {record.floor:g}" if known else ""
            lines.append(
                f"  {record.name}: error over {over} {record.train:.3f} fitted, "
                f"{record.held_out:.3f} held out{more}"
            )
            if record.test:
                lines.append(f"    {record.test}")
        said = (self.training.get(name) for name in _SAID_OF_A_FIT)
        lines += [f"  {part['sentence']}" for part in said if part is not None]
        return "\n".join(lines)

    def plot(self, data: TableLike | None = None) -> Any:
        """Return a plotly figure: measured and modelled wrench over the displacement.

        Parameters
        ----------
        data
            Measured rows, as a table, a data frame, a dict or a file. Each component is drawn over
            its own coordinate, fx over x, or else over the one that varies most. Without data: the
            errors in the history of fits.

        Raises
        ------
        InputError
            Without data before the first fit with `fit`.
        MissingExtra
            Where plotly is not installed.
        """
        if data is not None:
            return figures.plotly_figure(self._over_displacement(as_table(data, need="fit")))
        if not self.history:
            raise InputError(
                "the model has no history of fits to plot: give the data, plot(table), or call "
                "fit(table) first"
            )
        records = [record.to_dict() for record in self.history]
        return figures.plotly_figure(history_figure(records))

    def _over_displacement(self, table: Table) -> dict[str, Any]:
        """Measured and modelled wrench of each row, a panel for each component."""
        measured = table.matrix(self.outputs)
        modelled = self.readings(table, skip_untestable=True)
        poses = table.matrix(self.inputs)
        spread = poses.std(axis=0)
        places = []
        for output in self.outputs:
            own = POSE[WRENCH.index(output)]
            at = self.inputs.index(own) if own in self.inputs else -1
            places.append(at if at >= 0 and spread[at] > 0.0 else int(np.argmax(spread)))
        titles = [self.inputs[at] for at in places]
        curve = len(self.inputs) == 1 and not self.effects
        return figures.measured_and_modelled(
            poses[:, places], measured, modelled, titles, self.outputs, is_curve=curve
        )

    def to_pandas(self) -> Any:
        """Return a DataFrame with a row for each parameter (`params`)."""
        rows = [
            {"effect": own.effect, "parameter": name.removeprefix(f"{own.effect}.")}
            | {key: getattr(own, key) for key in ("value", "sd", "min", "max", "unit")}
            | {"frozen": not own.vary}
            for name, own in self.params.items()
        ]
        return require("pandas", "data", "Model.to_pandas").DataFrame(rows)

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
        """Write a model file with its checksum; not of a model `at` fixed values."""
        check_arguments(Model.save, locals())
        fixed = [i.effect.physics for i in self.effects if isinstance(i.effect, AtColumns)]
        if fixed:
            raise InputError(
                f"{', '.join(fixed)}: a model at fixed values predicts and is exported; save the "
                "model that follows its columns"
            )
        registry.write_document(self.document(), path)

    def document(self) -> dict[str, Any]:
        """The document of a model file, without its checksum."""
        return {
            "format": registry.FORMAT,
            "version": registry.VERSION,
            **self.base.document(),
            "length_m": self.known_length_m,
            "scene": asdict(self.scene),
            **registry.covariance_document(self.covariance, self.base),
            "noise": self.noise.to_dict(),
            "effects": [
                {**item.to_dict(), "side": item.effect.side, "frozen": item.frozen}
                for item in self.effects
            ],
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
    @one_blas_thread()
    def fit(
        self,
        table: TableLike,
        *,
        noise: Noise | None = None,
        most_rows: int = MANY_ROWS,
        prior: CoefficientPrior | None = None,
        with_ceiling: bool = True,
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
        with_ceiling
            Whether the history tells how far any function of the pose might go, which takes longer
            than a fit of few rows; a model that is only compared does without.
        progress
            Called with the part that is done, the whole, and the step that begins.

        Raises
        ------
        InputError
            Where the table cannot determine an effect; the message names the column to record.
        """
        table, freeze_base = without_zero_readings(table), self.base_frozen
        described = registry.fitted_to(table, self.inputs)
        training = described["training"]
        training["poses"] = sample_of(table, taken_by(self.base))
        if freeze_base:
            training["means"] = self.means
        same_rows = was_trained_on(self.training, table)
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
        shaped = self._shaped(table, used, steps)
        steps.begin(_ALL)
        joint = joint_fit(
            shaped.base, shaped.effects, table, used,
            freeze_base=freeze_base, prior=prior, kept=self.kept,
        )  # fmt: skip
        if joint.slow is not None:
            training["slow_noise"] = {"sentence": joint.slow.sentence()}
            joint = joint.in_slow_noise()
        if joint.smallest_taken:
            training["smallest_taken"] = True
        if prior is not None:
            training["prior"] = {"sentence": prior.sentence}
        if taken := of_fit(joint, self.kept):
            training["of_fit"] = taken
        training["effect_sizes"] = effect_sizes(joint, used)
        training["effect_shares"] = effect_shares(joint)
        if not used.is_residual:
            training["over_noise"] = rms(joint.whitened)
        k = 0 if freeze_base else len(joint.base.coefficients)
        fitted = replace(
            shaped,
            base=joint.base,
            effects=joint.effects,
            noise=used,
            length_m=table.meta.length_m or self.length_m,
            covariance=self.covariance if freeze_base else joint.covariance[:k, :k],
            correlations=_correlations(joint, freeze_base),
            previous=self.previous if self.changed else self,
            changed=False,
            **described,
        )
        steps.begin(_RECORD)
        training["pose_error"] = error_of_report(fitted, table)
        history = list(self.history)
        record = partial(
            FitRecord.of, noise=used, training_hash=training["hash"], with_ceiling=with_ceiling
        )
        # From the same base, whose stiffness weighs the rows: else the sums cannot be compared.
        if joint.effects and not history:
            alone = joint_fit(self.base, (), table, used, freeze_base=freeze_base)
            history.append(record(self.base.name, alone))
        own = record(fitted.name, joint)
        history.append(own.beside(history[-1]) if history else own)
        return replace(fitted, history=tuple(history))

    @property
    def kept(self) -> dict[str, Any]:
        """`of_fit` where a fit to other rows keeps it, so that what is frozen stays the same."""
        return self.of_fit if self.base_frozen or any(item.frozen for item in self.effects) else {}

    def _shaped(self, table: Table, noise: Noise, steps: Steps) -> Model:
        """The model with the shape of each free effect that explains most beside the others."""
        forms, own, frozen = self._forms_of(table), self.effects, self.base_frozen
        # Beside the others the shape of one is chosen: a new effect needs one that has columns.
        new = [i for i, form in forms.items() if form is not own[i].effect or own[i].is_new]
        shaped = self._with_effects({i: forms[i].variants(table.full)[0] for i in new})
        # What is right beside a bad shape of another effect need not be so beside a good one: it is
        # chosen again once the shapes beside it have changed.
        beside: dict[int, list[Effect]] = {}
        # Those that are new first: the others have shapes that were right before.
        order = sorted(forms.items(), key=lambda item: item[0] not in new)
        known = set(forms) - set(new)
        for position, form in order * _ROUNDS:
            others = tuple(one for i, one in enumerate(shaped.effects) if i != position)
            shapes = [one.effect for one in others]
            if position not in beside:
                steps.begin(_FORM.format(form.id))
            elif beside[position] == shapes:
                continue
            beside[position] = shapes
            present = shaped.effects[position].effect if position in known else None
            best = best_shape(
                self.base, others, form, table, noise,
                freeze_base=frozen, kept=self.kept, present=present,
            )  # fmt: skip
            known.add(position)
            shaped = shaped._with_effects({position: best})
        return shaped

    def _forms_of(self, table: Table) -> dict[int, Effect]:
        """The free effects in the forms that these columns call for, by position; all testable."""
        whole = table.full.with_length(self.known_length_m)
        forms = {}
        for position, item in enumerate(self.effects):
            if item.frozen and not (
                (lacks := item.effect.missing(whole)) is not None and lacks.absent
            ):
                continue
            names, known = (*self.inputs, *self.outputs), whole.meta.length_m is not None
            (form,) = effects_for(names, (item.effect,), length_known=known)
            form = form.beside_base(self.means if self.base_frozen else None)
            lacking = form.missing(whole) or missing_beside_columns(form, whole)
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


def _correlations(fit: JointFit, base_frozen: bool) -> tuple[tuple[str, str, float], ...]:
    """Pairs of parameters with large correlation: of effects, and of these with the base."""
    own = [
        f"{item.id}.{parameter.name}"
        for item in fit.effects
        if not item.frozen
        for parameter in item.effect.parameters
    ]
    base = 0 if base_frozen else len(fit.base.coefficients)
    names = [*fit.base.parameter_names[:base], *own]
    sd = np.sqrt(np.maximum(np.diag(fit.covariance), 1e-300))
    matrix = fit.covariance / np.outer(sd, sd)
    pairs = [
        (names[i], names[j], float(matrix[i, j]))
        for j in range(base, len(names))
        for i in range(j)
        if abs(matrix[i, j]) > _LARGE_CORRELATION
    ]
    return tuple(sorted(pairs, key=lambda pair: -abs(pair[2]))[:_MOST_PAIRS])


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def _ranges(document: dict[str, Any]) -> dict[str, tuple[float, float]]:
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
    document = registry.read_document(path)
    try:
        return Model(
            base=map_from_document(document),
            noise=Noise.from_dict(dict(document["noise"])),
            effects=tuple(registry.effect_of(item) for item in document["effects"]),
            covariance=registry.covariance_of(document),
            training=dict(document["training"]),
            length_m=document["length_m"],
            scene=read_settings(Scene, document.get("scene", {}), "scene"),
            domain=_ranges(document["domain"]),
            conditions=_ranges(document.get("conditions", {})),
            base_frozen=bool(document.get("base_frozen", False)),
            correlations=tuple((a, b, float(r)) for a, b, r in document.get("correlations", ())),
            history=tuple(FitRecord(**step) for step in document.get("history", ())),
        )
    except (EcmError, KeyError, TypeError, ValueError, IndexError) as error:
        raise InputError(
            f"{path}: the model file lacks or misstates a value: {error}; fit the model again"
        ) from None
