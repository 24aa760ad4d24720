"""`ecm export`: a model written for a controller or a simulator."""

from __future__ import annotations

import shlex
from pathlib import Path

from ecm.cli.models import open_model
from ecm.cli.options.export import Options
from ecm.cli.outputs import check_output_directory
from ecm.cli.session import Session
from ecm.effects import load_installed
from ecm.errors import Refusal
from ecm.models import Model
from ecm.models.adapt import AdaptSettings
from ecm.models.control import LoopSettings
from ecm.models.export import export as export_model


def export(options: Options, session: Session) -> None:
    """Run `ecm export`."""
    check_output_directory(options.out)
    load_installed()
    rows = session.read(options.data) if options.data else None
    with session.working(f"exporting {options.model}"):
        model = open_model(options.model, session)
        if rows is not None:
            model = model.measured_at(rows)
        try:
            exported = export_model(
                model,
                options.to.value,
                options.out,
                name=options.name,
                precision=options.precision.value,
                loop=LoopSettings(options.mass, options.inertia, options.delay, options.dt),
                adapt=_adapt(options),
                force=options.force,
            )
        except Refusal as error:
            if error.remedy is not None and rows is None:
                error.remedy = error.remedy.filled(_training_table(model, options))
            raise
    session.on_interrupt(f"complete: {options.out}. Run the same command again for the rest.")
    session.write_json(
        {
            "schema": 1,
            "files": sorted(exported.files),
            "left_out": list(exported.left_out),
            "sentences": list(exported.notes),
            "next_step": exported.next_step.replace("@OUT@", str(options.out)),
            "control_loop": None if exported.loop is None else exported.loop.to_dict(),
        }
    )
    for line in exported.notes:
        session.print(line)
    session.print(f"{options.out}: {len(exported.files)} files, {options.to.value}")
    session.print(f"Next: {exported.next_step.replace('@OUT@', str(options.out))}")


def _adapt(options: Options) -> AdaptSettings | None:
    return None if options.adapt is None else AdaptSettings(tuple(options.adapt.split(",")))


def _training_table(model: Model, options: Options) -> dict[str, str]:
    """DATA of a remedy: the table that the model was fitted to, where it lies beside it or here."""
    name = str(model.training.get("source", ""))
    places = (Path(options.model).parent / name, Path(name)) if name else ()
    found = next((place for place in places if place.is_file()), None)
    return {} if found is None else {"DATA": shlex.quote(str(found))}
