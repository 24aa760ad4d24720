"""A body whose ends differ is not explained by effects that the symmetric energy then lacks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from blind_parts.other_sets import given_model, other_sets, table_of
from ecm.diagnosis import Diagnosis, diagnose
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.io.description import Instrument, Meta
from ecm.io.table import Table, as_table
from ecm.models import fit_model
from rows import slow_ramp
from support.stand_in import left_jacobian_inverse, rotate, transpose

L = 0.1
META = Meta(
    mechanism={"length_m": L},
    instrument=Instrument(
        pose_position_sd_m=1e-9, pose_rotation_sd_rad=1e-9, force_sd_N=0.2, torque_sd_Nm=0.004
    ),
)
SCALE = np.array([5e-3, 1e-2, 1e-2, 0.3, 0.3, 0.3])


def tapered(poses: F) -> F:
    """Wrench of a quartic energy whose k_y_theta is not k_y L / 2, as alike ends ask."""
    linear = np.diag([4e4, 6e3, 6e3, 2.0, 3.0, 3.0])
    linear[1, 5] = linear[5, 1] = -60.0
    linear[2, 4] = linear[4, 2] = 60.0
    p = poses - [L, 0.0, 0.0, 0.0, 0.0, 0.0]
    q, gradient = p / SCALE, p @ linear
    gradient[:, 1:3] += 0.08 * (q[:, 1:3] ** 2).sum(axis=1)[:, None] * q[:, 1:3] / SCALE[1:3]
    gradient[:, 4:] += 0.12 * (q[:, 4:] ** 2).sum(axis=1)[:, None] * q[:, 4:] / SCALE[4:]
    torque = rotate(transpose(left_jacobian_inverse(p[:, 3:])), gradient[:, 3:])
    return np.concatenate([gradient[:, :3], torque], axis=1)


def measured(extra: F | float = 0.0) -> Table:
    random = np.random.default_rng(5)
    poses = random.uniform(-1.0, 1.0, (120, 6)) * [3e-3, 8e-3, 8e-3, 0.25, 0.25, 0.25]
    poses[:, 0] += L
    noise = random.standard_normal((120, 6)) * [0.2, 0.2, 0.2, 0.004, 0.004, 0.004]
    columns = dict(zip(POSE, poses.T, strict=True)) | {"time_s": 30.0 * np.arange(120)}
    columns |= dict(zip(WRENCH, (tapered(poses) + extra + noise).T, strict=True))
    return as_table(columns, meta=META)


EFFECTS = ("cable_drag", "payload", "fts_offset", "fts_drift")


@pytest.mark.parametrize(("name", "answer"), [("linear", "form"), ("energy6-revolution", "fits")])
def test_a_tapered_body_lacks_no_effect(name: str, answer: str) -> None:
    table = measured()
    found: Diagnosis = diagnose(fit_model(table, name), table, effects=EFFECTS)
    assert found.answer == (), found.sentence()
    assert found.verdict == "none"
    assert found.model.answer == answer
    assert any("the ends of the body differ" in text for text in found.warnings)


def test_nor_does_it_where_three_forces_are_measured() -> None:
    table = measured().drop(*WRENCH[3:])
    found = diagnose(fit_model(table, "linear"), table)
    assert (found.verdict, found.answer) == ("none", ()), found.sentence()
    assert any("the ends of the body differ" in text for text in found.warnings)


def test_what_else_is_missing_is_named_against_it() -> None:
    drift: F = np.outer(np.arange(120.0), [0.01, 0.0, 0.0, 0.0, 0.0004, 0.0])
    table = measured(drift)
    found = diagnose(fit_model(table, "linear"), table, effects=EFFECTS)
    assert [members[0] for members in found.answer] == ["fts_drift"], found.sentence()


def test_a_ramp_of_a_body_with_alike_ends_says_nothing_of_its_ends() -> None:
    """Rows held out of a growing motion are far off for every degree; that is no other body."""
    table = slow_ramp(600)
    found = diagnose(fit_model(table, "energy6"), table, effects=["payload"])
    assert not any("ends of the body" in text for text in found.warnings)


# --- measured bodies of the second blind benchmark, which use no formula of the library -----------
def drawn(solids: Path, seed: int, index: int) -> Diagnosis:
    """The answer to one set of `benches/blind_second.py`."""
    table, mechanism = table_of(other_sets(index + 1, seed)[index], solids)
    return diagnose(given_model(table, mechanism), table)


@pytest.mark.parametrize(
    ("seed", "index"), [(31, 60), (33, 110), (34, 224), (36, 0), (34, 94), (39, 214)]
)
def test_where_a_base_is_too_plain_nothing_is_named(solids: Path, seed: int, index: int) -> None:
    """Tapered rods whose best base is of revolution or of one degree more, also with noise that is
    only assumed, and a planar rod of 40 rows whose cubic was passed over."""
    found = drawn(solids, seed, index)
    assert (found.verdict, found.answer) == ("none", ()), found.sentence()


def test_unlike_ends_and_another_length_are_both_said(solids: Path) -> None:
    found = drawn(solids, 31, 60)
    assert any("the ends of the body differ" in text for text in found.warnings)
    assert any(text.startswith("or the") and "length looks" in text for text in found.warnings)


def test_an_effect_on_a_tapered_body_is_still_named(solids: Path) -> None:
    """The base of revolution by itself leaves as much as the symmetric one with wrong effects."""
    found = drawn(solids, 31, 11)
    assert found.answer == (("fts_drift",),), found.sentence()
