"""Exact distances between solids: the only file that knows Coal (https://github.com/coal-library/coal)."""

from __future__ import annotations

from functools import lru_cache
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pieper.errors import MissingExtraError, WorldError
from pieper.model.description import Box, Capsule, Cylinder, Geometry, Mesh, Sphere

if TYPE_CHECKING:
    from pieper.model.chain import FloatArray

LARGEST_MESH = 100_000_000
"""Bytes of a mesh file."""


def import_coal() -> Any:
    """The module ``coal``, or an error that says how to install it."""
    try:
        return import_module("coal")
    except ImportError as cause:
        raise MissingExtraError("coal", "plan", "collision detection") from cause


class Gap(NamedTuple):
    """How far two solids are apart: `distance` [m], below 0 by the depth where they overlap, and the nearest points (3,) of either."""

    distance: float
    p_first: FloatArray
    p_second: FloatArray


class Measure:
    """Distances between two solids of Coal; keeps what a query needs, for one thread."""

    def __init__(self) -> None:
        self._coal = import_coal()
        self._request = self._coal.DistanceRequest()
        self._request.enable_signed_distance = True
        self._result = self._coal.DistanceResult()

    def placed(self, T: FloatArray) -> Any:
        """A pose (4, 4) as Coal takes it."""
        return self._coal.Transform3s(T[:3, :3], T[:3, 3])

    def distance(self, first: Any, T_first: Any, second: Any, T_second: Any) -> float:
        """Metres between two solids, below 0 where they overlap; 0 where a mesh of the world is cut."""
        self._result.clear()
        return float(self._coal.distance(first, T_first, second, T_second, self._request, self._result))

    def gap(self, first: Any, T_first: Any, second: Any, T_second: Any) -> Gap:
        """The same with the nearest points."""
        distance = self.distance(first, T_first, second, T_second)
        return Gap(distance, np.array(self._result.getNearestPoint1()), np.array(self._result.getNearestPoint2()))


def as_coal(solid: Geometry, *, hull: bool, name: str = "") -> Any:
    """A solid for Coal.

    Parameters
    ----------
    solid : Geometry
    hull : bool
        Take the convex hull of a mesh, which holds it; otherwise its triangles, without what they enclose.
    name : str
        For messages.

    Raises
    ------
    MissingExtraError
        Coal is not installed.
    WorldError
        A mesh file that cannot be read, or has no volume to take the hull of.
    """
    coal = import_coal()
    if isinstance(solid, Box):
        return coal.Box(*map(float, solid.size))
    if isinstance(solid, Cylinder):
        return coal.Cylinder(float(solid.radius), float(solid.length))
    if isinstance(solid, Capsule):
        return coal.Capsule(float(solid.radius), float(solid.length))
    if isinstance(solid, Sphere):
        return coal.Sphere(float(solid.radius))
    return _mesh(_path(solid), tuple(map(float, solid.scale)), hull, name)


def vertices_of(mesh: Mesh, name: str = "") -> FloatArray:
    """Corners (k, 3) of a mesh file, scaled [m]."""
    model = _mesh(_path(mesh), tuple(map(float, mesh.scale)), False, name)
    return np.array(model.vertices(), dtype=np.float64).reshape(-1, 3)


def _path(mesh: Mesh) -> str:
    return mesh.path or mesh.filename


@lru_cache(maxsize=64)
def _mesh(path: str, scale: tuple[float, float, float], hull: bool, name: str) -> Any:
    coal = import_coal()
    file = Path(path)
    try:
        size = file.stat().st_size
    except OSError as cause:
        raise WorldError(f"mesh {name!r}: {path}: {cause.strerror}") from None
    if size > LARGEST_MESH:
        raise WorldError(f"mesh {name!r}: {path} has {size // 10**6} MB, more than {LARGEST_MESH // 10**6} MB")
    try:
        model = coal.MeshLoader().load(path, np.array(scale))
        vertices = np.array(model.vertices(), dtype=np.float64).reshape(-1, 3)
    except Exception as cause:  # noqa: BLE001  whatever the reader of meshes throws
        reason = _reason(cause, path)
        raise WorldError(f"mesh {name!r}: {path} cannot be read: {reason}; give an STL, OBJ, PLY or DAE file") from None
    if len(vertices) == 0 or not np.isfinite(vertices).all():
        raise WorldError(f"mesh {name!r}: {path} has no finite corners")
    return _hull(coal, vertices, path, name) if hull else model


def _reason(cause: Exception, path: str) -> str:
    """What the reader says of the file, without the place in its own source and without the name again."""
    said = " ".join(str(cause).split()).rpartition("message: ")[2].partition(" Hint: ")[0]
    return said.removeprefix(f"Could not load resource {path}").strip().rstrip(".") or "it holds no mesh"


def _hull(coal: Any, vertices: FloatArray, path: str, name: str) -> Any:
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(vertices)
    except QhullError:
        raise WorldError(f"mesh {name!r}: {path} is flat; a solid needs a volume") from None
    kept = hull.vertices
    where = np.full(len(vertices), -1)
    where[kept] = np.arange(len(kept))
    corners = vertices[kept]
    points, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    for corner in corners:
        points.append(corner)
    for face, equation in zip(where[hull.simplices], hull.equations, strict=True):
        i, j, k = map(int, face)
        turned = np.cross(corners[j] - corners[i], corners[k] - corners[i]) @ equation[:3] < 0.0
        triangles.append(coal.Triangle(i, k, j) if turned else coal.Triangle(i, j, k))
    return coal.Convex(points, triangles)
