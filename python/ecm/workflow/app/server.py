"""`ecm app`: the routes, thin JSON over the session folder, who may ask, and the server.

It serves this machine only.
"""

from __future__ import annotations

import asyncio
import contextlib
import filecmp
import hmac
import json
import os
import secrets
import socket
import sys
import tempfile
from collections.abc import AsyncIterator, Awaitable, Callable, MutableMapping, Sequence
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import IO, Any
from urllib.parse import quote

from ecm.errors import EcmError, InputError, Remedy, document_of
from ecm.io.arguments import check_arguments, listed, path_of
from ecm.io.description import Meta
from ecm.io.events import Follower, live_path
from ecm.io.extras import require
from ecm.report.blocks import WEB
from ecm.report.figures import view_of
from ecm.workflow.app.copying import archive_of, copy_of, report_of
from ecm.workflow.app.jobs import Busy, Jobs, Views
from ecm.workflow.app.journal import DiskError, sentence, writing
from ecm.workflow.app.session import INCOMING, Session, model_of, suffix_of
from ecm.workflow.app.views import NEED_MODEL, VIEWS, fits_of, state_of

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl


def locked(folder: Path) -> IO[bytes]:
    """Return the lock of a folder, held until it is closed or the process ends.

    Raises
    ------
    InputError
        Where another process holds it.
    """
    file = (folder / ".lock").open("a+b")
    try:
        if sys.platform == "win32":
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        else:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        file.close()
        raise InputError(
            f"{folder}: another `ecm app` has this session open. Use its page, end it, or name "
            "another folder with --session."
        ) from None
    return file


_PURPOSE = "The page of `ecm app`"
Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src 'self' data: blob:; font-src 'self' data:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""No script and no style but the server's own."""
REPORT_POLICY = (
    "sandbox allow-scripts allow-downloads; default-src 'none'; script-src 'unsafe-inline'; "
    "style-src 'unsafe-inline'; img-src data: blob:; font-src data:; frame-ancestors 'none'"
)
"""A report carries its script in itself. In a sandbox it has another origin than the page."""
_HEADERS = (
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"cache-control", b"no-store"),
    (b"content-security-policy", POLICY.encode()),
)
"""What each answer says that does not say otherwise."""


class Guard:
    """Refuses requests that are not from the person who began the server.

    Parameters
    ----------
    application
        What answers the others.
    port
        Port of the server: Host and Origin must name it, on this machine.
    token
        Secret of the address. A page that was opened with it gets it as a cookie.
    """

    def __init__(self, application: Any, *, port: int, token: str) -> None:
        self.application = application
        self.token = token
        self.hosts = {f"127.0.0.1:{port}", f"localhost:{port}"}
        self.origins = {f"http://{host}" for host in self.hosts}
        self.cookie = f"ecm_{port}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or refuse it."""
        if scope["type"] == "lifespan":
            await self.application(scope, receive, send)
            return
        if scope["type"] != "http":  # no web sockets here
            await send({"type": "websocket.close", "code": 1008})
            return
        answer = self._own_answer(scope) or self.application
        await answer(scope, receive, _with_headers(send))

    def _own_answer(self, scope: Scope) -> Any:
        """The answer to a request that the application does not get; None where it does."""
        plain = _responses().PlainTextResponse
        asked = require("starlette.requests", "app", _PURPOSE).HTTPConnection(scope)
        headers = asked.headers
        # Whether another page asks: browsers say so, other programs do not.
        origin, site = headers.get("origin"), headers.get("sec-fetch-site", "none")
        foreign = origin not in (None, *self.origins) or site not in ("none", "same-origin")
        # The token of a program, else of the page's cookie.
        given = headers.get("x-ecm-token", asked.cookies.get(self.cookie, ""))
        if headers.get("host") not in self.hosts:
            return plain("This server answers to 127.0.0.1 only.", 421)
        if foreign:
            return plain("Another page may not ask this server.", 403)
        if scope["path"] == "/" and self._is_token(asked.query_params.get("token", "")):
            cookie = f"{self.cookie}={self.token}; HttpOnly; SameSite=Strict; Path=/"
            return _responses().RedirectResponse("/", 303, {"set-cookie": cookie})
        if not self._is_token(given):
            return plain("Open the whole address that `ecm app` printed, with its token.", 403)
        return None

    def _is_token(self, given: str) -> bool:
        return hmac.compare_digest(given.encode(), self.token.encode())


def _with_headers(send: Send) -> Send:
    async def extended(message: MutableMapping[str, Any]) -> None:
        if message["type"] == "http.response.start":
            own = {key.lower() for key, _ in message["headers"]}
            more = [item for item in _HEADERS if item[0] not in own]
            message = {**message, "headers": [*message["headers"], *more]}
        await send(message)

    return extended


