"""The benchmarks run seldom: at least each can be imported."""

import importlib

import pytest

from support.neck import ROOT

NAMES = sorted(path.stem for path in (ROOT / "benches").glob("*.py"))


@pytest.mark.parametrize("name", NAMES)
def test_a_benchmark_can_be_imported(name: str) -> None:
    assert importlib.import_module(name).__doc__
