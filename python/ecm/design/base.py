"""The nominal mechanism of a design: what the noise of a row and the effects at a pose depend on.

A design comes before the measurement, so its stiffness is nominal: of a given model, of the
simulated wrenches among the candidates, or of the FEM of their `[mechanism]`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ecm import _native
from ecm.columns import POSE, WRENCH
from ecm.compare.noise import Noise, declared_noise, whiteners
from ecm.effects import Effect, Rows
from ecm.errors import InputError
from ecm.meta import Meta
from ecm.models import EnergyMap, Model, StiffnessMap, physics_map, surrogate_of
from ecm.table import Table

F = NDArray[np.float64]
_POISSON_STEP = 0.01
_ENOUGH = 100
"""Simulated poses from which a physics map can be made and tried."""


@dataclass(frozen=True)
class BaseForDesign:
    """A nominal map, the instruments' noise, and the description of the candidates."""

    base: StiffnessMap
    noise: Noise
    meta: Meta
    other_poisson: tuple[StiffnessMap, StiffnessMap, float] | None = None
    """The physics at two Poisson ratios and their difference, for its sensitivity."""

    def poisson_column(self, poses: F) -> F:
        """(N, 6, 1) sensitivity of the wrench to Poisson's ratio.

        (N, 6, 0) where it is unknown, or the base has it among its own coefficients.
        """
        own = getattr(self.base, "parameter_names", ())
        if self.other_poisson is None or "poisson_ratio" in own:
            return np.zeros((len(poses), 6, 0))
        lower, upper, step = self.other_poisson
        poses = np.ascontiguousarray(poses)
        return np.asarray(((upper.predict(poses) - lower.predict(poses)) / step)[:, :, None])

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


def nominal_base(
    candidates: Table,
    model: Model | None = None,
    *,
    poisson: bool = False,
    threads: int = 0,
) -> BaseForDesign:
    """The nominal base: of `model`, else of the candidates' wrenches, else FEM of [mechanism].

    With `poisson` also the sensitivity to Poisson's ratio, by FEM of `[mechanism]` at two.

    Errors
    ------
    InputError
        Nothing of this is there, or a pose column is missing.
    """
    where = candidates.source
    if candidates.pose_columns != POSE:
        found = ", ".join(candidates.pose_columns)
        raise InputError(
            f"{where}: the noise and the effects of a pose need the six pose columns, "
            f"found {found}; give all of {', '.join(POSE)}"
        )
    noise = declared_noise(candidates)
    meta = Meta(
        mechanism=candidates.meta.mechanism,
        scene=candidates.meta.scene,
        instrument=candidates.meta.instrument,
    )
    body = candidates.meta.body()
    known = body is not None and body.has_body
    pair = None
    if poisson and body is not None and known:
        physics = physics_map(body, threads=threads)
        below = physics.at(poisson_ratio=body.poisson_ratio - _POISSON_STEP)
        pair = (below, physics.at(), _POISSON_STEP)
    if model is not None:
        return BaseForDesign(model.base, noise, _with_length(meta, model.base.length_m), pair)
    length = candidates.meta.length_m
    if candidates.wrench_columns == WRENCH and length is not None:
        return BaseForDesign(_of_wrenches(candidates, length, known=known), noise, meta, pair)
    if body is not None and known:
        return BaseForDesign(physics_map(body, threads=threads), noise, meta, pair)
    raise InputError(
        f"{where}: the nominal stiffness is not known; give --base MODEL, simulated wrenches "
        "beside the poses with [mechanism] length_m, or a [mechanism] that FEM can solve"
    )


def _of_wrenches(candidates: Table, length_m: float, *, known: bool) -> StiffnessMap:
    """A map of simulated wrenches: the physics where the body is known, else a free energy."""
    poses, wrenches = candidates.poses, candidates.wrenches
    if known and len(poses) >= _ENOUGH:
        held = np.arange(len(poses)) % 5 == 4
        return surrogate_of(
            poses[~held],
            wrenches[~held],
            length_m,
            test_poses=poses[held],
            test_wrenches=wrenches[held],
            mechanism=dict(candidates.meta.mechanism),
        )
    fitted = _native.EnergyModel.fit(
        np.ascontiguousarray(poses),
        np.ascontiguousarray(wrenches),
        length_m=length_m,
        degree=4,
        symmetry="alike",
    )
    return EnergyMap(fitted)


def _with_length(meta: Meta, length_m: float | None) -> Meta:
    if length_m is None or "length_m" in meta.mechanism:
        return meta
    return Meta(
        mechanism={**meta.mechanism, "length_m": length_m},
        scene=meta.scene,
        instrument=meta.instrument,
    )
