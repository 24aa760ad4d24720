"""The options of the commands on tables and models: what help and parsing need, no more."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from ecm.cli.command import Data, ModelFile, Out, command


@dataclass(frozen=True, kw_only=True)
class ImportArguments:
    """Make a table of a log: text, Parquet, MAT, HDF5, NPZ, ROS 2 bag or MCAP (docs/import.md)."""

    log: Annotated[Path, typer.Argument(metavar="LOG", help="The log.")]
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="Table; else only shown.")
    ] = None
    columns: Annotated[
        list[str] | None,
        typer.Option("--map", metavar="A=B[:UNIT]", help="Column A is B (-B: negated); repeat it."),
    ] = None
    rotation: Annotated[
        str, typer.Option("--rotation", metavar="WORD", help="wxyz, xyzw, rotvec, ZYX or xyz.")
    ] = ""
    units: Annotated[
        str, typer.Option("--units", metavar="LIST", help="Where unstated: SI, or mm,deg,N,N mm.")
    ] = ""
    axis: Annotated[
        str, typer.Option("--axis", metavar="x|y|z", help="Axis of names without one.")
    ] = ""
    topics: Annotated[
        list[str] | None,
        typer.Option("--topic", metavar="NAME", help="A topic of a bag; repeat it."),
    ] = None
    ignore: Annotated[
        list[str] | None,
        typer.Option("--ignore", metavar="COLUMN", help="Not used; repeat it."),
    ] = None
    group: Annotated[
        str, typer.Option("--group", metavar="NAME", help="Column that tells experiments apart.")
    ] = ""
    meta: Annotated[
        Path | None,
        typer.Option("--meta", metavar="FILE", help="TOML with mechanism, frames, instrument."),
    ] = None
    leave_out: Annotated[
        bool, typer.Option("--leave-out", help="Leave unreadable rows and copies out; record them.")
    ] = False


import_log = command("tables.import_log", ImportArguments, report=True)


@dataclass(frozen=True, kw_only=True)
class CheckArguments:
    """Check columns and units; say what was never excited and which effects can be tested."""

    data: Data
    leave_out: Annotated[
        bool, typer.Option("--leave-out", help="Record what is no measurement in NAME.toml.")
    ] = False


check = command("tables.check", CheckArguments, tables=True)


_MODELS = "choose, poly:D, linear .. cubic, energyD, physics, rod, a TOML (docs/models.md)."


@dataclass(frozen=True, kw_only=True)
class FitArguments:
    """Fit a model to a table and write its file."""

    data: Data
    out: Out
    model: Annotated[str, typer.Option("--model", metavar="NAME", help=_MODELS)] = "cubic"
    pcr: Annotated[
        str | None,
        typer.Option("--pcr", metavar="B", help="B, B/sqrtN, rank:R or press (poly)."),
    ] = None
    zero_at_home: Annotated[
        bool, typer.Option("--zero-at-home", help="No wrench at the undeformed pose.")
    ] = False
    stable: Annotated[
        bool, typer.Option("--stable", help="A stable rest at the undeformed pose.")
    ] = False
    curve: Annotated[
        bool, typer.Option("--curve", help="Also print how many poses are enough.")
    ] = False
    weights: Annotated[
        str, typer.Option("--weights", metavar="W", help="auto, noise or spread (docs/models.md).")
    ] = "auto"
    add: Annotated[
        list[str] | None,
        typer.Option("--add", metavar="EFFECT", help="Fitted with this effect; repeatable."),
    ] = None
    force: Annotated[
        bool, typer.Option("--force", help="Fit a misread table; save what is worse.")
    ] = False


fit = command("fit.fit", FitArguments, tables=True, seed=True)


@dataclass(frozen=True, kw_only=True)
class RefitArguments:
    """Fit a model again with an effect more or less: fit report and fit history."""

    model: ModelFile
    data: Data
    out: Out
    add: Annotated[
        list[str] | None, typer.Option("--add", metavar="EFFECT", help="Effect to add; repeatable.")
    ] = None
    remove: Annotated[
        list[str] | None,
        typer.Option("--remove", metavar="EFFECT", help="Effect to remove; repeatable."),
    ] = None
    freeze: Annotated[
        list[str] | None, typer.Option("--freeze", metavar="NAME", help="Effect, or base, to keep.")
    ] = None
    force: Annotated[
        bool, typer.Option("--force", help="Save also a model that is worse than before.")
    ] = False


refit = command("fit.refit", RefitArguments, tables=True)


class StiffnessKind(str, Enum):
    """The three stiffnesses of the conventions."""

    partial = "partial"
    generalised = "generalised"
    screw = "screw"


@dataclass(frozen=True, kw_only=True)
class PredictArguments:
    """Predict the wrench of a model at each pose; other columns are kept."""

    model: ModelFile
    poses: Annotated[Path, typer.Argument(metavar="POSES", help="Table with pose columns.")]
    out: Out
    stiffness: Annotated[
        bool, typer.Option("--stiffness", help="Add the 36 columns k_fx_x ... of K.")
    ] = False
    stiffness_kind: Annotated[
        StiffnessKind, typer.Option("--stiffness-kind", help="Which of the three stiffnesses.")
    ] = StiffnessKind.partial
    leverage: Annotated[
        bool,
        typer.Option("--leverage", help="Add extrapolates (0, 1); of six columns leverage, too."),
    ] = False
    rotation: Annotated[
        str,
        typer.Option(
            "--rotation",
            metavar="WORD",
            help="Add the rotation as wxyz, rows, ZYX, grood-suntay-right or other words (rad).",
        ),
    ] = ""


predict = command("models.predict", PredictArguments, tables=True)


@dataclass(frozen=True, kw_only=True)
class CompareArguments:
    """Compare a model with a table: RMSE, bias, noise floor and excess error per component."""

    model: ModelFile
    data: Data


compare = command("models.compare", CompareArguments, tables=True, report=True, seed=True)


@dataclass(frozen=True, kw_only=True)
class DiagnoseArguments:
    """Rank the effects that the model may lack, and say which one is missing."""

    model: ModelFile
    data: Data
    next_plan: Annotated[
        Path | None,
        typer.Option("--next", metavar="PLAN", help="Write the next experiment for campaign."),
    ] = None
    details: Annotated[
        bool,
        typer.Option("--details", help="Print all that the three lines rest on."),
    ] = False


diagnose = command("diagnose.diagnose", DiagnoseArguments, tables=True, report=True, seed=True)


@dataclass(frozen=True, kw_only=True)
class EffectsArguments:
    """List the physical effects that diagnose can name, or show one in full."""

    id: Annotated[str | None, typer.Argument(metavar="[ID]", help="One effect in full.")] = None


effects = command("effects.effects", EffectsArguments)


class Target(str, Enum):
    """The targets of `ecm.models.export.files`, each with a line of the help."""

    line: str

    def __new__(cls, name: str, line: str) -> Target:
        """A member is its name; what it gives is beside it."""
        member = str.__new__(cls, name)
        member._value_ = name
        member.line = line
        return member

    c = "c", "C99: no heap, no libm, golden vectors, a 1 kHz control loop"
    rust = "rust", "a no_std crate with the same"
    mujoco = "mujoco", "a passive plugin, scenes that load it, the linear part alone"
    fmu = "fmu", "FMI 2.0 and 3.0 for co-simulation, with sources and binaries"
    opensim = "opensim", "ExpressionBasedBushingForce of all six deflections"
    simulink = "simulink", "C for a C Caller block, an S-function, a MEX file"
    drake = "drake", "a LeafSystem in Python that pushes on a MultibodyPlant"
    pinocchio = "pinocchio", "external forces of the joints, in Python"
    ros2 = "ros2", "a node from PoseStamped to WrenchStamped"


class Precision(str, Enum):
    """Floating-point type of the code."""

    double = "double"
    single = "single"


@dataclass(frozen=True, kw_only=True)
class ExportArguments:
    """The help is set below, with a line for each target."""

    model: ModelFile
    to: Annotated[Target, typer.Option("--to", metavar="TARGET", help="One of the above.")]
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder to write into.")]
    name: Annotated[str, typer.Option("--name", metavar="NAME", help="Begins each name.")] = (
        "ecm_model"
    )
    precision: Annotated[
        Precision, typer.Option("--precision", metavar="P", help="Or single (c, rust).")
    ] = Precision.double
    mass: Annotated[
        float | None, typer.Option("--mass", metavar="KG", help="Platform and load, for a loop.")
    ] = None
    inertia: Annotated[
        float | None,
        typer.Option(
            "--inertia", metavar="KGM2", help="Moment of inertia of the same, about any axis."
        ),
    ] = None
    delay: Annotated[
        float, typer.Option("--delay", metavar="S", help="Longest, from pose to wrench.")
    ] = 0.003
    dt: Annotated[float, typer.Option("--dt", metavar="S", help="Step of the loop.")] = 0.001
    adapt: Annotated[
        str | None,
        typer.Option(
            "--adapt",
            metavar="LIST",
            help="Follow readings: modulus,payload,zero,shares.",
        ),
    ] = None
    data: Annotated[
        list[Path] | None,
        typer.Option("--data", metavar="TABLE", help="Judge at the poses of these rows."),
    ] = None
    force: Annotated[
        bool, typer.Option("--force", help="Also where it changes the model beyond the noise.")
    ] = False


_LIST = "\n".join(f"  {target.value:<10}{target.line}" for target in Target)
ExportArguments.__doc__ = (
    f"Write a model for a controller or a simulator (docs/export.md).\n\n\b\n{_LIST}"
)

export = command("models.export", ExportArguments, tables=True, hide=("meta", "skip_bad_rows"))
