"""Surfaces to draw, as triangles: boxes, cylinders, capsules and spheres, made with NumPy alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import ArrayLike, NDArray

    from pieper.model.chain import FloatArray

Color: TypeAlias = tuple[int, int, int]
"""Red, green, blue, 0..255."""

_AROUND = 24  # corners of a circle
_SPHERE_ROWS = 6  # rows of a half sphere


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
    """One surface of several, in the colour of the first.

    >>> len(merged([box([1.0, 1.0, 1.0]), box([2.0, 0.1, 0.1])]).faces)
    24
    """
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


def box(size: ArrayLike, color: Color | None = None) -> Surface:
    """A box with edges `size` (3,) [m], centred on its frame."""
    half = 0.5 * np.asarray(size, dtype=np.float64)
    sides = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            u, v = np.roll(np.eye(3), axis, axis=1)[1:]  # u x v is the axis
            normal = sign * np.cross(u, v)
            corners = np.array(
                [normal - sign * u - v, normal + sign * u - v, normal + sign * u + v, normal - sign * u + v]
            )
            sides.append(
                Surface((corners * half).astype(np.float32), np.array([[0, 1, 2], [0, 2, 3]], np.uint32), color)
            )
    return merged(sides)


def cylinder(radius: float, length: float, color: Color | None = None) -> Surface:
    """A cylinder about z, centred on its frame [m]."""
    half = 0.5 * length
    rim = np.array([[0.0, -half], [radius, -half]])
    return merged(
        [
            _turned(rim, color),
            _turned(np.array([[radius, -half], [radius, half]]), color),
            _turned(-rim[::-1] * [-1.0, 1.0], color),
        ]
    )


def capsule(radius: float, length: float, color: Color | None = None) -> Surface:
    """A cylinder about z with half spheres beyond its `length`, centred on its frame [m]."""
    angle = np.linspace(-0.5 * np.pi, 0.0, _SPHERE_ROWS + 1)
    lower = np.column_stack([radius * np.cos(angle), radius * np.sin(angle) - 0.5 * length])
    return _turned(np.vstack([lower, lower[::-1] * [1.0, -1.0]]), color)


def sphere(radius: float, color: Color | None = None) -> Surface:
    """A sphere centred on its frame [m]."""
    return capsule(radius, 0.0, color)


def _turned(profile: FloatArray, color: Color | None) -> Surface:
    """The surface that a profile of rows (radius, z), from below, sweeps about z."""
    angle = np.linspace(0.0, 2.0 * np.pi, _AROUND, endpoint=False)
    r, z = profile[:, :1], np.broadcast_to(profile[:, 1:], (len(profile), _AROUND))
    vertices = np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=-1).reshape(-1, 3)
    row, column = np.meshgrid(np.arange(len(profile) - 1), np.arange(_AROUND), indexing="ij")
    here, beside = row * _AROUND + column, row * _AROUND + (column + 1) % _AROUND
    faces = np.stack([here, beside, beside + _AROUND, here, beside + _AROUND, here + _AROUND], axis=-1).reshape(-1, 3)
    corners = vertices[faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return Surface(vertices.astype(np.float32), faces[area > 0.0].astype(np.uint32), color)
