"""Curves of solutions: joint motions that leave a target met, followed from one solution.

An arm with more joints than its target has rows can move while its tip stays: seven joints at a pose, six joints at a
position and an axis. So can six joints at some singular poses (a stretched wrist turns joints 4 and 6 against each other).
Where the solutions ``r(q) = 0`` of n joints form a curve, its unit tangent t spans the null space of the Jacobian of the rows,

    J(q) t = 0,        J = dr/dq of rank n - 1.

`follow` takes a step along the tangent and comes back to the curve by Newton's method across it, through folds, where
a joint turns back, until the curve closes (Allgower and Georg, Introduction to Numerical Continuation Methods, SIAM 2003,
chapters 2 and 6). Length along a curve is that of joint space: radians and, for joints that slide, metres.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pieper.errors import ArrayError
from pieper.ik._equations import RESIDUAL, RESIDUAL_OF_FAMILIES, Equations
from pieper.ik._tracing import BEND, NO_WAY_ON, Point, begin, lengths, march, ways_from
from pieper.ik.target import Target, pose
from pieper.kinematics.joints import as_joints, periodic_joints

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from pieper.model.chain import Chain
    from pieper.spatial._checks import FloatArray


__all__ = [
    "RESIDUAL", "RESIDUAL_OF_FAMILIES", "Equations", "NearestPoint", "SolutionCurve", "crossing", "follow", "limit_margins",
]  # fmt: skip

_TURN = 2.0 * np.pi
_SOLVES = 1e-5  # [m and rad] a starting point that misses by more is not taken for a solution
_LIMIT_ROUNDING = 1e-12  # rad or m by which a joint limit may be passed
_STAYS = 1e-5  # rad or m: what changes by no more along a curve is constant; beside branch points 1e-6 is rounding


class NearestPoint(NamedTuple):
    """A point of a curve, and how far it is from where it was looked for."""

    q: FloatArray
    """(n,) joint values, each as the copy by whole turns that is nearest [rad or m]; NaN where no point is within limits."""
    s: float
    """Its place along the curve."""
    distance: float
    """Length of the difference of the joint values; infinite where there is no point."""


@dataclass(frozen=True, eq=False)
class SolutionCurve:
    """A connected one-dimensional set of solutions of one target. Made by `follow`.

    Attributes
    ----------
    chain : Chain
    target : Target
    q : (m, n) array
        Points along it, at most `step` apart, each of which meets the target [rad or m]. Joints run on without being
        brought back by whole turns, so that the last point of a closed curve is the first one but for whole turns.
    s : (m,) array
        Their places along the curve: its length so far.
    tangents : (m, n) array
        Unit tangents dq/ds.
    closed : bool
        True when it returns to where it began.
    ends : str
        Why it ends where it does: ``"closed"``, or what was met at its ends.
    branch_points : (k,) array
        Places where another curve crosses, as near as curves can be told apart.
    held : (int, float), optional
        A joint that stays, and its value, where the Jacobian alone does not show the direction of the curve: a straight arm.
    """

    chain: Chain
    target: Target
    q: FloatArray
    s: FloatArray
    tangents: FloatArray
    closed: bool
    ends: str
    branch_points: FloatArray
    held: tuple[int, float] | None = None

    @property
    def length(self) -> float:
        """Length in joint space."""
        return float(self.s[-1])

    @property
    def free_direction(self) -> FloatArray:
        """(n,): the unit tangent at the first point; with it the joints move and the target stays met."""
        return np.asarray(self.tangents[0])

    @cached_property
    def coupling(self) -> str:
        """What holds all along the curve, in words: a joint that is free, sums and differences that stay; or nothing."""
        moving = np.flatnonzero(np.ptp(self.q, axis=0) > _STAYS)
        names = self.chain.joint_names
        if len(moving) == 1:
            return f"{names[moving[0]]} free"
        said = []
        for k, i in enumerate(moving):
            for j in moving[k + 1 :]:
                for sign, word in ((1.0, "+"), (-1.0, "-")):
                    if np.ptp(self.q[:, i] + sign * self.q[:, j]) <= _STAYS:
                        said.append(f"{names[i]} {word} {names[j]} = const")
        return ", ".join(said)

    @cached_property
    def equations(self) -> Equations:
        """The equations that every point meets."""
        return Equations(self.chain, self.target, self.held)

    @cached_property
    def within_limits(self) -> NDArray[np.bool_]:
        """(m,): True for the points that have a copy, by whole turns, inside the joint limits."""
        return np.asarray((self._margins(self.q) >= -_LIMIT_ROUNDING).all(axis=-1))

    @cached_property
    def intervals(self) -> FloatArray:
        """(k, 2): from where to where along the curve the joints are inside their limits, ends exact.

        On a closed curve an interval that runs through the first point ends beyond `length`.
        """
        places = self._breaks()
        middles = 0.5 * (places[1:] + places[:-1])
        inside = np.all(self._margins(self._points(middles)[0]) >= -_LIMIT_ROUNDING, axis=-1).tolist()
        found: list[list[float]] = []
        for is_inside, start, end in zip(inside, places[:-1], places[1:], strict=True):
            if is_inside and found and found[-1][1] == start:
                found[-1][1] = float(end)
            elif is_inside:
                found.append([float(start), float(end)])
        if self.closed and len(found) > 1 and found[0][0] == 0.0 and found[-1][1] == self.length:
            found[-1][1] += found.pop(0)[1]
        return np.array(found).reshape(-1, 2)

    def at(self, s: ArrayLike) -> FloatArray:
        """Points at places along the curve, brought onto it.

        Parameters
        ----------
        s : (...) array_like
            Places, from 0 to `length`; on a closed curve any, counted on round it.

        Returns
        -------
        (..., n) array
            Joint values that meet the target to 1e-11 [rad or m].

        Raises
        ------
        ArrayError
            Not finite, or beyond the ends of a curve that does not close.
        """
        places = np.asarray(s, dtype=float)
        if not np.isfinite(places).all():
            raise ArrayError(f"s must be finite, got {places[~np.isfinite(places)].flat[0]}")
        if not self.closed and places.size and not (places.min() >= 0.0 and places.max() <= self.length):
            raise ArrayError(
                f"s must be from 0 to {self.length:.6g}, the ends of this curve, got {places.min():.6g} to {places.max():.6g}"
            )
        return np.asarray(self._points(places.ravel())[0].reshape(*places.shape, self.chain.dof))

    def nearest(self, q: ArrayLike, *, within_limits: bool = False) -> NearestPoint:
        """The point of the curve that is nearest to a joint vector; of the curve, not of its samples.

        Parameters
        ----------
        q : (n,) array_like
            Joint values [rad or m].
        within_limits : bool
            Whether to look inside the joint limits only, `intervals`. Then each joint is the copy inside its limits.

        Returns
        -------
        NearestPoint

        Raises
        ------
        ArrayError
            `q` has another shape.
        """
        wanted = as_joints(self.chain, q)
        if wanted.ndim != 1:
            raise ArrayError(f"q must have shape ({self.chain.dof},), got {wanted.shape}")
        if not within_limits:
            return self._nearest_between(wanted, 0.0, self.length, limited=False)
        best = NearestPoint(np.full(self.chain.dof, np.nan), np.nan, np.inf)
        for start, end in self.intervals:
            found = self._nearest_between(wanted, start, end, limited=True)
            best = min(best, found, key=lambda point: point.distance)
        return best

    def contains(self, q: ArrayLike, *, tolerance: float = 1e-6) -> NDArray[np.bool_]:
        """Which of some solutions are on the curve, whole turns aside.

        Parameters
        ----------
        q : (..., n) array_like
            Solutions of the same target [rad or m].
        tolerance : float
            Distance that counts as the same [rad or m].

        Returns
        -------
        (...) bool array
        """
        return np.asarray(self.place(q, tolerance=tolerance) >= 0.0)

    def place(self, q: ArrayLike, *, tolerance: float = 1e-6) -> FloatArray:
        """Places (...) along the curve of some solutions (..., n); NaN for those that are elsewhere. Arguments as for `contains`."""
        values = as_joints(self.chain, q)
        points = values.reshape(-1, self.chain.dof)
        places = np.full(len(points), np.nan)
        spacing = float(np.diff(self.s).max(initial=0.0))
        # the nearest sample, by distances whose squares are sums of products
        for at in range(0, len(points), 256):
            part = points[at : at + 256]
            apart = self._wrapped(part[:, None] - self.q)
            near = np.argmin((apart * apart).sum(axis=-1), axis=1)
            offset = apart[np.arange(len(part)), near]
            along = (offset * self.tangents[near]).sum(axis=1, keepdims=True)
            across = np.linalg.norm(offset - along * self.tangents[near], axis=1)
            close = np.flatnonzero(
                (across <= BEND * spacing + tolerance) & (np.abs(along[:, 0]) <= spacing + tolerance)
            )
            if not len(close):
                continue
            s = self.s[near[close]] + along[close, 0]
            for _ in range(3):
                s = self._held(s)
                here, tangent = self._points(s)
                left = self._wrapped(part[close] - here)
                s = s + (left * tangent).sum(axis=1)
            on = np.linalg.norm(left, axis=1) <= tolerance
            places[at + close[on]] = self._held(s)[on]
        return np.asarray(places.reshape(values.shape[:-1]))

    # What the methods above share.

    @cached_property
    def _turning(self) -> NDArray[np.bool_]:
        return periodic_joints(self.chain)

    def _wrapped(self, difference: FloatArray) -> FloatArray:
        return np.asarray(difference - np.where(self._turning, _TURN * np.round(difference / _TURN), 0.0))

    def _held(self, s: FloatArray) -> FloatArray:
        """Places brought back to the curve: round it, or to its ends."""
        return np.asarray(np.mod(s, self.length) if self.closed else np.clip(s, 0.0, self.length))

    def _points(self, s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Points (k, n) and tangents at places (k,)."""
        rounds = np.floor(s / self.length) if self.closed else np.zeros_like(s)
        rest = s - rounds * self.length
        i = np.clip(np.searchsorted(self.s, rest, side="right") - 1, 0, len(self.s) - 2)
        h = self.s[i + 1] - self.s[i]
        u = ((rest - self.s[i]) / h)[:, None]
        h = h[:, None]
        q = (1 + 2 * u) * (1 - u) ** 2 * self.q[i] + u * u * (3 - 2 * u) * self.q[i + 1]
        q = q + h * (u * (1 - u) ** 2 * self.tangents[i] - u * u * (1 - u) * self.tangents[i + 1])
        q, t = self.equations.correct_many(q)
        t = t * np.where((t * (self.tangents[i] + self.tangents[i + 1])).sum(axis=1) < 0.0, -1.0, 1.0)[:, None]
        return q + rounds[:, None] * (self.q[-1] - self.q[0]), t

    def _margins(self, q: FloatArray) -> FloatArray:
        """(..., n): how far each joint, or its best copy, is inside its limits; negative outside."""
        return limit_margins(self.chain, q)

    def _breaks(self) -> FloatArray:
        """Places where a joint passes a limit, and both ends."""
        nodes = np.unique(np.concatenate([self.s, self._turning_places()]))
        q, _ = self._points(nodes)
        margins = self._margins(q) + _LIMIT_ROUNDING
        i, joint = np.nonzero((margins[:-1] > 0.0) != (margins[1:] > 0.0))
        if not len(i):
            return np.array([0.0, self.length])
        low, high = nodes[i], nodes[i + 1]
        rising = margins[i, joint] <= 0.0
        rows = np.arange(len(i))
        s = low + (high - low) * margins[i, joint] / (margins[i, joint] - margins[i + 1, joint])
        for _ in range(40):
            q, t = self._points(s)
            value = self._margins(q)[rows, joint] + _LIMIT_ROUNDING
            below = (value > 0.0) != rising
            low, high = np.where(below, s, low), np.where(below, high, s)
            slope = np.where(rising, 1.0, -1.0) * np.abs(t[rows, joint])
            with np.errstate(divide="ignore", invalid="ignore"):
                step = s - value / slope
            inside = (step >= low) & (step <= high)
            new = np.where(inside, step, 0.5 * (low + high))
            done = np.abs(new - s).max() <= 1e-15 * max(1.0, self.length)
            s = new
            if done or np.abs(value).max() <= 1e-14:
                break
        return np.unique(np.concatenate([[0.0, self.length], np.clip(s, 0.0, self.length)]))

    def _turning_places(self) -> FloatArray:
        """Places between samples where a joint turns back."""
        t = self.tangents
        i, joint = np.nonzero(t[:-1] * t[1:] < 0.0)
        i, joint = i[np.abs(t[i, joint]) > 1e-9], joint[np.abs(t[i, joint]) > 1e-9]
        if not len(i):
            return np.empty(0)
        low, high, a, b = self.s[i], self.s[i + 1], t[i, joint], t[i + 1, joint]
        rows = np.arange(len(i))
        s = low + (high - low) * a / (a - b)
        for _ in range(3):  # a limit passed by less than what is left after these would be passed by 1e-10 or so
            value = self._points(s)[1][rows, joint]
            same = value * a > 0.0
            low, a = np.where(same, s, low), np.where(same, value, a)
            high, b = np.where(same, high, s), np.where(same, b, value)
            s = low + (high - low) * a / np.where(a == b, 1.0, a - b)
        return np.asarray(s)

    def _copies(self, q: FloatArray, wanted: FloatArray, limited: bool) -> FloatArray:
        """The copies of joint values (..., n), by whole turns, nearest to `wanted` (and inside the limits)."""
        turns = np.round((wanted - q) / _TURN)
        if limited:
            lower, upper = self.chain.limits.T
            lowest = np.ceil((lower - _LIMIT_ROUNDING - q) / _TURN)
            highest = np.floor((upper + _LIMIT_ROUNDING - q) / _TURN)
            turns = np.clip(turns, lowest, np.maximum(lowest, highest))
        return np.asarray(q + np.where(self._turning, _TURN * turns, 0.0))

    def _nearest_between(self, wanted: FloatArray, start: float, end: float, *, limited: bool) -> NearestPoint:
        whole = self.closed and end - start >= self.length
        rounds = (self.s, self.s[1:] + self.length) if self.closed else (self.s,)
        inner = np.concatenate(rounds)
        nodes = np.concatenate([[start], inner[(inner > start) & (inner < end)], [end]])
        q, _ = self._points(nodes)
        apart = self._copies(q, wanted, limited) - wanted
        distance = np.linalg.norm(apart, axis=1)
        # no point is farther from its nearest node than half the gap, so nodes that are too far lead nowhere
        gaps = np.diff(nodes)
        reach = np.maximum(np.append(gaps, 0.0), np.append(0.0, gaps))
        promising = distance - reach <= distance.min() + 1e-12
        before, after = np.append(np.inf, distance[:-1]), np.append(distance[1:], np.inf)
        if whole:
            before[0], after[-1] = distance[-2], distance[1]
        lowest = promising & (distance <= before) & (distance <= after)
        best = NearestPoint(q[0], start, np.inf)
        for i in np.flatnonzero(lowest):
            low = nodes[i] - (gaps[i - 1] if i else (gaps[-1] if whole else 0.0))
            high = nodes[i] + (gaps[i] if i < len(gaps) else (gaps[0] if whole else 0.0))
            point = self._refined(wanted, float(low), float(nodes[i]), float(high), limited)
            best = min(best, point, key=lambda p: p.distance)
        here = best.q
        if limited:
            here = np.clip(here, *self.chain.limits.T)
        return NearestPoint(here, float(self._held(np.array(best.s))), best.distance)

    def _refined(self, wanted: FloatArray, low: float, s: float, high: float, limited: bool) -> NearestPoint:
        """The least distance between two places: Newton's method on its slope, held by bisection."""
        best = NearestPoint(wanted, s, np.inf)
        for _ in range(60):
            (q,), (t,) = self._points(np.array([s]))
            q = self._copies(q, wanted, limited)
            apart = q - wanted
            distance = float(np.linalg.norm(apart))
            if distance < best.distance:
                best = NearestPoint(q, s, distance)
            slope = float(apart @ t)
            low, high = (low, s) if slope > 0.0 else (s, high)
            ahead = min(1e-4, 0.25 * max(high - low, 1e-6))
            (_,), (t2,) = self._points(np.array([s + ahead if s + ahead <= self.length or self.closed else s - ahead]))
            sign = 1.0 if s + ahead <= self.length or self.closed else -1.0
            bend = 1.0 + sign * float(apart @ (t2 - t)) / ahead
            step = s - slope / bend if bend > 0.1 else 0.5 * (low + high)
            if not low <= step <= high:
                step = 0.5 * (low + high)
            if abs(step - s) <= 1e-13 * max(1.0, self.length):
                break
            s = step
        return best

    def __repr__(self) -> str:
        how = "closed" if self.closed else "open"
        words = f", {self.coupling}" if self.coupling else ""
        return f"SolutionCurve({how}, length {self.length:.4g}, {len(self.q)} points{words})"


