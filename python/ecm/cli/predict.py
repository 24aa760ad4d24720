"""`ecm predict`: a model's wrench, and its stiffness, at given poses."""

from __future__ import annotations

from typing import Any

import numpy as np

from ecm.cli.models import open_model
from ecm.cli.options.predict import Options
from ecm.cli.session import Session
from ecm.effects import load_installed
from ecm.errors import InputError
from ecm.io.columns import POSE
from ecm.logs.rotations import check_rotation_word, rotation_columns
from ecm.models.prediction import predict as predict_table


def predict(options: Options, session: Session) -> None:
    """Run `ecm predict`."""
    session.check_output(options.out)
    load_installed()
    if options.rotation:
        check_rotation_word(options.rotation)
    table = session.read([options.poses], need="predict")
    lacking = [name for name in POSE[3:] if not table.has(name)]
    if options.rotation and lacking:
        raise InputError(
            f"{table.source}: --rotation {options.rotation} needs all three angles; no column "
            f"{', '.join(lacking)}. Add it, zero where the mechanism does not turn"
        )
    kind: Any = options.stiffness_kind.value if options.stiffness else None
    model = open_model(options.model, session, table)
    with session.working(f"predicting {len(table)} rows") as tell:
        predicted = predict_table(
            model, table, stiffness=kind, leverage=options.leverage, progress=tell
        )
    for warning in predicted.warnings[len(table.warnings) :]:
        session.warn(warning)
    if options.rotation:
        vectors = np.column_stack([predicted.column(name) for name in POSE[3:]])
        predicted = predicted.with_columns(rotation_columns(options.rotation, vectors))
    with session.working(f"writing {options.out}") as tell:
        predicted.write(options.out, progress=tell)
    new = [n for n, column in predicted.columns.items() if column is not table.columns.get(n)]
    session.write_json({"schema": 1, "rows": len(table), "columns": new})
    session.print(f"{options.out}: {len(table)} rows, {len(new)} predicted columns")
