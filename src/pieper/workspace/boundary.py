"""The surface of the workspace: where the share of reachable orientations passes a level, as triangles.

Marching cubes over the centres of the voxels (scikit-image, extra ``maps``). At half a pose the surface is the boundary of the
reachable workspace, at a half it encloses where every second orientation is reached.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pieper.errors import ArrayError, MapError, MissingExtraError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from pieper.spatial._checks import FloatArray
    from pieper.workspace.map import WorkspaceMap

MOST_VOXELS = 20_000_000
"""Voxels of a map whose surface is made, to bound the memory."""


class Boundary(NamedTuple):
    """Triangles in the base frame."""

    vertices: FloatArray
    """(v, 3) corners [m]."""
    faces: NDArray[np.int64]
    """(f, 3) corners of each triangle, anticlockwise from outside."""
    value: FloatArray
    """(v,) dexterity at the corners, the level up to rounding."""

    @property
    def area(self) -> float:
        """Of the surface [m^2]."""
        a, b, c = np.moveaxis(self.vertices[self.faces], 1, 0)
        return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=-1).sum())

    @property
    def volume(self) -> float:
        """Enclosed [m^3]."""
        a, b, c = np.moveaxis(self.vertices[self.faces], 1, 0)
        return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def boundary(found: WorkspaceMap, *, level: float | None = None) -> Boundary:
    """The surface on which the dexterity passes a level.

    Parameters
    ----------
    found : WorkspaceMap
        Whole and three-dimensional.
    level : float, optional
        Share of orientations between 0 and 1; half a pose when not given, which is the boundary of what is reachable.

    Returns
    -------
    Boundary

    Raises
    ------
    ArrayError
        A level outside (0, 1), a single layer, or a map that is not finished.
    MapError
        Nothing reaches the level, or the map has more than `MOST_VOXELS` voxels.
    MissingExtraError
        scikit-image is not installed.

    References
    ----------
    Lewiner, Lopes, Vieira, Tavares, Efficient implementation of marching cubes' cases with topological guarantees,
    J. Graphics Tools 8(2) (2003) 1-15.
    """
    if level is None:
        level = 0.5 / found.samples
    if not 0.0 < level < 1.0:
        raise ArrayError(f"level must be a share between 0 and 1, got {level!r}")
    found.require_complete("a surface")
    grid = found.grid
    if min(grid.shape) < 2:
        raise ArrayError(f"a surface needs a map of more than one layer, this one has {grid.shape} voxels")
    if grid.voxels > MOST_VOXELS:
        raise MapError(
            f"a surface over {grid.voxels} voxels takes too much memory (at most {MOST_VOXELS}); take larger voxels or a smaller box"
        )
    marching_cubes: Any
    try:
        from skimage.measure import marching_cubes
    except ImportError as cause:
        raise MissingExtraError("scikit-image", "maps", "the surface of a map") from cause
    field = np.zeros([n + 2 for n in grid.shape], dtype=np.float32)  # a shell of nothing, so that the surface closes
    for region, _, (dexterity,) in found.pieces("dexterity"):
        inside = tuple(slice(part.start + 1, part.stop + 1) for part in region)
        field[inside] = dexterity.reshape([part.stop - part.start for part in region])
    if float(field.max()) <= level:
        raise MapError(f"no voxel reaches a share of {level:.3g}; the greatest is {float(field.max()):.3g}")
    vertices, faces, _, value = marching_cubes(
        field, level=level, spacing=(grid.voxel,) * 3, gradient_direction="ascent"
    )
    made = Boundary(vertices + np.array(grid.origin) - grid.voxel, np.asarray(faces, dtype=np.int64), np.asarray(value))
    return made if made.volume >= 0.0 else made._replace(faces=made.faces[:, ::-1])
