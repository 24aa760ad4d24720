"""How many cores this process may use."""

from __future__ import annotations

import os


def own_cores() -> int:
    """Return the number of cores that this process may run on, at least 1.

    Examples
    --------
    >>> own_cores() >= 1
    True
    """
    own = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return own or 1
