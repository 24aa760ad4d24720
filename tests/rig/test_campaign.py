"""A whole campaign on the simulated rig: noise as declared, same bytes, resuming."""

from __future__ import annotations

import resource
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ecm.errors import ComputationError, InputError
from ecm.io.table import read_table
from ecm.rig import Campaign, CampaignOptions, RigSettings, campaign_minutes, run_campaign
from ecm.rig.inject import whitener_of
from ecm.rig.plant import residual
from ecm.rig.readings import BESIDE, Journal
from support.stand_in import StandIn, Stop, error_of, plan_of, some_poses, stop_at


@pytest.fixture
def options(tmp_path: Path) -> CampaignOptions:
    """The closed form, whose solved poses are kept beside the test's files."""
    return CampaignOptions(source=StandIn(), folder=tmp_path / "cache")


def test_with_nothing_hidden_only_the_declared_noise_is_left() -> None:
    strengths = []
    for seed in range(6):
        campaign = Campaign(plan_of(some_poses(200)), RigSettings(), StandIn(), seed=seed)
        whitener = whitener_of(campaign)
        strengths.append(whitener.strength(error_of(campaign, campaign.run())))
        plant = replace(campaign.plant, offset=np.full(6, 3.0))
        systematic = residual(plant, campaign.visits)
        assert whitener.strength(systematic) < 0.05
    assert np.mean(strengths) == pytest.approx(1.0, abs=0.03)


def test_without_compensation_the_zero_stays_in_the_data() -> None:
    plan = plan_of(some_poses(40))
    settings = RigSettings.from_dict({"rig": {"offset_compensation": "none"}})
    campaign = Campaign(plan, settings, StandIn())
    assert np.abs(error_of(campaign, campaign.run()).mean(axis=0)).max() > 1.0


def test_columns_and_description_are_complete() -> None:
    poses = some_poses(30)
    action = ["measure"] * 30
    action[10], action[20] = "home", "unload"
    table = Campaign(plan_of(poses, action=action), RigSettings(), StandIn()).run()
    assert table.has("time_s", "dwell_s", "approach", "kind", "temperature_degC", "sd_fx_N")
    assert [str(k) for k in table.text("kind")].count("pose") == 28
    home = table.select(table.text("kind") == "home")
    assert np.abs(home.wrenches[0, 1:3]).max() < 10.0
    free = table.select(table.text("kind") == "unloaded")
    assert np.abs(free.wrenches).max() < 1e-9  # it is itself what is subtracted
    assert np.all(np.diff(table.column("time_s")) > 0.0)
    figures = table.meta.instrument
    assert figures.force_sd_N == pytest.approx(0.3, rel=0.01)
    assert figures.torque_sd_Nm == pytest.approx(0.0103, rel=0.01)
    assert figures.pose_position_sd_m == pytest.approx(37.4e-6, rel=0.01)
    assert table.meta.file.truth_sha256 == ""
    # A window's own spread is that of one sample.
    assert table.measured().column("sd_fx_N").mean() == pytest.approx(3.0, rel=0.05)


def test_the_written_table_reads_back(tmp_path: Path, options: CampaignOptions) -> None:
    out = tmp_path / "data.csv"
    table = run_campaign(plan_of(some_poses(20)), RigSettings(), out, options=options)
    again = read_table(out)
    assert again.poses == pytest.approx(table.poses, abs=0.0)
    assert again.wrenches == pytest.approx(table.wrenches, abs=0.0)
    assert not list(tmp_path.glob("*.journal.csv"))
    assert not list(tmp_path.glob("*.truth.json"))


@pytest.mark.parametrize("cut", [0, 5])
def test_an_interrupted_campaign_goes_on_and_ends_with_the_same_bytes(
    tmp_path: Path, options: CampaignOptions, cut: int
) -> None:
    plan = plan_of(some_poses(25))
    same: dict[str, Any] = {"options": options, "hide": "payload=2", "seed": 4}

    def files(folder: Path, **more: Any) -> dict[str, bytes]:
        run_campaign(plan, RigSettings(), folder / "data.csv", **same, **more)
        return {f.name: f.read_bytes() for f in folder.iterdir()}

    whole = files(tmp_path / "a")
    assert set(whole) == {"data.csv", "data.toml", "data.truth.json"}
    with pytest.raises(Stop):
        files(tmp_path / "b", progress=stop_at(11))
    journal = tmp_path / "b" / "data.journal.csv"
    kept = journal.read_bytes()
    assert kept.count(b"\n") == 2 + 11
    if cut:  # a kill in the middle of a line loses that line only
        journal.write_bytes(kept[:-cut])
    taken: list[int] = []
    again = files(
        tmp_path / "b", progress=lambda d, n, w: taken.append(d) if w == "measuring" else None
    )
    assert again == whole
    assert taken[0] == (12 if not cut else 11)


