"""Five simpler methods on the same sets, given the same library, base and whitened rows."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blind_parts.analysis import library
from blind_parts.data import Data
from blind_parts.once import Work, only_the_answer
from blind_parts.sets import Set
from ecm.diagnosis import DiagnosisSettings, Stages, find_missing
from ecm.diagnosis.decision import Decision
from ecm.diagnosis.problem import Problem
from ecm.diagnosis.search import rank
from ecm.effects import Rows
from ecm.models.base_choice import choose_base
from ecm.models.noise_estimate import declared_or_fitted, estimate_noise
from ecm.regression.noise import Noise

F = NDArray[np.float64]
Answer = dict[str, Any]


def _named(ids: list[str]) -> Answer:
    return {"verdict": "named" if ids else "none", "answer": [[id] for id in ids]}


def _flat(problem: Problem) -> tuple[F, F, list[str], dict[int, int]]:
    """Weighted response and what testable effects add to the base; an id per column, and the
    place of each column of the problem's design."""
    root = np.sqrt(problem.weights)[:, None]
    y = (problem.response * root).ravel()
    z = (problem.design * root[:, :, None]).reshape(len(y), -1)
    base, rest = z[:, : problem.n_base], z[:, problem.n_base :]
    q = np.linalg.qr(base)[0] if problem.n_base else base
    ids = [""] * rest.shape[1]
    for candidate in problem.candidates:
        for column in candidate.columns:
            ids[column - problem.n_base] = candidate.id
    # Columns without an id belong to effects that these rows cannot test.
    own = [j for j, id in enumerate(ids) if id]
    rest = rest[:, own]
    place = {j + problem.n_base: i for i, j in enumerate(own)}
    return y - q @ (q.T @ y), rest - q @ (q.T @ rest), [ids[j] for j in own], place


def sparse_regression(case: Set, data: Data, work: Work) -> Answer:
    """Sequentially thresholded least squares over all columns of the library.

    A column stays while its coefficient exceeds a threshold in standard errors; the threshold is
    the largest within one standard error of the least error in random cross-validation.
    """
    y, z, ids, _ = _flat(work.problem)
    z = z / np.maximum(np.linalg.norm(z, axis=0), 1e-12)
    fold = np.random.default_rng([case.seed, 4]).permutation(len(y)) % 5
    whole = z.T @ z, z.T @ y
    parts = [(z[fold == k].T @ z[fold == k], z[fold == k].T @ y[fold == k]) for k in range(5)]
    thresholds = np.array([2.0, 2.5, 3.0, 3.5, 4.0, 5.0, 6.0, 8.0, 12.0])
    errors = np.empty((5, len(thresholds)))
    for k, (gram, vector) in enumerate(parts):
        for j, threshold in enumerate(thresholds):
            w = _thresholded(whole[0] - gram, whole[1] - vector, float(threshold))
            left = y[fold == k] - z[fold == k] @ w
            errors[k, j] = (left**2).mean()
    mean = errors.mean(axis=0)
    best = int(mean.argmin())
    bar = mean[best] + errors[:, best].std(ddof=1) / np.sqrt(5.0)
    pick = float(thresholds[np.flatnonzero(mean <= bar)[-1]])
    kept = np.flatnonzero(_thresholded(*whole, pick))
    return _named(sorted({ids[i] for i in kept}))


