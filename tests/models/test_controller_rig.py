"""The rig with hidden memory: one log is fitted, exported, and stepped through another motion."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

from ecm.effects.ageing import TemperatureModulus
from ecm.effects.friction import Hysteresis
from ecm.effects.relaxation import StressRelaxation
from ecm.models import fit_model
from ecm.models.joint_fit import joint_fit
from support.neck import ROOT
from support.programs import need_program

sys.path.insert(0, str(ROOT / "benches"))
from controller_rig import NOISE, Rig, over_noise, readings, stepped_in_c

FORMS = (
    StressRelaxation(0.8, "elastic", 20.0, frame="middle"),
    Hysteresis("middle", 3e-3),
    TemperatureModulus(22.0),
)


def test_a_motion_never_seen_is_stepped_in_c_to_the_noise(tmp_path: Path) -> None:
    """`benches/controller_rig.py`, shorter and with forms that are given."""
    need_program("gcc")
    rig = Rig()
    log, unseen = readings(rig, 100.0, 20.0, 0, fine=2), readings(rig, 60.0, 50.0, 1)
    static = fit_model(log, "energy6")
    joint = joint_fit(static.base, FORMS, log, NOISE)
    model = replace(static, base=joint.base, effects=joint.effects)
    errors = [
        over_noise(unseen.wrenches - found, unseen, static)[0]
        for found in (static.predict(unseen.poses), stepped_in_c(model, unseen, tmp_path))
    ]
    assert errors[0] > 4.0
    assert errors[1] < 1.15
