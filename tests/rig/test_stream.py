"""The raw stream: exact at both ends of a leg, noise as declared, and what only motion shows."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ecm.diagnosis import Diagnosis, diagnose
from ecm.errors import ComputationError, InputError
from ecm.io.se3 import rotation, turn_wrench
from ecm.io.table import Table, read_table
from ecm.rig import Campaign, CampaignOptions, Hidden, RigSettings, run_campaign
from ecm.rig.elastic import Smooth, SolvedPoses
from ecm.rig.inject import Whitener
from ecm.rig.physics import TRUE_EFFECTS
from ecm.rig.physics.camera import TimeSkew
from ecm.rig.raw_stream import RawStream
from support.campaigns import model, workspace_poses
from support.stand_in import (
    AT_REST,
    NOISELESS,
    REST,
    F,
    StandIn,
    Stop,
    plan_of,
    some_poses,
    stop_at,
    wrench,
)

pytest.importorskip("pyarrow", reason="pyarrow is missing: pip install 'ecm-stiffness[data]'")

STREAM = RigSettings.from_dict({"rig": {"stream_Hz": 2.0}})


def stream_of(campaign: Campaign) -> RawStream:
    stream = campaign.raw_stream()
    assert stream is not None
    return stream


def measured(folder: Path, hide: str) -> Path:
    out = folder / f"{hide.replace('=', '-')}.csv"
    options = CampaignOptions(source=StandIn(), folder=folder)
    plan = plan_of(workspace_poses(40, 3))
    run_campaign(plan, STREAM, out, hide=hide, seed=3, options=options)
    return out


def diagnosed(path: Path) -> Diagnosis:
    return diagnose(model(), read_table(path))


def test_a_leg_begins_and_ends_at_the_solved_poses_and_follows_the_map_between() -> None:
    campaign = Campaign(plan_of(some_poses(30)), STREAM, StandIn())
    stream = stream_of(campaign)
    assert stream.elastic_wrench() == pytest.approx(
        wrench(stream.truth(campaign.plant.physics)[0]), abs=1e-3
    )
    assert len(stream.legs) == 60  # there and home
    rows = [np.flatnonzero(stream.leg == 2 * i) for i in range(30)]
    rest, moving = [r[-1] for r in rows], [r[0] for r in rows]
    visits = [i for i, v in enumerate(campaign.visits) if v.kind == "pose"]
    nearest, reached = campaign.visits.nearest[visits], campaign.visits.reached[visits]
    at_rest = campaign.plant.elastic.wrench(nearest, reached)
    assert stream.elastic_wrench()[rest] == pytest.approx(at_rest, abs=1e-9)
    speed = np.abs(stream.velocities())
    assert speed[rest].max() == 0.0
    assert speed[moving].max() > 0.0
    # The velocities are those of the poses.
    poses = stream.truth(campaign.plant.physics)[0]
    for r in rows[:3]:
        middle = 0.5 * (stream.velocities()[r[1:]] + stream.velocities()[r[:-1]])
        assert np.diff(poses[r], axis=0) * 2.0 == pytest.approx(middle, abs=0.3 * speed[r].max())
    assert np.all(np.diff(stream.time_s) > 0.0)


class Line:
    """A smooth map that knows no more than a mean slope: newtons wrong at larger poses."""

    def predict(self, poses: F) -> F:
        return (poses - REST) @ SLOPE

    def stiffness(self, poses: F) -> F:
        return np.tile(SLOPE.T, (len(poses), 1, 1))


class Rough(StandIn):
    def surrogate(self, solved: SolvedPoses) -> Smooth | None:
        return Line()


SLOPE: F = np.linalg.lstsq(some_poses(200) - REST, wrench(some_poses(200)), rcond=None)[0]


def test_on_the_way_it_is_the_solver_that_counts_and_not_the_smooth_map() -> None:
    campaign = Campaign(plan_of(some_poses(30)), STREAM, Rough())
    stream = stream_of(campaign)
    poses = stream.truth(campaign.plant.physics)[0]
    line = np.abs(Line().predict(poses) - wrench(poses)).max(axis=0)
    miss = np.abs(stream.elastic_wrench() - wrench(poses)).max(axis=0)
    assert line[:3].max() > 5.0
    assert miss[:3].max() < 0.3  # newtons, of a row's noise of 1.1
    assert miss[3:].max() < 0.025  # of 0.036


def test_only_the_declared_noise_is_in_it(tmp_path: Path) -> None:
    raw = read_table(measured(tmp_path, "none").with_suffix(".raw.parquet"))
    assert raw.meta.file.kind == "continuous"
    figures = raw.meta.instrument
    assert figures.force_sd_N == pytest.approx(3.0 / np.sqrt(8.0), rel=0.01)
    assert figures.pose_position_sd_m == pytest.approx(np.hypot(37e-6, 20e-6), rel=0.01)
    found = diagnose(model(), raw)
    assert found.verdict == "none"


@pytest.mark.parametrize("strength", [0.5, 2.0])
def test_a_skew_is_as_strong_as_wanted_and_named_with_its_delay(
    tmp_path: Path, strength: float
) -> None:
    plan = plan_of(workspace_poses(40, 3))
    campaign = Campaign(plan, STREAM, StandIn(), hide=[Hidden("time_skew", strength)], seed=3)
    nominal = Campaign(plan, STREAM, StandIn(), seed=3)
    stream = stream_of(campaign)
    left = stream.residual(campaign.plant.physics) - stream_of(nominal).residual(
        nominal.plant.physics
    )
    whitener = Whitener(stream.covariance(), stream.elastic_wrench()[:, :, None])
    assert whitener.strength(left) == pytest.approx(strength, rel=1e-4)

    out = measured(tmp_path, f"time_skew={strength}")
    found = diagnosed(out.with_suffix(".raw.parquet"))
    assert found.answer == (("time_skew",),)
    truth = campaign.plant.physics.get(TimeSkew)
    assert truth is not None
    mean = truth.size * (1.0 + 0.5 * truth.creep)
    assert found.effects[0].values[0] == pytest.approx(mean, rel=0.1)

    # The readings at rest hold nothing of it, and say what would.
    at_rest = diagnosed(out)
    assert at_rest.verdict == "none"
    reasons = {n.id: n for n in at_rest.not_testable}
    assert reasons["time_skew"].reason == "no raw stream"
    assert "NAME.raw.parquet" in reasons["time_skew"].record


def test_what_is_hidden_at_rest_is_in_the_stream_too(tmp_path: Path) -> None:
    found = diagnosed(measured(tmp_path, "payload=2").with_suffix(".raw.parquet"))
    assert len(found.answer) == 1
    assert "payload" in found.answer[0]  # beside a cable, perhaps
    assert "time_skew" not in found.answer[0]


OTHERWISE = {
    # effect: share of it by which the stream may differ from the readings at rest, and why.
    "fts_hysteresis": 0.3,  # at rest it follows commanded poses, in the stream those reached
    "permanent_set": 0.5,  # a reading comes before its own rest has added, the stream is in it
    "stress_relaxation": 0.6,  # at rest each way begins relaxed, the stream carries what was before
}


@pytest.mark.parametrize("effect", AT_REST)
def test_every_truth_of_the_plant_acts_in_motion_too(effect: str) -> None:
    """Where a leg ends, at a pose and at home, the stream holds what a reading at rest does."""
    settings = RigSettings.from_dict({"rig": {"stream_Hz": 10.0}})
    plan = plan_of(
        np.repeat(some_poses(24), 2, axis=0), pose_id=np.arange(48), action=["measure", "home"] * 24
    )
    both = []
    for hide in ([Hidden(effect, 1.0)], []):
        campaign = Campaign(plan, settings, StandIn(), hide=hide, seed=1)
        stream = stream_of(campaign)
        at_rest = campaign.plant.truth(campaign.visits)
        seen, sensor = stream.truth(campaign.plant.physics)
        both.append(((seen, at_rest.pose_seen), (sensor, at_rest.sensor)))
    last = np.flatnonzero(np.diff(stream.leg, append=-1))
    visits = campaign.visits
    ends = [
        (last[k::2], [i for i, v in enumerate(visits) if v.kind == kind])
        for k, kind in enumerate(("pose", "home"))
    ]
    acts = False
    for (stream_with, rest_with), (stream_plain, rest_plain) in zip(*both, strict=True):
        moving, still = stream_with - stream_plain, rest_with - rest_plain
        size = np.max([np.abs(still[rows]).max(axis=0) for _, rows in ends], axis=0)
        acts = acts or bool(size.max() > 1e-6)
        for samples, rows in ends:
            off = np.abs(moving[samples] - still[rows]).max(axis=0)
            assert np.all(off <= OTHERWISE.get(effect, 0.2) * size + 1e-9)
    assert acts


def test_what_relaxes_goes_on_through_rest_and_way_home() -> None:
    settings = RigSettings.from_dict({"rig": {"stream_Hz": 20.0, "dwell_s": 1.0}})
    plan, relaxation = plan_of(some_poses(24)), [Hidden("stress_relaxation", 1.0)]
    parts = []
    for hide in (relaxation, []):
        campaign = Campaign(plan, settings, StandIn(), hide=hide, seed=1)
        seen, sensor = stream_of(campaign).truth(campaign.plant.physics)
        parts.append(turn_wrench(rotation(seen[:, 3:]), campaign.plant.to_top(sensor))[:, :3])
    stream, part = stream_of(campaign), parts[0] - parts[1]
    ends = np.flatnonzero(np.diff(stream.leg, append=-1))
    at_home = []
    for arrived, home in zip(ends[::2], ends[1::2], strict=True):
        held = float(np.linalg.norm(part[arrived]))
        along = part @ part[arrived] / held
        # Over the departure it only decays; a fresh ramp would be loaded at once.
        assert 0.9 * held < along[arrived + 1] < held
        at_home.append(along[home] / held)
        steps = np.linalg.norm(np.diff(part[arrived : home + 1], axis=0), axis=1)
        assert steps.max() < 0.1 * held
    # Unloaded on the way home it turns over, the slow chains of earlier poses notwithstanding.
    assert at_home[0] < -0.1
    assert np.mean(at_home) < -0.1


def test_each_piece_of_the_way_is_passed_once() -> None:
    poses = some_poses(24)
    approach = ["initial", "0", "1", "initial"] * 6
    for settings in (STREAM, RigSettings.from_dict({"rig": {"stream_Hz": 0.2}})):
        campaign = Campaign(plan_of(poses, approach=approach), settings, StandIn(), seed=1)
        stream = stream_of(campaign)
        _, samples = stream._still
        for before, visit in pairwise(samples):
            assert np.array_equal(visit.way[0], before.pose)
        lengths = [
            sum(float(np.abs(np.diff(v.way[:, 3:], axis=0)).sum()) for v in visits)
            for visits in (samples, campaign.visits)
        ]
        assert lengths[0] <= 1.001 * lengths[1]
        if settings is STREAM:  # a sample in 5 s misses much of a way of 3 s
            assert lengths[0] == pytest.approx(lengths[1], rel=0.02)


def test_a_sample_lies_within_its_leg_or_there_is_none() -> None:
    settings = RigSettings.from_dict({"rig": {"stream_Hz": 0.25, "dwell_s": 0.0}})
    campaign = Campaign(plan_of(some_poses(24)), settings, StandIn(), seed=1)
    stream = stream_of(campaign)
    legs = [stream.legs[i] for i in stream.leg]
    since = stream.time_s - np.asarray([leg.departs_s for leg in legs])
    assert np.all(since > 0.0)
    assert np.all(since < np.asarray([leg.visit.travel_s for leg in legs]))
    assert set(stream.leg.tolist()) < set(range(len(stream.legs)))
    for effect in ("hysteresis", "fts_hysteresis", "stress_relaxation"):
        hidden = Campaign(plan_of(some_poses(24)), settings, StandIn(), hide=Hidden.parse(effect))
        assert np.all(np.isfinite(stream_of(hidden).truth(hidden.plant.physics)[1]))
    short = {"rig": {"stream_Hz": 0.1, "dwell_s": 0.0, "speed_m_s": 1.0, "speed_rad_s": 10.0}}
    fast = Campaign(plan_of(some_poses(24)), RigSettings.from_dict(short), StandIn())
    with pytest.raises(InputError, match=r"stream_Hz = 0\.1: no way of this plan"):
        fast.raw_stream()


def test_without_a_stream_a_skew_cannot_be_hidden() -> None:
    plan = plan_of(some_poses(30))
    with pytest.raises(InputError, match=r"time_skew=1.*\[rig\] stream_Hz"):
        Campaign(plan, RigSettings(), StandIn(), hide=Hidden.parse("time_skew"))


def test_a_skew_that_is_absurd_is_refused_with_what_would_show_it() -> None:
    slow = RigSettings.from_dict(
        {"rig": {"stream_Hz": 1.0, "speed_m_s": 2e-3, "speed_rad_s": 1.5e-2}}
    )
    with pytest.raises(InputError, match=r"time_skew=3.*estimate.*\[rig\] stream_Hz") as caught:
        Campaign(plan_of(some_poses(24)), slow, StandIn(), hide=Hidden.parse("time_skew=3"))
    assert "ecm design" not in str(caught.value)


def test_random_draws_a_skew_only_where_there_is_a_stream(monkeypatch: pytest.MonkeyPatch) -> None:
    few = {name: TRUE_EFFECTS[name] for name in ("payload", "time_skew")}
    monkeypatch.setattr("ecm.rig.truth.TRUE_EFFECTS", few)
    drawn: dict[bool, set[str]] = {True: set(), False: set()}
    for streamed in (True, False):
        settings = STREAM if streamed else RigSettings()
        for seed in range(8):
            hide = Hidden.parse("random=1")
            campaign = Campaign(plan_of(some_poses(30)), settings, StandIn(), hide=hide, seed=seed)
            drawn[streamed].add(campaign.injected[0].truth.effect)
    assert drawn == {True: {"payload", "time_skew"}, False: {"payload"}}


def test_a_campaign_that_was_cut_ends_with_the_same_stream(tmp_path: Path) -> None:
    plan = plan_of(some_poses(25))
    options = CampaignOptions(source=StandIn(), folder=tmp_path / "cache")
    kept: dict[str, Any] = {"options": options, "seed": 4}

    whole, cut = tmp_path / "a" / "data.csv", tmp_path / "b" / "data.csv"
    run_campaign(plan, STREAM, whole, hide="time_skew=1", **kept)
    with pytest.raises(Stop):
        run_campaign(plan, STREAM, cut, hide="time_skew=1", progress=stop_at(11), **kept)
    run_campaign(plan, STREAM, cut, hide="time_skew=1", **kept)
    files = [{f.name: f.read_bytes() for f in out.parent.iterdir()} for out in (whole, cut)]
    assert files[0] == files[1]
    beside = {"data.raw.parquet", "data.raw.toml", "data.truth.json"}
    assert set(files[0]) == {"data.csv", "data.toml", *beside}
    # A stream alone is not overwritten either, and goes with the table it belongs to.
    whole.unlink()
    whole.with_suffix(".truth.json").unlink()
    with pytest.raises(InputError, match=r"data\.raw\.parquet: a table stands there"):
        run_campaign(plan, RigSettings(), whole, **kept)
    run_campaign(plan, RigSettings(), whole, overwrite=True, **kept)
    assert {f.name for f in whole.parent.iterdir()} == {"data.csv", "data.toml"}


def test_where_no_stream_can_be_kept_it_is_said_before_the_work(tmp_path: Path) -> None:
    plan, source = plan_of(some_poses(25)), StandIn()
    arm = RigSettings.from_dict({"rig": {"mode": "robot", "stream_Hz": 2.0}})
    with pytest.raises(InputError, match="only the quasi-static rig"):
        run_campaign(plan, arm, tmp_path / "data.csv", options=CampaignOptions(source=source))
    assert source.solved == 0
    measured: list[int] = []
    with pytest.raises(InputError, match=r"stream_Hz.*Plan 20 or more"):
        run_campaign(
            plan, STREAM, tmp_path / "data.csv",
            options=CampaignOptions(
                source=StandIn(curvature=False), folder=tmp_path / "cache"
            ),
            progress=lambda done, n, word: measured.append(done) if word == "measuring" else None,
        )  # fmt: skip
    assert measured == []
    assert not list(tmp_path.glob("data*"))


def test_the_wrench_is_turned_by_the_pose_of_its_own_row() -> None:
    """The pose at t and the wrench at t + delay: exactly what stands in a row."""
    settings = RigSettings.from_dict(
        {"rig": {"stream_Hz": 2.0}, "instrument": NOISELESS, "plant": {"drift_N": 0.0}}
    )
    campaign = Campaign(plan_of(some_poses(25)), settings, StandIn())
    skew = TimeSkew(0.3)
    campaign.plant = campaign.plant.put(skew)
    stream = stream_of(campaign)
    seen, sensor = stream.truth(campaign.plant.physics)
    top = campaign.plant.to_top(sensor - campaign.plant.offset)
    later, _ = stream._on_the_way(skew.read_s(stream.time_s))
    own, other = (turn_wrench(rotation(poses[:, 3:]), top) for poses in (seen, later))
    table = table_of(campaign)
    assert table.poses == pytest.approx(seen, abs=1e-12)
    assert table.wrenches == pytest.approx(own, abs=1e-9)
    assert np.abs(table.wrenches - other)[:, :3].max() > 0.3


def table_of(campaign: Campaign) -> Table:
    return stream_of(campaign).table(campaign, [campaign.measure(i) for i in range(len(campaign))])


def test_the_same_seed_gives_the_same_stream() -> None:
    plan = plan_of(some_poses(25))
    campaign = Campaign(plan, STREAM, StandIn(), seed=5)
    first, again = table_of(campaign), table_of(Campaign(plan, STREAM, StandIn(), seed=5))
    assert np.array_equal(table_of(campaign).wrenches, first.wrenches)
    other = table_of(Campaign(plan, STREAM, StandIn(), seed=6))
    assert np.array_equal(first.wrenches, again.wrenches)
    assert not np.allclose(first.wrenches, other.wrenches)


def test_a_pose_that_is_left_out_changes_no_other_noise() -> None:
    poses, ids = some_poses(25), np.arange(25)
    noise = []
    for kept in (ids, np.delete(ids, 4)):
        campaign = Campaign(plan_of(poses[kept], pose_id=kept), STREAM, StandIn(), seed=5)
        stream, table = stream_of(campaign), table_of(campaign)
        off = table.poses - stream.truth(campaign.plant.physics)[0]
        ids_of_rows = np.asarray([stream.legs[i].visit.pose_id for i in stream.leg])
        noise.append(off[np.isin(ids_of_rows, np.delete(ids, 4))])
    assert noise[0] == pytest.approx(noise[1], abs=1e-12)
    there, home = (off[np.flatnonzero(stream.leg == k)[:3], 0] for k in (0, 1))
    assert not np.allclose(there, home, atol=1e-6)


def test_thermometers_and_stamps_are_as_the_rig_file_says() -> None:
    plan = plan_of(some_poses(25))
    rig = {"rig": {"stream_Hz": 2.0}}
    good = {"instrument": {"thermometer_noise_degC": 0.0}}
    poor = {"instrument": {"thermometer_noise_degC": 0.5, "time_stamp_sd_s": 0.05}}
    tables = [
        table_of(Campaign(plan, RigSettings.from_dict({**rig, **more}), StandIn(), seed=5))
        for more in (good, poor)
    ]
    for name in ("temperature_degC", "sensor_temperature_degC"):
        off = tables[1].column(name) - tables[0].column(name)
        assert np.std(off) == pytest.approx(0.5, rel=0.1)
    stamps = [table.column("time_s") for table in tables]
    assert np.std(stamps[1] - stamps[0]) == pytest.approx(0.05, rel=0.1)
    assert np.all(np.diff(stamps[1]) >= 0.0)


def test_in_memory_it_is_said_that_no_stream_is_kept() -> None:
    for settings in (STREAM, RigSettings()):
        options = CampaignOptions(source=StandIn())
        table = run_campaign(plan_of(some_poses(25)), settings, None, options=options)
        assert any("stream_Hz" in text for text in table.warnings) == (settings is STREAM)


def test_a_way_point_that_nothing_is_known_of_is_no_guess() -> None:
    hide = [Hidden("fts_hysteresis", 1.0)]
    campaign = Campaign(plan_of(some_poses(8)), RigSettings(), StandIn(curvature=False), hide=hide)
    visit = campaign.visits.rows[3]
    strange = replace(visit, way=np.stack([visit.way[0], visit.way[-1] + 1e-3, visit.way[-1]]))
    rows = (*campaign.visits.rows[:3], strange, *campaign.visits.rows[4:])
    with pytest.raises(ComputationError, match="none of the 9 solved poses"):
        campaign.plant.truth(replace(campaign.visits, rows=rows))


def test_the_arm_cannot_remember_wrenches_that_no_map_knows() -> None:
    arm = RigSettings.from_dict({"rig": {"mode": "robot"}})
    hide = [Hidden("fts_hysteresis", 1.0)]
    Campaign(plan_of(some_poses(8)), arm, StandIn(), hide=hide)
    with pytest.raises(InputError, match=r"fts_hysteresis=1: the arm's own way.*Plan 20"):
        Campaign(plan_of(some_poses(8)), arm, StandIn(curvature=False), hide=hide)
