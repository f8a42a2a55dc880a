"""``inverse``: a target in, joint states or a trajectory out.

Two methods. ``report`` is that of a course report on the MH12 (node ``inverse_mh12_node``, whose lines of log it writes):
``q += step * pinv(J) e``, one step at every tick of a timer, each of them published. ``solve`` asks the solver of this package
for the answer nearest to where the arm is, within its limits, and makes one smooth move of it.
"""

from __future__ import annotations

from collections import deque
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.errors import ArrayError, MotionError, PieperError, RosError
from pieper.ik.iteration import iterate
from pieper.ik.numeric import solve_numeric
from pieper.ik.target import ignore_orientation
from pieper.motion.joint_move import joint_move
from pieper.motion.limits import JointLimits
from pieper.motion.trajectory import Trajectory
from pieper.ros import messages
from pieper.ros.nodes.checks import between, one_of
from pieper.ros.nodes.complaints import Complaints
from pieper.ros.nodes.joint_states import JOINT_STATE, JointStates
from pieper.ros.qos import QoS
from pieper.spatial.rotation import from_quaternion

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

    from pieper.arm import Arm
    from pieper.ik.iteration import Step
    from pieper.model.chain import Chain
    from pieper.ros.bus import Bus, Timer

    FloatArray = NDArray[np.float64]

POINT = "geometry_msgs/msg/Point"
POSE = "geometry_msgs/msg/PoseStamped"
TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"

_LOOK_EVERY = 0.1  # seconds
_PATIENCE = 2.0  # seconds that a target waits for the first joint states of a controller that is there
_NEARLY_INSIDE = 0.01  # [rad or m]; an encoder may read a little beyond a limit
_SLOWER = 1.0 + 1e-6  # so that a duration in whole nanoseconds keeps the velocity limits
_SLOWER_MOVING = 0.98  # since the arm is a little further when its controller hears of it
_LONGER = 1.2  # how much more time a move gets that would exceed a limit
_LONGER_OFTEN = 8
_SHORTEST_BRAKING = 1e-3  # s
_ROOM_TO_BRAKE = 0.8  # of what is left to a limit; a controller's arm is a little further when it hears of it
_CREEPING = 0.01  # fraction of the velocity limit; no slower joint is braked harder for the sake of its limit
_FARTHEST = 1e6  # m
_TOLD_OF = 20  # targets in a second that the log tells of; all are gone to
_OWN_REMEMBERED = 256  # messages of its own that may still be on their way back


def node_name(arm: Arm) -> str:
    """Name of the node for an arm: that of the report for its own.

    >>> import pieper
    >>> node_name(pieper.load("mh12")), node_name(pieper.load("ur5e"))
    ('inverse_mh12_node', 'inverse')
    """
    return "inverse_mh12_node" if arm.name in ("yaskawa_mh12", "mh12-report") else "inverse"


@dataclass(frozen=True, eq=False)
class _Place:
    """Where the arm is and how it moves: three (n,) arrays."""

    q: FloatArray
    dq: FloatArray
    ddq: FloatArray


@dataclass(frozen=True, eq=False)
class _Target:
    """What was asked for: a position (3,) or a pose (4, 4) of the tip in the base frame."""

    wanted: FloatArray

    @property
    def is_point(self) -> bool:
        return self.wanted.shape == (3,)


@dataclass(eq=False)
class _Iteration:
    """A run of method ``report``."""

    steps: Iterator[Step]
    count: int  # of steps at most
    last: Step
    kept: NDArray[np.intp]  # places of the joints that iterate, among those of the arm; the others are at 0


@dataclass(eq=False)
class _Motion:
    """A move that this node shows by joint states of its own."""

    trajectory: Trajectory
    began: int  # ns


