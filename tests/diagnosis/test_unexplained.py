"""What is said of a residual that no effect explains: variables, words, a skeleton that runs."""

from __future__ import annotations

import numpy as np
import pytest

from ecm.comparison.residuals import factors
from ecm.diagnosis import Diagnosis, diagnose
from ecm.diagnosis.left_over import effect_template
from ecm.effects import effect, get_effect, unregister
from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.description import Meta
from ecm.io.table import Table
from ecm.models import fit_model
from ecm.regression.rows import Rows
from support.campaigns import campaign, model


def strange() -> Table:
    """tau_x follows y times time: nothing of the catalogue."""
    table = campaign("", 1.0, 4)
    y, t = table.column("y_m"), table.column("time_s")
    extra = 0.03 * (t - t.mean()) / t.std() * y / y.std()
    return table.with_columns({"tau_x_Nm": table.column("tau_x_Nm") + extra})


@pytest.fixture(scope="module")
def found() -> Diagnosis:
    return diagnose(model(), strange())


def test_variables_words_and_nearest(found: Diagnosis) -> None:
    assert found.verdict == "unknown"
    unknown = found.unknown
    assert unknown is not None
    assert {"y_m", "time_s"} <= set(unknown.variables)
    follows, _, size = unknown.words.partition(" (")
    assert follows == "tau_x follows time_s*y_m"
    assert float(size.split()[0]) == pytest.approx(0.03, rel=0.05)
    assert unknown.nearest is not None
    assert unknown.nearest.share < 0.3


def test_the_skeleton_is_an_effect_that_explains_the_residual(found: Diagnosis) -> None:
    """At most ten lines; run as it stands it is named at once."""
    assert found.unknown is not None
    text = found.unknown.template
    assert len([line for line in text.splitlines() if line.strip()]) <= 10
    exec(compile(text, "skeleton", "exec"), {})
    try:
        after = diagnose(model(), strange())
        assert after.answer == (("my_effect",),), after.sentence()
        assert get_effect("my_effect").missing(strange().drop("time_s")) is not None
        assert after.held_out.after < 1.05
    finally:
        unregister("my_effect")


def test_a_skeleton_for_squares_and_sides() -> None:
    text = effect_template(("approach", "x_m"), "fx_N", ("fx_N", "fy_N"))
    assert "sides(rows.table)" in text
    assert 'u("x_m")' in text
    compile(text, "skeleton", "exec")
    squared = effect_template(("y_m", "y_m"), "fy_N", ("fx_N", "fy_N"))
    assert 'u("y_m") * u("y_m")' in squared
    assert "needs=('approach', 'x_m')" in text
    assert 'kind="time"' in effect_template(("row",), "fx_N", ("fx_N",))
    assert '{"size": "N/(m m)"}' in squared
    assert '{"size": "N m/Pa"}' in effect_template(("hose_Pa",), "tau_x_Nm", ("tau_x_Nm",))
    assert "columns[:, 1]" in squared
    constant = effect_template((), "fy_N", ("fx_N", "fy_N"))
    assert "columns[:, 1] = 1.0" in constant
    compile(constant, "skeleton", "exec")


def test_of_a_table_with_one_force_the_draft_is_an_effect_as_well() -> None:
    """Of what depends on a column in no simple way a draft is written, which is named at once."""
    random = np.random.default_rng(5)
    n = 200
    x, humidity = random.uniform(-0.01, 0.01, n), random.uniform(20.0, 80.0, n)
    # A square: a straight line would be the effect `unused_column`.
    force = 400.0 * x + 0.001 * (humidity - 50.0) ** 2 + 0.05 * random.standard_normal(n)
    columns = {"x_m": x, "humidity_percent": humidity, "fx_N": force}
    table = Table(columns, Meta(), "spring.csv")
    base = fit_model(table, "linear")
    found = diagnose(base, table)
    assert found.verdict == "family"
    assert found.family is not None
    assert found.family.driver == "humidity_percent"
    assert found.probability == found.family.probability > 0.5
    assert "follows humidity_percent" in found.summary().missing
    exec(compile(found.family.draft, "skeleton", "exec"), {})
    try:
        assert diagnose(base, table).answer == (("my_effect",),)
        better = base.add("my_effect").fit(table)
        before, after = ((force - m.predict(table)[:, 0]).std() for m in (base, better))
        assert after < 0.3 * before
    finally:
        unregister("my_effect")


def test_of_six_components_those_that_are_measured_are_taken() -> None:
    @effect("fan", physics="A fan.", parameters={"push": "N"}, needs=("x_m",))
    def fan(rows: Rows) -> F:
        return np.tile(np.arange(6.0), (len(rows), 1))

    @effect("wrong", physics="Rows are lost.", parameters={"push": "N"}, needs=("x_m",))
    def wrong(rows: Rows) -> F:
        return np.zeros((1, 6))

    @effect("broken", physics="Asks for what is not there.", parameters={"push": "N"}, needs=())
    def broken(rows: Rows) -> F:
        return np.asarray(rows.table.column("speed"))

    try:
        table = Table({"x_m": np.linspace(0, 1, 9), "fz_N": np.linspace(0, 2, 9)}, Meta(), "t")
        rows = Rows(table, fit_model(table, "linear").base)
        given = get_effect("fan").jacobian(rows, np.zeros(1))
        assert given[:, :, 0].tolist() == [[2.0]] * 9
        with pytest.raises(InputError, match=r"effect wrong: its function gives shape \(1, 6, 1\)"):
            get_effect("wrong").jacobian(rows, np.zeros(1))
        with pytest.raises(InputError, match="speed"):
            get_effect("broken").jacobian(rows, np.zeros(1))
    finally:
        for id in ("fan", "wrong", "broken"):
            unregister(id)


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
