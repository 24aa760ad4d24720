"""Who may ask: the token, the Host and the Origin of a request; the headers of every answer."""

from __future__ import annotations

import hmac
import re
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any
from urllib.parse import parse_qs

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
)


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
        headers = {k.decode("latin-1").lower(): v.decode("latin-1") for k, v in scope["headers"]}
        if headers.get("host") not in self.hosts:
            await _answer(send, 421, "This server answers to 127.0.0.1 only.")
        elif not self._of_this_page(headers):
            await _answer(send, 403, "Another page may not ask this server.")
        elif scope["path"] == "/" and self._has_token(scope):
            await _answer(send, 303, "", ((b"location", b"/"), (b"set-cookie", self._cookie())))
        elif not self._allowed(headers):
            await _answer(
                send, 403, "Open the whole address that `ecm app` printed, with its token."
            )
        else:
            await self.application(scope, receive, _with_headers(send))

    def _of_this_page(self, headers: dict[str, str]) -> bool:
        """Whether no other page asks: browsers say so, other programs do not."""
        origin, site = headers.get("origin"), headers.get("sec-fetch-site", "none")
        return (origin is None or origin in self.origins) and site in ("none", "same-origin")

    def _has_token(self, scope: Scope) -> bool:
        given = parse_qs(scope["query_string"].decode("latin-1")).get("token", [""])[0]
        return self._is_token(given)

    def _allowed(self, headers: dict[str, str]) -> bool:
        found = re.search(rf"(?:^|;\s*){self.cookie}=([^;]*)", headers.get("cookie", ""))
        return self._is_token(headers.get("x-ecm-token", found.group(1) if found else ""))

    def _is_token(self, given: str) -> bool:
        return hmac.compare_digest(given.encode(), self.token.encode())

    def _cookie(self) -> bytes:
        return f"{self.cookie}={self.token}; HttpOnly; SameSite=Strict; Path=/".encode()


def _with_headers(send: Send) -> Send:
    async def extended(message: MutableMapping[str, Any]) -> None:
        if message["type"] == "http.response.start":
            own = {key.lower() for key, _ in message["headers"]}
            more = [item for item in _HEADERS if item[0] not in own]
            if b"content-security-policy" not in own:
                more.append((b"content-security-policy", POLICY.encode()))
            message = {**message, "headers": [*message["headers"], *more]}
        await send(message)

    return extended


async def _answer(
    send: Send, status: int, text: str, headers: tuple[tuple[bytes, bytes], ...] = ()
) -> None:
    start = {
        "type": "http.response.start",
        "status": status,
        "headers": [(b"content-type", b"text/plain; charset=utf-8"), *headers],
    }
    await _with_headers(send)(start)
    await send({"type": "http.response.body", "body": text.encode()})
