"""Draws the pictures of docs/app.md: goes round `ecm app --demo` in a headless Chromium.

.venv/bin/python docs/app_pictures.py docs
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from support.chromium import Page, open_chromium

IDLE = "document.documentElement.dataset.running === ''"
DRAWN = "document.querySelectorAll('.panel canvas').length > 6"


def walk(page: Page, address: str, folder: Path) -> None:
    """Data, model, where it fails (a picture), what is missing (a picture)."""
    page.size(1280, 900)
    page.open(address)
    page.click("#to-model", 120)
    page.click("[name=kind][value=physics]")
    page.click("#fit")
    page.click("#to-fails", 120)
    page.until(DRAWN, 120)
    picture(page, folder / "app_fails.png")
    page.size(1280, 900, dark=True)
    page.click("#to-missing")
    page.click("#diagnose")
    page.until(f"!!document.querySelector('#verdict') && {IDLE} && {DRAWN}", 240)
    page.js("document.querySelector('.effects .named button').focus()")
    picture(page, folder / "app_missing.png")


def picture(page: Page, path: Path) -> None:
    """Save what is seen when the figures have been drawn."""
    page.js("scrollTo(0, 0)")
    page.js("new Promise(done => setTimeout(done, 1000))")
    page.screenshot(path, whole=False)


def main(folder: Path) -> None:
    """Serve a new session of the demo, and take the pictures."""
    with tempfile.TemporaryDirectory() as session, open_chromium() as page:
        command = [sys.executable, "-m", "ecm.cli", "app", "--demo", "--no-open"]
        server = subprocess.Popen(
            [*command, "--session", f"{session}/neck"], stdout=subprocess.PIPE, text=True
        )
        assert server.stdout is not None
        try:
            walk(page, server.stdout.readline().strip(), folder)
        finally:
            server.terminate()
            server.communicate()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
