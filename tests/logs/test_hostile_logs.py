"""Logs as strangers have them: nothing is read as what it is not, and nothing is lost unsaid."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

import ecm
from ecm import import_log
from ecm.io.columns import POSE
from support.neck import saved

ANGLE = np.linspace(-1.0, 1.0, 12)
JOINT = {"theta_z_rad": ANGLE, "tau_z_Nm": 2.0 * ANGLE}


def test_labview_with_two_header_blocks_and_a_comment(tmp_path: Path) -> None:
    head = [
        "LabVIEW Measurement\t", "Decimal_Separator\t,", "***End_of_Header***\t", "\t",
        "Channels\t2\t\t", "Samples\t3\t3\t", "Y_Unit_Label\tMillimeters\tNewtons\t",
        "X_Dimension\tTime\tTime\t", "X0\t0,0E+0\t0,0E+0\t", "***End_of_Header***\t\t\t",
        "X_Value\tDisplacement\tForce\tComment",
    ]  # fmt: skip
    rows = [f"0,{i:02d}\t{i},5\t1{i},0" for i in range(30)]
    rows[0] += "\tstart"
    path = tmp_path / "bench.lvm"
    path.write_text("\r\n".join(head + rows), encoding="latin-1")
    imported = import_log(path, units=["mm", "N"], axis="y")
    assert imported.table["time_s"].tolist() == [i / 100 for i in range(30)]
    assert np.allclose(imported.table["y_m"], 1e-3 * (np.arange(30) + 0.5))
    assert imported.table["fy_N"][:3].tolist() == [10.0, 11.0, 12.0]
    with pytest.raises(ecm.InputError, match="'X_Value' may be time_s or x_m"):
        import_log({"X_Value": ANGLE, "Force_X": ANGLE}, units=["SI"])


@pytest.mark.parametrize(
    "name", ["Fx (V)", "Load x [kg]", "Force X limit", "Force X error", "x (mm/s)"]
)
def test_other_units_and_set_points_are_no_reading(name: str) -> None:
    imported = import_log({**JOINT, name: ANGLE}, units=["SI"])
    assert not imported.table.has("fx_N")
    assert not imported.table.has("x_m")
    assert imported.table.covariates


def test_a_row_of_units_with_units_of_other_quantities(tmp_path: Path) -> None:
    path = tmp_path / "log.txt"
    rows = "".join(f"{i}\t{i}\t{i}\t{i}\n" for i in range(9))
    path.write_text("Time\tAngle\tTorque\tLoad x\ns\tdeg\tN mm\tV\n" + rows)
    table = import_log(path, axis="z").table
    assert np.allclose(table["theta_z_rad"], np.radians(np.arange(9.0)))
    assert np.allclose(table["tau_z_Nm"], 1e-3 * np.arange(9.0))
    assert not table.has("fx_N")


def test_decimal_commas_that_begin_late(tmp_path: Path) -> None:
    path = tmp_path / "log.txt"
    rest = "".join(f"{i};0;0\n" for i in range(450))
    path.write_text("time_s;theta_z_rad;tau_z_Nm\n" + rest + "450;0,25;0,5\n")
    assert import_log(path).table["theta_z_rad"][-1] == 0.25


def test_no_column_is_lost_to_another_of_nearly_the_same_name() -> None:
    table = import_log(
        {**JOINT, "A b": ANGLE, "a_b": ANGLE**2, "温度": ANGLE, "压力": -ANGLE}
    ).table
    assert len(table.covariates) == 4


def test_map_decides_between_two_columns() -> None:
    log = {"Fx (N)": [1.0, 2.0], "force x [N]": [3.0, 4.0], "x_m": [0.0, 1e-3]}
    table = import_log(log, columns={"fx_N": "force x [N]"}).table
    assert table["fx_N"].tolist() == [3.0, 4.0]
    assert [table[name].tolist() for name in table.covariates] == [[1.0, 2.0]]


def test_an_own_column_with_gaps_costs_no_rows_and_bad_cells_are_named() -> None:
    gaps = np.where(np.arange(12) % 3 == 0, np.nan, ANGLE)
    imported = import_log({**JOINT, "junk": gaps})
    assert len(imported.table) == 12
    assert "column 'junk' has no number in 4 rows" in str(imported)
    with pytest.raises(ecm.InputError, match="in junk: rows 1, 4, 7, 10"):
        import_log({**JOINT, "junk": gaps}, columns={"junk": "junk"})


def test_a_pressure_without_a_number_is_told_with_the_map_that_keeps_it() -> None:
    log = {**JOINT, "Chamber pressure [bar]": np.where(np.arange(12) == 5, np.nan, ANGLE)}
    said = str(import_log(log))
    assert "--map 'pressure_1_Pa=Chamber pressure [bar]'" in said
    assert "--map 'chamber_pressure__bar=Chamber pressure [bar]' keeps it" in said
    columns = {"pressure_1_Pa": "Chamber pressure [bar]"}
    table = import_log(log, columns=columns, leave_out=True).table
    assert len(table) == 11
    assert table["pressure_1_Pa"][1] == pytest.approx(1e5 * ANGLE[1])
    assert "not said of what" not in str(
        import_log({**JOINT, "P1 [bar]": ANGLE, "Air [mbar]": ANGLE})
    )
    absolute = str(import_log({**JOINT, "P1 abs [kPa]": 101.3 + ANGLE}))
    assert "counted from the air around it, it is --map 'pressure_1_Pa=P1 abs [kPa]'" in absolute


def test_a_header_that_comes_again_is_no_row_and_no_value(tmp_path: Path) -> None:
    head = "Run;Specimen;Time [s];Angle z [deg];Torque z [N mm]"
    rows = [f"{1 + i // 6};{'AB'[i // 6]};{i}.5;{3 * i};{20 * i}" for i in range(12)]
    (tmp_path / "log.csv").write_text("\n".join([head, *rows[:6], head, *rows[6:]]))
    imported = import_log(tmp_path / "log.csv", group="Specimen")
    assert len(imported.table) == 12
    assert imported.table["run"].tolist() == [1.0] * 6 + [2.0] * 6
    assert "1 line(s) are the header again and were left out" in str(imported)
    assert "words of 'Specimen' as numbers: A = 0, B = 1\n" in f"{imported}\n"


def test_a_data_frame_of_a_file_with_two_headers_is_read(tmp_path: Path) -> None:
    """Such a file makes words of all numbers of a data frame."""
    columns = {"Time [s]": np.arange(12.0), "Angle z [deg]": 3.0 * ANGLE, "Torque z [N mm]": ANGLE}
    cells = {name: [*map(str, own)] for name, own in columns.items()}
    twice = {name: [*own[:6], name, *own[6:]] for name, own in cells.items()}
    imported = import_log(twice)
    assert "1 line(s) are the header again and were left out" in str(imported)
    np.testing.assert_array_equal(imported.table["tau_z_Nm"], 1e-3 * ANGLE)
    commas = {name: [cell.replace(".", ",") for cell in own] for name, own in twice.items()}
    with pytest.raises(ecm.InputError, match=r"Torque z \[N mm\]: text, as '"):
        import_log(commas)


def test_rows_left_out_hold_no_zeros_that_somebody_may_take_back(tmp_path: Path) -> None:
    log = {**JOINT, "theta_z_rad": np.r_[np.nan, ANGLE[1:]]}
    import_log(log, leave_out=True).write(tmp_path / "t.csv")
    assert len(ecm.read_table(tmp_path / "t.csv")) == 11
    (tmp_path / "t.toml").unlink()
    with pytest.raises(ecm.InputError, match="theta_z_rad"):
        ecm.read_table(tmp_path / "t.csv")


def test_a_hinge_that_moves_by_more_than_half_a_turn_is_not_unwrapped() -> None:
    swing = np.tile([2.0, -2.0], 6)
    assert import_log({**JOINT, "theta_z_rad": swing}).table["theta_z_rad"].tolist() == [*swing]


def test_a_time_without_unit_is_said_to_be_in_seconds() -> None:
    assert "time, no unit stated, taken as s" in str(import_log({**JOINT, "time": ANGLE + 1.0}))


def test_weeks_of_a_log_in_days_are_no_seconds() -> None:
    aged = import_log({**JOINT, "time [d]": ANGLE + 1.0})
    assert np.ptp(aged.table["time_s"]) == pytest.approx(86400.0 * np.ptp(ANGLE))
    said = str(import_log({**JOINT, "time [fortnight]": ANGLE + 1.0}))
    assert "time [fortnight], 'fortnight' is no unit that is known: taken as s" in said


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("bad.npz", b"PK\3\4garbage"),
        ("bad.mat", b"MATLAB 5.0 MAT-file".ljust(124) + b"\0\1IM\x0f\0\0\0\xff\0\0\0" + b"z" * 90),
    ],
)
def test_damaged_files_are_refused(tmp_path: Path, name: str, content: bytes) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ecm.InputError, match="no readable"):
        import_log(tmp_path / name)


@pytest.mark.parametrize(
    "log",
    [
        {**JOINT, "time": -2e9 + np.arange(12.0)},
        {**JOINT, "time": np.full(12, np.nan)},
        {"theta_z_rad": [[1.0], [1.0, 2.0]], "tau_z_Nm": [1.0, 2.0]},
    ],
)
def test_odd_arrays_end_in_a_table_or_in_words(log: dict[str, Any]) -> None:
    with contextlib.suppress(ecm.InputError):
        assert len(import_log(log).table) == 12


def test_dates_of_which_some_have_a_time_zone_are_left_aside(tmp_path: Path) -> None:
    path = saved(
        tmp_path / "log.csv",
        "time,theta_z_rad,tau_z_Nm\n2026-03-05T10:00:00+00:00,0,0\n"
        "2026-03-05T10:00:01,1,1\n2026-03-05T10:00:02,1,2\n",
    )
    assert "'time' is text" in str(import_log(path))


def test_what_names_do_not_decide_about_a_rotation() -> None:
    turn = Rotation.from_rotvec(np.random.default_rng(0).normal(size=(9, 3)) * 0.4)
    matrix, angles = turn.as_matrix(), turn.as_euler("ZYZ")
    by_columns = {f"R{i}{j}": matrix[:, i, j] for j in range(3) for i in range(3)}
    force = {"fx_N": np.arange(9.0)}
    table = import_log({**by_columns, **force}, rotation="columns").table
    assert np.allclose(table.matrix(POSE[3:]), turn.as_rotvec())
    euler = {f"r{axis}_rad": angles[:, i] for i, axis in enumerate("xyz")}
    with pytest.raises(ecm.InputError, match="--rotation ZYZ:COLUMN"):
        import_log({**euler, **force}, rotation="ZYZ")
    listed = import_log({**euler, **force}, rotation="ZYZ:rx_rad,ry_rad,rz_rad").table
    assert np.allclose(listed.matrix(POSE[3:]), turn.as_rotvec())


def test_a_log_without_pose_or_wrench_is_told_so() -> None:
    two = import_log({"pitch_deg": ANGLE, "yaw_deg": ANGLE, "fx_N": ANGLE})
    assert "no pose was found by name" in str(two)
    assert "--map theta_y_rad=pitch_deg" in str(two)
    about = import_log({"angle x [deg]": ANGLE, "angle y [deg]": ANGLE, "fx_N": ANGLE})
    assert "--map 'theta_x_rad=angle x [deg]'" in str(about)
    assert "no wrench was found by name" in str(import_log({"x_m": ANGLE, "Fx (V)": ANGLE}))


def test_a_log_is_not_overwritten_by_its_own_table(tmp_path: Path) -> None:
    path = saved(tmp_path / "log.csv", "x (mm),Fx (N)\n1,2\n2,3\n")
    with pytest.raises(ecm.InputError, match="is the log itself"):
        import_log(path).write(path)
    assert path.read_text().startswith("x (mm)")
    assert not path.with_suffix(".toml").exists()


def test_components_along_the_first_axis() -> None:
    force = np.arange(60.0).reshape(3, 20)
    log = {"F": force, "x_m": np.linspace(0.0, 0.01, 20)}
    assert np.array_equal(import_log(log, units=["SI"]).table["fy_N"], force[1])


def test_dates_of_frames_and_parquet_are_times(tmp_path: Path) -> None:
    frame = pd.DataFrame(JOINT)
    stamps = pd.Series(pd.date_range("2026-03-05 10:00", periods=12, freq="500ms"))
    frame.assign(t=stamps).to_parquet(tmp_path / "log.parquet")
    frame.assign(t=stamps).to_csv(tmp_path / "log.csv", index=False)
    for log in (
        frame.assign(t=stamps),
        frame.assign(t=stamps.dt.tz_localize("Europe/Berlin")),
        frame.assign(t=stamps - stamps[0]),
        tmp_path / "log.parquet",
        tmp_path / "log.csv",
    ):
        imported = import_log(log)
        assert np.allclose(imported.table["time_s"], 0.5 * np.arange(12))
        assert "no unit" not in str(imported)


@pytest.mark.parametrize("force", ["1,20{}", "1,20{}.5"])
def test_commas_that_may_be_thousands_are_asked_about(tmp_path: Path, force: str) -> None:
    path = tmp_path / "log.txt"
    rows = "".join(f"{i}.5\t{i}\t{force.format(i)}\n" for i in range(9))
    path.write_text("time_s\tx (mm)\tFx (N)\n" + rows)
    with pytest.raises(ecm.InputError, match="may be thousands or a decimal comma"):
        import_log(path)
    path.write_text(path.read_text().replace(".5\t", "\t").replace("1,", "0,").replace(".5", ""))
    assert import_log(path).table["fx_N"][1] == 0.201


@pytest.mark.parametrize(
    "cells",
    [[["a", "b"]] * 12, [np.arange(1.0 + i % 3) for i in range(12)], [None, *[np.ones(3)] * 11]],
    ids=["lists of words", "lists of several lengths", "a missing list"],
)
def test_odd_cells_of_a_data_frame_are_left_aside(cells: list[Any]) -> None:
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame({**JOINT, "tags": cells[::-1]})
    assert len(import_log(frame).table) == 12


def test_a_pose_that_was_not_tracked_costs_its_row() -> None:
    transforms = np.tile(np.eye(4), (20, 1, 1))
    transforms[:, 0, 3] = np.linspace(0.1, 0.11, 20)
    transforms[3] = np.nan
    wrench = np.random.default_rng(0).standard_normal((20, 6))
    log = {"time": np.arange(20.0), "tracker.pose": transforms, "wrench": wrench}
    table = import_log(log, units=["SI"], leave_out=True).table
    assert table.column("x_m").tolist() == np.delete(transforms[:, 0, 3], 3).tolist()


def test_other_columns_are_not_asked_about_where_pose_and_wrench_are_mapped() -> None:
    log = {"disp": ANGLE, "load": 2.0 * ANGLE, "load2": 3.0 * ANGLE, "torque": ANGLE}
    with pytest.raises(ecm.InputError, match="without an axis"):
        import_log(log, columns={"x_m": "disp:mm"})
    imported = import_log(log, columns={"x_m": "disp:mm", "fx_N": "load:N"})
    assert sorted(imported.table.covariates) == ["load2", "torque"]
    assert "column 'torque' may be tau_x_Nm or tau_y_Nm or tau_z_Nm, and is kept" in str(imported)


@pytest.mark.parametrize("words", [False, True])
def test_experiments_in_one_log_are_asked_about_and_held_out_together(
    tmp_path: Path, words: bool
) -> None:
    number = np.repeat([1.0, 2.0, 3.0], 4)
    frame = pd.DataFrame(
        {**JOINT, "Specimen no": [f"S {n:g}" for n in number] if words else number}
    )
    asked = str(import_log(frame))
    assert "column 'Specimen no' has 3 values: are they experiments of their own?" in asked
    assert "--group 'Specimen no' holds" in asked
    imported = import_log(frame, group="Specimen no")
    imported.write(tmp_path / "t.csv")
    groups = ecm.read_table(tmp_path / "t.csv").groups()
    assert groups is not None
    assert groups.tolist() == (number - 1.0).tolist()
    assert ("S 1 = 0, S 2 = 1, S 3 = 2" in str(imported)) == words
    assert "--group" not in str(imported)
    assert "left aside" not in str(imported)
    with pytest.raises(ecm.InputError, match="--group speciman: no such column, did you mean"):
        import_log(frame, group="speciman")
