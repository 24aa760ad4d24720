"""Exports of hostile models and names, and into folders that hold something already."""

from __future__ import annotations

import io
import re
import sys
from dataclasses import replace
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest

from ecm.errors import EcmError, InputError
from ecm.io.description import Scene
from ecm.io.table import as_table
from ecm.models import Model, fit_model, load_model, registry
from ecm.models.control_loop import LoopSettings
from ecm.models.export import export, export_files
from ecm.models.export.simulators import fitted_expressions
from support.exports import CompiledC, fitted, thousand_poses, written
from support.models import with_time
from support.programs import ended, need_program


@pytest.fixture(scope="module")
def spring() -> Model:
    y = np.linspace(-0.01, 0.01, 9)
    return fit_model(as_table({"y_m": y, "fy_N": 3000.0 * y}), "linear")


@pytest.mark.parametrize("hostile", ["y*/ int evil; /*_m", 'y"/><x_m', "y\n}_m", "y, theta_z_m"])
def test_names_of_columns_add_nothing_to_the_code(
    spring: Model, hostile: str, tmp_path: Path
) -> None:
    other = {"inputs": [hostile], "domain": {hostile: [-0.01, 0.01]}}
    registry.write_document(spring.document() | other, tmp_path / "model.json")
    model = load_model(tmp_path / "model.json")
    for target in ("c", "rust", "fmu"):
        with pytest.raises(EcmError, match=r"inputs is .* letters, digits and _"):
            export(model, target, tmp_path / "out")
    assert not (tmp_path / "out").exists()


TAKEN = [("fmu", "instance"), ("fmu", "fmi3"), ("simulink", "mex"), ("mujoco", "mj"),
         ("rust", "fn"), ("rust", "test")]  # fmt: skip


@pytest.mark.parametrize(("target", "name"), TAKEN)
def test_a_name_that_the_target_has_itself_is_refused(target: str, name: str) -> None:
    with pytest.raises(EcmError, match=rf"name.*{name}.*(choose|take) another"):
        export_files(fitted("linear"), target, name)


