"""The plant's elastic truth is the FEM: what the surrogate adds between poses, and anisotropy."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from ecm.io.arrays import F
from ecm.io.mechanism import Mechanism
from ecm.io.se3 import displaced, turn_wrench
from ecm.io.table import read_table
from ecm.rig import Campaign, CampaignOptions, RigSettings, run_campaign
from ecm.rig.elastic import COS2, SIN2, UNIFORM, Elastic, FemSource, SolvedPoses, solve_cached
from support.stand_in import REST, plan_of, some_poses


@dataclass(frozen=True)
class _Strided:
    """A solver whose arrays do not lie row by row in memory."""

    length_m: float = 0.1034

    def key(self) -> str:
        return "strided"

    def solve(self, poses: F, grade: str, progress: object = None) -> SolvedPoses:
        random = np.random.default_rng(0)
        wrenches = random.standard_normal((6, len(poses))).T
        stiffness = np.swapaxes(random.standard_normal((len(poses), 6, 6)), 1, 2)
        return SolvedPoses(poses, wrenches, stiffness, ("solved",) * len(poses))

    def surrogate(self, solved: SolvedPoses) -> None:
        return None


def test_anchors_of_a_file_give_the_bits_of_the_solved_ones(tmp_path: Path) -> None:
    poses = some_poses(200)
    near = poses + 0.01 * np.random.default_rng(1).standard_normal(poses.shape)
    solved, read = (
        Elastic(solve_cached(_Strided(), poses, UNIFORM, tmp_path)).wrench(np.arange(200), near)
        for _ in range(2)
    )
    np.testing.assert_array_equal(read, solved)


@pytest.fixture(scope="module")
def source() -> FemSource:
    return FemSource(Mechanism())


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("anchors")


def test_between_anchor_and_reached_pose_the_error_is_below_a_hundredth_of_the_noise(
    source: FemSource,
) -> None:
    poses = np.vstack([REST, some_poses(40)])
    solved = source.solve(poses, UNIFORM)
    assert set(solved.status) == {"solved"}
    size = np.repeat([1.5e-4, 1e-3], 3)  # [rig] pose_error
    near = displaced(poses, size * np.random.default_rng(0).standard_normal(poses.shape))
    direct = source.solve(near, UNIFORM).wrenches
    index = np.arange(len(poses))
    full = Elastic(solved, source.surrogate(solved)).wrench(index, near) - direct
    noise = np.repeat([0.3, 0.01], 3)
    assert np.sqrt(np.mean((full / noise) ** 2)) < 0.01
    # It is the surrogate's curvature that does it, not its value.
    linear = Elastic(solved).wrench(index, near) - direct
    assert np.abs(linear).max() > 3.0 * np.abs(full).max()
    smooth = source.surrogate(solved)
    assert smooth is not None
    assert np.std(smooth.predict(near) - direct) > 3.0 * np.std(full)


def test_a_graded_modulus_stiffens_one_side_and_softens_the_other(source: FemSource) -> None:
    plain, cos2, sin2 = (
        source.solve(REST[None], grade).stiffness[0] for grade in (UNIFORM, COS2, SIN2)
    )
    cos2, sin2 = cos2 - plain, sin2 - plain
    # phi = 0 is y: fibres there bend in the x-y plane, about z.
    assert cos2[1, 1] > 0.0 > cos2[2, 2]
    assert cos2[5, 5] > 0.0 > cos2[4, 4]
    assert cos2[5, 5] == pytest.approx(-cos2[4, 4], rel=0.1)
    assert sin2[1, 2] > 0.0
    assert abs(sin2[1, 1]) < 0.2 * sin2[1, 2]
    assert sin2[1, 2] == pytest.approx(cos2[1, 1], rel=0.2)


def test_the_grade_turns_with_the_axes(source: FemSource) -> None:
    """cos 2 phi of a pose is minus that of the pose turned by 90 degrees about x."""
    quarter = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    pose = REST + np.array([[-0.001, 0.006, 0.002, 0.05, -0.1, 0.25]])
    turned = turn_wrench(quarter[None], pose)
    change = [
        source.solve(p, COS2).wrenches - source.solve(p, UNIFORM).wrenches for p in (pose, turned)
    ]
    assert np.abs(change[0]).max() > 0.05
    left = turn_wrench(quarter[None], change[0]) + change[1]
    # Second order in the contrast does not change its sign.
    assert np.abs(left[0, :3]).max() < 0.1 * np.abs(change[0][0, :3]).max()
    assert np.abs(left[0, 3:]).max() < 0.1 * np.abs(change[0][0, 3:]).max()


def test_a_plan_with_a_mechanism_is_measured_from_end_to_end(folder: Path, tmp_path: Path) -> None:
    plan = plan_of(some_poses(25))
    plan = plan.with_meta(replace(plan.meta, mechanism=Mechanism().to_dict()))
    out = tmp_path / "data.csv"
    options = CampaignOptions(folder=folder)
    run_campaign(plan, RigSettings(), out, hide="anisotropy=1", seed=1, options=options)
    table = read_table(out)
    assert len(table) == 25
    assert table.meta.mechanism["radius_m"] == 0.033
    assert len(list(folder.glob("anchors-*.npz"))) == 3  # plain, cos 2 phi, sin 2 phi
    campaign = Campaign(plan, RigSettings(), FemSource(Mechanism()), folder=folder)
    elastic = campaign.plant.elastic.wrench(np.arange(1, 26), table.poses)
    assert np.std(table.wrenches - elastic, axis=0)[1] < 2.0
