"""Every long work tells how much of it is done, and the command how much time is left."""

from __future__ import annotations

import ast
import itertools
import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ecm.cli import console
from ecm.cli.console import Console
from ecm.cli.main import run
from ecm.fem.material_fit import MaterialTest, fit_material
from ecm.io import events
from ecm.io.mechanism import Material
from ecm.io.table import Table, as_table, read_table
from ecm.logs.importing import import_log, read_log
from ecm.models import fit_model, parse_model, prediction
from ecm.models.check import check
from ecm.models.fit_summary import fit_summary
from ecm.models.model import Model
from ecm.models.selection import cross_validate, learning_curve
from support.neck import ROOT, Command, columns_of

Told = list[tuple[float, float, str]]


def hinge(rows: int) -> Table:
    """A log of one angle."""
    t = 0.01 * np.arange(rows)
    angle = 0.3 * np.sin(t)
    noise = np.random.default_rng(1).normal(0.0, 0.01, rows)
    return as_table({"theta_z_rad": angle, "tau_z_Nm": 2.0 * angle + angle**3 + noise, "time_s": t})


def six(rows: int) -> Table:
    """Random poses of a stiff spring with six coordinates."""
    poses = np.random.default_rng(2).uniform(-0.01, 0.01, (rows, 6))
    wrenches = poses * [2e4, 3e3, 3e3, 4.0, 9.0, 9.0] + 0.01 * np.sin(1e4 * poses)
    poses[:, 0] += 0.1
    columns = columns_of(poses, wrenches)
    return as_table(columns, meta={"mechanism": {"length_m": 0.1}})


def rubber() -> MaterialTest:
    """A uniaxial test."""
    stretch = np.linspace(0.8, 1.6, 9)
    solid = Material("neo_hookean", {"young_modulus_Pa": 6e5})
    return MaterialTest("uniaxial", stretch, solid.nominal_stress("uniaxial", stretch))


def held_out(told: Any) -> None:
    """The summary of a fit, whose folds are ten fits."""
    table, linear = hinge(300), parse_model("linear")
    fit_summary(fit_model(table, "linear"), table, linear, progress=told)


WORKS: dict[str, tuple[int, Callable[[Any], object]]] = {
    # The least number of words, and the work.
    "energy": (7, lambda told: fit_model(six(300), "energy4", force=True, progress=told)),
    "energy of many rows": (
        9, lambda told: fit_model(six(10_000), "energy4", force=True, progress=told)
    ),
    "cubic of many rows": (2, lambda told: fit_model(hinge(100_000), "cubic", progress=told)),
    "held-out rows": (10, held_out),
    "held-out of many rows": (
        4, lambda told: cross_validate(hinge(10_500), "cubic", progress=lambda *w: told(*w, "")),
    ),
    "poses": (6, lambda told: learning_curve(
        six(100), "linear", [10, 20, 40], draws=2, progress=told)),
    "check": (20, lambda told: check(hinge(300), progress=told)),
    "material": (15, lambda told: fit_material([rubber()], progress=told)),
    "rod": (3, lambda told: fit_model(six(20), "rod", force=True, progress=told)),
}  # fmt: skip


@pytest.mark.parametrize("name", WORKS)
def test_a_work_counts_its_parts(name: str) -> None:
    """From nothing done, never backwards within a whole, never beyond it."""
    least, work = WORKS[name]
    told: Told = []
    work(lambda done, total, *words: told.append((done, total, "".join(words))))
    assert len(told) >= least
    assert told[0][0] == 0
    for before, after in itertools.pairwise(told):
        assert after[0] >= before[0] or after[0] == 0
    assert all(0 <= done <= total for done, total, _ in told)


def test_the_passes_of_an_energy_are_judged_by_their_changes() -> None:
    told: Told = []
    fit_model(six(300), "energy4", force=True, progress=lambda *words: told.append(words))
    passes = [words for *_, words in told if "pass" in words]
    assert passes[0] == "all rows, pass 1 of about 6"
    last = re.fullmatch(r"all rows, pass (\d+) of about (\d+)", passes[-1])
    assert last is not None
    assert int(last[1]) == int(last[2])


