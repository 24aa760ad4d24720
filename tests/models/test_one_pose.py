"""One pose (n,) through the public model: as of many, in one native call, refused alike."""

from __future__ import annotations

import copy
import pickle
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import polars as pl
import pytest

from ecm._native import EnergyEvaluator, PolynomialEvaluator
from ecm.errors import EcmError, InputError
from ecm.io.columns import POSE, WRENCH
from ecm.io.table import as_table
from ecm.models import EnergyMap, Model, PhysicsMap, PolynomialMap, fit_model
from support.campaigns import campaign, physics, workspace_poses

POSES = workspace_poses(5, 7)


def energy(*groups: str) -> EnergyMap:
    poses = workspace_poses(60, 1)
    return EnergyMap(
        EnergyEvaluator.fit(
            poses, physics().predict(poses), length_m=0.1034, degree=4, groups=list(groups)
        )
    )


def cubic() -> PolynomialMap:
    values = np.random.default_rng(3).normal(size=(84, 6))
    model = PolynomialEvaluator.from_coefficients(3, -np.ones(6), np.ones(6), values)
    return PolynomialMap(model, POSE, WRENCH)


MODELS = {
    "energy": lambda: Model(base=energy()),
    "energy with a broken symmetry": lambda: Model(base=energy("precurvature")),
    "physics": lambda: Model(base=physics()),
    "cubic": lambda: Model(base=cubic()),
    "with an effect": lambda: Model(base=physics()).add("base_compliance").fit(campaign(seed=2)),
}


@pytest.mark.parametrize("name", MODELS)
def test_a_copy_and_names_in_another_order_are_the_same(name: str) -> None:
    model = MODELS[name]()
    wrench, stiffness = model.wrench_and_stiffness(POSES)
    turned = dict(zip(POSE[::-1], POSES.T[::-1], strict=True))
    for rows in (turned, pl.DataFrame(turned), as_table(turned)):
        np.testing.assert_array_equal(model.stiffness(rows), stiffness)
        np.testing.assert_array_equal(model.wrench_and_stiffness(rows)[0], wrench)
    for copied in (copy.deepcopy(model), pickle.loads(pickle.dumps(model))):
        np.testing.assert_array_equal(copied.stiffness(POSES), stiffness)
        assert str(copied) == str(model)
    assert model in {model: 1}


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("kind", ["partial", "generalised", "screw"])
def test_one_pose_is_as_one_of_many(name: str, kind: str) -> None:
    model = MODELS[name]()
    wrench, stiffness = model.predict(POSES), model.stiffness(POSES, kind)
    both = model.wrench_and_stiffness(POSES, kind)
    np.testing.assert_array_equal(both[0], wrench)
    np.testing.assert_array_equal(both[1], stiffness)
    for i, pose in enumerate(POSES):
        one = model.wrench_and_stiffness(pose, kind)
        assert (one[0].shape, one[1].shape) == ((6,), (6, 6))
        np.testing.assert_allclose(one[0], wrench[i], rtol=1e-13)
        np.testing.assert_allclose(one[1], stiffness[i], rtol=1e-12, atol=1e-9)
        np.testing.assert_array_equal(model.predict(pose), model.predict(pose[None])[0])
        np.testing.assert_array_equal(model.stiffness(pose, kind)[:3], one[1][:3])


def test_poses_may_be_lists() -> None:
    model = Model(base=physics())
    for poses in (POSES, POSES[0]):
        stiffness = model.stiffness(poses)
        np.testing.assert_array_equal(model.stiffness(poses.tolist()), stiffness)
        np.testing.assert_array_equal(model.wrench_and_stiffness(poses.tolist())[1], stiffness)


def test_few_columns_and_other_number_types() -> None:
    y = np.linspace(-0.01, 0.01, 9)
    model = fit_model({"y_m": y, "fy_N": 3000.0 * y}, "linear")
    wrench, stiffness = model.wrench_and_stiffness(np.array([0.005], dtype=np.float32))
    assert wrench == pytest.approx([15.0], rel=1e-6)
    assert stiffness.shape == (1, 1)


@dataclass
class Counted:
    """A native energy that counts the calls."""

    model: EnergyEvaluator
    calls: list[str] = field(default_factory=list)

    def __getattr__(self, name: str) -> Any:
        self.calls.append(name)
        return getattr(self.model, name)


@pytest.mark.parametrize("name", ["energy", "physics"])
def test_one_native_call_a_pose(name: str) -> None:
    """A controller's step crosses into Rust once, and asks for no setting of the model."""
    counted: Any = Counted(energy().model)
    plain = EnergyMap(counted)
    model = Model(base=plain if name == "energy" else PhysicsMap(plain, np.zeros(6), {}))
    for call, native in (
        (model.predict, "predict"),
        (model.stiffness, "stiffness"),
        (model.wrench_and_stiffness, "wrench_and_stiffness"),
    ):
        counted.calls.clear()
        call(POSES[0])
        assert counted.calls == [native]


@pytest.mark.parametrize("name", ["energy", "physics", "cubic"])
@pytest.mark.parametrize(
    ("pose", "says"),
    [
        (np.array([0.1, np.nan, 0.0, 0.0, 0.0, 0.0]), r"row 0, column y_m is nan"),
        (np.array([0.1, 0.0, 0.0, 2.0, 2.0, 2.0]), r"row 0: .* longer than pi"),
        (np.zeros(5), r"5"),
        (np.zeros((2, 3, 6)), r"shape \(2, 3, 6\)"),
        (np.zeros(()), r"shape \(\)"),
    ],
    ids=["nan", "long rotation", "too short", "three axes", "a number"],
)
def test_one_pose_is_refused_as_many_are(name: str, pose: np.ndarray, says: str) -> None:
    model = MODELS[name]()
    for call in (model.predict, model.stiffness, model.wrench_and_stiffness):
        with pytest.raises(EcmError, match=says):
            call(pose)


def test_poses_that_lie_column_by_column_are_read_as_such() -> None:
    """Below the door too, where no layer makes them contiguous."""
    model = energy().model
    assert np.array_equal(model.predict(np.asfortranarray(POSES)), model.predict(POSES))


def test_what_a_mask_hides_is_no_pose() -> None:
    """Numpy drops a mask without a word, and the number below it is any."""
    model = Model(base=energy())
    np.testing.assert_array_equal(model.predict(np.ma.array(POSES)), model.predict(POSES))
    hidden = np.ma.array(POSES, mask=np.arange(30).reshape(5, 6) == 15)
    for call in (model.predict, model.stiffness, model.wrench_and_stiffness):
        with pytest.raises(
            InputError, match=r"row 2, column theta_x_rad is nan.*leave the row out"
        ):
            call(hidden)
