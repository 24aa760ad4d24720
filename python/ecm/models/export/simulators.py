"""MuJoCo: a passive plugin of the whole model, scenes that load it, and the linear part alone.

Energy at rest to second order, U = h0.dp + dp.H dp / 2 with H the generalised stiffness at the
undeformed pose. H = sum_k lambda_k v_k v_k', so six fixed tendons over the platform's six joints,
each with stiffness lambda_k and coefficients v_k, are exactly this energy.

OpenSim: an ExpressionBasedBushingForce, six polynomials of its six deflections. OpenSim measures
the platform in the base by its origin delta and the angles a, b, c of a body-fixed rotation
x-y'-z''. Its force on the platform is minus the F expressions in the axes of the base; its moment
has minus the M expressions as generalised forces to a, b, c: M_k is the model's moment along the
axis of angle k, which are x, the once turned y and the twice turned z. All six are then the
derivatives of an energy to the deflections, where the model has one.

The rotation vector is no polynomial of these angles, and Lepton, which reads expressions, copies
each definition into each place of its use: an exact chain from deflections to an energy of degree 4
takes half a minute to load. So polynomials are fitted over poses like the measured ones.
"""

from __future__ import annotations

import hashlib
import io
import platform
import sys
from collections.abc import Iterator
from contextlib import suppress
from typing import Any
from xml.sax.saxutils import escape
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

import numpy as np
from scipy.spatial.transform import Rotation

from ecm._native import left_jacobians, polynomial_exponents
from ecm.errors import ComputationError, InputError
from ecm.io.arrays import F, lstsq, rms_of_columns
from ecm.io.columns import WRENCH
from ecm.models.errors import worst_over
from ecm.models.export.source import LINUX, WINDOWS, Exported, Source, shared_library
from ecm.models.measured_poses import measured_poses, noise_sd
from ecm.models.model import Model
from ecm.regression.rows import taken_by

_JOINTS = ("x", "y", "z", "theta_x", "theta_y", "theta_z")


def linear_tendons(
    name: str, length_m: float, wrench: F, stiffness: F, damping_s: float = 0
) -> str:
    """MJCF of six fixed tendons over the platform's joints: the energy to second order.

    Parameters
    ----------
    wrench
        (6,) at the undeformed pose, N and N m.
    stiffness
        (6, 6) generalised stiffness there.
    damping_s
        Damping over stiffness. With the time step itself an integrator that is implicit in the
        velocity steps as backward Euler does: q'' = -k (q + dt q').
    """
    # Lengths by L, so that newtons per metre and newton metres mix in the eigenvectors evenly.
    scale = np.array([length_m] * 3 + [1.0] * 3)
    values, vectors = np.linalg.eigh(scale[:, None] * stiffness * scale)
    if values[0] <= 0.0:
        raise InputError(
            f"the model is unstable at the undeformed pose (smallest eigenvalue of the "
            f"stiffness {values[0]:.3g} N m): springs cannot hold it; fit it again, or export to c"
        )
    tendons = []
    for k, (value, vector) in enumerate(zip(values, vectors.T, strict=True)):
        along = vector / scale
        offset = -float(vector @ (scale * wrench)) / value
        parts = "".join(
            f'\n      <joint joint="{name}_{joint}" coef="{c:.17g}"/>'
            for joint, c in zip(_JOINTS, along, strict=True)
        )
        damping = f'damping="{damping_s * value:.17g}" ' if damping_s else ""
        tendons.append(
            f'    <fixed name="{name}_mode_{k}" stiffness="{value:.17g}" {damping}'
            f'springlength="{offset:.17g}">{parts}\n    </fixed>'
        )
    return "\n".join(tendons)


def platform_joints(name: str) -> str:
    """MJCF of the platform's three slides and three hinges: the pose minus that at rest."""
    axes = ("1 0 0", "0 1 0", "0 0 1")
    return "".join(
        f'\n      <joint name="{name}_{joint}" type="{kind}" axis="{axis}"/>'
        for joint, kind, axis in zip(_JOINTS, ["slide"] * 3 + ["hinge"] * 3, axes * 2, strict=True)
    )


_LARGEST_STEP_S = 2e-3
"""MuJoCo's own default."""
_COMPARED = 500
"""Poses at which the linear part is compared with the model."""


