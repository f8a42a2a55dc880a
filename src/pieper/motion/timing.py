"""When to be where: the quickest motion along joint lines and joint paths that keeps velocity, acceleration and jerk within limits.

`time_waypoints` goes straight in joint space from point to point and rests at each. Ruckig finds the quickest jerk-limited profile of every
edge. All joints are in phase, on the straight line, so that an edge that was checked stays checked.

`time_path` follows a `pieper.motion.path_ik.JointPath`. A cubic spline q(x) goes through its joint values, over their own length x in the
measure of the speed limits, so that nothing diverges where joints turn fast for little motion of the tip. With the path speed v = dx/dt
and its derivatives a and j::

    dq   = q' v
    ddq  = q'' v^2 + q' a
    dddq = q''' v^3 + 3 q'' v a + q' j,

and likewise for the tip. The path is cut into windows. In each, bounds of v, a and j are taken that keep every limit for the largest derivatives
in the window; a backward and a forward pass find the largest speeds between windows that can be reached and left again within
these bounds, with no acceleration there; and Ruckig finds the quickest profile of each window. So every limit holds by construction,
slow where the path asks for it, as near a straight wrist. Of several ways to cut, the quickest is taken.

At last the motion is measured: the extrema of the polynomials between its points, and the tip at sixteen places between each two, with parabolas through them. The whole
motion is then made slower by what rounding or interpolation exceed a limit, or quicker by what the windows left. What is returned holds
the limits.

Ruckig plans every profile in this process. Its way points, which it would send over the network, are not used.

References
----------
Berscheid and Kroeger 2021, Jerk-limited real-time trajectory generation with arbitrary target states, Robotics: Science and Systems.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from math import sqrt
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pieper.errors import ArrayError, MissingExtraError, MotionError
from pieper.kinematics.jacobian import jacobian, jacobian_rate
from pieper.kinematics.joints import as_joints
from pieper.motion import polynomial
from pieper.motion.limits import JointLimits
from pieper.motion.trajectory import Trajectory

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from pieper.model.chain import Chain
    from pieper.motion.path_ik import JointPath
    from pieper.spatial._checks import FloatArray

_WINDOWS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32)
_SHARES = ((0.3, 0.3, 0.3), (0.6, 0.3, 0.3), (0.6, 0.6, 0.2))
"""Of an acceleration limit what ``q'' v^2`` may use, and of a jerk limit what ``q''' v^3`` and ``3 q'' v a`` may."""
_SWEEPS = 2  # of joining windows
_FINEST = 1e-3  # [s] least time between two points where one can be left out: below it, rounding shows in the jerk
_COARSEST = 0.01  # [s] most time between two points, or, of long motions,
_SPANS = 10_000  # this part of it
_LONGEST = 1e7  # [s] of motion along a path; far beyond it the times of its points cannot be told apart
_SAFE = 1.0 - 1e-8  # of a limit: what is left to rounding
_TRIALS = 12  # of a duration at which every limit holds; the last leaves 4 % to rounding
_AT_ONCE = 2e-3  # [s] full speed and full acceleration are come to in no less, whatever the limits: rounding would show in the jerk
_REPEATED = 1e-9  # [s of joint motion at the speed limits] points nearer than this are one


@dataclass(frozen=True)
class TcpLimits:
    """What the tip may do; infinite where nothing is said.

    Attributes
    ----------
    velocity, acceleration, jerk : float
        Of its origin [m/s, m/s^2, m/s^3].
    angular_velocity, angular_acceleration : float
        [rad/s, rad/s^2]
    """

    velocity: float = np.inf
    acceleration: float = np.inf
    jerk: float = np.inf
    angular_velocity: float = np.inf
    angular_acceleration: float = np.inf

    def __post_init__(self) -> None:
        for name in ("velocity", "acceleration", "jerk", "angular_velocity", "angular_acceleration"):
            value = getattr(self, name)
            if not (isinstance(value, (int, float, np.number)) and value > 0.0):
                raise ArrayError(f"the limit {name} of the tip must be above 0, got {value!r}")

    @property
    def say_something(self) -> bool:
        """Whether there is a limit at all."""
        values = (self.velocity, self.acceleration, self.jerk, self.angular_velocity, self.angular_acceleration)
        return bool(np.isfinite(values).any())


class Usage(NamedTuple):
    """The largest share of each limit that a trajectory uses; 1 is all of it."""

    velocity: float
    acceleration: float
    jerk: float
    tcp_velocity: float
    tcp_acceleration: float
    tcp_jerk: float

    @property
    def stretch(self) -> float:
        """By which factor the trajectory would have to be slower to hold every limit; below 1 where it could be quicker."""
        return float(
            max(
                self.velocity,
                self.tcp_velocity,
                np.sqrt(max(self.acceleration, self.tcp_acceleration)),
                np.cbrt(max(self.jerk, self.tcp_jerk)),
            )
        )


def usage(trajectory: Trajectory, limits: JointLimits, tcp: TcpLimits | None = None) -> Usage:
    """How much of its limits a trajectory uses.

    Parameters
    ----------
    trajectory : Trajectory
        With velocities and accelerations, its columns in the order of the joints.
    limits : JointLimits
    tcp : TcpLimits, optional

    Returns
    -------
    Usage
        For the joints from the extrema of the polynomials; for the tip from sixteen places between each two points, and parabolas through them.
    """
    if len(trajectory.t) == 1:
        return Usage(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    shares = []
    for order, most in ((1, limits.velocity), (2, limits.acceleration), (3, limits.jerk)):
        c = trajectory.polynomials(order)
        least, greatest = polynomial.bounds(c)
        share = np.maximum(np.abs(least), np.abs(greatest)) / most
        near = share >= 0.9 * share.max()  # the bounds are a little wide: look closely where they matter
        places = polynomial.stationary(c[near])
        exact = np.abs(polynomial.evaluate(c[near][:, None, :], places)).max(axis=-1)
        share[near] = exact / np.broadcast_to(most, share.shape)[near]
        shares.append(float(share.max()))
    velocity, acceleration, jerk = shares
    return Usage(velocity, acceleration, jerk, *_tip_usage(limits.chain, trajectory, tcp or TcpLimits()))


def _tip_usage(chain: Chain, trajectory: Trajectory, tcp: TcpLimits) -> tuple[float, float, float]:
    if not tcp.say_something:
        return 0.0, 0.0, 0.0
    u = np.arange(16) / 16.0
    lengths = np.diff(trajectory.t)
    t = np.append((trajectory.t[:-1, None] + u * lengths[:, None]).ravel(), trajectory.t[-1])
    q, dq, ddq = trajectory.sample(t)
    twist, rate = _tip(chain, q, dq, ddq)
    speed = _peak(np.linalg.norm(twist[:, :3], axis=1)) / tcp.velocity
    spin = _peak(np.linalg.norm(twist[:, 3:], axis=1)) / tcp.angular_velocity
    linear = _peak(np.linalg.norm(rate[:, :3], axis=1)) / tcp.acceleration
    angular = _peak(np.linalg.norm(rate[:, 3:], axis=1)) / tcp.angular_acceleration
    jerk = 0.0
    if np.isfinite(tcp.jerk):
        c = trajectory.polynomials(3)
        which = np.append(np.repeat(np.arange(len(lengths)), 16), len(lengths) - 1)
        dddq = polynomial.evaluate(c[which], np.append(np.tile(u, len(lengths)), 1.0)[:, None])
        jerk = _peak(np.linalg.norm(_tip_jerk(chain, q, dq, ddq, dddq), axis=1)) / tcp.jerk
    return float(max(speed, spin)), float(max(linear, angular)), jerk


def _peak(f: FloatArray) -> float:
    """The largest value of a curve by its samples: that of the parabola through each and its neighbours, where it is the largest of the three."""
    if len(f) < 3:
        return float(f.max())
    before, here, after = f[:-2], f[1:-1], f[2:]
    top = (here >= before) & (here >= after)
    bend = 2.0 * here - before - after
    more = np.where(top & (bend > 0.0), (after - before) ** 2 / (8.0 * np.maximum(bend, 1e-300)), 0.0)
    return float(max(f.max(), (here + more).max()))


def _tip(chain: Chain, q: FloatArray, dq: FloatArray, ddq: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Twist and its derivative, (k, 6) each, base axes: ``J dq`` and ``J ddq + dJ dq``."""
    J, dJ = jacobian(chain, q), jacobian_rate(chain, q, dq)
    return (J @ dq[..., None])[..., 0], (J @ ddq[..., None] + dJ @ dq[..., None])[..., 0]


def _tip_jerk(chain: Chain, q: FloatArray, dq: FloatArray, ddq: FloatArray, dddq: FloatArray) -> FloatArray:
    """(k, 3) third derivative of the position: the acceleration along the third-order continuation of the motion, differenced."""
    sizes = (np.abs(d).max(axis=1) ** (1.0 / order) for order, d in ((1, dq), (2, ddq), (3, dddq)))
    h = (1e-4 / np.maximum(np.max(list(sizes), axis=0), 1e-3))[:, None]  # [s], in which the joints move 0.1 mrad

    def acceleration(e: FloatArray) -> FloatArray:
        ahead = q + e * (dq + e * (ddq / 2.0 + e * dddq / 6.0)), dq + e * (ddq + e * dddq / 2.0), ddq + e * dddq
        return _tip(chain, *ahead)[1][:, :3]

    return np.asarray((acceleration(h) - acceleration(-h)) / (2.0 * h))


# ---------------------------------------------------------------------------------------------------------------------
# straight lines in joint space


def time_waypoints(
    chain: Chain,
    waypoints: ArrayLike,
    *,
    max_velocity: ArrayLike | None = None,
    max_acceleration: ArrayLike | None = None,
    max_jerk: ArrayLike | None = None,
    tcp: TcpLimits | None = None,
) -> Trajectory:
    """The quickest jerk-limited motion straight from joint vector to joint vector, at rest at each.

    Parameters
    ----------
    chain : Chain
    waypoints : (m, n) array
        Joint values [rad or m] within the limits. One that is the one before it again is passed without a stop of its own.
    max_velocity, max_acceleration, max_jerk : float or (n,) array, optional
        Limits of the joints and what holds without them: see `pieper.motion.limits.JointLimits.of`.
    tcp : TcpLimits, optional
        An edge on which the tip would exceed them is slowed down as a whole.

    Returns
    -------
    Trajectory
        With velocities and accelerations. Its interpolation is Ruckig's profile itself, of constant jerk between the points.

    Raises
    ------
    ArrayError
        Malformed way points or limits.
    MotionError
        A way point out of the joint limits.
    MissingExtraError
        Ruckig is not installed.

    Examples
    --------
    >>> from pieper.model import catalog
    >>> arm = catalog.describe("ur5e").chain()
    >>> move = time_waypoints(arm, [[0, -1.5, 1.5, 0, 0, 0], [1, -1.5, 1.5, 0.5, 0, 0]], max_velocity=2, max_acceleration=8, max_jerk=80)
    >>> round(move.duration, 6), move.sample(move.duration / 2).q
    (0.85, array([ 0.5 , -1.5 ,  1.5 ,  0.25,  0.  ,  0.  ]))
    """
    limits = JointLimits.of(chain, max_velocity=max_velocity, max_acceleration=max_acceleration, max_jerk=max_jerk)
    points = as_joints(chain, waypoints, name="waypoints")
    if points.ndim != 2 or not len(points):
        raise ArrayError(f"waypoints must have shape (m, {chain.dof}) with at least one row, got {points.shape}")
    points = np.array([limits.check_position(q, name=f"waypoint {k}") for k, q in enumerate(points)])
    parts = [
        _edge(limits, tcp, a, b)
        for a, b in itertools.pairwise(points)
        if (np.abs(b - a) / limits.velocity).max() > _REPEATED
    ]
    return one_after_another(chain, parts, points[-1])


def _edge(limits: JointLimits, tcp: TcpLimits | None, start: FloatArray, goal: FloatArray) -> Trajectory:
    """One profile for the share of the way, under the limits that the joints leave it: the joints stay on the line whatever their limits.

    Ruckig's own synchronisation by phase gives up where the joint that takes longest is not the one that every limit
    comes from, and the joints then leave the line.
    """
    ruckig = _ruckig()
    way = goal - start
    moving = way != 0.0
    v, a, j = (
        float((most[moving] / np.abs(way[moving])).min())
        for most in (limits.velocity, limits.acceleration, limits.jerk)
    )
    asked = ruckig.InputParameter(1)
    asked.target_position = [1.0]
    a = min(a, v / _AT_ONCE)
    asked.max_velocity, asked.max_acceleration, asked.max_jerk = [v], [a], [min(j, a / _AT_ONCE)]
    found = _planned(ruckig, asked)
    profile = found.profiles[0][0]
    ends = np.concatenate([[0.0], np.cumsum(profile.t)])
    kept = np.concatenate([[True], np.diff(ends) > 1e-12])
    share, speed, change = (np.array(values)[kept] for values in (profile.p, profile.v, profile.a))
    q = start + share[:, None] * way
    dq, ddq = speed[:, None] * way, change[:, None] * way
    q[0], q[-1] = start, goal
    for values in (dq, ddq):
        values[0] = values[-1] = 0.0
    return held(Trajectory(ends[kept], q, dq, ddq, limits.chain.joint_names), limits, tcp)


# ---------------------------------------------------------------------------------------------------------------------
# along a path


def time_path(
    path: JointPath,
    *,
    max_velocity: ArrayLike | None = None,
    max_acceleration: ArrayLike | None = None,
    max_jerk: ArrayLike | None = None,
    tcp: TcpLimits | None = None,
) -> Trajectory:
    """A quick jerk-limited motion along a joint path, from rest to rest, that rests at its corners.

    Parameters
    ----------
    path : JointPath
        A complete one, see `pieper.motion.path_ik.follow_path`.
    max_velocity, max_acceleration, max_jerk : float or (n,) array, optional
        Limits of the joints and what holds without them: see `pieper.motion.limits.JointLimits.of`.
    tcp : TcpLimits, optional
        Limits of the tip.

    Returns
    -------
    Trajectory
        With velocities and accelerations; `usage` of it is 1 at most. It passes through the joint values of the path; between them
        joints follow a spline, and the tip is as near to its path as the spline is: less than a micrometre at the usual 2 mm
        between poses, more where a path was given by few poses.

    Raises
    ------
    MotionError
        A path that breaks, or none; a limit so small that the motion would take 1e7 s, or that rounding exceeds it.
    MissingExtraError
        Ruckig is not installed.

    Notes
    -----
    Not the least time: acceleration ends at the edges of windows, and limits hold for the worst of a window. On paths with even
    derivatives, as a turn about one axis, it is the least time.
    """
    if path.broken is not None:
        raise MotionError(f"the path must reach its end to be timed; it breaks: {path.broken.message}")
    chain = path.chain
    limits = JointLimits.of(chain, max_velocity=max_velocity, max_acceleration=max_acceleration, max_jerk=max_jerk)
    edges = np.searchsorted(path.s, path.corners - 1e-12)
    edges = np.unique(np.concatenate([[0], edges, [len(path.s) - 1]]))
    parts = []
    for a, b in itertools.pairwise(edges):
        part = _section(path.q[a : b + 1], limits, tcp or TcpLimits())
        if part is not None:
            parts.append(part)
    return one_after_another(chain, parts, path.q[-1])


class Bounds(NamedTuple):
    """Of a window: its length, and the largest path speed, acceleration and jerk [by s of joint motion at the speed limits]."""

    length: float
    v: float
    a: float
    j: float


class _Profile(NamedTuple):
    """Path position and its derivatives over time; constant jerk between the points."""

    t: FloatArray
    x: FloatArray
    v: FloatArray
    a: FloatArray


def _section(q: FloatArray, limits: JointLimits, tcp: TcpLimits) -> Trajectory | None:
    """From rest to rest through joint values; None where they do not differ."""
    from scipy.interpolate import CubicSpline

    steps = np.linalg.norm(np.diff(q, axis=0) / limits.velocity, axis=1)
    kept = np.concatenate([[True], steps > _REPEATED])
    if kept.sum() < 2:
        return None
    last = q[-1]
    q = q[kept]
    q[-1] = last
    x = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(q, axis=0) / limits.velocity, axis=1))])
    spline = CubicSpline(x, q, bc_type="not-a-knot" if len(x) > 3 else "natural")
    places, sizes, most = _sizes(spline, x, limits, tcp)
    cut = _Cut(places, sizes, most)
    quickest: list[Bounds] = []
    least = np.inf
    for share in _SHARES:
        for count in _WINDOWS:
            if count > max(1, len(x) - 1):
                break
            time, windows = cut.joined(cut.evenly(count), share, least)
            if time < least:
                least, quickest = time, windows
    return held(along(spline, x, profile(quickest), limits), limits, tcp)


def _sizes(
    spline: Any, x: FloatArray, limits: JointLimits, tcp: TcpLimits
) -> tuple[FloatArray, list[FloatArray], FloatArray]:
    """Places along a path; sizes (r, k) of the first three derivatives there of joints and tip; and their limits (3, r)."""
    inner = x[:-1, None] + np.diff(x)[:, None] * np.arange(4) / 4.0
    places = np.append(inner.ravel(), x[-1])
    # at a knot the third derivative is that of the cubic behind it; the one before it has had its turn
    return places, *sizes_at(limits, tcp, *(np.ascontiguousarray(spline(places, k)) for k in range(4)))


def sizes_at(
    limits: JointLimits, tcp: TcpLimits, q: FloatArray, d1: FloatArray, d2: FloatArray, d3: FloatArray
) -> tuple[list[FloatArray], FloatArray]:
    """Sizes (r, k) of three derivatives of joints and, where it has limits, tip, at joint values (k, n); and their limits (3, r).

    Parameters
    ----------
    limits : JointLimits
    tcp : TcpLimits
    q : (k, n) array
        Joint values [rad or m].
    d1, d2, d3 : (k, n) arrays
        Their derivatives by the parameter of the path.

    Returns
    -------
    list of three (r, k) arrays
        Sizes.
    (3, r) array
        Limits of velocity, acceleration and jerk.
    """
    sizes = [np.abs(d).T for d in (d1, d2, d3)]
    most = np.stack([limits.velocity, limits.acceleration, limits.jerk])
    if tcp.say_something:
        q, d1, d2, d3 = map(np.ascontiguousarray, (q, d1, d2, d3))
        twist, rate = _tip(limits.chain, q, d1, d2)
        third = _tip_jerk(limits.chain, q, d1, d2, d3) if np.isfinite(tcp.jerk) else np.zeros((len(q), 3))
        rows = [
            np.stack([np.linalg.norm(values[:, :3], axis=1), np.linalg.norm(values[:, 3:], axis=1)])
            for values in (twist, rate)
        ]
        rows.append(np.stack([np.linalg.norm(third, axis=1), np.zeros(len(q))]))
        sizes = [np.concatenate(pair) for pair in zip(sizes, rows, strict=True)]
        tip = [[tcp.velocity, tcp.angular_velocity], [tcp.acceleration, tcp.angular_acceleration], [tcp.jerk, np.inf]]
        most = np.concatenate([most, np.array(tip)], axis=1)
    return sizes, most


class _Cut:
    """Ways to cut a path into windows.

    Parameters
    ----------
    places : (k,) array
        Along the path.
    sizes : three (r, k) arrays
        Of the first derivatives of joints and tip there.
    most : (3, r) array
        Limits of velocity, acceleration and jerk.
    """

    def __init__(self, places: FloatArray, sizes: list[FloatArray], most: FloatArray) -> None:
        self.places, self.sizes, self.most = places, sizes, most
        self._bounds: dict[tuple[float, float, tuple[float, float, float]], Bounds] = {}
        with np.errstate(divide="ignore", invalid="ignore"):
            slow = (sizes[0] / most[0][:, None]).max(axis=0)  # 1 / the largest speed there
            for derivative, order in ((1, 2), (2, 3)):
                ratio = np.nan_to_num(sizes[derivative] / most[derivative][:, None]).max(axis=0)
                slow = np.maximum(slow, ratio ** (1.0 / order))
        taken = np.concatenate([[0.0], np.cumsum(np.diff(places) * 0.5 * (slow[1:] + slow[:-1]))])
        self._measure = places / places[-1] + taken / taken[-1]

    def evenly(self, count: int) -> list[float]:
        """Edges of windows, even half by length and half by the time that the limits take."""
        edges = np.interp(np.linspace(0.0, 2.0, count + 1), self._measure, self.places)
        edges[0], edges[-1] = 0.0, self.places[-1]
        return [float(e) for e in np.unique(edges)]

    def windows(self, edges: list[float], share: tuple[float, float, float]) -> list[Bounds]:
        return [self._window(a, b, share) for a, b in itertools.pairwise(edges)]

    def _window(self, a: float, b: float, share: tuple[float, float, float]) -> Bounds:
        if (a, b, share) not in self._bounds:
            low, high = np.searchsorted(self.places, [a, b])
            rows = slice(max(int(low) - 1, 0), int(high) + 1)
            first, second, third = (size[:, rows].max(axis=1) for size in self.sizes)
            velocity, acceleration, jerk = self.most
            self._bounds[a, b, share] = bounds(b - a, first, second, third, velocity, acceleration, jerk, share)
        return self._bounds[a, b, share]

    def joined(self, edges: list[float], share: tuple[float, float, float], least: float) -> tuple[float, list[Bounds]]:
        """The time for a cut, and its windows; neighbours are joined where that is quicker, if the cut is near the least time so far."""
        windows = self.windows(edges, share)
        time = duration(windows)
        if time > 1.3 * least:
            return time, windows
        for _ in range(_SWEEPS):
            before, k = time, 1
            while k < len(edges) - 1:
                fewer = edges[:k] + edges[k + 1 :]
                tried = self.windows(fewer, share)
                shorter = duration(tried)
                if shorter < time:
                    edges, windows, time = fewer, tried, shorter
                else:
                    k += 1
            if time > 0.999 * before:
                break
        return time, windows


def bounds(
    length: float,
    first: FloatArray,
    second: FloatArray,
    third: FloatArray,
    velocity: FloatArray,
    acceleration: FloatArray,
    jerk: FloatArray,
    share: tuple[float, float, float],
) -> Bounds:
    """Bounds of path speed, acceleration and jerk at which every limit holds for derivatives up to these sizes.

    Parameters
    ----------
    length : float
        Of the window, in the parameter of the path.
    first, second, third : (r,) arrays
        Largest sizes of the three derivatives of joints and tip by that parameter.
    velocity, acceleration, jerk : (r,) arrays
        Their limits, each by one more second.
    share : (float, float, float)
        Of the limits, from 0 to 1: of the acceleration for the curve of the path, of the jerk for that, of the jerk for gaining speed in it.

    Returns
    -------
    Bounds
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        v = float(min(
            np.nanmin(velocity / first),
            np.nanmin(np.sqrt(share[0] * acceleration / second)),
            np.nanmin(np.cbrt(share[1] * jerk / third)),
        ))  # fmt: skip
        a = float(min(
            np.nanmin((acceleration - second * v * v) / first), np.nanmin(share[2] * jerk / (3.0 * second * v)),
        ))  # fmt: skip
        j = float(np.nanmin((jerk - third * v**3 - 3.0 * second * v * a) / first))
    a = min(a, v / _AT_ONCE)
    return Bounds(length, _SAFE * v, _SAFE * a, _SAFE * min(j, a / _AT_ONCE))


def _change(w0: float, w1: float, a: float, j: float) -> float:
    """Least time in which the speed changes between two values, with no acceleration at either."""
    change = abs(w1 - w0)
    return 2.0 * sqrt(change / j) if change * j <= a * a else change / a + a / j


def _reachable(w: float, bound: Bounds, highest: float) -> float:
    """The largest speed, up to `highest`, that a window leads to from speed w, or back from it; the way is the mean speed for that time."""
    room = bound.length * (1.0 - 1e-6)
    if highest <= w or 0.5 * (w + highest) * _change(w, highest, bound.a, bound.j) <= room:
        return highest
    low, high = w, highest
    for _ in range(30):
        middle = 0.5 * (low + high)
        if 0.5 * (w + middle) * _change(w, middle, bound.a, bound.j) <= room:
            low = middle
        else:
            high = middle
    return low


def _speeds(windows: list[Bounds]) -> list[float]:
    """The largest speeds between windows that can be reached from rest and brought to rest again."""
    count = len(windows)
    speeds = [0.0] + [min(windows[k].v, windows[k + 1].v) for k in range(count - 1)] + [0.0]
    for k in range(count - 1, -1, -1):
        speeds[k] = min(speeds[k], _reachable(speeds[k + 1], windows[k], speeds[k]))
    for k in range(count):
        speeds[k + 1] = min(speeds[k + 1], _reachable(speeds[k], windows[k], speeds[k + 1]))
    return speeds


def duration(windows: list[Bounds]) -> float:
    """The time through the windows; what Ruckig will find, without its profiles."""
    speeds, total = _speeds(windows), 0.0
    for k, (length, v, a, j) in enumerate(windows):
        w0, w1 = speeds[k], speeds[k + 1]
        low, high = max(w0, w1), v
        t0, t1 = _change(w0, high, a, j), _change(high, w1, a, j)
        if 0.5 * ((w0 + high) * t0 + (high + w1) * t1) <= length:
            low = high
        else:
            for _ in range(25):
                middle = 0.5 * (low + high)
                t0, t1 = _change(w0, middle, a, j), _change(middle, w1, a, j)
                if 0.5 * ((w0 + middle) * t0 + (middle + w1) * t1) <= length:
                    low = middle
                else:
                    high = middle
        t0, t1 = _change(w0, low, a, j), _change(low, w1, a, j)
        rest = length - 0.5 * ((w0 + low) * t0 + (low + w1) * t1)
        total += t0 + t1 + (max(rest, 0.0) / low if low > 0.0 else np.inf)
    return total


def profile(windows: list[Bounds]) -> _Profile:
    """The quickest motion through the windows from rest to rest, without acceleration between them.

    Raises
    ------
    MotionError
        It would take an absurdly long time.
    """
    speeds = _speeds(windows)
    ruckig = _ruckig()
    rows: list[tuple[float, float, float, float]] = [(0.0, 0.0, 0.0, 0.0)]
    time = place = 0.0
    for k, window in enumerate(windows):
        # lengths of 1 and speeds by them: Ruckig's tolerances are absolute
        size = window.length
        asked = ruckig.InputParameter(1)
        asked.current_velocity, asked.target_velocity = [speeds[k] / size], [speeds[k + 1] / size]
        asked.target_position = [1.0]
        asked.max_velocity, asked.max_acceleration = [window.v / size], [window.a / size]
        asked.max_jerk = [window.j / size]
        found = _planned(ruckig, asked)
        profile = found.profiles[0][0]
        ends = np.cumsum(profile.t)
        for i, end in enumerate(ends.tolist()):
            if profile.t[i] > 0.0:
                rows.append((
                    time + end, place + size * profile.p[i + 1], size * profile.v[i + 1], size * profile.a[i + 1],
                ))  # fmt: skip
        time += found.duration
        place += size
    if not time <= _LONGEST:
        raise MotionError(
            f"the motion would take {time:.3g} s, more than {_LONGEST:.0e} s: a limit of the joints or of the tip is too small for its way"
        )
    t, x, v, a = np.array(rows).T
    kept = np.concatenate([[True], np.diff(t) > 1e-12])
    x[-1], v[-1], a[-1] = place, 0.0, 0.0
    kept[-1] = True
    return _Profile(t[kept], x[kept], v[kept], a[kept])


def along(spline: Any, knots: FloatArray, profile: _Profile, limits: JointLimits) -> Trajectory:
    """The motion along the path: a point wherever the polynomial of time changes, so that little is left to interpolation.

    Parameters
    ----------
    spline : callable
        The path by its parameter, with derivatives.
    knots : (k,) array
        Parameters at which its polynomials change.
    profile
        The parameter by time, from `profile`.
    limits : JointLimits

    Returns
    -------
    Trajectory
    """
    t, x, v, a = profile
    spans = np.diff(t)
    j = np.diff(a) / spans
    # when the motion passes the knots of the spline: bisection in the piece that holds each
    inside = knots[(knots > x[0]) & (knots < x[-1])]
    piece = np.clip(np.searchsorted(x, inside, side="right") - 1, 0, len(spans) - 1)
    low, high = np.zeros(len(inside)), spans[piece].copy()
    for _ in range(48):
        middle = 0.5 * (low + high)
        beyond = _cubic(x, v, a, j, piece, middle) > inside
        low, high = np.where(beyond, low, middle), np.where(beyond, middle, high)
    passing = t[piece] + 0.5 * (low + high)
    coarsest = max(_COARSEST, float(t[-1]) / _SPANS)
    fixed = t[np.concatenate([[True], np.diff(t) > 0.2 * _FINEST])]
    if fixed[-1] != t[-1]:
        fixed = np.append(fixed[:-1], t[-1]) if len(fixed) > 1 else t[[0, -1]]
    times = _thinned(fixed, np.sort(passing))
    counts = np.ceil(np.diff(times) / coarsest - 1e-9).astype(int).clip(min=1)
    times = np.concatenate(
        [*(np.linspace(p, r, c + 1)[:-1] for p, r, c in zip(times[:-1], times[1:], counts, strict=True)), times[-1:]]
    )
    piece = np.clip(np.searchsorted(t, times, side="right") - 1, 0, len(spans) - 1)
    e = times - t[piece]
    place = np.clip(_cubic(x, v, a, j, piece, e), 0.0, knots[-1])
    speed = v[piece] + e * (a[piece] + 0.5 * e * j[piece])
    change = a[piece] + e * j[piece]
    d1 = spline(place, 1)
    q = spline(place)
    dq = d1 * speed[:, None]
    ddq = spline(place, 2) * speed[:, None] ** 2 + d1 * change[:, None]
    q[0], q[-1] = spline(0.0), spline(knots[-1])
    for values in (dq, ddq):
        values[0] = values[-1] = 0.0
    return Trajectory(times, np.clip(q, *limits.chain.limits.T), dq, ddq, limits.chain.joint_names)


def _cubic(x: FloatArray, v: FloatArray, a: FloatArray, j: FloatArray, piece: Any, e: FloatArray) -> FloatArray:
    return np.asarray(x[piece] + e * (v[piece] + e * (0.5 * a[piece] + e * j[piece] / 6.0)))


def _thinned(fixed: FloatArray, more: FloatArray) -> FloatArray:
    """Times that must be there, and as many others as keep a distance from them and from each other."""
    at = np.searchsorted(fixed, more)
    away = (more - fixed[np.maximum(at - 1, 0)] > _FINEST) & (fixed[np.minimum(at, len(fixed) - 1)] - more > _FINEST)
    kept = []
    last = -np.inf
    for time in more[away].tolist():
        if time - last > _FINEST:
            kept.append(time)
            last = time
    return np.sort(np.concatenate([fixed, kept]))


# ---------------------------------------------------------------------------------------------------------------------


def held(trajectory: Trajectory, limits: JointLimits, tcp: TcpLimits | None) -> Trajectory:
    """The same motion, slower by what it exceeds a limit, or quicker by what it leaves: the same way in another time.

    Where points are near each other in time, rounding of their joint values shows in the jerk, and is another one for each duration: then
    a little more is left to it every time, until all limits hold.

    Parameters
    ----------
    trajectory : Trajectory
    limits : JointLimits
    tcp : TcpLimits, optional

    Returns
    -------
    Trajectory

    Raises
    ------
    MotionError
        No duration was found with which every limit holds; the message tells by how much one is exceeded.
    """
    for trial in range(_TRIALS):
        factor = usage(trajectory, limits, tcp).stretch
        if 1.0 - 1e-6 * 4.0**trial <= factor <= 1.0:
            return trajectory
        slower = factor * (1.0 + 1e-8 * 4.0**trial)
        assert trajectory.dq is not None
        assert trajectory.ddq is not None
        trajectory = Trajectory(
            trajectory.t * slower,
            trajectory.q,
            trajectory.dq / slower,
            trajectory.ddq / slower**2,
            trajectory.joint_names,
        )
    factor = usage(trajectory, limits, tcp).stretch
    if factor > 1.0 + 1e-6:
        raise MotionError(
            f"no motion was found that holds every limit; the best of {trajectory.duration:.3g} s exceeds one by "
            f"{100.0 * (factor - 1.0):.2g} %, since a limit is so small that rounding exceeds it: raise the smallest"
        )
    return trajectory


def one_after_another(chain: Chain, parts: list[Trajectory], rest: FloatArray) -> Trajectory:
    """Motions from rest to rest as one; at rest at `rest` (n,) where there are none."""
    if not parts:
        still = np.zeros((1, chain.dof))
        return Trajectory(np.zeros(1), rest[None], still, still, chain.joint_names)
    t, q, dq, ddq = [np.zeros(1)], [parts[0].q[:1]], [np.zeros((1, chain.dof))], [np.zeros((1, chain.dof))]
    now = 0.0
    for part in parts:
        assert part.dq is not None
        assert part.ddq is not None
        t.append(now + part.t[1:])
        q.append(part.q[1:])
        dq.append(part.dq[1:])
        ddq.append(part.ddq[1:])
        now += part.duration
    return Trajectory(np.concatenate(t), np.concatenate(q), np.concatenate(dq), np.concatenate(ddq), chain.joint_names)


def _planned(ruckig: Any, asked: Any) -> Any:
    """Ruckig's answer to one question, from one state to one state."""
    found = ruckig.Trajectory(asked.degrees_of_freedom)
    result = ruckig.Ruckig(asked.degrees_of_freedom).calculate(asked, found)
    if result not in (ruckig.Result.Working, ruckig.Result.Finished):
        raise MotionError(
            f"no motion within limits was found ({result}); limits of very different sizes, or a move too small to time? raise the smallest limit"
        )
    return found


def _ruckig() -> Any:
    try:
        import ruckig
    except ImportError:
        raise MissingExtraError("ruckig", "plan", "jerk-limited timing") from None
    return ruckig
