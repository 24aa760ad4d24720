"""Logs of other programs become tables: what was written is read back in SI units, or asked for."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd
import pytest
from scipy.io import savemat
from scipy.spatial.transform import Rotation

import ecm
from ecm import import_log
from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.io.description import Meta
from ecm.io.se3 import Frames
from ecm.logs.sources import rotation_columns, to_rotation_vectors
from support.neck import Command, columns_of, saved

ROWS = 40


@pytest.fixture
def truth() -> dict[str, F]:
    """Poses and wrenches of a slow motion, in standard columns."""
    rng = np.random.default_rng(3)
    poses = np.column_stack([0.1 + 0.01 * rng.random((ROWS, 3)), 0.4 * rng.normal(size=(ROWS, 3))])
    wrenches = rng.normal(size=(ROWS, 6)) * [10.0] * 1
    return {"time_s": np.arange(ROWS) * 1.0} | columns_of(poses, wrenches)


def pose(truth: Mapping[str, F]) -> F:
    return np.column_stack([truth[name] for name in POSE])


def wrench(truth: Mapping[str, F]) -> F:
    return np.column_stack([truth[name] for name in WRENCH])


def same(table: ecm.Table, truth: Mapping[str, F], tolerance: float = 1e-9) -> None:
    for name in (*POSE, *WRENCH, "time_s"):
        np.testing.assert_allclose(table[name], truth[name], atol=tolerance, err_msg=name)


def test_a_text_file_with_semicolons_decimal_commas_and_a_row_of_units(
    truth: dict[str, F], tmp_path: Path
) -> None:
    quaternion = Rotation.from_rotvec(pose(truth)[:, 3:]).as_quat()
    parts = [
        truth["time_s"][:, None] / 60.0,
        pose(truth)[:, :3] * 1e3,
        quaternion,
        wrench(truth)[:, :3] / 4.4482216152605,
        wrench(truth)[:, 3:] * 1e3,
    ]
    names = "Time;Pos X;Pos Y;Pos Z;qx;qy;qz;qw;FORCE_X;force y;Fz;Moment-X;MY;mz;"
    units = "min;mm;mm;mm;;;;;lbf;lbf;lbf;N mm;N*mm;Nmm;"
    lines = [";".join(f"{v:.12g}" for v in row) + ";" for row in np.hstack(parts)]
    body = "\n".join(lines).replace(".", ",")
    path = tmp_path / "bench.txt"
    path.write_text(f"# rig 3\nOperator;Ada\n{names}\n{units}\n{body}\n", encoding="latin-1")
    imported = import_log(path)
    same(imported.table, truth)
    assert imported.meta.origin["fx_N"] == "FORCE_X * 4.44822"
    assert "semicolons and decimal commas" in str(imported)


def write_mat(path: Path, arrays: dict[str, Any]) -> None:
    savemat(path, {"log": arrays})


def write_mat73(path: Path, arrays: dict[str, Any]) -> None:
    with h5py.File(path, "w", userblock_size=512) as file:
        group = file.create_group("log")
        for name, values in arrays.items():
            data = group.create_dataset(name, data=np.atleast_2d(values).T if values.ndim == 1
                                        else values.T)  # fmt: skip
            data.attrs["MATLAB_class"] = np.bytes_("double")


def write_npz(path: Path, arrays: dict[str, Any]) -> None:
    np.savez(path, **arrays)


@pytest.mark.parametrize(
    ("name", "write"), [("a.mat", write_mat), ("b.mat", write_mat73), ("c.npz", write_npz)]
)
def test_files_of_arrays(
    truth: dict[str, F], tmp_path: Path, name: str, write: Callable[..., None]
) -> None:
    arrays = {
        "t": truth["time_s"],
        "pose": pose(truth),
        "wrench": wrench(truth),
        "serial": np.array([17.0]),
    }
    write(tmp_path / name, arrays)
    with pytest.raises(ecm.InputError, match="rotation vector, or Euler angles"):
        import_log(tmp_path / name, units=["SI"])
    same(import_log(tmp_path / name, units=["SI"], rotation="rotvec").table, truth)


def test_parquet_data_frames_and_dicts(truth: dict[str, F], tmp_path: Path) -> None:
    frame = pd.DataFrame(truth)
    frame.to_parquet(tmp_path / "a.parquet")
    same(import_log(tmp_path / "a.parquet").table, truth)
    same(import_log(frame).table, truth)
    same(import_log(truth).table, truth)


@pytest.mark.parametrize("word", ["wxyz", "xyzw", "rows", "columns", "rotvec", "ZYX", "xzy", "zyz"])
def test_every_way_to_write_a_rotation(truth: dict[str, F], word: str) -> None:
    turn = Rotation.from_rotvec(pose(truth)[:, 3:])
    quaternion, matrix = turn.as_quat(), turn.as_matrix()
    values = {
        "wxyz": quaternion[:, [3, 0, 1, 2]],
        "xyzw": quaternion,
        "rows": matrix.reshape(-1, 9),
        "columns": matrix.transpose(0, 2, 1).reshape(-1, 9),
        "rotvec": turn.as_rotvec(),
    }
    parts = values[word] if word in values else turn.as_euler(word)
    names = [f"a{i}" for i in range(parts.shape[1])]
    log = {name: truth[name] for name in (*POSE[:3], *WRENCH, "time_s")}
    log |= dict(zip(names, parts.T, strict=True))
    imported = import_log(log, rotation=f"{word}:{','.join(names)}", units=["rad"])
    same(imported.table, truth)


@pytest.mark.parametrize(
    "word", ["wxyz", "xyzw", "rows", "columns", "rotvec", "ZYX", "xzy", "zyz",
             "grood-suntay-right", "grood-suntay-left"],
)  # fmt: skip
def test_a_rotation_comes_out_as_it_went_in(truth: dict[str, F], word: str) -> None:
    theta = pose(truth)[:, 3:]
    columns = rotation_columns(word, theta)
    np.testing.assert_allclose(
        to_rotation_vectors(word, np.column_stack([*columns.values()]))[0], theta, atol=1e-12
    )


def test_predictions_come_with_the_angles_of_a_knee(
    truth: dict[str, F], tmp_path: Path, ecm_command: Command
) -> None:
    table = ecm.as_table(truth)
    ecm.fit(table, "linear", force=True).save(tmp_path / "model.json")
    table.write(tmp_path / "poses.csv")
    files = [tmp_path / "model.json", tmp_path / "poses.csv", "--out", tmp_path / "knee.csv"]
    refused = ecm_command("predict", *files, "--rotation", "grood").refused()
    assert "grood-suntay-right" in refused.err
    ecm.as_table({"y_m": truth["y_m"]}).write(tmp_path / "few.csv")
    few = ecm_command("predict", files[0], tmp_path / "few.csv", *files[2:], "--rotation", "ZYX")
    assert "no column theta_x_rad, theta_y_rad, theta_z_rad" in few.err
    ecm_command("predict", *files, "--rotation", "grood-suntay-left").good()
    back = import_log(
        tmp_path / "knee.csv",
        rotation="grood-suntay-left:flexion_rad,adduction_rad,internal_rotation_rad",
        units=["SI"],
    )
    np.testing.assert_allclose(back.table["theta_x_rad"], truth["theta_x_rad"], atol=1e-9)


@pytest.mark.parametrize(("written", "stated"), [("xyzw", "wxyz"), ("wxyz", "xyzw")])
def test_a_quaternion_in_the_other_order_is_told_at_once(
    truth: dict[str, F], written: str, stated: str
) -> None:
    """A body whose base is clamped is turned little; it stood half a turn away."""
    small = truth | dict(zip(POSE[3:], (0.5 * pose(truth)[:, 3:]).T, strict=True))
    four = Rotation.from_rotvec(pose(small)[:, 3:]).as_quat(scalar_first=written == "wxyz")
    log = {name: small[name] for name in ("time_s", *POSE[:3], *WRENCH)}
    log |= {f"quat{i}": column for i, column in enumerate(four.T)}
    wrong = import_log(log, rotation=f"{stated}:quat0,quat1,quat2,quat3")
    words = f"in the order {stated}, which are {written}"
    assert any(words in note for note in wrong.notes)
    assert any(words in warning for warning in ecm.check(wrong.table).warnings)
    right = import_log(log, rotation=f"{written}:quat0,quat1,quat2,quat3")
    assert not any("quaternion" in note for note in right.notes)
    same(right.table, small)
    # A robot that sees the tool half a turn away says so in [frames].
    frames = Frames(base_from_robot=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
    turned = import_log(log, rotation=f"{stated}:quat0,quat1,quat2,quat3", meta=Meta(frames=frames))
    assert not any("in the order" in note for note in turned.notes)


@pytest.mark.parametrize("side", ["right", "left"])
def test_grood_and_suntay_angles_are_those_of_their_definition(side: str) -> None:
    angles = np.radians([[30.0, 7.0, 12.0], [60.0, -4.0, -9.0]])
    names = ("flexion", "adduction", "internal rotation")
    log = dict(zip(names, angles.T, strict=True)) | {"y_m": [0.0, 0.1]}
    with pytest.raises(ecm.InputError, match=r"grood-suntay-right or --rotation grood-suntay-left"):
        import_log(log, units=["rad"])
    table = import_log(log, units=["rad"], rotation=f"grood-suntay-{side}").table
    theta = np.column_stack([table[name] for name in POSE[3:]])
    for (flexion, adduction, internal), turn in zip(
        angles, Rotation.from_rotvec(theta).as_matrix(), strict=True
    ):
        i, k = turn[:, 0], turn[:, 2]
        floating = np.cross(k, [1.0, 0.0, 0.0])
        floating /= np.linalg.norm(floating)
        sign = 1.0 if side == "right" else -1.0
        assert np.isclose(np.sin(flexion), -floating[2])
        assert np.isclose(np.arccos(k[0]), np.pi / 2.0 + sign * adduction)
        assert np.isclose(np.sin(-internal), -sign * (floating @ i))


@pytest.mark.parametrize(
    ("log", "message"),
    [
        ({"q0": [1.0, 1.0], "q1": [0.0, 0.0], "q2": [0.0, 0.0], "q3": [0.0, 0.0]},
         "--rotation wxyz or --rotation xyzw"),
        ({"tx": [0.0, 1.0], "fx_N": [1.0, 2.0]}, "--map tau_x_Nm=tx or --map x_m=tx"),
        ({"angle_deg": [0.0, 1.0], "torque_Nm": [0.0, 1.0]}, "--axis x, or --axis y or z"),
        ({"x": [0.0, 30.0], "Fx_N": [0.0, 1.0]}, "x: 0 to 30, in m or in mm"),
        ({"Fx_N": [0.0, 1.0], "force x [N]": [1.0, 2.0]}, "may both be fx_N"),
        ({"speed": [0.0, 1.0]}, "speed: 0 to 1\nName what is one"),
    ],
)  # fmt: skip
def test_what_has_two_readings_is_asked_for(log: dict[str, Any], message: str) -> None:
    with pytest.raises(ecm.InputError, match=message):
        import_log(log)


def test_x_y_z_tell_the_scalar_of_a_quaternion_that_has_a_number() -> None:
    """An electromagnetic tracker writes Q0 Qx Qy Qz: no order of four numbers is asked about."""
    half = np.sqrt(0.5)
    log = {"Q0": [1.0, half], "Qx": [0.0, half], "Qy": [0.0, 0.0], "Qz": [0.0, 0.0]}
    log |= {"x_mm": [0.0, 1.0], "Fx_N": [0.0, 2.0]}
    table = import_log(log).table
    assert np.allclose(table["theta_x_rad"], [0.0, np.pi / 2.0])
    last = {name.replace("0", "4"): log[name] for name in ("Qx", "Qy", "Qz", "Q0")}
    again = import_log(last | {"x_mm": [0.0, 1.0], "Fx_N": [0.0, 2.0]}).table
    assert np.allclose(again["theta_x_rad"], [0.0, np.pi / 2.0])


def test_a_stage_in_a_plane_has_two_axes_and_microradians() -> None:
    log = {"Cap X [um]": [0.0, 20.0], "Cap Y [um]": [5.0, 0.0], "Rz [µrad]": [0.0, 300.0]}
    table = import_log(log | {"Fx [mN]": [0.0, 400.0]}).table
    assert np.allclose(table["x_m"], [0.0, 2e-5])
    assert np.allclose(table["y_m"], [5e-6, 0.0])
    assert np.allclose(table["theta_z_rad"], [0.0, 3e-4])
    # Beside three that are a position, two of a spot of light are none.
    cap = {"Cap Z [um]": [1.0, 0.0], "spot x [mm]": [7.0, 8.0], "spot y [mm]": [9.0, 9.0]}
    table = import_log(log | cap | {"Fx [mN]": [0.0, 400.0]}).table
    assert np.allclose(table["x_m"], [0.0, 2e-5])
    assert np.allclose(table["z_m"], [1e-6, 0.0])


def test_turns_are_found_behind_the_name_of_what_was_tracked() -> None:
    """A camera's cam_rz_deg beside cam_x_mm, a motion capture's Pad qx: no columns of one's own."""
    load = {"FP Fx (N)": [0.0, 1.0]}
    camera = {"cam_x_mm": [0.0, 1.0], "cam_y_mm": [1.0, 0.0], "cam_rz_deg": [0.0, 90.0]}
    table = import_log(camera | load).table
    assert np.allclose(table["theta_z_rad"], [0.0, np.pi / 2.0])
    half = np.sqrt(0.5)
    pad = {"Pad X (mm)": [0.0, 1.0], "Pad Y (mm)": [1.0, 0.0], "Pad Z (mm)": [2.0, 0.0]}
    turn = {"Pad qx": [0.0, half], "Pad qy": [0.0, 0.0], "Pad qz": [0.0, 0.0]}
    turn |= {"Pad qw": [1.0, half]}
    table = import_log(pad | turn | load).table
    assert np.allclose(table["theta_x_rad"], [0.0, np.pi / 2.0])
    # Four numbers of that kind whose squares do not sum to 1 are something else.
    other = {name: [2.0 * value for value in values] for name, values in turn.items()}
    assert "theta_x_rad" not in import_log(pad | other | load).table
    three = {f"cam r{axis} [deg]": [0.0, 1.0] for axis in "xyz"}
    with pytest.raises(ecm.InputError, match="--rotation rotvec or --rotation xyz"):
        import_log(pad | three | load)


