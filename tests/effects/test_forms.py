"""Forms with a shape of their own: limits in which they must be another, known one."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy import special

from ecm.diagnosis.problem import assemble
from ecm.diagnosis.procedure import find_missing
from ecm.diagnosis.search import all_needed, delta_chi2, own_sign, rank, search
from ecm.effects import Rows, all_effects, get_effect
from ecm.effects.ageing import MullinsSoftening
from ecm.effects.contact import BaseCompliance, Debonding, PlatformSlip
from ecm.effects.frames import LedOcclusion, line_of_sight
from ecm.effects.friction import Hysteresis
from ecm.effects.load import CableDrag
from ecm.effects.material import DiameterError, PreCurvature, StrainStiffening
from ecm.effects.protocol import missing_beside_columns
from ecm.effects.relaxation import StressRelaxation
from ecm.effects.rod import rest_stiffness
from ecm.effects.sensor import FtsHysteresis
from ecm.io.columns import POSE, WRENCH
from ecm.io.description import Meta
from ecm.io.se3 import skew
from ecm.io.table import Table, as_table
from ecm.models import Model
from ecm.models.fit import choose_base
from ecm.regression.f_test import explained_by_span
from ecm.regression.folds import without_zero_readings
from ecm.regression.history import order_of_visits, pose_before
from ecm.regression.normal_equations import (
    NormalEquations,
    explained_by_blocks,
    explained_squares,
)
from ecm.rig import CampaignOptions, RigSettings, run_campaign
from support.campaigns import META, NOISE, campaign, model, physics, plan, workspace_poses
from support.neck import columns_of
from support.stand_in import L, StandIn, wrench


@pytest.fixture(scope="module")
def rows() -> Rows:
    return Rows(campaign(), physics())


def at(*poses: tuple[float, ...]) -> Rows:
    """Rows at given changes of the rest pose."""
    values = np.array(poses) + np.array([L, 0.0, 0.0, 0.0, 0.0, 0.0])
    columns = {name: values[:, j] for j, name in enumerate(POSE)}
    return Rows(Table(columns, Meta(mechanism={"length_m": L}), "poses"), physics())


def test_a_thicker_beam_grows_by_2_along_and_4_in_bending_and_torsion() -> None:
    small = at((1e-5, 0, 0, 0, 0, 0), (0, 0, 0, 1e-4, 0, 0), (0, 0, 0, 0, 0, 1e-4))
    change = DiameterError("beam").correction(small, np.array([1.0]))
    ratio = change / np.where(np.abs(small.wrench) > 1e-6, small.wrench, np.inf)
    assert ratio[0, 0] == pytest.approx(2.0, abs=0.02)
    assert ratio[1, 3] == pytest.approx(4.0, abs=0.02)
    # A turn of the top alone bends and, by half its lever, shifts: between 2 of shear and 4.
    assert 3.0 < ratio[2, 5] <= 4.01


def test_an_open_joint_is_a_yielding_base(rows: Rows) -> None:
    """With all of it open the hinge is the bending compliance of the base, wrench turned too."""
    hinge = Debonding("hinge", 0.0, 1e6, 1e-6).jacobian(rows, np.zeros(2))[:, :, 0]
    yields = BaseCompliance().jacobian(rows, np.zeros(3))[:, :, 0]
    assert np.abs(hinge - yields).max() < 0.01 * np.abs(yields).max()


def test_a_gap_opens_in_tension_alone(rows: Rows) -> None:
    column = Debonding("gap_base").columns(rows)[:, :, 0]
    pulled = rows.wrench[:, 0] > 0.0
    assert np.abs(column[pulled]).max() > 0.0
    assert np.abs(column[~pulled]).max() == 0.0


def test_yielding_elements_slip_behind_the_way(rows: Rows) -> None:
    """After a way much longer than that to the slip they stand full, towards where it went."""
    column = Hysteresis("each", 1e-6).columns(rows)
    came = pose_before(rows.table, rows.rest_pose)
    step = rows.poses - came
    known = np.isfinite(step).all(axis=1)
    force = column[known, 0, 0]
    moved = np.abs(step[known, 0]) > 2e-6
    assert known.sum() > 100
    assert np.all(np.sign(force[moved]) == np.sign(step[known, 0][moved]))
    assert np.ptp(np.abs(force[moved])) < 1e-9 * np.abs(force).max()


def test_relaxation_over_visits_is_that_at_rest_when_all_else_has_decayed(rows: Rows) -> None:
    """With a time constant far below the pause between visits only the last approach counts."""
    tau = 1.0
    visits = StressRelaxation(tau, path="visits").columns(rows)[:, :, 0]
    dwell = rows.table.column("dwell_s")
    compared = 0
    for before, now in pairwise(order_of_visits(rows.table)[0].tolist()):
        travel = rows.table.column("time_s")[now] - dwell[now] - rows.table.column("time_s")[before]
        if not np.isfinite(dwell[now]) or travel < 10.0 * tau or rows.unloaded[now]:
            continue
        # What the last leg added and a leg at constant speed has kept of it.
        leg = 0.5 * travel
        came = pose_before(rows.table, rows.rest_pose)[now]
        from_ = physics().predict(came[None, :])[0] if np.isfinite(came).all() else rows.wrench[now]
        kept = tau / leg * (1.0 - np.exp(-leg / tau))
        wanted = (rows.wrench[now] - from_) * kept * np.exp(-dwell[now] / tau)
        assert np.abs(visits[now] - wanted).max() < 1e-2 * np.abs(rows.wrench[now]).max()
        compared += 1
    assert compared > 5


def test_the_first_pose_came_from_rest_wherever_that_was(rows: Rows) -> None:
    """Without a recorded approach it was held for ever, and the slowest branch erred for hours."""
    names = (*POSE, *WRENCH, "time_s", "dwell_s")
    columns = {name: rows.table.column(name)[2:12] for name in names}
    columns["dwell_s"] = np.full(10, 40.0)
    late = Rows(as_table(columns, meta=Meta(mechanism={"length_m": L})), physics())
    visits = StressRelaxation(600.0, path="visits").columns(late)[0, :, 0]
    assert visits == pytest.approx(late.material_wrench[0] * np.exp(-40.0 / 600.0))


@pytest.mark.parametrize("path", ["", "visits"])
def test_two_branches_of_a_campaign_are_two_effects_of_one_branch(rows: Rows, path: str) -> None:
    both = StressRelaxation(1.0, second_tau_s=20.0, path=path)
    assert [parameter.name for parameter in both.parameters] == ["g", "g_second"]
    single = [StressRelaxation(tau, path=path).columns(rows)[:, :, 0] for tau in (1.0, 20.0)]
    assert np.array_equal(both.columns(rows), np.stack(single, axis=2))
    forms = both.variants(rows.table)
    assert all((form.branches, form.path) == (2, path) for form in forms)  # type: ignore[attr-defined]
    assert all(form.second_tau_s > 2.0 * form.tau_s for form in forms)  # type: ignore[attr-defined]


def test_the_sensors_play_at_its_zero_shifts_all_readings_around_it() -> None:
    table = campaign(seed=5)
    effect, base = FtsHysteresis(0.5, "each"), physics()
    zeroed = Rows(table, base)
    lag = effect.columns(zeroed)
    assert np.all(lag[zeroed.unloaded] == 0.0)
    # The readings themselves may be left out: their times tell.
    kept = without_zero_readings(table)
    assert len(kept) < len(table)
    np.testing.assert_allclose(effect.columns(Rows(kept, base)), lag[~zeroed.unloaded])
    # Where the free sensor reads something the zero is another.
    noise = np.where(zeroed.unloaded, 1e-3, 0.0)
    read = Rows(table.replace(fx_N=table.column("fx_N") + noise), base)
    apart = np.einsum("nji,njk->nik", zeroed.base_from_top, effect.columns(read) - lag)
    times, at = table.column("time_s"), np.flatnonzero(zeroed.unloaded)
    for axis in range(6):
        line = np.interp(times, times[at], apart[at, axis, axis])
        np.testing.assert_allclose(apart[:, axis, axis], line, atol=1e-12)
    assert np.ptp(apart[:, 0, 0]) > 0.1


def test_the_line_of_sight_is_the_turn_that_hides_no_marker() -> None:
    turns = np.random.default_rng(1).uniform(-0.6, 0.6, (200, 3))
    sight = np.array([0.2, 0.4, np.sqrt(0.8)])
    lean = np.linalg.norm(np.cross(turns, sight), axis=1)
    seen = 9.0 - np.floor(np.clip((lean - 0.2) / 0.12, 0.0, 5.0))
    columns = dict(zip(POSE[3:], turns.T, strict=True)) | dict.fromkeys(POSE[:3], np.zeros(200))
    table = Table(columns | {"leds_visible": seen}, Meta(), "turns")
    assert line_of_sight(table) @ sight > np.cos(0.05)


def test_markers_off_their_places_bias_a_pose_as_the_fit_of_those_left(rows: Rows) -> None:
    """Nine markers of any error: three waves around the line of sight hold nearly all of it."""
    random = np.random.default_rng(2)
    sight = np.array([0.0, 0.6, 0.8])
    place = np.concatenate([[sight], sight + 0.5 * random.uniform(-1.0, 1.0, (8, 3))]) * 0.05
    off = 1e-4 * random.standard_normal((9, 3))
    rigid = np.concatenate([np.tile(np.eye(3), (9, 1, 1)), -skew(place)], axis=2)
    off -= rigid @ np.linalg.lstsq(rigid.reshape(-1, 6), off.ravel(), rcond=None)[0]
    toward = np.einsum("nji,j->ni", rows.rotation, sight)
    visible = toward @ (place / np.linalg.norm(place, axis=1)[:, None]).T > 0.8
    visible |= visible.sum(axis=1, keepdims=True) < 5
    motions = np.stack(
        [np.linalg.lstsq(rigid[v].reshape(-1, 6), off[v].ravel(), rcond=None)[0] for v in visible]
    )
    table = rows.table.with_columns({"leds_visible": visible.sum(axis=1).astype(np.float64)})
    seen = Rows(table, rows.base)
    bias = -np.einsum("nij,njk,nk->ni", seen.screw_stiffness, seen.base_from_top, motions)
    weight = 1.0 / np.abs(bias).max(axis=0)
    left = []
    for waves in range(4):
        columns = LedOcclusion(waves, 9.0, *sight).columns(seen)
        assert columns.shape[2] == 6 + 12 * waves
        assert np.all(columns[visible.all(axis=1)] == 0.0)
        flat = (columns * weight[:, None]).reshape(-1, columns.shape[2])
        fitted = np.linalg.lstsq(flat, (bias * weight).ravel(), rcond=None)[0]
        left.append(np.linalg.norm((bias * weight).ravel() - flat @ fitted))
    assert left[0] > 1.5 * left[3]
    assert left[3] < 0.6 * np.linalg.norm(bias * weight)


def test_a_slip_carries_the_force_along(rows: Rows) -> None:
    """The end stands at r - R d, and its force acts there: tau' = tau - R d x f."""
    d = np.array([3e-6, -2e-6, 1e-6])
    column = PlatformSlip(-1.0).columns(rows)[:, :, :3] @ d
    moved = rows.rotation @ d
    felt = rows.poses.copy()
    felt[:, :3] -= moved
    wrench = rows.predict(felt)
    wrench[:, 3:] -= np.cross(moved, wrench[:, :3])
    change = wrench - rows.wrench
    assert np.abs(column - change).max(axis=0) == pytest.approx(
        np.zeros(6), abs=2e-3 * np.abs(change).max()
    )
    lever = np.abs(np.cross(moved, rows.wrench[:, :3])).max()
    assert np.abs(column - change)[:, 3:].max() < 0.05 * lever


