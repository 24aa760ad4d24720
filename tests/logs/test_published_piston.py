"""A published piston at seven pressures, by the commands and figures of docs/real_data.md."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import numpy as np
import pytest

import ecm
from ecm.io.arrays import F
from ecm.io.table import read_table
from support.neck import ROOT, Command


@pytest.fixture
def commands(shared_data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The commands of the page, in a folder of links to the published files."""
    for log in (shared_data / "pneumatic_piston").glob("*.tsv"):
        (tmp_path / log.name).symlink_to(log)
    monkeypatch.chdir(tmp_path)
    page = (ROOT / "docs" / "real_data.md").read_text(encoding="utf-8")
    block = page.partition("## A piston at pressures")[2].split("```")[1]
    return [line for line in block.replace("\\\n", " ").strip().splitlines() if line]


def of_bar(command: str, bar: int) -> list[str]:
    """The words of an import of 1 bar, for the log at another pressure."""
    return shlex.split(command.replace("1bar", f"{bar}bar").replace("p1.csv", f"p{bar}.csv"))[1:]


def typed(run: Command, command: str) -> str:
    """What a command prints."""
    done = run(*shlex.split(command)[1:]).good()
    return done.out


def fresh_error(model: Path) -> float:
    """Error at 2, 4 and 6 bar, N."""
    fresh = read_table([Path(f"p{bar}.csv") for bar in (2, 4, 6)])
    left = fresh.column("fx_N") - ecm.load_model(model).predict(fresh)[:, 0]
    return float(np.sqrt((left**2).mean()))


def noise_and_spread(force: F) -> tuple[float, float]:
    """Neighbours of a sample differ by noise alone: a third difference takes out what moves."""
    noise = np.median(np.abs(np.diff(force, 3))) / 0.6745 / np.sqrt(20.0)
    return float(noise), float(force.std())


def test_four_pressures_predict_three_others_once_the_friction_of_the_seal_is_named(
    commands: list[str], ecm_command: Command
) -> None:
    importing, fit, diagnose, refit, compare = commands
    for bar in range(1, 8):
        assert ecm_command(*of_bar(importing, bar)).code == 0
    force = read_table([Path(f"p{bar}.csv") for bar in (2, 4, 6)]).column("fx_N")
    noise, spread = noise_and_spread(force)
    assert noise == pytest.approx(0.026, abs=5e-4)
    assert spread == pytest.approx(83.0, abs=0.5)

    typed(ecm_command, fit)
    before = fresh_error(Path("linear.json"))
    assert before < 7.835
    assert before / noise < 304.0
    assert before / spread < 0.0955

    said = typed(ecm_command, diagnose)
    assert said.startswith("MISSING: seal_friction (friction of a seal or sheath grows with")
    assert re.search(r"^ADD IT: .*--add seal_friction", said, re.MULTILINE)

    typed(ecm_command, refit)
    (friction,) = ecm.load_model("piston.json").effects
    at_zero, per_pascal = friction.values
    assert at_zero + per_pascal * 1e5 == pytest.approx(4.2, abs=0.15)
    assert at_zero + per_pascal * 7e5 == pytest.approx(8.2, abs=0.15)
    after = fresh_error(Path("piston.json"))
    assert after < 3.355
    assert after / noise < 130.5
    assert after / spread < 0.0415
    assert "errs 3.35 N in fx" in typed(ecm_command, compare)
    # What is left has no name: the three files lie above the four by a constant.
    again = typed(ecm_command, diagnose.replace("linear.json", "piston.json"))
    assert "seal_friction" not in again.partition("ADD IT")[0]


def test_without_the_pressure_each_run_is_said_to_have_a_wrench_of_its_own(
    commands: list[str], ecm_command: Command
) -> None:
    importing, fit, diagnose = commands[:3]
    without = re.sub(r"--map pressure_1_Pa=(\w+):bar", r"--ignore \1", importing)
    assert without != importing
    for bar in range(1, 8):
        assert ecm_command(*of_bar(without, bar)).code == 0
    typed(ecm_command, fit)
    force = read_table([Path(f"p{bar}.csv") for bar in (2, 4, 6)]).column("fx_N")
    noise, spread = noise_and_spread(force)
    error = fresh_error(Path("linear.json"))
    assert error == pytest.approx(82.9, abs=0.05)
    assert error / spread == pytest.approx(1.0, abs=0.005)
    assert error / noise == pytest.approx(3210.0, abs=5.0)
    missing, add, after = typed(ecm_command, diagnose).splitlines()[:3]
    assert "each run has a wrench of its own, which no column tells" in missing
    assert add == "ADD IT:  nothing"
    assert "record in a column what was set or changed between the runs" in after
