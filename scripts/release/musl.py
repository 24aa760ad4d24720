"""A Python whose C library is musl, built from Debian's sources, for the wheels of musllinux."""

from __future__ import annotations

import os
import subprocess
import tarfile
from pathlib import Path

from release import debian

VERSION = "3.13"
WITHOUT = ("--without-ensurepip", "--disable-test-modules")
COMPILER = """#!/bin/sh
# As musl-gcc, but with the name of its own platform.
[ "$1" = --print-multiarch ] && { echo x86_64-linux-musl; exit; }
exec musl-gcc "$@"
"""


def build(folder: Path) -> list[str]:
    """Build a Python below a folder, and return the words that start it.

    It has what numpy and scipy import, `ctypes` and `zlib` among it, and no ssl. It runs with the
    musl of Debian 13: their wheels need 1.2.4 (relative relocations in a table of their own), and
    end without a word with the 1.2.3 of Debian 12.
    """
    program = folder / f"python/bin/python{VERSION}"
    command = [str(folder / "debian/usr/lib/x86_64-linux-musl/libc.so"), str(program)]
    if program.exists():
        return command
    apt = debian.apt(folder)
    sources = ["source", "--download-only", "zlib", f"python{VERSION}"]
    for words in (["download", "libffi-dev", "musl"], sources):
        subprocess.run([*apt, *words], cwd=folder, check=True, capture_output=True, text=True)
    debian.extract(folder, folder / "debian")
    compiler = folder / "cc"
    compiler.write_text(COMPILER, encoding="utf-8")
    compiler.chmod(0o755)
    zlib, ffi = folder / "zlib", folder / "debian/usr"
    variables = {"CC": str(compiler), "CFLAGS": "-O1 -fPIC"}
    _make(folder, "zlib", variables, ["--static", f"--prefix={zlib}"])
    variables |= {
        "CFLAGS": "-O1", "PKG_CONFIG_LIBDIR": "/nonexistent",
        "LIBFFI_CFLAGS": f"-I{ffi / 'include/x86_64-linux-gnu'}",
        "LIBFFI_LIBS": str(ffi / "lib/x86_64-linux-gnu/libffi_pic.a"),
        "ZLIB_CFLAGS": f"-I{zlib / 'include'}", "ZLIB_LIBS": str(zlib / "lib/libz.a"),
    }  # fmt: skip
    _make(folder, "python", variables, ["--quiet", f"--prefix={folder / 'python'}", *WITHOUT])
    return command


def _make(folder: Path, name: str, variables: dict[str, str], options: list[str]) -> None:
    """Unpack the sources of a Debian package, build and install them."""
    (archive,) = folder.glob(f"{name}*.orig.tar.?z")
    with tarfile.open(archive) as files:
        files.extractall(folder / f"source-{name}", filter="data")
    (source,) = (folder / f"source-{name}").iterdir()
    environment = {**os.environ, **variables}
    for words in (
        ["./configure", *options],
        ["make", "-s", f"-j{os.cpu_count() or 1}"],
        ["make", "-s", "install"],
    ):
        subprocess.run(
            words, cwd=source, env=environment, check=True, capture_output=True, text=True
        )
