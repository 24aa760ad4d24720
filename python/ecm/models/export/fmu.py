"""FMI 2.0 and 3.0: an FMU of each for co-simulation, with its sources and its binaries."""

from __future__ import annotations

import hashlib
import io
import platform
import sys
from contextlib import suppress
from dataclasses import dataclass
from xml.sax.saxutils import quoteattr
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

import numpy as np

from ecm.errors import ComputationError, InputError
from ecm.models.export.source import LINUX, WINDOWS, Files, Source, shared_library
from ecm.models.measured_poses import measured_poses

_UNITS = {
    "m": '<BaseUnit m="1"/>',
    "rad": '<BaseUnit rad="1"/>',
    "N": '<BaseUnit kg="1" m="1" s="-2"/>',
    "Nm": '<BaseUnit kg="1" m="2" s="-2"/>',
    "s": '<BaseUnit s="1"/>',
    "degC": '<BaseUnit K="1" offset="273.15"/>',
}
_CONDITIONS = ("temperature_degC", "age_s")
_MAJOR = (2, 3)


@dataclass(frozen=True)
class _Variables:
    """Names by the value references that `instance.h` counts in the same order."""

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    start: tuple[float, ...]

    @property
    def inside(self) -> int:
        """Value reference of `inside`."""
        return 1 + len(self.inputs) + len(self.outputs)


def fmu(source: Source) -> Files:
    """NAME_fmi2.fmu and NAME_fmi3.fmu."""
    variables = _variables(source)
    code = source.code()
    token = hashlib.sha256("".join(code[path] for path in sorted(code)).encode()).hexdigest()
    values = {
        "TOKEN": token,
        "MARK": f"0x{token[:15]}u",
        "N": str(len(source.inside.inputs)),
        "M": str(len(variables.outputs)),
        "START": ", ".join(f"{x:.17g}" for x in variables.start),
    }
    written: dict[str, str | bytes] = {}
    made: set[str] = set()
    for major in _MAJOR:
        files = {path: code[path] for path in (f"{source.name}.c", f"{source.name}.h")}
        files["instance.h"] = source.template("fmu/instance.h", values)
        files[f"fmi{major}.c"] = source.template(f"fmu/fmi{major}.c", values)
        archive: dict[str, str | bytes] = {f"sources/{path}": text for path, text in files.items()}
        compiled = (f"{source.name}.c", f"fmi{major}.c")
        for folder, name, commands in _platforms(major, source.name):
            with suppress(ComputationError):  # the sources go into the archive all the same
                archive[f"binaries/{folder}/{name}"] = shared_library(files, compiled, commands)
                made.add("Windows" if name.endswith("dll") else "this machine")
        if major == 2:
            archive["modelDescription.xml"] = _description_2(
                source.name, token, variables, compiled
            )
        else:
            archive["modelDescription.xml"] = _description_3(source.name, token, variables)
            archive["sources/buildDescription.xml"] = _build_3(source.name, compiled)
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
    return Files(written, f"fmpy simulate @OUT@/{source.name}_fmi3.fmu --show-plot", notes)


def _variables(source: Source) -> _Variables:
    model = source.inside
    if source.whole and model.known_length_m is not None:
        start = model.rest_pose("an FMU")[0]
    elif source.whole:
        start = measured_poses(source.model)[0]
    else:
        start = np.array([0.5 * sum(model.domain.get(name, (0.0, 0.0))) for name in model.inputs])
    conditions: tuple[str, ...] = ()
    if source.has_state:
        conditions = _CONDITIONS
        start = np.append(start, [source.timed.document.get("reference_degc", 0.0), 0.0])
    for name in (*model.inputs, *model.outputs):
        if name.rpartition("_")[2] not in _UNITS:
            raise InputError(f"--to fmu: column {name} has no unit of {', '.join(_UNITS)}")
    return _Variables((*model.inputs, *conditions), model.outputs, tuple(map(float, start)))


def _platforms(major: int, name: str) -> list[tuple[str, str, tuple[tuple[str, ...], ...]]]:
    """Folder and file of each binary, and the compilers that can make it."""
    found: list[tuple[str, str, tuple[tuple[str, ...], ...]]] = []
    if sys.platform == "linux" and platform.machine() in ("x86_64", "aarch64"):
        folder = f"{platform.machine()}-linux" if major == 3 else "linux64"
        if major == 3 or platform.machine() == "x86_64":  # FMI 2 has no name for aarch64
            found.append((folder, f"{name}.so", LINUX))
    found.append(("x86_64-windows" if major == 3 else "win64", f"{name}.dll", WINDOWS))
    return found


def _units(variables: _Variables) -> str:
    used = {name.rpartition("_")[2] for name in (*variables.inputs, *variables.outputs)}
    lines = (f'    <Unit name="{unit}">{_UNITS[unit]}</Unit>' for unit in _UNITS if unit in used)
    return "  <UnitDefinitions>\n" + "\n".join(lines) + "\n  </UnitDefinitions>"