def test_map_axis_and_units_by_one_word() -> None:
    log = {"angle": [0.0, 90.0, 359.0], "Load": [0.0, 1.0, 2.0], "humidity": [3.0, 4.0, 5.0]}
    imported = import_log(log, columns={"tau_z_Nm": "Load:gf cm"}, units=["deg"], axis="z")
    assert np.allclose(imported.table["theta_z_rad"], np.radians([0.0, 90.0, -1.0]))
    assert np.allclose(imported.table["tau_z_Nm"], [0.0, 9.80665e-5, 2 * 9.80665e-5])
    assert imported.table.covariates == ("humidity",)
    for bad, message in (
        ({"tau_z_Nm": "Lode"}, "did you mean 'Load'"),
        ({"tau_z_Nm": "Load:mm"}, "a unit of length, expected one of torque"),
    ):
        with pytest.raises(ecm.InputError, match=message):
            import_log(log, columns=bad, units=["deg"], axis="z")


def test_map_finds_a_column_without_regard_to_case_and_separators(tmp_path: Path) -> None:
    path = saved(tmp_path / "finger.csv", "Big Pos, , Torque,\nX,  Y, X,  Y\n1,2,3,4\n2,3,4,5\n")
    imported = import_log(
        path, columns={"load_y_m": "big_pos-y:cm", "tau_y_Nm": "TORQUE Y:gf cm"}, units=["SI"]
    )
    assert imported.table["load_y_m"].tolist() == [0.02, 0.03]
    assert np.allclose(imported.table["tau_y_Nm"], [4 * 9.80665e-5, 5 * 9.80665e-5])
    assert imported.meta.origin["x_m"] == "Big Pos X"


