"""Draws the pictures of `ecm app`: goes round the demo in a headless Chromium.

.venv/bin/python docs/app_pictures.py docs          # the two pictures of docs/app.md
.venv/bin/python docs/app_pictures.py DIR --all     # every state, both themes, three widths
.venv/bin/python docs/app_pictures.py docs --film   # the film of README.md (extra robot)
"""

from __future__ import annotations

import argparse
import base64
import io
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from ecm.workflow.app.steps import PLAN, RIG, write_demo
from support.chromium import Page, open_chromium

if TYPE_CHECKING:
    from PIL import Image

LONG_S = 300.0
WIDTHS = (360, 900, 1800)
IDLE = "document.documentElement.dataset.running === ''"
COMPARED = IDLE + " && /times the noise/.test(document.querySelector('nav').textContent)"
DRAWN = "document.querySelectorAll('.panel canvas').length > 6"
LOG = "Stroke [mm],Channel 7,note\n" + "".join(
    f"{i},{0.1 * i + 0.01 * (i % 3):.2f},{i % 2}\n" for i in range(20)
)
HIDDEN = "face_tilt"
"""The plan of the demo cannot tell it from what looks alike."""
Take = Callable[[str], None]


@contextmanager
def served(*arguments: str | Path) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """Serve a session whose rig takes its time; yields its address and the server."""
    command = [sys.executable, "-m", "ecm.cli", "app", "--no-open", *map(str, arguments)]
    slow = os.environ | {"ECM_READING_S": "0.15"}
    server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=slow)
    assert server.stdout is not None
    try:
        yield server.stdout.readline().strip(), server
    finally:
        server.terminate()
        server.communicate()


def of_docs(page: Page, folder: Path) -> Take:
    """Save the two pictures of docs/app.md, one of each theme."""
    sizes = {"fails": (900, False), "missing": (1240, True)}

    def take(name: str) -> None:
        if name in sizes:
            height, dark = sizes[name]
            page.size(1280, height, dark=dark)
            save(page, folder / f"app_{name}.png")

    return take


def of_all(page: Page, folder: Path) -> Take:
    """Save every state in both themes and three widths."""
    folder.mkdir(parents=True, exist_ok=True)

    def take(name: str) -> None:
        for dark in (False, True):
            for width in WIDTHS:
                page.size(width, 900, dark=dark)
                save(page, folder / f"{name}-{width}-{'dark' if dark else 'light'}.png")
        page.size(1280, 900)
        page.js("new Promise(done => setTimeout(done, 700))")  # another theme draws all again

    return take


def save(page: Page, path: Path) -> None:
    """Save what is seen when the figures have been drawn."""
    page.js("new Promise(done => setTimeout(done, 1000))")  # another theme draws all again
    page.js("document.querySelector('.effects .named [data-add]')?.focus()")
    page.js("scrollTo(0, 0)")
    page.js("new Promise(done => setTimeout(done, 700))")
    page.screenshot(path, whole=False)


