"""A rig with the arm on the closed-form mechanism, small enough for tests."""

from __future__ import annotations

import atexit
import shutil
import tempfile
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import pytest

from ecm.io.arrays import F
from ecm.io.table import Table
from ecm.rig import CampaignOptions, RigSettings, run_campaign
from support.stand_in import L, StandIn, plan_of, some_poses, wrench

pytest.importorskip("mujoco", reason="mujoco is missing: pip install 'ecm-stiffness[robot]'")

from ecm.rig.arm.mechanism import compile_model, controller_document, fit_surrogate
from ecm.rig.arm.procedure import ArmSetup, SimulatedArm
from support.programs import need_program

FAST: dict[str, Any] = {"mode": "robot", "speed_rad_s": 0.6, "speed_m_s": 0.08, "dwell_s": 0.1}
"""The quick arm of the tests."""


def settings(**rig: Any) -> RigSettings:
    """A quick arm, with changes."""
    return RigSettings.from_dict({"rig": {**FAST, **rig}})


@lru_cache(maxsize=1)
def library() -> Path:
    """The controller's model, compiled once: it errs by a few per cent, as a fitted one does."""
    need_program("cc", "gcc")
    poses = some_poses(80, seed=9)
    model = controller_document("", poses, 0.97 * wrench(poses), L)
    folder = Path(tempfile.mkdtemp(prefix="ecm-controller-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return compile_model(model, folder)


@lru_cache(maxsize=1)
def mechanism() -> Any:
    """The energy surrogate of the closed form."""
    poses = some_poses(120, seed=8)
    return fit_surrogate(poses, wrench(poses), L)


def arm_setup(**rig: Any) -> ArmSetup:
    """What an arm is built from."""
    return ArmSetup(settings(**rig), mechanism(), library())


def simulated_arm(**rig: Any) -> SimulatedArm:
    """A simulated arm."""
    return SimulatedArm(arm_setup(**rig))


def plan(poses: F, **columns: Any) -> Table:
    """A plan whose meta names the length."""
    table = plan_of(poses, **columns)
    return table.with_meta(replace(table.meta, mechanism={"length_m": L}))


def run(cache: Path, poses: F, out: Path | None = None, **more: Any) -> Table:
    """Run a small campaign of the arm."""
    rig = more.pop("rig", {})
    columns = more.pop("columns", {})
    rig = {"processes": 1, **rig}
    return run_campaign(
        plan(poses, **columns),
        settings(**rig),
        out,
        options=CampaignOptions(source=StandIn(), folder=cache),
        **more,
    )
