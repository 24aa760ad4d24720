"""Which row is next, when it is enough, what is promised, and that a cut changes none of it."""

from __future__ import annotations

import cProfile
import json
import re
from functools import cache
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from bench.test_measure import FRAME, PARTS, Rig, bench_of, plan_of, run, simulated, unsaid
from ecm.bench import measure
from ecm.bench.devices import DeviceError
from ecm.bench.until import next_row
from ecm.designs import Design, DesignSettings, diagnosable_plan, optimal_design
from ecm.designs.next_pose import NextPose
from ecm.diagnosis.agreement import Told, look_at
from ecm.errors import InputError
from ecm.io.columns import POSE, WRENCH
from ecm.io.description import Instrument, Meta
from ecm.io.events import live_path
from ecm.io.mechanism import Mechanism
from ecm.io.se3 import rotation, transpose, turn_wrench
from ecm.io.table import Table, as_table
from ecm.models import EnergyModel, Model, fit_model
from ecm.models.fit import fit_rows
from ecm.models.maps import EnergyMap, EnergyTerms
from ecm.rig import Campaign, RigSettings, fem_source
from ecm.rig.plan import LOOK_HOME, Request, requests
from ecm.rig.settings import Procedure
from support.neck import columns_of


def _body() -> EnergyMap:
    """An energy of degree 4 that is near a spring."""
    bent = spring_plan(60).poses
    wrenches = [2e4, 5e3, 5e3, 8.0, 10.0, 10.0] * (bent - [0.1, 0.0, 0.0, 0.0, 0.0, 0.0])
    return EnergyTerms(0.1, 4).fit(bent, wrenches)


BODY = cache(_body)


class Spring(Rig):
    """A body with a wrench at every pose, on a sensor that turns with the platform."""

    freed = False

    def ask(self, text: str) -> None:
        self.freed = text.startswith("free")

    def wrench(self, window_s: float) -> np.ndarray:
        self.readings += window_s > 0.15
        if self.readings > self.silent_from:
            raise OSError("the cable is out")
        back = transpose(rotation(self.at[None, 3:]))
        true = 0.0 if self.freed else turn_wrench(back, BODY().predict(self.at[None]))[0]
        noise = np.repeat([0.05, 1e-3], 3)
        random = np.random.default_rng(np.abs(self.at * 1e9).astype(np.int64))
        return true + noise * random.standard_normal((20, 6))


def spring_plan(rows: int = 80, **columns: Any) -> Table:
    """Random poses."""
    poses = np.random.default_rng(1).uniform(-1.0, 1.0, (rows, 6))
    poses *= [1e-3, 4e-3, 4e-3, 0.1, 0.1, 0.1]
    poses[:, 0] += 0.1
    table = dict(zip(POSE, poses.T, strict=True)) | columns
    return as_table(table, meta=Meta(mechanism={"length_m": 0.1}))


def spring_run(plan: Table, rig: Rig, out: Path, **options: Any) -> Table:
    """Measure without a person."""
    bench = bench_of(force_N=1000.0, torque_Nm=100.0)
    return measure(plan, bench, out, devices=dict.fromkeys(PARTS, rig), say=unsaid, **options)


def certificate(out: Path) -> dict[str, Any]:
    """What the run promises."""
    document: dict[str, Any] = json.loads(out.with_suffix(".until.json").read_text())
    return document


def test_a_run_stops_when_the_error_is_reached_and_promises_it(tmp_path: Path) -> None:
    out = tmp_path / "data.csv"
    table = spring_run(spring_plan(), Spring(), out, until="0.02 N", fit="energy4")
    at = table.text("kind") == "pose"
    assert 8 <= np.count_nonzero(at) < 50  # of 80: the promise is kept with 99 % at this look
    promise = certificate(out)
    assert promise["reached"] is True
    assert promise["error"]["high"] <= 0.02
    assert promise["rows"] == np.count_nonzero(at)
    assert promise["words"][0].endswith("0.02 N was reached")
    assert "energy4 errs" in promise["words"][1]


