"""Joint values that a figure draws: a trajectory as it runs between its points, or the rows of an array."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pieper.errors import ArrayError
from pieper.kinematics.joints import as_joints
from pieper.motion.trajectory import Trajectory

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from pieper.arm import Arm
    from pieper.spatial._checks import FloatArray

_PER_SEGMENT = 24  # samples between two points of a trajectory


class _Curves(NamedTuple):
    """Joint values to draw: `q` (m, n) and `dq` over `t` (m,), densely, and the points `q_points` over `t_points` themselves."""

    t: FloatArray
    q: FloatArray
    dq: FloatArray | None
    t_points: FloatArray
    q_points: FloatArray


def joint_curves(arm: Arm, q: Trajectory | ArrayLike) -> _Curves:
    """The curves of a `Trajectory`, or of rows (m, n) [rad or m], over time [s] or the number of the row."""
    if isinstance(q, Trajectory):
        trajectory = q.in_order(arm.joint_names)
        u = np.linspace(0.0, 1.0, _PER_SEGMENT + 1)[:-1]
        t = (trajectory.t[:-1, None] + u * np.diff(trajectory.t)[:, None]).ravel()
        t = np.append(t, trajectory.t[-1])
        sample = trajectory.sample(t)
        return _Curves(t, sample.q, sample.dq, trajectory.t, trajectory.q)
    rows = as_joints(arm.chain, q)
    if rows.ndim != 2 or not len(rows):
        raise ArrayError(f"q must be a Trajectory or have shape (m, {arm.dof}) with at least one row, got {rows.shape}")
    count = np.arange(len(rows), dtype=np.float64)
    return _Curves(count, rows, None, count, rows)


def sliding_joints(arm: Arm) -> NDArray[np.bool_]:
    """(n,) mask of the joints whose values are lengths."""
    chain = arm.chain
    return np.array([not chain.is_revolute[axes].all() for axes in (chain.coupling != 0.0).T], dtype=np.bool_)
