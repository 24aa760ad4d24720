"""The loop of the user: compare, diagnose, add the effect, refit; the error falls.

Here it runs on the simulated rig with an effect hidden by [hidden]; `ecm compare`, `diagnose`,
`refit` and `reveal` are the same steps on any data.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ecm.comparison import compare
from ecm.diagnosis import diagnose
from ecm.io.arrays import F
from ecm.io.table import Table
from ecm.models import Model, PhysicsMap, PhysicsModel, fit_model
from ecm.rig import reveal
from ecm.workflow.job import Job


@dataclass(frozen=True)
class Loop:
    """Result of the loop: numbers for the summary, arrays for its figures, the model."""

    summary: dict[str, Any]
    figures: dict[str, F]
    model: Model


def run_loop(data: Table, physics: PhysicsMap, *, path: Path, job: Job) -> Loop:
    """Fit the physics base, find what it lacks, add it, refit; then open the sealed truth.

    Parameters
    ----------
    data
        The measured table.
    physics
        Map of the body.
    path
        File of the data; its truth, where one was sealed, is beside it.
    job
        Seed, threads and console.
    """
    write, seed = job.console.print, job.seed
    model = fit_model(data, PhysicsModel(base=physics, threads=job.threads))
    before = compare(model, data, seed=seed)
    write(f"  {before.sentence()}")
    diagnosis = diagnose(model, data, seed=seed).to_dict()
    answer = diagnosis["answer"]
    names = ", ".join(" or ".join(members) for members in answer)
    write(f"  verdict: {diagnosis['verdict']} {names}")
    # All members of a class predict alike; the first is the likeliest.
    ids = [members[0] for members in answer]
    ids += [effect["id"] for effect in diagnosis["effects"] if effect["id"] not in ids]
    better = model
    for effect in ids:
        better = better.add(effect).fit(data)
    after = compare(better, data, noise=before.noise, seed=seed)
    history = [record.to_dict() for record in better.history]
    for record in history:
        write(f"  {record['name']}: held-out error {record['held_out']:.3f} times the noise")
    score = reveal(path, diagnosis).score if data.meta.file.truth_sha256 else None
    if score is not None:
        result = "found" if score["correct"] else "not found"
        write(f"  hidden was {', '.join(score['truth'])}: {result}")
    figures = {"loop_before": before.whitened, "loop_after": after.whitened}
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