def test_a_stricter_error_takes_more_rows_and_another_order_than_the_plan_s(tmp_path: Path) -> None:
    rows = []
    for name, until in (("a", "0.03 N"), ("b", "0.02 N")):
        out = tmp_path / f"{name}.csv"
        table = spring_run(spring_plan(), Spring(), out, until=until, fit="energy4")
        rows.append(table.column("pose_id")[table.text("kind") == "pose"].tolist())
    assert len(rows[0]) < len(rows[1])
    assert rows[1][: len(rows[0])] == rows[0] != sorted(rows[0])


NOISE = Instrument(
    pose_position_sd_m=1e-5, pose_rotation_sd_rad=1e-4, force_sd_N=0.05, torque_sd_Nm=1e-3
)


def read_poses(body: EnergyMap, seed: int, rows: int = 150) -> Table:
    """Poses and wrenches of a body with the noise of all instruments."""
    plan = spring_plan(rows)
    pairs = np.hstack([plan.poses, body.predict(plan.poses)])
    sizes = np.repeat([1e-5, 1e-4, 0.05, 1e-3], 3)
    pairs += sizes * np.random.default_rng(seed).standard_normal(pairs.shape)
    columns = dict(zip((*POSE, *WRENCH), pairs.T, strict=True))
    return as_table(columns, meta=Meta(mechanism={"length_m": 0.1}, instrument=NOISE))


def off(model: Model, body: EnergyMap, unit: str) -> np.ndarray:
    """(N, 3) error of a model at the poses of the plan."""
    poses = spring_plan(150).poses
    wrong = model.predict(poses) - body.predict(poses)
    if unit == "mm":
        wrong = 1e3 * wrong @ np.linalg.inv(body.stiffness(model.rest_pose("mm"))[0]).T
    return np.asarray(wrong[:, :3])


def expected(rows: Table, unit: str, degree: int) -> float:
    """Root mean square error of an energy over the plan by its covariance: no luck of a draw."""
    model = fit_rows(rows, EnergyModel(degree))
    poses = spring_plan(150).poses
    into = np.eye(6)[:3]
    if unit == "mm":
        into = 1e3 * np.linalg.inv(BODY().stiffness(model.rest_pose("mm"))[0])[:3]
    part = into @ model.base.columns(poses)
    variance = np.einsum("nij,jk,nik->", part, np.asarray(model.covariance), part)
    return float(np.sqrt(variance / len(poses)))


@pytest.mark.parametrize("unit", ["N", "mm"])
def test_chosen_rows_err_less_in_the_unit_of_the_goal_than_a_fixed_plan(unit: str) -> None:
    read = read_poses(BODY(), 5)
    choice = NextPose(read, unit)
    taken: list[int] = []
    while len(taken) < 30:
        if taken:
            choice.learn(read.select(np.asarray(taken)))
        left = np.setdiff1d(np.arange(len(read)), taken)
        taken.append(int(choice.order(left.tolist(), np.ones(len(left)))[0]))
    settings = DesignSettings(model="energy6", length_m=0.1, starts=1, iterations=20)
    plan = optimal_design(read.poses, 60, settings).indices
    random = np.random.default_rng(0)
    for degree, most in ((4, 0.97), (5, 0.95), (6, 0.8)):
        orders = [random.permutation(plan)[:30] for _ in range(5)]
        fixed = [expected(read.select(order), unit, degree) for order in orders]
        assert expected(read.select(np.asarray(taken)), unit, degree) < most * np.mean(fixed)


