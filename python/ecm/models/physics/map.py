"""The physics model: FEM of the mechanism as a map whose E and nu (and L and D) can be fitted.

h(p; E, nu, L, D) is a native energy whose coefficients follow from the parameters in closed form
(family.py). The FEM behind it runs once per shape (build.py) and is kept in the cache folder. `at`
gives the model with fixed parameters for a controller.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ecm._native import EcmError
from ecm.errors import ComputationError, InputError
from ecm.io.arrays import F, rms_of_columns
from ecm.io.cache import Stage, cache_directory, hash_of, write_atomically
from ecm.io.columns import POSE, WRENCH
from ecm.io.events import Progress, Steps
from ecm.io.mechanism import Mechanism
from ecm.io.sanity import likely_order
from ecm.io.se3 import ORDERS, read_in_other_order
from ecm.io.table import Table
from ecm.models.layout import plain
from ecm.models.maps import EnergyMap, EnergyTerms, SixAxisMap, finite
from ecm.models.physics.body_fits import MARGIN, ROTATION_LIMIT_RAD
from ecm.models.physics.build import (
    BuildSettings,
    build_family,
    mesh_difference,
    shape_of,
    stated_rod,
    usual_rotation_rad,
)
from ecm.models.physics.family import PARAMETERS, MeshDifference, PhysicsFamily, check_parameters
from ecm.regression.rows import BodyChange

_DEGREE = 6
BROUGHT = Path(__file__).parent / "brought"
"""Families that the package brings: that of the neck, the body of the demo and of the tutorial."""
_VERSION = 4
_MESH_VERSION = 2
_WIDE_VERSION = 2
"""Version of the poses of wide families: those that a load holds."""
_REACH_STEP = 0.2
_LEAST_REACH = 0.4
"""Reach of a mesh of one's own for poses that turn less; of the loads it has half."""
_MOST_REACH = 2.4
"""The neck reaches 2.4 rad in the whole box of Table I."""
_POSES_OF_A_MESH = 160
_POSES_OF_A_WIDE_FAMILY = 160
"""The energies of degree 8, which rotations beyond 1 rad need, have 157 terms at least."""
_USUAL = 0.98
"""Share of the poses that a family must hold; single ones far out are no reason for a FEM."""
_FURTHER, _FURTHEST = 1.5, 5.0
"""Shifts over those of the FEM poses from which a family of larger forces is built, in steps of the
same factor, and to which; a neck at 1.5 times errs by 1 %, a thick body by 2 to 4 %."""
FREE = ("young_modulus_Pa", "poisson_ratio")
"""Parameters that a refit changes by default; L and D stay as the file states them."""


