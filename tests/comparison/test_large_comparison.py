"""Large tables: errors of all rows; noise, references, maps and figures of some, which is said."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from ecm.comparison import compare
from ecm.comparison.result import Comparison
from ecm.diagnosis import diagnose
from ecm.diagnosis.summary import diagnosis_report
from ecm.io.table import Table
from ecm.models.errors import residuals, residuals_by_block
from ecm.regression.noise import Noise
from ecm.regression.rows import Rows
from ecm.report import TextBlock
from support.campaigns import campaign, model, physics
from support.report_pages import figures_of


@lru_cache(maxsize=1)
def long_table(times: int = 10) -> Table:
    """One campaign after the other, each with noise of its own."""
    table = campaign("payload", 2.0, 0)
    n = len(table)
    random = np.random.default_rng(0)
    first = np.repeat(np.arange(times), n)
    columns = {name: np.tile(values, times) for name, values in table.columns.items()}
    for name, sd in (("fx_N", 0.1), ("fy_N", 0.1), ("fz_N", 0.1)):
        columns[name] = columns[name] + sd * random.standard_normal(times * n)
    columns["time_s"] = columns["time_s"] + 1.1 * np.ptp(table.column("time_s")) * first
    return Table(columns, table.meta, "long")


@lru_cache(maxsize=1)
def long_comparison() -> Comparison:
    return compare(model(), long_table())


def test_errors_are_those_of_all_rows_and_the_rest_of_some() -> None:
    table, noise = long_table(), Noise(source="declared")
    every = compare(model(), table, noise=noise, most_rows=len(table))
    some = compare(model(), table, noise=noise, most_rows=400)
    assert [c.rmse for c in some.components] == [c.rmse for c in every.components]
    assert (some.excess_low, some.excess_high) == (every.excess_low, every.excess_high)
    assert every.rows_used is None
    assert some.rows_used is not None
    assert (some.rows_used.used, some.rows_used.of_table) == (400, len(table))
    few, all_ = some.where(), every.where()
    assert len(few.row) < 420 < len(all_.row)
    # The worst rows are those of the whole table. Poses weigh more evenly than in all rows.
    assert few.worst() == all_.worst()
    for name, share in all_.shares.items():
        assert few.shares[name] == pytest.approx(share, abs=0.1)
    numbers = few.variables["row"]
    np.testing.assert_array_equal(numbers, few.row)
    np.testing.assert_allclose(few.variables["time_s"], table.column("time_s")[few.row - 1])


def test_a_large_comparison_says_so_in_every_form() -> None:
    result = compare(model(), long_table(), noise=Noise(source="declared"), most_rows=400)
    assert result.rows_used is not None
    sentence = result.rows_used.sentence()
    assert sentence.startswith(f"400 of {len(long_table())} rows were used")
    assert TextBlock(sentence) in result.report().sections[0].blocks
    assert sentence in str(result).replace("\n", " ")


def test_blocks_of_rows_give_the_residuals_of_all(monkeypatch: pytest.MonkeyPatch) -> None:
    rows, noise = Rows(campaign(), physics()), Noise()
    whole = residuals(rows, rows.wrench, noise, physics().error)
    monkeypatch.setattr("ecm.models.errors._BLOCK", 50)
    physical, whitened, variance = residuals_by_block(rows, rows.wrench, noise, physics().error)
    np.testing.assert_array_equal(physical, whole.physical)
    np.testing.assert_allclose(whitened, whole.whitened, rtol=1e-12)
    np.testing.assert_allclose(variance, np.einsum("nii->ni", whole.covariance), rtol=1e-12)


def test_the_page_of_three_thousand_rows_is_at_most_three_megabytes(tmp_path: Path) -> None:
    result = long_comparison()
    assert result.rows > 2500
    maps = result.where()
    predicted = np.random.default_rng(0).standard_normal((len(maps.row), 6))
    page = tmp_path / "found.html"
    diagnosis_report(diagnose(model(), campaign()).to_dict(), result, predicted).write(page)
    assert page.stat().st_size < 3e6
    drawn = [t for f in figures_of(page) for t in f["data"] if t.get("meta") == "measured rows"]
    assert drawn
    shown = drawn[0]["customdata"]
    assert 1000 <= len(shown) <= 1010
    assert {item["row"] for item in maps.worst()} <= set(shown)
    assert f"{len(shown)} of {result.rows} rows are drawn" in page.read_text(encoding="utf-8")
