"""The whole loop of `ecm app --demo` in a headless Chromium, with times, memory and pictures.

.venv/bin/python benches/app.py [--rows 20000] [--clicks 300] [--pictures DIR]

It goes from the sealed campaign to the truth by clicks, runs the script of the session in a new
folder and compares every byte. Then it opens a table of many rows and prints how long a hover and a
brush take, and what the page holds in memory after many clicks.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import numpy as np

from ecm.io.columns import POSE, WRENCH
from support.chromium import Page, open_chromium
from support.neck import neck_rows

STAGES = ("data", "model", "fails", "missing", "add", "next", "out")
WIDTHS = (360, 900, 1800)
LONG_S = 120.0


@contextmanager
def served(*arguments: str | Path) -> Iterator[str]:
    """Serve a session; yields its address."""
    command = [sys.executable, "-m", "ecm.cli", "app", "--no-open", *map(str, arguments)]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert server.stdout is not None
    try:
        yield server.stdout.readline().strip()
    finally:
        server.send_signal(signal.SIGTERM)
        server.communicate(timeout=60)


def state_of(page: Page) -> dict[str, Any]:
    """State of the session."""
    found: dict[str, Any] = json.loads(page.js("fetch('/api/state').then(r => r.text())"))
    return found


def wait_for(page: Page, condition: str) -> None:
    """Wait until nothing is computed and a condition of the state `s` holds."""
    answer = "fetch('/api/state').then(r => r.json())"
    page.until(f"{answer}.then(s => !s.running && ({condition}))", LONG_S)


def go(page: Page, stage: str) -> None:
    """Open a stage and wait until it is drawn."""
    page.js(f"location.hash = '{stage}'")
    page.until(f"document.documentElement.dataset.stage === '{stage}'", LONG_S)


def demo(page: Page, folder: Path, pictures: Path | None) -> dict[str, Any]:
    """Go round the loop of the demo; the figures of it."""
    with served("--demo", "--session", folder) as address:
        begun = time.monotonic()
        page.open(address)
        page.until("!!document.documentElement.dataset.stage")
        first = time.monotonic() - begun
        begun = time.monotonic()
        page.click("#to-model", LONG_S)
        page.click("[name=kind][value=physics]", LONG_S)
        page.click("#fit", LONG_S)
        page.click("#to-fails", LONG_S)
        page.click("#to-missing", LONG_S)
        page.click("#diagnose", LONG_S)
        page.click(".effects .named [data-add]", LONG_S)
        wait_for(page, "s.rungs.length === 2 && s.compare")
        page.click("#reveal", LONG_S)
        wait_for(page, "s.truth")
        go(page, "out")
        page.click("#export", LONG_S)
        wait_for(page, "s.export")
        loop = time.monotonic() - begun
        state = state_of(page)
        if pictures is not None:
            take_pictures(page, pictures)
        script = page.js("fetch('/files/script.sh').then(r => r.text())")
    history = state["rungs"][-1]["report"]["history"]
    return {
        "first state [s]": first,
        "loop [s]": loop,
        "hidden": [effect["id"] for effect in state["truth"]["effects"]],
        "added": state["rungs"][-1]["name"],
        "held-out error": [history[0]["held_out"], history[-1]["held_out"]],
        "files that the script repeats": same_bytes(script, folder, state["files"]),
    }


def take_pictures(page: Page, pictures: Path) -> None:
    """Save every stage in both themes and three widths."""
    pictures.mkdir(parents=True, exist_ok=True)
    for dark in (False, True):
        for width in WIDTHS:
            page.size(width, 900, dark=dark)
            for stage in STAGES:
                go(page, stage)
                time.sleep(1.5)
                page.screenshot(pictures / f"{stage}-{width}-{'dark' if dark else 'light'}.png")


def same_bytes(script: str, folder: Path, names: list[str]) -> int:
    """Run the script in a new folder; returns the number of files, all equal."""
    with tempfile.TemporaryDirectory() as place:
        program, again = Path(place) / "ecm", Path(place) / "again"
        program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m ecm.cli "$@"\n')
        program.chmod(0o755)
        (folder / "script.sh").write_text(script, encoding="utf-8")
        path = f"{place}{os.pathsep}{os.environ['PATH']}"
        command = ["sh", str(folder / "script.sh"), str(again)]
        subprocess.run(command, check=True, capture_output=True, env={**os.environ, "PATH": path})
        written = [name for name in names if name not in ("script.sh", "steps.jsonl")]
        for name in written:
            assert (again / name).read_bytes() == (folder / name).read_bytes(), name
        return len(written)


def large_table(path: Path, rows: int) -> None:
    """Write rows of the neck in closed form, with a drift of the sensor."""
    poses, wrenches = neck_rows(rows)
    scatter = np.random.default_rng(1).standard_normal((rows, 6))
    scatter *= [0.3, 0.3, 0.3, 0.01, 0.01, 0.01]
    time_s = np.arange(float(rows))
    wrenches[:, 1] += 20.0 / rows * time_s
    columns = np.column_stack([poses, wrenches + scatter, time_s])
    header = ",".join([*POSE, *WRENCH, "time_s"])
    np.savetxt(path, columns, delimiter=",", header=header, comments="", fmt="%.8g")
    noise = "pose_position_sd_m = 4e-5\npose_rotation_sd_rad = 4e-4\nforce_sd_N = 0.3\n"
    noise += "torque_sd_Nm = 0.01\n"
    description = f"[mechanism]\nlength_m = 0.1034\n[instrument]\n{noise}"
    path.with_suffix(".toml").write_text(description, encoding="utf-8")


HOVER = """new Promise(async done => {
  const times = [], frame = () => new Promise(r => requestAnimationFrame(() => setTimeout(r)));
  for (const node of [...document.querySelectorAll('.effects li')].slice(0, 8)) {
    const begun = performance.now();
    node.dispatchEvent(new MouseEvent('mouseenter'));
    await frame();
    times.push(performance.now() - begun);
  }
  done(times);
})"""
BRUSH = """new Promise(async done => {
  const frame = () => new Promise(r => requestAnimationFrame(() => setTimeout(r)));
  const canvas = [...document.querySelectorAll('.panel canvas')].at(-1);
  canvas.setPointerCapture = () => {};
  const box = canvas.getBoundingClientRect(), times = [];
  const send = (type, x, y) => canvas.dispatchEvent(new PointerEvent(type, {bubbles: true,
    pointerId: 1, button: 0, buttons: 1, clientX: box.left + x * box.width,
    clientY: box.top + y * box.height}));
  send('pointerdown', 0.2, 0.2);
  for (let i = 1; i <= 8; i++) {
    const begun = performance.now();
    send('pointermove', 0.2 + 0.06 * i, 0.2 + 0.06 * i);
    await frame();
    times.push(performance.now() - begun);
  }
  const begun = performance.now();
  send('pointerup', 0.7, 0.7);
  await frame();
  times.push(performance.now() - begun);
  done(times);
})"""


def large(page: Page, place: Path, rows: int, clicks: int) -> dict[str, Any]:
    """Open a large table; times of a hover and of a brush, and memory after many clicks."""
    large_table(place / "large.csv", rows)
    with served(place / "large.csv", "--model", "linear", "--session", place / "large") as address:
        page.size(1400, 900)
        page.open(address)
        page.until("!!document.documentElement.dataset.stage", LONG_S)
        wait_for(page, "s.compare")
        go(page, "fails")
        page.until("document.querySelectorAll('.panel canvas').length > 5", LONG_S)
        brush = page.js(BRUSH)
        marked = page.js("document.querySelector('#marked-rows')?.textContent ?? ''")
        go(page, "missing")
        page.until("document.querySelectorAll('.effects li').length > 3", LONG_S)
        hover = page.js(HOVER)
        page.call("HeapProfiler.collectGarbage")
        before = page.call("Runtime.getHeapUsage")["usedSize"]
        for i in range(clicks):
            go(page, ("data", "fails", "missing", "out")[i % 4])
            time.sleep(0.1)
        go(page, "missing")
        page.call("HeapProfiler.collectGarbage")
        after = page.call("Runtime.getHeapUsage")["usedSize"]
    return {
        "rows": rows,
        "brush, median and longest [ms]": [statistics.median(brush), max(brush)],
        "marked": marked.split(":")[0],
        "hover, median and longest [ms]": [statistics.median(hover), max(hover)],
        f"memory before and after {clicks} clicks [MB]": [before / 1e6, after / 1e6],
    }


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=int, default=20_000)
    parser.add_argument("--clicks", type=int, default=300)
    parser.add_argument("--pictures", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name, open_chromium() as page:
        page.size(1400, 900)
        figures = demo(page, Path(name) / "demo", options.pictures)
        print(json.dumps(figures, indent=1), flush=True)
        if options.rows:
            print(json.dumps(large(page, Path(name), options.rows, options.clicks), indent=1))
        problems = page.problems()
    print(f"problems: {problems or 'none'}")
    sys.exit(bool(problems))


if __name__ == "__main__":
    main()
