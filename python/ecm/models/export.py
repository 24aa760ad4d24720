"""A model as source code for a controller, or as a MuJoCo file.

What is exported is the mechanism: the base map, effects of physics that act through the pose, and
as steps with a state those of time and temperature. Errors of the instruments stay out, and the
result says which and why.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from ecm._native import export_model, seal_model
from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.cache import write_atomically
from ecm.io.columns import POSE, WRENCH
from ecm.io.interrupts import uninterrupted
from ecm.models.control import ControlLoop, LoopSettings, design_loop
from ecm.models.control.code import loop_file
from ecm.models.folding import folded, noise_sd, poses_in_domain
from ecm.models.model import Model
from ecm.models.mujoco import mujoco_text
from ecm.models.time_effects import time_effects

Target = Literal["c", "rust", "mujoco"]
Precision = Literal["double", "single"]

_SEED = 11
_MOST_FOLDING = 1.0
"""Largest change of a model by folding, over the noise, that is exported without `force`."""


@dataclass(frozen=True)
class Exported:
    """An exported model.

    Examples
    --------
    >>> Exported({"spring.h": "..."}, ("Left out: fts_drift.",), ("fts_drift",)).left_out
    ('fts_drift',)
    """

    files: dict[str, str]
    """Text of each file by its path."""
    notes: tuple[str, ...]
    """What a reader of the files must know."""
    left_out: tuple[str, ...]
    """Ids of the effects that are not in the files."""
    loop: ControlLoop | None = None
    """The control loop of the example, where the model takes a pose to a wrench."""
    folding: float = 0.0
    """Change of the model by folding its effects into the base, over the noise."""


def export(
    model: Model,
    to: Target,
    directory: str | Path,
    *,
    name: str = "ecm_model",
    precision: Precision = "double",
    loop: LoopSettings | None = None,
    force: bool = False,
) -> Exported:
    """Write a model as source code for a controller, or as a MuJoCo file.

    Parameters
    ----------
    model
        The model; effects of the instruments are left out.
    to
        `c`, `rust` (a crate without the standard library) or `mujoco` (linear part, MJCF).
    directory
        Folder to write into; it is made where it does not exist.
    name
        Begins every public name: a lower-case letter, then at most 39 of a-z, 0-9 and _.
    precision
        Floating-point type of the code, `c` and `rust` only: `double` or `single`.
    loop
        Mass, inertia and delay of the robot, for the example of a control loop.
    force
        Write also where folding the effects into the base changes the model by more than the noise.

    Returns
    -------
    Exported
        The files (path to text), notes for their reader, and the effects that were left out.

    Raises
    ------
    InputError
        A wrong name, a model that cannot be exported, or one that folding changes too much.

    Examples
    --------
    >>> import tempfile, numpy as np, ecm
    >>> y = np.linspace(-0.01, 0.01, 9)
    >>> model = ecm.fit(ecm.as_table({"y_m": y, "fy_N": 3000.0 * y}), "linear")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     exported = ecm.export(model, "c", folder, name="spring")
    >>> sorted(exported.files)[:2]
    ['spring.c', 'spring.h']
    """
    exported = export_files(model, to, name, precision, loop)
    if exported.folding > _MOST_FOLDING and not force:
        raise InputError(
            f"{model.name}: with its effects folded into one map the model changes by "
            f"{exported.folding:.2g} times the measurement noise, more than {_MOST_FOLDING:g}: the "
            "controller would not have the model that was fitted. Remove an effect (ecm refit "
            "--remove), or export it all the same with --force."
        )
    with uninterrupted():  # a part of the files is of no use
        for path, text in exported.files.items():
            write_atomically(Path(directory) / path, text)
    return exported


def export_files(
    model: Model,
    target: Target,
    name: str = "ecm_model",
    precision: Precision = "double",
    loop: LoopSettings | None = None,
) -> Exported:
    """Return the files that `export` writes, without writing them."""
    if re.fullmatch(r"[a-z][a-z0-9_]{0,39}", name) is None:
        raise InputError(
            f"name {name!r}: expected a lower-case letter, then at most 39 of a-z, 0-9 and _"
        )
    inside, notes, folding = _mechanism_alone(model)
    timed = time_effects(model, target)
    left_out = tuple(timed.left_out)
    notes = [*timed.sentences(), *notes]
    if target == "mujoco":
        text, lost = _mujoco(inside, name)
        return Exported({f"{name}.xml": text}, (*notes, *lost), left_out, folding=folding)
    sealed = seal_model(json.dumps(inside.document()))
    steps = json.dumps(timed.document) if timed.acting else None
    files = dict(export_model(sealed, name, target=target, precision=precision, effects=steps))
    if (inside.inputs, inside.outputs) != (POSE, WRENCH):
        return Exported(files, tuple(notes), left_out, folding=folding)
    poses = poses_to_hold(model)
    try:
        designed = design_loop(
            poses, inside.base.stiffness(poses, "screw"), loop, stiffer=timed.stiffer
        )
    except InputError as error:
        without = (*notes, f"No control loop: {error}.")
        return Exported(files, without, left_out, folding=folding)
    if designed.holds.any():
        rest = model.rest_pose("a loop with a state")[0] if timed.acting else None
        files |= loop_file(designed, target, name, precision, rest)
    return Exported(files, (*notes, *designed.sentences()), left_out, designed, folding)


def _mechanism_alone(model: Model) -> tuple[Model, list[str], float]:
    """The model without effects beside the pose, those of physics folded into its base.

    Also notes, and the change by folding over the noise.
    """
    acting = {i.id for i in model.effects if i.effect.kind == "pose" and i.effect.side == "physics"}
    bare = replace(model, effects=(), history=(), correlations=())
    if not acting:
        return bare, [], 0.0
    energy, error = folded(model)
    share = float(np.max(error / noise_sd(model)))
    note = (
        f"Folded into {energy.name}: {', '.join(sorted(acting))}; the folded map differs from "
        f"model and effects by at most {share:.2g} of the measurement noise (rms, worst component)."
    )
    return replace(bare, base=energy, covariance=None), [note], share


def poses_to_hold(model: Model, count: int = 200) -> F:
    """(at most count, 6) poses like the measured ones, for which a control loop is designed.

    Those of `poses_in_domain` that lie in the range of every column and do not extrapolate; where
    they are few, also such poses nearer to the middle.
    """
    poses = poses_in_domain(model, 20 * count)
    random = np.random.default_rng(_SEED)
    middle = poses.mean(axis=0)
    nearer = middle + random.uniform(0.2, 1.0, (len(poses), 1)) * (poses - middle)
    found = np.zeros((0, 6))
    for candidates in (poses, nearer):
        if len(found) < count:
            found = np.vstack([found, _measured(model, candidates)])
    return found[:count] if len(found) else poses[:count]


def _measured(model: Model, poses: F) -> F:
    for j, column in enumerate(POSE):
        low, high = model.domain.get(column, (-np.inf, np.inf))
        poses = poses[(low <= poses[:, j]) & (poses[:, j] <= high)]
    return poses[~model.extrapolates(poses)]


def _mujoco(model: Model, name: str) -> tuple[str, list[str]]:
    rest = model.rest_pose("a MuJoCo export")
    wrench = model.base.predict(rest)[0]
    generalised = model.base.stiffness(rest, "generalised")[0]
    symmetric = 0.5 * (generalised + generalised.T)
    poses = poses_in_domain(model, 500)
    exact = model.base.predict(poses)
    linear = wrench + (poses - rest) @ symmetric
    share = np.sqrt(((linear - exact) ** 2).mean(axis=0) / (exact**2).mean(axis=0))
    listed = ", ".join(
        f"{column.rsplit('_', 1)[0]} {100 * s:.0f} %"
        for column, s in zip(WRENCH, share, strict=True)
    )
    lost = [
        "Lost: everything beyond the linear part (stiffening, couplings that grow with the pose).",
        f"Over the range of the training data the wrench is off by (rms share): {listed}.",
    ]
    skew = np.abs(generalised - generalised.T).max() / np.abs(generalised).max()
    if skew > 1e-9:
        lost.append(f"Lost: the skew part of the stiffness, {100 * skew:.2g} % of its largest.")
    return mujoco_text(name, float(rest[0, 0]), wrench, symmetric, lost), lost
