"""Exports: C and Rust give the golden vectors here and on a Cortex-M, and hold a platform."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from ecm.cli.app import load_command
from ecm.effects.relaxation import StressRelaxation
from ecm.errors import InputError
from ecm.io.columns import POSE, WRENCH
from ecm.io.se3 import poses_of
from ecm.io.table import as_table
from ecm.models import fit_model
from ecm.models.controller import AdaptSettings
from ecm.models.export import TARGETS, export_files
from ecm.models.measured_poses import reach_of
from support.campaigns import campaign
from support.cortex_m import (
    BOARDS,
    CORTEX,
    WARNINGS,
    compiled,
    linked,
    run_on_board,
    rust_library,
    stated_stack,
)
from support.exports import CompiledC, adapter_library, fitted, written
from support.models import BRANCHES, with_effects, with_time
from support.neck import ROOT, Command
from support.programs import cargo, ended, need_program


@pytest.mark.parametrize("precision", ["double", "single"])
@pytest.mark.parametrize("name", ["cubic", "energy6"])
def test_the_c_loop_holds_the_platform(name: str, precision: str, tmp_path: Path) -> None:
    gcc = need_program("gcc", "cc")
    folder = written(fitted(name), tmp_path, "c", precision)
    for source in ("neck_check", "neck_control"):
        program = tmp_path / source
        sources = folder / "neck.c", folder / f"{source}.c"
        ended(gcc, "-std=c99", "-O2", *WARNINGS, *sources, "-o", program)
        ran = ended(program)
    assert "margins: gain times" in ran.stdout
    assert "held: the push moved the platform" in ran.stdout
    # The weight is fed forward: before the push nothing has moved.
    before = re.search(r"  500 ms: largest error (\S+) ", ran.stdout)
    assert before is not None
    assert float(before[1]) < 2e-6
    # A loop that ignores the pose, or whose commands come late, must fail and say why.
    loop = folder / "neck_control.c"
    text = loop.read_text(encoding="utf-8")
    broken = {
        "mass * (y[i] - gravity[i]) : inertia * moment[i - 3]": ("R(0) : R(0)", "the held pose"),
        "DELAY_STEPS = 3 ": ("DELAY_STEPS = 12 ", "The loop is unstable"),
    }
    for right, (wrong, reason) in broken.items():
        assert right in text
        loop.write_text(text.replace(right, wrong), encoding="utf-8")
        ended(gcc, "-O2", folder / "neck.c", loop, "-o", tmp_path / "wrong")
        ran = ended(tmp_path / "wrong", code=1)
        assert "not held: after" in ran.stdout
        assert reason in ran.stdout


@pytest.mark.parametrize("precision", ["double", "single"])
def test_the_loop_waits_for_what_relaxes_slowly(precision: str, tmp_path: Path) -> None:
    """The softer platform relaxes otherwise than the model, for longer than a push is felt."""
    gcc = need_program("gcc", "cc")
    slow = with_effects(fitted("energy4"), (StressRelaxation(8.0, "linear", frame="middle"), [1.0]))
    folder = written(slow, tmp_path, "c", precision)
    ended(gcc, "-O2", folder / "neck.c", folder / "neck_control.c", "-o", tmp_path / "loop")
    ended(tmp_path / "loop")


@pytest.mark.parametrize("core", list(BOARDS))
@pytest.mark.parametrize("name", ["cubic", "energy4", "energy6"])
def test_cortex_m_gives_the_golden_vectors(name: str, core: str, tmp_path: Path) -> None:
    for precision in ("single", "double"):
        folder = written(fitted(name), tmp_path / precision, "c", precision)
        code = compiled(folder, core, folder / "neck.c")
        for source in ("neck_check.c", "neck_control.c"):
            run_on_board(linked(folder, core, code, folder / source), core)
        for level in ("-O0", "-O3", "-O2"):
            own = code if level == "-O2" else folder / "neck.c"
            program = linked(folder, core, own, CORTEX / "count.c", level=level)
            least, value, stack, low, both, deep = map(int, run_on_board(program, core).split())
            stated = stated_stack(folder / "neck.h")
            assert 0.3 * stated < max(stack, deep) <= stated, level
        print(f"{name} {precision} {core}: {value} instructions h, {both} h and K, stack {deep} B")
        # With a unit for the type in hardware; by software double costs some twenty times that.
        if precision == "single" or core == "cortex-m7":
            assert 500 < value < 15_000
            assert value < both < 45_000
            # The time does not depend on the pose; ten calls are counted in steps of 40.
            assert value - least <= 8
            assert both - low <= 8


def test_steps_on_a_cortex_m_give_the_golden_history_in_c_and_rust(tmp_path: Path) -> None:
    core, model = "cortex-m4", with_time(fitted("energy6"))
    folder = written(model, tmp_path, "c", "single")
    run_on_board(linked(folder, core, folder / "neck.c", folder / "neck_check.c"), core)
    written(model, folder / "neck", "rust", "single")
    library = rust_library(folder, "3", "single", "steps.rs")
    run_on_board(linked(folder, core, folder / "neck_check.c", library), core)
    header, lib = folder / "neck.h", folder / "neck" / "src" / "lib.rs"
    stated = {
        ".c": re.findall(r"step: at most (\d+) bytes; predict_ahead (\d+)", header.read_text())[0],
        ".a": re.findall(r"Stack: at most (\d+)", lib.read_text())[-2:],
    }
    for code in (folder / "neck.c", library):
        program = linked(folder, core, "-DSTEPS", CORTEX / "count.c", code)
        counted = [int(part) for part in run_on_board(program, core).split()]
        static, step, stack = counted[4], counted[7], counted[8]
        print(f"energy6 single {code.suffix}: h and K {static}, step {step}, stack {stack} B")
        assert step < 1.5 * static
        for deep, limit in zip((stack, counted[11]), stated[code.suffix], strict=True):
            assert 0.3 * int(limit) < deep <= int(limit)


@pytest.mark.parametrize("precision", ["single", "double"])
@pytest.mark.parametrize("name", ["cubic", "energy6"])
def test_rust_on_a_cortex_m_gives_the_golden_vectors_of_the_c(
    name: str, precision: str, tmp_path: Path
) -> None:
    core = "cortex-m4"
    folder = written(fitted(name), tmp_path, "c", precision)
    written(fitted(name), tmp_path / "neck", "rust", precision)
    library = rust_library(folder, "3", precision)
    run_on_board(linked(folder, core, folder / "neck_check.c", library), core)
    run_on_board(linked(folder, core, CORTEX / "example.c", library), core)
    counted = run_on_board(linked(folder, core, CORTEX / "count.c", library), core)
    least, value, stack, low, both, deep = map(int, counted.split())
    print(f"{name} {precision} Rust: {value} instructions h, {both} h and K, stack {deep} B")
    if precision == "single":
        assert value - least <= 8
        assert both - low <= 8
    assert max(stack, deep) <= stated_stack(folder / "neck" / "src" / "lib.rs")


@pytest.mark.parametrize("level", ["0", "1", "3", "s"])
def test_rust_in_single_precision_has_no_double_arithmetic(level: str, tmp_path: Path) -> None:
    nm = need_program("arm-none-eabi-nm")
    double = re.compile(r"__aeabi_(d|\w+2d)|__\w+df|__extendsf")
    found = {}
    for precision in ("single", "double") if level == "3" else ("single",):
        folder = written(fitted("energy4"), tmp_path / precision, "c", precision)
        written(fitted("energy4"), folder / "neck", "rust", precision)
        library = rust_library(folder, level, precision)
        program = linked(folder, "cortex-m4", folder / "neck_check.c", library)
        found[precision] = double.findall(ended(nm, program).stdout)
    assert found.pop("single") == []
    assert all(found.values())


def test_inside_is_the_range_of_the_training_data(tmp_path: Path) -> None:
    for name in ("cubic", "energy6"):
        folder = written(fitted(name), tmp_path / name, "c")
        inside = CompiledC(folder / "neck.c").inside
        poses = campaign(seed=3).measured().poses
        assert {inside(pose) for pose in poses} == {1}
        farthest = poses[np.argmax(np.abs(poses[:, 4]))]
        beyond = np.where(np.arange(6) == 4, 2.0, 1.0) * farthest
        assert [inside(beyond), inside(np.full(6, np.nan))] == [0, 0]
        # The code is the reach of the measured poses, whose corners no load reaches.
        reach = reach_of(fitted(name), fitted(name).base)
        assert reach is not None
        shares = np.random.default_rng(5).uniform(-0.1, 1.1, (2000, 6))
        x = reach.low + shares * (reach.high - reach.low)
        asked = x if name == "cubic" else poses_of(x, fitted(name).known_length_m or 0.0)
        expected = reach.contains(x)
        assert 20 < expected.sum() < 1000
        np.testing.assert_array_equal([inside(pose) for pose in asked], expected)


@pytest.mark.parametrize("compiler", ["clang", "gcc"])
def test_no_compiler_warns_of_the_code(compiler: str, tmp_path: Path) -> None:
    cc = need_program(compiler)
    for name, precision in (("cubic", "single"), ("energy4", "double"), ("time", "single")):
        model = with_time(fitted("energy4")) if name == "time" else fitted(name)
        adapt = AdaptSettings(("modulus", "payload", "zero"))
        folder = written(model, tmp_path / name, "c", precision, adapt=adapt)
        for source in sorted(folder.glob("*.c")):
            built = ended(cc, "-std=c99", "-O2", *WARNINGS, "-c", source, "-o", folder / "o")
            assert built.stderr == "", source.name


def test_the_exported_adapter_takes_its_branches_from_the_exported_steps(tmp_path: Path) -> None:
    """The wrench of a step is the static one and each share times its branch."""
    model = with_effects(fitted("energy4"), BRANCHES)
    settings = AdaptSettings(("modulus", "shares"))
    written(model, tmp_path, "c", adapt=settings)
    # -u: what a shared library does not call itself is taken from the static one only where named.
    sources = [tmp_path / "neck.c", "-Wl,-u,neck_adapt", adapter_library(tmp_path)]
    code, state, adapted = CompiledC(*sources), np.zeros(49), np.zeros(4000)
    h, k, still, branches = np.zeros(6), np.zeros(36), np.zeros(6), np.zeros((2, 6))
    poses = campaign(seed=3).measured().poses[:40]
    assert code.init(state, poses[0]) == 1
    code.adapt_init(adapted, None)
    outcomes = set()
    for pose in poses:
        assert code.step(state, pose, 0.3, None, h, k) == 1
        code.branches(state, branches)
        code.value(pose, still)
        np.testing.assert_allclose(h, still + BRANCHES[1] @ branches, rtol=1e-9, atol=1e-9)
        outcomes.add(code.adapt(adapted, None, pose, h, 0.3, h, k, branches))
    assert np.abs(branches[0]).max() > 0.1
    assert 1 in outcomes  # readings change the parameters
    assert 5 not in outcomes  # and none is refused


def test_no_heap_and_no_libm(tmp_path: Path) -> None:
    gcc, nm = need_program("gcc"), need_program("nm")
    for name in ("cubic", "energy4", "energy6"):
        folder = written(fitted(name), tmp_path / name, "c")
        ended(gcc, "-std=c99", "-O2", "-ffreestanding", "-c", folder / "neck.c", "-o", folder / "o")
        listed = ended(nm, "--undefined-only", folder / "o").stdout.split()
        assert set(listed) <= {"U", "memcpy", "memset", "_GLOBAL_OFFSET_TABLE_"}, listed


def test_mujoco_pushes_back_with_the_linear_part(tmp_path: Path) -> None:
    exported = export_files(fitted("energy6"), "mujoco", "neck")
    text = exported.files["neck.xml"]
    assert any("Lost" in note for note in exported.notes)
    tree = ElementTree.fromstring(text)
    rest = np.array([[fitted("energy6").base.length_m, 0, 0, 0, 0, 0]], dtype=float)
    hessian = fitted("energy6").base.stiffness(rest, "generalised")[0]
    found = np.zeros((6, 6))
    for tendon in tree.iter("fixed"):
        row = np.array([float(joint.attrib["coef"]) for joint in tendon.iter("joint")])
        found += float(tendon.attrib["stiffness"]) * np.outer(row, row)
    np.testing.assert_allclose(found, hessian, rtol=1e-9, atol=1e-9 * np.abs(hessian).max())
    mujoco = pytest.importorskip("mujoco", reason="mujoco is not installed (extra robot)")
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    h = fitted("energy6").base.predict(rest)[0]
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
    assert all("loop" in note or "margins" in note for note in export_files(plain, "c").notes)


def test_the_command_writes_the_files(tmp_path: Path, ecm_command: Command) -> None:
    fitted("cubic").save(tmp_path / "m.json")
    out = tmp_path / "code"
    ran = ecm_command(
        "export", tmp_path / "m.json", "--to", "c", "--out", out, "--name", "neck",
        "--json", tmp_path / "j.json",
    ).good()  # fmt: skip
    assert f"Next: cc -O2 {out}/neck.c" in ran.out
    document = json.loads((tmp_path / "j.json").read_text(encoding="utf-8"))
    names, loop = document["files"], document["control_loop"]
    assert loop["poses_held"] == loop["poses"] == 200
    assert f"bandwidth {loop['bandwidth_rad_s']:.3g} rad/s" in ran.out
    assert "margins: gain times" in ran.out
    assert sorted(p.name for p in out.iterdir()) == names
    assert (out / "neck_control.c").exists()
    ran = ecm_command("export", tmp_path / "m.json", "--to", "c", "--out", out, "--name", "A")
    assert ran.code == 2
    with pytest.raises(InputError, match="lower-case"):
        export_files(fitted("cubic"), "c", "My Neck")


def test_each_target_is_in_the_help() -> None:
    (to,) = (one.help for one in load_command("export").params if one.name == "to")
    assert re.findall(r"\w+", to) == list(TARGETS)
    with pytest.raises(InputError, match="expected one of c, rust, mujoco, fmu"):
        export_files(fitted("linear"), "lisp")
    with pytest.raises(InputError, match="--to fmu is written in double"):
        export_files(fitted("linear"), "fmu", precision="single")


@pytest.mark.parametrize(
    ("inputs", "outputs", "degree", "precision"),
    [(POSE, WRENCH, 2, "double"), (("y_m",), ("fy_N",), 5, "single"),
     (("x_m", "theta_z_rad"), ("fx_N", "fy_N", "tau_z_Nm"), 4, "double")],
)  # fmt: skip
def test_a_polynomial_of_any_shape_is_a_crate(
    inputs: tuple[str, ...], outputs: tuple[str, ...], degree: int, precision: str, tmp_path: Path
) -> None:
    table = campaign(seed=3).measured()
    columns = {name: table.column(name) for name in (*inputs, *outputs)}
    model = fit_model(as_table(columns), f"poly:{degree}")
    folder = written(model, tmp_path, "rust", precision)
    assert not (folder / "src" / "evaluation").exists()
    oldest = re.search(r'^rust-version = "\S+"$', (ROOT / "Cargo.toml").read_text("utf-8"), re.M)
    assert oldest is not None
    assert oldest.group() in (folder / "Cargo.toml").read_text("utf-8").splitlines()
    test = ("test", "--test", "golden")
    assert "2 passed" in cargo(folder, tmp_path / "target", *test, RUSTFLAGS="-D warnings")
