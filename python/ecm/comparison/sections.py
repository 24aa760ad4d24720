"""The report of a comparison: errors, pose errors, reference models, residual maps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ecm.comparison.reference_models import FEM_REMEDY, HELD_OUT, USELESS, ReferenceModels
from ecm.comparison.residual_figures import LINK, residual_section
from ecm.errors import Remedy
from ecm.report import figures as draw
from ecm.report.blocks import (
    Block,
    Cell,
    CodeBlock,
    FigureBlock,
    Section,
    TableBlock,
    TextBlock,
    number,
)
from ecm.report.mechanism import mechanism_blocks
from ecm.report.page import Report

if TYPE_CHECKING:
    from ecm.comparison.comparison import Comparison

_MEANING = {
    "physics base": "FEM of the body with E and ν free: what it leaves, no elasticity explains",
    "symmetric energy": "any elasticity or geometry that keeps the symmetry",
    "ceiling": "the better of the two with a free cubic of the pose: any function of the pose",
    "noise floor": "what no model can take",
}


def comparison_report(
    result: Comparison, warnings: Sequence[str] = (), fem: Remedy = FEM_REMEDY
) -> Report:
    """Return errors of each component, reference models, and residuals in units of the noise.

    Parameters
    ----------
    result
        The comparison.
    warnings
        About the data.
    fem
        How the FEM of a body is made that did not run yet.
    """
    sections = [
        Section("Compare", [*_errors(result), *_pose_error(result), *_rows(result)]),
        Section(
            "References", reference_blocks(result.references, fem, assumed=result.noise.is_assumed)
        ),
        residual_section(result.where()),
    ]
    return Report(f"{result.model} against measurements", f"{result.rows} rows", sections, warnings)


def _rows(result: Comparison) -> list[Block]:
    outside = f", {result.outside_domain} outside the poses of the fit" * bool(
        result.outside_domain
    )
    used = [] if result.rows_used is None else [TextBlock(result.rows_used.sentence())]
    return [TextBlock(f"{result.rows} rows{outside}; noise {result.noise.source}."), *used]


def _errors(result: Comparison) -> list[Block]:
    """One sentence, the mechanism, errors beside the noise; where it is not known, the spread."""
    made, every = result.compared, result.components
    measured = made.table.matrix(made.model.outputs)[result.row]
    varies = np.ptp(measured, axis=0) > 0.0
    at = np.flatnonzero(varies) if varies.any() else np.arange(len(every))
    items = [every[j] for j in at]
    names = [one.name for one in items]
    header, rmse = ["component", "RMSE", "bias"], np.array([one.rmse for one in items])
    if result.noise.is_assumed:
        spread = measured[:, at].std(axis=0)
        share = 100.0 * rmse / np.where(spread > 0.0, spread, np.inf)
        header.append("RMSE, % of the spread")
        more: list[list[Cell]] = [[value] for value in share.tolist()]
        bars: dict[str, Sequence[float]] = {"RMSE": share.tolist()}
        unit, over, scale = "% of the spread", "its spread", np.maximum(rmse, 1e-300)
    else:
        header += ["noise floor", "excess", "90 % interval"]
        scale = np.array([one.floor for one in items])
        more = [
            [one.floor, one.excess, f"{number(one.excess_low)} to {number(one.excess_high)}"]
            for one in items
        ]
        excess = np.array([one.excess for one in items])
        sizes = {"noise floor": scale, "RMSE": rmse, "excess": excess}
        bars = {name: (values / scale).tolist() for name, values in sizes.items()}
        unit, over = "over the noise floor", "its noise floor"
    rows = [[one.name, one.rmse, one.bias, *own] for one, own in zip(items, more, strict=True)]
    each = "its error" if result.noise.is_assumed else over
    values = {"rows": result.physical[:, at] / scale}
    histograms = draw.histograms(values, names, limit=8.0, x_title="times", y_title="rows")
    return [
        TextBlock(result.sentence(), strong=True),
        *workspace_blocks(result),
        TableBlock("Residuals in the unit of each column.", header, rows),
        *_lack_of_fit(result, names),
        FigureBlock(f"Error of each component over {over}.", draw.bars(bars, names, y_title=unit)),
        FigureBlock(f"Residuals of each component over {each}.", histograms),
    ]


def _lack_of_fit(result: Comparison, names: Sequence[str]) -> list[Block]:
    """F of the model's error between repeated poses over the scatter of the repeats."""
    if result.lack_of_fit is None:
        return []
    alone = {one.name: one.lack_of_fit for one in result.components if one.name in names}
    rows: list[list[Cell]] = [
        [name, f"{test.F:.6g}", f"{test.dof:.4g}", f"{test.dof_error:.4g}", test.p]
        for name, test in ({"all": result.lack_of_fit} | alone).items()
        if test is not None
    ]
    caption = "Error at repeated poses over the scatter of the repeats."
    return [TableBlock(caption, ("lack of fit", "F", "dof", "of error", "p"), rows)]


