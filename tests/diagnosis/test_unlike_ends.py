"""A body whose ends differ is not explained by effects that the symmetric energy then lacks."""

from __future__ import annotations

import numpy as np
import pytest

from ecm.diagnosis import Diagnosis, diagnose
from ecm.io.arrays import F
from ecm.io.columns import WRENCH
from ecm.io.table import Table, as_table
from ecm.models import fit_model
from rows import slow_ramp
from support.neck import columns_of
from support.tapered_body import META, NOISE, random_poses, tapered


def measured(extra: F | float = 0.0) -> Table:
    random = np.random.default_rng(5)
    poses = random_poses(random, 120)
    noise = random.standard_normal((120, 6)) * NOISE
    columns = columns_of(poses, tapered(poses) + extra + noise)
    return as_table(columns | {"time_s": 30.0 * np.arange(120)}, meta=META)


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