@pytest.mark.parametrize("unit", ["N", "mm"])
def test_a_promise_holds_where_the_model_lacks_a_form_that_the_noise_hides(unit: str) -> None:
    terms = EnergyTerms(0.1, 6)
    poses = spring_plan(150).poses
    plain = terms.fit(poses, BODY().predict(poses))
    further = np.where(np.arange(len(plain.coefficients)) < 22, 0.0, 0.002)
    body = terms.map(terms.frame(poses), plain.coefficients + further)
    kept = []
    for seed in range(20):
        read = read_poses(body, seed)
        choice = NextPose(read, unit)
        choice.learn(read.select(np.random.default_rng(seed).permutation(150)[:40]))
        assert choice.error is not None
        assert choice.model is not None
        found = np.sqrt((off(choice.model, body, unit) ** 2).sum(axis=1).mean())
        kept.append(found <= choice.error.high)
    assert sum(kept) >= 18


def test_a_plan_that_ends_before_the_error_says_so(tmp_path: Path) -> None:
    out = tmp_path / "data.csv"
    spring_run(spring_plan(12), Spring(), out, until="0.001 mm", fit="energy4")
    promise = certificate(out)
    assert promise["reached"] is False
    assert promise["rows"] == 12
    assert promise["words"][0].endswith("the plan has no more rows, and 0.001 mm was not reached")
    assert promise["error"]["high"] > 0.001


def test_a_run_that_is_cut_chooses_as_one_that_is_not(tmp_path: Path) -> None:
    plan, options = spring_plan(), {"until": "0.03 N", "fit": "energy4"}
    whole = spring_run(plan, Spring(), tmp_path / "whole.csv", **options)
    count = np.count_nonzero(whole.text("kind") == "pose")
    for cut in (3, 9, count - 1):
        out = tmp_path / f"cut{cut}.csv"
        rig = Spring()
        rig.silent_from = cut
        with pytest.raises(DeviceError, match="the cable is out"):
            spring_run(plan, rig, out, **options)
        again = spring_run(plan, Spring(), out, **options)
        order = [
            table.column("pose_id")[table.text("kind") == "pose"].tolist()
            for table in (whole, again)
        ]
        assert order[0][: cut + 1] == order[1][: cut + 1]
        assert sorted(order[0]) == sorted(order[1])
        assert "home" in again.text("kind")[cut - 1 : cut + 2]


def test_the_same_seed_gives_the_same_bytes(tmp_path: Path) -> None:
    texts = []
    for name in ("a", "b"):
        out = tmp_path / f"{name}.csv"
        spring_run(spring_plan(), Spring(), out, until="0.1 N")
        document = certificate(out)
        texts.append(json.dumps(document | {"minutes": 0.0, "words": []}))
    assert texts[0] == texts[1]


@pytest.mark.parametrize("text", ["0.3", "0 mm", "-1 N", "nan mm", "1e999 N", "3 apples", "name"])
def test_a_goal_that_cannot_be_meant_is_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(InputError, match=r'expected an error such as "0.3 mm" or "0.5 N"'):
        spring_run(spring_plan(), Spring(), tmp_path / "data.csv", until=text)


def test_an_order_that_cannot_be_changed_is_refused(tmp_path: Path) -> None:
    plan = spring_plan(4, action=["measure", "measure", "remount:90", "measure"])
    with pytest.raises(InputError, match=r"row 3: --until .* after `remount:90` the rig is"):
        spring_run(plan, Spring(), tmp_path / "data.csv", until="named")
    with pytest.raises(InputError, match="rows are chosen for energies"):
        spring_run(spring_plan(), Spring(), tmp_path / "data.csv", until="1 N", fit="cubic")
    with pytest.raises(InputError, match="6 poses, and energy4 needs 7 before its error is known"):
        spring_run(spring_plan(6), Spring(), tmp_path / "data.csv", until="1 N")


