"""Exports of models with actuators: their inputs stand behind the pose, and G behind K."""

from __future__ import annotations

import importlib
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import ecm
from ecm.effects import Effect
from ecm.effects.actuation import (
    PressureCrossTalk,
    PressureGain,
    PressureHysteresis,
    PressureOffset,
    RegulatorLag,
)
from ecm.effects.beyond_physics import UnusedColumn
from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.io.table import Table
from ecm.models import Model
from ecm.models.export import TARGETS, export_files
from ecm.models.measured_poses import are_inside
from ecm.regression.rows import taken_by
from support.cortex_m import WARNINGS
from support.driven import PRESSURES, arm_table
from support.exports import HEAD, CompiledC, written
from support.fmu import Instance
from support.models import with_effects
from support.neck import ROOT, way_out
from support.programs import cargo, ended, need_linux, need_program


@pytest.fixture(scope="module")
def table() -> Table:
    """100 rows by FEM of an arm with three chambers."""
    return arm_table()


@pytest.fixture(scope="module")
def model(table: Table) -> Model:
    return ecm.fit_model(table.select(np.arange(60)), "actuated4")


@pytest.fixture(scope="module")
def rows(table: Table) -> F:
    """(40, 9) poses and pressures that were not fitted."""
    return table.select(np.arange(60, 100)).matrix((*POSE, *PRESSURES))


@pytest.mark.parametrize("precision", ["double", "single"])
@pytest.mark.parametrize("name", ["actuated4", "quadratic"])
def test_c_is_the_model_with_its_inputs(
    table: Table, rows: F, name: str, precision: str, tmp_path: Path
) -> None:
    model = ecm.fit_model(table.select(np.arange(60)), name)
    folder = written(model, tmp_path, "c", precision, name="arm")
    check = tmp_path / "check"
    gcc = need_program("gcc", "cc")
    built = ended(gcc, *WARNINGS, "-O2", tmp_path / "arm.c", tmp_path / "arm_check.c", "-o", check)
    assert built.stderr == ""
    ended(check)
    share, real = (1e-10, np.float64) if precision == "double" else (1e-4, np.float32)
    code, h, slopes = (
        CompiledC(folder / "arm.c", *WARNINGS),
        np.zeros(6, real),
        np.zeros((6, 9), real),
    )
    for row in rows:
        code.value_and_stiffness(row.astype(real), h, slopes)
        expected = model.predict(row[None])[0]
        np.testing.assert_allclose(h, expected, atol=share * np.abs(expected).max())
        step = 1e-6 * np.array([0.1] * 3 + [1.0] * 3 + [2e4] * 3)
        differences = [
            (model.predict((row + d)[None])[0] - model.predict((row - d)[None])[0]) / (2 * d.max())
            for d in np.diag(step)
        ]
        for found, column in zip(slopes.T, differences, strict=True):
            np.testing.assert_allclose(found, column, atol=max(share, 1e-5) * np.abs(column).max())
        assert code.inside(row.astype(real)) == are_inside(model, row[None])[0]
    assert code.inside(np.array([*rows[0, :8], 1e6], real)) == 0
    code.value(np.array([*rows[0, :8], np.nan], real), h)
    assert np.isnan(h).all()


SLIP, LAG = PressureHysteresis("all", 3e3), RegulatorLag("pressure_2_Pa", 2.5)
OF_INPUTS: dict[str, list[tuple[Effect, list[float]]]] = {
    "a spring that slips": [(SLIP, [900.0])],
    "the sign of the last change": [(PressureHysteresis("pressure_1_Pa"), [400.0])],
    "a lag": [(LAG, [0.4])],
    "a gauge that lags": [(RegulatorLag(), [-0.2])],
    "all": [
        (SLIP, [900.0]),
        (LAG, [0.4]),
        (PressureOffset("pressure_2_Pa"), [300.0]),
        (PressureGain(), [0.03]),
        (PressureCrossTalk("pressure_1_Pa"), [0.05]),
    ],
}


