"""FMPy validates and simulates both FMUs, and couples two."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import couple_fmus
import fmpy
import numpy as np
from fmpy.validation import validate_fmu

from ecm.io.columns import POSE, WRENCH
from export_tools.errors import said
from support.exports import fitted, thousand_poses, written
from support.models import with_time


def run(folder: Path) -> Iterator[str]:
    """Lines of results."""
    written(fitted("energy6"), folder, "fmu")
    poses = thousand_poses()
    times = 1e-3 * np.arange(len(poses) + 1)
    # The value at the end of a step belongs to the input at its beginning.
    signals = np.zeros(len(times), dtype=[("time", float), *((name, float) for name in POSE)])
    signals["time"] = times
    for j, name in enumerate(POSE):
        signals[name] = [*poses[:, j], poses[-1, j]]
    for version in (2, 3):
        file = folder / f"neck_fmi{version}.fmu"
        problems = validate_fmu(str(file))
        if problems:
            raise SystemExit("\n".join(problems))
        result = fmpy.simulate_fmu(
            str(file), stop_time=times[-1], step_size=1e-3, output_interval=1e-3,
            input=signals, output=list(WRENCH),
        )  # fmt: skip
        found = np.array([result[name] for name in WRENCH]).T[1 : len(poses) + 1]
        yield f"{fmpy.__version__}, FMI {version}: valid; {said(found)}"
    for name in ("energy4", "energy6"):
        written(with_time(fitted(name)), folder, "fmu", name=f"{name}_slow")
    files = [str(folder / f"{name}_slow_fmi3.fmu") for name in ("energy4", "energy6")]
    poses, rest = couple_fmus.coupled(files)
    creep = 1e3 * np.abs(poses[-1, 1] - poses[50, 1])
    if not (rest < 1e-8 and creep > 0.0):
        raise SystemExit(f"coupled: {rest} N not held, creep {creep} mm")
    yield f"two coupled FMUs hold the load to {rest:.1g} N and creep by {creep:.2g} mm"
