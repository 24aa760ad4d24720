"""What the tests of `examples/head` share; without MuJoCo there are none."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import pytest

from support.programs import need_program

if find_spec("mujoco") is None:
    collect_ignore_glob = ["test_*.py"]


@pytest.fixture(scope="session")
def plugin(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The neck of `support.head_example` as MuJoCo's plugin."""
    from compiled import build_plugin  # noqa: PLC0415 - MuJoCo may be missing
    from support.head_example import closed_neck  # noqa: PLC0415

    need_program("c++", "g++")
    return build_plugin(closed_neck(), tmp_path_factory.mktemp("plugin"))
