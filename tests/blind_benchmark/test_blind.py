"""The blind benchmark in short: a dozen sets of the second generator, and its own parts.

The whole is `make bench-blind`. Bounds here are such that one broken step of the procedure (noise,
ranking, acceptance, classes, what cannot be tested) does not meet them: test_blind_broken.py breaks
one after the other.
"""

from __future__ import annotations

import ast
import os
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import blind_parts
from blind_parts.analysis import (
    OURS,
    Method,
    oracle,
    our_answer,
    parameters,
    same_verdicts,
    worked_answer,
)
from blind_parts.data import Data, Sources, data_of, shared_model, shared_plan
from blind_parts.once import Work
from blind_parts.other_bodies import BODIES, stated_model
from blind_parts.plans import rod_samples
from blind_parts.print_table import table_text
from blind_parts.rod import Rod, Section
from blind_parts.rod_tables import EFFECTS, planned_visits, rod_table
from blind_parts.score import all_right, clean_wrong, honest, one_named, one_right, tier_lines
from blind_parts.second import BY_HAND, _joined, _readings, second_answer
from blind_parts.sets import ALL_SETS, STRENGTHS, Set, balanced, hideable, sets_of
from blind_parts.strange import STRANGE
from blind_parts.strength import Strength
from blind_parts.workers import run_all
from ecm.designs import follow_up_plan
from ecm.diagnosis import diagnose, find_missing
from ecm.effects import Rows, all_effects, get_effect
from ecm.effects.material import Anisotropy
from ecm.effects.registry import effects_of_actuators
from ecm.effects.sensor import FtsOffset
from ecm.io.columns import WRENCH
from ecm.io.table import as_table
from ecm.regression.noise import declared_noise
from ecm.rig.physics import TRUE_EFFECTS
from support.campaigns import model, plan
from support.neck import columns_of
from support.stand_in import StandIn

ONE = ("anisotropy", "base_compliance", "fts_offset", "payload", "temperature_modulus")


@pytest.fixture(scope="module")
def folder(blind_folder: Path) -> Path:
    return blind_folder


@lru_cache(maxsize=32)
def _data(case: Set, folder: Path) -> Data:
    return data_of(case, folder)


@pytest.fixture
def method() -> Method:
    """The procedure as it stands; test_blind_broken.py gives others."""
    return OURS


@lru_cache(maxsize=64)
def _worked(case: Set, folder: Path, method: Method = OURS) -> tuple[dict[str, Any], Work]:
    return worked_answer(case, _data(case, folder), method=method)


def result_of(case: Set, folder: Path, method: Method = OURS) -> dict[str, Any]:
    return {"set": case.to_dict(), "ours": _worked(case, folder, method)[0]}


# --- the procedure ------------------------------------------------------------------------------
def test_one_effect_is_named_and_its_parameters_are_right(folder: Path, method: Method) -> None:
    right, ratios, inside, of = 0, [], 0, 0
    for i, id in enumerate(ONE):
        case = Set(1, 900 + i, "rod", hidden=((id, 1.0),))
        result, data = result_of(case, folder, method), _data(case, folder)
        right += one_right(result)
        best = oracle(case, _worked(case, folder, method)[1].problem)
        assert best is not None
        ratios.append(result["ours"]["held_out"]["after"] / best)
        for found in parameters(case, data, result["ours"]):
            inside, of = inside + found["inside"], of + found["of"]
            assert found["relative_error"] < 0.25, found
    assert right >= len(ONE) - 1
    assert float(np.median(ratios)) <= 1.02
    assert of >= 6
    assert inside / of >= 0.6


def test_nothing_hidden_is_given_no_name(folder: Path, method: Method) -> None:
    for i, variant in enumerate(("", "noise")):
        answer = result_of(Set(0, 900 + i, "rod", variant=variant), folder, method)["ours"]
        assert answer["answer"] == []
        assert answer["verdict"] == "none"


