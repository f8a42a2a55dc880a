"""How a task gets from pose to pose: the calls that a planner has to answer, and the plain mover that answers them without one.

A task asks for a joint motion to a pose, along whatever way is free, and for a straight motion of the tip over a short distance. Both come
back as a `Trajectory` from rest to rest, or as a `MotionError` that says why there is none.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from pieper.errors import MotionError
from pieper.ik.target import position_and_axis
from pieper.motion.joint_move import joint_move
from pieper.motion.limits import JointLimits
from pieper.motion.trajectory import Trajectory, one_after_another
from pieper.tasks.tip_line import tip_line

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from pieper.arm import Arm

FloatArray = NDArray[np.float64]

STEP = 0.01
"""Distance of the poses on a line that are solved [m]; a radian of turning counts as 0.1 m."""

LOOK = 0.03
"""How far joints move between looks for what is in the way [rad or m]."""


class Mover(Protocol):
    """What a task needs from a planner."""

    def plan(
        self, q_start: FloatArray, T_goal: FloatArray, usable: Callable[[FloatArray], bool] | None = None
    ) -> Trajectory:
        """A motion from rest at `q_start`, (n,), to rest with the tip at `T_goal`, (4, 4), at joint values that are `usable`.

        Raises
        ------
        MotionError
            There is none; the message says why.
        """
        ...

    def line(self, q_start: FloatArray, T_goal: FloatArray) -> Trajectory:
        """The same with the tip on a straight line, without a change of branch."""
        ...


class DirectMover:
    """Straight moves in joint space, if need be by way of a safe posture, and straight lines of the tip.

    It looks where it goes and takes another answer or another way when something is in the way, but it searches no further.

    Parameters
    ----------
    arm : Arm
    axis_tip : (3,) array, optional
        For arms that cannot take every orientation, and for things that look the same from all around: only this axis of the tip gets the
        direction that the pose gives it, and the turn about it is free.
    blocked : callable, optional
        Given joint values (n,), what the arm would touch there, in words; empty when nothing.
    postures : sequence of (n,) arrays
        Where to go by way of when the straight way is blocked [rad or m].
    speed : float
        Fraction of the velocity limits that is used; accelerations go along [-].

    Examples
    --------
    >>> import pieper
    >>> arm = pieper.load("ur5e")
    >>> mover = DirectMover(arm)
    >>> q = np.array([0.0, -1.5, 1.5, -1.5, -1.5, 0.0])
    >>> T = arm.fk(q)
    >>> T[2, 3] += 0.1
    >>> down = mover.line(q, T)
    >>> bool(abs(arm.fk(down.q)[:, :2, 3] - T[:2, 3]).max() < 1e-6)  # m
    True
    """

    def __init__(
        self, arm: Arm, *, axis_tip: FloatArray | None = None, blocked: Callable[[FloatArray], str] | None = None,
        postures: Sequence[FloatArray] = (), speed: float = 1.0,
    ) -> None:  # fmt: skip
        self.arm = arm
        self.blocked, self.postures = blocked, tuple(postures)
        self.axis_tip = axis_tip
        limits = JointLimits.of(arm.chain)
        self.velocity, self.acceleration = speed * limits.velocity, speed * limits.acceleration

    def answers(self, T_goal: FloatArray, q_near: FloatArray) -> FloatArray:
        """(k, n) joint values within the limits that reach a pose, the nearest to `q_near` first.

        Raises
        ------
        MotionError
            None do.
        """
        target = (
            T_goal
            if self.axis_tip is None
            else position_and_axis(T_goal[:3, 3], T_goal[:3, :3] @ self.axis_tip, axis_tip=self.axis_tip)
        )
        found = self.arm.ik(target, q_near)
        q = np.asarray(found.q)[np.asarray(found.within_limits)]
        if not len(q):
            where = ", ".join(f"{value:.3f}" for value in T_goal[:3, 3])
            raise MotionError(
                f"no joint values bring the tip to ({where}) m: {found.reason or 'all answers leave the joint limits'}"
            )
        return np.asarray(q[np.argsort(np.abs(q - q_near).max(axis=1), kind="stable")])

    def plan(
        self, q_start: FloatArray, T_goal: FloatArray, usable: Callable[[FloatArray], bool] | None = None
    ) -> Trajectory:
        """The shortest free way to usable joint values, straight or by way of one of the postures; see `Mover.plan`."""
        answers = list(self.answers(T_goal, q_start))
        ways = [
            (number, [q_start, q] if by_way_of is None else [q_start, by_way_of, q])
            for by_way_of in (None, *self.postures)
            for number, q in enumerate(answers)
        ]
        ways.sort(key=lambda way: sum(self._effort(a, b) for a, b in pairwise(way[1])))
        judged: dict[int, bool] = {}
        reason = ""
        for number, corners in ways:
            if number not in judged:
                judged[number] = usable is None or usable(answers[number])
            if not judged[number]:
                continue
            found = next(filter(None, (self._hindrance(a, b) for a, b in pairwise(corners))), "")
            if not found:
                return self._through(corners)
            reason = reason or found
        if not reason:
            raise MotionError(
                "the pose is in reach, but the motion cannot go on from any of the joint values that reach it"
            )
        raise MotionError(
            f"no free way to {len(answers)} answers, straight or by way of {len(self.postures)} postures: {reason}"
        )

    def _effort(self, q_start: FloatArray, q_goal: FloatArray) -> float:
        """About how long a joint move takes [s]."""
        return float((np.abs(q_goal - q_start) / self.velocity).max())

    def _hindrance(self, q_start: FloatArray, q_goal: FloatArray) -> str:
        if self.blocked is None:
            return ""
        count = int(np.ceil(np.abs(q_goal - q_start).max() / LOOK)) + 1
        return next(
            filter(
                None, (self.blocked(q_start + u * (q_goal - q_start)) for u in np.linspace(0.0, 1.0, count + 1)[1:])
            ),
            "",
        )

    def _through(self, corners: list[FloatArray]) -> Trajectory:
        moves = [
            joint_move(self.arm.chain, a, b, max_velocity=self.velocity, max_acceleration=self.acceleration)
            for a, b in pairwise(corners)
        ]
        return one_after_another([move for move in moves if move.duration > 0.0] or moves[:1])

    def line(self, q_start: FloatArray, T_goal: FloatArray) -> Trajectory:
        """A straight line of the tip, its orientation turning evenly; see `Mover.line`."""
        path = tip_line(self.arm, q_start, T_goal, axis_tip=self.axis_tip, step=STEP)
        if path is None:
            return Trajectory(np.zeros(1), q_start[None], joint_names=self.arm.joint_names)
        return timed(path.q[path.given], self.velocity, self.acceleration, self.arm.joint_names)


def timed(
    way: FloatArray, max_velocity: FloatArray, max_acceleration: FloatArray, joint_names: tuple[str, ...]
) -> Trajectory:
    """A smooth motion through joint values, from rest to rest, within limits: (k, n) values, evenly spaced along the way.

    A cubic spline through them is run along by ``10 u^3 - 15 u^4 + 6 u^5``, as slowly as the tightest limit anywhere on it asks.
    """
    from scipy.interpolate import CubicSpline

    k = len(way)
    curve = CubicSpline(np.linspace(0.0, 1.0, k), way)
    u = np.linspace(0.0, 1.0, 4 * k + 1)
    s = u**3 * (10.0 - 15.0 * u + 6.0 * u * u)
    ds = 30.0 * u * u * (1.0 - u) ** 2
    dds = 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u)
    q, slope, bend = curve(s), curve(s, 1), curve(s, 2)
    dq = slope * ds[:, None]
    ddq = bend * ds[:, None] ** 2 + slope * dds[:, None]
    duration = 1.02 * max(
        float((np.abs(dq) / max_velocity).max()), float(np.sqrt((np.abs(ddq) / max_acceleration).max())), 1e-3
    )  # between the samples it is a little more
    dq[0], dq[-1], ddq[0], ddq[-1] = 0.0, 0.0, 0.0, 0.0
    return Trajectory(u * duration, q, dq / duration, ddq / duration**2, joint_names)
