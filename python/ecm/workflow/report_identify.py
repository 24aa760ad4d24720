"""The report of `ecm identify`: the paper's three steps, and the loop after them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ecm.io.arrays import F
from ecm.report import figures as draw
from ecm.report.page import FigureBlock, Section, TableBlock, TextBlock, number
from ecm.workflow.paper import FEM_RATIO, KAPPA_RAW, SYMMETRIC_SHARE
from ecm.workflow.report_arm import arm_section
from ecm.workflow.report_loop import loop_section

Figures = Mapping[str, F]
_NAMES = {
    "d": "D-optimal",
    "maximin": "maximin",
    "d by the paper's exchange": "D-optimal, Fedorov's exchange alone",
    "maximin by the paper's exchange": "maximin, simple exchange alone",
}
_HEADER = ("fx N", "fy N", "fz N", "τx N m", "τy N m", "τz N m")


def identify_sections(
    summary: Mapping[str, Any], figures: Figures, times: Mapping[str, Any]
) -> list[Section]:
    """Every section of the page, in the order of the work."""
    sections = [
        _result(summary, times),
        _simulation(summary["simulate"], figures),
        _selection(summary["select"], figures),
        _designs(summary["select"], figures),
        _measurement(summary["identify"], figures),
        _stiffness(summary["identify"], figures),
        _speed(times),
    ]
    if "arm" in summary["identify"]:
        sections.insert(4, arm_section(summary["identify"]["arm"], figures, _NAMES))
    if "loop" in summary:
        sections.append(loop_section(summary["loop"], figures))
    return sections


def _beside(
    rows: Sequence[Mapping[str, Any]], label: str, names: Mapping[Any, str] | None = None
) -> list[list[str]]:
    """Table rows: ours, and below it the paper's where it has one."""
    cells: list[list[str]] = []
    for row in rows:
        key = row[label]
        text = names[key] if names is not None else f"{key:g}"
        cells.append([text, *(number(v) for v in row["rmse"]), number(row["kappa"], 4)])
        if "paper_rmse" in row:
            cells.append(
                ["↳ the paper", *(f"{v:g}" for v in row["paper_rmse"]), f"{row['paper_kappa']:g}"]
            )
    return cells


def _result(summary: Mapping[str, Any], times: Mapping[str, Any]) -> Section:
    models = summary["identify"]["models"]
    best = models[summary["identify"]["best"]]
    blocks: list[Any] = [
        TextBlock(
            f"The identified model is {best['model']}: {best['coefficients']} coefficients from "
            f"{best['poses']} measured poses; on unseen measured poses its error is "
            f"{number(best['rmse'][0])} N in fx, {number(best['rmse'][1])} N in fy and "
            f"{number(best['rmse'][4], 2)} N m in τy.",
            strong=True,
        ),
        TableBlock(
            "Root mean square error on measured poses of the other design, against the noise "
            "floor of the instruments (pose noise carried through K).",
            ("model", "coefficients", "poses", *_HEADER, "error / noise"),
            [
                [
                    row["model"],
                    str(row["coefficients"]),
                    str(row["poses"]),
                    *(number(v) for v in row["rmse"]),
                    number(row["whitened_rms"]),
                ]
                for row in models
            ]
            + [
                ["noise floor", "", "", *(number(v) for v in summary["identify"]["floor"]), "1"],
            ],
        ),
    ]
    stages = times.get("stages_s", {})
    if stages:
        total = sum(stages.values())
        listed = ", ".join(f"{name} {value:.0f} s" for name, value in stages.items())
        blocks.append(TextBlock(f"Time: {total / 60.0:.1f} minutes ({listed})."))
    return Section("Result", blocks)


