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


def build(folder: Path) -> Path:
    """Build a Python below a folder, and return its program.

    It has what numpy and scipy import, `ctypes` among it, and neither zlib nor ssl.
    """
    program = folder / f"python/bin/python{VERSION}"
    if program.exists():
        return program
    apt = debian.apt(folder)
    for command in (["download", "libffi-dev"], ["source", "--download-only", f"python{VERSION}"]):
        subprocess.run([*apt, *command], cwd=folder, check=True, capture_output=True, text=True)
    debian.extract(folder, folder / "libffi")
    here = folder / "libffi/usr"
    flags = f"-I{here / 'include/x86_64-linux-gnu'}"
    library = here / "lib/x86_64-linux-gnu/libffi_pic.a"
    compiler = folder / "cc"
    compiler.write_text(COMPILER, encoding="utf-8")
    compiler.chmod(0o755)
    (archive,) = folder.glob("python*.orig.tar.xz")
    with tarfile.open(archive) as files:
        files.extractall(folder / "source", filter="data")
    (source,) = (folder / "source").iterdir()
    variables = {
        **os.environ, "CC": str(compiler), "CFLAGS": "-O1", "LIBFFI_CFLAGS": flags,
        "LIBFFI_LIBS": str(library), "PKG_CONFIG_LIBDIR": "/nonexistent",
    }  # fmt: skip
    for words in (
        ["./configure", "--quiet", f"--prefix={folder / 'python'}", *WITHOUT],
        ["make", "-s", f"-j{os.cpu_count() or 1}"],
        ["make", "-s", "install"],
    ):
        subprocess.run(words, cwd=source, env=variables, check=True, capture_output=True, text=True)
    return program
