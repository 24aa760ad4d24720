"""The mechanism: its shape, its material, and what can be made of them (mesh, FEM, rod)."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ecm.errors import InputError
from ecm.material import Material
from ecm.mesh_file import read_mesh
from ecm.settings import read_settings
from ecm.stages import hash_of
from ecm.toml_file import check_keys, nearest

if TYPE_CHECKING:
    from ecm._native import Fem, Mesh

BUILTIN = ("cylinder", "tube", "hourglass", "stacked_discs", "rod")
_DIMENSIONS: dict[str, tuple[str, ...]] = {
    "cylinder": ("radius_m",),
    "tube": ("radius_m", "inner_radius_m"),
    "hourglass": ("radius_m", "waist_radius_m"),
    "stacked_discs": ("radius_m", "waist_radius_m", "disc_count"),
    "rod": ("radius_m",),
}
_SECTIONS = (
    "axial_stiffness_N",
    "shear_stiffness_N",
    "bending_stiffness_Nm2",
    "torsion_stiffness_Nm2",
)
QUALITIES = ("standard", "fine")

SOLVER_VERSION = 3
"""Grows with every change of the FEM that changes its answers: what was kept of older ones is then
solved anew. 2: bulk stiffness at distorted points. 3: a batch of poses begins at the
tangent at rest (within 1.3e-6 N of 2)."""


@dataclass(frozen=True)
class Mechanism:
    """An elastic body between two rigid plates; the default is the neck of the paper."""

    builtin: str = "cylinder"
    """cylinder, tube, hourglass, stacked_discs, rod; empty for a mesh or where only L is known."""
    length_m: float = 0.1034
    """Distance of the two faces, undeformed."""
    radius_m: float = 0.033
    """Outer radius (of the faces, for the hourglass)."""
    inner_radius_m: float = 0.0
    """Inner radius of the tube."""
    waist_radius_m: float = 0.0
    """Smallest radius of the hourglass, or between stacked discs."""
    disc_count: int = 0
    """Number of stacked discs, the half ones at both ends included."""
    young_modulus_Pa: float = 0.65e6
    """E at small strain; 0: unknown."""
    poisson_ratio: float = 0.49
    """nu, at most 0.5."""
    material: Material | None = None
    """Another law than neo-Hookean; E and nu above are then its moduli at small strain."""
    density_kg_m3: float = 0.0
    """0: own weight is not considered."""
    free_length_m: float = 0.0
    """Length when detached, for a preloaded mechanism; 0: the same as length_m."""
    mesh_file: Path | None = None
    """Mesh or CAD file with faces `base` and `top` (ecm.mesh_file), instead of a builtin."""
    quality: str = "standard"
    """standard or fine: element size of a builtin or of CAD."""
    axial_stiffness_N: float = 0.0
    """EA of a builtin rod; 0: from radius and E."""
    shear_stiffness_N: float = 0.0
    """GA of a builtin rod, with its shear correction."""
    bending_stiffness_Nm2: float = 0.0
    """EI of a builtin rod."""
    torsion_stiffness_Nm2: float = 0.0
    """GJ of a builtin rod."""

    def __post_init__(self) -> None:
        if self.builtin and self.builtin not in BUILTIN:
            raise InputError(f"builtin = '{self.builtin}': {nearest(self.builtin, BUILTIN)}")
        if self.builtin and self.mesh_file is not None:
            raise InputError("found both builtin and mesh: give one of them")
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, float) and (not math.isfinite(value) or value < 0.0):
                raise InputError(f"{field.name} = {value}: expected a positive number")
        if self.length_m <= 0.0:
            raise InputError(f"length_m = {self.length_m}: expected a positive length in metres")
        if self.length_m > 10.0:
            raise InputError(f"length_m = {self.length_m}: looks like millimetres; give metres")
        if self.length_m < 1e-3:
            raise InputError(
                f"length_m = {self.length_m:.4g}: shorter than a millimetre; expected metres, and "
                "CAD and mesh files at the body's real size"
            )
        if not 0.0 <= self.poisson_ratio <= 0.5:
            raise InputError(
                f"poisson_ratio = {self.poisson_ratio}: expected at least 0 and at most 0.5 "
                "(0.49 for rubber)"
            )
        if 0.0 < self.young_modulus_Pa < 100.0:
            raise InputError(
                f"young_modulus_Pa = {self.young_modulus_Pa}: looks like MPa; give Pa (0.65e6)"
            )
        if self.quality not in QUALITIES:
            raise InputError(f"quality = '{self.quality}': {nearest(self.quality, QUALITIES)}")
        self._check_dimensions()

    def _check_dimensions(self) -> None:
        if self.builtin in BUILTIN[:-1] and self.radius_m <= 0.0:
            raise InputError(f"radius_m = {self.radius_m}: expected a positive radius in metres")
        if self.builtin and self.radius_m > 10.0 * self.length_m:
            raise InputError(
                f"radius_m = {self.radius_m} with length_m = {self.length_m}: expected metres "
                "for both"
            )
        if self.builtin == "tube" and not 0.0 < self.inner_radius_m < self.radius_m:
            raise InputError(
                f"inner_radius_m = {self.inner_radius_m}: expected above 0 and below radius_m = "
                f"{self.radius_m}"
            )
        if self.builtin == "stacked_discs" and not 2 <= self.disc_count <= 40:
            raise InputError(f"disc_count = {self.disc_count}: expected 2 to 40")
        waisted = self.builtin in ("hourglass", "stacked_discs")
        if waisted and not 0.0 < self.waist_radius_m <= self.radius_m:
            raise InputError(
                f"waist_radius_m = {self.waist_radius_m}: expected above 0 and at most radius_m = "
                f"{self.radius_m}"
            )

    @staticmethod
    def from_dict(
        table: Mapping[str, Any], where: str | Path = "[mechanism]", *, base: Path | None = None
    ) -> Mechanism:
        """A `[mechanism]` table (interfaces.md).

        Parameters
        ----------
        where
            File and table, for messages; a path also resolves a relative mesh file.
        base
            Directory of a relative mesh file, where `where` is text.
        """
        place = f"{where} [mechanism]" if isinstance(where, Path) else where
        if base is None:
            base = where.parent if isinstance(where, Path) else Path()
        if not isinstance(table, Mapping):
            raise InputError(f"{place}: found {table!r}, expected a table of settings")
        check_keys(table, MECHANISM_KEYS, place)
        values: dict[str, Any] = {
            key: value for key, value in table.items() if key not in ("mesh", "material")
        }
        values |= _material(table, place)
        if "mesh" in table:
            if not isinstance(table["mesh"], str):
                raise InputError(f"{place}: mesh = {table['mesh']!r}: expected a file name")
            values["mesh_file"] = str(base / table["mesh"])
        # Only what the file says is known: the neck's figures are no defaults for another body.
        unknown: dict[str, Any] = {"builtin": "", "radius_m": 0.0, "young_modulus_Pa": 0.0}
        values = unknown | values
        if not values["builtin"]:
            if "mesh" in table and "length_m" not in table:
                values["length_m"] = _mesh_length(Path(values["mesh_file"]), table)
            if "length_m" not in values:
                raise InputError(
                    f"{place}: the key 'length_m' is missing; it is the least that a model needs"
                )
        elif values["builtin"] in _DIMENSIONS:
            _require(table, place)
        material = values.pop("material", None)
        return replace(read_settings(Mechanism, values, place), material=material)

    def to_dict(self) -> dict[str, Any]:
        """The `[mechanism]` table that gives this mechanism back."""
        default = {field.name: field.default for field in fields(self)}
        always = {"length_m", "builtin", "young_modulus_Pa", "poisson_ratio"}
        if self.builtin:
            always |= set(_DIMENSIONS[self.builtin])
        table: dict[str, Any] = {}
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name == "mesh_file":
                if value is not None:
                    table["mesh"] = str(value)
            elif field.name == "material":
                if value is not None:
                    table["material"] = value.to_dict()
                    del table["young_modulus_Pa"], table["poisson_ratio"]
            elif value and (field.name in always or value != default[field.name]):
                table[field.name] = value
        return table

    def with_modulus(self, young_modulus_Pa: float) -> Mechanism:
        """The same body of another modulus; all moduli of its material in proportion."""
        material = self.material
        if material is not None:
            material = material.scaled(young_modulus_Pa / material.young_modulus_Pa)
        return replace(self, young_modulus_Pa=young_modulus_Pa, material=material)

    @property
    def has_body(self) -> bool:
        """Whether FEM or rod can be made of it (not of a bare length)."""
        sections = all(getattr(self, name) > 0.0 for name in _SECTIONS)
        return (bool(self.builtin) or self.mesh_file is not None) and (
            self.young_modulus_Pa > 0.0 or sections
        )

    def mesh(self) -> Mesh:
        """Tetrahedra of the body; InputError where only its length is known."""
        from ecm._native import Mesh

        if self.mesh_file is not None:
            return read_mesh(self.mesh_file, self.quality)
        if self.builtin in ("cylinder", "rod") and self.radius_m > 0.0:
            return Mesh.cylinder(
                length_m=self.length_m, radius_m=self.radius_m, quality=self.quality
            )
        if self.builtin == "tube":
            return Mesh.tube(
                length_m=self.length_m,
                radius_m=self.radius_m,
                inner_radius_m=self.inner_radius_m,
                quality=self.quality,
            )
        if self.builtin == "hourglass":
            return Mesh.hourglass(
                length_m=self.length_m,
                radius_m=self.radius_m,
                waist_radius_m=self.waist_radius_m,
                quality=self.quality,
            )
        if self.builtin == "stacked_discs":
            return Mesh.stacked_discs(
                length_m=self.length_m,
                radius_m=self.radius_m,
                waist_radius_m=self.waist_radius_m,
                disc_count=self.disc_count,
                quality=self.quality,
            )
        raise InputError(
            '[mechanism] gives no shape: add builtin = "cylinder" with radius_m, or mesh = '
            '"file.msh"'
        )

    def fem(
        self,
        element_modulus_scale: NDArray[np.float64] | None = None,
        *,
        gravity_m_s2: tuple[float, float, float] | None = None,
    ) -> Fem:
        """The body clamped at its base with a rigid platform on top.

        Parameters
        ----------
        element_modulus_scale
            (M,) factor on all moduli per tetrahedron.
        gravity_m_s2
            In base axes; with density_kg_m3 the body's own weight. None: weightless.
        """
        from ecm._native import Fem

        if self.builtin == "rod":
            raise InputError(
                "[mechanism] builtin = 'rod' is a line, its solid would be about 10 % stiffer: "
                "for FEM give builtin = 'cylinder' with radius_m and young_modulus_Pa; compare, "
                "diagnose and fit --model physics take the rod as it is"
            )
        if self.young_modulus_Pa <= 0.0:
            raise InputError("[mechanism] gives no young_modulus_Pa: add it (Pa) for FEM")
        weight = None
        if gravity_m_s2 is not None:
            x, y, z = (self.density_kg_m3 * g for g in gravity_m_s2)
            weight = (x, y, z)
        if self.material is not None:
            return Fem(
                self.mesh(),
                model=self.material.model,
                parameters=dict(self.material.parameters),
                element_modulus_scale=element_modulus_scale,
                body_force_N_m3=weight,
            )
        return Fem(
            self.mesh(),
            young_modulus_Pa=self.young_modulus_Pa,
            poisson_ratio=self.poisson_ratio,
            element_modulus_scale=element_modulus_scale,
            body_force_N_m3=weight,
        )

    def rod_sections(self) -> dict[str, float]:
        """EA, GA (shear-corrected), EI, GJ of a uniform body, the arguments of `rod_poses`.

        Shear correction of a circle or ring with m = inner / outer radius (Cowper 1966):
        k = 6 (1 + nu) (1 + m^2)^2 / ((7 + 6 nu)(1 + m^2)^2 + (20 + 12 nu) m^2).
        An hourglass is taken at its mean radius, a mesh as the cylinder of its volume and length:
        good enough to screen draws, not to model.

        Errors
        ------
        InputError
            For a bare length, or a mesh that cannot be read.
        """
        given = {name: float(getattr(self, name)) for name in _SECTIONS}
        if all(value > 0.0 for value in given.values()):
            return given
        if self.mesh_file is not None and self.young_modulus_Pa > 0.0:
            return self._sections_of(*self._equivalent_circle())
        if not self.builtin or self.young_modulus_Pa <= 0.0 or self.radius_m <= 0.0:
            raise InputError(
                "[mechanism]: a rod needs builtin, radius_m and young_modulus_Pa, or "
                + ", ".join(_SECTIONS)
            )
        outer = self.radius_m
        if self.builtin in ("hourglass", "stacked_discs"):
            outer = 0.5 * (self.radius_m + self.waist_radius_m)
        return self._sections_of(outer, self.inner_radius_m if self.builtin == "tube" else 0.0)

    def _equivalent_circle(self) -> tuple[float, float]:
        """Radii of the cylinder of the mesh's volume and length."""
        mesh = self.mesh()
        return math.sqrt(mesh.volume_m3 / (math.pi * mesh.length_m)), 0.0

    def _sections_of(self, outer: float, inner: float) -> dict[str, float]:
        nu = self.poisson_ratio
        ratio = (inner / outer) ** 2
        correction = (
            6.0
            * (1.0 + nu)
            * (1.0 + ratio) ** 2
            / ((7.0 + 6.0 * nu) * (1.0 + ratio) ** 2 + (20.0 + 12.0 * nu) * ratio)
        )
        area = math.pi * (outer**2 - inner**2)
        second_moment = math.pi * (outer**4 - inner**4) / 4.0
        shear_modulus = self.young_modulus_Pa / (2.0 * (1.0 + nu))
        return {
            "axial_stiffness_N": self.young_modulus_Pa * area,
            "shear_stiffness_N": correction * shear_modulus * area,
            "bending_stiffness_Nm2": self.young_modulus_Pa * second_moment,
            "torsion_stiffness_Nm2": 2.0 * shear_modulus * second_moment,
        }

    def key(self) -> str:
        """Hash of solver, shape and material; of a mesh, of its content and not of its place."""
        values = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "mesh_file"}
        values["solver"] = SOLVER_VERSION
        if self.material is not None:
            values["material"] = self.material.to_dict()
        content = ""
        if self.mesh_file is not None:
            content = hashlib.sha256(_mesh_bytes(self.mesh_file)).hexdigest()
        return hash_of(values, content)


