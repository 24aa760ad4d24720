"""An FMU driven through its C functions, so that the tests need no other program."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from zipfile import ZipFile

import numpy as np

from ecm.io.arrays import F


class Instance:
    """One instance of an FMU of either version."""

    def __init__(self, file: Path, folder: Path) -> None:
        with ZipFile(file) as archive:
            archive.extractall(folder)
        self.description = ElementTree.parse(folder / "modelDescription.xml").getroot()
        self.three = self.description.attrib["fmiVersion"] == "3.0"
        place = "x86_64-linux" if self.three else "linux64"
        (self.binary,) = (folder / "binaries" / place).iterdir()
        self.library = ctypes.CDLL(str(self.binary))
        token = self.description.attrib["instantiationToken" if self.three else "guid"]
        self.component = self.made(token)
        assert self.component

    def made(self, token: str) -> int | None:
        """A new instance for this token."""
        if self.three:
            make = self.library.fmi3InstantiateCoSimulation
            make.restype = ctypes.c_void_p
            given = [b"one", token.encode(), None, False, False, False, False, None]
            return make(*given, ctypes.c_size_t(0), None, None, None)  # type: ignore[no-any-return]
        make = self.library.fmi2Instantiate
        make.restype = ctypes.c_void_p
        return make(b"one", 1, token.encode(), None, None, 0, 0)  # type: ignore[no-any-return]

    def variables(self, causality: str) -> dict[str, int]:
        """Value reference of each number by its name."""
        found = {}
        for item in self.description.iter():
            if item.attrib.get("causality") == causality and item.attrib["name"] != "inside":
                found[item.attrib["name"]] = int(item.attrib["valueReference"])
        return found

    def call(self, name: str, *arguments: Any) -> int:
        """Status of a function; its name without the version, as in FMI 3."""
        if not self.three:
            name = name.replace("FMUState", "FMUstate").replace("Float64", "Real")
            name = name.replace("Deserialize", "DeSerialize").replace("Int32", "Integer")
        function = getattr(self.library, f"fmi{3 if self.three else 2}{name}")
        return int(function(ctypes.c_void_p(self.component), *arguments))

    def enter(self) -> int:
        """Through the initialisation, from time 0."""
        d = ctypes.c_double
        if self.three:
            self.call("EnterInitializationMode", False, d(0), d(0), False, d(0))
        else:
            self.call("SetupExperiment", 0, d(0), d(0), 0, d(0))
            self.call("EnterInitializationMode")
        return self.call("ExitInitializationMode")

    def _room(self, count: int) -> list[ctypes.c_size_t]:
        return [ctypes.c_size_t(count)] if self.three else []

    def set(self, names: Sequence[str], numbers: F) -> int:
        """Set inputs."""
        return self._exchange("SetFloat64", "input", names, numbers)[0]

    def get(self, names: Sequence[str]) -> F:
        """Outputs."""
        status, values = self._exchange("GetFloat64", "output", names)
        assert status == 0
        return values

    def _exchange(
        self, name: str, causality: str, names: Sequence[str], numbers: Sequence[float] | F = ()
    ) -> tuple[int, F]:
        count, references = len(names), self._references(causality, names)
        values = (ctypes.c_double * count)(*numbers)
        status = self.call(name, references, ctypes.c_size_t(count), values, *self._room(count))
        return status, np.array(values)

    def asked(self, reference: int) -> int:
        """Status of asking for one number by its value reference."""
        one, value = (ctypes.c_uint * 1)(reference), ctypes.c_double()
        count = ctypes.c_size_t(1)
        return self.call("GetFloat64", one, count, ctypes.byref(value), *self._room(1))

    def inside(self) -> int:
        """The output `inside`."""
        (item,) = (i for i in self.description.iter() if i.attrib.get("name") == "inside")
        reference, value = (ctypes.c_uint * 1)(int(item.attrib["valueReference"])), ctypes.c_int()
        self.call("GetInt32", reference, ctypes.c_size_t(1), ctypes.byref(value), *self._room(1))
        return value.value

    def step(self, time: float, dt: float) -> int:
        """Status of a step."""
        d = ctypes.c_double
        if not self.three:
            return self.call("DoStep", d(time), d(dt), 1)
        flags, last = [ctypes.c_bool() for _ in range(3)], d()
        out = [ctypes.byref(flag) for flag in flags]
        return self.call("DoStep", d(time), d(dt), True, *out, ctypes.byref(last))

    def derivative(
        self, outputs: Sequence[str], inputs: Sequence[str], seed: F, expected: int = 0
    ) -> F:
        """Directional derivative, with the status that is expected of it."""
        rows, columns = len(outputs), len(inputs)
        seeds, found = (ctypes.c_double * columns)(*seed), (ctypes.c_double * rows)()
        status = self.call(
            "GetDirectionalDerivative",
            self._references("output", outputs), ctypes.c_size_t(rows),
            self._references("input", inputs), ctypes.c_size_t(columns),
            seeds, *self._room(columns), found, *self._room(rows),
        )  # fmt: skip
        assert status == expected
        return np.array(found)

    def saved(self) -> bytes:
        """The state as bytes."""
        state, size = ctypes.c_void_p(), ctypes.c_size_t()
        assert self.call("GetFMUState", ctypes.byref(state)) == 0
        assert self.call("SerializedFMUStateSize", state, ctypes.byref(size)) == 0
        stored = ctypes.create_string_buffer(size.value)
        assert self.call("SerializeFMUState", state, stored, size) == 0
        self.call("FreeFMUState", ctypes.byref(state))
        return stored.raw

    def restore(self, stored: bytes) -> int:
        """Take stored bytes as the state; the status of reading them."""
        state = ctypes.c_void_p()
        status = self.call(
            "DeserializeFMUState", stored, ctypes.c_size_t(len(stored)), ctypes.byref(state)
        )
        if status == 0:
            self.call("SetFMUState", state)
            self.call("FreeFMUState", ctypes.byref(state))
        return status

    def _references(self, causality: str, names: Sequence[str]) -> Any:
        known = self.variables(causality)
        return (ctypes.c_uint * len(names))(*(known[name] for name in names))
