"""Meshes with fewer triangles, for films and reports: corners in one cell of a grid become one."""

from __future__ import annotations

import numpy as np

from wbc.robot.geometry import Mesh

FINEST, GROWTH = 1e-3, 1.25  # m of the first grid tried, and how much coarser the next is


def simplified(mesh: Mesh, cell: float) -> Mesh:
    """Return a mesh whose corners within a cell of a grid are one, their mean.

    No corner moves farther than the cell's diagonal. Triangles that lose their area are left out;
    a mesh of which nothing would be left stays as it is.

    Parameters
    ----------
    cell:
        Side of the grid's cells [m].
    """
    cells = np.floor(mesh.vertices / cell).astype(np.int64)
    _, group, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    group = group.reshape(-1)
    means = np.zeros((len(counts), 3))
    np.add.at(means, group, mesh.vertices)
    means /= counts[:, None]
    faces = group[mesh.faces]
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    faces = np.unique(np.sort(faces, axis=1), axis=0)  # either winding is allowed
    if not len(faces):
        return mesh
    used, faces = np.unique(faces, return_inverse=True)
    return Mesh(mesh.name, means[used], faces.reshape(-1, 3), mesh.colour)


def limit_triangles(meshes: list[Mesh], triangles: int) -> list[Mesh]:
    """Return meshes with at most so many triangles in all, on the finest grid that will do."""
    made, cell = meshes, FINEST
    while sum(len(mesh.faces) for mesh in made) > triangles and cell < 1.0:
        made = [simplified(mesh, cell) for mesh in meshes]
        cell *= GROWTH
    return made
