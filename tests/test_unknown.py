"""What is said of a residual that no effect explains: variables, words, a skeleton that runs."""

from __future__ import annotations

import numpy as np
import pytest

from ecm.compare.residuals import factors
from ecm.diagnose import Diagnosis, diagnose
from ecm.diagnose.relevance import relevance
from ecm.diagnose.skeleton import skeleton
from ecm.effects import get_effect, unregister
from ecm.table import Table
from stand_in_campaign import campaign, model


def strange() -> Table:
    """tau_x follows y times time: nothing of the catalogue."""
    table = campaign("", 1.0, 4)
    y, t = table.column("y_m"), table.column("time_s")
    extra = 0.03 * (t - t.mean()) / t.std() * y / y.std()
    return table.with_columns({"tau_x_Nm": table.column("tau_x_Nm") + extra})


@pytest.fixture(scope="module")
def found() -> Diagnosis:
    return diagnose(model(), strange())


def test_the_process_finds_the_variables_that_matter() -> None:
    random = np.random.default_rng(0)
    variables = random.standard_normal((200, 5))
    target = np.sin(2.0 * variables[:, 1]) * variables[:, 3] + 0.1 * random.standard_normal(200)
    shares = relevance(variables, target[:, None])
    assert shares.sum() == pytest.approx(1.0)
    assert set(np.argsort(-shares)[:2]) == {1, 3}
    assert shares[[0, 2, 4]].max() < 0.1
    noise = relevance(variables, np.zeros((200, 1)))
    assert noise.tolist() == [0.0] * 5


def test_variables_words_and_nearest(found: Diagnosis) -> None:
    assert found.verdict == "unknown"
    unknown = found.unknown
    assert unknown is not None
    assert {"y_m", "time_s"} <= set(unknown["variables"])
    assert unknown["relevance"]["y_m"] > 0.15
    assert unknown["words"].startswith("tau_x follows time_s*y_m (+0.03")
    assert unknown["nearest"]["share"] < 0.3


def test_the_skeleton_is_an_effect_that_explains_the_residual(found: Diagnosis) -> None:
    """At most ten lines; run as it stands it is named at once."""
    assert found.unknown is not None
    text = found.unknown["skeleton"]
    assert len([line for line in text.splitlines() if line.strip()]) <= 10
    exec(compile(text, "skeleton", "exec"), {})
    try:
        after = diagnose(model(), strange())
        assert after.answer == (("my_effect",),), after.sentence()
        assert get_effect("my_effect").missing(strange().drop("time_s")) is not None
        assert after.held_out["after"] < 1.05
    finally:
        unregister("my_effect")


def test_a_skeleton_for_squares_and_sides() -> None:
    text = skeleton([(("approach", "x_m"), "fx_N")], ("fx_N", "fy_N"))
    assert "sides(rows.table)" in text
    assert 'u("x_m")' in text
    compile(text, "skeleton", "exec")
    squared = skeleton([(("y_m", "y_m"), "fy_N")], ("fx_N", "fy_N"))
    assert 'u("y_m") * u("y_m")' in squared
    assert "columns[:, 1]" in squared
    constant = skeleton([((), "fy_N")], ("fx_N", "fy_N"))
    assert "columns[:, 1] = 1.0" in constant
    compile(constant, "skeleton", "exec")


def test_a_name_that_holds_a_star_is_one_name() -> None:
    """`a*b` of a user's table is no product of `a` and `b`."""
    known = ("x_m", "time_s", "a*b", "c^2")
    assert factors("a*b", known) == ("a*b",)
    assert factors("a*b*x_m", known) == ("a*b", "x_m")
    assert factors("a*b^2", known) == ("a*b", "a*b")
    assert factors("c^2", known) == ("c^2",)
    assert factors("time_s*x_m", known) == ("time_s", "x_m")
    assert factors("x_m^2", known) == ("x_m", "x_m")
    assert factors("constant", known) == ()
