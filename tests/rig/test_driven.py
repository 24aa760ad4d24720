"""The rig with a driven mechanism: it follows it, perturbs it, and its regulators are not ideal."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import ecm
from ecm.errors import InputError
from ecm.io.arrays import B, F
from ecm.io.columns import POSE, POSE_OFFSETS
from ecm.io.table import Table
from ecm.rig import Campaign, CampaignOptions, Hidden, RigSettings, run_campaign
from ecm.rig.inject import whitener_of
from ecm.rig.physics import TRUE_EFFECTS
from ecm.rig.physics.material import Ageing
from ecm.rig.physics.supply import Slip
from ecm.rig.physics.true_effect import Conditions, RigScale, Supply
from ecm.rig.plant import residual
from support.driven import (
    PRESSURES,
    SMALL_RIG,
    DrivenArm,
    arm_model,
    arm_plan,
    small_rig,
    tendon_table,
)
from support.stand_in import StandIn, plan_of, some_poses

OF_CHAMBERS = sorted(
    name
    for name, kind in TRUE_EFFECTS.items()
    if issubclass(kind, Supply) and kind.acts_on == "pressure"
)


@pytest.fixture(scope="module")
def plan() -> Table:
    return arm_plan()


def campaign(plan: Table, hide: str = "", strength: float = 1.0, **plant: float) -> Campaign:
    """On the small rig, beside what an energy can take in."""
    return campaign_on(small_rig(**plant), plan, hide, strength)


def campaign_on(settings: RigSettings, plan: Table, hide: str, strength: float) -> Campaign:
    hidden = [Hidden(hide, strength)] if hide else []
    columns = arm_model().actuated.columns
    return Campaign(plan, settings, DrivenArm(), hide=hidden, seed=3, base_columns=columns)


def initial(of: Campaign) -> B:
    """Which visits come from the rest pose."""
    return np.array([visit.approach == "initial" for visit in of.visits])


def test_the_table_holds_the_pressures_and_the_poses_that_were_reached(plan: Table) -> None:
    table = campaign(plan).run()
    rows = table.measured()
    assert table.actuation_columns == PRESSURES
    assert not table.matrix(PRESSURES)[table.text("kind") != "pose"].any()
    left = arm_model().predict(rows.poses, rows.matrix(PRESSURES)) - rows.wrenches
    assert (left.std(axis=0) < 0.12 * rows.wrenches.std(axis=0)).all()
    measured = plan.select(np.flatnonzero(plan.text("action") == "measure"))
    assert np.abs(rows.poses[:, :3] - measured.poses[:, :3]).max() < 1e-3
    assert not set(POSE_OFFSETS) & set(table.columns)


@pytest.mark.parametrize("offset_Pa", [0.0, 1500.0])
def test_the_robot_follows_the_mechanism_until_the_wrench_vanishes(
    plan: Table, offset_Pa: float
) -> None:
    """Without an offset in the plan the wrench stays small, whatever acts in the chambers."""
    exact = plan.with_columns(dict.fromkeys(POSE_OFFSETS, np.zeros(len(plan))))
    settings = small_rig(regulator_offset_Pa=offset_Pa)
    still = replace(settings, rig=replace(settings.rig, pose_error_m=0.0, pose_error_rad=0.0))
    free = Campaign(exact, still, DrivenArm(), seed=3)
    rows = free.visits.at_poses & initial(free)
    table = free.run()
    read = table.select(
        np.flatnonzero((table.text("kind") == "pose") & (table["approach"] == "initial"))
    )
    assert np.abs(read.wrenches[:, :3]).max() < 0.12
    moved = np.abs(free.visits.reached - np.stack([v.pose[:6] for v in free.visits]))[rows]
    assert (moved[:, 0].mean() > 1.5e-5) == (offset_Pa > 0.0)


def test_a_pressure_that_is_not_the_one_set_acts_on_the_wrench(plan: Table) -> None:
    quiet = campaign(plan)
    rows = quiet.visits.at_poses
    asked = quiet.visits.inputs[rows]
    np.testing.assert_array_equal(quiet.plant.acting(quiet.visits)[rows], asked)
    acts: dict[str, F] = {}
    for setting, size in {
        "regulator_offset_Pa": 300.0,
        "regulator_gain": 0.03,
        "regulator_lag_s": 4.0,
        "regulator_step_Pa": 500.0,
        "chamber_leak_per_s": 2e-3,
    }.items():
        off = campaign(plan, **{setting: size})
        acts[setting] = off.plant.acting(off.visits)[rows]
        assert 0.0 < np.abs(acts[setting] - asked).max() < 1e4, setting
        left = residual(off.plant, off.visits) - residual(quiet.plant, quiet.visits)
        assert np.abs(left).max() > 1e-4, setting
    np.testing.assert_allclose(acts["regulator_offset_Pa"] - asked, 300.0, rtol=0.2)
    np.testing.assert_allclose(acts["regulator_gain"], 1.03 * asked, rtol=0.01)
    assert not (acts["regulator_step_Pa"] % 500.0).any()
    assert np.abs(acts["regulator_step_Pa"] - asked).max() <= 250.0
    assert (acts["chamber_leak_per_s"] <= asked).all()


def test_the_material_softens_and_the_push_of_the_pressures_stays(plan: Table) -> None:
    """The wrench of an aged body grows by that of its material, h - G a."""
    plain = campaign(plan)
    aged = plain.plant.put(Ageing(0.2))
    rows = plain.visits.at_poses
    size = 1.0 + 0.2 * np.log1p(plain.visits.time_s / 3600.0) / np.log(2.0)
    base, reached, inputs = arm_model().actuated, plain.visits.reached, plain.visits.inputs
    at = np.hstack([reached, inputs])
    push = (base.actuation_jacobian(at) @ inputs[:, :, None])[:, :, 0]
    more = (size - 1.0)[:, None] * (base.predict(at) - push)
    wrong = (size - 1.0)[:, None] * push
    found = residual(aged, plain.visits) - residual(plain.plant, plain.visits)
    assert np.abs(found - more[rows]).max() < 0.03 * np.abs(more[rows]).max()
    assert np.abs(wrong[rows]).max() > 0.1 * np.abs(more[rows]).max()


def test_lag_and_leak_follow_the_time_since_the_pressure_was_set(plan: Table) -> None:
    lag, leak = campaign(plan, regulator_lag_s=4.0), campaign(plan, chamber_leak_per_s=2e-3)
    rows = lag.visits.at_poses & initial(lag)
    since = lag.visits.time_s[rows] - lag.visits.numbers("set_s")[rows]
    dwell = lag.visits.numbers("dwell_s")[rows]
    # Beside the dwell: following, the way from there, and half a window.
    assert (since - dwell > 5.0).all()
    missing = np.abs(lag.plant.acting(lag.visits) - lag.visits.inputs)[rows].max(axis=1)
    assert missing[dwell > 20.0].max() < 0.1 * missing[dwell < 5.0].max()
    share = 1.0 - leak.plant.acting(leak.visits)[rows] / np.maximum(leak.visits.inputs[rows], 1.0)
    on = leak.visits.inputs[rows] > 1e3
    np.testing.assert_allclose(share[on].max(), 1.0 - (1.0 - 1e-3 * since.max()) ** 2, rtol=0.3)


def test_a_valve_with_play_depends_on_the_side(plan: Table) -> None:
    quiet, size = campaign(plan), 300.0
    less = quiet.plant.put(Slip(size)).acting(quiet.visits) - quiet.visits.inputs
    assert less.min() == pytest.approx(-size)
    beyond = quiet.visits.at_poses & ~initial(quiet)
    assert less[beyond].max() == pytest.approx(size)


def test_a_wall_gives_the_smooth_loop_of_masing() -> None:
    """Its way back is its way up turned about and twice as large, and a small loop closes."""
    size, reaches = 500.0, tuple(np.linspace(2e3, 9e3, 6).tolist())

    def first(pressure: F) -> F:
        shares = np.minimum(pressure[:, None] / reaches, 1.0)
        return size * shares.mean(axis=1)

    up, down = np.linspace(0.0, 1.2e4, 61), np.linspace(1.2e4, 0.0, 61)
    dip = np.concatenate([np.linspace(1.2e4, 9e3, 16), np.linspace(9e3, 1.2e4, 16)])
    asked = np.concatenate([up, dip, down])[:, None]
    before = np.vstack([asked[:1], asked[:-1]])
    ways = tuple(np.hstack([np.zeros((2, 6)), pair]) for pair in np.stack([before, asked], axis=1))
    at = Conditions(0.1, inputs=asked, actuators=PRESSURES[:1], ways=ways)
    held = (asked - Slip(size, reaches=reaches).acting(asked, at))[:, 0]
    np.testing.assert_allclose(held[:61], first(up), atol=1e-9)
    assert held[92] == pytest.approx(held[60])
    np.testing.assert_allclose(held[93:], size - 2.0 * first((1.2e4 - down) / 2.0), atol=1e-9)
    valve = (asked - Slip(size).acting(asked, at))[:, 0]
    slopes = [len(np.unique(np.diff(loop[:61]).round(6))) for loop in (valve, held)]
    assert slopes[0] <= 3
    assert slopes[1] >= 7


def test_hysteresis_is_drawn_of_valves_and_of_walls() -> None:
    scale = RigScale(0.1, 1e3, 25.0, 25.0, 1.0)
    drawn = [Slip.draw(np.random.default_rng(seed), scale) for seed in range(40)]
    walls = [one for one in drawn if one.reaches]
    assert 10 < len(walls) < 30
    assert all(0.1 < max(one.reaches) / scale.largest_input < 0.9 for one in walls)
    # A sealed wall is read back as it was.
    document = json.loads(json.dumps(walls[0].parameters()))
    assert Slip(1.0).with_parameters(document) == walls[0]


@pytest.mark.parametrize("effect", OF_CHAMBERS)
def test_the_wanted_strength_is_reached(effect: str, plan: Table) -> None:
    plain = campaign(plan)
    hidden = campaign(plan, effect, 2.0)
    # Calibrated before the robot follows what the effect moves; a second reading is beside it.
    left = residual(hidden.plant, plain.visits) - residual(plain.plant, plain.visits)
    assert whitener_of(plain).strength(left) == pytest.approx(2.0, rel=0.05)


def test_a_winch_that_stands_still_is_named_with_the_pose_at_which_it_was_set() -> None:
    """By the rig's law: the way from G of the solved poses, and stiffer the longer it is."""
    table = tendon_table()
    model = ecm.fit_model(table, "actuated4")
    plan = arm_plan(40, candidates=table, model=model)
    hidden = Campaign(
        plan,
        small_rig(),
        DrivenArm(ecm.fit_model(table, "actuated5").actuated),
        hide=[Hidden("tendon_stretch", 2.0)],
        seed=3,
        base_columns=model.actuated.columns,
    )
    more = np.abs(hidden.plant.acting(hidden.visits) - hidden.visits.inputs)
    at_poses = hidden.visits.at_poses
    # At home the robot is off by its own error only.
    assert more[~at_poses].max() < 0.02 * more[at_poses].max()
    measured = hidden.run()
    found = ecm.diagnose(ecm.fit_model(measured, "actuated4"), measured)
    assert "tendon_stretch" in found.answer[0], found.sentence()
    shape = next(item.effect.shape for item in found.effects if item.id == "tendon_stretch")
    assert shape == {"actuator": "tension_1_N", "set_at": "free", "from_before": True}


