"""The raw stream: exact at both ends of a leg, noise as declared, and what only motion shows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ecm.diagnose import Diagnosis, diagnose
from ecm.errors import InputError
from ecm.rig import Campaign, Hidden, RigSettings, run_campaign
from ecm.rig.draws import DRAWS
from ecm.rig.elastic import Anchors, Smooth
from ecm.rig.frames import rotation, turn_wrench
from ecm.rig.raw_stream import RawStream
from ecm.rig.strength import Whitener
from ecm.table import Table, read_table
from stand_in_campaign import model, workspace_poses
from test_rig_plan import plan_of
from test_rig_stand_in import F, L, StandIn, some_poses, wrench

pytest.importorskip("pyarrow", reason="pyarrow is missing: pip install 'ecm-stiffness[data]'")

STREAM = RigSettings.from_dict({"rig": {"stream_Hz": 2.0}})


def stream_of(campaign: Campaign) -> RawStream:
    stream = campaign.raw_stream()
    assert stream is not None
    return stream


def measured(folder: Path, hide: str, seed: int = 3) -> Path:
    out = folder / f"{hide.replace('=', '-')}.csv"
    plan = plan_of(workspace_poses(40, 3))
    run_campaign(plan, STREAM, out, hide=hide, seed=seed, source=StandIn(), folder=folder)
    return out


def diagnosed(path: Path) -> Diagnosis:
    return diagnose(model(), read_table(path))


def test_a_leg_begins_and_ends_at_the_solved_poses_and_follows_the_map_between() -> None:
    campaign = Campaign(plan_of(some_poses(30)), STREAM, StandIn())
    stream = stream_of(campaign)
    assert stream.elastic_wrench() == pytest.approx(
        wrench(stream.truth(campaign.physics)[0]), abs=1e-3
    )
    assert len(stream.legs) == 60  # there and home
    rows = [np.flatnonzero(stream.leg == 2 * i) for i in range(30)]
    rest, moving = [r[-1] for r in rows], [r[0] for r in rows]
    visits = [i for i, v in enumerate(campaign.course.visits) if v.kind == "pose"]
    course = campaign.course
    at_rest = campaign.plant.elastic.wrench(course.anchor[visits], course.reached[visits])
    assert stream.elastic_wrench()[rest] == pytest.approx(at_rest, abs=1e-9)
    speed = np.abs(stream.velocities())
    assert speed[rest].max() == 0.0
    assert speed[moving].max() > 0.0
    # The velocities are those of the poses.
    poses = stream.truth(campaign.physics)[0]
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
    def surrogate(self, anchors: Anchors) -> Smooth | None:
        return Line()


REST: F = np.array([L, 0.0, 0.0, 0.0, 0.0, 0.0])
SLOPE: F = np.linalg.lstsq(some_poses(200) - REST, wrench(some_poses(200)), rcond=None)[0]


def test_on_the_way_it_is_the_solver_that_counts_and_not_the_smooth_map() -> None:
    campaign = Campaign(plan_of(some_poses(30)), STREAM, Rough())
    stream = stream_of(campaign)
    poses = stream.truth(campaign.physics)[0]
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
    left = stream.residual(campaign.physics) - stream_of(nominal).residual(nominal.physics)
    whitener = Whitener(stream.covariance(), stream.elastic_wrench()[:, :, None])
    assert whitener.strength(left) == pytest.approx(strength, rel=1e-4)

    out = measured(tmp_path, f"time_skew={strength}")
    found = diagnosed(out.with_suffix(".raw.parquet"))
    assert found.answer == (("time_skew",),)
    truth = campaign.physics.time_skew
    assert truth is not None
    mean = truth.size * (1.0 + 0.5 * truth.creep)
    assert found.effects[0].values[0] == pytest.approx(mean, rel=0.1)

    # The readings at rest hold nothing of it, and say what would.
    at_rest = diagnosed(out)
    assert at_rest.verdict == "none"
    reasons = {n["id"]: n for n in at_rest.not_testable}
    assert reasons["time_skew"]["reason"] == "no raw stream"
    assert "NAME.raw.parquet" in reasons["time_skew"]["record"]


def test_what_is_hidden_at_rest_is_in_the_stream_too(tmp_path: Path) -> None:
    found = diagnosed(measured(tmp_path, "payload=2").with_suffix(".raw.parquet"))
    assert len(found.answer) == 1
    assert "payload" in found.answer[0]  # beside a cable, perhaps
    assert "time_skew" not in found.answer[0]


@pytest.mark.parametrize("effect", sorted(DRAWS))
def test_every_truth_of_the_plant_acts_in_motion_too(effect: str) -> None:
    """Where a leg ends the stream reads what a reading at rest does, but for what time changes."""
    campaign = Campaign(
        plan_of(some_poses(30)), STREAM, StandIn(), hide=[Hidden(effect, 1.0)], seed=1
    )
    stream = stream_of(campaign)
    seen, sensor = stream.truth(campaign.physics)
    assert np.all(np.isfinite(sensor))
    assert np.all(np.isfinite(seen))
    last = np.flatnonzero(np.diff(stream.leg, append=-1))[::2]  # the others end at home
    rows = [i for i, v in enumerate(campaign.course.visits) if v.kind == "pose"]
    truth = campaign.plant.truth(campaign.course, campaign.physics, campaign.offset)
    plain = campaign.plant.truth(
        campaign.course,
        Campaign(plan_of(some_poses(30)), STREAM, StandIn(), seed=1).physics,
        campaign.offset,
    )
    effect_size = np.abs(truth.sensor - plain.sensor)[rows].max() + 0.05
    assert np.abs(sensor[last] - truth.sensor[rows]).max() < 2.0 * effect_size


def test_without_a_stream_a_skew_cannot_be_hidden() -> None:
    plan = plan_of(some_poses(30))
    with pytest.raises(InputError, match=r"time_skew=1.*\[rig\] stream_Hz"):
        Campaign(plan, RigSettings(), StandIn(), hide=Hidden.parse("time_skew"))


def test_random_draws_a_skew_only_where_there_is_a_stream(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ecm.rig.hidden.DRAWS", {"payload": DRAWS["payload"]})
    drawn: dict[bool, set[str]] = {True: set(), False: set()}
    for streamed in (True, False):
        settings = STREAM if streamed else RigSettings()
        for seed in range(8):
            campaign = Campaign(
                plan_of(some_poses(30)), settings, StandIn(),
                hide=Hidden.parse("random=1"), seed=seed,
            )  # fmt: skip
            drawn[streamed].add(campaign.secrets[0].effect)
    assert drawn == {True: {"payload", "time_skew"}, False: {"payload"}}


class Stop(Exception):
    pass


def test_a_campaign_that_was_cut_ends_with_the_same_stream(tmp_path: Path) -> None:
    plan = plan_of(some_poses(25))
    kept: dict[str, Any] = {"source": StandIn(), "folder": tmp_path / "cache", "seed": 4}

    def stop(done: int, total: int, word: str) -> None:
        if word == "measuring" and done == 11:
            raise Stop

    whole, cut = tmp_path / "a" / "data.csv", tmp_path / "b" / "data.csv"
    run_campaign(plan, STREAM, whole, hide="time_skew=1", **kept)
    with pytest.raises(Stop):
        run_campaign(plan, STREAM, cut, hide="time_skew=1", progress=stop, **kept)
    run_campaign(plan, STREAM, cut, hide="time_skew=1", **kept)
    files = [{f.name: f.read_bytes() for f in out.parent.iterdir()} for out in (whole, cut)]
    assert files[0] == files[1]
    beside = {"data.raw.parquet", "data.raw.toml", "data.truth.json"}
    assert set(files[0]) == {"data.csv", "data.toml", *beside}
    # A stream alone is not overwritten either, and goes with the table it belongs to.
    whole.unlink()
    with pytest.raises(InputError, match=r"data\.raw\.parquet: a table stands there"):
        run_campaign(plan, RigSettings(), whole, **kept)
    run_campaign(plan, RigSettings(), whole, overwrite=True, **kept)
    assert {f.name for f in whole.parent.iterdir()} == {"data.csv", "data.toml"}


def test_where_no_stream_can_be_kept_it_is_said_before_the_work(tmp_path: Path) -> None:
    plan, source = plan_of(some_poses(25)), StandIn()
    arm = RigSettings.from_dict({"rig": {"mode": "robot", "stream_Hz": 2.0}})
    with pytest.raises(InputError, match="only the quasi-static rig"):
        run_campaign(plan, arm, tmp_path / "data.csv", source=source)
    assert source.solved == 0
    few = StandIn(curvature=False)
    with pytest.raises(InputError, match=r"stream_Hz.*Plan 20 or more"):
        Campaign(plan, STREAM, few).raw_stream()


def test_the_wrench_is_turned_by_the_pose_of_its_own_row() -> None:
    """The pose at t and the wrench at t + delay: exactly what stands in a row."""
    hide = [Hidden("time_skew", 1.0)]
    campaign = Campaign(plan_of(some_poses(25)), STREAM, StandIn(), hide=hide)
    stream = stream_of(campaign)
    seen, sensor = stream.truth(campaign.physics)
    free = sensor - campaign.offset
    top = campaign.plant.zeroed(free)
    warm = campaign.physics.sensor_warm_up
    assert warm is not None
    h: F = turn_wrench(rotation(seen[:, 3:]), top)
    still = np.abs(stream.velocities()).max(axis=1) == 0.0
    miss = np.abs(h - wrench(seen))[:, 1:3].max(axis=1)
    assert miss[~still].max() > 5.0 * miss[still].max()


def table_of(campaign: Campaign) -> Table:
    return stream_of(campaign).table(campaign, [campaign.measure(i) for i in range(len(campaign))])


def test_the_same_seed_gives_the_same_stream() -> None:
    plan = plan_of(some_poses(25))
    first, again = (table_of(Campaign(plan, STREAM, StandIn(), seed=5)) for _ in range(2))
    other = table_of(Campaign(plan, STREAM, StandIn(), seed=6))
    assert np.array_equal(first.wrenches, again.wrenches)
    assert not np.allclose(first.wrenches, other.wrenches)
