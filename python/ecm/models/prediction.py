"""Predictions of a model: wrench, standard deviation, stiffness and how symmetric it is.

K = dh/dp of a conservative mechanism is symmetric only at theta = 0 and tau = 0. In rotation
increments of base axes, K_s = K diag(I, J^-1), its skew part is known: -[tau]x/2 in the rotation
block, by the load alone. The rest measures noise, misfit and forces that are not conservative.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ecm._native import convert_stiffness
from ecm.io.arrays import F
from ecm.io.columns import STIFFNESS
from ecm.io.events import Progress, tell_part
from ecm.io.se3 import skew
from ecm.io.table import MetaLike, Table, TableLike, takes_table
from ecm.models.maps import StiffnessKind
from ecm.models.measured_poses import beyond_inputs
from ecm.models.model import Model
from ecm.models.physics.map import PhysicsMap
from ecm.regression.rows import actuators_of, driven_by, inputs_of


@dataclass(frozen=True)
class Symmetry:
    """Parts of a stiffness (N, 6, 6), SI units."""

    symmetric: F
    """(N, 6, 6) K_sym of the paper's equation (10)."""
    skew: F
    """(N, 6, 6) K_skew of the paper's equation (10)."""
    share: F
    """(N,) ||K_sym||_2 / ||K||_2."""
    skew_left: F
    """(N, 6, 6) skew part of K_s without the geometric part of the load."""
    share_without_geometry: F
    """(N,) ||K_s,sym||_2 / ||K_s - geometric part||_2: 1 for every conservative map."""


def symmetry_of(stiffness: F, poses: F, wrenches: F) -> Symmetry:
    """Symmetric and skew parts of the stiffness.

    Parameters
    ----------
    stiffness
        (N, 6, 6) K = dh/dp, SI units.
    poses, wrenches
        (N, 6) each, where the stiffness belongs.

    Source
    ------
    Deutschmann et al., equation (10); docs/explain/mechanics.md.

    Examples
    --------
    >>> poses = np.zeros((1, 6))
    >>> float(symmetry_of(np.eye(6)[None], poses, np.zeros((1, 6))).share[0])
    1.0
    """
    poses, wrenches = np.ascontiguousarray(poses), np.ascontiguousarray(wrenches)
    screw = convert_stiffness(
        np.ascontiguousarray(stiffness), poses, wrenches, source="partial", target="screw"
    )
    rest = screw.copy()
    rest[:, 3:, 3:] += 0.5 * skew(wrenches[:, 3:])
    return Symmetry(
        *_parts(stiffness), symmetric_share(stiffness), _parts(rest)[1], symmetric_share(rest)
    )


def _parts(matrix: F) -> tuple[F, F]:
    transposed = np.swapaxes(matrix, 1, 2)
    return 0.5 * (matrix + transposed), 0.5 * (matrix - transposed)


def symmetric_share(stiffness: F) -> F:
    """||K_sym||2 / ||K||2 of each pose (equation (10), Fig. 12), K in SI units."""
    symmetric = np.linalg.norm(_parts(stiffness)[0], 2, axis=(1, 2))
    return np.asarray(symmetric / np.linalg.norm(stiffness, 2, axis=(1, 2)))


_REACH_MARGIN = 1.05
"""Nearer to its reach the physics base errs as little as within it."""
_ERROR_AT, _ERROR_AT_REACH, _GROWTH = 0.01, 1.5, 3.5
"""Share of |force| and |moment| in error at so many times the reach, and the power by which it
grows.

Above what was measured on the neck (docs/models.md): 0.74 % there, 2.2 % at twice, 5.2 % at 2.5.
"""
_WIDE_ERRS_FROM_RAD, _WIDE_ERROR_AT_RAD = 1.2, 1.8
"""A family of a wide workspace errs by 0.1 % up to the first, and by that share at the second."""
_LATE = 0.1
"""Share of the measured range of time by which a drift may go on without a word."""
_ROWS = 4 * 4096
"""Rows whose stiffness is held at once."""


