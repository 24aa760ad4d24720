"""What `ecm diagnose` promises for a model is what the command that it prints then reaches."""

from __future__ import annotations

import json
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from blind_parts.other_sets import OtherSet, given_model, other_sets, table_of

BODIES = ("soft", "stiff", "planar", "hinge")
"""Those without FEM."""
CASES = [s for s in other_sets(120, 41) if s.kind == "known" and s.body in BODIES][:5]


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.name}-{case.body}")
def test_the_printed_command_reaches_what_it_promises(
    case: OtherSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ecm_command: Callable[..., Any]
) -> None:
    monkeypatch.chdir(tmp_path)
    table, mechanism = table_of(case, tmp_path)
    given_model(table, mechanism).save("model.json")
    table.write("data.csv")
    done = ecm_command("diagnose", "model.json", "data.csv", "--json", "found.json")
    assert done.code == 0, done.err
    addition = json.loads(Path("found.json").read_text(encoding="utf-8")).get("addition")
    if addition is None or addition["refused"]:
        # Then the command is another model's, and the line says so.
        assert "ecm refit model.json" not in done.out
        return
    argv = shlex.split(addition["remedy"]["command"])[1:]
    done = ecm_command(*argv, "--json", "refit.json")
    assert done.code == 0, done.err
    reached = json.loads(Path("refit.json").read_text(encoding="utf-8"))["history"][-1]["held_out"]
    assert reached <= 1.05 * addition["held_out"]["after"]
    assert reached < addition["held_out"]["before"]
