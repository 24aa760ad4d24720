"""`check`, `compare` and `diagnose` agree on noise, on what can be tested, and on what lacks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ecm.comparison import compare
from ecm.diagnosis import diagnose
from ecm.diagnosis.problem import assemble
from ecm.diagnosis.settings import DEFAULTS
from ecm.effects import effects_for
from ecm.errors import InputError
from ecm.io.columns import POSE, WRENCH
from ecm.io.description import FileMeta, Instrument, Meta
from ecm.io.table import Table, as_table
from ecm.models import fit_model
from ecm.models.check import check
from ecm.models.refit import refit
from support.campaigns import INSTRUMENT, campaign, workspace_poses
from support.neck import Command, columns_of
from support.stand_in import L, wrench

LENGTH = {"length_m": L}


def neck(
    rows: int = 90, *, declared: bool = True, length: bool = True, drift: float = 0.0
) -> Table:
    poses, random = workspace_poses(rows, 3), np.random.default_rng(4)
    h = wrench(poses) + random.standard_normal((rows, 6)) * [0.3, 0.3, 0.3, 0.01, 0.01, 0.01]
    time = 9.0 * np.arange(rows)
    h[:, 1] += drift * time
    columns = columns_of(poses, h)
    meta = Meta(
        mechanism=LENGTH if length else {}, instrument=INSTRUMENT if declared else Instrument()
    )
    return as_table(columns | {"time_s": time}, meta=meta)


def line(*, repeats: bool, bent: float = 0.0) -> Table:
    """One angle and one torque, of which a part may not be a line."""
    x = np.repeat(np.linspace(-1.0, 1.0, 30), 2)
    y = 3.0 * x + bent * x**3 + 0.05 * np.random.default_rng(5).standard_normal(60)
    columns = {"theta_z_rad": x, "tau_z_Nm": y, "time_s": np.arange(60.0)}
    return as_table(columns | ({"pose_id": np.repeat(np.arange(30.0), 2)} if repeats else {}))


CASES: dict[str, tuple[str, Callable[[], Table], bool]] = {
    "declared": ("energy6", neck, False),
    "assumed": ("energy6", lambda: neck(declared=False), False),
    "no length": ("cubic", lambda: neck(200, length=False), False),
    "drift": ("energy6", lambda: neck(drift=0.01), True),
    "drift, assumed": ("energy6", lambda: neck(declared=False, drift=0.01), True),
    "too plain": ("linear", neck, True),
    "campaign": ("energy6", lambda: campaign("", 1.0, 4), False),
    "payload": ("energy6", lambda: campaign("payload", 1.0, 4), True),
    "forces only": ("energy6", lambda: neck(200).drop(*WRENCH[3:]), False),
    "a line": ("linear", lambda: line(repeats=False), False),
    "a line, repeated": ("linear", lambda: line(repeats=True), False),
    "a curve": ("linear", lambda: line(repeats=False, bent=2.0), True),
    "a curve, repeated": ("linear", lambda: line(repeats=True, bent=2.0), True),
}


@pytest.mark.parametrize("case", CASES)
def test_all_three_say_the_same(case: str) -> None:
    name, make, missing = CASES[case]
    table = make()
    model = fit_model(table, name)
    checked, compared = check(table), compare(model, table)
    found = diagnose(model, table, effects=["fts_drift", "payload", "temperature_modulus"])
    assert checked.noise == compared.noise.source == found.noise.source
    assert compared.noise.is_residual == found.noise.figures.is_residual
    assert compared.missing == found.model.missing == missing, compared.sentence()
    lacking = {one.id: one.reason for one in checked.not_testable}
    for one in found.not_testable:
        absorbed = one.reason.startswith("the base absorbs it")
        assert absorbed or lacking.get(one.id) == one.reason
    tested = {one.id for one in found.ranking}
    assert tested <= set(checked.testable)


def test_all_effects_that_need_the_length_are_told_alike() -> None:
    table = neck(200, length=False)
    swept = as_table(
        {name: table.column(name) for name in (*POSE, *WRENCH)} | {"time_s": 0.05 * np.arange(200)},
        meta=replace(table.meta, file=FileMeta(kind="continuous")),
    )
    for each in (table, swept):
        model = fit_model(each, "linear")
        told = assemble(model.base, each, effects_for((*POSE, *WRENCH)), None, DEFAULTS).untestable
        lacking = {one.id: one.reason for one in check(each).not_testable}
        assert "length is not known" in lacking["length_error"]
        assert {id: w.reason for id, w in told.items() if "absorbs" not in w.reason} == lacking
    # A refit says so before it fits anything.
    with pytest.raises(InputError, match=r"hysteresis cannot be fitted, .*length is not known"):
        refit(model, swept, add=["hysteresis"])


def test_a_table_with_neither_pose_nor_wrench_is_told_so_by_all(
    tmp_path: Path, ecm_command: Command
) -> None:
    fit_model(neck(), "linear").save(tmp_path / "m.json")
    as_table({"time_s": np.arange(20.0), "speed": np.arange(20.0)}).write(tmp_path / "d.csv")
    checked = ecm_command("check", tmp_path / "d.csv")
    assert "pose" in checked.out
    assert "wrench" in checked.out
    for command in ("compare", "diagnose"):
        done = ecm_command(command, tmp_path / "m.json", tmp_path / "d.csv").refused()
        assert "no pose column was found" in done.err
        assert "or map them in [columns]" in done.err
    assert "nothing can be fitted, compared or diagnosed" in checked.out