def test_map_negates_a_column_with_a_minus(tmp_path: Path, ecm_command: Command) -> None:
    """Names are compared without signs: the minus was dropped without a word."""
    path = saved(tmp_path / "log.csv", "x [mm],Fx [kN],-Q [N]\n0,1,2\n1,2,3\n2,3,4\n")
    pairs = {"fx_N": "-Fx [kN]", "fy_N": "-Q [N]", "fz_N": "--Q [N]:mN"}
    imported = import_log(path, columns=pairs)
    np.testing.assert_allclose(imported.table["fx_N"], [-1e3, -2e3, -3e3])
    np.testing.assert_allclose(imported.table["fy_N"], [2.0, 3.0, 4.0])  # its own name
    np.testing.assert_allclose(imported.table["fz_N"], [-2e-3, -3e-3, -4e-3])
    done = ecm_command("import", path, "--map", "fx_N=-Fx [kN]")
    assert "fx_N  -1 * Fx [kN] * 1000" in done.out
    wrong = ecm_command("import", path, "--map", "fx_N=-Fz").refused()
    assert "the log has no column 'Fz'" in wrong.err
    rotation = ecm_command("import", path, "--rotation", "rotvec:-x [mm],-Q [N],Fx [kN]").refused()
    assert "the log has no column '-x [mm]'" in rotation.err


