"""The bounds of the short blind benchmark, with one step of the procedure broken at a time.

Each broken step is beside the test of test_blind.py whose bound it does not meet. A gate that
always rejects is not here: what is left over is asked the same question by the same test, so that
nothing changes. Nor is the resampling: of these sets it makes classes larger, none right or wrong.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from blind_benchmark import test_blind as short
from ecm.diagnosis import accept, problem, search
from ecm.diagnosis import decide as judge
from ecm.effects import Effect, Missing
from ecm.io.table import Table

pytestmark = pytest.mark.xdist_group("blind")  # one process: the data are worked out once
Patch = pytest.MonkeyPatch


def diagonal_noise(patch: Patch) -> None:
    """What links the components of a row's noise is left out."""
    whole = problem.whiteners
    patch.setattr(problem, "whiteners", lambda cov: whole(cov * np.eye(cov.shape[1])))


def last_first(patch: Patch) -> None:
    """The ranking begins with what explains least."""
    rank = search.rank
    for module in (search, accept, judge):
        patch.setattr(module, "rank", lambda *given: rank(*given)[::-1])


def all_accepted(patch: Patch) -> None:
    """What the search chooses is named, whatever the checks say."""
    patch.setattr(accept.AcceptanceCheck, "accepted", property(lambda check: True))


def no_classes(patch: Patch) -> None:
    """The best alone is the answer."""
    patch.setattr(judge, "confusion_class", lambda problem, chosen, item, *_: [item.id])
    patch.setattr(
        judge, "widened_class", lambda problem, chosen, item, members, near: list(members)
    )


def nothing_held_out(patch: Patch) -> None:
    """An effect need not do better on rows that its fit has not seen."""
    patch.setattr(accept, "held_out_delta", lambda *_: np.inf)


def random_folds(patch: Patch) -> None:
    """Groups are held out at random: neighbours in time know of each other."""

    def folds(table: Table, poses: Any, groups: Any, by: str) -> Any:
        return np.random.default_rng(5).permutation(int(groups.max()) + 1)[groups] % 5

    patch.setattr(accept, "folds", folds)


def gate_never_rejects(patch: Patch) -> None:
    """Whatever is left without a name is taken for noise."""
    gate = judge._gate
    patch.setattr(judge, "_gate", lambda *given: (gate(*given)[0], False))


def leftover_ignored(patch: Patch) -> None:
    """What an answer leaves unexplained does not speak against it."""
    left = judge._left_over

    def clean(*given: Any) -> Any:
        residual, _, figures = left(*given)
        return residual, False, figures

    patch.setattr(judge, "_left_over", clean)


@dataclass(frozen=True)
class _Careless:
    """An effect that asks for its columns only, not for what must vary in them."""

    effect: Effect

    def __getattr__(self, name: str) -> Any:
        return getattr(self.effect, name)

    def missing(self, table: Table) -> Missing | None:
        lacking = self.effect.missing(table)
        return lacking if lacking is not None and lacking.absent else None


def missing_ignored(patch: Patch) -> None:
    """Every effect whose columns are there is tested."""
    tangents = problem.all_score_columns
    patch.setattr(
        problem,
        "all_score_columns",
        lambda rows, whitener, effects: tangents(rows, whitener, [_Careless(e) for e in effects]),
    )


@pytest.mark.parametrize(
    ("broken", "bound"),
    [
        (diagonal_noise, short.test_the_noise_of_a_row_is_the_generator_s),
        (last_first, short.test_one_effect_is_named_and_its_parameters_are_right),
        (all_accepted, short.test_nothing_hidden_is_given_no_name),
        (no_classes, short.test_a_class_is_told_apart_by_the_experiment_that_is_proposed),
        (nothing_held_out, short.test_what_held_out_rows_contradict_is_not_accepted),
        (random_folds, short.test_what_held_out_rows_contradict_is_not_accepted),
        (gate_never_rejects, short.test_what_is_not_in_the_library_is_unknown),
        (leftover_ignored, short.test_what_is_not_in_the_library_is_unknown),
        (missing_ignored, short.test_the_paper_s_protocol_cannot_test_hysteresis),
    ],
)
def test_a_broken_step_does_not_meet_the_bound(
    broken: Callable[[Patch], None],
    bound: Callable[[Path], None],
    blind_folder: Path,
    monkeypatch: Patch,
) -> None:
    # The data are those of the unbroken run; the answers are not.
    monkeypatch.setattr(short, "_worked", lru_cache(maxsize=32)(short._worked.__wrapped__))
    broken(monkeypatch)
    with pytest.raises(AssertionError):
        bound(blind_folder)
