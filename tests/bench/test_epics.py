"""Process variables of a soft IOC in another process, by Channel Access."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ecm.bench import Bench, measure
from ecm.bench.devices import DeviceError, opened
from ecm.io.columns import POSE
from ecm.io.description import Meta
from ecm.io.table import as_table
from support import soft_ioc
from support.programs import until

MILLIMETRES = soft_ioc.SCALE.tolist()


@pytest.fixture(scope="module", autouse=True)
def ioc() -> Iterator[subprocess.Popen[str]]:
    """The soft IOC on a free port of this machine."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    own = {
        "EPICS_CA_ADDR_LIST": f"127.0.0.1:{port}",
        "EPICS_CA_AUTO_ADDR_LIST": "NO",
        "EPICS_CA_SERVER_PORT": str(port),
    }
    with pytest.MonkeyPatch.context() as patch:
        for name, value in own.items():
            patch.setenv(name, value)
        command = [sys.executable, soft_ioc.__file__, str(port)]
        quiet: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
        process = subprocess.Popen(command, text=True, **quiet)
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        yield process
        process.kill()
        process.communicate()


def motors() -> dict[str, Any]:
    """The table [mover]."""
    fields = {"setpoint": "VAL", "readback": "RBV", "done": "DMOV", "stop": "STOP"}
    names = {key: [f"rig:{a}.{field}" for a in soft_ioc.AXES] for key, field in fields.items()}
    return {"device": "epics-motors", "scale": MILLIMETRES} | names


def opened_as(device: str, **settings: Any) -> Any:
    """Open a device."""
    return opened(device, settings, "bench.toml [mover]")


def put(name: str, value: float) -> None:
    """Set a process variable."""
    channel = opened_as("epics", pvs=name)
    channel._channels.write(np.array([value]))
    until(lambda: channel.temperature()[0] == value, 5.0)
    channel.close()


def test_a_plan_through_process_variables(tmp_path: Path) -> None:
    poses = dict.fromkeys(POSE, np.zeros(4)) | {"x_m": np.full(4, 0.1)}
    poses["y_m"] = np.array([0.002, -0.002, 0.0, 0.001])
    poses["theta_z_rad"] = np.array([0.0, 0.0, 0.02, -0.01])
    plan = as_table(poses, meta=Meta(mechanism={"length_m": 0.1}))
    bench = Bench.from_dict(
        {
            "rig": {"offset_compensation": "none", "dwell_s": 0.0},
            "limits": {"check_s": 0.02},
            "mover": motors(),
            "wrench": {"device": "epics", "pvs": "rig:wrench"},
            "pose": {"device": "epics", "pvs": "rig:pose", "scale": MILLIMETRES},
            "thermometer": {"device": "epics", "pvs": "rig:temperature"},
        },
        "bench.toml",
    )
    table = measure(plan, bench, tmp_path / "data.csv")
    off = np.abs(table.poses - plan.poses)
    assert off[:, :3].max() < 2e-5
    # A sample scatters by 1e-3 degrees, and on a busy machine few of them make a reading.
    assert off[:, 3:].max() < 5.0 * np.deg2rad(1e-3)
    wrench = (table.poses - [0.1, 0.0, 0.0, 0.0, 0.0, 0.0]) * soft_ioc.STIFFNESS
    turned = np.abs(table.wrenches - wrench)  # the sensor's axes turn with the platform
    assert turned[:2].max() < 0.02
    assert table.column("temperature_degC").tolist() == [22.5] * 4
    assert 0.003 < np.median(table.column("sd_fx_N")) < 0.03


def test_a_motor_is_stopped_on_its_way_and_has_not_settled() -> None:
    stage = opened_as(**motors())
    at, _ = stage.pose(0.0)
    stage.start(at + 0.02 * np.eye(6)[0])
    assert not stage.settled()
    time.sleep(0.15)
    stage.stop()
    time.sleep(0.15)
    stopped, _ = stage.pose(0.0)
    assert 0.001 < stopped[0] - at[0] < 0.019
    time.sleep(0.1)
    assert stage.pose(0.0)[0].tolist() == stopped.tolist()
    assert not stage.settled()  # it rests, but not where it was sent
    stage.start(at)
    until(stage.settled, 5.0)
    stage.close()


def test_a_sensor_whose_scan_stands_still_or_that_has_an_alarm_is_refused() -> None:
    sensor = opened_as("epics", pvs="rig:wrench", timeout_s=0.5)
    assert 3 <= len(sensor.wrench(0.1)) <= 11
    put("rig:hold", 1.0)
    with pytest.raises(DeviceError, match=r"rig:wrench: not set for 0\.5 s"):
        sensor.wrench(0.1)
    put("rig:trust", 0.0)
    put("rig:hold", 0.0)
    time.sleep(0.1)
    with pytest.raises(DeviceError, match="rig:wrench: its value is in the alarm INVALID"):
        sensor.wrench(0.1)
    put("rig:trust", 1.0)
    time.sleep(0.1)
    assert sensor.wrench(0.1).shape[1] == 6
    sensor.close()


def test_actuators_are_set_and_read_in_pascals() -> None:
    valves = opened_as(
        "epics-actuators", setpoint="rig:pressure", readback="rig:gauge", scale=1e5
    )  # bar
    valves.actuate(np.array([2e4, 0.0]))
    time.sleep(0.1)
    assert valves.actuation() == pytest.approx([1.96e4, 0.0])
    valves.close()


def test_a_name_that_no_server_knows_is_told() -> None:
    with pytest.raises(DeviceError, match=r"\[mover\]: rig:wench: no answer within 0\.3 s"):
        opened_as("epics", pvs="rig:wench", timeout_s=0.3)
    with pytest.raises(DeviceError, match="rig:pressure: 2 numbers, expected six in all"):
        opened_as("epics", pvs="rig:pressure").wrench(0.1)


def test_a_server_that_dies_is_told(ioc: subprocess.Popen[str]) -> None:
    sensor = opened_as("epics", pvs="rig:wrench", timeout_s=0.5)
    assert len(sensor.wrench(0.05))
    ioc.kill()
    ioc.wait()
    began = time.monotonic()
    with pytest.raises(DeviceError, match=r"rig:wrench: no answer within 0\.5 s"):
        sensor.wrench(0.05)
    assert time.monotonic() - began < 5.0
    assert os.environ["EPICS_CA_AUTO_ADDR_LIST"] == "NO"
    sensor.close()