def streamed(plan: Table, hide: str = "") -> Campaign:
    """On the small rig with a raw stream; its robot goes where it is told."""
    rig = {"stream_Hz": 2.0, "pose_error_m": 0.0, "pose_error_rad": 0.0}
    return campaign_on(RigSettings.from_dict({**SMALL_RIG, "rig": rig}), plan, hide, 2.0)


@pytest.mark.parametrize("offsets", [True, False])
def test_the_raw_stream_knows_the_inputs_on_each_way(offsets: bool) -> None:
    """Set when the robot departs: those of the pose on the way there, none on the way home."""
    campaign = streamed(arm_plan(8, offsets=offsets))
    stream = campaign.raw_stream()
    assert stream is not None
    table = stream.table(campaign, [campaign.measure(i) for i in range(len(campaign))])
    asked = np.stack([leg.visit.pose[6:] * (not leg.home) for leg in stream.legs])
    inputs = table.matrix(PRESSURES)
    np.testing.assert_array_equal(inputs, asked[stream.leg])
    seen, _ = stream.truth(campaign.plant.physics)
    exact = arm_model().predict(seen, inputs)
    miss = np.abs(stream.elastic_wrench() - exact)
    assert (miss < 5e-3 * np.abs(exact).max(axis=0)).all()
    moves = np.abs(table.matrix([f"v_{name}" for name in POSE])).max(axis=1) > 0.0
    assert 0.2 < moves.mean() < 0.9
    if offsets:  # a followed leg begins where the mechanism is free
        first = [stream.legs[i].start for i in range(0, len(stream.legs), 2)]
        free = arm_model().predict(np.stack(first), asked[::2])
        sizes = np.repeat([0.1, 5e-3], 3)
        initial_legs = np.array([leg.visit.approach == "initial" for leg in stream.legs[::2]])
        assert (np.abs(free[initial_legs]) < sizes).all()


