"""What is stated wrongly: points, axes, signs and units of the table, E, nu, length and noise.

A frame that is turned by 90 degrees, a reversed torque or degrees for radians leave an error that
effects can imitate in part. Each other reading (`ecm.io.conventions`) is fitted by the same
base; one that brings the error down to a third, and far below what the accepted effects leave, is
named as what it is. A polynomial takes in most wrong readings. Where no length is stated, so that
nothing else serves as base, an energy without symmetry is asked: any elastic body has one.

With e the residual that no column explains and A = W V W' an effect's variance V in whitened axes,
U = sum e' A e - sum tr(A M) has mean 0 and variance 2 sum tr((A M)^2) where the noise is right, M
what the fit leaves of a row's unit covariance. Such effects change weights; they are no answer.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy import special
from scipy.optimize import least_squares

from ecm.diagnosis.problem import Candidates, Problem, best_of_each, omnibus_columns
from ecm.effects import Effect
from ecm.effects.noise import NoiseEffect
from ecm.errors import EcmError, ModelError
from ecm.io.arrays import B, F, evenly, rest_of
from ecm.io.columns import POSE, WRENCH, unit_of_factor
from ecm.io.conventions import Convention, conventions, falling_loads, in_words
from ecm.io.se3 import rotation
from ecm.io.table import Table
from ecm.models.joint_fit import FittedEffect, JointFit, joint_fit
from ecm.models.maps import EnergyMap, EnergyTerms, StiffnessMap
from ecm.models.physics.map import PhysicsMap
from ecm.models.physics.refit import stated_body
from ecm.models.refit import FAR_BEYOND_NOISE
from ecm.regression.f_test import orthonormal
from ecm.regression.folds import repeat_cells
from ecm.regression.noise import Noise, declared_noise
from ecm.regression.normal_equations import explained_by_blocks

LEAST_WRONG_ERROR = 2.0
"""Error over the noise from which other readings of the table are tried."""
MENDED_SHARE = 1.0 / 3.0
"""Share of the error to which another reading must bring it to be named."""


_LEAST_SHARE = 0.01
"""A point nearer than this share of the length is a matter of calibration."""
_MOST_SHARE = 1.0
_STEPS = 20
_STARTS = [
    np.zeros(3),
    *(s * axis for s in (-0.2, -0.1, -0.04, 0.04, 0.1, 0.2) for axis in np.eye(3)),
]
"""Shares of the length; the search begins at the best: there are other minima far away."""

Left = Callable[[F, F], F]
"""(poses, wrench) -> what a base fitted to them leaves, a vector."""


def moved_points(length_m: float, poses: F, wrench: F, left: Left) -> Iterator[Convention]:
    """Yield the points, and turns, of which the base leaves the least squares, one a kind."""
    point = length_m, 1e3, "mm"
    turn = 1.0, float(np.degrees(1.0)), "deg, as a rotation vector,"
    on_platform = (
        "against those of the top (state top_from_sensor in [instrument] and wrench_axes = "
        '"sensor" in [frames])'
    )
    kinds = (
        (
            "the positions look measured from a point {0} away (take it from base_from_robot of "
            "[frames])",
            _moved_pose,
            False,
            point,
        ),
        (
            "the pose looks that of another point of the top, {0} away (add it to top_from_tool of "
            "[frames])",
            _moved_pose,
            True,
            point,
        ),
        ("the torque looks taken about a point {0} away", _moved_torque, False, point),
        (
            "the torque looks taken about a point of the top {0} away",
            _moved_torque,
            True,
            point,
        ),
        (
            "the axes of the force sensor look turned by {0} against those of the base (state "
            'base_from_sensor and wrench_axes = "sensor" in [frames])',
            _turned_wrench,
            False,
            turn,
        ),
        (
            f"the axes of the force sensor look turned by {{0}} {on_platform}",
            _turned_wrench,
            True,
            turn,
        ),
        (
            "the wrench looks read in axes of a force sensor that moves, turned by {0} "
            f"{on_platform}",
            _read_by_sensor,
            True,
            turn,
        ),
    )
    for words, change, of_top, (size, shown, unit) in kinds:
        move = partial(change, of_top)
        at = _best_point(move, size, poses, wrench, left)
        if at is None:
            continue
        said = words.format(f"({', '.join(f'{shown * c:.1f}' for c in at)}) {unit}")
        yield Convention(said, partial(move, at), change is _moved_pose)


def _lever(of_top: bool, at: F, poses: F) -> F:
    """(N, 3) a point that is fixed in the base or in the top, in base axes."""
    return rotation(poses[:, 3:]) @ at if of_top else np.broadcast_to(at, (len(poses), 3))


def _moved_pose(of_top: bool, at: F, poses: F, wrench: F) -> tuple[F, F]:
    """Return the poses of another point."""
    return np.hstack([poses[:, :3] - _lever(of_top, at, poses), poses[:, 3:]]), wrench


def _moved_torque(of_top: bool, at: F, poses: F, wrench: F) -> tuple[F, F]:
    """Return the torques about another point."""
    more = np.cross(_lever(of_top, at, poses), wrench[:, :3])
    return poses, np.hstack([wrench[:, :3], wrench[:, 3:] + more])


def _turned_wrench(of_top: bool, by: F, poses: F, wrench: F) -> tuple[F, F]:
    """Return the wrench as a sensor reads it whose axes are turned by a rotation vector."""
    turn = rotation(by[None])
    if of_top:
        top = rotation(poses[:, 3:])
        turn = top @ turn @ np.swapaxes(top, 1, 2)
    return poses, _in_axes(turn, wrench)


def _read_by_sensor(of_top: bool, by: F, poses: F, wrench: F) -> tuple[F, F]:
    """Return the wrench in base axes that was read in those of a sensor on the platform."""
    return poses, _in_axes(rotation(poses[:, 3:]) @ rotation(by[None]), wrench)


def _in_axes(turn: F, wrench: F) -> F:
    """(N, 6) wrench of which force and torque are turned by matrices (N, 3, 3) or (1, 3, 3)."""
    return np.hstack([(turn @ part[:, :, None])[:, :, 0] for part in np.hsplit(wrench, 2)])


def _best_point(
    move: Callable[[F, F, F], tuple[F, F]], size: float, poses: F, wrench: F, left: Left
) -> F | None:
    """Return the point (3,) in m; None where it is too near, too far, or cannot be found.

    Or the turn in rad. Shares are of the length, or of a radian.
    """

    def rest(shares: F) -> F:
        return left(*move(size * shares, poses, wrench))

    try:
        begin = min(_STARTS, key=lambda start: float((rest(start) ** 2).sum()))
        found = least_squares(rest, begin, max_nfev=_STEPS, diff_step=[1e-4] * 3, x_scale=0.1)
    except (EcmError, ValueError, np.linalg.LinAlgError):
        return None
    far = float(np.abs(found.x).max())
    return size * found.x if _LEAST_SHARE < far < _MOST_SHARE else None


EQUAL = 1.5
"""What leaves up to so many times the least squares is said as well."""
_MOST_SAID = 2


@dataclass(frozen=True)
class WrongStatement:
    """A reading of the table that fits far better than the one that was stated."""

    what: str
    error_before: float
    """Error of the base, or of the model that was given, over the noise, as stated."""
    error_after: float
    """The same with the other reading."""

    def sentence(self) -> str:
        """Return what looks wrong, and what it rests on."""
        return (
            f"{self.what}: with that mended the error falls from {self.error_before:.3g} to "
            f"{self.error_after:.3g} times the noise"
        )


def best_readings(
    base: StiffnessMap, poses: F, wrench: F, length_m: float | None
) -> list[Convention]:
    """Return the readings of which a base, fitted to each, leaves the least, the simplest first.

    Where no length is known no origins are searched, and no units of the pose are tried.
    """
    try:
        as_stated = _columns(base, poses)
    except EcmError:
        return []

    def squares(item: Convention, poses: F, wrench: F) -> float:
        columns = _columns(base, poses) if item.of_pose else as_stated
        return float((_rest(columns, wrench) ** 2).mean())

    listed = [*conventions(length_m)]
    if length_m is None:
        # Every symmetric stiffness has an energy where the rotations are small enough.
        listed = [item for item in listed if not item.of_pose_unit]
    else:
        listed += moved_points(length_m, poses, wrench, lambda p, h: _rest(_columns(base, p), h))
    most = MENDED_SHARE**2 * float((_rest(as_stated, wrench) ** 2).mean())
    best = [item for _, item in best_of(listed, poses, wrench, squares, most)]
    if length_m is not None:
        return best
    there = np.full(12, True)
    return [one for one in best if not falling_loads(*one.change(poses, wrench), there)] or best


def best_of(
    listed: Iterable[Convention],
    poses: F,
    wrench: F,
    squares: Callable[[Convention, F, F], float],
    most: float,
) -> list[tuple[float, Convention]]:
    """Return the readings that leave about the least squares, with these; none where it is above
    `most`, and of several that say the same of these columns the first.

    `squares` gives those that are left of poses and wrench as a reading has them; not finite, or
    an error, where the columns or the model end.
    """
    left: dict[bytes, tuple[float, Convention]] = {}
    for item in listed:
        try:
            read = item.change(poses, wrench)
            value = squares(item, *read)
        except (EcmError, np.linalg.LinAlgError):
            continue
        if np.isfinite(value):
            same = np.round(np.hstack(read), 9) + 0.0  # no negative zeros
            left.setdefault(same.tobytes(), (value, item))
    least = min((value for value, _ in left.values()), default=np.inf)
    if not least <= most:
        return []
    return [one for one in left.values() if one[0] <= EQUAL * least][:_MOST_SAID]


def _columns(base: StiffnessMap, poses: F) -> tuple[F, F]:
    """Return the wrench (n, 6) and its derivative (n, 6, k) to the coefficients."""
    poses = np.ascontiguousarray(poses)
    found = base.predict(poses), base.columns(poses)
    if not all(np.isfinite(part).all() for part in found):
        raise ModelError("no such pose")
    return found


def _rest(base: tuple[F, F], wrench: F) -> F:
    """Return (6 n,) what the fitted base leaves, over the rms of force and of torque."""
    predicted, columns = base
    size = _sizes(wrench)
    y = ((wrench - predicted) / size).ravel()
    z = (columns / size[:, None]).reshape(len(y), -1)
    return rest_of(z, y)


def _sizes(wrench: F) -> F:
    """(6,) the rms of force and of torque, 1 where there is none."""
    size = np.repeat([np.sqrt((part**2).mean()) for part in (wrench[:, :3], wrench[:, 3:])], 3)
    return np.where(size > 0.0, size, 1.0)


_ROWS = 150
"""Rows on which the readings are compared; the best is checked on all."""
_BETTER = 0.5
"""Share of the error of the polynomial that an energy may leave, where it errs more than noise."""
_GENERAL_TERMS = {4: 209, 3: 83, 2: 27}
"""Terms of an energy without symmetry by its degree."""


def find_wrong_statement(
    problem: Problem, effects: Candidates, before: float, after: float
) -> WrongStatement | None:
    """Try other readings of the table; None where none explains it, or the accepted effects do.

    Errors before and after are those of the base alone, and with these effects.
    """
    table = problem.table
    if not table.has(*POSE, *WRENCH):
        return None
    rows = np.flatnonzero(problem.scored & (problem.weights > 0.0))
    rows = rows[evenly(len(rows), _ROWS)]
    poses, wrench = table.matrix(POSE)[rows], table.wrenches[rows]
    length = problem.rows.length_m if problem.rows.has_length else None
    bodies, most = _bodies(problem.base), 0.5 * after if effects else np.inf
    if problem.base.kind == "polynomial":
        # It takes in most readings: one that gives the wrench an energy is right.
        length, bodies = None, _any_elastic_body(poses, wrench)
        most = max(FAR_BEYOND_NOISE, _BETTER * before)
        before = min((_errors(problem, body, None)[0] for body in bodies), default=0.0)
    elif length is None:
        return None
    if not LEAST_WRONG_ERROR <= before < np.inf:
        return None
    for body in bodies:
        best = best_readings(body, poses, wrench, length)
        if not best:
            continue
        mended, left = _errors(problem, body, best[0])
        better = mended <= min(MENDED_SHARE * before, most)
        # Fitted as stated only where the reading may be said: most that are tried are not.
        if better and left <= MENDED_SHARE * _errors(problem, body, None)[1]:
            return WrongStatement(in_words(best), before, mended)
    return None


def _bodies(base: StiffnessMap) -> list[StiffnessMap]:
    """Return the base, and after a symmetric energy that of a body whose ends differ."""
    if not isinstance(base, EnergyMap) or base.model.symmetry != "alike":
        return [base]
    terms, scale = replace(base.terms, symmetry="revolution", groups=()), base.model.scale
    count = terms.regressor(np.array([[terms.length_m, *[0.0] * 5]]), scale).shape[2]
    return [base, terms.map(scale, np.zeros(count))]


def _any_elastic_body(poses: F, wrench: F) -> list[StiffnessMap]:
    """Return an energy without symmetry of the degree that the rows allow; none of too few rows."""
    degrees = [d for d, terms in _GENERAL_TERMS.items() if 2 * terms <= 6 * len(poses)]
    # The origin along the axis is free in an energy with all terms; it only gives a scale.
    length = float(np.linalg.norm(poses[:, :3].mean(axis=0)))
    if not degrees or not length > 0.0:
        return []
    return [EnergyTerms(length, degrees[0], "general").fit(poses, wrench)]


def _errors(
    problem: Problem, base: StiffnessMap, reading: Convention | None
) -> tuple[float, float]:
    """Return what a base leaves of a reading over the noise, and as a share of its wrench.

    The noise of a pose is as large in the wrench as the base is stiff, and at a reading far from
    the rows of its fit that may be any stiffness: it must leave less of the wrench itself as well.
    Infinite where it has no fit.
    """
    table = problem.table
    if reading is not None:
        read = np.hstack(reading.change(table.matrix(POSE), table.wrenches))
        table = table.with_columns(dict(zip((*POSE, *WRENCH), read.T, strict=True)))
    fit = fit_or_none(base, (), table, problem.noise)
    if fit is not None and reading is not None:
        # Its weights were by the stiffness of the base before, which was of other poses.
        fit = fit_or_none(fit.base, (), table, problem.noise)
    if fit is None:
        return np.inf, np.inf
    size = _sizes(table.wrenches[problem.scored])
    return _most_rows(fit.whitened[problem.scored]), _most_rows(fit.residual[problem.scored] / size)


def _most_rows(left: F) -> float:
    """Rms of (n, m) without the worst rows: some bad ones shall not decide."""
    squares = np.sort((left**2).sum(axis=1))
    kept = squares[: max(1, int(0.98 * len(squares)))]
    return float(np.sqrt(kept.mean() / left.shape[1]))


def fit_or_none(
    base: StiffnessMap, effects: Sequence[Effect], table: Table, noise: Noise
) -> JointFit | None:
    """Fit together; None where the steps leave the range of the base or of an effect."""
    try:
        return joint_fit(base, effects, table, noise)
    except (EcmError, np.linalg.LinAlgError):
        return None


_NOISE_DEVIATIONS = 4.0
"""An effect of the noise is reported beyond so many standard deviations."""

_MOST_MODULUS_FACTOR = 5.0
"""Largest error of the stated E; beyond it a sign or a unit is wrong."""
_LEAST_CHANGE = 0.05
"""Share by which E must differ from the stated value to be said."""
_LEAST_NU = 0.02
_LEAST_LENGTH = 0.03
"""Share by which the length at rest must differ from the stated one to be said."""
_STEPS_TO_REST = 20
_RESTS = 1e-9
"""Last step to the rest over the length."""
_DEVIATIONS = 4.0
_QUIET = 0.5
"""Variance over the declared one below which the declared noise is called too large."""
_CHANCE = 1e-3
_FAR = 3.0
"""Error at the bound of nu, over the noise and over that beyond it, from which nu is wrong."""


def stated_numbers(problem: Problem, final: JointFit, family: bool = False) -> list[str]:
    """Return what these rows say of E, nu, length and noise where it is not what was stated.

    What follows a driver in a form that is not known scatters repeats as well.
    """
    said = (_elasticity(problem), _length(final), _beside_declared(problem, family))
    return [words for words in said if words]


def _length(final: JointFit) -> str:
    """Return that an energy rests at another length than the stated one.

    An energy of the wrong length fits as well, since its origin is shifted along the axis. But the
    straight body then carries no force at another length than the stated one.
    """
    base, stated = final.base, final.base.length_m
    if base.kind != "energy" or stated is None:
        return ""
    along = final.rows.table.column("x_m")
    # From within the rows: far outside an energy of high degree means nothing.
    rest = np.array([[np.median(along), 0.0, 0.0, 0.0, 0.0, 0.0]])
    for _ in range(_STEPS_TO_REST):
        wrench, stiffness = base.wrench_and_stiffness(rest)
        if not stiffness[0, 0, 0] > 0.0:
            return ""
        step = float(wrench[0, 0] / stiffness[0, 0, 0])
        rest[0, 0] -= step
        if not np.isfinite(step) or abs(step) < _RESTS * stated:
            break
    if not along.min() <= rest[0, 0] <= along.max():
        return ""
    terms = base.columns(rest)[0, 0]
    force_sd = np.sqrt(terms @ final.covariance[: len(terms), : len(terms)] @ terms)
    change, sd = float(rest[0, 0]) - stated, float(force_sd / stiffness[0, 0, 0])
    if abs(change) < max(_LEAST_LENGTH * stated, _DEVIATIONS * sd):
        return ""
    return (
        f"by these rows the straight body carries no force at a length of {rest[0, 0]:.4g} m, "
        f"stated as {stated:.4g} m: the length or the origin of the positions along the axis is "
        "likely wrong, or something pulls or presses on it"
    )


def _elasticity(problem: Problem) -> str:
    base = problem.base
    if not isinstance(base, PhysicsMap) or base.values is None:
        return ""
    stated, values = stated_body(base), base.values
    spread = dict(zip(base.free, np.sqrt(np.diag(problem.fit.covariance)), strict=False))

    def differs(name: str, own: float, least: float) -> bool:
        return name in base.free and abs(values[name] - own) >= max(
            least, _DEVIATIONS * float(spread[name])
        )

    parts, modulus, nu = [], stated.young_modulus_Pa, stated.poisson_ratio
    if differs("young_modulus_Pa", modulus, _LEAST_CHANGE * modulus):
        ratio = values["young_modulus_Pa"] / modulus
        parts.append(f"E is {ratio:.3g} times the stated {modulus:.3g} Pa")
    if differs("poisson_ratio", nu, _LEAST_NU):
        parts.append(f"nu is {values['poisson_ratio']:.3f}, stated as {nu:.3g}")
    return f"by these rows {' and '.join(parts)}" if parts else ""


def negative_payload(effects: Sequence[FittedEffect]) -> list[str]:
    """Return what a payload of less than nothing means."""
    said = []
    for item in effects:
        mass, sd = float(item.values[0]), float(item.sd[0])
        if item.id == "payload" and not item.effect.shape and mass + _DEVIATIONS * sd < 0.0:
            said.append(
                f"a payload of {mass:.3g} kg: it was taken off after the sensor's zero, or gravity "
                "points the other way ([scene] gravity_m_s2), or forces have the wrong sign"
            )
    return said


def _beside_declared(problem: Problem, family: bool) -> str:
    """Return that the noise of the repeats, or of what no column explains, is not as declared."""
    names = (*problem.base.inputs, *problem.base.outputs)
    declared = declared_noise(problem.table, names)
    if declared.source != "declared":
        return ""
    factor, mend = 1.0, "mend the figures in [instrument]"
    if problem.noise.source == "repeats":
        stated, seen = (
            noise.covariance(problem.rows)[problem.scored] for noise in (declared, problem.noise)
        )
        share = np.einsum("nii->n", np.linalg.solve(stated, seen)).mean()
        factor = float(share / stated.shape[1])
        cells = repeat_cells(problem.table)[problem.scored]
        dof = (len(cells) - len(np.unique(cells))) * problem.response.shape[1]
        chance = min(special.chdtr(dof, factor * dof), special.chdtrc(dof, factor * dof))
        # A drift or a friction scatters repeats too: what columns explain of them is no noise.
        least = factor * min(1.0, problem.scale)
        loud = least >= 1.0 / _QUIET and problem.scale >= _QUIET and not family
        if chance <= _CHANCE and (factor <= _QUIET or loud):
            times = f"{np.sqrt(factor):.2f} times as large as declared"
            return f"by the repeats the noise is {times}: {mend}"
    # The scale is over the noise and the base's own error, which may be less at these rows.
    factor, dof = factor * problem.scale, problem.scale_freedom
    share = 1.0 - problem.base_error**2
    if not dof or factor >= _QUIET * share or special.chdtr(dof, factor / share * dof) > _CHANCE:
        return ""
    factor /= share
    return f"the noise is {np.sqrt(factor):.2f} times as large as declared, or less: {mend}"


def modulus_warning(problem: Problem) -> str:
    """Return what is wrong with the factor on E of a physics base; empty where it may be true."""
    if not isinstance(problem.base, PhysicsMap):
        return ""
    factor, most = problem.base.factor, _MOST_MODULUS_FACTOR
    if 1.0 / most < factor < most:
        return ""
    ratio = f"the wrench is {factor:.3g} times that of the stated body"
    if factor < 0.0:
        return f"{ratio}: a sign is likely wrong"
    unit = unit_of_factor(factor)
    if unit:
        return f"{ratio}: a unit is likely wrong ({unit})"
    return f"{ratio}, which is no unit's factor: [mechanism] states another body"


def ratio_warning(problem: Problem) -> str:
    """Return that no Poisson's ratio fits; empty where one does, or something else is missing too.

    A rod's stiffnesses are stated one by one: a wrong ratio of them looks like a nu beyond 1/2.
    """
    base = problem.base
    if not isinstance(base, PhysicsMap) or base.values is None or "poisson_ratio" not in base.free:
        return ""
    low, high = (float(limit[base.free.index("poisson_ratio")]) for limit in base.bounds)
    nu = base.values["poisson_ratio"]
    if min(nu - low, high - nu) > 1e-6 * high:
        return ""
    beyond = np.sqrt(problem.squares_beside_base / problem.size)
    at_bound = np.sqrt(problem.squares_of(problem.response) / problem.size)
    if at_bound < _FAR * max(1.0, float(beyond)):
        return ""
    return (
        f"no Poisson's ratio from {low:.2f} to {high:.2f} fits: nu, or the ratio of the stated "
        "stiffnesses, shear and torsion against bending, is likely wrong"
    )


@dataclass(frozen=True)
class NoiseFinding:
    """One effect of the noise that the rows show, by its clearest parameter."""

    id: str
    parameter: str
    value: float
    unit: str
    z: float
    """Standard deviations of the score."""


def tested_noise(problem: Problem, effects: Sequence[Effect]) -> list[NoiseEffect]:
    """Return the noise effects that these data can test."""
    return [e for e in effects if isinstance(e, NoiseEffect) and e.id not in problem.untestable]


def noise_findings(problem: Problem, effects: Sequence[Effect]) -> list[NoiseFinding]:
    """Return the noise effects that are seen, the clearest first.

    Robust weights take the place of those without parameters.
    """
    tested = [effect for effect in tested_noise(problem, effects) if effect.parameters]
    if not tested:
        return []
    use = problem.scored & (problem.weights > 0.9)
    residual, unfitted = _residual(problem, use)
    whitener = problem.whitener.each[use]

    def found(effect: NoiseEffect, j: int) -> NoiseFinding:
        parameter = effect.parameters[j]
        unit = parameter.scale * np.eye(len(effect.parameters))[j]
        variance = effect.variance(problem.rows, unit)[use]
        z, square = _score(residual, unfitted, whitener @ variance @ np.swapaxes(whitener, 1, 2))
        value = parameter.scale * float(np.sqrt(square))
        return NoiseFinding(effect.id, parameter.name, value, parameter.unit, z)

    every = [found(effect, j) for effect in tested for j in range(len(effect.parameters))]
    best = best_of_each(every, [one.z for one in every])
    seen = [one for _, one in best.values() if one.z > _NOISE_DEVIATIONS]
    return sorted(seen, key=lambda one: -one.z)


def with_load_growth(noise: Noise, findings: Sequence[NoiseFinding]) -> Noise:
    """Return the noise with scatter that grows with the load, where that is seen most clearly."""
    if noise.components is not None or not findings or findings[0].id != "heteroscedastic_noise":
        return noise
    if findings[0].parameter == "force_growth":
        return replace(noise, growth_per_N=findings[0].value)
    return replace(noise, growth_per_Nm=findings[0].value)


def _residual(problem: Problem, use: B) -> tuple[F, F]:
    """Return (n, m) the residual that nothing explains, and (n, m, m) what the fit leaves of it."""
    n, m = problem.response.shape
    smooth = omnibus_columns(problem, max(1, n // 6))
    # The best shape of every effect: what it does not explain is noise, significant or not.
    matrix, vector, _ = problem.normal.total
    blocks = [one.columns for one in problem.offered]
    gains = explained_by_blocks(matrix, vector, problem.base_index, blocks)
    leading = best_of_each(problem.offered, gains.tolist())
    best = problem.design[:, :, [c for _, one in leading.values() for c in one.columns]]
    columns = np.concatenate([problem.base_block, best, smooth], axis=2)[use]
    del smooth, best  # as large as the columns
    basis = orthonormal(columns.reshape(-1, columns.shape[2]))
    y = problem.response[use].ravel()
    residual = (y - basis @ (basis.T @ y)).reshape(-1, m)
    own = basis.reshape(-1, m, basis.shape[1])
    return residual, np.eye(m) - own @ np.swapaxes(own, 1, 2)


def _score(residual: F, unfitted: F, effect_variance: F) -> tuple[float, float]:
    """Return z of U with the common scale estimated, and the parameter's square over its unit."""
    scale = float((residual**2).sum() / np.einsum("nii->", unfitted))
    # Without its part along a common scale.
    share = np.einsum("nij,nji->", effect_variance, unfitted) / np.einsum("nii->", unfitted)
    centred = effect_variance - share * np.eye(effect_variance.shape[1])
    product = centred @ unfitted
    score = float(np.einsum("ni,nij,nj->", residual, centred, residual)) / scale
    information = float(np.einsum("nij,nji->", product, product))
    if information <= 0.0:
        return 0.0, 0.0
    return score / float(np.sqrt(2.0 * information)), max(score / information, 0.0)
