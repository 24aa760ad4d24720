"""Names, units and containers as other programs write them: units of arrays, labels, empty rows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import ecm
from ecm import import_log
from ecm.errors import InputError
from ecm.io.columns import POSE, WRENCH
from ecm.logs.log import log_of_object
from ecm.logs.names import read_name
from ecm.models.selection import default_candidates

N = 40
PLACE = np.random.default_rng(1).uniform(-0.02, 0.02, (N, 3))
TURN = np.random.default_rng(2).uniform(-0.3, 0.3, (N, 3))
WXYZ = Rotation.from_rotvec(TURN).as_quat()[:, [3, 0, 1, 2]]
LOAD = np.random.default_rng(3).uniform(-5.0, 5.0, (N, 6))


def check_all(imported: Any) -> None:
    table = imported.table
    assert np.allclose(table.matrix(POSE), np.hstack([PLACE, TURN]), atol=1e-12)
    assert np.allclose(table.matrix(WRENCH), LOAD, atol=1e-12)


def test_units_at_the_end_of_the_names_of_arrays() -> None:
    arrays = {
        "log": 1,
        "position_mm": 1e3 * PLACE,
        "quat_wxyz": WXYZ,
        "F_N": LOAD[:, :3],
        "M_Nmm": 1e3 * LOAD[:, 3:],
        "t_min": np.arange(N) / 60.0,
    }
    imported = import_log(arrays)
    check_all(imported)
    assert np.allclose(imported.table["time_s"], np.arange(N))
    both = {"pose_mm_deg": np.hstack([1e3 * PLACE, np.degrees(TURN)]), "Wrench [N, N mm]":
            LOAD * [1, 1, 1, 1e3, 1e3, 1e3]}  # fmt: skip
    check_all(import_log(both, rotation="rotvec"))


@pytest.mark.parametrize("name", ["twist", "actual_TCP_speed", "tcp_pose_target"])
def test_six_numbers_that_are_no_reading_of_the_pose_are_none(name: str) -> None:
    log = {"t": np.arange(float(N)), name: LOAD, "wrench": LOAD}
    with pytest.raises(InputError, match="--rotation rotvec: expected 3 columns, found 0"):
        import_log(log, units="SI", rotation="rotvec")
    check_all(import_log({**log, "tcp": np.hstack([PLACE, TURN])}, units="SI", rotation="rotvec"))


def test_two_units_of_pressure_are_refused_as_two_of_length_are() -> None:
    for units in ("bar,psi", "mm,m"):
        with pytest.raises(InputError, match="are both units of"):
            import_log({"x [mm]": [0.0, 1.0], "Fx [N]": [1.0, 2.0]}, units=units)


def test_the_smallest_value_of_a_force_is_no_time() -> None:
    imported = import_log({"x_m": PLACE[:, 0], "fx_N": LOAD[:, 0], "fy_min": LOAD[:, 1]})
    assert not imported.table.has("time_s")
    assert not imported.table.has("fy_N")


@pytest.mark.parametrize("name", ["psi", "gyro", "Data.acc", "imu/mag"])
def test_three_numbers_of_something_else_are_no_position(name: str) -> None:
    columns: dict[str, Any] = {"fx_N": LOAD[:, 0], name: PLACE}
    imported = import_log(columns)
    assert not imported.table.has("x_m")
    columns = {"fx_N": LOAD[:, 0]} | {f"{name}.{axis}": PLACE[:, 0] for axis in "xyz"}
    assert not import_log(columns).table.has("x_m")


def test_components_of_a_struct_are_read_without_its_name() -> None:
    columns = {f"bench3.{axis}": PLACE[:, i] for i, axis in enumerate("xyz")}
    columns |= {f"bench3.f{axis}": LOAD[:, i] for i, axis in enumerate("xyz")}
    table = import_log(columns, units=["mm", "N"]).table
    assert np.allclose(table["y_m"], 1e-3 * PLACE[:, 1])
    assert np.allclose(table["fz_N"], LOAD[:, 2])


def test_rows_without_any_cell_and_the_number_of_the_row(tmp_path: Path) -> None:
    rows = "".join(f"{i};{0.1 * i:.1f};{i}\n".replace(".", ",") for i in range(9))
    path = tmp_path / "log.csv"
    path.write_text(";x [mm];Fx [N]\n" + rows + ";;\n\n; ;\n", encoding="utf-8-sig")
    imported = import_log(path)
    assert len(imported.table) == 9
    assert imported.table.covariates == ()
    assert any("counts the rows" in note for note in imported.notes)
    assert np.allclose(imported.table["x_m"], 1e-4 * np.arange(9))


def test_a_row_of_units_in_quotes_and_a_side_of_the_body(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    rows = "".join(f'"{i}","{i}","{i}"\n' for i in range(9))
    head = '"Time","ankle_angle_r","Ankle Moment Right"\n"(s)","(deg)","(N mm)"\n'
    path.write_text(f'"Specimen","7"\n\n{head}{rows}')
    table = import_log(path, axis="z").table
    assert np.allclose(table["theta_z_rad"], np.radians(np.arange(9)))
    assert np.allclose(table["tau_z_Nm"], 1e-3 * np.arange(9))


def test_a_workbook_is_refused_with_what_to_save(tmp_path: Path) -> None:
    (tmp_path / "log.xlsx").write_bytes(b"PK\x03\x04" + bytes(300))
    with pytest.raises(ecm.InputError, match=r"log.xlsx: a binary file .* sheet of a workbook"):
        import_log(tmp_path / "log.xlsx")


def test_several_columns_without_an_axis_are_to_be_named_each() -> None:
    columns = {"AP Force": LOAD[:, 0], "ML Force": LOAD[:, 1], "x [mm]": PLACE[:, 0]}
    with pytest.raises(ecm.InputError, match='--map "fx_N=AP Force"'):
        import_log(columns, units=["SI"])


def test_a_name_that_is_there_twice_is_asked_about(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    rows = "".join(f"{i},{i},{2 * i}\n" for i in range(9))
    path.write_text("phi/deg,torque [N mm],torque [N mm]\n" + rows)
    with pytest.raises(ecm.InputError, match=r"both be tau_z_Nm.*--map \"tau_z_Nm=torque"):
        import_log(path, axis="z")
    chosen = import_log(path, axis="z", columns={"tau_z_Nm": "torque [N mm]_2:N mm"})
    assert np.allclose(chosen.table["tau_z_Nm"], 2e-3 * np.arange(9))
    assert np.allclose(chosen.table["theta_z_rad"], np.radians(np.arange(9)))


def test_a_column_and_its_unit_go_before_a_column_that_reads_alike() -> None:
    columns = {"x [mm]": np.arange(9.0), "F": np.arange(9.0), "FN": np.ones(9)}
    table = import_log(columns, columns={"fx_N": "F:kN"}).table
    assert np.allclose(table["fx_N"], 1e3 * np.arange(9))
    table = import_log(columns, columns={"fx_N": "F:N"}).table
    assert np.allclose(table["fx_N"], np.arange(9))


def test_labels_and_units_of_an_xarray_dataset() -> None:
    xarray = pytest.importorskip("xarray")
    data = xarray.Dataset(
        {
            "position": (("time", "axis"), 1e3 * PLACE, {"units": "mm"}),
            "orientation": (("part", "time"), WXYZ.T),
            "force": (("time", "axis"), LOAD[:, :3], {"units": "N"}),
            "torque": (("axis", "time"), 1e3 * LOAD[:, 3:].T, {"units": "N mm"}),
        },
        coords={
            "time": ("time", np.arange(N) / 60.0, {"units": "min"}),
            "axis": ["x", "y", "z"],
            "part": ["w", "x", "y", "z"],
        },
    )
    imported = import_log(data)
    check_all(imported)
    assert np.allclose(imported.table["time_s"], np.arange(N))


def test_labels_of_bytes_and_of_several_types_name_components() -> None:
    xarray = pytest.importorskip("xarray")
    for labels in (np.array([b"x", b"y", b"z"]), np.array(["x", "y", 3], dtype=object)):
        sizes = {"force": (("axis", "time"), LOAD[:, :3].T)}
        columns = log_of_object(xarray.Dataset(sizes, coords={"axis": labels})).columns
        names = [f"force.{'xyz'[i] if labels[2] != 3 or i < 2 else 3}" for i in range(3)]
        assert np.array_equal(np.array([columns[name] for name in names]).T, LOAD[:, :3])


def test_frames_of_polars_with_arrays_in_their_cells_and_not_yet_computed() -> None:
    polars = pytest.importorskip("polars")
    frame = polars.DataFrame({"pose": np.hstack([PLACE, WXYZ]), "wrench": LOAD})
    for each in (frame, frame.lazy()):
        check_all(import_log(each, rotation="wxyz", units=["SI"]))
    assert len(ecm.Table(polars.DataFrame({"x_m": PLACE[:, 0]}).lazy())) == N


def test_a_column_with_empty_cells_is_asked_for_with_its_range() -> None:
    """It said nan to nan."""
    load = np.linspace(-3.0, 4.0, N)
    load[[5, 9]] = np.nan
    with pytest.raises(ecm.InputError, match=r"Fx: -3 to 4, in N or in gf\?"):
        import_log({"x_mm": PLACE[:, 0], "Fx": load})
    with pytest.raises(ecm.InputError, match=r"Fx: no numbers, in N or in gf\?"):
        import_log({"x_mm": PLACE[:, 0], "Fx": np.full(N, np.nan)})


def test_a_model_of_one_angle_is_chosen_among_nine_polynomials() -> None:
    table = ecm.as_table({"theta_z_rad": TURN[:, 2], "tau_z_Nm": LOAD[:, 3]})
    assert [one.name for one in default_candidates(table)] == [f"poly:{d}" for d in range(1, 10)]


def test_a_column_of_remarks_below_a_row_of_units_costs_no_row(tmp_path: Path) -> None:
    rows = [f"{0.1 * i:.1f};{20.0 + i:.1f};{0.01 * i:.3f}".replace(".", ",") for i in range(N)]
    ends = [";checked" if i % 20 == 0 else ";" for i in range(N)]
    path = tmp_path / "excel.csv"
    for names, units in (("Bemerkung", ""), ("Befund", ""), ("Befund", "-")):
        head = f"Zeit;Biegewinkel;Moment;{names}\ns;°;Nm;{units}\n"
        text = head + "\n".join(map("".join, zip(rows, ends, strict=True)))
        path.write_text(text, encoding="utf-8-sig")
        table = import_log(path, axis="z").table
        assert len(table) == N
        assert table["theta_z_rad"][0] == pytest.approx(np.radians(20.0))


@pytest.mark.parametrize("encoding", ["cp932", "utf-8"])
@pytest.mark.parametrize("brackets", ["[]", "［］", "（）"])
def test_a_log_as_excel_writes_it_in_japan(tmp_path: Path, encoding: str, brackets: str) -> None:
    """Wide signs are units; it said a temperature is x_m, for a byte of its letters is an x."""
    units = {"時間": "s", "角度": "deg", "トルク": "mN・m", "温度": "℃"}
    head = ",".join(f"{name}{brackets[0]}{unit}{brackets[1]}" for name, unit in units.items())
    rows = [f"{0.1 * i:.1f},{i - 20},{3 * i},{20 + 0.1 * i:.1f}" for i in range(N)]
    path = tmp_path / "excel.csv"
    path.write_text("\n".join([head, *rows]), encoding=encoding)
    angle, torque = (
        f"{name}{brackets[0]}{units[name]}{brackets[1]}" for name in ("角度", "トルク")
    )
    table = import_log(path, columns={"theta_z_rad": angle, "tau_z_Nm": torque}).table
    assert table["theta_z_rad"][0] == pytest.approx(np.radians(-20.0))
    assert table["tau_z_Nm"][1] == pytest.approx(3e-3)
    assert table["temperature_degC"][10] == pytest.approx(21.0)
    assert table["time_s"][1] == pytest.approx(0.1)


@pytest.mark.parametrize("remark", ["Prüfer: Müller – „Öse“", "Operator’s rig"])
def test_letters_of_western_europe_are_no_japanese(tmp_path: Path, remark: str) -> None:
    """The curled mark and s of the second are one letter in Shift-JIS, and so is the mu."""
    path = tmp_path / "excel.csv"
    rows = [f"{0.1 * i:.1f};{0.2 * i:.1f};{i}" for i in range(N)]
    path.write_text("\n".join([remark, "Zeit [s];Weg x [µm];Kraft x [N]", *rows]), "cp1252")
    assert import_log(path).table["x_m"][5] == pytest.approx(1e-6)


def test_cells_that_end_in_one_unit_are_numbers_in_it(tmp_path: Path) -> None:
    path = tmp_path / "matlab.csv"
    cells = [f"{20 * i} ms,{0.1 * i:.1f},{i}" for i in range(N)]
    path.write_text("Time,x_mm,Fx_N\n" + "\n".join([*cells, "NaN ms,1,2"]), encoding="utf-8")
    imported = import_log(path, leave_out=True)
    assert np.allclose(imported.table["time_s"], 0.02 * np.arange(N))
    words = {"x_m": [0.0, 1.0], "fx": ["2 N", "3 N"], "gain": ["2 N", "3 mN"]}
    frame = import_log(words)
    assert frame.table["fx_N"].tolist() == [2.0, 3.0]
    assert "column 'gain' is text" in str(frame)


@pytest.mark.parametrize("ends", [("secs", "nsecs"), ("sec", "nanosec")])
def test_stamps_in_seconds_and_nanoseconds_are_one_time(ends: tuple[str, str]) -> None:
    nano = 1767225600 * 10**9 + 990 * 10**6 + 4 * 10**6 * np.arange(N)
    stamp = {f"header.stamp.{ends[0]}": nano // 10**9, f"header.stamp.{ends[1]}": nano % 10**9}
    log = stamp | {"pose.position.x": PLACE[:, 0], "wrench.force.x": LOAD[:, 0]}
    table = import_log(log, units="SI").table
    assert np.allclose(table["time_s"], 0.004 * np.arange(N), rtol=0.0, atol=1e-12)
    assert not table.covariates


def test_tensions_are_named_as_pressures_are() -> None:
    names = ["Tendon 1 (N)", "tension_2 (kN)", "Druck Kammer 1 [bar]", "x [mm]", "Fx [N]"]
    log = dict(zip(names, LOAD.T, strict=False))
    table = import_log(log).table
    assert table.actuation_columns == ("pressure_1_Pa", "tension_1_N", "tension_2_N")
    assert np.allclose(table["tension_2_N"], 1e3 * LOAD[:, 1])


@pytest.mark.parametrize(
    "name", ["Chamber 2 [kPa]", "chamber2 pressure (kPa)", "p_ch2_kPa", "Bellows 2 [kPa]"]
)
def test_a_chamber_is_known_by_its_number_and_a_unit_of_pressure(name: str) -> None:
    table = import_log({"x [mm]": LOAD[:, 0], "Fx [N]": LOAD[:, 1], name: LOAD[:, 2]}).table
    assert np.allclose(table["pressure_2_Pa"], 1e3 * LOAD[:, 2])


@pytest.mark.parametrize("name", ["Supply pressure 1 [bar]", "P1 set [bar]", "Row 2 P1 [bar]"])
def test_a_pressure_of_something_else_is_none_of_a_chamber(name: str) -> None:
    imported = import_log({"x [mm]": LOAD[:, 0], "Fx [N]": LOAD[:, 1], name: LOAD[:, 2]})
    assert not imported.table.actuation_columns


def test_pressures_without_a_number_are_offered_one_each() -> None:
    log = {"x [mm]": LOAD[:, 0], "Fx [N]": LOAD[:, 1]}
    said = str(import_log(log | {"Left [bar]": LOAD[:, 2], "Right [bar]": LOAD[:, 3]}))
    assert "pressure_1_Pa=Left [bar]" in said
    assert "pressure_2_Pa=Right [bar]" in said


def test_the_only_x_y_and_z_in_a_unit_are_known_whatever_they_are_called() -> None:
    log = {f"cam_{axis} [mm]": LOAD[:, i] for i, axis in enumerate("xyz")}
    log |= {f"cell {axis} [N]": LOAD[:, i] for i, axis in enumerate("xyz")}
    table = import_log(log).table
    assert np.allclose(table.matrix(("x_m", "y_m", "z_m")), 1e-3 * LOAD[:, :3])
    assert np.array_equal(table.matrix(("fx_N", "fy_N", "fz_N")), LOAD[:, :3])
    twice = log | {f"led_{axis} [mm]": LOAD[:, i] for i, axis in enumerate("xyz")}
    assert not import_log(twice).table.pose_columns  # of two nothing tells which


def test_an_axis_at_the_end_of_a_word_beside_others_is_known_by_its_unit() -> None:
    names = ["LC_Fx_gf", "LC_Fy_gf", "LC_Fz_gf", "LC_Mx_Nmm", "LC_My_Nmm", "LC_Mz_Nmm"]
    loads = LOAD / np.repeat([9.80665e-3, 1e-3], 3)
    log = dict(zip(names, loads.T, strict=True)) | {"max_gf": LOAD[:, 0]}
    assert np.allclose(import_log(log).table.matrix(WRENCH), LOAD)


def test_three_angles_without_a_known_name_beside_a_position_are_asked_about() -> None:
    angles = Rotation.from_rotvec(TURN).as_euler("xyz", degrees=True)
    log = dict(zip(("X [mm]", "Y [mm]", "Z [mm]"), 1e3 * PLACE.T, strict=True))
    log |= dict(zip(("U [deg]", "V [deg]", "W [deg]"), angles.T, strict=True))
    log |= dict(zip(WRENCH, LOAD.T, strict=True))
    with pytest.raises(InputError, match="no name tells about which axes") as refused:
        import_log(log)
    assert '--rotation "XYZ:U [deg],V [deg],W [deg]"' in str(refused.value)
    check_all(import_log(log, rotation="xyz:U [deg],V [deg],W [deg]"))
    kept = import_log(log, columns={"own_angle": "U [deg]"}).table
    assert {"own_angle", "v__deg", "w__deg"} <= set(kept.columns)


def test_the_rest_before_a_reading_is_known_beside_the_time() -> None:
    log = {"t [s]": np.arange(N), "Dwell time [s]": LOAD[:, 3] ** 2, "x [mm]": LOAD[:, 0]}
    table = import_log(log | {"Fx [N]": LOAD[:, 1]}).table
    assert np.array_equal(table["dwell_s"], LOAD[:, 3] ** 2)
    assert table["time_s"].tolist() == list(range(N))


@pytest.mark.parametrize(
    ("name", "standard"),
    [("Bending angle about y [rad]", "theta_y_rad"), ("pitch [rad]", "theta_y_rad"),
     ("rot_z_rad", "theta_z_rad")],
)  # fmt: skip
def test_one_angle_about_an_axis_is_the_rotation_vector(name: str, standard: str) -> None:
    log = {name: TURN[:, 0], "Moment about y [Nm]": LOAD[:, 0]}
    assert np.allclose(import_log(log).table[standard], TURN[:, 0])
    with_flexion = log | {"flexion [deg]": TURN[:, 1]}
    assert not import_log(with_flexion).table.pose_columns


def test_a_name_that_is_a_unit_alone_tells_the_quantity() -> None:
    """Its axis is asked for; a unit that is another word too tells nothing."""
    log = {"ms": [0.0, 5.0, 9.0], "deg": [0.0, 30.0, 10.0], "Nmm": [0.0, 9.0, 3.0]}
    with pytest.raises(InputError, match="'deg' is a rotation without an axis"):
        import_log(log)
    table = import_log(log, axis="z").table
    assert table["theta_z_rad"][1] == pytest.approx(np.pi / 6)
    assert table["tau_z_Nm"][1] == pytest.approx(9e-3)
    assert table["time_s"][2] == pytest.approx(9e-3)
    for word in ("in", "ft", "min", "N", "m"):
        assert not [one for one in read_name(word).guesses if one.dimension == "length"]