def _simulation(step: Mapping[str, Any], figures: Figures) -> Section:
    counts = step["counts"]
    return Section(
        "1 Simulate",
        [
            TextBlock(
                f"{counts['drawn']} wrenches drawn, {counts['screened']} passed the rod's screen, "
                f"{counts['solved']} solved by FEM ({counts['unstable']} unstable, "
                f"{counts['failed']} without a solution), {counts['kept']} kept; "
                f"{number(step['iterations_mean'])} Newton iterations a case."
            ),
            TableBlock(
                "K at rest beside the paper's equation (11), by magnitude (the paper's frame "
                "gives the couplings the other sign; its 4 and 16 are printed rounded).",
                ("entry", "here", "the paper", "difference"),
                [
                    [
                        row["entry"],
                        number(row["ours"], 5),
                        f"{row['paper']:g}",
                        f"{100.0 * row['difference']:+.1f} %",
                    ]
                    for row in step["equation_11"]
                ],
            ),
            FigureBlock(
                "The simulated poses: position and rotation vector of the top frame.",
                draw.pose_cloud(figures["simulated_poses"]),
            ),
        ],
    )


def _selection(step: Mapping[str, Any], figures: Figures) -> Section:
    table = step["table_two"]
    raw = table["degrees"][-1]["kappa_raw"]
    outside = ", ".join(
        f"{label.split(' [')[0]} {100.0 * row['share']:.1f} % (|h| up to "
        f"{number(row['largest_observed'], 2)}, error up to {number(row['largest_error'], 2)})"
        for label, row in zip(draw.COMPONENT_LABELS, step["outside"], strict=True)
    )
    curves: dict[str, tuple[list[float], list[float]]] = {}
    for model in dict.fromkeys(row["model"] for row in step["energy"]):
        chosen = [row for row in step["energy"] if row["model"] == model]
        curves[f"{model}, fy"] = (
            [row["poses"] for row in chosen],
            [row["rmse"][1] for row in chosen],
        )
    cubic = table["degrees"][-1]
    counts = sorted({row["poses"] for row in step["energy"]})
    curves[f"degree {cubic['degree']} polynomial from {step['n_train']} pairs, fy"] = (
        [counts[0], counts[-1]],
        [cubic["rmse"][1]] * 2,
    )
    return Section(
        "2 Select a model",
        [
            TableBlock(
                "Table II: RMSE on the test pairs by degree, and κ(X) of the normalised regressor. "
                f"Before normalisation κ(X) of the cubic is {number(raw, 2)} "
                f"(the paper: above {KAPPA_RAW:.0e}).",
                ("degree", *_HEADER, "κ(X)"),
                _beside(table["degrees"], "degree"),
            ),
            TableBlock(
                "Table II, lower part: principal component regression at degree 3; singular "
                "values of the normalised regressor below b are dropped.",
                ("threshold b", *_HEADER, "κ(X)"),
                _beside(table["thresholds"], "threshold"),
            ),
            FigureBlock(
                "Fig. 4: relative error at b = 0.1 on the test pairs, within ±0.2. Outside: "
                + outside
                + ".",
                draw.histograms(
                    {"b = 0.1": figures["e_rel_b01"]},
                    draw.COMPONENT_LABELS,
                    limit=0.2,
                    x_title="e_rel",
                ),
            ),
            TableBlock(
                "Symmetric energy models on the same test pairs: median of eight random draws "
                "of training poses.",
                ("model", "coefficients", "poses", *_HEADER),
                [
                    [
                        row["model"],
                        str(row["coefficients"]),
                        str(row["poses"]),
                        *(number(v) for v in row["rmse"]),
                    ]
                    for row in step["energy"]
                ],
            ),
            FigureBlock(
                "Error in fy against the number of training poses.",
                draw.lines(
                    curves,
                    x_title="training poses",
                    y_title="RMSE of fy [N]",
                    log_x=True,
                    log_y=True,
                ),
            ),
        ],
    )


