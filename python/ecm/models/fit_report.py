"""The fit report: values with errors, what moves together, and what each addition was worth."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ecm.models.history import FitRecord
    from ecm.models.joint_fit import FittedEffect, JointFit
    from ecm.models.maps import StiffnessMap

_TOGETHER = 0.3
_MOST_PAIRS = 12


def fit_report(
    name: str,
    base: StiffnessMap,
    effects: Sequence[FittedEffect],
    correlations: Sequence[tuple[str, str, float]],
    history: Sequence[FitRecord],
) -> str:
    """Text: parameters of physics, then of the instruments, correlations, the error ladder."""
    lines = [f"model {name}: {len(base.coefficients)} coefficients in the base"]
    for side, title in (("physics", "physics"), ("measurement", "instruments")):
        for item in (i for i in effects if i.effect.side == side):
            shape = "".join(f", {k} = {v}" for k, v in item.effect.shape.items())
            lines.append(f"  {item.id} ({title}{shape}){' frozen' if item.frozen else ''}")
            for parameter, value, sd in zip(
                item.effect.parameters, item.values, item.sd, strict=True
            ):
                error = f" +- {sd:.2g}" if np.isfinite(sd) else " (not fitted)"
                near = 1e-6 * parameter.scale
                bound = value - parameter.lower < near or parameter.upper - value < near
                at = " at its bound" if bound else ""
                lines.append(f"    {parameter.name} = {value:.4g}{error} {parameter.unit}{at}")
    if correlations:
        lines.append("  correlations beyond 0.3:")
        lines += [f"    {a} and {b}: {value:+.2f}" for a, b, value in correlations]
    for rung in history:
        ceiling = "" if rung.ceiling is None else f", ceiling {rung.ceiling:.3f}"
        lines.append(
            f"  {rung.name}: error over noise {rung.train:.3f} fitted, "
            f"{rung.held_out:.3f} held out{ceiling}, floor {rung.floor:g}"
        )
        if rung.test:
            lines.append(f"    {rung.test}")
    return "\n".join(lines)


def correlations_of(found: JointFit, base_frozen: bool) -> tuple[tuple[str, str, float], ...]:
    """Pairs of effect parameters, and of these with the base's coefficients, that go together."""
    own = [
        f"{item.id}.{parameter.name}"
        for item in found.effects
        if not item.frozen
        for parameter in item.effect.parameters
    ]
    base = 0 if base_frozen else len(found.base.coefficients)
    names = [*(f"base.{j + 1}" for j in range(base)), *own]
    sd = np.sqrt(np.maximum(np.diag(found.covariance), 1e-300))
    matrix = found.covariance / np.outer(sd, sd)
    pairs = [
        (names[i], names[j], float(matrix[i, j]))
        for j in range(base, len(names))
        for i in range(j)
        if abs(matrix[i, j]) > _TOGETHER
    ]
    return tuple(sorted(pairs, key=lambda pair: -abs(pair[2]))[:_MOST_PAIRS])