@pytest.mark.parametrize("measure", ["energy", "bend", "reach"])
def test_mullins_loss_is_zero_at_the_largest_load(rows: Rows, measure: str) -> None:
    for width in (0.0, 0.7):
        column = MullinsSoftening(width, measure).columns(rows)[:, :, 0]
        first = order_of_visits(rows.table)[0]
        loaded = [i for i in first if np.abs(rows.wrench[i]).max() > 1.0]
        # The first loaded row is the largest so far; some later ones are not.
        assert np.abs(column[loaded[0]]).max() < 1e-6 * np.abs(rows.wrench[loaded[0]]).max()
        assert np.abs(column).max() > 0.05 * np.abs(rows.wrench).max()


@pytest.mark.parametrize("memory", [True, False])
def test_softening_is_what_a_memory_explains(memory: bool) -> None:
    """A body that is softer below the largest of all loads before it came, too, has no memory."""
    poses = workspace_poses(60, 5)
    read = wrench(poses)
    energy = np.abs((read * (poses - [L, 0.0, 0.0, 0.0, 0.0, 0.0])).sum(axis=1))
    largest = np.maximum.accumulate(energy) if memory else np.full(60, energy.max())
    read = read * (1.0 - 0.05 * special.erf((largest - energy) / energy.mean()))[:, None]
    read += NOISE * np.random.default_rng(2).standard_normal(read.shape)
    table = as_table(columns_of(poses, read) | {"time_s": 20.0 * np.arange(60.0)}, meta=META)
    problem = assemble(physics(), table, [MullinsSoftening()])
    (item,) = search(problem, rank(problem))
    assert item.id == "mullins_softening"
    assert own_sign(problem, (item,), item)[0] == memory


