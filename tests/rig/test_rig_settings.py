"""The rig file: every wrong entry is refused with its place and what was expected."""

from __future__ import annotations

from typing import Any

import pytest

from ecm.errors import InputError
from ecm.io.settings import read_toml
from ecm.rig import RigSettings
from support.neck import ROOT


def test_defaults_stand_where_nothing_is_said() -> None:
    settings = RigSettings.from_dict({"rig": {"dwell_s": 8}})
    assert settings.rig.dwell_s == 8.0
    assert settings.rig.window_s == 0.2
    assert RigSettings.from_dict(settings.to_dict()) == settings


@pytest.mark.parametrize(
    ("tables", "words"),
    [
        ({"rgi": {}}, ["rig.toml", "rgi", "did you mean 'rig'"]),
        ({"rig": {"dwel_s": 1.0}}, ["rig.toml [rig]", "dwel_s", "did you mean 'dwell_s'"]),
        ({"rig": {"dwell_s": "two"}}, ["dwell_s", "'two'", "a number"]),
        ({"rig": {"dwell_s": -1.0}}, ["dwell_s", "-1.0", "from 0"]),
        ({"rig": {"dwell_s": float("nan")}}, ["dwell_s", "nan"]),
        ({"rig": {"offset_every": 2.5}}, ["offset_every", "a whole number"]),
        ({"rig": {"mode": "by hand"}}, ["mode", "quasi_static, robot"]),
        (
            {"rig": {"mode": "robot", "impedence_N_m": 900.0}},
            ["impedence_N_m", "did you mean 'impedance_N_m'"],
        ),
        ({"rig": {"mode": "robot", "dwel_s": 1.0}}, ["did you mean 'dwell_s'"]),
        ({"rig": {"mode": "robot", "step_s": 1.0}}, ["step_s", "to 0.002"]),
        ({"rig": {"impedance_N_m": 900.0}}, ["impedance_N_m", 'mode = "robot"']),
        ({"rig": {"approach": "sideways"}}, ["approach", "initial, previous"]),
        ({"rig": 3}, ["rig.toml [rig]", "a table"]),
        ({"instrument": {"fts_range": [400.0]}}, ["fts_range", "6 numbers"]),
        ({"instrument": {"zeroed_with_payload": 1}}, ["zeroed_with_payload", "true or false"]),
        ({"instrument": {"top_from_sensor": [0, 0, 0, 2, 0, 0, 0]}}, ["quaternion", "norm 2"]),
        ({"hidden": {"effect": "fts_drfit"}}, ["[hidden]", "did you mean 'fts_drift'"]),
        ({"hidden": {"strength": 0.0}}, ["strength", "0.0"]),
    ],
)
def test_wrong_entries_are_refused(tables: dict[str, Any], words: list[str]) -> None:
    with pytest.raises(InputError) as caught:
        RigSettings.from_dict(tables, "rig.toml")
    for word in words:
        assert word in str(caught.value)


def test_the_example_shows_every_key_at_its_default() -> None:
    path = ROOT / "examples" / "rig.toml"
    tables = read_toml(path, "rig")
    defaults = RigSettings().to_dict()
    assert RigSettings.from_dict(tables, str(path)).to_dict() == defaults
    for table, keys in tables.items():
        assert set(keys) == set(defaults[table]), table


@pytest.mark.parametrize("rate", [61.0, 0.01])
def test_a_stream_is_not_faster_than_its_camera_nor_slower_than_a_way(rate: float) -> None:
    with pytest.raises(InputError, match=r"\[rig\] stream_Hz.*\[instrument\] camera_rate_Hz = 60"):
        RigSettings.from_dict({"rig": {"stream_Hz": rate}})
    for fine in (0.0, 0.1, 60.0):
        assert RigSettings.from_dict({"rig": {"stream_Hz": fine}}).rig.stream_Hz == fine
