"""Solids, meshes and inertia of links: for drawing, for collisions and for the simulator."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from pieper.model._arrays import FloatArray, frozen, identity


def _ones() -> FloatArray:
    return np.ones(3)


@dataclass(frozen=True, eq=False)
class Box:
    """A box centred on its frame; `size` (3,) edge lengths [m]."""

    size: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "size", frozen(self.size, (3,), "size of a box"))


@dataclass(frozen=True)
class Cylinder:
    """A cylinder about z, centred on its frame [m]."""

    radius: float
    length: float


@dataclass(frozen=True)
class Capsule:
    """A cylinder about z with half spheres beyond its `length`, centred on its frame [m]."""

    radius: float
    length: float


@dataclass(frozen=True)
class Sphere:
    """A sphere centred on its frame [m]."""

    radius: float


@dataclass(frozen=True, eq=False)
class Mesh:
    """A mesh file.

    Attributes
    ----------
    filename : str
        As written in the description, for example ``package://my_robot/meshes/link_1.stl``.
    scale : (3,) array
        Factors along x, y, z [-].
    path : str or None
        The file that `filename` was resolved to; None when it was not found.
    """

    filename: str
    scale: FloatArray = field(default_factory=_ones)
    path: str | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "scale", frozen(self.scale, (3,), f"scale of mesh {self.filename!r}"))


Geometry: TypeAlias = Box | Cylinder | Capsule | Sphere | Mesh


@dataclass(frozen=True)
class Material:
    """How a surface looks: `rgba` in 0..1, or None; `texture` file name as written, or None."""

    name: str = ""
    rgba: tuple[float, float, float, float] | None = None
    texture: str | None = None


@dataclass(frozen=True, eq=False)
class Visual:
    """A shape to draw; `T_link_shape` (4, 4) places it in the link frame [m, -]."""

    geometry: Geometry
    T_link_shape: FloatArray = field(default_factory=identity)
    material: Material | None = None
    name: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "T_link_shape", frozen(self.T_link_shape, (4, 4), "T_link_shape"))


@dataclass(frozen=True, eq=False)
class Collision:
    """A shape to collide with; `T_link_shape` (4, 4) places it in the link frame [m, -]."""

    geometry: Geometry
    T_link_shape: FloatArray = field(default_factory=identity)
    name: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "T_link_shape", frozen(self.T_link_shape, (4, 4), "T_link_shape"))


@dataclass(frozen=True, eq=False)
class Inertial:
    """Mass [kg], the frame at the centre of mass, and the (3, 3) inertia about it in that frame [kg m^2]."""

    mass: float
    T_link_inertial: FloatArray
    inertia: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "T_link_inertial", frozen(self.T_link_inertial, (4, 4), "T_link_inertial"))
        object.__setattr__(self, "inertia", frozen(self.inertia, (3, 3), "inertia"))
