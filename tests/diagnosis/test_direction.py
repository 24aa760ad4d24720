"""A load along one direction that follows no column gets no name for its mean."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from blind_parts.other_sets import given_model, other_sets, table_of
from ecm.diagnosis import Diagnosis, diagnose, find_missing
from ecm.diagnosis.whiteness import find_direction
from ecm.io.columns import WRENCH
from ecm.io.table import Table
from support.campaigns import campaign, model

ALONG = np.array([3.0, -2.0, 1.0, 0.05, 0.02, -0.04])
"""N and N m: some times the noise of these campaigns."""


def with_load(table: Table, sizes: np.ndarray) -> Table:
    """The table with a load of these sizes (N,) along one direction, while a pose is held."""
    loaded = table.text("kind") == "pose"
    wrenches = table.wrenches + np.outer(sizes * loaded, ALONG)
    return table.with_columns({name: wrenches[:, j] for j, name in enumerate(WRENCH)})


def test_a_load_of_any_size_has_a_direction_and_a_steady_one_a_name() -> None:
    random = np.random.default_rng(4)
    table = campaign("", 1.0, 3)
    changing, steady = (
        find_missing(model(), with_load(table, sizes))
        for sizes in (random.exponential(1.0, len(table)), np.ones(len(table)))
    )
    assert changing.verdict != "named"
    found = find_direction(changing.problem, changing.accepted.effects)
    assert found is not None
    assert re.search(r"\(fx \+[2-5]\.?\d* N with tau_x \+0\.0\d+ N m rms\)", found.words)
    assert steady.verdict in ("named", "ambiguous")
    assert find_direction(steady.problem, steady.accepted.effects) is None


def test_a_load_whose_size_changes_by_less_than_the_noise_keeps_its_name() -> None:
    table = campaign("", 1.0, 3)
    sizes = 1.0 + 0.1 * np.random.default_rng(4).standard_normal(len(table))
    assert diagnose(model(), with_load(table, sizes)).answer == (("cable_drag",),)


@pytest.mark.parametrize(("seed", "index"), [(31, 229), (32, 183)])
def test_a_film_of_liquid_is_no_cable(solids: Path, seed: int, index: int) -> None:
    """Sets of `benches/blind_second.py` that came as a clean `cable_drag`."""
    table, mechanism = table_of(other_sets(index + 1, seed)[index], solids)
    found: Diagnosis = diagnose(given_model(table, mechanism), table)
    assert found.answer == (), found.sentence()
    assert found.unknown is not None
    assert found.unknown.pattern is not None
    assert "one direction" in found.unknown.words
