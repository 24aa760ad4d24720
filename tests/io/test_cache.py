"""Stages: hashes, atomic files, and work that a kill does not take back."""

from __future__ import annotations

import errno
import json
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecm.errors import ComputationError
from ecm.io.cache import Stage, atomic, hash_of, write_atomically, write_json


@dataclass(frozen=True)
class Settings:
    n: int
    tolerance: float


def test_equal_settings_have_equal_hashes_and_others_not() -> None:
    assert hash_of({"a": 1, "b": [1.5, None]}) == hash_of({"b": (1.5, None), "a": 1})
    assert hash_of(Settings(1, 0.5)) == hash_of({"n": 1, "tolerance": 0.5})
    distinct = [
        1, 1.5, "1", True, None, [1], {"a": 1}, np.zeros(2), np.zeros(3), np.zeros((2, 1)),
        np.zeros(2, dtype=np.int64), np.array([0.0, -0.0]), float("nan"), float("inf"),
    ]  # fmt: skip
    assert len({hash_of(value) for value in distinct}) == len(distinct)


@given(st.lists(st.floats(-1e300, 1e300), min_size=1, max_size=5))
def test_the_hash_of_an_array_is_that_of_its_bytes(values: list[float]) -> None:
    array = np.array(values)
    assert hash_of(array) == hash_of(array.copy())
    array[0] = np.nextafter(array[0], np.inf)
    assert hash_of(array) != hash_of(np.array(values))


def test_a_json_file_is_json_whatever_was_not_finite(tmp_path: Path) -> None:
    """`Infinity` is no JSON: a browser and most readers refuse the whole file for it."""
    path = tmp_path / "found.json"
    document = {"sd": [float("inf"), 0.25], "rows": ({"z": float("nan")}, -float("inf")), "n": 3}
    write_json(path, document)

    def refuse(word: str) -> None:
        raise AssertionError(word)

    found = json.loads(path.read_text(encoding="utf-8"), parse_constant=refuse)
    assert found == {"sd": [None, 0.25], "rows": [{"z": None}, None], "n": 3}
    # A stage is its own reader, and gives back what it was given.
    again = Stage(tmp_path, "far", None).run(lambda: {"limit": float("inf")})
    assert again["limit"] == float("inf")


def test_a_stage_computes_once_per_settings(tmp_path: Path) -> None:
    calls = []

    def compute() -> dict[str, object]:
        calls.append(1)
        return {"x": np.arange(3.0), "words": np.array(["a", ""], dtype=object), "n": 3}

    for _ in range(2):
        stage = Stage(tmp_path, "square", Settings(3, 1e-6), inputs=np.ones(2))
        result = stage.run(compute)
        np.testing.assert_array_equal(result["x"], [0.0, 1.0, 2.0])
        assert result["words"].tolist() == ["a", ""]
        assert result["n"] == 3
        assert list(result) == ["x", "words", "n"]
    assert len(calls) == 1
    other = Stage(tmp_path, "square", Settings(4, 1e-6), inputs=np.ones(2))
    assert not other.path.exists()
    other.run(compute)
    assert len(calls) == 2
    assert stage.load()["n"] == 3  # the earlier result is still there


