"""CONFIG and RIG files: defaults, every refusal, and that our own examples are valid."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from ecm.errors import InputError
from ecm.io.mechanism import Mechanism
from ecm.io.table import read_table
from ecm.io.templates import template
from ecm.workflow.config import Config, config_from_dict, read_config, read_rig
from support.neck import ROOT, saved


def test_the_example_is_the_neck_at_the_papers_size() -> None:
    config = read_config(ROOT / "examples" / "neck.toml")
    assert config.mechanism == Mechanism()
    assert (config.simulate.n, config.simulate.n_test, config.design.n) == (1700, 300, 200)
    assert config.workspace.rotation_limit_rad == 0.8
    assert config.workspace.wrench_min == (-110.0, -100.0, -100.0, -5.0, -5.0, -5.0)
    assert config.workspace.wrench_max == (30.0, 100.0, 100.0, 5.0, 5.0, 5.0)
    assert config.select.thresholds == (0.0, 0.1, 0.5)


def test_an_empty_config_is_the_neck() -> None:
    assert config_from_dict({}, "x") == Config(source="x")


def test_the_rigs_example_is_valid() -> None:
    assert read_rig(ROOT / "examples" / "rig.toml").rig.mode == "quasi_static"


def test_what_ecm_new_writes_is_valid(tmp_path: Path) -> None:
    for name in ("config.toml", "arm.toml", "rig.toml", "data.csv", "data.toml"):
        (tmp_path / name).write_text(template(name), encoding="utf-8")
    assert read_config(tmp_path / "config.toml").mechanism == Mechanism()
    arm = (tmp_path / "arm.toml").read_text(encoding="utf-8")
    assert len(read_config(tmp_path / "arm.toml").mechanism.actuators) == 3
    # Its lines on windings and tendons are valid settings, too.
    arm = re.sub(r"(?m)^# (\w+ = )", r"\1", arm)
    (tmp_path / "arm.toml").write_text(arm, encoding="utf-8")
    assert read_config(tmp_path / "arm.toml").mechanism.actuators[-1] == "tension_3_N"
    read_rig(tmp_path / "rig.toml")
    table = read_table(tmp_path / "data.csv", need="fit")
    assert len(table) == 20
    assert table.meta.instrument.force_sd_N == 0.3


@pytest.mark.parametrize(
    ("document", "expected"),
    [
        ({"simulat": {}}, "unknown key 'simulat', did you mean 'simulate'?"),
        ({"simulate": {"N": 3}}, "[simulate]: unknown key 'N'"),
        ({"simulate": {"n": 1.5}}, "[simulate]: n = 1.5: expected a whole number"),
        ({"simulate": {"n": 100, "n_test": 100}}, "n_test = 100: expected above 0 and below n"),
        ({"simulate": {"n": 100, "n_test": 50}}, "[design] n = 200: expected at most the 50"),
        (
            {"simulate": {"n": 70, "n_test": 20}, "design": {"n": 50}},
            "[simulate] n - n_test = 50: expected at least 84, the coefficients",
        ),
        ({"design": {"n": 83}}, "[design] n = 83: expected at least 84, the coefficients"),
        ({"design": {"n": 0}}, "[design]: n = 0: expected at least 1"),
        ({"design": {"n": True}}, "expected a whole number"),
        ({"design": {"starts": "10"}}, "[design]: starts = '10': expected a whole number"),
        ({"select": {"degrees": [3, 1]}}, "degrees = [3, 1]: expected increasing numbers"),
        ({"select": {"degrees": [9]}}, "degrees[0] = 9: expected a number from 1 to 6"),
        ({"select": {"degrees": 3}}, "expected a list in square brackets"),
        ({"select": {"thresholds": [-0.1]}}, "expected at least 0"),
        (
            {"select": {"energy_degrees": [7]}},
            "energy_degrees[0] = 7: expected a number from 3 to 6",
        ),
        ({"workspace": {"rotation_limit_rad": 45.0}}, "in rad, not degrees"),
        ({"workspace": {"wrench_min": [1.0]}}, "wrench_min has 1 entries: expected a list of 6"),
        ({"workspace": {"stretch_limit": float("inf")}}, "expected a finite number"),
        ({"mechanism": {"length_m": 0.1}}, "expected a body for FEM"),
        ({"mechanism": {"builtin": "cylinder"}}, "needs the key 'length_m'"),
        ({"mechanism": 3}, "[mechanism]: found 3, expected a table"),
        (
            {"rig": {"mode": "manual"}},
            "[rig]: mode = 'manual': expected one of quasi_static, robot",
        ),
        ({"instrument": {"force_noise": 1.0}}, "force_noise_N"),
        ({"design": 3}, "[design]: found 3, expected a table"),
    ],
)
def test_refusals_name_file_table_and_key(document: dict[str, Any], expected: str) -> None:
    with pytest.raises(InputError) as caught:
        config_from_dict(document, "neck.toml").check_job()
    assert str(caught.value).startswith("neck.toml")
    assert expected in str(caught.value)


def test_a_few_pairs_are_enough_for_simulate_alone() -> None:
    few = config_from_dict({"simulate": {"n": 60, "n_test": 10}}, "few.toml")
    assert few.simulate.n == 60
    with pytest.raises(InputError, match=r"few.toml: \[design\] n = 200"):
        few.check_job()


def test_the_test_pairs_of_few_pairs_are_few() -> None:
    tested = [config_from_dict({"simulate": {"n": n}}).simulate.n_test for n in (2, 60, 1700)]
    assert tested == [1, 12, 300]


def test_a_mesh_is_looked_for_beside_the_file(tmp_path: Path) -> None:
    path = saved(
        tmp_path / "own.toml",
        '[mechanism]\nmesh = "body.msh"\nlength_m = 0.1\nyoung_modulus_Pa = 1e6\n',
    )
    assert read_config(path).mechanism.mesh_file == tmp_path / "body.msh"
