"""Octave compiles the MEX file and calls it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from export_tools.errors import said
from support.exports import done, fitted, thousand_poses, written
from support.models import with_time

SCRIPT = """
p = dlmread('poses.txt'); h = zeros(rows(p), 6);
for i = 1:rows(p), [a, K] = neck_mex(p(i, :)); h(i, :) = a'; end
dlmwrite('h.txt', h, 'delimiter', ' ', 'precision', '%.17g');
dlmwrite('k.txt', K, 'delimiter', ' ', 'precision', '%.17g');
[a, K, s] = slow_mex(p(1, :), 0, [], [22 0]);
for i = 2:50, [a, K, s] = slow_mex(p(i, :), 0.01, s, [22 0]); end
dlmwrite('slow.txt', a', 'delimiter', ' ', 'precision', '%.17g');
refused = {{single(s)}, {s(1:9)}, {}, {s, 22}, {s, single([22 0])}, {s + 1i}};
for i = 1:numel(refused)
  try, slow_mex(p(1, :), 0.01, refused{i}{:}); error('taken: %d', i);
  catch e, if isempty(strfind(e.message, 'slow: ')), disp(e.message), exit(1), end, end
end
disp(version)
"""


def run(folder: Path) -> Iterator[str]:
    """Lines of results."""
    poses, slow = thousand_poses(), with_time(fitted("energy4"))
    written(fitted("energy6"), folder, "simulink")
    written(slow, folder, "simulink", name="slow")
    np.savetxt(folder / "poses.txt", poses, fmt="%.17g")
    (folder / "run.m").write_text(SCRIPT, encoding="utf-8")
    for name in ("neck", "slow"):
        built = done("mkoctfile", "--mex", f"{name}_mex.c", f"{name}.c", cwd=folder)
        if built.returncode:
            raise SystemExit(built.stderr)
    ran = done("octave", "--norc", "-q", "run.m", cwd=folder)
    if ran.returncode:
        raise SystemExit(f"{ran.stdout}{ran.stderr}")
    yield f"{ran.stdout.strip()}: {said(np.loadtxt(folder / 'h.txt'))}"
    k = fitted("energy6").base.stiffness(poses[-1:])[0]
    np.testing.assert_allclose(np.loadtxt(folder / "k.txt"), k, rtol=1e-9, atol=1e-9 * k.max())
    controller = slow.controller()
    controller.init(poses[0])
    for i in range(50):
        h, _ = controller.step(poses[i], 0.01 * (i > 0), temperature_degC=22.0)
    np.testing.assert_allclose(np.loadtxt(folder / "slow.txt"), h, rtol=1e-9, atol=1e-9)
    yield "50 steps of time are those of Model.controller()"
