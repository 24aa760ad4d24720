"""Times and memory of the page of `ecm app` in a headless Chromium, with a large table.

.venv/bin/python benches/app.py [--rows 20000] [--clicks 3000] [--many 200000] [--card]

It opens a table of many rows and prints how long the first paint, a hover, a brush and a cancel
take, and what the page holds in memory before and after many clicks (3,000: an hour with one in
1.2 s). A table of `--many` rows is opened last; it is thinned. The loop of the demo is gone through
by tests/workflow/test_app_page.py.
Goals: first paint 1 s, hover and brush 0.1 s, cancel 0.5 s. `docs/app_pictures.py` takes pictures.
"""

from __future__ import annotations

import argparse
import json
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import numpy as np

from ecm.io.columns import POSE, WRENCH
from support.chromium import Page, open_chromium
from support.neck import neck_rows

LONG_S = 120.0


@contextmanager
def served(*arguments: str | Path) -> Iterator[str]:
    """Serve a session; yields its address."""
    command = [sys.executable, "-m", "ecm", "app", "--no-open", *map(str, arguments)]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert server.stdout is not None
    try:
        yield server.stdout.readline().strip()
    finally:
        server.send_signal(signal.SIGTERM)
        server.communicate(timeout=60)


def wait_for(page: Page, condition: str) -> None:
    """Wait until nothing is computed and a condition of the state `s` holds."""
    answer = "fetch('/api/state').then(r => r.json())"
    page.until(f"{answer}.then(s => !s.running && ({condition}))", LONG_S)


def go(page: Page, stage: str) -> None:
    """Open a stage and wait until it is drawn."""
    page.js(f"location.hash = '{stage}'")
    page.until(f"document.documentElement.dataset.stage === '{stage}'", LONG_S)


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
  await frame();  // a page that nobody looked at draws its first one late
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
    pointerId: 1, isPrimary: true, button: 0, buttons: 1, clientX: box.left + x * box.width,
    clientY: box.top + y * box.height}));
  await frame();
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


TURN = """new Promise(async done => {
  const frame = () => new Promise(r => requestAnimationFrame(() => setTimeout(r)));
  const canvas = document.querySelector('.space canvas');
  canvas.setPointerCapture = () => {};
  const box = canvas.getBoundingClientRect(), times = [];
  const send = (type, x) => canvas.dispatchEvent(new PointerEvent(type, {bubbles: true,
    pointerId: 1, isPrimary: true, button: 0, buttons: 1, clientX: box.left + x,
    clientY: box.top + 0.5 * box.height}));
  await frame();
  send('pointerdown', 100);
  for (let i = 1; i <= 40; i++) {
    const begun = performance.now();
    send('pointermove', 100 + 12 * i);
    await frame();
    times.push(performance.now() - begun);
  }
  send('pointerup', 600);
  done([box.width, box.height, times]);
})"""


PAINT = """new Promise(done => {
  const look = () => {
    const paint = performance.getEntriesByName("first-contentful-paint")[0];
    const drawn = document.documentElement?.dataset.stage;
    if (paint && drawn) done([paint.startTime, performance.now()]);
    else setTimeout(look, 5);
  };
  look();
})"""
CLICK = """(async stages => {
  const at = items => items[Math.floor(next() * items.length)];
  const plain = "nav a[href], .views button, .help, [name=kind], summary, "
    + ".marked button:not(#leave-out)";
  const radios = "[name=kind-of-residual]";
  at([...document.querySelectorAll(`${plain}, ${radios}`)].filter(n => n.offsetParent)).click();
  const canvas = at([...document.querySelectorAll("#main canvas[tabindex]")]);
  const menu = document.querySelector("#variable");
  if (menu && next() < 0.2) {
    menu.selectedIndex = Math.floor(next() * menu.options.length);
    menu.dispatchEvent(new Event("change"));
  }
  if (canvas) {
    canvas.setPointerCapture = () => {};
    const box = canvas.getBoundingClientRect();
    const x = box.left + next() * box.width, y = box.top + next() * box.height;
    const send = (type, move) => canvas.dispatchEvent(new PointerEvent(type,
      {bubbles: true, pointerId: 1, isPrimary: true, clientX: x + move, clientY: y + move}));
    send("pointermove", 0); send("pointerdown", 0); send("pointermove", 30); send("pointerup", 30);
  }
  await new Promise(r => requestAnimationFrame(() => setTimeout(r)));
})()"""


def held(page: Page) -> dict[str, float]:
    """What the page holds after its garbage is gone: megabytes of heap, nodes and listeners."""
    for _ in range(2):
        page.call("HeapProfiler.collectGarbage")
    counts = page.call("Memory.getDOMCounters")
    heap = page.call("Runtime.getHeapUsage")["usedSize"]
    return {"MB": heap / 1e6, "nodes": counts["nodes"], "listeners": counts["jsEventListeners"]}


