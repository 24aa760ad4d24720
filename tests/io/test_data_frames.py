"""Data frames, dicts and files where a table is expected; descriptions as dicts."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ecm
from ecm.errors import InputError
from ecm.io.description import Meta
from ecm.io.sanity import doubts

NOISE = 0.02


def spring() -> dict[str, np.ndarray]:
    x = np.linspace(-1e-3, 1e-3, 24)
    return {"x_m": x, "fx_N": 1e4 * x + NOISE * np.random.default_rng(0).standard_normal(24)}


class PolarsLike:
    """As polars: columns is a list of str, items are series that become arrays; no mapping."""

    def __init__(self, columns: dict[str, Any]) -> None:
        self._columns = columns

    @property
    def columns(self) -> list[str]:
        return list(self._columns)

    def __getitem__(self, name: str) -> Any:
        return memoryview(self._columns[name])


def test_every_verb_takes_a_data_frame_a_dict_and_a_file(tmp_path: Path) -> None:
    pandas = pytest.importorskip("pandas")
    columns = spring()
    ecm.Table(columns).write(tmp_path / "spring.csv")
    meta = {"instrument": {"force_sd_N": NOISE, "pose_position_sd_m": 0.0}}
    expected = None
    for data in (pandas.DataFrame(columns), columns, tmp_path / "spring.csv", PolarsLike(columns)):
        model = ecm.fit_model(data, "linear", meta=meta)
        compared = ecm.compare(model, data, meta=meta)
        found = ecm.diagnose(model, data, meta=meta, effects=[])
        checked = ecm.check(data, meta=meta)
        assert ecm.predict(model, data)["fx_N"].shape == model.predict(data)[:, 0].shape == (24,)
        assert model.fit(data).name == model.name
        assert ecm.cross_validate(data, "linear", folds=3).folds == 3
        result = (compared.noise.source, found.verdict, checked.rows, compared.whitened_rms)
        expected = expected or result
        assert result == expected
        assert result[:3] == ("declared", "none", 24)


def test_spans_of_time_are_read_in_seconds_also_as_an_index() -> None:
    pandas = pytest.importorskip("pandas")
    span = pandas.to_timedelta(np.arange(24) * 1500, unit="ms")
    frame = pandas.DataFrame(spring())
    for data in (frame.assign(time_s=span), frame.set_index(span)):
        assert ecm.as_table(data)["time_s"].tolist() == (1.5 * np.arange(24)).tolist()


@pytest.mark.parametrize("scale", [1.0, 1e3, 1e9])
def test_time_of_a_clock_is_told_with_what_makes_it_time_since_the_start(scale: float) -> None:
    table = ecm.as_table(spring() | {"time_s": scale * (1.7e9 + np.arange(24.0))})
    (said,) = doubts(table, None)
    assert "time_s begins only at 1.7e+" in said
    assert f"State offset = {-1.7e9 * scale:.10g} for it" in said


def test_dates_count_from_the_first_in_a_table_as_in_an_import() -> None:
    pandas = pytest.importorskip("pandas")
    dates = pandas.date_range("2026-01-05", periods=24, freq="s", tz="Europe/Berlin")
    frame = pandas.DataFrame(spring(), index=dates)
    table = ecm.as_table(frame)
    assert table["time_s"].tolist() == list(range(24))
    assert not doubts(table, None)
    own = ecm.as_table(frame.rename_axis("time_s").reset_index())
    assert own["time_s"].tolist() == table["time_s"].tolist()
    texts = pandas.DataFrame(spring()).assign(time_s=dates.strftime("%d.%m.%Y %H:%M:%S"))
    with pytest.raises(ecm.InputError, match=r"every row .*'05\.01.*\n.*\n.*import_log\(log\)"):
        ecm.fit(texts, "linear")
    assert ecm.import_log(texts).table["time_s"].tolist() == list(range(24))
    log = ecm.import_log(frame.rename_axis("Date").reset_index())
    assert log.table["time_s"].tolist() == table["time_s"].tolist()


def test_a_table_is_made_of_a_frame_and_becomes_one_again() -> None:
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame(spring() | {"approach": "initial"}, index=range(7, 31))
    table = ecm.Table(frame, meta={"mechanism": {"length_m": 0.1}, "run": {0: {"note": "dry"}}})
    assert table.meta.length_m == 0.1
    assert table.meta.runs == {0: {"note": "dry"}}
    pandas.testing.assert_frame_equal(pandas.DataFrame(table), frame.reset_index(drop=True))
    again = ecm.as_table(table, meta={"file": {"kind": "continuous"}})
    assert again.meta.file.kind == "continuous"
    assert again.meta.length_m is None


def test_an_xarray_dataset_gives_its_coordinates_and_variables() -> None:
    columns = spring()
    values = {"x_m": columns["x_m"], "fx_N": columns["fx_N"], "temperature_degC": np.array(21.5)}
    data = type("Dataset", (), {"__getitem__": lambda self, name: values[name]})()
    data.coords, data.data_vars = {"x_m": 0, "temperature_degC": 0}, {"fx_N": 0}
    table = ecm.Table(data)
    assert list(table.keys()) == ["x_m", "temperature_degC", "fx_N"]
    assert (table["temperature_degC"] == 21.5).all()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"fx_N": [1.0, np.nan, 3.0]}, ["row 1", "column 'fx_N'", "skip_bad_rows=True", "from 0"]),
        ({"fx_N": ["1", "two", "3"]}, ["row 1", "column 'fx_N'", "'two'"]),
        ({"kind": ["pose", "pose", "rest"]}, ["row 2", "column 'kind'", "pose, home or unloaded"]),
        ({"fx_kN": [1.0, 2.0, 3.0]}, ["column 'fx_kN'", "'fx_N'"]),
    ],
)
def test_errors_name_column_and_row_of_the_frame(change: dict[str, Any], words: list[str]) -> None:
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame({"x_m": [0.0, 1e-3, 2e-3], "fx_N": [0.0, 1.0, 2.0]} | change)
    for made in (lambda: ecm.Table(frame), lambda: ecm.fit_model(frame, "linear")):
        with pytest.raises(InputError) as error:
            made()
        assert all(word in str(error.value) for word in words), error.value


def test_a_wrong_description_is_refused() -> None:
    with pytest.raises(InputError, match=r"meta.*lenght_m"):
        ecm.Table(spring(), meta={"mechanism": {"lenght_m": 0.1}})
    with pytest.raises(InputError, match="expected a Meta or a dict"):
        ecm.Table(spring(), meta=["mechanism"])  # type: ignore[arg-type]


def test_a_checked_description_takes_the_columns_as_they_are() -> None:
    columns = spring()
    assert ecm.Table(columns, Meta()).columns is columns


def test_a_comparison_prints_about_ten_lines_and_draws_itself() -> None:
    columns = spring()
    names = ("y_m", "z_m", "theta_x_rad", "theta_y_rad", "theta_z_rad")
    rng = np.random.default_rng(1)
    for name in names:
        columns[name] = 1e-3 * rng.standard_normal(24)
    for name in ("fy_N", "fz_N", "tau_x_Nm", "tau_y_Nm", "tau_z_Nm"):
        columns[name] = rng.standard_normal(24)
    result = ecm.compare(ecm.fit_model(columns, "linear", force=True), columns)
    lines = str(result).splitlines()
    assert lines[0] == result.sentence()
    assert 8 <= len(lines) <= 11
    assert all(len(line) < 100 for line in lines[1:])
    assert any(line.startswith("tau_z_Nm ") for line in lines)
    figures = pytest.importorskip("plotly.graph_objects")
    assert isinstance(result.plot(), figures.Figure)
    assert isinstance(
        ecm.diagnose(ecm.fit(columns, "linear", force=True), columns, effects=[]).plot(),
        figures.Figure,
    )


def test_a_table_keeps_its_numbers_when_the_arrays_it_was_made_of_are_filled_anew() -> None:
    pandas = pytest.importorskip("pandas")
    for given in (spring(), pandas.DataFrame(spring())):
        table = ecm.as_table(given)
        first = table["fx_N"].tolist()
        for column in table.columns:
            assert not np.shares_memory(table[column], np.asarray(given[column]))
        assert table["fx_N"].tolist() == first


@pytest.mark.parametrize("form", ["dict", "record"])
def test_a_masked_cell_is_an_empty_one(form: str) -> None:
    columns: Any = {name: np.ma.array(own) for name, own in spring().items()}
    assert ecm.as_table(columns)["fx_N"].tolist() == spring()["fx_N"].tolist()
    columns["fx_N"][3] = np.ma.masked
    if form == "record":
        columns = np.ma.core.MaskedArray(
            np.rec.fromarrays(columns.values(), names=list(columns)),
            mask=[(False, row == 3) for row in range(24)],
        )
    with pytest.raises(InputError, match=r"row 3, column 'fx_N': found an empty cell"):
        ecm.as_table(columns)
    assert len(ecm.as_table(columns, skip_bad_rows=True)) == 23


def test_complex_numbers_are_refused_and_not_cut() -> None:
    with pytest.raises(InputError, match="column 'fx_N' is text in every row"):
        ecm.as_table(spring() | {"fx_N": spring()["fx_N"] * 1j})


def test_results_that_hold_arrays_are_compared_without_an_error() -> None:
    table = ecm.as_table(spring())
    model = ecm.fit_model(table, "linear")
    for one in (table, model, ecm.compare(model, table), ecm.diagnose(model, table, effects=[])):
        assert one == one  # noqa: PLR0124 - that is what is asked
        assert one != pickle.loads(pickle.dumps(one))
        assert one in {one}
