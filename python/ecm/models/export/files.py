"""A model written for a controller or a simulator, and the registry of all targets.

What is exported is the mechanism: the base map, effects of physics that act through the pose, and
as steps with a state those of time and temperature. Errors of the instruments stay out, and the
result says which and why.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Literal

import numpy as np

from ecm.effects.protocol import AtColumns
from ecm.errors import InputError, Remedy
from ecm.io.arguments import check_arguments, path_of
from ecm.io.arrays import F
from ecm.io.cache import write_atomically
from ecm.io.columns import POSE
from ecm.io.interrupts import uninterrupted
from ecm.models.control_loop import ControlLoop, LoopSettings, design_loop
from ecm.models.controller import AdaptSettings
from ecm.models.export.simulators import fmu, mujoco, opensim
from ecm.models.export.source import Exported, Precision, Source, Target, without
from ecm.models.measured_poses import folded, has_measured_poses, measured_poses
from ecm.models.model import Model
from ecm.models.time_effects import NEEDS_ENERGY, NEEDS_POLYNOMIAL, OF_INPUTS, time_effects
from ecm.regression.blas import one_blas_thread
from ecm.regression.rows import actuators_of, is_whole, taken_by


def c(source: Source) -> Exported:
    """C99: header, source, golden vectors, and a loop; steps of recorded inputs."""
    name = source.name
    step = f"cc -O2 @OUT@/{name}.c @OUT@/{name}_check.c -o check && ./check"
    if source.adapt is not None:
        crate = f"@OUT@/{name}_adapt"
        step = (
            f"cargo build --release --manifest-path {crate}/Cargo.toml && cc -O2 @OUT@/{name}.c "
            f"{crate}_check.c {crate}/target/release/lib{name}_adapt.a -o check && ./check"
        )
    return _code(source, "c", f"{step}   (0: the compiler keeps the golden vectors)")


def rust(source: Source) -> Exported:
    """A crate without the standard library."""
    return _code(source, "rust", "cargo test --release --manifest-path @OUT@/Cargo.toml")


def _code(source: Source, language: Literal["c", "rust"], next_step: str) -> Exported:
    written: dict[str, str | bytes] = dict(source.code(language))
    if not source.whole or source.actuators:
        return Exported(written, next_step=next_step)
    poses = source.poses()
    try:
        stiffness = source.inside.base.stiffness(poses, "screw")
        loop = design_loop(poses, stiffness, source.loop, stiffer=source.timed.stiffer)
    except InputError as error:
        return Exported(written, (f"No control loop: {error}.",), next_step=next_step)
    if loop.holds.any():
        path = f"{source.name}_control.c" if language == "c" else "examples/control.rs"
        written[path] = _loop_example(source, loop, language == "c")
    return Exported(written, loop.sentences(), loop=loop, next_step=next_step)


def _loop_example(source: Source, loop: ControlLoop, c: bool) -> str:
    """The example of a loop that holds some pose; with a state it begins after a long rest."""
    model, sentences = source.model, loop.sentences()
    rest = model.rest_pose("a loop with a state")[0] if source.has_state else np.zeros(6)
    # The push ends after 700 steps; the slowest error then falls by a factor of e^20, and what the
    # platform, which is softer than the model, relaxes otherwise than that by e^5.
    tails = [5.0 * branch["tau_s"] for branch in source.timed.document.get("branches", ())]
    settled = np.ceil(max(20.0 / loop.decay_per_s, *tails, 0.0) / loop.gains.dt_s)

    def listed(values: F) -> str:
        return ", ".join(f"R({x:.9e})" if c else f"{x:.9e}" for x in values)

    prefix = " *     " if c else "//! "
    lines = textwrap.wrap(" ".join(sentences), 90 - len(prefix))
    values = {
        "SUMMARY": "\n".join(prefix + line for line in lines),
        "PRINTED": "\n".join(_printed(sentence, c) for sentence in sentences),
        "REAL": {"double": "f64", "single": "f32"}[source.precision],
        "COUNT": str(int(np.clip(700 + settled, 4000, 100_000))),
        "DELAY": str(loop.gains.delay_steps),
        "DT": f"{loop.gains.dt_s:e}",
        "MASS": f"{loop.mass_kg:e}",
        "INERTIA": f"{loop.inertia_kg_m2:e}",
        "BANDWIDTH": f"{loop.gains.bandwidth_rad_s:e}",
        "GRAVITY": listed(np.asarray(model.scene.gravity_m_s2)),
        "HELD": listed(loop.held),
        "REST": listed(rest),
        "COLUMNS": ", ".join(f'"{column}"' for column in POSE),
    }
    return source.template("control/control.c" if c else "control/control.rs", values)


def _printed(sentence: str, c: bool) -> str:
    if c:
        parts = textwrap.wrap(sentence.replace("%", "%%"), 80, drop_whitespace=False)
        quoted = "\n".join(f'           "{part}"' for part in parts).lstrip()
        return f'    printf({quoted}\n           "\\n");'
    quoted = " \\\n         ".join(textwrap.wrap(sentence, 80))
    return f'    println!(\n        "{quoted}"\n    );'


def drake(source: Source) -> Exported:
    """A LeafSystem that pushes on the bodies of a MultibodyPlant."""
    rest = source.inside.rest_pose("a Drake export")[0] if source.whole else ()
    values = {"REST": ", ".join(f"{x:.17g}" for x in rest)}
    return _beside(source, "drake", "system.py.txt", f"{source.name}_drake.py", values)


def pinocchio(source: Source) -> Exported:
    """External forces of the joints between two frames."""
    return _beside(source, "pinocchio", "forces.py.txt", f"{source.name}_pinocchio.py")


def ros2(source: Source) -> Exported:
    """A node from stamped poses to stamped wrenches."""
    step = f"python @OUT@/{source.name}_node.py, in a shell with ROS 2 set up"
    return _beside(source, "ros2", "node.py.txt", f"{source.name}_node.py", step=step)


def _beside(
    source: Source,
    target: str,
    template: str,
    path: str,
    values: dict[str, str] | None = None,
    step: str | None = None,
) -> Exported:
    source.need_whole(target)
    written: dict[str, str | bytes] = {
        **source.code(),
        f"{source.name}_model.py": source.template("python/model.py.txt"),
        path: source.template(f"{target}/{template}", values),
    }
    step = step or f"PYTHONPATH=@OUT@ python -c 'import {path[:-3]}'"
    return Exported(written, next_step=step)


def simulink(source: Source) -> Exported:
    """NAME.c and NAME.h for a C Caller block, NAME_sfun.c, NAME_mex.c."""
    source.need_whole("simulink")
    name = source.name
    own = {f"{name}_{kind}.c": source.template(f"simulink/{kind}.c") for kind in ("sfun", "mex")}
    step = (
        f"in MATLAB, in @OUT@: mex {name}_sfun.c {name}.c   "
        f"(Octave: mkoctfile --mex {name}_mex.c {name}.c)"
    )
    return Exported({**source.code(), **own}, next_step=step)


_LOOP = tuple(one.name for one in fields(LoopSettings))
TARGETS: dict[str, Target] = {
    "c": Target(c, precisions=("double", "single"), recorded=True, columns=True, robot=_LOOP),
    "rust": Target(
        rust, language="rust", precisions=("double", "single"), recorded=True, robot=_LOOP
    ),
    "mujoco": Target(mujoco, taken=("mj",), robot=_LOOP[:2]),
    "fmu": Target(fmu, recorded=True, taken=("instance", "fmi2", "fmi3")),
    "opensim": Target(opensim, language="none", robot=_LOOP[:2]),
    "simulink": Target(simulink, taken=("mex", "simstruc", "simulink")),
    "drake": Target(drake),
    "pinocchio": Target(pinocchio),
    "ros2": Target(ros2),
}
"""Every target; a new one is one more line here and one in the help of the command."""


_WITH_CODE = ("polynomial", "energy", "physics", "actuated")
"""Kinds of maps that `ecm._native.export_model` writes as they are."""
_EXPORTED = "Wrench and stiffness of an elastic mechanism"
"""Begins the description of exported crates."""
_NO_POSES = (
    "The model file holds no measured poses, as older ones do: poses were drawn from its domain. "
    "--data TABLE judges at measured ones; ecm fit and ecm refit write them into the file."
)
_MOST_FOLDING = 1.0
"""Largest change of a model by folding, over the noise, that is exported without `force`."""


@one_blas_thread()
def export(
    model: Model,
    to: str,
    directory: str | Path,
    *,
    name: str = "ecm_model",
    precision: Precision = "double",
    loop: LoopSettings | None = None,
    adapt: AdaptSettings | None = None,
    force: bool = False,
) -> Exported:
    """Write a model for a controller or a simulator.

    Parameters
    ----------
    model
        The model; effects of the instruments are left out.
    to
        A target of docs/export.md: `c`, `rust`, `mujoco`, `fmu`, ...
    directory
        Folder to write into; it is made where it does not exist.
    name
        Begins every public name: a lower-case letter, then at most 39 of a-z, 0-9 and _.
    precision
        Floating-point type of the code: `double`, or `single` for `c` and `rust` only.
    loop
        Mass, inertia and delay of the robot, for a control loop and for steps of time.
    adapt
        Parameters that follow measured wrenches (docs/adapt.md), `c` and `rust` only; None: none.
    force
        Write also where folding the effects into the base changes the model by more than the noise.

    Returns
    -------
    Exported
        The files (path to text), notes for their reader, and the effects that were left out.

    Raises
    ------
    InputError
        A wrong name, a model that cannot be exported, or one that folding changes too much.

    Examples
    --------
    >>> import tempfile, numpy as np, ecm
    >>> y = np.linspace(-0.01, 0.01, 9)
    >>> model = ecm.fit(ecm.as_table({"y_m": y, "fy_N": 3000.0 * y}), "linear")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     exported = ecm.export(model, "c", folder, name="spring")
    >>> sorted(exported.files)[:2]
    ['spring.c', 'spring.h']
    """
    check_arguments(export, locals())
    exported = export_files(model, to, name, precision, loop, adapt)
    if not force:
        _refuse_what_changed(model, exported, to, name)
    for path in exported.files:
        _check_crate(path_of(directory) / path)
    with uninterrupted():  # a part of the files is of no use
        for path, text in exported.files.items():
            write_atomically(path_of(directory) / path, text)
    return exported


def export_files(
    model: Model,
    target: str,
    name: str = "ecm_model",
    precision: Precision = "double",
    loop: LoopSettings | None = None,
    adapt: AdaptSettings | None = None,
) -> Exported:
    """Return the files that `export` writes, without writing them."""
    if target not in TARGETS:
        raise InputError(f"target {target!r}: expected one of {', '.join(TARGETS)}")
    if re.fullmatch(r"[a-z][a-z0-9_]{0,39}", name) is None:
        raise InputError(
            f"name {name!r}: expected a lower-case letter, then at most 39 of a-z, 0-9 and _"
        )
    chosen = TARGETS[target]
    if name in chosen.taken:
        raise InputError(f"name {name!r}: --to {target} uses it itself; choose another one")
    if precision not in chosen.precisions:
        raise InputError(
            f"precision {precision}: --to {target} is written in {' or '.join(chosen.precisions)}"
        )
    inside, notes, folding = _mechanism_alone(model)
    if not has_measured_poses(model):
        notes.append(_NO_POSES)
    actuated = bool(actuators_of(model.base))
    stored = model.training.get("poses") or [()]
    if actuated and len(stored[0]) != len(taken_by(model.base)):
        raise InputError(
            f"{model.name}: the model file holds no rows with the inputs of its actuators, so that "
            "nothing tells where it was measured",
            remedy=Remedy(
                "judge it at the rows of its table",
                f"ecm export MODEL --to {target} --out OUT --name {name} --data DATA",
            ),
        )
    follows = target in ("c", "rust") and is_whole(model.base) and not actuated
    if adapt is not None and not follows:
        raise InputError(
            "adapt: parameters follow readings in C and Rust, with a model of all six pose and "
            "wrench columns and no actuators; leave it out here"
        )
    _refuse_unused(loop, chosen.robot if follows or target not in ("c", "rust") else (), target)
    # An adapter steps alone, and nothing adds columns to what it says.
    columns = chosen.columns and adapt is None
    timed = time_effects(model, chosen.language, recorded=chosen.recorded, columns=columns)
    if timed.of_columns and timed.of_columns.effects:
        notes.append(timed.of_columns.sentence(model.conditions, f"{name}_columns.h"))
    given = chosen.write(Source(model, inside, timed, name, precision, loop, adapt))
    return replace(
        given,
        notes=(*timed.sentences(), *notes, *given.notes, *([adapt.sentence()] if adapt else [])),
        left_out=tuple(timed.left_out),
        folding=folding,
        folded=tuple(sorted(item.id for item in model.acting_at_poses)),
        lost=timed.lost_sentences(),
    )


def _refuse_unused(loop: LoopSettings | None, used: Sequence[str], to: str) -> None:
    """Raise InputError for a setting of the robot that no file of this model depends on."""
    own = LoopSettings()
    unused = [n for n in _LOOP if n not in used and getattr(loop or own, n) != getattr(own, n)]
    if unused:
        options = [f"--{name.partition('_')[0]} ({name})" for name in unused]
        raise InputError(
            f"{', '.join(options)}: no file of this "
            f"model for --to {to} depends on it; leave it out. Control loops are written to c and "
            "rust, for models of all six pose and wrench columns without actuators"
        )


def _refuse_what_changed(model: Model, exported: Exported, to: str, name: str) -> None:
    """Raise InputError where the files err, or lack, more than the noise."""
    again = f"ecm export MODEL --to {to} --out OUT --name {name}"
    if exported.folding > _MOST_FOLDING:
        known = has_measured_poses(model)
        raise InputError(
            f"{model.name}: as one map, with its effects, the model changes by "
            f"{exported.folding:.2g} times {_unit(model)} at "
            f"{'its measured poses' if known else 'poses drawn from its domain'}, more than "
            f"{_MOST_FOLDING:g}: the controller would not have the model that was fitted.",
            remedy=_without(_hard_to_fold(model, exported.folded), again, model, exported.folding)
            if known
            else Remedy("judge it at the poses that were measured", f"{again} --data DATA"),
        )
    if exported.change > _MOST_FOLDING:
        raise InputError(
            f"{model.name}: the form that --to {to} can hold changes the model by "
            f"{exported.change:.2g} times {_unit(model)}, more than {_MOST_FOLDING:g}.",
            remedy=Remedy(
                "export the whole model, which an FMU holds as it is",
                f"ecm export MODEL --to fmu --out OUT --name {name}",
            ),
        )
    if exported.lost:
        raise InputError(
            f"{model.name}: {'; '.join(exported.lost.values())}: the controller would not have the "
            "model that was fitted.",
            remedy=_that_steps(model, exported, to, name)
            or _at_columns(model, exported, again)
            or _without(list(exported.lost), again),
        )


def _that_steps(model: Model, exported: Exported, to: str, name: str) -> Remedy | None:
    """C where the target has no steps, or a base that steps; None where neither keeps them."""
    steps = time_effects(model, "c", recorded=True, columns=True)
    if not steps.lost and OF_INPUTS.keys() >= exported.lost.keys():
        return Remedy(
            "export it to c, which steps (or export all the same with --force)",
            f"ecm export MODEL --to c --out OUT --name {name}",
            force=True,
        )
    reasons = {steps.left_out[id] for id in steps.lost}
    base, alias = _STEPPING.get(reasons.pop(), ("", "")) if len(reasons) == 1 else ("", "")
    if not base or TARGETS[to].language == "none":
        return None
    unknown = base == "an energy" and model.known_length_m is None
    first = "state [mechanism] length_m in the data's TOML, then " if unknown else ""
    ids = [item.id for item in model.effects]
    options = " ".join(f"--add {id}" for id in ids)
    return Remedy(
        f"{first}fit {base} with {' and '.join(ids)}, which steps, and compare "
        "(or export all the same with --force)",
        f"ecm fit DATA --model {alias} {options} --out {alias.rstrip('4')}.json",
        force=True,
    )


_STEPPING = {NEEDS_ENERGY: ("an energy", "energy4"), NEEDS_POLYNOMIAL: ("a polynomial", "cubic")}
"""The base that steps where another does not: words, and its name for `ecm fit`."""


def _at_columns(model: Model, exported: Exported, again: str) -> Remedy | None:
    """The map at one value of the columns that lost effects follow; None where that is no map.

    The value is the middle of those that were measured; of the time the last, as it stands now.
    """
    followed = model.followed
    names = [followed.get(id, "") for id in exported.lost]
    if actuators_of(model.base) or not set(names) <= model.conditions.keys():
        return None
    values = {name: f"{sum(model.conditions[name]) / 2.0:.6g}" for name in names}
    where = "in the middle of those that were measured"
    if "time_s" in values:  # not rounded: beyond the last reading is refused
        values["time_s"], where = repr(model.conditions["time_s"][1]), "at the last reading"
    return Remedy(
        f"export it at one value of {' and '.join(values)}, as here {where} (or export all the "
        "same with --force)",
        f"{again} --at {','.join(f'{name}={value}' for name, value in values.items())}",
        force=True,
    )


def _hard_to_fold(model: Model, folded_ids: Sequence[str]) -> Sequence[str]:
    """The effect without which the others fold well; all where there is no such one."""
    if len(folded_ids) > 1:
        for id in folded_ids:
            if _mechanism_alone(model.remove(id))[2] <= _MOST_FOLDING:
                return [id]
    return folded_ids


def _without(
    ids: Sequence[str], again: str, model: Model | None = None, folding: float = np.inf
) -> Remedy:
    """Fit without effects that the files cannot hold, or write them all the same.

    Parameters
    ----------
    model
        Its history says how far a fit without them errs.
    folding
        How far the files err, over the noise; where a fit without the effects errs more, they are
        the better map.
    """
    if not ids:
        return Remedy("export it all the same", f"{again} --force", force=True)
    if model is not None:
        bare = model.remove(*ids).name
        errs = [record.train for record in model.history if record.name == bare]
        if errs and errs[-1] > folding:
            words = (
                f"export it all the same: fitted without {' and '.join(ids)} the model errs "
                f"{errs[-1]:.2g} times the noise"
            )
            return Remedy(words, f"{again} --force", force=True)
    mends = OF_INPUTS.keys() >= set(ids)
    who = "where the controller computes what acts from what is recorded, " if mends else ""
    left_out = without(ids, f" (or {who}export all the same with --force)")
    return replace(left_out, force=True)


def _check_crate(path: Path) -> None:
    """Raise InputError where a crate that is no export would be overwritten."""
    if path.name != "Cargo.toml" or not path.exists():
        return
    if _EXPORTED not in path.read_text(encoding="utf-8", errors="replace"):
        raise InputError(
            f"{path}: this crate is no export, and is not overwritten. Choose another folder."
        )


def _unit(model: Model) -> str:
    """What a change of the model is a multiple of, in words."""
    return model.noise.unit if model.noise.is_assumed else "the measurement noise"


def _mechanism_alone(model: Model) -> tuple[Model, list[str], float]:
    """The model without effects beside the pose, those of physics folded into its base.

    Also notes, and the change by folding over the noise. A map without code of its own, such as
    a rod or a learned one, becomes an energy as well.
    """
    acting = sorted(item.id for item in model.acting_at_poses)
    bare = replace(model, effects=(), history=(), correlations=())
    kind = model.base.document().get("kind")
    has_code = kind in _WITH_CODE
    if not acting and has_code:
        return bare, [], 0.0
    if actuators_of(model.base) and not acting:
        raise InputError(
            f"{model.name}: files hold such an energy of all six wrench columns, and this one is "
            f"known for {', '.join(model.outputs)} alone",
            remedy=Remedy(
                "fit a polynomial of pose and inputs, which files hold, and export that",
                "ecm fit DATA --model cubic --out cubic.json",
            ),
        )
    if actuators_of(model.base):
        raise InputError(
            f"{model.name}: effects on the pose are folded into a map of the pose alone, which has "
            "no inputs for actuators",
            remedy=without(acting, ", and export that"),
        )
    one, share = folded(model)
    where = "measured poses" if has_measured_poses(model) else "poses drawn from the domain"
    fixed = {i.id: i.effect.physics for i in model.effects if isinstance(i.effect, AtColumns)}
    parts = [] if has_code else [str(kind)]
    parts += [fixed.get(id, id) for id in acting]
    note = (
        f"Folded into {one.name}: {', '.join(parts)}; the folded map differs from "
        f"model and effects by at most {share:.2g} of {_unit(model)} (rms, worst component, "
        f"{len(measured_poses(model))} {where})."
    )
    return replace(bare, base=one, covariance=None), [note], share
