"""A body from a file: Gmsh meshes, whatever meshio reads, and CAD through Gmsh.

What a file must hold: tetrahedra (straight ones get nodes on their edges), lengths in metres, and
the two faces `base` and `top`. A face is found as a group of triangles or of nodes of that name
(physical group, element set, node set), or as an array of that name that is not zero there. Of CAD
the flat faces at the smallest and at the largest x are meant.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ecm.errors import FemError, InputError, MissingExtra

if TYPE_CHECKING:
    from ecm._native import Mesh

F = NDArray[np.float64]
I = NDArray[np.int64]

CAD_SUFFIXES = (".step", ".stp", ".iges", ".igs", ".brep")
FACES = ("base", "top")
SIZES = {"standard": 0.22, "fine": 0.14}
"""Element size of CAD over the cube root of the volume; of the neck 16 and 10 mm."""

_EDGES = np.array([[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]])
_CORNERS = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])


def read_mesh(path: Path, quality: str = "standard") -> Mesh:
    """The body that a mesh or CAD file describes.

    Parameters
    ----------
    quality
        Element size of CAD; a mesh is taken as it is.

    Errors
    ------
    InputError
        A file that is missing, cannot be read, or has no tetrahedra, no `base` or no `top`.
    MissingExtra
        Where meshio or gmsh is needed and not installed.
    """
    try:
        stat = path.stat()
    except FileNotFoundError:
        raise InputError(f"{path}: this mesh file does not exist: check the path") from None
    except OSError as error:
        raise InputError(f"{path}: this mesh file cannot be read: {error.strerror}") from None
    return _cached(path.resolve(), path, quality, stat.st_mtime_ns, stat.st_size)


@lru_cache(maxsize=4)
def _cached(_real: Path, path: Path, quality: str, _mtime: int, _size: int) -> Mesh:
    from ecm._native import Mesh

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
    """Read here without meshio: 4.1 ASCII. What is no Gmsh file at all is told so here, too."""
    try:
        with path.open("rb") as file:
            head = file.read(64).split()
    except OSError as error:
        raise InputError(f"{path}: this mesh file cannot be read: {error.strerror}") from None
    known = len(head) > 2 and head[0] == b"$MeshFormat"
    return not known or head[1:3] == [b"4.1", b"0"]


# --- meshio ------------------------------------------------------------
def _from_meshio(path: Path) -> Mesh:
    try:
        meshio: Any = import_module("meshio")
    except ImportError:
        raise MissingExtra("meshio", "mesh", f"{path}: a mesh that is not Gmsh 4.1 ASCII") from None
    if path.suffix.lower() not in meshio.extension_to_filetypes:
        raise InputError(
            f"{path}: unknown kind of mesh file '{path.suffix}'; expected .msh, .vtu, .vtk, .inp, "
            f"... (what meshio reads), or CAD: {', '.join(CAD_SUFFIXES)}"
        )
    try:
        found = meshio.read(path)
    except (meshio.ReadError, ValueError, KeyError, IndexError, AssertionError, OSError) as error:
        raise InputError(f"{path}: meshio cannot read this mesh: {error or 'malformed'}") from None
    except SystemExit:
        raise InputError(f"{path}: meshio cannot read this mesh") from None
    kinds = [block.type for block in found.cells]
    tetrahedra = [block.data for block in found.cells if block.type in ("tetra", "tetra10")]
    if not tetrahedra:
        held = ", ".join(sorted(set(kinds))) or "nothing"
        raise InputError(f"{path}: found no tetrahedra (cells: {held}); save the volume mesh")
    foreign = {k for k in kinds if k.startswith(("hexa", "wedge", "pyramid")) or k == "polyhedron"}
    if foreign or len({cells.shape[1] for cells in tetrahedra}) > 1:
        raise InputError(
            f"{path}: found cells {', '.join(sorted(set(kinds)))}; expected tetrahedra only, all "
            "straight (tetra) or all quadratic (tetra10)"
        )
    points = np.asarray(found.points, dtype=float)
    faces = [_face(found, name, path) for name in FACES]
    return _build(points, np.concatenate(tetrahedra).astype(np.int64), faces)


def _face(found: Any, name: str, path: Path) -> I:
    """Node numbers of a named face."""
    for nodes in _candidates(found, name):
        if nodes.size:
            return np.unique(nodes).astype(np.int64)
    names = {*found.cell_sets, *found.point_sets, *found.field_data, *found.point_data}
    names |= set(found.cell_data)
    held = ", ".join(sorted(n for n in names if ":" not in n)) or "none"
    raise InputError(
        f"{path}: no face named `{name}` (groups and arrays found: {held}); name a group of "
        f"triangles or nodes `{name}`, or add a point array `{name}` that is 1 on its nodes"
    )


def _candidates(found: Any, name: str) -> Iterator[I]:
    """All ways in which meshio's formats name nodes, best first."""
    blocks = list(enumerate(found.cells))
    triangles = [(i, block) for i, block in blocks if block.type in ("triangle", "triangle6")]

    def of(chosen: dict[int, Any]) -> I:
        parts = [block.data[chosen[i]].ravel() for i, block in triangles if i in chosen]
        return np.concatenate(parts) if parts else np.empty(0, dtype=np.int64)

    for key, sets in found.cell_sets.items():
        if key.lower() == name:
            yield of({i: s for i, s in enumerate(sets) if s is not None})
    for key, nodes in found.point_sets.items():
        if key.lower() == name:
            yield np.asarray(nodes, dtype=np.int64)
    if name in found.field_data:
        tag = int(found.field_data[name][0])
        for key in ("gmsh:physical", "cell_tags"):
            if key in found.cell_data:
                data = found.cell_data[key]
                yield of({i: np.asarray(data[i]).ravel() == tag for i, _ in triangles})
    if name in found.cell_data:
        data = found.cell_data[name]
        yield of({i: np.asarray(data[i]).ravel() != 0 for i, _ in triangles})
    if name in found.point_data:
        yield np.flatnonzero(np.asarray(found.point_data[name]).ravel() != 0).astype(np.int64)