def mujoco(source: Source) -> Exported:
    """The plugin with its build script, two scenes, and the linear part without a plugin."""
    source.need_whole("mujoco", with_actuators=source.whole)
    name = source.name
    pose, wrench, stiffness, skew = _at_rest(source.inside)
    compared = source.poses(_COMPARED)
    linear = wrench + (compared[:, :6] - pose) @ stiffness
    lost = _lost(source.inside.base.predict(compared), linear, skew)
    mass, inertia, chosen = source.platform()
    poses = source.poses()
    alone = largest_step(source.inside, poses, mass, inertia)
    shared = largest_step(source.inside, poses, mass, inertia, stiffness)
    step = _below(min(_LARGEST_STEP_S, 0.25 * alone))
    values = {
        "LENGTH": f"{pose[0]:.17g}",
        "MASS": f"{mass:.9g}",
        "INERTIA": f"{inertia:.9g}",
        "TIMESTEP": f"{step:g}",
        "ALONE": f"{alone:.2g}",
        "SHARED": _said(shared),
        "JOINTS": platform_joints(name),
        "TENDONS": linear_tendons(name, pose[0], wrench, stiffness, step),
        "LINEAR": linear_tendons(name, pose[0], wrench, stiffness),
        "LOST": "\n".join(f"  {line}" for line in lost),
        "INPUTCOUNT": str(len(source.actuators)),
        "INPUTNAMES": "".join(f'"{name}_{column}", ' for column in source.actuators),
        "ACTUATORS": _inputs(source, poses),
    }
    written: dict[str, str | bytes] = {
        **source.code(),
        f"{name}.xml": source.template("mujoco/linear.xml", values),
        f"{name}_plugin.cc": source.template("mujoco/plugin.cc", values),
        f"{name}_plugin.xml": source.template("mujoco/plugin.xml", values),
        f"{name}_free.xml": source.template("mujoco/free.xml", values),
        f"{name}_build.sh": source.template("mujoco/build.sh"),
    }
    notes = (
        *chosen,
        f"The plugin is the whole model. For a platform of {mass:.3g} kg and {inertia:.3g} kg m2 "
        f"{name}_free.xml, the plugin alone, is stable up to steps of "
        f"{alone:.2g} s; {name}_plugin.xml, with the linear part as damped tendons that the "
        f"implicit integrator sees, {_said(shared)} (linear theory at {len(poses)} poses).",
        f"{name}.xml, the linear part without a plugin:",
        *lost,
    )
    if source.actuators:
        listed = ", ".join(f"{name}_{column}" for column in source.actuators)
        notes = (
            f"Inputs: controls of the actuators {listed}, which do no force themselves; with a "
            "`dyntype` of MuJoCo their activations, so that a valve may lag. Without the plugin, "
            "and in the tendons, they are 0.",
            *notes,
        )
    build = f"sh @OUT@/{name}_build.sh python   (the Python that has mujoco)"
    return Exported(written, notes, next_step=build)


def _inputs(source: Source, poses: F) -> str:
    """MJCF of one control for each input, with its measured range."""
    if not source.actuators:
        return ""
    low, high = np.minimum(poses[:, 6:].min(axis=0), 0.0), poses[:, 6:].max(axis=0)
    ranges = zip(source.actuators, low, high, strict=True)
    lines = "".join(
        f'\n    <general name="{source.name}_{column}" site="{source.name}_top" '
        f'gear="0 0 0 0 0 0" ctrllimited="true" ctrlrange="{low:.9g} {high:.9g}"/>'
        for column, low, high in ranges
    )
    return f"\n  <actuator>{lines}\n  </actuator>"


def _at_rest(model: Model) -> tuple[F, F, F, float]:
    """Rest pose, wrench and symmetric stiffness there, and the share that is skew."""
    pose = model.rest_pose("a MuJoCo export")
    generalised = model.base.stiffness(pose, "generalised")[0]
    skew = np.abs(generalised - generalised.T).max() / np.abs(generalised).max()
    symmetric = 0.5 * (generalised + generalised.T)
    return pose[0], model.base.predict(pose)[0], symmetric, float(skew)


