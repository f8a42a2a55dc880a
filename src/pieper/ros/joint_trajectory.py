"""Trajectories as ROS 2 sends them: from ``trajectory_msgs/msg/JointTrajectory`` to a `Trajectory`, or the reason why not.

The rules are those of the joint_trajectory_controller of ros2_control: joints in any order, ``header.stamp`` 0 means now, points
that have passed are left out, and before the first point the arm is brought there from where it is. Stricter here: times increase
strictly, and velocities or accelerations are given for all points or for none, because the interpolation follows from what there is.

References
----------
ros2_control, "joint_trajectory_controller", control.ros.org.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.errors import PieperError, RosError, unknown_name
from pieper.motion.trajectory import Trajectory

if TYPE_CHECKING:
    from collections.abc import Sequence

    from pieper.model.chain import FloatArray
    from pieper.motion.robot import RobotState

INVALID_GOAL = -1
"""``control_msgs/action/FollowJointTrajectory``, error codes; as those below."""
INVALID_JOINTS = -2
OLD_HEADER_TIMESTAMP = -3
PATH_TOLERANCE_VIOLATED = -4
GOAL_TOLERANCE_VIOLATED = -5

ERROR_NAMES = {
    INVALID_GOAL: "INVALID_GOAL",
    INVALID_JOINTS: "INVALID_JOINTS",
    OLD_HEADER_TIMESTAMP: "OLD_HEADER_TIMESTAMP",
    PATH_TOLERANCE_VIOLATED: "PATH_TOLERANCE_VIOLATED",
    GOAL_TOLERANCE_VIOLATED: "GOAL_TOLERANCE_VIOLATED",
}

LATEST_START = 3600.0
"""How far ahead ``header.stamp`` may be [s]; more is taken for another clock."""

_LONGEST_NAME = 255
_RESTING = 1e-6  # [rad/s or m/s]; the velocity of a last point that counts as 0, as printed with six decimals


class TrajectoryError(RosError):
    """A trajectory that is refused.

    Attributes
    ----------
    code : int
        Error code of ``control_msgs/action/FollowJointTrajectory``.
    reason : str
    """

    def __init__(self, code: int, reason: str) -> None:
        super().__init__(f"{ERROR_NAMES[code]}: {reason}")
        self.code, self.reason = code, reason

    def __reduce__(self) -> tuple[type[TrajectoryError], tuple[int, str]]:
        return type(self), (self.code, self.reason)


def check_names(names: Sequence[str], joint_names: Sequence[str]) -> None:
    """Nothing, or an error for joints that are unknown, named twice, or more than there are.

    Raises
    ------
    TrajectoryError
        With the code ``INVALID_JOINTS``.

    Examples
    --------
    >>> check_names(["elbow", "elbow"], ["shoulder", "elbow"])
    Traceback (most recent call last):
    ...
    pieper.ros.joint_trajectory.TrajectoryError: INVALID_JOINTS: joint 'elbow' is named 2 times
    """
    if not names:
        raise TrajectoryError(INVALID_JOINTS, "no joint is named; values are taken by name, never by place")
    for name in names[: len(joint_names) + 1]:
        if name not in joint_names:
            raise TrajectoryError(INVALID_JOINTS, str(unknown_name("joint", name[:_LONGEST_NAME], joint_names)))
        if names.count(name) > 1:
            raise TrajectoryError(INVALID_JOINTS, f"joint {name!r} is named {names.count(name)} times")


def from_message(
    message: Any,
    joint_names: Sequence[str],
    *,
    state: RobotState,
    now: int,
    partial: bool = False,
    most_points: int = 10_000,
) -> Trajectory:
    """The trajectory of a ``trajectory_msgs/msg/JointTrajectory``, from now on and from where the arm is.

    Parameters
    ----------
    message : message
        With at least one point.
    joint_names : sequence of n str
        The joints of the arm.
    state : RobotState
        Where the arm is now.
    now : int
        The time of the clock that ``header.stamp`` is of [ns].
    partial : bool
        Whether joints may be left out; they stay where they are.
    most_points : int

    Returns
    -------
    Trajectory
        Its times count from now [s]. It begins at 0 where the arm is, unless its own first point is for this very moment.

    Raises
    ------
    TrajectoryError
        With the code and the reason. Joint limits are not looked at here.
    """
    check_names(message.joint_names, joint_names)
    missing = [name for name in joint_names if name not in message.joint_names]
    if missing and not partial:
        raise TrajectoryError(
            INVALID_JOINTS, f"all joints of the arm have to be given, and it lacks {', '.join(missing)}"
        )
    if not message.points:
        raise TrajectoryError(INVALID_GOAL, "it has no points; give one at least")
    if len(message.points) > most_points:
        raise TrajectoryError(INVALID_GOAL, f"{len(message.points)} points, and at most {most_points} are taken")
    t = np.array([_seconds(point.time_from_start) for point in message.points])
    _check_times(t)
    q, dq, ddq = (_rows(message, field) for field in ("positions", "velocities", "accelerations"))
    if q is None:
        raise TrajectoryError(
            INVALID_GOAL, "its points have no positions; give them, velocities alone are not followed"
        )
    if dq is not None and (np.abs(dq[-1]) > _RESTING).any():
        raise TrajectoryError(
            INVALID_GOAL, "the velocities of its last point are not 0; the arm has to come to rest there"
        )
    t, kept = _from_now(t, _nanoseconds(message.header.stamp), now)
    try:
        given = Trajectory(
            t,
            q[kept:],
            None if dq is None else dq[kept:],
            None if ddq is None else ddq[kept:],
            tuple(message.joint_names),
        )
        return _joined(_of_all(given, joint_names, state), state)
    except PieperError as error:
        raise TrajectoryError(INVALID_GOAL, str(error)) from error


def _seconds(duration: Any) -> float:
    return int(duration.sec) + int(duration.nanosec) * 1e-9


def _nanoseconds(stamp: Any) -> int:
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def _check_times(t: FloatArray) -> None:
    if t[0] < 0.0:
        raise TrajectoryError(INVALID_GOAL, f"time_from_start of its first point is {t[0]} s, before its start")
    back = np.flatnonzero(np.diff(t) <= 0.0)
    if back.size:
        i = int(back[0])
        raise TrajectoryError(
            INVALID_GOAL,
            f"time_from_start has to increase, and is {t[i]} s at point {i} and {t[i + 1]} s at point {i + 1}",
        )


def _rows(message: Any, field: str) -> FloatArray | None:
    """(m, n) values of all points, or None if no point gives them."""
    rows = [getattr(point, field) for point in message.points]
    n = len(message.joint_names)
    wrong = next((i for i, row in enumerate(rows) if len(row) != len(rows[0])), 0)
    if len(rows[wrong]) not in (0, n) or len(rows[wrong]) != len(rows[0]):
        raise TrajectoryError(
            INVALID_GOAL,
            f"each point has to give {field} for its {n} joints, or no point any; point {wrong} gives {len(rows[wrong])}",
        )
    if not len(rows[0]):
        return None
    values = np.array(rows, dtype=np.float64)
    if not np.isfinite(values).all():
        point, joint = (int(i) for i in np.argwhere(~np.isfinite(values))[0])
        name, value = message.joint_names[joint], values[point, joint]
        raise TrajectoryError(INVALID_GOAL, f"{field} of joint {name!r} at point {point} must be finite, got {value}")
    return values


def _from_now(t: FloatArray, stamp: int, now: int) -> tuple[FloatArray, int]:
    """The times from now of the points that are still to come, and the index of the first of them."""
    if stamp == 0:
        return t, 0
    delay = (stamp - now) * 1e-9
    if delay > LATEST_START:
        raise TrajectoryError(
            INVALID_GOAL,
            f"header.stamp is {delay:.0f} s ahead, at most {LATEST_START:g} s are waited; are the clocks the same?",
        )
    t = t + delay
    if t[-1] <= 0.0:
        raise TrajectoryError(OLD_HEADER_TIMESTAMP, f"it ended {-t[-1]:.3f} s ago, by header.stamp and time_from_start")
    first = int(np.argmax(t > 0.0))
    return t[first:], first


def _of_all(trajectory: Trajectory, joint_names: Sequence[str], state: RobotState) -> Trajectory:
    """The trajectory of all joints of the arm in its order; those that are not given stay."""
    if len(trajectory.joint_names) == len(joint_names):
        return trajectory.in_order(joint_names)
    columns = [joint_names.index(name) for name in trajectory.joint_names]

    def of_all(given: FloatArray, others: FloatArray) -> FloatArray:
        values = np.tile(others, (len(trajectory.t), 1))
        values[:, columns] = given
        return values

    rest = np.zeros_like(state.q)
    return Trajectory(
        trajectory.t,
        of_all(trajectory.q, state.q),
        None if trajectory.dq is None else of_all(trajectory.dq, rest),
        None if trajectory.ddq is None else of_all(trajectory.ddq, rest),
        tuple(joint_names),
    )


def _joined(trajectory: Trajectory, state: RobotState) -> Trajectory:
    """The trajectory with where the arm is before its first point."""
    if trajectory.t[0] <= 0.0:
        return trajectory
    dq, ddq = trajectory.dq, trajectory.ddq
    return Trajectory(
        np.concatenate([[0.0], trajectory.t]),
        np.vstack([state.q, trajectory.q]),
        None if dq is None else np.vstack([state.dq, dq]),
        None if ddq is None else np.vstack([np.zeros_like(state.q), ddq]),
        trajectory.joint_names,
    )
