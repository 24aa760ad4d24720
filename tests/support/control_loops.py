"""Exported control loops run at many poses, on softer and stiffer plants, with delays."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np

from ecm.io.arrays import F
from ecm.models import Model
from ecm.models.export import Exported
from support.exports import exported, written
from support.programs import cargo, ended, need_program

CASES = np.array(list(itertools.product((0.8, 1.2), range(4))))
"""Stiffness of the plant over the model's, and steps of delay."""
C_MAIN = """
int main(void)
{
    double told[8];
    while (fread(told, sizeof told, 1, stdin) == 1) {
        controller_t c;
        plant_t plant;
        real held[6], pose[6], wrench[6];
        double largest[2] = {0, 0};
        for (int i = 0; i < 6; i++) {
            held[i] = (real)told[i];
        }
        controller_start(&c, held);
        plant_start(&plant, &c, (real)told[6], (int32_t)told[7]);
        for (int step = 0; step < 2 * STEPS_RUN; step++) {
            plant_pose(&plant, pose);
            controller_step(&c, pose, wrench);
            plant_step(&plant, wrench, R(0));
            for (int i = 0; (step + 1) % STEPS_RUN == 0 && i < 6; i++) {
                double *most = largest + step / STEPS_RUN;
                const double e = (double)(plant.moved[i] < R(0) ? -plant.moved[i] : plant.moved[i]);
                *most = e > *most || e != e ? e : *most;
            }
        }
        fwrite(largest, sizeof largest, 1, stdout);
    }
    return 0;
}
"""
RUST_MAIN = """
fn main() -> Result<(), String> {
    let text = std::io::read_to_string(std::io::stdin()).map_err(|e| e.to_string())?;
    let numbers: Vec<f64> = text.split_whitespace().filter_map(|x| x.parse().ok()).collect();
    for told in numbers.chunks_exact(8) {
        let held: Vec6 = std::array::from_fn(|i| told[i] as REAL);
        let mut controller = Controller::new(held).ok_or("no wrench")?;
        let mut plant = Plant::new(&controller, told[6] as REAL, told[7] as usize);
        for _ in 0..2 {
            for _ in 0..STEPS_RUN {
                let wrench = controller.step(&plant.pose());
                plant.step(wrench, 0.0);
            }
            let moved = plant.moved.iter().map(|x| x.abs());
            println!("{:e}", moved.fold(0.0, |m: REAL, x| if x <= m { m } else { x }));
        }
    }
    Ok(())
}
"""


def cases_of(exported: Exported) -> F:
    """(N, 8) poses of the design, each with one of the plants and delays."""
    assert exported.loop is not None
    poses = exported.loop.poses
    return np.hstack([poses, CASES[np.arange(len(poses)) % len(CASES)]])


def exported_to(model: Model, target: str, folder: Path, precision: str = "double") -> Exported:
    """Write an export as `neck` into a folder."""
    written(model, folder, target, precision)
    return exported(model, target, precision)


def _loop(folder: Path, path: str, right: str, wrong: str) -> str:
    return (folder / path).read_text(encoding="utf-8").replace(right, wrong)


def errors_in_c(exported: Exported, folder: Path, steps: int = 1000) -> F:
    """(N, 2) distance from each held pose after half and all steps of the exported C, m and rad."""
    gcc = need_program("gcc", "cc")
    loop = _loop(folder, "neck_control.c", "int main(void)", "int example(void)")
    (folder / "many.c").write_text(loop + C_MAIN.replace("STEPS_RUN", str(steps // 2)), "utf-8")
    ended(gcc, "-std=c99", "-O2", "neck.c", "many.c", "-o", "many", cwd=folder)
    ran = ended(folder / "many", input=cases_of(exported).tobytes(), text=False)
    return np.frombuffer(ran.stdout).reshape(-1, 2)


def errors_in_rust(exported: Exported, folder: Path, steps: int = 1000) -> tuple[F, str]:
    """As `errors_in_c` of the exported crate, and what its example says."""
    loop = _loop(folder, "examples/control.rs", "fn main()", "pub fn example()")
    real = "f64" if "const DT: f64" in loop else "f32"
    many = folder / "examples" / "many.rs"
    program = RUST_MAIN.replace("REAL", real).replace("STEPS_RUN", str(steps // 2))
    many.write_text(loop + program, encoding="utf-8")
    target = folder / "target"
    cargo(folder, target, "build", "--release", "--examples")
    programs = target / "release" / "examples"
    said = ended(programs / "control")
    told = " ".join(repr(float(x)) for x in cases_of(exported).ravel())
    ran = ended(programs / "many", input=told)
    errors = np.array([float(line) for line in ran.stdout.split()])
    return errors.reshape(-1, 2), said.stdout
