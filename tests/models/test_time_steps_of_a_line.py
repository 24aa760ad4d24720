"""A table of one coordinate: its relaxation and friction step in C as Python predicts new rows."""

from __future__ import annotations

import shlex
from pathlib import Path

import numpy as np
import pytest

from ecm.effects.ageing import Ageing
from ecm.effects.motion import ViscousDamping
from ecm.errors import InputError
from ecm.io.arrays import F, rms
from ecm.io.table import as_table, read_table
from ecm.models import Expression, Model, fit_model
from ecm.models.control_loop import LoopSettings
from ecm.models.export import export, export_files
from support.campaigns import campaign
from support.cortex_m import WARNINGS
from support.exports import CompiledC
from support.models import with_effects
from support.neck import ROOT, Command, way_out
from support.one_angle import NOISE_NM, one_angle
from support.programs import ended, need_program

COLUMN = "unused_column:slider_mm"
"""An effect of a column that files do not take."""

META = ROOT / "examples" / "viscoelastic_shear.toml"


def built(model: Model, folder: Path, *, force: bool = False) -> CompiledC:
    """The exported code as a library, after its own check of the golden values."""
    export(model, "c", folder, name="line", force=force)
    check = folder / "check"
    strict = ["-std=c99", "-O2", *WARNINGS]
    ended(need_program("gcc"), *strict, folder / "line.c", folder / "line_check.c", "-o", check)
    ended(check)
    return CompiledC(folder / "line.c", *WARNINGS)


def stepped_in_c(model: Model, points: F, times: F, folder: Path) -> F:
    """Wrench of the exported code after each step."""
    assert export_files(model, "c", "line").left_out == ()
    code = built(model, folder)
    state, k, said = np.zeros(9), np.zeros(1), np.zeros((len(points), 1))
    assert code.init(state, points[:1].copy()) == 1
    steps = np.diff(times, prepend=times[0])
    for point, dt, h in zip(points[:, None], steps, said, strict=True):
        assert code.step(state, point, dt, None, h, k) == 1
    return said[:, 0]


@pytest.mark.parametrize("rate", [0.0, 1.0, 2.0])
def test_a_rate_left_out_is_stepped_as_well_in_c(
    shared_data: Path, rate: float, tmp_path: Path
) -> None:
    folder = shared_data / "viscoelastic_shear"
    table = read_table([folder / f"shear_relaxation_{n}.csv" for n in (1, 2, 5)], meta=META)
    number = table.column("run")
    train, unseen = table.select(number != rate), table.select(number == rate)
    static = fit_model(train, "poly:3")
    model = static.add("stress_relaxation").fit(train)
    said = stepped_in_c(model, unseen.column("x_m"), unseen.column("time_s"), tmp_path)
    truth = unseen.column("fx_N")

    stepped = rms(truth - said)
    assert stepped <= 1.02 * rms(truth - model.predict(unseen)[:, 0])
    assert rms(truth - static.predict(unseen)[:, 0]) > 2.8 * stepped


@pytest.mark.parametrize(
    ("kind", "effects"),
    [
        ("hysteresis", ("hysteresis",)),
        ("hysteresis:behind a play", ("hysteresis",)),
        ("hysteresis", ("stress_relaxation", "hysteresis")),
    ],
)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_loop_of_one_angle_is_stepped_in_c(
    kind: str, effects: tuple[str, ...], sign: float, tmp_path: Path
) -> None:
    """Also where the torque falls with the angle, as the robot's torque on a motor does."""
    table = one_angle(kind)
    table = table.with_columns({"tau_z_Nm": sign * table["tau_z_Nm"]})
    static = fit_model(table, "cubic")
    model = static.add(*effects).fit(table)
    time = 0.1 * np.arange(900.0)
    angle = 0.4 * np.sin(0.4 * time) * np.sin(0.09 * time + 0.4)
    said = stepped_in_c(model, angle, time, tmp_path)
    other = table.select(np.zeros(len(time), dtype=np.int64)).with_columns(
        {"theta_z_rad": angle, "time_s": time}
    )
    np.testing.assert_allclose(said, model.predict(other)[:, 0], rtol=0.0, atol=1e-9)
    first = model.predict(other.select(np.arange(200)))[:, 0]
    np.testing.assert_allclose(said[:200], first, rtol=0.0, atol=1e-9)
    assert np.abs(said - static.predict(other)[:, 0]).max() > 0.02


@pytest.mark.parametrize("kind", ["higher_degree", "dead_zone", "kink"])
def test_what_acts_on_one_angle_is_folded_into_its_polynomial(kind: str, tmp_path: Path) -> None:
    """A kink is no polynomial: the export says how far it is, and is refused beyond the noise."""
    table = one_angle(kind)
    static = fit_model(table, "cubic")
    model = static.add(kind).fit(table)
    exported = export_files(model, "c", "line")
    assert any(note.startswith("Folded into poly:") for note in exported.notes)
    if exported.folding > 1.0:
        with pytest.raises(InputError, match=r"(?s)times the measurement noise.*force=True"):
            export(model, "c", tmp_path, name="line")
    code = built(model, tmp_path, force=True)
    angles = np.linspace(-0.45, 0.45, 300)[:, None]
    said, k = np.zeros((300, 1)), np.zeros(1)
    for angle, h in zip(angles, said, strict=True):
        code.value_and_stiffness(angle, h, k)
    off, plain = rms(said - model.predict(angles)), rms(said - static.predict(angles))
    np.testing.assert_allclose(off, exported.folding * NOISE_NM, rtol=0.25, atol=0.03 * NOISE_NM)
    assert exported.folding < (0.2 if kind == "higher_degree" else 2.0)
    assert off < 0.5 * plain


