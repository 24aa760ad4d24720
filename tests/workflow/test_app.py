"""The server of `ecm app`: its state is that of the folder, and it answers one person only."""

from __future__ import annotations

import asyncio
import gzip
import json
import os
import re
import resource
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from base64 import b64decode
from collections.abc import Iterator
from contextlib import closing, contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pytest
from scipy.io import savemat
from starlette.testclient import TestClient

from ecm.cli import run
from ecm.cli.jobs import paced
from ecm.errors import InputError
from ecm.io.events import live_path
from ecm.io.table import read_table
from ecm.rig.truth import sealed, sha256
from ecm.workflow.app.copying import report_of
from ecm.workflow.app.journal import Journal
from ecm.workflow.app.server import App, application, begin, serve
from ecm.workflow.app.session import Session
from ecm.workflow.app.steps import PLAN, Files, command_of, request_of, write_demo
from ecm.workflow.app.views import state_of
from support.neck import ROOT, saved
from support.programs import ended
from support.warm_steps import warm

PORT, TOKEN = 8000, "a-secret"
HOME = f"http://127.0.0.1:{PORT}"


def table(path: Path, *, drift: float = 0.0, rows: int = 24) -> Path:
    """A stage of one axis: force over displacement, and a drift of the sensor."""
    rng = np.random.default_rng(1)
    x = np.linspace(-1e-3, 1e-3, rows)[rng.permutation(rows)]
    time_s = 60.0 * np.arange(rows)
    force = 1e4 * x + drift * time_s + 0.01 * rng.standard_normal(rows)
    lines = [f"{a},{b},{c}" for a, b, c in zip(x, force, time_s, strict=True)]
    path.write_text("\n".join(["x_m,fx_N,time_s", *lines, ""]), encoding="utf-8")
    return path


class Person(TestClient):
    """What the page asks of a session, with the token that it has."""

    def __init__(self, app: App, **options: Any) -> None:
        server = application(app, port=PORT, token=TOKEN)
        super().__init__(server, base_url=HOME, headers={"x-ecm-token": TOKEN}, **options)
        self.at, self.session, self.jobs = app, app.session, app.jobs

    def checked(self, path: Path) -> None:
        """Upload a table, and accept what its check warns of."""
        assert self.upload(path).status_code == 200
        self.accept_all(self.finished())

    def upload(self, path: Path, name: str = "stage.csv") -> Any:
        return self.post("/api/upload", params={"name": name}, content=path.read_bytes())

    def step(self, verb: str, **request: Any) -> dict[str, Any]:
        """Run a step to its end, with what follows it, and return the state."""
        answer = self.post("/api/step", json={"verb": verb, **request})
        assert answer.status_code == 200, answer.text
        return self.finished()

    def finished(self) -> dict[str, Any]:
        self.jobs.wait()
        state: dict[str, Any] = self.get("/api/state").json()
        return state

    def accept_all(self, state: dict[str, Any]) -> None:
        for warning in state["pending"]:
            assert self.post("/api/accept", json={"warning": warning}).status_code == 200

    def drop(self, path: Path, content: str, encoding: str = "utf-8") -> dict[str, Any]:
        """Drop a table, and return the state after its check."""
        path.write_text(content, encoding=encoding)
        assert self.upload(path, path.name).status_code == 200
        return self.finished()

    def take_the_way_out(self, state: dict[str, Any]) -> dict[str, Any]:
        """Do what the remedy of the last step says, as its button does."""
        last = state["steps"][-1]
        assert last["status"] == "failed"
        return self.step(**last["remedy"]["request"])


@pytest.fixture
def app_of_processes(tmp_path: Path) -> Iterator[App]:
    """A session whose steps are the processes that a person's are."""
    opened = App(tmp_path / "session")
    yield opened
    opened.close()


@pytest.fixture
def app(app_of_processes: App) -> App:
    """A session whose steps have imported everything."""
    return warm(app_of_processes)


@pytest.fixture
def user(app: App) -> Iterator[Person]:
    """A person at the page of such a session."""
    with Person(app) as opened:
        yield opened


def _fitted_linearly(view: dict[str, Any], ids: list[str]) -> float:
    """What a linear fit of the base and of these effects leaves, over the noise, of a view."""
    names = [id for id, item in view["effects"].items() for _ in item["parameters"]]
    take = [i for i, name in enumerate(names) if name in ids]
    gram, slope = np.array(view["gram"])[np.ix_(take, take)], np.array(view["slope"])[take]
    left = view["squares"] - (slope @ np.linalg.solve(gram, slope) if ids else 0.0)
    return float(np.sqrt(view["mean"] * left))


# --- the loop ----------------------------------------------------------
def test_the_loop_by_its_routes_and_the_script_that_repeats_it(
    user: Person, tmp_path: Path
) -> None:
    begin(user.at, [table(tmp_path / "stage.csv", drift=2e-4)], model="linear")
    with pytest.raises(InputError, match="is a session already"):
        begin(user.at, [tmp_path / "stage.csv"])
    state = user.finished()
    assert [step["verb"] for step in state["steps"]] == ["upload", "check", "fit", "compare"]
    assert state["data"] == [{"file": "upload-1.csv", "name": "stage.csv"}]
    assert state["check"]["rows"] == 24
    before = state["compare"]["whitened_rms"]
    residuals = user.get("/api/view/residuals").json()
    assert len(residuals["row"]) == 24
    view = user.get("/api/view/effects").json()
    assert next(iter(view["effects"])) == "fts_drift"  # the one that explains most
    foreseen = before * _fitted_linearly(view, ["fts_drift"]) / _fitted_linearly(view, [])

    state = user.step("refit", add=["fts_drift"])
    assert state["compare"]["whitened_rms"] == pytest.approx(foreseen, rel=0.05)
    assert foreseen < 0.5 * before
    held = user.get("/api/view/effects").json()  # of the model that has it, the same problem
    assert _fitted_linearly(held, []) == pytest.approx(_fitted_linearly(view, []), rel=0.05)
    assert [rung["name"] for rung in state["rungs"]] == ["linear", "+ fts_drift"]

    added = state["model"]
    assert user.post("/api/undo", json={}).json()["model"] != added
    late = user.get(f"/api/view/residuals?of={state['data'][0]['file']},{added}")
    assert len(late.json()["row"]) == 24  # asked for before the undo, answered after it
    assert user.post("/api/redo", json={}).json()["model"] == added
    frozen = user.step("refit", freeze=["fts_drift"])["fit"]["effects"]
    assert [(effect["id"], effect["frozen"]) for effect in frozen] == [("fts_drift", True)]
    assert user.step("export", to="c", force=True)["export"]["files"]
    script = user.get("/files/script.sh").text
    state = user.get("/api/state").json()
    _same_bytes_by(script, user.session, tmp_path)
    moved = tmp_path / "moved"
    shutil.copytree(user.session.folder, moved)
    assert {**state_of(Session(moved)), "folder": ""} | {"running": None} == {**state, "folder": ""}


