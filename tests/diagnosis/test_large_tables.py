"""Large tables: some rows are used, the result says so, and the verdict is that of all rows."""

from __future__ import annotations

import pytest

from ecm.diagnosis import DiagnosisSettings, diagnose, find_missing
from ecm.diagnosis.summary import verdict_blocks
from ecm.regression.folds import without_zero_readings
from ecm.report import TableBlock
from ecm.rig import CampaignOptions, RigSettings, run_campaign
from support.campaigns import campaign, model, plan
from support.stand_in import StandIn

FEW = DiagnosisSettings(most_rows=300)


@pytest.mark.parametrize("hidden", ["", "base_compliance", "hysteresis", "fts_drift"])
def test_the_verdict_of_some_rows_is_that_of_all(hidden: str) -> None:
    hide = f"{hidden}=1" if hidden else None
    source = CampaignOptions(source=StandIn())
    table = run_campaign(plan(600), RigSettings(), None, hide=hide, seed=3, options=source)
    assert len(table) > 600
    every, some = (
        find_missing(model(), table, settings=settings) for settings in (DiagnosisSettings(), FEW)
    )
    assert every.verdict == some.verdict == ("named" if hidden else "none")
    assert every.answer == some.answer == (((hidden,),) if hidden else ())
    assert len(some.problem.table) == 300


def test_the_result_says_which_rows_were_used() -> None:
    table = campaign("hysteresis")
    result = diagnose(model(), table, settings=DiagnosisSettings(most_rows=200))
    document = result.to_dict()
    used = document["rows_used"]
    # Readings from which the zero was taken are no rows.
    total = len(without_zero_readings(table))
    assert (used["used"], used["of_table"]) == (200, total)
    assert "repeats" in used["chosen"]
    assert "times the noise of a row" in used["enough"]
    assert used["sentence"].startswith(f"200 of {total} rows were used")
    assert used["sentence"] in result.report().text()
    tables = [b for b in verdict_blocks(document) if isinstance(b, TableBlock)]
    assert any(["rows", used["sentence"]] in list(one.rows) for one in tables)
    assert all(0 <= row < len(table) for row in result.outliers)


def test_a_small_table_is_used_as_it_is_and_nothing_is_said() -> None:
    table = campaign("hysteresis")
    result = diagnose(model(), table, settings=DiagnosisSettings(most_rows=len(table)))
    assert result.rows_used is None
    assert "rows_used" not in result.to_dict()