def largest_step(
    model: Model, poses: F, mass_kg: float, inertia_kg_m2: float, implicit: F | None = None
) -> float:
    """Largest stable time step (s) of a platform on the mechanism, by linear theory at poses.

    Semi-implicit Euler with the stiffness H explicit, and H0 as in backward Euler beside it, takes
    (M + dt^2 H0) v' = M v - dt H x: it is stable while 4 M + dt^2 (2 H0 - H) is positive.

    Parameters
    ----------
    implicit
        (6, 6) H0, N/m to N m; None: nothing is implicit.
    """
    stiffness = model.base.stiffness(poses, "generalised")
    excess = 0.5 * (stiffness + stiffness.transpose(0, 2, 1))
    if implicit is not None:
        excess = excess - 2.0 * implicit
    turned = left_jacobians(np.ascontiguousarray(poses[:, 3:6]))
    mass = np.zeros((len(poses), 6, 6))
    mass[:, :3, :3] = mass_kg * np.eye(3)
    mass[:, 3:, 3:] = inertia_kg_m2 * turned.transpose(0, 2, 1) @ turned
    largest = np.linalg.eigvals(np.linalg.solve(mass, excess)).real.max()
    return float(2.0 / np.sqrt(largest)) if largest > 0.0 else np.inf


def _said(step: float) -> str:
    return f"up to {step:.2g} s" if np.isfinite(step) else "at any step"


