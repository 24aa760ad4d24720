"""The threshold of principal component regression, in its four usual forms.

PCR drops singular values of the normalised, un-centred regressor below b (the paper's b). They grow
with the square root of the number of rows, so a b tuned at 1400 rows is 2.65 times stricter at 200:
`B/sqrtN` is free of that. `rank:R` keeps R of them. `press` keeps as many as predict
left-out rows best, by the one-standard-error rule.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from ecm._native import PolynomialModel
from ecm.errors import InputError
from ecm.io.arrays import F

Threshold: TypeAlias = float | str | None
_FORMS = "B, B/sqrtN, rank:R or press"


def singular_threshold(pcr: float | str, poses: F, wrenches: F, degree: int) -> float:
    """The b below which singular values are dropped.

    Parameters
    ----------
    pcr
        b, or a text: `0.1`, `0.003/sqrtN`, `rank:60`, `press`.
    """
    if not isinstance(pcr, str):
        return _positive(pcr, str(pcr))
    text = pcr.strip().lower()
    if text.endswith("/sqrtn"):
        return _positive(_number(text[:-6], pcr), pcr) * float(np.sqrt(len(poses)))
    if text != "press" and not text.startswith("rank:"):
        return _positive(_number(text, pcr), pcr)
    values, rmse = PolynomialModel.leave_one_out(poses, wrenches, degree)
    if text == "press":
        rank = press_rank(rmse, len(poses))
    else:
        digits = text[5:]
        if not digits.isdigit() or not 1 <= int(digits) <= len(values):
            raise InputError(
                f"PCR threshold {pcr!r}: expected rank:R with R from 1 to {len(values)}"
            )
        rank = int(digits)
    if rank >= len(values):
        return 0.0
    return float(np.sqrt(values[rank - 1] * values[rank]))


def press_rank(rmse: F, rows: int) -> int:
    """The smallest rank whose leave-one-out error is within one standard error of the best.

    Each output counts by its error over its smallest one; the standard error of a root mean
    square of N residuals is 1/sqrt(2 N) of it.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(rmse > 0.0, rmse / rmse.min(axis=0), 1.0)
    error = np.sqrt((share**2).mean(axis=1))
    error = np.where(np.isfinite(error), error, np.inf)
    limit = error.min() * (1.0 + 1.0 / np.sqrt(2.0 * rows))
    return int(np.argmax(error <= limit)) + 1


def _number(text: str, given: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError(f"PCR threshold {given!r}: expected B, B/sqrtN, rank:R or press") from None


def _positive(value: float, given: str) -> float:
    if not (np.isfinite(value) and value >= 0.0):
        raise InputError(f"--pcr {given}: expected {_FORMS}, B greater than or equal to 0")
    return value
