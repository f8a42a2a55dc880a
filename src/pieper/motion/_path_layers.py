"""The answers at all poses of a path as layers, and the cheapest route through them, as `pieper.motion.path_ik` says."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.errors import unknown_name
from pieper.motion._path_question import TURN
from pieper.motion.joint_path import jump_bound

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from pieper.model.chain import Chain
    from pieper.motion._path_question import PathQuestion
    from pieper.spatial._checks import FloatArray

ROUNDING = 1e-9
"""By how much a joint value may be beyond a limit, or a step longer than its bound [rad or m]: what rounding makes of one that touches it."""
SAME = 1e-6
"""Answers nearer to each other than this are one [rad or m]."""


@dataclass(eq=False)
class Route:
    """Rows of a route: joint values and the numbers of branches."""

    q: FloatArray
    branch: NDArray[np.int64]
    cost: float


class Layers:
    """The answers of all poses, and the ways between them."""

    def __init__(self, asked: PathQuestion, s: FloatArray, T: FloatArray, extra: dict[float, FloatArray]) -> None:
        self.asked, self.s, self.extra = asked, s, extra
        answers = asked.solver.solve(asked.wanted(T))
        q, usable, branch = answers.q, answers.within_limits, answers.branch
        if extra:
            q, usable, branch = self._with_extra(q, usable, branch)
        if not usable.shape[1]:  # no answer anywhere
            q, usable, branch = (
                np.zeros((len(q), 1, asked.chain.dof)),
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
        self._in_turns = np.where(asked.turning, 1.0 / TURN, 1.0)
        self.open = self._admissible(asked.chain)

    def _with_extra(self, q: FloatArray, usable: Any, branch: Any) -> tuple[FloatArray, Any, Any]:
        m = len(q)
        more = np.full((m, 1, q.shape[2]), np.nan)
        there = np.zeros((m, 1), dtype=bool)
        for i, s in enumerate(self.s.tolist()):
            values = self.extra.get(s)
            if values is None:
                continue
            apart = np.abs(self.asked.unturned(q[i][usable[i]], values) - values).max(axis=1, initial=0.0)
            if not (apart < SAME).any():
                more[i, 0], there[i, 0] = values, True
        return (
            np.concatenate([q, more], axis=1),
            np.concatenate([usable, there], axis=1),
            np.concatenate([branch, np.full((m, 1), -1, dtype=branch.dtype)], axis=1),
        )

    def _first(self, names: tuple[str, ...]) -> NDArray[np.bool_]:
        """(k,): the answers at the first pose that a route may begin with."""
        asked = self.asked
        usable: NDArray[np.bool_] = self.usable[0].copy()
        if asked.words is not None:
            words = [word.strip() for word in asked.words.split(",")]
            known = {part for name in names for part in name.split(", ")}
            for word in words:
                if word not in known:
                    raise unknown_name("label", word, sorted(known), f"the answers of {asked.chain.name!r}")
            fits = [b >= 0 and set(words) <= set(names[b].split(", ")) for b in self.branch[0].tolist()]
            usable &= np.array(fits)
        if asked.seed is not None and usable.any():
            apart = np.abs(asked.unturned(self.q[0], asked.seed) - asked.seed)
            distance = np.where(usable, (apart / asked.speeds).sum(axis=1), np.inf)
            usable &= distance <= distance.min() + SAME
        return usable

    def _admissible(self, chain: Chain) -> NDArray[np.bool_]:
        """(m - 1, k, k): which answer may follow which."""
        q = self.q * self._in_turns
        bound = jump_bound(np.diff(self.s))
        worst = np.where(self.usable[:-1, :, None] & self.usable[1:, None, :], 0.0, np.inf)
        for j in range(chain.dof):
            column = np.ascontiguousarray(q[:, :, j])
            apart = column[1:, None, :] - column[:-1, :, None]
            if self.asked.turning[j]:
                apart -= np.rint(apart)
                apart *= TURN
            np.abs(apart, out=apart)
            np.maximum(worst, apart, out=worst)
        # beside a fold two branches are near each other, and the answer that goes on is the nearer one
        nearest = np.minimum(
            np.maximum(worst.min(axis=2, keepdims=True), worst.min(axis=1, keepdims=True)), bound[:, None, None]
        )
        allowed: NDArray[np.bool_] = worst <= nearest + ROUNDING
        return allowed

    def costs(self, rows: NDArray[np.int64], a: NDArray[np.int64], b: NDArray[np.int64]) -> FloatArray:
        """Cost of the ways from answers a of some poses to answers b of the next: the sum of the ways over the speed limits [s]."""
        apart = self.q[rows + 1, b] - self.q[rows, a]
        apart -= np.where(self.asked.turning, TURN * np.rint(apart / TURN), 0.0)
        return np.asarray((np.abs(apart) / self.asked.speeds).sum(axis=-1))

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

    def routes(self, poses: int) -> list[Route]:
        """Of all pairs of a first and a last answer the cheapest route through the first poses that stays within the limits."""
        return [route for route in self._routes(poses) if route is not None]

    def shortest(self, poses: int) -> Route | None:
        """The cheapest route through the first poses; None where there is none within the limits."""
        return min(self.routes(poses), key=lambda route: route.cost, default=None)

    def _routes(self, poses: int) -> list[Route | None]:
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
    ) -> Route | None:
        places = np.empty(poses, dtype=np.int64)
        places[-1] = at = end
        for i, traces, before in reversed(steps):
            if traces is None:
                at = int(before[start, at])
                places[i] = at
            else:
                at = int(before[at])
                places[i : i + len(traces)] = traces[:, at]
        asked, rows = self.asked, np.arange(poses)
        q = self.q[rows, places]
        turns = np.zeros_like(q)
        np.cumsum(-np.rint(np.diff(q, axis=0) / TURN), axis=0, out=turns[1:])
        q = q + np.where(asked.turning, TURN * turns, 0.0)
        lowest, highest = q.min(axis=0), q.max(axis=0)
        with np.errstate(invalid="ignore"):
            least = np.ceil((asked.lower - ROUNDING - lowest) / TURN)
            most = np.floor((asked.upper + ROUNDING - highest) / TURN)
        bounded = np.isfinite(asked.lower) & np.isfinite(asked.upper)
        middle = np.where(
            bounded, 0.5 * (np.where(bounded, asked.lower, 0.0) + np.where(bounded, asked.upper, 0.0)), 0.0
        )
        wish = np.rint(((middle - 0.5 * (lowest + highest)) if asked.seed is None else (asked.seed - q[0])) / TURN)
        shift = np.where(asked.turning, np.minimum(np.maximum(wish, least), most), 0.0)
        if (shift < np.where(asked.turning, least, 0.0)).any():
            return None
        q = np.clip(q + TURN * shift, asked.lower, asked.upper)
        return Route(q, self.branch[rows, places], cost)
