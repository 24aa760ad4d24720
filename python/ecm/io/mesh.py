"""Meshes from files: Gmsh, other formats through meshio, and CAD through Gmsh.

A file must hold tetrahedra (straight ones get nodes on their edges), lengths in metres, and the two
faces `base` and `top`; the walls of chambers are faces `chamber_1`, `chamber_2`, ... A face is a
group of triangles or of nodes of that name (physical group, element set, node set), or an array of
that name that is not zero there. In CAD the faces are the flat ones at the smallest and at the
largest x.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from ecm._native import Mesh
from ecm.errors import FemError, InputError
from ecm.io.arrays import F, I
from ecm.io.extras import require

CAD_SUFFIXES = (".step", ".stp", ".iges", ".igs", ".brep")
FACES = ("base", "top")
SIZES = {"standard": 0.22, "fine": 0.14}
"""Element size of CAD over the cube root of the volume; for the neck 16 and 10 mm."""

_EDGES = np.array([[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]])
_SIDES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
_NODES_FROM_GMSH = [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]  # Gmsh numbers its last two edges 23, 13
_GMSH_OPTIONS = {
    "General.Verbosity": 0,
    "General.NumThreads": 1,
    "Mesh.ElementOrder": 2,
    "Mesh.HighOrderOptimize": 2,
    "Mesh.Optimize": 1,
    "Mesh.MeshSizeFromCurvature": 10,
}
_QUADRATIC_TRIANGLE, _QUADRATIC_TETRAHEDRON = 9, 11
"""Gmsh's numbers of element types."""


def read_mesh(path: Path, quality: str = "standard") -> Mesh:
    """Read the body of a mesh or CAD file; `quality` (standard or fine) is the element size of CAD.

    InputError for a file that cannot be read, or that has no tetrahedra, no `base` or no `top`;
    MissingExtra where meshio or gmsh is needed and not installed.
    """
    with _there(path):
        stat = path.stat()
    return _read(path.resolve(), path, quality, stat.st_mtime_ns, stat.st_size)


def mesh_bytes(path: Path) -> bytes:
    """Return the content of a mesh file; InputError where it cannot be read."""
    with _there(path):
        return path.read_bytes()


@contextmanager
def _there(path: Path) -> Iterator[None]:
    """Refuse a mesh file that cannot be read."""
    try:
        yield
    except FileNotFoundError:
        raise InputError(f"{path}: this mesh file does not exist: check the path") from None
    except OSError as error:
        raise InputError(f"{path}: this mesh file cannot be read: {error.strerror}") from None


@lru_cache(maxsize=4)
def _read(_absolute: Path, path: Path, quality: str, _mtime: int, _size: int) -> Mesh:
    """Read a mesh file; time and size of the file are part of the cache's key."""
    try:
        if path.suffix.lower() in CAD_SUFFIXES:
            return _from_cad(path, quality)
        if path.suffix.lower() == ".msh" and _is_plain_gmsh(path):
            return Mesh.read(str(path))
        return _from_meshio(path)
    except FemError as error:
        text = str(error)
        raise InputError(text if str(path) in text else f"{path}: {text}") from None


def _is_plain_gmsh(path: Path) -> bool:
    """Whether our own reader takes it: Gmsh 4.1 ASCII, or no Gmsh file at all, which it reports."""
    with _there(path), path.open("rb") as file:
        head = file.read(64).split()
    known = len(head) > 2 and head[0] == b"$MeshFormat"
    return not known or head[1:3] == [b"4.1", b"0"]


# --- meshio ------------------------------------------------------------
def _from_meshio(path: Path) -> Mesh:
    meshio = require("meshio", "mesh", f"{path}: a mesh that is not Gmsh 4.1 ASCII")
    if path.suffix.lower() not in meshio.extension_to_filetypes:
        raise InputError(
            f"{path}: unknown kind of mesh file '{path.suffix}'; expected .msh, .vtu, .vtk, .inp, "
            f"... (what meshio reads), or CAD: {', '.join(CAD_SUFFIXES)}"
        )
    try:
        content = meshio.read(path)
    except (Exception, SystemExit) as error:  # meshio raises nothing more precise
        why = "malformed" if isinstance(error, SystemExit) else str(error) or "malformed"
        raise InputError(f"{path}: meshio cannot read this mesh: {why}") from None
    kinds = {block.type for block in content.cells}
    words = ", ".join(sorted(kinds)) or "nothing"
    tetrahedra = [block.data for block in content.cells if block.type in ("tetra", "tetra10")]
    if not tetrahedra:
        raise InputError(f"{path}: found no tetrahedra (cells: {words}); save the volume mesh")
    others = any(k.startswith(("hexa", "wedge", "pyramid")) or k == "polyhedron" for k in kinds)
    if others or {"tetra", "tetra10"} <= kinds:
        raise InputError(
            f"{path}: found cells {words}; expected tetrahedra only, all straight (tetra) or all "
            "quadratic (tetra10)"
        )
    points = np.asarray(content.points, dtype=float)
    numbers = {n[8:] for n in _names(content) if n[:8].lower() == "chamber_" and n[8:].isdigit()}
    names = (*FACES, *(f"chamber_{number}" for number in sorted(numbers, key=int)))
    faces = {name: _face(content, name, path) for name in names}
    cells = np.concatenate(tetrahedra).astype(np.int64)
    # Gmsh 2.2 writes an element once for each of its physical groups.
    _, first = np.unique(np.sort(cells[:, :4], axis=1), axis=0, return_index=True)
    return _build(points, cells[np.sort(first)], faces)


