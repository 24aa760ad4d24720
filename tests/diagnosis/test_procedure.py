"""The stages one by one, their settings, and what a diagnosis turns into."""

from __future__ import annotations

import json
from dataclasses import fields, replace

import pytest

from ecm.diagnosis import Diagnosis, DiagnosisSettings, Stages, find_missing
from ecm.diagnosis.accept import accept
from ecm.diagnosis.left_over import gate, leftover
from ecm.diagnosis.preparation import prepare
from ecm.diagnosis.problem import assemble
from ecm.diagnosis.result import report
from ecm.diagnosis.search import rank, search
from ecm.diagnosis.verdict import Decision, verdict
from ecm.errors import InputError
from ecm.io.settings import meanings
from ecm.models.fit import choose_base
from support.campaigns import campaign, diagnosis_of, model


@pytest.fixture(scope="module")
def found() -> Diagnosis:
    return diagnosis_of("payload", 1.0, 4)


def test_the_stages_called_one_by_one_give_the_diagnosis(found: Diagnosis) -> None:
    prepared = prepare(model(), campaign("payload", 1.0, 4))
    base = choose_base(model(), prepared.table)
    problem = assemble(base, prepared.unexplained, prepared.effects)
    first = gate(problem)
    assert first.rejected
    ranking = rank(problem)
    chosen = search(problem, ranking)
    accepted = accept(problem, chosen)
    left = leftover(problem, first, accepted.effects)
    assert not left.remains
    final = verdict(Decision(prepared, problem, (), first, tuple(ranking), accepted, left))
    assert final.verdict == found.verdict
    assert final.accepted.classes == found.answer
    assert final.accepted.checks == found.checks
    assert first == found.gate
    assert left == found.left_over
    assert [one.p for one in ranking] == [one.p for one in found.ranking]


def test_a_decision_is_all_that_a_report_needs(found: Diagnosis) -> None:
    decision = find_missing(model(), campaign("payload", 1.0, 4))
    again = report(decision, model())
    # What is added to the model that was given is no part of the decision.
    assert json.dumps(again.to_dict()) == json.dumps(replace(found, addition=None).to_dict())


def test_a_stage_is_replaced_by_argument(found: Diagnosis) -> None:
    """With a gate that sees nothing and a search that finds nothing, drivers alone would speak."""
    table = campaign("payload", 1.0, 4)
    blind = Stages(
        gate=lambda problem: replace(gate(problem), rejected=False),
        search=lambda problem, ranking: (),
        white=lambda problem: None,
    )
    unsure = find_missing(model(), table, stages=blind)
    assert unsure.accepted.effects == ()
    assert unsure.verdict == "none"
    assert unsure.ranking[0].id == found.ranking[0].id
    rubbing = campaign("hysteresis", 1.0, 4)
    assert find_missing(model(), rubbing, stages=blind).verdict == "family"


def test_a_setting_decides() -> None:
    """A name that must fall by more BIC than there is to explain is not given."""
    table = campaign("payload", 1.0, 4)
    strict = find_missing(model(), table, settings=DiagnosisSettings(least_bic=1e6))
    assert strict.accepted.effects == ()
    assert strict.verdict == "unknown"


def test_every_setting_states_its_meaning_and_refuses_what_is_out_of_range() -> None:
    for item in fields(DiagnosisSettings):
        limits = item.metadata["limits"]
        assert meanings(DiagnosisSettings)[item.name], item.name
        limits.check(item.default, item.name)
    with pytest.raises(InputError, match=r"level = 2.0: expected a number from 0 to 1"):
        DiagnosisSettings(level=2.0)
    with pytest.raises(InputError, match=r"held_out = 'block': .* did you mean 'blocks'"):
        DiagnosisSettings(held_out="block")


def test_the_ranking_is_a_table_and_a_figure(found: Diagnosis) -> None:
    frame = found.to_pandas()
    assert list(frame["id"]) == [one.id for one in found.ranking]
    assert list(frame["delta_bic"]) == [one.delta_bic for one in found.ranking]
    (bars,) = found.plot(most=5).data
    # The best stands on top.
    assert list(bars.y)[::-1] == [one.id for one in found.ranking[:5]]
    assert list(bars.x)[::-1] == [one.delta_bic for one in found.ranking[:5]]
    lines, more = str(found).rsplit("\n", 1)
    assert lines == str(found.summary())
    assert more.startswith("(.report().text(): ")
