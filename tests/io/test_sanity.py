"""Signs and columns that an elastic body contradicts: what is told, tied, and left alone."""

from __future__ import annotations

import itertools
import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import ecm
from ecm.errors import InputError
from ecm.io.columns import POSE, WRENCH, unit_of_factor
from ecm.io.conventions import WrongConvention, falling_loads, wrong_convention
from ecm.io.description import Meta
from ecm.io.table import Table, as_table, read_table
from ecm.io.templates import data_template, description_template
from support.neck import ROOT, Command, saved

NECK = ROOT / "examples" / "neck_measured.csv"
COLUMNS = (*POSE, *WRENCH)
GROUPS = (POSE[:3], POSE[3:], WRENCH[:3], WRENCH[3:])
PAIRS = [pair for group in GROUPS for pair in itertools.combinations(group, 2)]


@pytest.fixture(scope="module")
def neck() -> Table:
    """Forty of the measured poses of the neck, into which a payload is hidden."""
    table = read_table(NECK).measured()
    return table.select(np.arange(0, len(table), 2))


def negated(table: Table, *names: str) -> Table:
    return table.with_columns({name: -table.column(name) for name in names})


def exchanged(table: Table, first: str, second: str) -> Table:
    return table.with_columns({first: table.column(second), second: table.column(first)})


def told(table: Table, *, decided: bool = True) -> WrongConvention:
    """What is told of a table with which something is wrong."""
    found = wrong_convention(table)
    assert found is not None
    assert found.decided == decided
    return found


@pytest.mark.parametrize("name", COLUMNS)
def test_each_negated_column_is_told(neck: Table, name: str) -> None:
    found = told(negated(neck, name))
    assert found.columns == (name,)
    assert found.sentence().startswith(f"the sign of {name.rsplit('_', 1)[0]} looks reversed: ")
    assert found.mend == (f'{name} = {{ column = "{name}", scale = -1.0 }}',)


@pytest.mark.parametrize(("first", "second"), PAIRS)
def test_each_exchange_of_two_columns_is_told(neck: Table, first: str, second: str) -> None:
    found = told(exchanged(neck, first, second))
    assert set(found.columns) == {first, second}
    assert "look exchanged" in found.what
    assert f'{first} = {{ column = "{second}" }}' in found.mend


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (WRENCH, "the wrench's sign looks reversed"),
        (WRENCH[:3], "the force's sign looks reversed"),
        (WRENCH[3:], "the torque's sign looks reversed"),
        (POSE, "the pose's sign looks reversed"),
        (POSE[3:], "the rotation looks transposed"),
    ],
)
def test_groups_of_columns_are_told(neck: Table, names: tuple[str, ...], words: str) -> None:
    found = told(negated(neck, *names))
    assert found.what.startswith(words)
    assert set(found.columns) == set(names)


@pytest.mark.parametrize("axes", ["xy", "xz", "yz"])
@pytest.mark.parametrize("names", [POSE, WRENCH])
def test_axes_of_pose_or_wrench_exchanged(neck: Table, names: tuple[str, ...], axes: str) -> None:
    a, b = ("xyz".index(axis) for axis in axes)
    wrong = exchanged(exchanged(neck, names[a], names[b]), names[a + 3], names[b + 3])
    found = told(wrong)
    assert set(found.columns) == {names[a], names[b], names[a + 3], names[b + 3]}


def test_few_rows_are_enough_and_never_wrong(neck: Table) -> None:
    random = np.random.default_rng(3)
    for rows in (8, 12, 20):
        some = neck.select(random.choice(len(neck), rows, replace=False))
        assert wrong_convention(some) is None
        for name in ("fx_N", "y_m", "theta_x_rad"):
            found = wrong_convention(negated(some, name))
            assert found is not None
            assert name in found.columns


def test_right_tables_are_left_alone(neck: Table, tmp_path: Path) -> None:
    assert wrong_convention(read_table(NECK)) is None
    for some in (WRENCH[3:], WRENCH[:3], POSE[:3], (*POSE[3:], *WRENCH[3:])):
        assert wrong_convention(neck.drop(*some)) is None
    for dof in (1, 3, 6):
        path = saved(tmp_path / f"data{dof}.csv", data_template(dof))
        path.with_suffix(".toml").write_text(description_template(dof), encoding="utf-8")
        assert wrong_convention(read_table(path)) is None


