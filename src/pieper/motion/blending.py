"""Motions through way points that do not stop at each: corners are rounded where that is free, and the whole is timed.

Straight edges that were checked stay as they are. Near a corner the path leaves the one edge at a distance d and comes to the other at the
same distance behind it. With path length x in the measure of the speed limits, directions d_1 and d_2 of the edges, and u running
from 0 to 1 over the 2 d between::

    q'(x) = d_1 + (d_2 - d_1) (3 u^2 - 2 u^3),

which integrates to the edge again, since the smooth step is as much above one half as it is below. So q'' is continuous and
q''' bounded, the curve stays between the edges, and at most ``1.5 |d_2 - d_1| / 2d`` is its bend.

A rounded corner leaves the edges that were checked, so it is checked itself: its chords, by `pieper.motion.edges`, so many that no point of
the arm is farther from them than a hundredth of the distance that is kept, or 0.1 mm. Where it is not free, a smaller one is tried, and
in the end the motion rests at the corner. The motion is timed as in `pieper.motion.timing`: within a straight edge and within a rounded
corner the bounds of path speed, acceleration and jerk are constant, and Ruckig finds the quickest profile of each.
"""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pieper.errors import ArrayError
from pieper.kinematics.joints import as_joints
from pieper.motion._profile import along, profile
from pieper.motion._retiming import held, joined
from pieper.motion._windows import Bounds, bounds, duration, sizes_at
from pieper.motion.limits import JointLimits, TcpLimits
from pieper.motion.timing import time_waypoints
from pieper.motion.trajectory import Trajectory

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

    from numpy.typing import ArrayLike

    from pieper.motion.edges import EdgeCheck
    from pieper.spatial._checks import FloatArray

_FRACTIONS = (1.0, 0.75, 0.55, 0.4, 0.28, 0.2, 0.12, 0.06)
"""Of the room that a corner has, the distances from it that are tried."""
_BACK = -0.9  # cosine between edges below which the motion turns back, and rests
_SHARES = ((0.3, 0.3, 0.3), (0.6, 0.3, 0.3), (0.6, 0.6, 0.2), (0.9, 0.6, 0.1), (0.97, 0.85, 0.05))
"""Of the limits, what a corner may use at constant path speed, as in `pieper.motion.timing`; the last is to coast through it."""
_OFF = 1e-4  # [m] a rounded corner from the chords that are checked, at most
_OFF_SHARE = 0.01  # of what is kept
_CHORDS = 256
_PLACES = 17  # of an edge or a corner, at which the tip is looked at
_PARTS = 8  # of an edge, when the tip has limits
_REPEATED = 1e-9  # [s of motion at the speed limits]


class Blended(NamedTuple):
    """A motion through way points.

    Attributes
    ----------
    trajectory : Trajectory
        With velocities and accelerations, from rest to rest, within every limit.
    rounded : (m,) array
        How far from each way point the motion leaves its edges, in seconds at the speed limits; 0 where it rests or is straight.
    off : float
        How far any point of the arm is at most from the ways that were checked [m].
    at_rest : float
        How long the motion would take with a rest at each way point [s].
    """

    trajectory: Trajectory
    rounded: FloatArray
    off: float
    at_rest: float


def time_blended(
    edges: EdgeCheck,
    waypoints: ArrayLike,
    *,
    max_velocity: ArrayLike | None = None,
    max_acceleration: ArrayLike | None = None,
    max_jerk: ArrayLike | None = None,
    tcp: TcpLimits | None = None,
    rest_at: Collection[int] = (),
) -> Blended:
    """A quick jerk-limited motion along edges that are free, that rounds corners where that is free too.

    Parameters
    ----------
    edges : EdgeCheck
        Of the collision model in which the edges are free. Only rounded corners are checked.
    waypoints : (m, n) array
        Joint values [rad or m] within the limits.
    max_velocity, max_acceleration, max_jerk : float or (n,) array, optional
        Limits of the joints and what holds without them: see `pieper.motion.limits.JointLimits.of`.
    tcp : TcpLimits, optional
        Limits of the tip.
    rest_at : collection of int
        Way points at which the motion rests, whatever is free there.

    Returns
    -------
    Blended
        Never slower than with a rest at each way point.

    Raises
    ------
    ArrayError, MotionError
        See `pieper.motion.timing.time_waypoints`.
    MissingExtraError
        Ruckig is not installed.
    """
    chain = edges.model.chain
    given = {"max_velocity": max_velocity, "max_acceleration": max_acceleration, "max_jerk": max_jerk}
    limits = JointLimits.of(chain, **given)
    points = as_joints(chain, waypoints, name="waypoints")
    resting = time_waypoints(chain, points, **given, tcp=tcp)
    wrong = [k for k in rest_at if not 0 <= k < len(points)]
    if wrong:
        raise ArrayError(f"rest_at must be way points from 0 to {len(points) - 1}, got {wrong[0]}")
    apart = np.linalg.norm(np.diff(points, axis=0) / limits.velocity, axis=1) > _REPEATED
    kept = np.concatenate([[0], np.flatnonzero(apart) + 1])
    rounded = np.zeros(len(points))
    if len(kept) > 2:
        stops = {int(np.searchsorted(kept, k, side="right")) - 1 for k in rest_at}
        task = _Corners(edges, points[kept], limits, tcp or TcpLimits(), stops)
        task.choose()
        if task.distances.any() and (made := task.trajectory()).duration < resting.duration:
            rounded[kept] = task.distances
            return Blended(made, rounded, task.off(), resting.duration)
    return Blended(resting, rounded, 0.0, resting.duration)


