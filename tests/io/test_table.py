"""The measurement table: what is read, kept, refused, and written back."""

from __future__ import annotations

import os
import time
import tracemalloc
from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ecm.errors import InputError, MissingExtra
from ecm.io import csv as csv_files
from ecm.io.columns import POSE, STANDARD, WRENCH, likely_name
from ecm.io.description import Meta, Scene
from ecm.io.table import Table, as_table, read_table
from ecm.logs import import_log
from support.neck import csv_text, neck_columns, saved

Edit = Callable[[list[list[str]]], None]


def written(tmp_path: Path, edit: Edit | None = None, **more: Any) -> Path:
    """A table of twenty rows after an edit of its cells (header included)."""
    columns = neck_columns(20) | {name: np.asarray(v, dtype=float) for name, v in more.items()}
    cells = [line.split(",") for line in csv_text(columns).splitlines()]
    if edit is not None:
        edit(cells)
    path = saved(tmp_path / "data.csv", "\n".join(",".join(row) for row in cells) + "\n")
    return path


def put(line: int, column: int, text: str) -> Edit:
    """Replace the cell of a line of the file (counted from 1) and column (from 0)."""

    def edit(cells: list[list[str]]) -> None:
        cells[line - 1][column] = text

    return edit


def refusal(path: Path | list[Path], **options: Any) -> str:
    with pytest.raises(InputError) as caught:
        read_table(path, **options)
    return str(caught.value)


def test_columns_arrive_in_file_order_as_float64(tmp_path: Path) -> None:
    table = read_table(written(tmp_path))
    expected = neck_columns(20)
    assert list(table.columns) == list(expected)
    assert table.poses.dtype == np.float64
    np.testing.assert_array_equal(table.poses, np.column_stack([expected[n] for n in POSE]))
    np.testing.assert_array_equal(table.wrenches, np.column_stack([expected[n] for n in WRENCH]))
    assert table.warnings == ()


def test_a_table_may_hold_one_displacement_and_one_force() -> None:
    table = as_table({"y_m": [0.0, 0.01], "fy_N": [0.0, 30.0]}, need="fit")
    assert table.pose_columns == ("y_m",)
    assert table.wrench_columns == ("fy_N",)
    with pytest.raises(InputError, match="'x_m' is missing"):
        _ = table.poses


@pytest.mark.parametrize(
    ("line", "column", "text", "found"),
    [
        (7, 6, "abc", "'abc'"),
        (7, 6, "nan", "'nan'"),
        (7, 6, "inf", "'inf'"),
        (7, 6, "", "an empty cell"),
        (7, 6, "1_000", "'1_000'"),
        (2, 0, "--", "'--'"),
    ],
)
def test_a_bad_cell_is_named_by_line_and_column(
    tmp_path: Path, line: int, column: int, text: str, found: str
) -> None:
    message = refusal(written(tmp_path, put(line, column, text)))
    name = (*POSE, *WRENCH)[column]
    assert f"line {line}, column '{name}': found {found}, expected a" in message
    assert "1 bad place" in message
    assert "skip_bad_rows=True" in message


def test_the_first_ten_places_and_the_count(tmp_path: Path) -> None:
    def edit(cells: list[list[str]]) -> None:
        for line in range(3, 16):
            cells[line - 1][4] = "x"

    message = refusal(written(tmp_path, edit))
    assert "13 bad places, the first 10" in message
    assert "line 12," in message
    assert "line 13," not in message


def test_lines_are_those_of_the_file_after_blank_and_quoted_lines(tmp_path: Path) -> None:
    path = saved(tmp_path / "data.csv", 'x_m,fx_N,approach\n\n0.1,1.0,"a\nb"\n0.1,oops,c\n')
    assert "line 5, column 'fx_N': found 'oops'" in refusal(path)


def test_skipping_bad_rows_keeps_the_rest_and_records_them(tmp_path: Path) -> None:
    def edit(cells: list[list[str]]) -> None:
        cells[4][3] = "?"
        cells[8] = cells[8][:5]

    path = written(tmp_path, edit)
    table = read_table(path, skip_bad_rows=True)
    assert len(table) == 18
    kept = [row for row in range(20) if row not in (3, 7)]
    np.testing.assert_array_equal(table.column("x_m"), neck_columns(20)["x_m"][kept])
    assert "left out 2 row(s)" in table.warnings[0]
    assert "line 5, column 'theta_x_rad'" in table.warnings[0]
    assert "line 9: found 5 cells, expected 12" in table.warnings[0]


