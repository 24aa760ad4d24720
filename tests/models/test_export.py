"""Exports: C and Rust give the golden vectors here and on a Cortex-M, and hold a platform."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from numpy.typing import NDArray

from ecm.errors import InputError
from ecm.models import Model, fit_model
from ecm.models.export import export_files
from support.campaigns import campaign
from support.neck import Done
from support.programs import need_program

F = NDArray[np.float64]
Command = Callable[..., Done]
CORTEX = Path(__file__).parent / "cortex_m"
WARNINGS = ["-Wall", "-Wextra", "-Wconversion", "-Wpedantic", "-Werror"]
BOARDS = {
    "cortex-m4": ("mps2-an386", ["-mcpu=cortex-m4", "-mfpu=fpv4-sp-d16"]),
    "cortex-m7": ("mps2-an500", ["-mcpu=cortex-m7", "-mfpu=fpv5-d16"]),
}


@pytest.fixture(scope="module")
def fitted() -> dict[str, Model]:
    table = campaign(seed=3)
    return {name: fit_model(table, name) for name in ("cubic", "energy4", "energy6")}


def written(model: Model, folder: Path, target: str, precision: str = "double") -> Path:
    files = export_files(model, target, "neck", precision).files  # type: ignore[arg-type]
    for path, text in files.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_text(text, encoding="utf-8")
    return folder


def done(*command: object, **settings: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(part) for part in command],
        capture_output=True, text=True, check=False, timeout=600, **settings,
    )  # type: ignore[call-overload,no-any-return]  # fmt: skip


@pytest.mark.parametrize("precision", ["double", "single"])
@pytest.mark.parametrize("name", ["cubic", "energy6"])
def test_the_c_loop_holds_the_platform(
    fitted: dict[str, Model], name: str, precision: str, tmp_path: Path
) -> None:
    gcc = need_program("gcc", "cc")
    folder = written(fitted[name], tmp_path, "c", precision)
    for source in ("neck_check", "neck_control"):
        program = tmp_path / source
        built = done(
            gcc, "-std=c99", "-O2", "-DTRACE", *WARNINGS,
            folder / "neck.c", folder / f"{source}.c", "-o", program,
        )  # fmt: skip
        assert built.returncode == 0, built.stderr
        ran = done(program)
        assert ran.returncode == 0, ran.stdout
    # A loop that ignores the pose must fail, or holding proves nothing.
    loop = folder / "neck_control.c"
    text = loop.read_text(encoding="utf-8")
    blind = text.replace("wrench[i] += c->stiffness[6 * i + j] * x[j]", "wrench[i] += R(0) * x[j]")
    assert blind != text
    loop.write_text(blind, encoding="utf-8")
    done(gcc, "-O2", folder / "neck.c", loop, "-o", tmp_path / "blind")
    assert done(tmp_path / "blind").returncode == 1


def test_the_rust_loop_holds_the_platform(fitted: dict[str, Model], tmp_path: Path) -> None:
    cargo = need_program("cargo")
    folder = written(fitted["energy6"], tmp_path, "rust")
    environment = {**os.environ, "CARGO_TARGET_DIR": str(tmp_path / "target")}
    ran = done(
        cargo, "run", "--release", "--offline", "--example", "control",
        cwd=folder, env=environment,
    )  # fmt: skip
    assert ran.returncode == 0, ran.stderr
    assert "4000 ms" in ran.stdout


@pytest.mark.parametrize("core", list(BOARDS))
@pytest.mark.parametrize("name", ["cubic", "energy4", "energy6"])
def test_cortex_m_gives_the_golden_vectors(
    fitted: dict[str, Model], name: str, core: str, tmp_path: Path
) -> None:
    gcc, qemu = need_program("arm-none-eabi-gcc"), need_program("qemu-system-arm")
    board, flags = BOARDS[core]
    for precision in ("single", "double"):
        folder = tmp_path / precision
        written(fitted[name], folder, "c", precision)

        def run(source: Path, *more: str, folder: Path = folder) -> str:
            program = folder / f"{source.stem}.elf"
            built = done(
                gcc, "-std=c99", "-O2", *WARNINGS, "-mthumb", "-mfloat-abi=hard", *flags, *more,
                f"-I{folder}", "-nostartfiles", "-T", CORTEX / "mps2.ld", CORTEX / "startup.c",
                folder / "neck.c", source, "-o", program,
            )  # fmt: skip
            assert (built.returncode, built.stderr) == (0, "")
            ran = done(
                qemu, "-M", board, "-nographic", "-monitor", "none", "-serial", "none",
                "-icount", "shift=0", "-semihosting-config", "enable=on,target=native",
                "-kernel", program,
            )  # fmt: skip
            assert ran.returncode == 0, ran.stderr
            return ran.stdout + ran.stderr

        run(folder / "neck_check.c")
        run(folder / "neck_control.c")
        definitions = ["-DMODEL=neck", '-DHEADER="neck.h"', '-DGOLDEN="neck_golden.h"']
        value, both = map(int, run(CORTEX / "count.c", *definitions).split())
        print(f"{name} {precision} {core}: {value} instructions h, {both} h and K")
        # With a unit for the type in hardware; by software double costs some twenty times that.
        if precision == "single" or core == "cortex-m7":
            assert 500 < value < 15_000
            assert value < both < 45_000


def test_no_heap_and_no_libm(fitted: dict[str, Model], tmp_path: Path) -> None:
    gcc, nm = need_program("gcc"), need_program("nm")
    for name, model in fitted.items():
        folder = written(model, tmp_path / name, "c")
        done(gcc, "-std=c99", "-O2", "-ffreestanding", "-c", folder / "neck.c", "-o", folder / "o")
        listed = done(nm, "--undefined-only", folder / "o").stdout.split()
        assert set(listed) <= {"U", "memcpy", "memset", "_GLOBAL_OFFSET_TABLE_"}, listed


def test_mujoco_pushes_back_with_the_linear_part(fitted: dict[str, Model], tmp_path: Path) -> None:
    exported = export_files(fitted["energy6"], "mujoco", "neck")
    text = exported.files["neck.xml"]
    assert any("Lost" in note for note in exported.notes)
    tree = ElementTree.fromstring(text)
    rest = np.array([[fitted["energy6"].base.length_m, 0, 0, 0, 0, 0]], dtype=float)
    hessian = fitted["energy6"].base.stiffness(rest, "generalised")[0]
    found = np.zeros((6, 6))
    for tendon in tree.iter("fixed"):
        row = np.array([float(joint.attrib["coef"]) for joint in tendon.iter("joint")])
        found += float(tendon.attrib["stiffness"]) * np.outer(row, row)
    np.testing.assert_allclose(found, hessian, rtol=1e-9, atol=1e-9 * np.abs(hessian).max())
    mujoco = pytest.importorskip("mujoco", reason="mujoco is not installed (extra robot)")
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    h = fitted["energy6"].base.predict(rest)[0]
    for pose in np.eye(6) * 1e-4:
        data.qpos[:] = pose
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(-data.qfrc_passive, h + hessian @ pose, rtol=1e-9, atol=1e-9)


def test_effects_of_instruments_stay_out_and_those_of_physics_are_folded_in() -> None:
    table = campaign(seed=3)
    plain = fit_model(table, "energy4")
    model = plain.add("fts_offset", "base_compliance")
    poses = table.measured().matrix(plain.inputs)[:40]
    bias, base = model.effects
    moved = replace(
        model,
        effects=(
            replace(bias, values=np.full(len(bias.values), 3.0)),
            replace(base, values=np.full(len(base.values), 1e-6)),
        ),
    )
    exported = export_files(moved, "c", "neck")
    assert exported.left_out == ("fts_offset",)
    assert any("fts_offset" in note for note in exported.notes)
    assert any("Folded" in note and "base_compliance" in note for note in exported.notes)
    changed = np.abs(moved.predict(poses) - plain.predict(poses)).max(axis=0)
    assert changed.max() > 0.01
    assert export_files(plain, "c", "neck").notes == ()


def test_the_command_writes_the_files(
    fitted: dict[str, Model], tmp_path: Path, ecm_command: Command
) -> None:
    fitted["cubic"].save(tmp_path / "m.json")
    out = tmp_path / "code"
    ran = ecm_command(
        "export", tmp_path / "m.json", "--to", "c", "--out", out, "--name", "neck",
        "--json", tmp_path / "j.json",
    )  # fmt: skip
    assert ran.code == 0, ran.err
    names = json.loads((tmp_path / "j.json").read_text(encoding="utf-8"))["files"]
    assert sorted(p.name for p in out.iterdir()) == names
    assert (out / "neck_control.c").exists()
    assert (
        ecm_command("export", tmp_path / "m.json", "--to", "c", "--out", out, "--name", "A").code
        == 2
    )
    with pytest.raises(InputError, match="lower-case"):
        export_files(fitted["cubic"], "c", "My Neck")