def test_files_are_counted_by_their_bytes_and_rows(tmp_path: Path) -> None:
    table, read, written = hinge(20_000), list[Any](), list[Any]()
    for name in ("a.csv", "b.csv"):
        table.write(tmp_path / name, progress=lambda *words: written.append(words))
    sizes = [(tmp_path / name).stat().st_size for name in ("a.csv", "b.csv")]
    again = read_table(
        [tmp_path / "a.csv", tmp_path / "b.csv"], progress=lambda *words: read.append(words)
    )
    assert np.array_equal(again["tau_z_Nm"][:20_000], table["tau_z_Nm"])
    assert [done for done, *_ in written[:5]] == [0, 4096, 8192, 12288, 16384]
    assert {total for _, total, _ in read} == {sum(sizes)}
    done = [done for done, *_ in read]
    assert done == sorted(done)
    assert done[0] == 0
    # The checks after the last byte are a quarter of a file's share.
    assert done[-1] == sum(sizes) - 0.25 * sizes[1]
    assert read[-1][2] == f"{tmp_path / 'b.csv'}, checks"


def test_the_rows_of_a_text_are_told_as_they_are_read(tmp_path: Path) -> None:
    rows = "".join(f"{i};0,{i};2,5\n" for i in range(50_000))
    (tmp_path / "log.csv").write_text(f"time [s];angle [rad];torque [Nm]\n{rows}")
    read, written = list[Any](), list[Any]()
    log = read_log(tmp_path / "log.csv", [], lambda *words: read.append(words))
    assert read[0] == (4096, 50_000, "")
    assert read[-1] == (50_000, 50_000, "")
    assert len(read) == 13
    imported = import_log(log, axis="z")
    assert imported.columns["tau_z_Nm"].tolist() == [2.5] * 50_000
    imported.write(tmp_path / "t.csv", progress=lambda *words: written.append(words))
    assert written[-1] == (49_152, 50_000, "")


