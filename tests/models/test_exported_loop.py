"""The exported 1 kHz loop of the demo's own model, with and without a state, in C and in Rust."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ecm.io.arrays import F
from ecm.io.table import as_table
from ecm.models import Model, fit_model, load_model
from support.campaigns import campaign
from support.control_loops import errors_in_c, errors_in_rust, exported_to
from support.exports import CompiledC
from support.models import with_time
from support.neck import Command


@pytest.fixture(scope="module")
def demo(quick_job: Path) -> Model:
    """What `ecm identify` writes: the kind and size of `make demo`, from fewer poses."""
    model = load_model(quick_job / "model.json")
    assert model.base.name == "energy6"
    assert len(model.base.coefficients) == 65
    return model


def test_the_result_of_the_loop_is_exported_and_errs_as_the_noise(
    quick_job: Path, tmp_path: Path, ecm_command: Command
) -> None:
    """The model with the effect that was found, in C, at the rows that it was measured at."""
    path = quick_job / "model-loop.json"
    ran = ecm_command("export", path, "--to", "c", "--out", tmp_path, "--name", "neck").good()
    assert "holds 200 of 200 poses" in ran.out
    code, model = CompiledC(tmp_path / "neck.c"), load_model(path)
    table = as_table(str(quick_job / "measured-loop.csv")).measured()
    poses = np.ascontiguousarray(table.matrix(model.inputs))
    assert all(code.inside(pose) for pose in poses)
    said = code.wrenches(poses, 6)
    variance = np.einsum("njj->nj", model.noise.covariance(model.rows_at(poses)))

    def over_noise(errors: F) -> float:
        return float(np.sqrt((errors**2 / variance).mean(axis=0)).max())

    assert over_noise(said - model.predict(poses)) < 0.3
    of_instruments = model.predict(table) - model.predict(poses)
    assert over_noise(said + of_instruments - table.matrix(model.outputs)) < 1.2


def holds(errors: F, *, state: bool) -> None:
    """At all poses; what a softer body relaxes beside the model's is followed by the integral."""
    assert errors.shape == (200, 2)
    assert errors[:, 1].max() < (1e-4 if state else 1e-5)
    assert errors[:, 1].max() < 0.2 * errors[:, 0].max()


@pytest.mark.parametrize("state", [False, True])
def test_the_loop_of_the_demo_holds_200_poses_in_c(
    demo: Model, state: bool, tmp_path: Path
) -> None:
    exported = exported_to(with_time(demo) if state else demo, "c", tmp_path)
    assert ("neck_step(" in (tmp_path / "neck_control.c").read_text()) == state
    holds(errors_in_c(exported, tmp_path, 2000 if state else 1000), state=state)


def test_the_loop_of_the_demo_holds_200_poses_in_rust_with_its_state(
    demo: Model, tmp_path: Path
) -> None:
    exported = exported_to(with_time(demo), "rust", tmp_path)
    errors, said = errors_in_rust(exported, tmp_path, 2000)
    holds(errors, state=True)
    assert "margins: gain times" in said
    assert "held: the push moved the platform" in said


def test_the_loop_of_a_cubic_holds_200_poses_in_rust(tmp_path: Path) -> None:
    model = fit_model(campaign(seed=3), "cubic")
    errors, said = errors_in_rust(exported_to(model, "rust", tmp_path), tmp_path)
    holds(errors, state=False)
    assert "held: the push moved the platform" in said
