"""Ten minutes of a motion never seen, stepped at 1 kHz in exported C, of a rig with hidden memory.

    .venv/bin/python benches/controller_rig.py [--minutes 10] [--seed 0 1 2] [--diagnose]

The plant is that of the simulated rig: a closed-form mechanism with two relaxing chains of section
resultants, Bouc-Wen friction and an Arrhenius modulus, formulas other than those of the effects.
One campaign, a log of ten minutes at 20 Hz, is fitted as a user does: a static model, then `refit`
with the three effects, relaxation with two branches; with `--diagnose` in rounds of `diagnose` and
`refit`, which are told of no effect. The model is exported, compiled, and told the
measured poses and temperatures of another motion. Error over noise: rms of reading less prediction
over the noise of a reading (sensor, and pose noise through the stiffness), for all components
together and for each.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ecm.diagnosis import diagnose
from ecm.effects.relaxation import StressRelaxation
from ecm.io.columns import POSE, WRENCH
from ecm.io.description import FileMeta, Instrument, Meta
from ecm.io.table import Table
from ecm.models import Model, fit_model
from ecm.models.export import export_files
from ecm.models.refit import refit
from ecm.regression.noise import Noise
from ecm.rig.physics.material import Hysteresis, Relaxation, Temperature

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
from support.stand_in import L, stiffness, wrench

F = NDArray[np.float64]
EFFECTS = (StressRelaxation(1.0, "elastic", 30.0), "hysteresis", "temperature_modulus")
ROUNDS = 5
"""The most rounds of `diagnose` and `refit`."""
POSE_SD = np.repeat([37e-6, 6e-4], 3)
WRENCH_SD = np.repeat([0.3, 0.015], 3)
NOISE = Noise(37e-6, 6e-4, 0.3, 0.015, source="declared")
PROGRAM = """#include "neck.h"
#include <stdio.h>

