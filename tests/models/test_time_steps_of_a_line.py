"""A table of one coordinate: its relaxation steps in C as Python predicts a rate it never saw."""

from __future__ import annotations

import ctypes
import subprocess
from pathlib import Path

import numpy as np
import pytest

from ecm.io.table import read_table
from ecm.models import fit_model
from ecm.models.export import export_files
from support.neck import ROOT
from support.programs import need_program

META = ROOT / "examples" / "viscoelastic_shear.toml"


@pytest.mark.parametrize("rate", [0.0, 1.0, 2.0])
def test_a_rate_left_out_is_stepped_as_well_in_c(
    shared_data: Path, rate: float, tmp_path: Path
) -> None:
    gcc = need_program("gcc")
    folder = shared_data / "viscoelastic_shear"
    table = read_table([folder / f"shear_relaxation_{n}.csv" for n in (1, 2, 5)], meta=META)
    number = table.column("run")
    train, unseen = table.select(number != rate), table.select(number == rate)
    static = fit_model(train, "poly:3")
    model = static.add("stress_relaxation").fit(train)
    exported = export_files(model, "c", "shear")
    assert exported.left_out == ()
    for path, text in exported.files.items():
        (tmp_path / path).write_text(text, encoding="utf-8")
    strict = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Wconversion", "-Wpedantic", "-Werror"]
    check = [gcc, *strict, "shear.c", "shear_check.c", "-o", "check"]
    subprocess.run(check, cwd=tmp_path, check=True)
    subprocess.run([tmp_path / "check"], check=True)
    library = tmp_path / "shear.so"
    subprocess.run(
        [gcc, *strict, "-shared", "-fPIC", "shear.c", "-o", library], cwd=tmp_path, check=True
    )
    code = ctypes.CDLL(str(library))
    state, h, k = (ctypes.c_double * 6)(), ctypes.c_double(), ctypes.c_double()
    x, time = unseen.column("x_m"), unseen.column("time_s")
    assert code.shear_init(state, ctypes.byref(ctypes.c_double(x[0]))) == 1
    said = []
    for point, dt in zip(x, np.diff(time, prepend=time[0]), strict=True):
        point_of_c = ctypes.byref(ctypes.c_double(point))
        told = (point_of_c, ctypes.c_double(dt), None, ctypes.byref(h), ctypes.byref(k))
        assert code.shear_step(state, *told) == 1
        said.append(h.value)
    truth = unseen.column("fx_N")

    def error(wrench: np.ndarray) -> float:
        return float(np.sqrt(((truth - wrench) ** 2).mean()))

    stepped = error(np.array(said))
    assert stepped <= 1.02 * error(model.predict(unseen)[:, 0])
    assert error(static.predict(unseen)[:, 0]) > 2.8 * stepped
