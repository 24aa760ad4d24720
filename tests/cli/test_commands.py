"""The command `ecm`: help, options that all share, results, and how it ends."""

from __future__ import annotations

import errno
import inspect
import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ecm._native import __version__, rotation_matrices
from ecm.cli import console
from ecm.cli.app import COMMANDS as REGISTRY
from ecm.cli.app import load_command
from ecm.cli.console import Console
from ecm.cli.main import reported
from ecm.cli.session import Session
from ecm.comparison import compare
from ecm.designs import CRITERIA
from ecm.effects import LinearEffect, Parameter, unregister
from ecm.errors import ComputationError, FemError, InputError, ModelError
from ecm.io.columns import POSE, STIFFNESS, WRENCH
from ecm.io.mechanism import Mechanism
from ecm.io.table import as_table, read_table
from ecm.models import PhysicsMap, fit_model
from ecm.models.refit import refit
from ecm.report.blocks import number
from support.campaigns import campaign, physics
from support.neck import (
    LENGTH_M,
    NECK_TOML,
    ROOT,
    Command,
    Done,
    columns_of,
    csv_text,
    neck_columns,
    neck_rows,
    saved,
)
from support.neck import STIFFNESS as K
from support.programs import ended

COMMANDS = sorted(set(REGISTRY) - {"material"})  # a group: `material fit`


def test_the_commands_are_those_of_this_version() -> None:
    names = "identify simulate fit predict design campaign check compare diagnose refit reveal"
    assert (
        sorted([*names.split(), "app", "effects", "export", "import", "measure", "new"]) == COMMANDS
    )


def test_a_command_that_moved_says_where_in_one_line(ecm_command: Command) -> None:
    done = ecm_command("head", "--out", "x", "--film", "x.gif")
    assert (done.code, done.err.count("\n")) == (2, 1)
    assert done.err.startswith("error: ecm head is an example of the repository now")
    assert (ROOT / "examples" / "head" / "__main__.py").is_file()
    assert "python examples/head --out DIR" in done.err


def test_help_of_all_loads_no_command() -> None:
    code = "import sys; from ecm.cli import run; run(['--help']); print([*sys.modules])"
    done = ended(sys.executable, "-c", code)
    loaded = done.stdout.splitlines()[-1]
    assert "ecm.cli.app" in loaded
    assert "ecm.cli.session" not in loaded
    assert "numpy" not in loaded


HELP = """
import sys
from ecm.cli import run
print(*[run([name, '--help']) for name in {names!r}])
parser = 'pydantic' in sys.modules
print(run(['fit']))
engines = 'numpy scipy matplotlib plotly mujoco ecm.io.table ecm.models ecm.fem ecm.rig'.split()
print(parser, [name for name in engines if name in sys.modules])
"""


def test_help_and_wrong_arguments_load_no_engine() -> None:
    """The help of a command takes little longer than that of all: both load the parser alone."""
    code = HELP.format(names=COMMANDS)
    done = ended(sys.executable, "-c", code)
    lines = done.stdout.splitlines()
    assert lines[-3] == " ".join("0" for _ in COMMANDS)
    assert lines[-2] == "2"
    # What typer converts values with is not needed for help, either.
    assert lines[-1] == "False []"


def test_the_help_of_design_names_all_criteria(ecm_command: Command) -> None:
    assert f"{', '.join(CRITERIA)}." in ecm_command("design", "--help").out


def _loaded(path: str) -> Any:
    """A function below `ecm`."""
    module, _, name = path.rpartition(".")
    return getattr(import_module(f"ecm.{module}"), name)


