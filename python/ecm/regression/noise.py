"""Noise of a row: Sigma = Sigma_w + K_s Sigma_p K_s' + Sigma_base, a full matrix.

The pose noise acts through the stiffness: the stiff axis has most of it, and the components are
correlated. Its rotations are increments in base axes (isotropic, hence the same in top axes), which
act through K_s = K diag(I, J^-1).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.io.table import Table
from ecm.regression.rows import Rows

Source = Literal["repeats", "declared", "assumed"]


@dataclass(frozen=True)
class Noise:
    """Standard deviations of one row, and where they come from.

    Parameters
    ----------
    position_sd_m, rotation_sd_rad, force_sd_N, torque_sd_Nm
        Standard deviations per axis.
    source
        `repeats`, `declared` or `assumed`.
    components
        (m,) standard deviations of the outputs instead, for tables of other columns; they hold the
        pose noise as well.
    growth_per_N, growth_per_Nm
        Heteroscedastic noise: sigma^2 (1 + (g h)^2) of forces and of torques.

    Examples
    --------
    >>> noise = Noise(force_sd_N=0.2, source="declared")
    >>> noise.to_dict()["force_sd_N"], noise == Noise.from_dict(noise.to_dict())
    (0.2, True)
    """

    position_sd_m: float = 40e-6
    rotation_sd_rad: float = 4e-4
    force_sd_N: float = 0.3
    torque_sd_Nm: float = 0.010
    source: Source = "assumed"
    components: tuple[float, ...] | None = None
    growth_per_N: float = 0.0
    growth_per_Nm: float = 0.0

    @property
    def is_assumed(self) -> bool:
        """Whether neither repeats nor figures tell the noise: an error has no floor to stand on.

        Whether the figures are those of a common rig or the spread of a residual (`is_residual`).
        """
        return self.source == "assumed"

    @property
    def is_residual(self) -> bool:
        """Whether nothing is known of the noise, and the spread of a residual stands in its place.

        Such figures weigh the components; they are no noise, and no error may be held against them.
        """
        return self.components is not None and self.source == "assumed"

    def parameters(self) -> F:
        """(4,) position, rotation, force, torque."""
        return np.array(
            [self.position_sd_m, self.rotation_sd_rad, self.force_sd_N, self.torque_sd_Nm]
        )

    def with_parameters(self, values: F, source: Source) -> Noise:
        """Other figures from another source."""
        position, rotation, force, torque = (float(v) for v in values)
        return replace(
            self,
            position_sd_m=position,
            rotation_sd_rad=rotation,
            force_sd_N=force,
            torque_sd_Nm=torque,
            source=source,
        )

    def covariance(self, rows: Rows, base_error: F | None = None) -> F:
        """(N, m, m) covariance of the residual of each row."""
        m = len(rows.base.outputs)
        if self.components is not None:
            covariance = np.broadcast_to(np.diag(np.square(self.components)), (len(rows), m, m))
            return np.array(covariance)
        outputs = rows.base.outputs
        of_wrench = [self.force_sd_N if n in WRENCH[:3] else self.torque_sd_Nm for n in outputs]
        acting = rows.acting_stiffness * self.pose_sd(rows.base.inputs)
        covariance = acting @ np.swapaxes(acting, 1, 2)
        covariance += np.diag(np.square(of_wrench))
        if self.growth_per_N > 0.0 or self.growth_per_Nm > 0.0:
            covariance += self._grown(rows)
        if base_error is not None:
            loaded = (~rows.unloaded).astype(np.float64)
            covariance += loaded[:, None, None] * np.diag(np.square(base_error))
        return np.asarray(covariance)

    def pose_sd(self, inputs: Sequence[str]) -> F:
        """(n,) standard deviations of pose columns."""
        return np.array(
            [self.position_sd_m if n in POSE[:3] else self.rotation_sd_rad for n in inputs]
        )

    def variances(self, rows: Rows, base_error: F | None = None) -> F:
        """(N, m) of the residual of each row."""
        return np.asarray(np.einsum("njj->nj", self.covariance(rows, base_error)))

    def _grown(self, rows: Rows) -> F:
        """(N, m, m) diagonal (sigma g h)^2."""
        force = np.array([name in WRENCH[:3] for name in rows.base.outputs])
        sd = np.where(force, self.force_sd_N, self.torque_sd_Nm)
        growth = np.where(force, self.growth_per_N, self.growth_per_Nm)
        own = (sd * growth * rows.wrench) ** 2
        return np.asarray(own[:, :, None] * np.eye(len(force)))

    def to_dict(self) -> dict[str, Any]:
        """For model files and reports."""
        if self.components is not None:
            return {"source": self.source, "components": list(self.components)}
        grown = {"growth_per_N": self.growth_per_N, "growth_per_Nm": self.growth_per_Nm}
        return {name: value for name, value in grown.items() if value > 0.0} | {
            "source": self.source,
            "position_sd_m": self.position_sd_m,
            "rotation_sd_rad": self.rotation_sd_rad,
            "force_sd_N": self.force_sd_N,
            "torque_sd_Nm": self.torque_sd_Nm,
        }

    @staticmethod
    def from_dict(document: dict[str, Any]) -> Noise:
        """The noise of a model file."""
        if "components" in document:
            return Noise(
                source=document["source"],
                components=tuple(float(v) for v in document["components"]),
            )
        return Noise(**document)


def covariance_parts(rows: Rows) -> F:
    """(4, N, m, m) covariance per unit variance of position, rotation, force, torque."""
    inputs, outputs = rows.base.inputs, rows.base.outputs
    stiffness = rows.acting_stiffness
    position = np.array([name in POSE[:3] for name in inputs])
    force = np.array([name in WRENCH[:3] for name in outputs])
    along, about = stiffness[:, :, position], stiffness[:, :, ~position]
    n, m = len(rows), len(outputs)
    parts = np.zeros((4, n, m, m))
    parts[0] = along @ np.swapaxes(along, 1, 2)
    parts[1] = about @ np.swapaxes(about, 1, 2)
    parts[2] = np.diag(force.astype(np.float64))
    parts[3] = np.diag((~force).astype(np.float64))
    return parts


_ALL = (*POSE, *WRENCH)


def declared_noise(table: Table, columns: Sequence[str] = _ALL) -> Noise:
    """Noise by the `[instrument]` figures of a table's description.

    Figures that are not given are assumed. Where all are 0 the data are exact, and the noise of a
    common rig is assumed.

    Parameters
    ----------
    table
        Measurements with their description.
    columns
        Pose and wrench columns that are looked at: a displacement and a force need two of the four
        figures.

    Returns
    -------
    Noise
        Its source is `declared` where every figure that concerns the columns is given, else
        `assumed`.

    Examples
    --------
    >>> from ecm import as_table
    >>> from ecm.io.description import Instrument, Meta
    >>> meta = Meta(instrument=Instrument(pose_position_sd_m=2e-5, force_sd_N=0.1))
    >>> table = as_table({"x_m": [0.1, 0.2], "fx_N": [1.0, 2.0]}, meta=meta)
    >>> declared_noise(table).source, declared_noise(table, ("x_m", "fx_N")).source
    ('assumed', 'declared')
    """
    exact = is_exact(table, columns)
    figures = (None,) * 4 if exact else tuple(_figures(table).values())
    default = Noise()
    values = np.array(
        [d if f is None else f for f, d in zip(figures, default.parameters(), strict=True)]
    )
    given = all(figure is not None for figure in _needed(table, columns))
    return default.with_parameters(values, "declared" if given and not exact else "assumed")


def is_exact(table: Table, columns: Sequence[str] = _ALL) -> bool:
    """Whether the data's TOML declares their noise figures as 0, as simulated pairs do."""
    return all(figure == 0.0 for figure in _needed(table, columns))


def _needed(table: Table, columns: Sequence[str]) -> list[float | None]:
    figures = _figures(table)
    return [figures[own] for own in figures if set(own) & set(columns)]


def _figures(table: Table) -> dict[tuple[str, ...], float | None]:
    """The four figures by the columns that they are of."""
    instrument = table.meta.instrument
    return {
        POSE[:3]: instrument.pose_position_sd_m,
        POSE[3:]: instrument.pose_rotation_sd_rad,
        WRENCH[:3]: instrument.force_sd_N,
        WRENCH[3:]: instrument.torque_sd_Nm,
    }


def whiteners(covariance: F) -> F:
    """(N, m, m) inverse Cholesky factors: W r has unit covariance."""
    try:
        lower = np.linalg.cholesky(covariance)
    except np.linalg.LinAlgError:
        raise InputError(
            "a component of the wrench has no noise at all; in [instrument] give force_sd_N and "
            "torque_sd_Nm above 0, or all figures 0 where the data are exact"
        ) from None
    identity = np.broadcast_to(np.eye(covariance.shape[1]), covariance.shape)
    return np.asarray(np.linalg.solve(lower, identity))
