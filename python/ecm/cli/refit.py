"""`ecm refit`: add or remove an effect and fit again."""

from __future__ import annotations

from ecm.cli.models import open_model
from ecm.cli.options.refit import Options
from ecm.cli.outputs import saved_by_force
from ecm.cli.session import Session
from ecm.diagnosis.check import likely_continuous
from ecm.effects import load_installed
from ecm.models.refit import refit as refit_model
from ecm.models.refit import refit_summary
from ecm.models.worse import refuse_worse


def refit(options: Options, session: Session) -> None:
    """Run `ecm refit`."""
    session.check_output(options.out)
    table = session.read(options.data, need="fit")
    for sentence in likely_continuous(table):
        session.warn(sentence)
    load_installed()
    before = open_model(options.model, session, table)
    with session.working(f"fitting {len(table)} rows") as tell:
        fitted = refit_model(
            before,
            table,
            add=options.add or (),
            remove=options.remove or (),
            freeze=options.freeze or (),
            progress=tell,
        )
    with session.working("errors of the new model"):
        summary = refit_summary(fitted)
    session.write_json(summary)
    for line in summary["sentences"]:
        session.print(line)
    if not options.force:
        # Without an effect a model errs more: that was asked for.
        with session.working("errors of both models"), saved_by_force(options.out):
            refuse_worse(fitted, table, before=None if options.remove else before)
    fitted.save(options.out)
    session.print(f"{options.out}: written")
