"""The bushing's expressions: the moment convention, and the model at a thousand poses.

OpenSim itself reads and evaluates them in `benches/export_targets.py`.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ecm._native import rotation_matrices
from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.columns import WRENCH
from ecm.models import fit_model
from ecm.models.export import export, export_files
from ecm.models.export.simulators import DEFLECTIONS, deflections
from ecm.models.measured_poses import noise_sd, poses_like_measured
from support.campaigns import campaign
from support.exports import fitted
from support.neck import way_out


def evaluated(text: str, at: F) -> F:
    """An expression with its definitions, at deflections (N, 6)."""
    main, *definitions = text.split(";")
    known = dict(zip(DEFLECTIONS, at.T, strict=True))
    for definition in definitions:
        name, value = definition.split("=")
        known[name] = eval(value, {}, known)
    return np.asarray(eval(main, {}, known))


def body_fixed(at: F) -> F:
    """R = Rx(a) Ry(b) Rz(c) of the three angles."""
    return Rotation.from_euler("XYZ", at[:, 3:]).as_matrix()


def test_deflections_are_those_of_a_body_fixed_rotation() -> None:
    poses = fitted("energy6").rest_pose("a test") + np.random.default_rng(2).uniform(
        -0.6, 0.6, (50, 6)
    )
    at, axes = deflections(poses)
    np.testing.assert_allclose(
        body_fixed(at), rotation_matrices(np.ascontiguousarray(poses[:, 3:])), atol=1e-12
    )
    # Along its axis each angle turns the platform: dR/da = [axis] R.
    for k in range(3):
        step = 1e-6 * np.eye(6)[3 + k]
        change = (body_fixed(at + step) - body_fixed(at - step)) / 2e-6
        turn = change @ body_fixed(at).transpose(0, 2, 1)
        found = np.stack([turn[:, 2, 1], turn[:, 0, 2], turn[:, 1, 0]], axis=1)
        np.testing.assert_allclose(found, axes[:, k], atol=1e-8)


def test_expressions_give_the_wrench_within_the_noise() -> None:
    model = fitted("energy6")
    exported = export_files(model, "opensim", "neck")
    assert 0.0 < exported.change < 0.3
    tree = ElementTree.fromstring(str(exported.files["neck.osim"]))
    texts = {item.tag: item.text or "" for item in tree.iter() if item.tag.endswith("_expression")}
    assert not any(c.isspace() for text in texts.values() for c in text)
    poses = poses_like_measured(model, 1000)
    at, axes = deflections(poses)
    found = np.stack(
        [
            evaluated(texts[f"{name}_expression"], at)
            for name in ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
        ],
        axis=1,
    )
    found[:, 3:] = np.linalg.solve(axes, found[:, 3:, None])[:, :, 0]
    error = np.sqrt(((found - model.base.predict(poses)) ** 2).mean(axis=0)) / noise_sd(model)
    assert error.max() < 0.3, dict(zip(WRENCH, error, strict=True))


def test_moments_are_generalised_forces_to_the_angles() -> None:
    """M_k is dU/d(angle k) of the model's energy, which is no moment about an axis of the body."""
    model = fitted("energy6")
    poses = model.rest_pose("a test") + np.random.default_rng(4).uniform(-1, 1, (20, 6)) * (
        [0.002] * 3 + [0.3] * 3
    )
    at, axes = deflections(poses)
    moments = np.einsum("nij,nj->ni", axes, model.base.predict(poses)[:, 3:])

    def energy(deflection: F) -> F:
        theta = Rotation.from_matrix(body_fixed(deflection)).as_rotvec()
        at_pose = np.hstack([deflection[:, :3], theta])
        return np.asarray(model.base.model.energy_J(at_pose))  # type: ignore[attr-defined]

    for k in range(3):
        step = 1e-5 * np.eye(6)[3 + k]
        slope = (energy(at + step) - energy(at - step)) / 2e-5
        np.testing.assert_allclose(moments[:, k], slope, rtol=1e-5, atol=1e-6)


def test_a_change_beyond_the_noise_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ecm.models.export.simulators._DEGREES", (2,))
    with pytest.raises(InputError, match=r"--to opensim can hold changes the model by"):
        export(fitted("energy6"), "opensim", tmp_path)
    assert list(tmp_path.iterdir()) == []
    assert export(fitted("energy6"), "opensim", tmp_path, force=True).change > 1.0


def test_an_effect_that_opensim_cannot_hold_is_refused_as_by_other_targets(tmp_path: Path) -> None:
    table = campaign("temperature_modulus", 3.0, 1)
    model = fit_model(table, "energy4").add("temperature_modulus").fit(table)
    with pytest.raises(InputError, match=r"temperature_modulus is .* times the measure") as found:
        export(model, "opensim", tmp_path)
    assert way_out(found.value).force
    middle = float(f"{sum(model.conditions['temperature_degC']) / 2.0:.6g}")
    assert way_out(found.value).command == (
        f"ecm export MODEL --to opensim --out OUT --name ecm_model --at temperature_degC={middle}"
    )
    assert export(model.at({"temperature_degC": middle}), "opensim", tmp_path / "warm").lost == {}
    # C has steps, of energies: the effect that counts is kept by another base, and not thrown away.
    cubic = fit_model(table, "cubic").add("temperature_modulus").fit(table)
    typed = "ecm fit DATA --model energy4 --add temperature_modulus --out energy.json"
    # Of data without a length an energy needs that before.
    for model_there, first in ((cubic, "fit"), (replace(cubic, length_m=None), "state")):
        with pytest.raises(InputError, match="steps need an energy") as found:
            export(model_there, "c", tmp_path)
        assert way_out(found.value).command == typed
        assert way_out(found.value).words.startswith(first)
    export(fit_model(table, "energy4").add("temperature_modulus").fit(table), "c", tmp_path / "c")
    forced = export(model, "opensim", tmp_path, force=True)
    assert forced.left_out == ("temperature_modulus",)
    assert export(model.remove("temperature_modulus"), "opensim", tmp_path).lost == {}