class Inverse:
    r"""Brings the tip of an arm to targets.

    Subscribes ``target`` (a Point: the orientation is left free), ``target_pose`` (a PoseStamped in the base frame) and
    ``joint_states``; publishes ``joint_trajectory`` where a controller listens there, else ``joint_states``; serves ``~/cancel``.

    *Busy.* It is never too busy for a target: the newest one replaces what runs, from where the arm is then. A target that is
    malformed or out of reach is refused with the reason in the log; nothing moves for it, and what runs goes on.
    ``~/cancel`` ends what runs; the arm comes to rest.

    *Where the arm is* is what the joint states of another node say, else where this node brought it last, at first all zeros
    (or the limit nearest to zero).

    Parameters of the node: ``method`` (``solve`` or ``report``), ``output`` (``auto``, ``joint_states`` or ``trajectory``),
    ``rate``, ``speed``, ``reliable`` (false: best-effort publishers of joint states are heard, too); for method ``report`` ``step``, ``iterations``, ``tolerance``, ``stop``, ``orientation``, ``hold``, ``offset``.

    Parameters
    ----------
    bus : Bus
        The network.
    arm : Arm
        What moves.

    Examples
    --------
    >>> import pieper
    >>> from pieper.ros.fake import FakeNetwork
    >>> network = FakeNetwork()
    >>> bus, user = network.bus("inverse_mh12_node", ["--ros-args", "-p", "method:=report"]), network.bus("user")
    >>> node = Inverse(bus, pieper.load("mh12"))
    >>> user.publisher("target", POINT).send(x=0.3, y=0.3, z=0.3)
    >>> network.advance(3.0)
    >>> print(*bus.lines[:4], *bus.lines[-2:], sep="\n")
    Node inverse started
    Received target: x=0.300, y=0.300, z=0.300
    Published joint angles: [0.020112, -0.082213, -0.156107, 0.000000, -0.031586, 0.000000]
    Error: 1.171888
    Error: 0.000000
    Finished IK iterations for target.
    """

    def __init__(self, bus: Bus, arm: Arm) -> None:
        self._bus, self._arm = bus, arm
        self._joints = JointStates(arm.chain)
        self._limits = JointLimits.of(arm.chain)
        self._complaints = Complaints(bus)
        self._declare_parameters()
        self._place, self._placed_at = _at_rest(np.clip(np.zeros(arm.dof), *arm.limits.T)), -1
        self._measured: _Place | None = None
        self._measured_at = 0
        self._run: _Iteration | _Motion | None = None
        self._timer: Timer | None = None
        self._waiting: tuple[_Target, int] | None = None
        self._controller_busy_until = 0
        self._own: deque[tuple[int, int, bytes]] = deque(maxlen=_OWN_REMEMBERED)
        self._crowded = False
        self._locked: dict[tuple[str, ...], Chain] = {}
        self._unsaid: list[tuple[str, str]] | None = None
        self._told_since, self._told_of = 0, 0
        self._state = messages.make(JOINT_STATE, name=list(self._joints.names))
        self._states = bus.publisher("joint_states", JOINT_STATE)
        self._commands = bus.publisher("joint_trajectory", TRAJECTORY)
        reliable = bus.parameter(
            "reliable",
            True,
            description="false: hear best-effort publishers of joint states, too; what is lost is not sent again then",
            read_only=True,
        )
        self._heard = bus.subscribe(
            "joint_states", JOINT_STATE, self._on_joint_states, qos=QoS(reliable=reliable.value)
        )
        bus.subscribe("target", POINT, lambda message: self._first_move_then_talk(self._on_point, message))
        bus.subscribe("target_pose", POSE, lambda message: self._first_move_then_talk(self._on_pose, message))
        bus.serve("~/cancel", "std_srvs/srv/Trigger", self._on_cancel)
        bus.timer(_LOOK_EVERY, self._look)
        self._warm_up()
        bus.log("info", "Node inverse started")

    def _declare_parameters(self) -> None:
        declare = self._bus.parameter
        self._method = declare("method", "solve", description="solve or report", check=one_of("solve", "report"))
        self._output = declare(
            "output",
            "auto",
            description="joint_states, trajectory, or auto: a trajectory where a controller listens",
            check=one_of("auto", "joint_states", "trajectory"),
        )
        self._rate = declare("rate", 100.0, description="joint states a second", check=between(0.1, 10_000.0))
        self._speed = declare(
            "speed", 1.0, description="fraction of the velocity limits to move with", check=between(0.001, 1.0)
        )
        self._step = declare("step", 0.06, description="report: gain of a step", check=between(1e-6, 2.0))
        self._iterations = declare(
            "iterations", 255, description="report: number of steps", check=between(1, 1_000_000)
        )
        self._tolerance = declare(
            "tolerance",
            1e-4,
            description="report: what may be left at the end [m, and rad for a pose]",
            check=between(1e-15, 1.0),
        )
        self._stop = declare("stop", False, description="report: end as soon as no more than the tolerance is left")
        self._orientation = declare(
            "orientation",
            "ignore",
            description="report: ignore the orientation for a Point, or hold it",
            check=one_of("ignore", "hold"),
        )
        self._hold = declare(
            "hold",
            "joint_4_r" if "joint_4_r" in self._arm.joint_names else "",
            description="report: joints that stay at 0 for a Point, separated by commas",
            check=self._check_hold,
        )
        self._offset = declare(
            "offset",
            [0.0, 0.0, 0.0],
            description="report: how far a Point is moved away from the planes of the base frame [m]",
            check=_check_offset,
        )

    def _warm_up(self) -> None:
        """Solve once, so that what is made once per arm is there before the first target comes."""
        q = self._place.q
        T = self._arm.fk(q)
        with suppress(PieperError):  # the reason is told to whoever sends a target
            self._arm.ik(T, q)
            solve_numeric(self._arm.chain, ignore_orientation(T[:3, 3]), seed=q)
            next(self._iteration(_Target(T[:3, 3])).steps, None)

    # What comes in

    def _first_move_then_talk(self, callback: Callable[[Any], None], message: Any) -> None:
        """Call back and keep the log waiting meanwhile: a line takes as long as a solution."""
        self._unsaid = []
        try:
            callback(message)
        finally:
            unsaid, self._unsaid = self._unsaid, None
            if not 0 <= self._bus.now() - self._told_since < 1e9:
                self._told_since, self._told_of = self._bus.now(), 0
            self._told_of += 1
            if self._told_of > _TOLD_OF:
                self._complaints.say("warn", f"targets come too fast to tell of each: {_TOLD_OF} a second are told of")
            else:
                for level, text in unsaid:
                    self._bus.log(level, text)

    def _log(self, level: str, text: str) -> None:
        if self._unsaid is None:
            self._bus.log(level, text)
        else:
            self._unsaid.append((level, text))

    def _on_point(self, message: Any) -> None:
        p = np.array([message.x, message.y, message.z])
        self._log("info", f"Received target: {_as_words(p)}")
        if self._is_somewhere(p):
            self._begin(_Target(p))

    def _on_pose(self, message: Any) -> None:
        p, q = message.pose.position, message.pose.orientation
        position, quaternion = np.array([p.x, p.y, p.z]), np.array([q.x, q.y, q.z, q.w])
        self._log("info", f"Received target: {_as_words(position)}")
        frame = message.header.frame_id.removeprefix("/")
        if frame not in ("", self._arm.base):
            self._refuse(f"the target is given in frame {frame!r}; give it in the base frame {self._arm.base!r}")
            return
        T = np.eye(4)
        try:
            T[:3, :3] = from_quaternion(quaternion)
        except ArrayError as error:
            self._refuse(str(error))
            return
        if self._is_somewhere(position):
            T[:3, 3] = position
            self._begin(_Target(T))

    def _is_somewhere(self, p: FloatArray) -> bool:
        """Whether a position can be computed with; if not, it is refused."""
        if np.isfinite(p).all() and np.abs(p).max() <= _FARTHEST:
            return True
        self._refuse(f"the target must be finite and within {_FARTHEST:g} m, got {_as_words(p)}")
        return False

    def _on_joint_states(self, message: Any) -> None:
        if (message.header.stamp.sec, message.header.stamp.nanosec, message.position.tobytes()) in self._own:
            return
        try:
            q = self._joints.read(message)
        except RosError as error:
            self._complaints.say("warn", str(error))
            return
        if not np.isfinite(q).all():
            self._complaints.say("warn", f"joint states not used: the positions must be finite, got {q.tolist()}")
            return
        self._measured = _Place(q, self._joints.velocity(message), np.zeros(len(q)))
        self._measured_at = self._bus.now()
        if self._waiting is not None:
            self._begin(self._waiting[0])

    def _on_cancel(self, request: Any) -> dict[str, Any]:
        running = self._run is not None or self._waiting is not None
        if isinstance(self._run, _Motion):
            self._show(_at_rest(self._place.q))
        self._end()
        if self._bus.now() < self._controller_busy_until:
            self._brake()
            running = True
        message = "cancelled; the arm comes to rest where it is" if running else "nothing was running"
        self._log("info", f"Cancel: {message}")
        return {"success": running, "message": message}

    # From a target to a run

    def _begin(self, target: _Target) -> None:
        self._waiting = None
        if self._to_controller() and self._measured is None:
            self._end()
            self._waiting = target, self._bus.now() + round(_PATIENCE * 1e9)
            return
        try:
            run = self._iteration(target) if self._method.value == "report" else self._solution(target)
        except PieperError as error:
            self._refuse(str(error))
            return
        self._end()
        if isinstance(run, _Iteration):
            self._start(run)
        else:
            self._move(run)

    def _solution(self, target: _Target) -> Trajectory:
        """The move to the answer that is nearest to where the arm is."""
        chain, place = self._arm.chain, self._now()
        seed = np.clip(place.q, *chain.limits.T)
        if target.is_point:  # by iteration from here: sampling a whole family of answers would take milliseconds
            answers = solve_numeric(chain, ignore_orientation(target.wanted), seed=seed)
        else:
            answers = self._arm.ik(target.wanted, seed)
        if not answers.reached:
            raise RosError(answers.reason)
        place = self._inside(place)
        if not self._to_controller():
            self._show(place)  # where the move begins; it is planned while this is on its way
        move = self._plan(place, answers.q[0])
        self._log("info", f"Joint angles: {self._angles(answers.q[0])}")
        self._log("info", f"Error: {float(answers.position_error[0]):.6f}")
        return move

    def _iteration(self, target: _Target) -> _Iteration:
        """The run of the report's rule, before its first step."""
        held = self._held() if target.is_point else ()
        chain: Chain = self._arm.chain
        kept = np.array([i for i, name in enumerate(chain.joint_names) if name not in held], dtype=np.intp)
        if held:
            if held not in self._locked:
                self._locked[held] = chain.lock(**dict.fromkeys(held, 0.0))
            chain = self._locked[held]
        stop = self._tolerance.value if self._stop.value else None
        steps = iterate(
            chain,
            target.wanted,
            self._now().q[kept],
            orientation=self._orientation.value if target.is_point else "reach",
            alpha=self._step.value,
            iterations=self._iterations.value,
            position_stop=stop,
            rotation_stop=None if target.is_point else stop,
            target_offset=self._offset.value if target.is_point else None,
        )
        return _Iteration(steps, self._iterations.value, next(steps), kept)

    def _inside(self, place: _Place) -> _Place:
        """The same within the limits, beyond which an encoder may read a little."""
        q = np.clip(place.q, *self._arm.limits.T)
        apart = np.abs(q - place.q)
        if (apart > _NEARLY_INSIDE).any():
            joint = int(np.argmax(apart))
            raise MotionError(
                f"the arm is outside its limits, joint {self._arm.joint_names[joint]!r} by {apart[joint]:.3g}; "
                "bring it back first"
            )
        return _Place(q, place.dq, place.ddq)

    def _plan(self, place: _Place, q_goal: FloatArray) -> Trajectory:
        """The smooth move from where the arm is, moving or not, to rest at the goal, within position and velocity limits."""
        chain = self._arm.chain
        fastest = self._speed.value * self._limits.velocity
        move = joint_move(chain, place.q, q_goal, max_velocity=fastest)
        if not place.dq.any():
            return move
        some = np.minimum(np.abs(place.dq), self._limits.velocity)
        limits = JointLimits.of(chain, max_velocity=np.maximum(_SLOWER_MOVING * fastest, some))
        zero = np.zeros(chain.dof)
        duration = max(move.duration, 2.0 * float(np.max(np.abs(place.dq) / limits.acceleration)))
        for _ in range(_LONGER_OFTEN):
            joined = Trajectory(
                np.array([0.0, duration]),
                np.stack([place.q, q_goal]),
                np.stack([place.dq, zero]),
                np.stack([place.ddq, zero]),
                chain.joint_names,
            )
            if limits.surely_hold(joined):
                return joined
            duration *= _LONGER
        # A joint that is on its way to a limit would pass it before it turned round, and all the more the longer that took: rest first.
        duration, rest = self._braking(place)
        move = joint_move(chain, rest, q_goal, max_velocity=fastest)
        joined = Trajectory(
            np.array([0.0, duration, *(duration + move.t[1:])]),
            np.stack([place.q, rest, *move.q[1:]]),
            np.stack([np.clip(place.dq, -self._limits.velocity, self._limits.velocity), zero, *move.q[1:] * 0.0]),
            np.zeros((1 + len(move.t), chain.dof)),
            chain.joint_names,
        )
        self._limits.check_trajectory(joined)
        return joined

    def _braking(self, place: _Place) -> tuple[float, FloatArray]:
        """How long a moving arm takes to come to rest [s], and where, with no joint past its limits."""
        lower, upper = self._arm.limits.T
        speed = np.abs(place.dq)
        duration = 2.0 * max(float(np.max(speed / self._limits.acceleration)), _LOOK_EVERY)
        fast = speed > _CREEPING * self._limits.velocity
        if fast.any():
            room = np.where(place.dq > 0.0, upper - place.q, place.q - lower)[fast]
            duration = min(duration, max(_ROOM_TO_BRAKE * 2.0 * float(np.min(room / speed[fast])), _SHORTEST_BRAKING))
        return duration, np.clip(place.q + 0.5 * duration * place.dq, lower, upper)

    # Runs

    def _start(self, run: _Iteration) -> None:
        self._run = run
        self._timer = self._bus.timer(1.0 / self._rate.value, self._iterate)
        self._iterate()

    def _iterate(self) -> None:
        run = self._run
        if not isinstance(run, _Iteration):
            return
        try:
            step = next(run.steps, None)
        except PieperError as error:
            self._end()
            self._refuse(str(error))
            return
        if step is not None:
            if not self._to_controller():
                self._show(_at_rest(self._whole(run, step)))
                self._log("info", f"Published joint angles: {self._angles(self._place.q)}")
            self._log("info", f"Error: {run.last.norm:.6f}")
            run.last = step
        if step is None or step.iteration == run.count:
            self._end()
            self._log("info", "Finished IK iterations for target.")
            self._conclude(run)

    def _conclude(self, run: _Iteration) -> None:
        """Judge what the iteration has come to; a controller gets it if it is an answer."""
        q = self._whole(run, run.last)
        parts = np.linalg.norm(run.last.error.reshape(-1, 3), axis=1)
        tolerance = self._tolerance.value
        if (parts > tolerance).any():
            left = " and ".join(f"{part:.6f} {unit}" for part, unit in zip(parts, ("m", "rad"), strict=False))
            self._log(
                "warn",
                f"target not reached: {left} left after {run.last.iteration} iterations; {tolerance:g} is allowed",
            )
            return
        lower, upper = self._arm.limits.T
        outside = [name for name, out in zip(self._arm.joint_names, (q < lower) | (q > upper), strict=True) if out]
        if outside:
            self._complaints.say(
                "warn",
                f"the answer is outside the limits of {', '.join(outside)}: this method knows none; method:=solve keeps them",
            )
        if self._to_controller():
            try:
                self._move(self._plan(self._inside(self._now()), q))
            except PieperError as error:
                self._refuse(str(error))
            else:
                self._log("info", f"Published joint angles: {self._angles(q)}")

    def _move(self, trajectory: Trajectory) -> None:
        """Have the controller make a move, or show it by joint states from the next tick on."""
        if self._to_controller():
            self._command(trajectory)
            return
        self._run = _Motion(trajectory, self._bus.now())
        self._timer = self._bus.timer(1.0 / self._rate.value, self._show_motion)

    def _command(self, trajectory: Trajectory) -> None:
        """Where to rest, and when: a controller goes there from where the arm is, and from the velocity that it has."""
        rest = [0.0] * len(self._joints.names)
        coming = slice(1 if len(trajectory.t) > 1 else 0, None)  # the first of several points is where the arm is
        times = [max(1_000_000, round(t * _SLOWER * 1e9)) for t in trajectory.t[coming]]
        self._commands.send(
            joint_names=list(self._joints.names),
            points=[
                {
                    "positions": self._joints.write(q),
                    "velocities": rest,
                    "accelerations": rest,
                    "time_from_start": dict(zip(("sec", "nanosec"), divmod(time, 1_000_000_000), strict=True)),
                }
                for time, q in zip(times, trajectory.q[coming], strict=True)
            ],
        )
        self._controller_busy_until = self._bus.now() + times[-1]
        self._log("info", f"Sent to {self._commands.topic}: {times[-1] * 1e-9:.3f} s")

    def _show_motion(self) -> None:
        run = self._run
        if not isinstance(run, _Motion):
            return
        t = (self._bus.now() - run.began) * 1e-9
        q, dq, ddq = run.trajectory.sample(max(0.0, t))
        self._show(_Place(np.clip(q, *self._arm.limits.T), dq, ddq))  # clip: what rounding adds
        if t >= run.trajectory.duration:
            self._end()
            self._log("info", f"Published joint angles: {self._angles(self._place.q)}")

    def _show(self, place: _Place) -> None:
        """Publish joint states."""
        self._place, self._placed_at = place, self._bus.now()
        stamp, positions = self._bus.stamp(), self._joints.write(place.q)
        message = self._state
        message.header.stamp.sec, message.header.stamp.nanosec = stamp["sec"], stamp["nanosec"]
        message.position, message.velocity = np.array(positions), np.array(self._joints.write(place.dq))
        self._own.append((stamp["sec"], stamp["nanosec"], message.position.tobytes()))
        self._states.send(message)

    def _end(self) -> None:
        """End what runs."""
        self._waiting = self._run = None
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _brake(self) -> None:
        """Have the controller bring a moving arm to rest near where it is."""
        duration, rest = self._braking(self._now())
        self._command(Trajectory(np.array([duration]), rest[None], joint_names=self._arm.joint_names))
        self._controller_busy_until = 0

    # Beneath

    def _now(self) -> _Place:
        """Where the arm is."""
        if self._measured is None or (self._placed_at > self._measured_at and not self._to_controller()):
            return self._place
        return self._measured

    def _to_controller(self) -> bool:
        output = self._output.value
        return output == "trajectory" or (output == "auto" and self._commands.subscribers > 0)

    def _whole(self, run: _Iteration, step: Step) -> FloatArray:
        q = np.zeros(self._arm.dof)
        q[run.kept] = step.q
        return q

    def _held(self) -> tuple[str, ...]:
        return tuple(name for name in map(str.strip, self._hold.value.split(",")) if name)

    def _check_hold(self, value: str) -> None:
        known = self._arm.joint_names
        for name in map(str.strip, value.split(",")):
            if name and name not in known:
                raise ValueError(f"no joint {name!r} of {self._arm.name!r}; joints are: {', '.join(known)}")
        if set(map(str.strip, value.split(","))) >= set(known):
            raise ValueError("at least one joint has to be free to move")

    def _angles(self, q: FloatArray) -> str:
        return f"[{', '.join(f'{value:.6f}' for value in np.round(self._joints.write(q), 6) + 0.0)}]"

    def _refuse(self, reason: str) -> None:
        self._log("warn", f"target refused: {reason}")

    def _look(self) -> None:
        if self._waiting is not None and not 0 <= self._waiting[1] - self._bus.now() <= _PATIENCE * 1e9:
            self._waiting = None
            self._refuse(f"no joint states on {self._heard.topic}, so it is not known where the arm is")
        crowded = self._run is not None and not self._to_controller() and self._heard.publishers > 1
        if crowded and not self._crowded:
            self._log(
                "warn",
                f"another node publishes {self._heard.topic} too: what shows the arm jumps between the two; "
                "stop it, or have a controller listen on joint_trajectory",
            )
        self._crowded = self._crowded or crowded


def _at_rest(q: FloatArray) -> _Place:
    return _Place(q, np.zeros(len(q)), np.zeros(len(q)))


def _as_words(p: FloatArray) -> str:
    x, y, z = p
    return f"x={x:.3f}, y={y:.3f}, z={z:.3f}"


def _check_offset(value: list[float]) -> None:
    if len(value) != 3 or not np.isfinite(value).all():
        raise ValueError(f"must be three finite numbers, got {value!r}")
