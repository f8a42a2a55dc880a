"""Streaming control: a pose or a twist in, the next joint values out, every two milliseconds.

`Servo` keeps a commanded state (position, velocity, acceleration of every joint) and moves it on by one cycle at each `Servo.step`:

* **A pose** is solved for the answer nearest to the one before, from the closed form where the arm has one, else by iteration from
  there. It is taken when it is a small step away or on the same branch; else the arm holds, and says so: never does it
  change to another branch by itself.
* **A twist** becomes joint velocities by damped least squares, ``dq = J^T (J J^T + d^2 1)^-1 v``; the damping d grows from 0 as the
  manipulability falls below a threshold (Nakamura and Hanafusa 1986). They are scaled together, so that the direction stays.
* **Ruckig** plans each cycle anew, from the state as it is, within velocity, acceleration and jerk. Towards poses it plans in a frame that
  moves with the answers, ``e = q - goal(t)``, so that the arm does not stay behind a pose that moves evenly.
* **At rest within the limits at any moment**: a state is entered only if braking from it as hard as allowed ends before every joint limit.
  Where the next state is not such a one, the arm brakes; that braking stays within the limits because the state before was one.

References
----------
Berscheid and Kroeger 2021, Jerk-limited real-time trajectory generation with arbitrary target states, Robotics: Science and Systems.
Nakamura and Hanafusa 1986, Inverse kinematic solutions with singularity robustness for robot manipulator control, Journal of
Dynamic Systems, Measurement, and Control 108(3), 163-171.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Protocol

import numpy as np

from pieper.errors import ArrayError, MotionError
from pieper.ik.numeric import solve_numeric
from pieper.ik.solutions import Status
from pieper.ik.solve import solver
from pieper.model.chain import Chain
from pieper.motion import _ruckig
from pieper.motion.limits import JointLimits

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from pieper.ik.solutions import IKSolutions
    from pieper.spatial._checks import FloatArray

LARGEST_STEP = 0.2
"""An answer no joint of which is further away than this from the one before is taken whatever its branch is called [rad or m]."""

_DAMPING = 0.05  # the most of it, for a Jacobian of order 1
_THRESHOLD = 0.05  # of the manipulability that the arm has at most: below it damping sets in
_ROOM = 1e-6  # [rad or m] from the joint limits, kept for rounding
_STILL = 1e-15  # [rad or m] a joint that comes no nearer to its limit than this in a cycle stands still
_REST = 1e-9  # [rad/s, rad/s^2] slower than this is at rest
_FEED = 0.95  # of its speed limit that an answer may move with to be followed as it moves; the rest is for catching up
_LAG = 3.0  # cycles by which the arm may be behind before it says that a limit holds it back


class Held(NamedTuple):
    """Why the arm does not do all of what it is asked."""

    reason: Literal["limit", "singularity", "unreachable", "branch", "malformed"]
    message: str


class Command(NamedTuple):
    """What to send to the joints now: position and velocity, (n,) each [rad or m, per s]."""

    q: FloatArray
    dq: FloatArray


class _HasChain(Protocol):
    @property
    def chain(self) -> Chain: ...


class Servo:
    """Follows poses or twists cycle by cycle within the limits of the joints.

    Parameters
    ----------
    arm : Arm or Chain
    limits : JointLimits, optional
        Velocity, acceleration and jerk; what `JointLimits.of` gives for the chain when not given.
    q : (n,) array
        Where the arm is, at rest, within its limits [rad or m].
    rate : float
        Cycles a second [Hz].

    Attributes
    ----------
    held : Held or None
        Why the arm held back in the last cycle.

    Raises
    ------
    ArrayError, MotionError
        Joint values out of the limits, a rate that is not above 0.
    MissingExtraError
        Ruckig is not installed.

    Examples
    --------
    >>> import numpy as np
    >>> from pieper.model import catalog
    >>> from pieper.kinematics.fk import fk
    >>> arm = catalog.describe("ur5e").chain()
    >>> servo = Servo(arm, q=[0.3, -1.2, 1.4, -1.7, -1.5, 0.3])
    >>> for _ in range(500):  # one second upwards at 0.1 m/s
    ...     q, dq = servo.step(np.array([0.0, 0.0, 0.1, 0.0, 0.0, 0.0]))
    >>> servo.held is None, servo.at_rest
    (True, False)
    >>> servo.stop()
    >>> while not servo.at_rest:
    ...     q, dq = servo.step()
    >>> bool(0.08 < fk(arm, q)[2, 3] - fk(arm, [0.3, -1.2, 1.4, -1.7, -1.5, 0.3])[2, 3] < 0.12)
    True
    """

    def __init__(
        self, arm: _HasChain | Chain, limits: JointLimits | None = None, *, q: ArrayLike, rate: float = 500.0
    ) -> None:
        chain = arm if isinstance(arm, Chain) else arm.chain
        if not (np.isfinite(rate) and rate > 0.0):
            raise ArrayError(f"rate must be above 0 [Hz], got {rate!r}")
        self.chain = chain
        self.limits = JointLimits.of(chain) if limits is None else limits
        if self.limits.chain.joint_names != chain.joint_names:
            raise ArrayError(
                f"limits must be those of the joints of {chain.name!r}, got those of {self.limits.chain.name!r}"
            )
        self.rate = float(rate)
        self.held: Held | None = None
        start = self.limits.check_position(q).tolist()
        n = chain.dof
        ruckig = _ruckig.module()
        self._failures = (ruckig.Result.Error, ruckig.Result.ErrorInvalidInput)
        self._raised = (ruckig.RuckigError, ValueError)  # ValueError: a result that its Python has no name for
        self._ruckig, self._braking = ruckig.Ruckig(n, 1.0 / self.rate), ruckig.Ruckig(n, 1.0 / self.rate)
        self._asked, self._turning, self._brake = (ruckig.InputParameter(n) for _ in range(3))
        self._out, self._stopped = ruckig.OutputParameter(n), ruckig.OutputParameter(n)
        # full speed and full acceleration are come to in a cycle at least: Ruckig fails where limits are very different in size
        acceleration = np.minimum(self.limits.acceleration, self.limits.velocity * self.rate)
        jerk = np.minimum(self.limits.jerk, acceleration * self.rate)
        for asked in (self._asked, self._turning, self._brake):
            asked.synchronization = ruckig.Synchronization.No
            asked.max_velocity = self.limits.velocity.tolist()
            asked.max_acceleration, asked.max_jerk = acceleration.tolist(), jerk.tolist()
            asked.current_position = asked.target_position = start
        self._brake.control_interface = self._turning.control_interface = ruckig.ControlInterface.Velocity
        self._zeros = [0.0] * n
        self._asked.target_position = self._zeros
        self._most = self.limits.velocity.tolist()
        self._fed = (_FEED * self.limits.velocity).tolist()
        lower, upper = chain.limits.T
        room = np.minimum(_ROOM, 0.5 * (upper - lower))
        self._lower, self._upper = (lower + room).tolist(), (upper - room).tolist()
        self._ends: list[tuple[float, float]] = [(low, high) for low, high in chain.limits.tolist()]
        # farther from a limit than any braking takes nothing needs to be looked at
        way = self.limits.velocity * (self.limits.velocity / acceleration + 2.0 * acceleration / jerk + 2.0 / rate)
        self._near_lower, self._near_upper = (lower + way).tolist(), (upper - way).tolist()
        self._q, self._dq, self._ddq = start, list(self._zeros), list(self._zeros)
        self._solver = solver(chain)
        self._listed = self._solver.method == "closed form"
        self._goal, self._goal_array = list(start), np.array(start)
        self._branch = -1
        self._following = False
        lowest, highest = np.clip(chain.limits, -np.pi, np.pi).T
        probes = lowest + np.random.default_rng(0).random((256, n)) * (highest - lowest)
        self._regular = _THRESHOLD * float(np.max(chain.native.manipulability(probes)))
        self._eye = np.eye(6)

    # --- state

    @property
    def q(self) -> FloatArray:
        """(n,) commanded joint values [rad or m]."""
        return np.array(self._q)

    @property
    def dq(self) -> FloatArray:
        """(n,) commanded velocities [rad/s or m/s]."""
        return np.array(self._dq)

    @property
    def ddq(self) -> FloatArray:
        """(n,) commanded accelerations [rad/s^2 or m/s^2]."""
        return np.array(self._ddq)

    @property
    def at_rest(self) -> bool:
        """Whether no joint moves."""
        return all(abs(v) <= _REST for v in self._dq) and all(abs(a) <= _REST for a in self._ddq)

    # --- one cycle

    def step(self, target: FloatArray | None = None) -> Command:
        """The command of the next cycle.

        Parameters
        ----------
        target : (4, 4) or (6,) array, optional
            A pose ``T_base_tcp`` [m, -] to be at, or a twist of the tip in base axes, linear part first [m/s, rad/s], to move with.
            None brakes to rest.

        Returns
        -------
        Command
            `held` tells whether and why it is less than what was asked.

        Raises
        ------
        ArrayError
            Neither a pose nor a twist in shape. A pose or twist with a NaN, or a matrix that is no rotation, is not an error here: the arm
            brakes, and `held` says so.
        """
        if target is None:
            self.held = None
            return self._stop()
        shape = getattr(target, "shape", None)
        if shape == (4, 4):
            return self._to_pose(target)
        if shape == (6,):
            return self._with_twist(target)
        target = np.asarray(target, dtype=np.float64)
        if target.shape in ((4, 4), (6,)):
            return self.step(target)
        raise ArrayError(f"target must be a pose (4, 4) or a twist (6,), got {target.shape}")

    def stop(self) -> None:
        """From the next cycle on brake to rest: call `step` without a target until `at_rest`."""
        self._following = False
        self.held = None

    # --- a pose

    def _to_pose(self, T: FloatArray) -> Command:
        old = self._goal
        try:
            if self._listed:
                answers = self._solver.solve(T, self._goal_array)
            else:
                answers = solve_numeric(self.chain, T, seed=self._goal_array, restarts=1)
        except ArrayError as error:
            self.held = Held("malformed", f"{error}; the arm holds")
            self._following = False
            return self._ahead(old, self._zeros)
        if answers.within_limits[:1].any():
            best = answers.q[0]
            goal = best.tolist()
            near = True
            for a, b in zip(goal, old, strict=True):
                if not -LARGEST_STEP <= a - b <= LARGEST_STEP:
                    near = False
                    break
            if near:
                self.held = None
            elif not self._takes_far(answers):
                return self._ahead(old, self._zeros)
            else:
                best = self._goal_array
                goal = best.tolist()
            self._branch = int(answers.branch[0]) if near else self._branch
            self._goal, self._goal_array = goal, best
            feed = self._zeros
            if near and self._following:
                rate = self.rate
                feed = [max(-v, min(v, (a - b) * rate)) for a, b, v in zip(goal, old, self._fed, strict=True)]
            self._following = True
            return self._ahead(goal, feed)
        self._say_why(answers)
        self._following = False
        return self._ahead(old, self._zeros)

    def _takes_far(self, answers: IKSolutions) -> bool:
        """Whether an answer that is far away may be taken: one of the same branch. Sets the goal, or says why not."""
        rows = np.flatnonzero(answers.within_limits)
        if self._branch < 0 and self._listed:  # where the arm is
            here = self._solver.solve(self.chain.native.fk(self._goal_array), self._goal_array)
            self._branch = int(here.branch[0]) if here.valid[:1].any() else -1
        same = [int(i) for i in rows if self._branch >= 0 and answers.branch[i] == self._branch]
        if same:
            self._goal_array = answers.q[same[0]]
            self._branch = int(answers.branch[same[0]])
            self.held = None
            return True
        jump = np.abs(answers.q[rows[0]] - self._goal_array)
        joint = int(np.argmax(jump))
        name = self.chain.joint_names[joint]
        if self._is_singular():
            self.held = Held(
                "singularity",
                f"the branch ends here, joint {name!r} would have to jump by {jump[joint]:.3g}; the arm holds",
            )
        else:
            self.held = Held(
                "branch",
                f"the pose is on another branch, joint {name!r} would have to jump by {jump[joint]:.3g}; the arm holds",
            )
        return False

    def _is_singular(self) -> bool:
        return bool(self.chain.native.manipulability(self._goal_array) < self._regular)

    def _say_why(self, answers: IKSolutions) -> None:
        status = Status(int(answers.status.ravel()[0]))
        if status is Status.outside_limits:
            self.held = Held("limit", f"{answers.reason}; the arm holds")
        elif not self._listed and self._is_singular():
            self.held = Held(
                "singularity", "iteration from the pose before came to no answer near a singularity; the arm holds"
            )
        else:
            self.held = Held("unreachable", "the pose is out of reach; the arm holds")

    # --- a twist

    def _with_twist(self, twist: FloatArray) -> Command:
        self._following = False
        q = np.array(self._q)
        native = self.chain.native
        J = native.jacobian(q)
        size = float(native.manipulability(q))
        self.held = None
        M = J @ J.T
        if size < self._regular or self.chain.dof < 6:
            damping = _DAMPING * (1.0 - min(size / self._regular, 1.0)) if self._regular > 0.0 else _DAMPING
            M += (damping * damping + 1e-12) * self._eye
            if size < self._regular:
                self.held = Held("singularity", "near a singularity: the motion that the arm can hardly make is damped")
        try:
            dq = (J.T @ np.linalg.solve(M, twist)).tolist()
        except np.linalg.LinAlgError:
            dq = [np.nan]
        fastest, joint = 1.0, -1
        for k, (v, most) in enumerate(zip(dq, self._most, strict=False)):
            if not abs(v) <= fastest * most:
                if v != v or abs(v) == np.inf:
                    self.held = Held("malformed", "the twist must be six finite numbers; the arm brakes")
                    return self._stop()
                fastest, joint = abs(v) / most, k
        if joint >= 0:
            dq = [v / fastest for v in dq]
            if self.held is None:
                name = self.chain.joint_names[joint]
                self.held = Held(
                    "limit",
                    f"joint {name!r} would have to be {fastest:.3g} times as fast as its limit; all are slowed down",
                )
        asked = self._turning
        asked.current_position, asked.current_velocity, asked.current_acceleration = self._q, self._dq, self._ddq
        asked.target_velocity = dq
        self._ruckig.reset()
        if self._fails(self._ruckig, asked, self._out):
            return self._stop(failed=True)
        out = self._out
        command = self._entered(out.new_position, out.new_velocity, out.new_acceleration)
        self._goal, self._goal_array = self._q, np.array(self._q)
        self._branch = -1
        return command

    # --- motion

    def _ahead(self, goal: list[float], feed: list[float]) -> Command:
        """One cycle towards joint values that move with some velocity and are there at its end."""
        for x, low, high in zip(goal, self._lower, self._upper, strict=True):
            if not low <= x <= high:
                goal, feed = self._short_of_limits(goal, feed)
                break
        asked, out, cycle = self._asked, self._out, 1.0 / self.rate
        asked.current_position = [x - g + f * cycle for x, g, f in zip(self._q, goal, feed, strict=True)]
        asked.current_velocity = [v - f for v, f in zip(self._dq, feed, strict=True)]
        asked.current_acceleration = self._ddq
        asked.max_velocity = [v - f for v, f in zip(self._most, feed, strict=True)]
        asked.min_velocity = [-v - f for v, f in zip(self._most, feed, strict=True)]
        if self._fails(self._ruckig, asked, out):
            return self._stop(failed=True)
        command = self._entered(
            [g + e for g, e in zip(goal, out.new_position, strict=True)],
            [f + v for f, v in zip(feed, out.new_velocity, strict=True)],
            out.new_acceleration,
        )
        if self.held is None:
            most, rate = self._most, self.rate
            for k, (a, b) in enumerate(zip(goal, self._q, strict=True)):
                if abs(a - b) * rate > _LAG * most[k] and abs(self._dq[k]) > 0.999 * most[k]:
                    self.held = Held(
                        "limit", f"joint {self.chain.joint_names[k]!r} moves at its speed limit and lags behind"
                    )
                    break
        return command

    def _fails(self, ruckig: Any, asked: Any, out: Any) -> bool:
        """Ask Ruckig for the next cycle; whether it has no answer."""
        try:
            return ruckig.update(asked, out) in self._failures
        except self._raised:
            return True

    def _short_of_limits(self, goal: list[float], feed: list[float]) -> tuple[list[float], list[float]]:
        """Joint values that may be come to rest at: one joint too near to its limit would else hold all of them."""
        short = [min(max(x, low), high) for x, low, high in zip(goal, self._lower, self._upper, strict=True)]
        return short, [f if x == g else 0.0 for f, x, g in zip(feed, short, goal, strict=True)]

    def _entered(self, q: list[float], dq: list[float], ddq: list[float]) -> Command:
        """The state of the next cycle, if the arm can be brought to rest from it; else one cycle of braking."""
        for x, low, high in zip(q, self._near_lower, self._near_upper, strict=True):
            if not low <= x <= high:
                if not self._can_brake(q, dq, ddq):
                    return self._stop(limited=True)
                q = [min(max(x, low), high) for x, (low, high) in zip(q, self._ends, strict=True)]  # of rounding
                break
        self._q, self._dq, self._ddq = q, dq, ddq
        return Command(np.array(q), np.array(dq))

    def _can_brake(self, q: list[float], dq: list[float], ddq: list[float]) -> bool:
        """Whether braking from a state ends within the joint limits, or, of a joint that stands at its limit, no nearer to it."""
        brake = self._brake
        # from 0: Ruckig counts 0 among the extrema of a motion to a velocity, wherever that motion is
        brake.current_position, brake.current_velocity, brake.current_acceleration = self._zeros, dq, ddq
        brake.target_velocity = brake.target_acceleration = self._zeros
        self._braking.reset()
        if self._fails(self._braking, brake, self._stopped):
            return False
        extrema = self._stopped.trajectory.position_extrema
        for x, now, bound, low, high in zip(q, self._q, extrema, self._lower, self._upper, strict=True):
            if x + bound.min < min(low, now - _STILL) or x + bound.max > max(high, now + _STILL):
                return False
        return True

    def _stop(self, *, limited: bool = False, failed: bool = False) -> Command:
        """One cycle of braking as hard as allowed."""
        self._following = False
        if failed:
            self.held = Held("limit", "no motion within the limits was found for this cycle; the arm brakes")
        if limited:
            lower, upper = self.chain.limits.T
            room = np.minimum(np.array(self._q) - lower, upper - np.array(self._q))
            joint = int(np.argmin(room))
            self.held = Held("limit", f"joint {self.chain.joint_names[joint]!r} brakes before its limit")
        brake = self._brake
        brake.current_position, brake.current_velocity, brake.current_acceleration = self._q, self._dq, self._ddq
        brake.target_velocity = brake.target_acceleration = self._zeros
        self._braking.reset()
        if self._fails(self._braking, brake, self._stopped):
            raise MotionError(
                f"no braking was found from {self._q} at {self._dq}; limits of very different sizes? raise the smallest of them"
            )
        out = self._stopped
        self._q, self._dq, self._ddq = out.new_position, out.new_velocity, out.new_acceleration
        self._goal, self._goal_array = self._q, np.array(self._q)
        return Command(np.array(self._q), np.array(self._dq))
