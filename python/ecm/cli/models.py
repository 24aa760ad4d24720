"""What the commands do with models: open, fit by name, predict into columns, sum up."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.columns import POSE, STIFFNESS, WRENCH, unit_of

if TYPE_CHECKING:
    from ecm.cli.console import Console
    from ecm.io.mechanism import Mechanism
    from ecm.io.table import Table
    from ecm.models import Model, ModelSpecification, PhysicsMap
    from ecm.models.specification import Weights

_FOLDS = 10
_HALVINGS = 25
_FAR = 0.1
"""A pose is outside the training data beyond this share of the range of a column."""


def build_bar(console: Console) -> Callable[[int, int, str], object]:
    """A progress bar that appears only if the physics base is not there yet."""
    drawn: list[Callable[..., None] | None] = []

    def show(done: int, total: int, word: str) -> None:
        if not drawn:
            drawn.append(console.bar("FEM of the body, kept for the next time"))
        if drawn[0] is not None:
            drawn[0](done, total, word)

    return show


def open_model(name: str, console: Console, table: Table | None = None) -> Model:
    """MODEL of a command: a model file, or a TOML whose [mechanism] is the physics model.

    Parameters
    ----------
    table
        The poses that it is asked for: the physics is built as wide as they reach.
    """
    from ecm.models import Model, load_model, physics_map
    from ecm.models.physics.map import reach_of

    path = Path(name)
    if path.suffix.lower() != ".toml":
        return load_model(path)
    reach = 0.0 if table is None else reach_of(table)
    bar = build_bar(console)
    return Model(base=physics_map(_mechanism(path), progress=bar, reach_rad=reach))


def prepare_physics(table: Table, console: Console, threads: int = 0) -> PhysicsMap | None:
    """The physics base of the table's `[mechanism]`, built under a progress bar where it is new."""
    from ecm.models import physics_map
    from ecm.models.physics.map import reach_of

    body = table.meta.body()
    if body is None or not body.has_body or not table.has(*POSE, *WRENCH):
        return None
    return physics_map(
        body, threads=threads, progress=build_bar(console), reach_rad=reach_of(table)
    )


def _mechanism(path: Path) -> Mechanism:
    """[mechanism] of a TOML; its other tables (of a CONFIG, say) are left alone."""
    from ecm.io.mechanism import Mechanism
    from ecm.io.toml import read_toml

    document = read_toml(path, "description of a mechanism")
    if "mechanism" not in document:
        raise InputError(f"{path}: no table [mechanism], expected one: it is the physics model")
    where = f"{path} [mechanism]"
    return Mechanism.from_dict(document["mechanism"], where, base=path.parent)


def named_model(name: str, pcr: str | None, threads: int) -> ModelSpecification:
    """Specification of `--model NAME`; NAME may be a TOML with [mechanism]."""
    from ecm.models import PhysicsModel, parse_model

    found = PhysicsModel(threads=threads)
    if name.lower().endswith(".toml"):
        found = replace(found, mechanism=_mechanism(Path(name)))
    elif name != found.name:
        return parse_model(name, pcr=pcr)
    if pcr is not None:
        raise InputError(f"--pcr is for polynomials, found --model {name}. Leave it out.")
    return found


def fit_named(
    table: Table,
    model: ModelSpecification,
    *,
    console: Console,
    zero_at_home: bool = False,
    stable: bool = False,
    weights: str = "auto",
) -> Model:
    """Fit a model; the physics of a body is built under a progress bar where it is new."""
    from ecm.models import PhysicsModel, fit_model, physics_map
    from ecm.models.physics.map import reach_of

    if isinstance(model, PhysicsModel):
        body = model.mechanism or table.meta.body()
        if body is not None:
            reach, bar = reach_of(table), build_bar(console)
            base = physics_map(body, threads=model.threads, progress=bar, reach_rad=reach)
            model = replace(model, base=base)
    return fit_model(
        table,
        model,
        zero_at_home=zero_at_home,
        stable=stable,
        weights=cast("Weights", weights),
    )


def fit_summary(
    fitted: Model, table: Table, model: ModelSpecification, *, seed: int = 0
) -> dict[str, Any]:
    """Error on the fitted and on held-out rows, absolute and as a share of the spread."""
    measured = table.measured()
    predicted = fitted.predict(measured.matrix(fitted.inputs))
    components: dict[str, dict[str, float | None]] = {}
    sentences: list[str] = []
    for j, column in enumerate(fitted.outputs):
        values = measured.column(column)
        rmse = float(np.sqrt(np.mean((predicted[:, j] - values) ** 2)))
        spread = float(np.std(values))
        share = rmse / spread if spread > 0.0 else None
        components[column] = {"rmse": rmse, "spread": spread, "rmse_over_spread": share}
        unit = unit_of(column)
        if share is None:
            sentences.append(f"{column}: never excited, nothing was learnt about it")
        else:
            sentences.append(f"{column}: rmse {rmse:.3g} {unit} on the fitted rows, "
                             f"{100.0 * share:.2g} % of its spread")  # fmt: skip
    held_out = _held_out(table, model, seed)
    if held_out is not None:
        sentences += held_out.pop("sentences")
    parameters = _parameters(fitted)
    if parameters is not None:
        sentences += parameters.pop("sentences")
    return {
        "schema": 1,
        "seed": seed,
        "model": fitted.name,
        "parameters": parameters,
        "rows": len(measured),
        "held_out": held_out,
        "inputs": list(fitted.inputs),
        "outputs": list(fitted.outputs),
        "components": components,
        "sentences": sentences,
    }


