"""A command and the function of the same name give the same; what a new command needs."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import ecm
from ecm.cli import app
from ecm.cli.command import Command
from ecm.cli.main import reported
from ecm.cli.session import Session, run_command
from ecm.effects import get_effect
from support.neck import LENGTH_M, csv_text, neck_columns


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """Eighty rows of the neck over time, with their description."""
    columns = neck_columns(80) | {"time_s": np.arange(80.0)}
    columns["fy_N"] = columns["fy_N"] + 0.1 * columns["time_s"]
    (tmp_path / "d.csv").write_text(csv_text(columns), encoding="utf-8")
    (tmp_path / "d.toml").write_text(f"[mechanism]\nlength_m = {LENGTH_M}\n", encoding="utf-8")
    return tmp_path / "d.csv"


def same_tables(path: Path, table: ecm.Table) -> None:
    written = ecm.read_table(path)
    assert list(written.columns) == list(table.columns)
    for name, values in table.columns.items():
        np.testing.assert_array_equal(written.columns[name], values)


def test_fit_predict_refit_and_export(data: Path, tmp_path: Path, ecm_command: Command) -> None:
    def run(*arguments: object) -> None:
        ecm_command(*arguments).good()

    table = ecm.read_table(data)
    model = ecm.fit(table, "energy4")
    model.save(tmp_path / "python.json")
    run("fit", data, "--model", "energy4", "--out", tmp_path / "m.json")
    assert (tmp_path / "m.json").read_bytes() == (tmp_path / "python.json").read_bytes()

    run("predict", tmp_path / "m.json", data, "--out", tmp_path / "p.csv", "--stiffness",
        "--stiffness-kind", "screw", "--leverage")  # fmt: skip
    predicted = ecm.predict(model, table, stiffness="screw", leverage=True)
    assert {"k_fx_x", "leverage", "extrapolates", "time_s"} <= set(predicted.columns)
    same_tables(tmp_path / "p.csv", predicted)

    run("refit", tmp_path / "m.json", data, "--add", "fts_drift", "--out", tmp_path / "r.json",
        "--json", tmp_path / "refit.json")  # fmt: skip
    better = ecm.refit(ecm.load_model(tmp_path / "m.json"), table, add=["fts_drift"])
    better.save(tmp_path / "python.json")
    assert (tmp_path / "r.json").read_bytes() == (tmp_path / "python.json").read_bytes()
    assert ecm.refit(better, table, remove=["fts_drift"]).effects == ()
    assert ecm.refit(model, table).name == model.name

    run("export", tmp_path / "r.json", "--to", "c", "--out", tmp_path / "c", "--name", "neck")
    exported = ecm.export(better, "c", tmp_path / "python", name="neck")
    assert exported.left_out == ("fts_drift",)
    for name, text in exported.files.items():
        assert (tmp_path / "c" / name).read_text(encoding="utf-8") == text
        assert (tmp_path / "python" / name).read_text(encoding="utf-8") == text


def test_check_and_design(data: Path, tmp_path: Path, ecm_command: Command) -> None:
    table = ecm.read_table(data)
    assert ecm_command("check", data, "--json", tmp_path / "check.json").code == 0
    assert json.loads((tmp_path / "check.json").read_text()) == ecm.check(table).to_dict()

    done = ecm_command(
        "design", data, "--n", "9", "--model", "linear", "--starts", "1", "--preset", "paper",
        "--seed", "3", "--exclude", "1-5", "--out", tmp_path / "plan.csv",
        "--json", tmp_path / "plan.json", "--iterations", "20",
    ).good()  # fmt: skip
    planned = ecm.design(
        table, 9, preset="paper", model="linear", starts=1, seed=3, exclude=range(5), iterations=20
    )
    same_tables(tmp_path / "plan.csv", planned.plan)
    document = json.loads((tmp_path / "plan.json").read_text())
    assert document == json.loads(json.dumps(planned.to_dict()))
    assert str(planned) in done.out
    assert len(planned.to_pandas()) == len(planned.plan)
    candidates, chosen = planned.plot("x_m", "theta_z_rad").data
    assert (len(candidates.x), len(chosen.x)) == (80, 9)
    assert not set(planned.design.indices.tolist()) & set(range(5))


def test_effects_need_the_protocol_that_tells_them_apart(data: Path) -> None:
    with pytest.raises(ecm.InputError, match="diagnosable"):
        ecm.design(ecm.read_table(data), 30, effects=[get_effect("fts_drift")])


def test_the_aliases_are_the_functions_themselves() -> None:
    assert ecm.fit is ecm.fit_model
    assert ecm.campaign is ecm.run_campaign


ROWS = '''
def rows(session, data: list[Path], *, most: Natural = 0, words: Sequence[str] = (), **options):
    """Count the rows of a table.

    Parameters
    ----------
    most : N
        Rows to count at most.
    words : --word WORD
        Words to print.
    freeze : NAME
        What is kept.
    """
    count = len(session.read(data))
    session.write_json({"rows": min(most or count, count)} | options)
    session.print(f"{count} rows {words}")
'''


def test_a_new_command_is_a_function_and_a_line_of_the_registry(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ecm_command: Command
) -> None:
    """Its options are the signature and the docstring, and those of the public function."""
    package = Path(ecm.__file__).parent
    (tmp_path / "cli").mkdir()
    (tmp_path / "cli" / "rows.py").write_text(f"from __future__ import annotations\n{ROWS}")
    for name in ("cli/session.py", "models/refit.py"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text((package / name).read_text(encoding="utf-8"))
    monkeypatch.setattr("ecm.cli.command._PACKAGE", tmp_path)
    file = ModuleType("ecm.cli.rows")
    exec(f"from __future__ import annotations\n{ROWS}", vars(file))
    monkeypatch.setitem(sys.modules, "ecm.cli.rows", file)
    made = Command(
        line="How many rows a table has.", group="Rows", work="rows.rows", common="tables",
        of="models.refit.refit", passed="freeze remove",
    )  # fmt: skip
    monkeypatch.setitem(app.COMMANDS, "rows", made)
    assert "Rows:\n  rows      How many rows a table has.\n" in ecm_command("--help").out
    page = ecm_command("rows", "--help").out
    assert "Usage: ecm rows [OPTIONS] {DATA...}\n\n  Count the rows of a table.\n" in page
    for words in ("--most N ", "--word WORD ", "--freeze NAME ", "--remove <str> "):
        assert f"  {words}" in page
    assert "  Rows to count at most.  [default: 0; x>=0]\n" in page
    assert "  Ids of effects that it has and shall not have.\n" in page
    assert "--seed" not in page
    asked = ("rows", data, data, "--json", tmp_path / "n.json", "--seed", "1", "--word", "of two")
    done = ecm_command(*asked, "--freeze", "base", "--most", "100")
    assert (done.code, done.out) == (0, "160 rows ['of two']\n")
    written = json.loads((tmp_path / "n.json").read_text())
    assert written == {"rows": 100, "freeze": ["base"], "remove": []}
    assert ecm_command("rows", data, "--most", "-1").code == 2


def test_a_message_of_an_interruption_does_not_outlive_its_command(
    capsys: pytest.CaptureFixture[str],
) -> None:
    def interrupted(_session: Session) -> None:
        raise KeyboardInterrupt

    def work() -> int:
        run_command(interrupted, {}, {})
        return 0

    Session().on_interrupt("readings so far are kept.")
    assert reported(work) == 130
    assert (
        capsys.readouterr().err == "Interrupted; nothing was written. Run the same command again.\n"
    )