@takes_table("predict")
def predict(
    model: Model,
    table: TableLike,
    *,
    meta: MetaLike = None,
    stiffness: StiffnessKind | None = None,
    leverage: bool = False,
    progress: Progress | None = None,
) -> Table:
    """Predict the wrench of a model at each pose of a table.

    Parameters
    ----------
    model
        Any model.
    table
        N poses, as a table, a data frame, a dict or a file; its other columns are kept.
    meta
        Description of the data, as a dict of what the TOML beside it would hold, or that file.
    stiffness
        Add the 36 columns `k_fx_x`, ... of this stiffness: `partial` (dh/dp, the paper's),
        `generalised` (d(f, J'tau)/dp) or `screw` (in rotation increments of the base axes).
    leverage
        Add the columns `leverage`, where it is known, and `extrapolates` (0 or 1).
    progress
        Called with the rows that are done, of all.

    Returns
    -------
    Table
        The table with the predicted wrench (N, N m), `sd_` columns where the model knows its
        standard deviation, and a warning where poses are outside the training data. Poses that turn
        far have the error of a physics base in their `sd_` columns.

    Examples
    --------
    >>> import ecm
    >>> y = np.linspace(-0.01, 0.01, 9)
    >>> model = ecm.fit(ecm.as_table({"y_m": y, "fy_N": 3000.0 * y}), "linear")
    >>> predicted = ecm.predict(model, {"y_m": [0.005, 0.05]})
    >>> predicted["fy_N"].round(6)
    array([ 15., 150.])
    >>> predicted.warnings
    ('1 of 2 poses are outside what the model was trained on: there it extrapolates',)
    """
    poses = inputs_of(model.base, table)
    # Effects follow the history of all rows.
    whole = model.readings(table) if model.effects else None
    parts = []
    for start in range(0, len(poses), _ROWS):
        tell_part(progress, start, len(poses))
        block = slice(start, start + _ROWS)
        wrench = model.predict(poses[block]) if whole is None else whole[block]
        parts.append(_columns(model, poses[block], wrench, stiffness, leverage))
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    warnings = (*table.warnings, *_outside(model, table), *beyond_reach(model, poses))
    predicted: Table = table.with_columns(columns)
    return replace(predicted, warnings=warnings)


def _columns(
    model: Model, poses: F, wrench: F, stiffness: StiffnessKind | None, leverage: bool
) -> dict[str, F]:
    """What is predicted at poses (N, n), by column."""
    columns: dict[str, F] = {name: wrench[:, j] for j, name in enumerate(model.outputs)}
    sd = _with_reach(model, poses, model.predict_sd(poses))
    if sd is not None:
        columns |= {f"sd_{name}": sd[:, j] for j, name in enumerate(model.outputs)}
    if stiffness is not None:
        columns |= _stiffness_columns(model, poses, stiffness)
    if leverage:
        known = model.leverage(poses)
        if known is not None:
            columns["leverage"] = known
        columns["extrapolates"] = model.extrapolates(poses).astype(np.float64)
    return columns


def _with_reach(model: Model, poses: F, sd: F | None) -> F | None:
    """(N, m) standard deviation with the error of a physics base at large turns and shifts."""
    found = _beside_fem(model, poses)
    if found is None:
        return sd
    base, turned, shifted = found
    far = np.where(shifted > _REACH_MARGIN, shifted / _ERROR_AT_REACH, 0.0)
    errs = turned > min(_REACH_MARGIN * base.reach_rad, _WIDE_ERRS_FROM_RAD)
    at = min(_ERROR_AT_REACH * base.reach_rad, _WIDE_ERROR_AT_RAD)
    far = np.maximum(far, np.where(errs, turned / at, 0.0))
    if not far.any():
        return sd
    known = np.broadcast_to(base.error, (len(poses), 6)) if sd is None else sd
    share = (_ERROR_AT * far**_GROWTH)[:, None]
    wrench = base.predict(poses)
    size = np.repeat(
        [np.linalg.norm(part, axis=1) for part in (wrench[:, :3], wrench[:, 3:])], 3, 0
    )
    return np.asarray(np.hypot(known, share * size.T))


