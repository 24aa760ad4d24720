"""Sections, points and page of a comparison: errors, residuals, four references side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ecm.comparison.comparison import Comparison
from ecm.comparison.reference_models import FEM_NEEDED
from ecm.comparison.residual_figures import LINK, residual_section
from ecm.comparison.residuals import dependence_variables, residuals_by_block
from ecm.io.arrays import F, I
from ecm.regression.f_test import FTest
from ecm.regression.folds import is_pose_row
from ecm.regression.rows import Rows
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
    write_page,
)

_WORST = 10


@dataclass(frozen=True)
class ResidualPoints:
    """Residuals, measured minus predicted, of n measured poses in file order, m components."""

    row: I
    """(n,) rows of the table, from 1."""
    variables: Mapping[str, F]
    """(n,) by name with unit, those that vary."""
    physical: F
    """(n, m) in the units of the outputs."""
    over_noise: F
    """(n, m) over the standard deviation of that row's noise."""
    size: F
    """(n,) root mean square of the row's residual, whitened by its full covariance."""
    total: int
    """Measured poses of the table."""

    @property
    def sentence(self) -> str:
        """How many rows these are, where not all."""
        if len(self.row) == self.total:
            return ""
        return (
            f"{len(self.row)} of {self.total} rows are drawn: evenly over their order, and the "
            "worst ones."
        )


def residual_points(result: Comparison, most: int = 20_000) -> ResidualPoints:
    """Return the residuals of all measured poses, of more than `most` some and the worst ones.

    Parameters
    ----------
    result
        A comparison. `where` rests on chosen rows of a large table; this does not.
    most
        Rows above which every k-th is taken.

    Examples
    --------
    >>> import numpy as np
    >>> import ecm
    >>> x = np.linspace(-1e-3, 1e-3, 20)
    >>> table = ecm.as_table({"x_m": x, "fx_N": 1e4 * x + 1e10 * x**3})
    >>> result = ecm.compare(ecm.fit_model(table, "linear"), table)
    >>> points = residual_points(result, most=10)
    >>> points.total, len(points.row) < 20, points.size.argmax() in (0, len(points.row) - 1)
    (20, True, True)
    """
    made = result.compared
    rows = Rows(made.table, made.model.base)
    physical, whitened, variance = residuals_by_block(
        rows, made.predicted, result.noise, made.model.base.error
    )
    scored = np.flatnonzero(is_pose_row(made.table))
    size = np.sqrt((whitened**2).mean(axis=1))
    at = scored
    if len(scored) > most:
        worst = scored[np.argsort(-size[scored], kind="stable")[:_WORST]]
        at = np.union1d(scored[:: -(-len(scored) // most)], worst)
    variables = {name: values[at] for name, values in dependence_variables(rows).items()}
    return ResidualPoints(
        row=made.table.row_numbers[at] + 1,
        variables={n: v for n, v in variables.items() if n == "row" or np.ptp(v) > 0.0},
        physical=physical[at],
        over_noise=physical[at] / np.sqrt(variance[at]),
        size=size[at],
        total=len(scored),
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


def write_comparison(path: Path, result: Comparison, warnings: Sequence[str] = ()) -> None:
    """Write error of each component, reference models, and residuals in units of the noise."""
    sections = [
        compare_section(result, warnings),
        pose_error_section(result),
        references_section(result),
        residual_section(result.where()),
    ]
    write_page(path, f"{result.model} against measurements", f"{result.rows} rows", sections)