# --- CAD ---------------------------------------------------------------
def _from_cad(path: Path, quality: str) -> Mesh:
    try:
        gmsh: Any = import_module("gmsh")
    except ImportError:
        raise MissingExtra("gmsh", "cad", f"{path}: CAD") from None
    except OSError as error:  # the wheel is there, a system library is not
        raise InputError(
            f"{path}: gmsh is installed but cannot start ({error}); it needs libGLU, libXft, "
            "libXcursor and libXinerama (Debian: libglu1-mesa libxft2 libxcursor1 libxinerama1)"
        ) from None
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        return _build(*_mesh_of_cad(gmsh, path, quality))
    except InputError:
        raise
    except Exception as error:  # gmsh raises nothing more precise
        raise InputError(
            f"{path}: gmsh cannot mesh this file ({error}); is it one closed solid?"
        ) from None
    finally:
        gmsh.finalize()


def _mesh_of_cad(gmsh: Any, path: Path, quality: str) -> tuple[F, I, list[I]]:
    for name, value in {
        "General.Verbosity": 0,
        "General.NumThreads": 1,
        "Mesh.ElementOrder": 2,
        "Mesh.HighOrderOptimize": 2,
        "Mesh.Optimize": 1,
    }.items():
        gmsh.option.setNumber(name, value)
    gmsh.option.setString("Geometry.OCCTargetUnit", "M")
    entities = gmsh.model.occ.importShapes(str(path))
    gmsh.model.occ.synchronize()
    solids = gmsh.model.getEntities(3)
    if len(solids) != 1:
        found = sorted({dimension for dimension, _ in entities})
        raise InputError(
            f"{path}: found {len(solids)} solids (entities of dimension {found}); expected one "
            "closed solid: join the parts in CAD"
        )
    volume = gmsh.model.occ.getMass(3, solids[0][1])
    size = SIZES[quality] * float(np.cbrt(volume))
    gmsh.option.setNumber("Mesh.MeshSizeMax", size)
    gmsh.option.setNumber("Mesh.MeshSizeMin", 0.2 * size)
    gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", 10)
    surfaces = _cad_faces(gmsh, path)
    gmsh.model.mesh.generate(3)
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    row = np.full(int(tags.max()) + 1, -1, dtype=np.int64)
    row[np.asarray(tags, dtype=np.int64)] = np.arange(len(tags))
    _, nodes = gmsh.model.mesh.getElementsByType(11)
    # Gmsh numbers its last two mid-edge nodes 23, 13.
    cells = row[np.asarray(nodes, dtype=np.int64)].reshape(-1, 10)[
        :, [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]
    ]
    faces = []
    for of_face in surfaces:
        own = [gmsh.model.mesh.getElementsByType(9, tag)[1] for tag in of_face]
        faces.append(np.unique(row[np.concatenate(own).astype(np.int64)]))
    return np.asarray(coordinates, dtype=float).reshape(-1, 3), cells, faces


