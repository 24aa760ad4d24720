"""Section of the arm: how near each phase came to the goals, what was skipped, and Fig. 7."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ecm.io.arrays import F
from ecm.report import figures as draw
from ecm.report.page import FigureBlock, Section, TableBlock, TextBlock
from ecm.rig.arm.plot_style import COLOURS, PANELS, thousandths

_MOST_REASONS = 12


def arm_section(
    step: Mapping[str, Any], figures: Mapping[str, F], names: Mapping[str, str]
) -> Section:
    """What the arm did in the campaigns of a job."""
    records = step["records"]
    said = " ".join(
        f"{names[name]}: {record['reached']} of {record['poses']} poses reached."
        for name, record in records.items()
    )
    blocks: list[Any] = [TextBlock(said), _phases(records, names)]
    reasons = [
        [names[name], str(pose), reason]
        for name, record in records.items()
        for _, pose, reason in record["reasons"]
    ]
    if reasons:
        more = len(reasons) - _MOST_REASONS
        blocks.append(
            TableBlock(
                "Poses that were skipped, and why"
                + (f"; {more} more are in the record of the arm." if more > 0 else "."),
                ("design", "pose", "reason"),
                reasons[:_MOST_REASONS],
            )
        )
    times = ", ".join(f"{name} {end - begin:.1f} s" for name, begin, end in step["phases_s"])
    shown = (
        f"the first pose of the plan, which was not reached: {step['not_reached']}"
        if step["not_reached"]
        else "the first pose that was reached, from home and back"
    )
    blocks.append(
        FigureBlock(
            f"Fig. 7: {shown}; dashed: the goal. {times}.",
            _figure(figures, step["phases_s"]),
        )
    )
    return Section("3 The arm", blocks)


def _phases(records: Mapping[str, Any], names: Mapping[str, str]) -> TableBlock:
    rows = []
    for name, record in records.items():
        for phase in ("impedance", "position"):
            found = record.get("phases", {}).get(phase)
            if found is None:
                continue
            rows.append(
                [
                    names[name],
                    phase,
                    *(thousandths(found[key]) for key in ("median_m", "largest_m")),
                    *(thousandths(found[key]) for key in ("median_rad", "largest_rad")),
                    " ".join(f"{100.0 * share:.0f}" for share in found["fraction"].values()),
                ]
            )
    return TableBlock(
        "Distance from the goal after each phase, by the encoders of the arm.",
        ("design", "after", "median mm", "largest mm", "median mrad", "largest mrad",
         "share of the way %, x y z θx θy θz"),
        rows,
    )  # fmt: skip


def _figure(figures: Mapping[str, F], phases: Sequence[Sequence[Any]]) -> dict[str, Any]:
    time_s = np.round(figures["arm_time_s"], 3).tolist()
    way, goal = 1e3 * figures["arm_way"], 1e3 * figures["arm_goal"]
    layout = draw.component_layout(PANELS, "phase")
    layout["legend"] |= {"x": 0.0, "xanchor": "left"}
    layout["shapes"] = []
    data: list[dict[str, Any]] = [
        {
            "type": "scatter",
            "mode": "markers",
            "x": [None],
            "y": [None],
            "name": name,
            "marker": {"symbol": "square", "size": 12, "color": COLOURS[name]},
            **draw.component_axes(0),
        }
        for name in dict.fromkeys(name for name, _, _ in phases)
    ]
    for j in range(6):
        axes = draw.component_axes(j)
        for name, begin, end in phases:
            layout["shapes"].append(
                {
                    "type": "rect",
                    "xref": axes["xaxis"],
                    "yref": f"{axes['yaxis']} domain",
                    "x0": begin,
                    "x1": end,
                    "y0": 0,
                    "y1": 1,
                    "fillcolor": COLOURS[name],
                    "line": {"width": 0},
                    "layer": "below",
                }
            )
        line = {"type": "scatter", "mode": "lines", "showlegend": False, **axes}
        data.append(
            line
            | {
                "x": time_s,
                "y": np.round(way[:, j], 4).tolist(),
                "line": {"color": draw.COLOURS[0], "width": 2},
            }
        )
        data.append(
            line
            | {
                "x": [time_s[0], time_s[-1]],
                "y": [float(goal[j])] * 2,
                "line": {"color": draw.COLOURS[1], "width": 1, "dash": "dash"},
            }
        )
        if j > 2:
            layout[axes["xaxis"].replace("x", "xaxis", 1)]["title"]["text"] = "time [s]"
    return {"data": data, "layout": layout}
