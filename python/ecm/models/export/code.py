"""C and Rust: the model's source code, and a control loop that holds a platform."""

from __future__ import annotations

from typing import Literal

from ecm.errors import InputError
from ecm.models.control import design_loop
from ecm.models.control.code import loop_file
from ecm.models.export.source import Files, Source


def c(source: Source) -> Files:
    """C99: header, source, golden vectors, and a loop."""
    name = source.name
    step = f"cc -O2 @OUT@/{name}.c @OUT@/{name}_check.c -o check && ./check"
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
