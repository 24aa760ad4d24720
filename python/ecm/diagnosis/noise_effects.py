"""Effects of the noise: whether the scatter of the rows follows the load, the pose or the steps.

With e the residual that no column explains and A = W V W' an effect's variance V in whitened axes,
U = sum e' A e - sum tr(A M) has mean 0 and variance 2 sum tr((A M)^2) where the noise is right, M
what the fit leaves of a row's unit covariance. Such effects change weights; they are no answer.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ecm.diagnosis.problem import Problem, omnibus_columns
from ecm.effects import Effect
from ecm.effects.noise import NoiseEffect
from ecm.io.arrays import B, F
from ecm.regression.f_test import orthonormal
from ecm.regression.noise import Noise


@dataclass(frozen=True)
class NoiseFinding:
    """One effect of the noise that the rows show, by its clearest parameter."""

    id: str
    parameter: str
    value: float
    unit: str
    z: float
    """Standard deviations of the score."""


def tested_noise(problem: Problem, effects: Sequence[Effect]) -> list[NoiseEffect]:
    """Return the noise effects that these data can test."""
    noise = [effect for effect in effects if isinstance(effect, NoiseEffect)]
    return [effect for effect in noise if effect.id not in problem.untestable]


def noise_findings(problem: Problem, effects: Sequence[Effect]) -> list[NoiseFinding]:
    """Return the noise effects that are seen, the clearest first.

    Robust weights take the place of those without parameters.
    """
    rows = problem.rows
    tested = [effect for effect in tested_noise(problem, effects) if effect.parameters]
    if not tested:
        return []
    use = problem.scored & (problem.weights > 0.9)
    residual, unfitted = _residual(problem, use)
    findings = []
    for effect in tested:
        best: NoiseFinding | None = None
        for j, parameter in enumerate(effect.parameters):
            unit = np.zeros(len(effect.parameters))
            unit[j] = parameter.scale
            variance = effect.variance(rows, unit)[use]
            whitener = problem.whitener[use]
            effect_variance = whitener @ variance @ np.swapaxes(whitener, 1, 2)
            z, square = _score(residual, unfitted, effect_variance)
            if z > problem.settings.noise_effect_deviations and (best is None or z > best.z):
                value = parameter.scale * float(np.sqrt(square))
                best = NoiseFinding(effect.id, parameter.name, value, parameter.unit, z)
        if best is not None:
            findings.append(best)
    return sorted(findings, key=lambda item: -item.z)


def with_load_growth(noise: Noise, findings: Sequence[NoiseFinding]) -> Noise:
    """Return the noise with scatter that grows with the load, where that is seen most clearly."""
    if noise.components is not None or not findings or findings[0].id != "heteroscedastic_noise":
        return noise
    first = findings[0]
    if first.parameter == "force_growth":
        return replace(noise, growth_per_N=first.value)
    return replace(noise, growth_per_Nm=first.value)


def _residual(problem: Problem, use: B) -> tuple[F, F]:
    """Return (n, m) the residual that nothing explains, and (n, m, m) what the fit leaves of it."""
    n, m = problem.response.shape
    smooth = omnibus_columns(problem, max(1, n // 6))
    known = [problem.base_block, problem.design[:, :, problem.leading]]
    columns = np.concatenate([block[use] for block in (*known, smooth)], axis=2)
    del known, smooth
    basis = orthonormal(columns.reshape(-1, columns.shape[2]))
    y = problem.response[use].ravel()
    residual = (y - basis @ (basis.T @ y)).reshape(-1, m)
    own = basis.reshape(-1, m, basis.shape[1])
    return residual, np.eye(m) - own @ np.swapaxes(own, 1, 2)


def _score(residual: F, unfitted: F, effect_variance: F) -> tuple[float, float]:
    """Return z of U with the common scale estimated, and the parameter's square over its unit."""
    scale = float((residual**2).sum() / np.einsum("nii->", unfitted))
    products = effect_variance @ unfitted
    traces = np.einsum("nii->n", products)
    plain = np.einsum("nii->n", unfitted)
    # Without its part along a common scale.
    share = traces.sum() / plain.sum()
    centred = effect_variance - share * np.eye(effect_variance.shape[1])
    product = centred @ unfitted
    score = float(np.einsum("ni,nij,nj->", residual, centred, residual)) / scale
    information = float(np.einsum("nij,nji->", product, product))
    if information <= 0.0:
        return 0.0, 0.0
    return score / float(np.sqrt(2.0 * information)), max(score / information, 0.0)