MOST_BYTES = 2_000_000_000
"""Largest file that may be dropped."""
_MOST_REQUEST = 100_000
_PAGE = Path(__file__).parent / "page"
_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
    ".json": "application/json",
    ".csv": "text/csv; charset=utf-8",
}


class App:
    """A session at work: its folder, its worker and its views.

    Steps that a killed server left are marked as interrupted.

    Parameters
    ----------
    folder
        The session folder.
    follow
        Table that `ecm measure` writes; when it is there the session takes it.

    Raises
    ------
    InputError
        Where another server has the folder open.
    """

    def __init__(self, folder: Path, follow: Path | None = None) -> None:
        self.session = Session(folder)
        self._lock = locked(folder)
        self.session.recover()
        self.jobs, self.views = Jobs(self.session), Views(folder)
        self.follow, self._follower = follow, Follower()
        self.most_bytes = MOST_BYTES

    def close(self) -> None:
        """End the processes, and let another server have the folder."""
        self.jobs.close()
        self.views.close()
        self._lock.close()

    def state(self) -> dict[str, Any]:
        """Return the state of the folder, and how far the running step is."""
        self.jobs.settle()
        self._take_followed()
        running = self.jobs.progress()
        state = state_of(self.session)
        going = {step["number"] for step in state["steps"] if step["status"] == "running"}
        # A step may end between the two: beside its result the page would be drawn twice, and
        # what a person does at the first drawing would be lost.
        if running and not running["waiting"] and running["step"] not in going:
            running = None
        following = {} if self.follow is None else {"following": self.follow.name}
        return {**state, "running": running, **following}

    def live(self, row: int) -> dict[str, Any]:
        """Return what the campaign that runs, or the run that is followed, tells after a row."""
        steps = reversed(self.session.journal.read().steps.values())
        running = (s for s in steps if s.status == "running" and s.argv[:1] == ["campaign"])
        if step := next(running, None):
            path, name = self.session.log_path(step.number, "events"), ""
        elif self.follow is None:
            return {"of": None}
        else:
            path, name = live_path(self.follow), self.follow.name
        found = self._follower.after(path, row)
        if found["begun"]:
            view = view_of(Meta(mechanism=found["begun"]["mechanism"]))
            found["begun"] = {**found["begun"], **view}
        return {"of": name, **found}

    def _take_followed(self) -> None:
        """Take the table that was followed when it is written, once, as a run of the data."""
        table = self.follow
        if table is None or self.jobs.busy() or not table.is_file() or live_path(table).exists():
            return

        def take() -> None:
            if self.follow is None:  # another tab was faster
                return
            history, files = self.session.now()
            own = [self.session.folder / step.outputs[0] for step in history.steps.values()]
            if not any(path.is_file() and filecmp.cmp(path, table, False) for path in own):
                self.session.add_table(table, table.name, more=bool(files.data))
                self.jobs.start("check", {})
            self.follow = None

        self.jobs.alone(take)


def application(app: App, *, port: int, token: str) -> Any:
    """Return the server of an opened session as an ASGI application.

    Raises
    ------
    MissingExtra
        Where the extra `app` is not installed.
    """
    starlette = require("starlette.applications", "app", _PURPOSE)
    routing = require("starlette.routing", "app", _PURPOSE)
    routes = _Routes(app)
    asked = {
        "/": routes.page,
        "/page/{name}": routes.page,
        "/api/state": routes.state,
        "/api/view/{name}": routes.view,
        "/api/live": routes.live,
        "/api/copy": routes.copy,
        "/api/report": routes.report,
        "/api/zip": routes.zip,
        "/api/log/{number:int}": routes.log,
        "/files/{name:path}": routes.file,
    }
    done = {"/api/upload": routes.upload, "/api/{action}": routes.action}
    paths = [routing.Route(path, route, methods=["GET"]) for path, route in asked.items()]
    paths += [routing.Route(path, route, methods=["POST"]) for path, route in done.items()]

    @contextlib.asynccontextmanager
    async def lifespan(_: Any) -> AsyncIterator[None]:
        yield
        app.close()

    gone = require("starlette.requests", "app", _PURPOSE).ClientDisconnect
    inner = starlette.Starlette(
        routes=paths,
        lifespan=lifespan,
        exception_handlers=dict.fromkeys((EcmError, OSError, gone), routes.refused),
    )
    return Guard(inner, port=port, token=token)