def test_quaternions_without_direction_are_found_and_left_out(tmp_path: Path) -> None:
    turn = np.tile([0.0, 0.0, 0.0, 1.01], (ROWS, 1))
    turn[[4, 5, 20]] = 0.0
    log = {"quat": turn, "Fx_N": np.arange(ROWS) * 1.0}
    with pytest.raises(ecm.InputError, match=r"3 of 40 rows .* rows 5-6, 21"):
        import_log(log, rotation="xyzw")
    imported = import_log(log, rotation="xyzw", leave_out=True)
    assert "37 quaternions were normalised" in str(imported)
    assert len(imported.table) == ROWS - 3
    imported.write(tmp_path / "t.csv")
    assert len(ecm.read_table(tmp_path / "t.csv")) == ROWS - 3
    assert 'unreadable = "5-6, 21"' in (tmp_path / "t.toml").read_text()


def test_a_unit_at_the_end_of_a_name_counts_where_its_words_say_nothing() -> None:
    log = {"ML_mm": np.arange(5.0), "Fx_N": np.arange(5.0)}
    table = import_log(log, columns={"x_m": "ML_mm"}).table
    np.testing.assert_allclose(table["x_m"], 1e-3 * np.arange(5.0))
    with pytest.raises(ecm.InputError, match="no unit is stated"):
        import_log({"ML": np.arange(5.0), "Fx_N": np.arange(5.0)}, columns={"x_m": "ML"})


