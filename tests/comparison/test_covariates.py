"""Columns that grow with the order of rows: ranks of all groups at once."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import spearmanr

from ecm.comparison import residuals
from ecm.comparison.residuals import confounded_with_order
from ecm.io.table import as_table


def grouped(noise: float) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Groups of 1 to 9 rows in mixed order, a load that grows with time, ties in both."""
    random = np.random.default_rng(5)
    sizes = random.integers(1, 10, 60)
    part = random.permutation(np.repeat(np.arange(60), sizes))
    time = np.round(random.uniform(0.0, 20.0, len(part)))
    load = np.round(time + 100.0 * part + noise * random.normal(size=len(part)))
    return {"time_s": time, "fx_N": load, "x_m": 1e-3 * random.normal(size=len(part))}, part


@pytest.mark.parametrize("noise", [0.0, 2.0, 5.0, 8.0, 30.0])
def test_the_rule_is_the_median_rank_correlation_of_the_groups(noise: float) -> None:
    columns, part = grouped(noise)
    expected = []
    for group in range(60):
        time, load = (columns[name][part == group] for name in ("time_s", "fx_N"))
        if len(time) >= 4 and np.ptp(time) > 0.0 and np.ptp(load) > 0.0:
            expected.append(abs(spearmanr(time, load).statistic))
    follows = residuals.in_one_order(columns["time_s"], columns["fx_N"], part)
    assert follows == (np.median(expected) > 0.9)


def test_a_load_that_grows_in_every_group_cannot_be_told_from_time() -> None:
    columns, part = grouped(0.0)
    load = np.arange(1.0, len(part) + 1.0)  # the order of time is that of the rows
    given = {"x_m": columns["x_m"], "fx_N": load, "group": part.astype(float)}
    table = as_table(given, meta={"columns": {"group": ["group"]}})
    assert "load" in confounded_with_order(table, ("x_m",), ("fx_N",))
    mixed = table.with_columns({"fx_N": np.random.default_rng(0).permutation(load)})
    assert "load" not in confounded_with_order(mixed, ("x_m",), ("fx_N",))
