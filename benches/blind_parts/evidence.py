"""An experiment beside today's diagnosis: one posterior over base, effects, families and noise.

For the whitened rows y, the base projected out: y = sum of effects + sum of families + the base's
own error + noise. An effect has the prior N(0, s^2 n (G'G)^-1), s its rms over the noise, and is
known to a tenth or a third of its form; a family is a smooth process of its driver; the base's own
error is a process of the pose of a small size; the noise's variance has an inverse gamma prior.
Sizes, forms and the base's error are sums over grids. The posterior of all sets that a beam search
visits gives the answer. docs/discovery.md has what it reached beside today's procedure.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr

from ecm.diagnosis.problem import Problem
from ecm.diagnosis.procedure import find_missing
from ecm.io.columns import POSE, WRENCH
from ecm.io.table import Table
from ecm.models import Model
from ecm.models.base_choice import next_degree
from ecm.models.joint_fit import base_columns

F = NDArray[np.float64]
Part = tuple[str, int]
Fixed = tuple[Part, float, float]
"""A part, its size and the share of its form that may be wrong."""

SIZES = np.exp(np.linspace(np.log(0.1), np.log(30.0), 13))
"""Rms of a cause over the noise."""
FORMS = (0.0, 0.1, 0.3)
"""Share by which the form of an effect may be wrong."""
BASE_ERROR = {"physics": (0.03, 0.1, 0.25), "": (0.03, 0.1, 0.3, 1.0, 3.0)}
"""Rms of the base's own error over the noise: of a stated body, and of a form that is fitted."""
FREEDOM = {"repeats": 30.0, "declared": 30.0, "assumed": 1.0}
"""Degrees of freedom of what is known of the noise."""
EFFECT_ODDS, FAMILY_ODDS, FURTHER = 0.5, 0.1, 4.0
"""Prior odds of all effects and of all families; a further cause is e^-4 as likely."""
NAMED, STANDS, MOST = 0.9, 0.85, 3
"""Probability of a name or class; share that a form explains of its family's; size of a class."""
BEAM, DEPTH = 4, 4

_BODY = ("diameter_error", "strain_stiffening", "base_compliance", "fts_gain", "debonding",
         "taper", "length_error")  # fmt: skip
"""What the FEM of a body gets wrong between two meshes or codes."""
_FAMILY = {
    "stress_relaxation": "dwell", "hysteresis": "approach", "backlash": "approach",
    "fts_hysteresis": "approach", "tendon_friction": "approach",
    "mullins_softening": "largest load", "temperature_modulus": "temperature",
    "fts_thermal_drift": "sensor temperature", "ageing": "time", "fts_drift": "time",
    "platform_slip": "rest pose", "marker_motion": "rest pose", "permanent_set": "rest pose",
}  # fmt: skip
"""The driver of an effect; of all others it is the pose."""
_OF_BASE = "~next degree"
"""A base of one degree more: no cause, but a base that was too plain."""


def family_of(name: str) -> str:
    """The driver that an effect, or a family (with its ~), follows."""
    if name.startswith("~"):
        return {"sensor axes": "pose"}.get(name[1:], name[1:])
    if name.startswith("unused_column:"):
        return name.removeprefix("unused_column:")
    return _FAMILY.get(name, "pose")


def _smooth(x: F, count: int) -> F | None:
    """(N, count) cosines of a variable, half by its ranks; None where it does not vary."""
    if not np.isfinite(x).all() or np.ptp(x) < 1e-12:
        return None
    rank = 0.5 * np.argsort(np.argsort(x)) / (len(x) - 1) + 0.5 * (x - x.min()) / np.ptp(x)
    return np.stack([np.cos(np.pi * k * rank) / k**1.5 for k in range(1, count + 1)], axis=1)


def _unit(x: F) -> F:
    return np.asarray((x - x.mean()) / max(float(x.std()), 1e-12))


