"""Tables of two to five pose columns: their relaxation and friction step as Python predicts."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ecm.effects.ageing import MullinsSoftening, TemperatureModulus, ThermalExpansion
from ecm.effects.friction import Hysteresis
from ecm.effects.motion import ViscousDamping
from ecm.effects.relaxation import StressRelaxation
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.io.table import Table
from ecm.models import Model, fit_model
from ecm.models.export import export_files
from ecm.models.expression import Expression
from ecm.models.time_effects import time_effects
from support.cortex_m import WARNINGS
from support.exports import CompiledC, written
from support.fmu import Instance
from support.models import spring_body, with_effects
from support.neck import columns_of
from support.one_angle import bouc_wen
from support.programs import cargo, ended, need_linux, need_program

PLANAR = (("x_m", "z_m", "theta_y_rad"), ("fx_N", "fz_N", "tau_y_Nm"))
SIZE = dict(zip(POSE, [4e-3] * 3 + [0.3] * 3, strict=True))
LOAD = dict(zip(WRENCH, [20.0] * 3 + [0.5] * 3, strict=True))
STEPS = """use std::io::BufRead;

fn main() {
    let mut state = None;
    for line in std::io::stdin().lock().lines() {
        let row: Vec<f64> = line.unwrap().split(' ').map(|x| x.parse().unwrap()).collect();
        let p = row[1..].try_into().unwrap();
        let state = state.get_or_insert_with(|| neck::init(&p).unwrap());
        let (h, k) = neck::step(state, &p, row[0], &neck::DEFAULT_INPUTS).unwrap();
        for x in h.iter().chain(k.as_flattened()) {
            print!("{x:e} ");
        }
        println!();
    }
}
"""


def motion(names: tuple[str, ...], rows: int, seed: int = 0) -> tuple[F, F]:
    """Times in s, not evenly spaced, and (rows, n) poses that go both ways, from zero."""
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.uniform(0.02, 0.08, rows))
    phase = rng.uniform(0.0, 6.0, (3, len(names)))
    turns = rng.uniform(0.2, 1.5, (3, len(names)))[:, None] * time[:, None] + phase[:, None]
    return time, (np.sin(turns) - np.sin(turns[:, :1])).mean(axis=0) * [SIZE[n] for n in names]


def cubic(inputs: tuple[str, ...], outputs: tuple[str, ...], sign: float = 1.0) -> Model:
    """A polynomial of columns that are coupled."""
    rng = np.random.default_rng(3)
    u = rng.uniform(-2.0, 2.0, (300, len(inputs)))
    k = rng.normal(0.0, 0.2, (len(inputs), len(outputs)))
    for j, name in enumerate(inputs):
        for i, other in enumerate(outputs):
            k[j, i] += sign * (POSE.index(name) == WRENCH.index(other))
    h = (u @ k + 0.05 * u**3 @ np.abs(k)) * [LOAD[name] for name in outputs]
    columns = dict(zip(inputs, (u * [SIZE[n] for n in inputs]).T, strict=True))
    meta = {
        "instrument": {"force_sd_N": 0.01, "torque_sd_Nm": 1e-4},
        "mechanism": {"length_m": 0.05},
    }
    table = Table(columns | dict(zip(outputs, h.T, strict=True)), meta)
    return fit_model(table, "cubic", force=sign < 0.0)


def table_of(model: Model, time: F, poses: F) -> Table:
    """A table of a motion whose wrench is that of the model alone."""
    values = np.column_stack([poses, model.base.predict(poses)])
    names = (*model.inputs, *model.outputs)
    return Table({"time_s": time} | dict(zip(names, values.T, strict=True)))


def with_memory(
    model: Model, overstress: str, pairs: str, loses: str = "", *, together: bool = False
) -> Model:
    """Two relaxing branches, and springs that slip along pairs, behind a play or together."""
    names = sorted({pair.partition(">")[0] for pair in pairs.split(",")})
    slip = ", ".join(f"{name} {0.2 * SIZE[name]}" for name in names)
    forces = [0.1 * LOAD[p.partition(">")[2].lstrip("-")] for p in pairs.split(",")]
    relaxes = StressRelaxation(
        tau_s=0.7, second_tau_s=20.0, overstress=overstress, samples="time", loses=loses
    )
    rubs = Hysteresis(of=pairs, slip=slip, play=0.0 if together else 0.3, together=together)
    made = with_effects(model, (relaxes, [0.3, 0.2]), (rubs, forces))
    mean = model.base.stiffness(motion(model.inputs, 300)[1]).mean(axis=0)
    return replace(made, training=made.training | {"of_fit": {"mean_stiffness": mean.tolist()}})


class Code:
    """The exported C of a model, after its own check of the golden values."""

    def __init__(self, model: Model, folder: Path) -> None:
        exported = export_files(model, "c", "neck")
        assert exported.left_out == ()
        written(model, folder, "c")
        strict, check = ("-std=c99", "-O2", *WARNINGS), folder / "check"
        ended(need_program("gcc"), *strict, folder / "neck.c", folder / "neck_check.c", "-o", check)
        ended(check)
        self.n, self.m = len(model.inputs), len(model.outputs)
        self.functions = CompiledC(folder / "neck.c", *WARNINGS)
        self.state = np.zeros(3 * self.n + 5 * self.m + 1)

    def init(self, pose: F) -> None:
        assert self.functions.init(self.state, pose) == 1

    def step(self, pose: F, dt: float, inputs: F | None = None) -> tuple[F, F]:
        h, k = np.zeros(self.m), np.zeros((self.m, self.n))
        assert self.functions.step(self.state, pose, dt, inputs, h, k) == 1
        return h, k

    def along(self, time: F, poses: F) -> F:
        """Wrenches of a motion from the state at rest at its first pose."""
        self.init(poses[0])
        steps = zip(poses, np.diff(time, prepend=time[0]), strict=True)
        return np.array([self.step(pose, float(dt))[0] for pose, dt in steps])

    def slope(self, pose: F, dt: float) -> F:
        """Central differences of the step, which leave the state."""
        columns, before = [], self.state.copy()
        for name, unit in zip(SIZE, np.eye(self.n), strict=False):
            ends = []
            for way in (1e-5, -1e-5):
                self.state[:] = before
                ends.append(self.step(pose + way * SIZE[name] * unit, dt)[0])
            columns.append((ends[0] - ends[1]) / (2e-5 * SIZE[name]))
        self.state[:] = before
        return np.stack(columns, axis=1)


def steps_as_predicted(model: Model, time: F, poses: F, folder: Path) -> None:
    """Exported C gives the predictions along a motion, k by differences, and no small effect."""
    code, said = Code(model, folder), []
    code.init(poses[0])
    for row, (pose, dt) in enumerate(zip(poses, np.diff(time, prepend=time[0]), strict=True)):
        slope = code.slope(pose, float(dt)) if row % 100 == 50 else None
        h, k = code.step(pose, float(dt))
        said.append(h)
        if slope is not None:
            np.testing.assert_allclose(k, slope, rtol=1e-5, atol=1e-5 * np.abs(k).max())
    predicted = model.predict(table_of(model, time, poses))
    scale = np.abs(predicted).max(axis=0)
    np.testing.assert_allclose(said / scale, predicted / scale, rtol=0.0, atol=1e-12)
    assert (np.abs(said - model.base.predict(poses)).max(axis=0) > 0.03 * scale).all()


@pytest.mark.parametrize("overstress", ["linear", "elastic"])
@pytest.mark.parametrize(
    ("columns", "pairs"),
    [
        (PLANAR, "x_m>fx_N,z_m>-fz_N,theta_y_rad>tau_y_Nm"),
        ((("theta_y_rad", "theta_z_rad"), WRENCH), "theta_y_rad>fz_N,theta_y_rad>tau_z_Nm"),
        ((POSE[:5], ("fy_N", "tau_x_Nm")), "y_m>fy_N,theta_x_rad>tau_x_Nm"),
        ((POSE[1:5], WRENCH[1:5]), "y_m>fy_N,theta_x_rad>tau_x_Nm,theta_y_rad>tau_y_Nm"),
    ],
)
def test_columns_step_in_c_as_python_predicts(
    columns: tuple[tuple[str, ...], tuple[str, ...]], pairs: str, overstress: str, tmp_path: Path
) -> None:
    model = with_memory(cubic(*columns), overstress, pairs)
    steps_as_predicted(model, *motion(columns[0], 3000, 1), tmp_path)


@pytest.mark.parametrize("pairs", ["x_m>fx_N,z_m>fz_N", "x_m>fx_N,z_m>-fz_N,theta_y_rad>tau_y_Nm"])
def test_springs_that_slip_together_step_in_c_as_python_predicts(
    pairs: str, tmp_path: Path
) -> None:
    """A coordinate that no spring holds has no part in their limit."""
    model = with_memory(cubic(*PLANAR), "linear", pairs, together=True)
    steps_as_predicted(model, *motion(PLANAR[0], 3000, 1), tmp_path)


def test_a_damper_of_columns_steps_in_c_with_the_mean_velocity(tmp_path: Path) -> None:
    """Forces of each column, and of a column on another, over the step before."""
    pairs = {"x_m>fx_N": 60.0, "z_m>-fz_N": 30.0, "theta_y_rad>tau_y_Nm": 0.02, "z_m>fx_N": 20.0}
    damper = ViscousDamping(",".join(pairs), 1.0)
    model = with_effects(cubic(*PLANAR), (damper, list(pairs.values())))
    matrix = np.array([[60.0, 20.0, 0.0], [0.0, -30.0, 0.0], [0.0, 0.0, 0.02]])
    time, poses = motion(PLANAR[0], 500, 1)
    code = Code(model, tmp_path)
    said = code.along(time, poses)
    static = model.base.predict(poses)
    rates = np.diff(poses, axis=0) / np.diff(time)[:, None]
    np.testing.assert_allclose(said[0], static[0], rtol=1e-12)
    scale = np.abs(said).max(axis=0)
    drags = (said - static)[1:]
    assert (np.abs(drags).max(axis=0) > 0.003 * scale).all()
    np.testing.assert_allclose(drags / scale, rates @ matrix.T / scale, rtol=0.0, atol=1e-12)
    slope = code.slope(poses[0], 0.03)
    np.testing.assert_allclose(
        code.step(poses[0], 0.03)[1], slope, rtol=1e-5, atol=1e-5 * np.abs(slope).max()
    )


@pytest.mark.parametrize("width", [0.0, 8.0])
@pytest.mark.parametrize("outputs", [PLANAR[1], ("tau_x_Nm", "tau_y_Nm")])
def test_wear_by_force_or_moment_steps_in_c_as_python_predicts(
    outputs: tuple[str, ...], width: float, tmp_path: Path
) -> None:
    width *= 0.05 if outputs[0] == "tau_x_Nm" else 1.0
    model = with_effects(cubic(PLANAR[0], outputs), (MullinsSoftening(load_width=width), [0.3]))
    time, poses = motion(PLANAR[0], 1000, 3)
    steps_as_predicted(model, time, poses * np.linspace(0.4, 1.0, 1000)[:, None], tmp_path)


@pytest.mark.parametrize("overstress", ["linear", "elastic"])
def test_what_resists_a_negative_stiffness_steps_with_its_sign(
    overstress: str, tmp_path: Path
) -> None:
    """As the robot's own force on a joint; where columns differ only the linear form steps."""
    loses = "x_m>fx_N,z_m>fz_N,theta_y_rad>tau_y_Nm"
    model = with_memory(cubic(*PLANAR, sign=-1.0), overstress, loses, loses)
    time, poses = motion(PLANAR[0], 400, 2)
    said = Code(model, tmp_path).along(time, poses)
    predicted = model.predict(table_of(model, time, poses))
    np.testing.assert_allclose(said, predicted, rtol=0.0, atol=1e-11 * np.abs(predicted).max())
    mixed = with_memory(cubic(*PLANAR), overstress, loses, loses)
    mean = np.diag([-5e3, 5e3, 2.0]).tolist()
    mixed = replace(mixed, training=mixed.training | {"of_fit": {"mean_stiffness": mean}})
    left_out = export_files(mixed, "c").left_out
    assert left_out == (() if overstress == "linear" else ("stress_relaxation",))