def _parameters(fitted: Model) -> dict[str, Any] | None:
    """What a refit of the physics found, with standard deviations and covariance."""
    from ecm.models.physics.map import PhysicsMap
    from ecm.models.physics.refit import physics_sentences

    if not isinstance(fitted.base, PhysicsMap) or fitted.covariance is None:
        return None
    values, sd = fitted.base.coefficients, np.sqrt(np.diag(fitted.covariance))
    return {
        name: {"value": float(value), "sd": float(error)}
        for name, value, error in zip(fitted.base.parameter_names, values, sd, strict=True)
    } | {
        "covariance": fitted.covariance.tolist(),
        "sentences": physics_sentences(fitted.base, fitted.covariance),
    }


def _held_out(table: Table, model: ModelSpecification, seed: int) -> dict[str, Any] | None:
    """Cross-validated error: ten folds, or halves by group and by random rows for a grouped table.

    Groups are few, so the parts are halves and the figure is the median over many divisions.
    None for the physics model and PCR, and where a part of the rows is too few for the model.
    """
    from ecm.errors import EcmError
    from ecm.models import PhysicsModel

    if isinstance(model, PhysicsModel) or getattr(model, "pcr", None) is not None:
        return None
    try:
        if not table.meta.group:
            found = {"folds": _shares(table, model, _FOLDS, True, [seed])}
            return found | {
                "sentences": [f"held out, share of the spread: {_list(found['folds'])}"]
            }
        seeds = [seed + i for i in range(_HALVINGS)]
        own = _shares(table, model, 2, True, seeds)
        random = _shares(table, model, 2, False, seeds)
    except EcmError:
        return None
    groups = ", ".join(table.meta.group)
    sentences = [
        f"one half held out by {groups}, share of the spread: {_list(own)}",
        f"one half held out by random rows, share of the spread: {_list(random)}",
    ]
    flattered = [column for column in own if random[column] < own[column]]
    if flattered:
        sentences.append(
            f"Random rows flatter the model in {', '.join(flattered)}: trust the split by group."
        )
    return {"by_group": own, "by_random_rows": random, "sentences": sentences}


def _shares(
    table: Table, model: ModelSpecification, folds: int, grouped: bool, seeds: Sequence[int]
) -> dict[str, float]:
    """Held-out RMSE over the spread of each component that is excited, median over the seeds."""
    from ecm.models import cross_validate

    found = [
        cross_validate(table, model, folds=folds, grouped=grouped, seed=number) for number in seeds
    ]
    return {
        column: float(np.median([result.rmse[column] for result in found])) / spread
        for column, spread in found[0].spread.items()
        if spread > 0.0
    }


def _list(shares: dict[str, float]) -> str:
    return ", ".join(f"{column} {share:.2f}" for column, share in shares.items())


def predicted_columns(
    model: Model,
    table: Table,
    stiffness: bool,
    kind: str,
    console: Console,
    *,
    leverage: bool = False,
) -> dict[str, F]:
    """Wrench, its sd where known, and the stiffness; a warning for poses far outside."""
    poses = table.matrix(model.inputs)
    wrench = model.predict(table if model.effects else poses)
    columns = {name: wrench[:, j] for j, name in enumerate(model.outputs)}
    sd = model.predict_sd(poses)
    if sd is not None:
        columns |= {f"sd_{name}": sd[:, j] for j, name in enumerate(model.outputs)}
    if stiffness:
        matrix = model.stiffness(poses, kind)
        short = {name: name.rsplit("_", 1)[0] for name in (*POSE, *WRENCH)}
        found = {
            f"k_{short[force]}_{short[coordinate]}": matrix[:, i, j]
            for i, force in enumerate(model.outputs)
            for j, coordinate in enumerate(model.inputs)
        }
        columns |= {name: found[name] for name in STIFFNESS if name in found}
    if leverage:
        known = model.leverage(poses)
        if known is not None:
            columns["leverage"] = known
        columns["extrapolates"] = model.extrapolates(poses).astype(np.float64)
    _warn_outside(model, table, console)
    return columns


def _warn_outside(model: Model, table: Table, console: Console) -> None:
    outside = np.zeros(len(table), dtype=bool)
    for name, (low, high) in model.domain.items():
        margin = _FAR * (high - low)
        values = table.column(name)
        outside |= (values < low - margin) | (values > high + margin)
    if outside.any():
        console.warn(
            f"{int(outside.sum())} of {len(table)} poses are outside what the model was trained "
            "on: there it extrapolates"
        )


def refit_summary(fitted: Model) -> dict[str, Any]:
    """Values of the effects, what moves together, and the error ladder; the report in words."""
    effects = []
    for item in fitted.effects:
        values = [
            {"name": p.name, "value": float(v), "sd": float(s), "unit": p.unit}
            for p, v, s in zip(item.effect.parameters, item.values, item.sd, strict=True)
        ]
        effects.append({"id": item.id, "frozen": item.frozen, "parameters": values})
    pairs = [{"between": [a, b], "value": value} for a, b, value in fitted.correlations]
    return {
        "schema": 1,
        "model": fitted.name,
        "effects": effects,
        "correlations": pairs,
        "history": [rung.to_dict() for rung in fitted.history],
        "sentences": fitted.fit_report().splitlines(),
    }
