"""The same way in another time: slower until every limit holds, and motions one behind the other."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pieper.errors import MotionError
from pieper.motion.trajectory import Trajectory, one_after_another
from pieper.motion.usage import usage

if TYPE_CHECKING:
    from pieper.model.chain import Chain
    from pieper.motion.limits import JointLimits, TcpLimits
    from pieper.spatial._checks import FloatArray

_TRIALS = 12  # of a duration at which every limit holds; the last leaves 4 % to rounding


def held(trajectory: Trajectory, limits: JointLimits, tcp: TcpLimits | None) -> Trajectory:
    """The same motion, slower by what it exceeds a limit, or quicker by what it leaves: the same way in another time.

    Where points are near each other in time, rounding of their joint values shows in the jerk, and is another one for each duration: then
    a little more is left to it every time, until all limits hold.

    Parameters
    ----------
    trajectory : Trajectory
    limits : JointLimits
    tcp : TcpLimits, optional

    Returns
    -------
    Trajectory

    Raises
    ------
    MotionError
        No duration was found with which every limit holds; the message tells by how much one is exceeded.
    """
    for trial in range(_TRIALS):
        factor = usage(trajectory, limits, tcp).stretch
        if 1.0 - 1e-6 * 4.0**trial <= factor <= 1.0:
            return trajectory
        slower = factor * (1.0 + 1e-8 * 4.0**trial)
        assert trajectory.dq is not None
        assert trajectory.ddq is not None
        trajectory = Trajectory(
            trajectory.t * slower,
            trajectory.q,
            trajectory.dq / slower,
            trajectory.ddq / slower**2,
            trajectory.joint_names,
        )
    factor = usage(trajectory, limits, tcp).stretch
    if factor > 1.0 + 1e-6:
        raise MotionError(
            f"no motion was found that holds every limit; the best of {trajectory.duration:.3g} s exceeds one by "
            f"{100.0 * (factor - 1.0):.2g} %, since a limit is so small that rounding exceeds it: raise the smallest"
        )
    return trajectory


def joined(chain: Chain, parts: list[Trajectory], rest: FloatArray) -> Trajectory:
    """Motions from rest to rest as one; at rest at `rest` (n,) where there are none."""
    if not parts:
        still = np.zeros((1, chain.dof))
        return Trajectory(np.zeros(1), rest[None], still, still, chain.joint_names)
    return one_after_another(parts)
