"""The report of `ecm identify`: the paper's three steps, the arm, and the loop after them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ecm.diagnosis.summary import not_testable_table, ranking_table
from ecm.io.arrays import F
from ecm.io.columns import POSE
from ecm.io.mechanism import Mechanism
from ecm.io.table import as_table
from ecm.models.errors import history_figure
from ecm.report import figures as draw
from ecm.report.blocks import Block, Cell, FigureBlock, Section, TableBlock, TextBlock, number
from ecm.report.figures import mechanism_blocks
from ecm.rig.arm.trips import COLOURS, PANELS, thousandths
from ecm.workflow.paper import FEM_RATIO, KAPPA_RAW, SYMMETRIC_SHARE

_MOST_REASONS = 12
Figures = Mapping[str, F]
_NAMES = {
    "d": "D-optimal",
    "maximin": "maximin",
    "d by the paper's exchange": "D-optimal, Fedorov's exchange alone",
    "maximin by the paper's exchange": "maximin, simple exchange alone",
}


def arm_section(step: Mapping[str, Any], figures: Figures) -> Section:
    """What the arm did in the campaigns of a job."""
    records, phases_s = step["records"], step["phases_s"]
    counts = " ".join(
        f"{_NAMES[name]}: {record['reached']} of {record['poses']} poses reached."
        for name, record in records.items()
    )
    blocks: list[Block] = [TextBlock(counts), _phases(records)]
    reasons = [
        [_NAMES[name], str(pose), reason]
        for name, record in records.items()
        for _, pose, reason in record["reasons"]
    ]
    if reasons:
        more = len(reasons) - _MOST_REASONS
        caption = "Poses that were skipped, and why" + (
            f"; {more} more are in the record of the arm." if more > 0 else "."
        )
        blocks.append(TableBlock(caption, ("design", "pose", "reason"), reasons[:_MOST_REASONS]))
    times = ", ".join(f"{name} {end - begin:.1f} s" for name, begin, end in phases_s)
    shown = "the first pose that was reached, from home and back"
    if step["not_reached"]:
        shown = f"the first pose of the plan, which was not reached: {step['not_reached']}"
    caption = f"Fig. 7: {shown}; dashed: the goal. {times}."
    blocks.append(FigureBlock(caption, _figure(figures, phases_s)))
    return Section("The arm", blocks)


def _phases(records: Mapping[str, Any]) -> TableBlock:
    keys = ("median_m", "largest_m", "median_rad", "largest_rad")
    rows = [
        [
            _NAMES[name],
            phase,
            *(thousandths(errors[key]) for key in keys),
            " ".join(f"{100.0 * share:.0f}" for share in errors["fraction"].values()),
        ]
        for name, record in records.items()
        for phase, errors in record.get("phases", {}).items()
        if phase in ("impedance", "position") and errors is not None
    ]
    return TableBlock(
        "Distance from the goal after each phase, by the encoders of the arm.",
        ("design", "after", "median mm", "largest mm", "median mrad", "largest mrad",
         "share of the way %, x y z θx θy θz"),
        rows,
    )  # fmt: skip


def _figure(figures: Figures, phases_s: Sequence[Sequence[Any]]) -> dict[str, Any]:
    """The way to the goal and back in six panels, the phases as coloured bands."""
    time_s, way, goal = figures["arm_time_s"], figures["arm_way"].T, figures["arm_goal"]
    ends = time_s[[0, -1]]
    layout = draw.component_layout(PANELS, "phase", x_title="time [s]")
    layout["legend"] |= {"x": 0.0, "xanchor": "left"}
    layout["shapes"] = [
        {
            "type": "rect",
            "xref": axes["xaxis"],
            "x0": begin,
            "x1": end,
            "yref": f"{axes['yaxis']} domain",
            "y0": 0,
            "y1": 1,
            "line": {"width": 0},
            "layer": "below",
            "fillcolor": COLOURS[name],
        }
        for axes in map(draw.panel_axes, range(6))
        for name, begin, end in phases_s
    ]
    legend = {"type": "scatter", "mode": "markers", "x": [None], "y": [None]}
    data: list[dict[str, Any]] = [
        {**legend, "name": name, "marker": {"symbol": "square", "size": 12, "color": COLOURS[name]}}
        for name in dict.fromkeys(name for name, _, _ in phases_s)
    ]
    line = {"color": draw.COLOURS[0], "width": 2}
    dashed = {"color": draw.COLOURS[1], "width": 1, "dash": "dash"}
    for j in range(6):
        axes, aim = draw.panel_axes(j), 1e3 * goal[[j, j]]
        data += [
            draw.scatter(time_s, 1e3 * way[j], "lines", showlegend=False, line=line, **axes),
            draw.scatter(ends, aim, "lines", showlegend=False, line=dashed, **axes),
        ]
    return {"data": data, "layout": layout}


_HEADER = ("fx N", "fy N", "fz N", "τx N m", "τy N m", "τz N m")


def _beside_paper(rows: Sequence[Mapping[str, Any]], label: str) -> list[list[Cell]]:
    """Table rows: the results here, and below each the paper's where it has one."""
    cells: list[list[Cell]] = []
    for row in rows:
        cells.append([f"{row[label]:g}", *row["rmse"], number(row["kappa"], 4)])
        if "paper_rmse" in row:
            cells.append(
                ["↳ the paper", *(f"{v:g}" for v in row["paper_rmse"]), f"{row['paper_kappa']:g}"]
            )
    return cells