def test_ragged_rows_are_refused(tmp_path: Path) -> None:
    message = refusal(written(tmp_path, lambda cells: cells[5].append("1.0")))
    assert "line 6: found 13 cells, expected 12 as in the header" in message


def test_repeated_names_are_refused(tmp_path: Path) -> None:
    message = refusal(written(tmp_path, put(1, 3, "fx_N")))
    assert "the column name 'fx_N' is repeated (columns 4, 7)" in message


@pytest.mark.parametrize(
    ("own", "likely"),
    [
        ("tau_z", "tau_z_Nm"),
        ("fx_kN", "fx_N"),
        ("Fx [N]", "fx_N"),
        ("x", "x_m"),
        ("x_mm", "x_m"),
        ("theta_y_deg", "theta_y_rad"),
        ("tau_x_Nmm", "tau_x_Nm"),
        ("tau_x_N_m", "tau_x_Nm"),
        ("time", "time_s"),
        ("time_ms", "time_s"),
        ("temperature", "temperature_degC"),
        ("q3_deg", "q3_rad"),
        ("v_x_m_s", "v_x_m"),
        ("sd_fx", "sd_fx_N"),
        ("tendon2", "tendon2_N"),
        ("FX_N", "fx_N"),
    ],
)
def test_a_standard_name_with_another_unit_is_refused_with_the_likely_one(
    tmp_path: Path, own: str, likely: str
) -> None:
    assert likely_name(own) == likely
    path = saved(tmp_path / "data.csv", f"{own},covariate\n1.0,2.0\n")
    assert f"column '{own}' looks like '{likely}'" in refusal(path)
    assert "table = ecm.import_log(log).table" in refusal(path)


def test_a_column_of_whole_numbers_in_capitals_is_not_asked_for_a_unit(tmp_path: Path) -> None:
    said = refusal(saved(tmp_path / "data.csv", "Run,covariate\n1.0,2.0\n"))
    assert (
        "column 'Run' looks like 'run', which is written so, without a unit: call it that" in said
    )


@pytest.mark.parametrize("own", ["load_x", "humidity", "force_plate", "x0", "batch", *STANDARD])
def test_other_names_are_left_alone(own: str) -> None:
    assert likely_name(own) is None


def test_own_columns_are_kept_with_a_warning() -> None:
    table = as_table({"y_m": [0.0, 0.1], "fy_N": [0.0, 1.0], "humidity": [40.0, 41.0],
                      "temperatur_degC": [20.0, 21.0]})  # fmt: skip
    assert table.covariates == ("humidity", "temperatur_degC")
    assert "humidity" in table.warnings[0]
    assert "did you mean temperature_degC?" in table.warnings[0]


def test_one_channel_that_is_read_twice_is_told() -> None:
    random = np.random.default_rng(1)
    names = ("x_m", "y_m", "fx_N", "fy_N")
    columns = dict(zip(names, random.normal(0.0, 1e-3, (4, 12)), strict=True))
    assert not as_table(columns).warnings
    (told,) = as_table(columns | {"fy_N": columns["fx_N"]}).warnings
    assert "fx_N and fy_N are the same number in every row" in told
    # What is off, or jumps between a few places, may well be alike.
    assert not as_table(columns | {"x_m": np.zeros(12), "y_m": np.zeros(12)}).warnings


def test_readings_at_the_end_of_a_range_are_told() -> None:
    x = np.random.default_rng(1).uniform(-1e-3, 1e-3, 40)
    force = 1e4 * x
    assert not as_table({"x_m": x, "fx_N": force}).warnings
    (told,) = as_table({"x_m": x, "fx_N": np.maximum(force, -7.0)}).warnings
    rows = ", ".join(str(row + 1) for row in np.flatnonzero(force < -7.0))
    assert "fx_N is exactly -7 in" in told
    assert f"leave these rows out, by ecm check --leave-out ({rows})" in told
    # Coarse steps come again anywhere; a load may well be off.
    for other in (np.round(force / 2.0) * 2.0, np.maximum(force, 0.0)):
        assert not as_table({"x_m": x, "fx_N": other}).warnings


