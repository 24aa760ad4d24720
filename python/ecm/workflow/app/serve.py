"""`ecm app`: opens or begins a session and serves it on this machine only."""

from __future__ import annotations

import secrets
import socket
from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

from ecm.errors import InputError
from ecm.io.arguments import check_arguments
from ecm.io.extras import require
from ecm.workflow.app.server import App, application
from ecm.workflow.app.session import suffix_of

_HOST = "127.0.0.1"


def serve(
    folder: str | Path,
    tables: Sequence[str | Path] = (),
    *,
    model: str | None = None,
    port: int = 0,
    demo: bool = False,
    ready: Callable[[str], object] = print,
) -> None:
    """Serve a session folder until Ctrl-C.

    Parameters
    ----------
    folder
        The session folder; one that is there goes on where it was.
    tables
        Tables of a new session.
    model
        Name of a model that is fitted to them, when their check leaves no warning open.
    port
        0: any that is free.
    demo
        Begin with a simulated campaign in which an effect is hidden.
    ready
        Called with the address when the server listens.

    Raises
    ------
    InputError
        Where the port is taken, or the folder has other tables.
    MissingExtra
        Where the extra `app` is not installed.

    Examples
    --------
    >>> import ecm
    >>> ecm.serve("session", ["missing.csv"])
    Traceback (most recent call last):
    ecm.errors.InputError: missing.csv: no such file
    """
    check_arguments(serve, locals())
    given = [Path(table) for table in tables]
    for table in given:
        if not table.is_file():
            raise InputError(f"{table}: no such file")
    uvicorn = require("uvicorn", "app", "The server of `ecm app`")
    listening = _listen(port)
    port = listening.getsockname()[1]
    with listening, closing(App(Path(folder))) as app:
        begin(app, given, model=model, demo=demo)
        token = secrets.token_urlsafe(24)
        server = uvicorn.Server(
            uvicorn.Config(
                application(app, port=port, token=token),
                log_level="error",
                server_header=False,
                date_header=False,
                timeout_graceful_shutdown=2,
            )
        )
        ready(f"http://{_HOST}:{port}/?token={token}")
        server.run(sockets=[listening])


def begin(
    app: App, tables: Sequence[Path], *, model: str | None = None, demo: bool = False
) -> None:
    """Put the tables of the command line, or the demo, into a new session."""
    history = app.session.journal.read()
    if history.steps:
        if tables:
            raise InputError(
                f"{app.session.folder} is a session already: open it without tables, or name a "
                "new folder with --session"
            )
        return
    if demo:
        app.jobs.start("example", {"name": "neck"})
        return
    for table in tables:
        suffix_of(table.name)  # all of them before the first one is taken
    for i, table in enumerate(tables):
        app.session.add_table(table, table.name, more=i > 0)
    if app.session.now()[1].data:  # a log is to be imported first
        app.jobs.start("check", {}, None if model is None else ("fit", {"model": model}))


def _listen(port: int) -> Any:
    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((_HOST, port))
        listening.listen()  # a browser that is faster than the server waits
    except (OSError, OverflowError) as error:
        listening.close()
        raise InputError(f"--port {port}: cannot be used ({error}). Choose another one") from None
    return listening