def test_each_reading_is_told_as_data_and_a_run_that_goes_on_tells_all_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    events, rig, out = tmp_path / "events", Rig(), tmp_path / "data.csv"
    monkeypatch.setenv("ECM_EVENTS", str(events))
    model, rig.silent_from = fit_model(run(plan_of(), Rig(), tmp_path / "a.csv"), "linear"), 17
    rig.outliers = {14}
    events.unlink()
    with pytest.raises(DeviceError, match="stopped at visit 17"):
        run(plan_of(18), rig, out, model=model)
    live = live_path(out).read_text()
    assert live == events.read_text()
    begun, *told, end = [json.loads(line) for line in live.splitlines()]
    assert len(begun["begun"]["poses"]["y_m"]) == 18
    assert "readings are kept" in end["ended"]
    run(plan_of(18), Rig(), out, model=model)
    assert not live_path(out).exists()
    lines = [json.loads(line) for line in events.read_text().splitlines()][1 + len(told) :]
    assert lines[2 : 2 + len(told)] == told  # those of the journal again, from their lines alone
    records = [line["measured"] for line in lines[2:]]
    found = [words for record in records for words in record["findings"]]
    assert any(re.match(r"visit 14: .* sd from its repeat", words) for words in found)
    poses = [record for record in records if record["kind"] == "pose"]
    for record in poses:
        off = np.subtract(record["wrench"], record["model"])[:3]
        assert np.linalg.norm(off) == pytest.approx(record["model_N"])
    assert poses[6]["noise_N"] is None
    # A mean of 20 samples of 0.02 N along each of three axes.
    assert poses[-1]["noise_N"] == pytest.approx(0.02 * np.sqrt(3.0 / 20.0), rel=0.7)
    assert poses[-1]["goal"] is None


def test_a_marker_that_slips_is_told_within_three_rows_and_the_rest_pose_is_looked_at(
    tmp_path: Path,
) -> None:
    rig = Spring()
    rig.accident = 30, rig.slip, 1, 3e-4  # each pose is driven to from home
    table = spring_run(spring_plan(30), rig, tmp_path / "data.csv")
    said = [words for words in table.warnings if "a marker may have slipped" in words]
    assert len(said) == 1
    kinds = table.text("kind").tolist()
    # Visit n of the words is row n - 1 of the table: the zero comes before it.
    told = int(said[0].split()[1].rstrip(":")) - 1
    rows = [i for i, kind in enumerate(kinds) if kind == "pose"]
    moves = table.column("y_m") - _commanded(table)
    first = next(i for i in rows if moves[i] > 1.5e-4)
    assert told - (first + 1) <= 3
    assert "home" in kinds[told : told + 2]


def _commanded(table: Table) -> np.ndarray:
    plan = spring_plan(30)
    ids = table.column("pose_id").astype(int)
    return np.where(ids >= 0, plan.column("y_m")[np.maximum(ids, 0)], 0.0)


def test_home_checks_that_the_plan_has_not_are_made_and_become_rare(tmp_path: Path) -> None:
    table = spring_run(spring_plan(130), Spring(), tmp_path / "data.csv")
    home = np.flatnonzero(table.text("kind") == "home")
    assert 2 <= len(home) <= 4
    assert (np.diff(np.diff([0, *home])) > 0).all()
    assert not table.warnings


def test_the_simulated_rig_follows_the_chosen_order(tmp_path: Path) -> None:
    poses = spring_plan(12).poses
    poses[:, 0] += Mechanism().length_m - 0.1
    meta = Meta(mechanism=Mechanism().to_dict())
    near = as_table(dict(zip(POSE, poses.T, strict=True)), meta=meta)
    plan, bench = simulated(near, tmp_path, like={"seed": 3}, instrument=FRAME)
    out = tmp_path / "data.csv"
    table = measure(plan, bench, out, until="0.001 N", fit="energy4", say=unsaid)
    order = table.column("pose_id").astype(int).tolist()
    assert sorted(order) == list(range(12)) != order
    campaign = Campaign(plan, RigSettings(), fem_source(plan), seed=3).in_order(order).run()
    assert table.wrenches.tolist() == campaign.wrenches.tolist()
    assert table.column("time_s").tolist() == campaign.column("time_s").tolist()
    assert certificate(out)["rows"] == 12