def test_millimetres_are_guessed(tmp_path: Path) -> None:
    def edit(cells: list[list[str]]) -> None:
        for row in cells[1:]:
            row[0] = repr(float(row[0]) * 1e3)

    message = refusal(written(tmp_path, edit))
    assert "column 'x_m', line 2" in message
    assert "millimetres" in message


def test_small_millimetres_are_guessed_where_the_length_is_known() -> None:
    columns = {"y_m": np.linspace(-1.5, 1.5, 9), "fy_N": np.linspace(-5.0, 5.0, 9)}
    assert len(as_table(columns)) == 9
    with pytest.raises(InputError, match="millimetres"):
        as_table(columns, meta=Meta(mechanism={"length_m": 0.1}))


def test_degrees_are_guessed() -> None:
    columns = {"theta_z_rad": np.linspace(-40.0, 40.0, 9), "tau_z_Nm": np.linspace(-1, 1, 9)}
    with pytest.raises(InputError, match="look like degrees"):
        as_table(columns)


def test_a_pose_beyond_any_range_is_a_bad_row_and_not_a_unit(tmp_path: Path) -> None:
    path = written(tmp_path, put(11, 1, "250.0"))
    assert "line 11, column 'y_m': found 250, expected at most 2 m" in refusal(path)
    assert len(read_table(path, skip_bad_rows=True)) == 19


def test_a_rotation_vector_of_more_than_half_a_turn_is_refused() -> None:
    columns = {name: np.full(20, 0.1) for name in POSE[3:]} | {"fx_N": np.arange(20.0)}
    columns["theta_x_rad"][4] = columns["theta_y_rad"][4] = 2.9
    with pytest.raises(InputError, match=r"row 4: found a rotation vector of 4\.1.* less than pi"):
        as_table(columns)


def test_identical_rows_with_time_are_refused_and_without_are_counted(tmp_path: Path) -> None:
    def edit(cells: list[list[str]]) -> None:
        cells[9] = list(cells[8])

    message = refusal(written(tmp_path, edit, time_s=np.arange(20)))
    assert "line 10: found a row identical in every column" in message
    assert "the same as line 9" in message
    table = read_table(written(tmp_path, edit))
    assert len(table) == 20
    assert "1 row(s) are identical" in table.warnings[0]


def test_time_must_grow(tmp_path: Path) -> None:
    time_s = np.arange(20.0)
    time_s[12] = 3.5
    message = refusal(written(tmp_path, time_s=time_s))
    assert "line 14, column 'time_s': found 3.5 after 11" in message
    assert "1 bad place:" in message
    message = refusal(written(tmp_path, time_s=np.random.default_rng(0).permutation(20)))
    assert "of 20 rows, and no time is there twice: put the rows in the order of time_s" in message


def test_whole_numbers_and_kinds_are_checked() -> None:
    rows = {"y_m": [0.0, 0.1], "fy_N": [0.0, 1.0]}
    with pytest.raises(InputError, match=r"column 'pose_id': found 1\.5, expected a whole number"):
        as_table(rows | {"pose_id": [0.0, 1.5]})
    with pytest.raises(InputError, match="found 'homing', expected pose, home or unloaded"):
        as_table(rows | {"kind": ["pose", "homing"]})
    with pytest.raises(
        InputError, match="row 1, column 'dwell_s': found -1, expected at least 0 s"
    ):
        as_table(rows | {"dwell_s": [np.nan, -1.0]})
    with pytest.raises(InputError, match="found 2, expected -1, 0 or 1"):
        as_table(rows | {"q1_dir": [1.0, 2.0]})


def test_unknown_dwell_and_approach_are_empty(tmp_path: Path) -> None:
    path = saved(
        tmp_path / "data.csv", "y_m,fy_N,dwell_s,approach,kind\n0.1,1.0,,,\n0.2,2.0,8.0,3,home\n"
    )
    table = read_table(path)
    np.testing.assert_array_equal(table.column("dwell_s"), [np.nan, 8.0])
    assert table.text("approach").tolist() == ["", "3"]
    assert table.text("kind").tolist() == ["pose", "home"]
    assert len(table.measured()) == 1


