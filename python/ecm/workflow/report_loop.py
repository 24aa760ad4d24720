"""Section of the loop: residuals before and after, the ranking, the error ladder."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ecm.diagnosis.sections import ranking_table
from ecm.io.arrays import F
from ecm.report import figures as draw
from ecm.report.page import FigureBlock, Section, TableBlock, TextBlock, number


def loop_section(step: Mapping[str, Any], figures: Mapping[str, F]) -> Section:
    """Compare, diagnose, refit; and what had been hidden."""
    diagnosis = step["diagnosis"]
    blocks: list[Any] = [TextBlock(verdict_sentence(step), strong=True)]
    blocks.append(TextBlock(step["before"]["sentence"]))
    blocks.append(component_table(step["before"], step["after"]))
    blocks.append(ladder_table(step["history"]))
    if step["history"]:
        blocks.append(
            FigureBlock(
                "The error ladder: root mean square of whitened residuals, 1 is the noise floor.",
                draw.bars(
                    {
                        "fitted rows": [rung["train"] for rung in step["history"]],
                        "held-out rows": [rung["held_out"] for rung in step["history"]],
                    },
                    [rung["name"] for rung in step["history"]],
                    y_title="error / noise",
                ),
            )
        )
    blocks.append(ranking_table(diagnosis))
    if "loop_time_s" in figures:
        blocks.append(
            FigureBlock(
                "Residual of each measured pose over time, in units of its noise: before and "
                "after the refit.",
                draw.residuals_over(
                    figures["loop_time_s"] / 60.0,
                    {"before": figures["loop_before"], "after": figures["loop_after"]},
                    x_title="time [min]",
                ),
            )
        )
    if diagnosis["not_testable"]:
        blocks.append(
            TableBlock(
                "What these data cannot show, and what to record so that they can.",
                ("effect", "why", "record"),
                [[row["id"], row["reason"], row["record"]] for row in diagnosis["not_testable"]],
            )
        )
    return Section("4 Find the missing effect", blocks)


def verdict_sentence(step: Mapping[str, Any]) -> str:
    """The headline: verdict, what it means for the error, and what had been hidden."""
    diagnosis = step["diagnosis"]
    names = ", ".join(" or ".join(members) for members in diagnosis["answer"])
    words = {
        "none": "Nothing is missing that these data could show.",
        "named": f"The missing effect is {names}.",
        "ambiguous": f"Missing is {names}: these data cannot tell which.",
        "unknown": "Something is missing that no effect of the catalogue explains.",
    }
    text = words[diagnosis["verdict"]]
    if len(step["history"]) > 1:
        first, last = step["history"][0], step["history"][-1]
        text += (
            f" With it the error on held-out poses falls from {number(first['held_out'])} to "
            f"{number(last['held_out'])} times the noise."
        )
    score = step.get("score")
    if score is not None:
        hidden = ", ".join(score["truth"]) or "nothing"
        text += f" Hidden in the rig was {hidden}."
    return text


def component_table(before: Mapping[str, Any], after: Mapping[str, Any]) -> TableBlock:
    """RMSE, floor and excess of each component, before and after."""
    rows = []
    for old, new in zip(before["components"], after["components"], strict=True):
        rows.append(
            [
                old["name"],
                number(old["rmse"]),
                number(new["rmse"]),
                number(old["floor"]),
                f"{number(old['excess'])} ({number(old['excess_low'], 2)} to "
                f"{number(old['excess_high'], 2)})",
                f"{number(new['excess'])} ({number(new['excess_low'], 2)} to "
                f"{number(new['excess_high'], 2)})",
                number(old["bias"], 2),
            ]
        )
    return TableBlock(
        "Error of the physics base before and after the refit; the floor is what noise alone "
        "gives, pose noise carried through K; excess with its 90 % interval.",
        ("component", "RMSE", "after", "noise floor", "excess", "after", "bias"),
        rows,
    )


def ladder_table(history: list[Mapping[str, Any]]) -> TableBlock:
    """The error ladder in numbers."""
    return TableBlock(
        "Error over noise. The ceiling adds a free cubic of the pose: no effect of the pose can "
        "do better.",
        ("model", "fitted rows", "held-out rows", "ceiling"),
        [
            [
                rung["name"],
                number(rung["train"], 4),
                number(rung["held_out"], 4),
                "–" if rung["ceiling"] is None else number(rung["ceiling"], 4),
            ]
            for rung in history
        ],
    )