def springs(stiffness: np.ndarray, random: np.random.Generator, rows: int = 60) -> Table:
    """Poses and wrenches of a stiffness matrix, beside a length of 0.1 m."""
    poses = random.uniform(-1.0, 1.0, (rows, 6)) * np.repeat([0.004, 0.1], 3)
    wrench = poses @ stiffness + 1e-3 * random.standard_normal((rows, 6))
    values = np.hstack([poses + np.array([0.1, 0.0, 0.0, 0.0, 0.0, 0.0]), wrench])
    return as_table(dict(zip(COLUMNS, values.T, strict=True)))


def test_springs_without_a_coupling_do_not_say_which_of_the_two_is_reversed() -> None:
    table = springs(np.diag([3e3, 3e2, 3e2, 3.0, 2.0, 2.0]), np.random.default_rng(0))
    assert wrong_convention(table) is None
    along = told(negated(table, "fx_N"), decided=False)
    assert along.columns == ("fx_N",)  # with -x the top would stand on the other side of the base
    found = told(negated(table, "fy_N"), decided=False)
    assert set(found.columns) == {"fy_N", "y_m"}
    assert found.sentence() == (
        "fy_N falls where its coordinate grows: the sign of fy or of y looks reversed, or the "
        "mechanism is not passive there (pre-loaded, near buckling, driven)"
    )


def test_a_wrong_frame_is_told_as_one(neck: Table) -> None:
    """Where [frames] turned the columns, no entry of [columns] mends them."""
    columns = {name: neck.column(name) for name in COLUMNS}
    reaction = as_table(columns, meta={"frames": {"wrench_by": "mechanism"}})
    found = told(reaction)
    assert "looks reversed (wrench_by of [frames] says whose it is)" in found.sentence()
    remedy = found.refusal("t.csv").remedy
    assert remedy is not None
    assert remedy.words.startswith("mend [frames] in the TOML beside the table")
    # Left-handed axes of pose or wrench: no entry can be printed, and what writes one is said.
    unframed = WrongConvention("the y axis looks reversed", ("fy_N",), True, ("fy_N",))
    assert "[columns]" in unframed.refusal("t.csv").remedy.words
    # Of twelve columns that no sign mends, an axis may be turned.
    falls = ("fy_N", "fz_N")
    told_of = [WrongConvention("", falls, False, falls, whole=whole) for whole in (True, False)]
    assert ["or a frame ([frames]" in one.sentence() for one in told_of] == [True, False]


def test_positions_that_count_from_rest_are_told_with_the_frame() -> None:
    """A stage whose encoders begin at 0: an energy of small motions fits there as well."""
    stage = springs(np.diag([3e3, 3e2, 3e2, 3.0, 2.0, 2.0]), np.random.default_rng(0))
    values = {name: stage[name] - 0.1 * (name == "x_m") for name in COLUMNS}
    found = told(as_table(values, meta=Meta(mechanism={"length_m": 0.1})), decided=False)
    assert "base_from_robot = [0.1, 0, 0, 1, 0, 0, 0] under [frames]" in found.sentence()


def test_a_body_that_buckles_is_not_called_wrong() -> None:
    """Its bending is coupled: no sign mends it, so that it may well be what it is."""
    stiffness = np.diag([3e3, 2e2, 3e2, 3.0, 0.5, 0.5])
    stiffness[1, 5] = stiffness[5, 1] = -14.0
    stiffness[2, 4] = stiffness[4, 2] = 6.0
    assert np.linalg.eigvalsh(stiffness).min() < 0.0
    found = told(springs(stiffness, np.random.default_rng(1)), decided=False)
    assert "or the mechanism is not passive there" in found.sentence()
    assert found.mend == ()


def test_directions_that_no_pose_takes_say_nothing() -> None:
    """Of poses of one load, y and theta_z are the same motion, and the rest of them is noise."""
    random = np.random.default_rng(2)
    load = random.uniform(-1.0, 1.0, 60)
    poses, wrench = np.zeros((60, 6)), np.zeros((60, 6))
    poses[:, 1], poses[:, 5] = 0.01 * load, 0.15 * load
    poses += 1e-5 * random.standard_normal((60, 6))
    wrench[:, 1] = 30.0 * load
    wrench += 1e-3 * random.standard_normal((60, 6))
    there = np.isin(COLUMNS, ("y_m", "theta_z_rad", "fy_N", "tau_z_Nm"))
    assert falling_loads(poses, wrench, there) == ()
    assert falling_loads(poses, -wrench, there) == ("fy_N",)