def _beside_fem(model: Model, poses: F) -> tuple[PhysicsMap, F, F] | None:
    """A physics base that is FEM's, the turns of the poses (N,), and their shifts over the FEM's.

    None for other bases.
    """
    base = model.base
    if not isinstance(base, PhysicsMap) or base.family is None:
        return None
    shifted = np.abs(base.family.shifted(poses, base.length_m)).max(axis=1)
    return base, np.linalg.norm(poses[:, 3:], axis=1), shifted


def _stiffness_columns(model: Model, poses: F, kind: StiffnessKind) -> dict[str, F]:
    driven = driven_by(model.base)
    short = {name: name.rsplit("_", 1)[0] for name in (*model.inputs, *driven, *model.outputs)}

    def named(letter: str, matrix: F, inputs: Sequence[str]) -> dict[str, F]:
        return {
            f"{letter}_{short[force]}_{short[moved]}": matrix[:, i, j]
            for i, force in enumerate(model.outputs)
            for j, moved in enumerate(inputs)
        }

    stiffness = model.stiffness(poses, kind)
    columns = named("k", stiffness, model.inputs)
    of_pose = {name: columns[name] for name in STIFFNESS if name in columns}
    if actuators_of(model.base):
        return of_pose | named("g", model.actuated.actuation_jacobian(poses), driven)
    places = [model.inputs.index(name) for name in driven]
    return of_pose | named("g", stiffness[:, :, places], driven)


def beyond_reach(model: Model, poses: F) -> list[str]:
    """Say how many poses (N, n) turn or shift further than the FEM behind a physics base.

    Examples
    --------
    >>> import ecm
    >>> y = np.linspace(-0.01, 0.01, 9)
    >>> beyond_reach(ecm.fit({"y_m": y, "fy_N": 3000.0 * y}, "linear"), y[:, None])
    []
    """
    found = _beside_fem(model, poses)
    if found is None:
        return []
    base, turned, shifted = found
    said = []
    far = turned > _REACH_MARGIN * base.reach_rad
    if far.any():
        said.append(
            f"{int(far.sum())} of {len(poses)} poses turn further than the FEM behind the physics, "
            f"{base.reach_rad:.2f} rad: at 1.5 times that it errs by 1 %, at twice by 2 to 5 %. "
            f"Build it wider: physics_map(mechanism, reach_rad={turned.max():.2f}), or give the "
            "TOML of the mechanism as MODEL"
        )
    far = shifted > _REACH_MARGIN
    if far.any() and base.family is not None:
        low, high, most = 1e3 * base.length_m * base.family.shifts
        said.append(
            f"{int(far.sum())} of {len(poses)} poses are pulled, pressed or pushed aside further "
            f"than the FEM behind the physics, up to {shifted.max():.1f} times: it knows {low:.2g} "
            f"to {high:+.2g} mm along the axis and {most:.2g} mm across. At twice that a neck's "
            "errs by some 2 %, a thick body's by 5 to 13 %, at 4 times by a third and more. "
            "Build it further, up to five times: physics_map(mechanism, poses=poses), or give the "
            "TOML of the mechanism as MODEL"
        )
    return said


def _outside(model: Model, table: Table) -> list[str]:
    outside = model.extrapolates(inputs_of(model.base, table))
    said = []
    if outside.any():
        said.append(
            f"{int(outside.sum())} of {len(table)} poses are outside what the model was trained on:"
            f" there it extrapolates{beyond_inputs(model, table)}"
        )
    grows = [item.id for item in model.effects if item.effect.grows_with_time]
    if grows and "time_s" in model.conditions and table.has("time_s"):
        (least, most), time = model.conditions["time_s"], table.column("time_s")
        beyond = np.maximum(least - time, time - most) > _LATE * (most - least)
        if beyond.any():
            said.append(
                f"{int(beyond.sum())} of {len(table)} rows have a time_s outside the measured "
                f"times, {least:.10g} to {most:.10g} s: there {', '.join(grows)} extrapolates"
            )
    return said