def test_the_header_may_be_absent_or_have_two_rows(tmp_path: Path) -> None:
    (tmp_path / "none.csv").write_text("9,10,100\n9,20,200\n", encoding="utf-8")
    (tmp_path / "none.toml").write_text(
        "[file]\nheader_rows = 0\n[columns]\ny_m = { column = 2, scale = 1e-3, offset = 0.1 }\n"
        "fy_N = 3\n",
        encoding="utf-8",
    )
    table = read_table(tmp_path / "none.csv")
    assert list(table.columns) == ["column_1", "y_m", "fy_N"]
    np.testing.assert_allclose(table.column("y_m"), [0.11, 0.12], rtol=1e-15)
    (tmp_path / "two.csv").write_text(
        "Pose,,Force\nX [mm],Y [mm],X [N], \n1,2,3\n4,5,6\n", encoding="utf-8"
    )
    (tmp_path / "two.toml").write_text(
        '[file]\nheader_rows = 2\n[columns]\nx_m = { column = "Pose X [mm]", scale = 1e-3 }\n'
        'fx_N = "Force X [N]"\n',
        encoding="utf-8",
    )
    table = read_table(tmp_path / "two.csv")
    np.testing.assert_allclose(table.column("x_m"), [1e-3, 4e-3], rtol=1e-15)
    np.testing.assert_array_equal(table.column("fx_N"), [3.0, 6.0])


def test_a_header_of_numbers_asks_for_header_rows(tmp_path: Path) -> None:
    path = saved(tmp_path / "data.csv", "0.1,2.0\n0.2,3.0\n")
    assert "header_rows = 0" in refusal(path)


def test_mapping_errors_name_the_description(tmp_path: Path) -> None:
    path = written(tmp_path)
    meta = saved(tmp_path / "own.toml", '[columns]\ndwell_s = "dwel"\n')
    message = refusal(path, meta=meta)
    assert "own.toml [columns]: dwell_s is column 'dwel', which" in message
    meta.write_text("[columns]\ndwell_s = 40\n", encoding="utf-8")
    assert "dwell_s is column 40, but" in refusal(path, meta=meta)
    meta.write_text('[columns]\ngroup = ["loadx"]\n', encoding="utf-8")
    assert "group names the column 'loadx', which is not in" in refusal(path, meta=meta)


def test_groups_number_equal_values() -> None:
    meta = Meta(group=("a", "b"))
    rows = {"y_m": np.zeros(4), "fy_N": np.arange(4.0), "a": [1, 1, 2, 1], "b": [5, 6, 5, 5]}
    groups = as_table(rows, meta=meta).groups()
    assert groups is not None
    assert groups.tolist() == [0, 1, 2, 0]
    assert as_table(rows).groups() is None


@given(
    st.lists(
        st.tuples(
            st.floats(-1.9, 1.9, allow_nan=False),
            st.floats(-1e100, 1e100),
            st.integers(0, 10**6),
            st.one_of(st.just(float("nan")), st.floats(0.0, 1e5)),
            st.text(st.characters(codec="utf-8", exclude_categories=("Cs", "Cc")), max_size=8),
        ),
        min_size=1,
        max_size=8,
    )
)
@settings(max_examples=60, deadline=None)
def test_what_is_written_is_read_back_bit_for_bit(
    tmp_path_factory: pytest.TempPathFactory, rows: list[tuple[float, float, int, float, str]]
) -> None:
    names = ("y_m", "fy_N", "pose_id", "dwell_s", "action")
    columns: dict[str, Any] = dict(zip(names, zip(*rows, strict=True), strict=True))
    table = as_table(columns)
    path = tmp_path_factory.mktemp("round") / "t.csv"
    table.write(path)
    back = read_table(path)
    assert list(back.columns) == list(names)
    for name in names[:-1]:
        left, right = table.column(name), back.column(name)
        np.testing.assert_array_equal(left.view(np.int64)[~np.isnan(left)],
                                      right.view(np.int64)[~np.isnan(right)])  # fmt: skip
        np.testing.assert_array_equal(np.isnan(left), np.isnan(right))
    assert back.text("action").tolist() == table.text("action").tolist()


def test_the_description_travels_with_the_table(tmp_path: Path) -> None:
    meta = Meta(
        mechanism={"length_m": 0.1}, scene=Scene(payload_mass_kg=0.2), group=("pose_id",),
        runs={1: {"mount_angle_rad": 1.5, "cable_attached": False}},
    )  # fmt: skip
    rows = {"y_m": [0.0, 0.1], "fy_N": [0.0, 1.0], "pose_id": [4, 5]}
    as_table(rows, meta=meta).write(tmp_path / "t.csv")
    back = read_table(tmp_path / "t.csv").meta
    assert back.mechanism == meta.mechanism
    assert back.scene == meta.scene
    assert back.runs == meta.runs
    assert back.group == meta.group


