"""Straight lines of the tip in joint values: from where an arm is, on one branch, for whole poses and for tools that look the same all around."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pieper.errors import MotionError
from pieper.motion.path import line as straight_line
from pieper.motion.path_ik import JointPath, follow_path
from pieper.spatial import rotation

if TYPE_CHECKING:
    from pieper.arm import Arm

FloatArray = NDArray[np.float64]

_ALIKE, _SAME = 1e-9, 1e-6


def tip_line(
    arm: Arm, q_start: FloatArray, T_goal: FloatArray, *, axis_tip: FloatArray | None = None, step: float
) -> JointPath | None:
    """Joint values along the line from where the tip is at `q_start`, (n,), to `T_goal`, (4, 4), its orientation turning evenly; None where it is there.

    Parameters
    ----------
    axis_tip : (3,) array, optional
        See `pieper.tasks.mover.DirectMover`.
    step : float
        Between the poses that are solved [m].

    Raises
    ------
    MotionError
        The line leaves the reach, the limits or the branch.
    """
    chain, T_start = arm.chain, arm.fk(q_start)
    if axis_tip is not None:
        turned = np.eye(4)
        turned[:3, :3] = _onto(np.array([0.0, 0.0, 1.0]), axis_tip)
        chain = chain.with_tool(turned)
        end = np.array(T_goal)
        end[:3, :3] = _onto(T_start[:3, :3] @ axis_tip, T_goal[:3, :3] @ axis_tip) @ T_start[:3, :3]
        T_start, T_goal = T_start @ turned, end @ turned
    if np.abs(T_goal - T_start).max() < _ALIKE:
        return None
    path = follow_path(
        chain, straight_line(T_start, T_goal), q_start=q_start, target="pose" if axis_tip is None else "axis", step=step
    )
    if path.broken is not None:
        raise MotionError(f"the straight line breaks: {path.broken}")
    apart = np.abs(path.q[0] - q_start)
    if apart.max() > _SAME:
        name = arm.joint_names[int(np.argmax(apart))]
        raise MotionError(
            f"the straight line cannot be followed from here: joint {name!r} would have to begin {apart.max():.2f} rad or m away, "
            "not to leave its limits"
        )
    return path


def _onto(a: FloatArray, b: FloatArray) -> FloatArray:
    """(3, 3) the smallest turn that brings one direction onto another."""
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    turn = np.cross(a, b)
    sine, cosine = float(np.linalg.norm(turn)), float(a @ b)
    if sine < _ALIKE:
        if cosine > 0.0:
            return np.eye(3)
        turn = np.cross(a, np.eye(3)[int(np.argmin(np.abs(a)))])
    return np.asarray(rotation.from_rotation_vector(np.arctan2(sine, cosine) * turn / np.linalg.norm(turn)))