def walk(page: Page, address: str, take: Take) -> None:
    """Go round the loop of the demo."""
    page.size(1280, 900)
    page.open(address)
    page.until("!!document.querySelector('#example-neck')")
    take("empty")
    page.click("#example-neck")
    page.until("document.querySelector('#live')?.textContent.includes('so far')"
               " || !!document.querySelector('#to-model')", LONG_S)  # fmt: skip
    take("measuring")
    page.click("#to-model", LONG_S)
    page.until(IDLE, LONG_S)
    page.js("location.hash = 'data'")
    page.until("document.querySelectorAll('.views button').length > 3", LONG_S)
    take("data")
    page.click("#to-model", LONG_S)
    page.click("[name=kind][value=physics]")
    take("model")
    page.click("#fit")
    page.click("#to-fails", LONG_S)
    page.until(DRAWN, LONG_S)
    take("fails")
    page.js("[...document.querySelectorAll('.panel canvas')].at(-1).focus()")
    page.keys("ArrowRight", " ", "ArrowRight", "ArrowRight", " ")
    take("marked")
    page.js("[...document.querySelectorAll('.marked button')].at(-1).click()")
    page.js("document.documentElement.scrollTop = 0")
    page.click("#to-missing")
    page.until(DRAWN, LONG_S)
    page.click("#diagnose")
    page.until("!document.querySelector('#running').hidden")
    take("diagnosing")
    page.until(f"!!document.querySelector('#verdict') && {IDLE} && {DRAWN}", LONG_S)
    page.js("document.querySelector('.effects .named [data-add]').focus()")
    take("missing")
    page.js("location.hash = 'next'")
    page.until("document.documentElement.dataset.stage === 'next'")
    take("next")
    page.js("location.hash = 'missing'")
    page.click(".effects .named [data-add]", LONG_S)
    page.until(f"document.querySelectorAll('tbody tr').length > 1 && {COMPARED}", LONG_S)
    page.click("#reveal", LONG_S)
    page.until(f"!!document.querySelector('#truth') && {IDLE}", LONG_S)
    take("add")
    page.js("location.hash = 'out'")
    page.click("#export", LONG_S)
    page.until(f"!!document.querySelector('.files a') && {IDLE}", LONG_S)
    page.until("document.querySelector('#script').textContent.length > 9", LONG_S)
    take("out")


def two_names(page: Page, folder: Path, take: Take) -> None:
    """Several names that stay, the experiment that tells them apart, and its readings."""
    session, data = folder / "ambiguous", folder / "ambiguous.csv"
    session.mkdir()
    write_demo(session)  # plan and rig: the next experiment is driven, too
    command = [sys.executable, "-m", "ecm.cli", "campaign", PLAN, "--rig", RIG]
    command += ["--hide", HIDDEN, "--seed", "1", "--out", str(data)]
    subprocess.run(command, check=True, cwd=session, capture_output=True)
    with served(data, "--session", session) as (address, _):
        page.open(address)
        page.click("#to-model", LONG_S)
        page.click("[name=kind][value=physics]")
        page.click("#fit")
        page.until("!!document.querySelector('#to-fails')", LONG_S)
        page.js("location.hash = 'missing'")
        page.click("#diagnose", LONG_S)
        page.until(f"!!document.querySelector('#verdict') && {IDLE} && {DRAWN}", LONG_S)
        take("several")
        page.js("location.hash = 'next'")
        page.until("!!document.querySelector('#main ol.effects li')", LONG_S)
        take("proposed")
        page.click("#campaign")
        page.until("document.querySelector('#live')?.textContent.includes('so far')", LONG_S)
        take("proposed-measured")


def troubles(page: Page, folder: Path, take: Take) -> None:
    """Logs that are to be imported, an import that fails, a warning, and a server that is gone."""
    for name in ("monday.log", "tuesday.log"):
        (folder / name).write_text(LOG, encoding="utf-8")
    given = (folder / "monday.log", folder / "tuesday.log")
    with served(*given, "--session", folder / "logs") as (address, server):
        page.open(address)
        page.until("!!document.querySelector('#import')")
        take("import")
        page.click("#import")
        page.until("!!document.querySelector('#trouble')", LONG_S)
        take("error")
        page.js("document.querySelector('#map').value = 'x_m=Stroke [mm]:mm\\nfx_N=Channel 7:N'")
        page.click("#import")
        page.until("!!document.querySelector('.warning button')", LONG_S)
        take("warning")
        server.terminate()
        page.until("!!document.querySelector('#status .error')", LONG_S)
        take("lost")


HELD_CLOCK = """(() => {
  const frame = requestAnimationFrame;
  window.clock = performance.now();
  performance.now = () => clock;
  window.requestAnimationFrame = then => frame(() => then(clock));
  const hand = document.createElement("div");
  hand.id = "hand";
  hand.style = "position:fixed;width:18px;height:18px;margin:-9px;border-radius:9px;z-index:99;"
    + "background:#d9480f99;border:2px solid #fff;pointer-events:none;display:none";
  document.body.append(hand);
  window.point = at => {
    const box = document.querySelector(at).getBoundingClientRect();
    hand.style.display = "";
    hand.style.left = `${box.x + box.width / 2}px`;
    hand.style.top = `${box.y + box.height / 2}px`;
  };
})()"""
"""Animations run as far as the film says, so that a slow machine draws the same frames."""


