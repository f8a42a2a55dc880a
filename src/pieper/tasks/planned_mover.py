"""The mover that plans: ways around obstacles by RRT-Connect, straight lines on one branch, and the quickest timing within every limit.

Where `pieper.tasks.mover.DirectMover` tries straight ways by way of safe postures, this one searches, so that no postures have to be
thought of; it looks at the lines too; and its motions hold limits of jerk. It needs the extra ``plan``.
"""

from __future__ import annotations

from importlib.util import find_spec
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pieper.errors import MotionError
from pieper.kinematics.joints import periodic_joints
from pieper.motion.edges import EdgeCheck
from pieper.motion.limits import JointLimits
from pieper.motion.timing import time_path, time_waypoints
from pieper.motion.trajectory import Trajectory
from pieper.tasks.mover import DirectMover
from pieper.tasks.tip_line import tip_line

if TYPE_CHECKING:
    from collections.abc import Callable

    from pieper.arm import Arm
    from pieper.motion.collision import CollisionModel

FloatArray = NDArray[np.float64]

LINE_MARGIN = 0.002
"""What is kept free beside a straight line of the tip [m]: a hand that grips something is near to what it stands on."""

TIMEOUT = 5.0
"""How long a way is searched for [s]."""

_TURN = 2.0 * np.pi
_STEP = 0.005  # [m] between the poses of a line that are solved
_NEAR_LIMIT = 0.2  # [rad or m]; joint values nearer to a limit are taken when there are no others
_MOST_COPIES = 48


def is_there() -> bool:
    """Whether what this mover needs is installed."""
    return all(find_spec(name) is not None for name in ("coal", "ompl", "ruckig"))


