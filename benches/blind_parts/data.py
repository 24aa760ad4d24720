"""The data of a set: a table, the same without noise, and the base that it is diagnosed with."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blind_parts.plans import fem_candidates, model_of, plan_of, rod_candidates
from blind_parts.rod_tables import rod_table
from blind_parts.sets import Set
from blind_parts.strange import STRANGE, Law, smooth_misfit
from blind_parts.strength import Strength
from ecm.effects import Rows
from ecm.io.cache import cache_directory
from ecm.io.columns import WRENCH
from ecm.io.table import Table, read_table
from ecm.models import Model, PhysicsMap
from ecm.models.fit import choose_base
from ecm.models.maps import StiffnessMap
from ecm.regression.noise import declared_noise
from ecm.rig import Campaign, Hidden, RigSettings, fem_source
from ecm.rig.arm.campaign import RobotCampaign

F = NDArray[np.float64]
BASE_ERROR = 0.1
UNEVEN_NOISE = 0.005
_RIG_SAMPLES = 100
"""Sensor samples in a window of the rig's defaults: noise per load is per sample there."""


@dataclass(frozen=True)
class Data:
    """What a method gets (table and model), and what only the scorer sees (quiet)."""

    table: Table
    quiet: Table
    """The table without noise; for the arm, which reads on the way, the table itself."""
    model: Model
    truth: dict[str, Any]
    """What was hidden, so that another campaign can measure the same."""


@lru_cache(maxsize=8)
def shared_plan(source: str, protocol: str, folder: Path) -> Table:
    """The plan of a source, kept in `folder`."""
    path = folder / f"plan-{source}-{protocol}.csv"
    if path.exists():
        return read_table(path)
    candidates = rod_candidates() if source == "rod" else fem_candidates(folder)
    plan = plan_of(candidates, protocol)
    plan.write(path)
    return plan


@lru_cache(maxsize=2)
def _model(is_rod: bool) -> Model:
    return model_of("rod" if is_rod else "rig")


def shared_model(source: str) -> Model:
    """The physics base of a source; kept in the library's own cache."""
    return _model(source == "rod")


@dataclass(frozen=True)
class Sources:
    """Where plans, bases and plants come from."""

    plan: Callable[[str, str, Path], Table] = shared_plan
    model: Callable[[str], Model] = shared_model
    plant: Callable[[Table], Any] = fem_source
    cache: Callable[[], Path] = cache_directory


SHARED = Sources()
"""Those that all sets share."""


def data_of(
    case: Set,
    folder: Path,
    plan: Table | None = None,
    truth: dict[str, Any] | None = None,
    *,
    sources: Sources = SHARED,
) -> Data:
    """Simulate a set; a `plan` of its own and the `truth` of the first for a second experiment."""
    usual = sources.plan(case.source, case.protocol, folder)
    plan = usual if plan is None else plan
    model = sources.model(case.source)
    uneven = UNEVEN_NOISE if case.variant == "noise" else 0.0
    if case.source == "arm":
        table = quiet = _arm(case, plan, sources)
        truth = {}
    elif case.source == "rod":
        base = model.base
        made = rod_table(
            plan,
            case.hidden,
            case.seed,
            base_columns=base.columns,
            uneven_noise=uneven,
            sizes=truth,
            before=None if truth is None else usual,
        )
        table, quiet, truth = made.table, made.quiet, dict(made.sizes)
    else:
        base = choose_base(model, plan)
        table, quiet, truth = _rig(case, plan, truth, base, sources)
    if case.strange:
        table, quiet = _with(STRANGE[case.strange], case.strength, (table, quiet), model, case)
    if case.variant == "base_error":
        before = table.wrenches
        table, quiet = _with(smooth_misfit, BASE_ERROR, (table, quiet), model, case)
        model = _less_sure(model, table.wrenches - before)
    return Data(table, quiet, model, truth)


def _rig(
    case: Set, plan: Table, truth: dict[str, Any] | None, base: StiffnessMap, sources: Sources
) -> tuple[Table, Table, dict[str, Any]]:
    settings = RigSettings()
    if case.variant == "noise":
        settings = replace(
            settings,
            instrument=replace(
                settings.instrument,
                outlier_share=0.01,
                force_noise_per_load=UNEVEN_NOISE * np.sqrt(_RIG_SAMPLES),
            ),
        )
    campaign = Campaign(
        plan,
        settings,
        sources.plant(plan),
        hide=[Hidden(id, s, (truth or {}).get(id, ())) for id, s in case.hidden],
        seed=case.seed + (0 if truth is None else 1_000_000),
        folder=sources.cache(),
        base_columns=base.columns,
    )
    table = campaign.run()
    silent: dict[str, Any] = dict.fromkeys(
        ("force_noise_N", "torque_noise_Nm", "force_noise_per_load", "camera_error_m",
         "camera_error_rad", "camera_jitter_m", "camera_jitter_rad", "thermometer_noise_degC"),
        0.0,
    )  # fmt: skip
    # Counts are noise as well: without the samples' scatter every reading, and the zero that many
    # rows share, would be off by up to half a count.
    silent["fts_resolution"] = (0.0,) * 6
    campaign.settings = replace(settings, instrument=replace(settings.instrument, **silent))
    hidden = {
        injected.truth.effect: tuple(sorted(injected.truth.parameters().items()))
        for injected in campaign.injected
    }
    return table, campaign.run(), hidden


def _arm(case: Set, plan: Table, sources: Sources) -> Table:
    """The arm moves, bends and settles at each visit; strengths are those beyond E alone."""
    settings = RigSettings.from_dict({"rig": {"mode": "robot"}})
    return RobotCampaign(
        plan,
        settings,
        sources.plant(plan),
        hide=[Hidden(id, s) for id, s in case.hidden],
        seed=case.seed,
        folder=sources.cache(),
    ).run(threads=1)


def _with(
    law: Law, strength: float, tables: tuple[Table, Table], model: Model, case: Set
) -> tuple[Table, Table]:
    """Both tables with a law's wrench of a strength on the rows that measure a pose."""
    table, quiet = tables
    wrench = law(quiet, np.random.default_rng([case.seed, 9]))
    rows = Rows(quiet, model.base)
    is_pose = np.asarray(quiet.text("kind") == "pose")
    covariance = declared_noise(table).covariance(Rows(table, model.base))
    columns = np.asarray(choose_base(model, table).columns(rows.poses))
    scale = Strength(covariance[is_pose], columns[is_pose])
    wrench = wrench * is_pose[:, None]
    size = strength / scale(wrench[is_pose])
    return _added(table, size * wrench), _added(quiet, size * wrench)


def _added(table: Table, wrench: F) -> Table:
    return table.with_columns(
        {name: table.column(name) + wrench[:, j] for j, name in enumerate(WRENCH)}
    )


def _less_sure(model: Model, misfit: F) -> Model:
    """The model with a base that states how wrong it is."""
    base = model.base
    if not isinstance(base, PhysicsMap):
        raise TypeError(f"expected a physics base, found {base.kind}")
    own = np.hypot(base.own_error, np.sqrt(np.mean(misfit**2, axis=0)))
    return replace(model, base=replace(base, own_error=own))
