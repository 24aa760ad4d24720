"""Which model, and how many poses: grouped cross-validation and learning curves.

The one-standard-error rule: of all candidates whose error is within one standard error of the
best one's, the one with the fewest coefficients. Errors are whitened by the noise of each row, so
that 1 is the noise floor and all six components count alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ecm.effects import Rows
from ecm.errors import EcmError, InputError
from ecm.io.arrays import F, I
from ecm.io.columns import POSE, WRENCH
from ecm.models.fit import fit_model
from ecm.models.maps import PolynomialMap
from ecm.models.pcr import Threshold
from ecm.regression.folds import row_groups
from ecm.regression.noise import Noise, whiteners

if TYPE_CHECKING:
    from ecm.io.table import Table
    from ecm.models.maps import StiffnessMap


@dataclass(frozen=True)
class Candidate:
    """A model by name, with its PCR threshold."""

    name: str
    pcr: Threshold = None

    @property
    def pcr_text(self) -> str | None:
        """The threshold as the option --pcr takes it."""
        return None if self.pcr is None else str(self.pcr)


@dataclass(frozen=True)
class ModelChoice:
    """What cross-validation says of each candidate, and which one to take."""

    candidates: tuple[Candidate, ...]
    coefficients: tuple[int, ...]
    error: F
    """(c,) root mean square whitened error on held-out folds; infinite where a fit failed."""
    standard_error: F
    """(c,) of `error`, over folds."""
    chosen: int

    @property
    def best(self) -> Candidate:
        """The one to take."""
        return self.candidates[self.chosen]

    def sentences(self) -> list[str]:
        """The held-out error of each candidate in words, and why one was chosen."""
        lines = []
        for i, candidate in enumerate(self.candidates):
            if np.isfinite(self.error[i]):
                pcr = "" if candidate.pcr is None else f" --pcr {candidate.pcr}"
                lines.append(
                    f"{candidate.name}{pcr}: {self.coefficients[i]} coefficients, held-out error "
                    f"{self.error[i]:.3g} +- {self.standard_error[i]:.2g} of the noise"
                )
        rule = "the fewest coefficients within one standard error of the smallest error"
        return [*lines, f"chosen: {rule}"]

    def to_dict(self) -> dict[str, Any]:
        """The candidates as plain values."""
        listed = [
            {
                "model": candidate.name,
                "pcr": candidate.pcr,
                "coefficients": self.coefficients[i],
                "error": float(self.error[i]) if np.isfinite(self.error[i]) else None,
                "chosen": i == self.chosen,
            }
            for i, candidate in enumerate(self.candidates)
        ]
        return {"candidates": listed}


def default_candidates(table: Table) -> list[Candidate]:
    """Return the models of `ecm fit --model choose`: polynomials, and energies where L is known.

    Raises
    ------
    InputError
        The table has not all six pose and wrench columns.
    """
    if table.pose_columns != POSE or table.wrench_columns != WRENCH:
        raise InputError(
            "--model choose needs all six pose and wrench columns: its errors are over the noise "
            "of a row; name a model instead"
        )
    candidates = [Candidate(name) for name in ("linear", "quadratic", "cubic")]
    candidates += [Candidate("cubic", "press"), Candidate("cubic", "0.01/sqrtN")]
    if table.meta.length_m is not None:
        candidates += [Candidate(f"energy{degree}") for degree in (4, 5, 6)]
    return candidates


def choose_model(
    table: Table, candidates: Sequence[Candidate | str], *, folds: int = 10, seed: int = 0
) -> ModelChoice:
    """Grouped cross-validation with the one-standard-error rule.

    Parameters
    ----------
    table
        All six pose and wrench columns; rows of one group, or one pose_id, stay together.
    """
    listed = tuple(Candidate(c) if isinstance(c, str) else c for c in candidates)
    if not listed:
        raise InputError("choose_model: no candidates; give at least one model name")
    measured = table.measured()
    fold = _folds(row_groups(measured), folds, seed)
    whitener = _whitener(measured)
    error, spread, sizes = [], [], []
    for candidate in listed:
        squares = []
        size = 0
        try:
            for part in range(int(fold.max()) + 1):
                train = measured.select(np.flatnonzero(fold != part))
                held = np.flatnonzero(fold == part)
                model = fit_model(train, candidate.name, pcr=candidate.pcr)
                size = free_coefficients(model.base)
                squares.append(_square(model.base, measured, held, whitener))
        except EcmError:
            error.append(np.inf)
            spread.append(np.inf)
            sizes.append(size)
            continue
        mean = float(np.mean(squares))
        error.append(np.sqrt(mean))
        # Of the root: d sqrt(s) = ds / (2 sqrt(s)).
        spread.append(float(np.std(squares, ddof=1)) / np.sqrt(len(squares)) / (2 * np.sqrt(mean)))
        sizes.append(size)
    if not np.isfinite(error).any():
        raise InputError(
            f"{table.source}: {len(measured)} rows are too few for every candidate; "
            "measure more poses or name smaller models"
        )
    best = int(np.argmin(error))
    within = np.asarray(error) <= error[best] + spread[best]
    order = [i for i in np.argsort(sizes, kind="stable") if within[i]]
    return ModelChoice(listed, tuple(sizes), np.array(error), np.array(spread), int(order[0]))


def free_coefficients(base: StiffnessMap) -> int:
    """How many numbers a fit chose: of a principal component regression those of its rank."""
    if isinstance(base, PolynomialMap) and base.model.rank > 0:
        return base.model.rank * len(base.outputs)
    return len(base.coefficients)


@dataclass(frozen=True)
class LearningCurve:
    """Held-out error against the number of poses."""

    sizes: tuple[int, ...]
    error: F
    """(s,) median over draws of the whitened held-out error; infinite where no fit was possible."""
    lower: F
    """(s,) quartile."""
    upper: F
    """(s,) quartile."""
    enough: int | None
    """The fewest poses that the stop rule accepts, None where more are needed."""
    one_standard_error: int | None
    """The fewest poses whose mean error over draws is within one standard error of the best's."""

    def sentences(self, name: str) -> list[str]:
        """The curve of a model in words."""
        lines = [
            f"{name} from {n} poses: held-out error {error:.3g} of the noise"
            for n, error in zip(self.sizes, self.error, strict=True)
            if np.isfinite(error)
        ]
        if self.enough is None:
            return [
                *lines,
                "not enough: the curve still falls at the last of these; measure more poses",
            ]
        return [
            *lines,
            f"enough: {self.enough} poses are within 5 %, {self.one_standard_error} within one "
            "standard error of the best",
        ]

    def to_dict(self) -> dict[str, Any]:
        """The curve as plain values."""
        return {
            "sizes": list(self.sizes),
            "error": [float(e) if np.isfinite(e) else None for e in self.error],
            "enough": self.enough,
            "one_standard_error": self.one_standard_error,
        }