@pytest.mark.parametrize("name", REGISTRY)
def test_the_parser_states_what_the_functions_take(name: str) -> None:
    """It is read from their sources; loaded, they have the same names and defaults."""
    command, parser = REGISTRY[name], load_command(name)
    params = getattr(parser, "commands", {"fit": parser})["fit"].params
    read = {p.name: p.default for p in params if p.name != "help"}
    work = inspect.signature(_loaded(f"cli.{command.work}"))
    taken = dict(list(work.parameters.items())[1:])  # without the session
    if command.passed:
        public = {}
        for source in command.of.split():
            public |= inspect.signature(_loaded(source)).parameters
        taken |= {name: public[name] for name in command.passed.split()}
        assert set(command.passed.split()) <= {*work.parameters} or "options" in work.parameters
    taken = {**taken, **inspect.signature(Session).parameters}
    taken.pop("options", None)
    assert set(read) <= set(taken)
    left_out = set() if "report" in command.common else {"report"}
    left_out |= set() if "tables" in command.common else {"meta", "skip_bad_rows"}
    assert set(taken) - set(read) <= left_out
    instead = {inspect.Parameter.empty: None, (): []}
    defaults = {name: taken[name].default for name in read}
    assert read == {name: instead.get(value, value) for name, value in defaults.items()}


@pytest.mark.parametrize("name", ["", *COMMANDS])
def test_help_is_one_screen(name: str, ecm_command: Command) -> None:
    done = ecm_command(*([name] if name else []), "--help").good()
    lines = done.out.rstrip("\n").split("\n")
    assert len(lines) <= 24, done.out
    assert max(len(line) for line in lines) <= 80, done.out
    assert "..." not in done.out.replace("...}", "").replace("ARGS]...", "").replace(
        "TABLE]...", ""
    ).replace("DATA...", "").replace("k_fx_x ...", "").replace("}...", ""), done.out


def test_the_commands_stand_in_three_groups(ecm_command: Command) -> None:
    lines = ecm_command("--help").out.splitlines()
    titles = [line for line in lines if line.endswith(":") and not line.startswith(" ")]
    assert titles == ["Your data:", "Plan and measure:", "Simulated rig:"]


def test_no_option_that_the_documentation_uses_is_hidden() -> None:
    pages = [*(ROOT / "docs").rglob("*.md"), ROOT / "README.md", *ROOT.glob("examples/*.toml")]
    used = set()
    for page in pages:
        text = page.read_text(encoding="utf-8").replace("\\\n", " ")
        for name, options in re.findall(r"\becm ([a-z]+(?: fit)?)( [^\n`|]*)", text):
            used |= {(name.split()[0], one) for one in re.findall(r"(?<!\S)--[a-z-]+", options)}
    assert len(used) > 50
    hidden = set()
    for name in REGISTRY:
        parser = load_command(name)
        for param in getattr(parser, "commands", {"fit": parser})["fit"].params:
            hidden |= {(name, one) for one in param.opts if getattr(param, "hidden", False)}
    assert used & hidden == set()


def test_the_shell_completes_commands_and_options() -> None:
    for line, word, found in (
        ("ecm fi", 1, ["fit"]),
        ("ecm fit --le", 2, ["--leave-out"]),
        ("ecm export --pre", 2, ["--precision"]),
    ):
        asked = {"_ECM_COMPLETE": "complete_bash", "COMP_WORDS": line, "COMP_CWORD": str(word)}
        code = "from ecm.cli import main; main()"
        done = ended(sys.executable, "-c", code, env=os.environ | asked)
        assert done.stdout.split() == found, done.stderr


def test_rows_are_left_out_by_one_name_and_the_old_one_is_taken(
    tmp_path: Path, ecm_command: Command
) -> None:
    x = np.linspace(-0.01, 0.01, 12)
    text = csv_text({"x_m": x, "fx_N": 2000.0 * x}).replace("20.0\n", "nan\n", 1)
    (tmp_path / "d.csv").write_text(text)
    for name in ("--leave-out", "--skip-bad-rows"):
        done = ecm_command(
            "fit", tmp_path / "d.csv", name, "--model", "linear", "--out", tmp_path / "m.json"
        ).good()
        assert "left out 1 row(s)" in done.err
        assert "column 'fx_N'" in done.err
    for command in ("fit", "compare", "check", "import"):
        help_text = ecm_command(command, "--help").out
        assert "--leave-out" in help_text
        assert "--skip-bad-rows" not in help_text


