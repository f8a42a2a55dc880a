"""Surfaces to draw, as triangles: placed, merged, with sharp edges, thinned out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import ArrayLike, NDArray


Color: TypeAlias = tuple[int, int, int]
"""Red, green, blue, 0..255."""

SHARP = np.radians(35.0)
"""Edges between triangles that are bent by more are seen as edges [rad]."""


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles in the frame of what they belong to.

    Attributes
    ----------
    vertices : (v, 3) float32 array
        [m].
    faces : (f, 3) uint32 array
        Corners of each triangle, counted anticlockwise from outside.
    color : tuple of 3 int, or None
        0..255; None where the viewer may choose.
    """

    vertices: NDArray[np.float32]
    faces: NDArray[np.uint32]
    color: Color | None = None

    def moved(self, T: ArrayLike) -> Surface:
        """The surface in another frame, where its own is at `T` (4, 4)."""
        pose = np.asarray(T, dtype=np.float64)
        vertices = self.vertices @ pose[:3, :3].T + pose[:3, 3]
        return Surface(vertices.astype(np.float32), self.faces, self.color)


def merged(surfaces: Iterable[Surface]) -> Surface:
    """One surface of several, in the colour of the first."""
    listed = list(surfaces)
    starts = np.cumsum([0, *(len(surface.vertices) for surface in listed)])
    return Surface(
        np.concatenate([surface.vertices for surface in listed] or [np.empty((0, 3), np.float32)]),
        np.concatenate(
            [surface.faces + np.uint32(start) for surface, start in zip(listed, starts, strict=False)]
            or [np.empty((0, 3), np.uint32)]
        ),
        listed[0].color if listed else None,
    )


def creased(surface: Surface, *, sharp: float = SHARP) -> Surface:
    """The same surface with vertices of its own on both sides of every sharp edge, so that shading does not round it off.

    Examples
    --------
    >>> from pieper.model.description import Box
    >>> from pieper.model.shape import as_mesh
    >>> cube = as_mesh(Box([1.0, 1.0, 1.0]))
    >>> len(cube.vertices), len(creased(Surface(cube.vertices, cube.faces)).vertices)
    (8, 24)
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    faces = surface.faces.astype(np.int64)
    count = len(faces)
    corners = surface.vertices.astype(np.float64)[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0.0)
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    of_face = np.repeat(np.arange(count), 3)
    order = np.lexsort(edges.T)
    same = (edges[order[1:]] == edges[order[:-1]]).all(axis=1)
    one, other = of_face[order[1:]][same], of_face[order[:-1]][same]
    smooth = np.einsum("ij,ij->i", normals[one], normals[other]) > np.cos(sharp)
    one, other = one[smooth], other[smooth]
    _, patch = connected_components(coo_array((np.ones(len(one)), (one, other)), shape=(count, count)), directed=False)
    keys = faces.ravel() * (int(patch.max(initial=0)) + 1) + np.repeat(patch, 3)
    _, first, corner = np.unique(keys, return_index=True, return_inverse=True)
    vertices = surface.vertices[faces.ravel()[first]]
    return Surface(np.asarray(vertices, np.float32), corner.reshape(-1, 3).astype(np.uint32), surface.color)


def welded(surface: Surface) -> Surface:
    """The same surface without triangles of no area and with one vertex where several are at the same place, as in STL files."""
    _, first, place = np.unique(surface.vertices, axis=0, return_index=True, return_inverse=True)
    faces = place.reshape(-1)[surface.faces]
    kept = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    return Surface(surface.vertices[first], faces[kept].astype(np.uint32), surface.color)


def thinned(surface: Surface, most: int) -> Surface:
    """A surface of at most `most` triangles: vertices in one cell of a grid become one, in the finest grid that does.

    The error is at most the diagonal of a cell.
    """
    cells = 256
    while len(surface.faces) > most:
        low = surface.vertices.min(axis=0)
        extent = float((surface.vertices.max(axis=0) - low).max())
        cell = np.floor((surface.vertices - low) * (cells / max(extent, 1e-30))).astype(np.int64)
        _, inverse, members = np.unique(cell, axis=0, return_inverse=True, return_counts=True)
        inverse = inverse.reshape(-1)
        means = np.stack([np.bincount(inverse, column) for column in surface.vertices.T.astype(np.float64)], axis=1)
        rough = Surface((means / members[:, None]).astype(np.float32), inverse[surface.faces].astype(np.uint32))
        coarse = welded(rough)
        _, unique = np.unique(np.sort(coarse.faces, axis=1), axis=0, return_index=True)
        if len(unique) <= most or cells <= 4:
            return Surface(coarse.vertices, coarse.faces[np.sort(unique)], surface.color)
        cells = int(cells / 1.26)
    return surface


def shrunk(surface: Surface, by: float) -> Surface:
    """The same surface, a little inside itself: every vertex moved by `by` [m] against its normal."""
    corners = surface.vertices.astype(np.float64)[surface.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sums = np.zeros((len(surface.vertices), 3))
    np.add.at(sums, surface.faces.ravel(), np.repeat(normals, 3, axis=0))
    lengths = np.linalg.norm(sums, axis=1, keepdims=True)
    outward = np.divide(sums, lengths, out=np.zeros_like(sums), where=lengths > 0.0)
    return Surface((surface.vertices - by * outward).astype(np.float32), surface.faces, surface.color)
