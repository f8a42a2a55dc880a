"""Links and joints, as a description of a robot is made of them."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf
from typing import TYPE_CHECKING

import numpy as np

from pieper.model._arrays import FloatArray, frozen, identity

if TYPE_CHECKING:
    from pieper.model.geometry import Collision, Inertial, Visual

JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")

MAX_NAME = 1000  # characters

_MOVING = frozenset({"revolute", "continuous", "prismatic"})


def _x_axis() -> FloatArray:
    return np.array([1.0, 0.0, 0.0])


@dataclass(frozen=True, eq=False)
class Link:
    """A rigid body with a frame of its own."""

    name: str
    visuals: tuple[Visual, ...] = ()
    collisions: tuple[Collision, ...] = ()
    inertial: Inertial | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "visuals", tuple(self.visuals))
        object.__setattr__(self, "collisions", tuple(self.collisions))


@dataclass(frozen=True)
class Mimic:
    """The joint follows another one: ``value = multiplier * value_of(joint) + offset`` [rad or m]."""

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True, eq=False)
class Joint:
    """The connection from a parent link to a child link.

    Attributes
    ----------
    name : str
    type : str
        One of `JOINT_TYPES`.
    parent, child : str
        Link names. The frame of the child is the frame of the joint, moved by the joint.
    T_parent_joint : (4, 4) array
        Joint frame in the parent frame at joint value 0 [m, -].
    axis : (3,) array
        Direction of the axis in the joint frame, normalised here [-].
    lower, upper : float
        Limits [rad or m]; infinite where there are none.
    velocity, effort : float
        Limits [rad/s or m/s, N m or N]; infinite where there are none.
    mimic : Mimic or None
    """

    name: str
    type: str
    parent: str
    child: str
    T_parent_joint: FloatArray = field(default_factory=identity)
    axis: FloatArray = field(default_factory=_x_axis)
    lower: float = -inf
    upper: float = inf
    velocity: float = inf
    effort: float = inf
    mimic: Mimic | None = None

    def __post_init__(self) -> None:
        axis = np.array(frozen(self.axis, (3,), f"axis of joint {self.name!r}"))
        largest = float(np.abs(axis).max())
        if 0.0 < largest < inf:  # a zero or infinite axis stays as it is: Description refuses it by name
            axis = axis / largest
            axis = axis / float(np.sqrt(axis @ axis))
        object.__setattr__(
            self, "T_parent_joint", frozen(self.T_parent_joint, (4, 4), f"T_parent_joint of joint {self.name!r}")
        )
        object.__setattr__(self, "axis", frozen(axis, (3,), "axis"))

    @property
    def moves(self) -> bool:
        """True for revolute, continuous and prismatic joints, mimicking ones included."""
        return self.type in _MOVING
