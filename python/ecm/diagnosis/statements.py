"""Wrong statements of the user: the tool tries other readings of the table and names what fits.

A frame that is turned by 90 degrees, a reversed torque or degrees for radians leave an error that
effects can imitate in part. Each other reading (`ecm.io.restated`) is fitted by the same
base; one that brings the error down to a third, and far below what the accepted effects leave, is
named as what it is. A polynomial takes in most wrong readings. Where no length is stated, so that
nothing else serves as base, an energy without symmetry is asked: any elastic body has one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ecm._native import EnergyModel
from ecm.diagnosis.problem import Candidate, Problem
from ecm.diagnosis.readings import WrongStatement, best_readings
from ecm.errors import EcmError
from ecm.io.arrays import F, I, evenly
from ecm.io.columns import POSE, WRENCH
from ecm.io.misread import falling_loads
from ecm.io.restated import Restatement, in_words
from ecm.models.joint_fit import joint_fit
from ecm.models.maps import EnergyMap, StiffnessMap

if TYPE_CHECKING:
    from ecm.io.table import Table

_ROWS = 150
"""Rows on which the readings are compared; the best is checked on all."""
_BETTER = 0.5
"""Share of the error of the polynomial that an energy may leave, where it errs more than noise."""
_GENERAL_TERMS = {4: 209, 3: 83, 2: 27}
"""Terms of an energy without symmetry by its degree."""


def find_wrong_statement(
    problem: Problem, effects: Sequence[Candidate], before: float, after: float
) -> WrongStatement | None:
    """Try other readings of the table; None where none explains it, or the effects do.

    Parameters
    ----------
    effects
        The accepted effects.
    before, after
        Whitened rms of the base alone, and with the accepted effects.
    """
    settings, base, table = problem.settings, problem.base, problem.table
    if not table.has(*POSE, *WRENCH):
        return None
    if base.kind == "polynomial":
        return _of_any_elastic_body(problem, before)
    length = problem.rows.length_m if problem.rows.has_length else None
    if before < settings.least_wrong_error or length is None:
        return None
    rows = _compared_rows(problem)
    poses, wrench = table.matrix(POSE)[rows], table.wrenches[rows]
    for body in _bodies(base):
        best = best_readings(body, poses, wrench, length, settings.mended_share)
        mended = _error(problem, body, best[0]) if best else None
        if mended is None or mended > settings.mended_share * before:
            continue
        if not effects or mended <= 0.5 * after:
            return WrongStatement(in_words(best), before, mended)
    return None


def _bodies(base: StiffnessMap) -> list[StiffnessMap]:
    """Return the base, and after a symmetric energy that of a body whose ends differ."""
    if not isinstance(base, EnergyMap) or base.model.symmetry != "alike":
        return [base]
    own = base.model
    terms: dict[str, Any] = {
        "length_m": own.length_m, "degree": own.degree, "symmetry": "revolution"
    }  # fmt: skip
    count = EnergyModel.regressor(np.array([[own.length_m, *[0.0] * 5]]), scale=own.scale, **terms)
    zeros = np.zeros(count.shape[2])
    unlike = EnergyModel.from_coefficients(scale=own.scale, coefficients=zeros, **terms)
    return [base, EnergyMap(unlike)]


def _of_any_elastic_body(problem: Problem, before: float) -> WrongStatement | None:
    """Try the readings where no length is stated: one that gives the wrench an energy is right."""
    settings, table, rows = problem.settings, problem.table, _compared_rows(problem)
    degrees = [d for d, terms in _GENERAL_TERMS.items() if 2 * terms <= 6 * len(rows)]
    poses, wrench = table.matrix(POSE)[rows], table.wrenches[rows]
    # The origin along the axis is free in an energy with all terms; it only gives a scale.
    length = float(np.linalg.norm(poses[:, :3].mean(axis=0)))
    if not degrees or not length > 0.0:
        return None

    def energy(poses: F, wrench: F) -> StiffnessMap:
        return EnergyMap(
            EnergyModel.fit(poses, wrench, length_m=length, degree=degrees[0], symmetry="general")
        )

    as_stated = _error(problem, energy(poses, wrench), None)
    most = max(settings.most_left_error, _BETTER * before)
    if as_stated is None or as_stated < settings.least_wrong_error:
        return None
    best = best_readings(energy(poses, wrench), poses, wrench, None, settings.mended_share)
    upright = [item for item in best if not _falls(*item.change(poses, wrench))]
    for item in (upright or best)[:1]:
        mended = _error(problem, energy(*item.change(poses, wrench)), item)
        if mended is not None and mended <= min(settings.mended_share * as_stated, most):
            return WrongStatement(in_words(upright or best), as_stated, mended)
    return None


def _falls(poses: F, wrench: F) -> bool:
    """Whether a load falls where its coordinate grows."""
    return bool(falling_loads(poses, wrench, np.full(12, True)))


def _named(poses: F, wrench: F) -> dict[str, F]:
    return dict(zip((*POSE, *WRENCH), np.hstack([poses, wrench]).T, strict=True))


def _compared_rows(problem: Problem) -> I:
    rows = np.flatnonzero(problem.scored & (problem.weights > 0.0))
    return rows[evenly(len(rows), _ROWS)]


def _error(problem: Problem, base: StiffnessMap, reading: Restatement | None) -> float | None:
    """Return the whitened rms that a base leaves of a reading; None where it cannot be fitted."""
    table = problem.table
    if reading is not None:
        table = table.with_columns(_named(*reading.change(table.matrix(POSE), table.wrenches)))
    try:
        fit = joint_fit(base, (), table, problem.noise)
    except (EcmError, np.linalg.LinAlgError):
        return None
    squares = (fit.whitened**2).sum(axis=1)[problem.scored]
    # Some bad rows shall not decide.
    kept = np.sort(squares)[: max(1, int(0.98 * len(squares)))]
    return float(np.sqrt(kept.mean() / fit.whitened.shape[1]))


def time_unit(table: Table) -> str:
    """Return the unit that time_s seems to have where readings follow faster than they rest."""
    if not table.has("time_s") or not table.has("dwell_s"):
        return ""
    time, dwell = table.column("time_s"), table.column("dwell_s")
    order = np.argsort(time, kind="stable")
    steps, rests = np.diff(time[order]), dwell[order][1:]
    known = np.isfinite(rests) & (rests > 0.0) & (steps > 0.0)
    if int(known.sum()) < 8 or float(np.median(steps[known] / rests[known])) >= 0.9:
        return ""
    for unit, factor in (("minutes", 60.0), ("hours", 3600.0)):
        if float(np.median(factor * steps[known] / rests[known])) >= 0.9:
            return (
                f"time_s looks stated in {unit}, not s: readings follow each other faster than "
                "the mechanism rests before them (dwell_s)"
            )
    return ""