MECHANISM_KEYS = (
    *(field.name for field in fields(Mechanism) if field.name != "mesh_file"),
    "mesh",
)


def _require(values: Mapping[str, Any], place: str) -> None:
    """A builtin needs its dimensions: the neck's are no silent defaults."""
    sections = values["builtin"] == "rod" and all(name in values for name in _SECTIONS)
    needed = ["length_m"] if sections else ["length_m", *_DIMENSIONS[values["builtin"]]]
    for name in needed:
        if name not in values:
            raise InputError(
                f"{place}: builtin = '{values['builtin']}' needs the key '{name}', which is missing"
            )


def _material(table: Mapping[str, Any], place: str) -> dict[str, Any]:
    material = table.get("material")
    if material is None:
        return {}
    if not isinstance(material, Mapping):
        raise InputError(
            f'{place}: material = {material!r}: expected {{ model = "neo_hookean", ... }}'
        )
    if material.get("model", "neo_hookean") == "neo_hookean" and not {
        key for key in material if key.startswith(("fibre", "bulk"))
    }:
        check_keys(material, ("model", "young_modulus_Pa", "poisson_ratio"), f"{place} material")
        return {key: value for key, value in material.items() if key != "model"}
    try:
        law = Material.from_dict(material)
    except InputError as error:
        raise InputError(f"{place}: {error}") from None
    for name in ("young_modulus_Pa", "poisson_ratio"):
        if name in table:
            raise InputError(f"{place}: found {name} and material: {name} belongs into material")
    return {
        "material": law,
        "young_modulus_Pa": law.young_modulus_Pa,
        "poisson_ratio": law.poisson_ratio,
    }


def length_of_mesh(table: Mapping[str, Any], folder: Path) -> float | None:
    """Length of the body in `mesh`; None where there is none, or its file cannot be read."""
    if not isinstance(table.get("mesh"), str):
        return None
    try:
        return _mesh_length(folder / table["mesh"], table)
    except InputError:
        return None


def _mesh_length(path: Path, table: Mapping[str, Any]) -> float:
    quality = table.get("quality", "standard")
    return float(read_mesh(path, quality if quality in QUALITIES else "standard").length_m)


def _mesh_bytes(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{path}: this mesh file does not exist: check the path") from None
    except OSError as error:
        raise InputError(f"{path}: this mesh file cannot be read: {error.strerror}") from None
