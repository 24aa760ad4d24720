"""A model: base map, effects, noise, where it comes from and where it is valid."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from ecm._native import convert_stiffness
from ecm.effects import Effect, Missing, Rows, get_effect
from ecm.errors import InputError
from ecm.io.arrays import B, F
from ecm.io.columns import POSE
from ecm.io.description import Meta, Scene
from ecm.io.table import Table
from ecm.models import file
from ecm.models.fit_report import correlations_of, fit_report
from ecm.models.history import FitRecord, RecordedFit, fit_records
from ecm.models.joint_fit import FittedEffect, best_shape, joint_fit
from ecm.models.leverage import leverages
from ecm.models.maps import StiffnessMap
from ecm.models.registry import map_from_document
from ecm.models.training import domain_of, noise_for, training_of
from ecm.regression.folds import without_zero_readings
from ecm.regression.noise import Noise


@dataclass(frozen=True, repr=False)
class Model:
    """h(p) of the base plus the corrections of its effects."""

    base: StiffnessMap
    noise: Noise = field(default_factory=Noise)
    effects: tuple[FittedEffect, ...] = ()
    covariance: F | None = None
    """(k, k) of the base's coefficients, where known."""
    training: Mapping[str, Any] = field(default_factory=dict)
    """hash, rows, source."""
    domain: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Range of each pose column in the training data."""
    length_m: float | None = None
    """Of the mechanism, for effects that need it where the base does not hold it."""
    scene: Scene = field(default_factory=Scene)
    """Where it was fitted: bare poses are under its gravity; a table says its own."""
    base_frozen: bool = False
    """Whether `fit` keeps the base's coefficients."""
    history: tuple[FitRecord, ...] = ()
    """The error ladder: one rung per fit (models/ladder.py)."""
    correlations: tuple[tuple[str, str, float], ...] = ()
    """Pairs of fitted parameters that move together, the closest first."""
    previous: Model | None = None
    """What it was before the last fit, or where it was changed since then as the fit left it."""
    changed: bool = False
    """Whether an effect was added, removed or frozen since the last fit."""

    def __repr__(self) -> str:
        """The fit report, so that a test is seen as soon as a term is added and fitted."""
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
        """Length of the mechanism: the base's own, else that of the data it was fitted to."""
        return self.base.length_m or self.length_m

    def predict(self, data: Table | F, *, skip_untestable: bool = False) -> F:
        """(N, m) wrench the mechanism needs at poses (N, n), or expected readings of a table.

        A table's rows have time, temperature and approach, so that all effects act; bare poses get
        the base map and the effects of physics that need the pose alone.

        Parameters
        ----------
        skip_untestable
            Leave out effects whose columns the table lacks (`left_out` names them) instead of
            refusing.
        """
        if isinstance(data, np.ndarray):
            return self._at_poses(np.ascontiguousarray(data, dtype=np.float64))
        rows = Rows(data, self.base)
        wrench: F = rows.sensor_load.copy()
        lacking = self.left_out(data)
        for item in self.effects:
            if item.id not in lacking:
                wrench += item.effect.correction(rows, item.values)
            elif not skip_untestable:
                raise InputError(
                    f"{data.source}: effect {item.id} cannot be predicted here, "
                    f"{lacking[item.id].reason}; record {lacking[item.id].record}, "
                    "or remove the effect"
                )
        return wrench

    def left_out(self, table: Table) -> dict[str, Missing]:
        """Effects of the model that a table's rows do not determine, and why.

        What only has to vary for a fit need not vary here.
        """
        found = {}
        filled = table.with_columns(_zeros(table, self.outputs))
        for item in self.effects:
            lacking = item.effect.missing(filled)
            if lacking is not None and lacking.absent:
                found[item.id] = lacking
        return found

    def predict_sd(self, data: Table | F) -> F | None:
        """(N, m) standard deviation of the base's wrench from its coefficients, where known."""
        if self.covariance is None:
            return None
        poses = data if isinstance(data, np.ndarray) else Rows(data, self.base).poses
        columns = self.base.columns(np.ascontiguousarray(poses))
        variance = np.einsum("nmk,kl,nml->nm", columns, self.covariance, columns)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0) + self.base.error**2))

    def reading_sd(self, poses: F) -> F | None:
        """(N, m) standard deviation of a new reading around the prediction, where known.

        Of the coefficients and of one row's noise, the latter widened where the training
        residuals are larger than it.
        """
        sd = self.predict_sd(poses)
        if sd is None:
            return None
        wider = max(1.0, float(self.training.get("residual_variance", 1.0)))
        of_row = np.einsum("njj->nj", self.noise.covariance(self._bare_rows(poses)))
        return np.asarray(np.sqrt(sd**2 + wider * of_row))

    def leverage(self, poses: F) -> F | None:
        """(N,) uncertainty of the prediction over the noise of one row, where known."""
        if self.covariance is None or self.noise.components is not None or self.inputs != POSE:
            return None
        return leverages(self.base, self.covariance, self.noise, np.ascontiguousarray(poses))

    def extrapolates(self, poses: F) -> B:
        """(N,) whether the model is asked beyond its training data.

        A leverage above the largest of the training rows; where that is not known, a pose column
        outside its range there.
        """
        leverage = self.leverage(poses)
        limit = self.training.get("largest_leverage")
        if leverage is not None and limit is not None:
            return np.asarray(leverage > limit * (1.0 + 1e-9))
        outside = np.zeros(len(poses), dtype=np.bool_)
        for j, name in enumerate(self.inputs):
            low, high = self.domain.get(name, (-np.inf, np.inf))
            outside |= (poses[:, j] < low) | (poses[:, j] > high)
        return outside

    def stiffness_sd(self, poses: F) -> F | None:
        """(N, m, n) standard deviation of K = dh/dp from the coefficients, where known."""
        if self.covariance is None:
            return None
        poses = np.ascontiguousarray(poses, dtype=np.float64)
        sd = np.empty((len(poses), len(self.outputs), len(self.inputs)))
        for j in range(len(self.inputs)):
            step = np.zeros(len(self.inputs))
            step[j] = 1e-5
            slope = (self.base.columns(poses + step) - self.base.columns(poses - step)) / 2e-5
            variance = np.einsum("nmk,kl,nml->nm", slope, self.covariance, slope)
            sd[:, :, j] = np.sqrt(np.maximum(variance, 0.0))
        return sd

    def stiffness(self, poses: F, kind: str = "partial") -> F:
        """(N, m, n) stiffness of the base and of the effects of physics on the pose."""
        poses = np.ascontiguousarray(poses, dtype=np.float64)
        acting = self._acting_at_poses()
        if not acting:
            return self.base.stiffness(poses, kind)
        partial = np.empty((len(poses), len(self.outputs), len(self.inputs)))
        for j in range(len(self.inputs)):
            step = np.zeros(len(self.inputs))
            step[j] = 1e-6
            partial[:, :, j] = (self._at_poses(poses + step) - self._at_poses(poses - step)) / 2e-6
        if kind == "partial":
            return partial
        target: Any = kind
        return convert_stiffness(
            partial, poses, self._at_poses(poses), source="partial", target=target
        )

    def _acting_at_poses(self) -> list[FittedEffect]:
        return [i for i in self.effects if i.effect.kind == "pose" and i.effect.side == "physics"]

    def _at_poses(self, poses: F) -> F:
        wrench = self.base.predict(poses)
        acting = self._acting_at_poses()
        if acting:
            rows = self._bare_rows(poses)
            wrench = wrench + sum(item.effect.correction(rows, item.values) for item in acting)
        return np.asarray(wrench)

    def _bare_rows(self, poses: F) -> Rows:
        """Poses without a table: of the model's mechanism in the model's scene."""
        columns = {name: poses[:, j] for j, name in enumerate(self.inputs)}
        known = {} if self.length_m is None else {"length_m": self.length_m}
        meta = Meta(mechanism=known, scene=self.scene)
        return Rows(Table(columns, meta, "poses"), self.base)

    def add(self, *effects: str | Effect) -> Model:
        """With these effects, at zero until `fit`; ids or effects."""
        present = {item.id for item in self.effects}
        added = []
        for item in effects:
            effect = get_effect(item) if isinstance(item, str) else item
            if effect.id in present:
                raise InputError(f"effect {effect.id} is in the model already: remove it first")
            if effect.kind == "noise":
                raise InputError(
                    f"effect {effect.id} acts on the noise and adds no term: diagnose weighs the "
                    "rows by it and lists it under noise"
                )
            present.add(effect.id)
            k = len(effect.parameters)
            added.append(FittedEffect(effect, np.zeros(k), np.full(k, np.inf)))
        return self._changed(effects=(*self.effects, *added))

    def undo(self, name: str | None = None) -> Model:
        """As it was before the last fit or unfitted change, or when it was called `name`."""
        found = self.previous
        while found is not None and name is not None and found.name != name:
            found = found.previous
        if found is None:
            wanted = "an earlier fit" if name is None else name
            known = ", ".join(rung.name for rung in self.history) or "none"
            raise InputError(f"nothing to undo: {wanted} is not in this session's fits ({known})")
        return found

    def _changed(self, **to: Any) -> Model:
        """With these fields; undo goes past all changes since the last fit at once."""
        settled = self.previous if self.changed else self
        return replace(self, **to, previous=settled, changed=True)

    def fit_report(self) -> str:
        """Values with errors and correlations, the error ladder and the tests between its rungs."""
        return fit_report(self.name, self.base, self.effects, self.correlations, self.history)

    def remove(self, *ids: str) -> Model:
        """Without these effects; what is left keeps its values until `fit`."""
        self._check(ids)
        kept = tuple(i for i in self.effects if i.id not in ids)
        return self._changed(effects=kept)

    def freeze(self, *ids: str) -> Model:
        """These effects, or `base`, keep their values in `fit`."""
        self._check([id for id in ids if id != "base"])
        for item in self.effects:
            if item.id in ids and not np.all(np.isfinite(item.sd)):
                raise InputError(
                    f"effect {item.id} was never fitted and has no values to keep: "
                    "fit the model with it first"
                )
        kept = [replace(i, frozen=True) if i.id in ids else i for i in self.effects]
        return self._changed(effects=tuple(kept), base_frozen=self.base_frozen or "base" in ids)

    def save(self, path: str | Path) -> None:
        """Write a sealed model file."""
        file.write_document(self.document(), path)

    def document(self) -> dict[str, Any]:
        """The document of a model file, without its sum."""
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
            "training": dict(self.training),
            "history": [step.to_dict() for step in self.history],
        }

    def _check(self, ids: Sequence[str]) -> None:
        present = [item.id for item in self.effects]
        for id in ids:
            if id not in present:
                listed = ", ".join(present) if present else "none"
                raise InputError(f"the model has no effect {id}; it has: {listed}")

    def fit(self, table: Table, *, noise: Noise | None = None) -> Model:
        """Refit the base's coefficients and all effects that are not frozen, jointly.

        Each effect takes the shape among its variants that fits best. The history gets a rung.

        Parameters
        ----------
        noise
            Default that of the table: of its repeats, else declared, else the model's.
        """
        table, freeze_base = without_zero_readings(table), self.base_frozen
        training = training_of(table)
        same_rows = self.training.get("hash") == training["hash"]
        used = noise
        if used is None:
            used = noise_for(self.base, table, self.noise, same_rows=same_rows)
        chosen = self
        for position, item in enumerate(self.effects):
            if not item.frozen:
                chosen = chosen._best_shape(position, table, used, freeze_base)
        found = joint_fit(chosen.base, chosen.effects, table, used, freeze_base=freeze_base)
        k = 0 if freeze_base else len(found.base.coefficients)
        fitted = replace(
            chosen,
            base=found.base,
            effects=found.effects,
            noise=used,
            length_m=table.meta.length_m or self.length_m,
            scene=table.meta.scene,
            covariance=self.covariance if freeze_base else found.covariance[:k, :k],
            training=training,
            domain=domain_of(table, self.inputs),
            correlations=correlations_of(found, freeze_base),
            previous=self.previous if self.changed else self,
            changed=False,
        )
        step = fit_records(
            RecordedFit(fitted.name, found, table, used, training["hash"]),
            fitted.base,
            self.history,
            frozen=freeze_base,
        )
        return replace(fitted, history=(*self.history, *step))

    def _best_shape(self, position: int, table: Table, noise: Noise, freeze_base: bool) -> Model:
        item = self.effects[position]
        lacking = item.effect.missing(table)
        if lacking is not None:
            raise InputError(
                f"{table.source}: effect {item.id} cannot be fitted, {lacking.reason}; "
                f"record {lacking.record}"
            )
        others = (*self.effects[:position], *self.effects[position + 1 :])
        effect = best_shape(self.base, others, item.effect, table, noise, freeze_base=freeze_base)
        k = len(effect.parameters)
        fresh = FittedEffect(effect, np.zeros(k), np.full(k, np.inf))
        return replace(
            self, effects=(*self.effects[:position], fresh, *self.effects[position + 1 :])
        )


def _zeros(table: Table, names: Sequence[str]) -> dict[str, F]:
    """Wrench columns that a pose table lacks, so that what is missing is only what matters."""
    return {name: np.zeros(len(table)) for name in names if not table.has(name)}


def load_model(path: str | Path) -> Model:
    """Read a model file; refused when its sum, version or a range is wrong."""
    document = file.read_document(path)
    try:
        return Model(
            base=map_from_document(document),
            noise=Noise.from_dict(dict(document["noise"])),
            effects=tuple(file.effect_of(item) for item in document["effects"]),
            covariance=file.covariance_of(document),
            training=dict(document["training"]),
            length_m=document["length_m"],
            scene=file.scene_of(document.get("scene", {})),
            domain={name: (float(a), float(b)) for name, (a, b) in document["domain"].items()},
            base_frozen=bool(document.get("base_frozen", False)),
            correlations=tuple((a, b, float(r)) for a, b, r in document.get("correlations", ())),
            history=tuple(FitRecord(**step) for step in document.get("history", ())),
        )
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise InputError(
            f"{path}: the model file lacks or misstates {error}; fit the model again"
        ) from None
