"""Draws the pictures of `ecm app`: goes round the demo in a headless Chromium.

.venv/bin/python docs/app_pictures.py docs          # the two pictures of docs/app.md
.venv/bin/python docs/app_pictures.py DIR --all     # every state, both themes, three widths
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from ecm.workflow.app.steps import PLAN, RIG, write_demo
from support.chromium import Page, open_chromium

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
    command = [sys.executable, "-m", "ecm", "app", "--no-open", *map(str, arguments)]
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
    command = [sys.executable, "-m", "ecm", "campaign", PLAN, "--rig", RIG]
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


def main() -> None:
    """Serve a new session of the demo, and take the pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--all", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name, open_chromium() as page:
        take = (of_all if options.all else of_docs)(page, options.folder)
        with served("--session", Path(name) / "neck") as (address, _):
            walk(page, address, take)
        if options.all:
            two_names(page, Path(name), take)
            troubles(page, Path(name), take)


if __name__ == "__main__":
    main()
