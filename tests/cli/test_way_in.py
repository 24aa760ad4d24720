"""A file that is no table is answered with what to type, and that works."""

from __future__ import annotations

import shlex
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from support.neck import ROOT

Run = Callable[..., Any]
_LOGS = {
    "displacement.csv": "dx [mm],Fx [N]\n",
    "machine.csv": "Time,Displacement,Force\n(s),(mm),(N)\n",
    "machine_kN.csv": "Time (s),Extension (mm),Load (kN)\n",
    "no_units.csv": "ux,Fx\n",
}


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def advised(err: str) -> list[str]:
    """The command in the last line of an error."""
    program, *words = shlex.split(err.rstrip().splitlines()[-1])
    assert program == "ecm", err
    return words


def typed(run: Run, err: str) -> str:
    """Run an import as advised; the table that it writes."""
    words = advised(err)
    done = run(*words)
    assert done.code == 0, done.err
    return words[words.index("--out") + 1]


def log(name: str) -> None:
    head = _LOGS[name]
    columns = head.splitlines()[0].count(",") + 1
    steps = np.linspace(0.0, 20.0, 30)
    rows = [",".join(f"{value:.4f}" for value in [k * 0.1, x, 2.0 * x][-columns:])
            for k, x in enumerate(steps)]  # fmt: skip
    Path(name).write_text(head + "\n".join(rows) + "\n", encoding="utf-8")


@pytest.mark.parametrize("name", _LOGS)
def test_a_raw_log_is_answered_with_the_import_that_works(name: str, ecm_command: Run) -> None:
    log(name)
    done = ecm_command("fit", name, "--model", "linear", "--out", "model.json")
    assert done.code == 2
    table = typed(ecm_command, done.err)
    assert ecm_command("fit", table, "--model", "linear", "--out", "model.json").code == 0


def test_an_angle_turns_about_an_axis_across(ecm_command: Run) -> None:
    shutil.copy(ROOT / "examples" / "hinge_log.csv", "hinge_log.csv")
    done = ecm_command("check", "hinge_log.csv")
    assert done.code == 2
    assert "theta_z_rad" in Path(typed(ecm_command, done.err)).read_text(encoding="utf-8")


def test_a_model_in_the_place_of_the_table_is_told(ecm_command: Run) -> None:
    log("displacement.csv")
    assert ecm_command("import", "displacement.csv", "--out", "data.csv").code == 0
    assert ecm_command("fit", "data.csv", "--model", "linear", "--out", "model.json").code == 0
    for words in (("compare", "data.csv", "model.json"), ("fit", "model.json", "data.csv")):
        done = ecm_command(*words, *(["--out", "m.json"] if words[0] == "fit" else []))
        assert done.code == 2
        assert "model.json is a model, expected a table of measurements" in done.err
        assert ecm_command(*advised(done.err)).code == 0


def test_what_no_import_understands_has_no_advice(ecm_command: Run) -> None:
    Path("words.csv").write_text("a,b\n1,2\n3,4\n", encoding="utf-8")
    done = ecm_command("fit", "words.csv", "--out", "model.json")
    assert done.code == 2
    assert "ecm import" not in done.err
