"""Baselines behind the same interface, and the table that compares them all."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from ecm._native import rod_poses
from ecm.errors import InputError, MissingExtra
from ecm.io.columns import POSE
from ecm.io.table import Table
from ecm.models import fit_model, parse_model
from ecm.models.export import export_files
from support.campaigns import exact_campaign, exact_table
from support.models import reread
from support.stand_in import L

SECTIONS = np.array([1900.0, 700.0, 0.65, 0.42])


def rod_table(count: int, seed: int) -> Table:
    """Poses of an exact rod."""
    random = np.random.default_rng(seed)
    low, high = np.array([-60, -30, -30, -2, -2, -2.0]), np.array([30, 30, 30, 2, 2, 2.0])
    wrenches = random.uniform(low, high, (count, 6))
    ea, ga, ei, gj = SECTIONS
    poses, ok = rod_poses(
        wrenches, length_m=L, axial_stiffness_N=ea, shear_stiffness_N=ga,
        bending_stiffness_Nm2=ei, torsion_stiffness_Nm2=gj,
    )  # fmt: skip
    return exact_table(poses[ok], wrenches[ok])


def test_a_rod_is_found_and_answers_in_wrenches() -> None:
    train, test = rod_table(40, 1), rod_table(30, 2)
    model = fit_model(train, "rod")
    np.testing.assert_allclose(model.base.coefficients, SECTIONS, rtol=1e-5)
    error = np.abs(model.predict(test.poses.copy()) - test.wrenches)
    assert error.max() < 1e-3
    k = model.base.stiffness(test.poses[:5].copy(), "generalised")
    np.testing.assert_allclose(k, np.swapaxes(k, 1, 2), atol=1e-5 * np.abs(k).max())


def test_constant_curvature_bends_and_stretches_but_does_not_shear() -> None:
    model = fit_model(exact_campaign(60, 1), "constant-curvature")
    base = model.base
    assert len(base.coefficients) == 3
    home = np.array([[L, 0.0, 0.0, 0.0, 0.0, 0.0]])
    h = base.stiffness(home, "generalised")[0]
    # At rest: k_e along, k_b and k_t about; sideways at the mid frame nothing.
    k_e, k_b, k_t = base.coefficients
    np.testing.assert_allclose(np.diag(h)[[0, 3]], [k_e, k_t], rtol=1e-6)
    np.testing.assert_allclose(np.diag(h)[[4, 5]], k_b, rtol=1e-6)
    assert abs(h[1, 1]) < 1e-6 * k_e
    np.testing.assert_allclose(
        base.columns(home * 1.01) @ base.coefficients, base.predict(home * 1.01)
    )


@pytest.mark.parametrize("name", ["constant-curvature", "rod", "gp", "mlp"])
def test_baselines_keep_in_files_and_have_a_slope(name: str, tmp_path: Path) -> None:
    if name in ("gp", "mlp"):
        pytest.importorskip("sklearn", reason="scikit-learn is not installed (extra learn)")
    table = rod_table(60, 3)
    model = fit_model(table, name, force=True)
    poses = table.poses[:10].copy()
    again = reread(model, tmp_path)
    assert again.name == name
    np.testing.assert_array_equal(again.predict(poses), model.predict(poses))
    step = np.zeros(6)
    step[4] = 1e-5
    slope = (model.predict(poses + step) - model.predict(poses - step)) / 2e-5
    k = model.stiffness(poses)
    np.testing.assert_allclose(k[:, :, 4], slope, rtol=1e-4, atol=1e-5 * np.abs(slope).max())
    exported = export_files(again, "c", "neck")
    kind = again.base.document()["kind"]
    assert any("Folded into " in n and f": {kind};" in n for n in exported.notes)
    assert exported.folding > 0.0
    if name not in ("gp", "mlp"):  # mechanics becomes an energy almost without a change
        assert exported.folding < 0.3
    with pytest.raises(InputError, match="PCR"):
        parse_model(name, pcr=0.1)


def test_a_learned_map_takes_any_columns_and_refuses_effects() -> None:
    pytest.importorskip("sklearn", reason="scikit-learn is not installed (extra learn)")
    table = exact_campaign(80, 4).drop("x_m", "fz_N", "tau_x_Nm")
    model = fit_model(table, "gp")
    assert model.inputs == POSE[1:]
    notes = export_files(model, "c", "neck").notes  # as the polynomial that is nearest to it
    assert any(note.startswith("Folded into poly:3: gp") for note in notes)
    with pytest.raises(InputError, match="cannot be refitted"):
        model.base.columns(table.matrix(model.inputs))


def test_without_scikit_learn_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("sklearn.gaussian_process", "sklearn.neural_network"):
        monkeypatch.setitem(sys.modules, module, None)
    for name in ("gp", "mlp"):
        with pytest.raises(MissingExtra, match=r"\(extra learn\)"):
            fit_model(exact_campaign(40, 5), name)
