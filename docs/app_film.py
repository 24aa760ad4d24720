"""Makes the film of `ecm app`: fit, diagnose, point at the effect that is named, add it.

.venv/bin/python docs/app_film.py docs/app.webp     # Chromium and the extra robot (Pillow)

The clock of the page is held between frames, so what takes seconds to compute is left out.
"""

from __future__ import annotations

import base64
import io
import sys
import tempfile
from pathlib import Path

from app_pictures import COMPARED, DRAWN, IDLE, LONG_S, served
from PIL import Image

from support.chromium import Page, open_chromium

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
            lossless=True, quality=50, method=3,
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


if __name__ == "__main__":
    with (
        tempfile.TemporaryDirectory() as name,
        open_chromium() as page,
        served("--session", Path(name) / "neck") as (address, _),
    ):
        film(page, address, Path(sys.argv[1]))
