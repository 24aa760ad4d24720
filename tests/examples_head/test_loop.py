"""The loop through the loop, in small: the head misses, an effect is named, the head hits."""

from __future__ import annotations

import json
import re
import runpy
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ecm import Mechanism, fit
from experiment import Record
from loop import HeadLoop, run_loop
from motions import Motions
from neck import Temperature
from robot import HeadSettings
from support.full_table import full_table
from support.head_example import closed_neck
from support.neck import LENGTH_M, ROOT


def test_the_head_misses_in_a_warm_room_and_hits_with_the_effect_that_is_named(
    tmp_path: Path,
) -> None:
    body = Mechanism(builtin="", length_m=LENGTH_M)  # the paper's physics is not this neck's
    neck = replace(closed_neck(Temperature(-0.012)), mechanism=body)
    settings = HeadSettings(plant_step_s=1e-3)
    loop = run_loop(
        neck, tmp_path, settings, model="energy4-revolution", poses=24,
        motion=Motions(neck, settings).warming(times=2),
    )  # fmt: skip
    assert loop.named == ("temperature_modulus",)
    missed, hit = loop.missed.figures(), loop.hit.figures()
    assert missed["settled_mm"] > 3.0 * hit["settled_mm"]
    assert missed["settled_deg"] > 3.0 * hit["settled_deg"]
    assert any("temperature_modulus" in line for line in loop.lines())


COMMAND = str(ROOT / "examples" / "head")


def test_the_command_writes_what_it_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """With a loop that is done already: the true one takes half a minute."""
    model = fit(full_table(), "linear")
    still = Record("still", *np.zeros((2, 1, 6)), np.full((1, 4), 9.0), np.zeros(1), ((0, 1),))
    done = HeadLoop(full_table(), model, model, ("hysteresis",), still, still)
    monkeypatch.setattr("neck.fem_neck", lambda file, effects: closed_neck(*effects))
    monkeypatch.setattr("loop.run_loop", lambda neck, folder, **given: done)
    monkeypatch.setattr(sys, "argv", ["head", "--out", str(tmp_path), "--hide", "hysteresis"])
    runpy.run_path(COMMAND, run_name="__main__")
    assert capsys.readouterr().out.splitlines()[-3:] == [
        "after: poly:1 settles 0.00 mm and 0.00 degrees off",
        f"{tmp_path}: campaign.csv, before.json, after.json, head.json",
        f"next: ecm compare {tmp_path}/after.json {tmp_path}/campaign.csv",
    ]
    figures = json.loads((tmp_path / "head.json").read_text(encoding="utf-8"))
    assert figures["hidden"] == "hysteresis"
    assert figures["after"]["settled_mm"] == 0.0
    assert {"campaign.csv", "before.json", "after.json"} <= {f.name for f in tmp_path.iterdir()}


def test_wrong_options_are_refused_before_any_work(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["head", "--out", "x", "--hide", "payload"])
    with pytest.raises(SystemExit, match="2"):
        runpy.run_path(COMMAND, run_name="__main__")
    assert "choose from 'temperature_modulus', 'stress_relaxation'" in capsys.readouterr().err


def test_the_package_does_not_know_the_example() -> None:
    own = {path.stem for path in (ROOT / "examples" / "head").glob("*.py")} - {"__main__"}
    for path in (ROOT / "python" / "ecm").rglob("*.py"):
        imported = re.findall(r"^\s*(?:from|import) (\w+)", path.read_text("utf-8"), re.MULTILINE)
        assert not own & set(imported), path
