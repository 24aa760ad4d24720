"""`ecm refit`: add or remove an effect and fit again."""

from __future__ import annotations

from ecm.cli.models import open_model
from ecm.cli.options.refit import Options
from ecm.cli.session import Session
from ecm.effects import load_installed
from ecm.models.refit import refit as refit_model
from ecm.models.refit import refit_summary


def refit(options: Options, session: Session) -> None:
    """Run `ecm refit`."""
    session.check_output(options.out)
    table = session.read(options.data, need="fit")
    load_installed()
    fitted = refit_model(
        open_model(options.model, session, table),
        table,
        add=options.add or (),
        remove=options.remove or (),
        freeze=options.freeze or (),
    )
    fitted.save(options.out)
    summary = refit_summary(fitted)
    session.write_json(summary)
    for line in summary["sentences"]:
        session.print(line)
    session.print(f"{options.out}: written")