def test_weak_effects_bring_hardly_a_wrong_name(folder: Path) -> None:
    """At a third of the noise on 120 rows: what most draws of rows do not choose is not said."""
    right = wrong = 0
    for i, id in enumerate(("payload", "hysteresis", "fts_drift", "tip_frame_misalignment") * 2):
        answer = result_of(Set(1, 980 + i, "rod", hidden=((id, 0.3),)), folder)["ours"]["answer"]
        right += len(answer) == 1 and id in answer[0]
        wrong += any(id not in members for members in answer)
    assert wrong <= 1
    assert right >= 4


def test_two_effects_are_both_found(folder: Path) -> None:
    case = Set(2, 900, "rod", hidden=(("payload", 1.0), ("temperature_modulus", 1.0)))
    assert all_right(result_of(case, folder))


def test_what_is_not_in_the_library_is_unknown(folder: Path, method: Method) -> None:
    removed = Set(3, 920, "rod", hidden=(("hysteresis", 1.0),), removed=("hysteresis",))
    foreign = Set(3, 935, "rod", strange="mains_beat", strength=1.0)
    for case in (removed, foreign):
        result = result_of(case, folder, method)
        assert result["ours"]["verdict"] in ("unknown", "family"), result["ours"]["answer"]
        assert not clean_wrong(result)


def late(case: Set, folder: Path) -> Data:
    """A sensor that is off by a constant in the last fifth of the campaign."""
    data = _data(replace(case, removed=()), folder)
    time = data.table.column("time_s")
    rows = Rows(data.table, shared_model("rod").base)
    shift = get_effect("fts_offset").correction(rows, 3.3 * np.repeat([0.3, 0.01], 3))
    wrenches = data.table.wrenches + shift * (time > np.quantile(time, 0.8))[:, None]
    return replace(data, table=data.table.with_columns(dict(zip(WRENCH, wrenches.T, strict=True))))


def test_what_held_out_rows_contradict_is_not_accepted(folder: Path, method: Method) -> None:
    """Fitted to all rows a constant explains much of it; no block of time tells it of another.

    The form that begins at a moment, which is what is hidden, is not asked here.
    """
    others = tuple(effect.id for effect in all_effects() if effect.id != "fts_offset")
    case = Set(0, 900, "rod", protocol="paper", removed=others)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(FtsOffset, "variants", lambda self, table: (FtsOffset(),))
        answer = our_answer(case, late(case, folder), method=method)
    assert answer["first"] == ["fts_offset"]
    assert answer["verdict"] == "family"
    assert answer["effects"] == []
    assert answer["held_out"]["after"] <= answer["held_out"]["before"]


def test_the_noise_of_a_row_is_the_generator_s(folder: Path, method: Method) -> None:
    """W Sigma W' of the rod's own covariance is 1 in every direction, not only on its diagonal."""
    case = Set(0, 900, "rod")
    problem = _worked(case, folder, method)[1].problem
    base = shared_model("rod").base
    made = rod_table(
        shared_plan("rod", "diagnosable", folder), (), case.seed, base_columns=base.columns
    )
    whitener = problem.whitener.each[problem.scored]
    found = np.linalg.eigvalsh(whitener @ made.covariance @ np.swapaxes(whitener, 1, 2))
    assert found.shape == (len(problem.scored.nonzero()[0]), 6)
    assert np.quantile(found, 0.02) > 0.5
    assert np.quantile(found, 0.98) < 1.6
    # The four figures are estimated, their ratio with them; the directions are not.
    assert np.quantile(found[:, -1] / found[:, 0], 0.9) < 2.3


def test_the_paper_s_protocol_cannot_test_hysteresis(folder: Path, method: Method) -> None:
    case = Set(4, 900, "rod", hidden=(("hysteresis", 1.0),), protocol="paper")
    result = result_of(case, folder, method)
    assert honest(result)
    assert "hysteresis" in {item["id"] for item in result["ours"]["not_testable"]}


