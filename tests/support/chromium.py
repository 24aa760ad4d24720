"""A headless Chromium that is driven: clicks, keys, files, screenshots (DevTools over a pipe)."""

from __future__ import annotations

import base64
import json
import os
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from support.programs import need_program

_OPTIONS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-dev-shm-usage",
    "--disable-extensions",
    "--no-first-run",
    "--remote-debugging-pipe",
    # No name but this machine's is known: a request to any other host fails.
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
)


_AT_REST = """new Promise(done => {
  let last = -1;
  const look = () => {
    if (scrollY === last) done();
    else { last = scrollY; setTimeout(look, 150); }
  };
  look();
})"""
"""A finger that drags a page lets it run on for a while."""


class Page:
    """One page of the browser."""

    def __init__(self, to_browser: int, from_browser: int) -> None:
        self._out, self._in = to_browser, from_browser
        self._buffer = b""
        self._number = 0
        self.events: list[dict[str, Any]] = []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        attached = self.call("Target.attachToTarget", targetId=target, flatten=True)
        self._session: str | None = attached["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network", "DOM"):
            self.call(f"{domain}.enable")

    _session: str | None = None

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Send a command to the browser and return its result."""
        self._number += 1
        message: dict[str, Any] = {"id": self._number, "method": method, "params": parameters}
        if self._session is not None:
            message["sessionId"] = self._session
        os.write(self._out, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._next()
            if answer.get("id") == self._number:
                assert "error" not in answer, f"{method}: {answer}"
                return answer["result"]
            self.events.append(answer)

    def _next(self) -> dict[str, Any]:
        while b"\0" not in self._buffer:
            part = os.read(self._in, 1 << 16)
            assert part, "the browser has ended"
            self._buffer += part
        line, _, self._buffer = self._buffer.partition(b"\0")
        return json.loads(line)

    def open(self, address: str) -> None:
        """Load an address; what happened on the page before is forgotten."""
        self.call("Page.navigate", url="about:blank")
        self.until("location.href === 'about:blank'")
        self.events.clear()
        self.call("Page.navigate", url=address)
        self.until("location.href !== 'about:blank'")

    def js(self, expression: str) -> Any:
        """Evaluate an expression; a promise is awaited."""
        found = self.call(
            "Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True
        )
        assert "exceptionDetails" not in found, found["exceptionDetails"]
        return found["result"].get("value")

    def until(self, expression: str, seconds: float = 60.0) -> Any:
        """Wait until an expression is true."""
        end = time.monotonic() + seconds
        # While a page is being loaded, parts of it are not there.
        tried = f"(() => {{ try {{ return {expression} }} catch {{ return false }} }})()"
        while not (value := self.js(tried)):
            assert time.monotonic() < end, f"{expression}\n{self.js('document.body.innerText')}"
            time.sleep(0.05)
        return value

    def click(self, selector: str, seconds: float = 60.0) -> None:
        """Click on an element when it is there and enabled."""
        at = json.dumps(selector)
        self.until(f"!document.querySelector({at}).disabled", seconds)
        self.js(f"document.querySelector({at}).click()")

    def keys(self, *names: str) -> None:
        """Press keys one after the other: `Tab`, `Enter`, ` `, `ArrowRight` or a letter."""
        for name in names:
            text = {"Enter": "\r"}.get(name, name if len(name) == 1 else "")
            code = {"Tab": 9, "Enter": 13, " ": 32, "Escape": 27, "ArrowRight": 39}.get(name, 0)
            self.call(
                "Input.dispatchKeyEvent",
                type="keyDown", key=name, text=text, windowsVirtualKeyCode=code,
            )  # fmt: skip
            self.call("Input.dispatchKeyEvent", type="keyUp", key=name, windowsVirtualKeyCode=code)

    def tab_to(self, selector: str) -> None:
        """Go to an element with the Tab key alone."""
        at = json.dumps(selector)
        self.until(f"!document.querySelector({at}).disabled")
        for _ in range(300):
            if self.js(f"document.activeElement.matches({at})"):
                return
            self.keys("Tab")
        raise AssertionError(f"the Tab key does not reach {selector}")

    def enter(self, selector: str) -> None:
        """Press an element by the Tab key and Enter alone."""
        self.tab_to(selector)
        self.keys("Enter")

    def finger(self, *points: tuple[float, float]) -> None:
        """Put a finger down at the first point of the window, drag it along, and lift it."""
        for kind, (x, y) in zip(
            ["touchStart", *["touchMove"] * (len(points) - 1)], points, strict=True
        ):
            self.call("Input.dispatchTouchEvent", type=kind, touchPoints=[{"x": x, "y": y}])
        self.call("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])

    def box(self, selector: str) -> tuple[float, float, float, float]:
        """Scroll an element into the window; left, top, width and height there."""
        at = json.dumps(selector)
        self.js(f"document.querySelector({at}).scrollIntoView({{block: 'center'}})")
        self.js(_AT_REST)
        rect = self.js(
            f"Object.values(document.querySelector({at}).getBoundingClientRect().toJSON())"
        )
        left, top, width, height = rect[:4]
        return left, top, width, height

    def unnamed(self) -> list[str]:
        """Return the roles of what can be focused but has no name for a screen reader."""
        nodes = self.call("Accessibility.getFullAXTree")["nodes"]
        return [
            node["role"]["value"]
            for node in nodes
            if not node.get("ignored")
            and any(
                p["name"] == "focusable" and p["value"]["value"] for p in node.get("properties", ())
            )
            and not node.get("name", {}).get("value", "").strip()
            and node["role"]["value"] not in ("RootWebArea", "main", "generic")
        ]

    def text(self) -> str:
        """Return what a person reads."""
        return str(self.js("document.body.innerText"))

    def problems(self) -> list[str]:
        """Return errors of scripts, blocked resources, and requests to other machines."""
        found = []
        for event in self.events:
            parameters = event.get("params", {})
            if event.get("method") == "Runtime.exceptionThrown":
                found.append(json.dumps(parameters["exceptionDetails"])[:500])
            if event.get("method") == "Log.entryAdded" and parameters["entry"]["level"] == "error":
                found.append(json.dumps(parameters["entry"])[:500])
            if event.get("method") == "Network.requestWillBeSent":
                url = parameters["request"]["url"]
                if not url.startswith(("http://127.0.0.1:", "data:", "blob:", "about:", "file:")):
                    found.append(url)
        return found

    def size(self, width: int, height: int, *, dark: bool = False) -> None:
        """Set the window and the theme."""
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width, height=height, deviceScaleFactor=1, mobile=width < 500,
        )  # fmt: skip
        self.call("Emulation.setTouchEmulationEnabled", enabled=width < 500)
        theme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[theme])

    def screenshot(self, path: Path, *, whole: bool = True) -> None:
        """Save a picture of the page."""
        data = self.call("Page.captureScreenshot", captureBeyondViewport=whole)["data"]
        path.write_bytes(base64.b64decode(data))


_NO_CARD = ("--disable-gpu",)
_IMITATED = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
             "--ignore-gpu-blocklist", "--enable-gpu-rasterization")  # fmt: skip
# Pages do not take a card of software by themselves.
_TAKE_IT = "WebGL2RenderingContext.prototype.getExtension = () => null"


@contextmanager
def open_chromium(*, card: bool = False) -> Iterator[Page]:
    """Start a browser without any profile, and end it; `card`: with an imitated graphics card."""
    program = need_program("chromium", "chromium-browser", "google-chrome")
    to_browser, from_test = os.pipe()
    to_test, from_browser = os.pipe()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        command = [
            program,
            *_OPTIONS,
            *(_IMITATED if card else _NO_CARD),
            f"--user-data-dir={profile}",
            "about:blank",
        ]
        # The browser reads commands from 3 and answers on 4.
        script = f'exec "$@" 3<&{to_browser} 4>&{from_browser}'
        process = subprocess.Popen(
            ["bash", "-c", script, "bash", *command],
            pass_fds=(to_browser, from_browser),
            env={**os.environ, "TMPDIR": profile},  # its own files go with the profile
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(to_browser)
        os.close(from_browser)
        try:
            page = Page(from_test, to_test)
            if card:
                page.call("Page.addScriptToEvaluateOnNewDocument", source=_TAKE_IT)
            yield page
        finally:
            process.kill()
            process.wait()
            os.close(from_test)
            os.close(to_test)
