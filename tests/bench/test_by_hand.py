"""A person who measures one axis with weights and a protractor, and a microcontroller with CSV."""

from __future__ import annotations

import json
import os
import sys
import time
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from bench.test_measure import answering, unsaid
from ecm.bench import Bench, measure
from ecm.bench.devices import DeviceError, opened
from ecm.bench.manual import Manual
from ecm.errors import InputError
from ecm.io.table import as_table, read_table
from ecm.models import fit_model
from support.programs import ended

HAND = ("mover", "wrench", "pose", "person")


def hinge(columns: list[str] | None = None) -> Bench:
    """A bench of one person."""
    tables: dict[str, Any] = {part: {"device": "manual", "sd_rad": 5e-3} for part in HAND}
    tables["columns"] = columns or ["theta_z_rad", "tau_z_Nm"]
    limits = {"answer_s": 0.05, "move_s": 0.05}
    rig = {"offset_compensation": "none", "dwell_s": 0.0, "approach": "previous"}
    tables["instrument"] = {"pose_rotation_sd_rad": 1e-4, "torque_sd_Nm": 2e-3}
    return Bench.from_dict(tables | {"limits": limits, "rig": rig}, "bench.toml")


def test_a_person_types_one_angle_and_one_torque_a_row_and_has_time(tmp_path: Path) -> None:
    angles = np.deg2rad([0.0, 10.0, 20.0, 10.0])
    plan = as_table({"theta_z_rad": angles})
    entries = {
        "pose": ["1 deg", "", "20.5 deg", "0.17"],
        "wrench": ["0", "80 N mm", "165 N mm", "x"],
    }
    entries["wrench"] += ["0.079"]
    prompts: list[str] = []

    def answer(prompt: str) -> str:
        prompts.append(prompt)
        time.sleep(0.1)  # longer than any watchdog of this bench
        key = prompt.split(maxsplit=1)[0]
        return entries[key].pop(0) if key in entries else ""

    bench = hinge()
    person = Manual(ask_for=answer)
    person.columns = bench.columns
    table = measure(plan, bench, tmp_path / "data.csv", devices=dict.fromkeys(HAND, person))
    assert {*table.columns} & {"x_m", "fx_N", "sd_x_m", "tau_x_Nm"} == set()
    assert table.column("theta_z_rad") == pytest.approx([*np.deg2rad([1.0, 10.0, 20.5]), 0.17])
    assert table.column("tau_z_Nm").tolist() == [0.0, 0.08, 0.165, 0.079]
    assert "bring the platform to theta_z 20 deg. Enter when it is done: " in prompts
    assert sum("wrench" in prompt for prompt in prompts) == 5  # no look in between, one mistake
    picture = ElementTree.parse(tmp_path / "data.envelope.svg").getroot()
    texts = [element.text or "" for element in picture.iter() if element.tag.endswith("text")]
    assert [text for text in texts if "up" in text] == ["θy [rad] to the right, θz [rad] up"]
    assert read_table(tmp_path / "data.csv").pose_columns == ("theta_z_rad",)


class Rubbing(Manual):
    """A hinge of 0.9 N m/rad that rubs by `rub`, and a person with a clock who measures it."""

    def __init__(self, rub: float) -> None:
        super().__init__(ask_for=self.answer)
        self.rub, self.side, self.time_s, self.random = rub, 0.0, 0.0, np.random.default_rng(0)

    def now(self) -> float:
        return self.time_s

    def wait(self, seconds: float) -> None:
        self.time_s += seconds

    def start(self, pose: np.ndarray) -> None:
        self.side = np.sign(pose[5] - np.nan_to_num(self._pose[5])) or self.side
        super().start(pose)

    def answer(self, prompt: str) -> str:
        self.time_s += 4.0
        torque = 0.9 * self._pose[5] + self.rub * self.side + 0.002 * self.random.standard_normal()
        return f"{torque:.4f}" if prompt.startswith("wrench") else ""


