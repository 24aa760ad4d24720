"""Numbers of the description that the rows contradict, and effects of the noise.

With e the residual that no column explains and A = W V W' an effect's variance V in whitened axes,
U = sum e' A e - sum tr(A M) has mean 0 and variance 2 sum tr((A M)^2) where the noise is right, M
what the fit leaves of a row's unit covariance. Such effects change weights; they are no answer.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from ecm.diagnosis.problem import Problem, omnibus_columns
from ecm.effects import Effect
from ecm.effects.noise import NoiseEffect
from ecm.io.arrays import B, F
from ecm.io.mechanism import Mechanism
from ecm.models.joint_fit import FittedEffect, JointFit
from ecm.models.physics.build import stated_rod
from ecm.models.physics.map import PhysicsMap
from ecm.regression.f_test import orthonormal
from ecm.regression.folds import repeat_cells
from ecm.regression.noise import Noise, declared_noise
from ecm.regression.normal_equations import explained_by_blocks, projected_out

_NOISE_DEVIATIONS = 4.0
"""An effect of the noise is reported beyond so many standard deviations."""

_LEAST_CHANGE = 0.05
"""Share by which E must differ from the stated value to be said."""
_LEAST_NU = 0.02
_LEAST_LENGTH = 0.03
"""Share by which the length at rest must differ from the stated one to be said."""
_STEPS_TO_REST = 20
_RESTS = 1e-9
"""Last step to the rest over the length."""
_DEVIATIONS = 4.0
_QUIET = 0.5
"""Variance over the declared one below which the declared noise is called too large."""
_CHANCE = 1e-3
_FAR = 3.0
"""Error at the bound of nu, over the noise and over that beyond it, from which nu is wrong."""


def stated_numbers(problem: Problem, final: JointFit) -> list[str]:
    """Return what these rows say of E, nu, length and noise where it is not what was stated.

    Parameters
    ----------
    final
        Fit of the base together with the accepted effects.
    """
    noise = _repeats(problem) or _quiet(problem)
    return [words for words in (_elasticity(problem), _length(final), noise) if words]


def _length(final: JointFit) -> str:
    """Return that an energy rests at another length than the stated one.

    An energy of the wrong length fits as well, since its origin is shifted along the axis. But the
    straight body then carries no force at another length than the stated one.
    """
    base, stated = final.base, final.base.length_m
    if base.kind != "energy" or stated is None:
        return ""
    along = final.rows.table.column("x_m")
    # From within the rows: far outside an energy of high degree means nothing.
    rest = np.array([[np.median(along), 0.0, 0.0, 0.0, 0.0, 0.0]])
    for _ in range(_STEPS_TO_REST):
        wrench, stiffness = base.wrench_and_stiffness(rest)
        if not stiffness[0, 0, 0] > 0.0:
            return ""
        step = float(wrench[0, 0] / stiffness[0, 0, 0])
        rest[0, 0] -= step
        if not np.isfinite(step) or abs(step) < _RESTS * stated:
            break
    if not along.min() <= rest[0, 0] <= along.max():
        return ""
    terms = base.columns(rest)[0, 0]
    force_sd = np.sqrt(terms @ final.covariance[: len(terms), : len(terms)] @ terms)
    change, sd = float(rest[0, 0]) - stated, float(force_sd / stiffness[0, 0, 0])
    if abs(change) < max(_LEAST_LENGTH * stated, _DEVIATIONS * sd):
        return ""
    return (
        f"by these rows the straight body carries no force at a length of {rest[0, 0]:.4g} m, "
        f"stated as {stated:.4g} m: the length or the origin of the positions along the axis is "
        "likely wrong, or something pulls or presses on it"
    )


def _elasticity(problem: Problem) -> str:
    base = problem.base
    if not isinstance(base, PhysicsMap) or base.values is None:
        return ""
    stated = Mechanism.from_dict(base.mechanism)
    if stated.builtin == "rod":
        stated = stated_rod(stated)
    own = {"young_modulus_Pa": stated.young_modulus_Pa, "poisson_ratio": stated.poisson_ratio}
    spread = dict(zip(base.free, np.sqrt(np.diag(problem.fit.covariance)), strict=False))
    parts = []
    for name, least in (
        ("young_modulus_Pa", _LEAST_CHANGE * own["young_modulus_Pa"]),
        ("poisson_ratio", _LEAST_NU),
    ):
        change = abs(base.values[name] - own[name])
        if name not in base.free or change < max(least, _DEVIATIONS * float(spread[name])):
            continue
        if name == "young_modulus_Pa":
            ratio = base.values[name] / own[name]
            parts.append(f"E is {ratio:.3g} times the stated {own[name]:.3g} Pa")
        else:
            parts.append(f"nu is {base.values[name]:.3f}, stated as {own[name]:.3g}")
    return f"by these rows {' and '.join(parts)}" if parts else ""


def negative_payload(effects: Sequence[FittedEffect]) -> list[str]:
    """Return what a payload of less than nothing means.

    Parameters
    ----------
    effects
        Accepted effects with their values.
    """
    said = []
    for item in effects:
        mass, sd = float(item.values[0]), float(item.sd[0])
        if item.id == "payload" and mass + _DEVIATIONS * sd < 0.0:
            said.append(
                f"a payload of {mass:.3g} kg: it was taken off after the sensor's zero, or gravity "
                "points the other way ([scene] gravity_m_s2), or forces have the wrong sign"
            )
    return said


def _quiet(problem: Problem) -> str:
    """Return that the declared noise is too large."""
    factor = problem.scale * (_seen_over_declared(problem) or 1.0)
    names = (*problem.base.inputs, *problem.base.outputs)
    declared = declared_noise(problem.table, names).source == "declared"
    if not declared or factor >= _QUIET or not problem.scale_freedom:
        return ""
    dof = problem.scale_freedom
    if float(special.chdtr(dof, factor * dof)) > _CHANCE:
        return ""
    return (
        f"the noise is {np.sqrt(factor):.2f} times as large as declared, or less: mend the "
        "figures in [instrument]"
    )


def _seen_over_declared(problem: Problem) -> float | None:
    """Return the variance of repeats over the declared one; None where one is not known."""
    names = (*problem.base.inputs, *problem.base.outputs)
    declared = declared_noise(problem.table, names)
    if problem.noise.source != "repeats" or declared.source != "declared":
        return None
    stated, seen = (noise.covariance(problem.rows) for noise in (declared, problem.noise))
    scored = problem.scored
    ratio = np.einsum("nii->n", np.linalg.solve(stated[scored], seen[scored])).mean()
    return float(ratio / stated.shape[1])


def _repeats(problem: Problem) -> str:
    """Return that repeats scatter more or less than the declared noise."""
    ratio = _seen_over_declared(problem)
    if ratio is None:
        return ""
    cells = repeat_cells(problem.table)[problem.scored]
    dof = (len(cells) - len(np.unique(cells))) * problem.response.shape[1]
    chance = min(float(special.chdtr(dof, ratio * dof)), float(special.chdtrc(dof, ratio * dof)))
    if chance > _CHANCE or _QUIET < ratio < 1.0 / _QUIET:
        return ""
    # A drift or a friction scatters repeats too: what columns explain of them is no noise.
    if ratio > 1.0 and (problem.scale < _QUIET or ratio * min(1.0, problem.scale) < 1.0 / _QUIET):
        return ""
    return (
        f"by the repeats the noise is {np.sqrt(ratio):.2f} times as large as declared: mend the "
        "figures in [instrument]"
    )


def ratio_warning(problem: Problem) -> str:
    """Return that no Poisson's ratio fits; empty where one does, or something else is missing too.

    A rod's stiffnesses are stated one by one: a wrong ratio of them looks like a nu beyond 1/2.
    """
    base = problem.base
    if not isinstance(base, PhysicsMap) or base.values is None or "poisson_ratio" not in base.free:
        return ""
    low, high = (float(limit[base.free.index("poisson_ratio")]) for limit in base.bounds)
    nu = base.values["poisson_ratio"]
    if min(nu - low, high - nu) > 1e-6 * high:
        return ""
    squares = float((problem.response**2).sum(axis=1) @ problem.weights)
    matrix, vector, _ = problem.normal.total()
    free = float(
        explained_by_blocks(
            (matrix, vector), projected_out(matrix, vector, ()), [problem.base_index]
        )[0]
    )
    beyond = np.sqrt(max(squares - free, 0.0) / problem.size)
    at_bound = np.sqrt(squares / problem.size)
    if at_bound < _FAR * max(1.0, float(beyond)):
        return ""
    return (
        f"no Poisson's ratio from {low:.2f} to {high:.2f} fits: nu, or the ratio of the stated "
        "stiffnesses, shear and torsion against bending, is likely wrong"
    )


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
            if z > _NOISE_DEVIATIONS and (best is None or z > best.z):
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