def _same_bytes_by(script: str, session: Session, tmp_path: Path) -> None:
    """Run a script beside the session, and compare every file that it writes."""
    (tmp_path / "bin").mkdir()
    program = saved(tmp_path / "bin" / "ecm", f'#!/bin/sh\nexec "{sys.executable}" -m ecm "$@"\n')
    program.chmod(0o755)
    (session.folder / "script.sh").write_text(script, encoding="utf-8")
    again = tmp_path / "again"
    path = f"{program.parent}{os.pathsep}{os.environ['PATH']}"
    ended("sh", session.folder / "script.sh", again, env={**os.environ, "PATH": path})
    written = [name for name in session.downloads() if name not in ("script.sh", "steps.jsonl")]
    assert len(written) > 6
    for name in written:
        assert (again / name).read_bytes() == (session.folder / name).read_bytes(), name


def test_undo_takes_the_data_back_and_a_new_step_ends_redo(user: Person, tmp_path: Path) -> None:
    def names() -> list[str]:
        return [item["name"] for item in state_of(user.session)["data"]]

    for name in ("a.csv", "b.csv"):
        user.session.add_table(table(tmp_path / name), name)
    assert user.post("/api/undo", json={}).json()["redo"]
    assert names() == ["a.csv"]
    user.session.add_table(table(tmp_path / "c.csv"), "c.csv", more=True)
    assert names() == ["a.csv", "c.csv"]
    assert user.post("/api/redo", json={}).status_code == 400
    user.post("/api/undo", json={})
    user.post("/api/undo", json={})
    assert names() == []
    assert user.post("/api/undo", json={}).status_code == 400
    user.post("/api/redo", json={})
    user.post("/api/redo", json={})
    assert names() == ["a.csv", "c.csv"]


def test_a_table_in_the_session_folder_is_copied_with_its_description(tmp_path: Path) -> None:
    data = table(tmp_path / "stage.csv")
    data.with_suffix(".toml").write_text("# nothing\n", encoding="utf-8")
    Session(tmp_path).add_table(data, "stage.csv")
    assert data.is_file()
    assert (tmp_path / "upload-1.toml").is_file()


def test_the_demo_writes_over_no_file_of_another_kind(tmp_path: Path) -> None:
    (tmp_path / PLAN).write_text("my own plan", encoding="utf-8")
    with pytest.raises(InputError, match="is there already"):
        write_demo(tmp_path)
    assert (tmp_path / PLAN).read_text(encoding="utf-8") == "my own plan"


def test_a_log_begins_a_session_and_waits_for_its_import(app: App, tmp_path: Path) -> None:
    log = saved(tmp_path / "log.txt", "a b\n1 2\n")
    with pytest.raises(InputError, match="expected a table or a log"):
        begin(app, [log, tmp_path / "picture.png"])
    begin(app, [log], model="linear")
    assert state_of(app.session)["dropped"] == ["log.txt"]
    assert app.jobs.progress() is None


def test_logs_that_are_dropped_together_become_runs_of_one_table(
    user: Person, tmp_path: Path
) -> None:
    rows = "".join(f"{0.1 * i},{i + 0.01 * (i % 3)}\n" for i in range(20))
    for name in ("a.log", "b.log"):
        log = saved(tmp_path / name, f"x [mm],Force 1\n{rows}")
        user.session.add_table(log, name, more=name == "b.log")
    meta = saved(tmp_path / "meta.toml", "[instrument]\nforce_sd_N = 0.02\n")
    user.session.add_description(meta, "meta.toml")
    assert user.get("/api/state").json()["dropped"] == ["a.log", "b.log"]
    state = user.step("import", map=["x_m=x [mm]:mm", "fx_N=Force 1:N"])
    imported = [item for item in state["steps"] if item["verb"] == "import"]
    assert [item["status"] for item in imported] == ["done", "done"], imported
    assert "--meta upload-3.toml" in imported[1]["command"]
    assert state["check"]["rows"] == 40
    # They keep the names under which they were dropped, and the base is called by what was chosen.
    assert [item["name"] for item in state["data"]] == ["a.log", "b.log"]
    assert [item["name"] for item in imported] == ["a.log", "b.log"]
    for warning in state["pending"]:
        user.post("/api/accept", json={"warning": warning})
    (rung,) = user.step("fit", model="choose")["rungs"]
    assert (rung["asked"], rung["name"]) == ("choose", rung["report"]["model"])
    assert rung["name"].startswith("poly:")
    wrong = user.post("/api/step", json={"verb": "import", "log": "../x.log"})
    assert wrong.status_code == 400
    table = read_table([user.session.folder / item["file"] for item in state["data"]])
    assert sorted(set(table.column("run"))) == [0, 1]


def test_a_matlab_file_is_listed_and_imported(user: Person, tmp_path: Path) -> None:
    x = np.linspace(-1.0, 1.0, 20)
    savemat(
        tmp_path / "rig.mat",
        {"stroke_x_mm": x, "cell": 10 * x, "q": np.tile([1.0, 0, 0, 0], (20, 1))},
    )
    assert user.get("/api/view/log").status_code == 400
    assert user.upload(tmp_path / "rig.mat", "rig.mat").status_code == 200
    columns = {item["name"]: item for item in user.get("/api/view/log").json()["columns"]}
    assert columns["cell"] == {
        "name": "cell", "range": [-10.0, 10.0], "unit": "", "standard": "", "quantity": "",
    }  # fmt: skip
    assert (columns["stroke_x_mm"]["standard"], columns["stroke_x_mm"]["unit"]) == ("x_m", "mm")
    state = user.step("import", map=["fx_N=cell:N"], rotation="wxyz")
    assert {"x_m", "fx_N", "theta_x_rad"} <= state["imported"]["columns"].keys()
    assert state["check"]["rows"] == 20