def test_a_large_effect_that_a_file_cannot_hold_is_not_left_out_in_silence(tmp_path: Path) -> None:
    table = one_angle(COLUMN)
    model = fit_model(table, "cubic").add(COLUMN).fit(table)
    with pytest.raises(InputError, match=rf"{COLUMN} is .* times the measurement noise"):
        export(model, "rust", tmp_path / "refused")
    assert not (tmp_path / "refused").exists()
    exported = export(model, "rust", tmp_path / "forced", force=True)
    assert exported.left_out == (COLUMN,)
    assert any("A model fitted without it may be nearer" in note for note in exported.notes)
    small = one_angle("").with_columns({"slider_mm": table["slider_mm"]})
    model = fit_model(small, "cubic").add(COLUMN).fit(small)
    assert export(model, "rust", tmp_path / "small").lost == {}


def test_a_large_share_is_not_left_out_where_the_noise_is_unknown(tmp_path: Path) -> None:
    """Without noise the residual weighs the rows, and an effect is small against it."""
    table = one_angle(COLUMN)
    angle, slider = table["theta_z_rad"], table["slider_mm"]
    torque = table["tau_z_Nm"] * (1.0 + 0.01 * slider)
    plain = as_table({"theta_z_rad": angle, "tau_z_Nm": torque, "slider_mm": slider})
    model = fit_model(plain, "linear").add(COLUMN).fit(plain)
    assert model.noise.is_residual
    with pytest.raises(InputError, match=rf"{COLUMN} is \d+ % of the measured wrench"):
        export(model, "rust", tmp_path / "refused")
    assert not (tmp_path / "refused").exists()
    assert export(model, "rust", tmp_path / "forced", force=True).left_out == (COLUMN,)


def test_what_a_file_does_not_depend_on_is_refused_and_what_steps_is_said() -> None:
    table = one_angle("stress_relaxation")
    model = with_effects(fit_model(table, "cubic"), (Ageing(), [1e-6]))
    for stated, name in ((LoopSettings(mass_kg=2.0), "mass_kg"), (LoopSettings(dt_s=2e-3), "dt_s")):
        with pytest.raises(InputError, match=rf"\({name}\): no file of this model for --to c"):
            export_files(model, "c", loop=stated)
    assert export_files(model, "c", loop=LoopSettings()).left_out == ()
    assert export_files(model, "rust").left_out == ()
    for power, left_out in ((1.0, ()), (0.3, ("viscous_damping",))):
        damped = ViscousDamping("theta_z_rad>tau_z_Nm", power)
        exported = export_files(with_effects(fit_model(table, "cubic"), (damped, [0.1])), "c")
        assert exported.left_out == left_out
    assert any("the power 0.3 of the velocity" in note for note in exported.notes)
    neck = fit_model(campaign(seed=3), "linear")
    with pytest.raises(InputError, match=r"--delay \(delay_s\): no file of this model for"):
        export_files(neck, "mujoco", loop=LoopSettings(2.0, 0.01, delay_s=0.01))


def test_a_refusal_names_the_way_that_keeps_what_relaxes(tmp_path: Path) -> None:
    """Not the one that throws it away: C refuses no effect because OpenSim has no state. Equations
    are written as a polynomial, and step as one."""
    table = one_angle("stress_relaxation")
    cubic = fit_model(table, "cubic").add("stress_relaxation").fit(table)
    law = Expression("tau_z_Nm = a * theta_z_rad + b * theta_z_rad**3", a=2.0, b=1.5)
    own = fit_model(table, law).add("stress_relaxation").fit(table)
    for model in (cubic, own):
        with pytest.raises(InputError) as found:
            export(model, "opensim", tmp_path)
        to_c = "ecm export MODEL --to c --out OUT --name ecm_model"
        assert way_out(found.value).command == to_c
        for to in ("c", "rust"):
            assert "stress_relaxation" not in export(model, to, tmp_path / model.name / to).left_out


def test_the_way_out_of_an_export_keeps_what_was_typed(
    ecm_command: Command, tmp_path: Path
) -> None:
    """It began anew from target and name: neither mass nor precision stayed."""
    table = one_angle("kink")
    model = fit_model(table, "cubic").add("kink").fit(table)
    model.save(tmp_path / "own.json")
    typed = ["export", str(tmp_path / "own.json"), "--precision", "single", "--to", "c", "--out"]
    typed += [str(tmp_path / "files")]
    refused = ecm_command(*typed)
    assert refused.code == 2
    assert shlex.join(["ecm", *typed, "--force"]) in refused.err
    ecm_command(*typed, "--force").good()


@pytest.mark.parametrize("kind", ["jump", "growing_load"])
def test_what_follows_the_time_alone_is_exported_as_it_stood_last(
    kind: str, tmp_path: Path
) -> None:
    """The way out was a fit without it, which averages before and after into one map."""
    plain = one_angle("")
    time = plain["time_s"]
    course = np.where(time > 0.6 * time[-1], 0.1, 0.0) if kind == "jump" else 0.1 * time / time[-1]
    table = plain.with_columns({"tau_z_Nm": plain["tau_z_Nm"] + course})
    static = fit_model(table, "cubic")
    model = static.add(kind).fit(table)
    with pytest.raises(InputError) as found:
        export(model, "c", tmp_path / "refused")
    assert way_out(found.value).command.endswith(f"--at time_s={float(time[-1])!r}")
    code = built(model.at({"time_s": float(time[-1])}), tmp_path)
    h, k = np.zeros(1), np.zeros(1)
    code.value_and_stiffness(np.zeros(1), h, k)
    before = fit_model(plain, "cubic").predict(np.zeros((1, 1)))[0]
    np.testing.assert_allclose(h, before + 0.1, atol=4e-3)
