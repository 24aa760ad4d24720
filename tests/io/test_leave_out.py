"""`[leave_out]` in a description that a user wrote by hand."""

from __future__ import annotations

import pytest

from ecm import InputError, as_table
from ecm.io.description import with_columns, with_leave_out
from ecm.io.settings import parse_toml


def test_reasons_of_the_users_own_words_and_comments_stay_readable() -> None:
    text = (
        '[file]\nkind = "continuous"\n[ leave_out ]  # mine\n"spilled coffee" = "1-3"\n'
        "# the bench of room 3\n[scene]\npayload_mass_kg = 0.5\n"
    )
    found = with_leave_out(text, {"clipped": "7", "spilled coffee": "1-3"})
    assert parse_toml(found, "here", "text") == {
        "file": {"kind": "continuous"},
        "scene": {"payload_mass_kg": 0.5},
        "leave_out": {"clipped": "7", "spilled coffee": "1-3"},
    }
    assert "# the bench of room 3\n[scene]" in found


@pytest.mark.parametrize("text", ['leave_out.coffee = "1-3"\n', 'leave_out = {coffee = "1"}\n'])
def test_another_form_is_refused_before_anything_is_written(text: str) -> None:
    with pytest.raises(InputError, match=r"write it as \[leave_out\]"):
        with_leave_out(text, {"clipped": "7"})


def test_a_description_that_leaves_out_every_row_is_told_so() -> None:
    with pytest.raises(InputError, match="names every one of the 2 rows"):
        as_table({"x_m": [0.0, 1e-3]}, meta={"leave_out": {"all": "1-2"}})


def test_columns_take_the_place_of_their_own_and_the_rest_stays() -> None:
    text = '[columns]  # mine\nx_m = "a"\ny_m = {column = "b", scale = 2.0}\n\n[scene]  # lab\n'
    found = with_columns(text, ('y_m = { column = "c" }', 'z_m = { column = "d" }'))
    assert found.startswith("[columns]  # mine\ny_m = { column")
    assert found.endswith("[scene]  # lab\n")
    columns = parse_toml(found, "s.toml", "s.toml")["columns"]
    assert columns == {"x_m": "a", "y_m": {"column": "c"}, "z_m": {"column": "d"}}
    with pytest.raises(InputError):
        with_columns('columns = {x_m = "a"}\n', ('x_m = { column = "b" }',))
