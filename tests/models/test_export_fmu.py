"""FMUs of both versions: the model at a thousand poses, K, stored states, refusals, coupling."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from ecm.errors import ComputationError
from ecm.io.columns import POSE, WRENCH
from ecm.io.table import as_table
from ecm.models import fit_model
from ecm.models.export import export_files
from ecm.models.export.source import WINDOWS, shared_library
from support.cortex_m import WARNINGS
from support.exports import fitted, thousand_poses, written
from support.fmu import Instance
from support.models import with_time
from support.programs import ended, need_linux, need_program

CONDITIONS = ("temperature_degC", "age_s")


@pytest.fixture(scope="module")
def static(tmp_path_factory: pytest.TempPathFactory) -> Path:
    need_linux()
    need_program("gcc", "cc")
    return written(fitted("energy6"), tmp_path_factory.mktemp("static"), "fmu")


@pytest.fixture(scope="module")
def slow(tmp_path_factory: pytest.TempPathFactory) -> Path:
    need_linux()
    need_program("gcc", "cc")
    return written(with_time(fitted("energy4")), tmp_path_factory.mktemp("slow"), "fmu")


@pytest.mark.parametrize("version", [2, 3])
def test_a_thousand_poses_and_k(static: Path, version: int, tmp_path: Path) -> None:
    fmu, poses = Instance(static / f"neck_fmi{version}.fmu", tmp_path), thousand_poses()
    base = fitted("energy6").base
    assert tuple(fmu.variables("input")) == POSE
    assert tuple(fmu.variables("output")) == WRENCH
    assert fmu.enter() == 0
    found = []
    for i, pose in enumerate(poses):
        assert fmu.set(POSE, pose) == 0
        assert fmu.step(1e-3 * i, 1e-3) == 0
        found.append(fmu.get(WRENCH))
    wrenches = base.predict(poses)
    error = np.abs(np.array(found) - wrenches).max(axis=0) / np.abs(wrenches).max(axis=0)
    assert error.max() < 1e-12
    k = base.stiffness(poses[-1:])[0]
    columns = [fmu.derivative(WRENCH, POSE, seed) for seed in np.eye(6)]
    np.testing.assert_allclose(np.array(columns).T, k, rtol=1e-9, atol=1e-9 * np.abs(k).max())
    part = fmu.derivative(WRENCH[4:], POSE[3:5], np.array([2.0, -1.0]))
    np.testing.assert_allclose(part, k[4:, 3:5] @ [2.0, -1.0], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("version", [2, 3])
def test_steps_of_time_are_those_of_the_controller(
    slow: Path, version: int, tmp_path: Path
) -> None:
    fmu = Instance(slow / f"neck_fmi{version}.fmu", tmp_path)
    model = with_time(fitted("energy4"))
    controller = model.controller()
    rest = model.rest_pose("a test")[0]
    assert tuple(fmu.variables("input")) == (*POSE, *CONDITIONS)
    assert fmu.enter() == 0
    controller.init(rest)
    moves = np.random.default_rng(5).normal(size=(60, 6)) * ([2e-4] * 3 + [0.01] * 3)
    poses, time = rest + np.cumsum(moves, axis=0), 0.0
    stored, kept = b"", np.zeros((0, 6))
    for row, pose in enumerate(poses):
        dt, warm = 0.01 * (1 + row % 7), 21.0 + 0.2 * row
        fmu.set([*POSE, *CONDITIONS], np.array([*pose, warm, 0.0]))
        assert fmu.step(time, dt) == 0
        time += dt
        h, k = controller.step(pose, dt, temperature_degC=warm)
        np.testing.assert_allclose(fmu.get(WRENCH), h, rtol=1e-10, atol=1e-10)
        column = fmu.derivative(WRENCH, POSE, np.eye(6)[row % 6])
        np.testing.assert_allclose(column, k[:, row % 6], rtol=1e-9, atol=1e-7)
        if row == 29:
            stored = fmu.saved()
        if row >= 30:
            kept = np.vstack([kept, fmu.get(WRENCH)])
    assert np.abs(h - fitted("energy4").base.predict(poses[-1:])[0]).max() > 0.05 * np.abs(h).max()
    warmer = fmu.derivative(WRENCH, CONDITIONS[:1], np.ones(1))
    cooled = -0.004 * fitted("energy4").base.predict(poses[-1:])[0]
    np.testing.assert_allclose(warmer, cooled, rtol=1e-6, atol=1e-9)

    assert fmu.restore(stored) == 0
    for row in range(30, 60):
        dt = 0.01 * (1 + row % 7)
        fmu.set([*POSE, *CONDITIONS], np.array([*poses[row], 21.0 + 0.2 * row, 0.0]))
        fmu.step(0.0, dt)
        np.testing.assert_array_equal(fmu.get(WRENCH), kept[row - 30])
    # A query between two steps is a sudden move that the next step takes back.
    before = fmu.saved()
    fmu.set(POSE, poses[0])
    fmu.get(WRENCH)
    fmu.set(POSE, poses[-1])
    fmu.step(0.0, 1.0)
    asked = fmu.get(WRENCH)
    fmu.restore(before)
    fmu.step(0.0, 1.0)
    np.testing.assert_array_equal(asked, fmu.get(WRENCH))


@pytest.mark.parametrize("version", [2, 3])
def test_what_means_nothing_is_refused(
    static: Path, slow: Path, version: int, tmp_path: Path
) -> None:
    for name, folder in (("static", static), ("slow", slow)):
        fmu = Instance(folder / f"neck_fmi{version}.fmu", tmp_path / name)
        assert fmu.made("another model") is None
        assert fmu.enter() == 0
        assert fmu.inside() == 1
        good = fmu.get(WRENCH)
        stored = fmu.saved()
        rest = fitted("energy4").rest_pose("a test")[0]
        assert fmu.set(POSE, np.array([0.1, 0.0, 0.0, 0.0, 0.0, 3.2])) == 0
        assert fmu.inside() == 0
        assert fmu.step(0.0, 0.1) == 2  # discarded
        # So are answers there: the instance goes on, which an error would end.
        assert fmu.asked(1 + len(fmu.variables("input"))) == 2
        assert fmu.asked(99) == 3
        fmu.derivative(["fx_N"], ["x_m"], np.ones(1), expected=2)
        fmu.set(POSE, rest)
        for no_time in (-0.1, np.nan, np.inf):
            assert fmu.step(0.0, no_time) == 2
        assert fmu.step(0.0, 0.1) == 0
        fmu.set(POSE, rest)
        np.testing.assert_allclose(fmu.get(WRENCH), good, rtol=1e-12, atol=1e-12)
        assert fmu.restore(stored[:-8]) == 3
        assert fmu.restore(b"\0" * len(stored)) == 3
        assert fmu.restore(stored) == 0


def test_the_sources_compile_without_warnings_and_with_a_prefix(
    static: Path, tmp_path: Path
) -> None:
    gcc, nm = need_program("gcc"), need_program("nm")
    for version in (2, 3):
        folder = tmp_path / str(version)
        shutil.unpack_archive(static / f"neck_fmi{version}.fmu", folder, "zip")
        prefix = f"-DFMI{version}_FUNCTION_PREFIX=neck_"
        source, made = folder / "sources" / f"fmi{version}.c", folder / "fmi.o"
        built = ended(gcc, "-std=c99", *WARNINGS, "-O1", prefix, "-c", source, "-o", made)
        assert built.stderr == ""
        listed = ended(nm, "--defined-only", "--extern-only", made).stdout.split()[2::3]
        # Importers look for all functions, also those that co-simulation never calls.
        assert len(listed) == {2: 34, 3: 75}[version]
        assert all(name.startswith(f"neck_fmi{version}") for name in listed)
    assert export_files(fitted("energy6"), "fmu", "neck").files == {
        path.name: path.read_bytes() for path in static.glob("*.fmu")
    }


def test_a_spring_of_one_column_is_an_fmu_too(tmp_path: Path) -> None:
    need_linux()
    need_program("gcc", "cc")
    y = np.linspace(-0.01, 0.01, 9)
    spring = fit_model(as_table({"y_m": y, "fy_N": 3000.0 * y}), "linear")
    fmu = Instance(written(spring, tmp_path, "fmu") / "neck_fmi3.fmu", tmp_path / "x")
    assert fmu.enter() == 0
    fmu.set(["y_m"], np.array([0.004]))
    np.testing.assert_allclose(fmu.get(["fy_N"]), [12.0], rtol=1e-9)
    np.testing.assert_allclose(fmu.derivative(["fy_N"], ["y_m"], np.ones(1)), [3000.0], rtol=1e-9)


def test_without_a_compiler_the_sources_are_exported_and_it_is_said(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("PATH", "")
    exported = export_files(fitted("energy4"), "fmu", "neck")
    assert any("no binary" in note for note in exported.notes)
    with pytest.raises(ComputationError, match="no C compiler"):
        shared_library({"a.c": ""}, ["a.c"], WINDOWS)
