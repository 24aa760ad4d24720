"""Programs that only some tests need: found, or one named line in the summary.

With ECM_REQUIRE_PROGRAMS=1 (`.ci/run`, after installing apt.txt) a missing one fails. The scripts
of docs take the browser from here, where pytest need not be: there a missing program ends them.
"""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any


def need_program(*names: str) -> str:
    """Path of the first of these programs that is installed."""
    for name in names:
        found = shutil.which(name)
        if found is not None:
            return found
    _missing(f"{names[0]} is not installed (see apt.txt)")
    return ""


def ended(*command: object, code: int = 0, **settings: Any) -> subprocess.CompletedProcess[str]:
    """A program that has run and left this exit code."""
    asked = [str(part) for part in command]
    settings = {"capture_output": True, "text": True, "timeout": 600, **settings}
    done = subprocess.run(asked, check=False, **settings)
    assert done.returncode == code, f"{done.returncode}: {done.stdout}{done.stderr}"
    return done


def until(condition: Callable[[], object], seconds: float = 60.0) -> None:
    """Wait for what another process or thread does."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, f"it did not come in {seconds} s"
        time.sleep(0.01)


def cargo(folder: Path, target: Path, *command: object, **more: str) -> str:
    """What `cargo COMMAND` says in a folder, built into another; `more` of its environment."""
    environment = {**os.environ, "CARGO_TARGET_DIR": str(target), **more}
    done = ended(need_program("cargo"), *command, "--offline", cwd=folder, env=environment)
    return done.stdout


def need_rust_target(triple: str) -> None:
    """Skip where the Rust compiler has no library for this target."""
    asked = [need_program("rustc"), "--print", "target-libdir", "--target", triple]
    done = subprocess.run(asked, capture_output=True, text=True, check=False)
    if done.returncode != 0 or not Path(done.stdout.strip()).is_dir():
        _missing(f"Rust has no target {triple} (rustup target add {triple})")


def need_linux() -> None:
    """Skip where exported FMUs have no binary that the tests can load."""
    if (sys.platform, platform.machine()) != ("linux", "x86_64"):
        _skip("FMUs are loaded on Linux on x86-64 only")


def need_packages(*names: str) -> None:
    """Skip where a package of the group `dev` is not installed."""
    for name in names:
        if find_spec(name) is None:
            _missing(f"{name} is not installed (pip install --group dev)")


def _missing(message: str) -> None:
    if os.environ.get("ECM_REQUIRE_PROGRAMS") == "1" and "pytest" in sys.modules:
        sys.modules["pytest"].fail(message)
    _skip(message)


def _skip(message: str) -> None:
    if "pytest" not in sys.modules:
        sys.exit(message)
    sys.modules["pytest"].skip(message)