@dataclass(frozen=True)
class PhysicsMap(SixAxisMap):
    """h(p) = factor * h0(p), h0 the energy `surrogate`; with a `family` also other nu, L and D.

    Without a family (fitted to given pairs, `surrogate_of`) only the factor on E is free.

    Examples
    --------
    >>> poses = np.random.default_rng(0).uniform(-0.01, 0.01, (60, 6)) + [0.1, 0, 0, 0, 0, 0]
    >>> wrenches = 1000.0 * (poses - [0.1, 0, 0, 0, 0, 0])
    >>> base = surrogate_of(poses, wrenches, 0.1, test_poses=poses, test_wrenches=wrenches)
    >>> stiffer = base.with_coefficients(np.array([2.0]))
    >>> bool(np.allclose(stiffer.predict(poses), 2.0 * base.predict(poses)))
    True
    """

    surrogate: EnergyMap
    own_error: F
    """(6,) root mean square error of the surrogate on FEM poses that it was not fitted to."""
    mechanism: dict[str, Any]
    """Table `[mechanism]` of the description."""
    factor: float = 1.0
    """E over that of `surrogate`."""
    family: PhysicsFamily | None = None
    values: Mapping[str, float] | None = None
    """E, nu, L, D by name, where there is a family; E includes the factor."""
    free: tuple[str, ...] = FREE
    """Names of the values that `coefficients` holds."""
    mesh: MeshDifference | None = None
    """What the size of the elements makes; None where there is no second mesh to compare with."""

    name = kind = "physics"

    @property
    def length_m(self) -> float:
        """Length of the mechanism."""
        return self.surrogate.length_m

    @property
    def reach_rad(self) -> float:
        """Largest rotation of the FEM poses behind it; infinite where it was fitted to pairs."""
        return math.inf if self.family is None else float(self.family.scale[1])

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the coefficients; `factor` on E without a family."""
        return ("factor",) if self.family is None else self.free

    @property
    def coefficients(self) -> F:
        """(k,) free values; the factor on E without a family."""
        if self.values is None:
            return np.array([self.factor])
        return np.array([self.values[name] for name in self.free])

    @property
    def bounds(self) -> tuple[F, F]:
        """(k,) lower and upper limits of the coefficients: the tabulated range."""
        if self.family is None or self.values is None:
            return np.full(1, -np.inf), np.full(1, np.inf)
        limits = self.family.bounds(self.values)
        low, high = zip(*(limits[name] for name in self.free), strict=True)
        return np.array(low), np.array(high)

    @property
    def error(self) -> F:
        """The surrogate's own error, scaled like its wrench."""
        return abs(self.factor) * self.own_error

    def error_columns(self, poses: F) -> F:
        """(N, 6, 1) wrench of the standard mesh less that of the fine one; (N, 6, 0): not known."""
        if self.mesh is None or self.values is None:
            return super().error_columns(poses)
        return self.mesh.at(self.values).predict(poses)[:, :, None]

    @property
    def mesh_shares(self) -> dict[str, float] | None:
        """Share of each wrench component by which the standard mesh differs from the fine one.

        At rest; None where there is no second mesh to compare with.
        """
        if self.mesh is None or self.values is None:
            return None
        shares = self.mesh.shares(self.values, self.at())
        return dict(zip(WRENCH, shares.tolist(), strict=True))

    def predict(self, poses: F) -> F:
        """(N, 6) poses to (N, 6) wrenches."""
        return finite("the prediction", lambda: self.factor * self.surrogate.predict(poses))

    def stiffness(self, poses: F, kind: str = "partial") -> F:
        """(N, 6, 6) stiffness."""
        return finite("the stiffness", lambda: self.factor * self.surrogate.stiffness(poses, kind))

    def wrench_and_stiffness(self, poses: F, kind: str = "partial") -> tuple[F, F]:
        """(N, 6) wrenches and (N, 6, 6) stiffnesses."""
        wrench, stiffness = self.surrogate.wrench_and_stiffness(poses, kind)
        return (
            finite("the prediction", lambda: self.factor * wrench),
            finite("the stiffness", lambda: self.factor * stiffness),
        )

    def columns(self, poses: F) -> F:
        """(N, 6, k) derivative to the coefficients."""
        if self.family is None:
            return np.asarray(self.surrogate.predict(poses)[:, :, None])
        return np.stack([self.sensitivity(poses, name) for name in self.free], axis=2)

    def sensitivity(self, poses: F, name: str) -> F:
        """(N, 6) derivative of the wrench to one parameter at fixed poses (N, 6).

        The parameters are young_modulus_Pa, poisson_ratio, length_m and diameter_m (all transverse
        dimensions in proportion).
        """
        family, values = self._tabulated()
        return family.derivative(values, name).predict(poses)

    def at(self, **changed: float) -> EnergyMap:
        """The energy with these parameters fixed, the others as they are."""
        family, values = self._tabulated()
        check_parameters(changed)
        chosen = {**values, **changed}
        family.check(chosen)
        return family.at(chosen)

    def other_body(self, change: BodyChange) -> EnergyMap | None:
        """The energy of changed E, nu, L, D, also beyond what was tabulated.

        None without a family.
        """
        if self.family is None or self.values is None:
            return None
        return self.family.at(change(dict(self.values)))

    def with_free(self, *names: str) -> PhysicsMap:
        """The same map with these parameters as coefficients."""
        self._tabulated()
        check_parameters(names)
        return replace(self, free=tuple(dict.fromkeys(names)))

    def with_coefficients(self, coefficients: F) -> PhysicsMap:
        """The same map with other values of the coefficients."""
        family, old = self.family, self.values
        if family is None or old is None:
            return replace(self, factor=float(coefficients[0]))
        values = {**old, **dict(zip(self.free, map(float, coefficients), strict=True))}
        if all(values[name] == old[name] for name in PARAMETERS[1:]):
            ratio = values["young_modulus_Pa"] / old["young_modulus_Pa"]
            return replace(self, values=values, factor=self.factor * ratio)
        own = old["young_modulus_Pa"] / self.factor
        stated = {**values, "young_modulus_Pa": own}
        return replace(
            self,
            surrogate=family.at(stated),
            own_error=family.own_error(stated, diameter="diameter_m" in self.free),
            factor=values["young_modulus_Pa"] / own,
            values=values,
        )

    def _tabulated(self) -> tuple[PhysicsFamily, Mapping[str, float]]:
        if self.family is None or self.values is None:
            raise InputError(
                "this physics model has fixed nu, L and D, because it was fitted to given pairs: "
                "build it from a [mechanism] (physics_map)"
            )
        return self.family, self.values

    def document(self) -> dict[str, Any]:
        """Surrogate, factor, family and mechanism for a model file."""
        document = {
            **self.surrogate.document(),
            "kind": "physics",
            "name": "physics",
            "factor": self.factor,
            "own_error": self.own_error.tolist(),
            "mechanism": self.mechanism,
        }
        if self.mesh is not None:
            document["mesh_difference"] = plain(self.mesh)
        if self.family is not None and self.values is not None:
            document["parameters"] = dict(self.values)
            document["free"] = list(self.free)
            document["family"] = plain(self.family)
        return document

    @staticmethod
    def from_document(document: dict[str, Any]) -> PhysicsMap:
        """The map of an opened model file."""
        known: dict[str, Any] = {}
        if "mesh_difference" in document:
            known["mesh"] = MeshDifference.from_dict(document["mesh_difference"])
        if "family" in document:
            values = {name: float(document["parameters"][name]) for name in PARAMETERS}
            known["family"] = PhysicsFamily.from_dict(document["family"])
            known["values"] = values
            known["free"] = tuple(document["free"])
        return PhysicsMap(
            surrogate=EnergyMap.from_document(document),
            own_error=np.asarray(document["own_error"], dtype=np.float64),
            mechanism=dict(document["mechanism"]),
            factor=float(document["factor"]),
            **known,
        )


