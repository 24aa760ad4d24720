"""`ecm export`: a model written for a controller or a simulator."""

from __future__ import annotations

from ecm.cli.models import open_model
from ecm.cli.options.export import Options
from ecm.cli.outputs import check_output_directory
from ecm.cli.session import Session
from ecm.effects import load_installed
from ecm.errors import Remedy
from ecm.models.adapt import AdaptSettings
from ecm.models.control import LoopSettings
from ecm.models.export import export as export_model
from ecm.models.export.files import ExportChanges


def export(options: Options, session: Session) -> None:
    """Run `ecm export`."""
    check_output_directory(options.out)
    load_installed()
    adapt = None if options.adapt is None else AdaptSettings(tuple(options.adapt.split(",")))
    try:
        with session.working(f"exporting {options.model}"):
            exported = export_model(
                open_model(options.model, session),
                options.to.value,
                options.out,
                name=options.name,
                precision=options.precision.value,
                loop=LoopSettings(options.mass, options.inertia, options.delay, options.dt),
                adapt=adapt,
                force=options.force,
            )
    except ExportChanges as error:
        error.remedy = error.remedy or Remedy("export it all the same", "AGAIN --force")
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
