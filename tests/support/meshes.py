"""Meshes as text, written by hand."""

from __future__ import annotations

import itertools

import numpy as np


def block_mesh(*, inside_out: bool = False, top: str = "top") -> str:
    """A Gmsh 4.1 file of a block of 0.1 m in six tetrahedra, base and top square to x."""
    corners = list(itertools.product((0, 1), repeat=3))
    number = {corner: i + 1 for i, corner in enumerate(corners)}
    tetrahedra, base, lid = [], [], []
    for order in itertools.permutations(range(3)):
        path = [(0, 0, 0)]
        for axis in order:
            step = list(path[-1])
            step[axis] = 1
            path.append((step[0], step[1], step[2]))
        points = np.array(path, dtype=float)
        if (np.linalg.det(points[1:] - points[0]) < 0.0) != inside_out:
            path[1], path[2] = path[2], path[1]
        tetrahedra.append([number[p] for p in path])
        base += [[number[p] for p in path if p[0] == 0]]
        lid += [[number[p] for p in path if p[0] == 1]]
    triangles = [[t for t in faces if len(t) == 3] for faces in (base, lid)]
    lines = [
        "$MeshFormat", "4.1 0 8", "$EndMeshFormat",
        "$PhysicalNames", "3", '2 1 "base"', f'2 2 "{top}"', '3 3 "body"', "$EndPhysicalNames",
        "$Entities", "0 0 2 1", "1 0 0 0 0 0 0 1 1 0", "2 0 0 0 0 0 0 1 2 0",
        "1 0 0 0 0 0 0 1 3 0", "$EndEntities",
        "$Nodes", "1 8 1 8", "3 1 0 8", *(str(i + 1) for i in range(8)),
        *(" ".join(str(0.1 * x) for x in corner) for corner in corners), "$EndNodes",
        "$Elements", "3 0 0 0",
    ]  # fmt: skip
    for dimension, entity, kind, elements in (
        (2, 1, 2, triangles[0]), (2, 2, 2, triangles[1]), (3, 1, 4, tetrahedra),
    ):  # fmt: skip
        lines.append(f"{dimension} {entity} {kind} {len(elements)}")
        lines += [f"{i + 1} {' '.join(str(n) for n in nodes)}" for i, nodes in enumerate(elements)]
    return "\n".join([*lines, "$EndElements"]) + "\n"