def _designs(step: Mapping[str, Any], figures: Figures) -> Section:
    labels = draw.COMPONENT_LABELS[4:]
    return Section(
        "2 Select poses",
        [
            TableBlock(
                "Designs of poses out of the training pairs, with their certificate: no design of "
                "this size can be better than the bound.",
                ("design", "poses", "value", "bound", "of what is possible"),
                [
                    [
                        _NAMES.get(name, name),
                        str(row["n"]),
                        f"{row['value']:.5f}",
                        f"{row['bound']:.5f}",
                        f"{100.0 * row['efficiency']:.2f} %",
                    ]
                    for name, row in step["designs"].items()
                ],
            ),
            TableBlock(
                "The cubic trained on each design's simulated pairs, on the test pairs.",
                ("design", *_HEADER, "κ(X)"),
                [
                    [
                        _NAMES.get(row["design"], row["design"]),
                        *(number(v) for v in row["rmse"]),
                        number(row["kappa"], 4),
                    ]
                    for row in step["figure_5"]
                ],
            ),
            FigureBlock(
                "Fig. 5: relative error of τy and τz on the test pairs.",
                draw.histograms(
                    {
                        _NAMES[name]: figures[f"e_rel_design_{name}"][:, 4:]
                        for name in ("d", "maximin")
                    },
                    labels,
                    limit=0.2,
                    x_title="e_rel",
                ),
            ),
        ],
    )


def _measurement(step: Mapping[str, Any], figures: Figures) -> Section:
    blocks: list[Any] = [
        TextBlock(
            " ".join(
                f"{_NAMES[name]}: {row['rows']} poses in {row['minutes']:.0f} robot minutes"
                f" ({row['skipped']} skipped)."
                for name, row in step["campaigns"].items()
            )
        )
    ]
    for name in ("d", "maximin"):
        other = _NAMES["maximin" if name == "d" else "d"]
        rows = [row for row in step["table_three"] if row["trained_on"] == name]
        blocks.append(
            TableBlock(
                f"Table III: trained on the {_NAMES[name]} design, tested on the {other} one.",
                ("threshold b", *_HEADER, "κ(X)"),
                _beside(rows, "threshold"),
            )
        )
    for name, title in (("d", "Fig. 8"), ("maximin", "Fig. 10")):
        blocks.append(
            FigureBlock(
                f"{title}: relative error within ±0.5, trained on the {_NAMES[name]} design.",
                draw.histograms(
                    {_NAMES[name]: figures[f"e_rel_measured_{name}"]},
                    draw.COMPONENT_LABELS,
                    limit=0.5,
                    x_title="e_rel",
                ),
            )
        )
    blocks.insert(
        -1,
        FigureBlock(
            "Fig. 9: measured against predicted, trained on the D-optimal design; the dashed line "
            "is an exact prediction.",
            draw.actual_predicted(
                figures["observed_d"], figures["predicted_d"], draw.COMPONENT_LABELS
            ),
        ),
    )
    return Section("3 Measure and identify", blocks)


def _stiffness(step: Mapping[str, Any], figures: Figures) -> Section:
    share = step["symmetric_share"]
    stiffness = np.asarray(step["stiffness_at_rest"])
    return Section(
        "3 Stiffness",
        [
            FigureBlock(
                "K = ∂h/∂p at rest of the cubic identified from measurements (N/m, N, N m/rad); "
                "colour by size relative to the diagonal.",
                draw.stiffness_map(stiffness, "K at rest"),
            ),
            TableBlock(
                "The significant entries beside equation (11), by magnitude.",
                ("entry", "here", "the paper", "difference"),
                [
                    [
                        row["entry"],
                        number(row["ours"], 5),
                        f"{row['paper']:g}",
                        f"{100.0 * row['difference']:+.1f} %",
                    ]
                    for row in step["equation_11"]
                ],
            ),
            FigureBlock(
                "Fig. 12: share of the symmetric part, ‖K_sym‖₂/‖K‖₂, at every measured pose; "
                f"smallest {share['smallest']:.4f} (the paper: above {SYMMETRIC_SHARE}).",
                draw.histogram(
                    figures["symmetric_share"], x_title="‖K_sym‖₂ / ‖K‖₂", y_title="poses"
                ),
            ),
        ],
    )


def _speed(times: Mapping[str, Any]) -> Section:
    evaluation = times["evaluation"]
    return Section(
        "3 Evaluation time",
        [
            FigureBlock(
                f"Fig. 11: {len(evaluation['fem_s'])} pairs, one by one, called from Python. The "
                f"model is {evaluation['ratio_of_medians']:.0f} times faster than the FEM by the "
                f"medians (the paper: at least {FEM_RATIO:.0f} times).",
                draw.times(evaluation["fem_s"], evaluation["model_s"]),
            )
        ],
    )
