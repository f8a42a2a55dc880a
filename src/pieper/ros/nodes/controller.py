"""A simulated arm on the network: commands and trajectories in, joint states out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.errors import PieperError, unknown_name
from pieper.ros.actions import ActionServer
from pieper.ros.joint_trajectory import (
    GOAL_TOLERANCE_VIOLATED,
    INVALID_GOAL,
    INVALID_JOINTS,
    PATH_TOLERANCE_VIOLATED,
    TrajectoryError,
    check_names,
    from_message,
)
from pieper.ros.nodes.checks import between
from pieper.ros.nodes.complaints import Complaints

if TYPE_CHECKING:
    from collections.abc import Callable

    from pieper.model.chain import FloatArray
    from pieper.motion.robot import RobotState, Simulator
    from pieper.motion.trajectory import Trajectory
    from pieper.ros.actions import Goal
    from pieper.ros.bus import Bus

JOINT_STATE = "sensor_msgs/msg/JointState"
JOINT_TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
FOLLOW_JOINT_TRAJECTORY = "control_msgs/action/FollowJointTrajectory"

LONGEST_STEP = 0.02
"""What passes for the robot at a time [s]; the tolerances are looked at after each step."""

MOST_STEPS = 50
"""Steps between two messages; a node that was away for longer goes on from where the arm was."""


@dataclass
class _Following:
    """The goal that is being followed."""

    goal: Goal
    trajectory: Trajectory
    began: float  # by the robot's own clock
    path: tuple[FloatArray, FloatArray]  # tolerances of positions and of velocities on the way
    end: tuple[FloatArray, FloatArray]  # and at the end
    patience: float  # how long the end may take after the last point [s]


class Controller:
    """Moves a robot as the network tells, and tells the network where it is.

    Hears ``set_joint_states`` and ``joint_trajectory``, serves the action ``follow_joint_trajectory`` and the services ``stop`` and
    ``home``, and publishes ``joint_states``. A command replaces what runs. One that must not be carried out is refused before
    anything changes: the reason goes to the log, and the arm goes on as it was.

    Parameters
    ----------
    bus : Bus
    robot : Simulator
        Its time is moved on by the clock of the bus. It is ``home`` where it is now.

    Examples
    --------
    >>> import pieper
    >>> from pieper.ros.fake import FakeNetwork
    >>> from pieper.sim.kinematic import KinematicSimulator
    >>> network = FakeNetwork()
    >>> arm, user = network.bus("controller"), network.bus("user")
    >>> node = Controller(arm, KinematicSimulator(pieper.load("mh12").chain))
    >>> command = user.publisher("set_joint_states", "sensor_msgs/msg/JointState")
    >>> command.send(name=["joint_3_u"], position=[0.5])
    >>> network.advance(1.0)
    >>> command.send(name=["joint_3_u"], position=[50.0])
    >>> network.advance(1.0)
    >>> node.robot.read().q.round(6) + 0.0
    array([0. , 0. , 0.5, 0. , 0. , 0. ])
    >>> arm.lines[-1]
    "set_joint_states: refused: q: joint 'joint_3_u' at 50 rad is outside its limits [-1.4835, 2.618] rad"
    """

    def __init__(self, bus: Bus, robot: Simulator) -> None:
        self.robot, self._bus = robot, bus
        self._home = np.array(robot.read().q)
        self._complaints = Complaints(bus)
        self._following: _Following | None = None
        self._waiting: tuple[str, Callable[[], None]] | None = None
        self._time = bus.now()
        self._taken: int | None = None  # when the last command came that was looked at,
        self._last_goal: int | None = None  # and the last goal
        self._told_of_rate = False
        self._declare_parameters()
        self._fed_back = self._time
        self._joint_states = bus.publisher("joint_states", JOINT_STATE)
        bus.subscribe("set_joint_states", JOINT_STATE, self._on_joint_states)
        bus.subscribe("joint_trajectory", JOINT_TRAJECTORY, self._on_trajectory)
        bus.serve("stop", "std_srvs/srv/Trigger", self._on_stop)
        bus.serve("home", "std_srvs/srv/Trigger", self._on_home)
        self._action = ActionServer(
            bus,
            "follow_joint_trajectory",
            FOLLOW_JOINT_TRAJECTORY,
            on_goal=self._on_goal,
            on_cancel=self._on_cancel,
            say=self._complaints.say,
        )
        bus.timer(1.0 / self._rate.value, self._tick)
        bus.log("info", f"Ready to move {', '.join(robot.joint_names)}")

    def _declare_parameters(self) -> None:
        bus = self._bus
        self._rate = bus.parameter(
            "rate", 100.0, description="joint states in a second", check=between(1.0, 1000.0), read_only=True
        )
        self._most_commands = bus.parameter(
            "max_commands_per_second",
            200.0,
            description="of more, the newest wins",
            check=between(0.1, 10_000.0),
        )
        self._most_points = bus.parameter(
            "max_points", 10_000, description="points that a trajectory may have", check=between(1, 1_000_000)
        )
        self._partial = bus.parameter(
            "allow_partial_joints_goal", False, description="trajectories may leave joints out, which then stay"
        )
        self._explain = bus.parameter(
            "explain_rejections",
            False,
            description="accept a goal that is refused and abort it at once, with the reason",
        )
        self._path_tolerance = bus.parameter(
            "path_tolerance", 0.05, description="position on the way [rad or m]; 0 for none", check=between(0.0, 1e3)
        )
        self._goal_tolerance = bus.parameter(
            "goal_tolerance", 0.01, description="position at the end [rad or m]; 0 for none", check=between(0.0, 1e3)
        )
        self._goal_time = bus.parameter(
            "goal_time", 1.0, description="how long the end may take after its time [s]", check=between(0.0, 3600.0)
        )
        self._feedback_rate = bus.parameter(
            "action_monitor_rate", 20.0, description="feedback messages in a second", check=between(0.1, 1000.0)
        )

    # Commands

    def _on_joint_states(self, message: Any) -> None:
        self._take("set_joint_states", lambda: self._command(message))

    def _on_trajectory(self, message: Any) -> None:
        self._take("joint_trajectory", lambda: self._follow_message(message))

    def _take(self, topic: str, command: Callable[[], None]) -> None:
        """Carry out a command now, or keep it as the newest if they come too fast."""
        if self._too_soon(self._taken):
            self._waiting = topic, command
            if not self._told_of_rate:
                self._told_of_rate = True
                self._bus.log(
                    "warn",
                    f"{topic}: commands come faster than max_commands_per_second = {self._most_commands.value:g}; "
                    "of those that come meanwhile the newest is taken, the others are dropped (said once)",
                )
            return
        self._taken, self._waiting = self._bus.now(), None
        self._advance()
        try:
            command()
        except PieperError as error:
            reason = error.reason if isinstance(error, TrajectoryError) else error
            self._complaints.say("warn", f"{topic}: refused: {reason}")

    def _too_soon(self, last: int | None) -> bool:
        return last is not None and bool(0 <= self._bus.now() - last < 1e9 / self._most_commands.value)

    def _command(self, message: Any) -> None:
        """Send joints to positions; those that are not named stay."""
        names = list(message.name)
        check_names(names, self.robot.joint_names)
        for field in ("position", "velocity", "effort"):
            count = len(getattr(message, field))
            if count != len(names) and (field == "position" or count):
                raise TrajectoryError(
                    INVALID_GOAL, f"{len(names)} joints are named, and there are {count} values of {field}"
                )
        for name, value in zip(names, message.position, strict=True):
            if not np.isfinite(value):
                raise TrajectoryError(INVALID_GOAL, f"the position of joint {name!r} must be finite, got {value}")
        self.robot.command(dict(zip(names, message.position.tolist(), strict=True)))
        self._replace("a command on set_joint_states took its place")

    def _follow_message(self, message: Any) -> None:
        if not message.points:  # as the controller of ros2_control takes it
            self.robot.stop()
            self._replace("an empty trajectory stopped the arm")
            return
        self._follow(message)
        self._replace("a trajectory on joint_trajectory took its place")

    def _follow(self, message: Any) -> Trajectory:
        """Have the robot follow a trajectory; raises before anything changes."""
        trajectory = from_message(
            message,
            self.robot.joint_names,
            state=self.robot.read(),
            now=self._bus.now(),
            partial=self._partial.value,
            most_points=self._most_points.value,
        )
        try:
            self.robot.follow(trajectory)
        except PieperError as error:
            raise TrajectoryError(INVALID_GOAL, str(error)) from error
        return trajectory

    def _on_stop(self, _: Any) -> dict[str, Any]:
        self._advance()
        self.robot.stop()
        self._replace("the service stop was called")
        return {"success": True, "message": "the arm rests where it is"}

    def _on_home(self, _: Any) -> dict[str, Any]:
        self._advance()
        try:
            self.robot.command(self._home)
        except PieperError as error:
            return {"success": False, "message": str(error)}
        self._replace("the service home was called")
        return {"success": True, "message": "on the way home"}

    def _replace(self, reason: str) -> None:
        """End the goal whose trajectory was replaced, and forget the command that waited."""
        following, self._following, self._waiting = self._following, None, None
        if following is not None:
            self._bus.log("warn", f"the goal that was followed is aborted: {reason}")
            following.goal.abort(error_code=INVALID_GOAL, error_string=reason)

    # The action

    def _on_goal(self, goal: Goal) -> str | None:
        if self._too_soon(self._last_goal):
            return f"goals come faster than max_commands_per_second = {self._most_commands.value:g}"
        self._last_goal = self._bus.now()
        self._advance()
        try:
            following = self._begin(goal)
        except TrajectoryError as error:
            if self._explain.value:
                self._complaints.say("warn", f"goal accepted to tell why it is refused: {error}")
                goal.accept()
                goal.abort(error_code=error.code, error_string=error.reason)
            return str(error)
        self._replace("a new goal took its place")
        self._following = following
        goal.accept()
        return None

    def _begin(self, goal: Goal) -> _Following:
        request = goal.request
        if request.multi_dof_trajectory.points or request.multi_dof_trajectory.joint_names:
            raise TrajectoryError(INVALID_GOAL, "multi_dof_trajectory is not supported; leave it empty")
        if request.component_path_tolerance or request.component_goal_tolerance:
            raise TrajectoryError(
                INVALID_GOAL, "component tolerances are for several degrees of freedom; leave them empty"
            )
        path = self._tolerances(request.path_tolerance, self._path_tolerance.value)
        end = self._tolerances(request.goal_tolerance, self._goal_tolerance.value)
        patience = int(request.goal_time_tolerance.sec) + int(request.goal_time_tolerance.nanosec) * 1e-9
        patience = self._goal_time.value if patience == 0.0 else patience if patience > 0.0 else np.inf
        trajectory = self._follow(request.trajectory)
        return _Following(goal, trajectory, self.robot.read().time, path, end, patience)

    def _tolerances(self, given: Any, default: float) -> tuple[FloatArray, FloatArray]:
        """Tolerances of positions and velocities: a value of 0 stands for the default, a negative one for none."""
        names = self.robot.joint_names
        position, velocity = np.full(len(names), default or np.inf), np.full(len(names), np.inf)
        if len(given) > len(names):
            raise TrajectoryError(INVALID_JOINTS, f"{len(given)} tolerances for {len(names)} joints")
        for tolerance in given:
            if tolerance.name not in names:
                raise TrajectoryError(
                    INVALID_JOINTS, f"tolerance: {unknown_name('joint', tolerance.name[:255], names)}"
                )
            if np.isnan([tolerance.position, tolerance.velocity]).any():
                raise TrajectoryError(INVALID_GOAL, f"a tolerance of joint {tolerance.name!r} is not a number")
            for values, value in ((position, tolerance.position), (velocity, tolerance.velocity)):
                if value != 0.0:
                    values[names.index(tolerance.name)] = value if value > 0.0 else np.inf
        return position, velocity

    def _on_cancel(self, goal: Goal) -> bool:
        self._advance()
        if self._following is not None and self._following.goal is goal:
            self.robot.stop()
            self._following = None
            goal.cancel(error_string="cancelled; the arm rests where it was")
        return True

    # Time

    def _tick(self) -> None:
        self._advance()
        if self._waiting is not None and not self._too_soon(self._taken):
            self._take(*self._waiting)
        state = self.robot.read()
        sec, nanosec = divmod(self._time, 1_000_000_000)  # when it was there; a command may have taken a while since
        self._joint_states.send(
            header={"stamp": {"sec": sec, "nanosec": nanosec}},
            name=list(self.robot.joint_names),
            position=state.q,
            velocity=state.dq,
        )
        now = self._bus.now()
        if self._following is not None and not 0 <= now - self._fed_back < 1e9 / self._feedback_rate.value:
            self._fed_back = now
            self._send_feedback(self._following, state)

    def _advance(self) -> None:
        """Let the time pass for the robot that has passed on the bus."""
        now = self._bus.now()
        before, self._time = self._time, now
        if before == 0:  # the simulated clock has just begun
            return
        passed = (now - before) * 1e-9  # a clock that was set back lets no time pass
        for _ in range(MOST_STEPS):
            if passed <= 0.0:
                return
            step = min(passed, LONGEST_STEP)
            passed -= step
            self._judge(self.robot.step(step))
        if passed > 0.0:
            self._complaints.say(
                "warn",
                f"time has jumped: by {passed + MOST_STEPS * LONGEST_STEP:.1f} s; the arm goes on from where it was",
            )

    def _judge(self, state: RobotState) -> None:
        """End the goal that is followed if it is reached, or if it cannot be any more."""
        following = self._following
        if following is None:
            return
        elapsed, end = state.time - following.began, following.trajectory.t[-1]
        if elapsed < end:
            wanted = following.trajectory.sample(elapsed)
            problem = self._out_of(following.path, state, wanted.q, wanted.dq)
            if problem:
                self._give_up(following, PATH_TOLERANCE_VIOLATED, f"on the way {problem}")
            return
        problem = self._out_of(following.end, state, following.trajectory.q[-1], np.zeros_like(state.q))
        if not problem:
            self._following = None
            following.goal.succeed(error_string="the goal is reached")
        elif elapsed - end > following.patience:
            self._give_up(following, GOAL_TOLERANCE_VIOLATED, f"{elapsed - end:.3f} s after its last point {problem}")

    def _out_of(
        self, tolerances: tuple[FloatArray, FloatArray], state: RobotState, q: FloatArray, dq: FloatArray
    ) -> str:
        """Which joint is out of its tolerance, in words, or nothing."""
        errors = np.abs(state.q - q), np.abs(state.dq - dq)
        for kind, tolerance, error in zip(("position", "velocity"), tolerances, errors, strict=True):
            wrong = np.flatnonzero(~(error <= tolerance))
            if wrong.size:
                i = int(wrong[0])
                return f"the {kind} of joint {self.robot.joint_names[i]!r} is off by {error[i]:.3g}, more than {tolerance[i]:.3g}"
        return ""

    def _give_up(self, following: _Following, code: int, reason: str) -> None:
        self.robot.stop()
        self._following = None
        self._bus.log("warn", f"the arm is stopped and its goal aborted: {reason}")
        following.goal.abort(error_code=code, error_string=reason)

    def _send_feedback(self, following: _Following, state: RobotState) -> None:
        elapsed = state.time - following.began
        wanted = following.trajectory.sample(min(elapsed, following.trajectory.t[-1]))
        seconds, nanoseconds = divmod(round(elapsed * 1e9), 1_000_000_000)
        time = {"sec": seconds, "nanosec": nanoseconds}
        following.goal.feedback(
            header={"stamp": self._bus.stamp()},
            joint_names=list(self.robot.joint_names),
            desired={
                "positions": wanted.q,
                "velocities": wanted.dq,
                "accelerations": wanted.ddq,
                "time_from_start": time,
            },
            actual={"positions": state.q, "velocities": state.dq, "time_from_start": time},
            error={
                "positions": wanted.q - state.q,
                "velocities": wanted.dq - state.dq,
                "time_from_start": time,
            },
        )
