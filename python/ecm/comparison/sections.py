"""Sections of a comparison: error of each component, and four references side by side."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ecm.comparison.comparison import Comparison
from ecm.comparison.residual_figures import LINK
from ecm.comparison.residual_points import residual_points
from ecm.regression.f_test import FTest
from ecm.report import figures as draw
from ecm.report.mechanism import mechanism_blocks
from ecm.report.page import (
    Block,
    FigureBlock,
    Section,
    TableBlock,
    TextBlock,
    number,
    warnings_table,
)

_DRAWN = 900
_MEANING = {
    "physics base": "FEM of the body with E and ν free: what it leaves, no elasticity explains",
    "symmetric energy": "any elasticity or geometry that keeps the symmetry",
    "ceiling": "the better of the two with a free cubic of the pose: any function of the pose",
    "noise floor": "what no model can take",
}


def compare_section(result: Comparison, warnings: Sequence[str]) -> Section:
    """Return one sentence, the error of each component against its noise, and warnings."""
    names = [item.name for item in result.components]
    rows = [
        [
            item.name,
            *(number(value) for value in (item.rmse, item.bias, item.floor, item.excess)),
            f"{number(item.excess_low, 2)} to {number(item.excess_high, 2)}",
            *_lack_of_fit(result, item.lack_of_fit),
        ]
        for item in result.components
    ]
    header = ["component", "RMSE", "bias", "noise floor", "excess", "90 % interval"]
    if result.lack_of_fit is not None:
        header += ["lack of fit F", "p"]
    floor = np.array([item.floor for item in result.components])
    shares: dict[str, Sequence[float]] = {
        "noise floor": [1.0] * len(names),
        "RMSE": [item.rmse / f for item, f in zip(result.components, floor, strict=True)],
        "excess": [item.excess / f for item, f in zip(result.components, floor, strict=True)],
    }
    blocks: list[Block] = [TextBlock(result.sentence(), strong=True), *workspace_blocks(result)]
    blocks += [
        TableBlock("Residuals in the unit of each column.", header, rows),
        FigureBlock(
            "Error of each component over its noise floor.",
            draw.bars(shares, names, y_title="over the noise floor"),
        ),
        FigureBlock(
            "Residuals over their noise; noise alone would have a standard deviation of 1.",
            draw.histograms(
                {"rows": result.whitened}, names, limit=8.0, x_title="over noise", y_title="rows"
            ),
        ),
        *([] if result.rows_used is None else [TextBlock(result.rows_used.sentence())]),
        *warnings_table(warnings),
    ]
    return Section("Compare", blocks)


def pose_error_section(result: Comparison) -> Section:
    """Return the error as millimetres and degrees of the pose, and the worst rows."""
    found = result.pose_error
    blocks: list[Block] = [TextBlock(found.sentence(), strong=True)]
    if len(found.row):
        known = {"position_mm": "position [mm]", "rotation_deg": "rotation [°]"}
        rows = found.worst()
        names = [name for name in known if name in rows[0]]
        blocks += [
            TextBlock(
                "How far the pose is from the one at which the model has the measured wrench, "
                "dp = K⁻¹ dh: so far, to first order, the mechanism would settle from a pose that "
                "is commanded by this model."
            ),
            TableBlock(
                "The rows with the largest pose error.",
                ["row", *(known[name] for name in names)],
                [[str(item["row"]), *(number(item[name]) for name in names)] for item in rows],
                link=LINK,
            ),
        ]
    return Section("As pose error", blocks)


def workspace_blocks(result: Comparison) -> list[Block]:
    """Return the mechanism in its measured poses, coloured by residual."""
    points = residual_points(result, _DRAWN)
    return [
        *mechanism_blocks(
            result.compared.table,
            "The mechanism bent into measured poses, coloured by the residual of the row over its "
            f"noise. {points.sentence}".rstrip(),
            rows=points.row - 1,
            values=points.size,
            title="residual",
            unit="times the noise",
            link=LINK,
        )
    ]


def _lack_of_fit(result: Comparison, test: FTest | None) -> list[str]:
    if result.lack_of_fit is None:
        return []
    return ["–", "–"] if test is None else [number(test.F), number(test.p, 2)]


def references_section(result: Comparison) -> Section:
    """Return the errors of the reference models, and the family that they point to."""
    known = result.references
    if known is None:
        text = "No references: they need all six pose and wrench columns and the length."
        return Section("References", [TextBlock(text)])
    levels = known.levels()
    rows = [[name, number(value), _MEANING[name]] for name, value in levels.items()]
    return Section(
        "References",
        [
            TextBlock(known.sentence(), strong=True),
            TableBlock(
                "Error on held-out rows over the noise: what each reference leaves.",
                ("reference", "error / noise", "what it can fit"),
                rows,
            ),
            FigureBlock(
                "The same side by side. A fall from one to the next is the family of what is "
                "missing: symmetric, asymmetric, or no function of the pose.",
                draw.bars(
                    {"held-out rows": list(levels.values())}, list(levels), y_title="error / noise"
                ),
            ),
        ],
    )
