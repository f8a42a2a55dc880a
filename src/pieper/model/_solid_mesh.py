"""Solids that shapes are made of, and their triangles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from pieper.errors import ArrayError
from pieper.model.description import Box, Capsule, Cylinder, Sphere

FloatArray = NDArray[np.float64]

IntArray = NDArray[np.int64]

ROLES = ("base", "link", "housing", "flange", "mark", "tool")
"""What a part is for; a viewer colours by it. ``mark`` points along the x axis of the tip."""


@dataclass(frozen=True)
class Taper:
    """The convex hull of two spheres: `radius` at ``z = -length / 2``, `end_radius` at ``z = length / 2`` [m]."""

    radius: float
    end_radius: float
    length: float


@dataclass(frozen=True)
class Drum:
    """A cylinder about z, centred on its frame, whose rims are rounded with the radius `rim` [m]."""

    radius: float
    length: float
    rim: float


Solid: TypeAlias = Box | Cylinder | Capsule | Sphere | Taper | Drum


@dataclass(frozen=True, eq=False)
class Part:
    """One solid of an arm.

    Attributes
    ----------
    link : int
        Number of axes that move it, 0 for the base.
    role : str
        One of `ROLES`.
    solid : Solid
    T_link_part : (4, 4) array
        Where it is in the frame ``chain.frame(link)`` [m, -].
    """

    link: int
    role: str
    solid: Solid
    T_link_part: FloatArray

    def __post_init__(self) -> None:
        T = np.array(self.T_link_part, dtype=np.float64)
        T.setflags(write=False)
        object.__setattr__(self, "T_link_part", T)


class Triangles(NamedTuple):
    """A closed surface: `vertices` (k, 3) [m], `faces` (f, 3) of indices, counter-clockwise seen from outside."""

    vertices: FloatArray
    faces: IntArray


def as_mesh(solid: Solid | Part, *, sections: int = 32) -> Triangles:
    """The surface of a solid as triangles, closed and turned outwards.

    Parameters
    ----------
    solid : Box, Cylinder, Capsule, Sphere, Taper, Drum or Part
        A solid in its own frame; the vertices of a `Part` are in the frame of its link.
    sections : int
        Corners of a circle, at least 3. Round surfaces are polyhedra inside the solid.

    Returns
    -------
    Triangles
        `vertices` (k, 3) [m], `faces` (f, 3); every edge belongs to two faces.

    Raises
    ------
    ArrayError
        Fewer than three sections, or something that is not a solid.

    Examples
    --------
    >>> mesh = as_mesh(Cylinder(0.5, 2.0), sections=4)
    >>> mesh.vertices.shape, mesh.faces.shape
    ((10, 3), (16, 3))
    """
    if sections < 3:
        raise ArrayError(f"sections must be at least 3, the corners of a triangle, got {sections}")
    if isinstance(solid, Part):
        mesh = as_mesh(solid.solid, sections=sections)
        T = solid.T_link_part
        return Triangles(mesh.vertices @ T[:3, :3].T + T[:3, 3], mesh.faces)
    if isinstance(solid, Box):
        return _box(solid)
    return _revolved(_profile(solid, max(2, sections // 4)), sections)


def merge(meshes: list[Triangles]) -> Triangles:
    """Several surfaces as one; each stays closed."""
    if not meshes:
        return Triangles(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64))
    first = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes[:-1])])
    faces = np.vstack([mesh.faces + k for mesh, k in zip(meshes, first, strict=True)])
    return Triangles(np.vstack([mesh.vertices for mesh in meshes]), faces)


def _box(box: Box) -> Triangles:
    signs = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], dtype=np.float64)
    quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    faces = [[q[i] for i in corner] for q in quads for corner in ((0, 1, 2), (0, 2, 3))]
    return Triangles(signs * 0.5 * box.size, np.array(faces, dtype=np.int64))


def _profile(solid: Solid, steps: int) -> FloatArray:
    """(k, 2) radius and height from the lower pole to the upper one, poles left out."""
    quarter = np.linspace(0.0, 0.5 * np.pi, steps + 1)
    if isinstance(solid, Sphere):
        solid = Taper(solid.radius, solid.radius, 0.0)
    if isinstance(solid, Capsule):
        solid = Taper(solid.radius, solid.radius, solid.length)
    if isinstance(solid, Taper):
        return _taper_profile(solid, steps)
    if isinstance(solid, Cylinder):
        half = 0.5 * solid.length
        return np.array([[0.0, -half], [solid.radius, -half], [solid.radius, half], [0.0, half]])
    if isinstance(solid, Drum):
        half, inner = 0.5 * solid.length - solid.rim, solid.radius - solid.rim
        rim = solid.rim * np.column_stack([np.sin(quarter), -np.cos(quarter)]) + [inner, -half]
        upper = (rim * [1.0, -1.0])[::-1]
        return np.vstack([[0.0, -half - solid.rim], rim, upper, [0.0, half + solid.rim]])
    raise ArrayError(f"solid must be a Box, Cylinder, Capsule, Sphere, Taper or Drum, got {type(solid).__name__}")


def _taper_profile(taper: Taper, steps: int) -> FloatArray:
    half = 0.5 * taper.length
    lean = taper.radius - taper.end_radius
    if abs(lean) >= taper.length:  # the larger sphere holds the smaller one
        r, z = (taper.radius, -half) if lean >= 0.0 else (taper.end_radius, half)
        around = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 2 * steps + 1)
        return np.column_stack([r * np.cos(around), z + r * np.sin(around)])
    touch = float(np.arcsin(lean / taper.length))  # where the cone leaves the spheres
    lower, upper = np.linspace(-0.5 * np.pi, touch, steps + 1), np.linspace(touch, 0.5 * np.pi, steps + 1)
    return np.vstack(
        [
            np.column_stack([taper.radius * np.cos(lower), -half + taper.radius * np.sin(lower)]),
            np.column_stack([taper.end_radius * np.cos(upper), half + taper.end_radius * np.sin(upper)]),
        ]
    )


def _revolved(profile: FloatArray, sections: int) -> Triangles:
    """A profile turned about z; its first and last point are the poles."""
    around = 2.0 * np.pi * np.arange(sections) / sections
    rings = profile[1:-1]
    ring = np.column_stack([np.cos(around), np.sin(around)])
    body = np.concatenate(
        [np.column_stack([radius * ring, np.full(sections, height)]) for radius, height in rings], axis=0
    )
    vertices = np.vstack([[0.0, 0.0, profile[0, 1]], body, [0.0, 0.0, profile[-1, 1]]])
    k = np.arange(sections, dtype=np.int64)
    after = (k + 1) % sections
    faces = [np.column_stack([np.zeros_like(k), 1 + after, 1 + k])]
    for low in range(1, 1 + sections * (len(rings) - 1), sections):
        high = low + sections
        faces.append(np.column_stack([low + k, low + after, high + after]))
        faces.append(np.column_stack([low + k, high + after, high + k]))
    top = 1 + sections * (len(rings) - 1)
    faces.append(np.column_stack([top + k, top + after, np.full_like(k, len(vertices) - 1)]))
    return Triangles(vertices, np.vstack(faces))
