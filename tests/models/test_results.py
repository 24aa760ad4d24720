"""Results of models print themselves, draw themselves, and become DataFrames."""

from __future__ import annotations

import numpy as np
import pytest

from ecm.errors import InputError
from ecm.models import CrossValidation, EnergyModel, LearningCurve, ModelChoice, PolynomialModel
from support.campaigns import campaign, model

CURVE = LearningCurve(
    "energy4", (10, 20), np.array([1.6, np.inf]), np.ones(2), np.full(2, 2.0), None, None
)
CHOICE = ModelChoice(
    (PolynomialModel(3, pcr="press"), EnergyModel(4)), (60, 22), np.array([2.0, 1.0]), np.ones(2), 1
)


def test_results_print_themselves() -> None:
    assert str(CHOICE).splitlines() == [
        "cubic --pcr press: 60 coefficients, held-out error 2 +- 1 of the noise",
        "energy4: 22 coefficients, held-out error 1 +- 1 of the noise",
        "chosen: the fewest coefficients within one standard error of the smallest error",
        "that is energy4",
    ]
    assert str(CURVE).splitlines() == [
        "energy4 from 10 poses: held-out error 1.6 of the noise",
        "not enough: the curve still falls at the last of these; measure more poses",
    ]


def test_results_become_data_frames() -> None:
    pytest.importorskip("pandas", reason="pandas is not installed (extra data)")
    assert CHOICE.to_pandas().loc["energy4", "error"] == 1.0
    assert CURVE.to_pandas().loc[10].tolist() == [1.6, 1.0, 2.0]
    held_out = CrossValidation({"fx_N": 0.5}, {"fx_N": 10.0}, 10, True)
    assert held_out.to_pandas().loc["fx_N"].tolist() == [0.5, 10.0]
    fitted = model().add("payload").fit(campaign("payload", 1.0, 0))
    frame = fitted.to_pandas()
    assert frame["value"].tolist() == fitted.effects[0].values.tolist()
    assert frame["effect"].tolist() == ["payload"] * len(frame)


def test_results_draw_themselves() -> None:
    pytest.importorskip("plotly", reason="plotly is not installed (extra report)")
    lines = CURVE.plot().data
    assert [line.name for line in lines] == ["median", "lower quartile", "upper quartile"]
    assert tuple(lines[1].x) == (10, 20)
    with pytest.raises(InputError, match="no history"):
        model().plot()
    fitted = model().add("payload").fit(campaign("payload", 1.0, 0))
    fitted_rows, held_out = fitted.plot().data
    assert tuple(fitted_rows.y) == tuple(record.train for record in fitted.history)
    assert tuple(held_out.x) == tuple(record.name for record in fitted.history)