def test_a_parquet_file_is_a_table_and_stands_in_the_script(user: Person, tmp_path: Path) -> None:
    pyarrow = pytest.importorskip("pyarrow")
    rows = read_table(table(tmp_path / "stage.csv"))
    columns = {name: rows.column(name) for name in ("x_m", "fx_N", "time_s")}
    import_module("pyarrow.parquet").write_table(pyarrow.table(columns), tmp_path / "rig.parquet")
    assert user.upload(tmp_path / "rig.parquet", "rig.parquet").status_code == 200
    state = user.finished()
    assert state["data"] == [{"file": "upload-1.parquet", "name": "rig.parquet"}]
    assert (state["check"]["rows"], state["dropped"]) == (24, ["rig.parquet"])
    listed = {item["name"]: item for item in user.get("/api/view/log").json()["columns"]}
    assert listed["x_m"]["standard"] == "x_m"
    poses = user.get("/api/view/poses").json()
    assert poses["columns"]["x_m"] == pytest.approx(columns["x_m"], rel=1e-5)
    assert "upload-1.parquet" in user.get("/files/script.sh").text


def test_looking_keeps_redo_and_undo_keeps_an_opened_truth(user: Person, tmp_path: Path) -> None:
    data = sealed_table(tmp_path / "stage.csv")
    user.session.add_table(data, "stage.csv")
    user.session.add_table(table(tmp_path / "b.csv"), "b.csv", more=True)
    assert user.step("reveal")["truth"]["effects"] == []
    assert user.post("/api/undo", json={}).json()["truth"]["effects"] == []
    state = user.step("check")
    assert (state["redo"], len(state["data"])) == (True, 1)
    state = user.post("/api/redo", json={}).json()
    assert (len(state["data"]), state["truth"]["effects"]) == (2, [])


def test_a_description_on_a_simulated_table_keeps_its_sealed_truth(
    user: Person, tmp_path: Path
) -> None:
    user.session.add_table(sealed_table(tmp_path / "stage.csv"), "stage.csv")
    meta = saved(tmp_path / "meta.toml", "[instrument]\nforce_sd_N = 0.02\n")
    user.session.add_description(meta, "meta.toml")
    state = user.get("/api/state").json()
    assert state["sealed"]
    assert user.step("reveal")["truth"]["effects"] == []
    text = (user.session.folder / "upload-2.toml").read_text(encoding="utf-8")
    assert "force_sd_N = 0.02" in text


def sealed_table(path: Path) -> Path:
    """A table with a sealed truth of no effect."""
    truth = sealed([], seed=1, salt="00")
    path.with_suffix(".truth.json").write_text(truth, encoding="utf-8")
    seal = f'[file]\ntruth_sha256 = "{sha256(truth)}"\n'
    path.with_suffix(".toml").write_text(seal, encoding="utf-8")
    return table(path)


def test_readings_of_a_running_campaign_are_there_as_they_come(user: Person) -> None:
    step = user.session.begin("example", {"name": "neck"})
    events = user.session.log_path(step.number, "events")
    events.parent.mkdir()
    assert user.get("/api/live").json()["run"] is None
    events.write_text(json.dumps({"what": "reading"}) + "\n")  # before its poses are known
    found = user.get("/api/live").json()
    assert (found["run"], found["begun"]) == (None, None)
    reading = {"visit": 1, "kind": "pose", "pose": [0.1, float("nan")], "wrench": [3.0]}
    told = [{"what": "FEM poses"}, {"begun": begun(1.0)}, {"measured": reading}]
    events.write_text("".join(json.dumps(line) + "\n" for line in told) + '{"meas')
    found = user.get("/api/live").json()
    assert (found["begun"]["length_m"], found["begun"]["poses"]) == (0.1, {"x_m": [0.1]})
    assert found["rows"] == [{**reading, "pose": [0.1, None]}]
    with events.open("a", encoding="utf-8") as file:
        file.write(json.dumps({"measured": {"visit": 2}})[len('{"meas') :] + "\n")
    found = user.get("/api/live?after=1").json()
    assert (found["rows"], found["begun"]) == ([{"visit": 2}], None)
    for wrong in ("-1", "9" * 5000):
        assert user.get(f"/api/live?after={wrong}").status_code == 400
    user.session.end(step.number, "cancelled", "", 0.0)
    assert user.get("/api/live").json() == {"of": None}


def begun(at: float) -> dict[str, Any]:
    """What a run tells first."""
    return {"at": at, "poses": {"x_m": [0.1]}, "mechanism": {"length_m": 0.1}}


def test_a_table_that_is_followed_is_taken_once_when_it_is_written(tmp_path: Path) -> None:
    data = tmp_path / "stage.csv"
    live = live_path(data)
    with closing(App(tmp_path / "session", data)) as app, Person(warm(app)) as client:
        found = client.get("/api/live").json()
        assert (found["of"], found["run"], found["rows"]) == ("stage.csv", None, [])
        for at, rows in ((1.0, 2), (2.0, 3)):  # a run that goes on tells all its readings again
            told = [{"begun": begun(at)}, *[{"measured": {"visit": i}} for i in range(rows)]]
            with live.open("a", encoding="utf-8") as file:
                file.write("".join(json.dumps(line) + "\n" for line in [*told, {"ended": "why"}]))
            found = client.get("/api/live").json()
            assert (found["run"], len(found["rows"]), found["ended"]) == (at, rows, "why")
        table(data)  # of before: it is being measured again
        state = client.get("/api/state").json()
        assert (state["following"], state["data"]) == ("stage.csv", [])
        live.unlink()
        assert "following" not in client.get("/api/state").json()
        state = client.finished()
        assert (len(state["data"]), state["check"]["rows"]) == (1, 24)
        assert client.get("/api/live").json() == {"of": None}
    with closing(App(tmp_path / "session", data)) as app, Person(app) as client:
        assert len(client.get("/api/state").json()["data"]) == 1  # it is there already
    table(data, rows=30)
    with closing(App(tmp_path / "session", data)) as app, Person(warm(app)) as client:
        assert len(client.get("/api/state").json()["data"]) == 2
        client.finished()
    live.touch()
    with pytest.raises(InputError, match=r"other\.csv: no such file$"):
        serve(tmp_path / "other", tmp_path / "other.csv")
    data.unlink()
    with pytest.raises(InputError, match="no such file") as refused:
        serve(tmp_path / "other", data)
    assert "ecm app --follow" in str(refused.value.remedy)


def test_a_reading_takes_as_long_as_a_person_needs_to_see_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    said: list[Any] = []
    monkeypatch.setattr("ecm.cli.jobs.time.sleep", said.append)

    def progress(*done: Any) -> None:
        said.append(done)

    assert paced(progress) is progress
    monkeypatch.setenv("ECM_READING_S", "0.5")
    slower = paced(progress)
    assert slower is not None
    slower(1, 2, "FEM poses")
    slower(1, 2, "measuring")
    assert said == [(1, 2, "FEM poses"), (1, 2, "measuring"), 0.5]


