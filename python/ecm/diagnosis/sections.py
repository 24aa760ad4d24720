"""The report of a diagnosis: verdict and what it rests on, what is unknown, what cannot be seen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from ecm.comparison.residual_figures import residual_figure, residual_section
from ecm.comparison.result import Comparison, workspace_blocks
from ecm.diagnosis.summary import LINES
from ecm.effects import with_shape
from ecm.errors import Remedy
from ecm.io.arrays import F
from ecm.report.blocks import Block, CodeBlock, FigureBlock, Section, TableBlock, TextBlock, number
from ecm.report.page import Report

_SHOWN = 12
_STEPS = ("before", "base", "after", "floor", "ceiling")


def diagnosis_report(
    document: Mapping[str, Any],
    compared: Comparison | None = None,
    predicted: F | None = None,
) -> Report:
    """Return three lines, verdict, unknown structure, residual maps, ranking, limits, what is next.

    Parameters
    ----------
    document
        The diagnosis as plain values (`Diagnosis.to_dict`).
    compared
        Comparison of the model before with the same rows, for the residual maps.
    predicted
        (N, m) what the effects of the answer add to the wrench of its rows.
    """
    lines = [[words, document["summary"][key]] for key, words in LINES]
    sections = [
        Section("In three lines", [TableBlock("", ("", ""), lines)]),
        Section("Verdict", verdict_blocks(document)),
    ]
    if document["unknown"] is not None:
        sections.append(Section("Unknown", _unknown(document["unknown"])))
    if compared is not None:
        sections.append(_residuals(document, compared, predicted))
    sections += [
        Section(title, [table])
        for title, table in (
            ("Next experiment", _next(document)),
            ("Ranking", ranking_table(document)),
            ("Not testable", not_testable_table(document)),
            ("Would have been seen from", _limits(document)),
        )
        if table.rows
    ]
    lead = f"verdict: {document['verdict']}"
    return Report("Which effect is missing", lead, sections, document["warnings"])


def verdict_blocks(document: Mapping[str, Any]) -> list[Block]:
    """Base, noise and gate, errors, sizes of what is named, what looks alike, how to add it."""
    effects = document["effects"]
    alike: dict[str, list[str]] = {}
    for first, second in document["confusable"]:
        alike.setdefault(first, []).append(second)
    tables = [
        _rests_on(document),
        *_errors(document),
        TableBlock(
            "What the accepted effects measure.",
            ("effect", "parameter", "value", "± sd", "unit"),
            [
                [item["id"], name, number(p["value"], 4), p["sd"], p["unit"]]
                for item in effects
                for name, p in item["parameters"].items()
            ],
        ),
        TableBlock(
            "What is not in the catalogue and would get the same name.",
            ("effect", "or", "what tells it apart"),
            [[one["id"], one["what"], one["apart"]] for one in document["look_alikes"]],
        ),
        TableBlock(
            "What these data cannot tell apart.",
            ("effect", "looks like"),
            [[first, ", ".join(others)] for first, others in alike.items()],
        ),
    ]
    return [
        TextBlock(document["sentence"]),
        *(
            TextBlock(f"{one['id']}: {with_shape(one['id'], one.get('shape', {})).physics}")
            for one in effects
        ),
        *(table for table in tables if table.rows),
        *_addition(document.get("addition")),
    ]


def _addition(addition: Mapping[str, Any] | None) -> list[Block]:
    """What adding the effects to the given model brings, and the command."""
    if addition is None:
        return []
    names, held_out = " and ".join(addition["effects"]), addition["held_out"]
    text = f"Add it: {names}"
    if addition["refused"]:
        text += f" cannot be added to this model: {addition['refused']}"
    elif held_out["after"] is not None:
        text += f"; this model's held-out error {held_out['before']:.2f} -> "
        text += f"{held_out['after']:.2f} times the noise"
    if addition["remedy"] is None:
        return [TextBlock(f"{text.rstrip('.')}.")]
    remedy = Remedy(**addition["remedy"])
    words = f" {Remedy(remedy.words)}" if addition["refused"] else ""
    return [CodeBlock(f"{text.rstrip('.')}.{words}", remedy.command)]


def _rests_on(document: Mapping[str, Any]) -> TableBlock:
    """Base, noise and gate of the verdict."""
    base, gate, noise = document["base"], document["gate"], document["noise"]
    rows = [["base", base["kind"]]]
    # Only a body's FEM has one; how far another form is off is what the tests say.
    if not noise["is_assumed"] and base["error_over_noise"] != 0.0:
        rows.append(["the base's own error over the noise", f"{base['error_over_noise']:.2f}"])
    if "mesh_error" in base:
        share = max(abs(value) for value in base["mesh_error"].values())
        left = f"{base['mesh_error_over_noise']:.2f} times the noise beside E and nu"
        left = f"up to {share:.1%} of the wrench, {left}, a direction in which the base may err"
        rows.append(["standard mesh against the fine one", left])
    source = "not known (the base's own residual weighs the components)"
    rows += [
        ["source of the noise", source if noise.get("is_residual") else noise["source"]],
        ["lack of fit", f"F = {number(gate['F'])}, p = {number(gate['p'], 2)}"],
    ]
    if (pattern := (document["unknown"] or {}).get("pattern")) is not None:
        rows.append([pattern["words"], f"p = {number(pattern['p'], 2)}"])
    if "rows_used" in document:
        rows.append(["rows", document["rows_used"]["sentence"]])
    if document["verdict"] == "none":
        bound = f"below {document['upper_bound']:.2f} times the noise, with 95 % confidence"
        rows.append(["what smooth functions could still hide", bound])
    return TableBlock("What the verdict rests on.", ("", ""), rows)


def _errors(document: Mapping[str, Any]) -> list[TableBlock]:
    """Error of each component, and of held-out rows over the noise, at each step."""
    errors = {**document["rmse"], "base": document["model"]["base_errors"]["rmse"]}
    held_out = document["held_out"]
    steps = [step for step in _STEPS if errors[step]]
    rows = [[name, *(errors[step].get(name) for step in steps)] for name in errors["before"]]
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
            [["held-out rows", *over_noise.values()]],
        ),
    ]


def _unknown(unknown: Mapping[str, Any]) -> list[Block]:
    """Variables that matter, words, the nearest effect and a draft of a new one."""
    blocks: list[Block] = [TextBlock(f"What stays: {unknown['words']}.")]
    if unknown["variables"]:
        blocks.append(TextBlock(f"It follows: {', '.join(unknown['variables'])}."))
    if (nearest := unknown["nearest"]) is not None:
        blocks.append(
            TextBlock(f"The nearest effect is {nearest['id']}: {nearest['share']:.0%} of it.")
        )
    if unknown["skeleton"]:
        caption = "A first draft of an effect of your own, in Python."
        blocks.append(CodeBlock(caption, unknown["skeleton"]))
    return blocks


def _limits(document: Mapping[str, Any]) -> TableBlock:
    """From which size each testable effect would have been named."""
    return TableBlock(
        "The smallest size that these data would have named with chance 0.9.",
        ("effect", "size", "unit", "parameter"),
        [
            [id, one["size"], one["unit"], one["parameter"]]
            for id, one in document["detection_limits"].items()
        ],
    )


def not_testable_table(document: Mapping[str, Any]) -> TableBlock:
    """Effects that these data cannot test, by what to record so that they can."""
    groups: dict[tuple[str, str], list[str]] = {}
    for item in document["not_testable"]:
        groups.setdefault((item["reason"], item["record"]), []).append(item["id"])
    return TableBlock(
        "Effects that these data cannot test, and what to record so that they can.",
        ("why not", "what to record", "effects"),
        [[*why, ", ".join(ids)] for why, ids in groups.items()],
    )


def _next(document: Mapping[str, Any]) -> TableBlock:
    """Experiments that would tell more, with their minutes."""
    rows = []
    for item in document["next_experiment"]:
        before, after = item.get("p_correct_before"), item.get("p_correct")
        chance = "not known" if after is None else f"{before:.2f} to {after:.2f}"
        rows.append([item["action"], item["minutes"], chance, "; ".join(item.get("separates", ()))])
    header = ("action", "minutes", "chance of the right name", "tells apart")
    return TableBlock("What would tell more.", header, rows)


def ranking_table(document: Mapping[str, Any]) -> TableBlock:
    """The first rows of the ranking."""
    keys = ("id", "p", "delta_bic", "size", "sd", "unit", "expected_fall")
    return TableBlock(
        "The effects in order of what each would explain alone; the last column is the fall of the "
        "error over the noise that is expected.",
        ("effect", "p", "ΔBIC", "size", "± sd", "unit", "fall"),
        [[row[key] for key in keys] for row in document["ranking"][:_SHOWN]],
    )


def _residuals(document: Mapping[str, Any], compared: Comparison, predicted: F | None) -> Section:
    unknown = document["unknown"]
    section = residual_section(compared.where(), [] if unknown is None else unknown["variables"])
    first: list[Block] = [section.blocks[0], *workspace_blocks(compared)]
    if predicted is not None:
        caption = "What the answer predicts (crosses) on the residuals of the model before."
        figure = residual_figure(compared.where(), predicted=predicted)
        first.append(FigureBlock(caption, figure))
    return replace(section, blocks=[*first, *section.blocks[1:]])