@dataclass(frozen=True)
class _Drivers:
    """What the rows may follow, and the columns of a process of each."""

    problem: Problem

    def columns(self) -> dict[str, list[F]]:
        """Family -> its columns (N, m, q); of periods one entry a frequency."""
        out = {"time": [self._both(_smooth(self._time, 6))], "period": self._periods()}
        out["pose"] = [self._free(self._poses())]
        for name, key, count in (
            ("temperature", "temperature_degC", 4),
            ("sensor temperature", "sensor_temperature_degC", 4),
            *((key, key, 3) for key in self._own()),
        ):
            if self.problem.table.has(key):
                out[name] = [self._both(_smooth(self.problem.table.column(key), count))]
        if self.problem.table.has("dwell_s"):
            rest = np.log(np.maximum(self.problem.table.column("dwell_s"), 0.1))
            out["dwell"] = [self._scaled(_smooth(rest, 3))]
        out |= self._of_the_way()
        out["largest load"] = [self._scaled(_smooth(self._largest(), 3))]
        rows, slow = self.problem.rows, _smooth(self._time, 4)
        if slow is not None:
            k = np.einsum("nij,njk->nik", self.problem.whitener, rows.stiffness)
            k = k / (np.sqrt((k**2).mean(axis=(0, 1))) + 1e-12)
            out["rest pose"] = [np.concatenate([k * f[:, None, None] for f in slow.T], axis=2)]
        load = rows.wrench / np.sqrt((rows.wrench**2).mean(axis=0) + 1e-18)
        out["sensor axes"] = [self._free(np.hstack([load, np.abs(load), load**2]))]
        if self.problem.base.kind != "physics":
            more = next_degree(self.problem.base, self.problem.table)
            if more is not None:
                own = base_columns(rows, more)
                out["next degree"] = [np.einsum("nij,njk->nik", self.problem.whitener, own)]
        return {name: [c for c in listed if c.shape[2]] for name, listed in out.items()}

    @property
    def _time(self) -> F:
        table = self.problem.table
        return table.column("time_s") if table.has("time_s") else np.arange(float(len(table)))

    def _own(self) -> list[str]:
        known = {*POSE, *WRENCH, "time_s", "dwell_s", "temperature_degC", "pose_id"}
        known |= {"sensor_temperature_degC"}
        named = {c.id.partition(":")[2] for c in self.problem.candidates}
        return [name for name in self.problem.table.columns if name in named - known]

    def _free(self, f: F | None) -> F:
        n, m = self.problem.response.shape
        if f is None:
            return np.zeros((n, m, 0))
        return np.einsum("nq,ij->niqj", f, np.eye(m)).reshape(n, m, -1)

    def _scaled(self, f: F | None) -> F:
        if f is None:
            return self._free(None)
        rows = self.problem.rows
        load = np.einsum("nij,nj->ni", self.problem.whitener, rows.wrench)
        return np.asarray(load[:, :, None] * f[:, None, :])

    def _both(self, f: F | None) -> F:
        return np.concatenate([self._free(f), self._scaled(f)], axis=2)

    def _periods(self) -> list[F]:
        time = self._time
        step = float(np.median(np.diff(np.sort(time))))
        span = float(np.ptp(time))
        if step <= 0.0 or span <= 0.0:
            return []
        waves = np.arange(1.5 / span, 0.5 / step, 0.5 / span)[:150]
        angles = (2.0 * np.pi * w * time for w in waves)
        return [self._free(np.stack([np.cos(a), np.sin(a)], axis=1)) for a in angles]

    def _poses(self) -> F:
        rows = self.problem.rows
        at = rows.poses - rows.rest_pose
        at = at / (np.sqrt((at**2).mean(axis=0)) + 1e-12)
        some = at[np.random.default_rng(0).permutation(len(at))[:40]]

        def kernel(a: F, b: F) -> F:
            squares = ((a[:, None] - b[None]) ** 2).sum(axis=2)
            return np.exp(-squares / (3.0 * at.shape[1]))

        values, vectors = np.linalg.eigh(kernel(some, some) + 1e-6 * np.eye(len(some)))
        return np.asarray((kernel(at, some) @ vectors / np.sqrt(values))[:, ::-1][:, :24])

    def _of_the_way(self) -> dict[str, list[F]]:
        rows = self.problem.rows
        step = rows.poses - rows.came_from
        if not np.isfinite(step).all() or not (step**2).sum() > 0.0:
            return {}
        size = np.sqrt((step**2).mean(axis=0)) + 1e-12
        way = step / size
        side = way / np.maximum(np.linalg.norm(way, axis=1), 0.3)[:, None]
        k = np.einsum("nij,njk->nik", self.problem.whitener, rows.stiffness) * size
        shifted = k / np.sqrt((k**2).mean()) * side[:, None, :]
        free = self._free(np.hstack([side, np.tanh(way)]))
        before = rows.came_from - rows.rest_pose
        before = before / (np.sqrt((before**2).mean(axis=0)) + 1e-12)
        return {
            "approach": [np.concatenate([free, shifted], axis=2)],
            "visit before": [self._free(before)],
        }

    def _largest(self) -> F:
        rows = self.problem.rows
        away = (rows.poses - rows.rest_pose) / (rows.poses.std(axis=0) + 1e-12)
        work = (away**2).sum(axis=1)
        order = np.argsort(self._time)
        largest = np.maximum.accumulate(work[order])[np.argsort(order)]
        return np.asarray(largest / (work + 0.1 * work.mean()))