# --- files of a person, and a full disk --------------------------------
def test_no_file_of_a_person_is_written_over(user: Person, tmp_path: Path) -> None:
    names = ("upload-1.csv", "check-2.json", "logs/3.err", "model-3.json.txt")
    own = [user.session.folder / name for name in names]
    for path in own:
        path.parent.mkdir(exist_ok=True)
        path.write_text("mine", encoding="utf-8")
    begin(user.at, [table(tmp_path / "stage.csv")])
    state = user.finished()
    assert [item["number"] for item in state["steps"]] == [4, 5]
    assert state["check"]["rows"] == 24
    assert [path.read_text(encoding="utf-8") for path in own] == ["mine"] * 4


def test_a_file_of_the_name_of_the_journal_is_left_alone(tmp_path: Path) -> None:
    own = saved(tmp_path / "steps.jsonl", '{"step": 1}\n')
    with pytest.raises(InputError, match="no journal of `ecm app`: name another folder"):
        Session(tmp_path)
    assert own.read_text(encoding="utf-8") == '{"step": 1}\n'


@contextmanager
def largest_file(size: int) -> Iterator[None]:
    """Let no file of this process grow beyond a size, as on a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_full_disk_is_an_error_with_the_file_and_the_next_step(
    user: Person, tmp_path: Path
) -> None:
    data = table(tmp_path / "stage.csv", rows=200)
    with largest_file(2000):
        answer = user.upload(data)
    assert (answer.status_code, list(user.session.folder.glob(".ecm-*"))) == (507, [])
    assert answer.json()["error"].startswith("stage.csv: cannot be written to ")
    assert "Free some space there" in answer.json()["error"]

    user.session.add_table(data, "stage.csv")
    size = (user.session.folder / "steps.jsonl").stat().st_size
    with largest_file(size + 10):
        answer = user.post("/api/step", json={"verb": "check"})
    assert answer.status_code == 507
    assert "steps.jsonl" in answer.json()["error"]


def test_the_end_of_a_step_waits_for_a_full_disk(user: Person, tmp_path: Path) -> None:
    user.session.add_table(table(tmp_path / "stage.csv"), "stage.csv")
    user.jobs.start("check", {})
    with largest_file((user.session.folder / "steps.jsonl").stat().st_size + 10):
        user.jobs.wait()
        answer = user.get("/api/state")
        assert answer.status_code == 507
        assert "steps.jsonl" in answer.json()["error"]
    state = user.get("/api/state").json()
    assert (state["steps"][-1]["status"], state["check"]["rows"]) == ("done", 24)


def test_the_script_outside_its_folder_says_so(app: App, tmp_path: Path) -> None:
    app.session.add_table(table(tmp_path / "stage.csv"), "stage.csv")
    script, again = saved(tmp_path / "script.sh", app.session.script()), tmp_path / "again"
    done = ended("sh", script, again, code=1)
    assert done.stderr == "put this script into the session folder\n"
    assert not again.exists()


# --- refusals and their way out -----------------------------------------
ROWS = "".join(f"{1e-4 * i},{i + 0.01 * (i % 3)}\n" for i in range(20))


def test_bad_rows_are_left_out_by_every_step_after_the_check_that_leaves_them(
    user: Person, tmp_path: Path
) -> None:
    state = user.drop(tmp_path / "a.csv", f"x_m,fx_N\n{ROWS}nan,1\n0.001,\n")
    assert "line 22, column 'x_m': found 'nan'" in state["steps"][-1]["message"]
    refused = user.get("/api/view/poses")  # of a process of its own
    assert refused.status_code == 400
    assert "line 22, column 'x_m': found 'nan'" in refused.json()["error"]
    assert refused.json()["remedy"]["request"] == {"verb": "check", "skip_bad_rows": True}
    state = user.take_the_way_out(state)
    assert state["check"]["rows"] == 20
    user.accept_all(state)
    state = user.step("fit", model="linear")
    assert [item["status"] for item in state["steps"][-2:]] == ["done", "done"], state["steps"]
    assert all("--skip-bad-rows" in item["command"] for item in state["steps"][-2:])
    assert len(user.get("/api/view/residuals").json()["row"]) == 20


def test_the_script_leaves_out_the_bad_rows_that_the_page_left_out(
    user: Person, tmp_path: Path
) -> None:
    """Also where the tables are checked again, more is said of them, or rows are marked."""
    state = user.drop(tmp_path / "a.csv", f"x_m,fx_N\n{ROWS}nan,1\n0.001,\n")
    state = user.take_the_way_out(state)
    user.accept_all(state)
    user.step("check")
    said = {"instrument": {"force_sd_N": 0.02}}
    assert user.post("/api/describe", json={"sections": said}).status_code == 200
    user.finished()
    assert user.post("/api/leave_out", json={"rows": [3]}).status_code == 200
    state = user.finished()
    assert state["check"]["rows"] == 19
    user.accept_all(state)
    state = user.step("fit", model="linear")
    assert [item["verb"] for item in state["steps"] if item["status"] == "failed"] == ["check"]
    script = user.get("/files/script.sh").text
    copied = re.search('id="packed-session">(.*)</script>', user.get("/api/copy").text)
    assert copied is not None
    recorded = json.loads(gzip.decompress(b64decode(copied[1])))
    assert recorded["states"][-1]["state"]["check"]["rows"] == 19
    poses = {len(view["row"]) for name, view in recorded["views"].items() if "/poses" in name}
    assert poses == {19, 20}
    commands = [line for line in script.splitlines() if line.startswith("ecm ")]
    assert len(commands) > 5
    assert all("--skip-bad-rows" in line for line in commands)
    _same_bytes_by(script, user.session, tmp_path)


@pytest.mark.parametrize(
    ("content", "encoding"),
    [
        ("x_m,fx_N,Prüfer\n" + ROWS.replace("\n", ",1\n"), "latin-1"),
        (f"x_m;fx_N\n{ROWS}".replace(",", ";"), "utf-8"),
    ],
)
def test_a_file_of_another_program_is_imported_by_the_button(
    user: Person, tmp_path: Path, content: str, encoding: str
) -> None:
    state = user.drop(tmp_path / "a.csv", content, encoding)
    state = user.take_the_way_out(state)
    assert (state["steps"][-1]["verb"], state["check"]["rows"]) == ("check", 20), state


def test_a_refused_fit_can_be_forced_and_a_refused_effect_is_told(
    user: Person, tmp_path: Path
) -> None:
    noise = np.random.default_rng(2).standard_normal(9)
    rows = "".join(f"{1e-4 * i},{v}\n" for i, v in enumerate(noise))
    user.accept_all(user.drop(tmp_path / "a.csv", f"x_m,fx_N\n{rows}"))
    state = user.step("fit", model="poly:6")
    remedy = state["steps"][-1]["remedy"]
    assert remedy["command"].startswith("ecm fit upload-1.csv --model choose")
    assert "not saved" in state["steps"][-1]["message"]
    assert "error:" not in state["steps"][-1]["message"]
    state = user.step(**remedy["again"])
    assert state["model"] is not None
    state = user.step("refit", add=["payload"])  # one axis has none
    assert list(state["refused"]) == ["payload"]
    assert state["refused"]["payload"]["message"]


def test_another_base_and_an_effect_on_it_are_one_click(user: Person, tmp_path: Path) -> None:
    user.checked(table(tmp_path / "stage.csv", drift=2e-4))
    user.step("fit", model="cubic")
    state = user.step("fit", model="linear", then={"verb": "refit", "add": ["fts_drift"]})
    assert [rung["name"] for rung in state["rungs"]] == ["linear", "+ fts_drift"]
    assert state["compare"]["model"] == "poly:1+fts_drift"


def test_every_effect_that_the_page_lists_can_be_added(user: Person, tmp_path: Path) -> None:
    user.checked(table(tmp_path / "stage.csv", drift=2e-4, rows=60))
    user.step("fit", model="linear")
    listed = user.get("/api/view/effects").json()["effects"]
    assert {"kink", "dead_zone", "higher_degree"} <= listed.keys()
    files = user.session.files(user.session.journal.read())
    for name in listed:
        command_of("refit", {"add": [name]}, files, 9)
    state = user.step("refit", add=["kink"])
    assert [item["status"] for item in state["steps"][-2:]] == ["done", "done"]


def test_marked_rows_are_left_out_and_the_model_fitted_again(user: Person, tmp_path: Path) -> None:
    for name in ("a.csv", "b.csv"):
        path = table(tmp_path / name, drift=2e-4, rows=20)
        of = {"name": name, "more": "1" if name == "b.csv" else "0"}
        assert user.post("/api/upload", params=of, content=path.read_bytes()).is_success
        state = user.finished()
    user.accept_all(state)
    user.step("fit", model="linear")
    then = {"verb": "fit", "model": "linear", "then": {"verb": "refit", "add": ["fts_drift"]}}
    for wrong in ([], [0], [41], ["3"], list(range(1, 21))):  # the last: all rows of a table
        answer = user.post("/api/leave_out", json={"rows": wrong})
        assert answer.status_code == 400, wrong
    asked = {"rows": [3, 4, 22], "then": then}
    assert user.post("/api/leave_out", json=asked).status_code == 200
    state = user.finished()
    assert state["check"]["rows"] == 37
    assert [item["name"] for item in state["data"]] == ["a.csv", "b.csv"]
    assert state["pending"] == []  # what was accepted before stays so, and this was wanted
    assert [rung["name"] for rung in state["rungs"]] == ["linear", "+ fts_drift"]
    # Row 3 of what is left is row 5 of the file.
    user.post("/api/leave_out", json={"rows": [3]})
    state = user.finished()
    written = (user.session.folder / state["data"][0]["file"]).with_suffix(".toml").read_text()
    assert 'marked = "3-5"' in written
    script = user.get("/files/script.sh").text
    _same_bytes_by(script, user.session, tmp_path)


def test_what_is_typed_goes_into_the_descriptions(user: Person, tmp_path: Path) -> None:
    user.checked(table(tmp_path / "stage.csv", drift=2e-4))
    said = {"mechanism": {"length_m": 0.1}, "instrument": {"force_sd_N": 0.02}}
    assert user.post("/api/describe", json={"sections": said}).status_code == 200
    state = user.finished()
    assert state["described"] == said
    assert state["compare"] is None
    wrong = user.post("/api/describe", json={"sections": {"mechanism": {"length_m": -1.0}}})
    assert wrong.status_code == 400
    assert "stage.csv [mechanism]: length_m = -1.0" in wrong.json()["error"]
    assert user.post("/api/describe", json={"sections": {"file": {}}}).status_code == 400
    taken = {"instrument": {"force_sd_N": None}}
    user.post("/api/describe", json={"sections": taken})
    assert user.finished()["described"] == {"mechanism": {"length_m": 0.1}}


def test_a_session_has_a_report_and_goes_on_from_its_zip(user: Person, tmp_path: Path) -> None:
    begin(user.at, [table(tmp_path / "stage.csv", drift=2e-4)], model="linear")
    assert user.finished()["tried"][0]["held_out"] is None  # a base alone has no history
    assert report_of(user.session).sections[0].blocks[0].rows[0][2] is None
    state = user.step("refit", add=["fts_drift"])
    report = user.get("/api/report").text
    ladder = report_of(user.session).sections[0].blocks
    error, held_out = (item["x"] for item in ladder[1].figure["data"][:2])
    assert error == held_out == ["1 linear", "2 + fts_drift"]  # a name each, no 1.1 fits
    assert all(isinstance(held, float) for *_, held in ladder[0].rows)
    for part in ("Ladder of errors", "Before and after", "Parameters", "ecm refit"):
        assert part in report
    assert [block.title for block in report_of(user.session).sections].count("Parameters") == 1
    content = user.get("/api/zip").content
    shutil.unpack_archive(_written(tmp_path / "all.zip", content), tmp_path / "other")
    found = state_of(Session(tmp_path / "other" / "session"))
    assert {**found, "running": None} == state
    page, written = tmp_path / "of.html", tmp_path / "of.json"
    outputs = ["--report", str(page), "--json", str(written)]
    assert run(["app", "--session", str(tmp_path / "none"), *outputs]) == 2
    assert not page.exists()
    assert run(["app", "--session", str(tmp_path / "other" / "session"), *outputs]) == 0
    assert "Before and after" in page.read_text(encoding="utf-8")
    assert json.loads(written.read_text(encoding="utf-8")) == found
    assert not (tmp_path / "none").exists()


def _written(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


def test_an_import_is_shown_beside_its_own_table_only(user: Person, tmp_path: Path) -> None:
    (tmp_path / "a.log").write_text(f"x [mm],Force\n{ROWS}", encoding="utf-8")
    user.upload(tmp_path / "a.log", "a.log")
    state = user.step("import", map=["fx_N=Force:N"], ignore=[])
    assert state["imported"]["columns"]["fx_N"] == "Force"
    state = user.drop(tmp_path / "b.csv", f"x_m,fx_N\n{ROWS}")
    assert state["imported"] is None


def test_a_guess_that_is_wrong_is_refused_by_a_person(user: Person, tmp_path: Path) -> None:
    rows = "".join(f"{i},{10 * i + i % 3},{i % 4},{20 + i}\n" for i in range(20))
    state = user.drop(tmp_path / "a.log", f"x_mm,Fx [N],Fy [N],Fz [N]\n{rows}")
    state = user.step("import", map=["own_fy_n=Fy [N]"], ignore=["Fz [N]"])
    assert sorted(state["imported"]["columns"]) == ["fx_N", "own_fy_n", "x_m"]
    state = user.step("import", ignore=["Fz"])
    assert "--ignore Fz: the log has no column 'Fz'" in state["steps"][-1]["message"]


@pytest.mark.parametrize(
    ("command", "request_"),
    [
        ("ecm export m.json --to c --mass 2.5 --inertia 1e-2 --out x",
         {"verb": "export", "to": "c", "mass": "2.5", "inertia": "1e-2"}),
        ("ecm export m.json --to c --out x --json y --force",
         {"verb": "export", "to": "c", "force": True}),
        ("ecm refit m.json 'a b.csv' --remove payload --out n.json",
         {"verb": "refit", "remove": ["payload"]}),
        ("ecm fit 'a b.csv' --model energy4 --add hysteresis --out n.json",
         {"verb": "fit", "model": "energy4", "add": ["hysteresis"]}),
        ("ecm fit 'a b.csv' --model energy4 --add no_effect --out n.json", None),
        ("ecm check 'a b.csv' --skip-bad-rows", {"verb": "check", "skip_bad_rows": True}),
        ("ecm import b.log --out t.csv --meta b.toml --leave-out",
         {"verb": "import", "log": "b.log", "leave_out": True}),
        ("ecm fit other.csv --model physics --out n.json", None),
        ("ecm fit 'a b.csv' --model ../x --out n.json", None),
        ("ecm material x.csv", None),
        ("rm -rf .", None),
        ("ecm check 'a b.csv", None),
        ("", None),
    ],
)  # fmt: skip
def test_the_command_of_a_remedy_is_a_step_where_it_is_one_of_this_session(
    command: str, request_: dict[str, Any] | None
) -> None:
    files = Files(data=["a b.csv"], model="m.json", dropped=["a b.csv", "b.log"])
    assert request_of(command, files) == request_


# --- long work ---------------------------------------------------------
def test_nothing_changes_while_a_step_begins(user: Person, tmp_path: Path) -> None:
    for name in ("a.csv", "b.csv"):
        user.session.add_table(table(tmp_path / name), name)
    begins, goes_on, begin_now = threading.Event(), threading.Event(), user.session.begin

    def slowly(*given: Any) -> Any:
        begins.set()
        goes_on.wait(10)
        return begin_now(*given)

    user.session.begin = slowly  # type: ignore[assignment, method-assign]
    beginning = threading.Thread(target=user.jobs.start, args=("check", {}))
    beginning.start()
    begins.wait(10)
    threading.Timer(0.3, goes_on.set).start()
    assert user.post("/api/undo", json={}).status_code == 409
    beginning.join()
    state = user.finished()
    assert [item["name"] for item in state["data"]] == ["b.csv"]


def test_an_upload_that_a_step_overtakes_changes_nothing(user: Person, tmp_path: Path) -> None:
    def body() -> Iterator[bytes]:
        yield b"x_m,fx_N\n"
        user.jobs.start("check", {})
        yield b"1,2\n"

    user.session.add_table(table(tmp_path / "a.csv"), "a.csv")
    answer = user.post("/api/upload", params={"name": "b.csv"}, content=body())
    assert answer.status_code == 409
    assert [item["name"] for item in user.finished()["data"]] == ["a.csv"]


def test_a_command_that_cannot_be_run_is_a_failed_step(
    app_of_processes: App, tmp_path: Path
) -> None:
    app = app_of_processes
    app.session.add_table(table(tmp_path / "stage.csv"), "stage.csv")
    with Person(app) as client:
        answer = client.post("/api/step", json={"verb": "import", "map": ["x_m=a\0"]})
        assert answer.status_code == 400
        assert client.finished()["steps"][-1]["status"] == "failed"


def test_ctrl_c_in_a_terminal_reaches_no_worker(app_of_processes: App, tmp_path: Path) -> None:
    app = app_of_processes
    app.session.add_table(table(tmp_path / "stage.csv"), "stage.csv")
    app.jobs.start("check", {})
    assert os.getpgid(app.jobs._job.process.pid) != os.getpgid(0)  # type: ignore[union-attr]


_CLOSED = """
import time
from pathlib import Path
from ecm.errors import InputError
from ecm.workflow.app.jobs import Views
if __name__ == "__main__":
    views = Views(Path("."))
    work = views._process().submit(time.sleep, 600)
    while not work.running():
        time.sleep(0.01)
    views.close()
    try:
        views.file("poses", ["a.csv"], None)
    except InputError as error:
        print(error)