def test_a_cable_at_the_rim_pulls_along_its_side(rows: Rows) -> None:
    columns = CableDrag(0.0).columns(rows)
    assert np.allclose(columns[:, [0, 2], 3], 0.0)
    # Opposite sides: a spring is the same, its growth changes sign.
    other = CableDrag(np.pi).columns(rows)
    assert np.abs(columns[:, 1, 3] - other[:, 1, 3]).max() < 0.5 * np.abs(columns[:, 1, 3]).max()


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_what_gets_softer_towards_both_sides_is_no_cable(way: float) -> None:
    """Its stiffness would be negative at the ends; three ribs on a body were named so at .9."""
    poses = workspace_poses(60, 5)
    read = wrench(poses)
    read[:, 1] += way * 3e4 * poses[:, 1] * np.abs(poses[:, 1])
    read += NOISE * np.random.default_rng(2).standard_normal(read.shape)
    table = as_table(columns_of(poses, read) | {"time_s": 20.0 * np.arange(60.0)}, meta=META)
    found = find_missing(Model(base=physics()), table, effects=["cable_drag"])
    assert found.answer == ((("cable_drag",),) if way > 0.0 else ())


def test_a_cable_is_tested_with_forces_alone(rows: Rows) -> None:
    """From a rim whose radius is that of the torques it could not be."""
    few = rows.table.drop(*WRENCH[3:])
    assert few.wrench_columns == WRENCH[:3]
    for table, azimuths in ((few, 1), (rows.table, 8)):
        forms = get_effect("cable_drag").variants(table)
        assert len({form.shape.get("azimuth_rad") for form in forms}) == azimuths
        assert missing_beside_columns(forms[0], table) is None


