"""Devices behind a line of text: JSON or CSV over TCP or a serial port, and the ATI Net F/T.

One line asks, one line answers, each a JSON object:

    {"do": "start", "pose": [0.1, 0, 0, 0, 0, 0]}   ->  {"ok": true}
    {"do": "settled"}                               ->  {"ok": true, "settled": false}
    {"do": "stop"}                                  ->  {"ok": true}
    {"do": "wrench", "window_s": 0.2}               ->  {"ok": true, "samples": [[fx, ...], ...]}
    {"do": "pose", "window_s": 0.2}                 ->  {"ok": true, "mean": [...], "sd": [...]}
    {"do": "temperature"}                           ->  {"ok": true, "degC": 22.5}
    {"do": "ask", "text": "..."}                    ->  {"ok": true}
    {"do": "actuate", "values": [20000, 0]}         ->  {"ok": true}
    {"do": "actuation"}                             ->  {"ok": true, "values": [19900, 0]}
    {"do": "follow", "free_N": 0.02}                ->  {"ok": true} when it is there

{"ok": false, "error": "words"} refuses. The same as CSV, for a microcontroller without JSON:

    start,0.1,0,0,0,0,0   ->  ok
    settled               ->  ok,0
    wrench,0.2            ->  ok,fx,fy,fz,tx,ty,tz,fx,...
    pose,0.2              ->  ok,mean of six,sd of six
    ask,words             ->  error,words

With numbered = true each question has a number, which its answer repeats:

    {"id": 7, "do": "stop"}   ->  {"id": 7, "ok": true}
    7,stop                    ->  7,ok
"""

from __future__ import annotations

import json
import os
import secrets
import select
import socket
import struct
import threading
import time
from contextlib import suppress
from typing import Any

import numpy as np

from ecm.bench.devices import DeviceError
from ecm.errors import EcmError, InputError
from ecm.io.arrays import F
from ecm.io.extras import require

_KEYS = {"settled": "settled", "wrench": "samples", "pose": "mean"}
_KEYS |= {"temperature": "degC", "actuation": "values"}
"""What tells the answer to a question from one to `stop`."""


_AGAIN_S = 0.1
"""Time after which a connection that was cut is tried again."""


class _Cut(DeviceError):
    """The connection was closed from the other side, or its plug was pulled."""


