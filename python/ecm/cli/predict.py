"""`ecm predict`: a model's wrench, and its stiffness, at given poses."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Annotated, Any

import typer

from ecm.cli.command import ModelFile, Out, Session, command
from ecm.cli.models import open_model
from ecm.effects import load_installed
from ecm.models.prediction import predict as predict_table


class StiffnessKind(str, Enum):
    """The three stiffnesses of the conventions."""

    partial = "partial"
    generalised = "generalised"
    screw = "screw"


@dataclass(frozen=True, kw_only=True)
class Options:
    """Arguments of the command."""

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
        bool, typer.Option("--leverage", help="Add the columns leverage and extrapolates (0, 1).")
    ] = False


@command(Options, tables=True)
def predict(options: Options, session: Session) -> None:
    """Predict the wrench of a model at each pose; other columns are kept."""
    session.check_output(options.out)
    load_installed()
    table = session.read([options.poses], need="predict")
    kind: Any = options.stiffness_kind.value if options.stiffness else None
    predicted = predict_table(
        open_model(options.model, session, table), table, stiffness=kind, leverage=options.leverage
    )
    for warning in predicted.warnings[len(table.warnings) :]:
        session.warn(warning)
    predicted.write(options.out)
    new = [n for n, column in predicted.columns.items() if column is not table.columns.get(n)]
    session.write_json({"schema": 1, "rows": len(table), "columns": new})
    session.print(f"{options.out}: {len(table)} rows, {len(new)} predicted columns")