def _named(name: str, caption: str, paper: bool) -> str:
    """The caption, with the paper's name of the table or figure where the body is the paper's."""
    return f"{name}: {caption}" if paper else caption


def _equation_11(caption: str, rows: Sequence[Mapping[str, Any]], paper: bool) -> TableBlock:
    cells = [[row["entry"], number(row["ours"], 5)] for row in rows]
    if not paper:
        return TableBlock(f"{caption}.", ("entry", "K"), cells)
    for cell, row in zip(cells, rows, strict=True):
        cell += [f"{row['paper']:g}", f"{100.0 * row['difference']:+.1f} %"]
    caption += (
        " beside the paper's equation (11), by magnitude (the paper's frame gives the couplings "
        "the other sign; its 4 and 16 are printed rounded)."
    )
    return TableBlock(caption, ("entry", "here", "the paper", "difference"), cells)


def _relative_errors(caption: str, series: Mapping[str, F], limit: float) -> FigureBlock:
    labels = draw.COMPONENT_LABELS[-next(iter(series.values())).shape[1] :]
    figure = draw.histograms(dict(series), labels, limit=limit, x_title="e_rel")
    return FigureBlock(caption, figure)


def workspace_blocks(figures: Figures, body: Mechanism) -> Sequence[Block]:
    """Return the mechanism in the measured poses of the other design."""
    poses, residual = figures["workspace_poses"], figures["workspace_residual"]
    return mechanism_blocks(
        as_table(dict(zip(POSE, poses.T, strict=True))),
        "The mechanism at rest and bent into measured poses that the model has not seen, "
        "coloured by the residual of the row over its noise.",
        rows=np.arange(len(poses)),
        values=residual,
        title="residual",
        unit="times the noise",
        body=body,
    )


def result_section(
    step: Mapping[str, Any], stages_s: Mapping[str, float], workspace: Sequence[Block]
) -> Section:
    """Return the identified model, and the errors of all on the poses of the other design."""
    models = step["models"]
    best = models[step["best"]]
    keys = ("model", "coefficients", "poses")
    rows: list[list[Cell]] = [
        [*(row[key] for key in keys), *row["rmse"], row["whitened_rms"]] for row in models
    ]
    rows.append(["noise floor", "", "", *step["floor"], 1])
    blocks: list[Block] = [
        TextBlock(
            f"The identified model is {best['model']}: {best['coefficients']} coefficients from "
            f"{best['poses']} measured poses; on unseen measured poses its error is "
            f"{number(best['rmse'][0])} N in fx, {number(best['rmse'][1])} N in fy and "
            f"{number(best['rmse'][4], 2)} N m in τy.",
            strong=True,
        ),
        *workspace,
        TableBlock(
            "Root mean square error on measured poses of the other design, against the noise "
            "floor of the instruments (pose noise carried through K).",
            ("model", "coefficients", "poses", *_HEADER, "error / noise"),
            rows,
        ),
    ]
    if stages_s:
        listed = ", ".join(f"{name} {value:.0f} s" for name, value in stages_s.items())
        minutes = sum(stages_s.values()) / 60.0
        blocks.append(TextBlock(f"Time: {minutes:.1f} minutes ({listed})."))
    return Section("Result", blocks)


def simulation_section(step: Mapping[str, Any], figures: Figures, paper: bool) -> Section:
    """Return the pairs that were simulated, and K at rest; `paper`: the body is the paper's."""
    counts = step["counts"]
    blocks: list[Block] = [
        TextBlock(
            f"{counts['drawn']} wrenches drawn, {counts['screened']} passed the rod's screen, "
            f"{counts['solved']} solved by FEM ({counts['unstable']} unstable, "
            f"{counts['failed']} without a solution), {counts['kept']} kept; "
            f"{number(step['iterations_mean'])} Newton iterations a case."
        ),
        _equation_11("K at rest by FEM", step["equation_11"], paper),
        FigureBlock(
            "The simulated poses: position and rotation vector of the top frame."
            + draw.drawn_sentence(figures["simulated_poses"]),
            draw.pose_cloud(figures["simulated_poses"]),
        ),
    ]
    return Section("Simulate", blocks)