def test_a_run_until_named_takes_telling_rows_and_stops_when_a_name_is_believed(
    tmp_path: Path,
) -> None:
    poses = np.random.default_rng(0).uniform(-1.0, 1.0, (40, 6))
    poses *= [0.004, 0.012, 0.012, 0.2, 0.2, 0.2]
    poses[:, 0] += Mechanism().length_m
    candidates = as_table(
        dict(zip(POSE, poses.T, strict=True)), meta=Meta(mechanism=Mechanism().to_dict())
    )
    chosen = Design(np.arange(40), "maximin", 0.0, 0.0, 1.0, "converged")
    noise = {"pose_position_sd_m": 4e-5, "pose_rotation_sd_rad": 4e-4, "force_sd_N": 0.1}
    own = {"instrument": noise | FRAME, "limits": {"force_N": 1e3, "torque_Nm": 1e2}}
    whole = diagnosable_plan(candidates, chosen, 80)
    plan, bench = simulated(whole, tmp_path, like={"hide": "payload=3"}, **own)
    out = tmp_path / "data.csv"
    table = measure(plan, bench, out, until="named", say=unsaid)
    promise = certificate(out)
    assert (promise["names"], promise["reached"]) == (["payload"], True)
    assert promise["rows"] == np.count_nonzero(table.text("kind") == "pose") < 60
    assert promise["words"][0].endswith("named was reached")
    assert promise["words"][1] == "named payload"
    # The run read its zero before the first pose: the plan's own would cost three minutes more.
    assert plan.text("kind")[0] == "unloaded"
    assert "unloaded" not in table.text("kind")
    again = measure(plan, bench, tmp_path / "again.csv", until="named", say=unsaid)
    assert again.text("approach").tolist() == table.text("approach").tolist()


def test_looks_keep_their_places_and_every_other_pose_is_the_one_that_tells_most_a_minute() -> None:
    kinds = ["unloaded", "home", *["pose"] * 15, "home", *["pose"] * 5, "unloaded"]
    plan = spring_plan(len(kinds), kind=kinds)
    rows = requests(plan, Procedure(), 0.1)

    class Worth:
        """Rows tell as much as their number; what was taken since tells nothing more."""

        def worth(self, rows: list[int], since: list[int]) -> np.ndarray:
            seen.append(since)
            return np.where(np.isin(rows, since), 0.0, rows)

    seen: list[list[int]] = []
    order: list[int] = []
    while len(order) < 100:
        row = next_row(rows, order, cast("Told", Worth()) if len(order) > 12 else None, minutes)
        assert row is not None
        order += [row.row, LOOK_HOME][: 1 + (len(order) == 3)]
    places = [row for row in order if row >= 0]
    # The twelve poses before the first diagnosis: in the order of the plan, and 9 lasts long.
    assert places[:13] == [1, *range(2, 9), *range(10, 15)]
    # The thirteenth tells most, the next is from the plan; 14 poses are diagnosed again.
    assert places[13:16] == [22, 15, 22]
    # The look after 15 poses, and that before the first again after all 20.
    assert places[16:23] == [17, 16, 22, 18, 22, 19, 1]
    # What was taken since the diagnosis of 20 tells nothing more.
    assert [since for since in seen if since][:2] == [[1], [1, 22, 20]]
    assert places[23:26] == [22, 20, 21]
    # Every other row is from the plan, and it begins again.
    looks = [i for i, row in enumerate(places) if row == 17]
    assert [sum(row not in (1, 17) for row in places[:i]) for i in looks] == [15, 35, 55, 75]
    # The zero is the run's; what lasts long comes late, and is not left out.
    assert set(places) == set(range(1, 23))
    assert 1 <= places.count(9) < min(places.count(row) for row in range(2, 9))


def minutes(row: Request) -> float:
    """All take alike long but one."""
    return 3.0 if row.row == 9 else 1.0