def test_a_hinge_is_measured_until_its_friction_has_a_name(tmp_path: Path) -> None:
    loop = [*range(0, 25, 5), *range(25, -25, -5), *range(-25, 0, 5)]
    dwell_s = [2.0] * 20 + [60.0] * 20
    plan = as_table({"theta_z_rad": np.deg2rad([*loop, *loop]), "dwell_s": dwell_s})
    bench = hinge()
    rows = {}
    for rub in (0.02, 0.0):
        person, out = Rubbing(rub), tmp_path / f"rubs{rub}.csv"
        person.columns = bench.columns
        devices = dict.fromkeys(HAND, person)
        measure(plan, bench, out, devices=devices, until="named", say=unsaid)
        said = json.loads(out.with_suffix(".until.json").read_text())
        assert (said["reached"], said["names"]) == (rub > 0.0, ["hysteresis"] if rub else [])
        rows[rub] = said["rows"]
    assert rows[0.02] < 0.75 * len(plan) < rows[0.0]
    # The model that lacks something may be given, though no row can be held to it.
    model = fit_model(read_table(tmp_path / "rubs0.0.csv"), "cubic")
    table = measure(
        plan,
        bench,
        out,
        model=model,
        devices=devices,
        until="named",
        say=unsaid,
        minutes=1.0,
        overwrite=True,
    )
    assert len(table) < 12


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ("12 mm", "`mm` is no unit of theta_z_rad"),
        ("twelve", "`twelve` is no number"),
        ("1, 2", "found 2, expected 1 numbers"),
        ("nan", "`nan` is no number"),
    ],
)
def test_a_wrong_entry_is_asked_again(
    entry: str, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    entries = iter([entry, "12 deg"])
    person = Manual(ask_for=lambda prompt: next(entries))
    person.columns = ["theta_z_rad"]
    assert person.pose(0.1)[0][5] == pytest.approx(np.deg2rad(12.0))
    assert words in capsys.readouterr().out


def test_columns_that_do_not_exist_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"columns = \['theta'\]: expected some of x_m, y_m"):
        hinge(["theta"])
    devices = dict.fromkeys(HAND, Manual())
    plan = as_table({"theta_z_rad": [0.1]})
    with pytest.raises(InputError, match="the rig has not all six columns"):
        measure(plan, hinge(), tmp_path / "d.csv", model=object(), devices=devices, say=unsaid)


def test_lines_of_csv() -> None:
    answers = {
        "start,0.0,0.0,0.0,0.0,0.0,0.0": "ok",
        "settled": "ok,1",
        "stop": "error,the brake is on, press it",
        "wrench,0.1": "ok,1,2,3,4,5,6,1,2,3,4,5,6",
        "pose,0.1": "ok,0.1,0,0,0,0,0,1e-5,1e-5,1e-5,1e-6,1e-6,1e-6",
        "temperature": "ok,22.5",
        "ask,free the sensor": "what?",
        "actuate,20000.0,0.0": "ok",
        "actuation": "ok,19900,3",
        "follow,0.02": "ok",
    }
    address = answering(lambda line: f"{answers.pop(line.decode().rstrip())}\r\n".encode())
    device = opened("line", {"address": address, "form": "csv"}, "bench.toml [mover]")
    device.start(np.zeros(6))
    assert device.settled() is True
    with pytest.raises(DeviceError, match="the brake is on, press it"):
        device.stop()
    assert device.wrench(0.1).tolist() == [[1, 2, 3, 4, 5, 6]] * 2
    mean, spread = device.pose(0.1)
    assert (mean[0], spread[5]) == (0.1, 1e-6)
    assert device.temperature() == 22.5
    with pytest.raises(DeviceError, match="expected ok or error, then numbers"):
        device.ask("free the sensor")
    device.actuate(np.array([2e4, 0.0]))
    assert device.actuation().tolist() == [19900.0, 3.0]
    device.follow(0.02)
    assert answers == {}
    device.close()
    with pytest.raises(InputError, match="form = 'xml': expected json or csv"):
        opened("line", {"address": os.devnull, "form": "xml"}, "bench.toml [mover]")


def test_what_is_typed_at_the_terminal_is_a_table(tmp_path: Path) -> None:
    as_table({"theta_z_rad": np.deg2rad([0.0, 10.0, -10.0])}).write(tmp_path / "plan.csv")
    (tmp_path / "bench.toml").write_text(
        'columns = ["theta_z_rad", "tau_z_Nm"]\n'
        '[rig]\noffset_compensation = "none"\ndwell_s = 0.0\n'
        + "".join(f'[{part}]\ndevice = "manual"\n' for part in HAND)
    )
    command = [sys.executable, "-m", "ecm", "measure", "plan.csv", "--rig", "bench.toml"]
    command += ["--out", "data.csv", "--yes"]
    typed = "\n0 deg\n0\n\n10.5 deg\n80 N mm\n"
    cut = ended(*command, cwd=tmp_path, input=typed, code=1)
    assert "nobody answers at the terminal. The mover was stopped, and 2 readings" in cut.stderr
    assert "STOP: bring the platform back to rest" in cut.stdout
    # It goes on after a look at the rest pose.
    whole = ended(*command, cwd=tmp_path, input="\n0.1 deg\n0\n\n\n-82 N mm\n")
    assert "STOP" not in whole.stdout
    table = read_table(tmp_path / "data.csv")
    assert table.text("kind").tolist() == ["pose", "pose", "home", "pose"]
    angles = np.deg2rad([0.0, 10.5, 0.1, -10.0])
    assert table.column("theta_z_rad") == pytest.approx(angles)
    assert table.column("tau_z_Nm").tolist() == [0.0, 0.08, 0.0, -0.082]
