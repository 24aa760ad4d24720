"""A plan through devices: the same table as the simulated rig's, limits, silence, and cuts."""

from __future__ import annotations

import os
import re
import resource
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import ecm
from ecm.bench import Bench, measure
from ecm.bench.devices import DeviceError, opened
from ecm.bench.manual import Manual
from ecm.bench.messages import Status, Stopped, _Mover
from ecm.bench.run import envelope
from ecm.errors import InputError
from ecm.io.columns import POSE
from ecm.io.description import Meta
from ecm.io.mechanism import Mechanism
from ecm.io.table import Table, as_table, read_table
from ecm.rig.run import run_campaign
from ecm.rig.settings import Instruments, RigSettings
from support.programs import ended, until

PARTS = ("mover", "wrench", "pose", "person")


def plan_of(rows: int = 12, kind: str = "pose", **columns: Any) -> Table:
    """Six poses near the rest of a body of 0.1 m, again and again."""
    poses = np.zeros((rows, 6))
    poses[:, 0] = 0.1
    poses[:, 1] = 1e-3 * (np.arange(rows) % 6)
    table = dict(zip(POSE, poses.T, strict=True)) | {"kind": [kind] * rows} | columns
    return as_table(table, meta=Meta(mechanism={"length_m": 0.1}))


class Rig:
    """A spring on a robot; what goes wrong is set from outside."""

    def __init__(self, *, settle_s: float = 0.0) -> None:
        self.at = np.array([0.1, 0.0, 0.0, 0.0, 0.0, 0.0])
        self.told: list[str] = []
        self.random = np.random.default_rng(0)
        self.settle_s, self._arrives_s, self.readings = settle_s, 0.0, 0
        self.push = np.zeros(6)
        self.slip = np.zeros(6)
        self.outliers: set[int] = set()
        self.silent_from = 10_000
        self.accident = 0, self.push, 0, 0.0
        """Number of a move, and the part of `push` or `slip` that has this value from then on."""

    def start(self, pose: np.ndarray) -> None:
        self.told.append("start")
        self.at, self._arrives_s = pose, time.monotonic() + self.settle_s
        number, what, axis, value = self.accident
        if self.told.count("start") == number:
            what[axis] = value

    def settled(self) -> bool:
        return time.monotonic() >= self._arrives_s

    def stop(self) -> None:
        self.told.append("stop")

    def ask(self, text: str) -> None:
        self.told.append(text)

    def pose(self, window_s: float) -> tuple[np.ndarray, np.ndarray]:
        return self.at + self.slip, np.full(6, 1e-5)

    def wrench(self, window_s: float) -> np.ndarray:
        if window_s > 0.15:  # not a look while it moves
            self.readings += 1
            if self.readings > self.silent_from:
                time.sleep(30.0)
        true = 1e4 * (self.at - [0.1, 0.0, 0.0, 0.0, 0.0, 0.0]) + self.push
        true = true + 5.0 * (self.readings in self.outliers)
        return true + 0.02 * self.random.standard_normal((20, 6))


def unsaid(words: str) -> None:
    """Findings are among the warnings of the table."""


def bench_of(**limits: Any) -> Bench:
    """A bench whose devices the test makes."""
    tables: dict[str, Any] = {part: {"device": "manual"} for part in PARTS}
    rig = {"dwell_s": 0.0, "offset_every": 0, "offset_window_s": 0.2}
    limits = {"answer_s": 1.0, "check_s": 0.01} | limits
    instrument = {"fts_range": [100.0] * 3 + [10.0] * 3, "pose_position_sd_m": 1e-5}
    return Bench.from_dict(
        tables | {"rig": rig, "limits": limits, "instrument": instrument}, "bench.toml"
    )


def run(plan: Table, rig: Rig, out: Path, bench: Bench | None = None, **options: Any) -> Table:
    """Measure with one device for all parts."""
    devices = dict.fromkeys(PARTS, rig)
    return measure(plan, bench or bench_of(), out, devices=devices, say=unsaid, **options)


FRAME = {"top_from_sensor": list(Instruments().top_from_sensor)}
"""Where the sensor of the simulated rig sits."""


def simulated(
    plan: Table, folder: Path, parts: tuple[str, ...] = (), *, like: dict[str, Any], **tables: Any
) -> tuple[Table, Bench]:
    """The plan as its file has it, and a bench of the simulated rig that measures it.

    `parts` are devices beside those of every bench; `like` are further settings of the rig.
    """
    path = folder / "plan.csv"
    plan.write(path)
    rig = {"device": "simulated", "plan": str(path)} | like
    devices = dict.fromkeys((*PARTS, "thermometer", *parts), rig)
    return read_table(path, need="predict"), Bench.from_dict(devices | tables, "bench.toml")


