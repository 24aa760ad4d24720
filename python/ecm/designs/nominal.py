"""Nominal model of a design, for the noise of a row and the effects at a pose.

A design comes before the measurement, so its stiffness is nominal: that of a given model, of the
simulated wrenches among the candidates, or of the FEM of their `[mechanism]`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ecm.effects import Effect, Rows
from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.io.description import Meta
from ecm.io.events import Progress
from ecm.io.mechanism import Mechanism
from ecm.io.se3 import wrench_adjoint
from ecm.io.table import Table
from ecm.models import Model, StiffnessMap, physics_map, surrogate_of
from ecm.models.maps import EnergyTerms
from ecm.regression.noise import Noise, declared_noise, whiteners
from ecm.rig.instruments import Camera, ForceTorqueSensor
from ecm.rig.settings import RigSettings

_MIN_POSES = 100
"""Number of simulated poses from which a physics map can be fitted and tested."""


@dataclass(frozen=True)
class NominalModel:
    """A nominal map, the instruments' noise, and the description of the candidates.

    Parameters
    ----------
    base
        Map from (N, 6) poses to (N, 6) wrenches.
    noise
        Noise of one row.
    meta
        Mechanism, scene and instruments of the candidates.

    Examples
    --------
    >>> import numpy as np
    >>> from ecm import as_table
    >>> bent = np.random.default_rng(0).normal(0.0, 0.01, (60, 6))
    >>> pairs = np.hstack([bent + [0.1, 0.0, 0.0, 0.0, 0.0, 0.0], 100.0 * bent])
    >>> meta = Meta(mechanism={"length_m": 0.1})
    >>> nominal = nominal_model(as_table(dict(zip((*POSE, *WRENCH), pairs.T)), meta=meta))
    >>> nominal.whiteners(pairs[:2, :6]).shape
    (2, 6, 6)
    """

    base: StiffnessMap
    noise: Noise
    meta: Meta

    def rows(self, poses: F) -> Rows:
        """Rows at (N, 6) poses, their wrenches predicted."""
        return Rows(self.table(poses), self.base)

    def table(self, poses: F) -> Table:
        """A table of (N, 6) poses with the nominal wrenches."""
        columns = dict(zip(POSE, np.asarray(poses, dtype=np.float64).T.copy(), strict=True))
        wrenches = self.base.predict(np.ascontiguousarray(poses))
        columns |= dict(zip(WRENCH, wrenches.T.copy(), strict=True))
        return Table(columns, self.meta, "nominal")

    def whiteners(self, poses: F) -> F:
        """(N, 6, 6) W with W' W = Sigma^-1, Sigma = Sigma_w + K_s Sigma_p K_s'."""
        return whiteners(self.noise.covariance(self.rows(poses)))

    def effect_columns(self, poses: F, effects: Sequence[Effect]) -> tuple[F, F]:
        """(N, 6, q) wrench per parameter of the effects that act at a pose, and (q,) sizes.

        Effects of time, order or approach are a matter of the plan, not of the poses.
        """
        rows = self.rows(poses)
        blocks, scales = [np.zeros((len(poses), 6, 0))], []
        for effect in effects:
            if effect.missing(rows.table) is not None:
                continue
            variant = effect.variants(rows.table)[0]
            blocks.append(variant.jacobian(rows, np.zeros(len(variant.parameters))))
            scales += [parameter.scale for parameter in variant.parameters]
        return np.concatenate(blocks, axis=2), np.asarray(scales)


def nominal_model(
    candidates: Table,
    model: Model | None = None,
    *,
    physics: bool = False,
    noise: Noise | None = None,
    threads: int = 0,
    progress: Progress | None = None,
) -> NominalModel:
    """The nominal model of a table of candidates.

    Its map is that of `model`, else it is fitted to the candidates' wrenches, else it is the FEM of
    their `[mechanism]`.

    Parameters
    ----------
    candidates
        Table with the six pose columns.
    model
        A fitted model.
    physics
        Accept only the physics map: of `model`, or the FEM of `[mechanism]` with its sensitivities
        to E and Poisson's ratio (solved once per shape, minutes).
    noise
        Noise of one row; by default that of the candidates' `[instrument]`.
    threads
        Threads of the FEM; 0: all.
    progress
        Called with the load cases done, their number and what is being done.

    Returns
    -------
    NominalModel
        Map, noise and description.

    Raises
    ------
    InputError
        None of the three is there, or a pose column is missing.

    Examples
    --------
    >>> import numpy as np
    >>> from ecm import as_table
    >>> bent = np.random.default_rng(0).normal(0.0, 0.01, (60, 6))
    >>> pairs = np.hstack([bent + [0.1, 0.0, 0.0, 0.0, 0.0, 0.0], 100.0 * bent])
    >>> meta = Meta(mechanism={"length_m": 0.1})
    >>> nominal = nominal_model(as_table(dict(zip((*POSE, *WRENCH), pairs.T)), meta=meta))
    >>> nominal.base.kind, nominal.noise.source
    ('energy', 'assumed')
    """
    where = candidates.source
    if candidates.pose_columns != POSE:
        raise InputError(
            f"{where}: the noise and the effects of a pose need the six pose columns, "
            f"found {', '.join(candidates.pose_columns)}; give all of {', '.join(POSE)}"
        )
    noise = declared_noise(candidates) if noise is None else noise
    meta = Meta(
        mechanism=candidates.meta.mechanism,
        scene=candidates.meta.scene,
        instrument=candidates.meta.instrument,
    )
    body = candidates.meta.elastic_body()
    if physics:
        own = _physics(where, body, model, threads, progress)
        return NominalModel(own, noise, meta.with_length(own.length_m))
    if model is not None:
        return NominalModel(model.base, noise, meta.with_length(model.base.length_m))
    length = candidates.meta.length_m
    if candidates.wrench_columns == WRENCH and length is not None:
        return NominalModel(_fitted_map(candidates, length, known=body is not None), noise, meta)
    if body is not None:
        return NominalModel(physics_map(body, threads=threads, progress=progress), noise, meta)
    raise InputError(
        f"{where}: the nominal stiffness is not known; give --base MODEL, simulated wrenches "
        "beside the poses with [mechanism] length_m, or a [mechanism] that FEM can solve"
    )


def _physics(
    where: str,
    body: Mechanism | None,
    model: Model | None,
    threads: int,
    progress: Progress | None,
) -> StiffnessMap:
    """The physics map, whose E and (where it is tabulated) Poisson's ratio are unknown."""
    if model is not None:
        if model.base.kind == "physics":
            return model.base
        raise InputError(
            f"--base: a {model.base.kind} model, but --model physics needs the physics base; leave "
            "--base out where the candidates have a [mechanism], or give a physics model"
        )
    if body is None:
        raise InputError(
            f"{where}: --model physics needs a [mechanism] that FEM can solve; add builtin, its "
            "dimensions and young_modulus_Pa to the TOML beside the candidates"
        )
    return physics_map(body, threads=threads, progress=progress)