def test_the_crate_of_columns_steps_as_python_predicts(tmp_path: Path) -> None:
    model = with_memory(cubic(*PLANAR), "linear", "x_m>fx_N,z_m>-fz_N,theta_y_rad>tau_y_Nm")
    time, poses = motion(PLANAR[0], 3000, 1)
    folder = written(model, tmp_path / "crate", "rust")
    (folder / "examples").mkdir()
    (folder / "examples" / "steps.rs").write_text(STEPS)
    target = tmp_path / "target"
    assert "golden_history ... ok" in cargo(folder, target, "test", RUSTFLAGS="-D warnings")
    cargo(folder, target, "build", "--release", "--example", "steps")
    told = np.column_stack([np.diff(time, prepend=time[0]), poses])
    rows = "\n".join(" ".join(repr(float(x)) for x in row) for row in told)
    program = target / "release" / "examples" / "steps"
    said = np.loadtxt(ended(program, input=rows).stdout.splitlines())
    predicted = model.predict(table_of(model, time, poses))
    scale = np.abs(predicted).max(axis=0)
    np.testing.assert_allclose(said[:, :3] / scale, predicted / scale, rtol=0.0, atol=1e-12)
    code = Code(model, tmp_path)
    code.init(poses[0])
    in_c = np.array([code.step(row[1:], float(row[0]))[1].ravel() for row in told])
    np.testing.assert_allclose(said[:, 3:], in_c, rtol=0.0, atol=1e-9 * np.abs(in_c).max())


