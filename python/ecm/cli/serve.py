"""`ecm app`: the loop in a browser."""

from __future__ import annotations

import webbrowser

from ecm.cli.options.serve import Options
from ecm.cli.outputs import check_output_directory
from ecm.cli.session import Session
from ecm.workflow.app.serve import serve as serve_session


def serve(options: Options, session: Session) -> None:
    """Run `ecm app`."""
    check_output_directory(options.folder)
    session.on_interrupt(f"ecm app --session {options.folder} goes on with the session.")

    def ready(address: str) -> None:
        session.print(f"{address}\nCtrl-C ends the server; the session stays in {options.folder}.")
        if options.browser:
            webbrowser.open(address)

    serve_session(
        options.folder,
        options.data or (),
        model=options.model,
        port=options.port,
        demo=options.demo,
        ready=ready,
    )
