"""Sections of a diagnosis: verdict and what it rests on, what is unknown, what cannot be seen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from ecm.comparison.comparison import Comparison
from ecm.comparison.residual_figures import residual_figure, residual_section
from ecm.comparison.sections import workspace_blocks
from ecm.diagnosis.summary import LINES
from ecm.io.arrays import F
from ecm.report.page import (
    Block,
    CodeBlock,
    FigureBlock,
    Section,
    TableBlock,
    TextBlock,
    number,
    warnings_table,
    write_page,
)

_SHOWN = 12
_STEPS = ("before", "base", "after", "floor", "ceiling")


def verdict_section(document: Mapping[str, Any]) -> Section:
    """The three lines, base, noise and gate, errors, sizes of what is named, what looks alike."""
    blocks: list[Block] = [
        TableBlock("", ("", ""), [[words, document["summary"][key]] for key, words in LINES]),
        TextBlock(document["sentence"]),
        _rests_on(document),
    ]
    blocks += _errors(document)
    rows = [
        [item["id"], name, number(p["value"]), number(p["sd"], 2), p["unit"]]
        for item in document["effects"]
        for name, p in item["parameters"].items()
    ]
    if rows:
        header = ("effect", "parameter", "value", "± sd", "unit")
        blocks.append(TableBlock("What the accepted effects measure.", header, rows))
    alike: dict[str, list[str]] = {}
    for first, second in document["confusable"]:
        alike.setdefault(first, []).append(second)
    if alike:
        rows = [[first, ", ".join(others)] for first, others in alike.items()]
        caption = "What these data cannot tell a"
        blocks.append(TableBlock(caption, ("effect", "looks like"), rows))
    if document["look_alikes"]:
        rows = [[one["id"], one["what"], one["apart"]] for one in document["look_alikes"]]
        caption = "What is not in the catalogue and would get the same name."
        outside = ("effect", "or", "what tells it apart")
        blocks.append(TableBlock(caption, outside, rows))
    blocks += warnings_table(document["warnings"])
    return Section("Verdict", blocks)


def _rests_on(document: Mapping[str, Any]) -> TableBlock:
    """Base, noise and gate of the verdict."""
    base, gate = document["base"], document["gate"]
    rows = [
        ["base", base["kind"]],
        *(
            []
            if document["noise"].get("is_residual") or base["error_over_noise"] == 0.0
            else [["the base's own error over the noise", f"{base['error_over_noise']:.2f}"]]
        ),
        *_mesh_row(base),
        ["source of the noise", noise_words(document["noise"])],
        ["lack of fit", f"F = {number(gate['F'])}, p = {number(gate['p'], 2)}"],
    ]
    if "rows_used" in document:
        rows.append(["rows", document["rows_used"]["sentence"]])
    if document["verdict"] == "none":
        bound = f"below {document['upper_bound']:.2f} times the noise, with 95 % confidence"
        rows.append(["what smooth functions could still hide", bound])
    return TableBlock("What the verdict rests on.", ("", ""), rows)


def _mesh_row(base: Mapping[str, Any]) -> list[list[str]]:
    """What the size of the elements makes, where two meshes were compared."""
    if "mesh_error" not in base:
        return []
    share = max(abs(value) for value in base["mesh_error"].values())
    left = f"{base['mesh_error_over_noise']:.2f} times the noise beside E and nu"
    left += ", a direction in which the base may err"
    return [["standard mesh against the fine one", f"up to {share:.1%} of the wrench, {left}"]]


def noise_words(noise: Mapping[str, Any]) -> str:
    """Where the noise comes from; a spread of the residual is not called noise."""
    if noise.get("is_residual"):
        return "not known (the base's own residual weighs the components)"
    return str(noise["source"])


def _errors(document: Mapping[str, Any]) -> list[Block]:
    """Error of each component, and of held-out rows over the noise, at each step."""
    errors = {**document["rmse"], "base": document["model"]["base_errors"]["rmse"]}
    held_out = document["held_out"]
    steps = [step for step in _STEPS if errors[step]]
    rows = [
        [name, *(number(errors[step].get(name, float("nan"))) for step in steps)]
        for name in errors["before"]
    ]
    caption = (
        "Root mean square error in the unit of each column. Before: the model as given, not "
        "refitted. Base: what names are against, fitted to these rows. After: the base with the "
        "accepted effects"
    )
    if errors["floor"]:
        caption += ". The floor is the noise"
    more = "; the ceiling is the base with a free cubic of the pose, on held-out rows."
    caption += more if errors["ceiling"] else "."
    over_noise = {"before": held_out["before"], "after": held_out["after"]}
    unit = "the base's own residual" if document["noise"].get("is_residual") else "the noise"
    if errors["floor"]:
        over_noise["floor"] = 1.0
    if "ceiling" in held_out:
        over_noise["ceiling"] = held_out["ceiling"]
    return [
        TableBlock(caption, ("component", *steps), rows),
        TableBlock(
            f"Held-out error over {unit}. Before: the base alone.",
            ("", *over_noise),
            [["held-out rows", *(number(value) for value in over_noise.values())]],
        ),
    ]


def unknown_section(document: Mapping[str, Any]) -> Section | None:
    """Variables that matter, words, the nearest effect and a draft of a new one."""
    unknown = document["unknown"]
    if unknown is None:
        return None
    blocks: list[Block] = [TextBlock(f"What stays: {unknown['words']}.")]
    if unknown["variables"]:
        blocks.append(TextBlock(f"It follows: {', '.join(unknown['variables'])}."))
    if (nearest := unknown["nearest"]) is not None:
        blocks.append(
            TextBlock(f"The nearest effect is {nearest['id']}: {nearest['share']:.0%} of it.")
        )
    if unknown["skeleton"]:
        blocks.append(
            CodeBlock("A first draft of an effect of your own, in Python.", unknown["skeleton"])
        )
    return Section("Unknown", blocks)


def limits_section(document: Mapping[str, Any]) -> Section | None:
    """From which size each testable effect would have been named."""
    limits = document["detection_limits"]
    if not limits:
        return None
    rows = [
        [id, item["parameter"], number(item["size"]), item["unit"]] for id, item in limits.items()
    ]
    caption = "The smallest size that these data would have named with chance 0.9."
    header = ("effect", "parameter", "size", "unit")
    return Section("Would have been seen from", [TableBlock(caption, header, rows)])


def untestable_section(document: Mapping[str, Any]) -> Section | None:
    """Effects that these data cannot test, and what to record so that they can."""
    if not document["not_testable"]:
        return None
    rows = [[item["id"], item["reason"], item["record"]] for item in document["not_testable"]]
    header = ("effect", "why not", "what to record")
    block = TableBlock("Effects that these data cannot test.", header, rows)
    return Section("Not testable", [block])


def next_section(document: Mapping[str, Any]) -> Section | None:
    """Experiments that would tell more, with their minutes."""
    if not document["next_experiment"]:
        return None
    rows = [_proposal(item) for item in document["next_experiment"]]
    header = ("action", "minutes", "tells apart", "chance of the right name")
    return Section("Next experiment", [TableBlock("What would tell more.", header, rows)])


def _proposal(item: Mapping[str, Any]) -> list[str]:
    known = item.get("p_correct") is not None
    chance = f"{item['p_correct_before']:.2f} to {item['p_correct']:.2f}" if known else "not known"
    return [item["action"], str(item["minutes"]), "; ".join(item.get("separates", ())), chance]


def ranking_table(diagnosis: Mapping[str, Any]) -> TableBlock:
    """The first rows of the ranking."""
    return TableBlock(
        "The effects in order of what each would explain alone.",
        ("effect", "p", "ΔBIC", "size", "± sd", "unit", "expected fall of error / noise"),
        [
            [
                row["id"],
                number(row["p"], 2),
                number(row["delta_bic"], 3),
                number(row["size"], 3),
                number(row["sd"], 2),
                row["unit"],
                number(row["expected_fall"], 2),
            ]
            for row in diagnosis["ranking"][:_SHOWN]
        ],
    )


def write_diagnosis(
    path: Path,
    document: Mapping[str, Any],
    compared: Comparison | None = None,
    predicted: F | None = None,
) -> None:
    """Write verdict, unknown structure, residual maps, ranking, limits and next experiment.

    Parameters
    ----------
    path
        File of the page.
    document
        The diagnosis as plain values (`Diagnosis.to_dict`).
    compared
        Comparison of the model before with the same rows, for the residual maps.
    predicted
        (N, m) what the effects of the answer add to the wrench of its rows.
    """
    sections = [verdict_section(document), unknown_section(document)]
    if compared is not None:
        sections.append(_residuals(document, compared, predicted))
    if document["ranking"]:
        sections.append(Section("Ranking", [ranking_table(dict(document))]))
    sections += [
        limits_section(document),
        untestable_section(document),
        next_section(document),
    ]
    shown = [section for section in sections if section is not None]
    write_page(path, "Which effect is missing", f"verdict: {document['verdict']}", shown)


def _residuals(document: Mapping[str, Any], compared: Comparison, predicted: F | None) -> Section:
    unknown = document["unknown"]
    section = residual_section(compared.where(), [] if unknown is None else unknown["variables"])
    first: list[Block] = [section.blocks[0], *workspace_blocks(compared)]
    if predicted is not None:
        caption = "What the answer predicts (crosses) on the residuals of the model before."
        figure = residual_figure(compared.where(), predicted=predicted)
        first.append(FigureBlock(caption, figure))
    return replace(section, blocks=[*first, *section.blocks[1:]])