"""


def test_the_end_of_the_server_ends_a_view(tmp_path: Path) -> None:
    script = saved(tmp_path / "server.py", _CLOSED)
    done = ended(sys.executable, script)
    assert done.stdout == "the server is being ended\n"


_VIEWS = """
import os, signal, sys
from pathlib import Path
from ecm.workflow.app.jobs import Views
if __name__ == "__main__":
    views = Views(Path("."))
    print(views._process().submit(os.getpid).result(), flush=True)
    os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_tab_gets_no_view_of_other_tables_than_it_asks_for(user: Person, tmp_path: Path) -> None:
    for path in (table(tmp_path / "a.csv"), ROOT / "examples" / "neck_measured.csv"):
        user.session.add_table(path, path.name)
    assert user.get("/api/view/poses?of=upload-1.csv").status_code == 409
    assert user.get("/api/view/poses?of=upload-2.csv").json()["body"] is True


def test_a_killed_server_leaves_no_process_of_views(tmp_path: Path) -> None:
    script = saved(tmp_path / "server.py", _VIEWS)
    done = subprocess.run(
        [sys.executable, str(script)], check=False, stdout=subprocess.PIPE, text=True
    )
    _ends(int(done.stdout))


def test_an_upload_that_a_kill_has_cut_is_removed(tmp_path: Path) -> None:
    (tmp_path / ".ecm-incoming-1").write_bytes(b"1")
    App(tmp_path).close()
    assert not list(tmp_path.glob(".ecm-incoming-*"))


