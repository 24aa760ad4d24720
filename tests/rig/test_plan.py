"""From a plan to a timeline: actions, approaches, unloaded readings, skipped poses."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest

from ecm.errors import InputError
from ecm.io.table import Table
from ecm.rig import Campaign, RigSettings
from ecm.rig.plan import Action, Visit
from support.stand_in import REST, StandIn, plan_of, some_poses


def visits_of(plan: Table, **rig: Any) -> list[Visit]:
    settings = RigSettings.from_dict({"rig": rig})
    return Campaign(plan, settings, StandIn()).timeline.visits


def test_actions_are_read() -> None:
    assert Action.parse("remount:90", "row 1") == Action("remount", 90.0)
    assert Action.parse("", "row 1") == Action("measure")


@pytest.mark.parametrize("text", ["remuont:90", "remount", "remount:x", "home:3", "warm_up:-1"])
def test_wrong_actions_are_refused(text: str) -> None:
    with pytest.raises(InputError, match="row 7"):
        Action.parse(text, "row 7")


def test_time_grows_and_travel_takes_time() -> None:
    visits = visits_of(plan_of(some_poses(30)))
    times = [v.time_s for v in visits]
    assert all(b > a for a, b in itertools.pairwise(times))
    poses = [v for v in visits if v.kind == "pose"]
    fast = list(visits_of(plan_of(some_poses(30)), speed_m_s=0.2, speed_rad_s=1.5))
    assert fast[-1].time_s < times[-1]
    # Cubic timing law: peak speed is 3/2 of the mean.
    for visit in poses:
        way = visit.pose - REST
        needed = 1.5 * max(np.linalg.norm(way[:3]) / 0.02, np.linalg.norm(way[3:]) / 0.15)
        assert visit.travel_s == pytest.approx(needed)


def test_unloaded_readings_stand_at_both_ends_and_in_between() -> None:
    kinds = [v.kind for v in visits_of(plan_of(some_poses(30)), offset_every=10)]
    assert [i for i, k in enumerate(kinds) if k == "offset"] == [0, 11, 22, 33]
    ends = [v.kind for v in visits_of(plan_of(some_poses(30)), offset_every=0)]
    assert [i for i, k in enumerate(ends) if k == "offset"] == [0, 31]


def test_approach_from_another_pose_goes_through_it() -> None:
    poses = some_poses(4)
    visits = visits_of(
        plan_of(poses, pose_id=[0, 1, 2, 3], approach=["initial", "2", "1", ""]),
        approach="previous",
    )
    taken = [v for v in visits if v.kind == "pose"]
    assert taken[0].way == pytest.approx(np.stack([REST, poses[0]]))
    assert taken[1].way == pytest.approx(np.stack([poses[0], REST, poses[2], poses[1]]))
    assert taken[2].way == pytest.approx(np.stack([poses[1], poses[2]]))
    assert taken[3].way == pytest.approx(np.stack([poses[2], poses[3]]))
    assert [v.approach for v in taken] == ["initial", "2", "1", "2"]


def test_an_unknown_approach_is_refused() -> None:
    with pytest.raises(InputError, match=r"row 2, column approach: `9`"):
        visits_of(plan_of(some_poses(2), pose_id=[0, 1], approach=["initial", "9"]))


def test_repeats_are_counted_and_share_the_pose() -> None:
    poses = some_poses(5)
    visits = visits_of(plan_of(np.concatenate([poses, poses[:2]])))
    taken = [v for v in visits if v.kind == "pose"]
    assert [v.pose_id for v in taken] == [0, 1, 2, 3, 4, 0, 1]
    assert [v.repeat for v in taken] == [0, 0, 0, 0, 0, 1, 1]


def test_actions_change_the_rig() -> None:
    poses = some_poses(8)
    actions = ["measure", "home", "unload", "remount:90", "measure", "remove_payload",
               "dead_weight:2", "measure"]  # fmt: skip
    campaign = Campaign(plan_of(poses, action=actions), RigSettings(), StandIn())
    visits = campaign.timeline.visits
    taken = [v for v in visits if v.kind == "pose"]
    assert [v.run for v in taken] == [0, 1, 4]
    assert [v.mount_rad for v in taken] == pytest.approx([0.0, np.pi / 2, np.pi / 2])
    assert [v.payload_on for v in taken] == [True, True, False]
    runs = campaign.timeline.runs
    assert runs[1] == {"mount_angle_rad": pytest.approx(np.pi / 2)}
    assert runs[2]["payload_mass_kg"] == 0.0
    assert runs[3] == {"payload_mass_kg": 2.0}
    assert runs[4]["mount_angle_rad"] == pytest.approx(np.pi / 2)
    kinds = [v.kind for v in visits if v.kind in ("home", "unloaded")]
    assert kinds == ["home", "unloaded", "unloaded"]
    hung = [v for v in visits if v.dead_weight_kg > 0.0]
    assert [v.run for v in hung] == [3]


def test_a_new_run_rests_the_mechanism() -> None:
    visits = visits_of(plan_of(some_poses(4), run=[0, 0, 5, 5]))
    taken = [v for v in visits if v.kind == "pose"]
    assert [v.run for v in taken] == [0, 0, 5, 5]
    rested = [i for i, v in enumerate(visits) if v.rested]
    assert len(rested) == 2
    assert visits[rested[1]].kind == "offset"


def test_warm_up_heats_the_mechanism() -> None:
    poses = some_poses(3)
    plan = plan_of(poses, action=["measure", "warm_up:20", "measure"])
    campaign = Campaign(plan, RigSettings(), StandIn())
    begin, end = campaign.timeline.heating[0]
    assert end - begin == pytest.approx(1200.0)
    taken = [i for i, v in enumerate(campaign.visits) if v.kind == "pose"]
    cold, warm = campaign.visits.temperature_degC[taken]
    assert warm > cold + 5.0


def test_poses_out_of_reach_are_skipped_with_the_reason() -> None:
    poses = some_poses(6)
    poses[1, 4] = 2.0
    poses[2, 1] = 0.09
    poses[3, 0] -= 0.02
    plan = plan_of(poses, pose_id=range(6), approach=["initial"] * 4 + ["1", "initial"])
    campaign = Campaign(plan, RigSettings(), StandIn())
    reasons = {s.row: s.reason for s in campaign.skipped}
    assert set(reasons) == {1, 2, 3, 4}
    assert "rotation_limit_rad" in reasons[1]
    assert "stretch_limit" in reasons[2]
    assert "fts_range" in reasons[3]
    assert "approached from pose 1" in reasons[4]
    assert [v.pose_id for v in campaign.timeline.visits if v.kind == "pose"] == [0, 5]
    table = campaign.run()
    assert len(table.warnings) == 4
    assert "row 2, pose 1" in table.warnings[0]


def test_a_plan_that_cannot_be_run_is_refused() -> None:
    poses = some_poses(2)
    poses[:, 4] = 2.5
    with pytest.raises(InputError, match="no pose of the plan"):
        Campaign(plan_of(poses), RigSettings(), StandIn())