def test_an_fmu_of_columns_has_the_steps_and_their_stiffness(tmp_path: Path) -> None:
    need_linux()
    model = with_memory(cubic(*PLANAR), "elastic", "x_m>fx_N,z_m>fz_N,theta_y_rad>tau_y_Nm")
    time, poses = motion(PLANAR[0], 200, 4)
    fmu = Instance(written(model, tmp_path, "fmu") / "neck_fmi3.fmu", tmp_path / "fmu")
    fmu.set(PLANAR[0], poses[0])
    assert fmu.enter() == 0
    code = Code(model, tmp_path)
    code.init(poses[0])
    for pose, at, dt in zip(poses, time, np.diff(time, prepend=0.0), strict=True):
        fmu.set(PLANAR[0], pose)
        assert fmu.step(float(at - dt), float(dt)) == 0
        h, k = code.step(pose, float(dt))
        np.testing.assert_allclose(fmu.get(PLANAR[1]), h, rtol=1e-9, atol=1e-9)
        column = fmu.derivative(PLANAR[1], PLANAR[0], np.array([0.0, 0.0, 1.0]))
        np.testing.assert_allclose(column, k[:, 2], rtol=1e-9, atol=1e-6)


def test_a_plant_of_other_formulas_is_stepped_as_well_as_it_is_predicted(tmp_path: Path) -> None:
    """A planar joint with a Maxwell branch and smooth friction: fitted on one motion, stepped along
    another."""
    spring = cubic(*PLANAR)
    at_rest = spring.base.stiffness(np.zeros((1, 3)))[0]

    def plant(seed: int) -> tuple[Table, F, F]:
        time, poses = motion(PLANAR[0], 900, seed)
        pulls, drive = np.zeros((900, 3)), poses @ at_rest.T
        for i in range(1, 900):
            part = (time[i] - time[i - 1]) / 20.0
            pulls[i] = pulls[i - 1]
            for _ in range(20):
                pulls[i] = (pulls[i] + 0.02 * (drive[i] - drive[i - 1])) * np.exp(-part / 2.0)
        rubs = [bouc_wen(poses[:, j], 0.1 * SIZE[name]) for j, name in enumerate(PLANAR[0])]
        load = np.array([LOAD[name] for name in PLANAR[1]])
        wrench = spring.base.predict(poses) + pulls + 0.15 * load * np.stack(rubs, axis=1)
        wrench += 0.005 * load * np.random.default_rng(seed).standard_normal(wrench.shape)
        columns = dict(zip((*PLANAR[0], *PLANAR[1]), [*poses.T, *wrench.T], strict=True))
        instrument = {"force_sd_N": 0.1, "torque_sd_Nm": 2.5e-3}
        meta = {"file": {"kind": "continuous"}, "instrument": instrument}
        return Table({"time_s": time} | columns, meta), time, poses

    table, _, _ = plant(11)
    static = fit_model(table, "cubic")
    model = static.add("stress_relaxation", "hysteresis").fit(table)
    unseen, time, poses = plant(12)
    truth = unseen.matrix(PLANAR[1])

    def error(wrench: F) -> F:
        return np.asarray(np.sqrt(((wrench - truth) ** 2).mean(axis=0)))

    stepped = error(Code(model, tmp_path).along(time, poses))
    assert (stepped <= 1.02 * error(model.predict(unseen))).all()
    assert (error(static.predict(unseen)) > 2.0 * stepped).all()