def test_the_address_is_given_when_it_answers_and_an_error_lets_the_folder_go(
    tmp_path: Path,
) -> None:
    def ready(address: str) -> None:
        port = urlsplit(address).port or 0
        socket.create_connection(("127.0.0.1", port)).close()
        raise InputError("enough")

    with pytest.raises(InputError, match="enough") as kept:
        serve(tmp_path / "session", ready=ready)
    App(tmp_path / "session").close()
    assert kept.value


def test_cancel_kills_the_process_and_the_step_can_be_run_again(
    app_of_processes: App, tmp_path: Path
) -> None:
    app = app_of_processes
    with Person(app) as client:
        client.upload(table(tmp_path / "stage.csv"))
        process = app.jobs._job.process  # type: ignore[union-attr]
        busy = client.post("/api/step", json={"verb": "check"})
        assert busy.status_code == 409
        assert client.post("/api/cancel", json={}).json() == {"cancelled": True}
        state = client.finished()
        assert process.poll() == -signal.SIGKILL
        assert [item["status"] for item in state["steps"]] == ["done", "cancelled"]
        assert state["check"] is None
        again = client.post("/api/again", json={"step": state["steps"][-1]["number"]})
        assert again.status_code == 200
        assert client.finished()["check"]["rows"] == 24