int main(void)
{
    neck_state state;
    double row[8], h[6], k[36];
    const neck_real rest[6] = {%(length)r, 0, 0, 0, 0, 0};
    if (!neck_init(&state, rest)) {
        return 1;
    }
    while (fread(row, sizeof row, 1, stdin) == 1) { /* dt, temperature, pose */
        neck_conditions inputs = neck_default_conditions;
        inputs.temperature_degC = row[1];
        if (!neck_step(&state, row + 2, row[0], &inputs, h, k)) {
            return 1;
        }
        fwrite(h, sizeof h, 1, stdout);
    }
    return 0;
}
"""


@dataclass(frozen=True)
class Rig:
    """The hidden physics; a part of size 0 is absent."""

    relaxation: Relaxation = field(
        default_factory=lambda: Relaxation(0.15, shares=(0.6, 0.4), times_s=(0.8, 20.0))
    )
    friction: Hysteresis = field(default_factory=lambda: Hysteresis(1e-4, yield_m=3e-3))
    temperature: Temperature = field(
        default_factory=lambda: Temperature(-0.006, reference_degC=22.0)
    )

    def wrenches(self, poses: F, time_s: F, temperature_degC: F) -> F:
        """(N, 6) wrench at the moments (N,) of one motion from a long rest."""
        elastic = wrench(poses)
        t, t0 = temperature_degC + 273.15, self.temperature.reference_degC + 273.15
        activation = t0**2 * (1.0 / t0 - self.temperature.size)
        factor = np.exp(activation * (1.0 / t - 1.0 / t0)) * t / t0
        never = np.zeros(len(poses), dtype=np.bool_)
        found: F = factor[:, None] * elastic
        found = found + self.relaxation.along(poses, elastic, time_s, never)
        if self.friction.size:
            start = np.vstack([poses[:1], poses[:-1]])
            legs = [(np.stack(pair), False) for pair in zip(start, poses, strict=True)]
            rest = stiffness(np.array([[L, 0.0, 0.0, 0.0, 0.0, 0.0]]))[0]
            found = found + self.friction.wrench(self.friction.states(legs, L), rest, L)
        return found


def motion(seconds: float, rate_Hz: float, seed: int) -> tuple[F, F, F]:
    """Time (N,), poses (N, 6) and temperature (N,): from rest into sums of sines, with holds."""
    random = np.random.default_rng([seed, 7])
    time = np.arange(1, round(seconds * rate_Hz) + 1) / rate_Hz
    # The clock of the motion stands still for some seconds now and then.
    clock = time - np.sin(2 * np.pi * time / 23.0) * 23.0 / (2 * np.pi) * 0.95
    poses = np.zeros((len(time), 6))
    ends = np.array([0.0015, 0.011, 0.011, 0.18, 0.18, 0.18])
    for j in range(6):
        for _ in range(4):
            frequency = 10.0 ** random.uniform(-1.7, -0.5)
            phase = random.uniform(0.0, 2.0 * np.pi)
            poses[:, j] += 0.55 * ends[j] * np.sin(2.0 * np.pi * frequency * clock + phase)
    poses[:, 5] += 8.0 * poses[:, 1]
    poses[:, 4] -= 8.0 * poses[:, 2]
    bend = (poses[:, 1:3] / 0.05) ** 2
    poses[:, 0] += L - 0.0015 - 0.125 * L * bend.sum(axis=1)
    rest = np.array([L, 0.0, 0.0, 0.0, 0.0, 0.0])
    begun = np.minimum(1.0, time / 2.0)[:, None]
    poses = rest + begun**2 * (3.0 - 2.0 * begun) * (poses - rest)
    kelvin = 22.0 + 3.0 * np.sin(2.0 * np.pi * (time / 540.0 + random.uniform()))
    return time, poses, kelvin


def readings(rig: Rig, seconds: float, rate_Hz: float, seed: int, fine: int = 1) -> Table:
    """A log at this rate of a motion that is simulated `fine` times as finely."""
    time, poses, kelvin = motion(seconds, rate_Hz * fine, seed)
    h = rig.wrenches(poses, time, kelvin)
    rows = slice(fine - 1, None, fine)
    random = np.random.default_rng([seed, 8])
    poses = poses[rows] + POSE_SD * random.standard_normal(poses[rows].shape)
    h = h[rows] + WRENCH_SD * random.standard_normal(h[rows].shape)
    columns = {"time_s": time[rows], "temperature_degC": kelvin[rows]}
    columns |= dict(zip(POSE, poses.T, strict=True)) | dict(zip(WRENCH, h.T, strict=True))
    meta = Meta(
        file=FileMeta(kind="continuous"), mechanism={"length_m": L},
        instrument=Instrument(*NOISE.parameters().tolist()),
    )  # fmt: skip
    return Table(columns, meta, f"motion {seed}")


def identified(log: Table) -> tuple[Model, Model]:
    """The static model of a campaign, and the model with the effects of time."""
    static = fit_model(log, "energy6")
    return static, refit(static, log, add=EFFECTS)


def diagnosed(log: Table, seed: int) -> tuple[Model, Model]:
    """The same models, the second with what `diagnose` names until it names nothing new."""
    static = model = fit_model(log, "energy6")
    for _ in range(ROUNDS):
        found = diagnose(model, log, seed=seed)
        print(f"  {found.sentence()}", flush=True)
        named = {members[0] for members in found.answer} - {item.id for item in model.effects}
        add = [item.effect for item in found.effects if item.id in named]
        if not add:
            break
        model = refit(model, log, add=add)
    return static, model


def stepped_in_c(model: Model, log: Table, folder: Path) -> F:
    """(N, 6) wrenches of the exported steps along a log."""
    for path, text in export_files(model, "c", "neck").files.items():
        (folder / path).write_text(text, encoding="utf-8")
    (folder / "main.c").write_text(PROGRAM % {"length": L}, encoding="utf-8")
    build = ["gcc", "-std=c99", "-O2", "neck.c", "main.c", "-o", "main"]
    subprocess.run(build, cwd=folder, check=True)
    steps = np.diff(log.column("time_s"), prepend=0.0)
    told = np.column_stack([steps, log.column("temperature_degC"), log.poses])
    said = subprocess.run(
        [folder / "main"], input=told.tobytes(), capture_output=True, check=True
    ).stdout
    return np.frombuffer(said).reshape(-1, 6)


def over_noise(error: F, log: Table, static: Model) -> tuple[float, F]:
    """Error over noise of all components and of each."""
    some = log.poses[:: max(1, len(log) // 2000)]
    noise = np.sqrt(np.einsum("njj->nj", NOISE.covariance(static.rows_at(some))))
    each = np.sqrt((error**2).mean(axis=0) / (noise**2).mean(axis=0))
    return float(np.sqrt((each**2).mean())), each


def main() -> None:
    """Print error over noise of the static model, of the stepped model, and of the truth."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--rate", type=float, default=1000.0, help="steps a second")
    parser.add_argument("--seed", type=int, nargs="+", default=[0])
    parser.add_argument("--diagnose", action="store_true", help="let `diagnose` name the effects")
    parser.add_argument("--without", choices=("relaxation", "friction", "temperature"))
    options = parser.parse_args()
    rig = Rig()
    if options.without:
        part = getattr(rig, options.without)
        changed = part.resized(0.0) if options.without != "temperature" else part.resized(1e-12)
        rig = Rig(**{**rig.__dict__, options.without: changed})
    names = " ".join(name.rsplit("_", 1)[0] for name in WRENCH)
    for seed in options.seed:
        print(f"seed {seed}", flush=True)
        log = readings(rig, 600.0, 20.0, 2 * seed, fine=5)
        static, model = diagnosed(log, seed) if options.diagnose else identified(log)
        print(model.fit_report())
        fast = readings(rig, 60.0 * options.minutes, options.rate, 2 * seed + 1)
        with tempfile.TemporaryDirectory() as name:
            found = stepped_in_c(model, fast, Path(name))
        print(f"error over noise, {options.minutes:g} min at {options.rate:g} Hz: all, {names}")
        for label, said in (("static model", static.predict(fast.poses)), ("stepped in C", found)):
            whole, each = over_noise(fast.wrenches - said, fast, static)
            print(f"  {label}: {whole:.3f}  " + " ".join(f"{x:.2f}" for x in each), flush=True)


if __name__ == "__main__":
    main()