@pytest.mark.parametrize("last", ["InternalRot_deg", "Int Rotation [deg]", "tibial_rot_deg"])
def test_the_angles_of_a_knee_under_other_names(last: str) -> None:
    log = {"Flexion_deg": np.arange(5.0), "Adduction_deg": np.zeros(5), last: np.zeros(5)}
    with pytest.raises(ecm.InputError, match="right knee"):
        import_log(log)
    table = import_log(log, rotation="grood-suntay-right").table
    np.testing.assert_allclose(np.rad2deg(table["theta_x_rad"]), -np.arange(5.0))


def test_rows_that_are_written_twice_are_found_and_left_out(tmp_path: Path) -> None:
    time = np.repeat(np.arange(20.0), 2)
    log = {"time [s]": time, "x [mm]": np.sin(time), "Fx_N": np.cos(time)}
    log["Fx_N"][6] = 9.0  # the same time, another reading: no copy
    with pytest.raises(ecm.InputError, match=r"19 of 40 rows are copies .* rows 2, 4, 6, 10"):
        import_log(log)
    imported = import_log(log, leave_out=True)
    assert len(imported.table) == 21
    imported.write(tmp_path / "t.csv")
    assert len(ecm.read_table(tmp_path / "t.csv")) == 21
    assert len(import_log({"x [mm]": [1.0, 1.0], "Fx_N": [2.0, 2.0]}).table) == 2  # repeats


def test_a_description_may_be_a_dict_or_the_name_of_a_file(tmp_path: Path) -> None:
    log = {"x_m": np.arange(5.0) * 1e-3, "Fx_N": np.arange(5.0)}
    said = {"instrument": {"force_sd_N": 0.25}}
    (tmp_path / "bench.toml").write_text("[instrument]\nforce_sd_N = 0.25\n", encoding="utf-8")
    for meta in (said, str(tmp_path / "bench.toml"), tmp_path / "bench.toml"):
        assert import_log(log, meta=meta).meta.instrument.force_sd_N == 0.25


@pytest.mark.parametrize(
    "stamps",
    [
        ["31.12.2026 23:59:59.5", "01.01.2027 00:00:00.0", "01.01.2027 00:00:00.75"],
        ["31.12.2026  23:59:59,5", "1.1.2027 0:00:00", "1.1.2027 0:00:00,75"],
        ["23:59:59.5", "0:00:00", "00:00:00.750000"],
        ["2026-12-31 23:59:59.5", "2027-01-01 00:00:00", "2027/01/01 00:00:00.75"],
    ],
)
def test_dates_with_dots_and_times_of_day_are_seconds(stamps: list[str], tmp_path: Path) -> None:
    rows = [f"{stamp};{k},5;{2 * k},25" for k, stamp in enumerate(stamps)]
    path = saved(tmp_path / "log.csv", "\n".join(["Zeitstempel;Weg [mm];Fx [N]", *rows]))
    table = import_log(path, axis="x").table
    np.testing.assert_allclose(table["time_s"], [0.0, 0.5, 1.25], rtol=0.0, atol=1e-9)