def test_a_foreign_description_is_not_adopted_in_silence(tmp_path: Path) -> None:
    (tmp_path / "t.toml").write_text("[scene]\npayload_mass_kg = 3.0\n", encoding="utf-8")
    with pytest.raises(InputError, match="would be taken as its description"):
        as_table({"y_m": [0.0], "fy_N": [1.0]}).write(tmp_path / "t.csv")


def test_several_tables_become_runs_of_one(tmp_path: Path) -> None:
    for name, shift in (("a", 0.0), ("b", 0.5)):
        table = as_table(
            {"pose_id": [0, 1, 0], "time_s": [0.0, 10.0, 20.0], "repeat": [0, 0, 1],
             "y_m": [0.1 + shift, 0.2 + shift, 0.1 + shift], "fy_N": [1.0, 2.0, 1.1],
             "approach": ["initial", "0", "1"]},
            meta=Meta(scene=Scene(payload_mass_kg=shift or None)),
        )  # fmt: skip
        table.write(tmp_path / f"{name}.csv")
    both = read_table([tmp_path / "a.csv", tmp_path / "b.csv"])
    assert both.column("run").tolist() == [0, 0, 0, 1, 1, 1]
    assert np.all(np.diff(both.column("time_s")) > 0.0)
    # Id 0 of the second table is another pose: it gets a number of its own, approaches as well.
    assert both.column("pose_id").tolist() == [0, 1, 0, 2, 3, 2]
    assert both.text("approach").tolist() == ["initial", "0", "1", "initial", "2", "3"]
    assert both.column("repeat").tolist() == [0, 0, 1, 0, 0, 1]
    assert both.meta.runs == {1: {"payload_mass_kg": 0.5}}
    assert any("pose_id" in warning for warning in both.warnings)


def test_tables_of_different_things_do_not_join(tmp_path: Path) -> None:
    as_table({"y_m": [0.0], "fy_N": [1.0]}).write(tmp_path / "a.csv")
    as_table({"z_m": [0.0], "fy_N": [1.0]}).write(tmp_path / "b.csv")
    message = refusal([tmp_path / "a.csv", tmp_path / "b.csv"])
    assert "pose and wrench columns differ" in message
    assert "y_m, z_m" in message


def test_the_kind_that_differs_is_told_with_the_line_that_mends_it(tmp_path: Path) -> None:
    """Of two logs of one test the faster one alone counts as continuous."""
    for name, kind in (("a", "static"), ("b", "continuous")):
        table = as_table({"y_m": [0.0], "fy_N": [1.0]}, meta={"file": {"kind": kind}})
        table.write(tmp_path / f"{name}.csv")
    message = refusal([tmp_path / "a.csv", tmp_path / "b.csv"])
    assert message.endswith('say the same in the TOML beside each, for example kind = "continuous" '
                            "below [file].")  # fmt: skip


def test_a_mesh_is_the_same_whatever_folder_names_it(tmp_path: Path) -> None:
    """Catches a second campaign, written to a folder of its own, that is refused for its path."""
    rows = {"y_m": [0.0, 0.1], "fy_N": [0.0, 1.0]}
    (tmp_path / "later").mkdir()
    for name, mesh in (("a", "body.msh"), ("later/b", "../body.msh"), ("later/c", "body.msh")):
        text = f'[mechanism]\nmesh = "{mesh}"\nlength_m = 0.1\nyoung_modulus_Pa = 1e6\n'
        (tmp_path / f"{name}.toml").write_text(text, encoding="utf-8")
        (tmp_path / f"{name}.csv").write_text("y_m,fy_N\n0.0,0.0\n0.1,1.0\n", encoding="utf-8")
    both = read_table([tmp_path / "a.csv", tmp_path / "later" / "b.csv"])
    assert both.column("run").tolist() == [0, 0, 1, 1]
    assert "[mechanism] is mesh" in refusal([tmp_path / "a.csv", tmp_path / "later" / "c.csv"])
    # As written by a campaign whose plan came from the first folder.
    as_table(rows, meta=read_table(tmp_path / "a.csv").meta).write(tmp_path / "later" / "d.csv")
    assert len(read_table([tmp_path / "a.csv", tmp_path / "later" / "d.csv"])) == 4