def surrogate_of(
    poses: F,
    wrenches: F,
    length_m: float,
    *,
    test_poses: F,
    test_wrenches: F,
    mechanism: dict[str, Any] | None = None,
) -> PhysicsMap:
    """A physics map from poses and wrenches without noise, its error from other ones.

    Parameters
    ----------
    poses, wrenches
        (N, 6) in m and rad, (N, 6) in N and N m.
    length_m
        Length of the mechanism.
    test_poses, test_wrenches
        Pairs that the map is not fitted to; they give its own error.
    mechanism
        Table `[mechanism]` to keep with the map.

    Examples
    --------
    >>> poses = np.random.default_rng(0).uniform(-0.01, 0.01, (60, 6)) + [0.1, 0, 0, 0, 0, 0]
    >>> wrenches = 1000.0 * (poses - [0.1, 0, 0, 0, 0, 0])
    >>> base = surrogate_of(poses, wrenches, 0.1, test_poses=poses, test_wrenches=wrenches)
    >>> base.name, base.coefficients.tolist()
    ('physics', [1.0])
    """
    surrogate = EnergyTerms(length_m, _DEGREE).fit(poses, wrenches)
    error = rms_of_columns(surrogate.predict(test_poses) - test_wrenches)
    return PhysicsMap(surrogate, error, {} if mechanism is None else dict(mechanism))