class PlannedMover:
    """Free ways by search, and straight lines of the tip, timed within velocity, acceleration and jerk limits.

    Parameters
    ----------
    arm : Arm
    model : callable
        Given the margin to keep [m], and whether the tip reaches for something, on a line: the arm as it is now, with its tool and what it holds,
        among what stands around it, but for what it reaches for.
    axis_tip : (3,) array, optional
        As for `pieper.tasks.mover.DirectMover`.
    speed : float
        Fraction of the limits of velocity, acceleration and jerk that is used [-].
    margin : float
        Kept between solids on planned ways [m].
    seed : int
        Of the search; the same seed and the same questions give the same ways.
    timeout : float
        How long a way is searched for [s].
    cancelled : callable, optional
        Asked during a search, which ends when it says True.

    Raises
    ------
    MissingExtraError
        Coal, OMPL or Ruckig are not installed; when they are first needed.

    Examples
    --------
    >>> import pieper
    >>> from pieper.motion.collision import CollisionModel
    >>> from pieper.motion.world import Item, World
    >>> from pieper.model.description import Box
    >>> arm = pieper.load("ur5e")
    >>> place = np.eye(4)
    >>> place[:3, 3] = [0.55, 0.0, 0.4]
    >>> post = World([Item("post", Box([0.2, 0.1, 0.8]), place)])
    >>> mover = PlannedMover(arm, model=lambda margin, reaching: CollisionModel(arm, post, margin=margin))
    >>> T_goal = arm.fk([-1.2, -1.2, 1.2, -1.6, -1.6, 0.0])
    >>> way = mover.plan(np.array([1.2, -1.2, 1.2, -1.6, -1.6, 0.0]), T_goal)
    >>> bool(np.abs(arm.fk(way.q[-1]) - T_goal).max() < 1e-9)
    True
    """

    def __init__(
        self, arm: Arm, *, model: Callable[[float, bool], CollisionModel], axis_tip: FloatArray | None = None, speed: float = 1.0,
        margin: float = 0.01, seed: int = 0, timeout: float = TIMEOUT, cancelled: Callable[[], bool] | None = None,
    ) -> None:  # fmt: skip
        self.arm, self.model = arm, model
        self.margin, self.seed, self.timeout, self.cancelled = margin, seed, timeout, cancelled
        self._direct = DirectMover(arm, axis_tip=axis_tip, speed=speed)
        limits = JointLimits.of(arm.chain)
        self.velocity, self.acceleration, self.jerk = (
            speed * most for most in (limits.velocity, limits.acceleration, limits.jerk)
        )

    def plan(
        self, q_start: FloatArray, T_goal: FloatArray, usable: Callable[[FloatArray], bool] | None = None
    ) -> Trajectory:
        """The way from `q_start` (n,) to the nearest usable joint values that are free at the pose `T_goal` (4, 4), straight if that is free too; see `pieper.tasks.mover.Mover.plan`.

        Raises
        ------
        MotionError
            No answer is free, or no way to one; the message says what is in the way.
        """
        from pieper.motion import planning

        model = self.model(self.margin, False)
        answers = self._with_turns(self._direct.answers(T_goal, q_start), q_start)
        free = answers[np.atleast_1d(model.is_free(answers))]
        if not len(free):
            nearest = max((model.distance(q) for q in answers), key=lambda pair: pair.distance)
            raise MotionError(f"none of {len(answers)} answers at the goal is free: {nearest}")
        edges = EdgeCheck(model)
        judged: list[FloatArray] = []
        for q in free[np.lexsort((self._effort(q_start, free), self._is_near_limit(free)))]:
            if self.cancelled is not None and self.cancelled():
                raise MotionError("cancelled while planning")
            if usable is None or usable(q):
                if model.is_free(q_start) and edges.free(q_start, q):
                    return self._timed(np.stack([q_start, q]))
                judged.append(q)
        if not judged:
            raise MotionError(
                "the pose is in reach, but the motion cannot go on from any of the joint values that reach it"
            )
        found = planning.plan(
            model, q_start, np.array(judged), seed=self.seed, timeout=self.timeout, cancelled=self.cancelled
        )
        if not found.found:
            raise MotionError(f"no free way to {len(judged)} answers: {found}")
        return self._timed(found.q)

    def line(self, q_start: FloatArray, T_goal: FloatArray) -> Trajectory:
        """A straight line of the tip from `q_start` (n,) to `T_goal` (4, 4) on one branch, its orientation turning evenly; see `pieper.tasks.mover.Mover.line`.

        Raises
        ------
        MotionError
            It leaves the limits or is not free; the message says after how many metres.
        """
        path = tip_line(self.arm, q_start, T_goal, axis_tip=self._direct.axis_tip, step=_STEP)
        if path is None:
            return Trajectory(np.zeros(1), q_start[None], joint_names=self.arm.joint_names)
        model = self.model(LINE_MARGIN, True)
        hits = np.flatnonzero(~np.atleast_1d(model.is_free(path.q)))
        begins = self._touching(model, q_start)  # what stands on a board, or lies in a hand, does so at first
        for k in hits:
            new = [pair for pair in model.contacts(path.q[k]) if frozenset((pair.first, pair.second)) not in begins]
            if new:
                raise MotionError(
                    f"the straight line is not free after {path.s[k]:.3f} of {path.s[-1]:.3f} m: {new[0]}"
                )
        move = time_path(path, max_velocity=self.velocity, max_acceleration=self.acceleration, max_jerk=self.jerk)
        return Trajectory(move.t, move.q, move.dq, move.ddq, self.arm.joint_names)

    @staticmethod
    def _touching(model: CollisionModel, q: FloatArray) -> set[frozenset[str]]:
        return {frozenset((pair.first, pair.second)) for pair in model.contacts(q)}

    def _effort(self, q_start: FloatArray, q_goal: FloatArray) -> FloatArray:
        """About how long joint moves take, (k,) [s]."""
        return np.asarray((np.abs(q_goal - q_start) / self.velocity).max(axis=-1))

    def _is_near_limit(self, q: FloatArray) -> NDArray[np.bool_]:
        """(k,) where an arm would soon have no way on: after many motions to what is nearest, joints are wound up."""
        lower, upper = self.arm.limits.T
        return np.asarray((np.minimum(q - lower, upper - q) < _NEAR_LIMIT).any(axis=-1))

    def _with_turns(self, answers: FloatArray, q_near: FloatArray) -> FloatArray:
        """The answers and their copies by whole turns within the limits, the nearest first, (k, n)."""
        lower, upper = self.arm.limits.T
        turning = periodic_joints(self.arm.chain) & np.isfinite(self.arm.limits).all(axis=1)
        found = [*answers]
        for q in answers:
            choices = [
                [x + turn for turn in (0.0, -_TURN, _TURN) if low <= x + turn <= high] if turns else [x]
                for x, turns, low, high in zip(q, turning, lower, upper, strict=True)
            ]
            found += [np.array(copy) for copy in product(*choices) if not np.array_equal(copy, q)]
        copies = np.array(found)
        return copies[np.argsort(self._effort(q_near, copies), kind="stable")][:_MOST_COPIES]

    def _timed(self, q: FloatArray) -> Trajectory:
        return time_waypoints(
            self.arm.chain, q, max_velocity=self.velocity, max_acceleration=self.acceleration, max_jerk=self.jerk
        )
