"""The FMU's Windows library, driven by a Windows program under wine."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from export_tools.errors import said
from support.exports import done, fitted, thousand_poses, written

WINE = next(
    (found for name in ("wine64", "wine", "/usr/lib/wine/wine64") if (found := shutil.which(name))),
    "",
)
DRIVER = Path(__file__).with_name("windows.c")


def run(folder: Path) -> Iterator[str]:
    """Lines of results."""
    written(fitted("energy6"), folder, "fmu")
    shutil.unpack_archive(folder / "neck_fmi3.fmu", folder, "zip")
    built = done("x86_64-w64-mingw32-gcc", "-O1", DRIVER, "-o", folder / "driver.exe")
    if built.returncode:
        raise SystemExit(built.stderr)
    root = ElementTree.parse(folder / "modelDescription.xml").getroot()
    lines = "\n".join(" ".join(map(repr, row)) for row in thousand_poses().tolist())
    ran = subprocess.run(
        [WINE, "driver.exe", "binaries/x86_64-windows/neck.dll", root.attrib["instantiationToken"]],
        cwd=folder, input=lines, capture_output=True, text=True, check=True, timeout=300,
        env={**os.environ, "WINEDEBUG": "-all", "WINEPREFIX": str(folder / "wine")},
    )  # fmt: skip
    version = done(WINE, "--version").stdout.strip()
    found = np.array([line.split() for line in ran.stdout.splitlines()], dtype=float)
    yield f"{version}, FMI 3 library for Windows: {said(found)}"