def _face(content: Any, name: str, path: Path) -> I:
    """Return the node numbers of a named face."""
    for nodes in _candidates(content, name):
        if nodes.size:
            return np.unique(nodes).astype(np.int64)
    groups = ", ".join(sorted(n for n in _names(content) if ":" not in n)) or "none"
    raise InputError(
        f"{path}: no face named `{name}` (groups and arrays found: {groups}); name a group of "
        f"triangles or nodes `{name}`, or add a point array `{name}` that is 1 on its nodes"
    )


def _names(content: Any) -> set[str]:
    """Names of all groups and arrays."""
    sets = {*content.cell_sets, *content.point_sets, *content.field_data}
    return sets | {*content.point_data, *content.cell_data}


def _candidates(content: Any, name: str) -> Iterator[I]:
    """Try all ways in which meshio's formats name nodes, best first."""
    triangles = {
        i: block.data
        for i, block in enumerate(content.cells)
        if block.type in ("triangle", "triangle6")
    }

    def nodes_of(chosen: dict[int, Any]) -> I:
        parts = [data[chosen[i]].ravel() for i, data in triangles.items() if i in chosen]
        return np.concatenate(parts) if parts else np.empty(0, dtype=np.int64)

    for key, sets in content.cell_sets.items():
        if key.lower() == name:
            yield nodes_of({i: s for i, s in enumerate(sets) if s is not None})
    for key, nodes in content.point_sets.items():
        if key.lower() == name:
            yield np.asarray(nodes, dtype=np.int64)
    if name in content.field_data:
        tag = int(content.field_data[name][0])
        for key in ("gmsh:physical", "cell_tags"):
            if key in content.cell_data:
                tags = content.cell_data[key]
                yield nodes_of({i: np.asarray(tags[i]).ravel() == tag for i in triangles})
    if name in content.cell_data:
        data = content.cell_data[name]
        yield nodes_of({i: np.asarray(data[i]).ravel() != 0 for i in triangles})
    if name in content.point_data:
        yield np.flatnonzero(np.asarray(content.point_data[name]).ravel() != 0).astype(np.int64)


# --- CAD ---------------------------------------------------------------
def _from_cad(path: Path, quality: str) -> Mesh:
    try:
        gmsh = require("gmsh", "cad", f"{path}: CAD")
    except OSError as error:  # the package is installed, a system library is not
        raise InputError(
            f"{path}: gmsh is installed but cannot start ({error}); it needs libGLU, libXft, "
            "libXcursor and libXinerama (Debian: libglu1-mesa libxft2 libxcursor1 libxinerama1)"
        ) from None
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        return _build(*_mesh_cad(gmsh, path, quality))
    except InputError:
        raise
    except Exception as error:  # gmsh raises nothing more precise
        raise InputError(
            f"{path}: gmsh cannot mesh this file ({error}); is it one closed solid?"
        ) from None
    finally:
        gmsh.finalize()


