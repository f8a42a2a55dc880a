"""An arm without mass: joints that move exactly as told, within their limits.

Nothing runs by itself: the caller moves time on with `KinematicSimulator.step`. Every motion is a function of the time since it
began, evaluated and never added up, so that the size of the steps does not matter.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from pieper.errors import ArrayError, MotionError
from pieper.motion.limits import JointLimits
from pieper.motion.robot import RobotState, Simulator
from pieper.motion.trajectory import Trajectory

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from pieper.model.chain import Chain, FloatArray

START_TOLERANCE = 0.01
"""How far from the arm a trajectory may begin [rad or m], the value that MoveIt checks with."""

LONGEST_STEP = 1e6
"""The longest time of one step [s]; more is a mistake, such as nanoseconds."""

_SHORTEST_MOVE = 1e-9  # [s]; a shorter one would have a velocity that is mostly rounding


class KinematicSimulator(Simulator):
    """A simulated arm that needs nothing but NumPy.

    A joint takes up a velocity at once, since nothing has mass; positions never jump, stay within the joint limits, and never change
    faster than the velocity limits. What is refused raises before anything changes: the arm goes on as it was.
    With mimic joints, ``q`` and the limits are those of the joints that lead, as in the chain.

    Parameters
    ----------
    chain : Chain
    q : (n,) array or mapping, optional
        Joint values at the beginning [rad or m]; when not given, the values nearest 0 within the limits.
    max_velocity : float or (n,) array, optional
        Speed limit [rad/s or m/s]; it can lower a limit of the description and never raise one. For what holds without it see
        `pieper.motion.limits.JointLimits.of`.

    Attributes
    ----------
    chain : Chain
    limits : JointLimits

    Raises
    ------
    ArrayError
        A wrong length, a number that is not finite, or a speed limit that is not positive.
    MotionError
        `q` is out of the joint limits.
    UnknownNameError
        `q` names a joint that the arm does not have.

    Examples
    --------
    >>> from pieper.model import catalog
    >>> robot = KinematicSimulator(catalog.describe("mh12").chain())
    >>> robot.command({"joint_1_s": 0.5, "joint_2_l": -0.2})
    >>> state = robot.step(0.1)
    >>> state.q[:2].round(3), state.dq[:2].round(3)
    (array([ 0.384, -0.154]), array([ 3.84 , -1.536]))
    >>> robot.command({"joint_1_s": 3.2})
    Traceback (most recent call last):
        ...
    pieper.errors.MotionError: q: joint 'joint_1_s' at 3.2 rad is outside its limits [-2.967, 2.967] rad
    """

    _trajectory: Trajectory  # what runs, or one point to rest at
    _velocity: FloatArray | None  # or this, from that point
    _since: float  # when it began

    def __init__(
        self, chain: Chain, *, q: ArrayLike | Mapping[str, float] | None = None, max_velocity: ArrayLike | None = None
    ) -> None:
        self.chain = chain
        self.limits = JointLimits.of(chain, max_velocity=max_velocity)
        nearest_zero = np.clip(np.zeros(chain.dof), *chain.limits.T)
        start = nearest_zero if q is None else self.limits.check_position(joint_vector(chain, q, nearest_zero))
        self._time = 0.0
        self._rest(start)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints, in the order of ``q``."""
        return self.chain.joint_names

    @property
    def time(self) -> float:
        """Sum of all steps [s]."""
        return self._time

    @property
    def is_moving(self) -> bool:
        """True until a command or a trajectory has ended, and while a commanded velocity moves a joint."""
        if self._velocity is not None:
            return bool(self.read().dq.any())
        return bool(self._elapsed < self._trajectory.t[-1])

    def read(self) -> RobotState:
        """Time, joint values and joint velocities now.

        At rest, and at the end of a motion, the velocities are 0.
        """
        lower, upper = self.chain.limits.T
        if self._velocity is not None:
            q = self._trajectory.q[0] + self._velocity * self._elapsed
            at_limit = ((self._velocity > 0.0) & (q >= upper)) | ((self._velocity < 0.0) & (q <= lower))
            dq = np.where(at_limit, 0.0, self._velocity)
        else:
            q, dq, _ = self._trajectory.sample(self._elapsed)
            if self._elapsed >= self._trajectory.t[-1]:
                dq = np.zeros(self.chain.dof)
        q = np.clip(q, lower, upper)  # what rounding adds
        dq = np.clip(dq, -self.limits.velocity, self.limits.velocity)
        q.setflags(write=False)
        dq.setflags(write=False)
        return RobotState(self._time, q, dq)

    def step(self, dt: float) -> RobotState:
        """Let time pass, and read.

        Parameters
        ----------
        dt : float
            [s], from 0 to 1e6.

        Returns
        -------
        RobotState
            Time, joint values and velocities at the end.

        Raises
        ------
        ArrayError
            Time cannot pass like that.
        """
        passed = seconds(dt, LONGEST_STEP)
        self._time += passed
        return self.read()

    def command(self, q: ArrayLike | Mapping[str, float]) -> None:
        """Go to joint values on a straight line in joint space, as fast as the velocity limits allow. Replaces what runs.

        All joints move with constant velocity and arrive together after ``max over joints of |q - q_now| / max_velocity``; they
        start and stop at once. Moves with smooth starts and stops are made by `pieper.motion.joint_move` and followed.

        Parameters
        ----------
        q : (n,) array or mapping
            Joint values [rad or m]; joints that a mapping leaves out stay where they are now. No whole turns are added or taken away.

        Raises
        ------
        ArrayError
            A wrong length, or a number that is not finite.
        MotionError
            A joint out of its limits.
        UnknownNameError
            A name that no joint has.
        """
        here = self.read().q
        goal = self.limits.check_position(joint_vector(self.chain, q, here))
        apart = np.abs(goal - here)
        if not apart.any():
            self._rest(goal)
            return
        duration = max(float(np.max(apart / self.limits.velocity)), _SHORTEST_MOVE)
        self._start(Trajectory(np.array([0.0, duration]), np.stack([here, goal]), joint_names=self.joint_names))

    def command_velocity(self, dq: ArrayLike | Mapping[str, float]) -> None:
        """Move with constant joint velocities until something else is commanded; a joint that comes to its limit stops there. Replaces what runs.

        Parameters
        ----------
        dq : (n,) array or mapping
            Joint velocities [rad/s or m/s]; joints that a mapping leaves out rest.

        Raises
        ------
        ArrayError
            A wrong length, or a number that is not finite.
        MotionError
            A joint faster than its limit.
        UnknownNameError
            A name that no joint has.
        """
        velocity = self.limits.check_velocity(joint_vector(self.chain, dq, np.zeros(self.chain.dof), name="dq"))
        self._rest(self.read().q)
        self._velocity = velocity

    def follow(self, trajectory: Trajectory) -> None:
        """Follow a trajectory whose times count from now; at its end the arm rests. Replaces what runs.

        As on ros2_control, a trajectory whose first time is after 0 is joined to where the arm is and to its velocity by the same interpolation.
        One that begins at 0 has to begin where the arm is, within 0.01 rad or m, and the small rest is taken up by its first segment.

        Parameters
        ----------
        trajectory : Trajectory
            Of all joints, in any order if it names them.

        Raises
        ------
        ArrayError
            A joint is missing, there are too many columns, or the first time is before 0.
        MotionError
            It begins too far from where the arm is, or leaves the joint limits or exceeds the velocity limits, at its points or
            between them. Accelerations are not limited.
        UnknownNameError
            It moves a joint that the arm does not have.
        """
        ordered = joined(trajectory.in_order(self.joint_names), self.read())
        self.limits.check_trajectory(ordered)
        self._start(ordered)

    def stop(self) -> None:
        """Rest where the arm is now."""
        self._rest(self.read().q)

    # --- beneath

    @property
    def _elapsed(self) -> float:
        return self._time - self._since

    def _start(self, trajectory: Trajectory) -> None:
        self._trajectory = trajectory
        self._velocity = None
        self._since = self._time

    def _rest(self, q: FloatArray) -> None:
        self._start(Trajectory(np.zeros(1), q[None], joint_names=self.joint_names))