def _below(step: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is not above."""
    power = 10.0 ** np.floor(np.log10(step))
    digit = max(d for d in (1.0, 2.0, 5.0) if d * power <= step * (1.0 + 1e-9))
    return float(f"{digit * power:.1g}")


def _lost(exact: F, linear: F, skew: float) -> list[str]:
    """What the linear part leaves out, in words."""
    share = rms_of_columns(linear - exact) / rms_of_columns(exact)
    listed = ", ".join(
        f"{column.rsplit('_', 1)[0]} {100 * s:.0f} %"
        for column, s in zip(WRENCH, share, strict=True)
    )
    lost = [
        "Lost: everything beyond the linear part (stiffening, couplings that grow with the pose).",
        f"At the measured poses the wrench is off by (rms share): {listed}.",
    ]
    if skew > 1e-9:
        lost.append(f"Lost: the skew part of the stiffness, {100 * skew:.2g} % of its largest.")
    return lost


DEFLECTIONS = ("delta_x", "delta_y", "delta_z", "theta_x", "theta_y", "theta_z")
_VARIABLES = ("ua", "ub", "uc", "ud", "ue", "uf")
_DEGREES = (2, 3, 4, 5)
_ALIKE = 0.3
"""Change over the noise that a measurement cannot tell; the least degree that reaches it."""
_POSES = 2400


def opensim(source: Source) -> Exported:
    """NAME.osim: ground, a platform on a free joint, and the bushing between them."""
    source.need_whole("opensim")
    poses = source.poses(_POSES)
    wrenches = source.inside.base.predict(poses)
    expressions, degree, change = fitted_expressions(poses, wrenches, noise_sd(source.model))
    mass, inertia, chosen = source.platform()
    values = {
        "MASS": f"{mass:.9g}",
        "INERTIA": f"{inertia:.9g}",
        "REST": f"{poses[:, 0].mean():.9g}",
        "DEGREE": str(degree),
        "CHANGE": f"{change:.2g}",
        **expressions,
    }
    notes = (
        *chosen,
        f"Polynomials of degree {degree} in the six deflections differ from the model by "
        f"{change:.2g} of the measurement noise (rms, worst component, poses like the measured "
        "ones); beyond the measured range they mean nothing. No state: effects of time stay out.",
    )
    step = f"opensim-cmd info @OUT@/{source.name}.osim, or open it in OpenSim; docs/export.md"
    file = source.template("opensim/model.osim", values)
    return Exported({f"{source.name}.osim": file}, notes, next_step=step, change=change)


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
    turned = Rotation.from_rotvec(poses[:, 3:])
    angles = turned.as_euler("XYZ")
    axes = np.zeros((len(poses), 3, 3))
    axes[:, 0, 0] = 1.0
    axes[:, 1, 1], axes[:, 1, 2] = np.cos(angles[:, 0]), np.sin(angles[:, 0])
    axes[:, 2] = turned.as_matrix()[:, :, 2]
    return np.hstack([poses[:, :3], angles]), axes


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
        powers = polynomial_exponents(len(DEFLECTIONS), degree)
        if len(powers) > kept.sum():
            break
        columns = np.prod(u[:, None, :] ** powers, axis=2)
        found = lstsq(columns[kept], values[kept])
        error = (columns @ found - values)[~kept]
        error[:, 3:] = np.linalg.solve(axes[~kept], error[:, 3:, None])[:, :, 0]
        change = worst_over(noise, error)
        if best is None or change < best[3]:
            best = (powers, found, degree, change)
        if change < _ALIKE:
            break
    if best is None:
        least = 4 * len(polynomial_exponents(len(DEFLECTIONS), _DEGREES[0])) // 3 + 2
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
    terms = [tuple(own) for own in powers.tolist()]
    expressions = {
        name: f"{_horner(dict(zip(terms, x, strict=True)))};{definitions}"
        for name, x in zip(names, found.T.tolist(), strict=True)
    }
    return expressions, degree, change


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


_UNITS = {
    "m": '<BaseUnit m="1"/>',
    "rad": '<BaseUnit rad="1"/>',
    "N": '<BaseUnit kg="1" m="1" s="-2"/>',
    "Nm": '<BaseUnit kg="1" m="2" s="-2"/>',
    "s": '<BaseUnit s="1"/>',
    "Pa": '<BaseUnit kg="1" m="-1" s="-2"/>',
    "degC": '<BaseUnit K="1" offset="273.15"/>',
}
_CONDITIONS = ("temperature_degC", "age_s")
_SCALAR = '    <ScalarVariable name="{name}" valueReference="{reference}" causality='
_REAL = '<Real unit="{unit}"'
_FLOAT = '    <Float64 name="{name}" valueReference="{reference}" causality='
_LINES = {
    2: {
        "input": f'{_SCALAR}"input" variability="continuous">{_REAL} start="{{start}}"/>'
        "</ScalarVariable>",
        "output": f'{_SCALAR}"output" variability="continuous" initial="calculated">{_REAL}/>'
        "</ScalarVariable>",
        "inside": f'{_SCALAR}"output" variability="discrete" initial="calculated"><Integer/>'
        "</ScalarVariable>",
        "dependent": ['      <Unknown index="{reference}" dependencies="{needs}"/>'],
    },
    3: {
        "input": f'{_FLOAT}"input" unit="{{unit}}" start="{{start}}"/>',
        "output": f'{_FLOAT}"output" initial="calculated" unit="{{unit}}"/>',
        "inside": '    <Int32 name="{name}" valueReference="{reference}" causality="output" '
        'variability="discrete" initial="calculated"/>',
        "dependent": [
            '    <Output valueReference="{reference}" dependencies="{needs}"/>',
            '    <InitialUnknown valueReference="{reference}" dependencies="{needs}"/>',
        ],
    },
}
"""Lines of the description of each version of FMI."""


def fmu(source: Source) -> Exported:
    """NAME_fmi2.fmu and NAME_fmi3.fmu."""
    start, outputs = _fmu_inputs(source), source.inside.outputs
    code = source.code()
    token = hashlib.sha256("".join(code[path] for path in sorted(code)).encode()).hexdigest()
    parts = [path for path in code if not path.endswith(("_check.c", "_golden.h"))]
    sources = [path for path in parts if path.endswith(".c")]
    values = {
        "STEPSOFINPUTS": str(len(sources) - 1),
        "TOKEN": token,
        "MARK": f"0x{token[:15]}u",
        "N": str(len(taken_by(source.inside.base))),
        "M": str(len(outputs)),
        "START": ", ".join(f"{x:.17g}" for x in start.values()),
    }
    written: dict[str, str | bytes] = {}
    made: set[str] = set()
    for major in _LINES:
        files = {path: code[path] for path in parts}
        files["instance.h"] = source.template("fmu/instance.h", values)
        files[f"fmi{major}.c"] = source.template(f"fmu/fmi{major}.c", values)
        archive: dict[str, str | bytes] = {f"sources/{path}": text for path, text in files.items()}
        compiled = (*sources, f"fmi{major}.c")
        line = '      <SourceFile name="{}"/>' if major == 3 else '      <File name="{}"/>'
        listed = {"SOURCES": "\n".join(map(line.format, sources))}
        for folder, name, commands in _platforms(major, source.name):
            with suppress(ComputationError):  # the sources go into the archive all the same
                archive[f"binaries/{folder}/{name}"] = shared_library(files, compiled, commands)
                made.add("Windows" if name.endswith("dll") else "this machine")
        described = values | listed | _described(major, start, outputs)
        description = source.template(f"fmu/modelDescription{major}.xml", described)
        archive["modelDescription.xml"] = description
        if major == 3:
            archive["sources/buildDescription.xml"] = source.template(
                "fmu/buildDescription.xml", listed
            )
        written[f"{source.name}_fmi{major}.fmu"] = _zipped(archive)
    held = (
        f"binaries for {' and '.join(sorted(made))}"
        if made
        else "no binary: cc was not found, or failed"
    )
    notes = (
        f"FMUs for co-simulation with sources and {held}; K as directional derivatives; states may "
        "be read, set and stored.",
    )
    step = f"fmpy simulate @OUT@/{source.name}_fmi3.fmu --show-plot"
    return Exported(written, notes, next_step=step)


def _fmu_inputs(source: Source) -> dict[str, float]:
    """Start of each input: the pose, then actuators, then what effects of time follow."""
    model = source.inside
    if source.whole and model.known_length_m is not None:
        start = model.rest_pose("an FMU")[0]
    elif source.whole:
        start = measured_poses(source.model)[0]
    else:
        start = np.array([0.5 * sum(model.domain.get(name, (0.0, 0.0))) for name in model.inputs])
    taken = taken_by(model.base)
    inputs = dict.fromkeys(taken, 0.0) | dict(zip(taken, map(float, start), strict=False))
    if source.has_state:
        reference = float(source.timed.document.get("reference_degc", 0.0))
        inputs |= dict(zip(_CONDITIONS, (reference, 0.0), strict=True))
    return inputs


def _unit(column: str) -> str:
    return column.rpartition("_")[2]


def _described(major: int, start: dict[str, float], outputs: tuple[str, ...]) -> dict[str, str]:
    """Variables of a description; value references count as in `instance.h`, from the time, 0."""
    lines: dict[str, Any] = _LINES[major]
    names = (*start, *outputs, "inside")
    variables = []
    for reference, name in enumerate(names, start=1):
        kind = "input" if name in start else "output" if name in outputs else "inside"
        known = {"name": escape(name, {'"': "&quot;"}), "unit": _unit(name)}
        known["start"] = f"{start.get(name, 0.0):.17g}"
        variables.append(lines[kind].format(reference=reference, **known))
    needs = " ".join(str(1 + i) for i in range(len(start)))
    dependent = [
        line.format(reference=reference, needs=needs)
        for line in lines["dependent"]
        for reference in range(1 + len(start), 1 + len(names))
    ]
    used = {_unit(name) for name in names}
    units = [f'    <Unit name="{unit}">{_UNITS[unit]}</Unit>' for unit in _UNITS if unit in used]
    listed = {"VARIABLES": variables, "DEPENDENT": dependent, "UNITS": units}
    return {key: "\n".join(own) for key, own in listed.items()}


def _platforms(major: int, name: str) -> Iterator[tuple[str, str, tuple[tuple[str, ...], ...]]]:
    """Folder and file of each binary, and the compilers that can make it."""
    if sys.platform == "linux" and platform.machine() in ("x86_64", "aarch64"):
        folder = f"{platform.machine()}-linux" if major == 3 else "linux64"
        if major == 3 or platform.machine() == "x86_64":  # FMI 2 has no name for aarch64
            yield folder, f"{name}.so", LINUX
    yield "x86_64-windows" if major == 3 else "win64", f"{name}.dll", WINDOWS


def _zipped(archive: dict[str, str | bytes]) -> bytes:
    """A zip file whose bytes depend on the content alone."""
    memory = io.BytesIO()
    with ZipFile(memory, "w", ZIP_DEFLATED) as file:
        for path in sorted(archive):
            info = ZipInfo(path, (1980, 1, 1, 0, 0, 0))
            info.create_system, info.external_attr = 3, 0o644 << 16  # Unix: all may read
            file.writestr(info, archive[path], ZIP_DEFLATED)
    return memory.getvalue()