_SERVER = """
import sys
from pathlib import Path
from ecm.workflow.app.steps import PLAN, write_demo
from ecm.workflow.app.server import begin, serve
from ecm.workflow.app.server import App
app = App(Path(sys.argv[1]))
app.session.add_table(Path(sys.argv[2]), "stage.csv")
app.jobs.start("check", {})
app.jobs.wait()
app.jobs.start("fit", {"model": "linear"})
print(app.jobs._job.process.pid, flush=True)
app.jobs.wait()
"""


def files_of(folder: Path) -> dict[str, bytes]:
    """The tables, results and the journal of a session."""
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def test_a_kill_in_the_middle_of_a_fit_loses_nothing_and_leaves_no_process(
    tmp_path: Path,
) -> None:
    data, folder = table(tmp_path / "stage.csv"), tmp_path / "session"
    with subprocess.Popen(
        [sys.executable, "-c", _SERVER, str(folder), str(data)], stdout=subprocess.PIPE, text=True
    ) as server:
        assert server.stdout is not None
        worker = int(server.stdout.readline())
        before = files_of(folder)
        server.kill()
    _ends(worker)
    assert "check-2.json" in before
    assert "model-3.json" not in before
    assert files_of(folder) == before
    opened = App(folder)
    with Person(opened) as client:
        state = client.get("/api/state").json()
        assert [item["status"] for item in state["steps"]] == ["done", "done", "interrupted"]
        assert (state["check"]["rows"], state["model"], state["fit"]) == (24, None, None)
        assert client.post("/api/again", json={"step": 3}).status_code == 200
        state = client.finished()
    assert (state["model"], state["compare"]["rows"]) == ("model-4.json", 24)


def _ends(pid: int) -> None:
    """Wait until a process is gone; end it where it stays."""
    for _ in range(1000):
        if not _alive(pid):
            return
        time.sleep(0.01)
    os.kill(pid, signal.SIGKILL)
    pytest.fail("the process lives on")


def _alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


def test_a_second_server_in_the_same_folder_is_refused(app: App) -> None:
    with pytest.raises(InputError, match="another `ecm app` has this session open"):
        App(app.session.folder)
    app.close()
    App(app.session.folder).close()


def test_a_record_that_a_kill_has_cut_is_left_out(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "steps.jsonl")
    begin = {
        "verb": "check",
        "request": {},
        "argv": [],
        "inputs": {},
        "outputs": [],
        "begun_s": 0.0,
    }
    journal.append(event="begin", number=1, **begin)
    with journal.path.open("a", encoding="utf-8") as file:
        file.write('{"event": "end", "num')
    journal.append(event="begin", number=2, **begin)
    history = journal.read()
    assert sorted(history.steps) == [1, 2]
    assert history.steps[1].status == "running"


# --- who may ask -------------------------------------------------------
@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({}, 200),
        ({"origin": HOME}, 200),
        ({"host": "localhost:8000"}, 200),
        ({"host": "evil.example:8000"}, 421),
        ({"host": "127.0.0.1:9"}, 421),
        ({"origin": "http://evil.example"}, 403),
        ({"origin": "null"}, 403),
        ({"sec-fetch-site": "cross-site"}, 403),
        ({"x-ecm-token": "guessed"}, 403),
        ({"x-ecm-token": ""}, 403),
        ({"x-ecm-token": "ü"}, 403),
    ],
)
def test_only_the_page_with_the_token_is_answered(
    user: Person, headers: dict[str, str], status: int
) -> None:
    encoded = {name: value.encode() for name, value in headers.items()}
    assert user.get("/api/state", headers=encoded).status_code == status


def test_the_token_of_the_address_becomes_a_cookie_that_scripts_cannot_read(app: App) -> None:
    with Person(app, follow_redirects=False) as client:
        del client.headers["x-ecm-token"]
        assert client.get("/?token=wrong").status_code == 403
        answer = client.get(f"/?token={TOKEN}")
        assert answer.status_code == 303
        assert "HttpOnly; SameSite=Strict" in answer.headers["set-cookie"]
        page = client.get("/")
        assert page.status_code == 200
        policy = page.headers["content-security-policy"]
        assert "script-src 'self';" in policy
        assert "unsafe-eval" not in policy
        assert "<script>" not in page.text


@pytest.mark.parametrize(
    "path",
    [
        "/files/..%2f..%2fetc%2fpasswd",
        "/files/%2fetc%2fpasswd",
        "/files/upload-1.truth.json",
        "/files/logs/2.err",
        "/page/..%2fserver.py",
        "/page/server.py",
        "/api/view/..",
        "/api/view/plan",
        "/api/view/__class__",
    ],
)
def test_no_path_of_a_request_reaches_the_file_system(
    user: Person, tmp_path: Path, path: str
) -> None:
    data = table(tmp_path / "stage.csv")
    data.with_suffix(".truth.json").write_text("{}", encoding="utf-8")
    user.session.add_table(data, "stage.csv")
    assert user.get("/files/upload-1.csv").status_code == 200
    assert user.get(path).status_code == 404


@pytest.mark.parametrize(
    "name",
    [
        "../../x.csv",
        "<img src=x onerror=alert(1)>.csv",
        "a\nb.csv",
        "-rf.csv",
        "C:\\x.csv",
        "é\u202e.csv",
    ],
)
def test_a_hostile_file_name_stays_text(user: Person, tmp_path: Path, name: str) -> None:
    assert user.upload(table(tmp_path / "stage.csv"), name).status_code == 200
    state = user.get("/api/state").json()
    assert state["data"] == [{"file": "upload-1.csv", "name": name}]
    assert state["steps"][1]["command"] == "ecm check upload-1.csv --json check-2.json"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["session", "stage.csv"]
    assert name not in user.session.script()