def _pose_error(result: Comparison) -> list[Block]:
    """The error as millimetres and degrees of the pose, and the worst rows."""
    found = result.pose_error
    blocks: list[Block] = [TextBlock(found.sentence(), strong=True)]
    if rows := found.worst():
        heads = {"row": "row", "position_mm": "position [mm]", "rotation_deg": "rotation [°]"}
        caption = (
            "The rows with the largest pose error, dp = K⁻¹ dh: to first order the mechanism would "
            "settle so far from a pose that is commanded by this model."
        )
        header, cells = [heads[name] for name in rows[0]], [[*item.values()] for item in rows]
        blocks.append(TableBlock(caption, header, cells, link=LINK))
    return blocks


def workspace_blocks(result: Comparison) -> list[Block]:
    """Return the mechanism in its measured poses, coloured by residual."""
    maps = result.where()
    return [
        *mechanism_blocks(
            result.compared.table,
            "The mechanism bent into measured poses, coloured by the residual of the row over "
            f"{maps.noise_word}.{maps.drawn_sentence(len(maps.drawn))}",
            rows=maps.row[maps.drawn] - 1,
            values=maps.size[maps.drawn],
            title="residual",
            unit=f"times {maps.noise_word}",
            link=LINK,
        )
    ]


def reference_blocks(
    known: ReferenceModels | None, fem: Remedy = FEM_REMEDY, *, assumed: bool = False
) -> list[Block]:
    """Return the errors of the reference models, and the family that they point to.

    Parameters
    ----------
    known
        The reference models; None where the columns do not allow them.
    fem
        How the FEM of a body is made that did not run yet.
    assumed
        Whether the noise is only assumed.
    """
    if known is None:
        text = "No references: they need all six pose and wrench columns and the length."
        return [TextBlock(text)]
    levels = known.levels()
    if assumed:
        levels.pop("noise floor")
    lost = [name for name, value in levels.items() if value >= USELESS]
    shown = {name: value for name, value in levels.items() if name not in lost}
    over = "an assumed noise: only the ratios count" if assumed else "the noise"
    quotient = f"error / {'assumed ' * assumed}noise"
    blocks: list[Block] = [] if assumed else [TextBlock(known.sentence(), strong=True)]
    if known.fem_needed:
        blocks.append(CodeBlock(str(Remedy(fem.words)), fem.command))
    if lost:
        names = f"The {' and the '.join(lost)} do{'es' * (len(lost) == 1)}"
        blocks.append(TextBlock(f"{names} not extrapolate to the held-out rows."))
    rows = [[name, shown.get(name), _MEANING[name]] for name in levels]
    caption = f"Error over {over}, {HELD_OUT[known.by]} held out. What each reference leaves."
    return [
        *blocks,
        TableBlock(caption, ("reference", quotient, "what it can fit"), rows),
        FigureBlock(
            "The same side by side. A fall from one to the next is the family of what is "
            "missing: symmetric, asymmetric, or no function of the pose.",
            draw.bars({"held-out rows": list(shown.values())}, list(shown), y_title=quotient),
        ),
    ]
