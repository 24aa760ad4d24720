"""What a plain install costs: bytes to download and on disk, and the time to the first answer."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import time
import venv
from email import message_from_bytes
from pathlib import Path
from tempfile import TemporaryDirectory
from zipfile import ZipFile

from packaging.requirements import Requirement

PIP = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check"]
RUNS = 7
PYTHONS = ("3.10", "3.11", "3.12", "3.13", "3.14")
MOST_MB, MOST_COLD_S, MOST_WARM_S = 60.0, 1.0, 0.25
"""What is promised: the download on every Python, and the first answer of `ecm --help`."""


def words(wheel: Path) -> str:
    """Measure a plain install of a wheel, and return a line that says it.

    Cold means that the pages of every file of the environment and of the standard library are
    given back to the disk before (`posix_fadvise`). Processor time is told beside the time on the
    clock, because other programs lengthen only the latter; the smallest of seven runs counts.

    Raises
    ------
    RuntimeError
        A promise is not kept; the message is the line.
    """
    with TemporaryDirectory() as name:
        folder = Path(name)
        here = ".".join(map(str, sys.version_info[:2]))
        downloads = {
            python: _download(wheel, python, folder / python) for python in {*PYTHONS, here}
        }
        venv.create(folder / "env", with_pip=False)
        python = str(folder / "env/bin/python")
        put = [*PIP, "--python", python, "install", "--no-index", f"--find-links={folder / here}"]
        subprocess.run([*put, str(wheel)], check=True, capture_output=True)
        command = [str(folder / "env/bin/ecm"), "--help"]
        cold = min(_run(command, [folder / "env", Path(os.__file__).parent]) for _ in range(RUNS))
        warm = min(_run(command, []) for _ in range(RUNS))
        installed = _bytes(folder / "env") / 1e6
    sizes = ", ".join(f"{downloads[python]:.1f} MB on {python}" for python in sorted(downloads))
    line = (
        f"download {sizes}; installed {installed:.0f} MB; ecm --help cold {cold[0]:.2f} s"
        f" (processor {cold[1]:.2f}), warm {warm[0]:.2f} s ({warm[1]:.2f})"
    )
    if max(downloads.values()) > MOST_MB or cold[0] > MOST_COLD_S or warm[0] > MOST_WARM_S:
        raise RuntimeError(f"{line}; at most {MOST_MB:.0f} MB, {MOST_COLD_S} s and {MOST_WARM_S} s")
    return line


def _download(wheel: Path, python: str, folder: Path) -> float:
    """Megabytes of a wheel with its dependencies for one Python on Linux."""
    made_for = ["--only-binary=:all:", "--implementation", "cp", "--python-version", python]
    for abi in (f"cp{python.replace('.', '')}", "abi3", "none"):
        made_for += ["--abi", abi]
    for policy in ("manylinux_2_28", "manylinux_2_27", "manylinux_2_17", "manylinux2014"):
        made_for += ["--platform", f"{policy}_x86_64"]
    get = [*PIP, "download", *made_for, "--dest", str(folder), *requirements(wheel, python)]
    subprocess.run(get, check=True, capture_output=True, text=True)
    return (_bytes(folder) + wheel.stat().st_size) / 1e6


def requirements(wheel: Path, python: str) -> list[str]:
    """What a wheel needs on one Python; pip would ask for those of the Python that it runs in."""
    with ZipFile(wheel) as files:
        (name,) = (name for name in files.namelist() if name.endswith(".dist-info/METADATA"))
        lines = message_from_bytes(files.read(name)).get_all("Requires-Dist", [])
    there = {"python_version": python, "python_full_version": f"{python}.0", "extra": ""}
    found = [Requirement(line) for line in lines]
    kept = [item for item in found if item.marker is None or item.marker.evaluate(there)]
    return [f"{item.name}{item.specifier}" for item in kept]


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