class _Piece(NamedTuple):
    """A straight stretch or a rounded corner: its length, where it begins, and the directions before and after it."""

    length: float
    start: FloatArray
    before: FloatArray
    after: FloatArray

    @property
    def coefficients(self) -> FloatArray:
        """(5, n) of powers 4 to 0 of the length from its start."""
        turn = self.after - self.before
        size = self.length
        rows = [-turn / (2.0 * size**3), turn / size**2, np.zeros_like(turn), self.before, self.start]
        return np.array(rows)

    def at(self, x: FloatArray, order: int = 0) -> FloatArray:
        """Derivatives at lengths x, (k, n)."""
        c = self.coefficients
        for _ in range(order):
            c = c[:-1] * np.arange(len(c) - 1, 0, -1)[:, None]
        return np.array([np.polyval(column, x) for column in c.T]).T


class _Corners:
    """How far each corner is rounded."""

    def __init__(
        self, edges: EdgeCheck, points: FloatArray, limits: JointLimits, tcp: TcpLimits, stops: Collection[int]
    ) -> None:
        self.edges, self.points, self.limits, self.tcp = edges, points, limits, tcp
        steps = np.diff(points, axis=0)
        self.lengths = np.linalg.norm(steps / limits.velocity, axis=1)
        self.directions = steps / self.lengths[:, None]
        self.distances = np.zeros(len(points))
        self._free: dict[tuple[int, float], bool] = {}
        self._off: dict[tuple[int, float], float] = {}
        self._sizes: dict[tuple[Any, ...], list[tuple[float, list[FloatArray], FloatArray]]] = {}
        model = edges.model
        self._far = np.abs(model.chain.coupling).T @ model.lever.max(axis=1, initial=0.0)  # [m] points move by a joint
        self._may = np.zeros(len(points), dtype=bool)
        for k in range(1, len(points) - 1):
            a, b = self.directions[k - 1] / limits.velocity, self.directions[k] / limits.velocity
            self._may[k] = k not in stops and float(a @ b) > _BACK

    def choose(self) -> None:
        """Round corner after corner as far as the motion gets quicker by it and the corner is free."""
        last = len(self.points) - 1
        for _ in range(2):
            changed = False
            for k in map(int, np.flatnonzero(self._may)):
                before = self.lengths[k - 1] * (0.95 if k == 1 else 0.5)
                after = self.lengths[k] * (0.95 if k == last - 1 else 0.5)
                best, least = float(self.distances[k]), self._around(k)
                for fraction in _FRACTIONS:
                    distance = fraction * min(before, after)
                    self.distances[k] = distance
                    time = self._around(k)
                    if time < least - 1e-9 and self._corner_is_free(k, distance):
                        best, least, changed = distance, time, True
                self.distances[k] = best
            if not changed:
                break

    def off(self) -> float:
        """How far from the chords that were checked [m]."""
        return max((self._off[k, float(d)] for k, d in enumerate(self.distances) if d > 0.0), default=0.0)

    # --- geometry

    def _corner(self, k: int, distance: float) -> _Piece:
        before, after = self.directions[k - 1], self.directions[k]
        return _Piece(2.0 * distance, self.points[k] - distance * before, before, after)

    def _corner_is_free(self, k: int, distance: float) -> bool:
        if (k, distance) not in self._free:
            corner = self._corner(k, distance)
            bend = (
                float(np.abs(corner.after - corner.before) @ self._far) * 1.5 / corner.length
            )  # [m] by length squared
            allowed = max(_OFF_SHARE * self.edges.kept, _OFF)
            count = int(np.ceil(np.sqrt(bend * corner.length**2 / (8.0 * allowed)))) + 1
            off = bend * (corner.length / count) ** 2 / 8.0
            q = corner.at(np.linspace(0.0, corner.length, count + 1))
            self._off[k, distance] = off
            self._free[k, distance] = count <= _CHORDS and self.edges.path_is_free(q)
        return self._free[k, distance]

    def _pieces(self, first: int, last: int) -> list[_Piece]:
        """From way point to way point, at both of which the motion rests."""
        found = []
        for k in range(first, last):
            before, after = self.distances[k], self.distances[k + 1]
            length = self.lengths[k] - before - after
            if length > _REPEATED:
                direction = self.directions[k]
                found.append(_Piece(length, self.points[k] + before * direction, direction, direction))
            if after > 0.0:
                found.append(self._corner(k + 1, after))
        return found

    # --- time

    def _windows(self, piece: _Piece, share: tuple[float, float, float]) -> list[Bounds]:
        key = (piece.length, piece.start.tobytes(), piece.before.tobytes(), piece.after.tobytes())
        if key not in self._sizes:
            straight = bool((piece.before == piece.after).all())
            parts = _PARTS if straight and self.tcp.say_something else 1
            self._sizes[key] = [self._size(piece, part, parts, straight) for part in range(parts)]
        return [
            bounds(size, first, second, third, velocity, acceleration, jerk, share)
            for size, (first, second, third), (velocity, acceleration, jerk) in self._sizes[key]
        ]

    def _size(self, piece: _Piece, part: int, parts: int, straight: bool) -> tuple[float, list[FloatArray], FloatArray]:
        """Length of a window, the largest sizes of three derivatives in it, and their limits."""
        size = piece.length / parts
        turn = np.abs(piece.after - piece.before)
        first = np.maximum(np.abs(piece.before), np.abs(piece.after))
        sizes = [first, 1.5 * turn / piece.length, 6.0 * turn / piece.length**2]
        if straight:
            sizes[1:] = [np.zeros_like(first)] * 2
        most = np.stack([self.limits.velocity, self.limits.acceleration, self.limits.jerk])
        if self.tcp.say_something:
            x = np.linspace(part * size, (part + 1) * size, _PLACES)
            of_tip, most = sizes_at(self.limits, self.tcp, *(piece.at(x, order) for order in range(4)))
            rows = len(first)
            sizes = [np.append(own, tip[rows:].max(axis=1)) for own, tip in zip(sizes, of_tip, strict=True)]
        return size, sizes, most

    def _stretches(self) -> list[tuple[int, int]]:
        rests = np.flatnonzero(self.distances == 0.0)
        return [(int(a), int(b)) for a, b in itertools.pairwise(rests)]

    def _around(self, k: int) -> float:
        """Time of the stretches that way point k is part of [s]."""
        return sum(
            min(map(duration, self._cuts(self._pieces(first, last))))
            for first, last in self._stretches()
            if first <= k <= last
        )

    def _cuts(self, pieces: list[_Piece]) -> list[list[Bounds]]:
        """The bounds along the pieces, for each way to share the limits."""
        return [[window for piece in pieces for window in self._windows(piece, share)] for share in _SHARES]

    def trajectory(self) -> Trajectory:
        """The motion."""
        made = [self._timed(self._pieces(a, b), self.points[a], self.points[b]) for a, b in self._stretches()]
        return joined(self.limits.chain, made, self.points[-1])

    def _timed(self, pieces: list[_Piece], start: FloatArray, end: FloatArray) -> Trajectory:
        from scipy.interpolate import PPoly

        knots = np.concatenate([[0.0], np.cumsum([piece.length for piece in pieces])])
        curve: Callable[..., Any] = PPoly(np.stack([piece.coefficients for piece in pieces], axis=1), knots)
        quickest = min(self._cuts(pieces), key=duration)
        made = along(curve, knots, profile(quickest), self.limits)
        q = np.array(made.q)
        q[0], q[-1] = start, end  # but for rounding they are
        return held(Trajectory(made.t, q, made.dq, made.ddq, made.joint_names), self.limits, self.tcp)