def _thresholded(gram: F, vector: F, threshold: float) -> F:
    """Coefficients (K,), 0 where thrown out; noise of the rows is 1."""
    active = np.arange(len(vector))
    w = np.zeros(len(vector))
    while len(active):
        part = gram[np.ix_(active, active)] + 1e-6 * np.eye(len(active))
        inverse = np.linalg.inv(part)
        own = inverse @ vector[active]
        keep = np.abs(own) > threshold * np.sqrt(np.maximum(np.diag(inverse), 1e-300))
        if keep.all():
            w[active] = own
            break
        # The weakest half of what fails goes, or columns that share an effect all go at once.
        order = np.argsort(np.abs(own) / np.sqrt(np.maximum(np.diag(inverse), 1e-300)))
        out = order[: max(1, int((~keep).sum()) // 2)]
        active = np.delete(active, out)
    return w


def bic_forward(case: Set, data: Data, work: Work) -> Answer:
    """Forward selection while BIC falls; no class, no held-out error, no resampling."""
    problem = work.problem
    chosen: list[Any] = []
    while len(chosen) < 4:
        ranked = rank(problem, chosen)
        if not ranked or ranked[0].delta_bic <= 0.0:
            break
        chosen.append(ranked[0].candidate)
    return _named([item.id for item in chosen])


def gaussian_process(case: Set, data: Data, work: Work) -> Answer:
    """A GP of the residual over pose, time and temperature; named is what is most like it."""
    problem, table = work.problem, work.problem.table
    columns = [*problem.rows.poses.T]
    for name in ("time_s", "temperature_degC", "sensor_temperature_degC", "dwell_s"):
        if table.has(name):
            columns.append(table.column(name))
    x = np.stack(columns, axis=1)
    spread = x.std(axis=0)
    x = (x - x.mean(axis=0)) / np.where(spread > 0.0, spread, 1.0)
    distance = ((x[:, None, :] - x[None, :, :]) ** 2).sum(axis=2)
    y = problem.response * np.sqrt(problem.weights)[:, None]
    n, m = y.shape
    best = (0.5 * float((y**2).sum()), np.zeros_like(y))  # no process at all
    for reach in (1.5, 3.0, 6.0):
        for power in (0.1, 0.3, 1.0, 3.0, 10.0):
            kernel = power * np.exp(-0.5 * distance / reach**2)
            root = np.linalg.cholesky(kernel + np.eye(n))
            half = np.linalg.solve(root, y)
            evidence = 0.5 * float((half**2).sum()) + m * float(np.log(np.diag(root)).sum())
            if evidence < best[0] - 3.0:
                best = evidence, kernel @ np.linalg.solve(root.T, half)
    mean = best[1].ravel()
    if not np.any(mean):
        return _named([])
    _, z, _, place = _flat(problem)
    shares: dict[str, float] = {}
    for candidate in problem.candidates:
        own = z[:, [place[c] for c in candidate.columns]]
        fitted = own @ np.linalg.lstsq(own, mean, rcond=1e-10)[0]
        shares[candidate.id] = max(
            shares.get(candidate.id, 0.0), float((fitted**2).sum() / (mean**2).sum())
        )
    return _named([max(shares, key=lambda id: shares[id])] if shares else [])


def random_folds(case: Set, data: Data, work: Work) -> Answer:
    """Our procedure with held-out rows drawn at random."""
    decision = find_missing(
        data.model,
        data.table,
        effects=library(case.removed),
        settings=DiagnosisSettings(held_out="random"),
        stages=work.replaying(),
    )
    return _answer(decision)


def _answer(decision: Decision) -> Answer:
    return {
        "verdict": decision.verdict,
        "answer": [list(members) for members in decision.answer],
        "not_testable": [
            {"id": id, "reason": lacking.reason, "record": lacking.record}
            for id, lacking in decision.not_testable.items()
        ],
    }


class DiagonalNoise(Noise):
    """The same figures without what links the components."""

    def covariance(self, rows: Any, base_error: Any = None) -> F:
        whole = super().covariance(rows, base_error)
        return np.asarray(whole * np.eye(whole.shape[1]))


def diagonal_noise(case: Set, data: Data, work: Work) -> Answer:
    """Our procedure with the diagonal of each row's covariance, nothing off it."""
    base = choose_base(data.model, data.table)
    rows = Rows(data.table, base)
    noise = estimate_noise(rows, rows.sensor_load, fallback=declared_or_fitted(base, data.table))
    decision = find_missing(
        data.model,
        data.table,
        effects=library(case.removed),
        noise=diagonal(noise),
        stages=only_the_answer(Stages()),
    )
    return _answer(decision)


def diagonal(noise: Noise) -> Noise:
    """The same noise without what links the components."""
    return DiagonalNoise(
        noise.position_sd_m, noise.rotation_sd_rad, noise.force_sd_N, noise.torque_sd_Nm,
        noise.source, noise.components,
    )  # fmt: skip


SIMPLE: dict[str, Callable[[Set, Data, Work], Answer]] = {
    "sparse regression": sparse_regression,
    "BIC forward": bic_forward,
    "GP discrepancy": gaussian_process,
    "random folds": random_folds,
    "diagonal noise": diagonal_noise,
}


def simple_answers(case: Set, data: Data, work: Work) -> dict[str, Answer]:
    """What each of the five says."""
    return {name: method(case, data, work) for name, method in SIMPLE.items()}
