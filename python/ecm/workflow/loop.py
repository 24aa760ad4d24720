"""The loop that users come for: compare, diagnose, add, refit, and the error falls.

Here on the simulated rig with an effect hidden in it by [hidden]; `ecm compare`, `diagnose`,
`refit` and `reveal` are the same steps on any data.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ecm.comparison import compare
from ecm.diagnosis import diagnose
from ecm.io.arrays import F
from ecm.io.table import Table
from ecm.models import Model, PhysicsMap, PhysicsModel, fit_model
from ecm.rig import reveal

Say = Callable[[str], object]


@dataclass(frozen=True)
class Loop:
    """What the loop found: numbers for the summary, arrays for its figures."""

    summary: dict[str, Any]
    figures: dict[str, F]
    model: Model


def run_loop(
    data: Table, physics: PhysicsMap, *, path: Path, seed: int, threads: int, say: Say
) -> Loop:
    """Fit the physics base, find what it lacks, add it, refit; then open the sealed truth.

    `path` is the file of the data; its truth, where one was sealed, lies beside it.
    """
    model = fit_model(data, PhysicsModel(base=physics, threads=threads))
    before = compare(model, data, seed=seed)
    say(f"  {before.sentence()}")
    diagnosis = diagnose(model, data, seed=seed).to_dict()
    say(f"  verdict: {diagnosis['verdict']} {_listed(diagnosis['answer'])}")
    # Of a class any member predicts alike; the first is the likeliest.
    ids = [members[0] for members in diagnosis["answer"]]
    ids += [e["id"] for e in diagnosis["effects"] if e["id"] not in ids]
    better = model
    for effect in ids:
        better = better.add(effect).fit(data)
    after = compare(better, data, noise=before.noise, seed=seed)
    history = [rung.to_dict() for rung in better.history]
    for rung in history:
        say(f"  {rung['name']}: held-out error {rung['held_out']:.3f} times the noise")
    score = None
    if data.meta.file.truth_sha256:
        score = reveal(path, diagnosis).score
    if score is not None:
        say(
            f"  hidden was {', '.join(score['truth'])}: "
            + ("found" if score["correct"] else "not found")
        )
    figures = {
        "loop_before": before.whitened,
        "loop_after": after.whitened,
    }
    measured = data.measured()
    if measured.has("time_s"):
        figures["loop_time_s"] = measured.column("time_s")
    summary = {
        "rows": before.rows,
        "minutes": float(data.column("time_s").max()) / 60.0 if data.has("time_s") else None,
        "before": before.to_dict(),
        "after": after.to_dict(),
        "diagnosis": diagnosis,
        "history": history,
        "score": score,
    }
    return Loop(summary, figures, better)


def _listed(answer: list[list[str]]) -> str:
    return ", ".join(" or ".join(members) for members in answer)
