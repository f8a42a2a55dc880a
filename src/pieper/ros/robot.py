"""An arm on a ROS network as a robot: read it, send it somewhere, stop it; the same interface as the simulators."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.errors import ArrayError, RosError
from pieper.motion.joint_move import joint_move
from pieper.motion.limits import JointLimits
from pieper.motion.robot import Robot, RobotState
from pieper.ros.nodes.joint_states import JOINT_STATE

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import ArrayLike

    from pieper.model.chain import Chain, FloatArray
    from pieper.ros.bus import Bus

JOINT_TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"

PATIENCE = 5.0
"""How long `RosRobot.wait_until_heard` waits for joint states [s]."""

STALE = 1.0
"""Joint states that are older than this are none [s]."""

_SLACK = 1.1  # a move takes so much longer than it must: the arm's controller begins it from where the arm is by then


class RosRobot(Robot):
    """Hears ``joint_states`` and sends ``joint_trajectory``, as `pieper.ros.nodes.controller.Controller` and the
    joint_trajectory_controller of ros2_control take it.

    Whoever has the bus spins it: nothing is heard otherwise. A command is one point, which the arm's controller reaches by its own
    interpolation from where the arm is; `stop` is a trajectory without points.

    Parameters
    ----------
    bus : Bus
    chain : Chain
        Of the arm, its joints named as on the network.
    max_velocity : float or (n,) array, optional
        See `pieper.motion.limits.JointLimits.of`.

    Attributes
    ----------
    chain : Chain
    limits : JointLimits

    Examples
    --------
    >>> import pieper
    >>> from pieper.ros.fake import FakeNetwork
    >>> from pieper.ros.nodes.controller import Controller
    >>> from pieper.sim.kinematic import KinematicSimulator
    >>> chain, network = pieper.load("mh12").chain, FakeNetwork()
    >>> node = Controller(network.bus("controller"), KinematicSimulator(chain))
    >>> robot = RosRobot(network.bus("user"), chain)
    >>> network.advance(0.1)
    >>> robot.command({"joint_3_u": 0.5})
    >>> network.advance(1.0)
    >>> robot.read().q.round(6) + 0.0
    array([0. , 0. , 0.5, 0. , 0. , 0. ])
    """

    def __init__(self, bus: Bus, chain: Chain, *, max_velocity: ArrayLike | None = None) -> None:
        self.chain, self.limits = chain, JointLimits.of(chain, max_velocity=max_velocity)
        self._bus = bus
        self._state: RobotState | None = None
        self._heard = 0
        self._reason = "none have been heard"
        self._trajectory = bus.publisher("joint_trajectory", JOINT_TRAJECTORY)
        bus.subscribe("joint_states", JOINT_STATE, self._on_joint_states)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints, in the order of ``q``."""
        return self.chain.joint_names

    def wait_until_heard(self, *, timeout: float = PATIENCE) -> None:
        """Spin the bus until the arm has told where it is.

        Raises
        ------
        RosError
            It has not, in so many seconds.
        """
        if not self._bus.spin_until(lambda: self._state is not None, timeout=timeout):
            raise RosError(f"no joint states of {', '.join(self.joint_names)} in {timeout:g} s: {self._reason}")

    def read(self) -> RobotState:
        """Where the arm was when it was last heard; the time is that of its message.

        Raises
        ------
        RosError
            It was not heard for `STALE`, or never.
        """
        if self._state is None:
            raise RosError(f"no joint states of {', '.join(self.joint_names)} on the network yet: {self._reason}")
        age = (self._bus.now() - self._heard) * 1e-9
        if age > STALE:
            raise RosError(
                f"the last joint states are {age:.1f} s old, more than {STALE:g} s; is the robot still there?"
            )
        return self._state

    def command(self, q: ArrayLike | Mapping[str, float]) -> None:
        """Go to joint values (n,) [rad or m], in the time of the quickest smooth move and a tenth more; joints that a mapping leaves out stay.

        Raises
        ------
        ArrayError, MotionError, UnknownNameError
            As from the simulators; nothing is sent then.
        RosError
            Where the arm is is not known.
        """
        here = self.read()
        goal = self.limits.check_position(self._vector(q, here.q))
        inside = np.clip(here.q, *self.chain.limits.T)
        move = joint_move(self.chain, inside, goal, max_velocity=self.limits.velocity)
        braking = float((np.abs(here.dq) / self.limits.acceleration).max())  # a moving arm needs that much more
        seconds = max(_SLACK * (move.duration + 2.0 * braking), 0.01)
        nanoseconds = math.ceil(seconds * 1e9)
        rest = np.zeros(len(goal))
        self._trajectory.send(
            joint_names=list(self.joint_names),
            points=[
                {
                    "positions": goal,
                    "velocities": rest,
                    "accelerations": rest,
                    "time_from_start": {"sec": nanoseconds // 10**9, "nanosec": nanoseconds % 10**9},
                }
            ],
        )

    def stop(self) -> None:
        """Have the controller bring the arm to rest."""
        self._trajectory.send(joint_names=list(self.joint_names))

    def _vector(self, values: ArrayLike | Mapping[str, float], here: FloatArray) -> ArrayLike:
        if not hasattr(values, "items"):
            return values
        vector = here.copy()
        for joint, value in values.items():
            try:
                vector[self.chain.joint_index(joint)] = float(value)
            except (TypeError, ValueError) as cause:  # noqa: PERF203  a handful of joints
                raise ArrayError(f"q of joint {joint!r} must be a number, got {value!r}") from cause
        return vector

    def _on_joint_states(self, message: Any) -> None:
        names = list(message.name)
        missing = [name for name in self.joint_names if name not in names]
        if missing:
            self._reason = f"a message lacks {', '.join(missing)}"
            return  # of another part of the robot, as of a gripper
        places = [names.index(name) for name in self.joint_names]
        position, velocity = np.asarray(message.position), np.asarray(message.velocity)
        if len(position) != len(names) or not np.isfinite(position[places]).all():
            self._reason = "a message has not one finite position for each name"
            return
        q = position[places].astype(np.float64)
        dq = velocity[places].astype(np.float64) if len(velocity) == len(names) else np.zeros(len(places))
        for values in (q, dq):
            values.setflags(write=False)
        stamp = message.header.stamp
        self._state, self._heard = RobotState(stamp.sec + 1e-9 * stamp.nanosec, q, dq), self._bus.now()