class _Routes:
    def __init__(self, app: App) -> None:
        self.app = app
        self.files = {path.name: path for folder in (_PAGE, WEB) for path in folder.iterdir()}
        """The files of the page: only these names can be asked for."""

    async def page(self, request: Any) -> Any:
        path = self.files.get(request.path_params.get("name", "index.html"))
        if path is None:
            return _json({"error": "no such file"}, 404)
        return _file(path, {"cache-control": "no-cache"})

    async def state(self, _request: Any) -> Any:
        return _json(await asyncio.to_thread(self.app.state))

    async def view(self, request: Any) -> Any:
        name = request.path_params["name"]
        if name not in VIEWS:
            return _json({"error": f"no view; there are {', '.join(VIEWS)}"}, 404)
        history, files = self.app.session.now()
        data = files.dropped[:1] if name == "log" else files.data
        model, wanted = None, request.query_params.get("of")
        if name in NEED_MODEL:  # an undo may be a moment old: any model of these data is shown
            models = map(model_of, fits_of(history.steps.values(), files))
            named = {",".join([*data, one]): one for one in models}
            model = files.model if wanted is None else named.get(wanted, files.model)
        if not data or (name in NEED_MODEL and model is None):
            raise InputError("nothing to show yet: it needs a table, and most views a model")
        if wanted not in (None, ",".join([*data, *([] if model is None else [model])])):
            raise Busy("the session has changed in the meantime")
        skip = files.skip_bad_rows and name != "log"
        path = await asyncio.to_thread(self.app.views.file, name, data, model, skip_bad_rows=skip)
        return _file(path)

    async def live(self, request: Any) -> Any:
        after = request.query_params.get("after", "0")
        if not (after.isdecimal() and len(after) < 10):
            raise InputError(f"after {after!r}: expected the number of a row")
        return _json(await asyncio.to_thread(self.app.live, int(after)))

    async def copy(self, _request: Any) -> Any:
        text = await asyncio.to_thread(copy_of, self.app.session, self.app.views)
        return _attached(text.encode(), f"{self.app.session.folder.resolve().name}.html")

    async def report(self, _request: Any) -> Any:
        report = await asyncio.to_thread(report_of, self.app.session)
        policy = {"content-security-policy": REPORT_POLICY}
        return _responses().HTMLResponse(report.page(), headers=policy)

    async def zip(self, _request: Any) -> Any:
        content = await asyncio.to_thread(archive_of, self.app.session.folder)
        return _attached(content, f"{self.app.session.folder.resolve().name}.zip")

    async def log(self, request: Any) -> Any:
        number = request.path_params["number"]
        text = [self.app.session.log(number, kind).decode("utf-8", "replace")
                for kind in ("out", "err")]  # fmt: skip
        return _json({"out": text[0], "err": text[1]})

    async def file(self, request: Any) -> Any:
        name = request.path_params["name"]
        if name not in self.app.session.downloads():
            return _json({"error": "no such file in this session"}, 404)
        if name == "script.sh":
            return _responses().PlainTextResponse(self.app.session.script())
        headers = {"content-disposition": "attachment"}
        if name.endswith(".html"):
            headers = {"content-security-policy": REPORT_POLICY}
        return _file(self.app.session.folder / name, headers)

    async def refused(self, _request: Any, error: Exception) -> Any:
        """Say what was wrong with a request, and the way out as of a refused step."""
        if isinstance(error, OSError):
            return _json({"error": sentence(error)}, 507)
        if not isinstance(error, EcmError):  # the page was closed in the middle of an upload
            return _json({"error": "the file did not come to its end"}, 400)
        known: dict[type[Exception], int] = {Busy: 409, DiskError: 507}
        found = {"error": document_of(error)["message"], "remedy": self.app.session.way_out(error)}
        return _json(found, known.get(type(error), 400))

    async def action(self, request: Any) -> Any:
        body = await _body(request)
        done = await asyncio.to_thread(self._done, request.path_params["action"], body)
        return _json({"error": "no such action"}, 404) if done is None else _json(done)

    def _done(self, action: str, body: dict[str, Any]) -> dict[str, Any] | None:
        """Do what the page asks for, and return the answer; None where nothing is called so."""
        jobs, session = self.app.jobs, self.app.session
        changes: dict[str, Callable[[], None]] = {
            "leave_out": lambda: session.leave_out(body.get("rows")),
            "describe": lambda: session.describe(body.get("sections")),
            "undo": session.undo,
            "redo": session.redo,
            "accept": lambda: session.accept(str(body.get("warning", ""))),
        }
        if action in changes:
            jobs.alone(changes[action])
            if action in ("leave_out", "describe"):
                return {"step": jobs.start("check", {"then": body.get("then")})}
            return self.app.state()
        if action == "step":
            return {"step": jobs.start(str(body.pop("verb", None)), body)}
        if action == "again":
            wanted, steps = body.get("step"), session.journal.read().steps
            step = steps.get(wanted) if isinstance(wanted, int) else None
            if step is None or not step.argv:
                raise InputError("no such step with a command in this session")
            return {"step": jobs.start(step.verb, step.request)}
        return {"cancelled": jobs.cancel()} if action == "cancel" else None

    async def upload(self, request: Any) -> Any:
        """Stream the body into the session folder; its name is a text in the address."""
        name = request.query_params.get("name", "")
        if not name or len(name) > 255:
            raise InputError("the file has no name, or one of more than 255 characters")
        if self.app.jobs.busy():
            raise Busy("a step is being computed: wait for it, or cancel it")
        session, size = self.app.session, 0
        with writing(session.folder / INCOMING, name):
            handle, temporary = tempfile.mkstemp(prefix=INCOMING, dir=session.folder)
        path = Path(temporary)
        try:
            with writing(path, name), os.fdopen(handle, "wb") as file:
                async for chunk in request.stream():
                    size += len(chunk)
                    if size > self.app.most_bytes:
                        most = self.app.most_bytes
                        raise InputError(f"{name}: more than {most} bytes, the limit of this page")
                    file.write(chunk)
            more = request.query_params.get("more") == "1"
            # Another tab may have begun a step while the file came in.
            take = partial(self._take, path, name, more=more)
            number = await asyncio.to_thread(self.app.jobs.alone, take)
        finally:
            path.unlink(missing_ok=True)
        return _json({"step": number})

    def _take(self, path: Path, name: str, *, more: bool) -> int:
        session = self.app.session
        if name.lower().endswith(".toml"):
            step = session.add_description(path, name)
        else:
            step = session.add_table(path, name, more=more, move=True)
        if step.outputs[0] in session.now()[1].data:
            self.app.jobs.start("check", {})
        return step.number