def test_the_rig_s_generator_on_a_closed_form(folder: Path) -> None:
    """The sets of the rig as the benchmark makes them, but for FEM."""
    sources = Sources(
        plan=lambda *_: plan(),
        model=lambda _: model(),
        plant=lambda _: StandIn(),
        cache=lambda: folder,
    )
    named = Set(1, 960, "rig", hidden=(("fts_frame", 1.0),))
    nothing = Set(0, 960, "rig")
    data = data_of(named, folder, sources=sources)
    result = {"set": named.to_dict(), "ours": our_answer(named, data)}
    assert one_right(result), result["ours"]["answer"]
    (found,) = parameters(named, data, result["ours"])
    assert found["relative_error"] < 0.25
    assert our_answer(nothing, data_of(nothing, folder, sources=sources))["verdict"] == "none"


def test_the_answer_does_not_look_at_the_truth(folder: Path) -> None:
    case = Set(1, 903, "rod", hidden=(("payload", 1.0),))
    data = _data(case, folder)
    sealed = replace(data, quiet=data.table.select(np.arange(0)), truth={})
    nobody = replace(case, tier=0, index=0, hidden=())
    full, blind = _worked(case, folder)[0], our_answer(nobody, sealed)
    assert {**full, "seconds": 0.0} == {**blind, "seconds": 0.0}
    clean = _data(Set(0, 900, "rod"), folder).table
    assert data.table.meta == clean.meta
    assert list(data.table.columns) == list(clean.columns)


def test_other_seeds_of_the_analysis_give_the_same(folder: Path) -> None:
    case = Set(1, 900, "rod", hidden=((ONE[0], 1.0),))
    data, (first, work) = _data(case, folder), _worked(case, folder)
    assert same_verdicts(case, data, first, work) == 1.0


def test_what_is_replayed_is_what_a_whole_analysis_says(folder: Path) -> None:
    case = Set(2, 900, "rod", hidden=(("payload", 1.0), ("temperature_modulus", 1.0)))
    data, (_, work) = _data(case, folder), _worked(case, folder)
    full = diagnose(data.model, data.table, seed=3)
    again = find_missing(data.model, data.table, seed=3, stages=work.replaying())
    assert (again.verdict, again.answer) == (full.verdict, full.answer)
    assert again.accepted.checks == full.checks
    assert again.problem is work.problem


def test_a_class_is_told_apart_by_the_experiment_that_is_proposed(
    folder: Path, method: Method
) -> None:
    case = Set(5, 900, "rod", hidden=(("face_tilt", 1.0),))
    data = _data(case, folder)
    first = our_answer(case, data, method=method)
    assert first["verdict"] == "ambiguous", first["answer"]
    second = second_answer(case, data, first, folder)
    assert second is not None
    assert one_named({"set": case.to_dict(), "second": second}, "second"), second["answer"]


@pytest.mark.parametrize(
    ("hidden", "wrong"), [("base_compliance", "debonding"), ("taper", "cable_drag")]
)
def test_a_name_needs_its_own_sign(hidden: str, wrong: str, folder: Path) -> None:
    """A spring is no bond that opens, and a softer body is no cable, which pulls to a side."""
    case = Set(3, 903, "rod", hidden=((hidden, 1.0),), removed=(hidden,))
    report = our_answer(case, _data(case, folder))
    assert report["first"][0] == wrong
    assert not clean_wrong({"set": case.to_dict(), "ours": report}), report["answer"]


@pytest.mark.parametrize("gap_m", [0.0, 4e-4])
def test_a_measurement_by_hand_confirms_or_rules_out(folder: Path, gap_m: float) -> None:
    """A calliper reads the length's own error; what it does not show is out of question."""
    case = Set(5, 901, "rod", hidden=(("payload", 1.0),))
    data = replace(_data(case, folder), truth={"length_error": gap_m})
    first = {
        "verdict": "ambiguous",
        "answer": [["base_frame_misalignment", "length_error"]],
        "next_experiment": [{"action": "calliper"}],
    }
    second = second_answer(case, data, first, folder)
    assert second is not None
    assert second["done"] == "calliper"
    if gap_m:
        assert second["answer"] == [["length_error"]]
    else:
        assert len(second["answer"]) == 1
        assert "payload" in second["answer"][0]
        assert "length_error" not in second["answer"][0]
    known = {effect.id for effect in all_effects()}
    assert {id for read in BY_HAND.values() for id in read} <= known


