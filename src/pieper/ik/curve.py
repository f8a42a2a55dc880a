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
from math import sqrt
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pieper.errors import ArrayError
from pieper.ik.family import size_of
from pieper.ik.target import Target, pose
from pieper.kinematics.joints import as_joints, periodic_joints
from pieper.spatial._checks import FloatArray
from pieper.spatial.rotation import as_rotation_vector

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from pieper.model.chain import Chain

RESIDUAL = 1e-11
"""What may be left of the rows of a target at a point of a curve [m and rad]."""

RESIDUAL_OF_FAMILIES = 9e-10
"""The same for curves at singular poses: those of an arm whose description rounds right angles are curves only so far."""

_TURN = 2.0 * np.pi
_SOLVES = 1e-5  # [m and rad] a starting point that misses by more is not taken for a solution
_PROBE = 1e-2  # length of the step that tells a curve from an isolated double solution
_SIDEWAYS = 0.1  # a step whose end is brought back across the curve by more than this share of it was too long
_BEND = 0.2  # rad, most that the tangent may turn in a step
_OTHER_WAY = 0.95  # curves that leave a branch point at a larger cosine are one
_STRAIGHT = 0.06  # rad, a tangent that turns by less in a step allows a longer one
_SHORTEST = 1e-7  # steps below this are given up
# The least singular value that should not vanish falls towards branch points, and is small where two curves run side by side.
_CAUTION = 0.5  # a step may be this share of the way to where it would be 0
_ALONGSIDE = 4.0  # a step may be this times it
_APART = 0.5  # the end of a step may be brought back across the curve by this times it, less than to the next curve
_NULL = 1e-4  # singular values up to this are those of the null space at a branch point, which is not known to the last digit
_BRANCHING = 1e-5  # below this singular value there is a branch point ahead, closer than its curves can be told apart
_SURFACE = "the solutions near q form a surface, not a curve; hold a joint or ask for more rows"
_NO_WAY_ON = "no way on"
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