def neck_plan() -> Table:
    """Two poses of the neck, twice."""
    poses = dict.fromkeys(POSE, np.zeros(4)) | {"x_m": [0.1034, 0.102, 0.1034, 0.102]}
    return as_table(poses, meta=Meta(mechanism=Mechanism().to_dict()))


def test_the_simulated_rig_in_another_process_gives_the_table_of_the_campaign(
    tmp_path: Path,
) -> None:
    plan, bench = simulated(neck_plan(), tmp_path, like={"seed": 3}, instrument=FRAME)
    campaign = run_campaign(plan, RigSettings(), seed=3)
    measured = measure(plan, bench, tmp_path / "data.csv")
    assert {*campaign.columns} - {*measured.columns} == {"leds_visible"}
    for name, column in measured.columns.items():
        assert column.tolist() == campaign.columns[name].tolist(), name
    written = read_table(tmp_path / "data.csv")
    assert written.wrenches.tolist() == campaign.wrenches.tolist()
    assert not (tmp_path / "data.journal.csv").exists()


def test_a_spring_is_measured_and_fitted(tmp_path: Path) -> None:
    rig = Rig()
    table = run(plan_of(), rig, tmp_path / "data.csv")
    assert len(table) == 12
    assert table.column("repeat").tolist() == [0.0] * 6 + [1.0] * 6
    stiffness = np.polyfit(table.column("y_m"), table.column("fy_N"), 1)[0]
    assert stiffness == pytest.approx(1e4, rel=1e-3)
    freed = "free the sensor from the mechanism"
    assert [word for word in rig.told if word == freed] == [freed] * 2
    assert table.warnings == ()


def test_the_progress_says_how_far_a_row_is_from_a_model(tmp_path: Path) -> None:
    model = ecm.fit_model(run(plan_of(), Rig(), tmp_path / "first.csv"), "linear")
    rig, words = Rig(), list[str]()
    rig.outliers = {5}
    run(
        plan_of(),
        rig,
        tmp_path / "data.csv",
        model=model,
        progress=lambda done, total, what: words.append(what),
    )
    said = [float(word.split()[1]) for word in words if "N or" in word]
    assert len(said) == 12
    assert max(said) == said[3] == pytest.approx(5.0 * np.sqrt(3.0), rel=0.1)
    assert sorted(said)[-2] < 0.1


def test_a_pose_beyond_the_limits_moves_nothing(tmp_path: Path) -> None:
    rig = Rig()
    with pytest.raises(InputError, match=r"row 4: 3\.0 mm from rest, limit 2 mm \(shift_m\)"):
        run(plan_of(), rig, tmp_path / "data.csv", bench_of(shift_m=2e-3))
    assert rig.told == []


def test_a_force_beyond_the_limit_while_it_moves_stops_the_mover_first(tmp_path: Path) -> None:
    rig = Rig(settle_s=0.2)
    rig.accident = 3, rig.push, 2, 60.0
    began = time.monotonic()
    with pytest.raises(DeviceError, match=r"visit 4: force 60 N, limit 50 N \(force_N\)\. The"):
        run(plan_of(), rig, tmp_path / "data.csv", bench_of(force_N=50.0))
    assert time.monotonic() - began < 5.0
    assert "stop" in rig.told
    assert "start" not in rig.told[rig.told.index("stop") :]


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"velocity": 0.3}, r"\d+ mm/s, limit 250 mm/s \(speed_m_s\)\. The mover was stopped"),
        ({"velocity": 0.1}, r"mm from rest, limit 20 mm \(shift_m\)"),
        ({"hangs": "wrench"}, r"the wrench did not answer within 0\.51 s\. The mover was stopped"),
        ({"hangs": "settled"}, r"the mover did not answer within 0\.5 s"),
        ({"hangs": "start"}, r"the mover did not answer within 0\.5 s\. The mover was stopped"),
        ({"hangs": "pose"}, r"the pose did not answer within 0\.51 s"),
        ({"breaks": "settled"}, r"the mover failed: ValueError: no brake\. The mover was stopped"),
        ({"velocity": 0.3, "hangs": "stop"}, r"mm/s.* THE MOVER HAS NOT ANSWERED THE STOP"),
        ({"velocity": 0.3, "breaks": "stop"}, r"mm/s.* THE MOVER HAS NOT ANSWERED THE STOP"),
    ],
)
def test_what_goes_wrong_on_the_way_stops_the_mover_at_once_and_is_told_as_it_is(
    tmp_path: Path, wrong: dict[str, Any], said: str
) -> None:
    rig = Moving(**wrong)
    began = time.monotonic()
    with pytest.raises(DeviceError, match=said):
        run(plan_of(3), rig, tmp_path / "data.csv", bench_of(answer_s=0.5, shift_m=0.02))
    assert time.monotonic() - began < 3.0
    assert "stop" in rig.told


