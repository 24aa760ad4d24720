"""A model as source code for a controller, or as a MuJoCo file.

What is exported is the mechanism: the base map, and effects of physics that act through the
pose. Effects of instruments, of time and of temperature stay out, and the result says which.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from ecm._native import EnergyModel, export_model, rotation_matrices, seal_model
from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.cache import write_atomically
from ecm.io.columns import POSE, WRENCH
from ecm.io.interrupts import uninterrupted
from ecm.models.control import ControlLoop, LoopSettings, design_loop
from ecm.models.control.code import loop_file
from ecm.models.maps import EnergyMap, Symmetry
from ecm.models.model import Model
from ecm.models.mujoco import mujoco_text
from ecm.models.physics.map import PhysicsMap

Target = Literal["c", "rust", "mujoco"]
Precision = Literal["double", "single"]

_POSES = 2000
_SEED = 11
_MOST_FOLDING = 1.0
"""Largest change of a model by folding, over the noise, that is exported without `force`."""
_SMALL_ERROR = 0.15
"""An energy whose error over the noise is smaller is near enough to fold effects into."""


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
        The model; effects that do not act through the pose are left out.
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
    inside, left_out, notes, folding = _mechanism_alone(model)
    if target == "mujoco":
        text, lost = _mujoco(inside, name)
        return Exported({f"{name}.xml": text}, (*notes, *lost), left_out, folding=folding)
    sealed = seal_model(json.dumps(inside.document()))
    files = dict(export_model(sealed, name, target=target, precision=precision))
    if (inside.inputs, inside.outputs) != (POSE, WRENCH):
        return Exported(files, tuple(notes), left_out, folding=folding)
    poses = poses_to_hold(model)
    try:
        designed = design_loop(poses, inside.base.stiffness(poses, "screw"), loop)
    except InputError as error:
        without = (*notes, f"No control loop: {error}.")
        return Exported(files, without, left_out, folding=folding)
    if designed.holds.any():
        files |= loop_file(designed, target, name, precision)
    return Exported(files, (*notes, *designed.sentences()), left_out, designed, folding)


def _mechanism_alone(model: Model) -> tuple[Model, tuple[str, ...], list[str], float]:
    """The model without effects of instruments, those of physics folded into its base.

    Also the effects that are left out, notes, and the change by folding over the noise.
    """
    acting = {i.id for i in model.effects if i.effect.kind == "pose" and i.effect.side == "physics"}
    left_out = tuple(i.id for i in model.effects if i.id not in acting)
    notes = []
    if left_out:
        notes.append(
            f"Left out: {', '.join(left_out)}. They belong to the instruments, to time or to "
            "temperature, not to the mechanism's pose."
        )
    bare = replace(model, effects=(), history=(), correlations=())
    if not acting:
        return bare, left_out, notes, 0.0
    folded, error = _folded(model)
    share = float(np.max(error / _noise_sd(model)))
    notes.append(
        f"Folded into {folded.name}: {', '.join(sorted(acting))}; the folded map differs from "
        f"model and effects by at most {share:.2g} of the measurement noise (rms, worst component)."
    )
    return replace(bare, base=folded, covariance=None), left_out, notes, share


def _folded(model: Model) -> tuple[EnergyMap, F]:
    """The smallest energy that is near enough to the base with its effects, and its error."""
    rest = model.rest_pose("a model with effects of physics is exported as an energy, which")
    poses = poses_in_domain(model, _POSES)
    wrenches = model.predict(poses)
    noise = _noise_sd(model)
    trials: list[tuple[float, EnergyMap, F]] = []
    forms: tuple[tuple[int, Symmetry], ...]
    forms = ((6, "alike"), (6, "revolution"), (4, "general"), (6, "general"))
    for degree, symmetry in forms:
        energy = EnergyModel.fit(
            poses[::2].copy(),
            wrenches[::2].copy(),
            length_m=float(rest[0, 0]),
            degree=degree,
            symmetry=symmetry,
        )
        error = np.sqrt(((energy.predict(poses[1::2].copy()) - wrenches[1::2]) ** 2).mean(axis=0))
        trials.append((float(np.max(error / noise)), EnergyMap(energy), error))
        if trials[-1][0] < _SMALL_ERROR:
            break
    _, folded, error = min(trials, key=lambda trial: trial[0])
    return folded, error


def _noise_sd(model: Model) -> F:
    """(m,) root mean square noise of a row of each component over the model's poses."""
    rows = model.rows_at(poses_in_domain(model, 200))
    return np.asarray(np.sqrt(np.einsum("njj->j", model.noise.covariance(rows)) / len(rows)))


def poses_in_domain(model: Model, count: int) -> F:
    """(count, 6) random poses like those of the training data, which the model does not contain.

    An energy states how far its data went in mid-frame coordinates: |c| and |theta| at most
    `scale`. Otherwise the ranges of the pose columns are shrunk by half about their middle,
    because no mechanism reaches the corners of the whole box.
    """
    random = np.random.default_rng(_SEED)
    base = model.base.surrogate if isinstance(model.base, PhysicsMap) else model.base
    if isinstance(base, EnergyMap):
        directions = random.standard_normal((2, count, 3))
        directions /= np.linalg.norm(directions, axis=2, keepdims=True)
        radii = random.uniform(0.0, 1.0, (2, count, 1)) ** (1.0 / 3.0)
        c, theta = directions * radii * np.minimum(base.model.scale, 3.0)[:, None, None]
        half = rotation_matrices(np.ascontiguousarray(0.5 * theta))
        position = np.einsum("nij,nj->ni", half, c + np.array([base.model.length_m, 0.0, 0.0]))
        return np.hstack([position, theta])
    length = model.known_length_m or 0.1
    lower = np.array([0.9 * length, -0.1 * length, -0.1 * length, -0.3, -0.3, -0.3])
    upper = np.array([1.1 * length, 0.1 * length, 0.1 * length, 0.3, 0.3, 0.3])
    for j, column in enumerate(POSE):
        if column in model.domain:
            low, high = model.domain[column]
            quarter = 0.25 * (high - low)
            lower[j], upper[j] = low + quarter, high - quarter
    return np.asarray(random.uniform(lower, upper, (count, 6)))


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