def _mesh_cad(gmsh: Any, path: Path, quality: str) -> tuple[F, I, dict[str, I]]:
    """Mesh the solid of a CAD file: points (N, 3), cells (M, 10), node numbers of both faces."""
    for name, value in _GMSH_OPTIONS.items():
        gmsh.option.setNumber(name, value)
    gmsh.option.setString("Geometry.OCCTargetUnit", "M")
    entities = gmsh.model.occ.importShapes(str(path))
    gmsh.model.occ.synchronize()
    solids = gmsh.model.getEntities(3)
    if len(solids) != 1:
        dimensions = sorted({dimension for dimension, _ in entities})
        raise InputError(
            f"{path}: found {len(solids)} solids (entities of dimension {dimensions}); expected "
            "one closed solid: join the parts in CAD"
        )
    volume = gmsh.model.occ.getMass(3, solids[0][1])
    size = SIZES[quality] * float(np.cbrt(volume))
    gmsh.option.setNumber("Mesh.MeshSizeMax", size)
    gmsh.option.setNumber("Mesh.MeshSizeMin", 0.2 * size)
    surfaces = _cad_faces(gmsh, path)
    gmsh.model.mesh.generate(3)
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    row = np.full(int(tags.max()) + 1, -1, dtype=np.int64)
    row[np.asarray(tags, dtype=np.int64)] = np.arange(len(tags))
    _, nodes = gmsh.model.mesh.getElementsByType(_QUADRATIC_TETRAHEDRON)
    cells = row[np.asarray(nodes, dtype=np.int64)].reshape(-1, 10)[:, _NODES_FROM_GMSH]
    faces = {}
    for name, surface in zip(FACES, surfaces, strict=True):
        own = [gmsh.model.mesh.getElementsByType(_QUADRATIC_TRIANGLE, tag)[1] for tag in surface]
        faces[name] = np.unique(row[np.concatenate(own).astype(np.int64)])
    return np.asarray(coordinates, dtype=float).reshape(-1, 3), cells, faces


def _cad_faces(gmsh: Any, path: Path) -> list[list[int]]:
    """Return the surfaces of `base` and `top`: flat, at the smallest and at the largest x.

    Gmsh does not pass on the names of STEP faces, so only their place can tell.
    """
    boxes = {tag: gmsh.model.getBoundingBox(2, tag) for _, tag in gmsh.model.getEntities(2)}
    low, high = min(b[0] for b in boxes.values()), max(b[3] for b in boxes.values())
    tolerance = 1e-5 * (high - low) + 2e-7  # OpenCASCADE widens its boxes by 1e-7
    surfaces = []
    for name, word, x in (("base", "smallest", low), ("top", "largest", high)):
        tags = [t for t, b in boxes.items() if max(abs(b[0] - x), abs(b[3] - x)) < tolerance]
        if not tags:
            raise InputError(
                f"{path}: no face lies flat at the {word} x = {x:.6g} m to be `{name}`; turn the "
                "body so that its axis is x, or mesh it in Gmsh with physical surfaces `base` and "
                "`top` (.msh)"
            )
        surfaces.append(tags)
    return surfaces


# --- arrays ------------------------------------------------------------
def _build(points: F, tetrahedra: I, faces: dict[str, I]) -> Mesh:
    """Make a mesh of quadratic tetrahedra, without nodes that no tetrahedron uses."""
    if tetrahedra.shape[1] == 4:
        points, tetrahedra, faces = _quadratic(points, tetrahedra, faces)
    used = np.unique(tetrahedra)
    row = np.full(len(points), -1, dtype=np.int64)
    row[used] = np.arange(len(used))
    kept = {name: row[face][row[face] >= 0] for name, face in faces.items()}
    nodes, cells = np.ascontiguousarray(points[used]), np.ascontiguousarray(row[tetrahedra])
    mesh = Mesh.from_arrays(nodes, cells, base_nodes=kept.pop("base"), top_nodes=kept.pop("top"))
    for name, wall in kept.items():
        mesh = mesh.with_chamber(name, wall)
    return mesh


def _quadratic(points: F, corners: I, faces: dict[str, I]) -> tuple[F, I, dict[str, I]]:
    """Add nodes in the middle of all edges, also to the named faces."""
    edges = np.sort(corners[:, _EDGES], axis=2)
    unique, number = np.unique(edges.reshape(-1, 2), axis=0, return_inverse=True)
    middle = len(points) + number.reshape(len(corners), 6)
    keys = unique[:, 0] * len(points) + unique[:, 1]
    quadratic = {}
    for name, face in faces.items():
        on = np.zeros(len(points), dtype=bool)
        on[face] = True
        triangles = corners[:, _SIDES].reshape(-1, 3)
        triangles = triangles[on[triangles].all(axis=1)]
        sides = np.sort(triangles[:, [[0, 1], [1, 2], [0, 2]]].reshape(-1, 2), axis=1)
        at = np.searchsorted(keys, sides[:, 0] * len(points) + sides[:, 1])
        quadratic[name] = np.concatenate([face, len(points) + np.unique(at)])
    halves = 0.5 * (points[unique[:, 0]] + points[unique[:, 1]])
    return np.concatenate([points, halves]), np.hstack([corners, middle]), quadratic