class Moving(Rig):
    """A mover that is on its way for long, and one of whose methods hangs or breaks."""

    def __init__(self, velocity: float = 0.0, hangs: str = "", breaks: str = "") -> None:
        super().__init__(settle_s=20.0)
        self.velocity = velocity
        for name in filter(None, [hangs, breaks]):
            setattr(self, name, partial(self.fail, name, hangs))

    def fail(self, name: str, hangs: str, *_: float) -> Any:
        self.told.append(name)
        if not hangs:
            raise ValueError("no brake")
        time.sleep(20.0)

    def ask(self, text: str) -> None:
        pass

    def pose(self, window_s: float) -> tuple[np.ndarray, np.ndarray]:
        time.sleep(window_s)
        way = self.velocity * (time.monotonic() - self._arrives_s + self.settle_s)
        return self.at + np.array([way, 0.0, 0.0, 0.0, 0.0, 0.0]), np.zeros(6)


def test_a_sensor_that_falls_silent_stops_the_mover_and_the_run_goes_on_later(
    tmp_path: Path,
) -> None:
    rig, out = Rig(), tmp_path / "data.csv"
    rig.silent_from = 5
    began = time.monotonic()
    with pytest.raises(DeviceError, match="readings are kept; the same command goes on"):
        run(plan_of(), rig, out)
    assert time.monotonic() - began < 10.0
    assert rig.told[-1] == "stop"
    assert len((tmp_path / "data.journal.csv").read_text().splitlines()) == 2 + 5
    again = Rig()
    table = run(plan_of(), again, out)
    assert np.count_nonzero(table.text("kind") == "pose") == 12
    assert np.count_nonzero(table.text("kind") == "home") == 1
    assert "going on at visit 6 of 14" in table.warnings[0]
    assert read_table(out).meta.runs[0]["note"] == "interrupted before visit 6"
    whole = run(plan_of(), Rig(), tmp_path / "whole.csv")
    at = table.text("kind") == "pose"
    assert np.abs(table.wrenches[at] - whole.wrenches).max() < 0.1


def test_readings_are_in_the_order_of_time_where_the_clock_is_set_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = iter(np.arange(2e9, 1e9, -60.0))
    monkeypatch.setattr(time, "time", lambda: float(next(clock)))
    rig, out = Rig(), tmp_path / "data.csv"
    rig.silent_from = 5
    with pytest.raises(DeviceError, match=r"with --minutes 0 it writes the table of them"):
        run(plan_of(), rig, out)
    journal = tmp_path / "data.journal.csv"
    kept = journal.read_text()
    only: Any = {"devices": {}, "say": unsaid, "minutes": 0.0, "agree": pytest.fail}
    part = measure(plan_of(), bench_of(), out, **only)
    with pytest.raises(InputError, match="no pose was measured, so no table is written"):
        measure(plan_of(), bench_of(), tmp_path / "other.csv", **only)
    assert part.text("kind").tolist() == ["pose"] * 4
    out.unlink()
    journal.write_text(kept)
    table = run(plan_of(), Rig(), out)
    assert len(table) == 13
    assert (np.diff(table.column("time_s")) > 0.0).all()


def test_another_plan_does_not_go_on_in_this_journal(tmp_path: Path) -> None:
    rig = Rig()
    rig.silent_from = 3
    with pytest.raises(DeviceError):
        run(plan_of(), rig, tmp_path / "data.csv")
    with pytest.raises(InputError, match="journal of another campaign"):
        run(plan_of(10), Rig(), tmp_path / "data.csv")
    journal = tmp_path / "data.journal.csv"
    whole = journal.read_text().splitlines()
    for damaged in (whole[3].replace(",", ";", 1), whole[3][:50], "1.5" + whole[3][1:]):
        journal.write_text("\n".join([*whole[:3], damaged, *whole[4:], ""]))
        with pytest.raises(
            InputError, match=r"journal\.csv line 4: found .*, expected 30 numbers; "
        ):
            run(plan_of(), Rig(), tmp_path / "data.csv")


def test_a_row_that_differs_from_its_repeat_is_measured_again_at_once(tmp_path: Path) -> None:
    rig = Rig()
    rig.outliers = {1 + 16}  # the zero is the first reading; pose 4, the third time
    table = run(plan_of(18), rig, tmp_path / "data.csv")
    assert len(table) == 19
    assert table.column("pose_id")[15:17].tolist() == [3.0, 3.0]
    assert "visit 17: f" in table.warnings[0]
    assert "sd from its repeat; it was measured again at once" in table.warnings[0]


