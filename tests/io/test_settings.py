"""The reader of settings: types by annotation, ranges by field, the same checks in Python."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from ecm.errors import InputError
from ecm.io.settings import Checked, read_settings, setting


@dataclass(frozen=True)
class Oven(Checked):
    name: str = setting()
    mode: str = setting("warm", choices=("warm", "hot"))
    power_W: float = setting(100.0, above=0.0, high=2e3)
    """heater."""
    offset_K: float | None = setting(None, high=5.0)
    shelves: int = setting(3, low=1)
    size_m: tuple[float, ...] = setting((0.3, 0.2), low=0.1, high=1.0)
    steps_s: tuple[float, ...] = setting((1.0, 2.0), low=0.0, any_size=True)
    sensor: str | int = setting(1, low=0)
    fan: bool = True
    log: Path = Path("oven.log")


def test_a_table_becomes_the_dataclass() -> None:
    table = {"name": "a", "shelves": 4.0, "size_m": [1, 0.5], "steps_s": [3], "sensor": "left",
             "offset_K": -2, "fan": False, "log": "b.log"}  # fmt: skip
    oven = read_settings(Oven, table, "o.toml [oven]")
    assert oven == Oven(
        "a", shelves=4, size_m=(1.0, 0.5), steps_s=(3.0,), sensor="left", offset_K=-2.0, fan=False,
        log=Path("b.log"),
    )  # fmt: skip
    assert [type(oven.shelves), type(oven.offset_K), type(oven.size_m[0])] == [int, float, float]


@pytest.mark.parametrize(
    ("key", "value", "expected"),
    [
        ("power_W", 0.0, "power_W = 0.0: expected above 0 and at most 2000 (heater)"),
        ("power_W", True, "power_W = True: expected a number"),
        ("power_W", float("inf"), "power_W = inf: expected a finite number (heater)"),
        ("mode", "hat", "mode = 'hat': expected one of warm, hot, did you mean 'hot'?"),
        ("offset_K", 6.0, "offset_K = 6.0: expected at most 5"),
        ("shelves", 0, "shelves = 0: expected at least 1"),
        ("shelves", 1.5, "shelves = 1.5: expected a whole number"),
        ("size_m", [0.3], "size_m has 1 entries: expected a list of 2 numbers"),
        ("size_m", [0.3, 3.0], "size_m[1] = 3.0: expected a number from 0.1 to 1"),
        ("size_m", 0.3, "size_m = 0.3: expected a list in square brackets"),
        ("steps_s", [0.0, "x"], "steps_s[1] = 'x': expected a number"),
        ("sensor", 1.5, "sensor = 1.5: expected text in quotes or a whole number"),
        ("sensor", -1, "sensor = -1: expected at least 0"),
        ("fan", 1, "fan = 1: expected true or false"),
        ("log", 3, "log = 3: expected text in quotes"),
        ("powr_W", 3.0, "unknown key 'powr_W', did you mean 'power_W'?"),
    ],
)
def test_refusals_name_place_value_and_range(key: str, value: Any, expected: str) -> None:
    with pytest.raises(InputError) as caught:
        read_settings(Oven, {"name": "a", key: value}, "o.toml [oven]")
    assert str(caught.value) == f"o.toml [oven]: {expected}"


def test_a_required_key_and_a_table_are_needed() -> None:
    with pytest.raises(InputError, match="the key 'name' is missing"):
        read_settings(Oven, {}, "o.toml [oven]")
    with pytest.raises(InputError, match="found 3, expected a table"):
        read_settings(Oven, 3, "o.toml [oven]")


def test_ranges_hold_in_python_as_well() -> None:
    with pytest.raises(InputError, match="shelves = 0: expected at least 1"):
        Oven("a", shelves=0)
