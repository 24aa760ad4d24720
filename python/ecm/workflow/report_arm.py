"""Section of the arm: how near each phase came to the goals, what was skipped, and Fig. 7."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ecm.io.arrays import F
from ecm.report import figures as draw
from ecm.report.page import Block, FigureBlock, Section, TableBlock, TextBlock
from ecm.rig.arm.plot_style import COLOURS, PANELS, thousandths

_MOST_REASONS = 12


def arm_section(
    step: Mapping[str, Any], figures: Mapping[str, F], names: Mapping[str, str]
) -> Section:
    """What the arm did in the campaigns of a job; `names` are those of the designs."""
    records, phases_s = step["records"], step["phases_s"]
    counts = " ".join(
        f"{names[name]}: {record['reached']} of {record['poses']} poses reached."
        for name, record in records.items()
    )
    blocks: list[Block] = [TextBlock(counts), _phases(records, names)]
    reasons = [
        [names[name], str(pose), reason]
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
    shown = (
        f"the first pose of the plan, which was not reached: {step['not_reached']}"
        if step["not_reached"]
        else "the first pose that was reached, from home and back"
    )
    caption = f"Fig. 7: {shown}; dashed: the goal. {times}."
    blocks.append(FigureBlock(caption, _figure(figures, phases_s)))
    return Section("3 The arm", blocks)


def _phases(records: Mapping[str, Any], names: Mapping[str, str]) -> TableBlock:
    keys = ("median_m", "largest_m", "median_rad", "largest_rad")
    rows = [
        [
            names[name],
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


def _figure(figures: Mapping[str, F], phases_s: Sequence[Sequence[Any]]) -> dict[str, Any]:
    """The way to the goal and back in six panels, the phases as coloured bands."""
    time_s = np.round(figures["arm_time_s"], 3).tolist()
    way, goal = 1e3 * figures["arm_way"], 1e3 * figures["arm_goal"]
    layout = draw.component_layout(PANELS, "phase")
    layout["legend"] |= {"x": 0.0, "xanchor": "left"}
    legend = {"type": "scatter", "mode": "markers", "x": [None], "y": [None]}
    data: list[dict[str, Any]] = [
        legend
        | {"name": name, "marker": {"symbol": "square", "size": 12, "color": COLOURS[name]}}
        | draw.panel_axes(0)
        for name in dict.fromkeys(name for name, _, _ in phases_s)
    ]
    layout["shapes"] = []
    for j in range(6):
        axes = draw.panel_axes(j)
        band = {
            "type": "rect",
            "xref": axes["xaxis"],
            "yref": f"{axes['yaxis']} domain",
            "y0": 0,
            "y1": 1,
            "line": {"width": 0},
            "layer": "below",
        }
        layout["shapes"] += [
            band | {"x0": begin, "x1": end, "fillcolor": COLOURS[name]}
            for name, begin, end in phases_s
        ]
        curve = {"type": "scatter", "mode": "lines", "showlegend": False, **axes}
        data += [
            curve
            | {
                "x": time_s,
                "y": np.round(way[:, j], 4).tolist(),
                "line": {"color": draw.COLOURS[0], "width": 2},
            },
            curve
            | {
                "x": [time_s[0], time_s[-1]],
                "y": [float(goal[j])] * 2,
                "line": {"color": draw.COLOURS[1], "width": 1, "dash": "dash"},
            },
        ]
        if j > 2:
            layout[axes["xaxis"].replace("x", "xaxis", 1)]["title"]["text"] = "time [s]"
    return {"data": data, "layout": layout}