def test_a_marker_that_slipped_is_told_at_the_next_look_at_home(tmp_path: Path) -> None:
    rig, told = Rig(), list[str]()
    plan = plan_of(4, action=["home", "measure", "measure", "home"], kind="")
    rig.accident = 3, rig.slip, 0, 3e-4
    devices = dict.fromkeys(PARTS, rig)
    table = measure(plan, bench_of(), tmp_path / "data.csv", devices=devices, say=told.append)
    assert told == list(table.warnings)
    assert "the rest pose has moved by 0.3 mm" in told[0]


def test_a_sensor_at_its_range_is_told_at_that_row(tmp_path: Path) -> None:
    rig = Rig()
    rig.push[1] = 90.0
    table = run(plan_of(), rig, tmp_path / "data.csv", bench_of(force_N=1000.0))
    assert any("the sensor is at its range along fy_N" in words for words in table.warnings)


@pytest.mark.parametrize(
    ("part", "visit", "zero"),
    [("wrench", 7, False), ("pose", 15, False), ("wrench", 8, True)],  # of 6, and of 2 columns
)
def test_an_instrument_that_stands_still_is_told_once(
    tmp_path: Path, part: str, visit: int, zero: bool
) -> None:
    rig = Rig()
    read, kept = getattr(rig, part), list[Any]()

    def stale(window_s: float) -> Any:
        kept.append(read(window_s) if rig.told.count("start") < 4 else kept[-1] * (not zero))
        return kept[-1]

    setattr(rig, part, stale)
    table = run(plan_of(20), rig, tmp_path / "data.csv")
    said = [words for words in table.warnings if "to the last digit" in words]
    assert len(said) == 1
    assert said[0].startswith(f"visit {visit}: the {part} is the same")


def test_no_pose_begins_after_the_time(tmp_path: Path) -> None:
    rig = Rig(settle_s=0.05)
    table = run(plan_of(60), rig, tmp_path / "data.csv", minutes=1.0 / 60.0)
    assert 2 <= len(table) < 60
    assert "the time was over" in table.warnings[-1]
    assert rig.told[-1] == "connect the sensor to the mechanism again" or len(table) < 60


SCRIPT = """
import sys
from pathlib import Path
sys.path.insert(0, {tests!r})
import importlib.util
spec = importlib.util.spec_from_file_location("rigs", {file!r})
rigs = importlib.util.module_from_spec(spec)
spec.loader.exec_module(rigs)
rigs.unsaid = print
rigs.run(rigs.plan_of(), rigs.Rig(settle_s=0.1), Path({out!r}), progress={progress})
"""


def test_the_simulated_rig_goes_on_where_it_was_cut(tmp_path: Path) -> None:
    plan, bench = simulated(neck_plan(), tmp_path, like={"seed": 3})

    def full(done: int, total: int, what: str) -> None:
        if done == 3:
            raise OSError("the disk is full")

    with pytest.raises(DeviceError, match="the disk is full"):
        measure(plan, bench, tmp_path / "data.csv", progress=full)
    table = measure(plan, bench, tmp_path / "data.csv", say=unsaid)
    assert table.text("kind").tolist() == ["pose", "pose", "home", "pose", "pose"]
    assert (np.diff(table.column("time_s")) > 0.0).all()
    whole = measure(plan, bench, tmp_path / "whole.csv")
    rest = table.text("kind") == "pose"
    assert np.abs(table.wrenches[rest] - whole.wrenches).max() < 1.0
    assert table.poses[rest].tolist() == whole.poses.tolist()


