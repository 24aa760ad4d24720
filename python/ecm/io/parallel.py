"""Work on several cores, here or on the workers of a Dask scheduler (extra `cluster`)."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from typing import Any

from ecm.errors import InputError
from ecm.io.extras import require


def own_cores() -> int:
    """Return the number of cores that this process may run on, at least 1.

    Examples
    --------
    >>> own_cores() >= 1
    True
    """
    own = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return own or 1


class DaskClient:
    """Connection to the Dask scheduler at an address, e.g. tcp://192.0.2.1:8786.

    MissingExtra where Dask is not installed, InputError where nobody answers within `timeout_s`.
    """

    def __init__(self, scheduler: str, *, timeout_s: float = 10.0) -> None:
        self._distributed = require("distributed", "cluster", "--scheduler")
        self._scheduler = scheduler
        try:
            self._client: Any = self._distributed.Client(
                scheduler, timeout=timeout_s, set_as_default=False
            )
        except (OSError, ValueError) as error:
            raise InputError(
                f"--scheduler {scheduler}: no answer within {timeout_s:.0f} s ({error}). Start "
                "one with `dask scheduler` and workers with `dask worker ADDRESS`"
            ) from None
        self.killed_worker: type[Exception] = self._distributed.KilledWorker
        """Raised by the result of a task whose workers died again and again."""

    def count_workers(self) -> int:
        """Return the number of workers; InputError where there is none."""
        workers = len(self._client.scheduler_info(n_workers=-1)["workers"])
        if workers == 0:
            self.close()
            raise InputError(
                f"--scheduler {self._scheduler}: no worker is there. Start some with "
                f"`dask worker {self._scheduler}`"
            )
        return workers

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Start a task and return its future; equal tasks are run again."""
        return self._client.submit(function, *arguments, pure=False)

    def completed(self, futures: Iterable[Any]) -> Any:
        """Iterate over futures as they end; `add` takes more of them."""
        return self._distributed.as_completed(
            list(futures), loop=self._client.loop, raise_errors=False
        )

    def close(self) -> None:
        """Disconnect."""
        self._client.close()

    def __enter__(self) -> DaskClient:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
