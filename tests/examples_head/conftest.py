"""What the tests of `examples/head` share; without MuJoCo there are none."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import pytest

from support.programs import need_program

if find_spec("mujoco") is None:
    collect_ignore_glob = ["test_*.py"]


@pytest.fixture(scope="session")
def plugin(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The neck of `support.head_example` as MuJoCo's plugin."""
    need_program("c++", "g++")
    build = import_module("compiled").build_plugin  # MuJoCo may be missing
    neck = import_module("support.head_example").closed_neck()
    return Path(build(neck, tmp_path_factory.mktemp("plugin")))