def test_the_series_holds_the_odd_law(rows: Rows) -> None:
    """psi = (e^2 + gamma^2 / 3)^2 / 4 is e^4 / 4 + e^2 gamma^2 / 6 + gamma^4 / 36."""
    series = StrainStiffening("series").columns(rows)
    odd = StrainStiffening("odd").columns(rows)[:, :, 0]
    left = odd - series[:, :, :3] @ np.array([1.0, 1.0 / 3.0, 1.0 / 9.0])
    assert np.abs(left).max() < 1e-9 * np.abs(odd).max()


def test_a_secant_section_is_stiffer_by_the_square_of_its_bend() -> None:
    """An arc: M = E I kappa (r kappa / e0)^2, and neither torsion nor lateral shear."""
    angle = 0.02
    arc = at((L * (np.cos(0.5 * angle) - 1.0), L * np.sin(0.5 * angle), 0.0, 0.0, 0.0, angle))
    columns = StrainStiffening("sections").columns(arc)[0]
    known = rest_stiffness(arc)
    rim = known.radius_m * angle / L
    assert columns[5, 1] == pytest.approx(known.bending * angle * (rim / 0.1) ** 2, rel=1e-2)
    assert np.abs(columns[:, 2:]).max() < 1e-9 * columns[5, 1]