def a_log(table: Table) -> Table:
    """The rows at uneven times, with a sudden change."""
    time = np.cumsum(np.random.default_rng(2).uniform(0.0, 4.0, len(table)))
    time[30] = time[29]
    return table.with_columns({"time_s": time})


@pytest.mark.parametrize("kind", OF_INPUTS)
@pytest.mark.parametrize("name", ["actuated4", "quadratic"])
def test_recorded_inputs_are_stepped_in_c_as_in_a_log(
    table: Table, kind: str, name: str, tmp_path: Path
) -> None:
    """To rounding at each row, a step of no time among them; what is refused leaves the state."""
    log = a_log(table)
    model = with_effects(ecm.fit_model(log, name), *OF_INPUTS[kind])
    exported = export_files(model, "c", "arm")
    assert (exported.left_out, exported.lost) == ((), {})
    ids = ", ".join(effect.id for effect, _ in OF_INPUTS[kind])
    assert f"Steps of the recorded inputs to those that act: {ids}; " in str(exported)
    written(model, tmp_path, "c", name="arm")
    code = CompiledC(tmp_path / "arm_steps.c", tmp_path / "arm.c", *WARNINGS, name="arm")
    state, h, k, acting = np.zeros(64), np.zeros(6), np.zeros((6, 9)), np.zeros(9)
    other, slope = np.zeros_like(h), np.zeros_like(k)
    recorded = np.ascontiguousarray(log.matrix((*POSE, *PRESSURES)))
    expected = model.predict(log)
    code.init(state, recorded[0])
    for row, dt, wrench in zip(
        recorded, np.diff(log["time_s"], prepend=log["time_s"][0]), expected, strict=True
    ):
        for pose, wrong in ((row * np.where(np.arange(9) == 7, np.nan, 1.0), 1.0), (row, -1.0)):
            saved = state.tobytes()
            assert code.step(state, pose, wrong, h, k, acting) == 0
            assert np.isnan([*h, *k.ravel(), *acting]).all()
            assert state.tobytes() == saved
        assert code.step(state, row, dt, h, k, acting) == 1
        np.testing.assert_allclose(h, wrench, rtol=0.0, atol=1e-12 * np.abs(expected).max())
        code.value_and_stiffness(row, other, slope)
        there = other + slope @ (acting - row)
        np.testing.assert_allclose(h, there, rtol=0.0, atol=1e-9 * np.abs(expected).max())
        code.value_and_stiffness(acting, other, slope)
        np.testing.assert_array_equal(k, slope)
    assert np.abs(expected - model.base.predict(recorded)).max() > 1e-3 * np.abs(expected).max()


