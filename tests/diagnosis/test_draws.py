"""Draws of groups of rows: many side by side, and how little a decision hangs on the seed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from ecm.diagnosis import accept
from ecm.diagnosis.accept import CHOSEN_SHARE, _drawn, selection_shares
from ecm.diagnosis.problem import Candidate, Problem, assemble
from ecm.diagnosis.search import best_shapes, rank
from ecm.effects import all_effects
from ecm.io.arrays import F
from ecm.models.fit import choose_base
from support.campaigns import campaign, model

DRAWS = 60


@pytest.fixture(scope="module")
def problem() -> Problem:
    table = campaign("payload", 0.2, 4)
    return assemble(choose_base(model(), table), table, all_effects(), None)


def shapes_of_best(problem: Problem, count: int) -> list[Candidate]:
    """All shapes of the effects that explain most."""
    ids = {item.candidate.id for item in rank(problem)[:count]}
    return [c for c in problem.candidates if c.id in ids]


def one_by_one(problem: Problem, sets: list[list[Candidate]], seed: int) -> list[dict[str, float]]:
    """The same beside each set of others, from the whole normal equations of each draw."""
    count = len(problem.normal.squares)
    order = np.random.default_rng([seed, 5])
    draws = np.ones((DRAWS, count))
    for first in range(0, DRAWS, 25):
        size = min(25, DRAWS - first)
        least = np.argsort(order.random((size, count)), axis=1)[:, : round(count / 4)]
        np.put_along_axis(draws[first : first + size], least, 0.0, axis=1)
    draws *= count / draws.sum(axis=1, keepdims=True)
    won: list[dict[str, float]] = [{} for _ in sets]
    for weights in draws:
        each = np.repeat(weights, np.diff(problem.normal.bounds))
        unweighted = problem.normal.rows()
        rows = each[:, None] * unweighted
        matrix = rows.T @ unweighted + np.diag(problem.normal.precision)
        vector = problem.normal.response @ rows
        drawn = replace(problem, reduced=(matrix / problem.scale, vector / problem.scale))
        for wins, others in zip(won, sets, strict=True):
            first = best_shapes(drawn, others)[0]
            if first.delta_bic > 0.0:
                wins[first.id] = wins.get(first.id, 0.0) + 1.0 / DRAWS
    return won


def test_draws_side_by_side_are_those_one_by_one(problem: Problem) -> None:
    first = rank(problem)[0].candidate
    winners, sets = [], [[], [first]]
    for others, expected in zip(sets, one_by_one(problem, sets, 3), strict=True):
        present = {other.id for other in others}
        shapes = [c for c in problem.candidates if c.id not in present]
        found = selection_shares(problem, others, shapes, 3, DRAWS)
        assert found == pytest.approx(expected, rel=1e-9)
        winners.append(len(expected))
    assert winners[0] > 2


@pytest.mark.parametrize("groups", [2, 4, 5, 9, 10, 20])
def test_what_one_pose_alone_shows_wins_too_few_draws(groups: int) -> None:
    drawn = np.concatenate([*_drawn(groups, 4000, 0)])
    assert ((drawn > 0.0).mean(axis=0) < CHOSEN_SHARE).all()
    np.testing.assert_allclose(drawn.sum(axis=1), groups)
    assert np.concatenate([*_drawn(1, 25, 0)]).min() == 1.0  # which nothing can be left of


def test_a_base_that_is_projected_out_leaves_no_fixed_columns(
    problem: Problem, capfd: pytest.CaptureFixture[str]
) -> None:
    bare = replace(problem, n_base=0)
    shapes = shapes_of_best(bare, 4)
    assert 0.0 < sum(selection_shares(bare, [], shapes, 3, DRAWS).values()) <= 1.0
    assert capfd.readouterr().err == ""  # LAPACK complains of empty matrices there


def test_a_share_is_the_same_to_a_few_hundredths_whatever_the_seed(problem: Problem) -> None:
    shapes = shapes_of_best(problem, 8)
    found = [selection_shares(problem, [], shapes, seed) for seed in range(3)]
    assert 0.1 < found[0]["payload"] < 0.95
    for other in found[1:]:
        assert other["payload"] == pytest.approx(found[0]["payload"], abs=0.06)


def test_no_more_draws_are_made_than_a_clear_share_needs(
    problem: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    clear = [one for one in shapes_of_best(problem, 1) if not one.effect.shape]
    made = 0

    def counted(*given: int) -> Iterator[F]:
        nonlocal made
        for part in _drawn(*given):
            made += len(part)
            yield part

    monkeypatch.setattr(accept, "_drawn", counted)
    ((_, share),) = selection_shares(problem, [], clear, 3).items()
    assert share >= 0.99
    assert made == 400
    selection_shares(problem, [], shapes_of_best(problem, 8), 3)
    assert made == 1400


def test_without_contenders_nobody_wins(problem: Problem) -> None:
    assert selection_shares(problem, [], [], 0) == {}