def test_growth_and_temperature_step_by_the_unit_of_each_column(tmp_path: Path) -> None:
    """g^2 for a force, g^3 for a moment, at the position over g and the same angle."""
    alpha, beta = 3e-3, 4e-3
    model = with_effects(
        cubic(*PLANAR), (ThermalExpansion(21.0), [alpha]), (TemperatureModulus(21.0), [beta])
    )
    code, pose = Code(model, tmp_path), np.array([3e-3, -2e-3, 0.2])
    code.init(pose)
    h, k = code.step(pose, 1.0, inputs=np.array([26.0, 0.0]))
    g = 1.0 + 5.0 * alpha
    own = pose / [g, g, 1.0]
    scale = (1.0 - 5.0 * beta) * np.array([g**2, g**2, g**3])
    np.testing.assert_allclose(h, scale * model.base.predict(own[None])[0], rtol=1e-12)
    slope = scale[:, None] * model.base.stiffness(own[None])[0] / [g, g, 1.0]
    np.testing.assert_allclose(k, slope, rtol=1e-10, atol=1e-9)


def test_three_forces_of_an_energy_step_with_the_temperature(tmp_path: Path) -> None:
    """The way out was a polynomial of 252 coefficients, which errs several times as much."""
    poses = np.random.default_rng(1).uniform(-1.0, 1.0, (250, 6)) * [2e-3, *[5e-3] * 2, *[0.1] * 3]
    poses[:, 0] += 0.1
    columns = columns_of(poses, spring_body().predict(poses))
    meta = {"mechanism": {"length_m": 0.1}, "instrument": {"force_sd_N": 0.05}}
    forces = Table({name: columns[name] for name in (*POSE, *WRENCH[:3])}, meta)
    model = with_effects(fit_model(forces, "energy4"), (TemperatureModulus(21.0), [0.01]))
    code = Code(model, tmp_path)
    code.init(poses[0])
    said = [code.step(pose, 1.0, inputs=np.array([31.0, 0.0]))[0] for pose in poses]
    np.testing.assert_allclose(said, 0.9 * model.base.predict(poses), atol=0.05)
    relaxing = with_effects(model, (StressRelaxation(tau_s=0.7, overstress="elastic"), [0.3]))
    assert "polynomial" in time_effects(relaxing, "c").left_out["stress_relaxation"]


def test_equations_of_the_user_step_with_their_memory(tmp_path: Path) -> None:
    """They are written as the polynomial that is near, and a memory steps on that."""
    time, poses = motion(("x_m",), 300)
    law = Expression("fx_N = k * x_m + c * x_m**3", k=1e3, c=1e6)
    columns = {"x_m": poses[:, 0], "fx_N": 5e3 * poses[:, 0] + 2e7 * poses[:, 0] ** 3}
    static = fit_model(Table(columns, {"instrument": {"force_sd_N": 0.01}}), law)
    relaxes = StressRelaxation(tau_s=0.7, overstress="elastic", samples="time", loses="x_m>fx_N")
    steps_as_predicted(with_effects(static, (relaxes, [0.3])), time, poses, tmp_path)
