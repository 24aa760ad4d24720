"""The page of `ecm app` in a real browser: a person goes round the loop by clicks."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from ecm.io.columns import POSE, WRENCH
from support.chromium import Page, open_chromium
from support.neck import LENGTH_M, STIFFNESS, csv_text, neck_rows

pytestmark = pytest.mark.browser
HOSTILE = "<img src=x onerror=document.title=1><b>own</b>"


def drifting_table(path: Path) -> Path:
    """A linear mechanism, each pose twice, with a drift of the sensor; a hostile column."""
    poses = np.tile(neck_rows(40)[0], (2, 1))
    noise = [0.3, 0.3, 0.3, 0.01, 0.01, 0.01]
    wrenches = (poses - [LENGTH_M, 0, 0, 0, 0, 0]) @ STIFFNESS
    wrenches += np.random.default_rng(2).standard_normal((80, 6)) * noise
    time_s = 30.0 * np.arange(80.0)
    wrenches[:, 1] += 1e-3 * time_s
    columns = dict(zip((*POSE, *WRENCH), np.hstack([poses, wrenches]).T, strict=True))
    lines = csv_text({**columns, "time_s": time_s, "pose_id": np.arange(80.0) % 40}).splitlines()
    rows = [f"{HOSTILE if i == 0 else i % 7},{line}" for i, line in enumerate(lines)]
    path.write_text("\n".join([*rows, ""]), encoding="utf-8")
    return path


@contextmanager
def served(*arguments: str | Path) -> Iterator[str]:
    """`ecm app` of these arguments; yields its address."""
    server = subprocess.Popen(
        [sys.executable, "-m", "ecm.cli", "app", "--no-open", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert server.stdout is not None
    try:
        address = server.stdout.readline().strip()
        assert address.startswith("http://127.0.0.1:"), server.communicate()[1]
        yield address
    finally:
        server.send_signal(signal.SIGTERM)
        server.communicate(timeout=30)


@pytest.fixture(scope="module")
def page() -> Iterator[Page]:
    with open_chromium() as opened:
        yield opened


def test_the_loop_by_clicks_down_to_a_lower_rung(page: Page, tmp_path: Path) -> None:
    data = drifting_table(tmp_path / "stage.csv")
    with served(data, "--session", tmp_path / "session") as address:
        page.open(address)
        page.click(".warning button")  # a warning about the column of one's own
        page.click("#to-model")
        page.click("[name=kind][value=linear]")
        page.click("#fit")
        page.click("#to-fails")
        page.until("document.querySelectorAll('.panel canvas, .space canvas').length > 6")
        page.click("#to-missing")
        page.until("!!document.querySelector('[data-add=fts_drift]')")
        page.click("#diagnose")
        page.click(".effects .named [data-add=fts_drift]")
        page.until("document.documentElement.dataset.stage === 'add'")
        page.until("document.querySelectorAll('#main table tbody tr').length >= 3")
        rungs = _state(page)["rungs"]
        assert [rung["name"] for rung in rungs] == ["linear", "+ fts_drift"]
        history = rungs[-1]["report"]["history"]
        assert history[-1]["held_out"] < 0.9 * history[0]["held_out"]
        page.js("location.hash = 'out'")
        page.until("document.querySelector('#script').textContent.includes('--add fts_drift')")
        page.js("document.querySelector('.skip').click()")
        page.until("document.activeElement.id === 'main' && location.hash === '#out'")
        page.js("location.hash = 'data'")
        page.until(f"document.querySelector('#main').textContent.includes({json.dumps(HOSTILE)})")
        assert page.js("document.title") == "Data – ECM"
        assert page.js("document.querySelectorAll('#main img').length") == 0
    assert page.problems() == []


_DROP = """
const given = new DataTransfer();
const rows = [...Array(20).keys()].map(i => `${i * 1e-4},${i + 0.01 * (i % 3)}`);
const text = ["x_m,fx_N", ...rows, ""].join("\\n");
for (const name of ["length.toml", "a.csv", "b.csv"])
  given.items.add(new File([name.endsWith(".csv") ? text : "# nothing"], name));
const input = document.querySelector("#file");
input.files = given.files;
input.dispatchEvent(new Event("change"));
"""


def test_files_that_are_dropped_together_become_runs_with_their_description(
    page: Page, tmp_path: Path
) -> None:
    with served("--session", tmp_path / "session") as address:
        page.open(address)
        page.until("!!document.querySelector('#file')")
        page.js(f"(() => {{{_DROP}}})()")
        page.until(
            "fetch('/api/state').then(r => r.json()).then(s => !s.running"
            " && s.check && s.data.length === 2 && s.data[1].name === 'length.toml')"
        )
        state = _state(page)
        assert [item["name"] for item in state["data"]] == ["a.csv", "length.toml"]
        assert state["check"]["rows"] == 40


def _state(page: Page) -> dict:  # type: ignore[type-arg]
    text = page.js("fetch('/api/state').then(r => r.text())")
    return dict(json.loads(text))
