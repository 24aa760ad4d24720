"""`ecm identify`: the paper's three steps and the loop after them."""

from __future__ import annotations

from ecm.cli.options.identify import Options
from ecm.cli.outputs import check_output_directory
from ecm.cli.session import Session
from ecm.io.cache import write_atomically
from ecm.workflow.config import read_config, with_rig
from ecm.workflow.identify import identify as identify_mechanism


def identify(options: Options, session: Session) -> None:
    """Run `ecm identify`."""
    out = options.out
    check_output_directory(out)
    session.on_interrupt(f"finished stages are kept in {out}. The same command goes on there.")
    config = read_config(options.config)
    if options.rig is not None:
        config = with_rig(config, options.rig)
    summary = identify_mechanism(
        config, out, seed=session.seed, threads=session.threads, console=session
    )
    session.write_json(summary)
    if session.report is not None:
        write_atomically(session.report, (out / "report.html").read_bytes())
