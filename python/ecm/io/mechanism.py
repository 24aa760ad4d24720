"""The mechanism: shape and material of the elastic body, and the mesh, FEM and rod made of it."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from ecm._native import Fem, FemError, Mesh, material_models, material_moduli, material_stress
from ecm.errors import InputError
from ecm.io.arguments import path_of
from ecm.io.arrays import F
from ecm.io.cache import hash_of
from ecm.io.events import Printed
from ecm.io.mesh import SIZES, mesh_bytes, read_mesh
from ecm.io.settings import Checked, check_keys, did_you_mean, read_settings, setting

TESTS = ("uniaxial", "equibiaxial", "pure_shear")
"""The classical tests of a material."""
COMMON = ("bulk_modulus_Pa", "poisson_ratio", "fibre_direction", "fibre_k1_Pa", "fibre_k2")
"""Parameters that every model takes."""
MODELS = {name: tuple(parameters) for name, parameters, _ in material_models()}
"""The own parameters of each material model, as `[mechanism] material` names them."""
WITH_TERMS = {name for name, _, has_terms in material_models() if has_terms}
"""Models whose parameters are lists with one number per term."""


@dataclass(frozen=True)
class Material:
    """A material model with its parameters, as in `[mechanism] material = { model = "yeoh", ... }`.

    Parameters
    ----------
    model
        A name of `MODELS`, for example neo_hookean or yeoh (docs/fem.md).
    parameters
        Values by name (docs/fem.md), moduli in Pa. Every model also takes `bulk_modulus_Pa` or
        `poisson_ratio` (default 0.49) and one family of fibres.

    Raises
    ------
    InputError
        For an unknown model, and for a parameter that is unknown, missing, no number or out of its
        bounds.

    Examples
    --------
    >>> rubber = Material("mooney_rivlin", {"c10_Pa": 8e4, "c01_Pa": 3e4})
    >>> round(rubber.shear_modulus_Pa), round(rubber.young_modulus_Pa)
    (220000, 655600)
    >>> rubber.nominal_stress("uniaxial", np.array([1.0, 1.5])).round()
    array([     0., 211111.])
    """

    model: str
    parameters: Mapping[str, float | list[float]]

    def __post_init__(self) -> None:
        if self.model not in MODELS:
            raise InputError(f"material model = '{self.model}': {did_you_mean(self.model, MODELS)}")
        own = MODELS[self.model]
        check_keys(self.parameters, (*own, *COMMON), f"material '{self.model}'")
        for name in own:
            if name not in self.parameters:
                raise InputError(f"material '{self.model}': the key '{name}' is missing")
        for name, value in self.parameters.items():
            for number in value if isinstance(value, (list, tuple)) else (value,):
                if isinstance(number, bool) or not isinstance(number, (int, float)):
                    raise InputError(
                        f"material '{self.model}': {name} = {value!r}: expected a number or a "
                        "list of numbers"
                    )
        try:
            material_moduli(self.model, self.parameters)
        except FemError as error:
            raise InputError(f"material '{self.model}': {error}") from None

    @staticmethod
    def from_dict(table: Mapping[str, Any]) -> Material:
        """Read a table with `model` and its parameters."""
        parameters = {key: value for key, value in table.items() if key != "model"}
        return Material(str(table.get("model", "neo_hookean")), parameters)

    def to_dict(self) -> dict[str, Any]:
        """Return the table that gives this material back."""
        return {"model": self.model, **self.parameters}

    @property
    def poisson_ratio(self) -> float:
        """Poisson's ratio at small strain; 0.49 where neither it nor a bulk modulus is given."""
        if "bulk_modulus_Pa" not in self.parameters:
            return float(self.parameters.get("poisson_ratio", 0.49))  # type: ignore[arg-type]
        mu, kappa = self._moduli_Pa()
        return (3.0 * kappa - 2.0 * mu) / (6.0 * kappa + 2.0 * mu)

    @property
    def shear_modulus_Pa(self) -> float:
        """Shear modulus of the matrix at small strain."""
        return self._moduli_Pa()[0]

    @property
    def young_modulus_Pa(self) -> float:
        """Young's modulus of the matrix at small strain."""
        return 2.0 * self.shear_modulus_Pa * (1.0 + self.poisson_ratio)

    def scaled(self, factor: float) -> Material:
        """Return the material with all moduli times `factor`."""

        def scale(name: str, value: float | list[float]) -> float | list[float]:
            if not name.endswith("_Pa"):
                return value
            return [factor * v for v in value] if isinstance(value, list) else factor * value

        return Material(self.model, {k: scale(k, v) for k, v in self.parameters.items()})

    def nominal_stress(self, mode: str, stretch: F) -> F:
        """Return the force per undeformed area, Pa, of the incompressible solid without fibres.

        Parameters
        ----------
        mode
            uniaxial, equibiaxial or pure_shear.
        stretch
            (N,) stretches in the pulled direction, 1 where undeformed.
        """
        if mode not in TESTS:
            raise InputError(f"mode = '{mode}': {did_you_mean(mode, TESTS)}")
        if np.any(stretch <= 0.0):
            raise InputError(f"stretch = {np.min(stretch)}: expected above 0 (1 is undeformed)")
        stretch = np.ascontiguousarray(stretch, dtype=float)
        return material_stress(self.model, self._without_fibres(), mode, stretch)

    def _moduli_Pa(self) -> tuple[float, float]:
        return material_moduli(self.model, self._without_fibres())

    def _without_fibres(self) -> dict[str, float | list[float]]:
        return {k: v for k, v in self.parameters.items() if not k.startswith("fibre_")}


