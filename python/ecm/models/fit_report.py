"""The fit report: values with errors, correlations, and the history of fits."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ecm.io.arrays import F
from ecm.models.history import FitRecord
from ecm.models.joint_fit import FittedEffect, JointFit
from ecm.models.maps import StiffnessMap
from ecm.models.parameters import ParametrisedMap

_LARGE_CORRELATION = 0.3
_MOST_PAIRS = 12


def fit_report(
    name: str,
    base: StiffnessMap,
    effects: Sequence[FittedEffect],
    correlations: Sequence[tuple[str, str, float]],
    history: Sequence[FitRecord],
    covariance: F | None = None,
) -> str:
    """Text: parameters of physics, then of the instruments, correlations, history of fits."""
    lines = [f"model {name}: {len(base.coefficients)} coefficients in the base"]
    if isinstance(base, ParametrisedMap):
        lines += [f"  {line}" for line in base.sentences(covariance)]
    for side, title in (("physics", "physics"), ("measurement", "instruments")):
        for item in (i for i in effects if i.effect.side == side):
            shape = "".join(f", {k} = {v}" for k, v in item.effect.shape.items())
            lines.append(f"  {item.id} ({title}{shape}){' frozen' if item.frozen else ''}")
            for parameter, value, sd, bound in zip(
                item.effect.parameters, item.values, item.sd, item.at_bounds, strict=True
            ):
                error = f" +- {sd:.2g}" if np.isfinite(sd) else " (not fitted)"
                at = " at its bound" if bound else ""
                lines.append(f"    {parameter.name} = {value:.4g}{error} {parameter.unit}{at}")
            least = [1e-6 * parameter.scale for parameter in item.effect.parameters]
            if not item.is_new and item.at_bounds.all() and np.all(np.abs(item.values) <= least):
                lines.append("    it explains nothing: the data would need the opposite sign")
    if correlations:
        lines.append(f"  correlations beyond {_LARGE_CORRELATION}:")
        lines += [f"    {a} and {b}: {value:+.2f}" for a, b, value in correlations]
    for record in history:
        ceiling = "" if record.ceiling is None else f", ceiling {record.ceiling:.3f}"
        lines.append(
            f"  {record.name}: error over noise {record.train:.3f} fitted, "
            f"{record.held_out:.3f} held out{ceiling}, floor {record.floor:g}"
        )
        if record.test:
            lines.append(f"    {record.test}")
    return "\n".join(lines)


def correlations_of(fit: JointFit, base_frozen: bool) -> tuple[tuple[str, str, float], ...]:
    """Pairs of parameters with large correlation: of effects, and of these with the base."""
    own = [
        f"{item.id}.{parameter.name}"
        for item in fit.effects
        if not item.frozen
        for parameter in item.effect.parameters
    ]
    base = 0 if base_frozen else len(fit.base.coefficients)
    own_names = fit.base.parameter_names if isinstance(fit.base, ParametrisedMap) else ()
    names = [*(own_names or (f"base.{j + 1}" for j in range(base)))][:base] + own
    sd = np.sqrt(np.maximum(np.diag(fit.covariance), 1e-300))
    matrix = fit.covariance / np.outer(sd, sd)
    pairs = [
        (names[i], names[j], float(matrix[i, j]))
        for j in range(base, len(names))
        for i in range(j)
        if abs(matrix[i, j]) > _LARGE_CORRELATION
    ]
    return tuple(sorted(pairs, key=lambda pair: -abs(pair[2]))[:_MOST_PAIRS])
