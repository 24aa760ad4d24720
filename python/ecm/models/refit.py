"""Refit of a model with effects added or removed, whether it may be saved, and what it brings.

With few rows of many columns no test of a residual can show what a model lacks; the base can.

An error counts as worse where it exceeds the other by a tenth and by more than the noise of a row.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from ecm.effects.protocol import Effect
from ecm.errors import ComputationError, EcmError, ModelError, Remedy, remedy_of
from ecm.io.arguments import listed
from ecm.io.arrays import B, F, eigh, rms
from ecm.io.columns import POSE, WRENCH, unit_of
from ecm.io.events import Progress
from ecm.io.table import MetaLike, Table, TableLike, takes_table
from ecm.models.errors import errors_and_noise, held_out, is_far_less, residuals
from ecm.models.evaluation import on_what_is_measured
from ecm.models.fit import as_model, choose_base, fit_base, fit_rows, refuse_unused_inputs
from ecm.models.fit_summary import quick_shares
from ecm.models.joint_fit import FittedEffect, joint_fit
from ecm.models.maps import CHOOSE, EnergyMap, PolynomialMap
from ecm.models.measured_poses import has_rows_of_fit
from ecm.models.model import Model
from ecm.models.physics.map import PhysicsMap
from ecm.models.physics.refit import PhysicsModel, physics_prior, sizes_that_fit
from ecm.models.registry import parse_model
from ecm.models.specimen import of_other_specimen, said_of, specimen_of
from ecm.regression.blas import one_blas_thread
from ecm.regression.folds import spread_rows, without_zero_readings
from ecm.regression.noise import Noise
from ecm.regression.normal_equations import MANY_ROWS
from ecm.regression.rows import Rows, naming_outliers

FAR_BEYOND_NOISE = 2.2
"""Error over the noise that a noise stated half as large does not explain."""
_TIMES = 2.0
"""A model that errs so many times as much as a base fitted to the rows lacks something."""


def is_far_behind(error: float, of_base: float) -> bool:
    """Whether a model errs far beyond the noise and a base fitted to the rows does not.

    Parameters
    ----------
    error, of_base
        Over the noise, of the model as it stands and of the base on held-out rows.

    Examples
    --------
    >>> is_far_behind(6.0, 1.1), is_far_behind(6.0, 5.0), is_far_behind(1.9, 0.5)
    (True, False, False)
    """
    return error > max(FAR_BEYOND_NOISE, _TIMES * of_base)


def base_and_error(model: Model, table: Table, noise: Noise) -> tuple[str, float] | None:
    """The name and the held-out error over the noise of the base that names would be against.

    Returns
    -------
    tuple or None
        None where these rows cannot carry a base.
    """
    kept = without_zero_readings(table)
    try:
        base = choose_base(model, kept)
        if noise.components is not None and base.outputs != model.outputs:
            return None  # noise of other columns
        error = held_out(joint_fit(base, (), kept, noise))
    except (EcmError, np.linalg.LinAlgError):
        return None
    return None if error is None else (base.name, error)


_WORSE = 1.1
_ONE_COLUMN = 0.99
"""Correlation from which a parameter and a coefficient of the base are one column."""
_SD = 3.0
"""Standard deviations of the interval of a stiffness."""
_MOST_MOVE = 0.05
"""Share of the stiffness by which one that is not determined may move."""


def refuse_worse(
    fitted: Model,
    table: Table,
    *,
    before: Model | None = None,
    held_out: Mapping[str, float] | None = None,
    chosen: bool = False,
) -> None:
    """Refuse a fitted model that is worse on a table than another, or than the mean.

    Parameters
    ----------
    fitted
        The model that was fitted to the table.
    table
        Its rows.
    before
        The model before, for example without the effect that was added.
    held_out
        Held-out error of each component over its spread; 1 is the mean of the readings.
    chosen
        Whether held-out rows chose it: then no other model is a way out. It may lack an effect,
        such as a weight, which no function of the pose holds and the diagnosis names.

    Raises
    ------
    ComputationError
        With each component that is worse, and the command that works, where one does.

    Examples
    --------
    >>> import ecm
    >>> x = np.linspace(-1e-3, 1e-3, 12)
    >>> table = ecm.as_table({"x_m": x, "fx_N": 1e4 * x})
    >>> model = ecm.fit_model(table, "linear")
    >>> refuse_worse(model, table, held_out={"fx_N": 0.1})
    >>> refuse_worse(model, table, held_out={"fx_N": 4e8})
    Traceback (most recent call last):
    ecm.errors.ComputationError: the fit is no model of these data: on held-out rows fx_N errs \