class LineDevice:
    """A program or a microcontroller that answers lines of JSON or CSV.

    Parameters
    ----------
    address
        `HOST:PORT`, or the name of a serial port such as /dev/ttyACM0.
    form
        Of the lines, json or csv.
    baud
        Speed of the serial port.
    timeout_s
        Longest silence, beyond the window of a reading.
    numbered
        Whether a question has a number that its answer repeats. Other lines are passed over then.
        Without it each line is an answer, and they come in the order of the questions.
    """

    def __init__(
        self,
        address: str,
        *,
        form: str = "json",
        baud: int = 115200,
        timeout_s: float = 5.0,
        numbered: bool = False,
    ) -> None:
        if form not in ("json", "csv"):
            raise InputError(f"form = '{form}': expected json or csv")
        self._csv, self._numbered, self._address = form == "csv", numbered, address
        self._timeout_s, self._lock = timeout_s, threading.Lock()
        # From elsewhere: a serial port may still bring an answer to an earlier run.
        self._number, self._writing = numbered * secrets.randbelow(2**20), threading.Lock()
        self._owed = dict[int, str]()
        """Questions without an answer by their numbers, those that were given up included."""
        self._heard = dict[int, dict[str, Any]]()
        """Answers to a question that still waits, by the same numbers."""
        self._aside, self._baud = "", baud
        self._link = self._connected()

    def _connected(self) -> Any:
        self._rest, address = b"", self._address
        host, colon, port = address.rpartition(":")
        if colon and port.isdigit():
            return socket.create_connection((host, int(port)), timeout=self._timeout_s)
        if os.path.exists(address):
            serial = require("serial", "measure", f"The serial port {address}")
            return serial.Serial(address, self._baud, timeout=0)
        raise InputError(f"address = '{address}': expected HOST:PORT or a serial port")

    def start(self, pose: F) -> None:
        """Begin to move to a pose (6,)."""
        self._ask({"do": "start", "pose": np.asarray(pose).tolist()})

    def settled(self) -> bool:
        """Whether the move has ended and the mover rests."""
        return bool(self._ask({"do": "settled"})["settled"])

    def stop(self) -> None:
        """Stop at once, whatever else is waited for; anew where the connection was cut."""
        until_s = time.monotonic() + self._timeout_s
        while True:
            link = self._link
            try:
                number = self._write({"do": "stop"})
                with self._lock:
                    self._read(number, "stop")
                return
            except (OSError, _Cut):
                if time.monotonic() > until_s:
                    raise
            time.sleep(_AGAIN_S)
            with self._lock, suppress(OSError, EcmError):
                if self._link is link:
                    self._link = self._connected()
                    link.close()
                    self._owed.clear()

    def wrench(self, window_s: float) -> F:
        """Samples (n, 6) over a window, in sensor axes."""
        return self._six(self._ask({"do": "wrench", "window_s": window_s}, window_s), "samples")

    def pose(self, window_s: float) -> tuple[F, F]:
        """Mean and standard deviation (6,) of the pose over a window."""
        answer = self._ask({"do": "pose", "window_s": window_s}, window_s)
        return self._six(answer, "mean"), self._six(answer, "sd")

    def temperature(self) -> float:
        """Temperature of the mechanism, degrees Celsius."""
        return float(self._ask({"do": "temperature"})["degC"])

    def ask(self, text: str) -> None:
        """Have something done by a person or a machine there."""
        self._ask({"do": "ask", "text": text}, 3600.0)

    def actuate(self, values: F) -> None:
        """Ask for (m,) pressures or tensions, in Pa and N."""
        self._ask({"do": "actuate", "values": np.asarray(values).tolist()})

    def actuation(self) -> F:
        """What is there, (m,)."""
        return np.asarray(self._ask({"do": "actuation"})["values"], dtype=np.float64)

    def follow(self, free_N: float) -> None:
        """Go where the driven mechanism goes, until the force is below free_N."""
        self._ask({"do": "follow", "free_N": free_N}, 60.0)

    def close(self) -> None:
        """Close the connection."""
        self._link.close()

    def _six(self, answer: dict[str, Any], key: str) -> F:
        numbers = np.empty(0)
        with suppress(KeyError, TypeError, ValueError):
            numbers = np.asarray(answer[key], dtype=np.float64)
        if numbers.ndim not in (1, 2) or numbers.shape[-1] != 6 or not np.isfinite(numbers).all():
            raise DeviceError(f"{self._address}: the answer has no {key} of six finite numbers")
        return numbers

    def _ask(self, question: dict[str, Any], more_s: float = 0.0) -> dict[str, Any]:
        with self._lock:
            come = self._rest or select.select([self._link], [], [], 0.0)[0]
            if come and not self._owed and not self._numbered:
                # All later answers would be those of the question before.
                line = self._line(time.monotonic() + self._timeout_s)
                raise DeviceError(
                    f"{self._address}: `{line[:60]!r}` came before `{question['do']}`, and nobody "
                    "asked for it: expected one answer to each line"
                )
            return self._read(self._write(question), question["do"], more_s)

    def _write(self, question: dict[str, Any]) -> int:
        with self._writing:  # lines are in the order of their numbers
            self._number += 1
            self._owed[self._number] = question["do"]
            line = {"id": self._number} | question if self._numbered else question
            text = _csv_line(line) if self._csv else json.dumps(line)
            os.write(self._link.fileno(), text.encode() + b"\n")
            return self._number

    def _read(self, number: int, do: str, more_s: float = 0.0) -> dict[str, Any]:
        until_s, key = time.monotonic() + self._timeout_s + more_s, _KEYS.get(do, "ok")
        shown = key + " (true or false)" * (key in ("ok", "settled"))
        expected = "ok or error, then numbers" if self._csv else f"a JSON object with {shown}"
        while number not in self._heard:
            line = self._line(until_s)
            own, answer = self._matched(line.decode(errors="replace"))
            if not own:
                wrong = f"answered `{line[:60]!r}`, expected {expected}"
                if self._numbered:
                    self._aside = f"; it {wrong}, and the same id"
                    continue
                self._owed.pop(number, None)
                raise DeviceError(f"{self._address}: {wrong}")
            if own == number or self._owed[own] == "stop":  # which waits for the lock
                self._heard[own] = answer
            for passed in [asked for asked in self._owed if asked <= own]:
                del self._owed[passed]
            if own > number:
                raise DeviceError(f"{self._address}: no answer to `{do}`, and then one to `stop`")
        answer = self._heard.pop(number)
        if not answer["ok"]:
            raise DeviceError(f"{self._address}: {answer.get('error', 'refused without a reason')}")
        return answer

    def _matched(self, text: str) -> tuple[int, dict[str, Any]]:
        """Number of the first question that a line answers, 0 where it answers none; the answer."""
        for number, do in [*self._owed.items()]:
            with suppress(ValueError, LookupError, TypeError):  # of another form
                answer = _csv_answer(do, text, self._numbered) if self._csv else json.loads(text)
                if self._numbered and int(answer["id"]) != number:
                    continue
                if not {answer["ok"], answer.get("settled", 0)} <= {0, 1}:
                    continue  # "false" in quotes would be true
                bare = answer.keys().isdisjoint(_KEYS.values())
                if not answer["ok"] or (bare if do == "stop" else _KEYS.get(do, "ok") in answer):
                    return number, dict(answer)
        return 0, {}

    def _line(self, until_s: float) -> bytes:
        while b"\n" not in self._rest:
            left = until_s - time.monotonic()
            if left <= 0.0 or not select.select([self._link], [], [], left)[0]:
                raise DeviceError(
                    f"{self._address}: no answer within {self._timeout_s:g} s{self._aside}"
                )
            more = b""
            with suppress(OSError):
                more = os.read(self._link.fileno(), 65536)
            if not more:
                raise _Cut(f"{self._address}: the connection was closed")
            self._rest += more
        line, _, self._rest = self._rest.partition(b"\n")
        return line