def test_what_is_left_falls_while_one_part_lasts(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    steps = console._Progress("fitting")
    assert steps.line(1.0) == "fitting: 1 s so far"
    steps.tell(0, 1000, "")
    assert steps.line(9.0) == "fitting, 9 s so far: 0 %"
    now[0] = 10.0
    steps.tell(250, 1000, "pass 1", "")
    shown = {
        10.0: "10 s so far: 25 %, about 30 s left",
        25.0: "25 s so far: 62 %, about 15 s left",
        39.0: "39 s so far: 88 %, about 6 s left",  # not over at once
        110.0: "2 min so far: 88 %, about 20 s left",
    }
    for at, words in shown.items():
        assert steps.line(at) == f"fitting, pass 1, {words}"
    steps.tell(500, 1000, "pass 2")
    assert steps.line(10.0) == "fitting, pass 2, 10 s so far: 50 %, about 10 s left"
    steps.tell(0, 10, "measuring")  # a count of its own
    now[0] = 34.0
    steps.tell(5, 10, "measuring")
    assert steps.line(34.0) == "fitting, measuring, 34 s so far: 5 of 10, about 24 s left"
    steps.tell(10, 10, "measuring")
    assert steps.line(34.0) == "fitting, measuring, 34 s so far: 10 of 10"


def test_a_work_that_slows_down_is_not_said_to_be_over_soon(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now = [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    steps = console._Progress("FEM")
    steps.tell(0, 91)
    now[0] = 9.0
    steps.tell(90, 91)
    for now[0] in range(10, 70):  # told again and again where it stands
        steps.tell(90, 91)
    assert steps.line(69.0).endswith("69 s so far: 90 of 91, about 12 s left")
    for k in range(1, 11):  # it creeps
        now[0] = 69.0 + 10.0 * k
        steps.tell(90 + 0.01 * k, 91)
    assert steps.line(169.0).endswith("90 of 91, about 15 min left")


def test_a_count_that_is_corrected_keeps_its_speed(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    steps = console._Progress("FEM")
    for now[0], done in ((0.0, 0), (10.0, 7), (20.0, 14), (22.0, 11)):
        steps.tell(done, 60)
    # Before: nothing is known of a count that begins at 11.
    assert steps.line(22.0).endswith("11 of 60, about 2 min left")


def test_predict_says_the_time_left(
    ecm_command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    table = hinge(400)
    fit_model(table, "linear").save(tmp_path / "m.json")
    table.write(tmp_path / "d.csv")
    monkeypatch.setattr(console, "_FIRST_LINE_S", 0.02)
    monkeypatch.setattr(console, "_LINE_EVERY_S", 0.02)
    monkeypatch.setattr(prediction, "_ROWS", 40)
    plain = Model.predict

    def slow(self: Model, *args: Any, **more: Any) -> Any:
        time.sleep(0.05)
        return plain(self, *args, **more)

    monkeypatch.setattr(Model, "predict", slow)
    done = ecm_command(
        "predict", tmp_path / "m.json", tmp_path / "d.csv", "--out", tmp_path / "p.csv"
    ).good()
    assert re.search(r"predicting 400 rows, \d s so far: \d+ %, about \d s left", done.err)
    predicted = read_table(tmp_path / "p.csv")
    assert np.array_equal(predicted["tau_z_Nm"], fit_model(table, "linear").predict(table)[:, 0])


def test_what_follows_the_end_of_a_count_is_said_by_nobody(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(console, "_FIRST_LINE_S", 0.01)
    begun_s = time.process_time()
    with Console().working("measuring") as tell:
        tell(9, 9)
        time.sleep(0.3)
    assert capsys.readouterr().err == ""
    assert time.process_time() - begun_s < 0.2  # it does not spin


def test_nobody_waits_for_a_quiet_command() -> None:
    with Console(quiet=True).working("reading") as tell:
        tell(1, 2, "")


def said_by(path: Path, what: str) -> dict[str, Any]:
    """The last event of a file when it is about this."""
    for _ in range(2000):
        found = events.last(path.read_bytes() if path.exists() else b"", "what") or {}
        if found.get("what") == what:
            return found
        time.sleep(0.005)
    raise AssertionError(f"{what}: {found}")


def test_another_program_reads_steps_and_errors_as_lines_of_json(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = tmp_path / "events"
    monkeypatch.setenv(events.VARIABLE, str(path))
    monkeypatch.setattr(events, "EVERY_S", 0.0)
    session = Console()
    (session.progress("FEM poses") or print)(3, 240, "solving")
    told = {"what": "FEM poses, solving", "done": 3, "total": 240, "left_s": None}
    assert said_by(path, "FEM poses, solving") == told
    with session.working("fitting") as tell:
        tell(1, 4, "noise")
        assert said_by(path, "fitting, noise")["total"] == 4
    assert run(["check", str(tmp_path / "none.csv")]) != 0
    said = capsys.readouterr().err.strip().splitlines()[-1]
    told = events.last(path.read_bytes(), "error")
    assert told is not None
    assert f"error: {told['error']}".startswith(said[:40])
    assert run(["fit"]) == 2
    told = events.last(path.read_bytes(), "error")
    assert told is not None
    assert "issing" in told["error"]
    with path.open("a", encoding="utf-8") as file:
        file.write('{"what": "half')
    assert events.last(path.read_bytes(), "error") == told
    # A folder that is not there costs nothing but the events.
    monkeypatch.setenv(events.VARIABLE, str(tmp_path / "none" / "events"))
    with session.working("fitting") as tell:
        tell(240, 240)
        time.sleep(0.01)


SAID = re.compile(
    r"str\((error|caught|problem)\)|\.message\b|\.stderr\b|\.stdout\b|\.sentences?\(\)|\.log\("
)
"""Expressions of what a command, an error or a result says to people."""
READS = {"startswith", "endswith", "split", "splitlines", "partition", "rpartition",
         "removeprefix", "removesuffix", "find", "index", "count"}  # fmt: skip


def reads_prose(source: str) -> list[str]:
    """Places of a source where a program looks into words for people."""
    read: list[ast.expr] = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            of_re = ast.unparse(node.func.value) == "re"
            read += node.args[1:] if of_re else [node.func.value] * (node.func.attr in READS)
        elif isinstance(node, ast.Compare) and isinstance(node.ops[0], ast.In | ast.NotIn | ast.Eq):
            read += [node.left, *node.comparators]
    return [text for text in map(ast.unparse, read) if SAID.search(text)]


def test_no_program_reads_the_words_that_are_for_people() -> None:
    """Progress and ends of commands come as lines of JSON, refusals as fields."""
    for old in (
        'done = re.search(r"(\\d+) of (\\d+)", session.log(3, "err").decode())',
        "if str(error).startswith(where): pass",
        'refused = "not saved" in step.message',
    ):
        assert len(reads_prose(old)) == 1, old
    assert reads_prose("message = str(error)") == []
    files = (ROOT / "python" / "ecm").rglob("*.py")
    found = [path.name for path in files if reads_prose(path.read_text(encoding="utf-8"))]
    assert found == ["extras.py"]  # it shows the first line of what another library says