def physics_map(
    mechanism: Mechanism,
    *,
    threads: int = 0,
    cache: Path | None = None,
    progress: Progress | None = None,
    settings: BuildSettings | None = None,
    reach_rad: float = 0.0,
    poses: F | None = None,
) -> PhysicsMap:
    """The physics map of a mechanism; its family is built once per shape and kept in `cache`.

    Parameters
    ----------
    mechanism
        A body: `builtin` with its dimensions, or a mesh, and its material.
    threads
        Threads of the FEM, 0 for all cores.
    cache
        Default `ECM_CACHE`, else `XDG_CACHE_HOME/ecm`, else `~/.cache/ecm`. An interrupted build
        continues there.
    progress
        Called with the number of solved poses, the number of all, and a word, during the build.
    settings
        Numbers of FEM poses; the default fits the kind of body.
    reach_rad
        Largest rotation of the poses to predict; beyond 0.88 rad, of a body thicker than long
        less, a wider family of more poses is built, which takes twice as long.
    poses
        (N, 6) m and rad, to predict: what 98 % of them do not exceed is the reach. Where they are
        pulled, pressed or pushed aside far beyond the FEM of the usual loads, a family of larger
        forces is built as well.

    Raises
    ------
    InputError
        Where the mechanism has no body.
    ComputationError
        Where too few poses have a stable state.

    Examples
    --------
    >>> try:
    ...     physics_map(Mechanism(builtin="", length_m=0.1))
    ... except InputError as error:
    ...     print(str(error)[:31])
    the physics model needs a body:
    """
    if not mechanism.has_body:
        raise InputError(
            "the physics model needs a body: give [mechanism] builtin with its dimensions, or "
            "mesh, and young_modulus_Pa"
        )
    kept = _Kept.of(mechanism, settings, max(reach_rad, _turned(poses)), cache)
    family = kept.built(threads, progress)
    if (further := kept.further(family, poses, mechanism.checked_length_m())) is not None:
        # Where too few such poses have a stable state, predictions say what they are beyond.
        with suppress(ComputationError):
            more = Steps({"usual": 100, "larger forces": 100}, progress).within("larger forces")
            kept, family = further, further.built(threads, more)
    return _map_of(mechanism, family, kept.mesh(family, threads=threads, progress=progress))


def kept_physics(
    mechanism: Mechanism, *, cache: Path | None = None, poses: F | None = None
) -> PhysicsMap | None:
    """The same of a FEM that ran before; None where it would have to run, which takes minutes.

    Where only that of larger forces did not run, or its states are not stable, the usual one.

    Examples
    --------
    >>> kept_physics(Mechanism(radius_m=0.0271), cache=Path("no such folder")) is None
    True
    """
    kept = _Kept.of(mechanism, None, _turned(poses), cache)
    family = kept.family()
    if family is None:
        return None
    further = kept.further(family, poses, mechanism.checked_length_m())
    if further is not None and (far := further.family()) is not None:
        kept, family = further, far
    return _map_of(mechanism, family, kept.mesh(family, build=False))


@dataclass(frozen=True)
class _Kept:
    """Where the family of a body is kept, and what it is made of."""

    shape: Mechanism
    settings: BuildSettings
    directory: Path
    key: dict[str, Any]

    @classmethod
    def of(
        cls,
        mechanism: Mechanism,
        settings: BuildSettings | None,
        reach_rad: float,
        cache: Path | None,
    ) -> _Kept:
        """Choose numbers of poses by the kind of body and by how far its poses reach."""
        shape = shape_of(mechanism)
        usual = usual_rotation_rad(shape)
        own_mesh = mechanism.mesh_file is not None and settings is None
        near = math.ceil(reach_rad / MARGIN / _REACH_STEP) * _REACH_STEP
        if own_mesh and 0.0 < near < usual:
            # Far poses, which nobody asks for, take FEM longest: many have no stable state.
            usual = min(usual, max(near, _LEAST_REACH))
        if settings is None:
            # A mesh of a user may have no symmetry, and then ten times the terms.
            poses = _POSES_OF_A_MESH if own_mesh else BuildSettings.poses
            settings = BuildSettings(poses=poses, rotation_limit_rad=usual)
        if reach_rad > MARGIN * settings.rotation_limit_rad:
            # In steps of 0.2 rad, so that campaigns of similar reach share a family.
            wider = _REACH_STEP * math.ceil(min(reach_rad, _MOST_REACH) / MARGIN / _REACH_STEP)
            few = settings.poses if wider <= ROTATION_LIMIT_RAD else _POSES_OF_A_WIDE_FAMILY
            poses = max(settings.poses, few)
            settings = replace(settings, rotation_limit_rad=wider, poses=poses)
        key = {"version": _VERSION, "shape": shape.key(), "settings": settings}
        if settings.rotation_limit_rad > usual:
            key["wide"] = _WIDE_VERSION
        if usual < ROTATION_LIMIT_RAD:
            key["usual_rad"] = usual
        return cls(shape, settings, cache_directory() if cache is None else cache, key)

    def further(self, family: PhysicsFamily, poses: F | None, length_m: float) -> _Kept | None:
        """Where a family of larger forces is kept; None where this one holds the poses (N, 6).

        What no such body can do is an error of the table, and no reason for a FEM.
        """
        if poses is None or not np.isfinite(poses).all():
            return None
        along, across = family.shifted(poses, length_m).T
        rest = 0.5 * (1.0 - _USUAL)
        ends = np.abs(np.quantile(along, [rest, 1.0 - rest]))
        times = np.array([ends.max(), np.quantile(across, _USUAL)])
        if not _FURTHER < times.max() <= _FURTHEST:
            return None
        steps = np.ceil(np.log(np.maximum(times, 1.0)) / np.log(_FURTHER)) * (times > _FURTHER)
        return replace(self, key=self.key | {"more_force": (_FURTHER**steps).tolist()})

    def built(self, threads: int, progress: Progress | None) -> PhysicsFamily:
        """The family, which is solved by FEM where it is not there."""
        if (family := self.family()) is not None:
            return family
        stage = Stage(self.directory, "physics-bodies", self.key)
        family = build_family(
            self.shape,
            self.settings,
            more_force=tuple(self.key.get("more_force", (1.0, 1.0))),
            stage=stage,
            threads=threads,
            progress=progress,
        )
        _write(self.path, plain(family))
        stage.forget_parts()
        return family

    @property
    def path(self) -> Path:
        """File of the family in the cache."""
        return self.directory / f"physics-{hash_of(self.key)[:32]}.json"

    def family(self) -> PhysicsFamily | None:
        """The family of the cache, else the one that the package brings; None without both."""
        return _read(self.path) or _read(BROUGHT / self.path.name)

    def mesh(
        self,
        family: PhysicsFamily,
        *,
        build: bool = True,
        threads: int = 0,
        progress: Progress | None = None,
    ) -> MeshDifference | None:
        """The difference of two meshes, kept beside the family; the same for both qualities.

        Where it is not there and not to be built: None.
        """
        shape = replace(self.shape, quality="standard").key()
        key = {"version": _MESH_VERSION, "shape": shape, "symmetry": family.symmetry}
        name = f"mesh-{hash_of(key)[:32]}.json"
        for folder in (self.directory, BROUGHT):
            with suppress(OSError, ValueError, TypeError, KeyError, EcmError):
                kept = json.loads((folder / name).read_text(encoding="utf-8"))["mesh_difference"]
                return None if kept is None else MeshDifference.from_dict(kept)
        if not build:
            return None
        found = mesh_difference(self.shape, family.symmetry, threads=threads, progress=progress)
        kept = None if found is None else plain(found)
        _write(self.directory / name, {"mesh_difference": kept})
        return found