def test_a_finished_table_is_not_overwritten_and_an_unfinished_one_goes_on(
    tmp_path: Path, options: CampaignOptions
) -> None:
    plan, out = plan_of(some_poses(12)), tmp_path / "data.csv"
    run_campaign(plan, RigSettings(), out, options=options)
    before = out.read_bytes()
    with pytest.raises(InputError, match=r"data\.csv: a table stands there.*overwrite=True"):
        run_campaign(plan, RigSettings(), out, seed=1, options=options)
    for name in ("data.parquet", "data", "data.v2"):  # all would share data.truth.json
        with pytest.raises(InputError, match="written as CSV"):
            run_campaign(plan, RigSettings(), tmp_path / name, options=options)
    # A journal that names no campaign opens no door, nor does another's, nor this one's own
    # where it is not to go on.
    journal = tmp_path / "data.journal.csv"
    for text in ("", "# campaign 12", "# campaign \n", "anything\n"):
        journal.write_text(text)
        with pytest.raises(InputError, match="a table stands there"):
            run_campaign(plan, RigSettings(), out, options=options)
    journal.write_text("# campaign 12\n")
    with pytest.raises(InputError, match="another campaign"):
        run_campaign(plan, RigSettings(), out, options=options)
    with pytest.raises(InputError, match="a table stands there"):
        run_campaign(plan, RigSettings(), out, options=replace(options, resume=False))
    journal.unlink()
    assert out.read_bytes() == before

    with pytest.raises(Stop):
        run_campaign(
            plan, RigSettings(), out, seed=1, overwrite=True, progress=stop_at(3), options=options
        )
    assert out.read_bytes() == before  # until the new one is whole
    run_campaign(plan, RigSettings(), out, seed=1, options=options)
    assert out.read_bytes() != before


@pytest.mark.parametrize("suffix", sorted(BESIDE))
def test_what_belongs_to_a_table_is_kept_without_it(
    tmp_path: Path, options: CampaignOptions, suffix: str
) -> None:
    theirs = tmp_path / f"data{suffix}"
    theirs.write_text("sealed yesterday")
    with pytest.raises(InputError, match=rf"data\{suffix}: .* stands there.*overwrite=True"):
        run_campaign(plan_of(some_poses(12)), RigSettings(), tmp_path / "data.csv", options=options)
    assert theirs.read_text() == "sealed yesterday"


def test_a_journal_that_cannot_be_written_again_keeps_its_readings(tmp_path: Path) -> None:
    """It is written again when a campaign goes on: a kill or a full disk in that moment."""
    path = tmp_path / "data.journal.csv"
    with Journal(path, "key", "header", resume=True) as journal:
        for _ in range(5):
            journal.append(24 * "1")
    before = path.read_bytes()
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (40, limits[1]))
    try:
        with pytest.raises(ComputationError, match="kept"):
            Journal(path, "key", "header", resume=True).__enter__()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert path.read_bytes() == before


def test_the_journal_of_another_campaign_is_refused(
    tmp_path: Path, options: CampaignOptions
) -> None:
    plan = plan_of(some_poses(12))
    out = tmp_path / "data.csv"
    with pytest.raises(Stop):
        run_campaign(plan, RigSettings(), out, progress=stop_at(3), options=options)
    with pytest.raises(InputError, match="another campaign"):
        run_campaign(plan, RigSettings(), out, seed=1, options=options)
    run_campaign(plan, RigSettings(), out, seed=1, options=replace(options, resume=False))
    assert out.exists()


def test_noise_belongs_to_the_visit_and_not_to_its_place_in_the_order() -> None:
    poses = some_poses(10)
    ids = np.arange(10)
    forward = Campaign(plan_of(poses, pose_id=ids), RigSettings(), StandIn(), seed=1)
    back = Campaign(plan_of(poses[::-1], pose_id=ids[::-1]), RigSettings(), StandIn(), seed=1)

    def of(campaign: Campaign) -> dict[int, list[float]]:
        table = campaign.run().measured()
        rows = campaign.visits.at_poses
        both = np.concatenate([table.poses, campaign.visits.reached[rows]], axis=1)
        return dict(zip(table.column("pose_id").astype(int).tolist(), both.tolist(), strict=True))

    assert of(back) == of(forward)


def test_anchors_are_solved_once(tmp_path: Path) -> None:
    poses = some_poses(10)
    source = StandIn()
    plan = plan_of(np.concatenate([poses, poses]))
    for seed in range(3):
        Campaign(plan, RigSettings(), source, seed=seed, folder=tmp_path)
    assert source.solved == 11  # ten poses and the rest pose


def test_a_damaged_cache_is_solved_again(tmp_path: Path) -> None:
    plan = plan_of(some_poses(5))
    Campaign(plan, RigSettings(), StandIn(), folder=tmp_path)
    file = next(tmp_path.glob("anchors-*.npz"))
    file.write_bytes(file.read_bytes()[:100])
    source = StandIn()
    Campaign(plan, RigSettings(), source, folder=tmp_path)
    assert source.solved == 6


def test_a_cache_that_cannot_be_written_says_what_to_do(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_text("")
    with pytest.raises(ComputationError, match="ECM_CACHE"):
        Campaign(plan_of(some_poses(5)), RigSettings(), StandIn(), folder=file / "cache")


def test_new_data_without_secrets_take_the_old_truth_away(
    tmp_path: Path, options: CampaignOptions
) -> None:
    out = tmp_path / "data.csv"
    run_campaign(plan_of(some_poses(20)), RigSettings(), out, hide="payload=1", options=options)
    assert (tmp_path / "data.truth.json").exists()
    run_campaign(plan_of(some_poses(20)), RigSettings(), out, overwrite=True, options=options)
    assert not (tmp_path / "data.truth.json").exists()


def test_the_time_of_a_plan_is_known_before_anything_is_solved() -> None:
    plan = plan_of(some_poses(20))
    plan = plan.with_meta(replace(plan.meta, mechanism={"length_m": StandIn().length_m}))
    minutes = campaign_minutes(plan, RigSettings())
    assert minutes == pytest.approx(Campaign(plan, RigSettings(), StandIn()).minutes)
    assert 5.0 < minutes < 30.0


def test_a_plan_without_mechanism_says_what_to_add(tmp_path: Path) -> None:
    plan = replace(plan_of(some_poses(3)), source="plan.csv")
    with pytest.raises(InputError, match=r"plan.csv.*\[mechanism\]"):
        run_campaign(plan, RigSettings(), tmp_path / "data.csv")
