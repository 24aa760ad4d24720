"""An effect of one's own is treated as a built-in one: fit, file, limits, classes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from ecm.diagnosis import diagnose
from ecm.effects import (
    LinearEffect,
    Parameter,
    Rows,
    effect,
    get_effect,
    register,
    unregister,
    with_shape,
)
from ecm.effects.protocol import needs_columns, needs_full, needs_varying, optional
from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.table import Table
from ecm.models import load_model
from support.campaigns import campaign, model, physics, with_change


def register_own() -> None:
    """A fan: its force grows with time; and a weight that is the payload by another name."""

    @effect("fan", physics="A fan warms up.", parameters={"rate": "N/s"}, needs=["time_s"],
            kind="time", scale=1e-4)  # fmt: skip
    def fan(rows: Rows) -> F:
        columns = np.zeros((len(rows), 6))
        time = rows.table.column("time_s")
        columns[:, 1] = time - time.mean()
        return columns

    @effect("weight", physics="A weight.", parameters=dict.fromkeys("abcd", "1"), scale=0.1)
    def weight(rows: Rows) -> F:
        return get_effect("payload").jacobian(rows, np.zeros(4))


@pytest.fixture(autouse=True)
def own() -> Iterator[None]:
    register_own()
    yield
    for id in ("fan", "weight"):
        unregister(id)


def blown() -> Table:
    """Half a newton from the first to the last row, and more."""
    table = campaign("", 1.0, 4)
    change = get_effect("fan").correction(Rows(table, physics()), np.array([2e-4]))
    return with_change(table, change)


def test_a_model_file_carries_it(tmp_path: Path) -> None:
    table = blown()
    fitted = model().add("fan").fit(table)
    assert fitted.effects[0].values == pytest.approx([2e-4], abs=4.0 * fitted.effects[0].sd[0])
    fitted.save(tmp_path / "m.json")
    again = load_model(tmp_path / "m.json")
    assert np.array_equal(again.predict(table), fitted.predict(table))
    assert again.effects[0].sd == pytest.approx(fitted.effects[0].sd)
    # Without its column it is left out by name, as a built-in one is.
    assert "fan" in again.left_out(table.drop("time_s"))
    # Where nobody has registered it, the file is refused and says why.
    unregister("fan")
    with pytest.raises(InputError, match="fan"):
        load_model(tmp_path / "m.json")


def test_it_is_named_has_a_limit_and_is_listed_where_it_cannot_be_tested() -> None:
    found = diagnose(model(), blown())
    assert "fan" in found.answer[0], found.sentence()
    limit = diagnose(model(), campaign("", 1.0, 4)).detection_limits["fan"]
    assert limit.unit == "N/s"
    assert 1e-6 < limit.size < 2e-4
    bare = diagnose(model(), campaign("", 1.0, 4).drop("time_s"))
    listed = {item.id: item.record for item in bare.not_testable}
    assert listed["fan"] == "time_s"


def test_it_stands_in_a_class_with_what_looks_alike() -> None:
    found = diagnose(model(), campaign("payload", 1.0, 4))
    assert found.verdict == "ambiguous"
    assert {"payload", "weight"} <= set(found.answer[0]), found.sentence()
    assert any({"payload", "weight"} == set(pair) for pair in found.confusable)


@dataclass(eq=False)
class Tide(LinearEffect):
    """An effect with a shape: the moment of the flood, and a place that is left out by default."""

    id = "tide"
    physics = "The sea lifts the rig."
    parameters = (Parameter("lift", "N", 1.0),)
    requires = (needs_full, needs_columns("moon", "sun"), needs_varying("time_s", 1.0))

    at_s: float = 0.0
    place: str = optional("harbour")

    def columns(self, rows: Rows) -> F:
        return np.zeros((len(rows), 6, 1))


def test_the_fields_are_the_shape_and_the_first_need_that_fails_is_the_reason() -> None:
    register(Tide())
    try:
        assert Tide().shape == {"at_s": 0.0}
        assert Tide(3.0, "beach").shape == {"at_s": 3.0, "place": "beach"}
        again = with_shape("tide", {"at_s": 3.0, "place": "beach"})
        assert again.shape == {"at_s": 3.0, "place": "beach"}
        with pytest.raises(InputError, match="shape"):
            with_shape("tide", {"hour": 1.0})
    finally:
        unregister("tide")
    table = campaign("", 1.0, 4)
    lacking = Tide().missing(table)
    assert lacking is not None
    assert (lacking.reason, lacking.record, lacking.absent) == ("no column moon", "moon, sun", True)
    sky = table.with_columns({"moon": np.ones(len(table)), "sun": np.ones(len(table))})
    assert Tide().missing(sky) is None
    still = Tide().missing(sky.with_columns({"time_s": np.zeros(len(table))}))
    assert still is not None
    assert still.reason == "time_s does not vary"
