"""A TOML as MODEL: the physics is built as wide as the data reach, as for `ecm fit`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ecm.io.columns import POSE, WRENCH
from ecm.io.table import Table, as_table
from ecm.models.physics.map import PhysicsMap
from support.campaigns import physics, workspace_poses
from support.neck import Done
from support.stand_in import L

Command = Callable[..., Done]
REACH_RAD = 1.1


def far_table() -> Table:
    """Rows that all turn by more than the physics base is usually built for."""
    poses = workspace_poses(40, 5)
    poses[:, 3:] *= (REACH_RAD / np.linalg.norm(poses[:, 3:], axis=1))[:, None]
    wrenches = physics().predict(poses)
    noise = [0.3, 0.3, 0.3, 0.01, 0.01, 0.01]
    wrenches += noise * np.random.default_rng(0).standard_normal(wrenches.shape)
    columns = dict(zip(POSE, poses.T.copy(), strict=True))
    return as_table(columns | dict(zip(WRENCH, wrenches.T.copy(), strict=True)))


@pytest.mark.parametrize(
    "command",
    [
        ("compare", "body.toml", "d.csv"),
        ("diagnose", "body.toml", "d.csv"),
        ("refit", "body.toml", "d.csv", "--add", "fts_offset", "--out", "m.json"),
        ("predict", "body.toml", "d.csv", "--out", "p.csv"),
    ],
)
def test_the_physics_of_a_toml_is_as_wide_as_the_data(
    command: tuple[str, ...],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    ecm_command: Command,
) -> None:
    """Catches a surrogate of 0.8 rad that is asked beyond without a word."""
    asked: list[float] = []

    def built(*_: Any, reach_rad: float = 0.0, **__: Any) -> PhysicsMap:
        asked.append(reach_rad)
        return physics()

    monkeypatch.setattr("ecm.cli.models.physics_map", built)
    monkeypatch.chdir(tmp_path)
    far_table().write("d.csv")
    Path("body.toml").write_text(f"[mechanism]\nlength_m = {L}\n", encoding="utf-8")
    done = ecm_command(*command)
    assert done.code == 0, done.err
    assert asked == [pytest.approx(REACH_RAD)]