def follow(
    chain: Chain,
    target: ArrayLike | Target,
    q: ArrayLike,
    *,
    direction: ArrayLike | None = None,
    step: float = 0.1,
    max_steps: int = 5000,
) -> SolutionCurve | None:
    """The curve of solutions of a target through one of them.

    Parameters
    ----------
    chain : Chain
        Any chain with at least as many rows in the target as joints but one.
    target : (4, 4) array_like or Target
        A pose ``T_base_tip`` [m, -], or some rows of one.
    q : (n,) array_like
        A solution of it [rad or m]; it may miss by up to 1e-5 and is brought onto the curve.
    direction : (n,) array_like, optional
        Which way to go first, and which curve to take where several cross at `q`.
    step : float
        Largest distance between points of the curve.
    max_steps : int
        Steps before giving up, in either direction.

    Returns
    -------
    SolutionCurve or None
        None where the solution is isolated: a regular one, or two that coincide (a fold).

    Raises
    ------
    ArrayError
        The target or `q` is malformed, `q` does not meet the target, or the solutions near it form a surface.

    Notes
    -----
    At a branch point curves cross; the one that goes straight on is followed, and the place is reported. Curves that pass each
    other closer than about 1e-5 are taken to cross. At a double solution a step of 0.01 along the null direction
    leaves a residual that nothing removes, on a curve it does not: this is how they are told apart.

    Examples
    --------
    >>> from pieper.kinematics.fk import fk
    >>> from pieper.model import catalog
    >>> arm = catalog.describe("kuka_kr210_robond").chain()
    >>> stretched_wrist = [0.1, 0.2, 0.3, 0.4, 0.0, 0.6]
    >>> curve = follow(arm, fk(arm, stretched_wrist), stretched_wrist)
    >>> curve.closed, curve.coupling
    (True, 'joint_4 + joint_6 = const')
    >>> follow(arm, fk(arm, [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]), [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]) is None
    True
    """
    goal = target if isinstance(target, Target) else pose(target)
    if goal.T_base_tip.shape != (4, 4):
        raise ArrayError(f"a curve is that of one target, of shape (4, 4), got {goal.T_base_tip.shape}")
    start = as_joints(chain, q)
    if start.ndim != 1:
        raise ArrayError(f"q must have shape ({chain.dof},), got {start.shape}")
    if not (0.0 < step < np.inf and max_steps >= 1):
        raise ArrayError(f"step must be positive and max_steps at least 1, got {step!r} and {max_steps!r}")
    equations = Equations(chain, goal)
    if equations.count < equations.rank:
        raise ArrayError(
            f"the target has {equations.count} rows for {chain.dof} joints of {chain.name!r}, so that its solutions form a set "
            f"of {chain.dof - equations.count} dimensions and no curve; hold some joints or ask for more rows"
        )
    missed = float(equations.errors(start))
    if not missed <= _SOLVES:
        raise ArrayError(f"q must meet the target; it misses by {missed:.3g} m or rad")
    wanted = None if direction is None else as_joints(chain, direction, name="direction")
    first = begin(equations, start, wanted)
    if first is None:
        return None
    curve = _trace(*first, step=step, max_steps=max_steps)
    # at a singular pose solutions beside each other within rounding are no curve, and soon leave the target
    return None if curve.ends == NO_WAY_ON and equations.count > equations.rank else curve


