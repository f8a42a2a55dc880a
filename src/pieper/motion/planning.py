"""Motions around obstacles: a path of straight edges in joint space from a start to a goal that touches nothing.

The straight way is tried first, to every goal. Where all are blocked, RRT-Connect of OMPL searches and its path is shortened. Edges are
checked all along in metric steps (`pieper.motion.edges`), and the path that is returned is checked once more as a whole.
"""

from __future__ import annotations

import itertools
import operator
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.errors import ArrayError, MotionError
from pieper.ik.solve import solve
from pieper.ik.target import Target
from pieper.kinematics.joints import as_joints
from pieper.motion.collision import DEFAULT_MARGIN, CollisionModel, Nearest, finite_limits
from pieper.motion.edges import EdgeCheck
from pieper.motion.ompl_search import search
from pieper.motion.shorten import shorten
from pieper.spatial._checks import FloatArray, poses, stack

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from numpy.typing import ArrayLike

    from pieper.model.chain import Chain
    from pieper.motion.arm_solids import ArmLike
    from pieper.motion.timing import TcpLimits
    from pieper.motion.trajectory import Trajectory
    from pieper.motion.world import Item, World

STATUSES = (
    "found",
    "start out of limits",
    "start in collision",
    "goal out of limits",
    "goal out of reach",
    "goal in collision",
    "no path in time",
    "cancelled",
)
"""How a plan can end."""

DEFAULT_TIMEOUT = 5.0
"""Seconds."""

MOST_GOALS = 12
"""Joint vectors of a goal pose that are taken, the nearest to the start first."""

_ROUNDING = 1e-9  # [rad or m] outside a limit by rounding
_BESIDE = np.pi  # [rad] how far beyond start and goals a joint that turns is moved in a search
_LIGHT = 0.25  # joints count by how far they move points, but not less than this fraction of the most
_LONGEST = 0.7  # [rad of the joint that moves points farthest] of an edge in the search
_TOLD = 0.05  # seconds between two calls of progress


@dataclass(frozen=True, eq=False)
class Plan:
    """A path, or what is in its way.

    Attributes
    ----------
    status : str
        One of `STATUSES`.
    reason : str
        In words; empty when a path was found.
    q : (k, n) array
        Joint vectors from the start, straight in joint space from one to the next [rad or m]. Without a path the way to where the search
        came nearest to a goal; one row where start and goal are the same, or nothing was searched.
    goal : int
        Which of the goals was reached, or was nearest; -1 when none could be tried.
    goals : (g, n) array
        The joint vectors that were aimed at.
    blocking : Nearest or None
        The pair of solids in the way.
    margin, kept : float
        Distance of all solids at the states that were looked at, and everywhere between them [m].
    seconds : float
        Time taken.
    edges, states : int
        How many edges and states were looked at.
    joint_names : tuple of str
    rests_at : tuple of int
        Rows of `q` between the ends at which a motion must rest: where a straight approach begins.
    """

    status: str
    reason: str
    q: FloatArray
    goal: int
    goals: FloatArray
    blocking: Nearest | None
    margin: float
    kept: float
    seconds: float
    edges: int
    states: int
    joint_names: tuple[str, ...] = field(default=())
    rests_at: tuple[int, ...] = ()

    @property
    def found(self) -> bool:
        """Whether `q` leads to a goal."""
        return self.status == "found"

    @property
    def length(self) -> float:
        """Length of the path in joint space, the sum of its edges [rad, m]."""
        return float(np.linalg.norm(np.diff(self.q, axis=0), axis=1).sum())

    def trajectory(
        self,
        along: Chain | CollisionModel,
        *,
        max_velocity: ArrayLike | None = None,
        max_acceleration: ArrayLike | None = None,
        max_jerk: ArrayLike | None = None,
        tcp: TcpLimits | None = None,
    ) -> Trajectory:
        """The quickest jerk-limited motion along the path that is found, from rest to rest, within every limit.

        Parameters
        ----------
        along : Chain or CollisionModel
            With a chain the motion rests at each point: the edges that were checked, and nothing beside them. With the model of the plan
            corners are rounded where that is quicker and free too, see `pieper.motion.blending.time_blended`.
        max_velocity, max_acceleration, max_jerk : float or (n,) array, optional
            See `pieper.motion.limits.JointLimits.of`.
        tcp : TcpLimits, optional
            Of the tip.

        Returns
        -------
        Trajectory
            Timed; ``trajectory.at(t)`` is where the arm is then.

        Raises
        ------
        MissingExtraError
            Ruckig is not installed (``pip install 'pieper[plan]'``).
        """
        from pieper.motion.blending import time_blended
        from pieper.motion.timing import time_waypoints

        limits = {"max_velocity": max_velocity, "max_acceleration": max_acceleration, "max_jerk": max_jerk}
        if not isinstance(along, CollisionModel):
            return time_waypoints(along, self.q, **limits, tcp=tcp)
        step = 2.0 * (self.margin - self.kept)
        edges = EdgeCheck(along, step=step if step <= 2.0 * along.margin else None)
        return time_blended(edges, self.q, **limits, tcp=tcp, rest_at=self.rests_at).trajectory

    def __str__(self) -> str:
        if self.found:
            return f"path of {len(self.q)} points, {self.length:.3g} rad long, found in {self.seconds:.3f} s"
        return f"{self.status}: {self.reason}"