def _description_2(name: str, token: str, variables: _Variables, compiled: tuple[str, ...]) -> str:
    def scalar(reference: int, column: str, kind: str, body: str) -> str:
        return (
            f'    <ScalarVariable name={quoteattr(column)} valueReference="{reference}" {kind}>'
            f"{body}</ScalarVariable>"
        )

    def unit(column: str) -> str:
        return f'unit="{column.rpartition("_")[2]}"'

    inputs = [
        scalar(
            1 + i, column, 'causality="input" variability="continuous"',
            f'<Real {unit(column)} start="{start:.17g}"/>',
        )
        for i, (column, start) in enumerate(zip(variables.inputs, variables.start, strict=True))
    ]  # fmt: skip
    first = 1 + len(inputs)
    outputs = [
        scalar(
            first + j, column, 'causality="output" variability="continuous" initial="calculated"',
            f"<Real {unit(column)}/>",
        )
        for j, column in enumerate(variables.outputs)
    ]  # fmt: skip
    inside = scalar(
        variables.inside, "inside",
        'causality="output" variability="discrete" initial="calculated"', "<Integer/>",
    )  # fmt: skip
    listed = "\n".join(f'      <File name="{path}"/>' for path in compiled)
    needs = " ".join(str(1 + i) for i in range(len(inputs)))
    unknowns = "\n".join(
        f'      <Unknown index="{first + j}" dependencies="{needs}"/>'
        for j in range(len(outputs) + 1)
    )
    body = "\n".join([*inputs, *outputs, inside])
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="{name}" guid="{token}"
  description="Wrench and stiffness of an elastic mechanism" generationTool="ecm"
  variableNamingConvention="flat">
  <CoSimulation modelIdentifier="{name}" canHandleVariableCommunicationStepSize="true"
    canGetAndSetFMUstate="true" canSerializeFMUstate="true" providesDirectionalDerivative="true">
    <SourceFiles>
{listed}
    </SourceFiles>
  </CoSimulation>
{_units(variables)}
  <DefaultExperiment startTime="0" stopTime="1" stepSize="0.001"/>
  <ModelVariables>
{body}
  </ModelVariables>
  <ModelStructure>
    <Outputs>
{unknowns}
    </Outputs>
    <InitialUnknowns>
{unknowns}
    </InitialUnknowns>
  </ModelStructure>
</fmiModelDescription>
"""


def _description_3(name: str, token: str, variables: _Variables) -> str:
    def unit(column: str) -> str:
        return f'unit="{column.rpartition("_")[2]}"'

    lines = ['    <Float64 name="time" valueReference="0" causality="independent"/>']
    lines += [
        f'    <Float64 name="{column}" valueReference="{1 + i}" causality="input" '
        f'{unit(column)} start="{start:.17g}"/>'
        for i, (column, start) in enumerate(zip(variables.inputs, variables.start, strict=True))
    ]
    first = 1 + len(variables.inputs)
    lines += [
        f'    <Float64 name="{column}" valueReference="{first + j}" causality="output" '
        f'initial="calculated" {unit(column)}/>'
        for j, column in enumerate(variables.outputs)
    ]
    lines.append(
        f'    <Int32 name="inside" valueReference="{variables.inside}" causality="output" '
        'variability="discrete" initial="calculated"/>'
    )
    needs = " ".join(str(1 + i) for i in range(len(variables.inputs)))
    structure = "\n".join(
        f'    <{element} valueReference="{reference}" dependencies="{needs}"/>'
        for element in ("Output", "InitialUnknown")
        for reference in range(first, variables.inside + 1)
    )
    body = "\n".join(lines)
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="{name}" instantiationToken="{token}"
  description="Wrench and stiffness of an elastic mechanism" generationTool="ecm"
  variableNamingConvention="flat">
  <CoSimulation modelIdentifier="{name}" canHandleVariableCommunicationStepSize="true"
    canGetAndSetFMUState="true" canSerializeFMUState="true" providesDirectionalDerivatives="true"
    providesAdjointDerivatives="true"/>
{_units(variables)}
  <DefaultExperiment startTime="0" stopTime="1" stepSize="0.001"/>
  <ModelVariables>
{body}
  </ModelVariables>
  <ModelStructure>
{structure}
  </ModelStructure>
</fmiModelDescription>
"""


def _build_3(name: str, compiled: tuple[str, ...]) -> str:
    listed = "\n".join(f'      <SourceFile name="{path}"/>' for path in compiled)
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiBuildDescription fmiVersion="3.0">
  <BuildConfiguration modelIdentifier="{name}">
    <SourceFileSet language="C99">
{listed}
    </SourceFileSet>
  </BuildConfiguration>
</fmiBuildDescription>
"""


def _zipped(archive: dict[str, str | bytes]) -> bytes:
    """A zip file whose bytes depend on the content alone."""
    memory = io.BytesIO()
    with ZipFile(memory, "w", ZIP_DEFLATED) as file:
        for path in sorted(archive):
            info = ZipInfo(path, (1980, 1, 1, 0, 0, 0))
            info.create_system, info.external_attr = 3, 0o644 << 16  # Unix: all may read
            file.writestr(info, archive[path], ZIP_DEFLATED)
    return memory.getvalue()