def test_a_crate_that_is_no_export_stays(spring: Model, tmp_path: Path) -> None:
    manifest = tmp_path / "Cargo.toml"
    manifest.write_text('[package]\nname = "mine"\n', encoding="utf-8")
    with pytest.raises(InputError, match="this crate is no export"):
        export(spring, "rust", tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["Cargo.toml"]
    assert "mine" in manifest.read_text(encoding="utf-8")
    for name in ("one", "two"):
        export(spring, "rust", tmp_path / "crate", name=name)
    assert 'name = "two"' in (tmp_path / "crate/Cargo.toml").read_text(encoding="utf-8")


def test_the_loader_takes_the_last_export_into_its_folder(tmp_path: Path) -> None:
    need_program("cc")
    pose = thousand_poses()[0]
    program = "import sys, neck_model as m; print(*m.value_and_stiffness(eval(sys.argv[1]))[0])"
    for kind in ("energy4", "energy6"):
        export(fitted(kind), "ros2", tmp_path, name="neck")
        done = ended(sys.executable, "-c", program, repr(pose.tolist()), cwd=tmp_path)
        expected = fitted(kind).base.predict(pose[None])[0]
        np.testing.assert_allclose(np.array(done.stdout.split(), float), expected, rtol=1e-9)


def test_every_user_may_read_the_files_of_an_fmu(spring: Model) -> None:
    content = export_files(spring, "fmu", "spring").files["spring_fmi3.fmu"]
    assert isinstance(content, bytes)
    for file in ZipFile(io.BytesIO(content)).infolist():
        assert (file.create_system, file.external_attr >> 16) == (3, 0o644), file.filename


def test_opensim_refuses_few_poses_and_bears_a_deflection_that_is_constant() -> None:
    base, noise = fitted("energy4").base, np.full(6, 1e-3)
    poses = thousand_poses()[:36].copy()
    with pytest.raises(InputError, match="36 poses like the measured ones are too few"):
        fitted_expressions(poses, base.predict(poses), noise)
    poses = thousand_poses().copy()
    poses[:, 0] = 0.1
    with np.errstate(all="raise"):
        expressions, _, change = fitted_expressions(poses, base.predict(poses), noise)
    assert np.isfinite(change)
    assert not any("nan" in text or "inf" in text for text in expressions.values())


def test_every_scene_has_the_mass_that_is_stated() -> None:
    files = export_files(fitted("linear"), "mujoco", "neck", loop=LoopSettings(2.0, 0.01)).files
    scenes = {path: str(text) for path, text in files.items() if path.endswith(".xml")}
    assert len(scenes) == 3
    for path, text in scenes.items():
        assert 'mass="2" diaginertia="0.01 0.01 0.01"' in text, path


@pytest.mark.parametrize("stated", [{}, {"mass_kg": 2.0}, {"inertia_kg_m2": 0.01}])
def test_the_platform_of_every_target_is_the_same_and_what_was_not_stated_is_said(
    stated: dict[str, float],
) -> None:
    """A stated mass stood beside an inertia of 1e-4 kg m2, as if both had been stated."""
    given = {
        to: export_files(fitted("linear"), to, loop=LoopSettings(**stated))
        for to in ("c", "mujoco", "opensim")
    }
    loop = given["c"].loop
    assert loop is not None
    mass, inertia = f"{loop.mass_kg:.9g}", f"{loop.inertia_kg_m2:.9g}"
    assert f'mass="{mass}" diaginertia="{inertia} ' in given["mujoco"].files["ecm_model_free.xml"]
    assert f"<mass>{mass}</mass>" in given["opensim"].files["ecm_model.osim"]
    assert f"<inertia>{inertia} " in given["opensim"].files["ecm_model.osim"]
    by = "stiffness" if stated else "own frequency"
    for exported in given.values():
        (said,) = (note for note in exported.notes if note.startswith("Not stated: "))
        assert f"by the mechanism's {by}. State yours" in said


@pytest.mark.parametrize("to", ["mujoco", "opensim"])
def test_a_scene_has_the_gravity_of_the_data(to: str) -> None:
    """A mechanism that hangs or lies fell along -x of its base all the same."""
    model = replace(fitted("linear"), scene=Scene(gravity_m_s2=(0.0, 0.0, 9.81)))
    files = export_files(model, to).files
    for path, text in files.items():
        if path.endswith((".xml", ".osim")):
            assert re.search(r'gravity(=")?>?0 0 9\.81["<]', str(text)), path


def test_a_pose_that_is_a_fault_leaves_the_state_as_it_was(tmp_path: Path) -> None:
    """A finite pose far beyond the data would else stay in the memory for its time constants."""
    model = with_time(fitted("energy4"))
    code = CompiledC(written(model, tmp_path, "c") / "neck.c")
    controller = model.controller()
    poses = thousand_poses()[:5]
    state, h, k = np.zeros(49), np.zeros(6), np.zeros(36)
    code.init(state, poses[0])
    controller.init(poses[0])
    for fault in (1e3 * np.eye(6)[1], np.array([1e9, 0, 0, 0, 0, 0]), 0.3 * np.eye(6)[0]):
        kept, here = bytes(state), controller.state
        assert code.step(state, fault, 0.01, None, h, k) == 0
        assert np.isnan(h).all()
        assert np.isnan(controller.step(fault, 0.01)[0]).all()
        assert bytes(state) == kept
        np.testing.assert_array_equal(controller.state, here)
    assert code.init(np.zeros(49), np.array([1e9, 0, 0, 0, 0, 0])) == 0
    for pose in poses:
        assert code.step(state, pose, 0.01, None, h, k) == 1
        np.testing.assert_allclose(h, controller.step(pose, 0.01)[0], rtol=1e-9, atol=1e-9)
