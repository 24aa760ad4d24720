"""Exports in their real programs: the model at a thousand poses, and what else each must do.

    .venv/bin/python benches/export_targets.py                every program that is found
    .venv/bin/python benches/export_targets.py --need drake   fails where it is missing

Programs: fmpy, opensim, drake, cyclonedds (pip; with rosbags); octave with mkoctfile; wine64 with
x86_64-w64-mingw32-gcc. Any Python with numpy and scipy that has them can run this file
(PYTHONPATH=python). MuJoCo, Pinocchio and rosbags are tested by the project's own tests.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

ROOT = Path(__file__).parent.parent
sys.path[:0] = [str(ROOT / "tests"), str(ROOT / "examples"), str(ROOT / "benches")]


def octave_found() -> bool:
    return bool(shutil.which("octave") and shutil.which("mkoctfile"))


def wine_found() -> bool:
    from export_tools.wine import WINE  # noqa: PLC0415 - as the others, only where it is asked for

    return bool(WINE and shutil.which("x86_64-w64-mingw32-gcc"))


def module_found(name: str) -> Callable[[], bool]:
    return lambda: find_spec(name) is not None


TOOLS: dict[str, Callable[[], bool]] = {
    "fmpy": module_found("fmpy"),
    "wine": wine_found,
    "opensim": module_found("opensim"),
    "octave": octave_found,
    "drake": module_found("pydrake"),
    "cyclonedds": module_found("cyclonedds"),
}
"""How each program is found; what is done with it is `export_tools/NAME.py`."""


def main() -> int:
    """Run every program that is found; 1 where one that is needed is missing."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--need", nargs="*", default=[], choices=[*TOOLS, "all"])
    asked = parser.parse_args().need
    needed = list(TOOLS) if "all" in asked else asked
    missing = [name for name in needed if not TOOLS[name]()]
    for name, found in TOOLS.items():
        if not found():
            print(f"{name:12}not found", flush=True)
            continue
        with tempfile.TemporaryDirectory() as folder:
            for line in import_module(f"export_tools.{name}").run(Path(folder)):
                print(f"{name:12}{line}", flush=True)
    if missing:
        print(f"missing: {', '.join(missing)}")
    return int(bool(missing))


if __name__ == "__main__":
    sys.exit(main())