def test_one_axis_and_three_forces() -> None:
    x = np.linspace(-1e-3, 1e-3, 20)
    one = told(as_table({"x_m": x, "fx_N": -1e4 * x}), decided=False)
    assert one.what == "the wrench's sign looks reversed"
    random = np.random.default_rng(4)
    place = random.uniform(-0.01, 0.01, (30, 3))
    force = -place * [3e3, 5e2, 5e2]
    values = np.hstack([place, force]).T
    # No body can be held that pushes on in every direction.
    told(as_table(dict(zip((*POSE[:3], *WRENCH[:3]), values, strict=True))))


def test_a_real_joint_whose_torque_falls(shared_data: Path) -> None:
    """The gyroscope's x axis points against that of the weights: r = -0.86."""
    path = shared_data / "finger_joint" / "03April2018_full_calculated_data.csv"
    found = told(read_table(path, meta=ROOT / "examples" / "finger_joint.toml"), decided=False)
    assert set(found.columns) == {"tau_x_Nm", "theta_x_rad"}


@pytest.mark.parametrize(
    "wrong", [lambda t: negated(t, "fx_N"), lambda t: exchanged(t, "y_m", "z_m")]
)
@pytest.mark.parametrize("model", ["physics", "energy4"])
def test_fit_refuses_with_an_entry_that_works(
    wrong: Callable[[Table], Table], model: str, tmp_path: Path, ecm_command: Command
) -> None:
    data = tmp_path / "data.csv"
    wrong(read_table(NECK)).write(data)
    shutil.copy(NECK.with_suffix(".toml"), data.with_suffix(".toml"))
    done = ecm_command("fit", data, "--model", model, "--out", tmp_path / "m.json").refused()
    assert not (tmp_path / "m.json").exists()
    assert "fewer coefficients" not in done.err
    entry = re.search(r"^\[columns\]\n(.*)\nThen check it again:\n  ecm (check \S+)$", done.err,
                      re.DOTALL | re.MULTILINE)  # fmt: skip
    assert entry is not None
    said = next(line for line in done.err.splitlines() if "look" in line)
    sentence = said.partition("data.csv: ")[2].partition(". --force")[0]
    report = tmp_path / "check.json"
    before = ecm_command("check", data, "--json", report)
    assert sentence in before.err
    document = json.loads(report.read_text(encoding="utf-8"))
    assert document["misread"]["sentence"] == sentence
    assert sentence in document["warnings"]
    with data.with_suffix(".toml").open("a", encoding="utf-8") as file:
        file.write(f"\n[columns]\n{entry[1]}\n")
    ecm_command(*entry[2].split(), "--json", report).good()
    assert json.loads(report.read_text(encoding="utf-8"))["misread"] is None


def test_an_entry_that_is_there_is_replaced_by_one_of_the_other_sign() -> None:
    x = np.linspace(-1.0, 1.0, 20)
    meta = {
        "columns": {"x_m": {"column": "x", "scale": 1e-3}, "fx_N": {"column": 2, "offset": 4.0}}
    }
    found = wrong_convention(as_table({"x": x, "f": -10.0 * x}, meta=meta))
    assert found is not None
    assert found.mend == ("fx_N = { column = 2, scale = -1.0, offset = -4.0 }",)


@pytest.mark.parametrize(
    ("factor", "unit"),
    [
        (1e-3, "mm"), (1020.0, "mN"), (57.3, "degrees"), (1 / 9.81, "kgf"), (4.448, "lbf"),
        (25.4, "inches"), (0.00878, ""),
        (1.3, ""), (7.0, ""), (300.0, ""), (-1000.0, ""),
    ],
)  # fmt: skip
def test_only_factors_of_units_are_called_a_unit(factor: float, unit: str) -> None:
    found = unit_of_factor(factor)
    assert unit in found
    assert bool(found) == bool(unit)


def test_fit_in_python_refuses_what_the_command_refuses(neck: Table) -> None:
    wrong = negated(neck, "fx_N")
    with pytest.raises(InputError, match="the sign of fx looks reversed") as refused:
        ecm.fit(wrong, "energy4")
    assert refused.value.remedy is not None
    assert "scale = -1.0" in refused.value.remedy.words
    assert refused.value.remedy.force
    assert "force=True in Python" in refused.value.message
    assert ecm.fit(wrong, "linear", force=True).name == "poly:1"
    assert "misread" not in ecm.fit(neck, "linear", force=True).training


def test_what_the_table_does_not_prove_is_in_the_fit_report() -> None:
    y = np.linspace(-0.01, 0.01, 21)
    model = ecm.fit({"y_m": y, "fy_N": -3000.0 * y}, "linear")
    assert "the wrench's sign looks reversed, or the mechanism is not passive" in model.fit_report()
