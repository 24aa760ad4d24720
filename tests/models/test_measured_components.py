"""Six poses with some wrench columns: energies and physics by the components that exist."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ecm
from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.io.description import Meta
from ecm.models import PhysicsMap, choose_model, surrogate_of
from ecm.models.partial import MeasuredMap
from ecm.models.physics.refit import PhysicsModel
from support.models import reread, spring_body
from support.neck import columns_of, way_out

LENGTH_M = 0.1
NOISE = np.repeat([0.05, 0.005], 3)
META = {
    "mechanism": {"length_m": LENGTH_M},
    "instrument": {"force_sd_N": 0.05, "torque_sd_Nm": 0.005,
                   "pose_position_sd_m": 1e-6, "pose_rotation_sd_rad": 1e-5},
}  # fmt: skip
FORCES = WRENCH[:3]


def measured(outputs: tuple[str, ...] = FORCES, rows: int = 120, seed: int = 1) -> ecm.Table:
    random = np.random.default_rng(seed)
    poses = random.uniform(-1.0, 1.0, (rows, 6)) * [2e-3, 5e-3, 5e-3, 0.1, 0.1, 0.1]
    poses[:, 0] += LENGTH_M
    wrenches = spring_body().predict(poses) + random.standard_normal((rows, 6)) * NOISE
    columns = columns_of(poses, wrenches)
    kept = {name: columns[name] for name in (*POSE, *outputs)}
    return ecm.as_table(kept | {"time_s": 2.0 * np.arange(rows)}, meta=META)


def whole_base(poses: F) -> PhysicsMap:
    """The body's own wrenches at these poses: a physics base of six components."""
    h = spring_body().predict(poses)
    return surrogate_of(poses, h, LENGTH_M, test_poses=poses, test_wrenches=h)


@pytest.mark.parametrize("outputs", [FORCES, WRENCH[3:], ("fy_N", "tau_z_Nm")])
def test_an_energy_fits_and_keeps_to_what_was_measured(
    outputs: tuple[str, ...], tmp_path: Path
) -> None:
    table = measured(outputs)
    assert ecm.check(table).testable
    model = ecm.fit(table, "energy4")
    # A force across and the moment about the third axis tell of all the others.
    assert model.outputs == (WRENCH if "fy_N" in outputs[:1] else outputs)
    assert ecm.compare(model, table).whitened_rms == pytest.approx(1.0, abs=0.1)
    other = measured(outputs, seed=2)
    assert ecm.compare(model, other).whitened_rms == pytest.approx(1.05, abs=0.1)
    found = ecm.diagnose(model, table)
    assert found.verdict == "none"
    assert found.base.kind == "energy"
    better = ecm.refit(model, table, add=["hysteresis"])
    loaded = reread(better, tmp_path)
    np.testing.assert_array_equal(loaded.predict(table), better.predict(table))
    assert ecm.predict(model, table).matrix(outputs).shape == (120, len(outputs))
    if model.outputs == FORCES:
        exported = ecm.export(model, "c", tmp_path)
        assert any(note.startswith("Folded into poly:") for note in exported.notes)
        assert exported.folding < 0.05
    bare = ecm.fit(table, "energy4", weights="spread")
    assert ecm.compare(bare, table).whitened_rms == pytest.approx(1.0, abs=0.1)


def test_a_body_that_forces_determine_predicts_all_six() -> None:
    table = measured()
    twice_as_stiff = whole_base(table.poses).with_coefficients(np.array([2.0]))
    model = ecm.fit(table, PhysicsModel(base=twice_as_stiff))
    assert model.outputs == WRENCH
    np.testing.assert_allclose(model.base.coefficients, [1.0], atol=2e-3)
    assert [c.name for c in ecm.compare(model, table).components] == list(FORCES)
    assert ecm.diagnose(model, table).verdict == "none"
    turned = table.with_columns({"fy_N": table["fy_N"] * 1.2})
    assert ecm.compare(model, turned).missing


def test_a_whole_model_of_forces_without_a_stated_noise_is_stored_and_read(tmp_path: Path) -> None:
    """The spread of three residuals is no noise of six components."""
    table = measured().with_meta(Meta(mechanism={"length_m": LENGTH_M}))
    poses = table.poses
    model = ecm.fit(table, PhysicsModel(base=whole_base(poses)))
    assert model.outputs == WRENCH
    found = reread(model, tmp_path).reading_sd(poses[:4])
    assert found is not None
    assert found.shape == (4, 6)


def test_a_model_of_six_with_an_effect_is_judged_by_three_forces() -> None:
    whole = measured(WRENCH)
    model = ecm.refit(ecm.fit(whole, "energy4"), whole, add=["own_weight"])
    by_forces = ecm.compare(model, measured())
    all_six = ecm.compare(model, whole)
    assert [c.rmse for c in by_forces.components] == pytest.approx(
        [c.rmse for c in all_six.components[:3]], rel=1e-9
    )
    assert isinstance(by_forces.compared.model.base, MeasuredMap)


@pytest.mark.parametrize("name", ["rod", "physics"])
def test_what_cannot_do_with_less_says_what_can(name: str) -> None:
    table = measured() if name == "rod" else measured().drop("theta_x_rad")
    with pytest.raises(InputError, match="needs all six pose") as caught:
        ecm.fit(table, name)
    chosen = way_out(caught.value).command.split()[4]
    if chosen == "choose":  # a name of the command line
        chosen = choose_model(table, ["linear", "quadratic"]).best.name
    ecm.fit(table, chosen)


def test_fewer_readings_than_coefficients_are_refused_with_both() -> None:
    with pytest.raises(InputError, match=r"30 readings of fx_N, fy_N, fz_N for .* coefficients"):
        ecm.fit(measured(rows=10), "energy6")
