"""Each map of where a model fails: its data, and a figure that draws these and no others."""

from __future__ import annotations

import numpy as np
import pytest

from ecm.comparison import ResidualMaps, compare
from ecm.comparison.residual_maps import (
    residual_figure,
    signature_figure,
    stiffness_figure,
    workspace_figure,
)
from ecm.errors import InputError
from ecm.models import fit_model
from support.campaigns import campaign, model


@pytest.fixture(scope="module")
def found() -> ResidualMaps:
    return compare(model(), campaign("payload", 2.0, 0)).where()


def drawn(values: np.ndarray) -> list[float]:
    """Numbers as a figure holds them: five digits."""
    return [float(f"{value:.5g}") for value in values]


def test_residuals_over_their_noise_against_a_variable(found: ResidualMaps) -> None:
    """A figure of another frame, unit or component than its data would show."""
    data = found.residual_map("time_s", frame="top", over_noise=False)
    assert list(data) == ["row", "time_s", *found.outputs]
    assert data["fy_N"] == pytest.approx(found.physical["top"][:, 1])
    assert data["row"].astype(int).tolist() == found.row.tolist()
    default = found.residual_map()
    assert found.strongest()[0] in default
    assert default["fx_N"] == pytest.approx(
        found.physical["base"][:, 0] / found.spread["base"][:, 0]
    )
    figure = residual_figure(found, "time_s", frame="top", over_noise=False)
    assert len(figure["data"]) == 6
    for trace, name in zip(figure["data"], found.outputs, strict=True):
        assert trace["x"] == drawn(data["time_s"])
        assert trace["y"] == drawn(data[name])
        assert trace["customdata"] == found.row.tolist()
    variables, units = figure["layout"]["updatemenus"]
    assert variables["buttons"][variables["active"]]["label"] == "time_s"
    assert units["buttons"][units["active"]]["label"] == "top axes, in its unit"


@pytest.mark.parametrize("frame", ["base", "top"])
@pytest.mark.parametrize("over_noise", [True, False])
def test_what_an_effect_predicts_stands_on_the_residual(
    found: ResidualMaps, frame: str, over_noise: bool
) -> None:
    """What predicts the residual itself lies on it, in either frame and unit."""
    figure = residual_figure(
        found, "x_m", frame=frame, over_noise=over_noise, predicted=found.physical["base"]
    )
    residual, predicted = figure["data"][:6], figure["data"][6:]
    assert len(predicted) == 6
    for own, other in zip(residual, predicted, strict=True):
        assert other["y"] == pytest.approx(own["y"], rel=1e-4, abs=1e-9)
        assert other["yaxis"] == own["yaxis"]
        assert other["marker"]["symbol"] != own["marker"]["symbol"]
    steps = np.arange(found.physical["base"].size, dtype=np.float64).reshape(-1, 6)
    data = found.residual_map("x_m", predicted=steps)
    assert data["predicted fz_N"] == pytest.approx(steps[:, 2] / found.spread["base"][:, 2])


def test_workspace_signature_and_stiffness(found: ResidualMaps) -> None:
    workspace = found.workspace_map()
    assert workspace["over_noise"] == pytest.approx(found.size)
    assert {"row", "x_m", "theta_z_rad"} <= set(workspace)
    first = workspace_figure(found)["data"][0]
    assert first["x"] == drawn(workspace["theta_y_rad"])
    order = np.argsort(workspace["over_noise"])
    assert np.all(np.diff(np.array(first["marker"]["size"])[order]) >= 0.0)

    shares = found.signature_map()
    assert shares == found.shares
    assert list(shares.values()) == sorted(shares.values(), reverse=True)
    bar = signature_figure(found)["data"][0]
    assert dict(zip(bar["x"], bar["y"], strict=True)) == shares

    stiffness = found.stiffness_map()
    assert stiffness is not None
    figure = stiffness_figure(found)
    assert figure is not None
    cells = figure["data"][0]["text"]
    for i, j in np.ndindex(6, 6):
        beyond = abs(stiffness["value"][i, j]) > 3.0 * stiffness["sd"][i, j]
        assert cells[i][j].startswith("<b>") == beyond
        assert (figure["data"][0]["z"][i][j] != 0.0) == beyond
        value, _, sd = cells[i][j].replace("<b>", "").replace("</b>", "").partition(" ± ")
        assert float(value) == pytest.approx(stiffness["value"][i, j], rel=0.06)
        assert float(sd) == pytest.approx(stiffness["sd"][i, j], rel=0.06)


def test_maps_that_the_columns_do_not_allow(found: ResidualMaps) -> None:
    with pytest.raises(InputError, match="no 'tmie_s'"):
        found.residual_map("tmie_s")
    table = campaign("", 1.0, 1).select(np.arange(40))
    small = table.drop("fx_N", "theta_x_rad")
    partial = compare(fit_model(small, "linear", force=True), small).where()
    assert partial.stiffness_map() is None
    assert stiffness_figure(partial) is None
    with pytest.raises(InputError, match="no 'top'"):
        residual_figure(partial, frame="top")