def joint_vector(
    chain: Chain, values: ArrayLike | Mapping[str, float], otherwise: FloatArray, *, name: str = "q"
) -> ArrayLike:
    """The values in the order of the joints; those that a mapping leaves out are taken from `otherwise`, (n,).

    Raises
    ------
    ArrayError
        A value that is no number.
    UnknownNameError
        A name that no joint has.
    """
    if not isinstance(values, Mapping):
        return values
    vector = otherwise.copy()
    for joint, value in values.items():
        index = chain.joint_index(joint)
        try:
            vector[index] = float(value)
        except (TypeError, ValueError) as cause:
            raise ArrayError(f"{name} of joint {joint!r} must be a number, got {value!r}") from cause
    return vector


def seconds(dt: float, longest: float) -> float:
    """A step of time as a number [s].

    Raises
    ------
    ArrayError
        It is no number, before 0, or above `longest`.
    """
    try:
        passed = float(dt)
    except (TypeError, ValueError) as cause:
        raise ArrayError(f"dt must be a number of seconds, got {dt!r}") from cause
    if not 0.0 <= passed <= longest:
        raise ArrayError(f"dt must be from 0 to {longest:g} s, got {dt!r}")
    return passed


def joined(trajectory: Trajectory, here: RobotState) -> Trajectory:
    """The trajectory from time 0 and from where an arm is, its columns in the order of the joints of the arm.

    Raises
    ------
    ArrayError
        The first time is before 0.
    MotionError
        It begins at time 0, and too far from where the arm is.
    """
    t, q, dq, ddq = trajectory.t, trajectory.q, trajectory.dq, trajectory.ddq
    names = trajectory.joint_names
    if t[0] < 0.0:
        raise ArrayError(f"the times of a trajectory count from now and must not be before 0, got {t[0]} s")
    if t[0] > 0.0:
        return Trajectory(
            np.concatenate([[0.0], t]),
            np.vstack([here.q, q]),
            None if dq is None else np.vstack([here.dq, dq]),
            None if ddq is None else np.vstack([np.zeros(len(here.q)), ddq]),
            names,
        )
    apart = np.abs(q[0] - here.q)
    if (apart > START_TOLERANCE).any():
        joint = int(np.argmax(apart))
        raise MotionError(
            f"the trajectory must begin where the arm is, within {START_TOLERANCE}: joint {names[joint]!r} is at "
            f"{here.q[joint]:.9g} and the trajectory begins at {q[0, joint]:.9g}; plan it from where the arm is, "
            "or give its first point a time after 0"
        )
    if len(t) == 1:
        return Trajectory(t, here.q[None], joint_names=names) if apart.any() else trajectory
    return Trajectory(t, np.vstack([here.q, q[1:]]), dq, ddq, names)