async def _body(request: Any) -> dict[str, Any]:
    """Return the JSON object of a request; a page of another origin cannot send this type."""
    if request.headers.get("content-type", "").split(";")[0] != "application/json":
        raise InputError("expected a JSON object (content-type application/json)")
    content = b""
    async for chunk in request.stream():
        content += chunk
        if len(content) > _MOST_REQUEST:
            raise InputError(f"a request of more than {_MOST_REQUEST} bytes")
    try:
        body = json.loads(content)
        json.dumps(body, ensure_ascii=False).encode()  # half a surrogate cannot be kept
    except (ValueError, RecursionError):
        body = None
    if not isinstance(body, dict):
        raise InputError("expected a JSON object")
    return body


def _responses() -> Any:
    return require("starlette.responses", "app", _PURPOSE)


def _json(document: Any, status: int = 200) -> Any:
    return _responses().JSONResponse(document, status_code=status)


def _attached(content: bytes, name: str) -> Any:
    named = {"content-disposition": f"attachment; filename*=UTF-8''{quote(name)}"}
    return _responses().Response(content, media_type="application/octet-stream", headers=named)


def _file(path: Path, headers: dict[str, str] | None = None) -> Any:
    kind = _TYPES.get(path.suffix, "application/octet-stream")
    return _responses().FileResponse(path, media_type=kind, headers=headers)


_HOST = "127.0.0.1"


def serve(
    folder: str | Path,
    tables: str | Path | Sequence[str | Path] = (),
    *,
    model: str | None = None,
    port: int = 0,
    demo: bool = False,
    follow: str | Path | None = None,
    ready: Callable[[str], object] = print,
) -> None:
    """Serve a session folder until Ctrl-C.

    Parameters
    ----------
    folder
        The session folder; one that is there goes on where it was.
    tables
        Tables of a new session, or one alone.
    model
        Name of a model that is fitted to them, when their check leaves no warning open.
    port
        0: any that is free.
    demo
        Begin with a simulated campaign in which an effect is hidden.
    follow
        Table that `ecm measure` writes: its rows are shown as they come, and at the end the
        session takes it, as a further run where it has data.
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
    given = [Path(table) for table in listed(tables)]
    for table in given:
        if not table.is_file():
            grows = Remedy("watch its rows come", f"ecm app --follow {table}")
            remedy = grows if live_path(table).exists() else None
            raise InputError(f"{table}: no such file", remedy=remedy)
    uvicorn = require("uvicorn", "app", "The server of `ecm app`")
    listening = _listen(port)
    port = listening.getsockname()[1]
    with (
        listening,
        closing(App(path_of(folder), None if follow is None else path_of(follow))) as app,
    ):
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
        then = None if model is None else {"verb": "fit", "model": model}
        app.jobs.start("check", {"then": then})


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