def test_frames_are_accepted() -> None:
    pandas = pytest.importorskip("pandas", reason="pandas frames: pandas is not installed")
    frame = pandas.DataFrame({"y_m": [0.0, 0.1], "fy_N": [0.0, 30.0], "approach": ["initial", ""]})
    table = as_table(frame)
    np.testing.assert_array_equal(table.column("fy_N"), [0.0, 30.0])
    assert table.text("approach").tolist() == ["initial", ""]
    record = np.array([(0.0, 1.0)], dtype=[("y_m", float), ("fy_N", float)])
    assert as_table(record).column("fy_N").tolist() == [1.0]
    with pytest.raises(InputError, match="found a int, expected a dict"):
        as_table(3)
    with pytest.raises(InputError, match="different lengths"):
        as_table({"y_m": [0.0], "fy_N": [1.0, 2.0]})


def test_a_table_is_read_by_name_and_by_row() -> None:
    table = as_table({"y_m": [0.0, 0.1], "fy_N": [0.0, 30.0], "approach": ["initial", ""]})
    assert table["fy_N"].tolist() == [0.0, 30.0]
    assert table["approach"].tolist() == ["initial", ""]
    assert list(dict(table)) == ["y_m", "fy_N", "approach"]
    assert list(table)[1] == {"y_m": 0.1, "fy_N": 30.0, "approach": ""}
    assert "fy_N" in table
    assert "fx_N" not in table
    with pytest.raises(InputError, match="the column 'fyN' is missing, did you mean 'fy_N'"):
        table["fyN"]
    with pytest.raises(InputError, match="the column 'kind' is missing"):
        table["kind"]


def test_a_table_becomes_a_data_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    pandas = pytest.importorskip("pandas", reason="pandas frames: pandas is not installed")
    columns = {**neck_columns(6), "approach": np.array(["initial"] * 6, dtype=object)}
    table = as_table(columns)
    frame = pandas.DataFrame(columns)
    pandas.testing.assert_frame_equal(table.to_pandas(), frame)
    pandas.testing.assert_frame_equal(pandas.DataFrame(table), frame, check_dtype=False)
    again = as_table(table.to_pandas())
    assert all((again[name] == table[name]).all() for name in columns)

    def absent(module: str) -> Any:
        raise ImportError(module)

    monkeypatch.setattr("ecm.io.extras.import_module", absent)
    with pytest.raises(MissingExtra, match=r"pandas.*\(extra data\)"):
        table.to_pandas()


def test_a_table_shows_itself_in_a_few_lines() -> None:
    columns = neck_columns(4) | {"run": [0, 0, 1, 1], "humidity": [40.0, 41.0, 42.0, 43.0]}
    table = as_table(columns | {"approach": ["initial"] * 4}, source="a<b.csv")
    assert str(table).splitlines() == [
        "a<b.csv: 4 rows, 2 runs",
        f"  pose    {', '.join(POSE)}",
        f"  wrench  {', '.join(WRENCH)}",
        "  other   run, approach",
        "  own     humidity",
    ]
    page = table._repr_html_()
    assert "<caption>a&lt;b.csv: 4 rows, 2 runs</caption>" in page
    assert "<tr><td>humidity</td><td>40</td><td>43</td></tr>" in page
    assert "<td>approach</td><td>initial</td><td>initial</td>" in page
    assert repr(Table({}, Meta(), "nothing")) == "<Table: nothing: 0 rows, 1 run>"


def test_parquet_needs_the_extra_or_reads(tmp_path: Path) -> None:
    path = tmp_path / "t.parquet"
    rows = {"y_m": [0.0, 0.1], "fy_N": [0.0, 30.0], "dwell_s": [None, 2.0]}
    if find_spec("pyarrow") is None:
        with pytest.raises(MissingExtra, match=r"pip install .*pandas"):
            read_table(path)
        return
    arrow, parquet = import_module("pyarrow"), import_module("pyarrow.parquet")
    with pytest.raises(InputError, match="does not exist"):
        read_table(path)
    parquet.write_table(arrow.table(rows), path)
    table = read_table(path)
    np.testing.assert_array_equal(table.column("fy_N"), [0.0, 30.0])
    np.testing.assert_array_equal(table.column("dwell_s"), [np.nan, 2.0])
    parquet.write_table(arrow.table(rows | {"fy_N": [0.0, None]}), path)
    assert "row 2, column 'fy_N': found an empty cell" in refusal(path)