def selection_section(step: Mapping[str, Any], figures: Figures, paper: bool) -> Section:
    """Return the errors of models on the test pairs."""
    table = step["table_two"]
    degree = table["degrees"][-1]["degree"]
    outside = ", ".join(
        f"{label.split(' [')[0]} {100.0 * row['share']:.1f} % (|h| up to "
        f"{number(row['largest_observed'], 2)}, error up to {number(row['largest_error'], 2)})"
        for label, row in zip(draw.COMPONENT_LABELS, step["outside"], strict=True)
    )
    energy = [
        [row["model"], row["coefficients"], row["poses"], *row["rmse"]] for row in step["energy"]
    ]
    raw = number(table["degrees"][-1]["kappa_raw"], 2)
    blocks: list[Block] = [
        TableBlock(
            _named("Table II", "RMSE on the test pairs", paper)
            + " by degree, and κ(X) of the normalised regressor. Before normalisation κ(X) of "
            f"degree {degree} is {raw}{f' (the paper: above {KAPPA_RAW:.0e})' * paper}.",
            ("degree", *_HEADER, "κ(X)"),
            _beside_paper(table["degrees"], "degree"),
        ),
        TableBlock(
            _named("Table II, lower part", "Principal component regression", paper)
            + f" at degree {degree}; singular values of the normalised regressor below b are "
            "dropped.",
            ("threshold b", *_HEADER, "κ(X)"),
            _beside_paper(table["thresholds"], "threshold"),
        ),
        _relative_errors(
            _named("Fig. 4", "Relative error at b = 0.1 on the test pairs, within ±0.2. ", paper)
            + f"Outside: {outside}.",
            {"b = 0.1": figures["e_rel_b01"]},
            0.2,
        ),
        TableBlock(
            "Symmetric energy models on the same test pairs: median of eight random draws "
            "of training poses.",
            ("model", "coefficients", "poses", *_HEADER),
            energy,
        ),
        FigureBlock("Error in fy against the number of training poses.", _learning_curves(step)),
    ]
    return Section("Select a model", blocks)


def _learning_curves(step: Mapping[str, Any]) -> dict[str, Any]:
    rows, cubic = step["energy"], step["table_two"]["degrees"][-1]
    curves: dict[str, tuple[list[float], list[float]]] = {}
    for row in rows:
        poses, errors = curves.setdefault(f"{row['model']}, fy", ([], []))
        poses.append(row["poses"])
        errors.append(row["rmse"][1])
    counts = sorted({row["poses"] for row in rows})
    curves[f"degree {cubic['degree']} polynomial from {step['n_train']} pairs, fy"] = (
        [counts[0], counts[-1]],
        [cubic["rmse"][1]] * 2,
    )
    return draw.lines(
        curves, x_title="training poses", y_title="RMSE of fy [N]", log_x=True, log_y=True
    )


def design_section(step: Mapping[str, Any], figures: Figures, paper: bool) -> Section:
    """Return the designs with their certificates, and the errors that they leave."""
    certificates = [
        [
            _NAMES[name],
            row["n"],
            f"{row['value']:.5f}",
            f"{row['bound']:.5f}",
            f"{100.0 * row['efficiency']:.2f} %",
        ]
        for name, row in step["designs"].items()
    ]
    errors = [
        [_NAMES[row["design"]], *row["rmse"], number(row["kappa"], 4)] for row in step["figure_5"]
    ]
    blocks: list[Block] = [
        TableBlock(
            "Designs of poses out of the training pairs, with their certificate: no design of "
            "this size can be better than the bound.",
            ("design", "poses", "value", "bound", "of what is possible"),
            certificates,
        ),
        TableBlock(
            f"The polynomial of degree {step['table_two']['degrees'][-1]['degree']}, trained on "
            "each design's simulated pairs, on the test pairs.",
            ("design", *_HEADER, "κ(X)"),
            errors,
        ),
        _relative_errors(
            _named("Fig. 5", "Relative error of τy and τz on the test pairs.", paper),
            {_NAMES[name]: figures[f"e_rel_design_{name}"][:, 4:] for name in ("d", "maximin")},
            0.2,
        ),
    ]
    return Section("Select poses", blocks)