ROD_SECTIONS = (
    "axial_stiffness_N",
    "shear_stiffness_N",
    "bending_stiffness_Nm2",
    "torsion_stiffness_Nm2",
)
"""EA, GA (with shear correction), EI, GJ; also keys of `[mechanism]` and arguments of the rod."""

_SHAPES: dict[str, tuple[Callable[..., Mesh], tuple[str, ...]]] = {
    "cylinder": (Mesh.cylinder, ("radius_m",)),
    "tube": (Mesh.tube, ("radius_m", "inner_radius_m")),
    "hourglass": (Mesh.hourglass, ("radius_m", "waist_radius_m")),
    "stacked_discs": (Mesh.stacked_discs, ("radius_m", "waist_radius_m", "disc_count")),
    "rod": (Mesh.cylinder, ("radius_m",)),
    "chambered": (
        Mesh.chambered,
        (
            "radius_m",
            "chamber_count",
            "chamber_inner_m",
            "chamber_outer_m",
            "chamber_angle_rad",
            "channel_radius_m",
            "end_wall_m",
        ),
    ),
}
"""Builtin shapes: their mesh, and the dimensions that it needs besides the length."""
_DIMENSIONS = {shape: dimensions for shape, (_, dimensions) in _SHAPES.items()}
_MAY_BE_ZERO = ("chamber_angle_rad", "channel_radius_m", "end_wall_m")
"""Dimensions that a shape may leave out."""
_LOWEST_MODULUS_PA = 100.0
RUBBER_PA = (1e4, 1e8)
"""Young's moduli of rubber, silicone and soft foam."""
_LENGTHS_M = (1e-3, 10.0)
_ENOUGH_NODES = 5000
"""The neck's mesh of 3255 errs by half a per cent; the time grows like the nodes^1.8."""
_SAME_LENGTH = 0.01
"""Largest share by which a stated length may differ from that of the mesh."""
_LARGEST_RADIUS = 10.0
"""Largest radius over the length: a larger one was probably given in another unit."""

SOLVER_VERSION = 4
"""Increased with every change of the FEM's results, so that cached ones are solved again.
2: bulk stiffness at distorted points. 3: a batch of poses starts from the tangent at rest (within
1.3e-6 N of 2). 4: a loss of stability is bracketed on one branch and judged by K_s."""


