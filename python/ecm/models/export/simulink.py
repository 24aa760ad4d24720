"""Simulink: C for a C Caller block, a level-2 S-function, a MEX file for MATLAB and Octave."""

from __future__ import annotations

from ecm.models.export.source import Files, Source


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