def rig_noise(settings: RigSettings) -> Noise:
    """Noise of one averaged row, as the campaigns of a rig declare it.

    Parameters
    ----------
    settings
        Instruments and averaging window of the rig.

    Returns
    -------
    Noise
        Its source is `declared`.

    Raises
    ------
    InputError
        A figure is 0.

    Examples
    --------
    >>> from ecm.rig import RigSettings
    >>> rig_noise(RigSettings()).source
    'declared'
    """
    instrument, window = settings.instrument, settings.rig.window_s
    adjoint = wrench_adjoint(instrument.top_from_sensor)
    variance = np.diag(ForceTorqueSensor(instrument).row_covariance(window, adjoint))
    position, angle = Camera(instrument).row_sd(window)
    sd = np.array([position, angle, *np.sqrt(variance.reshape(2, 3).mean(axis=1))])
    if not (sd > 0.0).all():
        raise InputError(
            f"--rig: its noise of position, rotation, force and torque is {sd.tolist()}; a design "
            "needs positive figures in [instrument]"
        )
    return Noise().with_parameters(sd, "declared")


def _fitted_map(candidates: Table, length_m: float, *, known: bool) -> StiffnessMap:
    """A map fitted to simulated wrenches: physics where the body is known, else a free energy."""
    poses, wrenches = candidates.poses, candidates.wrenches
    if known and len(poses) >= _MIN_POSES:
        tested = np.arange(len(poses)) % 5 == 4
        return surrogate_of(
            poses[~tested],
            wrenches[~tested],
            length_m,
            test_poses=poses[tested],
            test_wrenches=wrenches[tested],
            mechanism=dict(candidates.meta.mechanism),
        )
    return EnergyTerms(length_m, 4).fit(poses, wrenches)
