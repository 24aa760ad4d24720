"""Firmware of a Cortex-M, from exported C or Rust, and QEMU that runs it."""

from __future__ import annotations

import os
import re
import shutil
from pathlib import Path

from support.neck import ROOT
from support.programs import cargo, ended, need_program, need_rust_target

CORTEX = Path(__file__).parents[1] / "models" / "cortex_m"
"""Start-up code, counts and the glue between C and Rust."""
WARNINGS = ["-Wall", "-Wextra", "-Wconversion", "-Wpedantic", "-Werror"]
COUNTED = ["-DMODEL=neck", '-DHEADER="neck.h"', '-DGOLDEN="neck_golden.h"']
THUMB = "thumbv7em-none-eabihf"
BOARDS = {
    "cortex-m4": ("mps2-an386", ["-mcpu=cortex-m4", "-mfpu=fpv4-sp-d16"]),
    "cortex-m7": ("mps2-an500", ["-mcpu=cortex-m7", "-mfpu=fpv5-d16"]),
}


def linked(folder: Path, core: str, *sources: object, level: str = "-O2") -> Path:
    """A firmware of these sources, the start-up code and `neck.h`."""
    program = folder / "firmware.elf"
    _built(
        folder, core, level, "-nostartfiles", "-Wl,--gc-sections,-z,noexecstack",
        "-T", CORTEX / "mps2.ld", CORTEX / "startup.c", *sources, "-o", program,
    )  # fmt: skip
    return program


def compiled(folder: Path, core: str, source: Path) -> Path:
    """The object of a source, for several firmwares."""
    _built(folder, core, "-O2", "-c", source, "-o", folder / "code.o")
    return folder / "code.o"


def _built(folder: Path, core: str, level: str, *arguments: object) -> None:
    built = ended(
        need_program("arm-none-eabi-gcc"), "-std=c99", level, *WARNINGS, "-mthumb", "-DQUIET",
        "-mfloat-abi=hard", *BOARDS[core][1], *COUNTED, f"-I{folder}", *arguments,
    )  # fmt: skip
    assert built.stderr == ""


def run_on_board(program: Path, core: str) -> str:
    ran = ended(
        need_program("qemu-system-arm"), "-M", BOARDS[core][0], "-nographic", "-monitor", "none",
        "-serial", "none", "-icount", "shift=0",
        "-semihosting-config", "enable=on,target=native", "-kernel", program,
    )  # fmt: skip
    return ran.stdout + ran.stderr


def stated_stack(file: Path) -> int:
    """Bytes that the code promises not to exceed."""
    found = re.search(r"at most (\d+) bytes", file.read_text(encoding="utf-8"))
    assert found is not None
    return int(found.group(1))


def rust_library(folder: Path, level: str, precision: str, *parts: str) -> Path:
    """The exported crate in `folder`/neck and the example of ecm-poly, to link with C.

    `parts` are files beside `firmware.rs` that give C more of the crate's functions. What the
    crates depend on stays compiled in the cache folder of the tests, for the next time as well;
    the sources stand there in one place, so that a build replaces that of the last time.
    """
    need_rust_target(THUMB)
    kept = Path(os.environ["ECM_CACHE"]) / "firmware"
    sources = kept / "sources"
    shutil.rmtree(sources, ignore_errors=True)
    shutil.copytree(folder / "neck", sources / "neck")
    files = [CORTEX / part for part in ("firmware.rs", *parts)]
    source = "".join(file.read_text(encoding="utf-8") for file in files)
    example = ROOT / "crates" / "ecm-poly" / "examples" / "controller.rs"
    source = source.replace("EXAMPLE", str(example))
    source = source.replace("REAL", "f32" if precision == "single" else "f64")
    (sources / "lib.rs").write_text(source, encoding="utf-8")
    manifest = (CORTEX / "firmware.toml").read_text(encoding="utf-8")
    manifest = manifest.replace("CRATES", str(ROOT / "crates"))
    (sources / "Cargo.toml").write_text(manifest, encoding="utf-8")
    shutil.copy(ROOT / "Cargo.lock", sources / "Cargo.lock")
    more = {"CARGO_PROFILE_RELEASE_OPT_LEVEL": level, "RUSTFLAGS": "-D warnings"}
    cargo(sources, kept / "target", "build", "--release", "--target", THUMB, **more)
    return Path(shutil.copy(kept / "target" / THUMB / "release" / "libfirmware.a", folder))
