"""From an error of the wrench to an error of the pose: dp = K^-1 dh.

dp is how far the pose is from the one at which the model has the measured wrench, and equally how
far a mechanism settles from the pose that a controller wanted of this model, to first order in dh.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ecm._native import inverse_left_jacobians, left_jacobians
from ecm.errors import InputError
from ecm.io.arrays import B, F, I, evenly
from ecm.io.columns import POSE, WRENCH
from ecm.io.table import Table
from ecm.models.evaluation import EvaluatedModel
from ecm.regression.noise import Noise
from ecm.regression.rows import Rows

_BLOCK = 20_000
"""Rows whose stiffness is held at once."""
_LEAST_STIFFNESS = 0.02
"""Least eigenvalue of sym K over the typical stiffness of its axes; a neck at rest has 0.2."""
_TYPICAL_ROWS = 25
"""Rows over which the typical stiffness of an axis is the median."""
_WORST = 10
_ROWS_OF_A_FIT = 200
"""Rows that the fit report rests on: the stiffness of a rod takes a hundredth of a second each."""
_CONSTANT = 1e-12
"""Range below which a column does not vary."""


@dataclass(frozen=True)
class PoseError:
    """Errors of a model's wrench as errors of the pose, of n rows in file order.

    Examples
    --------
    >>> import ecm
    >>> x = np.linspace(-0.01, 0.01, 9)
    >>> model = ecm.fit_model({"x_m": x, "fx_N": 2000.0 * x}, "linear")
    >>> table = ecm.as_table({"x_m": x, "fx_N": 2000.0 * x + 1.0})
    >>> found = pose_error(model, table, table.matrix(["fx_N"]) - model.predict(table))
    >>> float(found.position_mm.max().round(9)), found.rotation_deg
    (0.5, None)
    """

    axes: tuple[str, ...]
    """Pose columns that the error may change: those that vary, with the wrench on their axis."""
    row: I
    """(n,) rows of the table, from 1, whose K determines the change."""
    change: F
    """(n, 6) dp in m and rad, in the order of the pose columns; 0 outside `axes`."""
    position_mm: F | None
    """(n,) length of the change of position; None without such an axis."""
    rotation_deg: F | None
    """(n,) angle of the change of rotation, |J(theta) dtheta|; None without such an axis."""
    left_out: I
    """Rows of the table, from 1, at which K is singular, nearly so, or does not hold the pose."""
    noise_mm: float | None = None
    """Standard deviation that the noise of a row alone gives, median over the rows."""
    noise_deg: float | None = None

    def worst(self, count: int = _WORST) -> list[dict[str, Any]]:
        """Return the rows with the largest change, by position where there is one."""
        by = self.position_mm if self.position_mm is not None else self.rotation_deg
        if by is None:
            return []
        return [
            {"row": int(self.row[i])}
            | {name: float(values[i]) for name, values in self._sizes().items()}
            for i in np.argsort(-by, kind="stable")[:count]
        ]

    def sentence(self) -> str:
        """Return median and largest in words, and how many rows are left out and why."""
        if not self.axes:
            return (
                "No pose error: it needs a pose column that varies and the wrench on its axis, as "
                "x_m and fx_N."
            )
        total = len(self.row) + len(self.left_out)
        why = (
            f"of {total} rows {'are' if len(self.left_out) != 1 else 'is'} left out: the model's "
            "stiffness is singular there, nearly so, or does not hold the pose (buckling)."
        )
        if not len(self.row):
            return f"No pose error: {len(self.left_out)} {why}"
        held = [name for name in POSE if name not in self.axes]
        text = f"As pose error: median {self._words(np.median)}, largest {self._words(np.max)}"
        text += f"; noise alone gives {self._noise_words()}" * (self._noise_words() != "")
        text += f". Held as they are: {', '.join(held)}." if held else "."
        return text + (f" {len(self.left_out)} {why}" if len(self.left_out) else "")

    def _words(self, of: Any) -> str:
        return " and ".join(f"{of(v):.2g}{_UNITS[name]}" for name, v in self._sizes().items())

    def _noise_words(self) -> str:
        known = {" mm": self.noise_mm, "°": self.noise_deg}
        return " and ".join(f"{v:.2g}{unit}" for unit, v in known.items() if v is not None)

    def _sizes(self) -> dict[str, F]:
        known = {"position_mm": self.position_mm, "rotation_deg": self.rotation_deg}
        return {name: values for name, values in known.items() if values is not None}

    def to_dict(self) -> dict[str, Any]:
        """Return plain JSON: median, largest and noise, the worst rows, how many are left out."""
        noise = {"position_mm": self.noise_mm, "rotation_deg": self.noise_deg}
        sizes = {
            name: {
                "median": float(np.median(values)),
                "largest": float(values.max()),
                "noise": noise[name],
            }
            for name, values in self._sizes().items()
            if len(values)
        }
        return {
            "sentence": self.sentence(),
            "axes": list(self.axes),
            "rows": len(self.row),
            "left_out": len(self.left_out),
            "position_mm": sizes.get("position_mm"),
            "rotation_deg": sizes.get("rotation_deg"),
            "worst_rows": self.worst(),
        }


_UNITS = {"position_mm": " mm", "rotation_deg": "°"}


def pose_error(
    model: EvaluatedModel, table: Table, errors: F, *, noise: Noise | None = None
) -> PoseError:
    """Turn the wrench errors of a model into errors of the pose.

    Axes that do not vary in the table, or whose force or moment is not measured, are held: the
    change is that of the others. A row is left out where the least eigenvalue of sym K_s, over the
    typical stiffness of its axes, is below 0.02: K is singular or nearly so, or the pose unstable.

    Parameters
    ----------
    model
        The model, whose K = dh/dp counts.
    table
        N rows, of which measured poses are taken.
    errors
        (N, m) wrench, measured minus predicted, in N and N m.
    noise
        Noise of the rows, for what it gives alone.

    Raises
    ------
    InputError
        If the errors do not have the table's rows and the model's components.

    Examples
    --------
    >>> import ecm
    >>> y = np.linspace(-0.01, 0.01, 9)
    >>> data = {"y_m": y, "theta_z_rad": 9.0 * y**2, "fy_N": 3000.0 * y, "tau_z_Nm": 180.0 * y**2}
    >>> model = ecm.fit_model(data, "quadratic")
    >>> pose_error(model, ecm.as_table(data), np.tile([0.3, 0.0], (9, 1))).axes
    ('y_m', 'theta_z_rad')
    """
    if errors.shape != (len(table), len(model.outputs)):
        raise InputError(
            f"errors of shape {errors.shape}: expected {(len(table), len(model.outputs))}, a row "
            f"for each of the table and a column for each of {', '.join(model.outputs)}"
        )
    measured = np.flatnonzero(table.of_poses)
    numbers = table.numbers_in_file[measured]
    axes = _axes(model, table.select(measured))
    if not axes:
        return PoseError((), numbers[:0], np.zeros((0, 6)), None, None, numbers)
    some = table.select(measured[evenly(len(measured), _TYPICAL_ROWS)])
    typical = _typical_stiffness(model, some, axes)
    parts = [
        _of_block(model, table.select(rows), errors[rows], noise, axes, typical)
        for rows in np.split(measured, range(_BLOCK, len(measured), _BLOCK))
    ]
    held, change, sizes, noise_sizes = (np.concatenate(part) for part in zip(*parts, strict=True))
    has = [any(k in axes for k in part) for part in (range(3), range(3, 6))]
    known = noise is not None and not noise.is_assumed and held.any()
    alone = np.median(noise_sizes[held], axis=0) if known else None
    return PoseError(
        axes=tuple(POSE[k] for k in axes),
        row=numbers[held],
        change=change[held],
        position_mm=sizes[held, 0] if has[0] else None,
        rotation_deg=sizes[held, 1] if has[1] else None,
        left_out=numbers[~held],
        noise_mm=float(alone[0]) if has[0] and alone is not None else None,
        noise_deg=float(alone[1]) if has[1] and alone is not None else None,
    )


def report_rows(table: Table) -> I:
    """Return at most 200 measured rows of a table, evenly, on which a fit report rests.

    Examples
    --------
    >>> import ecm
    >>> x = np.linspace(-0.01, 0.01, 1000)
    >>> len(report_rows(ecm.as_table({"x_m": x, "fx_N": 2000.0 * x})))
    200
    """
    rows = np.flatnonzero(table.of_poses)
    return rows[evenly(len(rows), _ROWS_OF_A_FIT)]


def error_of_report(model: EvaluatedModel, table: Table) -> dict[str, Any]:
    """Pose error of a model on the rows of a fit report, as plain JSON."""
    shown = report_rows(table)
    some = table.subsample(shown)
    errors = some.matrix(model.outputs) - model.predict(some)
    return pose_error(model, table.select(shown), errors).to_dict()


def _axes(model: EvaluatedModel, measured: Table) -> list[int]:
    """Places in POSE of the columns that vary, with the wrench on their axis."""
    pairs = zip(POSE, WRENCH, strict=True)
    return [
        k
        for k, pair in enumerate(pairs)
        if pair[0] in model.inputs
        and pair[1] in model.outputs
        and all(len(measured) and np.ptp(measured.column(name)) > _CONSTANT for name in pair)
    ]


def _stiffness(model: EvaluatedModel, table: Table, axes: list[int]) -> tuple[F, F]:
    """K = dh/dp of the axes (N, a, a), and K_s where all rotations are among them, else K."""
    inputs = [model.inputs.index(POSE[k]) for k in axes]
    outputs = [model.outputs.index(WRENCH[k]) for k in axes]
    poses = np.ascontiguousarray(table.matrix(model.inputs))
    partial = model.stiffness(poses)[:, outputs][:, :, inputs]
    partial[~np.isfinite(partial).all(axis=(1, 2))] = 0.0
    if axes[-3:] != [3, 4, 5]:
        return partial, partial
    screw = partial.copy()
    screw[:, :, -3:] = partial[:, :, -3:] @ inverse_left_jacobians(_rotations(table))
    return partial, screw


def _typical_stiffness(model: EvaluatedModel, table: Table, axes: list[int]) -> F:
    """(a,) typical stiffness of each axis, N/m and N m/rad."""
    _, screw = _stiffness(model, table, axes)
    return np.asarray(np.median(np.abs(np.einsum("nii->ni", screw)), axis=0))


def _rotations(table: Table) -> F:
    """(N, 3) rotation vectors; a column that the table lacks is 0."""
    columns = [table.column(n) if table.has(n) else np.zeros(len(table)) for n in POSE[3:]]
    return np.ascontiguousarray(np.stack(columns, axis=1))


def _of_block(
    model: EvaluatedModel, table: Table, errors: F, noise: Noise | None, axes: list[int], typical: F
) -> tuple[B, F, F, F]:
    """Which rows hold (N,), dp (N, 6), its mm and degrees (N, 2), and those of the noise alone."""
    partial, screw = _stiffness(model, table, axes)
    products = np.outer(typical, typical)
    scaled = screw / np.sqrt(np.where(products > 0.0, products, np.inf))
    held = np.linalg.eigvalsh(0.5 * (scaled + np.swapaxes(scaled, 1, 2)))[:, 0] > _LEAST_STIFFNESS
    to_pose = np.zeros((len(table), 6, len(axes)))
    to_pose[np.ix_(np.flatnonzero(held), np.array(axes))] = np.linalg.inv(partial[held])
    outputs = [model.outputs.index(WRENCH[k]) for k in axes]
    change = np.einsum("nij,nj->ni", to_pose, errors[:, outputs])
    to_pose[:, 3:] = left_jacobians(_rotations(table)) @ to_pose[:, 3:]
    increment = np.einsum("nij,nj->ni", to_pose, errors[:, outputs])
    variance = np.zeros_like(change)
    if noise is not None:
        covariance = noise.covariance(Rows(table, model.base))[:, outputs][:, :, outputs]
        variance = np.einsum("nij,njk,nik->ni", to_pose, covariance, to_pose)
    return held, change, _sizes(increment**2), _sizes(variance)


def _sizes(squares: F) -> F:
    """(N, 2) mm and degrees of squares (N, 6) in m^2 and rad^2."""
    sums = np.stack([squares[:, :3].sum(axis=1), squares[:, 3:].sum(axis=1)], axis=1)
    return np.asarray(np.sqrt(sums) * [1e3, 180.0 / np.pi])