@dataclass(frozen=True)
class Tendon(Checked):
    """A thread that is pulled, straight between its points in the undeformed body, base frame, m.

    Examples
    --------
    >>> Tendon(base_m=((0.0, 0.02, 0.0),), platform_m=((0.1, 0.02, 0.0),)).points
    2
    """

    base_m: tuple[tuple[float, ...], ...] = setting((), any_size=True)
    """Points that the base carries, first to last."""
    body_m: tuple[tuple[float, ...], ...] = setting((), any_size=True)
    """Points within the body, after those of the base."""
    platform_m: tuple[tuple[float, ...], ...] = setting((), any_size=True)
    """Points that the platform carries, last."""

    def _check_together(self) -> None:
        for field in fields(self):
            for point in getattr(self, field.name):
                if len(point) != 3:
                    raise InputError(f"{field.name}: found {list(point)}, expected [x, y, z] in m")
        if self.points < 2:
            raise InputError(f"a tendon has {self.points} points: expected 2 or more")

    @property
    def points(self) -> int:
        """Number of points."""
        return len(self.base_m) + len(self.body_m) + len(self.platform_m)


@dataclass(frozen=True, repr=False)
class Mechanism(Checked, Printed):
    """An elastic body between two rigid plates. The default is the neck of the paper.

    Its shape is `builtin` with its dimensions, or a mesh or CAD file. Its material is neo-Hookean,
    or another model as `material`. Each field states its meaning, unit and range.

    Raises
    ------
    InputError
        For a value out of its range, and for dimensions that do not fit each other.

    Examples
    --------
    >>> neck = Mechanism(length_m=0.1034, radius_m=0.033, young_modulus_Pa=0.65e6)
    >>> stiffness = neck.fem().rest_stiffness()    # (6, 6), N/m, N, N m/rad
    >>> round(float(stiffness[1, 1]), -2)
    3600.0
    >>> round(neck.rod_sections()["bending_stiffness_Nm2"], 3)
    0.605
    >>> Mechanism(builtin="tube", inner_radius_m=0.02)
    Mechanism(builtin='tube', length_m=0.1034, radius_m=0.033, inner_radius_m=0.02, \
young_modulus_Pa=650000.0, poisson_ratio=0.49)
    """

    builtin: str = setting("cylinder", choices=("", *_SHAPES))
    """Shape; empty: that of a mesh, or only the length is known."""
    length_m: float = setting(0.1034, low=_LENGTHS_M[0], high=_LENGTHS_M[1])
    """Undeformed length in metres, not millimetres; mesh and CAD files at real size."""
    radius_m: float = setting(0.033, low=0.0)
    """Outer radius; of an hourglass at its ends."""
    inner_radius_m: float = setting(0.0, low=0.0)
    """Inner radius of a tube."""
    waist_radius_m: float = setting(0.0, low=0.0)
    """Smallest radius, of an hourglass or stacked discs."""
    disc_count: int = setting(0, low=0)
    """Number of stacked discs, the half ones at both ends included."""
    chamber_count: int = setting(0, low=0, high=12)
    """Number of chambers round the axis of `chambered`."""
    chamber_inner_m: float = setting(0.0, low=0.0)
    """Smallest distance of a chamber from the axis."""
    chamber_outer_m: float = setting(0.0, low=0.0)
    """Largest distance of a chamber from the axis."""
    chamber_angle_rad: float = setting(0.0, low=0.0)
    """Angle of a chamber; 0: round ones."""
    channel_radius_m: float = setting(0.0, low=0.0)
    """Radius of a channel along the axis; 0: none."""
    end_wall_m: float = setting(0.0, low=0.0)
    """Wall at both ends; 0: base and platform close the chambers."""
    tendon_count: int = setting(0, low=0, high=12)
    """Number of tendons round the axis, the first towards y."""
    tendon_offset_m: float = setting(0.0, low=0.0)
    """Their distance from the axis."""
    tendon_guides: int = setting(0, low=0, high=100)
    """Points of the body that each of them passes; 0: free between base and platform."""
    tendons: tuple[Tendon, ...] = setting((), any_size=True)
    """Tendons along points of their own."""
    winding_stiffness_N_m: float = setting(0.0, low=0.0)
    """E A of a thread over the distance of the threads, N/m; 0: no winding on a surface."""
    winding_stiffness_Pa: float = setting(0.0, low=0.0)
    """E of the threads times their share of the volume; 0: no winding through a region."""
    winding_angle_rad: float = setting(0.0, low=-0.5 * math.pi, high=0.5 * math.pi)
    """Angle of the threads from the direction round the surface, right-handed; 0: rings."""
    winding_second_angle_rad: float | None = setting(None, low=-0.5 * math.pi, high=0.5 * math.pi)
    """Angle of the second family of threads; without it the first one's, left-handed."""
    winding_on: str = setting("chambers")
    """Where the threads lie: chambers, outside, a surface or region of the mesh file, or body."""
    young_modulus_Pa: float = setting(0.65e6, low=0.0)
    """E at small strain; 0: unknown."""
    poisson_ratio: float = setting(0.49, low=0.0, high=0.5)
    """0.49 for rubber."""
    material: Material | None = setting(None)
    """Another law than neo-Hookean; E and nu are then its values at small strain."""
    density_kg_m3: float = setting(0.0, low=0.0)
    """Density; 0: own weight is ignored."""
    free_length_m: float = setting(0.0, low=0.0)
    """Length when detached; 0: same as length_m."""
    mesh_file: Path | None = setting(None)
    """Mesh or CAD file with faces `base` and `top` in place of builtin; in TOML: mesh."""
    quality: str = setting("standard", choices=tuple(SIZES))
    """Element size of builtin shapes and of CAD."""
    axial_stiffness_N: float = setting(0.0, low=0.0)
    """EA of a rod; 0: from radius and E."""
    shear_stiffness_N: float = setting(0.0, low=0.0)
    """GA of a rod with its shear correction."""
    bending_stiffness_Nm2: float = setting(0.0, low=0.0)
    """EI of a rod."""
    torsion_stiffness_Nm2: float = setting(0.0, low=0.0)
    """GJ of a rod."""

    def __repr__(self) -> str:
        """What differs from the default, and numbers that are not 0: it creates the same again."""
        pairs = [(item, getattr(self, item.name)) for item in fields(self)]
        shown = [
            f"{item.name}={value!r}"
            for item, value in pairs
            if value != item.default or (isinstance(value, float) and value)
        ]
        return f"{type(self).__name__}({', '.join(shown)})"

    def __post_init__(self) -> None:
        self._complete()
        super().__post_init__()
        if self.builtin and self.mesh_file is not None:
            raise InputError("found both builtin and mesh: give one of them")
        if 0.0 < self.young_modulus_Pa < _LOWEST_MODULUS_PA:
            modulus = self.young_modulus_Pa
            raise InputError(f"young_modulus_Pa = {modulus}: looks like MPa; give Pa (0.65e6)")
        if self.tendon_count and not self.tendon_offset_m > 0.0:
            raise InputError("tendon_count needs tendon_offset_m: their distance from the axis, m")
        if self.builtin:
            self._check_dimensions()

    def _complete(self) -> None:
        """Take shape and length from the mesh, E and nu from the law; the defaults are the neck's.

        A file may be given as text, and a law as a table.
        """
        law: Any = self.material
        path: Any = self.mesh_file
        if isinstance(law, Mapping):
            law = Material.from_dict(law)
        if isinstance(path, str):
            path = path_of(path)
        values: dict[str, Any] = {"material": law, "mesh_file": path}
        if isinstance(law, Material):
            values |= {name: getattr(law, name) for name in ("young_modulus_Pa", "poisson_ratio")}
        if isinstance(path, Path) and self.builtin == Mechanism.builtin:
            values |= {"builtin": "", "radius_m": 0.0}
            if self.length_m == Mechanism.length_m:
                values["length_m"] = _mesh_length(path, {"quality": self.quality})
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def _check_dimensions(self) -> None:
        """Compare dimensions of a builtin shape with each other."""
        length, outer = self.length_m, self.radius_m
        if self.builtin != "rod" and outer <= 0.0:
            raise InputError(f"radius_m = {outer}: expected a positive radius in metres")
        if outer > _LARGEST_RADIUS * length:
            raise InputError(f"radius_m = {outer}, length_m = {length}: expected metres for both")
        if self.builtin == "tube" and not 0.0 < self.inner_radius_m < outer:
            inner = self.inner_radius_m
            raise InputError(
                f"inner_radius_m = {inner}: expected above 0 and below radius_m = {outer}"
            )
        if self.builtin == "stacked_discs" and not 2 <= self.disc_count <= 40:
            raise InputError(f"disc_count = {self.disc_count}: expected 2 to 40")
        waisted = "waist_radius_m" in _DIMENSIONS[self.builtin]
        if waisted and not 0.0 < self.waist_radius_m <= outer:
            waist = self.waist_radius_m
            raise InputError(
                f"waist_radius_m = {waist}: expected above 0, at most radius_m = {outer}"
            )

    @staticmethod
    def from_dict(
        table: Mapping[str, Any], where: str | Path = "[mechanism]", *, base: Path | None = None
    ) -> Mechanism:
        """Read a `[mechanism]` table.

        Parameters
        ----------
        table
            Keys and values of the TOML table.
        where
            File (a path) or table (text) for messages; a relative mesh file is looked for beside
            the file.
        base
            Directory of a relative mesh file, where `where` is text.

        Raises
        ------
        InputError
            Naming the table, the key, what was found and what was expected.
        """
        place = f"{where} [mechanism]" if isinstance(where, Path) else where
        if base is None:
            base = where.parent if isinstance(where, Path) else Path()
        if not isinstance(table, Mapping):
            raise InputError(f"{place}: found {table!r}, expected a table of settings")
        check_keys(table, MECHANISM_KEYS, place)
        # The neck's dimensions are no defaults of another body.
        values: dict[str, Any] = {"builtin": "", "radius_m": 0.0, "young_modulus_Pa": 0.0}
        values |= {key: table[key] for key in table if key not in ("mesh", "material")}
        values |= _read_material(table, place)
        if "mesh" in table:
            if not isinstance(table["mesh"], str):
                raise InputError(f"{place}: mesh = {table['mesh']!r}: expected a file name")
            if values["builtin"]:
                raise InputError(f"{place}: found both builtin and mesh: give one of them")
            values["mesh_file"] = str(base / table["mesh"])
        if not values["builtin"]:
            if "mesh" in table and "length_m" not in table:
                values["length_m"] = _mesh_length(Path(values["mesh_file"]), table)
            if "length_m" not in values:
                raise InputError(f"{place}: the key 'length_m' is missing; every model needs it")
        elif values["builtin"] in tuple(_DIMENSIONS):
            _require_dimensions(table, place)
        material = values.pop("material", None)
        return replace(read_settings(Mechanism, values, place), material=material)

    def to_dict(self) -> dict[str, Any]:
        """Return the `[mechanism]` table of this mechanism."""
        always = {"length_m", "builtin", "young_modulus_Pa", "poisson_ratio"}
        always |= set(_DIMENSIONS.get(self.builtin, ()))
        table: dict[str, Any] = {}
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, Material):
                table["material"] = value.to_dict()
                del table["young_modulus_Pa"], table["poisson_ratio"]
            elif isinstance(value, Path):
                table["mesh"] = str(value)
            elif field.name == "tendons":
                if value:
                    table["tendons"] = [asdict(tendon) for tendon in value]
            elif (value or (value == 0.0 and field.default is None)) and (
                field.name in always or value != field.default
            ):
                table[field.name] = value
        return table

    @property
    def has_body(self) -> bool:
        """Whether shape and stiffness are known, not only the length."""
        sections = all(getattr(self, name) > 0.0 for name in ROD_SECTIONS)
        shape = bool(self.builtin) or self.mesh_file is not None
        return shape and (self.young_modulus_Pa > 0.0 or sections)

    @property
    def chambers(self) -> int:
        """Number of chambers: of the builtin shape, or of the surfaces named so in the mesh."""
        if self.mesh_file is not None:
            return len(self.mesh().chambers)
        return self.chamber_count if self.builtin == "chambered" else 0

    @property
    def actuators(self) -> tuple[str, ...]:
        """Columns of the inputs: pressure_1_Pa, ... of chambers, tension_1_N, ... of tendons."""
        return self._numbered("pressure_{}_Pa", "tension_{}_N")

    @property
    def amounts(self) -> tuple[str, ...]:
        """Columns of what the inputs do work on: volume_1_m3, ..., length_1_m, ... wound in."""
        return self._numbered("volume_{}_m3", "length_{}_m")

    def _numbered(self, chamber: str, tendon: str) -> tuple[str, ...]:
        """A name for each chamber, then one for each tendon."""
        tendons = self.tendon_count + len(self.tendons)
        names = [chamber] * self.chambers, [tendon] * tendons
        return tuple(name.format(k) for own in names for k, name in enumerate(own, 1))

    def mesh(self) -> Mesh:
        """Return the tetrahedra of the body; InputError where only its length is known."""
        mesh = self._body()
        for number, tendon in enumerate((*self._round_the_axis(), *self.tendons), 1):
            points = {field.name: getattr(tendon, field.name) for field in fields(tendon)}
            mesh = mesh.with_tendon(f"tendon_{number}", **points)
        on_surface = self.winding_stiffness_N_m or None
        in_region = self.winding_stiffness_Pa or None
        if on_surface or in_region:
            first, second = self.winding_angle_rad, self.winding_second_angle_rad
            angles = (first, -first if second is None else second)
            chambers = self.winding_on == "chambers" and in_region is None
            for on in [name for name, _ in mesh.chambers] if chambers else [self.winding_on]:
                try:
                    mesh = mesh.with_winding(
                        on, angles_rad=angles, stiffness_N_m=on_surface, stiffness_Pa=in_region
                    )
                except FemError as error:
                    raise InputError(f"[mechanism]: {error}") from None
        return mesh

    @property
    def size_words(self) -> str:
        """For who waits for FEM: the nodes of a mesh file, which set the time."""
        if self.mesh_file is None:
            return ""
        nodes = len(self.mesh().nodes_m)
        slow = f" ({_ENOUGH_NODES} are mostly enough)" if nodes > _ENOUGH_NODES else ""
        return f", {nodes} nodes{slow}"

    def checked_length_m(self) -> float:
        """Return the length, of a mesh file its own; InputError where another one is stated."""
        if self.mesh_file is None:
            return self.length_m
        found = self.mesh().length_m
        if abs(found - self.length_m) > _SAME_LENGTH * self.length_m:
            raise InputError(
                f"{self.mesh_file}: this mesh is {found:.4g} m long from base to top, and "
                f"[mechanism] length_m = {self.length_m:g}: leave length_m out, or "
                f"{_scale_by(self.length_m / found)}"
            )
        return float(found)

    def _round_the_axis(self) -> Iterator[Tendon]:
        """Tendons parallel to the axis, at equal angles."""
        for k in range(self.tendon_count):
            angle = 2.0 * math.pi * k / self.tendon_count
            y, z = self.tendon_offset_m * math.cos(angle), self.tendon_offset_m * math.sin(angle)
            steps = self.tendon_guides + 1
            at = [(self.length_m * i / steps, y, z) for i in range(steps + 1)]
            yield Tendon((at[0],), tuple(at[1:-1]), (at[-1],))

    def _body(self) -> Mesh:
        if self.mesh_file is not None:
            return read_mesh(self.mesh_file, self.quality)
        if not self.builtin or self.radius_m <= 0.0:
            raise InputError(
                '[mechanism] gives no shape: add builtin = "cylinder" with radius_m, or mesh = '
                '"file.msh"'
            )
        make, names = _SHAPES[self.builtin]
        dimensions = {name: getattr(self, name) for name in ("length_m", *names)}
        return make(quality=self.quality, **dimensions)

    def fem(
        self,
        element_modulus_scale: F | None = None,
        *,
        gravity_m_s2: tuple[float, float, float] | None = None,
    ) -> Fem:
        """Return the finite element model: clamped at the base, a rigid platform on top.

        Parameters
        ----------
        element_modulus_scale
            (M,) factor on all moduli per tetrahedron.
        gravity_m_s2
            In base axes; with density_kg_m3 the body's own weight. None: weightless.
        """
        if self.builtin == "rod":
            raise InputError(
                "[mechanism] builtin = 'rod' is a line, its solid would be about 10 % stiffer: "
                "for FEM give builtin = 'cylinder' with radius_m and young_modulus_Pa; compare, "
                "diagnose and fit --model physics take the rod as it is"
            )
        if self.young_modulus_Pa <= 0.0:
            raise InputError("[mechanism] gives no young_modulus_Pa: add it (Pa) for FEM")
        self.checked_length_m()
        weight = None
        if gravity_m_s2 is not None:
            x, y, z = (self.density_kg_m3 * g for g in gravity_m_s2)
            weight = (x, y, z)
        law: dict[str, Any]
        if self.material is not None:
            law = {"model": self.material.model, "parameters": dict(self.material.parameters)}
        else:
            law = {"young_modulus_Pa": self.young_modulus_Pa, "poisson_ratio": self.poisson_ratio}
        return Fem(
            self.mesh(),
            element_modulus_scale=element_modulus_scale,
            body_force_N_m3=weight,
            **law,
        )

    def rod_sections(self) -> dict[str, float]:
        """Return EA, GA (shear-corrected), EI, GJ of a uniform rod, the arguments of `rod_poses`.

        An hourglass is taken at its mean radius, a mesh as the cylinder of its volume and length:
        good enough to screen random wrenches, not to model. The shear correction is Cowper's
        (1966), with m = inner / outer radius:
        k = 6 (1 + nu) (1 + m^2)^2 / ((7 + 6 nu) (1 + m^2)^2 + (20 + 12 nu) m^2).

        Raises
        ------
        InputError
            Where only the length is known, or for a mesh that cannot be read.
        """
        given = {name: float(getattr(self, name)) for name in ROD_SECTIONS}
        if all(value > 0.0 for value in given.values()):
            return given
        outer, inner = self.radius_m, 0.0
        if self.mesh_file is not None and self.young_modulus_Pa > 0.0:
            mesh = self.mesh()
            outer = math.sqrt(mesh.volume_m3 / (math.pi * mesh.length_m))
        elif not self.builtin or self.young_modulus_Pa <= 0.0 or outer <= 0.0:
            raise InputError(
                "[mechanism]: a rod needs builtin, radius_m and young_modulus_Pa, or "
                + ", ".join(ROD_SECTIONS)
            )
        elif self.builtin == "tube":
            inner = self.inner_radius_m
        elif "waist_radius_m" in _DIMENSIONS[self.builtin]:
            outer = 0.5 * (self.radius_m + self.waist_radius_m)
        nu, young, ratio = self.poisson_ratio, self.young_modulus_Pa, (inner / outer) ** 2
        full = (1.0 + ratio) ** 2
        correction = (
            6.0 * (1.0 + nu) * full / ((7.0 + 6.0 * nu) * full + (20.0 + 12.0 * nu) * ratio)
        )
        area = math.pi * (outer**2 - inner**2)
        second_moment = math.pi * (outer**4 - inner**4) / 4.0
        shear = young / (2.0 * (1.0 + nu))
        stiffnesses = (
            young * area,
            correction * shear * area,
            young * second_moment,
            2.0 * shear * second_moment,
        )
        return dict(zip(ROD_SECTIONS, stiffnesses, strict=True))

    def key(self) -> str:
        """Return a hash of solver version, shape and material; of a mesh file its content."""
        values: dict[str, Any] = {"solver": SOLVER_VERSION}
        for field in fields(self):
            value = getattr(self, field.name)
            # So that what was solved of bodies without actuators stays valid.
            unused = field.name.startswith(_OF_ACTUATORS) and value == field.default
            if field.name != "mesh_file" and not unused:
                values[field.name] = value
        if self.material is not None:
            values["material"] = self.material.to_dict()
        content = ""
        if self.mesh_file is not None:
            content = hashlib.sha256(mesh_bytes(self.mesh_file)).hexdigest()
        return hash_of(values, content)


