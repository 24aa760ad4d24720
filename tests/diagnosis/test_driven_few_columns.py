"""A bellows with one pressure: what its pressure does wrong is named from one force, too."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import ecm
from ecm.diagnosis.procedure import find_missing
from ecm.effects.protocol import ABSORBED
from ecm.effects.relaxation import play
from ecm.io.arrays import F
from ecm.models import Model

REST_M, FORCE_SD_N = 0.06, 0.02


def force(x: F, pressure: F) -> F:
    """N of a bellows that stiffens, and whose section grows as it is stretched."""
    stretch = x - REST_M
    return 900.0 * stretch + 4e5 * stretch**3 - (3.1e-4 + 1.2e-3 * stretch) * pressure


def fitted(x: F, time_s: F, recorded: F, acts: F, **more: F) -> tuple[Model, ecm.Table]:
    """A cubic of the rows that a force sensor reads under the pressure that acts, and the rows."""
    noise = FORCE_SD_N * np.random.default_rng(1).standard_normal(len(x))
    columns = {"time_s": time_s, "x_m": x, "pressure_1_Pa": recorded, "fx_N": force(x, acts)}
    meta = {"instrument": {"force_sd_N": FORCE_SD_N, "pose_position_sd_m": 1e-7}}
    table = ecm.Table(columns | {"fx_N": columns["fx_N"] + noise} | more, meta)
    return ecm.fit(table, "cubic"), table


def at_rest(rows: int = 240) -> tuple[F, F, F]:
    """Lengths, times and pressures that go up and down, a few kPa a row."""
    random = np.random.default_rng(2)
    turns = random.uniform(0.0, 3e4, 34) + np.arange(34) % 2 * 3e4
    pressure = np.interp(np.arange(rows), np.linspace(0, rows - 1, len(turns)), turns)
    return REST_M + random.uniform(-0.008, 0.015, rows), 4.0 * np.arange(rows), pressure


def stream(rows: int = 1500) -> tuple[F, F, F]:
    """The same in motion, every 0.05 s, with steps of the pressure."""
    time = 0.05 * np.arange(rows)
    x = REST_M + 0.004 + 0.009 * np.sin(time / 2.75) + 0.002 * np.sin(time / 0.46)
    return x, time, 2.5e4 + 1.8e4 * np.sin(time / 0.81) + 6e3 * np.sign(np.sin(time / 1.86))


def late(values: F, tau_s: float, step_s: float = 0.05) -> F:
    """What a first-order lag makes of them."""
    out, share = values.copy(), -np.expm1(-step_s / tau_s)
    for i in range(1, len(values)):
        out[i] = out[i - 1] + share * (values[i] - out[i - 1])
    return out


def narrow_loop() -> tuple[Model, ecm.Table]:
    """Play of the valve, a thirtieth of the largest pressure."""
    x, time, recorded = at_rest()
    return fitted(x, time, recorded, play(recorded[:, None], 1800.0)[:, 0])


def leak() -> tuple[Model, ecm.Table]:
    x, time, recorded = at_rest()
    dwell = np.random.default_rng(3).choice([2.0, 10.0, 40.0], len(x))
    return fitted(x, 15.0 * time, recorded, recorded * (1.0 - 4e-3 * dwell), dwell_s=dwell)


def valve() -> tuple[Model, ecm.Table]:
    x, time, asked = stream()
    return fitted(x, time, asked, late(asked, 0.2))


def gauge() -> tuple[Model, ecm.Table]:
    x, time, acts = stream()
    return fitted(x, time, late(acts, 0.2), acts)


@pytest.mark.parametrize(
    ("read", "name", "size"),
    [
        (narrow_loop, "pressure_hysteresis", 1800.0),
        (leak, "chamber_leak", 4e-3),
        (valve, "regulator_lag", 1.0),
        (gauge, "regulator_lag", -1.0 / np.expm1(0.05 / 0.2)),
    ],
)
def test_what_a_pressure_does_wrong_is_named_along_one_axis(
    read: Callable[[], tuple[Model, ecm.Table]], name: str, size: float
) -> None:
    model, table = read()
    found = ecm.diagnose(model, table)
    assert found.answer == ((name,),)
    assert found.effects[0].values[0] == pytest.approx(size, rel=0.1)
    late = name == "regulator_lag" and size < 0.0
    assert found.directions == (
        {name: "the gauge lags behind the pressure that acts"} if late else None
    )
    assert ("the gauge lags" in found.summary().missing) == late
    better = ecm.refit(model, table, add=[name])
    before, after = (
        float(np.std(one.predict(table)[:, 0] - table["fx_N"])) for one in (model, better)
    )
    assert after < 0.2 * before


def test_a_pressure_that_acts_as_recorded_lacks_nothing() -> None:
    for x, time, recorded in (at_rest(), stream()):
        model, table = fitted(x, time, recorded, recorded)
        assert find_missing(model, table).verdict == "none"


def test_a_gauge_of_a_wrong_gain_is_taken_in_by_a_polynomial() -> None:
    x, time, recorded = at_rest()
    model, table = fitted(x, time, recorded, recorded / 1.1)
    found = find_missing(model, table)
    assert found.verdict == "none"
    why = found.not_testable["pressure_gain"]
    assert why.reason.startswith("the base absorbs it")
    assert why.record.endswith("a gauge of known zero and gain")
    hidden = [one for one in found.not_testable.values() if one.reason.startswith(ABSORBED)]
    said = str(ecm.diagnose(model, table))
    assert f"of which the base takes in {len(hidden)} (" in said


def test_the_slope_along_the_pressure_is_written_beside_that_along_the_pose() -> None:
    x, time, recorded = at_rest()
    model, table = fitted(x, time, recorded, recorded)
    written = ecm.predict(model, table, stiffness="partial")
    whole = model.stiffness(table)[:, 0]
    np.testing.assert_array_equal(written["k_fx_x"], whole[:, 0])
    np.testing.assert_array_equal(written["g_fx_pressure_1"], whole[:, 1])
    np.testing.assert_allclose(whole[:, 1], -3.1e-4 - 1.2e-3 * (x - REST_M), rtol=0.05)


def test_a_file_takes_the_pressure_that_acts(tmp_path: Path) -> None:
    model, table = leak()
    better = ecm.refit(model, table, add=["chamber_leak"])
    with pytest.raises(ecm.InputError, match="the inputs of files are those that act") as refused:
        ecm.export(better, "c", tmp_path)
    assert "where the controller computes what acts" in str(refused.value.remedy)
