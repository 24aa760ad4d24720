"""OpenSim: an ExpressionBasedBushingForce, six polynomials of its six deflections.

OpenSim measures the platform in the base by its origin delta and the angles a, b, c of a body-fixed
rotation x-y'-z''. Its force on the platform is minus the F expressions in the axes of the base; its
moment has minus the M expressions as generalised forces to a, b, c: M_k is the model's moment along
the axis of angle k, which are x, the once turned y and the twice turned z. All six are then the
derivatives of an energy to the deflections, where the model has one.

The rotation vector is no polynomial of these angles, and Lepton, which reads expressions, copies
each definition into each place of its use: an exact chain from deflections to an energy of degree 4
takes half a minute to load. So polynomials are fitted over poses like the measured ones.
"""

from __future__ import annotations

from itertools import combinations_with_replacement

import numpy as np

from ecm._native import rotation_matrices
from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.models.control import LoopSettings
from ecm.models.export.mujoco import INERTIA_KG_M2, MASS_KG
from ecm.models.export.source import Files, Source
from ecm.models.measured_poses import noise_sd

DEFLECTIONS = ("delta_x", "delta_y", "delta_z", "theta_x", "theta_y", "theta_z")
_VARIABLES = ("ua", "ub", "uc", "ud", "ue", "uf")
_DEGREES = (2, 3, 4, 5)
_ALIKE = 0.3
"""Change over the noise that a measurement cannot tell; the least degree that reaches it."""
_POSES = 2400


def opensim(source: Source) -> Files:
    """NAME.osim: ground, a platform on a free joint, and the bushing between them."""
    source.need_whole("opensim")
    poses = source.poses(_POSES)
    wrenches = source.inside.base.predict(poses)
    expressions, degree, change = fitted_expressions(poses, wrenches, noise_sd(source.model))
    loop = source.loop or LoopSettings()
    values = {
        "MASS": f"{loop.mass_kg or MASS_KG:.9g}",
        "INERTIA": f"{loop.inertia_kg_m2 or INERTIA_KG_M2:.9g}",
        "REST": f"{poses[:, 0].mean():.9g}",
        "DEGREE": str(degree),
        "CHANGE": f"{change:.2g}",
        **expressions,
    }
    notes = (
        f"Polynomials of degree {degree} in the six deflections differ from the model by "
        f"{change:.2g} of the measurement noise (rms, worst component, poses like the measured "
        "ones); beyond the measured range they mean nothing. No state: effects of time stay out.",
    )
    step = f"opensim-cmd info @OUT@/{source.name}.osim, or open it in OpenSim; docs/export.md"
    return Files({f"{source.name}.osim": source.template("opensim/model.osim", values)}, step,
                 notes, change=change)  # fmt: skip


def deflections(poses: F) -> tuple[F, F]:
    """Deflections of the bushing at poses, and the axes of its three angles.

    Parameters
    ----------
    poses
        (N, 6) poses of the platform in the base.

    Returns
    -------
    deflections, axes
        (N, 6) delta_x to theta_z, m and rad; (N, 3, 3) the axis of each angle, in rows.

    Examples
    --------
    >>> at, axes = deflections(np.array([[0.1, 0.0, 0.0, 0.0, 0.0, 0.5]]))
    >>> at.round(3).tolist()
    [[0.1, 0.0, 0.0, -0.0, 0.0, 0.5]]
    """
    turned = rotation_matrices(np.ascontiguousarray(poses[:, 3:]))
    a = np.arctan2(-turned[:, 1, 2], turned[:, 2, 2])
    b = np.arcsin(np.clip(turned[:, 0, 2], -1.0, 1.0))
    c = np.arctan2(-turned[:, 0, 1], turned[:, 0, 0])
    axes = np.zeros((len(poses), 3, 3))
    axes[:, 0, 0] = 1.0
    axes[:, 1, 1], axes[:, 1, 2] = np.cos(a), np.sin(a)
    axes[:, 2] = turned[:, :, 2]
    return np.column_stack([poses[:, :3], a, b, c]), axes


def fitted_expressions(poses: F, wrenches: F, noise: F) -> tuple[dict[str, str], int, float]:
    """The six expressions, their degree, and the change of a wrench over its noise (rms)."""
    at, axes = deflections(poses)
    values = wrenches.copy()
    values[:, 3:] = np.einsum("nij,nj->ni", axes, wrenches[:, 3:])
    middle, half = 0.5 * (at.max(axis=0) + at.min(axis=0)), 0.5 * np.ptp(at, axis=0)
    half = np.where(half > 0.0, half, 1.0)  # a deflection that never changes
    u = (at - middle) / half
    kept = np.arange(len(poses)) % 4 > 0  # the fourth part tells the error
    best = None
    for degree in _DEGREES:
        powers = _powers(degree)
        if len(powers) > kept.sum():
            break
        columns = np.prod(u[:, None, :] ** powers, axis=2)
        found = np.linalg.lstsq(columns[kept], values[kept], rcond=None)[0]
        error = (columns @ found - values)[~kept]
        error[:, 3:] = np.linalg.solve(axes[~kept], error[:, 3:, None])[:, :, 0]
        change = float(np.max(np.sqrt((error**2).mean(axis=0)) / noise))
        if best is None or change < best[3]:
            best = (powers, found, degree, change)
        if change < _ALIKE:
            break
    if best is None:
        least = 4 * len(_powers(_DEGREES[0])) // 3 + 2
        raise InputError(
            f"--to opensim: {len(poses)} poses like the measured ones are too few for polynomials, "
            f"at least {least} are needed: measure more, or export to c"
        )
    powers, found, degree, change = best
    definitions = ";".join(
        f"{letter}=({name}-({m!r}))*{(1.0 / h)!r}"
        for letter, name, m, h in zip(
            _VARIABLES, DEFLECTIONS, middle.tolist(), half.tolist(), strict=True
        )
    )
    names = ("FX", "FY", "FZ", "MX", "MY", "MZ")
    return (
        {
            name: f"{_horner(dict(zip(map(tuple, powers.tolist()), x.tolist(), strict=True)))};"
            f"{definitions}"
            for name, x in zip(names, found.T, strict=True)
        },
        degree,
        change,
    )


def _powers(degree: int) -> F:
    chosen = (
        some for k in range(degree + 1) for some in combinations_with_replacement(range(6), k)
    )
    return np.array([[some.count(i) for i in range(6)] for some in chosen])


def _horner(terms: dict[tuple[int, ...], float]) -> str:
    """A polynomial nested by its first variable, each coefficient a polynomial of the others."""
    power = next(iter(terms))
    if not power:
        return f"({terms[power]!r})"
    letter = _VARIABLES[len(_VARIABLES) - len(power)]
    parts: dict[int, dict[tuple[int, ...], float]] = {}
    for power, x in terms.items():
        parts.setdefault(power[0], {})[power[1:]] = x
    text = ""
    for k in range(max(parts), -1, -1):
        text = f"{letter}*({text})+{_horner(parts[k])}" if text else _horner(parts[k])
    return text