@pytest.mark.parametrize("effect", ["pressure_gain", "pressure_hysteresis", "pressure_cross_talk"])
def test_a_raw_stream_holds_what_acts_as_the_readings_do(effect: str, plan: Table) -> None:
    campaign = streamed(plan, effect)
    stream = campaign.raw_stream()
    assert stream is not None
    _, visits = stream._still
    there = [i for i, leg in enumerate(stream.legs) if not leg.home]
    last = [np.flatnonzero(stream.leg == i)[-1] for i in there]
    more = (campaign.plant.acting(visits) - visits.inputs)[last]
    read = (campaign.plant.acting(campaign.visits) - campaign.visits.inputs)[
        campaign.visits.at_poses
    ]
    assert np.abs(read).max() > 100.0
    np.testing.assert_allclose(more, read, atol=1e-6 * np.abs(read).max())
    left = stream.residual(campaign.plant.physics) - stream.residual(streamed(plan).plant.physics)
    assert np.abs(left).max() > 1e-3


def test_every_command_reads_the_inputs_of_a_raw_stream(tmp_path: Path) -> None:
    """As a table, and as a log that is imported."""
    campaign, out = streamed(arm_plan(20)), tmp_path / "arm.csv"
    options = CampaignOptions(source=DrivenArm())
    run_campaign(campaign.plan, campaign.settings, out, options=options, seed=3)
    raw = out.with_suffix(".raw.parquet")
    table, imported = ecm.read_table(raw), ecm.import_log(raw).table
    for one in (table, imported):
        assert one.actuation_columns == PRESSURES
    np.testing.assert_array_equal(imported.matrix(PRESSURES), table.matrix(PRESSURES))
    left = ecm.fit(table, "actuated3").predict(table) - table.wrenches
    assert (left.std(axis=0) < 0.15 * table.wrenches.std(axis=0)).all()


def test_refusals() -> None:
    with pytest.raises(InputError, match="it acts in an actuator, and this plan has no pressure"):
        Campaign(
            plan_of(some_poses(30)), RigSettings(), StandIn(), hide=[Hidden("chamber_leak", 1)]
        )

    class NoFree(DrivenArm):
        free_poses = None  # type: ignore[assignment]

    with pytest.raises(InputError, match=r"no free_poses\(inputs\)"):
        Campaign(arm_plan(4), small_rig(), NoFree())


def test_without_offsets_the_poses_of_the_plan_are_driven_to() -> None:
    plain = arm_plan(6, offsets=False)
    options = CampaignOptions(source=DrivenArm())
    table = run_campaign(plain, small_rig(), options=options, seed=1)
    rows = table.measured()
    ids = plain.column("pose_id")
    for pose, number in zip(rows.poses, rows.column("pose_id"), strict=True):
        expected = plain.matrix(POSE)[ids == number][0]
        assert np.abs(pose - expected)[:3].max() < 1e-3
