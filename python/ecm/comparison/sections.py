"""Sections of a comparison: error of each component, and four references side by side."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ecm.comparison.comparison import Comparison
from ecm.comparison.reference_models import FEM_NEEDED
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
_RESIDUALS = "Residuals in the unit of each column."
_MEANING = {
    "physics base": "FEM of the body with E and ν free: what it leaves, no elasticity explains",
    "symmetric energy": "any elasticity or geometry that keeps the symmetry",
    "ceiling": "the better of the two with a free cubic of the pose: any function of the pose",
    "noise floor": "what no model can take",
}


def compare_section(result: Comparison, warnings: Sequence[str]) -> Section:
    """Return one sentence, the error of each component against its noise, and warnings."""
    errors = _over_spread(result) if result.noise.is_assumed else _over_noise(result)
    blocks: list[Block] = [TextBlock(result.sentence(), strong=True), *workspace_blocks(result)]
    blocks += [
        *errors,
        *([] if result.rows_used is None else [TextBlock(result.rows_used.sentence())]),
        *warnings_table(warnings),
    ]
    return Section("Compare", blocks)


def _over_noise(result: Comparison) -> list[Block]:
    """Return the error of each component, its noise floor and what is above it."""
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
    floor = np.array([item.floor for item in result.components])
    shares: dict[str, Sequence[float]] = {
        "noise floor": [1.0] * len(names),
        "RMSE": [item.rmse / f for item, f in zip(result.components, floor, strict=True)],
        "excess": [item.excess / f for item, f in zip(result.components, floor, strict=True)],
    }
    return [
        TableBlock(_RESIDUALS, [*header, *_lack_of_fit_header(result)], rows),
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
    ]


def _over_spread(result: Comparison) -> list[Block]:
    """Return the error of each component beside its spread: nobody knows the noise."""
    made = result.compared
    names = [item.name for item in result.components]
    measured = made.table.matrix(names)[made.chosen]
    error = np.array([item.rmse for item in result.components])
    spread = measured.std(axis=0)
    share = 100.0 * error / np.where(spread > 0.0, spread, np.inf)
    rows = [
        [
            item.name,
            *(number(value) for value in (item.rmse, item.bias, percent)),
            *_lack_of_fit(result, item.lack_of_fit),
        ]
        for item, percent in zip(result.components, share.tolist(), strict=True)
    ]
    header = ["component", "RMSE", "bias", "RMSE, % of the spread", *_lack_of_fit_header(result)]
    residual = (measured - made.predicted[made.chosen]) / np.maximum(error, 1e-300)
    return [
        TableBlock(_RESIDUALS, header, rows),
        FigureBlock(
            "Error of each component over the spread of its readings.",
            draw.bars({"RMSE": share.tolist()}, names, y_title="% of the spread"),
        ),
        FigureBlock(
            "Residuals over the error of their component.",
            draw.histograms(
                {"rows": residual}, names, limit=8.0, x_title="over the RMSE", y_title="rows"
            ),
        ),
    ]


def _lack_of_fit_header(result: Comparison) -> list[str]:
    return [] if result.lack_of_fit is None else ["lack of fit F", "p"]


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
    over = result.where().noise_word
    return [
        *mechanism_blocks(
            result.compared.table,
            "The mechanism bent into measured poses, coloured by the residual of the row over "
            f"{over}. {points.sentence}".rstrip(),
            rows=points.row - 1,
            values=points.size,
            title="residual",
            unit=f"times {over}",
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
    assumed = result.noise.is_assumed
    levels = known.levels()
    if assumed:
        levels.pop("noise floor")
    over = "an assumed noise: only the ratios count" if assumed else "the noise"
    quotient = f"error / {'assumed ' * assumed}noise"
    rows = [[name, number(value), _MEANING[name]] for name, value in levels.items()]
    left_out = [TextBlock(f"{FEM_NEEDED[0].upper()}{FEM_NEEDED[1:]}.")] if known.fem_needed else []
    return Section(
        "References",
        [
            *([] if assumed else [TextBlock(known.sentence(), strong=True)]),
            *left_out,
            TableBlock(
                f"Error on held-out rows over {over}. What each reference leaves.",
                ("reference", quotient, "what it can fit"),
                rows,
            ),
            FigureBlock(
                "The same side by side. A fall from one to the next is the family of what is "
                "missing: symmetric, asymmetric, or no function of the pose.",
                draw.bars({"held-out rows": list(levels.values())}, list(levels), y_title=quotient),
            ),
        ],
    )
