"""Debian 13's wine in a folder, for the Python of Windows: nothing is installed.

Older ones lack random numbers and complex numbers of Windows' C library, which Rust and numpy ask
for. Wine 10 lacks the complex numbers only; mingw's stand before its library here.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

from release import debian

BUILTIN = "usr/lib/x86_64-linux-gnu/wine/x86_64-windows"
MINGW = "usr/x86_64-w64-mingw32/lib"
WORK = "work"
"""The folder of the root in which Windows' programs and their files lie; for them `Z:\\work`."""

REAL = ("cabs", "carg", "cimag", "creal")
COMPLEX = ("ccos", "ccosh", "cexp", "clog", "csin", "csinh", "csqrt", "ctan", "ctanh")


def unpack(root: Path) -> None:
    """Unpack wine and all that it needs into a folder, by apt with lists of its own."""
    packages = root.parent / "wine-packages"
    get = ["install", "--yes", "--no-install-recommends", "--download-only", "wine64"]
    command = [*debian.apt(packages), *get]
    subprocess.run(command, check=True, capture_output=True, text=True)
    debian.extract(packages / "archives", root)
    for name in ("bin", "lib", "lib64"):
        if not (root / name).exists():
            (root / name).symlink_to(f"usr/{name}")
    for name in ("proc", "dev", "tmp", WORK):
        (root / name).mkdir(exist_ok=True)
    shutil.copy(root / MINGW / "zlib1.dll", root / BUILTIN)


def add_missing(root: Path, python: Path) -> None:
    """Put the libraries that wine lacks beside a Python for Windows."""
    library = root / BUILTIN / "ucrtbase.dll"
    shutil.copy(library, root / BUILTIN / "crtwine.dll")
    shutil.copy(library, python / "crtwine.dll")
    shutil.copy(root / MINGW / "zlib1.dll", python)
    definitions, source = python / "ucrtbase.def", python / "ucrtbase.c"
    names, code = complex_numbers()
    listed = subprocess.run(
        ["x86_64-w64-mingw32-objdump", "--private-headers", library],
        check=True, capture_output=True, text=True,
    ).stdout.split("[Ordinal/Name Pointer] Table")[1]  # fmt: skip
    there = re.findall(r"^\s*\[ *\d+\].*?(\S+)$", listed, re.M)
    lines = [f'"{name}" = {names.get(name, f"crtwine.{name}")}' for name in {*there, *names}]
    definitions.write_text("\n".join(["LIBRARY ucrtbase.dll", "EXPORTS", *sorted(lines)]) + "\n")
    source.write_text("#include <complex.h>\n" + code, encoding="utf-8")
    command = ["x86_64-w64-mingw32-gcc", "-O1", "-shared", "-static-libgcc", "-o"]
    subprocess.run(
        [*command, python / "ucrtbase.dll", source, definitions], check=True, capture_output=True
    )


def complex_numbers() -> tuple[dict[str, str], str]:
    """Return the functions by their name in Windows, and their source; `l` is `double` there."""
    names, code = {}, []
    for end, kind in (("", "double"), ("f", "float")):
        z = f"{kind} _Complex"
        heads = dict.fromkeys(REAL, (kind, f"{z} a", "a"))
        heads |= dict.fromkeys(COMPLEX, (z, f"{z} a", "a"))
        heads["cpow"] = (z, f"{z} a, {z} b", "a, b")
        for name, (result, given, passed) in heads.items():
            code.append(f"{result} own_{name}{end}({given}) {{ return {name}{end}({passed}); }}\n")
            names[name + end] = f"own_{name}{end}"
    names |= {f"{name}l": names[name] for name in (*REAL, *COMPLEX, "cpow")}
    return names, "".join(code)


def command(root: Path) -> tuple[list[str], dict[str, str]]:
    """The words before a program of Windows, and the variables that wine wants."""
    enter = 'mount --rbind /proc "$0/proc"; mount --rbind /dev "$0/dev"; exec chroot "$0" "$@"'
    rights = [] if os.geteuid() == 0 else ["--map-root-user"]
    variables = {
        "WINEPREFIX": f"/{WORK}/prefix", "WINEDEBUG": "-all", "HOME": f"/{WORK}",
        "WINESERVER": "/usr/lib/wine/wineserver64",
        "WINEDLLOVERRIDES": "mscoree,mshtml=;ucrtbase=n,b",
    }  # fmt: skip
    words = ["unshare", "--mount", *rights, "sh", "-c", enter, str(root), "/usr/lib/wine/wine64"]
    return words, variables
