"""One joint path for a path of poses, without a jump; or where it must break, and why.

Arms whose answers are all listed (closed forms, general six joints) are solved **by layers**: every answer of every pose in one call,
then the shortest admissible route through them. A step between two answers is admissible when no joint moves further than
`jump_bound` allows for the distance between the two poses, and one answer is the nearest of its layer to the other; its cost is the sum over the joints of the way divided by the speed limit.
Whole turns are undone along the route, and it is shifted by whole turns to where every joint stays within its limits; a route without
such a shift is no route. Where no route goes on, the arm is led across the gap in ever smaller steps; if that succeeds, the poses it went
through join the layers, else the place of the break is known to `precision`.

Arms with a joint to spare, targets that leave a direction free, and arms without a listing method are **tracked**: from each of
several starts (the given one, or the answers at the first pose: with seven joints 16 values of one of them) by iteration from
the joint values before, which moves the joints least. The first start that arrives is taken, else the one that comes farthest.

Near a straight wrist joints turn fast for little motion of the tip. That is a passage and no break: steps become smaller there, and
`pieper.motion.timing.time_path` slows down so that the speed limits hold.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from pieper.errors import ArrayError, unknown_name
from pieper.ik import target as _target
from pieper.ik.numeric import solve_numeric
from pieper.ik.solve import solver
from pieper.kinematics.jacobian import jacobian
from pieper.kinematics.joints import as_joints, periodic_joints
from pieper.kinematics.manipulability import singularity
from pieper.motion.limits import JointLimits
from pieper.motion.path import METRES_PER_RADIAN, CartesianPath
from pieper.spatial import pose
from pieper.spatial._checks import FloatArray, poses

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

    from pieper.ik.solutions import IKSolutions
    from pieper.model.chain import Chain

Reason = Literal["limit", "singularity", "unreachable", "branch"]

LARGEST_STEP, SMALLEST_BOUND, FULL_STEP = 0.5, 0.1, 0.02
"""A joint may move 0.5 rad [or m] between poses 0.02 m apart or more, in proportion less between nearer ones, but always 0.1 rad."""

PRECISION = 1e-6
"""How exactly the place of a break is found unless something else is said [m of path length]."""

FINEST_PRECISION = 1e-9
"""No break is placed more exactly [m of path length]: beyond that rounding decides."""

_TURN = 2.0 * np.pi
_MOST_POSES = 20_000  # that may be added where steps have to be smaller
_STARTS = 16  # that are tried where the first pose leaves a choice
_ROUNDING = 1e-9
_SAME = 1e-6
_AT_LIMIT = 1e-4  # [rad or m] a tracked arm that ends this near to a joint limit ends because of it
_STRAY = 0.05  # of the distance between two poses, by which the tip may leave their middle when the joints go straight
_SINGULAR = (
    0.01  # least singular value of the Jacobian, a radian counted as 0.1 m: below it the break is called a singularity
)


def jump_bound(distance: ArrayLike) -> FloatArray:
    """How far a joint may move between poses that are `distance` (...) [m] of path length apart: (...) [rad or m].

    >>> jump_bound([0.0, 0.008, 1.0])
    array([0.1, 0.2, 0.5])
    """
    return np.asarray(np.clip(np.asarray(distance) / FULL_STEP * LARGEST_STEP, SMALLEST_BOUND, LARGEST_STEP))


@dataclass(frozen=True)
class PathBreak:
    """Where a joint path must end before its poses do.

    Attributes
    ----------
    s : float
        Length up to which it goes [m], to `precision`.
    index : int
        The last of the given poses that it reaches; -1 where the first one is missed already.
    reason : {"limit", "singularity", "unreachable", "branch"}
        A joint at its limit; the branch ends where it meets another one; the pose is out of reach; or other answers are there, and to
        reach them a joint would have to jump.
    message : str
        The same in words, with the joint or the direction.
    precision : float
        [m]
    start : (n,) array or None
        Where the path breaks at once because the arm stands in a singularity, as with a straight wrist: joint values at the same pose from
        which it goes on, if there are any [rad or m].
    """

    s: float
    index: int
    reason: Reason
    message: str
    precision: float
    start: FloatArray | None = None

    def __str__(self) -> str:
        return self.message


@dataclass(frozen=True, eq=False)
class JointPath:
    """Joint values for poses one behind the other, up to the last pose or to a break.

    Attributes
    ----------
    chain : Chain
    s : (m,) array
        Lengths [m], not decreasing.
    q : (m, n) array
        Joint values [rad or m], within the limits, turns undone.
    given : (m,) bool array
        Which rows belong to poses that were asked for; the others were added where steps had to be smaller.
    corners : (c,) array
        Lengths at which a move has to come to rest [m].
    branch : tuple of m str
        Labels of the answers, ``""`` where the arm has none.
    broken : PathBreak or None
        Why the path ends early.
    method : {"layers", "tracked"}
    """

    chain: Chain
    s: FloatArray
    q: FloatArray
    given: NDArray[np.bool_]
    corners: FloatArray
    branch: tuple[str, ...]
    broken: PathBreak | None
    method: Literal["layers", "tracked"]

    @property
    def complete(self) -> bool:
        """Whether every pose is reached."""
        return self.broken is None

    @cached_property
    def margin(self) -> FloatArray:
        """(m,): how far the joint nearest to one of its limits is away from it [rad or m]; infinite without limits."""
        lower, upper = self.chain.limits.T
        return np.asarray(np.minimum(self.q - lower, upper - self.q).min(axis=1))

    @cached_property
    def sensitivity(self) -> FloatArray:
        """(m,): joint motion for motion of the tip in the worst direction [rad/m], a radian of the tip counted as 0.1 m.

        The inverse of the least singular value of the Jacobian; infinite where it is singular. Found when first asked for.
        """
        if not len(self.q):
            return np.empty(0)
        J = jacobian(self.chain, self.q) * np.array([1.0] * 3 + [METRES_PER_RADIAN] * 3)[:, None]
        least = np.linalg.svd(J, compute_uv=False)[:, min(6, self.chain.dof) - 1]
        with np.errstate(divide="ignore"):
            return np.asarray(1.0 / least)

    def __repr__(self) -> str:
        end = "complete" if self.broken is None else f"broken: {self.broken.message}"
        return f"JointPath({self.chain.name!r}, {len(self.q)} poses, {end})"


def follow_path(
    chain: Chain,
    path: CartesianPath | ArrayLike,
    *,
    q_start: ArrayLike | None = None,
    branch: str | None = None,
    target: Literal["pose", "axis", "position"] = "pose",
    count: int | None = None,
    step: float | None = None,
    precision: float = PRECISION,
    max_velocity: ArrayLike | None = None,
) -> JointPath:
    """Joint values along a path of poses, on one branch of answers all the way.

    Parameters
    ----------
    chain : Chain
    path : CartesianPath or (m, 4, 4) array
        A path, which is sampled by `count` or `step`, or the poses themselves, ``T_base_tcp`` [m, -], between which the tip goes straight.
        Poses may be repeated.
    q_start : (n,) array, optional
        Where the arm is [rad or m]: the path begins at the answer nearest to it. When not given, the cheapest route is taken.
    branch : str, optional
        Words that the label of the first answer must have, as in ``"elbow up"``; for arms with labels.
    target : {"pose", "axis", "position"}
        What counts: the whole pose, position and z axis of the tip (arms with five joints), or the position.
    count, step
        How a path is sampled, see `CartesianPath.sample`.
    precision : float
        How exactly the place of a break is found [m], at least 1e-9.
    max_velocity : float or (n,) array, optional
        Speed limits by which joint ways are compared; see `pieper.motion.limits.JointLimits.of`.

    Returns
    -------
    JointPath
        A path that must break is a result: `JointPath.broken` tells where and why.

    Raises
    ------
    ArrayError
        Malformed poses, start or options.

    Examples
    --------
    >>> from pieper.kinematics.fk import fk
    >>> from pieper.model import catalog
    >>> from pieper.motion.path import line
    >>> arm = catalog.describe("ur5e").chain()
    >>> T = fk(arm, [0.3, -1.2, 1.4, -1.7, -1.5, 0.3])
    >>> T_goal = T.copy()
    >>> T_goal[:3, 3] += [0.2, -0.3, 0.1]
    >>> way = follow_path(arm, line(T, T_goal), q_start=[0.3, -1.2, 1.4, -1.7, -1.5, 0.3])
    >>> way.complete, way.branch[0], len(way.q)
    (True, 'front, elbow up, flip', 189)
    """
    if target not in ("pose", "axis", "position"):
        raise unknown_name("target", target, ("pose", "axis", "position"), "follow_path")
    if not (np.isfinite(precision) and precision >= FINEST_PRECISION):
        raise ArrayError(
            f"precision must be at least {FINEST_PRECISION:g} m, below which rounding says where a path breaks, got {precision!r}"
        )
    speeds = JointLimits.of(chain, max_velocity=max_velocity).velocity
    seed = None
    if q_start is not None:
        seed = as_joints(chain, q_start, name="q_start")
        if seed.ndim != 1:
            raise ArrayError(f"q_start must have shape ({chain.dof},), got {seed.shape}")
    return _Search(chain, _Poses.of(path, count, step), target, seed, branch, precision, speeds).run()


@dataclass(eq=False)
class _Poses:
    """The poses of a path, and those between them."""

    s: FloatArray
    T: FloatArray
    between: Callable[[float], FloatArray]
    corners: FloatArray

    @classmethod
    def of(cls, path: CartesianPath | ArrayLike, count: int | None, step: float | None) -> _Poses:
        if isinstance(path, CartesianPath):
            s, T = path.sample(count=count, step=step)
            return cls(s, T, path.at, path.corners)
        if count is not None or step is not None:
            raise ArrayError("count and step sample a CartesianPath; poses are taken as they are: leave both out")
        Ts = np.ascontiguousarray(poses(path, "path"))
        if Ts.ndim != 3 or not len(Ts):
            raise ArrayError(f"path must be a CartesianPath or poses of shape (m, 4, 4), got {Ts.shape}")
        metres = np.linalg.norm(np.diff(Ts[:, :3, 3], axis=0), axis=1)
        # the angle from the chord of the rotation matrices: |R - S| = 2 sqrt(2) sin(angle / 2)
        chord = np.linalg.norm(np.diff(Ts[:, :3, :3], axis=0), axis=(1, 2))
        radians = 2.0 * np.arcsin(np.minimum(chord / np.sqrt(8.0), 1.0))
        lengths = np.concatenate([[0.0], np.cumsum(np.hypot(metres, METRES_PER_RADIAN * radians))])

        def between(s: float) -> FloatArray:
            k = int(np.clip(np.searchsorted(lengths, s, side="right") - 1, 0, max(len(Ts) - 2, 0)))
            if len(Ts) == 1 or lengths[k + 1] == lengths[k]:
                return np.asarray(Ts[k])
            share = (s - lengths[k]) / (lengths[k + 1] - lengths[k])
            return pose.interpolate(Ts[k], Ts[k + 1], fraction=share, motion="straight")

        return cls(lengths, Ts, between, np.empty(0))


@dataclass(eq=False)
class _Route:
    """Rows of a route: joint values and the numbers of branches."""

    q: FloatArray
    branch: NDArray[np.int64]
    cost: float


class _Search:
    def __init__(
        self,
        chain: Chain,
        given: _Poses,
        target: str,
        seed: FloatArray | None,
        branch: str | None,
        precision: float,
        speeds: FloatArray,
    ) -> None:
        self.chain, self.source, self.target = chain, given, target
        self.seed, self.words, self.precision, self.speeds = seed, branch, precision, speeds
        self.solver = solver(chain)
        self.turning = periodic_joints(chain)
        self.lower, self.upper = chain.limits.T
        self.names: tuple[str, ...] = ()
        self.s, self.T = given.s, given.T
        self.is_given = np.ones(len(given.s), dtype=bool)
        self.extra: dict[float, FloatArray] = {}  # answers at added poses that a listing does not hold

    # --- what the arm answers

    def wanted(self, T: FloatArray) -> Any:
        if self.target == "pose":
            return T
        if self.target == "axis":
            return _target.position_and_axis(T[..., :3, 3], T[..., :3, 2])
        return _target.ignore_orientation(T[..., :3, 3])

    def near(self, T: FloatArray, q: FloatArray) -> tuple[FloatArray | None, IKSolutions]:
        """The answer at one pose that goes on from q, its turns undone; None where there is none inside the limits."""
        if self.layered:
            answers = self.solver.solve(self.wanted(T), q)
        else:
            answers = solve_numeric(self.chain, self.wanted(T), seed=q, restarts=1)
        candidates = answers.q[answers.valid]
        if not len(candidates):
            return None, answers
        candidates = self.unturned(candidates, q)
        best = candidates[int(np.argmin(np.abs(candidates - q).max(axis=1)))]
        inside = ((best >= self.lower - _ROUNDING) & (best <= self.upper + _ROUNDING)).all()
        return (np.clip(best, self.lower, self.upper) if inside else None), answers

    def unturned(self, q: FloatArray, near: FloatArray) -> FloatArray:
        turns = np.where(self.turning, np.rint((near - q) / _TURN), 0.0)
        return np.asarray(q + _TURN * turns)

    def goes_on(self, q: FloatArray, following: FloatArray, a: float, b: float) -> bool:
        """Whether a step is small, and the tip keeps to the way between the poses when the joints go straight."""
        distance = b - a
        if np.abs(following - q).max() > float(jump_bound(distance)):
            return False
        if self.target != "pose":
            return True
        return bool(self._strays(np.stack([q, following]), np.array([a, b]))[0] <= 0.0)

    def _strays(self, q: FloatArray, s: FloatArray) -> FloatArray:
        """(m - 1,): by how much the middle of each step leaves the way, beyond what is allowed [m]."""
        T = self.chain.native.fk(np.ascontiguousarray(0.5 * (q[1:] + q[:-1])))
        ends = self.chain.native.fk(np.ascontiguousarray(q))
        off = T[:, :3] - 0.5 * (ends[1:, :3] + ends[:-1, :3])
        metres = np.sqrt((off[:, :, 3] ** 2).sum(axis=1))
        radians = np.sqrt((off[:, :, :3] ** 2).sum(axis=(1, 2)) / 2.0)
        return np.asarray(np.hypot(metres, METRES_PER_RADIAN * radians) - _STRAY * np.diff(s) - _ROUNDING)

    # --- the whole

    @property
    def layered(self) -> bool:
        return self._layered

    def run(self) -> JointPath:
        at_once = self.solver.method in ("closed form", "general") and self.target != "position"
        self._layered = at_once and not (self.target == "axis" and self.chain.dof > 5)
        if self._layered:
            first = self.solver.solve(self.wanted(self.T[:1]))
            self.names = first.branch_names
            self._layered = not first.free
        if self._layered and self.seed is not None and self.target == "pose":
            metres, radians = pose.distance(self.chain.native.fk(self.seed), self.T[0])
            if metres <= _SAME and radians <= _SAME and ((self.seed >= self.lower) & (self.seed <= self.upper)).all():
                self.extra[float(self.s[0])] = (
                    self.seed
                )  # in a singularity one of endlessly many answers, of which one is listed
        found = self._by_layers() if self._layered else self._tracked()
        broken = found.broken
        if broken is None or broken.s > 0.0 or broken.reason != "singularity" or self.words is not None:
            return found
        # the arm stands in a singularity, where endlessly many joint values reach the pose: those it would come to from the other side
        ends = np.flatnonzero(self.source.s >= min(FULL_STEP, float(self.source.s[-1])))
        behind = _Poses.of(self.source.T[: int(ends[0]) + 1][::-1], None, None)
        way = _Search(self.chain, behind, self.target, self.seed, None, self.precision, self.speeds).run()
        if way.broken is not None or not len(way.q):
            return found
        if self.seed is not None:
            return replace(found, broken=self._stood_badly(broken, way.q[-1]))
        again = _Search(self.chain, self.source, self.target, way.q[-1], None, self.precision, self.speeds)
        return again.run()

    def _stood_badly(self, broken: PathBreak, start: FloatArray) -> PathBreak:
        """The break of an arm that stands in a singularity, with joint values to begin from."""
        assert self.seed is not None
        listed, start = start, self.unturned(start, self.seed)
        if ((start < self.lower) | (start > self.upper)).any():
            start = np.array(listed)
        moves = [
            f"{name!r} to {value:.6g}"
            for name, value, here in zip(self.chain.joint_names, start, self.seed, strict=True)
            if abs(value - here) > _AT_LIMIT
        ]
        message = f"{broken.message}; the path goes on from the same pose with {', '.join(moves)}"
        start.setflags(write=False)
        return replace(broken, message=message, start=start)

    def _result(
        self, rows: int, q: FloatArray, branch: NDArray[np.int64], broken: PathBreak | None, method: Any
    ) -> JointPath:
        labels = np.array([*self.names, ""], dtype=object)[branch]
        s, given = np.array(self.s[:rows]), np.array(self.is_given[:rows])
        for values in (s, q, given):
            values.setflags(write=False)
        return JointPath(self.chain, s, q, given, self.source.corners, tuple(labels.tolist()), broken, method)

    # --- by layers

    def _by_layers(self) -> JointPath:
        while True:
            layers = _Layers(self)
            route = layers.shortest(len(self.s))
            if route is not None:
                strays = np.zeros(len(self.s) - 1)
                if self.target == "pose" and len(route.q) > 1:
                    strays = self._strays(route.q, self.s)
                wide = np.flatnonzero((strays > 0.0) & (np.diff(self.s) > self.precision))
                if not wide.size or len(self.s) > _MOST_POSES:
                    return self._result(len(self.s), route.q, route.branch, None, "layers")
                self._add([0.5 * (self.s[i] + self.s[i + 1]) for i in wide.tolist()])
                continue
            last = layers.farthest()
            if last < 0:
                return self._missed(layers)
            routes = layers.routes(last + 1)
            ways = [self._across(route.q[-1], float(self.s[last]), float(self.s[last + 1])) for route in routes]
            crossed = [way for way in ways if way[2]]
            known = len(self.s), len(self.extra)
            if not crossed or len(self.s) > _MOST_POSES:
                return self._broken(last, routes, ways)
            for added, q, _ in crossed:
                for s, values in zip(added, q, strict=True):
                    self.extra[s] = values
            self._add([s for added, _, _ in crossed for s in added])
            if known == (len(self.s), len(self.extra)):  # nothing new to try
                short = [(added[:-1], q[:-1], False) if arrived else (added, q, False) for added, q, arrived in ways]
                return self._broken(last, routes, short)

    def _add(self, places: list[float]) -> None:
        fresh = np.setdiff1d(np.array(places), self.s)
        T = np.array([self.source.between(float(s)) for s in fresh]).reshape(-1, 4, 4)
        order = np.argsort(np.concatenate([self.s, fresh]), kind="stable")
        self.s = np.concatenate([self.s, fresh])[order]
        self.T = np.ascontiguousarray(np.concatenate([self.T, T])[order])
        self.is_given = np.concatenate([self.is_given, np.zeros(len(fresh), dtype=bool)])[order]

    def _across(self, q: FloatArray, a: float, b: float) -> tuple[list[float], list[FloatArray], bool]:
        """Leads the arm over a gap in small steps: the lengths and joint values on the way, and whether it arrived."""
        s, ways, values = a, [], []
        h = b - a
        while s < b:
            h = min(h, b - s)
            there = b if h >= b - s else s + h
            following, _ = self.near(self.source.between(there), q)
            if following is not None and self.goes_on(q, following, s, there):
                s, q = there, following
                ways.append(s)
                values.append(q)
                h *= 2.0
                if len(ways) > _MOST_POSES:
                    return ways, values, False
            elif h <= self.precision:
                return ways, values, False
            else:
                h *= 0.5
        return ways, values, True

    def _broken(
        self, last: int, routes: list[_Route], ways: list[tuple[list[float], list[FloatArray], bool]]
    ) -> JointPath:
        """The path up to the break: the route whose way goes farthest, the cheapest of those, with the poses that lead there."""
        ends = [way[0][-1] if way[0] else float(self.s[last]) for way in ways]
        farthest = max(ends)
        best = min((k for k, end in enumerate(ends) if end >= farthest - self.precision), key=lambda k: routes[k].cost)
        added, values, _ = ways[best]
        q, branch = routes[best].q, routes[best].branch
        given = self.is_given[: last + 1]
        if added:
            q = np.concatenate([q, np.array(values)])
            branch = np.concatenate([branch, np.full(len(added), branch[-1])])
            self.s = np.concatenate([self.s[: last + 1], added])
            self.is_given = np.concatenate([given, np.zeros(len(added), dtype=bool)])
        where = float(self.s[len(q) - 1])
        broken = self._why(where, q[-1], int(given.sum()) - 1)
        return self._result(len(q), q, branch, broken, "layers")

    def _missed(self, layers: _Layers) -> JointPath:
        """No answer to begin with."""
        answers = self.solver.solve(self.wanted(self.T[0]))
        reason: Reason = "unreachable" if not answers.valid.any() else "limit"
        words = answers.reason
        if answers.within_limits.any():
            reason = "branch"
            words = f"no answer there is called {self.words!r}; there are: " + "; ".join(
                sorted({str(x) for x in answers.labels[answers.within_limits]})
            )
        broken = PathBreak(0.0, -1, reason, f"the first pose is missed: {words}", 0.0)
        return self._result(0, np.empty((0, self.chain.dof)), np.empty(0, dtype=np.int64), broken, "layers")

    def _why(self, s: float, q: FloatArray, index: int) -> PathBreak:
        """The reason that a path ends at length s with joint values q."""
        total = float(self.source.s[-1])
        beyond = min(s + 10.0 * self.precision, total)
        T = self.source.between(beyond)
        if self.layered:
            answers = self.solver.solve(self.wanted(T), q)
        else:
            answers = solve_numeric(self.chain, self.wanted(T), seed=q)
        near = f"at {s:.6g} of {total:.6g} m"
        J = jacobian(self.chain, q) * np.array([1.0] * 3 + [METRES_PER_RADIAN] * 3)[:, None]
        if self.target == "position":
            J = J[:3]
        report = singularity(J, threshold=_SINGULAR, joint_names=self.chain.joint_names)
        candidates = self.unturned(answers.q[answers.valid], q)
        if len(candidates):
            candidates = candidates[np.argsort(np.abs(candidates - q).max(axis=1))]
        room = np.minimum(q - self.lower, self.upper - q)
        tight = int(np.argmin(room))
        name = self.chain.joint_names[tight]
        if len(candidates) and np.abs(candidates[0] - q).max() <= SMALLEST_BOUND:
            out = np.maximum(self.lower - candidates[0], candidates[0] - self.upper)
            worst = int(np.argmax(out))
            if out[worst] > -_ROUNDING:
                bound = (
                    self.lower[worst]
                    if candidates[0][worst] < q[worst] or q[worst] < self.lower[worst]
                    else self.upper[worst]
                )
                return PathBreak(
                    s, index, "limit",
                    f"{near}: joint {self.chain.joint_names[worst]!r} is at its limit of {bound:.6g} and would have to go beyond",
                    self.precision,
                )  # fmt: skip
        if not self.layered and room[tight] <= _AT_LIMIT:  # iteration keeps within the limits, and ends there
            return PathBreak(s, index, "limit", f"{near}: joint {name!r} is at its limit", self.precision)
        if not len(candidates):
            if self.layered or not report.near:
                return PathBreak(
                    s, index, "unreachable", f"{near}: the pose behind it is missed: {answers.reason}", self.precision
                )
            return PathBreak(s, index, "singularity", f"{near}: {report}", self.precision)
        if report.near:
            return PathBreak(s, index, "singularity", f"{near}: the branch ends, {report}", self.precision)
        jump = np.abs(candidates[0] - q)
        worst = int(np.argmax(jump))
        return PathBreak(
            s, index, "branch",
            f"{near}: to go on, joint {self.chain.joint_names[worst]!r} would have to jump by {jump[worst]:.4g} to another branch",
            self.precision,
        )  # fmt: skip

    # --- tracked

    def _starts(self) -> FloatArray:
        T = self.T[0]
        if self.seed is not None:
            answers = solve_numeric(self.chain, self.wanted(T), seed=self.seed)
            return answers.q[answers.within_limits][:1]
        answers = self.solver.solve(self.wanted(T))
        found = answers.q[answers.within_limits]
        if len(found) <= 1:
            more = solve_numeric(self.chain, self.wanted(T), count=_STARTS)
            found = np.concatenate([found, more.q[more.within_limits]])
        # those in the middle of their limits first
        lower, upper = np.clip(self.lower, -_TURN, _TURN), np.clip(self.upper, -_TURN, _TURN)
        room = np.minimum(found - lower, upper - found).min(axis=1)
        return np.asarray(found[np.argsort(-room, kind="stable")][:_STARTS])

    def _tracked(self) -> JointPath:
        best: tuple[list[float], list[FloatArray]] | None = None
        for start in self._starts():
            s, q = [float(self.s[0])], [start]
            for k in range(1, len(self.T)):
                a, b = float(self.s[k - 1]), float(self.s[k])
                following, _ = self.near(self.T[k], q[-1])
                if following is not None and self.goes_on(q[-1], following, a, b):
                    s.append(b)
                    q.append(following)
                    continue
                added, values, arrived = self._across(q[-1], a, b)
                s += added
                q += values
                if not arrived:
                    break
            else:
                best = s, q
                break
            if best is None or s[-1] > best[0][-1]:
                best = s, q
        if best is None:
            answers = self.solver.solve(self.wanted(self.T[0]))
            reason: Reason = "unreachable" if not answers.valid.any() else "limit"
            broken = PathBreak(0.0, -1, reason, f"the first pose is missed: {answers.reason}", 0.0)
            return self._result(0, np.empty((0, self.chain.dof)), np.empty(0, dtype=np.int64), broken, "tracked")
        s, q = best
        index = int(np.searchsorted(self.source.s, s[-1] + 1e-15, side="right")) - 1
        broken_at = None if s[-1] >= float(self.source.s[-1]) else self._why(s[-1], q[-1], index)
        self.s, given = np.array(s), np.isin(np.array(s), self.source.s)
        self.is_given = given
        return self._result(len(q), np.array(q), np.full(len(q), -1), broken_at, "tracked")


class _Layers:
    """The answers of all poses, and the ways between them."""

    def __init__(self, search: _Search) -> None:
        self.search = search
        chain = search.chain
        answers = search.solver.solve(search.wanted(search.T))
        q, usable, branch = answers.q, answers.within_limits, answers.branch
        if search.extra:
            q, usable, branch = self._with_extra(q, usable, branch)
        if not usable.shape[1]:  # no answer anywhere
            q, usable, branch = (
                np.zeros((len(q), 1, chain.dof)),
                np.zeros((len(q), 1), bool),
                np.zeros((len(q), 1), int),
            )
        places = max(1, int(usable.sum(axis=1).max(initial=0)))
        if places < usable.shape[1]:  # fewer places than the method has: those that count come first
            order = np.argsort(~usable, axis=1, kind="stable")[:, :places]
            q = np.take_along_axis(q, order[:, :, None], axis=1)
            usable, branch = np.take_along_axis(usable, order, 1), np.take_along_axis(branch, order, 1)
        self.q = np.where(usable[..., None], q, 0.0)
        self.usable, self.branch = usable, branch.astype(np.int64)
        self.first = self._first(answers.branch_names)
        self._in_turns = np.where(search.turning, 1.0 / _TURN, 1.0)
        self.open = self._admissible(chain)

    def _with_extra(self, q: FloatArray, usable: Any, branch: Any) -> tuple[FloatArray, Any, Any]:
        search, m = self.search, len(q)
        more = np.full((m, 1, q.shape[2]), np.nan)
        there = np.zeros((m, 1), dtype=bool)
        for i, s in enumerate(search.s.tolist()):
            values = search.extra.get(s)
            if values is None:
                continue
            apart = np.abs(search.unturned(q[i][usable[i]], values) - values).max(axis=1, initial=0.0)
            if not (apart < _SAME).any():
                more[i, 0], there[i, 0] = values, True
        return (
            np.concatenate([q, more], axis=1),
            np.concatenate([usable, there], axis=1),
            np.concatenate([branch, np.full((m, 1), -1, dtype=branch.dtype)], axis=1),
        )

    def _first(self, names: tuple[str, ...]) -> NDArray[np.bool_]:
        """(k,): the answers at the first pose that a route may begin with."""
        search = self.search
        usable: NDArray[np.bool_] = self.usable[0].copy()
        if search.words is not None:
            words = [word.strip() for word in search.words.split(",")]
            known = {part for name in names for part in name.split(", ")}
            for word in words:
                if word not in known:
                    raise unknown_name("label", word, sorted(known), f"the answers of {search.chain.name!r}")
            fits = [b >= 0 and set(words) <= set(names[b].split(", ")) for b in self.branch[0].tolist()]
            usable &= np.array(fits)
        if search.seed is not None and usable.any():
            apart = np.abs(search.unturned(self.q[0], search.seed) - search.seed)
            distance = np.where(usable, (apart / search.speeds).sum(axis=1), np.inf)
            usable &= distance <= distance.min() + _SAME
        return usable

    def _admissible(self, chain: Chain) -> NDArray[np.bool_]:
        """(m - 1, k, k): which answer may follow which."""
        q = self.q * self._in_turns
        bound = jump_bound(np.diff(self.search.s))
        worst = np.where(self.usable[:-1, :, None] & self.usable[1:, None, :], 0.0, np.inf)
        for j in range(chain.dof):
            column = np.ascontiguousarray(q[:, :, j])
            apart = column[1:, None, :] - column[:-1, :, None]
            if self.search.turning[j]:
                apart -= np.rint(apart)
                apart *= _TURN
            np.abs(apart, out=apart)
            np.maximum(worst, apart, out=worst)
        # beside a fold two branches are near each other, and the answer that goes on is the nearer one
        nearest = np.minimum(
            np.maximum(worst.min(axis=2, keepdims=True), worst.min(axis=1, keepdims=True)), bound[:, None, None]
        )
        allowed: NDArray[np.bool_] = worst <= nearest + _ROUNDING
        return allowed

    def costs(self, rows: NDArray[np.int64], a: NDArray[np.int64], b: NDArray[np.int64]) -> FloatArray:
        """Cost of the ways from answers a of some poses to answers b of the next: the sum of the ways over the speed limits [s]."""
        apart = self.q[rows + 1, b] - self.q[rows, a]
        apart -= np.where(self.search.turning, _TURN * np.rint(apart / _TURN), 0.0)
        return np.asarray((np.abs(apart) / self.search.speeds).sum(axis=-1))

    def farthest(self) -> int:
        """The last pose that any route reaches inside the limits of the joints; -1 where there is none to begin with."""
        if not self.first.any():
            return -1
        alive, last = self.first, 0
        for i, open_ in enumerate(self.open):
            alive = (alive[:, None] & open_).any(axis=0)
            if not alive.any():
                break
            last = i + 1
        low, high = 0, last  # whole turns may end a route earlier: the longest that has a shift, by bisection
        while low < high:
            middle = (low + high + 1) // 2
            if self.shortest(middle + 1) is None:
                high = middle - 1
            else:
                low = middle
        return low

    def routes(self, poses: int) -> list[_Route]:
        """Of all pairs of a first and a last answer the cheapest route through the first poses that stays within the limits."""
        return [route for route in self._routes(poses) if route is not None]

    def shortest(self, poses: int) -> _Route | None:
        """The cheapest route through the first poses; None where there is none within the limits."""
        return min(self.routes(poses), key=lambda route: route.cost, default=None)

    def _routes(self, poses: int) -> list[_Route | None]:
        """For each answer that a route can begin with and each that it can end with, the cheapest."""
        starts = np.flatnonzero(self.first)
        if not starts.size:
            return []
        open_ = self.open[: poses - 1]
        k = open_.shape[1] if len(open_) else self.usable.shape[1]
        out, into = open_.sum(axis=2, dtype=np.int8), open_.sum(axis=1, dtype=np.int8)
        split = np.flatnonzero((out > 1).any(axis=1) | (into > 1).any(axis=1))
        follower = np.where(out == 1, open_.argmax(axis=2), k).astype(np.int64)
        follower = np.concatenate([follower, np.full((len(open_), 1), k)], axis=1)  # from nowhere to nowhere
        cost = np.full((len(starts), k), np.inf)
        cost[np.arange(len(starts)), starts] = 0.0
        steps: list[
            tuple[int, NDArray[np.int64] | None, NDArray[np.int64]]
        ] = []  # where, traces of a run, predecessors
        i = 0
        for stop in [*split.tolist(), poses - 1]:
            if stop > i:  # a run in which every answer has one follower at most
                traces = np.empty((stop - i + 1, k), dtype=np.int64)
                at = traces[0] = np.arange(k)
                for row in range(i, stop):
                    at = traces[row - i + 1] = follower[row].take(at)
                done = at < k
                spent = np.full(k, np.inf)
                for column in np.flatnonzero(done & np.isfinite(cost).any(axis=0)).tolist():
                    trace = traces[:, column]
                    spent[column] = self.costs(np.arange(i, stop), trace[:-1], trace[1:]).sum()
                before = np.full(k, -1)
                before[at[done]] = np.flatnonzero(done)
                cost = np.where(before >= 0, (cost + spent)[:, np.maximum(before, 0)], np.inf)
                steps.append((i, traces, before))
                i = stop
            if stop < poses - 1:  # a choice
                a, b = (x.ravel() for x in np.meshgrid(np.arange(k), np.arange(k), indexing="ij"))
                edges = self.costs(np.full(k * k, i), a, b).reshape(k, k)
                total = cost[:, :, None] + np.where(open_[i], edges, np.inf)
                steps.append((i, None, total.argmin(axis=1)))
                cost = total.min(axis=1)
                i += 1
        return [
            self._route(starts, int(s), int(e), steps, poses, float(cost[s, e]))
            for s, e in zip(*np.nonzero(np.isfinite(cost)), strict=True)
        ]

    def _route(
        self, starts: NDArray[np.int64], start: int, end: int, steps: list[Any], poses: int, cost: float
    ) -> _Route | None:
        places = np.empty(poses, dtype=np.int64)
        places[-1] = at = end
        for i, traces, before in reversed(steps):
            if traces is None:
                at = int(before[start, at])
                places[i] = at
            else:
                at = int(before[at])
                places[i : i + len(traces)] = traces[:, at]
        search, rows = self.search, np.arange(poses)
        q = self.q[rows, places]
        turns = np.zeros_like(q)
        np.cumsum(-np.rint(np.diff(q, axis=0) / _TURN), axis=0, out=turns[1:])
        q = q + np.where(search.turning, _TURN * turns, 0.0)
        lowest, highest = q.min(axis=0), q.max(axis=0)
        with np.errstate(invalid="ignore"):
            least = np.ceil((search.lower - _ROUNDING - lowest) / _TURN)
            most = np.floor((search.upper + _ROUNDING - highest) / _TURN)
        bounded = np.isfinite(search.lower) & np.isfinite(search.upper)
        middle = np.where(
            bounded, 0.5 * (np.where(bounded, search.lower, 0.0) + np.where(bounded, search.upper, 0.0)), 0.0
        )
        wish = np.rint(((middle - 0.5 * (lowest + highest)) if search.seed is None else (search.seed - q[0])) / _TURN)
        shift = np.where(search.turning, np.minimum(np.maximum(wish, least), most), 0.0)
        if (shift < np.where(search.turning, least, 0.0)).any():
            return None
        q = np.clip(q + _TURN * shift, search.lower, search.upper)
        return _Route(q, self.branch[rows, places], cost)