class Equations:
    """The rows of one target as equations ``r(q) = 0``, lengths in units of the size of the arm.

    Parameters
    ----------
    chain : Chain
    target : Target
        One target.
    held : (int, float), optional
        A joint, and the value that it is to keep: one more row.
    """

    def __init__(self, chain: Chain, target: Target, held: tuple[int, float] | None = None) -> None:
        self.chain = chain
        self.target = target
        self.held = held
        self.rank = chain.dof - 1
        self.length = size_of(chain)
        T = np.asarray(target.T_base_tip)
        self._p, self._R = T[:3, 3], T[:3, :3]
        self._R_T = np.ascontiguousarray(self._R.T)
        weights = np.asarray(target.weights) != 0.0
        self._position = np.flatnonzero(weights[:3])
        self._turned = target.position_axes == "tool"
        self._axis: FloatArray | None = None
        if target.axis is not None:
            self._axis = np.asarray(target.axis)
            self._wanted = self._R @ self._axis
            self._across = np.linalg.svd(self._wanted[None])[2][1:]
            self._rotation = np.arange(2)
        else:
            self._rotation = np.flatnonzero(weights[3:])
            self._rotation_axes = self._R_T if target.rotation_axes == "tool" else np.eye(3)
        self.whole = bool(weights.all()) and self._axis is None and not self._turned
        self.count = len(self._position) + len(self._rotation) + (held is not None)
        self.tolerance = RESIDUAL / max(1.0, self.length)
        singular = self.count > self.rank
        self.accepted = RESIDUAL_OF_FAMILIES / max(1.0, self.length) if singular else self.tolerance

    def __call__(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals (..., m) and their derivative (..., m, n) at joint values (..., n)."""
        rows, derivative = self._rows(q)
        if self.held is None:
            return rows, derivative
        joint, value = self.held
        one = np.zeros((*derivative.shape[:-2], 1, derivative.shape[-1]))
        one[..., joint] = 1.0
        return np.concatenate([rows, q[..., [joint]] - value], axis=-1), np.concatenate([derivative, one], axis=-2)

    def _rows(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        native = self.chain.native
        T, J = native.fk(q), native.jacobian(q)
        off = (T[..., :3, 3] - self._p) / self.length
        linear, angular = J[..., :3, :] / self.length, J[..., 3:, :]
        if self.whole:  # for small angles the rotation vector is the antisymmetric part
            left = (T[..., :3, :3] @ self._R_T).reshape(*q.shape[:-1], 9)
            turn = 0.5 * (left[..., [7, 2, 3]] - left[..., [5, 6, 1]])
            return np.concatenate([off, turn], axis=-1), np.concatenate([linear, angular], axis=-2)
        if self._turned:
            off, linear = off @ self._R, self._R_T @ linear
        turn, turning = self._rotation_rows(T[..., :3, :3], angular)
        rows = np.concatenate([off[..., self._position], turn], axis=-1)
        return rows, np.concatenate([linear[..., self._position, :], turning], axis=-2)

    def _rotation_rows(self, R: FloatArray, angular: FloatArray) -> tuple[FloatArray, FloatArray]:
        if self._axis is not None:  # what is left across the wanted direction d: B (a x d)
            a = R @ self._axis
            along = (angular * self._wanted[:, None]).sum(axis=-2)
            turning = (self._across @ a[..., None]) * along[..., None, :]
            turning -= (a @ self._wanted)[..., None, None] * (self._across @ angular)
            return np.asarray(np.cross(a, self._wanted) @ self._across.T), np.asarray(turning)
        if not len(self._rotation):
            return np.asarray(R[..., 0, :0]), np.asarray(angular[..., :0, :])
        e = as_rotation_vector(R @ self._R_T)
        turning = self._rotation_axes @ _left_jacobian_inverse(e) @ angular
        return np.asarray((e @ self._rotation_axes.T)[..., self._rotation]), turning[..., self._rotation, :]

    def errors(self, q: FloatArray) -> FloatArray:
        """(...): the largest error in any row [m or rad]; opposite orientations are told apart."""
        rows, _ = self(q)
        units = np.where(np.arange(self.count) < len(self._position), self.length, 1.0)
        largest = np.asarray(np.abs(rows * units).max(axis=-1))
        R = self.chain.native.fk(q)[..., :3, :3]
        if self.whole:
            angle = np.linalg.norm(R - self._R, axis=(-2, -1)) / np.sqrt(2.0)
            return np.asarray(np.maximum(largest, angle))
        if self._axis is not None:
            return np.asarray(np.maximum(largest, np.linalg.norm(R @ self._axis - self._wanted, axis=-1)))
        return largest

    def correct(self, q: FloatArray, iterations: int = 12) -> tuple[FloatArray, FloatArray, float, bool]:
        """The point of the curve near `q` (n,), its tangent (n,), the least singular value that should not vanish, and whether
        the residual was met.
        """
        before = np.inf
        rank = self.rank
        for _ in range(iterations):
            r, J = self(q)
            U, s, Vt = np.linalg.svd(J)
            worst = sqrt(float(r @ r))
            if worst <= self.tolerance:
                return q, Vt[rank], float(s[rank - 1]), True
            if not worst < 0.9 * before or s[rank - 1] <= 0.0:
                break
            before = worst
            q = q - ((r @ U[:, :rank]) / s[:rank]) @ Vt[:rank]
        return q, Vt[rank], float(s[rank - 1]), worst <= self.accepted

    def correct_many(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """As `correct`, for points (k, n) that are on the curve but for interpolation: the points and their tangents."""
        rank = self.rank
        for _ in range(4):
            r, J = self(q)
            U, s, Vt = np.linalg.svd(J)
            if (r * r).sum(axis=-1).max(initial=0.0) <= (0.1 * self.tolerance) ** 2:
                break
            across = np.where(s[:, :rank] > 1e-9, 1.0 / np.maximum(s[:, :rank], 1e-9), 0.0)
            weights = across * (np.swapaxes(U[:, :, :rank], -1, -2) @ r[..., None])[..., 0]
            q = q - (weights[:, None] @ Vt[:, :rank])[:, 0]
        return q, Vt[:, rank]


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
                (across <= _BEND * spacing + tolerance) & (np.abs(along[:, 0]) <= spacing + tolerance)
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
    begin = _begin(equations, start, wanted)
    if begin is None:
        return None
    curve = _trace(*begin, step=step, max_steps=max_steps)
    # at a singular pose solutions beside each other within rounding are no curve, and soon leave the target
    return None if curve.ends == _NO_WAY_ON and equations.count > equations.rank else curve


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


def _left_jacobian_inverse(e: FloatArray) -> FloatArray:
    """(..., 3, 3): the rate of a rotation vector for angular velocities in base axes (Barfoot, State Estimation for Robotics, eq. 7.83)."""
    angle = np.linalg.norm(e, axis=-1)[..., None, None]
    zero = np.zeros_like(e[..., 0])
    x, y, z = e[..., 0], e[..., 1], e[..., 2]
    E = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*e.shape, 3)
    small = angle < 1e-2
    safe = np.where(small, 1.0, angle)
    c = np.where(small, 1.0 / 12.0 + angle**2 / 720.0, (1.0 - 0.5 * safe / np.tan(0.5 * safe)) / safe**2)
    return np.asarray(np.eye(3) - 0.5 * E + c * (E @ E))


class _Point(NamedTuple):
    q: FloatArray
    t: FloatArray
    strength: float  # the least singular value that vanishes only where curves cross


_Begin = tuple[Equations, _Point, FloatArray]


def _begin(equations: Equations, q: FloatArray, wanted: FloatArray | None) -> _Begin | None:
    """A regular point of the curve, and the direction to go; None where the solution is isolated."""
    rank = equations.rank
    here, t, strength, met = equations.correct(q)
    if not met or strength <= _BRANCHING:
        return _leave_branch_point(equations, q, wanted)
    if wanted is not None and float(t @ wanted) < 0.0:
        t = -t
    if equations.count > rank:
        _, J = equations(here)
        if np.linalg.svd(J, compute_uv=False)[rank] > _BRANCHING or not _goes_on(equations, here, t):
            return None
    return equations, _Point(here, t, strength), t


def _goes_on(equations: Equations, q: FloatArray, t: FloatArray) -> bool:
    """True when a step along the tangent, one way or the other, can be brought back to a solution."""
    for h in (_PROBE, -_PROBE):
        end, _, _, met = equations.correct(q + h * t)
        if met and np.linalg.norm(end - q) > 0.5 * _PROBE:
            return True
    return False


def _leave_branch_point(equations: Equations, q: FloatArray, wanted: FloatArray | None) -> _Begin | None:
    """The null space has two dimensions or more at `q`: take a step in it that leads to a curve."""
    found = _ways_from(equations, q, wanted)
    if found.flat:
        raise ArrayError(_SURFACE)
    if found.ways:
        return found.ways[0]
    begin = _along_degenerate(equations, q, wanted) if equations.held is None else None
    if begin is None and found.others:
        raise ArrayError(_SURFACE)
    return begin


class _Ways(NamedTuple):
    ways: list[_Begin]  # curves, the one that bends least first
    flat: bool  # most directions lead to solutions: a surface
    others: bool  # there are solutions nearby


def _ways_from(equations: Equations, q: FloatArray, wanted: FloatArray | None = None) -> _Ways:
    """The curves that leave a point where the null space has two dimensions or more, by a step in each of many directions."""
    _, J = equations(q)
    values = np.zeros(equations.chain.dof)
    _, s, Vt = np.linalg.svd(J)
    values[: len(s)] = s
    null = Vt[values <= _NULL]
    if len(null) < 2:
        return _Ways([], False, False)
    if wanted is not None and np.linalg.norm(null @ wanted) > 0.0:
        along = (null @ wanted) @ null
        directions = [along / np.linalg.norm(along)]
    else:
        angles = np.arange(24) * (np.pi / 24) + 0.01
        pairs = [(a, b) for a in range(len(null)) for b in range(a + 1, len(null))]
        directions = [np.cos(x) * null[a] + np.sin(x) * null[b] for a, b in pairs for x in angles]
    found: list[tuple[float, _Begin]] = []
    flat = others = 0
    for d in directions:
        end, t, strength, met = equations.correct(q + _PROBE * d, 40)
        if not met:
            continue
        moved = float(np.linalg.norm(end - q))
        sideways = float(np.linalg.norm(end - q - _PROBE * d))
        others += moved > 0.3 * _PROBE
        flat += strength <= _BRANCHING and sideways < 0.1 * _PROBE
        if strength > _BRANCHING and sideways < 0.5 * _PROBE and abs(float(t @ (end - q))) > 0.9 * moved:
            out = t if float(t @ d) > 0.0 else -t
            found.append((sideways, (equations, _Point(end, t, strength), out)))
    ways: list[_Begin] = []
    for _, way in sorted(found, key=lambda entry: entry[0]):
        if all(abs(float(way[2] @ other[2])) < _OTHER_WAY for other in ways):
            ways.append(way)
    return _Ways(ways, not ways and 3 * flat > len(directions), others > 0)


def crossing(curve: SolutionCurve) -> FloatArray:
    """Points (k, n) of the curves that cross at the branch points of one, a little away from it; its own among them."""
    found = [way[1].q for s in curve.branch_points for way in _ways_from(curve.equations, curve.at(s), None).ways]
    return np.array(found).reshape(-1, curve.chain.dof)


def _along_degenerate(equations: Equations, q: FloatArray, wanted: FloatArray | None) -> _Begin | None:
    """A curve whose Jacobian has one rank less all along, as that of a straight arm; with one joint held it has not."""
    best, most = None, _BRANCHING
    for joint in range(equations.chain.dof):
        holding = Equations(equations.chain, equations.target, (joint, float(q[joint])))
        here, t, strength, met = holding.correct(q)
        if met and strength > most and _goes_on(holding, here, t):
            back = wanted is not None and float(t @ wanted) < 0.0
            best, most = (holding, _Point(here, t, strength), -t if back else t), strength
    return best


def _trace(
    equations: Equations,
    begin: _Point,
    direction: FloatArray,
    *,
    step: float,
    max_steps: int,
) -> SolutionCurve:
    forth, words, branches = _march(equations, begin, direction, step, max_steps)
    closed = words == "closed"
    points, at_start = forth, 0
    crossings = branches
    if not closed:
        back, words_back, branches_back = _march(equations, begin, -direction, step, max_steps)
        points = [_Point(p.q, -p.t, p.strength) for p in back[:0:-1]] + forth
        at_start = len(back) - 1
        crossings = [at_start - i - 1 for i in branches_back] + [at_start + i for i in branches]
        words = words if words == words_back else f"{words_back}; {words}"
    q, t = np.array([p.q for p in points]), np.array([p.t for p in points])
    s = _lengths(q, t)
    between = np.array([0.5 * (s[i] + s[i + 1]) for i in sorted(crossings)])
    return SolutionCurve(equations.chain, equations.target, q, s, t, closed, words, between.reshape(-1), equations.held)


def _lengths(q: FloatArray, t: FloatArray) -> FloatArray:
    """Length along a curve through points with unit tangents, as that of the cubic between neighbours."""
    chord = np.diff(q, axis=0)
    mean = 0.25 * (t[1:] + t[:-1])
    h = np.linalg.norm(chord, axis=1)
    for _ in range(30):
        h = np.linalg.norm(1.5 * chord - h[:, None] * mean, axis=1)
    return np.concatenate([[0.0], np.cumsum(h)])


def _march(
    equations: Equations, begin: _Point, direction: FloatArray, step: float, max_steps: int
) -> tuple[list[_Point], str, list[int]]:
    """Points one way along the curve, why it ended, and after which points others cross."""
    chain = equations.chain
    turns = periodic_joints(chain)
    lower, upper = np.where(turns, -np.inf, chain.limits[:, 0]), np.where(turns, np.inf, chain.limits[:, 1])
    first = _Point(begin.q, direction, begin.strength)
    points = [first]
    crossings: list[int] = []
    here, bend, fall = first, np.zeros_like(direction), 1.0
    h = 0.5 * step
    for _ in range(max_steps):
        if here.strength <= _BRANCHING:
            end = _across_branch_point(equations, here, bend)
            if end is None:
                return points, "branch point", crossings
            crossings.append(len(points) - 1)
        else:
            ahead = _CAUTION * here.strength / fall if fall > 0.0 else np.inf
            h = min(h, step, max(min(_ALONGSIDE * here.strength, ahead), _BRANCHING))
            end, h = _step(equations, here, bend, h)
            if end is None:
                return points, _NO_WAY_ON, crossings
        last = _closes(equations, first, here, end, turns) if len(points) > 2 else None
        if last is not None:
            points.append(last)
            return points, "closed", crossings
        moved = end.q - here.q
        length = float(np.linalg.norm(moved))
        change = end.t - here.t
        bend, fall = change / length, (here.strength - end.strength) / length
        h = 1.5 * length if float(np.linalg.norm(change)) < _STRAIGHT else length
        points.append(end)
        here = end
        if ((end.q < lower) | (end.q > upper)).any():
            joint = chain.joint_names[int(np.argmax((end.q < lower) | (end.q > upper)))]
            return points, f"beyond the limit of {joint}", crossings
    return points, f"{max_steps} steps", crossings


def _step(equations: Equations, here: _Point, bend: FloatArray, h: float) -> tuple[_Point, float] | tuple[None, float]:
    """The next point, with the length of the step that led there."""
    while h >= _SHORTEST:
        ahead = here.q + h * here.t + (0.5 * h * h) * bend
        q, t, strength, met = equations.correct(ahead, 6)
        if met:
            along = float(t @ here.t)
            if along < 0.0:
                t, along = -t, -along
            sideways = q - ahead
            most = min(_SIDEWAYS * h, _APART * here.strength)
            if along >= 1.0 - 0.5 * _BEND * _BEND and float(sideways @ sideways) <= most * most:
                return _Point(q, t, strength), h
        h *= 0.5
    return None, h


def _across_branch_point(equations: Equations, here: _Point, bend: FloatArray) -> _Point | None:
    """The first point beyond a branch point, on the curve that goes straight on."""
    for h in (1e-4, 3e-4, 1e-3, 3e-3, 1e-2):
        end, _ = _step(equations, here, bend, h)
        if end is not None and end.strength > 3.0 * _BRANCHING and np.linalg.norm(end.q - here.q) > 0.5 * h:
            return end
    return None


def _closes(equations: Equations, first: _Point, here: _Point, end: _Point, turns: NDArray[np.bool_]) -> _Point | None:
    """The first point again, as it is come to between `here` and `end`; None when it is not."""
    to_first = first.q - here.q
    to_first = to_first - np.where(turns, _TURN * np.round(to_first / _TURN), 0.0)
    moved = end.q - here.q
    length = float(np.linalg.norm(moved))
    ahead = float(to_first @ moved) / length
    near = float(np.linalg.norm(to_first - (ahead / length) * moved)) <= 0.3 * length
    if not near or not 0.0 < ahead <= length * (1.0 + 1e-6) or float(here.t @ first.t) < 0.5:
        return None
    # the point of the curve that passes the first one most closely
    u, at = ahead / length, here.q
    for _ in range(6):
        cubic = u * u * (3 - 2 * u) * moved + length * (u * (1 - u) ** 2 * here.t - u * u * (1 - u) * end.t)
        at, _, strength, met = equations.correct(here.q + cubic)
        left = to_first - (at - here.q)
        missed = float(np.linalg.norm(left))
        if met and missed <= max(1e-8, 10.0 * equations.accepted / strength):
            return _Point(here.q + to_first, first.t, first.strength)
        u += float(left @ first.t) / length
    return None
