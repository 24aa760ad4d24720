"""FMI 2.0 and 3.0: an FMU of each for co-simulation, with its sources and its binaries."""

from __future__ import annotations

import hashlib
import io
import platform
import sys
from contextlib import suppress
from typing import Any
from xml.sax.saxutils import escape
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

import numpy as np

from ecm.errors import ComputationError, InputError
from ecm.models.export.source import LINUX, WINDOWS, Exported, Source, shared_library
from ecm.models.measured_poses import measured_poses
from ecm.regression.rows import taken_by

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
    start, outputs = _inputs(source), source.inside.outputs
    code = source.code()
    token = hashlib.sha256("".join(code[path] for path in sorted(code)).encode()).hexdigest()
    values = {
        "TOKEN": token,
        "MARK": f"0x{token[:15]}u",
        "N": str(len(taken_by(source.inside.base))),
        "M": str(len(outputs)),
        "START": ", ".join(f"{x:.17g}" for x in start.values()),
    }
    written: dict[str, str | bytes] = {}
    made: set[str] = set()
    for major in _LINES:
        files = {path: code[path] for path in (f"{source.name}.c", f"{source.name}.h")}
        files["instance.h"] = source.template("fmu/instance.h", values)
        files[f"fmi{major}.c"] = source.template(f"fmu/fmi{major}.c", values)
        archive: dict[str, str | bytes] = {f"sources/{path}": text for path, text in files.items()}
        compiled = (f"{source.name}.c", f"fmi{major}.c")
        for folder, name, commands in _platforms(major, source.name):
            with suppress(ComputationError):  # the sources go into the archive all the same
                archive[f"binaries/{folder}/{name}"] = shared_library(files, compiled, commands)
                made.add("Windows" if name.endswith("dll") else "this machine")
        described = values | _described(major, start, outputs)
        description = source.template(f"fmu/modelDescription{major}.xml", described)
        archive["modelDescription.xml"] = description
        if major == 3:
            archive["sources/buildDescription.xml"] = source.template("fmu/buildDescription.xml")
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


def _inputs(source: Source) -> dict[str, float]:
    """Start of each input: the pose, then actuators, then what effects of time follow."""
    model = source.inside
    if source.whole and model.known_length_m is not None:
        start = model.rest_pose("an FMU")[0]
    elif source.whole:
        start = measured_poses(source.model)[0]
    else:
        start = np.array([0.5 * sum(model.domain.get(name, (0.0, 0.0))) for name in model.inputs])
    taken = taken_by(model.base)
    for name in (*taken, *model.outputs):
        if _unit(name) not in _UNITS:
            raise InputError(f"--to fmu: column {name} has no unit of {', '.join(_UNITS)}")
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


def _platforms(major: int, name: str) -> list[tuple[str, str, tuple[tuple[str, ...], ...]]]:
    """Folder and file of each binary, and the compilers that can make it."""
    found: list[tuple[str, str, tuple[tuple[str, ...], ...]]] = []
    if sys.platform == "linux" and platform.machine() in ("x86_64", "aarch64"):
        folder = f"{platform.machine()}-linux" if major == 3 else "linux64"
        if major == 3 or platform.machine() == "x86_64":  # FMI 2 has no name for aarch64
            found.append((folder, f"{name}.so", LINUX))
    found.append(("x86_64-windows" if major == 3 else "win64", f"{name}.dll", WINDOWS))
    return found


def _zipped(archive: dict[str, str | bytes]) -> bytes:
    """A zip file whose bytes depend on the content alone."""
    memory = io.BytesIO()
    with ZipFile(memory, "w", ZIP_DEFLATED) as file:
        for path in sorted(archive):
            info = ZipInfo(path, (1980, 1, 1, 0, 0, 0))
            info.create_system, info.external_attr = 3, 0o644 << 16  # Unix: all may read
            file.writestr(info, archive[path], ZIP_DEFLATED)
    return memory.getvalue()