def test_every_result_has_a_page(tmp_path: Path, ecm_command: Command) -> None:
    assert {name for name in REGISTRY if "report" not in REGISTRY[name].common} == {"new"}
    x = np.linspace(-0.01, 0.01, 30)
    data, model, page = (tmp_path / name for name in ("d.csv", "m.json", "page.html"))
    data.write_text(csv_text({"x_m": x, "fx_N": 2000.0 * x + 1e-3 * np.cos(1e5 * x)}))
    for words, said in (
        (("check", data), "Testable effects"),
        (("fit", data, "--model", "cubic", "--out", model), "Measured and modelled"),
        (("predict", model, data, "--out", tmp_path / "p.csv"), "predicted columns"),
        (("effects", "payload"), "payload"),
    ):
        page.unlink(missing_ok=True)
        ecm_command(*words, "--report", page).good()
        assert said in page.read_text(encoding="utf-8")


def test_version_and_no_arguments(ecm_command: Command) -> None:
    assert ecm_command("--version").out == f"ecm {__version__}\n"
    assert "Usage: ecm" in ecm_command().err + ecm_command().out


def read(path: Path) -> dict[str, Any]:
    document: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return document


def test_check_writes_what_it_says(neck_csv: Path, tmp_path: Path, ecm_command: Command) -> None:
    done = ecm_command("check", neck_csv, "--json", tmp_path / "check.json").good()
    assert "60 rows" in done.out
    document = read(tmp_path / "check.json")
    assert document["rows"] == 60
    assert {column["name"] for column in document["columns"]} == {*POSE, *WRENCH}
    assert "fts_gain" in document["testable"]
    reasons = {one["id"]: one["reason"] for one in document["not_testable"]}
    assert "length is not known" in reasons["anisotropy"]  # as diagnose says


def test_quiet_says_nothing(neck_csv: Path, tmp_path: Path, ecm_command: Command) -> None:
    done = ecm_command("check", neck_csv, "--quiet", "--json", tmp_path / "check.json")
    assert (done.code, done.out, done.err) == (0, "", "")
    assert (tmp_path / "check.json").exists()


def test_fit_and_predict(tmp_path: Path, ecm_command: Command) -> None:
    """Noise-free rows of a linear mechanism: the model gives wrench and stiffness back."""
    poses, _ = neck_rows(80)

    wrenches = (poses - [LENGTH_M, 0, 0, 0, 0, 0]) @ K
    columns = columns_of(poses, wrenches)
    (tmp_path / "d.csv").write_text(csv_text(columns), encoding="utf-8")
    ecm_command(
        "fit", tmp_path / "d.csv", "--model", "linear", "--out", tmp_path / "m.json",
        "--json", tmp_path / "fit.json",
    ).good()  # fmt: skip
    assert read(tmp_path / "fit.json")["components"]["fx_N"]["rmse"] < 1e-9
    new, _ = neck_rows(5, seed=3)
    asked = {"pose_id": np.arange(5.0), **dict(zip(POSE, new.T, strict=True))}
    asked |= {"fx_N": np.zeros(5), "humidity": np.full(5, 40.0)}
    (tmp_path / "p.csv").write_text(csv_text(asked), encoding="utf-8")
    ecm_command(
        "predict", tmp_path / "m.json", tmp_path / "p.csv", "--out", tmp_path / "out.csv",
        "--stiffness",
    ).good()  # fmt: skip
    table = read_table(tmp_path / "out.csv")
    # The input's columns keep their order, fx_N its place; predicted ones follow.
    assert list(table.columns)[: len(asked)] == list(asked)
    assert table.column("humidity").tolist() == [40.0] * 5
    expected = (new - [LENGTH_M, 0, 0, 0, 0, 0]) @ K
    np.testing.assert_allclose(table.wrenches, expected, atol=1e-8)
    assert [name for name in table.columns if name.startswith("k_")] == list(STIFFNESS)
    np.testing.assert_allclose(
        table.matrix(STIFFNESS).reshape(5, 6, 6), np.broadcast_to(K, (5, 6, 6)), atol=1e-5
    )
    assert "sd_fx_N" in table.columns


