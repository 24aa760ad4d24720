"""Logs that are cut off or damaged: each ends in a table or in a refusal that names the file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ecm import import_log
from ecm.errors import EcmError, InputError
from ecm.io.table import read_table
from support.neck import Command
from support.spoilt_files import good_logs, spoilt

SPOILT = 15
"""Copies of each log that are tried."""
NAMES = (
    "plain.mat", "packed.mat", "four.mat", "v73.mat", "log.h5", "packed.h5", "log.npz",
    "packed.npz", "log.npy", "log.parquet", "log.csv", "tabs.txt", "log.db3", "log.mcap",
)  # fmt: skip


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    return good_logs(tmp_path_factory.mktemp("logs"))


@pytest.mark.parametrize("name", NAMES)
def test_a_spoilt_log_is_read_or_refused_by_name(
    name: str, logs: dict[str, bytes], tmp_path: Path
) -> None:
    path, problems, refused = tmp_path / name, [], 0
    path.write_bytes(logs[name])
    assert len(import_log(path, units=["SI"]).table) > 20
    copies = [("cut in the middle", logs[name][: len(logs[name]) // 2]), ("empty", b"")]
    for label, content in [*copies, *spoilt(logs[name], SPOILT, seed=31)]:
        path.write_bytes(content)
        try:
            str(import_log(path, units=["SI"], leave_out=True))
        except EcmError as error:
            refused += 1
            if name not in str(error):
                problems.append(f"{label}: no name: {error}")
        except BaseException as error:
            problems.append(f"{label}: {type(error).__name__}: {error}")
    assert problems == []
    assert refused > 0


def test_a_spoilt_parquet_table_is_refused(logs: dict[str, bytes], tmp_path: Path) -> None:
    for label, content in spoilt(logs["log.parquet"], 20, seed=5):
        path = tmp_path / "log.parquet"
        path.write_bytes(content)
        try:
            read_table(path)
        except InputError as error:
            assert "log.parquet" in str(error), label  # noqa: PT017


def test_the_command_ends_with_two_and_says_what_to_do(
    logs: dict[str, bytes], tmp_path: Path, ecm_command: Command
) -> None:
    path = tmp_path / "log.mat"
    path.write_bytes(logs["packed.mat"][:1500])
    done = ecm_command("import", str(path), "--out", str(tmp_path / "table.csv")).refused()
    assert "log.mat: no readable MAT file" in done.err
    assert "It may be cut off or damaged: copy or save it again." in done.err
    assert "unexpected" not in done.err


def test_control_characters_of_a_file_do_not_reach_the_terminal(
    tmp_path: Path, ecm_command: Command
) -> None:
    rows = "".join(f"0.00{i},{i}.5,{i}\n" for i in range(1, 9))
    head = "x_m,fx_N,temp\x1b[31m\x9b2J\u202e\n"
    (tmp_path / "good.csv").write_text(head + rows, encoding="utf-8")
    bad = '0.1,\x1b]0;evil\x07,1\n0.2,"a\nb\rc",1\n0.3,' + "y" * 50_000 + ",1\n"
    (tmp_path / "bad.csv").write_text(head + rows + bad, encoding="utf-8")
    (tmp_path / "wide.csv").write_text("x_m," + "t" * 50_000 + "\n0,1\n1,2\n", encoding="utf-8")
    for name, code in (("good.csv", 0), ("bad.csv", 2), ("wide.csv", 2)):
        done = ecm_command("check", str(tmp_path / name))
        printed = done.out + done.err
        assert done.code == code
        assert not set(printed) & {"\x1b", "\x07", "\r", "\x9b", "\u202e"}
        assert max(map(len, printed.splitlines())) < 2000
    assert "temp\\x1b[31m\\x9b2J\\u202e" in ecm_command("check", str(tmp_path / "good.csv")).out
    said = ecm_command("check", str(tmp_path / "bad.csv")).err
    assert "found '\\x1b]0;evil\\x07', expected a number" in said
    assert "found 'a\\nb\\rc', expected a number" in said
    assert "yyy... (50000 letters)', expected a number" in said
    assert "(50000 letters)', expected at most 255 letters" in done.err


def test_a_log_of_which_nobody_said_that_it_is_continuous_is_asked_about_in_a_refit(
    tmp_path: Path, ecm_command: Command
) -> None:
    t = 0.01 * np.arange(400.0)
    x = 1e-3 * np.sin(t)
    columns = np.column_stack([t, x, 2e3 * x + 0.1 * np.sin(99.0 * t)])
    data, model = str(tmp_path / "log.csv"), str(tmp_path / "m.json")
    np.savetxt(data, columns, delimiter=",", header="time_s,x_m,fx_N", comments="")
    question = 'Then say kind = "continuous" in [file]'
    assert question in ecm_command("fit", data, "--model", "linear", "--out", model).err
    arguments = ["refit", model, data, "--add", "viscous_damping", "--out", model, "--force"]
    assert question in ecm_command(*arguments).err
