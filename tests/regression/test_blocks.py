"""Work that is shared by the cores."""

from __future__ import annotations

import os
import sys
import time
from threading import Barrier, get_ident

import pytest

from ecm.io.extras import in_background
from ecm.regression.normal_equations import in_threads


def test_long_items_are_worked_on_at_once_and_come_back_in_order(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1}, raising=False)
    both = Barrier(2, timeout=10.0)  # each waits for the other

    def work(item: int) -> int:
        if item == 5:
            time.sleep(4.0 * sys.getswitchinterval())
        else:
            both.wait()
        return 10 * item

    assert in_threads(work, [5, 4, 3]) == [50, 40, 30]


def test_short_items_stay_in_one_thread() -> None:
    """Threads of them would wait for each other."""
    assert set(in_threads(lambda _: get_ident(), range(20))) == {get_ident()}


def test_an_error_of_an_item_is_raised() -> None:
    with pytest.raises(ZeroDivisionError):
        in_threads(lambda item: 1 // item, [1, 0, 1])


def test_a_work_goes_on_in_the_background_and_its_error_is_raised_where_it_is_asked_for() -> None:
    both = Barrier(2, timeout=10.0)
    waited = in_background(both.wait)
    both.wait()
    assert waited.result() in (0, 1)
    with pytest.raises(ZeroDivisionError):
        in_background(lambda: 1 // 0).result()