def test_a_date_with_two_readings_is_no_time(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    rows = [f"3/5/2026 10:00:0{k},{k}.0,{k}.5" for k in range(4)]
    path.write_text("\n".join(["time,x_m,fx_N", *rows]), encoding="utf-8")
    imported = import_log(path)
    assert "time_s" not in imported.columns
    assert "column 'time' is text" in str(imported)


def test_time_that_begins_again_makes_runs_and_epochs_begin_at_zero() -> None:
    time = np.concatenate([np.arange(10.0), np.arange(5.0)])
    imported = import_log({"time": time, "x_m": np.arange(15.0) * 1e-3})
    assert imported.table["run"].tolist() == [0.0] * 10 + [1.0] * 5
    assert (np.diff(imported.table["time_s"]) > 0.0).all()
    stamps = 1.7e18 + 1e7 * np.arange(15)
    begun = import_log({"stamp": stamps, "x_m": time * 1e-3}).table["time_s"]
    assert np.allclose(begun, 0.01 * np.arange(15), rtol=0.0, atol=1e-6)
    mixed = np.random.default_rng(0).permutation(15)
    turned = import_log({"time": 2.0 * mixed, "x_m": mixed * 1e-3})
    assert turned.table["x_m"].tolist() == (np.arange(15) * 1e-3).tolist()
    assert "run" not in turned.table
    assert "the rows were put in the order of time" in str(turned)


@pytest.mark.parametrize("axis", ["", "z"])
@pytest.mark.parametrize("names", [("Fx (N)", "Fy (N)"), ("fx_N", "fy_N")])
def test_a_force_without_an_axis_beside_others_with_one_is_no_component(
    axis: str, names: tuple[str, str]
) -> None:
    x = np.arange(15.0) * 1e-3
    imported = import_log(
        {"x_m": x, names[0]: x, names[1]: 2.0 * x, "Force (N)": 3.0 * x}, axis=axis
    )
    assert imported.table.wrench_columns == ("fx_N", "fy_N")
    assert imported.table.covariates == ("force__n",)
    assert "column 'Force (N)' may be fx_N or fy_N or fz_N, and is kept as your own" in str(
        imported
    )


def test_what_alone_grows_in_seconds_is_the_time_whatever_its_name() -> None:
    x = np.arange(15.0) * 1e-3
    for values, is_time in ((2.0 * np.arange(15), True), (np.arange(15) % 4, False)):
        imported = import_log({"Duration (s)": values, "x_m": x, "fx_N": x})
        assert ("time_s" in imported.table) == is_time
    both = import_log({"Duration (s)": 2.0 * np.arange(15), "t": np.arange(15), "x_m": x})
    assert both.table["time_s"].tolist() == list(range(15))


def test_what_kind_of_row_it_is_and_where_it_came_from_are_kept(
    truth: dict[str, F], tmp_path: Path
) -> None:
    """As text they were left aside: zero readings became poses, and a slip had another name."""
    given: dict[str, Any] = dict(truth) | {"pose_id": np.arange(ROWS)}
    given["kind"] = np.array(["unloaded", "home", *["pose"] * (ROWS - 2)], dtype=object)
    given["approach"] = np.array(["", "", "initial", *["3"] * (ROWS - 3)], dtype=object)
    given["weather"] = np.array(["fair"] * ROWS, dtype=object)
    backwards = {name: column[::-1] for name, column in given.items()}
    pd.DataFrame(backwards).to_csv(tmp_path / "log.csv", index=False)
    imported = import_log(tmp_path / "log.csv")
    table = imported.table
    assert table.text("kind").tolist() == given["kind"].tolist()  # in the order of time
    assert table.text("approach").tolist() == given["approach"].tolist()
    assert len(table.measured()) == ROWS - 2
    assert any("'weather' is text" in note for note in imported.notes)
    strange = backwards | {"kind": np.array(["warm"] * ROWS, dtype=object)}
    other = import_log(pd.DataFrame(strange))
    assert any("'kind' is text" in note for note in other.notes)


def test_structs_that_hold_the_same_columns_are_logs_of_their_own() -> None:
    log = {f"{one}.{name}": np.arange(15.0) * 1e-3
           for one in ("a.low", "a.high", "b.low") for name in ("t", "x_m", "fx_N")}  # fmt: skip
    chosen = {name: f"a.low.{column}" for name, column in
              (("time_s", "t"), ("x_m", "x_m"), ("fx_N", "fx_N"))}  # fmt: skip
    imported = import_log(log | {"room.warm": np.ones(15)}, columns=chosen)
    assert set(imported.table.columns) == {"time_s", "x_m", "fx_N", "room_warm"}
    assert "a.high, b.low hold the same columns as a.low" in str(imported)


def test_the_command_writes_table_description_json_and_page(
    truth: dict[str, F], tmp_path: Path, ecm_command: Command
) -> None:
    write_npz(tmp_path / "log.npz", {"pose": pose(truth), "Force [N]": wrench(truth)[:, :3]})
    (tmp_path / "rig.toml").write_text("[mechanism]\nlength_m = 0.1\n", encoding="utf-8")
    ecm_command(
        "import", tmp_path / "log.npz", "--out", tmp_path / "t.csv", "--units", "SI",
        "--rotation", "rotvec", "--meta", tmp_path / "rig.toml",
        "--json", tmp_path / "t.json", "--report", tmp_path / "t.html",
    ).good()  # fmt: skip
    table = ecm.read_table(tmp_path / "t.csv")
    np.testing.assert_array_equal(table.poses, pose(truth))
    assert table.meta.length_m == 0.1
    document = json.loads((tmp_path / "t.json").read_text())
    assert document["columns"]["fy_N"] == "Force [N].1"
    assert "Mechanism" in (tmp_path / "t.html").read_text()
    assert ecm_command("import", tmp_path / "log.npz", "--map", "x_m").code == 2


@pytest.mark.parametrize(("module", "name"), [("h5py", "log.h5"), ("rosbags.highlevel", "a.mcap")])
def test_a_missing_extra_is_named(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, module: str, name: str
) -> None:
    (tmp_path / name).write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(600))
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ecm.MissingExtra, match=r"\(extra logs\)"):
        import_log(tmp_path / name)