4e+08 times its spread, where the mean errs once
    Let held-out rows choose the model:
      better = ecm.fit(table, "choose")
    """
    if before is not None:
        refuse_addition(fitted, table, before)
    fitted = on_what_is_measured(fitted, table)
    errors, noise = errors_and_noise(fitted, table)
    reasons = _worse_than_mean(fitted, table, errors, noise, held_out or {})
    if isinstance(fitted.base, PhysicsMap) and fitted.base.factor < 0.0:
        reasons.append(f"its modulus is {fitted.base.factor:.2g} times the stated one")
    if not reasons:
        return
    said, remedy = f"the fit is no model of these data: {'; '.join(reasons)}", CHOOSE
    steady = _leaves_a_constant(fitted, table, noise)
    if steady:
        said += "; most of what it leaves is one constant wrench, as of a payload or of a zero"
    if steady or chosen:
        name = "choose" if chosen else fitted.base.name
        again = f"ecm fit DATA --model {name} --out OUT --force"
        remedy = Remedy(
            "an effect may be missing, which ecm diagnose can name beside this model; save it all "
            "the same",
            again,
            force=True,
        )
    raise ComputationError(f"{said}{_why(fitted, table)}", remedy=remedy)


def refuse_unless_forced(name: str, *given: Any, **known: Any) -> None:
    """`refuse_worse` in the words of a function of Python, which has `force`."""
    try:
        refuse_worse(*given, **known)
    except ComputationError as error:
        said = f"{name}: {error.message}; force=True returns it all the same"
        raise ComputationError(said, remedy=error.remedy) from None


def _why(fitted: Model, table: Table) -> str:
    """What a body leaves open: it has E and nu, and no coefficients to spare."""
    if fitted.base.kind != "physics":
        return ""
    found = sizes_that_fit(fitted.base, table, fitted.noise)
    other = "; [mechanism] states another body, or columns are misread (ecm check shows them)"
    return found or other


def refuse_addition(fitted: Model, table: Table, before: Model) -> None:
    """Refuse a model with an effect more that is worse than the one before it."""
    reasons = objections(fitted, table, before)
    if (better := _better_base(fitted, table)) is not None:
        raise ComputationError(
            f"on held-out rows the new model errs {fitted.history[-1].held_out:.3g} times the "
            f"noise, {fitted.history[-1].held_out / better[1]:.3g} times as much as {better[0]} "
            "without any effect: what is missing is a better base"
            + "".join(f"; {reason}" for reason in reasons),
            remedy=remedy_with_base(better[0], (), table) or CHOOSE,
        )
    if reasons:
        raise ComputationError(
            f"the new model is worse than the one before it: {'; '.join(reasons)}",
            remedy=_another_base(fitted, table),
        )


def objections(fitted: Model, table: Table, before: Model) -> list[str]:
    """What makes a model with an effect more worse than the one before it; empty where nothing.

    Parameters
    ----------
    fitted
        The model with the effect.
    table
        Rows that it was fitted to.
    before
        The model without it.
    """
    fitted, before = on_what_is_measured(fitted, table), on_what_is_measured(before, table)
    errors, noise = errors_and_noise(fitted, table)
    return [
        *_worse_than(before, fitted, table, errors, noise),
        *_worse_held_out(fitted),
        *undetermined(fitted, table, before),
    ]


def undetermined(fitted: Model, table: Table, before: Model) -> list[str]:
    """What these rows cannot tell of a base and the effect that was added to it.

    An effect that is one with coefficients of the base, of which the fit takes the smallest: zero.
    A parameter at its bound that is one with a coefficient of the base, or of an effect of which
    none is known and one is one with that of another effect. A stiffness at rest that has left the
    interval that the rows gave it without the effect, although they do not determine
    it with the effect; one that was positive and is not any more.
    """
    fitted, before = on_what_is_measured(fitted, table), on_what_is_measured(before, table)
    bounds = {
        f"{item.id}.{parameter.name}": item.values[j]
        for item in fitted.effects
        for j, parameter in enumerate(item.effect.parameters)
        if not item.frozen and item.at_bounds[j]
    }
    alone = [
        f"{item.id} is one with coefficients of {fitted.base.name}: these rows tell only their sum"
        for item in fitted.effects
        if fitted.training.get("smallest_taken") and not item.frozen and item.taken.all()
    ]
    of_effects = {name for name, own in fitted.params.items() if own.effect != "base"}
    reasons = [
        f"{name} = {bounds[name]:.3g} is at its bound and one with {other} of the base ({r:+.3f})"
        for other, name, r in fitted.correlations
        if name in bounds and other not in of_effects and abs(r) > _ONE_COLUMN
    ]
    free = [item for item in fitted.effects if not item.frozen]
    unsure = {item.id for item in free if np.all(np.abs(item.values) < _SD * item.sd)}
    pairs = [
        f"{name} is not known and one with {other} ({r:+.3f})"
        for pair in fitted.correlations
        for (name, other), r in ((pair[:2], pair[2]), (pair[1::-1], pair[2]))
        if {name, other} <= of_effects and abs(r) > _ONE_COLUMN
        if fitted.params[name].effect in unsure - {fitted.params[other].effect}
    ]
    return alone + reasons[:1] + pairs[:1] + _stiffness_moves(fitted, table.measured(), before)


def _stiffness_moves(fitted: Model, table: Table, before: Model) -> list[str]:
    if fitted.base_frozen or fitted.covariance is None:
        return []
    table = table.subsample(spread_rows(table, MANY_ROWS))
    fit = joint_fit(before.base, before.effects, table, fitted.noise, kept=before.kept)
    fit = fit.in_slow_noise()
    k = len(fit.base.coefficients)
    alone = replace(before, base=fit.base, effects=fit.effects, covariance=fit.covariance[:k, :k])
    rest = Rows(table, fitted.base).middle_pose[None]
    old, new = alone.stiffness(rest)[0], fitted.stiffness(rest)[0]
    known, own = alone.stiffness_sd(rest), fitted.stiffness_sd(rest)
    if known is None or own is None:
        return []
    # What the model lacks without the effect widens the interval.
    wide = max(1.0, rms(fit.whitened))
    move, size = np.abs(new - old), np.abs(old)
    if old.shape[0] == old.shape[1]:  # a coupling is small beside what it couples
        size = np.sqrt(np.outer(np.diag(size), np.diag(size)))
    moved = (move > _SD * wide * known[0]) & (move < _SD * own[0]) & (move > _MOST_MOVE * size)
    places = sorted(zip(*np.nonzero(moved), strict=True), key=lambda at: -move[at] / size[at])
    reasons = [
        f"K({fitted.outputs[i]}, {fitted.inputs[j]}) at rest moves from {old[i, j]:.4g} to "
        f"{new[i, j]:.4g} +- {own[0, i, j]:.2g}, which these rows do not determine"
        for i, j in places[:1]
    ]
    return reasons + _lost_signs(fitted, old, new, own[0], old > _SD * wide * known[0])


def _lost_signs(fitted: Model, old: F, new: F, sd: F, positive: B) -> list[str]:
    """The direction in which the stiffness at rest was surely positive and is not any more."""
    pairs = [
        (fitted.outputs.index(output), fitted.inputs.index(name))
        for name, output in zip(POSE, WRENCH, strict=True)
        if name in fitted.inputs and output in fitted.outputs
    ]
    pairs = [pair for pair in pairs if positive[pair]]
    if not pairs:
        return []
    rows, columns = map(list, zip(*pairs, strict=True))
    root = np.sqrt(np.diag(old[np.ix_(rows, columns)]))

    def least(stiffness: F) -> tuple[float, int]:
        """The least eigenvalue, and the pair with the largest part in its direction."""
        block = stiffness[np.ix_(rows, columns)] / np.outer(root, root)
        values, vectors = eigh((block + block.T) / 2.0)
        return float(values[0]), int(np.abs(vectors[:, 0]).argmax())

    value, largest = least(new)
    if least(old)[0] <= 0.0 or value > 0.0:
        return []
    i, j = pairs[largest]
    return [
        "the stiffness at rest, positive before, has a direction in which it is not any more: "
        f"K({fitted.outputs[i]}, {fitted.inputs[j]}) {old[i, j]:.3g} -> {new[i, j]:.3g} +- "
        f"{sd[i, j]:.2g}"
    ]


def _better_base(fitted: Model, table: Table) -> tuple[str, float] | None:
    """The base that errs far less without the effect than the model does with it, and its error."""
    if not fitted.history or fitted.noise.is_residual:
        return None
    error = fitted.history[-1].held_out
    if not is_far_behind(error, 0.0):
        return None
    base = base_and_error(fitted, table, fitted.noise)
    if base is None or not is_far_behind(error, base[1]) or base[0] == fitted.base.name:
        return None
    return base


@dataclass(frozen=True)
class OtherBase(Remedy):
    """The command that fits another base with effects."""

    held_out: float = np.inf
    """Error over the noise of what it fits."""


def remedy_with_base(
    name: str, effects: Sequence[Effect], table: Table, most_error: float = np.inf
) -> OtherBase | None:
    """The command that fits a base with effects; None where it would be refused, or errs more.

    Parameters
    ----------
    most_error
        Held-out error over the noise up to which it is a way out.
    """
    try:
        specification = parse_model(name)
        refuse_unused_inputs(table, specification)
        base = fit_rows(table, specification)
        found = base.add(*effects).fit(table, with_ceiling=False)
        if (error := found.history[-1].held_out) > most_error:
            return None
        shares = None if effects else quick_shares(table, specification, base.base)
        refuse_worse(found, table, held_out=shares)
        if effects and (objections(found, table, base) or _better_base(found, table) is not None):
            return None
    except (EcmError, np.linalg.LinAlgError):
        return None
    added = "".join(f" --add {effect.id}" for effect in effects)
    return OtherBase(
        f"fit {found.name.replace('+', ' with ', 1).replace('+', ' and ')}, which errs {error:.3g} "
        f"times {found.noise.unit} on held-out rows",
        f"ecm fit DATA --model {name}{added} --out OUT",
        held_out=error,
    )


_ROWS_OF_OTHERS = 2000
"""Rows on which other bases are tried first."""


def _base_that_holds(
    fitted: Model, effects: Sequence[Effect], table: Table, most: float
) -> tuple[str, OtherBase] | None:
    """The first of other bases that holds these effects and errs no more than that, if one does."""
    six = table.has(*POSE, *WRENCH[:3])
    names = ["physics"] if table.physics_body is not None and six else []
    if six and fitted.known_length_m is not None:
        driven = ["actuated4", "actuated5", "actuated3"]
        names += driven if table.actuation_columns else ["energy6", "energy5", "energy4"]
    names += [f"poly:{degree}" for degree in (3, 2, 1)]
    # Most of several bases are refused, which fewer rows show; what they allow is asked of all.
    few = table.subsample(spread_rows(table, _ROWS_OF_OTHERS))
    for name in names:
        if name == fitted.base.name:
            continue
        found = remedy_with_base(name, effects, few, most)
        if found is not None and len(few) < len(table):
            found = remedy_with_base(name, effects, table, most)
        if found is not None:
            return name, found
    return None


def _another_base(fitted: Model, table: Table) -> Remedy:
    """The command that adds the same effects to a base that holds them, where there is one."""
    before = fitted.history[-2].held_out if len(fitted.history) > 1 else np.inf
    effects = [item.effect for item in fitted.effects]
    if (found := _base_that_holds(fitted, effects, table, before)) is not None:
        return found[1]
    six = table.has(*POSE, *WRENCH[:3])
    if table.physics_body is not None and six:
        return Remedy("do without it, or add something else")
    if not six:  # no physics can tell the stiffness
        return Remedy(
            "first record what tells it from the stiffness, as NEXT of ecm diagnose says, or "
            "add it for predictions alone (ecm refit --force)"
        )
    return Remedy(
        "do without it, or describe the body in [mechanism] of the data's TOML: its physics knows "
        "the stiffness"
    )


def _worse_than(before: Model, fitted: Model, table: Table, errors: F, sd: F) -> list[str]:
    old, _ = errors_and_noise(before, table)
    return [
        f"{name} errs {error:.3g} {unit_of(name)}, before {other:.3g}"
        for name, error, other, noise in zip(fitted.outputs, errors, old, sd, strict=True)
        if _is_worse(error, other, noise)
    ]


def _worse_held_out(fitted: Model) -> list[str]:
    """Compare the last two records of the fit history, where they are of the same rows."""
    records = fitted.history[-2:]
    if len(records) < 2 or records[0].rows != records[1].rows:
        return []
    first, second = (record.held_out for record in records)
    # Below a noise that is known no error tells which model is better.
    floor = 0.0 if fitted.noise.is_residual else 1.0
    if second <= max(_WORSE * first, floor):
        return []
    return [f"on held-out rows it errs {second:.3g} times {fitted.noise.unit}, before {first:.3g}"]


def _worse_than_mean(
    fitted: Model, table: Table, errors: F, sd: F, held_out: Mapping[str, float]
) -> list[str]:
    spread = table.matrix(fitted.outputs)[table.of_poses].std(axis=0)
    reasons = []
    for name, error, own, noise in zip(fitted.outputs, errors, spread, sd, strict=True):
        unit = unit_of(name)
        if _is_worse(error, own, noise):
            reasons.append(f"{name} errs {error:.3g} {unit}, the mean of its readings {own:.3g}")
        elif _is_worse(held_out.get(name, 0.0) * own, own, noise):
            reasons.append(
                f"on held-out rows {name} errs {held_out[name]:.3g} times its spread, where the "
                "mean errs once"
            )
    return reasons


def _leaves_a_constant(fitted: Model, table: Table, sd: F) -> bool:
    """Whether a model is no worse than the mean but for a wrench that is in all rows.

    The mean of the readings takes such a wrench in; an energy that is at rest somewhere does not,
    and a model with more freedom takes it in as stiffness, where no diagnosis finds it.
    """
    loaded = table.of_poses
    left = (table.matrix(fitted.outputs) - fitted.readings(table, skip_untestable=True))[loaded]
    own, scatter = table.matrix(fitted.outputs)[loaded].std(axis=0), left.std(axis=0)
    steady = (np.abs(left.mean(axis=0)) > np.hypot(scatter, sd)).any()
    return bool(steady) and not any(map(_is_worse, scatter, own, sd))


def _is_worse(error: float, other: float, noise: float) -> bool:
    return not error <= max(_WORSE * other, float(np.hypot(other, noise)))


@takes_table()
@one_blas_thread()
def refit(
    model: Model,
    table: TableLike,
    *,
    meta: MetaLike = None,
    add: str | Effect | Sequence[str | Effect] = (),
    remove: str | Sequence[str] = (),
    freeze: str | Sequence[str] = (),
    force: bool = False,
    progress: Progress | None = None,
) -> Model:
    """Fit a model again to a table, as it is or with an effect more or less.

    Parameters
    ----------
    model
        The model before.
    table
        Measured rows (N), as a table, a data frame, a dict or a file.
    meta
        Description of the data, as a dict of what the TOML beside it would hold, or that file.
    add
        Effects, or their ids, that the model lacks. One alone needs no list.
    remove
        Ids of effects that it has and shall not have. One alone needs no list.
    freeze
        Ids of effects whose values are kept; `base` keeps the base, and `form` keeps it up to one
        factor on its loads, as of another specimen. One alone needs no list.
    force
        Return also a model that `refuse_worse` refuses, as `ecm refit --force` saves it.
    progress
        Called with the part that is done, the whole, and the step that begins.

    Returns
    -------
    Model
        Base and effects fitted together; `history` says what each change was worth. Where these
        rows cannot tell an added effect from the stiffness of the base, and the table states a
        body, the base is held near the physics of that body (`ecm.models.physics.refit`).

    Raises
    ------
    InputError
        An unknown id, or an effect that the table cannot test.
    ComputationError
        The new model is worse than the one before, or than the mean of the readings.

    Examples
    --------
    >>> import numpy as np, ecm
    >>> from ecm.io.columns import POSE, WRENCH
    >>> time_s = np.arange(20.0)
    >>> poses = np.random.default_rng(0).uniform(-0.01, 0.01, (20, 6))
    >>> wrenches = 1000.0 * poses
    >>> wrenches[:, 1] += 0.05 * time_s
    >>> rows = np.column_stack([poses, wrenches, time_s]).T
    >>> table = ecm.as_table(dict(zip([*POSE, *WRENCH, "time_s"], rows)))
    >>> model = ecm.refit(ecm.fit(table, "linear"), table, add="fts_drift")
    >>> print(model.fit_report().splitlines()[3])
        fy_rate = 0.05 +- 0.016 N/s
    """
    add, remove, freeze = listed(add), listed(remove), listed(freeze)
    model = as_model(model, table)
    fitted = _changed(model, table, add, remove, freeze, progress)
    if not force:
        # Without an effect a model errs more: that was asked for.
        refuse_unless_forced("refit", fitted, table, before=None if remove else model)
    return fitted


def _changed(
    model: Model,
    table: Table,
    add: Sequence[str | Effect],
    remove: Sequence[str],
    freeze: Sequence[str],
    progress: Progress | None = None,
    *,
    with_ceiling: bool = True,
) -> Model:
    """Fit a model with effects added, removed or kept."""
    specimen: FittedEffect | None = None
    if "form" in freeze:
        freeze = ["base" if name == "form" else name for name in freeze]
        specimen = specimen_of(model.remove(*remove).add(*add).freeze(*freeze), table)
        model = of_other_specimen(model, specimen)
    changed = model.remove(*remove).add(*add).freeze(*freeze)
    with naming_outliers(table):
        try:
            fitted = changed.fit(table, with_ceiling=with_ceiling, progress=progress)
            if specimen is not None:
                of_form = {"form": {"sentence": said_of(specimen)}}
                fitted = replace(fitted, training={**fitted.training, **of_form})
        except ModelError as error:
            if not add:
                raise
            raise ComputationError(str(error), remedy=_another_base(changed, table)) from error
        before = model.remove(*remove)
        one_column = fitted.training.get("smallest_taken", False)
        if not add or not (one_column or undetermined(fitted, table, before)):
            return fitted
        held = _held_near_physics(changed, table, with_ceiling)
        return fitted if held is None or undetermined(held, table, before) else held


def _held_near_physics(changed: Model, table: Table, with_ceiling: bool) -> Model | None:
    """The changed model fitted with the physics of the stated body as a prior.

    None where no body is stated, and for a base that is no free map of all columns.
    """
    free = isinstance(changed.base, EnergyMap | PolynomialMap) and not changed.base_frozen
    known = table.physics_body is not None and table.has(*POSE, *WRENCH)
    if not free or not known or changed.inputs != POSE:
        return None
    stated = fit_base(table, PhysicsModel())
    physics = replace(changed, base=stated, history=()).fit(table, with_ceiling=False)
    base, rows = cast(PhysicsMap, physics.base), without_zero_readings(table)
    prior = physics_prior(changed.base, base, physics.effects, rows, physics.noise)
    return changed.fit(table, prior=prior, with_ceiling=with_ceiling)


@dataclass(frozen=True)
class Addition:
    """What the named effects bring to the model that was given.

    Examples
    --------
    >>> found = Addition(("payload",), 1.48, 1.18, "", Remedy("add it", "ecm refit MODEL DATA"))
    >>> found.to_dict()["held_out"]
    {'before': 1.48, 'after': 1.18}
    """

    effects: tuple[str, ...]
    before: float | None
    """Held-out error over the noise of the model fitted to these rows; None where not known."""
    after: float | None
    """The same with the effects."""
    refused: str
    """Why `ecm refit` would refuse, or that they bring nothing; empty where they are added."""
    remedy: Remedy | None
    """The command that adds them: to this model, else to one that holds them, or errs far less."""
    base: str | None = None
    """The base of the command where it is another one because that errs far less."""
    removed: tuple[str, ...] = ()
    """Effects of the model in whose place they come: beside them the rows do not need these."""

    def is_better(self, other: Addition) -> bool:
        """Whether the given model takes it and errs far less than by the command of another.

        Less is enough where it does not take the other.

        Examples
        --------
        >>> stop = Addition(("kink",), 22.1, 11.8, "", None)
        >>> smooth = Addition(("higher_degree",), 22.1, 48.1, "it is worse", None)
        >>> stop.is_better(smooth), smooth.is_better(stop)
        (True, False)
        """
        if self.refused or self.after is None:
            return False
        if other.refused:
            way = other.remedy
            return self.after < (way.held_out if isinstance(way, OtherBase) else np.inf)
        reached = other.remedy.held_out if isinstance(other.remedy, OtherBase) else other.after
        return reached is None or is_far_less(self.after, reached)

    def to_dict(self) -> dict[str, Any]:
        """For the report: plain values."""
        return {
            "effects": list(self.effects),
            "removed": list(self.removed),
            "held_out": {"before": self.before, "after": self.after},
            "refused": self.refused,
            "remedy": None if self.remedy is None else self.remedy.to_dict(),
            "base": self.base,
        }


def addition_to(
    model: Model,
    table: Table,
    effects: Sequence[Effect],
    richer: str = "",
    against: str = "",
    *,
    freeze: str = "",
) -> Addition | None:
    """Add effects to a model as `ecm refit` does, or fit those that it has anew; else None.

    Parameters
    ----------
    model
        The model that was given.
    table
        Rows that it is fitted to.
    effects
        Those that are named.
    richer
        A base that leaves far less beside them: the way, where it errs less on held-out rows too.
    against
        The base that they were named against: the way where this model cannot take them, or errs
        far beyond the noise on held-out rows and twice as much as that base.
    freeze
        What is kept of the base, as `refit` takes it: they were named against the base as it is.
    """
    if {effect.id for effect in effects} <= {item.id for item in model.effects}:
        return _fitted_anew(model, table, effects, freeze or "base")
    found = _added(model, table, effects, richer, against, freeze)
    if found.refused and not has_rows_of_fit(model, table):
        # A base of these rows alone may hold less, or have no need of what its kept values have.
        kept = found if freeze else _added(model, table, effects, richer, against, "base")
        again = _fitted_anew(model, table, effects, freeze or "base") if kept.refused else kept
        return again or found
    return found


def _added(
    model: Model,
    table: Table,
    effects: Sequence[Effect],
    richer: str,
    against: str,
    freeze: str,
) -> Addition:
    """What `addition_to` says of effects of which some are new to the model, with one way to it."""
    present = {item.id: item.effect for item in model.effects}
    new = [effect for effect in effects if effect.id not in present]
    free = {item.id for item in model.effects if not item.frozen}
    ids, anew = tuple(effect.id for effect in new), [e.id for e in effects if e.id in free]
    table = table.subsample(spread_rows(table, MANY_ROWS))  # those that every fit here would choose
    most = np.inf
    try:
        keep = (freeze,) if freeze else ()
        found = _changed(model, table, new, (), keep, with_ceiling=False)
        first = found.history[-2]
        if first.rows != found.history[-1].rows:  # of the model as it was fitted to others
            first = _changed(model, table, (), (), keep, with_ceiling=False).history[-1]
        most = first.held_out
        # Those whose values change may have stood for what is new: then they are no longer needed.
        with suppress(EcmError, np.linalg.LinAlgError):
            fewer = _changed(model, table, new, anew, keep, with_ceiling=False) if anew else found
            more, less = found.history[-1], fewer.history[-1]
            if more.bic_fall(less) <= 0.0 or more.held_out >= less.held_out:
                found, present = fewer, {id: e for id, e in present.items() if id not in anew}
        refuse_addition(found, table, model)
        own = has_rows_of_fit(model, table)
        stands = np.inf if own else _error_of(model, table, found.noise)
    except (EcmError, np.linalg.LinAlgError) as error:
        said, way = getattr(error, "message", str(error)), None
        if against and against != model.base.name:
            way = remedy_with_base(against, [*present.values(), *new], table, most)
        return Addition(ids, None, None, said, way or remedy_of(error))
    before, last = first.held_out, found.history[-1]
    after = last.held_out
    known = not found.noise.is_residual
    removed = tuple(item.id for item in model.effects if item.id not in present)
    words = [f"remove {' and '.join(removed)}"] if removed else []
    frozen = [f"--freeze {name}" for name in keep]
    named = *(f"--remove {id}" for id in removed), *(f"--add {id}" for id in ids)
    options = " ".join([*named, *frozen])
    command = Remedy(
        ", ".join([*words, f"add {' and '.join(ids)}"]), f"ecm refit MODEL DATA {options} --out OUT"
    )
    # Of a degree too many what it leaves is small, and what it errs where no row was is not.
    far = not richer and against != model.base.name and after > FAR_BEYOND_NOISE
    other, most = (against, after / _TIMES) if far else (richer, after)
    every = [*present.values(), *new]
    better = remedy_with_base(other, every, table, most) if other else None
    if far and better is None and freeze == "":
        other, better = _base_that_holds(found, every, table, most) or (other, None)
    held = "prior" in found.training  # near the physics: its coefficients are no free ones
    no_less = after >= before or (not held and last.bic_fall(first) <= 0.0)
    if known and not better and no_less and against not in ("", model.name):
        # It may hold already what the base lacks that they were named against.
        errs = "less with it, which may be chance" if after < before else "no less with it"
        return Addition(ids, before, after, f"it errs {errs}", None)
    if known and stands <= (most if better else after):
        errs = f"here it errs {stands:.3g} times the noise as it stands, fitted to these rows alone"
        return Addition(ids, before, after, errs, None)
    return Addition(
        ids,
        before if known else None,
        after if known else None,
        refused="",
        remedy=better or command,
        base=other if better else None,
        removed=removed,
    )


def _fitted_anew(
    model: Model, table: Table, effects: Sequence[Effect], keep: str
) -> Addition | None:
    """Fit a model anew to these rows, also its base only where keeping it leaves far more."""
    found: tuple[float, Addition] | None = None
    for kept in (keep, ""):
        with suppress(EcmError, np.linalg.LinAlgError):
            again = _changed(model, table, (), (), [kept] if kept else [], with_ceiling=False)
            refuse_addition(again, table, model)
            after, before = again.history[-1].held_out, _error_of(model, table, again.noise)
            if is_far_less(after, before if found is None else found[0]):
                options = f" --freeze {kept}" if kept else ""
                remedy = Remedy("fit it anew", f"ecm refit MODEL DATA{options} --out OUT")
                ids = tuple(effect.id for effect in effects)
                found = after, Addition(ids, None, None, "", remedy)
    return None if found is None else found[1]


def _error_of(model: Model, table: Table, noise: Noise) -> float:
    """The error of a model as it stands on these rows, over their noise."""
    said = model.readings(table, skip_untestable=True)
    left = residuals(Rows(table, model.base), said, noise, model.base.error)
    return rms(left.whitened[table.of_poses])


def refit_summary(model: Model) -> dict[str, Any]:
    """Return values of the effects, correlations and fit history, and the fit report in words."""
    effects = []
    for item in model.effects:
        values = [
            {"name": p.name, "value": value, "sd": sd, "unit": p.unit}
            for p, value, sd in item.listed
        ]
        effects.append({"id": item.id, "frozen": item.frozen, "parameters": values})
    pairs = [{"between": [a, b], "value": value} for a, b, value in model.correlations]
    return {
        "schema": 1,
        "model": model.name,
        "effects": effects,
        "correlations": pairs,
        "history": [record.to_dict() for record in model.history],
        "sentences": model.fit_report().splitlines(),
    }
