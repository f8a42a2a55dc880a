"""What a solver is asked for: a whole pose, or only some rows of one.

A target is a pose ``T_base_tip`` and a choice of its rows: the three of the position, and the three of the rotation vector that
is left to turn. Rows that are left out are free. What to do with an orientation that does not matter much has three
answers, and they are three functions here:

- `ignore_orientation`: its rows are left out, the tip may turn as it likes;
- `hold_orientation`: its rows stay, and ask for the orientation that the tip has at the start;
- `weight_orientation`: its rows stay with another weight, so that a pose out of reach is missed in orientation rather
  than in position, or the other way round.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np

from pieper._native import kernels
from pieper.errors import ArrayError
from pieper.kinematics.fk import fk
from pieper.spatial._checks import FloatArray, poses, stack

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from pieper.model.chain import Chain

Axes = Literal["base", "tool"]

_ALL = (1.0, 1.0, 1.0, 1.0, 1.0, 1.0)
_NAMES = ("x", "y", "z", "rx", "ry", "rz")


@dataclass(frozen=True, eq=False)
class Target:
    """A pose, and which of its rows count. Made by the functions of this module.

    Attributes
    ----------
    T_base_tip : (..., 4, 4) array
        The pose of the tip in the base frame [m, -]. Parts that do not count hold any value.
    weights : tuple of 6 floats
        One for each row: position x, y, z and rotation vector x, y, z. 0 leaves a row out. The nearest pose minimises the
        sum of ``(weight * error)^2`` with errors in metres and radians.
    position_axes, rotation_axes : "base" or "tool"
        The axes that the rows are taken along; "tool" means those of the target pose.
    axis : tuple of 3 floats, optional
        A unit vector in tool axes. Of the rotation only its direction counts then.
    """

    T_base_tip: FloatArray
    weights: tuple[float, ...] = _ALL
    position_axes: Axes = "base"
    rotation_axes: Axes = "base"
    axis: tuple[float, ...] | None = None

    @cached_property
    def rows(self) -> kernels.TargetRows:
        """The choice of rows in the form that the compiled solver takes."""
        if self.axis is not None:
            rotation = kernels.RotationTarget.axis
        else:
            rotation = kernels.RotationTarget.full if any(self.weights[3:]) else kernels.RotationTarget.free
        axis = (0.0, 0.0, 1.0) if self.axis is None else self.axis
        return kernels.TargetRows(
            self.weights, self.position_axes == "tool", self.rotation_axes == "tool", rotation, axis
        )

    @cached_property
    def position_rows(self) -> kernels.TargetRows | None:
        """The position rows alone; None where there is no rotation to leave out, or no position."""
        if not self.counts_position or not any(self.weights[3:]):
            return None
        weights = (*self.weights[:3], 0.0, 0.0, 0.0)
        return kernels.TargetRows(
            weights, self.position_axes == "tool", False, kernels.RotationTarget.free, (0.0, 0.0, 1.0)
        )

    @property
    def counts_position(self) -> bool:
        """True when some row of the position counts."""
        return any(self.weights[:3])


def pose(T_base_tip: ArrayLike) -> Target:
    """Position and orientation: all six rows.

    Parameters
    ----------
    T_base_tip : (..., 4, 4) array
        Poses of the tip in the base frame [m, -].

    Returns
    -------
    Target

    Raises
    ------
    ArrayError
        Wrong shape, not finite, or not a rotation; the message tells the deviation and, in a batch, the index.

    Examples
    --------
    >>> import numpy as np
    >>> pose(np.eye(4)).weights
    (1.0, 1.0, 1.0, 1.0, 1.0, 1.0)
    """
    return Target(poses(T_base_tip, "T_base_tip"))


def ignore_orientation(p_base: ArrayLike) -> Target:
    """Position only: the three rows of the rotation are left out, and the tip may turn as it likes.

    Parameters
    ----------
    p_base : (..., 3) array
        Positions of the tip in the base frame [m].

    Returns
    -------
    Target

    Raises
    ------
    ArrayError
        Wrong shape or not finite.

    Examples
    --------
    >>> ignore_orientation([0.3, 0.3, 0.3]).weights
    (1.0, 1.0, 1.0, 0.0, 0.0, 0.0)
    """
    return Target(_poses_at(p_base), weights=(1.0, 1.0, 1.0, 0.0, 0.0, 0.0))


def hold_orientation(p_base: ArrayLike, *, chain: Chain, q: ArrayLike) -> Target:
    """Another position with the orientation that the tip has at `q`.

    In a velocity loop this is what ``omega = 0`` in a six-row Jacobian does.

    Parameters
    ----------
    p_base : (..., 3) array
        Positions of the tip in the base frame [m].
    chain : Chain
    q : (..., n) array
        Joint values at the start [rad or m]; leading axes broadcast with those of `p_base`.

    Returns
    -------
    Target

    Raises
    ------
    ArrayError
        Wrong shape or not finite.
    """
    p = stack(p_base, (3,), "p_base")
    start = fk(chain, q)
    T = np.broadcast_to(start, (*np.broadcast_shapes(p.shape[:-1], start.shape[:-2]), 4, 4)).copy()
    T[..., :3, 3] = p
    return Target(T)


def weight_orientation(T_base_tip: ArrayLike, weight: float) -> Target:
    """A pose whose orientation weighs more or less than its position when both cannot be met.

    Parameters
    ----------
    T_base_tip : (..., 4, 4) array
        Poses of the tip in the base frame [m, -].
    weight : float
        Metres that one radian counts as [m/rad], above 0. A reachable pose is reached whatever the weight; where it is out
        of reach, a small weight keeps the position and gives up orientation. 1 is `pose`.

    Returns
    -------
    Target

    Raises
    ------
    ArrayError
        As `pose`, or the weight is not a positive number.
    """
    if not 0.0 < weight < np.inf:
        raise ArrayError(
            f"weight must be a positive number of metres per radian, got {weight!r}; "
            "to leave the orientation out altogether, use ignore_orientation"
        )
    return Target(poses(T_base_tip, "T_base_tip"), weights=(1.0, 1.0, 1.0, *(float(weight),) * 3))


def position_and_axis(p_base: ArrayLike, axis_base: ArrayLike, *, axis_tip: ArrayLike = (0.0, 0.0, 1.0)) -> Target:
    """A position and the direction of one tool axis: five rows; the tip may turn about that axis.

    What a drill, a torch or a suction cup needs, and all that an arm with five joints can do.

    Parameters
    ----------
    p_base : (..., 3) array
        Positions of the tip in the base frame [m].
    axis_base : (..., 3) array
        Where the tool axis is to point, in the base frame; any length but 0.
    axis_tip : (3,) array
        The tool axis in the tip frame; any length but 0.

    Returns
    -------
    Target

    Raises
    ------
    ArrayError
        Wrong shape, not finite, or a direction of length 0.

    Examples
    --------
    >>> position_and_axis([0.3, 0.3, 0.3], [0.0, 0.0, -1.0]).T_base_tip[:3, 2]
    array([ 0.,  0., -1.])
    """
    tool = _unit(axis_tip, "axis_tip")
    if tool.shape != (3,):
        raise ArrayError(f"axis_tip must have shape (3,), got {tool.shape}")
    wanted = _unit(axis_base, "axis_base")
    T = _poses_at(p_base)
    T = np.broadcast_to(T, (*np.broadcast_shapes(T.shape[:-2], wanted.shape[:-1]), 4, 4)).copy()
    T[..., :3, :3] = _turn_between(tool, wanted)
    return Target(T, axis=tuple(tool.tolist()))


def components(
    T_base_tip: ArrayLike, rows: str, *, position_axes: Axes = "base", rotation_axes: Axes = "base"
) -> Target:
    """Chosen components of a pose.

    Parameters
    ----------
    T_base_tip : (..., 4, 4) array
        Poses of the tip in the base frame [m, -]. Components that are left out may have any value.
    rows : str
        Names of the rows that count, for example ``"x y rz"``: x, y, z of the position, and rx, ry, rz of the rotation
        vector that would turn the tip to the target.
    position_axes, rotation_axes : "base" or "tool"
        The axes that the components are taken along; "tool" means the axes of the target pose.

    Returns
    -------
    Target

    Raises
    ------
    ArrayError
        As `pose`, or the rows or axes have another name.

    Examples
    --------
    >>> import numpy as np
    >>> components(np.eye(4), "x y rz").weights
    (1.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    """
    names = rows.split()
    if not names or len(set(names)) != len(names) or not set(names) <= set(_NAMES):
        raise ArrayError(f"rows must be names out of {', '.join(_NAMES)}, each once, got {rows!r}")
    for key, axes in (("position_axes", position_axes), ("rotation_axes", rotation_axes)):
        if axes not in ("base", "tool"):
            raise ArrayError(f"{key} must be 'base' or 'tool', got {axes!r}")
    weights = tuple(float(name in names) for name in _NAMES)
    T = poses(T_base_tip, "T_base_tip")
    return Target(T, weights=weights, position_axes=position_axes, rotation_axes=rotation_axes)


def _poses_at(p_base: ArrayLike) -> FloatArray:
    p = stack(p_base, (3,), "p_base")
    T = np.zeros((*p.shape[:-1], 4, 4))
    T[...] = np.eye(4)
    T[..., :3, 3] = p
    return T


def _unit(vector: ArrayLike, name: str) -> FloatArray:
    v = stack(vector, (3,), name)
    length = np.linalg.norm(v, axis=-1, keepdims=True)
    if not (length > 0.0).all():
        raise ArrayError(f"{name} must have a direction, got a vector of length 0")
    return np.asarray(v / length)


def _turn_between(a: FloatArray, b: FloatArray) -> FloatArray:
    """Some rotation that takes the unit vector `a` to `b`, (..., 3, 3): two reflections, well behaved at half a turn.

    With any unit vector m, ``R = (I - 2 h h^T)(I - 2 m m^T)`` takes `a` to `b` where ``h`` is along the reflected `a`
    minus `b`; m is taken such that the difference is not small.
    """
    m = np.eye(3)[np.argmin(np.abs(a))]
    m = m - a * (a @ m)
    m = m / np.linalg.norm(m)  # across a, so reflecting by m leaves a where it is; reflecting by a turns it round
    identity = np.eye(3)
    apart = a - b
    far = np.linalg.norm(apart, axis=-1, keepdims=True) > 1.0
    h = np.where(far, apart, a + b)
    h = h / np.linalg.norm(h, axis=-1, keepdims=True)
    reflection = identity - 2.0 * h[..., :, None] * h[..., None, :]
    # far: reflection takes a to b; near: it takes -a to b
    first = np.where(far[..., None], identity - 2.0 * np.outer(m, m), identity - 2.0 * np.outer(a, a))
    return np.asarray(reflection @ first)
