"""A model of fewer columns than the data is diagnosed as any other."""

from __future__ import annotations

import json
from pathlib import Path

from ecm.diagnosis import diagnose
from ecm.io.columns import POSE, WRENCH
from ecm.models import fit_model
from support.campaigns import campaign
from support.neck import Command


def test_the_error_before_is_that_of_its_columns() -> None:
    """Catches the error of the model's three outputs where that of the base's six belongs."""
    table = campaign("fts_offset", 1.0, 4)
    full = diagnose(fit_model(table, "linear"), table)
    few = diagnose(fit_model(table.drop(*POSE[3:], *WRENCH[3:]), "linear"), table)
    assert list(few.rmse.before) == list(WRENCH[:3])
    assert few.answer == full.answer
    assert few.rmse.after == full.rmse.after
    assert few.rmse.ceiling == full.rmse.ceiling


def test_its_report_draws_what_the_model_has(tmp_path: Path, ecm_command: Command) -> None:
    table, model = campaign("fts_offset", 1.0, 4), tmp_path / "m.json"
    table.write(tmp_path / "d.csv")
    fit_model(table.drop(*POSE[3:], *WRENCH[1:]), "linear").save(model)
    ecm_command(
        "diagnose", model, tmp_path / "d.csv", "--json", tmp_path / "d.json",
        "--report", tmp_path / "d.html",
    ).good()  # fmt: skip
    assert json.loads((tmp_path / "d.json").read_text(encoding="utf-8"))["effects"]
    assert "verdict" in (tmp_path / "d.html").read_text(encoding="utf-8")
