"""Recorded columns of one's own in exported C: as `ecm predict` has them along a log."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ecm.effects.ageing import TemperatureModulus
from ecm.effects.beyond_physics import UnusedColumn
from ecm.errors import InputError
from ecm.io.columns import POSE, WRENCH
from ecm.io.table import Table
from ecm.models import Model, fit_model
from ecm.models.controller import AdaptSettings
from ecm.models.export import export, export_files
from support.cortex_m import WARNINGS
from support.exports import CompiledC, written
from support.models import spring_body, with_effects
from support.neck import columns_of, way_out

HUMID, FAN = "humidity_pct", "fan */ rpm"
META = {"mechanism": {"length_m": 0.1}, "instrument": {"force_sd_N": 0.05, "torque_sd_Nm": 2e-3}}


def log(names: tuple[str, ...], rows: int = 200) -> Table:
    """Poses of some columns, their wrench, two own columns and a temperature over time."""
    random = np.random.default_rng(4)
    poses = random.uniform(-1.0, 1.0, (rows, 6)) * [2e-3, 5e-3, 5e-3, 0.1, 0.1, 0.1]
    poses[:, 0] += 0.1
    table = columns_of(poses, spring_body().predict(poses))
    time = np.cumsum(random.uniform(0.5, 2.0, rows))
    own = {
        "time_s": time,
        "temperature_degC": 21.0 + np.sin(time / 30.0),
        HUMID: 50.0 + 8.0 * np.sin(time / 20.0),
        FAN: 1500.0 + 700.0 * np.sign(np.sin(time / 9.0)),
    }
    return Table({name: table[name] for name in names} | own, META)


@pytest.mark.parametrize("names", [(*POSE, *WRENCH), ("y_m", "theta_z_rad", "fy_N", "tau_z_Nm")])
def test_own_columns_step_in_c_as_in_a_log(names: tuple[str, ...], tmp_path: Path) -> None:
    """Scales, adds with a lag, shifts; beside an effect with a state; what is refused changes
    nothing. Of an own column nothing stepped, and the way out was one fixed value of it."""
    table = log(names)
    inputs = tuple(name for name in names if name in POSE)
    outputs = tuple(name for name in names if name in WRENCH)
    n, m = len(inputs), len(outputs)
    base = fit_model(table, "energy4" if len(names) == 12 else "cubic")
    scales = UnusedColumn(HUMID, 48.0, "scales", ",".join(outputs)), [-0.01]
    adds = UnusedColumn(FAN, 1400.0, "adds", ",".join(outputs), 7.0), np.linspace(1e-4, 3e-4, m)
    shifts = UnusedColumn(FAN, 1500.0, "shifts", ",".join(inputs), 3.0), np.full(n, 1e-6)
    warm = TemperatureModulus(21.0), [0.02]
    for i, effects in enumerate([(scales, adds, warm), (shifts, warm)]):
        _steps_as_predicted(with_effects(base, *effects), table, tmp_path / str(i))


def _steps_as_predicted(model: Model, table: Table, folder: Path) -> None:
    exported = export_files(model, "c", "neck")
    assert (exported.left_out, exported.lost) == ((), {})
    assert "scales and shifts the base alone" in str(exported.files["neck_columns.h"])
    assert "neck_columns.h adds what columns of your own do: " in str(exported)
    assert ". The control loop takes none of them. --at COLUMN=VALUE exports one" in str(exported)
    written(model, folder, "c")
    code = CompiledC(folder / "neck_columns.c", folder / "neck.c", *WARNINGS, name="neck")
    columns = [item.effect.column for item in model.effects if hasattr(item.effect, "column")]
    given = np.ascontiguousarray(table.matrix(tuple(columns)))
    poses = np.ascontiguousarray(table.matrix(model.inputs))
    n, m, expected = len(model.inputs), len(model.outputs), model.predict(table)
    state, memory, h, k = np.zeros(64), np.zeros(64), np.zeros(m), np.zeros((m, n))
    code.init(state, poses[0])
    code.columns_init(memory, given[0])
    dts = np.diff(table["time_s"], prepend=table["time_s"][0])
    for i, (pose, dt, own) in enumerate(zip(poses, dts, given, strict=True)):
        warm = np.array([table["temperature_degC"][i], 0.0])
        assert code.step(state, pose, dt, warm, h, k) == 1
        saved, slope = memory.tobytes(), k.copy()
        for wrong, lost in ((own * np.nan, h.copy()), (own, h * np.nan), (own, h + np.inf)):
            assert code.columns_add(memory, pose, wrong, dt, lost, k) == 0
            assert np.isnan(lost).all()
            assert memory.tobytes() == saved
        np.testing.assert_array_equal(k, slope)
        assert code.columns_add(memory, pose, own, dt, h, k) == 1
        np.testing.assert_allclose(h, expected[i], rtol=0.0, atol=1e-9 * np.abs(expected).max())
    assert np.abs(expected - model.base.predict(poses)).max() > 0.03 * np.abs(expected).max()


def test_a_column_that_sets_the_damping_stays_out_and_other_targets_fix_it(tmp_path: Path) -> None:
    table = log(("y_m", "fy_N"))
    static = fit_model(table, "cubic")
    damps = UnusedColumn(HUMID, 50.0, "damps", "y_m>fy_N", exponent=1.0)
    assert "damping" in str(export_files(with_effects(static, (damps, [0.1])), "c").notes)
    scaled = with_effects(static, (UnusedColumn(HUMID, 50.0, "scales", "fy_N"), [-0.01]))
    large = {"effect_shares": {f"unused_column:{HUMID}": 0.3}}
    scaled = replace(scaled, training=scaled.training | large)
    with pytest.raises(InputError) as found:
        export(scaled, "rust", tmp_path)
    assert f"--at {HUMID}=" in way_out(found.value).command
    export(scaled, "c", tmp_path)


@pytest.mark.parametrize(("name", "to"), [("energy4", "c"), ("energy4", "rust"), ("cubic", "c")])
def test_an_adapter_lacks_no_large_column_without_a_word(
    name: str, to: str, tmp_path: Path
) -> None:
    """An adapter, which takes no column, was written without it; the way out is what holds it."""
    model = fit_model(log((*POSE, *WRENCH)), name)
    scaled = with_effects(model, (UnusedColumn(HUMID, 50.0, "scales", ",".join(WRENCH)), [-0.01]))
    id = f"unused_column:{HUMID}"
    large = {"effect_shares": {id: 0.3}, "effect_sizes": {id: 9.0}}
    scaled = replace(scaled, training=scaled.training | large)
    adapt = AdaptSettings(("payload",))
    with pytest.raises(InputError, match=id) as found:
        export(scaled, to, tmp_path, adapt=adapt)
    command = way_out(found.value).command
    assert command.startswith(f"ecm export MODEL --to {to} ")
    assert f"--at {HUMID}=" in command
    said = export(scaled.at({HUMID: 48.0}), to, tmp_path, adapt=adapt).notes[-1]
    assert said.startswith("The adapter takes each reading to have noise of 0.3 N, ")
    assert said.endswith('too little ends in "diagnose" without a cause.')
