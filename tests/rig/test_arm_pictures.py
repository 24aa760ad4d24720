"""The film, Fig. 7, and the command that writes them."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arm_pictures import Film, campaign_of, write_film, write_pictures
from ecm.errors import ComputationError, MissingExtra
from ecm.io.columns import POSE
from ecm.report.blocks import FigureBlock
from ecm.rig.arm.campaign import RobotCampaign, first_pose_trace
from ecm.rig.arm.simulation import mujoco
from ecm.rig.arm.trips import Stop
from ecm.workflow.report_identify import arm_section
from support.arm_rig import arm_setup, library, plan, settings
from support.neck import NECK_TOML, Command, csv_text, saved
from support.stand_in import REST, L, StandIn, some_poses

GOAL = REST + np.array([-0.003, 0.004, 0.0, 0.0, 0.0, 0.3])


def pictures(folder: Path, seed: int = 0, **rig: Any) -> RobotCampaign:
    made = plan(some_poses(7, seed=seed))
    return campaign_of(made, settings(**rig), source=StandIn(), folder=folder)


def need_drawing() -> None:
    try:
        Film(L, 0.033).close()
    except ComputationError as error:
        pytest.skip(str(error))


def test_a_film_shows_the_arm_and_what_it_bends(tmp_path: Path) -> None:
    need_drawing()
    image = pytest.importorskip("PIL.Image", reason="pillow is missing: see the extra robot")
    out = tmp_path / "film.gif"
    count = write_film(arm_setup(), [Stop(0, GOAL, (), 0.2, 0.2)], out, 0.033)
    frames = []
    with image.open(out) as moving:
        assert moving.n_frames == count > 5
        for i in (0, count // 2):
            moving.seek(i)
            frames.append(np.asarray(moving.convert("RGB"), dtype=float))
    assert frames[0].std() > 20.0  # something is drawn
    assert np.abs(frames[0] - frames[1]).mean() > 0.5  # and it moves


def test_show_writes_what_is_asked_for(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="matplotlib is missing: see the extra report")
    out = tmp_path / "fig7.png"
    (line,) = write_pictures(pictures(tmp_path / "cache"), None, out)
    assert str(out) in line
    assert out.read_bytes()[:4] == b"\x89PNG"


def test_a_pose_that_no_limit_lets_the_arm_reach_is_not_called_reached(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("matplotlib", reason="matplotlib is missing: see the extra report")
    monkeypatch.setattr("ecm.rig.arm.campaign._TRIED", 2)
    weak = pictures(tmp_path / "cache", force_limit_N=1.0)
    (line,) = write_pictures(weak, None, tmp_path / "fig7.png")
    assert "does not reach: while in phase impedance: force" in line
    arrays, phases, reason = first_pose_trace(weak)
    assert "limit 1 N" in reason
    assert "reading" not in [name for name, _, _ in phases]
    record: dict[str, Any] = {"reached": 0, "poses": 7, "reasons": []}
    step = {"records": {"d": record}, "phases_s": phases, "not_reached": reason}
    figures = {f"arm_{name}": values for name, values in arrays.items()}
    section = arm_section(step, figures)
    (figure,) = [block for block in section.blocks if isinstance(block, FigureBlock)]
    assert "not reached: while in phase impedance: force" in figure.caption
    arrays, phases, reason = first_pose_trace(pictures(tmp_path / "cache"))
    assert reason == ""
    step = {"records": {"d": record}, "phases_s": phases, "not_reached": reason}
    section = arm_section(step, figures)
    (figure,) = [block for block in section.blocks if isinstance(block, FigureBlock)]
    assert "the first pose that was reached" in figure.caption


def test_a_compiler_is_asked_for_where_no_controller_is_kept_and_before_any_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("matplotlib", reason="matplotlib is missing: see the extra report")
    library()  # skips where there is no compiler at all
    out = tmp_path / "fig7.png"
    write_pictures(pictures(tmp_path / "kept"), None, out)
    monkeypatch.setattr("ecm.rig.arm.mechanism.shutil.which", lambda _name: None)
    write_pictures(pictures(tmp_path / "kept"), None, out)
    with pytest.raises(ComputationError, match="no C compiler"):
        write_pictures(pictures(tmp_path / "bare"), None, out)
    assert not (tmp_path / "bare").exists()
    with pytest.raises(ComputationError, match="no C compiler"):  # another controller than the kept
        pictures(tmp_path / "kept", seed=5)


def test_a_missing_library_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(MissingExtra, match=r"\(extra robot\)"):
        mujoco()


def test_the_command_drives_the_arm_on_fem(tmp_path: Path, ecm_command: Command) -> None:
    poses = dict(zip(POSE, some_poses(6, seed=2).T, strict=True))
    saved(tmp_path / "plan.csv", csv_text(poses))
    saved(tmp_path / "plan.toml", NECK_TOML)
    (tmp_path / "rig.toml").write_text(
        '[rig]\nmode = "robot"\nspeed_m_s = 0.05\nspeed_rad_s = 0.4\nprocesses = 1\n'
    )
    out = tmp_path / "data.csv"
    done = ecm_command(
        "campaign", tmp_path / "plan.csv", "--rig", tmp_path / "rig.toml", "--out", out
    ).good()
    assert "6 of 6 poses reached" in done.out
    assert "after the impedance phase" in done.out
    found: dict[str, Any] = json.loads((tmp_path / "data.robot.json").read_text())
    assert found["phases"]["position"]["largest_m"] < 1e-6
    assert len(out.read_text().splitlines()) == 7
