"""A click while the result of the step before is computed: it waits, and nobody sees an error."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from starlette.testclient import TestClient

from ecm.workflow.app.jobs import Busy
from ecm.workflow.app.journal import Step
from ecm.workflow.app.server import App, application, begin
from support.programs import until

TOKEN = "a-secret"
TABLE = "".join(f"{1e-4 * i},{i + 0.01 * (i % 3)}\n" for i in range(20))


class Worker:
    """A process of a step that ends when the test says so."""

    stdin = None

    def __init__(self) -> None:
        self._end, self._code = threading.Event(), 0

    def end(self, code: int = 0) -> None:
        self._code = code
        self._end.set()

    def kill(self) -> None:
        self.end(-9)

    def wait(self) -> int:
        self._end.wait(20)
        return self._code


@pytest.fixture
def workers() -> list[Worker]:
    """The processes of the fit and of what follows it."""
    return []


@pytest.fixture
def app(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, workers: list[Worker]) -> Iterator[App]:
    """A session with a fit that has ended, and a comparison that goes on until it is told."""
    (tmp_path / "a.csv").write_text(f"x_m,fx_N\n{TABLE}", encoding="utf-8")
    opened = App(tmp_path / "session")
    begin(opened, [tmp_path / "a.csv"])
    opened.jobs.wait()
    monkeypatch.setattr(opened.jobs, "_process", lambda step: started(opened, step, workers))
    opened.jobs.start("fit", {"model": "linear"})
    workers[0].end()
    until(lambda: len(workers) == 2)
    yield opened
    for worker in workers:
        worker.end()
    opened.close()


def started(app: App, step: Step, workers: list[Worker]) -> Worker:
    if step.verb == "fit":
        (app.session.folder / step.outputs[0]).write_text("{}", encoding="utf-8")
    workers.append(Worker())
    return workers[-1]


def posted(client: TestClient, action: str, **body: Any) -> tuple[threading.Thread, list[Any]]:
    """Send a request that may have to wait; its answers come into the list."""
    answers: list[Any] = []
    sending = threading.Thread(
        target=lambda: answers.append(client.post(f"/api/{action}", json=body))
    )
    sending.start()
    return sending, answers


@pytest.fixture
def client(app: App) -> TestClient:
    return TestClient(
        application(app, port=8000, token=TOKEN),
        base_url="http://127.0.0.1:8000",
        headers={"x-ecm-token": TOKEN},
    )


def test_a_click_during_the_automatic_comparison_waits_for_its_end(
    app: App, client: TestClient, workers: list[Worker]
) -> None:
    running = client.get("/api/state").json()["running"]
    assert (running["automatic"], running["waiting"]) == (True, False)
    sending, answers = posted(client, "undo")
    until(lambda: app.state()["running"]["waiting"])
    assert client.post("/api/step", json={"verb": "check"}).status_code == 409  # one waits
    assert not answers
    workers[1].end()
    sending.join(20)
    assert answers[0].status_code == 200
    assert answers[0].json()["model"] is None
    assert [step.status for step in app.session.journal.read().steps.values()][-1] == "done"


def test_a_click_on_a_step_follows_a_comparison_that_is_cancelled(
    app: App, client: TestClient, workers: list[Worker]
) -> None:
    sending, answers = posted(client, "step", verb="fit", model="cubic")
    until(lambda: app.state()["running"]["waiting"])
    assert client.post("/api/cancel", json={}).json() == {"cancelled": True}
    sending.join(20)
    assert answers[0].status_code == 200
    assert len(workers) == 3
    assert not app.state()["running"]["automatic"]
    assert client.post("/api/undo", json={}).status_code == 409  # a step of a person


def test_nobody_comes_between_the_automatic_step_and_the_click_that_waits(
    app: App, client: TestClient, workers: list[Worker]
) -> None:
    jobs = app.jobs
    sending, answers = posted(client, "undo")
    until(lambda: app.state()["running"]["waiting"])
    with jobs._lock:  # as if the thread that waits were slow to go on
        running, jobs._job = jobs._job, None
        with pytest.raises(Busy):
            jobs.start("fit", {"model": "cubic"})
        jobs._job = running
    workers[1].end()
    sending.join(20)
    assert answers[0].json()["model"] is None


def test_a_result_never_comes_beside_its_running_step(
    app: App, workers: list[Worker], monkeypatch: pytest.MonkeyPatch
) -> None:
    write_end, seen = app.jobs._end, []

    def ended(*end: Any) -> None:
        write_end(*end)
        seen.append(app.state()["running"])  # the job is taken away after this

    monkeypatch.setattr(app.jobs, "_end", ended)
    workers[1].end()
    until(lambda: seen)
    assert seen == [None]


def test_the_end_of_the_server_refuses_the_click_that_waits(app: App, client: TestClient) -> None:
    sending, answers = posted(client, "step", verb="check")
    until(lambda: app.state()["running"]["waiting"])
    app.jobs.close()
    sending.join(20)
    assert answers[0].status_code == 409
    assert "being ended" in answers[0].json()["error"]


def test_what_a_step_tells_becomes_its_progress_and_time_left(app: App, client: TestClient) -> None:
    step = app.state()["running"]["step"]
    log = app.session.folder / "logs" / f"{step}.events"
    log.parent.mkdir(exist_ok=True)
    event = '{"what": "folds", "done": 3, "total": 10, "left_s": 4.0}\n'
    log.write_text(event + '{"what": "folds", "done"', encoding="utf-8")
    running = client.get("/api/state").json()["running"]
    assert {name: running[name] for name in ("what", "done", "total", "left_s")} == {
        "what": "folds", "done": 3, "total": 10, "left_s": 4.0,
    }  # fmt: skip