def test_predicting_far_away_warns(neck_csv: Path, tmp_path: Path, ecm_command: Command) -> None:
    ecm_command("fit", neck_csv, "--model", "linear", "--out", tmp_path / "m.json")
    far = {name: np.full(3, 0.7) for name in POSE}
    (tmp_path / "p.csv").write_text(csv_text(far), encoding="utf-8")
    done = ecm_command("predict", tmp_path / "m.json", tmp_path / "p.csv", "--out",
                       tmp_path / "o.csv").good()  # fmt: skip
    assert "3 of 3 poses are outside what the model was trained on" in done.err


def test_compare_prints_every_component(
    neck_csv: Path, tmp_path: Path, ecm_command: Command
) -> None:
    ecm_command("fit", neck_csv, "--model", "linear", "--out", tmp_path / "m.json")
    done = ecm_command(
        "compare", tmp_path / "m.json", neck_csv, "--json", tmp_path / "c.json",
        "--report", tmp_path / "c.html",
    ).good()  # fmt: skip
    for word in ("RMSE", "bias", "% of the spread", *WRENCH):
        assert word in done.out
    assert "noise floor" not in done.out  # the noise of this table is assumed
    assert set(read(tmp_path / "c.json")["rmse"]) == set(WRENCH)
    page = (tmp_path / "c.html").read_text(encoding="utf-8")
    assert "% of the spread" in page
    assert "http://" not in re.sub(r"http://www\.w3\.org[^\s\"']*", "", page.split("<main>")[1])


def test_compare_sets_four_references_side_by_side(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ecm_command: Command
) -> None:
    """An energy model too: the physics base is that of the table's [mechanism]."""
    asked: list[Mechanism] = []

    def built(body: Mechanism, **_: object) -> PhysicsMap:
        asked.append(body)
        return physics()

    monkeypatch.setattr("ecm.comparison.reference_models.kept_physics", built)
    table = campaign("base_compliance", 2.0, 1)
    body = Mechanism().to_dict()
    table.with_meta(replace(table.meta, mechanism=body)).write(tmp_path / "d.csv")
    fit_model(table, "linear").save(tmp_path / "m.json")
    done = ecm_command(
        "compare", tmp_path / "m.json", tmp_path / "d.csv", "--json", tmp_path / "c.json",
        "--report", tmp_path / "c.html",
    ).good()  # fmt: skip
    assert asked[0].radius_m == 0.033
    document = read(tmp_path / "c.json")
    known = document["references"]
    page = (tmp_path / "c.html").read_text(encoding="utf-8").split("<main>")[1]
    shown = ("physics base", "physics"), ("symmetric energy", "energy"), ("ceiling", "ceiling")
    for name, key in (*shown, ("noise floor", "floor")):
        assert re.search(rf"^{name} +{number(known[key])} ", done.out, re.MULTILINE)
        assert f"{name}</td>" in page
        assert number(known[key]) in page
    assert known["sentence"] in done.out
    assert known["sentence"] in page
    assert "elasticity or geometry that keeps the symmetry" in known["sentence"]
    # Lack of fit of each component beside that of all.
    for name in ("all", *WRENCH):
        test = document["lack_of_fit"]
        if name != "all":
            test = next(c for c in document["components"] if c["name"] == name)["lack_of_fit"]
        found = re.search(rf"^{name} +(\S+) +\S+ +\S+ +(\S+)$", done.out, re.MULTILINE)
        assert found is not None
        assert found.groups() == (f"{test['F']:.6g}", f"{test['p']:.2g}")


def test_a_single_row_is_compared_and_drawn(tmp_path: Path, ecm_command: Command) -> None:
    """Catches a report that takes for granted that something varies."""
    (tmp_path / "d.csv").write_text(csv_text(neck_columns()), encoding="utf-8")
    (tmp_path / "one.csv").write_text(csv_text(neck_columns(1)), encoding="utf-8")
    ecm_command("fit", tmp_path / "d.csv", "--model", "linear", "--out", tmp_path / "m.json")
    ecm_command(
        "compare", tmp_path / "m.json", tmp_path / "one.csv", "--report", tmp_path / "c.html"
    ).good()
    assert "% of the spread" in (tmp_path / "c.html").read_text(encoding="utf-8")