# --- arithmetic of the search -------------------------------------------------------------------
def test_what_dependent_columns_explain_does_not_depend_on_their_order() -> None:
    random = np.random.default_rng(0)
    a = random.standard_normal((120, 12))
    a = np.concatenate([a[:, :6], a[:, :4] @ random.standard_normal((4, 5)), a[:, 6:]], axis=1)
    y = random.standard_normal(120)
    fitted = a @ np.linalg.lstsq(a, y, rcond=1e-10)[0]
    for order in (np.arange(17), random.permutation(17)):
        found, rank = explained_by_span(a[:, order], y)
        assert rank == 12
        assert found == pytest.approx(float(fitted @ fitted), rel=1e-9)


def test_gains_beside_fixed_columns_are_those_of_whole_fits() -> None:
    random = np.random.default_rng(1)
    design, y = random.standard_normal((40, 2, 9)), random.standard_normal((40, 2))
    groups = np.repeat(np.arange(10), 4)
    gram = NormalEquations.of(design, y, groups, random.uniform(0.5, 1.0, 40))
    matrix, vector, _ = gram.total
    assert np.allclose(gram.rows().T @ gram.rows(), matrix)
    assert np.allclose(gram.rows((3, 1)), gram.rows()[:, [3, 1]])
    found = explained_by_blocks(matrix, vector, (0, 1), [(2,), (3, 4), (5, 6), (8,)])
    for gain, block in zip(found, [(2,), (3, 4), (5, 6), (8,)], strict=True):
        whole = explained_squares(matrix, vector, (0, 1, *block)) - explained_squares(
            matrix, vector, (0, 1)
        )
        assert gain == pytest.approx(whole, rel=1e-6)


def test_a_coefficient_of_the_wrong_sign_explains_nothing() -> None:
    random = np.random.default_rng(2)
    design = random.standard_normal((40, 2, 5))
    y = design @ np.array([1.0, 2.0, -1.0, 0.5, -2.0])
    gram = NormalEquations.of(design, y, np.repeat(np.arange(10), 4))
    matrix, vector, _ = gram.total
    signs = np.array([0.0, 1.0, 1.0, 1.0, 0.0])
    blocks = [(1, 2), (1, 3), (2,), (3, 4)]
    allowed = [(1,), (1, 3), (), (3, 4)]
    found = explained_by_blocks(matrix, vector, (0,), blocks, signs)
    known = explained_by_blocks(matrix, vector, (0,), allowed)
    np.testing.assert_allclose(found, known, rtol=1e-9)


def test_two_effects_are_found_where_neither_stands_out_alone() -> None:
    """A taper and a wrong length look like three other effects first."""
    hide = "taper=1,length_error=1"
    table = run_campaign(
        plan(), RigSettings(), None, hide=hide, seed=5, options=CampaignOptions(source=StandIn())
    )
    problem = assemble(choose_base(model(), table), table, list(all_effects()), None)
    assert not {"taper", "length_error"} & {item.candidate.id for item in rank(problem)[:3]}
    chosen = search(problem, rank(problem))
    assert {item.id for item in chosen} == {"taper", "length_error"}
    assert all_needed(problem, chosen)
    best_single = max(delta_chi2(problem, (c,)) for c in problem.candidates)
    assert delta_chi2(problem, chosen) > 1.03 * best_single


@pytest.mark.parametrize("power", [0.0, 2.0, 6.0])
def test_a_curved_body_held_straight_is_a_bending_moment(power: float) -> None:
    """At rest EI / L times the whole bend, without a force, however the bend is spread."""
    rest = at((0.0,) * 6)
    found = PreCurvature(power).correction(rest, np.array([0.01, -0.02]))[0]
    held = -rest_stiffness(rest).bending * np.array([0.01, -0.02])
    np.testing.assert_allclose(found[4:], held, rtol=1e-3)
    np.testing.assert_allclose(found[:4], 0.0, atol=1e-3 * np.abs(held).max())
