"""A real compliant finger joint: no header, degrees, gram-force centimetres, fifteen positions."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ecm.io.table import read_table
from support.neck import ROOT, Command

META = ROOT / "examples" / "finger_joint.toml"


@pytest.fixture(scope="module")
def april(shared_data: Path) -> Path:
    return shared_data / "finger_joint" / "03April2018_full_calculated_data.csv"


def test_units_are_those_of_the_file(april: Path) -> None:
    table = read_table(april, meta=META)
    own = np.loadtxt(april, delimiter=",")
    assert len(table) == 492
    assert table.pose_columns == ("theta_x_rad", "theta_y_rad", "theta_z_rad")
    assert table.wrench_columns == ("tau_x_Nm", "tau_y_Nm", "tau_z_Nm")
    np.testing.assert_allclose(table.column("theta_y_rad"), np.deg2rad(own[:, 7]), rtol=1e-14)
    # A weight of 20 g at 4.6 cm gives 92 gf cm = 0.092 kg cm = 9.02 mN m.
    assert table.column("tau_y_Nm")[0] == pytest.approx(-0.020 * 9.80665 * 0.046, rel=1e-12)
    torque = table.column("load_x") * own[:, 5] * 1e-3 * 9.80665
    np.testing.assert_allclose(-table.column("tau_y_Nm"), torque, rtol=1e-12)
    groups = table.groups()
    assert groups is not None
    assert len(np.unique(groups)) == 15


def test_check_says_what_is_never_excited(april: Path, ecm_command: Command) -> None:
    done = ecm_command("check", april, "--meta", META).good()
    assert "492 rows" in done.out
    assert "The z torque (tau_z_Nm) is never excited" in done.out
    assert "15 groups" in done.out
    assert "4 row(s) are identical" in done.err


def test_random_rows_flatter_the_cubic(april: Path, ecm_command: Command, tmp_path: Path) -> None:
    """Half of the rows held out: about 0.51 of the spread of tau_x at random, 0.67 by position."""
    fitted = ecm_command(
        "fit", april, "--meta", META, "--model", "cubic", "--out", tmp_path / "m.json",
        "--json", tmp_path / "fit.json",
    ).good()  # fmt: skip
    held_out = read(tmp_path / "fit.json")["held_out"]
    assert held_out["by_random_rows"]["tau_x_Nm"] == pytest.approx(0.49, abs=0.04)
    assert held_out["by_group"]["tau_x_Nm"] == pytest.approx(0.67, abs=0.06)
    assert "tau_z_Nm" not in held_out["by_group"]
    assert "Random rows flatter the model in tau_x_Nm" in fitted.out
    assert "tau_z_Nm: never excited" in fitted.out

    compared = ecm_command(
        "compare", tmp_path / "m.json", april, "--meta", META, "--json", tmp_path / "c.json"
    ).good()
    assert "The z torque (tau_z_Nm) is never excited" in compared.out
    document = read(tmp_path / "c.json")
    assert document["never_excited"] == ["tau_z_Nm"]
    assert document["rmse"]["tau_x_Nm"] == pytest.approx(1.36e-3, rel=0.02)
    assert document["rmse"]["tau_z_Nm"] < 1e-12


def test_the_later_session_has_two_header_rows(shared_data: Path, tmp_path: Path) -> None:
    meta = tmp_path / "may.toml"
    text = META.read_text(encoding="utf-8").replace("header_rows = 0", "header_rows = 2")
    meta.write_text(text, encoding="utf-8")
    path = shared_data / "finger_joint" / "06May2018_full_calculated_data.csv"
    table = read_table(path, meta=meta)
    assert len(table) == 81
    assert "Big Force Z" in table.columns
    assert table.column("theta_y_rad")[0] == pytest.approx(math.radians(-1.75))


def read(path: Path) -> dict[str, Any]:
    document: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return document
