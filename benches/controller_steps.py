"""Cost of a step with two relaxing branches and friction beside h and K alone, in exported C.

    .venv/bin/python benches/controller_steps.py

Both run in turns in one program, on the CPU clock; the least of 60 rounds counts.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from ecm.effects.friction import Hysteresis
from ecm.effects.relaxation import StressRelaxation
from ecm.models import fit_model
from ecm.models.export import export_files
from ecm.models.joint_fit import FittedEffect

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
from support.campaigns import campaign

PROGRAM = """#include "neck.h"
#include "neck_golden.h"
#include <stdio.h>
#include <time.h>

enum { CALLS = 16000 };

int main(void)
{
    neck_state state;
    neck_real h[6], k[36], sum = 0;
    double least[2] = {1e9, 1e9};
    neck_init(&state, neck_golden_p[0]);
    for (int round = 0; round < 120; round++) {
        const clock_t from = clock();
        for (int i = 0; i < CALLS; i++) {
            const neck_real *p = neck_golden_p[i % 16];
            if (round % 2) {
                neck_step(&state, p, (neck_real)0.001, 0, h, k);
            } else {
                neck_value_and_stiffness(p, h, k);
            }
            sum += h[0] + k[7];
        }
        const double each = (double)(clock() - from) / CLOCKS_PER_SEC / CALLS * 1e9;
        least[round % 2] = each < least[round % 2] ? each : least[round % 2];
    }
    printf("h and K %.0f ns, step %.0f ns, ratio %.2f\\n", least[0], least[1], least[1] / least[0]);
    return !(sum == sum);
}
"""


def main() -> None:
    """Print the times and their ratio for both precisions."""
    effects = [
        (StressRelaxation(0.5, "linear", 60.0, frame="middle"), [0.3, 0.2]),
        (Hysteresis("middle", 2e-3), [3e-4]),
    ]
    fitted = tuple(FittedEffect(e, np.array(v), np.full(len(v), 0.1)) for e, v in effects)
    model = replace(fit_model(campaign(seed=3), "energy6"), effects=fitted)
    for precision in ("double", "single"):
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            for path, text in export_files(model, "c", "neck", precision).files.items():
                (folder / path).write_text(text, encoding="utf-8")
            (folder / "main.c").write_text(PROGRAM, encoding="utf-8")
            build = ["gcc", "-std=c99", "-O2", "neck.c", "main.c", "-o", "main"]
            subprocess.run(build, cwd=folder, check=True)
            ran = subprocess.run([folder / "main"], check=True, capture_output=True, text=True)
            print(f"energy6 {precision}: {ran.stdout}", end="")


if __name__ == "__main__":
    main()