def test_effects_lists_and_explains(tmp_path: Path, ecm_command: Command) -> None:
    listed = ecm_command("effects", "--json", tmp_path / "e.json")
    ids = {effect["id"] for effect in read(tmp_path / "e.json")["effects"]}
    assert {"fts_offset", "fts_drift", "payload", "base_compliance", "tip_frame_misalignment",
            "hysteresis", "temperature_modulus", "anisotropy"} <= ids  # fmt: skip
    assert all(id in listed.out for id in ids)
    few = listed.out.partition("With fewer than the twelve columns of pose and wrench also:\n")[2]
    assert few.startswith("jump ")
    assert "\ngrowing_load " in few
    needs = "needs: time (time_s), or rows step by step, and motion both ways"
    assert needs in ecm_command("effects", "backlash").out
    one = ecm_command("effects", "hysteresis").good()
    assert "parameter" in one.out
    assert "confused with" in one.out
    for line in ("needs: poses reached from both sides (approach, ", "side: physics", "kind: time"):
        assert f"\n{line}" in one.out
    # Of a kink the columns of the table say which, and no table of none is printed.
    assert "ordinary size" not in ecm_command("effects", "kink").good().out
    plain = ecm_command("effects", "fts_offset").out
    assert "\nneeds: nothing beside pose and wrench\nside: measurement" in plain
    effects = {effect["id"]: effect for effect in read(tmp_path / "e.json")["effects"]}
    both = "poses reached from both sides (approach, or the order of time_s)"
    assert effects["hysteresis"]["needs"] == both
    assert effects["fts_offset"]["needs"] == ""
    assert (effects["pose_noise"]["side"], effects["pose_noise"]["kind"]) == (
        "measurement", "noise",
    )  # fmt: skip


def test_effects_of_installed_packages_are_known(
    monkeypatch: pytest.MonkeyPatch, ecm_command: Command
) -> None:
    class Draught(LinearEffect):
        id = "draught"
        physics = "A fan blows on the platform."
        parameters = (Parameter("force", "N", 0.1),)

    class Point:
        def __init__(self, load: Callable[[], object]) -> None:
            self.load = load

    def broken() -> object:
        raise ImportError("no module named fan")

    def offer(load: Callable[[], object]) -> None:
        monkeypatch.setattr("importlib.metadata.entry_points", lambda group: [Point(load)])

    offer(lambda: Draught)
    try:
        assert "A fan blows on the platform" in ecm_command("effects", "draught").out
    finally:
        unregister("draught")
    offer(broken)
    done = ecm_command("effects").refused()
    assert "no module named fan" in done.err


@pytest.mark.parametrize("what", ["config", "arm", "rig", "data"])
def test_new_writes_a_file_once(
    what: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ecm_command: Command
) -> None:
    monkeypatch.chdir(tmp_path)
    assert ecm_command("new", what).code == 0
    written = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert written
    assert ecm_command("new", what).code == 2
    assert written == {path.name: path.read_bytes() for path in tmp_path.iterdir()}


