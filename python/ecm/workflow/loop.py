"""The loop of the user: compare, diagnose, add the effect, refit; and its section of a report.

Here it runs on the simulated rig with an effect hidden by [hidden]; `ecm compare`, `diagnose`,
`refit` and `reveal` are the same steps on any data.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ecm.comparison import compare
from ecm.diagnosis import diagnose
from ecm.diagnosis.summary import not_testable_table, ranking_table
from ecm.io.arrays import F
from ecm.io.table import Table
from ecm.models import Model, PhysicsMap, PhysicsModel, fit_model
from ecm.report import figures as draw
from ecm.report.blocks import Block, FigureBlock, Section, TableBlock, TextBlock, number
from ecm.rig import reveal
from ecm.workflow.job import Job


def run_loop(job: Job, data: Table, physics: PhysicsMap | None) -> Model:
    """Fit the physics base, find what it lacks, add it, refit; then open the sealed truth.

    Of a driven mechanism the base is an energy of pose and actuation.

    Parameters
    ----------
    job
        Takes the numbers of the summary and the arrays of the figures.
    data
        The measured table, as read from a file: its truth, where one was sealed, is beside it.
    physics
        Map of the body; None of a driven mechanism.

    Returns
    -------
    Model
        The model with what it lacked.
    """
    seed = job.seed
    if physics is None:
        model = fit_model(data, f"actuated{job.config.select.energy_degrees[-1]}")
    else:
        model = fit_model(data, PhysicsModel(base=physics, threads=job.threads))
    before = compare(model, data, seed=seed)
    diagnosis = diagnose(model, data, seed=seed).to_dict()
    answer = diagnosis["answer"]
    # All members of a class predict alike; the first is the likeliest.
    ids = [members[0] for members in answer]
    ids += [effect["id"] for effect in diagnosis["effects"] if effect["id"] not in ids]
    better = model
    for effect in ids:
        better = better.add(effect).fit(data)
    after = compare(better, data, noise=before.noise, seed=seed)
    history = [record.to_dict() for record in better.history]
    score = reveal(data, diagnosis).score if data.meta.file.truth_sha256 else None
    job.figures |= {"loop_before": before.whitened, "loop_after": after.whitened}
    measured = data.measured()
    if measured.has("time_s"):
        job.figures["loop_time_s"] = measured.column("time_s")
    job.summary["loop"] = {
        "rows": before.rows,
        "minutes": float(data.column("time_s").max()) / 60.0 if data.has("time_s") else None,
        "before": before.to_dict(),
        "after": after.to_dict(),
        "diagnosis": diagnosis,
        "history": history,
        "score": score,
    }
    job.show(loop_section(job.summary["loop"], job.figures))
    return better


def loop_section(step: Mapping[str, Any], figures: Mapping[str, F]) -> Section:
    """Compare, diagnose, refit; and what had been hidden."""
    diagnosis, history = step["diagnosis"], step["history"]
    blocks: list[Block] = [
        TextBlock(_sentence(step), strong=True),
        TextBlock(step["before"]["sentence"]),
        _components(step["before"], step["after"], history[0]["name"]),
        _history_table(history),
    ]
    if history:
        errors: dict[str, Sequence[float]] = {
            "fitted rows": [record["train"] for record in history],
            "held-out rows": [record["held_out"] for record in history],
        }
        blocks.append(
            FigureBlock(
                "The fit history: root mean square of whitened residuals, 1 is the noise floor.",
                draw.bars(errors, [record["name"] for record in history], y_title="error / noise"),
            )
        )
    blocks.append(ranking_table(diagnosis))
    if "loop_time_s" in figures:
        blocks.append(
            FigureBlock(
                "Residual of each measured pose over time, in units of its noise: before and "
                "after the refit." + draw.drawn_sentence(figures["loop_before"]),
                draw.residuals_over(
                    figures["loop_time_s"] / 60.0,
                    {"before": figures["loop_before"], "after": figures["loop_after"]},
                    x_title="time [min]",
                ),
            )
        )
    if diagnosis["not_testable"]:
        blocks.append(not_testable_table(diagnosis))
    return Section("4 Find the missing effect", blocks)


def _sentence(step: Mapping[str, Any]) -> str:
    """What is missing, what it brings, and what had been hidden."""
    text, history = f"Missing: {step['diagnosis']['summary']['missing']}.", step["history"]
    if len(history) > 1:
        first, last = number(history[0]["held_out"]), number(history[-1]["held_out"])
        text += f" By the refit the held-out error falls from {first} to {last} times the noise."
    if step.get("score") is not None:
        text += f" Hidden in the rig was {', '.join(step['score']['truth']) or 'nothing'}."
    return text


def _components(before: Mapping[str, Any], after: Mapping[str, Any], base: str) -> TableBlock:
    """RMSE, floor and excess of each component, before and after."""

    def excess(row: Mapping[str, Any]) -> str:
        low, high = number(row["excess_low"]), number(row["excess_high"])
        return f"{number(row['excess'])} ({low} to {high})"

    both = zip(before["components"], after["components"], strict=True)
    return TableBlock(
        f"Error of {base} before and after the refit; the floor is what noise alone gives, pose "
        "noise carried through K; excess with its 90 % interval.",
        ("component", "RMSE", "after", "noise floor", "excess", "after", "bias"),
        [
            [a["name"], a["rmse"], b["rmse"], a["floor"], excess(a), excess(b), a["bias"]]
            for a, b in both
        ],
    )


def _history_table(history: Sequence[Mapping[str, Any]]) -> TableBlock:
    keys = ("name", "train", "held_out", "ceiling")
    return TableBlock(
        "Error over noise. The ceiling adds a free cubic of the pose: no effect of the pose can "
        "do better.",
        ("model", "fitted rows", "held-out rows", "ceiling"),
        [[record[key] for key in keys] for record in history],
    )