@pytest.mark.parametrize("turn_rad", [0.0, 0.05])
def test_what_a_reading_by_hand_says_of_a_need_in_another_unit(
    folder: Path, turn_rad: float
) -> None:
    """Nothing of what is there; what is not there reads zero in each unit of the tool."""
    id = "base_frame_misalignment"
    case = Set(5, 901, "rod", hidden=(("payload", 1.0),))
    data = replace(_data(case, folder), truth={id: turn_rad} if turn_rad else {})
    read, decided = BY_HAND["base_survey"], ([id], []) if turn_rad else ([], [id])
    for unit, expected in (("m", decided), ("rad", decided), ("N", (decided[0], []))):
        assert _readings(case, data, {"needed": {id: (1e-2, unit)}}, read) == expected


def test_unknown_of_the_joint_data_stays_whatever_is_read_by_hand(folder: Path) -> None:
    case = Set(5, 901, "rod", hidden=(("payload", 1.0),))
    data = replace(_data(case, folder), truth={"length_error": 4e-4})
    unknown = {"verdict": "unknown", "answer": []}
    first = {
        "verdict": "ambiguous",
        "answer": [["base_frame_misalignment", "length_error"]],
        "next_experiment": [{"action": "calliper + a pair of push and pull poses"}],
    }
    second = second_answer(case, data, first, folder, answer=lambda *_, **__: unknown)
    assert second is not None
    assert (second["verdict"], second["answer"]) == ("unknown", [])


# --- the second generator -----------------------------------------------------------------------
def test_the_rod_shares_no_code_with_the_library() -> None:
    folder = Path(blind_parts.__file__).parent
    allowed = {"rod_tables.py": {"ecm.io.columns", "ecm.io.description", "ecm.io.table"}}
    files = sorted(folder.glob("rod*.py"))
    assert len(files) >= 5
    for file in files:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            names = []
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                names = [node.module or ""]
            ours = {n for n in names if n == "ecm" or n.startswith("ecm.")}
            assert ours <= allowed.get(file.name, set()), (file.name, ours)


def test_two_rods_written_apart_agree() -> None:
    poses, wrenches = rod_samples(40, 3)
    found = Rod(Section()).solve(poses, np.zeros(len(poses))).wrench
    assert found == pytest.approx(wrenches, rel=1e-3, abs=2e-3)


def test_the_strength_is_that_of_the_definition(folder: Path) -> None:
    """s^2 is what the whitened effect adds to the residual's mean square beyond the base."""
    case = Set(1, 950, "rod", hidden=(("fts_offset", 2.0),))
    data = _data(case, folder)
    base = shared_model("rod").base
    rows = Rows(data.quiet, base)
    is_pose = np.asarray(data.quiet.text("kind") == "pose")
    excess = (data.quiet.wrenches - rows.wrench)[is_pose]
    covariance = declared_noise(data.table).covariance(rows)[is_pose]
    scale = Strength(covariance, np.asarray(base.columns(rows.poses))[is_pose])
    # The declared figures leave out the lever between sensor and top, hence the tolerance.
    assert scale(excess) == pytest.approx(2.0, rel=0.2)


def test_a_remount_turns_the_body_and_a_dead_weight_is_a_run_of_its_own(folder: Path) -> None:
    rod = Rod(Section(face_tilt=(0.02, 0.0)))
    pose = np.array([[0.1, 0.0, 0.0, 0.0, 0.0, 0.0]])
    plain, half, whole = (
        rod.solve(pose, np.array([angle])).wrench[0] for angle in (0.0, np.pi, 2.0 * np.pi)
    )
    assert whole == pytest.approx(plain, abs=1e-6)
    # Half a turn about x changes the sign of what stands across it.
    assert half == pytest.approx(plain * [1, -1, -1, 1, -1, -1], abs=1e-6)
    assert abs(plain[4]) > 0.01
    data = _data(Set(1, 951, "rod", hidden=(("hysteresis", 1.0),)), folder)
    case = planned_visits(follow_up_plan(data.table, "dead weights"))
    hung = case.dead_weight_kg > 0.0
    assert len(set(case.run[hung].tolist())) == hung.sum() == 7
    assert not set(case.run[hung].tolist()) & set(case.run[~hung].tolist())


