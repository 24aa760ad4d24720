"""Ctrl-C ends a command with 130 and one line, from its first moments to its last."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from ecm.cli.session import Session
from ecm.errors import ComputationError
from ecm.io.cache import write_atomically
from ecm.io.description import Meta
from ecm.io.interrupts import uninterrupted, wait_to_interrupt
from ecm.io.table import as_table
from interruptions import files, loads_ecm, printed, run, when, written
from support.neck import Command, csv_text, neck_columns
from support.programs import ended

FIT = ("fit", "d.csv", "--model", "linear", "--json", "f.json", "--out", "m.json")


MOMENTS = {
    "while modules are imported": when(loads_ecm),
    "40 ms later": when(loads_ecm, 0.04),
    "120 ms later": when(loads_ecm, 0.12),
    "250 ms later": when(loads_ecm, 0.25),
    "with the first file": when(written("m.json")),
    "with the last file": when(written("f.json")),
    "with the last line": when(printed("m.json: model linear")),
}


def test_an_interruption_at_any_moment_ends_with_130_and_one_line(tmp_path: Path) -> None:
    """From the imports to the shutdown of the interpreter; afterwards the bytes are the same."""
    text = csv_text(neck_columns(30))
    whole, cut = tmp_path / "whole", tmp_path / "cut"
    for folder in (whole, cut):
        folder.mkdir()
        (folder / "d.csv").write_text(text, encoding="utf-8")
    assert run(FIT, whole).code == 0
    interrupted = 0
    for name, moment in MOMENTS.items():
        for old in (cut / "m.json", cut / "f.json"):
            old.unlink(missing_ok=True)
        end = run(FIT, cut, moment=moment)
        # The command may have ended in the microseconds between looking and sending.
        if end.code != 0:
            assert end.faults(signal.SIGINT) == [], f"{name}: {end.text}"
            interrupted += 1
        assert end.code in (0, 130), f"{name}: {end.text}"
    assert interrupted >= 5, "those before the last file"
    assert run(FIT, cut).code == 0
    assert files(cut) == files(whole)


WAITS = """
import signal, sys
from pathlib import Path
from ecm.cli import interrupt
from ecm.cli.main import reported
from ecm.io.cache import write_atomically
from ecm.io.interrupts import uninterrupted
signal.signal(signal.SIGHUP, signal.SIG_DFL)  # ignored where nohup runs the tests
interrupt.install()
interrupt.begin()
def work():
    with uninterrupted():
        print("waits", flush=True)
        write_atomically(Path(sys.argv[1]), "the model")
sys.exit(reported(work))
"""


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_a_pipe_that_nobody_reads_does_not_hold_the_command(tmp_path: Path, number: int) -> None:
    os.mkfifo(tmp_path / "out")
    arguments = [sys.executable, "-c", WAITS, tmp_path / "out"]
    with subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"waits\n"
        time.sleep(0.1)
        sent = time.monotonic()
        process.send_signal(number)
        assert process.wait(10.0) == 130
        assert time.monotonic() - sent < 2.0, "0.05 s where the machine has nothing else to do"


def test_a_pipe_is_written_to_its_reader_and_refused_without_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "out"
    os.mkfifo(path)
    monkeypatch.setattr("ecm.io.cache._WAIT_FOR_READER_S", 0.1)
    with pytest.raises(ComputationError, match=r"out: no program has read this pipe for 0.1 s"):
        write_atomically(path, "the model")
    with subprocess.Popen(["cat", path], stdout=subprocess.PIPE) as reader:
        monkeypatch.setattr("ecm.io.cache._WAIT_FOR_READER_S", 10.0)
        write_atomically(path, "the model")
        assert reader.communicate()[0] == b"the model"


LOST = """
import atexit, os, signal, time
from ecm.cli import interrupt
from ecm.io.interrupts import uninterrupted
interrupt.install()
interrupt.begin()
class Owner:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.2)
"""


@pytest.mark.parametrize(
    "what",
    [
        "Owner(); print('went on')",  # Python prints an exception of a destructor and goes on
        "interrupt.finish(0); Owner()",
        "atexit.register(Owner); interrupt.finish(0)",
        "with uninterrupted(): Owner(); Owner()",  # whoever cannot wait interrupts twice
    ],
)
def test_an_interruption_is_not_lost_where_no_exception_gets_through(what: str) -> None:
    done = ended(sys.executable, "-c", LOST + what, code=130, timeout=30)
    assert done.stdout == "", done
    assert done.stderr.startswith("Interrupted; ")
    assert done.stderr.count("\n") == 1


def test_a_file_is_finished_before_the_interruption() -> None:
    steps = []

    def write() -> None:
        with uninterrupted():
            with uninterrupted():
                assert wait_to_interrupt()
                steps.append("inner")
            steps.append("outer")
        steps.append("after")

    with pytest.raises(KeyboardInterrupt):
        write()
    assert steps == ["inner", "outer"]
    assert not wait_to_interrupt()


def test_an_interruption_tells_which_files_are_complete(tmp_path: Path) -> None:
    first, second = tmp_path / "a.json", tmp_path / "b.json"
    second.write_text("older")
    session = Session()
    session.check_output(first, second, None)
    assert session.left_behind() == "nothing was written. Run the same command again."
    first.write_text("new")
    assert session.left_behind() == f"complete: {first}. Run the same command again for the rest."


# --- pairs of files ------------------------------------------------------------


def test_a_plan_that_was_cut_between_its_files_is_completed(
    tmp_path: Path, ecm_command: Command
) -> None:
    meta = Meta(mechanism={"length_m": 0.1})
    as_table(neck_columns(30), meta=meta).write(tmp_path / "c.csv")
    plan = tmp_path / "plan.csv"
    design = ("design", tmp_path / "c.csv", "--n", "8", "--model", "linear", "--out", plan)
    design = (*design, "--starts", "1", "--iterations", "20")
    assert ecm_command(*design).code == 0
    whole = files(tmp_path)
    plan.unlink()  # the description is written first
    assert ecm_command(*design).code == 0
    assert files(tmp_path) == whole
    plan.unlink()
    plan.with_suffix(".toml").write_text("[mechanism]\nlength_m = 0.2\n")
    done = ecm_command(*design).refused()
    assert "which the plan's description would overwrite" in done.err


def test_a_first_data_file_that_was_cut_between_its_files_is_completed(
    tmp_path: Path, ecm_command: Command
) -> None:
    new = ("new", "data", "--out", tmp_path / "d.csv")
    assert ecm_command(*new).code == 0
    whole = files(tmp_path)
    for name in whole:
        (tmp_path / name).unlink()
        assert ecm_command(*new).code == 0
        assert files(tmp_path) == whole
    assert ecm_command(*new).code == 2