class Film:
    """Frames and how long each is shown; frames that are alike become one."""

    def __init__(self, page: Page) -> None:
        self._page = page
        self.frames: list[Image.Image] = []
        self.times_ms: list[int] = []

    def shoot(self, seconds: float, frame_ms: int = 60) -> None:
        """Let the page's clock run for some time."""
        from PIL import Image  # noqa: PLC0415 - of the extra robot, and only the film needs it

        for _ in range(max(1, round(1e3 * seconds / frame_ms))):
            self._page.js(f"clock += {frame_ms}; new Promise(requestAnimationFrame)")
            self._page.js("new Promise(requestAnimationFrame)")
            data = self._page.call("Page.captureScreenshot")["data"]
            frame = Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB")
            if self.frames and frame.tobytes() == self.frames[-1].tobytes():
                self.times_ms[-1] += frame_ms
            else:
                self.frames.append(frame)
                self.times_ms.append(frame_ms)

    def save(self, path: Path) -> None:
        """Write a moving picture that is shown again and again."""
        first, *others = self.frames
        first.save(
            path, save_all=True, append_images=others, duration=self.times_ms, loop=0,
            lossless=True, quality=100, method=6,
        )  # fmt: skip


def film(page: Page, address: str, path: Path) -> None:
    """Fit, diagnose, point at the effect that is named, add it, and see the error fall."""
    page.size(1120, 820)
    page.open(address)
    page.click("#example-neck")
    page.click("#to-model", LONG_S)
    page.until(IDLE, LONG_S)
    page.click("[name=kind][value=physics]")
    page.js(HELD_CLOCK)
    shots = Film(page)
    named = ".effects .named [data-add]"

    def click(at: str) -> None:
        page.js(f"point('{at}')")
        shots.shoot(0.8)
        page.click(at)
        page.js("hand.style.display = 'none'")

    shots.shoot(0.8)
    click("#fit")
    page.until("!!document.querySelector('#to-fails')", LONG_S)
    page.until(IDLE, LONG_S)
    click("#to-fails")
    page.until(f"{DRAWN} && {IDLE}", LONG_S)
    shots.shoot(2)
    click("#to-missing")
    page.until(DRAWN, LONG_S)
    click("#diagnose")
    page.until("!document.querySelector('#running').hidden")
    shots.shoot(0.6)
    page.until(f"!!document.querySelector('#verdict') && {IDLE} && {DRAWN}", LONG_S)
    shots.shoot(2)
    page.js(f"document.querySelector('{named}').scrollIntoView({{block: 'center'}})")
    shots.shoot(1)
    page.js(f"document.querySelector('{named}').focus(); point('{named}')")
    shots.shoot(2.5)
    click(named)
    page.until(f"document.querySelectorAll('tbody tr').length > 1 && {COMPARED}", LONG_S)
    page.until("!!document.querySelector('#main .space canvas, #main canvas')"
               " && !document.body.innerText.includes('Computing the')", LONG_S)  # fmt: skip
    shots.shoot(4)
    shots.save(path)


def main() -> None:
    """Serve a new session of the demo, and take the pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--all", action="store_true")
    parser.add_argument("--film", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name, open_chromium() as page:
        if options.film:
            with served("--session", Path(name) / "neck") as (address, _):
                film(page, address, options.folder / "app.webp")
            return
        take = (of_all if options.all else of_docs)(page, options.folder)
        with served("--session", Path(name) / "neck") as (address, _):
            walk(page, address, take)
        if options.all:
            two_names(page, Path(name), take)
            troubles(page, Path(name), take)


if __name__ == "__main__":
    main()
