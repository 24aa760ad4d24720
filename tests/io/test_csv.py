"""CSV files: numpy's reader gives what the careful one gives, and is used where it can be."""

from __future__ import annotations

import csv
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

import ecm
import ecm.io.csv as reader
from ecm.errors import InputError
from support.neck import saved

ROWS = "".join(f"{0.1 * i!r}, at {i} ,{-(3.0**i)!r}\n" for i in range(-3, 4))
LONG = "".join(f"{i / 7.0!r},a,{i}\n" for i in range(9000))
TEXTS = {
    "plain": ROWS,
    "no newline at the end": ROWS.rstrip(),
    "line ends of Windows": ROWS.replace("\n", "\r\n"),
    "old line ends": ROWS.replace("\n", "\r"),
    "spaces around numbers": " 1\t,a,\x0c2\n",
    "empty text": "1,,2\n",
    "signs and powers": "+1,a,.5\n5.,b,-1e-300\n",
    "quotes": ROWS + '1,"a, b",2\n',
    "a quoted line break": '1,"a\nb",2\n3,c,4\n',
    "a stray quote": ROWS + '1,"a"b,2\n',
    "empty lines": ROWS + "\n" + ROWS + "\n\n",
    "only empty lines": "\n\n",
    "lines of spaces": ROWS + "  \n" + ROWS,
    "too many cells": ROWS + "1,a,2,3\n" + ROWS,
    "too few cells": ROWS + "1,a\n",
    "a comma at the end": "1,a,2,\n",
    "an empty number": ROWS + "1,a,\n",
    "a word": ROWS + "1,a,b\n",
    "not a number": ROWS + "nan,a,2\n",
    "infinite": "1,a,1e400\n",
    "grouped digits": "1_0,a,1\n",
    "digits of another script": "\uff11,a,1\n",
    "hexadecimal": "1,a,0x10\n",
    "a comment": "#1,a,2\n1,#a,2\n",
    "a byte order mark inside": "\ufeff1,a,2\n",
    "a lone line end": "1\r2,a,3\n",
    "a cell beyond the limit": "1," + "a" * (csv.field_size_limit() + 1) + ",2\n",
    "a bad number after many lines": LONG + "1,a,b\n" + LONG,
    "an empty line after many": LONG + "\n" + LONG,
    "a wide row after many": LONG + "1,a,2,3\n" + LONG,
}


def outcome(path: Path, header_rows: int) -> Any:
    """All that a file gives: names, types and bits of the cells, lines; or the error."""
    try:
        raw = reader.read_csv(path, header_rows, {"kind", 2})
    except InputError as error:
        return str(error)
    cells = [
        (c.dtype.str, c.tobytes()) if isinstance(c, np.ndarray) else list(c) for c in raw.columns
    ]
    return raw.names, cells, np.asarray(raw.numbers).tolist(), raw.ragged


@pytest.mark.parametrize("name", TEXTS)
def test_both_readers_give_the_same(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "table.csv"
    for header_rows, header in enumerate(("", "x_m,kind,fx_N\n", "\nat,,of\n\nx,kind,fx\n")):
        path.write_bytes((header + TEXTS[name]).encode())
        found = outcome(path, header_rows)
        with monkeypatch.context() as careful:
            careful.setattr(reader, "_plain_columns", lambda *_: None)
            assert found == outcome(path, header_rows)


def test_plain_numbers_and_words_are_left_to_numpy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = saved(tmp_path / "table.csv", "x_m,kind,fx_N\n" + LONG)
    monkeypatch.setattr(reader, "_finite_numbers", lambda _: pytest.fail("one by one"))
    raw = reader.read_csv(path)
    assert list(raw.columns[2]) == list(range(9000))
    assert raw.columns[1] == ["a"] * 9000
    assert np.asarray(raw.numbers)[[0, -1]].tolist() == [2, 9001]


@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.lists(st.text(max_size=6), min_size=1, max_size=4))
@example(["nan", "inf", "1e5"])
@example([" a ", "-1", "#", '"', "a,b\n"])
@example(["0\r0"])
def test_a_table_that_is_written_is_read_back_whatever_its_columns_are_called(
    names: list[str],
) -> None:
    own = {name: np.arange(3.0) + i for i, name in enumerate(names)}
    try:
        table = ecm.as_table({"x_m": 0.01 * np.arange(3.0), "fx_N": np.arange(3.0), **own})
    except InputError:
        return  # a name that is empty, repeated, or like a standard one
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "table.csv"
        table.write(path)
        again = ecm.read_table(path)
    assert list(again.columns) == list(table.columns)
    np.testing.assert_array_equal(again.matrix(list(own_of(table))), table.matrix(own_of(table)))


def own_of(table: ecm.Table) -> list[str]:
    return ["x_m", "fx_N", *table.covariates]


@pytest.mark.parametrize("header", ["0.0,1.5", "0.0,nan", "1,2,x"])
def test_a_header_of_numbers_is_told_from_names(tmp_path: Path, header: str) -> None:
    path = saved(tmp_path / "bare.csv", f"{header}\n{header}\n")
    with pytest.raises(InputError, match="the header row holds the number"):
        ecm.read_table(path)
