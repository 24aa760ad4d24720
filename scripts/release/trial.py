"""An archive as a user gets it: installed in a new environment, and used.

    python -m release.trial dist/ecm_stiffness-0.1.0-cp310-abi3-manylinux_2_28_x86_64.whl

Needs nothing but Python. A wheel must do without a compiler: on Linux and macOS none is in reach.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import venv
from pathlib import Path
from tempfile import TemporaryDirectory

USE = Path(__file__).with_name("use.py")
"""What is done with the installed package, also on foreign machines."""


def try_archive(archive: Path) -> str:
    """Install a wheel, or a source archive with the compiler of this machine, and use it.

    Returns
    -------
    str
        What `use.py` printed.

    Raises
    ------
    RuntimeError
        The installation, a command or a figure failed.
    """
    archive = archive.resolve()
    with TemporaryDirectory() as name:
        folder = Path(name)
        venv.create(folder / "env", with_pip=True)
        programs = folder / "env" / ("Scripts" if os.name == "nt" else "bin")
        within_reach = os.environ["PATH"]
        if archive.suffix == ".whl" and os.name != "nt":
            within_reach = "/usr/bin:/bin"
        variables = {**os.environ, "PATH": os.pathsep.join([str(programs), within_reach])}
        variables.pop("PYTHONPATH", None)  # only what is installed counts
        for program, *arguments in (
            ["python", "-m", "pip", "install", "--quiet", str(archive)],
            ["ecm", "--version"],
            ["ecm", "--help"],
            ["ecm", "new", "data", "--out", "mine.csv"],
            ["ecm", "check", "mine.csv"],
            ["python", str(USE)],
        ):
            command = [str(programs / program), *arguments]
            done = subprocess.run(
                command, cwd=folder, env=variables, capture_output=True, text=True, check=False
            )
            if done.returncode != 0:
                raise RuntimeError(f"{' '.join(command)}\n{done.stdout}{done.stderr}")
        return done.stdout


def main() -> int:
    """Try the archives that are named."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("archive", type=Path, nargs="+")
    for archive in parser.parse_args().archive:
        try:
            print(f"{archive.name}\n{try_archive(archive)}")
        except RuntimeError as error:
            print(error, file=sys.stderr)
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