def _poses() -> tuple[F, F, F]:
    random = np.random.default_rng(0)
    turns = random.uniform(-0.4, 0.4, (20, 3))
    return random.uniform(-0.1, 0.1, (20, 3)), turns, random.standard_normal((20, 6))


@pytest.mark.parametrize(
    "form", ["4x4", "transposed", "3x4", "cells", "mat", "quaternion", "first"]
)
def test_whole_poses_are_taken_apart(form: str, tmp_path: Path) -> None:
    place, turns, wrench = _poses()
    rotation = Rotation.from_rotvec(turns)
    matrix = np.tile(np.eye(4), (20, 1, 1))
    matrix[:, :3, :3], matrix[:, :3, 3] = rotation.as_matrix(), place
    seven = np.hstack([place, rotation.as_quat()])
    pose: Any = {
        "4x4": matrix,
        "transposed": matrix.transpose(0, 2, 1),
        "3x4": matrix[:, :3],
        "cells": [*matrix],
        "mat": np.moveaxis(matrix, 0, -1),
        "quaternion": seven,
        "first": np.hstack([rotation.as_quat(), place]),
    }[form]
    source: Any = {"time": np.arange(20.0), "rig.pose": pose, "wrench": wrench}
    if form == "cells":
        pandas = pytest.importorskip("pandas")
        source = pandas.DataFrame({"time": np.arange(20.0), "T": pose, "wrench": [*wrench]})
    elif form == "mat":
        source = tmp_path / "log.mat"
        savemat(source, {"time": np.arange(20.0), "T": pose, "wrench": wrench.T})
    word = "xyzw" if form in ("quaternion", "first") else ""
    table = import_log(source, units=["SI"], rotation=word).table
    np.testing.assert_allclose(table.poses, np.hstack([place, turns]), atol=1e-12)
    np.testing.assert_allclose(table.wrenches, wrench)


def test_seven_joints_are_no_pose() -> None:
    place, turns, wrench = _poses()
    joints = np.random.default_rng(1).uniform(-2.0, 2.0, (20, 7))
    columns = {"pos": place, "rotvec": turns, "wrench": wrench, "axes": joints}
    table = import_log(columns, units=["SI"]).table
    assert sum(name.startswith("axes") for name in table.columns) == 7


@pytest.mark.parametrize("name", ["c{}", "Value", "array.{}"])
def test_the_time_of_an_import_grows_with_the_columns_not_with_their_square(
    tmp_path: Path, name: str
) -> None:
    def seconds(count: int) -> float:
        names = ["time [s]", "x [mm]", "Fx [N]", *(name.format(i) for i in range(count))]
        rows = [names, *(map(str, range(i, i + len(names))) for i in range(3))]
        path = saved(tmp_path / f"{count}.csv", "\n".join(map(",".join, rows)))
        begin = time.process_time()
        assert len(import_log(path).columns) == len(names)
        return time.process_time() - begin

    seconds(10)
    # 16 times as many columns take 16 times as long, or 256 times where it is the square.
    assert seconds(8000) < 60.0 * seconds(500)


