"""Effects of the noise change weights, never the answer."""

from __future__ import annotations

import numpy as np
import pytest

from ecm.diagnosis import diagnose, find_missing
from ecm.effects import Rows, get_effect
from ecm.effects.noise import NoiseEffect
from ecm.io.columns import WRENCH
from ecm.io.table import Table
from support.campaigns import campaign, diagnosis_of, model, physics

GROWTH_PER_NM = 2.0


def with_growing_scatter(table: Table, seed: int) -> Table:
    """Torques whose scatter grows with the torque."""
    random = np.random.default_rng(seed)
    loaded = table.text("kind") == "pose"
    wrenches = table.wrenches.copy()
    extra = 0.01 * GROWTH_PER_NM * np.abs(wrenches[:, 3:]) * random.standard_normal((len(table), 3))
    wrenches[:, 3:] += extra * loaded[:, None]
    return table.with_columns({name: wrenches[:, j] for j, name in enumerate(WRENCH)})


@pytest.mark.parametrize("seed", [1])
def test_scatter_that_grows_with_the_load_is_seen_and_no_name(seed: int) -> None:
    plain = diagnosis_of("", 1.0, seed)
    assert plain.noise.effects == ()
    grown = diagnose(model(), with_growing_scatter(campaign("", 1.0, seed), seed))
    assert grown.verdict == "none", grown.sentence()
    first = grown.noise.effects[0]
    assert first.id == "heteroscedastic_noise"
    assert first.parameter == "torque_growth"
    assert 0.3 * GROWTH_PER_NM < first.value < 2.0 * GROWTH_PER_NM
    assert grown.noise.figures.growth_per_Nm == first.value


def test_an_effect_is_still_named_under_growing_scatter() -> None:
    table = with_growing_scatter(campaign("temperature_modulus", 2.0, 1), 1)
    assert find_missing(model(), table).answer == (("temperature_modulus",),)


@pytest.mark.parametrize("id", ["heteroscedastic_noise", "pose_noise", "fts_quantisation"])
def test_the_variance_of_a_noise_effect_is_one(id: str) -> None:
    """Symmetric, positive, zero at zero, and quadratic in its parameter."""
    effect = get_effect(id)
    assert isinstance(effect, NoiseEffect)
    rows = Rows(campaign("", 1.0, 1).select(np.arange(40)), physics())
    unit = np.array([p.scale for p in effect.parameters])
    once, twice = effect.variance(rows, unit), effect.variance(rows, 2.0 * unit)
    assert np.abs(effect.variance(rows, 0.0 * unit)).max() == 0.0
    np.testing.assert_allclose(twice, 4.0 * once, rtol=1e-12, atol=1e-300)
    np.testing.assert_allclose(once, np.swapaxes(once, 1, 2), rtol=1e-9, atol=1e-12)
    assert np.linalg.eigvalsh(once).min() > -1e-9 * np.abs(once).max()