def test_from_candidates_to_a_refit_and_the_truth(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    ecm_command: Command,
    neck_physics: PhysicsMap,
) -> None:
    """design, campaign, fit, compare, refit and reveal pass their files on to each other."""
    monkeypatch.chdir(tmp_path)
    poses, _ = neck_rows(40)
    candidates = {"pose_id": np.arange(40.0) + 100, **dict(zip(POSE, poses.T, strict=True))}
    Path("c.csv").write_text(csv_text(candidates), encoding="utf-8")
    Path("c.toml").write_text(NECK_TOML, encoding="utf-8")
    Path("rig.toml").write_text("[rig]\ndwell_s = 5.0\n", encoding="utf-8")

    def done(*arguments: object) -> Done:
        return ecm_command(*arguments).good()

    said = done("design", "c.csv", "--n", "14", "--model", "linear", "--out", "plan.csv",
                "--json", "design.json")  # fmt: skip
    assert "14 poses" in said.out
    plan = read_table("plan.csv")
    rows = read(Path("design.json"))["rows"]
    assert len(set(rows)) == 14
    # Rows count from 1; the plan is in visiting order.
    assert sorted(plan.column("pose_id")) == [row - 1 + 100.0 for row in rows]
    visited = plan.column("pose_id").astype(int) - 100
    np.testing.assert_array_equal(plan.poses, poses[visited])
    assert plan.meta.mechanism["radius_m"] == 0.033

    done("campaign", "plan.csv", "--rig", "rig.toml", "--out", "data.csv", "--hide",
         "fts_offset=5", "--seed", "3")  # fmt: skip
    data = read_table("data.csv")
    assert len(data) == 14
    assert data.column("dwell_s").tolist() == [5.0] * 14
    assert data.meta.instrument.force_sd_N == pytest.approx(0.3, rel=0.05)
    assert "fts_offset" not in Path("data.csv").read_text(encoding="utf-8")
    measured = Path("data.csv").read_bytes()
    again = ecm_command("campaign", "plan.csv", "--rig", "rig.toml", "--out", "data.csv").refused()
    assert "measurements are not overwritten" in again.err
    assert Path("data.csv").read_bytes() == measured
    assert "fts_offset" not in Path("data.toml").read_text(encoding="utf-8")

    done("fit", "data.csv", "--model", "energy4", "--out", "m.json")
    said = done("compare", "m.json", "data.csv", "--json", "before.json")
    assert "physics base" in said.out
    said = done("refit", "m.json", "data.csv", "--add", "fts_offset", "--out", "n.json", "--json",
                "refit.json")  # fmt: skip
    assert "fts_offset (instruments)" in said.out
    together = read(Path("refit.json"))["correlations"]
    assert together
    for pair in together:
        assert "{} and {}: {:+.2f}".format(*pair["between"], pair["value"]) in said.out
    done("compare", "n.json", "data.csv", "--json", "after.json")
    before, after = read(Path("before.json")), read(Path("after.json"))
    assert after["whitened_rms"] < 0.5 * before["whitened_rms"]
    assert [effect["id"] for effect in read(Path("refit.json"))["effects"]] == ["fts_offset"]

    Path("answer.json").write_text(
        json.dumps({"schema": 1, "verdict": "named", "answer": [["fts_offset"]]}), encoding="utf-8"
    )
    told = done("reveal", "data.csv", "--answer", "answer.json", "--json", "truth.json")
    assert "fts_offset" in told.out
    assert "the answer is right" in told.out
    assert read(Path("truth.json"))["effects"][0]["s"] == 5.0


def test_a_plan_replaces_nothing_but_a_plan(
    neck_csv: Path, tmp_path: Path, ecm_command: Command
) -> None:
    """Catches measurements, or the description of a rig, that are lost to a wrong name."""
    model, plan = tmp_path / "m.json", tmp_path / "plan.csv"
    ecm_command("fit", neck_csv, "--model", "linear", "--out", model)
    ways: tuple[tuple[object, ...], ...] = (
        ("design", neck_csv, "--n", "14", "--time-limit", "0.2", "--model", "linear", "--out"),
        ("diagnose", model, neck_csv, "--next"),
    )
    measured = neck_csv.read_bytes()
    for way in ways:
        done = ecm_command(*way, neck_csv).refused()
        assert "is no plan, and is not overwritten" in done.err
        assert neck_csv.read_bytes() == measured
    rig = saved(tmp_path / "plan.toml", "[rig]\ndwell_s = 5.0\n")
    for way in ways:
        done = ecm_command(*way, plan).refused()
        assert "plan.toml, which" in done.err
        assert "description would overwrite" in done.err
        assert rig.read_text(encoding="utf-8") == "[rig]\ndwell_s = 5.0\n"
    rig.unlink()
    for _ in range(2):
        assert ecm_command(*ways[0], plan).code == 0


