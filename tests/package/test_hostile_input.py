"""Hostile input: every public function ends, with finite numbers or an error that can be read."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from support import hostile

LIMIT_S = 300.0
"""Far above the normal time of a few seconds: only an endless call reaches it."""


@pytest.mark.parametrize("group", hostile.GROUPS)
def test_ends_with_finite_numbers_or_an_error_of_the_package(group: str) -> None:
    path = os.pathsep.join(sys.path)
    try:
        done = subprocess.run(
            [sys.executable, "-W", "error", str(Path(hostile.__file__)), group],
            check=False,
            capture_output=True,
            text=True,
            timeout=LIMIT_S,
            env={**os.environ, "PYTHONPATH": path},
        )
    except subprocess.TimeoutExpired as expired:
        output = expired.stdout or b""
        lines = (output if isinstance(output, bytes) else output.encode()).splitlines()
        pytest.fail(f"endless: {lines[-1].decode()}")
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    assert done.returncode == 0, f"{lines[-1:]}\n{done.stderr[-2000:]}"
    assert [line for line in lines if "problem" in line] == []
    assert len(lines) > 50
