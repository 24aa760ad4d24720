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
    "instron.csv": "Instrument,5944\n\nTime (s),Extension (mm),Load (N)\n",
    "strain.csv": "Tensile strain (%),Load (N)\n",
    "material.csv": "Strain (mm/mm),Stress (MPa)\n",
    "torsion.csv": "Elapsed Time (s),Axial Rotation (deg),Axial Torque (N.m)\n",
    "gauge.csv": "t,LVDT (mm),Load cell (N)\n",
    "twice.csv": "Displacement (mm),Extension (mm),Force (N)\n",
    "volts.csv": "time [s],x [mm],Force (V)\n",
    "microstrain.csv": "Chamber (°C),eps (µm/m),Load (N)\n",
    "no_names.csv": "",
    "unknown_names.csv": "a,b\n",
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
    run(*words).good()
    return words[words.index("--out") + 1]


def log(name: str) -> None:
    head = _LOGS[name]
    columns = (head.splitlines() or [",,"])[-1].count(",") + 1
    steps = np.linspace(0.0, 20.0, 30)
    rows = [",".join(f"{value:.4f}" for value in [k * 0.1, x, 2.0 * x][-columns:])
            for k, x in enumerate(steps)]  # fmt: skip
    Path(name).write_text(head + "\n".join(rows) + "\n", encoding="utf-8")


@pytest.mark.parametrize("name", _LOGS)
def test_a_raw_log_is_answered_with_the_import_that_works(name: str, ecm_command: Run) -> None:
    log(name)
    done = ecm_command("fit", name).refused()
    table = typed(ecm_command, done.err)
    assert ecm_command("fit", table, "--model", "linear", "--out", "model.json").code == 0


def test_a_check_of_names_that_it_does_not_doubt_ends_in_the_import(ecm_command: Run) -> None:
    """It was said to map the names in a TOML, though an import reads them all."""
    rows = "".join(f"{x},{2.0 * x + x % 2}\n" for x in np.linspace(-30.0, 30.0, 21))
    Path("joint.csv").write_text(f"angle_deg,torque_Nmm\n{rows}", encoding="utf-8")
    done = ecm_command("check", "joint.csv").good()
    table = typed(ecm_command, done.err or done.out)
    assert "ecm import" not in ecm_command("check", table).good().out


def test_a_model_that_nobody_named_is_called_like_its_table(ecm_command: Run) -> None:
    log("displacement.csv")
    assert ecm_command("import", "displacement.csv", "--out", "data.csv").code == 0
    assert ecm_command("fit", "data.csv", "--model", "linear").code == 0
    fitted = Path("data.json").read_bytes()
    done = ecm_command("fit", "data.csv", "--model", "quadratic").refused()
    assert Path("data.json").read_bytes() == fitted
    assert ecm_command(*advised(done.err)).code == 0
    assert "poly:2" in Path("data-2.json").read_text(encoding="utf-8")
    done = ecm_command("fit", "data.csv", "--model", "physics")
    assert "--out OUT" not in done.err


def test_an_angle_turns_about_an_axis_across(ecm_command: Run) -> None:
    shutil.copy(ROOT / "examples" / "hinge_log.csv", "hinge_log.csv")
    done = ecm_command("check", "hinge_log.csv").refused()
    assert "theta_z_rad" in Path(typed(ecm_command, done.err)).read_text(encoding="utf-8")


def test_a_model_in_the_place_of_the_table_is_told(ecm_command: Run) -> None:
    log("displacement.csv")
    assert ecm_command("import", "displacement.csv", "--out", "data.csv").code == 0
    assert ecm_command("fit", "data.csv", "--model", "linear", "--out", "model.json").code == 0
    for words in (
        ("compare", "data.csv", "model.json"),
        ("compare", "model.json", "model.json"),
        ("diagnose", "data.csv", "model.json"),
        ("fit", "model.json", "data.csv"),
        ("fit", "model.json"),
        ("check", "model.json"),
        ("import", "model.json"),
    ):
        done = ecm_command(*words, *(["--out", "m.json"] if words[0] == "fit" else [])).refused()
        assert "model.json is a model, expected a table of measurements" in done.err
        assert ecm_command(*advised(done.err)).code == 0
    done = ecm_command("export", "data.csv", "--to", "c", "--out", "folder").refused()
    assert ecm_command(*advised(done.err)).code == 0
    assert Path("data.json").is_file()


def test_a_workbook_is_told_how_it_becomes_a_table(ecm_command: Run) -> None:
    Path("log.xlsx").write_bytes(b"PK\x03\x04" + bytes(40))
    done = ecm_command("fit", "log.xlsx").refused()
    assert "Save the sheet of a workbook, or the file of another program, as CSV; or" in done.err