def cancelled(page: Page) -> float:
    """Begin a diagnosis, cancel it, and return the time until nothing is computed, in ms."""
    go(page, "missing")
    page.click("#diagnose", LONG_S)
    page.until("!document.querySelector('#running').hidden && !!document.querySelector('#cancel')")
    time.sleep(1.0)
    return float(page.js("""(async () => {
      const begun = performance.now();
      document.querySelector('#cancel').click();
      const running = async () => (await (await fetch('/api/state')).json()).running;
      while (await running()) await new Promise(r => setTimeout(r, 5));
      return performance.now() - begun;
    })()"""))  # fmt: skip


def turned(page: Page) -> list[float]:
    """Size of the picture in space in a wide window; the time of a frame while it is turned, and
    that of the page's script alone: without a graphics card Chromium draws by the processor."""
    page.size(2560, 1400)
    go(page, "fails")
    page.until("!!document.querySelector('.space canvas')", LONG_S)
    time.sleep(1.0)
    page.call("Performance.enable")

    def script_s() -> float:
        metrics = page.call("Performance.getMetrics")["metrics"]
        return float(next(one["value"] for one in metrics if one["name"] == "ScriptDuration"))

    before = script_s()
    width, height, times = page.js(TURN)
    script_ms = 1e3 * (script_s() - before) / len(times)
    page.size(1400, 900)
    return [width, height, statistics.median(times), max(times), script_ms]


def opened(page: Page, address: str) -> dict[str, Any]:
    """Open an address; when it was painted and when its stage was drawn."""
    page.size(1400, 900)
    page.open(address)
    paint, drawn = page.js(PAINT)
    return {"first paint [ms]": paint, "first stage [ms]": drawn}


def large(page: Page, place: Path, rows: int, clicks: int) -> dict[str, Any]:
    """Open a large table; times of paint, hover, brush and cancel, and memory after many clicks."""
    large_table(place / "large.csv", rows)
    with served(place / "large.csv", "--model", "linear", "--session", place / "large") as address:
        opened(page, address)
        wait_for(page, "s.compare")
        found = opened(page, address)
        go(page, "fails")
        page.until("document.querySelectorAll('.panel canvas').length > 5", LONG_S)
        brush = page.js(BRUSH)
        marked = page.js("document.querySelector('#marked-rows').textContent")
        go(page, "missing")
        page.until("document.querySelectorAll('.effects li').length > 3", LONG_S)
        hover = page.js(HOVER)
        turn = turned(page)
        stop = cancelled(page)
        page.js(
            "window.seed = 1; window.next = () => (seed = (seed * 16807) % 2147483647) / 2147483647"
        )
        before = {}
        for i in range(clicks):
            if i == min(100, clicks // 3):  # each view has been fetched, each figure drawn once
                go(page, "fails")
                before = held(page)
            page.js(CLICK)
        go(page, "fails")
        after = held(page)
    return {
        "rows": rows,
        **found,
        "brush, median and longest [ms]": [statistics.median(brush), max(brush)],
        "marked": marked.split(":")[0],
        "hover, median and longest [ms]": [statistics.median(hover), max(hover)],
        "turning in space at 2560 px, [px, px, median and longest ms, script ms]": turn,
        "cancel [ms]": stop,
        "clicks": clicks,
        "held after the first of them": before,
        "held after all": after,
    }


def many(page: Page, place: Path, rows: int) -> dict[str, Any]:
    """Open a table of very many rows, which is thinned."""
    large_table(place / "many.csv", rows)
    with served(place / "many.csv", "--model", "linear", "--session", place / "many") as address:
        opened(page, address)
        wait_for(page, "s.compare")
        found = opened(page, address)
        go(page, "fails")
        page.until("document.querySelectorAll('.panel canvas').length > 5", LONG_S)
        said = page.js(
            "document.querySelector('#main').textContent.match(/[0-9]+ of [0-9]+ rows are/)[0]"
        )
        brush = page.js(BRUSH)
    return {"rows": rows, **found, "said": said,
            "brush, median and longest [ms]": [statistics.median(brush), max(brush)]}  # fmt: skip


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=int, default=20_000, help="0: not measured")
    parser.add_argument("--clicks", type=int, default=3000)
    parser.add_argument("--card", action="store_true", help="imitate a graphics card")
    parser.add_argument("--many", type=int, default=200_000, help="0: not measured")
    options = parser.parse_args()
    problems: list[str] = []
    with tempfile.TemporaryDirectory() as name, open_chromium(card=options.card) as page:
        page.size(1400, 900)
        parts: list[Callable[[], dict[str, Any]]] = []
        if options.rows:
            parts.append(lambda: large(page, Path(name), options.rows, options.clicks))
        if options.many:
            parts.append(lambda: many(page, Path(name), options.many))
        for part in parts:
            print(json.dumps(part(), indent=1), flush=True)
            problems += page.problems()
    print(f"problems: {problems or 'none'}")
    sys.exit(bool(problems))


if __name__ == "__main__":
    main()