class Evidence:
    """Log evidence of sets of effects and families over that of nothing."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        n, m = problem.response.shape
        root = np.sqrt(problem.weights)
        self._flat = lambda columns: (columns * root[:, None, None]).reshape(n * m, -1)
        base = self._flat(problem.base_block)
        q = np.linalg.qr(base)[0] if base.shape[1] else np.zeros((n * m, 0))
        self._rest = lambda columns: columns - q @ (q.T @ columns)
        self.size = problem.size
        self.freedom = self.size - base.shape[1]
        self.parts: dict[str, list[F]] = {}
        self._sign: dict[Part, float] = {}
        self._columns: dict[Part, list[int]] = {}
        for item in (*problem.candidates, *problem.imitators):
            self._add_effect(item.id, list(item.columns))
        self.effects = list(self.parts)
        for name, listed in _Drivers(problem).columns().items():
            for columns in listed:
                self._add_family(f"~{name}", columns)
        self.families = [name for name in self.parts if name.startswith("~")]
        self.keys: list[Part] = [(k, i) for k in self.parts for i in range(len(self.parts[k]))]
        ends = np.cumsum([self.parts[k][i].shape[1] for k, i in self.keys])
        self._at = {
            key: slice(int(end) - self.parts[key[0]][key[1]].shape[1], int(end))
            for key, end in zip(self.keys, ends, strict=True)
        }
        noise = problem.noise
        self._known = 1e-3 if noise.is_residual else FREEDOM.get(noise.source, 30.0)
        y = self._rest((problem.response * root[:, None]).reshape(-1, 1))[:, 0]
        self._whiten(y)
        self._forms: dict[Part, list[F]] = {}
        self._scores: dict[tuple[Part, ...], tuple[float, list[Fixed], int]] = {}

    def _add_effect(self, name: str, columns: list[int]) -> None:
        raw = self._rest(self._flat(self.problem.design[:, :, columns]))
        u, d, _ = np.linalg.svd(raw, full_matrices=False)
        u = u[:, d > 1e-6 * max(float(d[0]), 1e-300)]
        if not u.shape[1]:
            return
        part = (name, len(self.parts.setdefault(name, [])))
        self.parts[name].append(u * np.sqrt(self.size / u.shape[1]))
        sign = float(self.problem.signs[columns[0]]) if len(columns) == 1 else 0.0
        self._sign[part] = sign * float(np.sign(raw[:, 0] @ u[:, 0]))
        self._columns[part] = columns

    def _add_family(self, name: str, columns: F) -> None:
        u, d, _ = np.linalg.svd(self._rest(self._flat(columns)), full_matrices=False)
        if not len(d) or d[0] < 1e-9:
            return
        k = min(30, int((d > 3e-2 * d[0]).sum()))
        scaled = u[:, :k] * d[:k] / np.sqrt((d[:k] ** 2).sum()) * np.sqrt(self.size)
        self.parts.setdefault(name, []).append(scaled)

    def _whiten(self, y: F) -> None:
        """Once for each size of the base's own error: rows and columns beside it."""
        body = [self.parts[k][len(self.parts[k]) // 2] for k in _BODY if k in self.parts]
        own = [self.parts["~pose"][0], *(c / np.sqrt(len(body)) for c in body)]
        own += [3.0 * c for c in self.parts.get(_OF_BASE, [])]  # a fitted form is too plain
        g = np.concatenate(own, axis=1)
        all_columns = np.concatenate([self.parts[k][i] for k, i in self.keys], axis=1)
        kind = self.problem.base.kind
        self._white: list[tuple[F, F, float]] = []
        for size in BASE_ERROR.get(kind, BASE_ERROR[""]):
            values, vectors = np.linalg.eigh(size**2 * (g.T @ g))
            kept = values > 1e-9
            axes = size * g @ vectors[:, kept] / np.sqrt(values[kept])
            shrink = 1.0 - 1.0 / np.sqrt(1.0 + values[kept])
            self._white.append((axes, shrink, 0.5 * float(np.log1p(values[kept]).sum())))
        self._u = [self._beside_base(all_columns, w) for w in range(len(self._white))]
        self._y = [self._beside_base(y, w) for w in range(len(self._white))]
        self._b = [u.T @ one for u, one in zip(self._u, self._y, strict=True)]
        self.nulls = np.array([self.whole([], w) for w in range(len(self._white))])
        self.null = float(np.logaddexp.reduce(self.nulls))

    def _beside_base(self, columns: F, w: int) -> F:
        axes, shrink, _ = self._white[w]
        return np.asarray(columns - axes @ (shrink * (axes.T @ columns).T).T)

    def form(self, part: Part, w: int) -> F:
        """(N m, q) columns by which the form of an effect may be off, with the effect's rms."""
        if part not in self._forms:
            own = self.parts[part[0]][part[1]]
            block = self.problem.design[:, :, self._columns[part]]
            raw = self._rest(self._flat(block))
            drivers = self._modulations()
            changed = np.concatenate([block * f[:, None, None] for f in drivers], axis=2)
            off = self._rest(self._flat(changed))
            off = off - own @ (own.T @ off) / (self.size / own.shape[1])
            u, d, _ = np.linalg.svd(off, full_matrices=False)
            k = min(10, int((d > 1e-2 * max(float(d[0]), 1e-300)).sum()))
            scale = np.sqrt(self.size / len(drivers) / (raw**2).sum())
            columns = u[:, :k] * d[:k] * scale
            self._forms[part] = [self._beside_base(columns, j) for j in range(len(self._white))]
        return self._forms[part][w]

    def _modulations(self) -> list[F]:
        rows, table = self.problem.rows, self.problem.table
        at = (rows.poses - rows.poses.mean(axis=0)) / np.maximum(rows.poses.std(axis=0), 1e-12)
        out = [at[:, j] for j in range(at.shape[1]) if np.ptp(at[:, j]) > 1e-6]
        out.append(_unit((at**2).sum(axis=1)))
        for key in ("time_s", "dwell_s", "temperature_degC", "sensor_temperature_degC"):
            if table.has(key) and np.ptp(table.column(key)) > 0.0:
                x = table.column(key)
                x = _unit(np.log(np.maximum(x, 0.1)) if key == "dwell_s" else x)
                out += [x, _unit(x**2)]
        return [f for f in out if np.isfinite(f).all()]

    def _state(self, fixed: Sequence[Fixed], w: int) -> F:
        columns = [np.zeros((len(self._y[w]) if hasattr(self, "_y") else 0, 0))]
        for part, size, form in fixed:
            columns.append(self._u[w][:, self._at[part]] * size)
            if form:
                columns.append(self.form(part, w) * size * form)
        return np.concatenate(columns, axis=1)

    def _log(self, quadratic: F, determinant: F, w: int) -> F:
        """Log evidence by what is left of the squares and half the log determinant."""
        least = 1e-9 * float(self._y[w] @ self._y[w])
        squares = self._known + np.maximum(quadratic, least)
        power = 0.5 * (self._known + self.freedom)
        return np.asarray(-determinant - self._white[w][2] - power * np.log(squares))

    def whole(self, fixed: Sequence[Fixed], w: int) -> float:
        """Log evidence of parts of given sizes with one size of the base's error."""
        s, y = self._state(fixed, w), self._y[w]
        lower = np.linalg.cholesky(np.eye(s.shape[1]) + s.T @ s)
        z = np.linalg.solve(lower, s.T @ y)
        return float(self._log(y @ y - z @ z, np.log(np.diag(lower)).sum(), w))

    def beside(self, fixed: Sequence[Fixed], w: int, only: Iterable[Part] | None = None) -> F:
        """(parts, sizes) log evidence of each further part beside fixed ones."""
        s, y = self._state(fixed, w), self._y[w]
        lower = np.linalg.cholesky(np.eye(s.shape[1]) + s.T @ s)
        z, across = (np.linalg.solve(lower, s.T @ x) for x in (y, self._u[w]))
        determinant, left = np.log(np.diag(lower)).sum(), float(y @ y - z @ z)
        b = self._b[w] - across.T @ z
        used = {part[0] for part, _, _ in fixed}
        tried = self.keys if only is None else list(only)
        out = np.full((len(self.keys), len(SIZES)), -np.inf)
        squares = SIZES[:, None] ** 2
        for key in tried:
            if key[0] in used:
                continue
            at = self._at[key]
            u = self._u[w][:, at]
            values, vectors = np.linalg.eigh(u.T @ u - across[:, at].T @ across[:, at])
            values, beta = np.maximum(values, 0.0), vectors.T @ b[at]
            grown = 1.0 + squares * values
            quadratic = left - (squares * beta**2 / grown).sum(axis=1)
            found = self._log(quadratic, determinant + 0.5 * np.log(grown).sum(axis=1), w)
            if sign := self._sign.get(key, 0.0):
                mean = squares[:, 0] * float(vectors[0, 0] * beta[0]) / grown[:, 0]
                spread = squares[:, 0] / grown[:, 0] * np.maximum(quadratic, 1e-12) / self.freedom
                found = found + log_ndtr(sign * mean / np.sqrt(spread)) + np.log(2.0)
            out[self.keys.index(key)] = found
        return out

    def score(
        self, parts: Sequence[Part], sizes: dict[Part, float]
    ) -> tuple[float, list[Fixed], int]:
        """Log evidence of a set over nothing: sums over sizes, forms and the base's errors."""
        key = tuple(sorted(parts))
        if key in self._scores:
            return self._scores[key]
        start, forms = {p: sizes.get(p, 1.0) for p in key}, dict.fromkeys(key, 0.0)
        each: list[tuple[float, list[Fixed], int]] = []
        for w in sorted(range(len(self._white)), key=lambda w: -self.nulls[w]):
            value = self._summed(key, start, forms, w)
            each.append((value, [(p, start[p], forms[p]) for p in key], w))
            if value < max(one[0] for one in each) - 15.0:
                break
        best = max(each, key=lambda one: one[0])
        total = float(np.logaddexp.reduce([one[0] for one in each])) - self.null
        self._scores[key] = (total, best[1], best[2])
        return self._scores[key]

    def _summed(
        self, key: tuple[Part, ...], sizes: dict[Part, float], forms: dict[Part, float], w: int
    ) -> float:
        """Coordinate steps over sizes, then forms; the sums around the best are added."""
        top, spread = -np.inf, 0.0
        for _ in range(2 if len(key) > 1 else 1):
            spread = 0.0
            for p in key:
                others = [(o, sizes[o], forms[o]) for o in key if o != p]
                if forms[p]:
                    found = np.array([self.whole([*others, (p, s, forms[p])], w) for s in SIZES])
                else:
                    found = self.beside(others, w, [p])[self.keys.index(p)]
                sizes[p], top = float(SIZES[int(np.argmax(found))]), float(found.max())
                spread += float(np.log(np.mean(np.exp(found - top))))
        for p in key:
            if not p[0].startswith("~"):
                tried = [
                    self.whole([(o, sizes[o], f if o == p else forms[o]) for o in key], w)
                    for f in FORMS
                ]
                forms[p], top = FORMS[int(np.argmax(tried))], max(tried)
                spread += float(np.log(np.mean(np.exp(np.array(tried) - top))))
        return top + spread

    def prior(self, names: Iterable[str]) -> float:
        """Log prior odds of a set over nothing."""
        listed = list(names)
        family = np.log(FAMILY_ODDS / len(self.families))
        effect = np.log(EFFECT_ODDS / max(1, len(self.effects)))
        own = sum(family if name.startswith("~") else effect for name in listed)
        return float(own - FURTHER * max(len(listed) - 1, 0))


@dataclass(frozen=True)
class Posterior:
    """All sets that were visited, the most likely first."""

    evidence: Evidence
    sets: list[tuple[tuple[str, ...], float]]
    held: dict[tuple[str, ...], tuple[list[Fixed], int]]

    def of(self, names: Iterable[str]) -> float:
        """Probability that one of the names is in the set."""
        wanted = set(names)
        return sum(p for one, p in self.sets if wanted & set(one))

    def explained(self, top: tuple[str, ...], names: Iterable[str]) -> float:
        """Squares that members of a set explain."""
        fixed, w = self.held[top]
        evidence, wanted = self.evidence, set(names)
        s = evidence._state(fixed, w)
        theta = np.linalg.solve(np.eye(s.shape[1]) + s.T @ s, s.T @ evidence._y[w])
        widths = [evidence._state([one], w).shape[1] for one in fixed]
        mask = np.concatenate(
            [np.full(k, one[0][0] in wanted) for k, one in zip(widths, fixed, strict=True)]
        )
        value = s @ np.where(mask, theta, 0.0)
        return float(value @ value)


def posterior(evidence: Evidence) -> Posterior:
    """Forward search with a beam over effects and families."""
    start = int(np.argmax(evidence.nulls))
    found: dict[tuple[str, ...], float] = {(): 0.0}
    held: dict[tuple[str, ...], tuple[list[Fixed], int]] = {(): ([], start)}
    front: list[tuple[str, ...]] = [()]
    for _ in range(DEPTH):
        new: list[tuple[str, ...]] = []
        for one in front:
            new += _extended(evidence, one, found, held)
        new.sort(key=lambda names: -found[names])
        best = max(found.values())
        front = [names for names in new[:BEAM] if found[names] > best - 12.0]
        if not front or found[new[0]] < best - 3.0:
            break
    logs = np.array(list(found.values()))
    share = np.exp(logs - np.logaddexp.reduce(logs)).tolist()
    ordered = sorted(zip(found, share, strict=True), key=lambda item: -item[1])
    return Posterior(evidence, ordered, held)


def _extended(
    evidence: Evidence,
    one: tuple[str, ...],
    found: dict[tuple[str, ...], float],
    held: dict[tuple[str, ...], tuple[list[Fixed], int]],
) -> list[tuple[str, ...]]:
    """Visit the sets of one name more: all by sizes held, the ten best by all sums."""
    fixed, w = held[one]
    table = evidence.beside(fixed, w)
    now, by_name = evidence.whole(fixed, w), {}
    for j, (name, shape) in enumerate(evidence.keys):
        if np.isfinite(table[j, 0]):
            top = float(table[j].max())
            summed = top + float(np.log(np.mean(np.exp(table[j] - top)))) - now
            size = float(SIZES[int(np.argmax(table[j]))])
            by_name.setdefault(name, []).append((summed, (name, shape), size))
    gains = {
        name: float(np.logaddexp.reduce([g for g, _, _ in shapes])) - np.log(len(shapes))
        for name, shapes in by_name.items()
    }
    values = {name: gains[name] + evidence.prior((*one, name)) for name in gains}
    new = []
    for place, name in enumerate(sorted(values, key=lambda name: -values[name])):
        key = tuple(sorted((*one, name)))
        if key in found:
            continue
        rough = found[one] - evidence.prior(one) + values[name]
        shapes = sorted(by_name[name], reverse=True)
        if place < 10 and rough > max(found.values()) - 12.0:
            sizes = {part: size for part, size, _ in fixed}
            scored = [
                evidence.score([*sizes, part], {**sizes, part: size})
                for gain, part, size in shapes[:3]
                if gain > shapes[0][0] - 6.0
            ]
            best = max(scored, key=lambda item: item[0])
            forms = gains[name] - shapes[0][0]  # what the other shapes add, or cost
            found[key] = best[0] + forms + evidence.prior(key)
            held[key] = (best[1], best[2])
        else:
            found[key] = rough
            held[key] = ([*fixed, (shapes[0][1], shapes[0][2], 0.0)], w)
        new.append(key)
    return new


@dataclass(frozen=True)
class Answer:
    """What the posterior says."""

    verdict: str
    answer: list[list[str]]
    families: list[str]
    probability: float


def answer_of(found: Posterior) -> Answer:
    """None, names, classes, families or unknown."""
    empty = sum(p for one, p in found.sets if not set(one) - {_OF_BASE})
    if empty >= 0.5:
        return Answer("none", [], [], empty)
    top = next(one for one, _ in found.sets if set(one) - {_OF_BASE})
    causes = _without_misfits(found, top)
    named, families, sure = [], [], 1.0
    for name in causes:
        group = _group(found, name, causes)
        if group:
            named.append(group)
            sure = min(sure, found.of(group))
            continue
        own = [k for k in found.evidence.parts if family_of(k) == family_of(name)]
        families.append(family_of(name) if found.of(own) >= NAMED else "")
        sure = min(sure, found.of(own))
    if "" in families:
        return Answer("unknown", [], [f for f in families if f], sure)
    if families:
        return Answer("family", named, families, sure)
    single = all(len(group) == 1 for group in named)
    return Answer("named" if single else "ambiguous", named, [], sure)


def _without_misfits(found: Posterior, top: tuple[str, ...]) -> list[str]:
    """The causes of a set without what is only the misfit of another one's form."""
    causes = [name for name in top if name != _OF_BASE]
    for name in sorted(causes, key=lambda name: found.explained(top, [name])):
        mates = [
            o
            for o in causes
            if o != name and not o.startswith("~") and family_of(o) == family_of(name)
        ]
        if mates and found.explained(top, mates) >= STANDS * found.explained(top, [*mates, name]):
            causes.remove(name)
    return causes


def _group(found: Posterior, name: str, causes: list[str]) -> list[str]:
    """The smallest group with the probability of a name; empty where there is none."""
    if name.startswith("~"):
        return []
    others = set(causes) - {name}
    rivals: dict[str, float] = {}
    for one, p in found.sets:
        if name in one or others <= set(one):
            for member in set(one) - others:
                if not member.startswith("~") and (member == name or member not in causes):
                    rivals[member] = rivals.get(member, 0.0) + p
    ordered = sorted(rivals, key=lambda member: -rivals[member])
    for count in range(1, MOST + 1):
        if found.of(ordered[:count]) >= NAMED:
            return ordered[:count]
    return []


def answer_by_evidence(model: Model, table: Table) -> Answer:
    """Diagnose a table by the posterior alone, on the base and the noise that `diagnose` ends with.

    Which base fits is no part of this experiment: against a base of alike ends every posterior
    names a taper on a notched bar.
    """
    return answer_of(posterior(Evidence(find_missing(model, table).problem)))
