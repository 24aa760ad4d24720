"""Wheels of one target, with the platform tag that is promised.

    python -m release.wheels aarch64-unknown-linux-musl --out dist

The C library of Linux wheels is that of zig, so that one machine builds for old systems and for
both processors. Windows (MSVC) and macOS are built on their own systems.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).parents[2]


@dataclass(frozen=True)
class Target:
    """How a wheel is built and what its file name ends in."""

    tag: str
    arguments: tuple[str, ...] = ()
    audited: bool = False
    """Whether auditwheel knows its rules (Linux)."""


def _linux(policy: str, processor: str) -> Target:
    return Target(f"{policy}_{processor}", ("--zig", "--compatibility", policy), audited=True)


TARGETS = {
    "x86_64-unknown-linux-gnu": _linux("manylinux_2_28", "x86_64"),
    "aarch64-unknown-linux-gnu": _linux("manylinux_2_28", "aarch64"),
    "x86_64-unknown-linux-musl": _linux("musllinux_1_2", "x86_64"),
    "aarch64-unknown-linux-musl": _linux("musllinux_1_2", "aarch64"),
    "aarch64-apple-darwin": Target("macosx_11_0_arm64"),
    "x86_64-apple-darwin": Target("macosx_10_12_x86_64"),
    "x86_64-pc-windows-msvc": Target("win_amd64"),
    # Not published: shows on Linux that the sources build for Windows.
    "x86_64-pc-windows-gnu": Target("win_amd64"),
}


def build(target: str, out: Path) -> Path:
    """Build the wheel of a target into a folder, and check the name it got.

    Raises
    ------
    RuntimeError
        The build failed, or auditwheel finds symbols or libraries beyond the tag.
    """
    wanted = TARGETS[target]
    out.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=out) as folder:
        command = ["maturin", "build", "--release", "--locked", "--target", target]
        command += ["--compression-level", "9"]
        _run([*command, *wanted.arguments, "--out", folder])
        (wheel,) = Path(folder).glob("*.whl")
        if not wheel.stem.endswith(f"-abi3-{wanted.tag}"):
            raise RuntimeError(f"{wheel.name} was built, a wheel of {wanted.tag} is promised")
        if wanted.audited:
            audit(wheel)
        return wheel.replace(out / wheel.name)


def audit(wheel: Path) -> None:
    """Check that a Linux wheel keeps the tag of its file name; for musl, needs its C library alone.

    Raises
    ------
    RuntimeError
        It needs newer symbols or other libraries; the message is auditwheel's.
    """
    command = [sys.executable, "-m", "auditwheel", "show", str(wheel)]
    promised = wheel.stem.split("-")[-1]
    expected = f'consistent with the following platform tag: "{promised}"'
    if promised.startswith("musllinux"):
        # zig's musl is called libc.so, which musl's loader takes for itself, and auditwheel expects
        # Alpine's name of it. This machine's libc.so is glibc's, a text: it must not be found.
        command += ["--ldpaths", str(wheel.parent / "none")]
        expected = 'shared libraries are required by the wheel: { "libc.so": null }'
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    words = " ".join(done.stdout.split())
    if expected not in words:
        raise RuntimeError(f"{wheel.name}: {words}{done.stderr}")


def _run(command: list[str]) -> None:
    # Stripped anyway, so without debug information; in one unit each crate becomes smaller.
    smaller = {"CARGO_PROFILE_RELEASE_DEBUG": "false", "CARGO_PROFILE_RELEASE_CODEGEN_UNITS": "1"}
    variables = {**os.environ, **smaller}
    done = subprocess.run(
        command, cwd=ROOT, env=variables, capture_output=True, text=True, check=False
    )
    if done.returncode != 0:
        raise RuntimeError(f"{' '.join(command)}\n{done.stdout}{done.stderr}")


def main() -> int:
    """Build and check one wheel."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("target", choices=sorted(TARGETS))
    parser.add_argument("--out", type=Path, default=ROOT / "dist")
    options = parser.parse_args()
    try:
        print(build(options.target, options.out))
    except RuntimeError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