def plan(
    arm: ArmLike | Chain | CollisionModel,
    q_start: ArrayLike,
    goal: ArrayLike | Target,
    *,
    world: World | None = None,
    tool: Item | Iterable[Item] = (),
    attached: Iterable[Item] = (),
    margin: float = DEFAULT_MARGIN,
    approach: ArrayLike | None = None,
    step: float | None = None,
    seed: int = 0,
    timeout: float = DEFAULT_TIMEOUT,
    simplify: bool = True,
    progress: Callable[[float, int], None] | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> Plan:
    """Find a path that touches nothing.

    Parameters
    ----------
    arm : Arm, Chain or CollisionModel
        With a model, `world`, `tool`, `attached` and `margin` are its own and must not be given.
    q_start : (n,) array
        Joint values [rad or m].
    goal : (n,) or (g, n) array, (4, 4) pose, or Target
        Joint values, several of them, or ``T_base_tip``: then all its solutions within the limits that are free are goals, copies by whole
        turns included. (4, 4) is a pose also for an arm of four joints if its last row is 0 0 0 1.
    world, tool, attached, margin
        See `pieper.motion.collision.CollisionModel`.
    approach : (3,) array, optional
        Where the tip comes from in the end, in its own frame at the goal [m], such as ``[0, 0, -0.1]``: 0.1 m before it along z. Only for
        goals that are poses. The last edge of the path then leads from there to the goal; it is straight in joint space, and nearly so
        for the tip. Solutions for which it is not free are no goals.
    step : float, optional
        See `pieper.motion.edges.EdgeCheck`.
    seed : int
        At least 0. The same seed gives the same path, unless time runs out.
    timeout : float
        Seconds for the search; 0 tries the straight way alone.
    simplify : bool
        Whether the path of a search is shortened.
    progress : callable, optional
        Called with the seconds that have passed and the edges looked at, about twenty times a second, while the search runs.
    cancelled : callable, optional
        Asked between edges; the plan ends when it says True.

    Returns
    -------
    Plan
        That there is no path is a result that says what is in the way, not an exception.

    Raises
    ------
    ArrayError
        A goal or a start of the wrong shape, or not finite.
    MotionError
        A step, seed or timeout that cannot be used.
    MissingExtraError
        Coal or OMPL are not installed (``pip install 'pieper[plan]'``).

    Examples
    --------
    >>> import pieper
    >>> from pieper.model.description import Box
    >>> from pieper.motion.world import Item, World
    >>> T = np.eye(4)
    >>> T[:3, 3] = [0.55, 0.0, 0.4]
    >>> post = World([Item("post", Box([0.2, 0.1, 0.8]), T)])
    >>> arm = pieper.load("ur5e")
    >>> q_start, q_goal = [1.2, -1.2, 1.2, -1.6, -1.6, 0.0], [-1.2, -1.2, 1.2, -1.6, -1.6, 0.0]
    >>> path = plan(arm, q_start, q_goal, world=post)
    >>> path.status, bool((path.q[-1] == q_goal).all())
    ('found', True)
    >>> print(plan(arm, [0.0, -1.2, 1.2, 0.0, 0.0, 0.0], q_goal, world=post).status)
    start in collision
    """
    begun = time.perf_counter()
    model = _model(arm, world, tool, attached, margin)
    seed, timeout = _checked(seed, timeout)
    start = _vector(model.chain, q_start, "q_start")
    task = _Task(model, EdgeCheck(model, step=step), start, begun, timeout, progress, cancelled)
    out = _outside(model.chain, start)
    if out:
        return task.failed("start out of limits", out)
    if not model.is_free(start):
        pair = model.distance(start)
        return task.failed("start in collision", f"at the start {task.too_near(pair)}", blocking=pair)
    failure = task.choose_goals(goal, None if approach is None else _offset(approach))
    if failure is not None:
        return failure
    return task.straight() or task.search(seed, simplify)


def _model(
    arm: ArmLike | Chain | CollisionModel,
    world: World | None,
    tool: Item | Iterable[Item],
    attached: Iterable[Item],
    margin: float,
) -> CollisionModel:
    if not isinstance(arm, CollisionModel):
        return CollisionModel(arm, world, tool=tool, attached=attached, margin=margin)
    if world is not None or tool != () or attached != () or margin != DEFAULT_MARGIN:
        raise MotionError(
            "world, tool, attached and margin belong to the collision model that was given; change them there"
        )
    return arm


def _checked(seed: int, timeout: float) -> tuple[int, float]:
    try:
        whole = operator.index(seed)
    except TypeError:
        whole = -1
    if isinstance(seed, bool) or not 0 <= whole < 2**31 - 1:
        raise MotionError(f"seed must be a whole number from 0 to {2**31 - 2}, got {seed!r}")
    try:
        seconds = float(timeout)
    except (TypeError, ValueError):
        seconds = float("nan")
    if not seconds >= 0.0:
        raise MotionError(f"timeout must be a number of seconds, at least 0, got {timeout!r}")
    return whole, seconds


def _offset(approach: ArrayLike) -> FloatArray:
    offset = stack(approach, (3,), "approach")
    if offset.ndim != 1 or not offset.any():
        raise ArrayError(f"approach must be one offset (3,) in the frame of the tip, not zero [m], got {approach!r}")
    return offset


def _vector(chain: Chain, q: ArrayLike, name: str) -> FloatArray:
    values = as_joints(chain, q, name=name)
    if values.ndim != 1:
        raise ArrayError(f"{name} must have shape ({chain.dof},), got {values.shape}")
    return np.array(values)


def _outside(chain: Chain, q: FloatArray) -> str:
    """What is outside the limits, in words; empty when nothing is."""
    lower, upper = chain.limits.T
    beyond = np.flatnonzero((q < lower - _ROUNDING) | (q > upper + _ROUNDING))
    if not beyond.size:
        return ""
    i = int(beyond[0])
    return f"joint {chain.joint_names[i]!r} at {q[i]:.6g} is outside its limits [{lower[i]:.6g}, {upper[i]:.6g}]"


class _Task:
    """One question, and what was learnt about it so far."""

    def __init__(
        self,
        model: CollisionModel,
        edges: EdgeCheck,
        start: FloatArray,
        begun: float,
        timeout: float,
        progress: Callable[[float, int], None] | None,
        cancelled: Callable[[], bool] | None,
    ) -> None:
        self.model, self.edges, self.start = model, edges, start
        self._begun, self._timeout = begun, timeout
        self._progress, self._cancelled = progress, cancelled
        self._told = begun
        self._was_cancelled = False
        self.goals: FloatArray = np.empty((0, len(start)))
        self._ends: FloatArray | None = None
        self._from: dict[bytes, bytes | None] = {start.tobytes(): None}  # states that free edges join to the start

    # --- results

    def failed(
        self, status: str, reason: str, *, q: FloatArray | None = None, goal: int = -1, blocking: Nearest | None = None
    ) -> Plan:
        return self._plan(status, reason, self.start[None] if q is None else q, goal, blocking)

    def _plan(self, status: str, reason: str, q: FloatArray, goal: int, blocking: Nearest | None) -> Plan:
        q, goals = np.array(q), np.array(self.goals if self._ends is None else self._ends)
        rests_at: tuple[int, ...] = ()
        if status == "found" and self._ends is not None:
            rests_at = (len(q) - 1,)
            q = np.vstack([q, self._ends[goal]])
        for values in (q, goals):
            values.setflags(write=False)
        return Plan(
            status,
            reason,
            q,
            goal,
            goals,
            blocking,
            self.model.margin,
            self.edges.kept,
            time.perf_counter() - self._begun,
            self.edges.edges,
            self.edges.states,
            self.model.chain.joint_names,
            rests_at,
        )

    def too_near(self, pair: Nearest) -> str:
        if pair.distance <= 0.0:
            return f"{pair}"
        return f"{pair}, nearer than the margin of {1e3 * self.model.margin:g} mm"

    # --- goals

    def choose_goals(self, goal: ArrayLike | Target, approach: FloatArray | None) -> Plan | None:
        """Take the goals that can be aimed at, or say why there are none."""
        is_pose = not isinstance(goal, Target) and _is_pose(goal, self.model.chain.dof)
        if approach is not None and not is_pose:
            raise ArrayError(
                "approach goes with a goal that is a pose (4, 4); joint values say nothing of the way there"
            )
        if is_pose or isinstance(goal, Target):
            found = self._solutions(goal if isinstance(goal, Target) else poses(goal, "goal"))
        else:
            found = self._within_limits(goal)
        if isinstance(found, Plan):
            return found
        vectors, words = found
        free = np.atleast_1d(self.model.is_free(vectors))
        if not free.any():
            nearest = max((self.model.distance(vector) for vector in vectors), key=lambda pair: pair.distance)
            return self.failed("goal in collision", f"{words} {self.too_near(nearest)}", blocking=nearest)
        self.goals = vectors[free][:MOST_GOALS]
        if approach is None or isinstance(goal, Target):
            return None
        return self._approach_first(poses(goal, "goal"), approach)

    def _solutions(self, aim: FloatArray | Target) -> tuple[FloatArray, str] | Plan:
        """The joint vectors of a pose, nearest to the start first, and what to call them; or why there are none."""
        answers = solve(self.model.chain, aim, seed=self.start)
        if answers.status.ndim:
            raise ArrayError(f"goal must be one pose (4, 4), got a batch of shape {answers.status.shape}")
        vectors = np.array(list(itertools.islice(answers.copies(seed=self.start), 4 * MOST_GOALS)))
        if not len(vectors):
            return self.failed("goal out of limits" if answers.valid.any() else "goal out of reach", answers.reason)
        return (
            vectors,
            f"all {len(vectors)} joint vectors of the goal pose are too near to something; at the best of them",
        )

    def _within_limits(self, goal: ArrayLike) -> tuple[FloatArray, str] | Plan:
        """Those of the given joint vectors that are within the limits, and what to call them; or why there are none."""
        chain = self.model.chain
        vectors = stack(goal, (chain.dof,), "goal")
        if vectors.ndim > 2 or vectors.size == 0:
            raise ArrayError(f"goal must have shape ({chain.dof},), (g, {chain.dof}) or (4, 4), got {vectors.shape}")
        vectors = vectors.reshape(-1, chain.dof)
        outside = [_outside(chain, vector) for vector in vectors]
        if all(outside):
            return self.failed("goal out of limits", outside[0])
        vectors = vectors[[not words for words in outside]]
        return vectors, "at the goal" if len(vectors) == 1 else f"at the best of {len(vectors)} goals"

    def _approach_first(self, T: FloatArray, approach: FloatArray) -> Plan | None:
        """Aim at where the approach begins; keep the goals, to be added in the end."""
        before = T.copy()
        before[:3, 3] = T[:3, 3] + T[:3, :3] @ approach
        starts, ends, pair = [], [], None
        for end in self.goals:
            answers = solve(self.model.chain, before, seed=end)
            start = next(iter(answers.copies(seed=end)), None)
            if start is None:
                continue
            way = self.edges.check(end, start)
            if way.free:
                starts.append(start)
                ends.append(end)
            else:
                pair = self.model.distance(end + way.blocked_at * (start - end))
        if not starts:
            where = "out of reach" if pair is None else f"not free; on it {self.too_near(pair)}"
            words = f"the approach from {np.linalg.norm(approach):.3g} m before the goal is {where}"
            return self.failed("goal out of reach" if pair is None else "goal in collision", words, blocking=pair)
        self.goals, self._ends = np.array(starts), np.array(ends)
        return None

    # --- the two ways to find a path

    def straight(self) -> Plan | None:
        """The first goal, in the order of their distance, that can be reached without any turn."""
        order = np.argsort(np.linalg.norm((self.goals - self.start) * self._weights(), axis=1), kind="stable")
        open_ones = self.edges.screen(np.broadcast_to(self.start, self.goals.shape), self.goals)
        for k in map(int, order):
            goal = self.goals[k]
            if (goal == self.start).all():
                return self._plan("found", "", self.start[None], k, None)
            if self._stopped(in_time=False):
                return self._without_path()
            if open_ones[k] and self.edges.free(self.start, goal):
                return self._plan("found", "", np.stack([self.start, goal]), k, None)
        return None

    def search(self, seed: int, simplify: bool) -> Plan:
        """RRT-Connect, in joint values scaled by how far they move points."""
        if self._timeout <= 0.0:
            return self._without_path()
        weights = self._weights()
        lower, upper = (bound * weights for bound in self._bounds())

        def edge_is_free(first: FloatArray, second: FloatArray) -> bool:
            if self._stopped():
                return False
            first, second = first / weights, second / weights
            if not self.edges.check(first, second, stop=self._stopped).free:
                return False
            known, new = first.tobytes(), second.tobytes()
            if known in self._from:
                self._from.setdefault(new, known)
            return True

        # scaled there and back the start has to be the same number again
        self._from = {(self.start * weights / weights).tobytes(): None}
        path = search(
            self.start * weights,
            self.goals * weights,
            bounds=(lower, upper),
            is_free=lambda state: self.model.is_free(state / weights),
            edge_is_free=edge_is_free,
            stop=self._stopped,
            seed=seed + 1,
            longest=_LONGEST,
        )
        if path is None:
            return self._without_path()
        q = path / weights
        k = int(np.argmin(np.abs(self.goals - q[-1]).max(axis=1)))
        q[0], q[-1] = self.start, self.goals[k]
        if simplify:
            q = shorten(q, self.edges, weights=weights, seed=seed, stop=self._stopped)
        if not self.edges.path_is_free(q):  # by rounding of the scales at most
            return self._without_path()
        return self._plan("found", "", q, k, None)

    def _weights(self) -> FloatArray:
        """(n,) how far a joint moves points, as a fraction of the joint that moves them farthest."""
        far = np.abs(self.model.chain.coupling).T @ self.model.lever.max(axis=1, initial=0.0)
        most = float(far.max(initial=0.0))
        return np.maximum(far / most, _LIGHT) if most > 0.0 else np.ones(len(self.start))

    def _bounds(self) -> tuple[FloatArray, FloatArray]:
        """Where states are drawn: the limits, and for joints that turn not more than half a turn beyond start and goals."""
        lower, upper = finite_limits(self.model.chain)
        every = np.vstack([self.start, self.goals])
        lower, upper = np.minimum(lower, every.min(axis=0)), np.maximum(upper, every.max(axis=0))
        turns = ((self.model.chain.coupling != 0.0) & self.model.chain.is_revolute[:, None]).any(axis=0)
        near_low, near_high = every.min(axis=0) - _BESIDE, every.max(axis=0) + _BESIDE
        endless = ~np.isfinite(self.model.chain.limits)
        low = np.where(endless[:, 0], near_low, np.maximum(lower, near_low))
        high = np.where(endless[:, 1], near_high, np.minimum(upper, near_high))
        return np.where(turns, low, lower), np.where(turns, high, upper)

    def _stopped(self, *, in_time: bool = True) -> bool:
        now = time.perf_counter()
        if self._progress is not None and now - self._told >= _TOLD:
            self._told = now
            self._progress(now - self._begun, self.edges.edges)
        if self._cancelled is not None and not self._was_cancelled:
            self._was_cancelled = bool(self._cancelled())
        return self._was_cancelled or (in_time and now - self._begun >= self._timeout)

    # --- what was in the way

    def _without_path(self) -> Plan:
        """The way to where the search came nearest to a goal, and what stops the arm from there."""
        states = np.array([np.frombuffer(key) for key in self._from])
        weights = self._weights()
        apart = np.linalg.norm((states[:, None, :] - self.goals[None]) * weights, axis=2)
        best, k = (int(i) for i in np.unravel_index(int(np.argmin(apart)), apart.shape))
        way: list[FloatArray] = []
        key: bytes | None = states[best].tobytes()
        while key is not None:
            way.append(np.frombuffer(key))
            key = self._from[key]
        q = np.array(way[::-1])
        q[0] = self.start
        ahead = self.edges.check(q[-1], self.goals[k])
        pair, words = None, ""
        if not ahead.free:
            pair = self.model.distance(q[-1] + ahead.blocked_at * (self.goals[k] - q[-1]))
            words = f"; straight on from there {self.too_near(pair)}"
        left = float(np.abs(q[-1] - self.goals[k]).max())
        where = "the start" if len(q) == 1 else f"a state {left:.3g} rad or m from a goal in the joint farthest off"
        if self._was_cancelled:
            return self.failed(
                "cancelled", f"cancelled; the nearest approach is {where}{words}", q=q, goal=k, blocking=pair
            )
        reason = f"no path in {self._timeout:g} s; the nearest approach is {where}{words}"
        return self.failed("no path in time", reason, q=q, goal=k, blocking=pair)


def _is_pose(goal: Any, dof: int) -> bool:
    try:
        values = np.asarray(goal, dtype=np.float64)
    except (TypeError, ValueError):
        return False
    if values.shape[-2:] != (4, 4) or values.ndim < 2:
        return False
    return dof != 4 or bool((values[..., 3, :] == (0.0, 0.0, 0.0, 1.0)).all())
