"""Tasks for the processes of the blind benchmark; spawned processes find them by name."""

from __future__ import annotations

import os
from pathlib import Path


def write(task: tuple[str, str]) -> None:
    """Write a file of that name; the one named 2 fails."""
    folder, name = task
    if name == "2":
        raise ValueError("two")
    Path(folder, name).write_text(name * 3, encoding="utf-8")


def write_or_die(task: tuple[str, str]) -> None:
    """The same, but the process of the one named 2 ends at once."""
    if task[1] == "2":
        os._exit(1)
    write(task)
