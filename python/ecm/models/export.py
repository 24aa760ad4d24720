"""A model as source code for a controller, or as a MuJoCo file.

What is exported is the mechanism: the base map, and effects of physics that act through the
pose. Effects of instruments, of time and of temperature stay out, and the result says which.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ecm._native import EnergyModel, export_model, rotation_matrices, seal_model
from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.cache import write_atomically
from ecm.io.columns import POSE, WRENCH
from ecm.models.maps import EnergyMap
from ecm.models.mujoco import mujoco_text
from ecm.models.physics.map import PhysicsMap

if TYPE_CHECKING:
    from ecm.models.model import Model

Target = Literal["c", "rust", "mujoco"]
Precision = Literal["double", "single"]

_POSES = 2000
_SEED = 11


@dataclass(frozen=True)
class Exported:
    """Files by path, and what a reader of them must know."""

    files: dict[str, str]
    notes: tuple[str, ...]
    left_out: tuple[str, ...]
    """Ids of the effects that are not in the files."""


def export(
    model: Model,
    to: Target,
    directory: str | Path,
    *,
    name: str = "ecm_model",
    precision: Precision = "double",
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

    Returns
    -------
    Exported
        The files (path to text), notes for their reader, and the effects that were left out.

    Raises
    ------
    InputError
        A wrong name, or a model that cannot be exported.

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
    exported = export_files(model, to, name, precision)
    for path, text in exported.files.items():
        file = Path(directory) / path
        file.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(file, text)
    return exported


def export_files(
    model: Model, target: Target, name: str = "ecm_model", precision: Precision = "double"
) -> Exported:
    """Source files of a model.

    Parameters
    ----------
    name
        Begins every public name: a lower-case letter, then a-z, 0-9, _.
    precision
        Floating-point type of the code, `c` and `rust` only.
    """
    if re.fullmatch(r"[a-z][a-z0-9_]{0,39}", name) is None:
        raise InputError(
            f"name {name!r}: expected a lower-case letter, then at most 39 of a-z, 0-9 and _"
        )
    inside, left_out, notes = _mechanism_alone(model)
    if target == "mujoco":
        text, lost = _mujoco(inside, name)
        return Exported({f"{name}.xml": text}, (*notes, *lost), left_out)
    sealed = seal_model(json.dumps(inside.document()))
    files = export_model(sealed, name, target=target, precision=precision)
    return Exported(dict(files), tuple(notes), left_out)


def _mechanism_alone(model: Model) -> tuple[Model, tuple[str, ...], list[str]]:
    """The model without effects of instruments; effects of physics on the pose folded in."""
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
        return bare, left_out, notes
    folded, error = _folded(model)
    share = np.max(error / _noise_sd(model))
    notes.append(
        f"Folded into {folded.name}: {', '.join(sorted(acting))}; the folded map differs from "
        f"model and effects by at most {share:.2g} of the measurement noise (rms, worst component)."
    )
    return replace(bare, base=folded, covariance=None), left_out, notes


def _folded(model: Model) -> tuple[EnergyMap, F]:
    """The energy nearest to base plus acting effects, the smallest that is near enough."""
    length = model.known_length_m
    if model.inputs != POSE or model.outputs != WRENCH or length is None:
        raise InputError(
            "a model with effects of physics is exported as an energy, which needs all six pose "
            "and wrench columns and the length: give [mechanism] length_m, or remove the effects"
        )
    poses = poses_in_domain(model, _POSES)
    wrenches = model.predict(poses)
    noise = _noise_sd(model)
    best: tuple[float, EnergyMap, F] | None = None
    symmetries: list[Any] = ["alike", "revolution", "general", "general"]
    for degree, symmetry in zip((6, 6, 4, 6), symmetries, strict=True):
        fitted = EnergyMap(
            EnergyModel.fit(
                poses[::2].copy(),
                wrenches[::2].copy(),
                length_m=length,
                degree=degree,
                symmetry=symmetry,
            )
        )
        error = np.sqrt(((fitted.predict(poses[1::2]) - wrenches[1::2]) ** 2).mean(axis=0))
        share = float(np.max(error / noise))
        if best is None or share < best[0]:
            best = (share, fitted, error)
        if share < 0.15:
            break
    if best is None:
        raise InputError("no energy to fold the effects into")
    return best[1], best[2]


def _noise_sd(model: Model) -> F:
    """(m,) root mean square noise of a row of each component over the model's poses."""
    from ecm.effects import Rows
    from ecm.io.description import Meta
    from ecm.io.table import Table

    poses = poses_in_domain(model, 200)
    columns = {name: poses[:, j] for j, name in enumerate(POSE)}
    length = model.known_length_m
    known = {} if length is None else {"length_m": length}
    rows = Rows(Table(columns, Meta(mechanism=known), "poses"), model.base)
    return np.asarray(np.sqrt(np.einsum("njj->j", model.noise.covariance(rows)) / len(poses)))


def poses_in_domain(model: Model, count: int) -> F:
    """(count, 6) poses like those of the training data, which the model does not hold.

    An energy knows how far its data went in mid-frame coordinates: |c| and |theta| at most
    `scale`. Otherwise the ranges of the pose columns are shrunk by half about their middle,
    because their corners combine what no mechanism does.
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


def _mujoco(model: Model, name: str) -> tuple[str, list[str]]:
    length = model.known_length_m
    if model.inputs != POSE or model.outputs != WRENCH or length is None:
        raise InputError(
            "a MuJoCo export needs a model of all six pose and six wrench columns, and the "
            "length: give [mechanism] length_m in the data's TOML"
        )
    rest = np.array([[length, 0.0, 0.0, 0.0, 0.0, 0.0]])
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
    return mujoco_text(name, length, wrench, symmetric, lost), lost