@pytest.mark.parametrize("name", ["actuated4", "quadratic"])
def test_own_columns_beside_recorded_inputs_are_in_c_as_in_a_log(
    table: Table, name: str, tmp_path: Path
) -> None:
    """What a column does is to the map at the recorded inputs, in a log and in C."""
    log = a_log(table)
    log = log.with_columns({"fan_rpm": 1500.0 + 700.0 * np.sin(log["time_s"] / 9.0)})
    outputs, inputs = ",".join(WRENCH), ",".join(POSE)
    scales = UnusedColumn("fan_rpm", 1400.0, "scales", outputs, 7.0), [1e-4]
    adds = UnusedColumn("fan_rpm", 1400.0, "adds", outputs, 3.0), [1e-4] * 6
    shifts = UnusedColumn("fan_rpm", 1500.0, "shifts", inputs), [1e-7] * 6
    base = ecm.fit_model(table, name)
    for i, own in enumerate((scales, adds, shifts)):
        model = with_effects(base, *OF_INPUTS["all"], own)
        exported = export_files(model, "c", "arm")
        assert (exported.left_out, exported.lost) == ((), {})
        folder = tmp_path / str(i)
        written(model, folder, "c", name="arm")
        sources = (folder / f"arm_{kind}.c" for kind in ("columns", "steps"))
        code = CompiledC(*sources, folder / "arm.c", *WARNINGS, name="arm")
        recorded = np.ascontiguousarray(log.matrix((*POSE, *PRESSURES)))
        fan = np.ascontiguousarray(log.matrix(("fan_rpm",)))
        expected = model.predict(log)
        without = with_effects(base, *OF_INPUTS["all"]).predict(log)
        assert np.abs(expected - without).max() > 1e-3 * np.abs(expected).max()
        state, memory, h = np.zeros(64), np.zeros(8), np.zeros(6)
        code.init(state, recorded[0])
        code.columns_init(memory, fan[0])
        dts = np.diff(log["time_s"], prepend=log["time_s"][0])
        for row, dt, one, wrench in zip(recorded, dts, fan, expected, strict=True):
            assert code.step(state, row, dt, h, None, None) == 1
            assert code.columns_add(memory, row, one, dt, h, None) == 1
            np.testing.assert_allclose(h, wrench, rtol=0.0, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("name", ["actuated4", "linear"])
def test_recorded_inputs_are_stepped_in_rust_as_in_a_log(
    table: Table, name: str, tmp_path: Path
) -> None:
    log = a_log(table)
    model = with_effects(ecm.fit_model(log, name), *OF_INPUTS["all"])
    folder = written(model, tmp_path, "rust", name="arm")
    expected = model.predict(log)
    dts = np.diff(log["time_s"], prepend=log["time_s"][0])
    lines = np.column_stack([log.matrix((*POSE, *PRESSURES)), dts, expected]).tolist()
    (folder / "tests" / "log.rs").write_text(
        f"""#[test]
        fn each_row_is_as_predicted() {{
            let rows: [[f64; 16]; {len(lines)}] = {lines};
            let at = |row: &[f64; 16]| -> [f64; 9] {{ core::array::from_fn(|i| row[i]) }};
            let mut state = arm::steps::State::new(&at(&rows[0]));
            for row in &rows {{
                let (saved, p) = (state, at(row));
                assert!(state.step(&p, -1.0).is_none());
                assert!(state.step(&[f64::NAN; 9], 1.0).is_none());
                assert_eq!(saved, state);
                let said = state.step(&p, row[9]).unwrap();
                for (found, wanted) in said.wrench.iter().zip(&row[10..]) {{
                    assert!((found - wanted).abs() < {1e-12 * np.abs(expected).max()});
                }}
                assert_eq!(said.slopes, arm::value_and_stiffness(&said.acting).1);
            }}
        }}"""
    )
    built = cargo(folder, folder / "target", "test", "--release", RUSTFLAGS="-D warnings")
    assert "each_row_is_as_predicted ... ok" in built


@pytest.mark.parametrize("version", [2, 3])
def test_an_fmu_steps_from_the_recorded_inputs(table: Table, version: int, tmp_path: Path) -> None:
    """From its start, without pressure at rest; a stored state goes on to the bit."""
    need_linux()
    need_program("gcc", "cc")
    log, names = a_log(table).select(np.arange(12)), (*POSE, *PRESSURES)
    for place, name in enumerate(names):
        first = 0.1 if place == 0 else 0.0
        log = log.with_columns({name: np.append(first, log[name][1:])})
    model = with_effects(ecm.fit_model(table, "actuated4"), *OF_INPUTS["all"])
    folder = written(model, tmp_path, "fmu", name="arm")
    fmu = Instance(folder / f"arm_fmi{version}.fmu", tmp_path / "fmu")
    assert tuple(fmu.variables("input")) == names
    assert fmu.enter() == 0
    expected, dts = model.predict(log), np.diff(log["time_s"])
    for row, dt, wrench in zip(log.matrix(names)[1:], dts, expected[1:], strict=True):
        saved = fmu.saved()
        for _ in range(2):
            fmu.restore(saved)
            fmu.set(names, row)
            assert fmu.step(0.0, dt) == 0
            np.testing.assert_allclose(fmu.get(WRENCH), wrench, rtol=0.0, atol=1e-9)


def test_what_has_no_steps_of_the_inputs_names_the_target_that_has(
    model: Model, tmp_path: Path
) -> None:
    large = with_effects(model, *OF_INPUTS["a lag"])
    sizes = {"effect_sizes": {"regulator_lag": 5.0}, "effect_shares": {"regulator_lag": 0.2}}
    large = replace(large, training={**large.training, **sizes})
    with pytest.raises(InputError, match="Export it to c, which steps"):
        ecm.export(large, "mujoco", tmp_path, name="arm")
    ecm.export(large, "c", tmp_path, name="arm")


def test_free_pose_in_c_is_that_of_the_model(model: Model, rows: F, tmp_path: Path) -> None:
    code = CompiledC(written(model, tmp_path, "c", name="arm") / "arm.c", *WARNINGS)
    rest, wrench = np.array([0.1, 0, 0, 0, 0, 0]), np.array([0.3, 0.1, -0.1, 0.0, 0.005, 0.0])
    for pressures in rows[:10, 6:]:
        for load in (np.zeros(6), wrench):
            pose = rest.copy()
            assert 0 < code.free_pose(pressures, load, pose) < 8
            np.testing.assert_allclose(pose, model.free_pose(pressures, load)[0], atol=1e-9)
            assert code.free_pose(pressures, load, pose) == 1
    # Where there is none the pose stays.
    pose = rest.copy()
    assert code.free_pose(rows[0, 6:], np.array([1e9, 0, 0, 0, 0, 0]), pose) == 0
    np.testing.assert_array_equal(pose, rest)


@pytest.mark.parametrize("precision", ["double", "single"])
@pytest.mark.parametrize("name", ["actuated4", "linear"])
def test_the_crate_gives_the_golden_vectors(
    table: Table, name: str, precision: str, tmp_path: Path
) -> None:
    folder = written(ecm.fit_model(table, name), tmp_path, "rust", precision, name="arm")
    assert "golden_vectors ... ok" in cargo(folder, folder / "target", "test", "--release")


@pytest.mark.parametrize("version", [2, 3])
def test_an_fmu_has_the_pressures_for_inputs(
    model: Model, rows: F, version: int, tmp_path: Path
) -> None:
    need_linux()
    need_program("gcc", "cc")
    folder = written(model, tmp_path, "fmu", name="arm")
    fmu = Instance(folder / f"arm_fmi{version}.fmu", tmp_path / "fmu")
    names = (*POSE, *PRESSURES)
    assert tuple(fmu.variables("input")) == names
    assert fmu.enter() == 0
    for row in rows[:5]:
        fmu.set(names, row)
        np.testing.assert_allclose(fmu.get(WRENCH), model.predict(row[None])[0], rtol=1e-9)
        g = [fmu.derivative(WRENCH, PRESSURES, seed) for seed in np.eye(3)]
        expected = model.actuation_jacobian(row[:6], row[6:])
        np.testing.assert_allclose(np.array(g).T, expected, rtol=1e-9, atol=1e-15)


def test_a_free_body_of_mujoco_comes_to_rest_at_the_free_pose(model: Model, tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco", reason="mujoco is not installed (extra robot)")
    need_program("g++", "c++")
    folder = written(model, tmp_path, "mujoco", name="arm", loop=HEAD)
    built = ended("sh", folder / "arm_build.sh", sys.executable)
    assert built.stderr == ""
    mujoco.mj_loadPluginLibrary(built.stdout.strip())
    for file in ("arm_free.xml", "arm_plugin.xml"):
        text = (folder / file).read_text()
        lags = text.replace("<general name=", '<general dyntype="filter" dynprm="0.02" name=')
        for words in (text, lags):  # the control itself, and one behind a valve
            scene = mujoco.MjModel.from_xml_string(words)
            scene.opt.gravity[:] = 0.0
            scene.dof_damping[:] = np.repeat([3.0, 3e-3], 3)
            data, pressures = mujoco.MjData(scene), np.array([9e3, 2e3, 0.0])
            data.ctrl[:] = pressures
            mujoco.mj_step(scene, data, int(4.0 / scene.opt.timestep))
            pose, _ = model.free_pose(pressures)
            np.testing.assert_allclose(data.site("arm_top").xpos, pose[:3], atol=1e-6)
    wrong = text.replace("arm_pressure_2_Pa", "other")
    with pytest.raises(ValueError, match="no actuator arm_pressure_2_Pa"):
        mujoco.MjModel.from_xml_string(wrong)


def test_a_target_without_such_inputs_says_which_has_them(model: Model, table: Table) -> None:
    for target in sorted(set(TARGETS) - {"c", "rust", "fmu", "mujoco"}):
        with pytest.raises(InputError, match="no inputs for pressure_1_Pa") as refusal:
            export_files(model, target, "arm")
        assert "at_actuation" in str(refusal.value)
        assert way_out(refusal.value)
        export_files(model.at_actuation(np.array([1e4, 0.0, 0.0])), target, "arm")
    with pytest.raises(InputError, match="no inputs for pressure_1_Pa"):
        export_files(ecm.fit_model(table, "linear"), "mujoco", "arm")


def test_a_controller_in_python_and_inputs_that_are_no_numbers_name_the_way_out(
    model: Model, rows: F
) -> None:
    with pytest.raises(InputError, match="without the inputs of actuators") as refusal:
        model.controller()
    assert "--to c" in way_out(refusal.value).command
    for wrong in (np.array([0.0, np.nan, 0.0]), np.ma.array([0.0, 1e4, 0.0], mask=[0, 1, 0])):
        for call in (model.predict, model.actuation_jacobian, lambda _, a: model.at_actuation(a)):
            with pytest.raises(InputError, match="row 0, column pressure_2_Pa is nan"):
                call(rows[0, :6], wrong)


def test_rows_of_a_table_tell_where_the_export_is_inside(model: Model, table: Table) -> None:
    low = table.select(np.flatnonzero(table.column("pressure_1_Pa") < 8e3))
    judged = model.measured_at(low)
    names = taken_by(model.base)
    assert are_inside(judged, low.matrix(names)).all()
    beyond = low.matrix(names)[:1]
    beyond[0, 6] += 1e4
    assert not are_inside(judged, beyond).any()
    sources = [export_files(one, "c", "arm").files["arm.c"] for one in (judged, model)]
    assert sources[0] != sources[1]
    # Rows of older files have no pressures: then there is nothing to judge by.
    poses = [row[:6] for row in model.training["poses"]]
    old = replace(model, training={**model.training, "poses": poses})
    with pytest.raises(InputError, match="no rows with the inputs") as refusal:
        export_files(old, "c", "arm")
    assert "--data DATA" in way_out(refusal.value).command


def test_the_example_holds_its_tip_when_a_payload_is_put_on(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The whole example, whose figures docs/actuation.md has: moved, then loaded at 3 s."""
    need_program("cc")
    monkeypatch.syspath_prepend(ROOT / "examples")
    monkeypatch.setattr("sys.argv", ["arm_controller.py"])
    importlib.import_module("arm_controller").main()
    printed = capsys.readouterr().out
    page = (ROOT / "docs" / "actuation.md").read_text(encoding="utf-8")
    table = page[page.index("| distance in mm |") :].partition("\n\n")[0]
    told, read = (
        {row[0]: np.array(row[1:], dtype=np.float64) for row in table_rows(text)[2:]}
        for text in (printed, table)
    )
    assert set(told) == set(read)
    for name, numbers in told.items():
        np.testing.assert_allclose(numbers, read[name], atol=0.021)
    for how in ("without reading the pose", "reads the pose"):
        linear, exact = told[f"linear, {how}"], told[f"exact, {how}"]
        assert exact[0] < 0.2 * linear[0]  # on the way, of 8 mm
        assert exact[1] < 0.02
    assert told["linear, without reading the pose"][1] > 1.0
    # Once the load is told by h(p, a): nearer half a second after, and both settle.
    assert exact[2] < 0.7 * linear[2]
    assert max(exact[3], linear[3]) < 0.1
    assert told["exact, without reading the pose"][3] > 2.0  # nothing tells it of the payload


def table_rows(text: str) -> list[list[str]]:
    """Cells of the rows of a Markdown table."""
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines()]
