"""A driven arm through the devices of a bench, and the samples between the readings."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ecm
from bench.test_measure import FRAME, PARTS, Rig, bench_of, plan_of, simulated, unsaid
from ecm.bench import measure
from ecm.bench.devices import DeviceError
from ecm.bench.settings import DeviceTable
from ecm.errors import InputError
from ecm.io.columns import POSE
from ecm.io.description import Meta
from ecm.io.table import Table, as_table, read_table
from ecm.rig.run import run_campaign
from ecm.rig.settings import RigSettings

ARM = {
    "builtin": "chambered",
    "length_m": 0.05,
    "radius_m": 0.02,
    "chamber_count": 3,
    "chamber_inner_m": 0.0075,
    "chamber_outer_m": 0.0165,
    "channel_radius_m": 0.004,
    "young_modulus_Pa": 3e5,
}


def arm_plan() -> Table:
    """Offsets from the free pose at two sets of pressures, one of them twice."""
    columns = dict.fromkeys(POSE, np.zeros(3)) | {"x_m": np.full(3, 0.0505)}
    columns |= {"pressure_1_Pa": np.array([5e3, 0.0, 5e3]), "pressure_2_Pa": np.zeros(3)}
    columns |= {"pressure_3_Pa": np.array([0.0, 8e3, 0.0])}
    offsets = np.zeros((3, 6))
    offsets[:, 1] = [0.001, -0.001, 0.001]
    columns |= {f"offset_{name}": column for name, column in zip(POSE, offsets.T, strict=True)}
    return as_table(columns, meta=Meta(mechanism=ARM))


def test_a_driven_arm_through_devices_gives_the_table_of_the_campaign(tmp_path: Path) -> None:
    rig = tmp_path / "rig.toml"
    rig.write_text("[instrument]\nforce_noise_N = 0.03\n")
    settings = RigSettings.from_dict({"instrument": {"force_noise_N": 0.03}})
    tables = {"instrument": FRAME, "limits": {"actuation": [0.0, 1e4]}}
    like, parts = {"seed": 3, "rig": str(rig)}, ("actuation", "follower")
    plan, bench = simulated(arm_plan(), tmp_path, parts, like=like, **tables)
    campaign = run_campaign(plan, settings, seed=3)
    measured = measure(plan, bench, tmp_path / "data.csv")
    assert {*campaign.columns} - {*measured.columns} == {"leds_visible"}
    for name, column in measured.columns.items():
        assert column.tolist() == campaign.columns[name].tolist(), name
    assert measured.column("pressure_3_Pa").tolist() == [0.0, 8e3, 0.0]


class DrivenRig(Rig):
    """The spring with two valves, whose free place moves with the first."""

    def __init__(self) -> None:
        super().__init__()
        self.asked, self.leak, self.followed = np.zeros(2), 1.0, 0

    def actuate(self, values: np.ndarray) -> None:
        self.told.append("actuate")
        self.asked = np.asarray(values)

    def actuation(self) -> np.ndarray:
        return self.leak * self.asked

    def follow(self, free_N: float) -> None:
        self.followed += 1
        self.at = np.array([0.1 + 1e-7 * self.asked[0], 0.0, 0.0, 0.0, 0.0, 0.0])


def driven_plan(rows: int = 4) -> Table:
    """The plan of the spring, with pressures and offsets."""
    pressures = {"pressure_1_Pa": np.full(rows, 2e4), "pressure_2_Pa": np.linspace(0.0, 1e4, rows)}
    offsets = dict.fromkeys((f"offset_{name}" for name in POSE), np.zeros(rows))
    return plan_of(rows, **pressures, **offsets | {"offset_y_m": np.full(rows, 1e-3)})


def drive(rig: DrivenRig, out: Path, *, follow: bool = True, **limits: Any) -> Table:
    """Measure the driven plan."""
    parts = (*PARTS, "actuation", *(["follower"] if follow else []))
    bench = bench_of(**{"actuation": [0.0, 3e4]} | limits)
    bench = replace(bench, devices=bench.devices | dict.fromkeys(parts, DeviceTable("line")))
    return measure(driven_plan(), bench, out, devices=dict.fromkeys(parts, rig), say=unsaid)


def test_actuators_are_set_before_the_move_and_their_gauges_are_in_the_table(
    tmp_path: Path,
) -> None:
    rig = DrivenRig()
    rig.leak = 0.9
    table = drive(rig, tmp_path / "data.csv")
    assert table.column("pressure_1_Pa").tolist() == [0.9 * 2e4] * 4
    assert rig.told.index("actuate") < rig.told.index("start")
    assert rig.followed == 4  # each row has other pressures
    assert table.column("x_m") == pytest.approx([0.102] * 4)
    assert table.column("y_m") == pytest.approx([0.001] * 4)
    assert "visit 2: an actuator is at 18000, 20000 was asked for" in table.warnings
    assert read_table(tmp_path / "data.csv").actuation_columns == ("pressure_1_Pa", "pressure_2_Pa")


def test_without_a_follower_the_poses_are_those_of_the_plan(tmp_path: Path) -> None:
    table = drive(DrivenRig(), tmp_path / "data.csv", follow=False)
    assert table.column("y_m") == pytest.approx(driven_plan().column("y_m"))


def test_pressures_beyond_the_limits_move_nothing_and_a_stop_releases_where_asked(
    tmp_path: Path,
) -> None:
    rig = DrivenRig()
    with pytest.raises(InputError, match=r"row 1: an actuator at 20000, limits 0 to 10000 \(act"):
        drive(rig, tmp_path / "data.csv", actuation=[0.0, 1e4])
    assert rig.told == []
    for release in (False, True):
        rig = DrivenRig()
        rig.leak = 2.0  # the gauge reads more than the regulator was told
        with pytest.raises(DeviceError, match=r"an actuator at 40000, limits 0 to 30000"):
            drive(rig, tmp_path / f"{release}.csv", release_on_stop=release)
        assert rig.told[-1] == ("actuate" if release else "stop")
        assert (rig.asked == 0.0).all() == release
    bench = bench_of(actuation=[0.0, 3e4])
    with pytest.raises(InputError, match=r"there is no \[actuation\] to set them"):
        measure(driven_plan(), bench, tmp_path / "none.csv", devices={})


def test_the_samples_are_a_continuous_test_beside_the_table(tmp_path: Path) -> None:
    out, raw = tmp_path / "data.csv", tmp_path / "data.raw.csv"
    rig = Rig(settle_s=0.12)
    rig.silent_from = 6
    bench = bench_of()
    bench = replace(bench, procedure=replace(bench.procedure, stream_Hz=50.0))
    devices = dict.fromkeys(PARTS, rig)
    with pytest.raises(DeviceError):
        measure(plan_of(), bench, out, devices=devices, say=unsaid)
    first = len((tmp_path / "data.raw.journal.csv").read_text().splitlines())
    assert first > 6
    devices = dict.fromkeys(PARTS, Rig(settle_s=0.12))
    table = measure(plan_of(), bench, out, devices=devices, say=unsaid)
    samples = read_table(raw)
    assert samples.meta.file.kind == "continuous"
    assert len(samples) > first
    # At rest 50 a second in windows of 0.2 s, more on the way.
    assert len(samples) > 10 * len(table)
    error = samples.wrenches[:, :3] - 1e4 * (samples.poses[:, :3] - [0.1, 0.0, 0.0])
    assert np.abs(error).max() < 0.2
    assert not (tmp_path / "data.raw.journal.csv").exists()
    assert ecm.import_log(raw).table.poses.tolist() == samples.poses.tolist()
    middle = samples.column("time_s")[None] - table.column("time_s")[:, None]
    assert np.abs(middle).min(axis=1).max() < 0.02