@pytest.mark.parametrize("experiment", ["remount turned by 180 degrees", "dead weights"])
def test_a_second_campaign_alone_gives_no_name(experiment: str, folder: Path) -> None:
    """Nothing hidden: the joined data of a remount or of weights are as clean as the first."""
    case = Set(5, 902, "rod", protocol="plain")
    data = _data(case, folder)
    plan = follow_up_plan(data.table, experiment)
    more = data_of(case, folder, plan, data.truth)
    joined = replace(data, table=_joined(data.table, more.table))
    assert our_answer(case, joined)["answer"] == []


def test_the_same_seed_gives_the_same_table(folder: Path) -> None:
    case = Set(1, 951, "rod", hidden=(("hysteresis", 1.0),))
    first, again = data_of(case, folder).table, data_of(case, folder).table
    assert np.array_equal(first.wrenches, again.wrenches)
    assert np.array_equal(first.poses, again.poses)


# --- sets and scores ----------------------------------------------------------------------------
def test_thirty_effects_can_be_hidden_and_named() -> None:
    known = {effect.id for effect in (*all_effects(), *effects_of_actuators())}
    assert len(set(hideable("rig")) | set(hideable("rod"))) >= 30
    assert set(EFFECTS) | set(TRUE_EFFECTS) <= known
    assert len(STRANGE) >= 5