def test_what_is_needed_is_named_with_a_likely_column() -> None:
    with pytest.raises(InputError, match="no wrench column") as caught:
        as_table({"y_m": [0.0, 0.1], "forc_x_N": [1.0, 2.0]}, need="fit")
    assert "Did you mean" not in str(caught.value)
    with pytest.raises(InputError, match="Did you mean tau_x_Nm"):
        as_table({"y_m": [0.0, 0.1], "tau_xx_Nm": [1.0, 2.0]}, need="fit")
    with pytest.raises(InputError, match="no row of kind 'pose'"):
        as_table({"y_m": [0.0], "fy_N": [0.0], "kind": ["home"]}, need="fit")


def test_selecting_and_replacing(tmp_path: Path) -> None:
    table = as_table(neck_columns(10))
    few = table.select(table.column("y_m") > 0.0)
    assert 0 < len(few) < 10
    assert few.replace(fy_N=np.zeros(len(few))).column("fy_N").tolist() == [0.0] * len(few)
    assert table.drop("fy_N").wrench_columns == tuple(n for n in WRENCH if n != "fy_N")
    with pytest.raises(InputError, match="expected \\(10,\\)"):
        table.with_columns({"fy_N": np.zeros(3)})
    lost = np.where(np.arange(10) == 4, np.nan, 0.0)
    with pytest.raises(InputError, match=r"row 4, column 'fy_N': found nan, expected a finite"):
        table.with_columns({"fy_N": lost})
    assert np.isnan(table.with_columns({"sd_fy_N": lost})["sd_fy_N"]).any()
    own = np.zeros(10)
    changed = table.with_columns({"fy_N": own})
    own += 1.0
    assert not changed["fy_N"].any()
    assert len(table.select([])) == 0
    with pytest.raises(IndexError):
        table.select([10])


def test_a_large_table_is_read_quickly_and_a_late_cell_still_named(tmp_path: Path) -> None:
    n = 40_000
    random = np.random.default_rng(0)
    table = as_table(
        {name: random.uniform(-0.1, 0.1, n) for name in (*POSE, *WRENCH)}
        | {"time_s": np.arange(float(n))}
    )
    path = tmp_path / "large.csv"
    table.write(path)
    start = time.perf_counter()
    back = read_table(path)
    assert time.perf_counter() - start < 5.0  # 0.5 s on an idle core
    np.testing.assert_array_equal(back.wrenches, table.wrenches)
    with path.open("a", encoding="utf-8") as file:
        file.write(",".join(["0.0"] * 11 + ["zero", "1e6"]) + "\n")
    assert f"line {n + 2}, column 'tau_z_Nm': found 'zero'" in refusal(path)


def test_an_empty_table_keeps_its_columns() -> None:
    table = Table({name: np.empty(0) for name in POSE}, Meta(), "empty")
    assert table.poses.shape == (0, 6)
    assert len(table) == 0