def measurement_section(step: Mapping[str, Any], figures: Figures, paper: bool) -> Section:
    """Return the errors of models that are fitted to measured poses."""
    campaigns = " ".join(
        f"{_NAMES[name]}: {row['rows']} poses in {row['minutes']:.0f} robot minutes"
        f" ({row['skipped']} skipped)."
        for name, row in step["campaigns"].items()
    )
    blocks: list[Block] = [TextBlock(campaigns)]
    for name, other in (("d", "maximin"), ("maximin", "d")):
        rows = [row for row in step["table_three"] if row["trained_on"] == name]
        blocks.append(
            TableBlock(
                _named("Table III", f"Degree {step['degree']}, trained on the", paper)
                + f" {_NAMES[name]} design, tested on the {_NAMES[other]} one.",
                ("threshold b", *_HEADER, "κ(X)"),
                _beside_paper(rows, "threshold"),
            )
        )
    fig_8, fig_10 = (
        _relative_errors(
            _named(title, "Relative error within ±0.5, trained on the", paper)
            + f" {_NAMES[name]} design.",
            {_NAMES[name]: figures[f"e_rel_measured_{name}"]},
            0.5,
        )
        for name, title in (("d", "Fig. 8"), ("maximin", "Fig. 10"))
    )
    fig_9 = FigureBlock(
        _named("Fig. 9", "Measured against predicted, trained on the D-optimal design;", paper)
        + " the dashed line is an exact prediction."
        + draw.drawn_sentence(figures["predicted_d"] - figures["observed_d"]),
        draw.actual_predicted(figures["observed_d"], figures["predicted_d"], draw.COMPONENT_LABELS),
    )
    return Section("Measure and identify", [*blocks, fig_8, fig_9, fig_10])


def stiffness_section(step: Mapping[str, Any], figures: Figures, paper: bool) -> Section:
    """Return the stiffness at rest, and how symmetric it is."""
    smallest = step["symmetric_share"]["smallest"]
    blocks: list[Block] = [
        FigureBlock(
            f"K = ∂h/∂p at rest of {step['stiffness_of']} identified from measurements (N/m, N, "
            "N m/rad); colour by size relative to the diagonal.",
            draw.stiffness_map(np.asarray(step["stiffness_at_rest"]), "K at rest"),
        ),
        _equation_11("Its significant entries", step["equation_11"], paper),
        FigureBlock(
            _named("Fig. 12", "Share of the symmetric part, ‖K_sym‖₂/‖K‖₂,", paper)
            + f" at every measured pose; smallest {smallest:.4f}"
            f"{f' (the paper: above {SYMMETRIC_SHARE})' * paper}.",
            draw.histogram(
                {"poses": figures["symmetric_share"]}, x_title="‖K_sym‖₂ / ‖K‖₂", y_title="poses"
            ),
        ),
    ]
    return Section("Stiffness", blocks)


def speed_section(evaluation: Mapping[str, Any], paper: bool) -> Section:
    """Return the time of one evaluation by FEM and by the model."""
    model_s, both_s = (
        float(np.median(evaluation[key])) for key in ("model_s", "model_with_stiffness_s")
    )
    text = (
        f"{evaluation['model']}, one pose a call from Python, the mean of many calls: "
        f"{1e6 * model_s:.1f} µs, with the stiffness {1e6 * both_s:.1f} µs. The model is "
        f"{evaluation['ratio_of_medians']:.0f} times faster than the FEM by the medians"
        f"{f' (the paper: at least {FEM_RATIO:.0f} times)' * paper}."
    )
    figure = draw.histogram(
        {"FEM": evaluation["fem_s"], "model": evaluation["model_s"]},
        x_title="time of one evaluation [s]",
        y_title="pairs",
        log=True,
        bins=20,
    )
    caption = _named("Fig. 11", f"Times of {len(evaluation['fem_s'])} pairs.", paper)
    return Section("Evaluation time", [TextBlock(text), FigureBlock(caption, figure)])


def loop_section(step: Mapping[str, Any], figures: Figures) -> Section:
    """Compare, diagnose, refit; and what had been hidden."""
    diagnosis, history = step["diagnosis"], step["history"]
    blocks: list[Block] = [
        TextBlock(_loop_sentence(step), strong=True),
        TextBlock(step["before"]["sentence"]),
        _components(step["before"], step["after"], history[0]["name"] if history else "the model"),
    ]
    if history:
        caption = "The fit history: root mean square of whitened residuals, 1 is the noise floor."
        blocks += [_history_table(history), FigureBlock(caption, history_figure(history))]
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
    return Section("Find the missing effect", blocks)


def _loop_sentence(step: Mapping[str, Any]) -> str:
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