def test_no_description_replaces_settings(
    neck_csv: Path, tmp_path: Path, ecm_command: Command
) -> None:
    """Catches `ecm simulate neck.toml --out neck.csv`, which replaced the settings it had read."""
    plan = tmp_path / "plan.csv"
    model = tmp_path / "m.json"
    ecm_command("fit", neck_csv, "--model", "linear", "--out", model)
    ecm_command("design", neck_csv, "--n", 9, "--model", "linear", "--out", plan, "--iterations", 9)
    settings = tmp_path / "neck.toml"
    out = tmp_path / "neck.csv"
    for text in (NECK_TOML, f"# Mine.\n{NECK_TOML}[simulate]\nn = 3\n", "[rig]\ndwell_s = 5.0\n"):
        settings.write_text(text, encoding="utf-8")
        ways = [("simulate", settings, "--out", out)]
        if "cylinder" not in text:
            ways = [
                ("campaign", plan, "--rig", settings, "--out", out, "--overwrite"),
                ("predict", model, plan, "--out", out),
            ]
        for way in ways:
            done = ecm_command(*way).refused()
            assert f"{settings.name}, which" in done.err
            assert "Choose another name" in done.err
            assert settings.read_text(encoding="utf-8") == text


def test_diagnose_reports_a_verdict(tmp_path: Path, ecm_command: Command) -> None:
    """An offset of the sensor in its own axes, against the energy model (only L is known)."""
    columns = neck_columns(80)
    rotations = rotation_matrices(np.column_stack([columns[name] for name in POSE[3:]]))
    for j, name in enumerate(WRENCH[:3]):
        columns[name] = columns[name] + 3.0 * rotations[:, j, 1]
    (tmp_path / "d.csv").write_text(csv_text(columns), encoding="utf-8")
    (tmp_path / "d.toml").write_text(
        "[mechanism]\nlength_m = 0.1034\n[instrument]\nforce_sd_N = 0.3\ntorque_sd_Nm = 0.01\n"
        "pose_position_sd_m = 1e-7\npose_rotation_sd_rad = 1e-6\n",
        encoding="utf-8",
    )
    data = tmp_path / "d.csv"
    assert ecm_command("fit", data, "--model", "energy4", "--out", tmp_path / "m.json").code == 0
    done = ecm_command(
        "diagnose", tmp_path / "m.json", data, "--json", tmp_path / "d.json", "--report",
        tmp_path / "d.html", "--seed", "7", "--details",
    ).good()  # fmt: skip
    document = read(tmp_path / "d.json")
    assert document["seed"] == 7
    assert document["verdict"] in ("none", "named", "ambiguous", "unknown")
    assert document["sentence"] in done.out
    assert document["not_testable"][0]["id"] in done.out
    assert "verdict" in (tmp_path / "d.html").read_text(encoding="utf-8")


# --- how it ends ------------------------------------------------------------


