"""`import ecm`: every name is there, comes when it is asked for, and is what it says."""

from __future__ import annotations

import subprocess
import sys
from importlib import import_module

import pytest

import ecm


@pytest.mark.parametrize("name", ecm.__all__)
def test_every_name_is_there(name: str) -> None:
    assert getattr(ecm, name) is not None
    assert name in dir(ecm)


def test_a_name_that_is_not_there_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="'ecm' has no attribute 'measure'"):
        _ = ecm.measure  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", ["compare", "diagnose", "identify", "simulate"])
def test_a_function_is_not_replaced_by_the_module_of_its_name(name: str) -> None:
    module = import_module(f"ecm.{name}")
    assert getattr(ecm, name) is getattr(module, name)
    assert callable(getattr(ecm, name))


@pytest.mark.parametrize(
    ("code", "not_loaded"),
    [
        ("import ecm", ("numpy", "scipy", "ecm._native")),
        ("from ecm.cli import run; run(['--version'])", ("numpy", "scipy")),
        ("import ecm.rig, ecm.config", ("scipy", "ecm.models", "ecm.diagnose", "ecm.effects")),
    ],
)
def test_a_command_loads_only_what_it_uses(code: str, not_loaded: tuple[str, ...]) -> None:
    script = f"{code}\nimport sys\nprint([n for n in {not_loaded!r} if n in sys.modules])"
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert done.stdout.splitlines()[-1] == "[]"
