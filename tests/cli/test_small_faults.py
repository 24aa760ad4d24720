"""Faults of a stranger's first day: devices as outputs, paths in warnings, words in `approach`."""

from __future__ import annotations

import inspect
import json
import os
import sys
from pathlib import Path

import numpy as np
import pytest

import ecm
from ecm.cli.session import brief
from ecm.effects import effect, get_effect, unregister
from ecm.errors import ComputationError, InputError
from ecm.fem.material_fit import MaterialTest, fit_material
from ecm.io.cache import write_json
from ecm.io.columns import POSE, WRENCH
from ecm.models.export import export as export_module
from support.neck import columns_of
from support.programs import ended

SPRING = "x_m,fx_N\n0,0\n0.001,1.1\n0.002,1.9\n0.003,3.2\n"


@pytest.mark.parametrize("name", ["/dev/stdout", "-"])
def test_the_json_goes_to_the_standard_output(name: str, tmp_path: Path) -> None:
    (tmp_path / "d.csv").write_text(SPRING, encoding="utf-8")
    done = ended(sys.executable, "-m", "ecm", "check", "d.csv", "--json", name, cwd=tmp_path)
    assert json.loads(done.stdout)["rows"] == 4
    assert "Testable effects" in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["d.csv"]


def test_a_device_stays_a_device_and_a_link_a_link(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    write_json(pipe, {"a": 1})
    assert json.loads(os.read(reader, 100)) == {"a": 1}
    os.close(reader)
    assert pipe.is_fifo()
    (tmp_path / "there.json").write_text("old", encoding="utf-8")
    (tmp_path / "link.json").symlink_to("there.json")
    write_json(tmp_path / "link.json", [2])
    assert (tmp_path / "link.json").is_symlink()
    assert json.loads((tmp_path / "there.json").read_text(encoding="utf-8")) == [2]
    write_json(Path("/dev/null"), [3])
    assert Path("/dev/null").is_char_device()


def test_a_word_in_approach_is_refused() -> None:
    with pytest.raises(InputError, match=r"row 1, column 'approach': found 'up'.*initial"):
        ecm.Table({"x_m": [0.0, 1e-3, 2e-3], "fx_N": [0.0, 1.0, 2.0], "approach": ["", "up", "7"]})


def test_warnings_name_files_without_their_folders_once() -> None:
    paths = [Path(f"/data/long/way/run{i}.csv") for i in range(5)]
    warnings = [f"{path}: 2 column(s) of your own" for path in paths] + ["general"]
    assert brief(warnings, paths) == [
        "run0.csv, run1.csv, run2.csv and 2 more: 2 column(s) of your own",
        "general",
    ]


@pytest.mark.parametrize("wrench", [0.0, 1.0])
def test_a_rod_of_strange_data_is_a_failed_fit(wrench: float) -> None:
    """Wrenches that are all the same leave a singular stiffness."""
    rng = np.random.default_rng(0)
    poses = rng.uniform(-0.01, 0.01, (40, 6)) + np.array([0.1, 0, 0, 0, 0, 0])
    columns = dict(zip(POSE, poses.T, strict=True)) | {n: np.full(40, wrench) for n in WRENCH}
    with pytest.raises(ComputationError, match="not that of a rod"):
        ecm.fit(columns, "rod", meta={"mechanism": {"length_m": 0.1}})


def test_an_own_effect_says_how_fewer_columns_are_enough() -> None:
    @effect("wind_push", physics="Wind.", parameters={"push": "N"})
    def wind_push(rows: ecm.Table) -> np.ndarray:
        return np.ones((len(rows), 6))

    try:
        missing = get_effect("wind_push").missing(ecm.Table({"x_m": [0.0], "fx_N": [0.0]}))
    finally:
        unregister("wind_push")
    assert missing is not None
    assert "needs=(" in missing.record


def test_a_load_unload_loop_is_said_to_be_one() -> None:
    up = np.linspace(1.0, 1.5, 30)
    stretch = np.concatenate([up, up[-2::-1]])
    elastic = 1e5 * (stretch - stretch**-2)
    unloading = np.arange(len(stretch)) >= len(up)
    loop = MaterialTest("uniaxial", stretch, elastic * np.where(unloading, 0.75, 1.0), "loop.txt")
    warned = fit_material([loop], "neo_hookean").warnings
    assert "loop.txt: loading and unloading differ by" in warned[0]
    assert "keep the rows up to the largest stretch" in warned[0]
    same = fit_material([MaterialTest("uniaxial", stretch, elastic)], "neo_hookean").warnings
    assert not any("unloading" in warning for warning in same)


@pytest.fixture
def folded_badly(monkeypatch: pytest.MonkeyPatch) -> None:
    """Folding its effects changes a model by 36 times the noise."""
    names, name = inspect.unwrap(export_module).__globals__, "_mechanism_alone"
    folded = names[name]
    monkeypatch.setitem(names, name, lambda m: (*folded(m)[:2], 36.0))


@pytest.mark.usefixtures("folded_badly")
def test_a_model_that_folding_changes_beyond_the_noise_is_not_exported(tmp_path: Path) -> None:
    table = ecm.Table({"y_m": [-0.01, 0.0, 0.01], "fy_N": [-30.0, 0.0, 30.0]})
    model = ecm.fit(table, "linear")
    with pytest.raises(InputError, match=r"(?s)36 times the base.s own residual.*force=True"):
        ecm.export(model, "c", tmp_path)
    assert list(tmp_path.iterdir()) == []
    assert ecm.export(model, "c", tmp_path, force=True).folding == 36.0


@pytest.mark.usefixtures("folded_badly")
def test_a_folded_model_without_a_control_loop_is_refused_as_well(tmp_path: Path) -> None:
    """A mechanism that pushes away has no loop; how much folding changes it must not be lost."""
    poses = np.random.default_rng(2).normal(size=(60, 6)) * [1e-3, 1e-3, 1e-3, 0.05, 0.05, 0.05]
    wrenches = -poses * [3000.0, 3000.0, 3000.0, 1.0, 1.0, 1.0]
    table = ecm.as_table(columns_of(poses, wrenches))
    model = ecm.fit(table, "linear", force=True)
    with pytest.raises(InputError, match="36 times an assumed noise"):
        ecm.export(model, "c", tmp_path)
    assert any(
        "No control loop" in note for note in ecm.export(model, "c", tmp_path, force=True).notes
    )


def test_the_way_out_of_a_refused_choice_is_not_to_choose_again(tmp_path: Path) -> None:
    """What acts beside the pose is no model of it: the command that was printed was this one."""
    valve = np.where(np.arange(12) % 2, 5.0, -5.0)
    x = np.random.default_rng(0).uniform(-0.01, 0.01, 12)
    rows = np.column_stack([x, valve + 10.0 * x, valve])
    np.savetxt(tmp_path / "d.csv", rows, delimiter=",", header="x_m,fx_N,valve", comments="")
    way = "ecm fit d.csv --model choose --out m.json"
    done = ended(sys.executable, "-m", *way.split(), cwd=tmp_path, code=1)
    assert "no model of these data" in done.stderr
    assert f"ecm diagnose can name beside this model; save it all the same:\n  {way} --force" in (
        done.stderr
    )
    with pytest.raises(ComputationError, match=r'ecm.fit\(table, "choose", force=True'):
        ecm.fit(tmp_path / "d.csv", "choose")
    model = ecm.fit(tmp_path / "d.csv", "choose", force=True)
    assert ecm.diagnose(model, tmp_path / "d.csv").answer == (("unused_column:valve",),)