@pytest.mark.parametrize(
    "body",
    [
        {"verb": "fit", "model": "--force"},
        {"verb": "fit", "model": "/etc/passwd.toml"},
        {"verb": "fit", "model": ["linear"]},
        {"verb": "refit", "add": ["--out=/tmp/x"]},
        {"verb": "refit", "add": "payload"},
        {"verb": "export", "to": "../c"},
        {"verb": "campaign"},
        {"verb": "example", "name": "../x"},
        {"verb": "upload"},
        {"verb": "reveal"},
        {"verb": "rm"},
        {"verb": None},
    ],
)
def test_a_request_that_is_no_step_is_refused(user: Person, tmp_path: Path, body: Any) -> None:
    user.session.add_table(table(tmp_path / "stage.csv"), "stage.csv")
    answer = user.post("/api/step", json=body)
    assert answer.status_code == 400
    assert answer.json()["error"]
    assert user.get("/api/state").json()["running"] is None


def test_a_form_of_another_page_is_no_request(user: Person) -> None:
    text = {"content-type": "text/plain"}
    answer = user.post("/api/undo", content=b"{}", headers=text)
    assert answer.status_code == 400
    assert user.post("/api/undo", content=b"[1]").status_code == 400


@pytest.mark.parametrize(
    ("action", "content"),
    [
        ("again", b"[" * 90_000),
        ("again", b'{"step": [1]}'),
        ("step", rb'{"verb": "check", "a": "\ud800"}'),
    ],
)
def test_a_request_of_another_form_is_refused(
    user: Person, tmp_path: Path, action: str, content: bytes
) -> None:
    user.session.add_table(table(tmp_path / "stage.csv"), "stage.csv")
    json_type = {"content-type": "application/json"}
    assert user.post(f"/api/{action}", content=content, headers=json_type).status_code == 400
    assert user.get(f"/api/log/{10**300}").json() == {"out": "", "err": ""}


def test_a_page_that_is_closed_in_an_upload_leaves_nothing(app: App) -> None:
    sent: list[Any] = []

    async def receive() -> Any:
        return {"type": "http.disconnect"}

    async def send(message: Any) -> None:
        sent.append(message)

    headers = [(b"host", b"127.0.0.1:8000"), (b"x-ecm-token", TOKEN.encode())]
    scope: dict[str, Any] = {"type": "http", "method": "POST", "path": "/api/upload"}
    scope |= {"headers": headers, "query_string": b"name=a.csv", "root_path": ""}
    asyncio.run(application(app, port=PORT, token=TOKEN)(scope, receive, send))
    assert sent[0]["status"] == 400
    assert not list(app.session.folder.glob(".ecm-incoming-*"))


def test_a_large_file_is_refused_and_leaves_nothing(user: Person) -> None:
    user.at.most_bytes = 1000
    answer = user.post("/api/upload", params={"name": "a.csv"}, content=b"1" * 1001)
    assert answer.status_code == 400
    assert "1000 bytes" in answer.json()["error"]
    assert user.get("/api/state").json()["data"] == []
    assert not list(user.session.folder.glob(".ecm-incoming-*"))


def test_a_warning_is_open_until_a_person_takes_it_on(
    app_of_processes: App, tmp_path: Path
) -> None:
    app = app_of_processes
    data = table(tmp_path / "stage.csv")
    lines = data.read_text(encoding="utf-8").splitlines()
    extended = [f"{line},{'own' if i == 0 else i % 3}" for i, line in enumerate(lines)]
    data.write_text("\n".join([*extended, ""]), encoding="utf-8")
    with Person(app) as client:
        client.upload(data)
        state = client.finished()
        assert any("own" in warning for warning in state["pending"])
        refused = client.post("/api/step", json={"verb": "fit", "model": "linear"})
        assert refused.status_code == 400
        assert "warning" in refused.json()["error"]
        client.accept_all(state)
        assert app.session.begin("fit", {"model": "linear"}).argv[:2] == ["fit", "upload-1.csv"]


def test_every_file_of_the_page_is_served_and_asks_no_other_machine(user: Person) -> None:
    page = ROOT / "python" / "ecm" / "workflow" / "app" / "page"
    for path in page.iterdir():
        answer = user.get(f"/page/{path.name}")
        assert answer.content == path.read_bytes()
        assert "http://" not in answer.text.replace("http://www.w3.org/", "")
        assert "https://" not in answer.text


def test_a_refused_request_has_the_button_of_a_refused_step(user: Person, tmp_path: Path) -> None:
    user.session.add_table(table(tmp_path / "stage.csv"), "stage.csv")
    refused = user.post("/api/step", json={"verb": "fit", "model": "linear"})
    assert refused.status_code == 400
    answer = refused.json()
    assert answer["error"] == ("the tables are not checked: nothing goes on until the check passes")
    assert answer["remedy"]["command"] == "ecm check upload-1.csv"
    way = answer["remedy"]["request"]
    assert way == {"verb": "check"}
    assert user.post("/api/step", json=way).status_code == 200
    user.accept_all(user.finished())
    refused = user.post("/api/step", json={"verb": "export"})
    assert refused.status_code == 400
    way = refused.json()["remedy"]["request"]
    assert way == {"verb": "fit", "model": "choose"}
    assert user.post("/api/redo", json={}).json()["remedy"] is None


def test_experiments_of_a_log_are_told_apart(user: Person, tmp_path: Path) -> None:
    lines = table(tmp_path / "plain.csv").read_text(encoding="utf-8").splitlines()
    words = [f"{line},{'specimen' if i == 0 else 'AB'[i % 2]}" for i, line in enumerate(lines)]
    log = saved(tmp_path / "log.csv", "\n".join([*words, ""]))
    user.upload(log)
    user.finished()
    step = {"verb": "import", "group": "specimen"}
    assert user.post("/api/step", json=step).status_code == 200
    state = user.finished()
    done = next(item for item in state["steps"] if item["verb"] == "import")
    assert done["status"] == "done", done["message"]
    assert "--group specimen" in done["command"]
    assert len(read_table(user.session.folder / state["data"][0]["file"]).meta.group) == 1
    files = user.session.files(user.session.journal.read())
    assert request_of("ecm import upload-1.csv --group specimen", files) == step
    assert user.post("/api/step", json={**step, "group": 3}).status_code == 400
