"""The exported adapter on a Cortex-M4F: golden readings, instructions and stack, in C and Rust."""

from __future__ import annotations

import re
from pathlib import Path

from ecm.models.adapt import OUTCOMES, AdaptSettings
from ecm.models.export import export_files
from support.cortex_m import CORTEX, linked, run_on_board, rust_library
from support.exports import fitted


def test_an_adapter_on_a_cortex_m_follows_golden_readings_in_c_and_rust(
    products: Path, tmp_path: Path
) -> None:
    core, model = "cortex-m4", fitted("energy6")
    for target, folder in (("c", tmp_path), ("rust", tmp_path / "neck")):
        files = export_files(model, target, "neck", "single", adapt=AdaptSettings()).files
        for path, text in files.items():
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            (folder / path).write_text(str(text), encoding="utf-8")
    check = tmp_path / "neck_adapt_check.c"
    code = {
        "C": [tmp_path / "neck.c", tmp_path / "neck_adapt.c"],
        "Rust": [rust_library(tmp_path, products, "3", "single", "adapt.rs")],
    }
    stated = int(re.findall(r"Stack: at most (\d+)", (tmp_path / "neck_adapt.h").read_text())[0])
    for language, sources in code.items():
        run_on_board(linked(tmp_path, core, check, *sources), core)
        program = linked(tmp_path, core, '-DADAPT="neck_adapt.h"', CORTEX / "count.c", *sources)
        counted = [int(part) for part in run_on_board(program, core).split()]
        static, waits, closes, stack = counted[4], counted[7], counted[10], counted[11]
        print(
            f"energy6 single {language}: h and K {static}, a reading that waits {waits}, "
            f"one that ends its interval {closes - waits}, stack {stack} B"
        )
        assert [OUTCOMES[i] for i in counted[12:]] == ["waiting", "adapted"]
        assert waits < 0.4 * static
        assert closes < 30 * static
        if language == "C":
            assert 0.3 * stated < stack <= stated