def limit_margins(chain: Chain, q: FloatArray) -> FloatArray:
    """How far joints are inside their limits [rad or m]; for those that turn, the copy by whole turns that is farthest inside.

    Parameters
    ----------
    chain : Chain
    q : (..., n) array

    Returns
    -------
    (..., n) array
        Negative outside, infinite for joints without limits.
    """
    lower, upper = chain.limits.T
    plain = np.minimum(q - lower, upper - q)
    bounded = periodic_joints(chain) & np.isfinite(lower) & np.isfinite(upper)
    unbounded = periodic_joints(chain) & ~bounded
    middle = np.where(bounded, 0.5 * (np.where(bounded, lower, 0.0) + np.where(bounded, upper, 0.0)), 0.0)
    away = q - middle
    away = np.abs(away - _TURN * np.round(away / _TURN))
    copies = np.where(bounded, 0.5 * (upper - lower), np.inf) - away
    return np.asarray(np.where(unbounded, np.inf, np.where(bounded, copies, plain)))


def crossing(curve: SolutionCurve) -> FloatArray:
    """Points (k, n) of the curves that cross at the branch points of one, a little away from it; its own among them."""
    found = [way[1].q for s in curve.branch_points for way in ways_from(curve.equations, curve.at(s), None).ways]
    return np.array(found).reshape(-1, curve.chain.dof)


def _trace(
    equations: Equations,
    start: Point,
    direction: FloatArray,
    *,
    step: float,
    max_steps: int,
) -> SolutionCurve:
    forth, words, branches = march(equations, start, direction, step, max_steps)
    closed = words == "closed"
    points, at_start = forth, 0
    crossings = branches
    if not closed:
        back, words_back, branches_back = march(equations, start, -direction, step, max_steps)
        points = [Point(p.q, -p.t, p.strength) for p in back[:0:-1]] + forth
        at_start = len(back) - 1
        crossings = [at_start - i - 1 for i in branches_back] + [at_start + i for i in branches]
        words = words if words == words_back else f"{words_back}; {words}"
    q, t = np.array([p.q for p in points]), np.array([p.t for p in points])
    s = lengths(q, t)
    between = np.array([0.5 * (s[i] + s[i + 1]) for i in sorted(crossings)])
    return SolutionCurve(equations.chain, equations.target, q, s, t, closed, words, between.reshape(-1), equations.held)
