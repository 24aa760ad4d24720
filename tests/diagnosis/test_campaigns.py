"""Several campaigns in one table: what begins anew with each, and what goes on."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ecm.diagnosis import diagnose
from ecm.diagnosis.next_experiment import _joined_forms
from ecm.diagnosis.problem import Candidate
from ecm.effects import Rows, get_effect
from ecm.effects.protocol import Shape
from ecm.effects.registry import with_shape
from ecm.effects.sensor import zeroings
from ecm.errors import InputError
from ecm.io.columns import WRENCH
from ecm.io.table import Table, as_table, read_table
from ecm.models import fit_model
from support.campaigns import META, NOISE, campaign, physics, workspace_poses
from support.neck import columns_of
from support.stand_in import wrench


@pytest.fixture(scope="module")
def joined(tmp_path_factory: pytest.TempPathFactory) -> Table:
    folder: Path = tmp_path_factory.mktemp("campaigns")
    paths = [folder / f"{name}.csv" for name in ("first", "second")]
    for seed, path in enumerate(paths):
        table = campaign(seed=seed)
        pause = 1e4 * seed
        table.with_columns({"time_s": table.column("time_s") + pause}).write(path)
    return read_table(paths)


def test_where_each_campaign_begins_is_kept(joined: Table, tmp_path: Path) -> None:
    rows = Rows(joined, physics())
    half = len(joined) // 2
    assert rows.campaign.tolist() == [0] * half + [1] * half
    assert joined.meta.file.begins_s == (joined.column("time_s")[half],)
    joined.write(tmp_path / "both.csv")
    assert read_table(tmp_path / "both.csv").meta.file == joined.meta.file


def test_a_zero_taken_anew_is_seen_in_the_first_reading_of_the_free_sensor(joined: Table) -> None:
    half = len(joined) // 2
    nothing = joined.with_columns(
        {
            name: np.where(np.arange(len(joined)) == half, 0.0, joined.column(name))
            for name in WRENCH
        }
        | {"kind": np.where(np.arange(len(joined)) == half, "unloaded", joined.text("kind"))}
    )
    assert zeroings(nothing) == ("each",)
    something = nothing.with_columns({"fx_N": nothing.column("fx_N") + 50.0})
    assert zeroings(something) == ("once", "each")
    assert zeroings(campaign(seed=0)) == ("once",)


@pytest.mark.parametrize("id", ["fts_drift", "fts_thermal_drift"])
def test_a_drift_counts_from_the_zero_of_its_campaign(joined: Table, id: str) -> None:
    half = len(joined) // 2
    rows = Rows(joined, physics())
    columns = np.asarray(with_shape(id, {"zeroed": "each"}).jacobian(rows, np.zeros(6)))
    assert not columns[half].any()
    second = joined.select(np.arange(half, len(joined)))
    second = second.with_meta(replace(second.meta, file=replace(second.meta.file, begins_s=())))
    time = second.column("time_s")
    alone = Rows(second.with_columns({"time_s": time - time[0]}), physics())
    assert columns[half:] == pytest.approx(get_effect(id).jacobian(alone, np.zeros(6)))


@pytest.mark.parametrize(
    ("id", "shape"),
    [
        ("fts_thermal_drift", {"reference_degC": 21.0, "zeroed": "each"}),
        ("marker_motion", {"course": "step", "at_s": 60.0, "counted": "each"}),
    ],
)
def test_a_shape_that_contradicts_itself_is_refused(id: str, shape: Shape) -> None:
    with pytest.raises(InputError, match="each"):
        with_shape(id, shape)


def test_the_zero_of_a_second_campaign_replaces_the_reference_of_the_first() -> None:
    once = Candidate(with_shape("fts_thermal_drift", {"reference_degC": 21.0}), (0,))
    anew = _joined_forms(once)
    assert [form.effect.shape for form in anew] == [{"zeroed": "each"}]


def test_a_set_that_is_kept_is_there_when_the_second_campaign_begins(joined: Table) -> None:
    half = len(joined) // 2
    rows = Rows(joined, physics())
    first = half + int(np.flatnonzero(joined.text("kind")[half:] == "pose")[0])
    shape = {"memory": "summed"}
    anew, kept = (
        with_shape("permanent_set", shape | more).jacobian(rows, np.zeros(1))[first]
        for more in ({}, {"history": "kept"})
    )
    # Before it the second campaign has only been at home, to within the robot's error.
    assert np.abs(kept).max() > 3.0 * np.abs(anew).max()


def test_the_free_sensor_shows_nothing_of_a_strained_mounting(joined: Table) -> None:
    free = np.arange(len(joined)) % 7 == 0
    table = joined.with_columns({"kind": np.where(free, "unloaded", "pose")})
    rows = Rows(table, physics())
    always, mounted = (
        effect.jacobian(rows, np.zeros(6))
        for effect in get_effect("fts_offset").variants(table)[:2]
    )
    assert np.abs(always[free]).max() > 0.5
    assert not mounted[free].any()
    assert np.array_equal(mounted[~free], always[~free])


ZERO = np.array([1.2, -0.8, 1.0, 0.02, 0.03, -0.02])
"""In the sensor's axes, N and N m."""


def with_new_zero(begins: int) -> Table:
    """120 poses, the sensor's zero another one from a row on."""
    random = np.random.default_rng(begins)
    poses = workspace_poses(120, begins)
    after = np.arange(120) >= begins
    turned = Rotation.from_rotvec(poses[:, 3:])
    zero = np.hstack([turned.apply(ZERO[:3]), turned.apply(ZERO[3:])]) * after[:, None]
    loads = wrench(poses) + zero + random.standard_normal((120, 6)) * NOISE
    return as_table(columns_of(poses, loads) | {"time_s": 60.0 * np.arange(120)}, meta=META)


@pytest.mark.parametrize("begins", [45, 83])
def test_a_new_zero_of_the_sensor_is_named_with_its_moment(begins: int) -> None:
    """A knock; it was a drift of the zero."""
    table = with_new_zero(begins)
    found = diagnose(fit_model(table, "energy6"), table)
    assert found.answer == (("fts_offset",),), found.sentence()
    fitted = found.effects[0]
    assert (np.abs(fitted.values - ZERO) <= 4.0 * fitted.sd).all()
    assert abs(fitted.effect.shape["since_s"] - 60.0 * (begins - 0.5)) <= 120.0


def test_a_sensor_that_is_mounted_again_is_named_with_its_moment() -> None:
    """It was a motion of the base marker beside a slip of the platform."""
    table = with_new_zero(120)
    after = (np.arange(120) >= 70)[:, None]
    turned, turn = Rotation.from_rotvec(table.poses[:, 3:]), Rotation.from_rotvec([0.06, 0.01, 0])
    again = turned * turn * turned.inv()
    loads = np.hstack(
        [again.apply(part) for part in (table.wrenches[:, :3], table.wrenches[:, 3:])]
    )
    mounted = dict(zip(WRENCH, np.where(after, loads, table.wrenches).T, strict=True))
    table = table.with_columns(mounted)
    found = diagnose(fit_model(table, "energy6"), table)
    assert found.answer == (("fts_frame",),), found.sentence()
    assert found.effects[0].values[3] == pytest.approx(0.06, abs=4.0 * found.effects[0].sd[3])
    assert abs(found.effects[0].effect.shape["since_s"] - 60.0 * 69.5) <= 120.0


def test_a_zero_that_stays_is_none() -> None:
    table = with_new_zero(120)
    assert diagnose(fit_model(table, "energy6"), table).verdict == "none"