def _cad_faces(gmsh: Any, path: Path) -> list[list[int]]:
    """Surfaces that are `base` and `top`: flat, at the smallest and at the largest x.

    Gmsh hands on no names of STEP faces, so their place must tell.
    """
    boxes = {tag: gmsh.model.getBoundingBox(2, tag) for _, tag in gmsh.model.getEntities(2)}
    low, high = min(b[0] for b in boxes.values()), max(b[3] for b in boxes.values())
    # OpenCASCADE widens its boxes by 1e-7.
    slack = 1e-5 * (high - low) + 2e-7
    found = []
    for name, x in zip(FACES, (low, high), strict=True):
        tags = [t for t, b in boxes.items() if max(abs(b[0] - x), abs(b[3] - x)) < slack]
        if not tags:
            raise InputError(
                f"{path}: no face lies flat at the {'smallest' if name == 'base' else 'largest'} "
                f"x = {x:.6g} m to be `{name}`; turn the body so that its axis is x, or mesh it in "
                "Gmsh with physical surfaces `base` and `top` (.msh)"
            )
        found.append(tags)
    return found


# --- arrays ------------------------------------------------------------
def _build(points: F, tetrahedra: I, faces: list[I]) -> Mesh:
    """Quadratic and without nodes that no tetrahedron uses."""
    from ecm._native import Mesh

    if tetrahedra.shape[1] == 4:
        points, tetrahedra, faces = _raise(points, tetrahedra, faces)
    used = np.unique(tetrahedra)
    row = np.full(len(points), -1, dtype=np.int64)
    row[used] = np.arange(len(used))
    base, top = (row[face][row[face] >= 0] for face in faces)
    return Mesh.from_arrays(
        np.ascontiguousarray(points[used]),
        np.ascontiguousarray(row[tetrahedra]),
        base_nodes=base,
        top_nodes=top,
    )


def _raise(points: F, corners: I, faces: list[I]) -> tuple[F, I, list[I]]:
    """Nodes in the middle of all edges, also of those on the named faces."""
    edges = np.sort(corners[:, _EDGES], axis=2)
    unique, number = np.unique(edges.reshape(-1, 2), axis=0, return_inverse=True)
    middle = len(points) + number.reshape(len(corners), 6)
    raised = []
    for face in faces:
        on = np.zeros(len(points), dtype=bool)
        on[face] = True
        triangles = corners[:, _CORNERS].reshape(-1, 3)
        triangles = triangles[on[triangles].all(axis=1)]
        sides = np.sort(triangles[:, [[0, 1], [1, 2], [0, 2]]].reshape(-1, 2), axis=1)
        keys = unique[:, 0] * len(points) + unique[:, 1]
        at = np.searchsorted(keys, sides[:, 0] * len(points) + sides[:, 1])
        raised.append(np.concatenate([face, len(points) + np.unique(at)]))
    halves = 0.5 * (points[unique[:, 0]] + points[unique[:, 1]])
    return np.concatenate([points, halves]), np.hstack([corners, middle]), raised