def test_rows_tell_of_what_the_rows_so_far_cannot_show() -> None:
    plan, rest = spring_plan(60), np.array([0.1, 0.0, 0.0, 0.0, 0.0, 0.0])
    far = plan.poses[:30] - rest
    # The second 30 are the first again; every other of them is driven to from twice as far.
    poses = np.vstack([far, far, 2.0 * far]) + rest
    ways = ["initial"] * 90
    ways[31:60:2] = [str(30 + i) for i in range(1, 30, 2)]
    text = {"approach": ways, "pose_id": [*range(30), *range(60)]}
    way = as_table(dict(zip(POSE, poses.T, strict=True)) | text, meta=plan.meta)
    pairs = np.hstack([poses, BODY().predict(poses)])[:30]
    read = dict(zip((*POSE, *WRENCH), pairs.T, strict=True))
    random = np.random.default_rng(0).standard_normal((6, 30))
    noise = np.repeat([1e-5, 1e-4, 0.05, 1e-3], 3)
    for column, kick, sd in zip((*POSE, *WRENCH), [*random, *random], noise, strict=True):
        read[column] = read[column] + sd * kick
    warm = {"time_s": 60.0 * np.arange(30), "sensor_temperature_degC": np.linspace(40.0, 41.0, 30)}
    own = {"approach": ["initial"] * 30, "pose_id": np.arange(30), "dwell_s": np.full(30, 2.0)}
    rows = as_table(read | warm | own, meta=Meta(mechanism={"length_m": 0.1}, instrument=NOISE))
    told = look_at(rows, way).told
    assert told is not None
    worth = told.worth(list(range(90)), [])
    # Beside what all of them tell of a sensor or a mass that may have changed at the end.
    assert np.median(worth[31:60:2] - worth[1:30:2]) > 0.08
    # Each is what would be read now: the rows so far say little of a sensor 20 K colder.
    assert worth[:60].max() < 5.0


def test_a_row_tells_less_once_it_is_measured_and_where_an_effect_is_not_seen() -> None:
    plan = spring_plan(60, dwell_s=[2.0, 30.0] * 30)
    for name, rest in zip(POSE, [0.1, 0.0, 0.0, 0.0, 0.0, 0.0], strict=True):
        plan = plan.with_columns({name: np.append(plan.column(name)[:-1], rest)})
    at = plan.poses[:30]
    random = np.random.default_rng(2)
    wrenches = BODY().predict(at) * np.where(np.arange(30) % 2, 0.95, 1.0)[:, None]
    wrenches += np.repeat([0.05, 1e-3], 3) * random.standard_normal((30, 6))
    read = columns_of(at, wrenches)
    read |= {"dwell_s": plan.column("dwell_s")[:30], "time_s": 10.0 * np.arange(30)}
    rows = as_table(read, meta=Meta(mechanism={"length_m": 0.1}, instrument=NOISE))
    look = look_at(rows, plan)
    assert look.names == ("stress_relaxation",)
    assert 0.0 < look.wrong < 0.5
    assert look.told is not None
    left = list(range(30, 60))
    fresh, after = (look.told.worth(left, since) for since in ([], left))
    assert (after < 0.9 * fresh).all()
    assert fresh[-1] < 0.5 * np.median(fresh)
    for count in (500, 2000):  # a loop over pairs of rows would make more calls
        wide = spring_plan(count)
        left, told = requests(wide, Procedure(), 0.1), look_at(rows, wide).told
        assert told is not None
        assert calls(next_row, left, list(range(30)), told, lambda row: 1.0) < 3 * count
        choice = NextPose(wide, "mm")
        assert calls(choice.learn, rows) < 40_000  # of either plan as many
        assert calls(choice.order, range(count), np.ones(count)) < 2_000


def calls(work: Any, *given: Any) -> int:
    """How many functions are called: what the work takes, whatever else the machine does."""
    profile = cProfile.Profile()
    profile.runcall(work, *given)
    return sum(entry.callcount for entry in profile.getstats())