def test_a_run_that_stops_early_is_a_sample_of_all() -> None:
    everything = balanced([one for tier in ALL_SETS for one in sets_of(tier)])
    assert len(everything) == sum(ALL_SETS.values())
    third = everything[: len(everything) // 3]
    for tier, count in ALL_SETS.items():
        assert sum(one.tier == tier for one in third) == pytest.approx(count / 3.0, rel=0.15, abs=4)
    ones = [one.hidden[0][1] for one in third if one.tier == 1]
    assert all(ones.count(s) == pytest.approx(50, abs=2) for s in STRENGTHS)
    for source in ("rig", "rod"):
        of_source = sum(one.source == source for one in everything)
        assert sum(one.source == source for one in third) == pytest.approx(of_source / 3.0, abs=8)
    # A round holds each strength from both sources: --every K takes whole rounds.
    first = [one for one in sets_of(1) if one.round == 0]
    assert len({(one.source, one.hidden[0][1]) for one in first}) == len(first) == 10


def _write(task: tuple[str, str]) -> None:
    folder, name = task
    if name == "2":
        raise ValueError("two")
    Path(folder, name).write_text(name * 3, encoding="utf-8")


def _write_or_die(task: tuple[str, str]) -> None:
    if task[1] == "2":
        os._exit(1)
    _write(task)


def test_a_process_that_is_killed_costs_what_it_ran_and_no_more(tmp_path: Path) -> None:
    tasks = [(str(tmp_path), str(i)) for i in range(7)]
    failed = run_all(tasks, _write_or_die, workers=2)
    assert tasks[2] in failed
    assert len(failed) <= 2  # the other process ran a task of its own
    lost = {name for _, name in failed}
    assert {f.name for f in tmp_path.iterdir()} | lost == set("0123456")


@pytest.mark.parametrize("workers", [1, 2])
def test_any_number_of_processes_writes_the_same_files(
    tmp_path: Path, workers: int, capsys: pytest.CaptureFixture[str]
) -> None:
    tasks = [(str(tmp_path), str(i)) for i in range(6)]
    calls: list[int] = []
    failed = run_all(
        tasks, _write, workers=workers, progress=lambda done, left_s: calls.append(done)
    )
    assert failed == [tasks[2]]
    assert "ValueError: two" in capsys.readouterr().err
    assert calls == [1, 2, 3, 4, 5, 6]
    written = {f.name: f.read_text(encoding="utf-8") for f in tmp_path.iterdir()}
    assert written == {i: i * 3 for i in "01345"}
    assert run_all(tasks, _write, workers=workers, seconds=-1.0) == []


@pytest.mark.parametrize(
    ("answer", "first", "wrong"),
    [
        ([["a"]], True, False),
        ([["b", "a"]], True, False),
        ([["b"]], False, True),
        ([["a", "b", "c", "d"]], False, False),
        ([["a"], ["b"]], False, False),
        ([], False, False),
    ],
)
def test_scores_of_one_effect(answer: list[list[str]], first: bool, wrong: bool) -> None:
    result = {
        "set": {"tier": 1, "hidden": [["a", 1.0]], "strength": 0.0},
        "ours": {"verdict": "named", "answer": answer},
    }
    assert one_right(result) is first
    assert clean_wrong(result) is wrong


def test_not_testable_beside_a_clean_wrong_name_is_not_honest() -> None:
    listed = [{"id": "a"}]
    result: dict[str, Any] = {"set": {"tier": 4, "hidden": [["a", 1.0]], "strength": 0.0}}
    for answer, good in (([], True), ([["b"]], False), ([["b", "a"]], True), ([["b", "c"]], True)):
        result["ours"] = {"verdict": "", "answer": answer, "not_testable": listed}
        assert honest(result) is good
    # Without a word that it cannot be tested its own name is right all the same.
    for answer, good in (([], False), ([["a"]], True), ([["b", "a"]], True), ([["b", "c"]], False)):
        result["ours"] = {"verdict": "", "answer": answer}
        assert honest(result) is good


def _timed(result: dict[str, Any]) -> dict[str, Any]:
    held = {"before": 2.0, "after": 1.0}
    return {"ours": {**result["ours"], "seconds": 1.0, "held_out": held}}


def test_the_table_counts_what_was_run() -> None:
    def made(s: float, right: bool) -> dict[str, Any]:
        answer = [["a"]] if right else []
        return {
            "set": {"tier": 1, "index": 0, "source": "rod", "hidden": [["a", s]], "strength": 0.0},
            "ours": {"verdict": "named", "answer": answer},
        }

    lines = tier_lines([made(1.0, True)] * 3 + [made(1.0, False)])
    assert len(lines) == 1
    assert lines[0]["sets"] == 4
    assert lines[0]["value"] == 0.75
    some = [made(1.0, True), made(1.0, False)]
    text, document = table_text([{**r, "seconds": 1.0, **_timed(r)} for r in some])
    assert "| 2 | >= 0.98 | 0.50 | no |" in text
    assert document["tiers"][0]["sets"] == 2
    assert lines[0]["met"] is False


def test_the_catalogue_knows_the_anisotropy_of_a_rod(folder: Path) -> None:
    """Also along the axis: what bends shortens as much, whichever plane is stiffer."""
    body = BODIES["soft"]
    seen = body.visited(60, np.random.default_rng(3), folder)
    change = body.changed(seen, uneven=0.03, uneven_angle_rad=0.7) - seen.wrenches
    mechanism = body.mechanism()
    stated = stated_model(mechanism)
    assert stated is not None
    read = columns_of(seen.poses, seen.wrenches)
    rows = Rows(as_table(read, meta={"mechanism": mechanism}), stated.base)
    size = np.repeat([np.sqrt((change[:, j : j + 3] ** 2).mean()) for j in (0, 3)], 3)
    y = (change / size).ravel()
    left = {}
    for form in ("bending", "stretched"):  # as it was
        parts = [Anisotropy(form=form).correction(rows, unit) for unit in 1e-3 * np.eye(2)]
        x = (np.stack(parts, axis=2) / size[:, None]).reshape(-1, 2)
        error = y - x @ np.linalg.lstsq(x, y, rcond=None)[0]
        left[form] = float(error @ error) / float(y @ y)
    assert left["bending"] < 0.03
    assert left["stretched"] > 0.3