def _csv_line(question: dict[str, Any]) -> str:
    """A question as a line of CSV.

    Examples
    --------
    >>> _csv_line({"do": "actuate", "values": [20000.0, 0.0]})
    'actuate,20000.0,0.0'
    """
    values = (v if isinstance(v, list) else [v] for v in question.values())
    return ",".join(str(cell) for part in values for cell in part)


def _csv_answer(do: str, line: str, numbered: bool) -> dict[str, Any]:
    """A line of CSV as the JSON object that it stands for."""
    if numbered:
        number, _, line = line.partition(",")
        return {"id": number} | _csv_answer(do, line, False)
    word, *cells = line.strip().split(",")
    if word == "error":
        return {"ok": False, "error": ",".join(cells)}
    if word != "ok":
        raise ValueError
    numbers = [float(cell) for cell in cells]
    if not numbers:
        return {"ok": True}
    if do == "settled":
        return {"ok": True, "settled": numbers[0] != 0.0}
    if do == "temperature":
        return {"ok": True, "degC": numbers[0]}
    samples = [numbers[i : i + 6] for i in range(0, len(numbers), 6)]
    return {
        "ok": True,
        "samples": samples,
        "mean": numbers[:6],
        "sd": numbers[6:],
        "values": numbers,
    }


_RDT_PORT = 49152
_RDT_REQUEST = struct.Struct("!HHI")
_RDT_RECORD = struct.Struct("!IIIiiiiii")
_RDT_HEADER, _RDT_STREAM, _RDT_STOP = 0x1234, 2, 0


class AtiNetFt:
    """Force-torque sensor behind an ATI Net F/T box, by its raw data transfer over UDP.

    Parameters
    ----------
    address
        Host of the box, or `HOST:PORT`.
    rate_Hz
        Rate at which the box is set to send.
    counts_per_N, counts_per_Nm
        Of the box's configuration page.
    timeout_s
        Longest silence.
    """

    def __init__(
        self,
        address: str,
        *,
        rate_Hz: float = 1000.0,
        counts_per_N: float = 1e6,
        counts_per_Nm: float = 1e6,
        timeout_s: float = 1.0,
    ) -> None:
        host, _, port = address.partition(":")
        self._address, self._rate_Hz = (host, int(port or _RDT_PORT)), rate_Hz
        self._counts = np.repeat([counts_per_N, counts_per_Nm], 3)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.settimeout(timeout_s)

    def wrench(self, window_s: float) -> F:
        """Samples (n, 6) over a window; records that were lost or came twice are left out."""
        count = max(2, round(window_s * self._rate_Hz))
        self._socket.sendto(_RDT_REQUEST.pack(_RDT_HEADER, _RDT_STREAM, count), self._address)
        samples: dict[int, F] = {}
        try:
            while len(samples) < count:
                record = self._socket.recv(64)
                if len(record) != _RDT_RECORD.size:
                    raise DeviceError(f"{self._address[0]}: a record of {len(record)} bytes")
                number, _, status, *counts = _RDT_RECORD.unpack(record)
                if status:
                    raise DeviceError(f"{self._address[0]}: the sensor has status {status:#010x}")
                samples[number] = np.asarray(counts) / self._counts
                if number == count:
                    break
        except TimeoutError:
            self._socket.sendto(_RDT_REQUEST.pack(_RDT_HEADER, _RDT_STOP, 0), self._address)
        if len(samples) < max(2, count // 2):
            raise DeviceError(
                f"{self._address[0]}: {len(samples)} of {count} samples came; check the cable"
            )
        return np.stack([samples[number] for number in sorted(samples)])

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()