def test_pressures_come_in_their_units(tmp_path: Path) -> None:
    path = saved(tmp_path / "piston.tsv", "0\t1.5\t2.5\t100\n10\t1.6\t2.6\t101\n")
    map_ = {"time_s": "column_1:ms", "x_m": "column_2:mm", "fx_N": "column_4:N"}
    table = import_log(path, columns=map_ | {"pressure_1_Pa": "column_3:bar"}).table
    np.testing.assert_allclose(table["pressure_1_Pa"], [2.5e5, 2.6e5])
    with pytest.raises(InputError, match=r"column_3: 2.5 to 2.6, in Pa or in bar\?") as asked:
        import_log(path, columns=map_ | {"pressure_1_Pa": "column_3"})
    assert '--units "bar"' in str(asked.value)
    said = import_log(path, columns=map_ | {"pressure_1_Pa": "column_3"}, units=["psi"]).table
    assert said["pressure_1_Pa"][0] == pytest.approx(17236.89, rel=1e-6)
    one = np.arange(1.0, 4.0)
    by_name = import_log({"x [mm]": one, "Fx [N]": one, "Pressure 2 (kPa)": 3.0 * one}).table
    assert by_name["pressure_2_Pa"].tolist() == [3e3, 6e3, 9e3]
    # One without a number may be that of the room.
    alone = import_log({"x [mm]": one, "Fx [N]": one, "Pressure (kPa)": 3.0 * one}).table
    assert not alone.actuation_columns


def test_a_word_in_the_place_of_a_unit_that_is_none_is_named() -> None:
    """Once (kip) was taken in newtons in silence; now it is a unit, and other words are said."""
    known = import_log({"x (in)": np.arange(5.0), "force x (kip)": np.arange(5.0)}).table
    np.testing.assert_allclose(known["fx_N"], 4448.2216152605 * np.arange(5.0))
    log = {"x (in)": np.arange(5.0), "force x (slugs)": np.arange(5.0)}
    said = r"'slugs' is no unit.*\n.*what one of it is worth"
    with pytest.raises(ecm.InputError, match=said) as no:
        import_log(log)
    assert "For example" not in str(no.value)
    assert "'slugs' is no unit that is known: taken as N" in str(import_log(log, units=["SI"]))
    told = import_log(log, columns={"fx_N": "force x (slugs):2.5 N"})
    assert "is no unit" not in str(told)
    assert told.table["fx_N"][2] == 5.0


@pytest.mark.parametrize("form", ["dates", "epoch", "frame"])
def test_logs_with_dates_are_joined_in_the_order_of_their_time(tmp_path: Path, form: str) -> None:
    """The drift of the sensor goes on in the pause, whatever order the tables are given in."""
    time = np.arange(200.0)
    tables = []
    for name, begin in (("late", 900), ("early", 0)):
        z = 6.0 * np.sin(time / 6.0) + 2.0 * np.sin(time / 2.0)
        force = 14.0 * z + 0.02 * (begin + time)
        clock: Any = 1772456400.0 + begin + time
        if form == "frame":
            clock = clock.astype("M8[s]")
        if form == "dates":
            clock = [str(one) for one in clock.astype("M8[s]").tolist()]
        imported = import_log({"Time": clock, "z_mm": z, "Fz_N": force})
        assert imported.table["time_s"][0] == 0.0
        imported.write(tmp_path / f"{name}.csv")
        tables.append(str(tmp_path / f"{name}.csv"))
    joined = ecm.as_table(tables)
    assert joined.source == " + ".join(tables[::-1])
    assert joined["time_s"][[0, 199, 200]].tolist() == [0.0, 199.0, 900.0]
    assert joined.meta.file.begins_s == (900.0,)
    (said,) = (words for words in joined.warnings if "order of their time" in words)
    assert said.endswith(", ".join(tables[::-1]))
    assert "taken in the order" not in " ".join(ecm.as_table(tables[::-1]).warnings)


def test_the_temperature_of_the_sensor_is_not_that_of_the_mechanism() -> None:
    """Its drift would be named as a softer material; two of them were refused as one column."""
    log = {"yaw [deg]": [0.0, 2.0], "Mz [Nmm]": [0.0, 1.0]}
    both = {"FT temperature [K]": [300.15, 301.15], "room temp [degC]": [20.0, 21.0]}
    table = ecm.import_log(log | both).table
    assert table["sensor_temperature_degC"] == pytest.approx([27.0, 28.0])
    assert table["temperature_degC"] == pytest.approx([20.0, 21.0])
