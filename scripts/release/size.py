"""What a plain install costs: bytes to download and on disk, and the time to the first answer."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import time
import venv
from pathlib import Path
from tempfile import TemporaryDirectory

RUNS = 7


def words(wheel: Path) -> str:
    """Measure a plain install of a wheel, and return a line that says it.

    Cold means that the pages of every file of the environment and of the standard library are
    given back to the disk before (`posix_fadvise`). Processor time is told beside the time on the
    clock, because other programs lengthen only the latter; the smallest of seven runs counts.
    """
    with TemporaryDirectory() as name:
        folder = Path(name)
        venv.create(folder / "env", with_pip=False)
        pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check"]
        get = [*pip, "download", "--dest", str(folder / "get"), str(wheel)]
        subprocess.run(get, check=True, capture_output=True)
        python = str(folder / "env/bin/python")
        put = [*pip, "--python", python, "install", "--no-index", f"--find-links={folder / 'get'}"]
        subprocess.run([*put, str(wheel)], check=True, capture_output=True)
        command = [str(folder / "env/bin/ecm"), "--help"]
        cold = min(_run(command, [folder / "env", Path(os.__file__).parent]) for _ in range(RUNS))
        warm = min(_run(command, []) for _ in range(RUNS))
        download, installed = (_bytes(folder / part) / 1e6 for part in ("get", "env"))
    return (
        f"download {download:.1f} MB, installed {installed:.0f} MB; ecm --help cold {cold[0]:.2f} s"
        f" (processor {cold[1]:.2f}), warm {warm[0]:.2f} s ({warm[1]:.2f})"
    )


def _bytes(folder: Path) -> int:
    return sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())


def _run(command: list[str], forget: list[Path]) -> tuple[float, float]:
    """Return seconds on the clock and of the processor, with the pages of folders given back."""
    for folder in forget:
        for file in folder.rglob("*"):
            if file.is_file():
                descriptor = os.open(file, os.O_RDONLY)
                os.posix_fadvise(descriptor, 0, 0, os.POSIX_FADV_DONTNEED)
                os.close(descriptor)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    began = time.perf_counter()
    variables = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    subprocess.run(command, check=True, capture_output=True, env=variables)
    took = time.perf_counter() - began
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return took, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