def learning_curve(
    table: Table,
    name: str,
    sizes: Sequence[int],
    *,
    draws: int = 8,
    tolerance: float = 0.05,
    held_out: float = 0.25,
    seed: int = 0,
) -> LearningCurve:
    """How many poses are enough for a model.

    The stop rule: the fewest poses whose held-out error is within `tolerance` of the smallest
    on the curve, provided that the curve has become flat there: the largest size must not be
    better than the one before by more than `tolerance`. `one_standard_error` asks for what the
    draws can tell apart instead of for a share.
    """
    measured = table.measured()
    groups = row_groups(measured)
    count = int(groups.max()) + 1
    keep = max(1, round(held_out * count))
    whitener = _whitener(measured)
    usable = [n for n in sizes if n <= count - keep]
    if not usable:
        raise InputError(
            f"{table.source}: {count} poses, {keep} of them held out: give sizes up to "
            f"{count - keep}, found {list(sizes)}"
        )
    errors = np.full((len(usable), draws), np.inf)
    for d in range(draws):
        order = np.random.default_rng([seed, d]).permutation(count)
        held = np.flatnonzero(np.isin(groups, order[:keep]))
        for s, n in enumerate(usable):
            rows = np.flatnonzero(np.isin(groups, order[keep : keep + n]))
            try:
                model = fit_model(measured.select(rows), name)
            except EcmError:
                continue
            errors[s, d] = np.sqrt(_square(model.base, measured, held, whitener))
    middle = np.median(errors, axis=1)
    lower, upper = np.sort(errors, axis=1)[:, [draws // 4, -1 - draws // 4]].T
    enough = None
    flat = len(usable) > 1 and middle[-2] <= (1.0 + tolerance) * middle[-1]
    if flat and np.isfinite(middle[-1]):
        within = middle <= (1.0 + tolerance) * middle.min()
        enough = usable[int(np.argmax(within))]
    mean, few = errors.mean(axis=1), None
    if np.isfinite(mean).any() and draws > 1:
        best = int(np.argmin(mean))
        spread = float(errors[best].std(ddof=1)) / np.sqrt(draws)
        few = usable[int(np.argmax(mean <= mean[best] + spread))]
    return LearningCurve(tuple(usable), middle, lower, upper, enough, few)


def _folds(groups: I, folds: int, seed: int) -> I:
    count = int(groups.max()) + 1
    parts = min(folds, count)
    if parts < 2:
        raise InputError("only one group of rows: cross-validation needs two")
    of_group = np.empty(count, dtype=np.int64)
    order = np.random.default_rng([seed, 7]).permutation(count)
    of_group[order] = np.arange(count) % parts
    return np.asarray(of_group[groups])


def _whitener(table: Table) -> F:
    """(N, m, m) from the table's stated noise, the stiffness from a smooth fit of all rows."""
    from ecm.regression.noise import declared_noise

    name = "cubic" if len(table) >= 120 else "linear"
    base = fit_model(table, name).base
    noise: Noise = declared_noise(table)
    return whiteners(noise.covariance(Rows(table, base)))


def _square(base: StiffnessMap, table: Table, held: I, whitener: F) -> float:
    part = table.select(held)
    truth = np.stack([part.column(c) for c in base.outputs], axis=1)
    left = truth - base.predict(np.ascontiguousarray(part.matrix(base.inputs)))
    return float((np.einsum("nij,nj->ni", whitener[held], left) ** 2).mean())