def _map_of(mechanism: Mechanism, family: PhysicsFamily, mesh: MeshDifference | None) -> PhysicsMap:
    length = mechanism.checked_length_m()
    stated = stated_rod(mechanism) if mechanism.builtin == "rod" else mechanism
    values = {
        "young_modulus_Pa": stated.young_modulus_Pa,
        "poisson_ratio": mechanism.poisson_ratio,
        "length_m": length,
        "diameter_m": family.centre[1] * length,
    }
    return PhysicsMap(
        surrogate=family.at(values),
        own_error=family.own_error(values),
        mechanism=mechanism.to_dict(),
        family=family,
        values=values,
        mesh=mesh,
    )


def _turned(poses: F | None) -> float:
    """Rotation, rad, that 98 % of poses (N, 6) do not exceed."""
    if poses is None:
        return 0.0
    return float(np.quantile(np.linalg.norm(poses[:, 3:], axis=1), _USUAL))


def poses_meant(table: Table) -> F | None:
    """(N, 6) poses of a table for `physics_map`; None without rotation columns.

    Where positions lack, they are nan and only turns count. Of quaternions that were read in the
    wrong order, in the right one: no FEM shall run for half turns that never were.
    """
    if not table.has(*POSE[3:]):
        return None
    poses = np.full((len(table), 6), np.nan)
    poses[:, 3:] = table.matrix(POSE[3:])
    if table.has(*POSE[:3]):
        poses[:, :3] = table.matrix(POSE[:3])
    if meant := likely_order(poses[:, 3:]):
        poses[:, 3:] = read_in_other_order(poses[:, 3:], ORDERS[meant])
    return poses


def _read(path: Path) -> PhysicsFamily | None:
    """A cached family; None where there is none or it cannot be read."""
    try:
        return PhysicsFamily.from_dict(json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, KeyError, TypeError, EcmError):
        return None


def _write(path: Path, document: dict[str, Any]) -> None:
    """Write to the cache; one that cannot be written only costs time."""
    with suppress(OSError):
        write_atomically(path, json.dumps(document))
