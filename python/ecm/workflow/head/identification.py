"""The controllers of the table, each identified from a campaign on the simulated rig."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ecm.designs import DesignSettings, diagnosable_plan, optimal_design, plain_plan
from ecm.effects.protocol import Effect
from ecm.effects.relaxation import StressRelaxation
from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.columns import POSE
from ecm.io.description import Meta
from ecm.io.mechanism import Mechanism
from ecm.io.table import Table, as_table
from ecm.models import Model, PhysicsModel, fit_model
from ecm.models.maps import EnergyMap
from ecm.rig import CampaignOptions, PlantTable, RigSettings, run_campaign
from ecm.workflow.head.compiled import compile_controller, exportable
from ecm.workflow.head.experiment import Robot
from ecm.workflow.head.neck_wrench import TrueNeck
from ecm.workflow.head.plugin import build_plugin
from ecm.workflow.head.settings import HeadSettings

_RIG = RigSettings(plant=PlantTable(room_cycle_degC=4.0))
"""A room whose heating is felt, so that a campaign can see what temperature does."""
_MIDDLE_M = 0.006
"""How far the tendons and the head press the neck at the middle of its workspace."""
_WORKSPACE = np.array([0.0035, 0.007, 0.007, 0.22, 0.26, 0.26])
"""Half of the box of poses that are worth measuring."""
FORMS: dict[str, Effect] = {"stress_relaxation": StressRelaxation(1.0, second_tau_s=30.0)}
"""Forms of effects that are fitted here: a head moves within a second and rests for minutes, which
one time constant cannot follow."""
DWELLS_S = (0.5, 2.0, 8.0, 30.0, 120.0)
"""Rests before a reading where effects of time are looked for. After 30 s a slow chain carries
so much that it would be taken for static stiffness."""
_EFFECTS = ("stress_relaxation", "hysteresis", "temperature_modulus")


@dataclass(frozen=True)
class Identified:
    """How the model of a row of the table is identified.

    Examples
    --------
    >>> ROWS["energy6, 50 poses"].poses
    50
    """

    model: str = ""
    """Short name of the model; empty: none."""
    poses: int = 0
    """Poses of the campaign."""
    effects: tuple[str, ...] = ()
    """Effects of time that are added and fitted."""
    plan: str = "plain"
    """`plain`: each pose once; `diagnosable`: twice, from two sides, with several dwells."""
    share: float = 1.0
    """Size of the campaign's box over that of the workspace."""


ROWS: dict[str, Identified] = {
    "no model (PD)": Identified(),
    "linear K at rest": Identified("linear", 30, share=0.15),
    "constant curvature": Identified("constant-curvature", 50),
    "cubic, 200 poses": Identified("cubic", 200),
    "energy4, 10 poses": Identified("energy4", 10),
    "energy6, 50 poses": Identified("energy6", 50),
    "physics, 50 poses": Identified("physics", 50),
    "energy6 with effects of time": Identified("energy6", 50, _EFFECTS, "diagnosable"),
    "plant's truth": Identified("truth"),
}
"""The rows of the table, in its order."""


def measured(
    neck: TrueNeck, row: Identified, seed: int, mechanism: Mechanism, *, folder: Path | None = None
) -> Table:
    """Return the table of the campaign of a row, on the true neck.

    Parameters
    ----------
    neck
        The neck; all that is hidden in it acts on the rig as well.
    row
        Which poses, and whether the plan separates effects.
    seed
        Of design and instruments.
    mechanism
        The body that the table's description names.
    folder
        Cache of the rig.
    """
    random = np.random.default_rng([seed, 5])
    rest = neck.rest - [row.share * _MIDDLE_M, 0.0, 0.0, 0.0, 0.0, 0.0]
    box = row.share * _WORKSPACE
    poses = rest + box * random.uniform(-1.0, 1.0, (max(600, 3 * row.poses), 6))
    meta = Meta(mechanism=mechanism.to_dict())
    candidates = as_table(dict(zip(POSE, poses.T, strict=True)), meta=meta)
    kind = row.model if row.model.startswith(("energy", "cubic", "linear")) else "energy4"
    design = DesignSettings(model=kind, length_m=neck.length_m, seed=seed, starts=1, iterations=4)
    try:
        chosen = optimal_design(poses, row.poses, design)
    except InputError:
        chosen = optimal_design(poses, row.poses, replace(design, model="energy4"))
    plan = (
        diagnosable_plan(candidates, chosen, seed=seed, dwells_s=DWELLS_S)
        if row.plan == "diagnosable"
        else plain_plan(candidates, chosen, seed=seed)
    )
    options = CampaignOptions(source=neck, folder=folder, threads=1)
    return run_campaign(plan, _RIG, hide=neck.hidden(), seed=seed, options=options)


def identified(row: Identified, table: Table, mechanism: Mechanism) -> Model:
    """Return the fitted model of a row."""
    kind = PhysicsModel(mechanism) if row.model == "physics" else row.model
    return with_effects(fit_model(table, kind), row.effects, table)


def with_effects(model: Model, effects: Sequence[str], table: Table) -> Model:
    """Return the model fitted again with effects (ids), in the forms of `FORMS`."""
    for effect in effects:
        model = model.add(FORMS.get(effect, effect))
    return model.fit(table) if effects else model


def robot(
    name: str, neck: TrueNeck, settings: HeadSettings, seed: int, folder: Path,
    mechanism: Mechanism,
) -> Robot:  # fmt: skip
    """Identify the model of a row, compile its controller, and return the robot.

    Parameters
    ----------
    name
        Row of `ROWS`.
    neck
        The true neck.
    settings
        The robot.
    seed
        Of the campaign.
    folder
        Where libraries are kept.
    mechanism
        Body of the neck.
    """
    row = ROWS[name]
    plugin = build_plugin(neck.energy, folder)
    if row.model == "truth":
        library = compile_controller(true_model(neck), folder)
        return Robot(settings, neck, library, knows_the_truth=True, plugin=plugin)
    model = None
    if row.model:
        model = identified(row, measured(neck, row, seed, mechanism), mechanism)
        model = exportable(model, _workspace_poses(neck))
    return Robot(settings, neck, compile_controller(model, folder), plugin=plugin)


def true_model(neck: TrueNeck) -> Model:
    """Return the true energy as a model."""
    return Model(EnergyMap(neck.energy))


def _workspace_poses(neck: TrueNeck) -> F:
    random = np.random.default_rng(9)
    middle = neck.rest - [_MIDDLE_M, 0.0, 0.0, 0.0, 0.0, 0.0]
    return np.asarray(middle + _WORKSPACE * random.uniform(-1.0, 1.0, (400, 6)))
