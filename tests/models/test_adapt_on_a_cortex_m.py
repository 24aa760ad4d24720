"""The exported adapter on a Cortex-M4F: golden readings, instructions and stack."""

from __future__ import annotations

import re
from pathlib import Path

from ecm.models.controller import OUTCOMES, AdaptSettings
from support.cortex_m import CORTEX, THUMB, linked, run_on_board
from support.exports import adapter_library, fitted, written
from support.programs import need_rust_target


def test_an_adapter_on_a_cortex_m_follows_golden_readings(tmp_path: Path) -> None:
    need_rust_target(THUMB)
    core = "cortex-m4"
    written(fitted("energy6"), tmp_path, "c", "single", adapt=AdaptSettings())
    sources = [tmp_path / "neck.c", adapter_library(tmp_path, "--target", THUMB)]
    run_on_board(linked(tmp_path, core, tmp_path / "neck_adapt_check.c", *sources), core)
    program = linked(tmp_path, core, '-DADAPT="neck_adapt.h"', CORTEX / "count.c", *sources)
    counted = [int(part) for part in run_on_board(program, core).split()]
    static, waits, closes, stack = counted[4], counted[7], counted[10], counted[11]
    print(
        f"energy6 single: h and K {static}, a reading that waits {waits}, "
        f"one that ends its interval {closes - waits}, stack {stack} B"
    )
    assert [OUTCOMES[i] for i in counted[12:]] == ["waiting", "adapted"]
    assert waits < 0.4 * static
    assert closes < 30 * static
    stated = int(re.findall(r"Stack: at most (\d+)", (tmp_path / "neck_adapt.h").read_text())[0])
    assert 0.3 * stated < stack <= stated
