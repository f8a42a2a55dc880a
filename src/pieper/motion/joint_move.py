"""From one joint vector to another, all joints starting and arriving together."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pieper.motion.limits import JointLimits
from pieper.motion.trajectory import Trajectory

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from pieper.model.chain import Chain

_PEAK_VELOCITY = 15.0 / 8.0  # of 10 u^3 - 15 u^4 + 6 u^5, at u = 1/2
_PEAK_ACCELERATION = 10.0 / np.sqrt(3.0)  # at u = (3 - sqrt 3) / 6
_SHORTEST = 1e-9  # [s]; the resolution of time on a robot's network


def joint_move(
    chain: Chain,
    q_start: ArrayLike,
    q_goal: ArrayLike,
    *,
    max_velocity: ArrayLike | None = None,
    max_acceleration: ArrayLike | None = None,
) -> Trajectory:
    """The quickest synchronised minimum-jerk move from rest to rest within the limits of every joint.

    With ``u = t / T`` and ``d = q_goal - q_start``::

        q(t) = q_start + d (10 u^3 - 15 u^4 + 6 u^5),

    which of all moves of duration T has the least integral of squared jerk. Its largest velocity is ``15/8 |d| / T`` and its largest
    acceleration ``10/sqrt(3) |d| / T^2``, so that the least duration is::

        T = max over joints of max(15/8 |d| / max_velocity, sqrt(10/sqrt(3) |d| / max_acceleration)).

    Parameters
    ----------
    chain : Chain
        Its position and velocity limits hold.
    q_start, q_goal : (n,) arrays
        Joint values [rad or m] within the limits. A joint that turns goes straight from one to the other, whole turns included.
    max_velocity, max_acceleration : float or (n,) array, optional
        Limits [rad/s or m/s, rad/s^2 or m/s^2] and what holds without them: see `pieper.motion.limits.JointLimits.of`.

    Returns
    -------
    Trajectory
        Two points with velocities and accelerations, all 0; its interpolation is the move itself. Every joint stays between
        its start and its goal. One point when start and goal are the same. No move is shorter than a nanosecond.

    Raises
    ------
    ArrayError
        A joint vector of the wrong length or not finite, or a limit that is not positive.
    MotionError
        A start or a goal out of the joint limits.

    References
    ----------
    Flash and Hogan 1985, The coordination of arm movements: an experimentally confirmed mathematical model,
    Journal of Neuroscience 5(7), 1688-1703, appendix A.

    Examples
    --------
    >>> from pieper.model import catalog
    >>> arm = catalog.describe("ur5e").chain()
    >>> move = joint_move(arm, [0.0, -1.5, 1.5, 0.0, 0.0, 0.0], [1.0, -1.5, 1.5, 0.5, 0.0, 0.0])
    >>> round(move.duration, 6)  # joint 1: sqrt(5.7735 * 1 rad / (6.2831 rad/s^2))
    0.958583
    >>> move.sample(move.duration / 2).q
    array([ 0.5 , -1.5 ,  1.5 ,  0.25,  0.  ,  0.  ])
    """
    limits = JointLimits.of(chain, max_velocity=max_velocity, max_acceleration=max_acceleration)
    start = limits.check_position(q_start, name="q_start")
    goal = limits.check_position(q_goal, name="q_goal")
    apart = np.abs(goal - start)
    if not apart.any():
        rest = np.zeros((1, chain.dof))
        return Trajectory(np.zeros(1), start[None], rest, rest, chain.joint_names)
    duration = max(
        float(np.max(_PEAK_VELOCITY * apart / limits.velocity)),
        float(np.max(np.sqrt(_PEAK_ACCELERATION * apart / limits.acceleration))),
        _SHORTEST,
    )
    rest = np.zeros((2, chain.dof))
    return Trajectory(np.array([0.0, duration]), np.stack([start, goal]), rest, rest, chain.joint_names)
