"""The search for a joint path: by layers of answers, or tracked from several starts; across gaps in small steps; and why it ends."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.ik.numeric import solve_numeric
from pieper.kinematics.jacobian import jacobian
from pieper.kinematics.manipulability import singularity
from pieper.motion._path_layers import ROUNDING, SAME, Layers, Route
from pieper.motion._path_question import TURN, GivenPoses, PathQuestion
from pieper.motion.joint_path import FULL_STEP, SMALLEST_BOUND, JointPath, PathBreak, Reason, jump_bound
from pieper.motion.path import METRES_PER_RADIAN
from pieper.spatial import pose

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from pieper.kinematics.manipulability import Singularity
    from pieper.spatial._checks import FloatArray

_MOST_POSES = 20_000  # that may be added where steps have to be smaller
_STARTS = 16  # that are tried where the first pose leaves a choice
_AT_LIMIT = 1e-4  # [rad or m] a tracked arm that ends this near to a joint limit ends because of it
_STRAY = 0.05  # of the distance between two poses, by which the tip may leave their middle when the joints go straight
_SINGULAR = (
    0.01  # least singular value of the Jacobian, a radian counted as 0.1 m: below it the break is called a singularity
)


class PathSearch:
    """A question and what is known so far; `run` answers it."""

    def __init__(self, asked: PathQuestion, given: GivenPoses) -> None:
        self.asked, self.source = asked, given
        self.layered = False  # until `run` looks
        self.names: tuple[str, ...] = ()
        self.s, self.T = given.s, given.T
        self.is_given = np.ones(len(given.s), dtype=bool)
        self.extra: dict[float, FloatArray] = {}  # answers at added poses that a listing does not hold

    # --- what the arm answers

    def near(self, T: FloatArray, q: FloatArray) -> FloatArray | None:
        """The answer at one pose that goes on from q, its turns undone; None where there is none inside the limits."""
        if self.layered:
            answers = self.asked.solver.solve(self.asked.wanted(T), q)
        else:
            answers = solve_numeric(self.asked.chain, self.asked.wanted(T), seed=q, restarts=1)
        candidates = answers.q[answers.valid]
        if not len(candidates):
            return None
        candidates = self.asked.unturned(candidates, q)
        best = candidates[int(np.argmin(np.abs(candidates - q).max(axis=1)))]
        inside = ((best >= self.asked.lower - ROUNDING) & (best <= self.asked.upper + ROUNDING)).all()
        return np.clip(best, self.asked.lower, self.asked.upper) if inside else None

    def goes_on(self, q: FloatArray, following: FloatArray, a: float, b: float) -> bool:
        """Whether a step is small, and the tip keeps to the way between the poses when the joints go straight."""
        distance = b - a
        if np.abs(following - q).max() > float(jump_bound(distance)):
            return False
        if self.asked.target != "pose":
            return True
        return bool(self._strays(np.stack([q, following]), np.array([a, b]))[0] <= 0.0)

    def _strays(self, q: FloatArray, s: FloatArray) -> FloatArray:
        """(m - 1,): by how much the middle of each step leaves the way, beyond what is allowed [m]."""
        T = self.asked.chain.native.fk(np.ascontiguousarray(0.5 * (q[1:] + q[:-1])))
        ends = self.asked.chain.native.fk(np.ascontiguousarray(q))
        off = T[:, :3] - 0.5 * (ends[1:, :3] + ends[:-1, :3])
        metres = np.sqrt((off[:, :, 3] ** 2).sum(axis=1))
        radians = np.sqrt((off[:, :, :3] ** 2).sum(axis=(1, 2)) / 2.0)
        return np.asarray(np.hypot(metres, METRES_PER_RADIAN * radians) - _STRAY * np.diff(s) - ROUNDING)

    # --- the whole

    def run(self) -> JointPath:
        at_once = self.asked.solver.method in ("closed form", "general") and self.asked.target != "position"
        self.layered = at_once and not (self.asked.target == "axis" and self.asked.chain.dof > 5)
        if self.layered:
            first = self.asked.solver.solve(self.asked.wanted(self.T[:1]))
            self.names = first.branch_names
            self.layered = not first.free
        if self.layered and self.asked.seed is not None and self.asked.target == "pose":
            metres, radians = pose.distance(self.asked.chain.native.fk(self.asked.seed), self.T[0])
            if (
                metres <= SAME
                and radians <= SAME
                and ((self.asked.seed >= self.asked.lower) & (self.asked.seed <= self.asked.upper)).all()
            ):
                # in a singularity one of endlessly many answers, of which one is listed
                self.extra[float(self.s[0])] = self.asked.seed
        found = self._by_layers() if self.layered else self._tracked()
        broken = found.broken
        if broken is None or broken.s > 0.0 or broken.reason != "singularity" or self.asked.words is not None:
            return found
        return self._out_of_singularity(found, broken)

    def _out_of_singularity(self, found: JointPath, broken: PathBreak) -> JointPath:
        """The arm stands in a singularity, where endlessly many joint values reach the pose: those it would come to from the other side."""
        ends = np.flatnonzero(self.source.s >= min(FULL_STEP, float(self.source.s[-1])))
        behind = GivenPoses.of(self.source.T[: int(ends[0]) + 1][::-1], None, None)
        way = PathSearch(self.asked, behind).run()
        if way.broken is not None or not len(way.q):
            return found
        if self.asked.seed is not None:
            return replace(found, broken=self._stood_badly(broken, way.q[-1]))
        return PathSearch(replace(self.asked, seed=way.q[-1]), self.source).run()

    def _stood_badly(self, broken: PathBreak, start: FloatArray) -> PathBreak:
        """The break of an arm that stands in a singularity, with joint values to begin from."""
        assert self.asked.seed is not None
        listed, start = start, self.asked.unturned(start, self.asked.seed)
        if ((start < self.asked.lower) | (start > self.asked.upper)).any():
            start = np.array(listed)
        moves = [
            f"{name!r} to {value:.6g}"
            for name, value, here in zip(self.asked.chain.joint_names, start, self.asked.seed, strict=True)
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
        return JointPath(self.asked.chain, s, q, given, self.source.corners, tuple(labels.tolist()), broken, method)

    # --- by layers

    def _by_layers(self) -> JointPath:
        while True:
            layers = Layers(self.asked, self.s, self.T, self.extra)
            route = layers.shortest(len(self.s))
            if route is not None:
                strays = np.zeros(len(self.s) - 1)
                if self.asked.target == "pose" and len(route.q) > 1:
                    strays = self._strays(route.q, self.s)
                wide = np.flatnonzero((strays > 0.0) & (np.diff(self.s) > self.asked.precision))
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
            following = self.near(self.source.between(there), q)
            if following is not None and self.goes_on(q, following, s, there):
                s, q = there, following
                ways.append(s)
                values.append(q)
                h *= 2.0
                if len(ways) > _MOST_POSES:
                    return ways, values, False
            elif h <= self.asked.precision:
                return ways, values, False
            else:
                h *= 0.5
        return ways, values, True

    def _broken(
        self, last: int, routes: list[Route], ways: list[tuple[list[float], list[FloatArray], bool]]
    ) -> JointPath:
        """The path up to the break: the route whose way goes farthest, the cheapest of those, with the poses that lead there."""
        ends = [way[0][-1] if way[0] else float(self.s[last]) for way in ways]
        farthest = max(ends)
        best = min(
            (k for k, end in enumerate(ends) if end >= farthest - self.asked.precision), key=lambda k: routes[k].cost
        )
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

    def _missed(self, layers: Layers) -> JointPath:
        """No answer to begin with."""
        answers = self.asked.solver.solve(self.asked.wanted(self.T[0]))
        reason: Reason = "unreachable" if not answers.valid.any() else "limit"
        words = answers.reason
        if answers.within_limits.any():
            reason = "branch"
            words = f"no answer there is called {self.asked.words!r}; there are: " + "; ".join(
                sorted({str(x) for x in answers.labels[answers.within_limits]})
            )
        broken = PathBreak(0.0, -1, reason, f"the first pose is missed: {words}", 0.0)
        return self._result(0, np.empty((0, self.asked.chain.dof)), np.empty(0, dtype=np.int64), broken, "layers")

    def _why(self, s: float, q: FloatArray, index: int) -> PathBreak:
        """The reason that a path ends at length s with joint values q."""
        total = float(self.source.s[-1])
        T = self.source.between(min(s + 10.0 * self.asked.precision, total))
        if self.layered:
            answers = self.asked.solver.solve(self.asked.wanted(T), q)
        else:
            answers = solve_numeric(self.asked.chain, self.asked.wanted(T), seed=q)
        candidates = self.asked.unturned(answers.q[answers.valid], q)
        if len(candidates):
            candidates = candidates[np.argsort(np.abs(candidates - q).max(axis=1))]
        at_limit, report = self._limit_in_the_way(q, candidates), self._singularity(q)
        reason: Reason
        if at_limit is not None:
            reason, words = "limit", at_limit
        elif not len(candidates) and (self.layered or not report.near):
            reason, words = "unreachable", f"the pose behind it is missed: {answers.reason}"
        elif report.near:
            reason, words = "singularity", f"the branch ends, {report}" if len(candidates) else str(report)
        else:
            jump = np.abs(candidates[0] - q)
            worst = int(np.argmax(jump))
            name = self.asked.chain.joint_names[worst]
            reason, words = (
                "branch",
                f"to go on, joint {name!r} would have to jump by {jump[worst]:.4g} to another branch",
            )
        return PathBreak(s, index, reason, f"at {s:.6g} of {total:.6g} m: {words}", self.asked.precision)

    def _limit_in_the_way(self, q: FloatArray, candidates: FloatArray) -> str | None:
        """Which joint is at a limit that it would have to cross to the nearest answer, or by which iteration was ended; None without one."""
        if len(candidates) and np.abs(candidates[0] - q).max() <= SMALLEST_BOUND:
            there = candidates[0]
            beyond = np.maximum(self.asked.lower - there, there - self.asked.upper)
            worst = int(np.argmax(beyond))
            if beyond[worst] > -ROUNDING:
                downwards = there[worst] < q[worst] or q[worst] < self.asked.lower[worst]
                bound = (self.asked.lower if downwards else self.asked.upper)[worst]
                return f"joint {self.asked.chain.joint_names[worst]!r} is at its limit of {bound:.6g} and would have to go beyond"
        room = np.minimum(q - self.asked.lower, self.asked.upper - q)
        tight = int(np.argmin(room))
        if not self.layered and room[tight] <= _AT_LIMIT:  # iteration keeps within the limits, and ends there
            return f"joint {self.asked.chain.joint_names[tight]!r} is at its limit"
        return None

    def _singularity(self, q: FloatArray) -> Singularity:
        J = jacobian(self.asked.chain, q) * np.array([1.0] * 3 + [METRES_PER_RADIAN] * 3)[:, None]
        if self.asked.target == "position":
            J = J[:3]
        return singularity(J, threshold=_SINGULAR, joint_names=self.asked.chain.joint_names)

    # --- tracked

    def _starts(self) -> FloatArray:
        T = self.T[0]
        if self.asked.seed is not None:
            answers = solve_numeric(self.asked.chain, self.asked.wanted(T), seed=self.asked.seed)
            return answers.q[answers.within_limits][:1]
        answers = self.asked.solver.solve(self.asked.wanted(T))
        found = answers.q[answers.within_limits]
        if len(found) <= 1:
            more = solve_numeric(self.asked.chain, self.asked.wanted(T), count=_STARTS)
            found = np.concatenate([found, more.q[more.within_limits]])
        # those in the middle of their limits first
        lower, upper = np.clip(self.asked.lower, -TURN, TURN), np.clip(self.asked.upper, -TURN, TURN)
        room = np.minimum(found - lower, upper - found).min(axis=1)
        return np.asarray(found[np.argsort(-room, kind="stable")][:_STARTS])

    def _tracked(self) -> JointPath:
        best: tuple[list[float], list[FloatArray]] | None = None
        for start in self._starts():
            s, q = [float(self.s[0])], [start]
            for k in range(1, len(self.T)):
                a, b = float(self.s[k - 1]), float(self.s[k])
                following = self.near(self.T[k], q[-1])
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
            answers = self.asked.solver.solve(self.asked.wanted(self.T[0]))
            reason: Reason = "unreachable" if not answers.valid.any() else "limit"
            broken = PathBreak(0.0, -1, reason, f"the first pose is missed: {answers.reason}", 0.0)
            return self._result(0, np.empty((0, self.asked.chain.dof)), np.empty(0, dtype=np.int64), broken, "tracked")
        s, q = best
        index = int(np.searchsorted(self.source.s, s[-1] + 1e-15, side="right")) - 1
        broken_at = None if s[-1] >= float(self.source.s[-1]) else self._why(s[-1], q[-1], index)
        self.s, given = np.array(s), np.isin(np.array(s), self.source.s)
        self.is_given = given
        return self._result(len(q), np.array(q), np.full(len(q), -1), broken_at, "tracked")
