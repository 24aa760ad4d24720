"""The loop through the loop, in small: the head misses, an effect is named, the head hits."""

from __future__ import annotations

from pathlib import Path

import pytest

from ecm.errors import InputError
from ecm.io.mechanism import Mechanism
from ecm.workflow.head.loop import hidden_effect, run_loop
from ecm.workflow.head.motions import Motions
from ecm.workflow.head.neck_wrench import Temperature
from ecm.workflow.head.settings import HeadSettings
from ecm.workflow.head.table import Bench
from support.head import closed_neck, statics
from support.neck import LENGTH_M

pytest.importorskip("mujoco")


def test_the_head_misses_in_a_warm_room_and_hits_with_the_effect_that_is_named(
    tmp_path: Path,
) -> None:
    neck = closed_neck(Temperature(-0.012))
    settings = HeadSettings(plant_step_s=1e-3)
    motion = Motions(statics(neck), settings, LENGTH_M).warming(times=2)
    body = Mechanism(builtin="", length_m=LENGTH_M)  # its physics would not be that of this neck
    bench = Bench(neck, settings, body, tmp_path)
    loop = run_loop(
        bench, model="energy4-revolution", poses=24, motion=motion,
        effects=("temperature_modulus", "stress_relaxation", "hysteresis", "fts_drift"),
    )  # fmt: skip
    assert loop.named == ("temperature_modulus",)
    missed, hit = loop.missed.figures(), loop.hit.figures()
    assert missed.settled_mm > 3.0 * hit.settled_mm
    assert missed.settled_deg > 3.0 * hit.settled_deg
    assert any("temperature_modulus" in line for line in loop.lines())


def test_an_effect_that_the_neck_cannot_hide_is_refused() -> None:
    with pytest.raises(InputError, match="choose one of them"):
        hidden_effect("payload")
