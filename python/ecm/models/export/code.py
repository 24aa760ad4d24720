"""Programs in C, Rust, Python and Simulink: the model's code and what loads it."""

from __future__ import annotations

from typing import Literal

from ecm.errors import InputError
from ecm.models.control import design_loop
from ecm.models.control.design import loop_file
from ecm.models.export.source import Files, Source


def c(source: Source) -> Files:
    """C99: header, source, golden vectors, and a loop."""
    name = source.name
    step = f"cc -O2 @OUT@/{name}.c @OUT@/{name}_check.c -o check && ./check"
    if source.adapt is not None:
        crate = f"@OUT@/{name}_adapt"
        step = (
            f"cargo build --release --manifest-path {crate}/Cargo.toml && cc -O2 @OUT@/{name}.c "
            f"{crate}_check.c {crate}/target/release/lib{name}_adapt.a -o check && ./check"
        )
    return _code(source, "c", f"{step}   (0: the compiler keeps the golden vectors)")


def rust(source: Source) -> Files:
    """A crate without the standard library."""
    return _code(source, "rust", "cargo test --release --manifest-path @OUT@/Cargo.toml")


def _code(source: Source, language: Literal["c", "rust"], next_step: str) -> Files:
    written: dict[str, str | bytes] = dict(source.code(language, source.precision))
    if not source.whole:
        return Files(written, next_step)
    poses = source.poses()
    try:
        stiffness = source.inside.base.stiffness(poses, "screw")
        designed = design_loop(poses, stiffness, source.loop, stiffer=source.timed.stiffer)
    except InputError as error:
        return Files(written, next_step, (f"No control loop: {error}.",))
    if designed.holds.any():
        state = source.has_state
        rest = source.model.rest_pose("a loop with a state")[0] if state else None
        written |= loop_file(
            designed, language, source.name, source.precision, rest, source.model.scene.gravity_m_s2
        )
    return Files(written, next_step, designed.sentences(), designed)


def drake(source: Source) -> Files:
    """A LeafSystem that pushes on the bodies of a MultibodyPlant."""
    rest = source.inside.rest_pose("a Drake export")[0] if source.whole else ()
    values = {"REST": ", ".join(f"{x:.17g}" for x in rest)}
    return _beside(source, "drake", "system.py.txt", f"{source.name}_drake.py", values)


def pinocchio(source: Source) -> Files:
    """External forces of the joints between two frames."""
    return _beside(source, "pinocchio", "forces.py.txt", f"{source.name}_pinocchio.py")


def ros2(source: Source) -> Files:
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
) -> Files:
    source.need_whole(target)
    name = source.name
    loader = source.template("python/model.py.txt")
    if not source.has_state:  # without the steps there is no state
        loader = loader[: loader.index("\n\nSTATE = ")] + "\n"
    written: dict[str, str | bytes] = dict(source.code())
    written[f"{name}_model.py"] = loader
    written[path] = source.template(f"{target}/{template}", values)
    return Files(written, step or f"PYTHONPATH=@OUT@ python -c 'import {path[:-3]}'")


def simulink(source: Source) -> Files:
    """NAME.c and NAME.h for a C Caller block, NAME_sfun.c, NAME_mex.c."""
    source.need_whole("simulink")
    name = source.name
    written: dict[str, str | bytes] = dict(source.code())
    written |= {
        f"{name}_{kind}.c": source.template(f"simulink/{kind}.c") for kind in ("sfun", "mex")
    }
    return Files(
        written,
        f"in MATLAB, in @OUT@: mex {name}_sfun.c {name}.c   "
        f"(Octave: mkoctfile --mex {name}_mex.c {name}.c)",
    )