@pytest.mark.parametrize("table", sorted((ROOT / "examples").glob("*.csv")), ids=lambda p: p.stem)
def test_each_shipped_table_is_read_with_what_lies_beside_it(table: Path, ecm_command: Run) -> None:
    shutil.copytree(table.parent, "examples")  # what an import writes lies beside its log
    done = ecm_command("check", Path("examples", table.name))
    assert done.code == 0 or typed(ecm_command, done.err)  # of a log the import that is advised


def test_a_strain_becomes_a_displacement_by_the_gauge_length(ecm_command: Run) -> None:
    for name, column, worth, factor in (
        ("strain.csv", "x_m=Tensile strain (%)", "80 mm", 0.8e-3),
        ("material.csv", "fx_N=Stress (MPa)", "20 mm2", 20.0),
        ("volts.csv", "fx_N=Force (V)", "12.5 N", 12.5),
        ("microstrain.csv", "x_m=eps (µm/m)", "80 mm", 0.8e-7),
    ):
        log(name)
        words = ("import", name, "--axis", "x", "--map", f"{column}:{worth}", "--out", "t.csv")
        done = ecm_command(*words).good()
        assert f"* {factor:g}" in done.out
        assert name != "microstrain.csv" or "temperature_degC  Chamber (°C)" in done.out
    refused = ecm_command("import", "strain.csv", "--map", "x_m=Tensile strain (%):80 V").refused()
    assert "is no unit, nor what one of the column is worth" in refused.err


def test_an_import_that_is_refused_ends_in_one_that_works(ecm_command: Run) -> None:
    for name in ("twice.csv", "machine.csv", "no_names.csv", "no_units.csv"):
        log(name)
        done = ecm_command("import", name).refused()
        assert ecm_command(*advised(done.err)).code == 0


def test_published_logs_are_answered_with_an_import_that_works(
    shared_data: Path, ecm_command: Run, folder: Path
) -> None:
    logs = [
        *(shared_data / "finger_joint").glob("*.csv"),
        shared_data / "finger_joint" / "imu_raw" / "03IMU.txt",
        shared_data / "nist_load_cell" / "load_cell.csv",
        shared_data / "pneumatic_piston" / "circle_1bar.tsv",
        *(shared_data / "viscoelastic_shear").glob("*_relaxation*.csv"),
        shared_data / "rubber" / "Treloar_1944" / "UT" / "stress_stretch.txt",
    ]
    assert len(logs) == 11
    for path in logs:
        shutil.copy(path, path.name)
        done = ecm_command("fit", path.name, "--model", "linear", "--out", "model.json").refused()
        table = typed(ecm_command, done.err)
        assert ecm_command("fit", table, "--model", "linear", "--out", "model.json").code == 0


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("colours.csv", "name,colour\na,red\nb,blue\n", "Remove the column"),
        ("gauges.csv", "eps1 (um/m),eps2 (µε)\n1,2\n3,5\n4,9\n", "here is only 'eps1 (um/m)'"),
        ("stress.txt", "0.1\n0.2\n0.4\n", "a model needs a pose and a wrench in each row"),
    ],
)
def test_what_no_import_understands_has_no_command(
    name: str, text: str, words: str, ecm_command: Run
) -> None:
    Path(name).write_text(text, encoding="utf-8")
    done = ecm_command("fit", name, "--out", "model.json").refused()
    assert words.lower() in done.err.lower()
    assert "ecm import" not in done.err


def test_a_log_without_a_force_is_told_that_no_model_can_be_fitted(ecm_command: Run) -> None:
    Path("poses.csv").write_text("x [mm],time [s]\n1,0\n2,1\n4,2\n", encoding="utf-8")
    done = ecm_command("fit", "poses.csv", "--out", "model.json").refused()
    assert "No column may be a wrench, without which no model can be fitted" in done.err
    table = typed(ecm_command, done.err)
    again = ecm_command("fit", table, "--out", "model.json").refused()
    assert "so no model can be fitted" in again.err
    assert "ecm import" not in again.err


@pytest.mark.parametrize("given", [True, False])
def test_the_import_that_is_advised_takes_the_description_with_it(
    ecm_command: Run, folder: Path, given: bool
) -> None:
    """Else the noise, the frames and the mechanism that it states are lost without a word."""
    log("displacement.csv")
    text = "[instrument]\nforce_sd_N = 1.5\n"
    name = "bench.toml" if given else "displacement.toml"
    (folder / name).write_text(text, encoding="utf-8")
    meta = ("--meta", name) if given else ()
    table = typed(ecm_command, ecm_command("fit", "displacement.csv", *meta).refused().err)
    assert "force_sd_N = 1.5" in Path(table).with_suffix(".toml").read_text(encoding="utf-8")