_OF_ACTUATORS = ("chamber", "channel", "end_wall", "tendon", "winding")

MECHANISM_KEYS = (*(f.name for f in fields(Mechanism) if f.name != "mesh_file"), "mesh")
"""Keys that `[mechanism]` may hold."""


def _require_dimensions(table: Mapping[str, Any], place: str) -> None:
    """Check that a builtin shape has its dimensions: those of the neck are no defaults."""
    shape = table["builtin"]
    sections = shape == "rod" and all(name in table for name in ROD_SECTIONS)
    for name in ("length_m", *(() if sections else _DIMENSIONS[shape])):
        if name not in table and name not in _MAY_BE_ZERO:
            raise InputError(f"{place}: builtin = '{shape}' needs the key '{name}'")


def _read_material(table: Mapping[str, Any], place: str) -> dict[str, Any]:
    """Read `material` into fields of Mechanism; a plain neo-Hookean one is its two moduli."""
    material = table.get("material")
    if material is None:
        return {}
    if not isinstance(material, Mapping):
        raise InputError(f'{place}: material = {material!r}: expected {{ model = "yeoh", ... }}')
    extra = any(key.startswith(("fibre", "bulk")) for key in material)
    if material.get("model", "neo_hookean") == "neo_hookean" and not extra:
        check_keys(material, ("model", "young_modulus_Pa", "poisson_ratio"), f"{place} material")
        return {key: value for key, value in material.items() if key != "model"}
    try:
        law = Material.from_dict(material)
    except InputError as error:
        raise InputError(f"{place}: {error}") from None
    for name in ("young_modulus_Pa", "poisson_ratio"):
        if name in table:
            raise InputError(f"{place}: found {name} and material: {name} belongs into material")
    return {"material": law}


def length_of_mesh(table: Mapping[str, Any], folder: Path) -> float | None:
    """Return the length of the mesh of `[mechanism]`; None without a mesh that can be read."""
    if not isinstance(table.get("mesh"), str):
        return None
    try:
        return _mesh_length(folder / table["mesh"], table)
    except InputError:
        return None


def _mesh_length(path: Path, table: Mapping[str, Any]) -> float:
    quality = table.get("quality", "standard")
    found = float(read_mesh(path, quality if quality in tuple(SIZES) else "standard").length_m)
    low, high = _LENGTHS_M
    if not low <= found <= high:
        raise InputError(
            f"{path}: this mesh is {found:.4g} m long from base to top, expected {low:g} to "
            f"{high:g} m: is it in metres? Else {_scale_by(1e-3 if found > high else 1e3)}"
        )
    return found


def _scale_by(factor: float) -> str:
    """How a mesh comes to metres."""
    return (
        f"scale its points by {factor:.3g} and save it again (in Gmsh Mesh.ScalingFactor, with "
        f"meshio mesh.points *= {factor:.3g})"
    )
