"""The bounds of the short blind benchmark, with one stage of the procedure broken at a time.

Each broken stage is beside the test of test_blind.py whose bound it does not meet. A gate that
always rejects is not here: what is left over is asked the same question by the same test, so that
nothing changes. Nor are the draws of rows: of these sets they make classes larger, none right or
wrong.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest

from blind_benchmark import test_blind as short
from blind_parts.analysis import Method
from ecm.diagnosis import DiagnosisSettings, Stages
from ecm.diagnosis.accept import Accepted, accept, confusion_class
from ecm.diagnosis.left_over import Gate, Leftover, gate, leftover
from ecm.diagnosis.problem import Candidate, Problem, assemble
from ecm.diagnosis.search import Ranked, rank
from ecm.effects import Effect, Missing, get_effect
from ecm.io.arrays import F
from ecm.io.table import Table
from ecm.regression.noise import Noise
from support.acceptance import acceptance_check


class DiagonalNoise(Noise):
    """The same figures without what links the components."""

    def covariance(self, rows: Any, base_error: Any = None) -> F:
        whole = super().covariance(rows, base_error)
        return np.asarray(whole * np.eye(whole.shape[1]))


def diagonal_noise(*given: Any) -> Problem:
    """What links the components of a row's noise is left out."""
    base, table, effects, noise, settings = given
    full = assemble(base, table, effects, noise, settings)
    diagonal = DiagonalNoise(*full.noise.parameters(), full.noise.source, full.noise.components)
    return assemble(base, table, effects, diagonal, settings)


def last_first(problem: Problem) -> list[Ranked]:
    """The ranking begins with what explains least."""
    return rank(problem)[::-1]


def all_accepted(problem: Problem, chosen: Sequence[Candidate], seed: int) -> Accepted:
    """What the search chooses is named, whatever the checks say."""
    classes = [confusion_class(problem, chosen, item) for item in chosen]
    return Accepted(
        tuple(chosen),
        tuple(tuple(members) for members in classes),
        tuple(
            acceptance_check(problem, chosen, item, members, seed)
            for item, members in zip(chosen, classes, strict=True)
        ),
    )


def alone(problem: Problem, chosen: Sequence[Candidate], item: Candidate, *_: float) -> list[str]:
    """The best alone is the answer."""
    return [item.id]


def accept_alone(problem: Problem, chosen: Sequence[Candidate], seed: int) -> Accepted:
    """No name has a class."""
    with patch("ecm.diagnosis.accept.confusion_class", alone):
        return accept(problem, chosen, seed)


def gate_never_rejects(problem: Problem) -> Gate:
    """Whatever is left without a name is taken for noise."""
    return replace(gate(problem), rejected=False)


def nothing_followed(_: Problem) -> None:
    """Whiteness, which finds most of what the gate finds, is left out with it."""


def leftover_ignored(problem: Problem, first: Gate, effects: Sequence[Candidate]) -> Leftover:
    """What an answer leaves unexplained does not speak against it."""
    return replace(leftover(problem, first, effects), remains=False)


def careless(id: str) -> Effect:
    """An effect that asks for its columns only, not for what must vary in them."""
    effect = copy(get_effect(id))

    class Careless(type(effect)):  # type: ignore[misc]
        def missing(self, table: Table) -> Missing | None:
            lacking: Missing | None = super().missing(table)
            return lacking if lacking is not None and lacking.absent else None

    object.__setattr__(effect, "__class__", Careless)
    return effect


NO_CLASSES = Stages(accept=accept_alone)
NOTHING_HELD_OUT = DiagnosisSettings(held_out_errors=-1e9)
"""An effect need not do better on rows that its fit has not seen."""
RANDOM_FOLDS = DiagnosisSettings(held_out="random")
"""Groups are held out at random: neighbours in time know of each other."""


@pytest.mark.parametrize(
    ("method", "bound"),
    [
        (
            Method(stages=Stages(assemble=diagonal_noise)),
            short.test_the_noise_of_a_row_is_the_generator_s,
        ),
        (
            Method(stages=Stages(rank=last_first)),
            short.test_one_effect_is_named_and_its_parameters_are_right,
        ),
        (Method(stages=Stages(accept=all_accepted)), short.test_nothing_hidden_is_given_no_name),
        (
            Method(stages=NO_CLASSES),
            short.test_a_class_is_told_apart_by_the_experiment_that_is_proposed,
        ),
        (
            Method(settings=NOTHING_HELD_OUT),
            short.test_what_held_out_rows_contradict_is_not_accepted,
        ),
        (Method(settings=RANDOM_FOLDS), short.test_what_held_out_rows_contradict_is_not_accepted),
        (
            Method(stages=Stages(gate=gate_never_rejects, white=nothing_followed)),
            short.test_what_is_not_in_the_library_is_unknown,
        ),
        (
            Method(stages=Stages(leftover=leftover_ignored)),
            short.test_what_is_not_in_the_library_is_unknown,
        ),
        (Method(effect=careless), short.test_the_paper_s_protocol_cannot_test_hysteresis),
    ],
    ids=[
        "diagonal_noise",
        "last_first",
        "all_accepted",
        "no_classes",
        "nothing_held_out",
        "random_folds",
        "gate_never_rejects",
        "leftover_ignored",
        "missing_ignored",
    ],
)
def test_a_broken_stage_does_not_meet_the_bound(
    method: Method, bound: Callable[[Path, Method], None], blind_folder: Path
) -> None:
    # Names and nothing are weighed beside smooth processes, too, and names have a probability:
    # that alone holds some bounds.
    with (
        patch("ecm.diagnosis.procedure.SURE", 1.0),
        patch.multiple("ecm.diagnosis.verdict", OUTLIER_CHANCE=-1.0, _AS_LIKELY=0.0),
        pytest.raises(AssertionError),
    ):
        bound(blind_folder, method)
