"""Pressures that are off in an arm with three chambers: the base bends with what is missing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import ecm
from ecm.diagnosis import diagnose
from ecm.diagnosis.family import posterior
from ecm.diagnosis.problem import assemble
from ecm.diagnosis.search import rank, search
from ecm.effects import effects_of
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.io.table import Table
from ecm.models import fit_model
from ecm.models.actuated import ActuatedMap
from ecm.models.fit import choose_base
from support.driven import ARM, PRESSURES, arm_table

PAIRED = "pressure_offset"
FIGURES = {"force_sd_N": 0.004, "torque_sd_Nm": 1.2e-4}


def read(poses: int, times: int, acting: Callable[[F], F], seed: int) -> Table:
    """Some poses of the arm, each read so many times; the plant is an energy of degree 5."""
    random = np.random.default_rng(seed)
    rows = arm_table().select(np.sort(random.choice(100, poses, replace=False)))
    plant = fit_model(arm_table(), "actuated5")
    wrenches = plant.predict(rows.matrix(POSE), acting(rows.matrix(PRESSURES)))
    every = np.tile(np.arange(poses), times)
    noise = random.standard_normal((len(every), 6)) * np.repeat(list(FIGURES.values()), 3)
    columns = {name: rows[name][every] for name in (*POSE, *PRESSURES)}
    columns |= dict(zip(WRENCH, (wrenches[every] + noise).T, strict=True))
    columns["pose_id"] = every.astype(np.float64)
    return ecm.as_table(columns, meta={**ARM, "instrument": FIGURES})


def moving(seed: int) -> Table:
    """Forces alone along a smooth way of poses and pressures; the plant is that of `read`."""
    random, time_s = np.random.default_rng(seed), 0.2 * np.arange(600.0)
    rows = arm_table().matrix((*POSE, *PRESSURES))
    waves = [
        np.sin(2.0 * np.pi * time_s / random.uniform(6.0, 30.0) + random.uniform(0.0, 6.3))
        for _ in range(9)
    ]
    half = 0.4 * np.ptp(rows, axis=0)
    at = 0.5 * (rows.min(axis=0) + rows.max(axis=0)) + half * np.stack(waves, axis=1)
    forces = fit_model(arm_table(), "actuated5").predict(at[:, :6], at[:, 6:])[:, :3]
    forces = forces + 0.002 * forces.std(axis=0) * random.standard_normal(forces.shape)
    columns = dict(zip((*POSE, *PRESSURES, *WRENCH[:3]), np.hstack([at, forces]).T, strict=True))
    return ecm.as_table({"time_s": time_s, **columns}, meta=ARM)


def off(by_Pa: float) -> Callable[[F], F]:
    """The second pressure is off by a constant."""
    return lambda inputs: inputs + by_Pa * np.array([0.0, 1.0, 0.0])


def named(table: Table, model: str = "actuated4") -> tuple[str, list[tuple[str, ...]]]:
    found = diagnose(fit_model(table, model, force=True), table)
    return found.verdict, [tuple(members) for members in found.answer]


def test_a_degree_that_a_base_of_pressures_lacks_is_no_memory_of_a_log() -> None:
    """Along a smooth way the past follows what a plain base of pose and pressures leaves."""
    table = moving(3)
    chances = posterior(assemble(fit_model(table, "actuated4", force=True).base, table, []))
    assert chances.of_pose > 0.9


@pytest.mark.parametrize("poses", [30, 40])
def test_poses_and_not_their_repeats_carry_a_degree(poses: int) -> None:
    for times in (1, 3):
        table = read(poses, times, lambda inputs: inputs, 0)
        base = choose_base(fit_model(table, "actuated3"), table)
        assert isinstance(base, ActuatedMap)
        assert base.terms.degree == 4, times


def test_a_pressure_that_the_base_nearly_absorbs_is_offered_beside_a_bent_body() -> None:
    """Of 1.5 kPa an energy takes in 94 %; the rest alone looks like a body that is bent."""
    table = read(30, 2, off(1500.0), 0)
    base = choose_base(fit_model(table, "actuated4", force=True), table)
    found = [one.id for one in rank(assemble(base, table, effects_of(table)))]
    assert found.index("pressure_offset") < found.index("pre_curvature")


def test_a_large_effect_is_looked_for_again_around_the_base_beside_it() -> None:
    """A base that took in its part has another G: a gain and a bent body would be named."""
    verdict, classes = named(read(30, 2, off(3000.0), 1))
    assert verdict in ("named", "ambiguous")
    assert [members[0] for members in classes] == ["pressure_offset"]


def test_one_degree_more_is_taken_by_what_it_predicts() -> None:
    """On the fitted rows 200 coefficients take in most of what is missing."""
    verdict, classes = named(read(40, 2, off(1200.0), 0), "actuated3")
    assert (verdict, classes) == ("named", [("pressure_offset",)])


def test_two_effects_of_which_neither_shows_alone_are_found_beyond_chance() -> None:
    """Each hides what the other does: alone they explain 1, together 144, or 19."""
    table = read(30, 1, off(0.0), 0)
    base = choose_base(fit_model(table, "actuated4", force=True), table)
    problem = assemble(base, table, effects_of(table))
    pair = [next(c for c in problem.candidates if c.id == id) for id in ("payload", PAIRED)]
    one, two = (item.columns[0] for item in pair)
    size = problem.design.shape[2]
    for length, expected in ((60.0, {"payload", PAIRED}), (22.0, set())):
        matrix, vector = np.eye(size), np.zeros(size)
        matrix[one, two] = matrix[two, one] = -0.98
        vector[[one, two]] = 0.02 * length
        hidden = replace(problem, reduced=(matrix, vector))
        assert rank(hidden)[0].delta_bic < hidden.settings.least_bic
        assert {item.id for item in search(hidden, rank(hidden))} == expected
