"""A physics base that is not the body that was measured: said, and seen through."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from ecm.diagnosis import diagnose
from ecm.models import Model, surrogate_of
from support.campaigns import campaign, model, workspace_poses
from support.stand_in import L, coordinates, wrench

STIFFER = np.array([1.0, 1.3, 1.3, 1.0, 1.15, 1.15])
"""Ratio of shear and bending stiffness: E alone cannot correct it."""


@cache
def another_body() -> Model:
    """The physics of a body that is stiffer in shear and bending than the one on the rig."""
    pairs = []
    for count, seed in ((200, 1), (80, 2)):
        poses = workspace_poses(count, seed)
        pairs += [poses, wrench(poses) * STIFFER]
    base = surrogate_of(
        pairs[0], pairs[1], L, test_poses=pairs[2], test_wrenches=pairs[3],
        mechanism={"length_m": L},
    )  # fmt: skip
    return Model(base=base)


def test_nothing_hidden_is_unknown_and_the_body_is_named_as_the_reason() -> None:
    assert np.abs(coordinates(workspace_poses(5, 1))[1]).max() > 0.05
    found = diagnose(another_body(), campaign("", 1.0, 4))
    assert found.verdict == "unknown"
    assert found.answer == ()
    assert found.base.kind == "energy"
    assert found.unknown is not None
    assert "the stated body is not the one that was measured" in found.unknown.words
    assert any("names are against the energy model" in text for text in found.warnings)


@pytest.mark.parametrize("hidden", ["hysteresis", "fts_drift", "temperature_modulus"])
def test_an_effect_is_named_through_a_wrong_body(hidden: str) -> None:
    found = diagnose(another_body(), campaign(hidden, 1.0, 4))
    assert found.base.kind == "energy"
    assert len(found.answer) == 1
    assert hidden in found.answer[0]
    assert found.held_out.after < 1.15


def test_the_right_body_is_never_doubted() -> None:
    for hidden in ("", "payload", "base_compliance"):
        found = diagnose(model(), campaign(hidden, 3.0, 4))
        assert found.base.kind == "physics"
        assert not any("stated body" in text for text in found.warnings)


def test_what_no_symmetric_energy_takes_is_no_other_body() -> None:
    """A structure that turns with the azimuth stays unknown against the physics."""
    table = campaign("", 1.0, 4)
    three_fold = np.sin(3.0 * np.arctan2(table.column("z_m"), table.column("y_m")))
    spoilt = table.with_columns({"fx_N": table.column("fx_N") + 6.0 * three_fold})
    found = diagnose(replace(model()), spoilt)
    assert found.verdict == "unknown"
    assert found.base.kind == "physics"
