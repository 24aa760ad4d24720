"""What the diagnosis says of a set, and what one who knows the truth could reach."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from blind_parts.data import Data
from blind_parts.once import Work
from blind_parts.sets import Set
from ecm.diagnosis import DiagnosisSettings, Stages, diagnose, find_missing
from ecm.diagnosis.problem import Candidate, Problem
from ecm.diagnosis.procedure import STAGES
from ecm.diagnosis.search import held_out_rms, rank
from ecm.diagnosis.settings import DEFAULTS
from ecm.effects import Effect, all_effects
from ecm.effects.registry import with_shape
from ecm.models.fit import choose_base
from ecm.models.joint_fit import joint_fit
from ecm.regression.folds import distinct_rows, rows_without_zero_readings, zero_times
from ecm.regression.noise import declared_noise

SEEDS = 20
_NORMAL_90 = 1.6449


@dataclass(frozen=True)
class Method:
    """How our procedure is run: its limits, its stages, and what each effect is replaced by."""

    settings: DiagnosisSettings = DEFAULTS
    stages: Stages = STAGES
    effect: Callable[[str], str | Effect] = str


OURS = Method()


def library(removed: Sequence[str]) -> list[str]:
    """All ids but those that were taken out."""
    return [effect.id for effect in all_effects() if effect.id not in removed]


def our_answer(
    case: Set, data: Data, seed: int = 0, *, without: Sequence[str] = (), method: Method = OURS
) -> dict[str, Any]:
    """The report of `diagnose`, what a score needs of it."""
    return worked_answer(case, data, seed, without=without, method=method)[0]


def worked_answer(
    case: Set, data: Data, seed: int = 0, *, without: Sequence[str] = (), method: Method = OURS
) -> tuple[dict[str, Any], Work]:
    """The same with the stages that a further analysis of these data can share."""
    work = Work(method.stages)
    # One thread: processor time is what an idle core takes, however busy the machine is.
    began = time.process_time()
    report = diagnose(
        data.model,
        data.table,
        seed=seed,
        effects=[method.effect(id) for id in library((*case.removed, *without))],
        settings=method.settings,
        stages=work.recording(),
    ).to_dict()
    seconds = time.process_time() - began
    keys = (
        "verdict", "answer", "effects", "held_out", "gate", "not_testable", "next_experiment",
        "noise",
    )  # fmt: skip
    answer = {key: report[key] for key in keys}
    answer["first"] = [row["id"] for row in report["ranking"][:3]]
    answer["needed"] = {row["id"]: (row["size"], row["unit"]) for row in report["ranking"]}
    answer["left_over"] = report["left_over"]
    answer["seconds"] = seconds
    answer["rows"] = len(data.table)
    return answer, work


def same_verdicts(case: Set, data: Data, first: dict[str, Any], work: Work) -> float:
    """Share of further seeds of the analysis with the same verdict and answer."""
    same = 0
    for seed in range(1, SEEDS):
        again = find_missing(
            data.model,
            data.table,
            seed=seed,
            effects=library(case.removed),
            stages=work.replaying(),
        )
        answer = [list(members) for members in again.answer]
        same += (again.verdict, answer) == (first["verdict"], first["answer"])
    return same / (SEEDS - 1)


def oracle(case: Set, problem: Problem) -> float | None:
    """Held-out error with the truth's own effects; None where the library lacks one."""
    chosen: list[Candidate] = []
    for id, _ in case.hidden:
        ranked = [item for item in rank(problem, chosen) if item.candidate.id == id]
        if not ranked:
            return None
        chosen.append(ranked[0].candidate)
    return held_out_rms(problem, chosen)


def parameters(case: Set, data: Data, report: dict[str, Any]) -> list[dict[str, Any]]:
    """Values of rightly named effects against a fit of the same form to data without noise."""
    hidden = dict(case.hidden)
    right = [item for item in report["effects"] if item["id"] in hidden]
    if not right or len(right) != len(report["effects"]):
        return []
    effects = [with_shape(item["id"], item["shape"]) for item in right]
    # The same rows: those that the diagnosis leaves out would pull the reference alone.
    rows = rows_without_zero_readings(data.table)
    rows = rows[distinct_rows(data.table.select(rows))]
    quiet = replace(data.quiet.select(rows), zeros_s=zero_times(data.table))
    base = choose_base(data.model, quiet)
    found = joint_fit(base, effects, quiet, declared_noise(data.table))
    result = []
    for item, fitted in zip(right, found.effects, strict=True):
        value = np.array([p["value"] for p in item["parameters"].values()])
        sd = np.array([p["sd"] for p in item["parameters"].values()])
        scale = np.array([p.scale for p in fitted.effect.parameters])
        size = float(np.linalg.norm(fitted.values / scale))
        error = float(np.linalg.norm((value - fitted.values) / scale)) / max(size, 1e-300)
        inside = np.abs(value - fitted.values) < _NORMAL_90 * sd
        result.append(
            {
                "id": item["id"],
                "s": hidden[item["id"]],
                "relative_error": error,
                "inside": int(inside.sum()),
                "of": len(inside),
            }
        )
    return result
