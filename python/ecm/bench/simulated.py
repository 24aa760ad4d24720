"""The simulated rig in a process of its own, behind the same lines of JSON as a real one.

    python -m ecm.bench.simulated PLAN.csv RIG.toml SEED HIDE

prints the address at which it listens, answers one connection, and ends with it.
"""

from __future__ import annotations

import json
import socket
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ecm.bench.lines import LineDevice
from ecm.errors import EcmError, InputError
from ecm.io.settings import read_toml
from ecm.io.table import read_table
from ecm.rig.campaign import Campaign
from ecm.rig.plan import POSE
from ecm.rig.readings import Reading
from ecm.rig.run import fem_source
from ecm.rig.settings import RigSettings
from ecm.rig.truth import Hidden

_PAUSE_S = 1e-3
"""Seconds of the simulated clock between a visit and a reading at rest that is made again."""


class SimulatedRig(LineDevice):
    """Mover, sensor, camera, thermometer, actuators, follower and person of the simulated rig.

    Parameters
    ----------
    plan
        The plan that is measured: its poses are solved before the first move.
    rig
        Rig file, as of `ecm campaign`; default: the rig's defaults.
    seed
        Seed of the random generator.
    hide
        What is hidden, as in `ecm campaign`.
    """

    def __init__(self, plan: str, *, rig: str = "", seed: int = 0, hide: str = "") -> None:
        command = [sys.executable, "-m", "ecm.bench.simulated", plan, rig, str(seed), hide]
        # Ctrl-C is for the run, which ends this process itself.
        self._process = subprocess.Popen(
            command, stdout=subprocess.PIPE, text=True, start_new_session=True
        )
        said = self._process.stdout.readline().strip() if self._process.stdout else ""
        if not said.startswith("127.0.0.1:"):
            self._process.wait()
            raise InputError(said or "the simulated rig ended before it was ready")
        super().__init__(said, timeout_s=60.0)

    def begin(self, visit: int, again: str, rows: Sequence[int]) -> None:
        """Tell which visit comes next: the rig has a clock of its own.

        again: kind of a reading at rest that is made once more after this visit; rows: those of
        the plan in the order in which they were gone to.
        """
        self._ask({"do": "begin", "visit": visit, "again": again, "rows": list(rows)})

    def now(self) -> float:
        """Time of the rig's clock, s."""
        return float(self._ask({"do": "now"})["time_s"])

    def wait(self, seconds: float) -> None:
        """Let the rig's clock go on; a simulated rig needs no time for it."""
        self._ask({"do": "wait", "seconds": seconds})

    def temperature(self) -> Any:
        """Temperatures of the mechanism and of the sensor, degrees Celsius."""
        return self._ask({"do": "temperature"})["degC"]

    def close(self) -> None:
        """Close the connection; the process ends with it."""
        super().close()
        if self._process.stdout is not None:
            self._process.stdout.close()
        try:
            self._process.wait(5.0)
        except subprocess.TimeoutExpired:
            self._process.kill()


class _Server:
    """Answers of one campaign."""

    def __init__(self, campaign: Campaign) -> None:
        self._campaign, self._begun = campaign, dict[int, int]()
        self._rows = campaign.rows
        self._time_s, self._more_s = 0.0, 0.0
        self._reading: Reading | None = None
        self._state, self._free = np.empty(0), np.empty(0)
        self._following = False
        self._samples = np.zeros((0, 6))

    def answer(self, question: dict[str, Any]) -> dict[str, Any]:
        """Answer one question."""
        method = getattr(self, f"_{question.get('do')}", None)
        if method is None:
            return {"ok": False, "error": f"unknown question {question.get('do')!r}"}
        return {"ok": True} | (method(question) or {})

    def _begin(self, question: dict[str, Any]) -> None:
        index, rows = int(question["visit"]), question["rows"]
        if rows != self._rows[: len(rows)]:
            self._campaign, self._rows = self._campaign.in_order(rows), rows
        visits = self._campaign.timeline.visits
        if not 0 <= index < len(visits):
            raise InputError(f"visit {index}: the plan has {len(visits)} visits")
        self._time_s = visits[index].time_s
        if question["again"]:
            self._more_s += _PAUSE_S
            self._time_s += self._more_s
            index = next(i for i in range(index, -1, -1) if visits[i].kind != POSE)
            self._begun.setdefault(index, 1)
        # A visit that is made again is another repeat, with noise of its own.
        again = self._begun.get(index, 0)
        self._begun[index] = again + 1
        visit = visits[index]
        if again:
            visits[index] = replace(visit, repeat=visit.repeat + 1000 * again)
        self._state, self._free = visit.pose, visit.pose if visit.free is None else visit.free
        self._reading = self._campaign.measure(index)
        self._samples = self._campaign.sensor_samples(index)
        visits[index] = visit

    def _start(self, question: dict[str, Any]) -> None:
        """The pose is that of the visit that was begun."""
        self._following = False

    def _follow(self, question: dict[str, Any]) -> None:
        """The camera sees the free pose next."""
        self._following = True

    def _actuate(self, question: dict[str, Any]) -> None:
        """The inputs are those of the visit that was begun."""

    def _actuation(self, question: dict[str, Any]) -> dict[str, Any]:
        return {"values": self._state[6:].tolist()}

    def _settled(self, question: dict[str, Any]) -> dict[str, Any]:
        return {"settled": True}

    def _stop(self, question: dict[str, Any]) -> None:
        """Nothing moves between two visits."""

    def _ask(self, question: dict[str, Any]) -> None:
        """Persons of the simulated rig do what they are asked."""

    def _wait(self, question: dict[str, Any]) -> None:
        """The clock is that of the plan."""

    def _now(self, question: dict[str, Any]) -> dict[str, Any]:
        return {"time_s": self._time_s}

    def _wrench(self, question: dict[str, Any]) -> dict[str, Any]:
        return {"samples": self._samples.tolist()}

    def _pose(self, question: dict[str, Any]) -> dict[str, Any]:
        if self._following:
            return {"mean": self._free[:6].tolist(), "sd": [0.0] * 6}
        reading = self._reading_begun()
        return {"mean": reading.pose.tolist(), "sd": reading.pose_sd.tolist()}

    def _temperature(self, question: dict[str, Any]) -> dict[str, Any]:
        reading = self._reading_begun()
        return {"degC": [reading.temperature_degC, reading.sensor_temperature_degC]}

    def _reading_begun(self) -> Reading:
        if self._reading is None:
            raise InputError("no visit was begun")
        return self._reading


def main(plan: str, rig: str, seed: str, hide: str) -> None:
    """Solve the plan, say the address, answer until the other side closes."""
    table = read_table([Path(plan)], need="predict")
    settings = RigSettings.from_dict(read_toml(Path(rig), "rig file") if rig else {}, rig)
    hidden = Hidden.parse(hide)
    server = _Server(Campaign(table, settings, fem_source(table), hide=hidden, seed=int(seed)))
    with socket.create_server(("127.0.0.1", 0)) as listener:
        print(f"127.0.0.1:{listener.getsockname()[1]}", flush=True)
        connection, _ = listener.accept()
    with connection, connection.makefile("rw") as stream:
        for line in stream:
            try:
                answer = server.answer(json.loads(line))
            except (EcmError, KeyError, ValueError) as error:
                answer = {"ok": False, "error": str(error)}
            stream.write(json.dumps(answer) + "\n")
            stream.flush()


if __name__ == "__main__":
    try:
        main(*sys.argv[1:])
    except EcmError as error:
        print(str(error).replace("\n", " "), flush=True)
        sys.exit(1)
