"""The chain without a dead end: from any table to a controller, by the terminal and by the page.

`make chain` goes through the whole matrix, every table with every base; `make test` through one
base of each table.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from support.chain import BASES, TABLES, Walk, walks
from support.neck import SHARED_DATA, Command

_SAMPLE = {
    "neck": "energy4",
    "neck_of_few_rows": "choose",
    "neck_of_forces": "choose",
    "six_axes": "choose",
    "three_axes": "linear",
    "one_axis": "cubic",
    "one_axis_with_a_second_load": "cubic",
    "planar_of_known_length": "choose",
    "rotation_only": "cubic",
    "log_of_one_axis": "cubic",
    "finger_joint": "linear",
}
"""The base of each table in `make test`."""


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """All walks with --whole, else the sample."""
    if {"table", "base"} <= set(metafunc.fixturenames):
        whole = metafunc.config.getoption("--whole")
        metafunc.parametrize(("table", "base"), list(walks()) if whole else list(_SAMPLE.items()))


def test_each_step_ends_in_a_result_or_in_advice_that_works(
    table: str,
    base: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    request: pytest.FixtureRequest,
    ecm_command: Command,
) -> None:
    if table == "finger_joint" and not SHARED_DATA.is_dir():
        pytest.skip("published measurements: no folder ../shared/data beside the repository")
    request.getfixturevalue("neck_physics")
    monkeypatch.chdir(tmp_path)
    whole = request.config.getoption("--whole")
    number = list(TABLES).index(table) + BASES.index(base)
    walk = Walk(
        ecm_command,
        table,
        base,
        tmp_path,
        by_page=number % 2 == 1,
        most=12 if whole else 2,
        **({} if whole else {"targets": ("c", "mujoco")}),
    ).run()
    assert "\n".join(walk.broken) == ""
    assert walk.steps >= 3 or walk.refused