def test_memory_of_reading_follows_the_numbers(tmp_path: Path) -> None:
    """240 000 cells are 2 MB; held as text with their line they were 40 MB."""
    path = tmp_path / "many.csv"
    numbers = np.random.default_rng(0).uniform(size=(20_000, 12))
    names = ",".join(f"own_{i}" for i in range(11))
    lines = [",".join(map(repr, row)) for row in numbers.tolist()]
    path.write_text("\n".join([f"x_m,{names}", *lines]))
    del lines
    tracemalloc.start()
    table = read_table(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 15e6
    assert np.array_equal(table.column("own_3"), numbers[:, 4])


def test_cells_are_quoted_as_written_in_every_block(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(csv_files, "_BLOCK", 2)
    path = saved(
        tmp_path / "blocks.csv",
        "x_m,fx_N,approach\n0.1,1,03\n0.2,2,4\n0.3,1_0,5\n0.4, NaN,6\n0.5,5,07\n",
    )
    with pytest.raises(InputError) as caught:
        read_table(path)
    assert "line 4, column 'fx_N': found '1_0'" in str(caught.value)
    assert "line 5, column 'fx_N': found 'NaN'" in str(caught.value)
    table = read_table(path, skip_bad_rows=True)
    assert table.column("fx_N").tolist() == [1.0, 2.0, 5.0]
    assert table.text("approach").tolist() == ["03", "4", "07"]


def test_copies_are_found_among_rows_of_equal_numbers() -> None:
    columns = {
        "x_m": [0.0, -0.0, 0.1, 0.1],
        "fx_N": [1.0, 1.0, 2.0, 3.0],
        "dwell_s": [np.nan, np.nan, 1.0, 1.0],
        "approach": ["initial", "initial", "1", "1"],
    }
    warnings = as_table(columns).warnings
    assert len(warnings) == 1
    assert "1 row(s) are identical" in warnings[0]


@pytest.mark.parametrize("runs", [[0, 0, 0, 0], [0, 0, 1, 1]])
def test_runs_may_each_begin_at_time_zero(runs: list[int]) -> None:
    columns = {"x_m": [0.0, 1e-3, 2e-3, 3e-3], "fx_N": [0.0, 1.0, 2.0, 3.0], "run": runs}
    times = [0.0, 1.0, 0.0, 1.0] if runs[-1] else [0.0, 1.0, 2.0, 3.0]
    own = np.array(times)
    table = as_table(columns | {"time_s": own})
    assert own.tolist() == times  # what was given stays as it is
    assert table.column("time_s").tolist() == [0.0, 1.0, 2.0, 3.0]
    assert ("begins again in 1 run" in "".join(table.warnings)) == bool(runs[-1])


def test_rows_of_leave_out_are_left_out_before_anything_is_checked(tmp_path: Path) -> None:
    path = saved(tmp_path / "t.csv", "x_m,fx_N\n0,1\n0.1,2\n0.2,?\n0.3,4\n0.4,5\n")
    meta = saved(tmp_path / "t.toml", '[leave_out]\nstart_up = "1"\nunreadable = "3"\n')
    table = read_table(path)
    assert table.column("fx_N").tolist() == [2.0, 4.0, 5.0]
    assert "2 of 5 rows are left out by [leave_out]: start_up 1, unreadable 3" in table.warnings[0]
    assert table.file_rows is not None
    assert table.file_rows.tolist() == [2, 4, 5]
    table.write(tmp_path / "again.csv")
    assert len(read_table(tmp_path / "again.csv")) == 3
    for text, message in (('"1-9"', "names row 9, but the table has 5"), ('"x"', "row numbers")):
        meta.write_text(f"[leave_out]\nclipped = {text}\n")
        with pytest.raises(InputError, match=message):
            read_table(path)


def test_tables_of_two_experiments_say_what_differs(tmp_path: Path) -> None:
    rows = "x_m,fx_N\n0,1\n0.1,2\n"
    words = {
        "one": '[file]\nkind = "static"\n[mechanism]\nlength_m = 0.1\nradius_m = 0.02\n',
        "two": '[file]\nkind = "continuous"\n[mechanism]\nlength_m = 0.1\nradius_m = 0.02\n',
        "long": '[file]\nkind = "static"\n[mechanism]\nlength_m = 0.2\nradius_m = 0.02\n',
    }
    for name, text in words.items():
        (tmp_path / f"{name}.csv").write_text(rows, encoding="utf-8")
        (tmp_path / f"{name}.toml").write_text(text, encoding="utf-8")
    one, two, long = (tmp_path / f"{name}.csv" for name in words)
    with pytest.raises(InputError, match=r'two.csv: \[file\] kind is "continuous", in .*"static"'):
        read_table([one, two])
    with pytest.raises(
        InputError, match=r"\[mechanism\] is length_m = 0.2, in .* length_m = 0.1. "
    ):
        read_table([one, long])


def test_a_pipe_is_refused_at_once(tmp_path: Path) -> None:
    """Nobody writes into it: to open it would wait for ever."""
    os.mkfifo(tmp_path / "pipe.csv")
    with pytest.raises(InputError, match="a pipe or a device; a table is read more than once"):
        read_table(tmp_path / "pipe.csv")
    with pytest.raises(InputError, match="a pipe or a device; a log is read more than once"):
        import_log(tmp_path / "pipe.csv")


def test_angles_with_names_of_another_program_are_told() -> None:
    columns = neck_columns()
    renamed = {name.replace("theta_", "r"): values for name, values in columns.items()}
    (said,) = as_table(renamed).warnings
    assert "rx_rad, ry_rad, rz_rad; where one is a pose or a wrench, ecm import" in said
    (said,) = as_table(columns | {"dial_rad": columns["fx_N"]}).warnings
    assert said.endswith("dial_rad")
