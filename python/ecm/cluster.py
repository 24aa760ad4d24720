"""Chunks of load cases on the workers of a Dask scheduler.

A chunk is solved by one worker as it would be here, so that the result does not depend on how
many workers there are. A worker that dies loses nothing but time: Dask gives its chunks to
another, and finished ones are already here.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecm.errors import ComputationError, FemError, InputError, MissingExtra
from ecm.mechanism import Mechanism

F = NDArray[np.float64]

_CONNECT_S = 10.0
_DEATHS = 10
"""A chunk during which this many workers died is given up."""


class Cluster:
    """Solves chunks on the workers of a scheduler.

    Parameters
    ----------
    scheduler
        Address, e.g. tcp://192.0.2.1:8786.

    Errors
    ------
    MissingExtra
        Where Dask is not installed.
    InputError
        Where nobody answers at the address, or no worker is there.
    """

    def __init__(self, mechanism: Mechanism, threads: int, scheduler: str) -> None:
        try:
            from importlib import import_module

            distributed: Any = import_module("distributed")
        except ImportError:
            raise MissingExtra("distributed", "cluster", "--scheduler") from None
        try:
            self._client: Any = distributed.Client(
                scheduler, timeout=_CONNECT_S, set_as_default=False
            )
        except (OSError, ValueError) as error:
            raise InputError(
                f"--scheduler {scheduler}: no answer within {_CONNECT_S:.0f} s ({error}). Start "
                "one with `dask scheduler` and workers with `dask worker ADDRESS`"
            ) from None
        workers = len(self._client.scheduler_info(n_workers=-1)["workers"])
        if workers == 0:
            self._client.close()
            raise InputError(
                f"--scheduler {scheduler}: no worker is there. Start some with "
                f"`dask worker {scheduler}`"
            )
        self.ahead = 2 * workers
        mesh = b"" if mechanism.mesh_file is None else mechanism.mesh_file.read_bytes()
        self._work = (replace(mechanism, mesh_file=None), mesh, threads)
        if mechanism.mesh_file is not None:
            self._work = (replace(mechanism, mesh_file=None, builtin=""), mesh, threads)
        self._futures: dict[int, Any] = {}

    def begin(self, chunk: int, wrenches: F) -> None:
        """Hand a chunk to the workers."""
        self._futures[chunk] = self._client.submit(
            _work, *self._work, wrenches, key=f"ecm-{id(self)}-{chunk}", pure=False
        )

    def finish(
        self, chunk: int, wrenches: F, report: Callable[[int, int], None] | None
    ) -> dict[str, F]:
        """The chunk's results, waited for."""
        from distributed import KilledWorker

        for _ in range(_DEATHS):
            try:
                result: dict[str, F] = self._futures.pop(chunk).result()
                break
            except KilledWorker:
                self.begin(chunk, wrenches)
        else:
            raise ComputationError(
                f"chunk {chunk}: workers die while solving it; do they have enough memory?"
            )
        if report is not None:
            report(len(wrenches), len(wrenches))
        return result

    def close(self) -> None:
        """Let go of what was begun and is not needed."""
        for future in self._futures.values():
            future.cancel()
        self._client.close()


_fems: dict[str, Any] = {}
"""On a worker: the last body, which many chunks share."""


def _work(mechanism: Mechanism, mesh: bytes, threads: int, wrenches: F) -> dict[str, F]:
    from ecm.simulate import solve_chunk

    key = mechanism.key() + str(hash(mesh))
    if key not in _fems:
        _fems.clear()
        _fems[key] = _body(mechanism, mesh)
    return solve_chunk(_fems[key], wrenches, threads)


def _body(mechanism: Mechanism, mesh: bytes) -> Any:
    if not mesh:
        return mechanism.fem()
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory) / "body.msh"
        path.write_bytes(mesh)
        try:
            return replace(mechanism, mesh_file=path).fem()
        except FemError as error:
            raise InputError(str(error)) from None