@pytest.mark.parametrize(
    ("error", "code", "says"),
    [
        (KeyboardInterrupt(), 130, "Interrupted; "),
        (OSError(errno.ENOSPC, "No space left on device", "d.csv"), 1, "the disk is full"),
        (PermissionError(errno.EACCES, "Permission denied", "d.csv"), 1, "Permission denied"),
        (MemoryError(), 1, "not enough memory"),
        (RuntimeError("inner"), 1, "please report it"),
        (ZeroDivisionError(), 1, "please report it"),
    ],
)
def test_nobody_sees_a_traceback(
    error: BaseException, code: int, says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert reported(raising(error)) == code
    done = capsys.readouterr()
    assert says in done.err
    assert "Traceback" not in done.err


def test_errors_of_the_computation_and_of_the_input_differ(
    capsys: pytest.CaptureFixture[str],
) -> None:
    for error, code in (
        (ComputationError("no convergence"), 1),
        (InputError("wrong"), 2),
        (ModelError("wrong model"), 2),
        (FemError("wrong mesh"), 2),
    ):
        assert reported(raising(error)) == code
        assert capsys.readouterr().err.startswith(f"error: {error}")


def raising(error: BaseException) -> Callable[[], int]:
    """Work that ends with this exception."""

    def work() -> int:
        raise error

    return work


# A shell that puts the tests in the background has SIGINT ignored in all that they begin.
INTERRUPTED = """
import importlib, signal, time
signal.signal(signal.SIGINT, signal.default_int_handler)
from ecm.cli import main
def endless(*args, progress=None, **more):
    print("begun", flush=True)
    while True:
        time.sleep(0.01)
importlib.import_module("ecm.fem.simulate").simulate = endless
main()
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_with_130_and_says_what_is_kept(number: int, tmp_path: Path) -> None:
    (tmp_path / "c.toml").write_text("", encoding="utf-8")
    process = subprocess.Popen(
        [sys.executable, "-c", INTERRUPTED, "simulate", "c.toml", "--out", "s.csv"],
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert process.stdout is not None
    timer = threading.Timer(30.0, process.kill)  # a test that waits for ever tells nothing
    timer.start()
    assert process.stdout.readline() == "begun\n"
    process.send_signal(number)
    _, err = process.communicate()
    timer.cancel()
    assert process.returncode == 130
    said = "Interrupted; finished cases are kept in s.parts. The same command goes on there.\n"
    assert err == said


def test_a_reader_that_goes_away_is_no_traceback(tmp_path: Path) -> None:
    table = {f"own_{i}": np.arange(3.0) for i in range(3000)} | {"y_m": np.arange(3.0) / 10}
    (tmp_path / "d.csv").write_text(csv_text(table), encoding="utf-8")
    process = subprocess.Popen(
        [sys.executable, "-m", "ecm", "check", "d.csv"],
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.readline()
    process.stdout.close()
    err = process.stderr.read()
    assert process.wait(timeout=20) == 1
    assert "Traceback" not in err
    assert "Exception ignored" not in err
    process.stderr.close()


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="full disk: no /dev/full here")
def test_a_full_disk_is_said(neck_csv: Path) -> None:
    with open("/dev/full", "w", encoding="utf-8") as full:
        done = subprocess.run(
            [sys.executable, "-m", "ecm", "check", str(neck_csv)],
            stdout=full, stderr=subprocess.PIPE, text=True, check=False,
        )  # fmt: skip
    assert done.returncode == 1
    assert "the disk is full" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_long_work_tells_its_step_and_the_time_left(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(console, "_FIRST_LINE_S", 0.01)
    monkeypatch.setattr(console, "_LINE_EVERY_S", 0.01)
    said = ""

    def until(words: str) -> None:
        nonlocal said
        for _ in range(2000):  # it fails, rather than that it waits for ever
            if words in said:
                break
            time.sleep(0.005)
            said += capsys.readouterr().err
        assert words in said

    with Console().working("fitting") as tell:
        until("fitting: 0 s so far\n")
        tell(0, 4, "noise")
        until("fitting, noise, 0 s so far: 0 of 4\n")
        tell(3, 4, "all values")
        until("fitting, all values, 0 s so far: 3 of 4, about 0 s left\n")
    with Console(quiet=True).working("fitting") as tell:
        tell(0, 4, "noise")
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("name", sorted({*REGISTRY} - {"app", "effects", "new", "reveal"}))
def test_every_command_that_computes_says_how_far_it_is(name: str) -> None:
    """All but those that compute nothing, and the page, which shows the progress of its steps."""
    source = inspect.getsource(inspect.getmodule(_loaded(f"cli.{REGISTRY[name].work}")))
    assert re.search(r"session\.working\(|session\.progress\(|console=session", source)


def test_compare_and_refit_tell_their_steps() -> None:
    x = np.linspace(-1.0, 1.0, 60)
    columns = {"theta_z_rad": x, "tau_z_Nm": 2.0 * x + 0.1 * np.sign(x), "time_s": 9.0 * x + 9.0}
    table = as_table(columns)
    model = fit_model(table, "linear")
    told: list[tuple[int, int, str]] = []

    def progress(*step: Any) -> None:
        told.append(step)

    compared = compare(model, table, progress=progress)
    compared.complete(progress)
    assert [words for *_, words in told] == [
        "errors", "structure of the errors", "pose errors", "reference models", "residual maps",
    ]  # fmt: skip
    refitted: list[tuple[int, int, str]] = []
    refit(model, table, add=["fts_drift"], force=True, progress=lambda *step: refitted.append(step))
    assert refitted[1][2] == "form of fts_drift"
    for steps in (told, refitted):
        done = [step[0] for step in steps]
        assert done[0] == 0
        assert done == sorted(set(done))
        assert done[-1] < steps[-1][1] == steps[0][1]