def fill_the_disk(done: int, total: int, what: str) -> None:
    """Let no file of this process grow by more than half a line after the third reading."""
    if done == 3:
        grown = 100 + max(path.stat().st_size for path in Path.cwd().glob("*.journal.csv"))
        resource.setrlimit(resource.RLIMIT_FSIZE, (100 * (grown // 100), -1))


def wait_to_be_killed(done: int, total: int, what: str) -> None:
    """No run ends before the signal comes."""
    if done == 6:
        time.sleep(60.0)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_a_run_that_is_killed_goes_on_from_its_last_reading(
    tmp_path: Path, number: signal.Signals
) -> None:
    out, journal = tmp_path / "data.csv", tmp_path / "data.journal.csv"
    known = {"tests": str(Path(__file__).parents[1]), "file": __file__, "out": str(out)}
    full = SCRIPT.format(**known, progress="rigs.fill_the_disk")
    said = ended(sys.executable, "-c", full, cwd=tmp_path, code=1)
    assert re.search(r"stopped at visit 4: .*File too large.* The mover was stopped", said.stderr)
    assert journal.stat().st_size % 100 == 0  # the fourth line is cut
    stops = ["the mover is being stopped", "The mover was stopped"]
    first, script = 3, SCRIPT.format(**known, progress="rigs.wait_to_be_killed")
    process = subprocess.Popen(
        [sys.executable, "-c", script], stdout=subprocess.PIPE, start_new_session=True
    )
    until(lambda: len(journal.read_text().splitlines()) >= first + 6)
    process.send_signal(number)
    began = time.monotonic()
    told = process.communicate(timeout=30.0)[0].decode().splitlines()[1:]
    assert process.returncode != 0
    assert time.monotonic() - began < 10.0
    assert [line.split(";")[0] for line in told] == stops * (number == signal.SIGINT)
    assert not out.exists()
    kept = int(journal.read_text().splitlines()[-1].split(",")[0]) + 1
    table = run(plan_of(), Rig(), out)
    # The same noise in each process: a repeat may look like an outlier, and is measured again.
    ids = table.column("pose_id")[table.text("kind") == "pose"]
    assert np.unique(ids, return_counts=True)[1].min() >= 2
    assert f"going on at visit {kept + 1} of 14" in table.warnings[0]
    cuts = f"interrupted before visit {first + 1} and before visit {kept + 1}"
    assert read_table(out).meta.runs[0]["note"] == cuts


def answering(answer: Callable[[bytes], bytes]) -> str:
    """The address of a device that gives each line it reads this answer."""
    listener = socket.create_server(("127.0.0.1", 0))

    def serve() -> None:
        with listener:
            connection, _ = listener.accept()
        with connection, connection.makefile("rwb") as stream:
            for line in stream:
                stream.write(answer(line))
                stream.flush()

    threading.Thread(target=serve, daemon=True).start()
    return f"127.0.0.1:{listener.getsockname()[1]}"


def test_lines_of_json_over_tcp_and_over_a_serial_port() -> None:
    answers = {
        b"start": b'{"ok": true}\n',
        b"settled": b'{"ok": true, "settled": true}\n',
        b"wrench": b'{"ok": true, "samples": [[1, 2, 3, 4, 5, 6], [1, 2, 3, 4, 5, 6]]}\n',
        b"pose": b'{"ok": true, "mean": [0.1, 0, 0, 0, 0, 0], "sd": [0, 0, 0, 0, 0, 0]}\n',
        b"temperature": b'{"ok": true, "degC": 22.5}\n',
        b"stop": b'{"ok": false, "error": "the brake is on"}\n',
        b"ask": b"no JSON\n",
    }

    def answer(question: bytes) -> bytes:
        return next(text for word, text in answers.items() if b'"do": "' + word in question)

    own, other = os.openpty()

    def serve_port() -> None:
        rest = b""
        while b"end" not in rest:
            rest += os.read(own, 4096)
            while b"\n" in rest and b"end" not in rest:
                line, _, rest = rest.partition(b"\n")
                os.write(own, answer(line))

    threading.Thread(target=serve_port, daemon=True).start()
    for address in (answering(answer), os.ttyname(other)):
        device = opened("line", {"address": address}, "bench.toml [mover]")
        device.start(np.zeros(6))
        assert device.settled() is True
        assert device.wrench(0.1).shape == (2, 6)
        assert device.pose(0.1)[0][0] == 0.1
        assert device.temperature() == 22.5
        with pytest.raises(DeviceError, match="the brake is on"):
            device.stop()
        with pytest.raises(DeviceError, match="expected a JSON object"):
            device.ask("free the sensor")
        device.close()
    os.write(other, b"end\n")
    with pytest.raises(InputError, match="expected HOST:PORT or a serial port"):
        opened("line", {"address": "/dev/nothing"}, "bench.toml [mover]")


@pytest.mark.parametrize(
    ("asked", "told", "said"),
    [
        ("settled", '{"ok": true, "settled": "false"}', r"settled \(true or false\)"),
        ("stop", '{"ok": "no"}', r"expected a JSON object with ok \(true or false\)"),
        ("wrench", '{"ok": true, "samples": [[1, 2, 3]]}', r"0\.1:\d+: the answer has no samples"),
    ],
)
def test_an_answer_of_another_form_is_refused(asked: str, told: str, said: str) -> None:
    device, connection = linked()
    answer = Status(partial(getattr(device, asked), *[0.1] * (asked == "wrench")))
    with connection, connection.makefile("rwb", buffering=0) as stream:
        stream.readline()
        stream.write(f"{told}\n".encode())
        assert re.search(said, str(answer.exception(5.0)))
    device.close()


def linked(**settings: Any) -> tuple[Any, socket.socket]:
    """A device behind lines, and the other end."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        address = f"127.0.0.1:{listener.getsockname()[1]}"
        device = opened("line", {"address": address} | settings, "bench")
        connection, _ = listener.accept()
    connection.settimeout(5.0)
    return device, connection


def test_an_answer_to_no_question_stops_the_run() -> None:
    device, connection = linked()
    with connection:
        connection.sendall(b'{"ok": true, "degC": 20.0}\n')  # later answers would be one late
        with pytest.raises(DeviceError, match=r"degC.: 20\.0}'` came before `temperature`, and n"):
            device.temperature()
    with pytest.raises(DeviceError, match=r"the connection was closed$"):
        device.temperature()
    device.close()


def moved(start: Any, settled: Any, look: Any) -> BaseException | None:
    """The error of a move of a mover that is seen every 20 ms."""
    rig = SimpleNamespace(answer=lambda _, ask, __=0.0: ask(), look=look, look_s=0.02)
    run = SimpleNamespace(bench=SimpleNamespace(limits=SimpleNamespace(move_s=5.0)))
    device = SimpleNamespace(start=lambda _: start(mover), settled=settled)
    mover = _Mover(run, {"mover": device}, rig)
    return mover.set(np.zeros(6)).exception(5.0)


def test_a_move_that_was_stopped_has_not_arrived() -> None:
    error = moved(lambda mover: mover.ended.set(), lambda: True, lambda seen: seen)
    assert isinstance(error, Stopped)


def test_two_looks_are_apart_where_a_device_answers_at_once() -> None:
    times: list[float] = []
    error = moved(lambda _: None, lambda: len(times) == 4, lambda _: times.append(time.monotonic()))
    assert error is None
    assert min(np.diff(times)) > 0.015


POSE_TOLD = f'{{"ok": true, "mean": {[0.0] * 6}, "sd": {[0.0] * 6}}}'


@pytest.mark.parametrize(
    ("form", "answers", "said"),
    [
        ("json", [POSE_TOLD, '{"ok": true}'], "None"),
        ("late", [POSE_TOLD, '{"ok": true}'], "no answer within 0.5 s"),
        ("late", [POSE_TOLD], "no answer within 0.5 s"),
        ("json", [POSE_TOLD], "None"),
        ("json", [], "no answer within 0.5 s"),
        ("json", ["no JSON"], "expected a JSON object with mean"),
        ("json", ['{"ok": true}'], "no answer to `pose`, and then one to `stop`"),
        ("csv", ["ok"], "no answer to `pose`, and then one to `stop`"),
    ],
)
def test_a_stop_does_not_wait_for_another_question_and_knows_its_own_answer(
    form: str, answers: list[str], said: str
) -> None:
    device, connection = linked(form="json" if form == "late" else form, timeout_s=0.5)
    with connection, connection.makefile("rwb") as stream:
        calls = []
        for call, word in ((partial(device.pose, 0.1), b"pose"), (device.stop, b"stop")):
            calls.append(Status(call))
            assert word in stream.readline()
            if form == "late":
                calls[0].exception(5.0)
        stream.write("".join(f"{line}\n" for line in answers).encode())
        stream.flush()
        heard = [call.exception(5.0) for call in calls]
    device.close()
    assert said in str(heard[0])
    assert (heard[1] is None) == (answers[-1:] in (['{"ok": true}'], ["ok"]))


@pytest.mark.parametrize("lost", [False, True])
@pytest.mark.parametrize("form", ["json", "csv", "json numbered", "csv numbered"])
@pytest.mark.parametrize("asked", ["start", "ask", "actuate", "follow"])
def test_a_late_answer_is_not_that_of_the_stop(form: str, asked: str, lost: bool) -> None:
    def answer(line: bytes) -> bytes:
        number = (re.findall(rb"\d+", line) or [b""])[0]
        if form.startswith("csv"):
            return b"ok\r\n" if form == "csv" else number + b",ok\r\n"
        return b'{"ok": true}\r\n' if form == "json" else b'{"ok": true, "id": %b}\r\n' % number

    form_, _, numbered = form.partition(" ")
    device, connection = linked(form=form_, timeout_s=0.3, numbered=bool(numbered))
    given = {"start": np.zeros(6), "ask": "free it", "actuate": np.zeros(2), "follow": 0.02}
    with connection, connection.makefile("rwb", buffering=0) as stream:
        first = Status(partial(getattr(device, asked), given[asked]))
        question = stream.readline()
        assert numbered or question.startswith((b'{"do": "' + asked.encode(), asked.encode()))
        if asked in ("start", "actuate"):  # the others wait for longer
            assert "no answer within 0.3 s" in str(first.exception(5.0))
        stop = Status(device.stop)
        own = answer(stream.readline())
        if numbered:
            stream.write(b"[INFO] homing\r\n99,ok\r\n" + b'{"ok": true, "id": 2}\r\n')
        stream.write(own if lost else answer(question) + own)
        heard = str(stop.exception(5.0))
    device.close()
    assert not device._heard  # what nobody waits for is not kept
    assert heard == "None" if numbered or not lost else "no answer within 0.3 s" in heard


def test_a_stop_comes_through_a_new_connection_where_the_old_one_was_cut() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        address = f"127.0.0.1:{listener.getsockname()[1]}"
        device = opened("line", {"address": address, "timeout_s": 2.0}, "bench")
        moving = Status(lambda: device.start(np.zeros(6)))
        with listener.accept()[0] as cut:
            assert b"start" in cut.recv(100)
        assert "the connection was closed" in str(moving.exception(5.0))
        stop = Status(device.stop)
        with listener.accept()[0] as again:
            assert again.recv(100) == b'{"do": "stop"}\n'
            again.sendall(b'{"ok": true}\n')
            assert stop.exception(5.0) is None
    device.close()


def test_a_class_of_one_s_own_is_found_by_its_entry_point(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    info = tmp_path / "my_stage-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: my-stage\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[ecm.bench]\nmy-stage = my_stage:Stage\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(DeviceError, match=r"\[mover\]: .* opened: ModuleNotFoundError"):
        opened("my-stage", {}, "bench.toml [mover]")
    lines = ("class Stage:", "    def __init__(self, *, speed_m_s):", "        1.0 / speed_m_s")
    (tmp_path / "my_stage.py").write_text("\n".join(lines))
    assert type(opened("my-stage", {"speed_m_s": 0.1}, "bench.toml [mover]")).__name__ == "Stage"
    with pytest.raises(DeviceError, match=r"\[mover\]: .* opened: ZeroDivisionError"):
        opened("my-stage", {"speed_m_s": 0.0}, "bench.toml [mover]")
    with pytest.raises(InputError, match=r"unexpected keyword argument 'speed'"):
        opened("my-stage", {"speed": 0.1}, "bench.toml [mover]")


COUNTS = [1_000_000, -2_000_000, 3_000_000, 100_000, 0, -50_000]


@contextmanager
def ati_box(*, status: int = 0, lose: int = 0) -> Iterator[Any]:
    """A Net F/T box by its published packets, and the device that reads it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as box:
        box.bind(("127.0.0.1", 0))
        box.settimeout(10.0)

        def serve() -> None:
            request, whom = box.recvfrom(64)
            header, command, count = struct.unpack("!HHI", request)
            assert (header, command) == (0x1234, 2)
            for i in range(1, count + 1):
                if not lose or i % lose:
                    box.sendto(struct.pack("!IIIiiiiii", i, 7 * i, status, *COUNTS), whom)

        serving = threading.Thread(target=serve)
        serving.start()
        settings = {"address": f"127.0.0.1:{box.getsockname()[1]}", "timeout_s": 0.5}
        device = opened("ati-net-ft", settings, "bench.toml [wrench]")
        yield device
        serving.join()
        device.close()


def test_the_ati_box_gives_newtons_and_may_lose_records() -> None:
    with ati_box() as box:
        samples = box.wrench(0.05)
    assert samples.shape == (50, 6)
    assert samples[0].tolist() == [1.0, -2.0, 3.0, 0.1, 0.0, -0.05]
    with ati_box(lose=4) as box:
        assert len(box.wrench(0.05)) == 38


def test_the_ati_box_with_a_bad_status_or_without_a_cable_is_refused() -> None:
    with ati_box(status=0x80000000) as box, pytest.raises(DeviceError, match="0x80000000"):
        box.wrench(0.05)
    with ati_box(lose=1) as box, pytest.raises(DeviceError, match="0 of 50 samples came"):
        box.wrench(0.05)


def test_a_person_is_asked_again_until_the_entry_is_six_numbers(
    capsys: pytest.CaptureFixture[str],
) -> None:
    entries = iter(["", "1 2 3", "1 2 3 4 5 x", "1, 2, 3, 4, 5, 6", ""])
    person = Manual(ask_for=lambda prompt: next(entries))
    person.start(np.array([0.1, 0.002, 0.0, 0.0, 0.0, 0.1]))
    assert person.wrench(0.1).tolist() == [[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]]
    assert person.pose(0.1)[0].tolist() == [0.1, 0.002, 0.0, 0.0, 0.0, 0.1]
    said = capsys.readouterr().out
    assert "`1 2 3`: found 3, expected 6 numbers" in said
    assert "`1 2 3 4 5 x`: `x` is no number" in said


def test_what_a_bench_lacks_is_named() -> None:
    tables = {part: {"device": "manual"} for part in PARTS}
    with pytest.raises(InputError, match=r"\[pose\] is missing"):
        Bench.from_dict({k: v for k, v in tables.items() if k != "pose"}, "bench.toml")
    with pytest.raises(InputError, match=r"did you mean '?force_N"):
        Bench.from_dict(tables | {"limits": {"force_n": 1.0}}, "bench.toml")
    with pytest.raises(InputError, match="the key device is missing"):
        Bench.from_dict(tables | {"pose": {}}, "bench.toml")
    with pytest.raises(InputError, match=r"AtiNetFt cannot be the mover: it has no start\(\)"):
        Bench.from_dict(
            tables | {"mover": {"device": "ati-net-ft", "address": "127.0.0.1"}}, "bench.toml"
        ).open()
    alone = {part: table for part, table in tables.items() if part != "person"}
    with pytest.raises(InputError, match=r"there is no \[person\] to free it"):
        envelope(plan_of(), Bench.from_dict(alone, "bench.toml"))
    zeroed = Bench.from_dict(alone | {"rig": {"offset_compensation": "none"}}, "bench.toml")
    assert envelope(plan_of(), zeroed)[1][0] == "12 visits, about 1 minutes"
    for action in ("unload", "remount:90"):
        handled = plan_of(action=[*["measure"] * 11, action])
        word = action.partition(":")[0]
        with pytest.raises(InputError, match=f"row 12: `{word}` is done by hand, and bench"):
            envelope(handled, zeroed)
    warm = Bench.from_dict(tables | {"rig": {"offset_compensation": "temperature"}}, "bench.toml")
    with pytest.raises(InputError, match=r"there is no \[thermometer\]"):
        envelope(plan_of(), warm)
    far = plan_of().with_columns({"x_m": np.where(np.arange(12) < 3, 0.3, 0.1)})
    assert "3 of 12 rows are left out, the first is row 1: " in "\n".join(envelope(far, zeroed)[1])


def test_a_dry_run_and_a_command_without_yes_move_nothing(tmp_path: Path) -> None:
    plan_of().write(tmp_path / "plan.csv")
    tables = "".join(f'[{part}]\ndevice = "line"\naddress = "127.0.0.1:1"\n' for part in PARTS)
    (tmp_path / "bench.toml").write_text(tables)
    command = [sys.executable, "-m", "ecm", "measure", "plan.csv", "--rig", "bench.toml"]
    command += ["--out", "data.csv"]
    dry = ended(*command, "--dry-run", cwd=tmp_path)
    assert not dry.stderr  # a plan goes to the same pose again on purpose
    assert "14 visits" in dry.stdout
    assert "farthest 5.00 mm and 0.000 rad from rest" in dry.stdout
    asked = ended(*command, cwd=tmp_path, code=2, stdin=subprocess.DEVNULL)
    assert "nobody has agreed to the moves above" in asked.stderr
    refused = ended(*command, "--yes", cwd=tmp_path, code=1)
    assert "bench.toml [mover]: the device cannot be reached" in refused.stderr
    assert not (tmp_path / "data.csv").exists()
    assert ecm.read_table(tmp_path / "plan.csv", need="predict") is not None


def test_a_second_interruption_says_that_the_mover_may_still_move(tmp_path: Path) -> None:
    plan_of().write(tmp_path / "plan.csv")
    with socket.create_server(("127.0.0.1", 0)) as listener:
        link = f'device = "line"\naddress = "127.0.0.1:{listener.getsockname()[1]}"\n'
        tables = '[rig]\noffset_compensation = "none"\n' + "".join(
            f"[{part}]\n{link}" for part in PARTS[:3]
        )
        (tmp_path / "bench.toml").write_text(tables)
        command = [sys.executable, "-m", "ecm", "measure", "plan.csv", "--rig", "bench.toml"]
        process = subprocess.Popen(
            [*command, "--out", "data.csv", "--yes"], cwd=tmp_path, stderr=subprocess.PIPE
        )
        connection, _ = listener.accept()
    with connection, connection.makefile("rwb", buffering=0) as stream:
        assert b"start" in stream.readline()  # which nobody answers, as the stop
        process.send_signal(signal.SIGINT)
        assert b"stop" in stream.readline()
        process.send_signal(signal.SIGINT)
        said = process.communicate(timeout=10.0)[1].decode().splitlines()
    assert process.returncode == 130
    assert said[-1] == (
        "Interrupted; finished readings are kept. The same command goes on there. THE MOVER HAS "
        "NOT ANSWERED THE STOP (it may still move: stop it at the rig)."
    )
