"""Four references side by side point to the family of what is hidden."""

from __future__ import annotations

import pytest

from ecm.comparison import compare
from ecm.comparison.reference_models import ReferenceModels
from support.campaigns import campaign, model


@pytest.mark.parametrize(
    ("hidden", "family"),
    [
        ("length_error", "symmetric"),
        ("base_compliance", "symmetric"),
        ("anisotropy", "asymmetric"),
        ("temperature_modulus", "other"),
        ("stress_relaxation", "other"),
    ],
)
def test_the_family_of_a_hidden_effect(hidden: str, family: str) -> None:
    found = compare(model(), campaign(hidden, 2.0, 1)).references
    assert found is not None
    shares = found.shares()
    assert max(shares, key=shares.__getitem__) == family
    assert shares[family] > 0.6
    assert sum(shares.values()) == pytest.approx(1.0)


def test_nothing_hidden_points_nowhere() -> None:
    found = compare(model(), campaign("", 1.0, 1)).references
    assert found is not None
    for level in (found.physics, found.energy, found.ceiling):
        assert level == pytest.approx(1.0, abs=0.06)
    assert found.shares() == {}
    assert "noise" in found.sentence()


def test_shares_are_those_of_the_squares() -> None:
    found = ReferenceModels(physics=3.0, energy=2.0, ceiling=1.5)
    assert found.shares() == pytest.approx(
        {"symmetric": 5.0 / 8.0, "asymmetric": 1.75 / 8.0, "other": 1.25 / 8.0}
    )
    assert "62% of the excess points to elasticity or geometry" in found.sentence()
    # A ceiling that is no better than the energy has nothing of its own.
    assert ReferenceModels(physics=3.0, energy=1.0, ceiling=1.2).shares()["asymmetric"] == 0.0