def test_a_damaged_result_counts_as_not_done(tmp_path: Path) -> None:
    stage = Stage(tmp_path, "s")
    stage.run(lambda: {"x": np.arange(100.0)})
    archive = next(tmp_path.glob("*.npz"))
    content = bytearray(archive.read_bytes())
    content[len(content) // 2] ^= 1
    archive.write_bytes(content)
    with pytest.raises(ComputationError, match="no complete result of the stage 's'"):
        stage.load()
    assert stage.run(lambda: {"x": np.ones(1)})["x"].tolist() == [1.0]


def test_the_same_result_has_the_same_bytes(tmp_path: Path) -> None:
    contents = []
    for name in ("a", "b"):
        stage = Stage(tmp_path / name, "s")
        stage.run(lambda: {"x": np.arange(5.0), "y": 0.1})
        contents.append({p.name: p.read_bytes() for p in (tmp_path / name).iterdir()})
    assert contents[0] == contents[1]


def test_chunks_are_kept_until_the_whole_is_there(tmp_path: Path) -> None:
    stage = Stage(tmp_path, "long", {"n": 2})
    assert stage.load_part(0) is None
    stage.save_part(0, {"x": np.zeros(2)})
    assert stage.parts() == 1
    found = Stage(tmp_path, "long", {"n": 2}).load_part(0)
    assert found is not None
    assert found["x"].tolist() == [0.0, 0.0]
    assert Stage(tmp_path, "long", {"n": 3}).load_part(0) is None
    part = next(tmp_path.glob("*.parts/*"))
    part.write_bytes(part.read_bytes()[:-1])
    assert stage.load_part(0) is None
    stage.save({"n": 2})
    assert stage.parts() == 0


def test_a_failed_write_leaves_the_old_file_and_no_rubbish(tmp_path: Path) -> None:
    path = tmp_path / "file.txt"
    write_atomically(path, "old")

    def fail() -> None:
        with atomic(path) as file:
            file.write(b"half of the n")
            raise OSError(errno.EFBIG, "File too large")

    with pytest.raises(OSError, match=r"file\.txt"):
        fail()
    assert path.read_text(encoding="utf-8") == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["file.txt"]


def test_threads_that_write_one_file_leave_the_whole_text_of_one(tmp_path: Path) -> None:
    path = tmp_path / "file.txt"
    texts = [f"{letter}" * 100_000 for letter in "abcd"]
    with ThreadPoolExecutor(4) as pool:
        for _ in range(10):
            list(pool.map(lambda text: write_atomically(path, text), texts))
            assert path.read_text(encoding="utf-8") in texts
    assert [p.name for p in tmp_path.iterdir()] == ["file.txt"]


def test_an_error_of_writing_names_the_file_that_was_asked_for(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="directory") as said:
        write_atomically(tmp_path, "text")
    assert str(said.value).endswith(f"directory: '{tmp_path}'")


WRITES = """
import sys
from pathlib import Path
from ecm.io.cache import atomic
with atomic(Path(sys.argv[1])) as file:
    file.write(b"half")
    file.flush()
    if sys.argv[2] == "wait":
        print("half", flush=True)
        sys.stdin.read()
"""


def test_what_a_killed_process_left_goes_when_the_file_is_written_again(tmp_path: Path) -> None:
    path, other = tmp_path / "file.txt", tmp_path / "file.txt.csv"

    def write(target: Path, then: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-c", WRITES, str(target), then]
        return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)

    killed, alive, elsewhere = (write(target, "wait") for target in (path, path, other))
    for process in (killed, alive, elsewhere):
        assert process.stdout is not None
        assert process.stdout.readline() == b"half\n"
    for process in (killed, elsewhere):
        process.kill()
        process.communicate()
    foreign = tmp_path / f".file.txt.{killed.pid}.tmp"
    foreign.write_bytes(b"of another program, or of another machine")
    left = {p.name for p in tmp_path.iterdir()}
    write(path, "end").communicate()
    gone = left - {p.name for p in tmp_path.iterdir()}
    assert len(gone) == 1
    assert gone.pop().endswith(f".{killed.pid}.tmp")
    assert foreign.exists()
    alive.communicate()
    assert alive.returncode == 0
    assert path.read_bytes() == b"half"


LONG_JOB = """
import sys, time
from pathlib import Path
import numpy as np
from ecm.io.cache import Stage
stage = Stage(Path(sys.argv[1]), "long", {"n": 80})
computed = 0
values = []
for i in range(80):
    def compute(i=i):
        global computed
        computed += 1
        time.sleep(0.002)
        return {"x": np.full(50, float(i) ** 0.5)}
    part = stage.load_part(i)
    if part is None:
        part = compute()
        stage.save_part(i, part)
    values.append(part["x"].sum())
    print(i, flush=True)
stage.save({"sums": np.array(values)})
Path(sys.argv[2]).write_text(str(computed))
"""


def test_kill_minus_nine_takes_back_no_finished_chunk(tmp_path: Path) -> None:
    """Killed twice in the middle, the job goes on and ends with the bytes of an unbroken one."""
    folder, count = tmp_path / "killed", tmp_path / "count"
    command = [sys.executable, "-c", LONG_JOB]
    kept = 0
    for stop in (15, 40):
        process = subprocess.Popen(
            [*command, str(folder), str(count)], stdout=subprocess.PIPE, text=True
        )
        assert process.stdout is not None
        for line in process.stdout:
            if int(line) >= stop:
                break
        os.kill(process.pid, signal.SIGKILL)
        process.stdout.close()
        assert process.wait() == -signal.SIGKILL
        parts = Stage(folder, "long", {"n": 80}).parts()
        assert parts > stop
        assert parts >= kept
        kept = parts
    start = time.perf_counter()
    subprocess.run([*command, str(folder), str(count)], check=True, stdout=subprocess.DEVNULL)
    assert time.perf_counter() - start < 60.0
    assert int(count.read_text(encoding="utf-8")) == 80 - kept
    whole = tmp_path / "whole"
    subprocess.run([*command, str(whole), str(count)], check=True, stdout=subprocess.DEVNULL)
    assert int(count.read_text(encoding="utf-8")) == 80
    left = {p.name: p.read_bytes() for p in folder.iterdir() if p.is_file()}
    right = {p.name: p.read_bytes() for p in whole.iterdir() if p.is_file()}
    assert left == right
    assert json.loads(next(whole.glob("*.json")).read_text(encoding="utf-8"))["stage"] == "long"
