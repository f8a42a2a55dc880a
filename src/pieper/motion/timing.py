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
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.errors import ArrayError, MotionError
from pieper.kinematics.joints import as_joints
from pieper.motion import _ruckig
from pieper.motion._profile import along, profile
from pieper.motion._retiming import held, joined
from pieper.motion._windows import AT_ONCE, Bounds, Cut, sizes_at
from pieper.motion.limits import JointLimits, TcpLimits
from pieper.motion.trajectory import Trajectory
from pieper.motion.usage import Usage, usage

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from pieper.model.chain import Chain
    from pieper.motion.path_ik import JointPath
    from pieper.spatial._checks import FloatArray

__all__ = ["TcpLimits", "Usage", "time_path", "time_waypoints", "usage"]

_WINDOWS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32)
_SHARES = ((0.3, 0.3, 0.3), (0.6, 0.3, 0.3), (0.6, 0.6, 0.2))
"""Of an acceleration limit what ``q'' v^2`` may use, and of a jerk limit what ``q''' v^3`` and ``3 q'' v a`` may."""
_REPEATED = 1e-9  # [s of joint motion at the speed limits] points nearer than this are one


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
    return joined(chain, parts, points[-1])


def _edge(limits: JointLimits, tcp: TcpLimits | None, start: FloatArray, goal: FloatArray) -> Trajectory:
    """One profile for the share of the way, under the limits that the joints leave it: the joints stay on the line whatever their limits.

    Ruckig's own synchronisation by phase gives up where the joint that takes longest is not the one that every limit
    comes from, and the joints then leave the line.
    """
    ruckig = _ruckig.module()
    way = goal - start
    moving = way != 0.0
    v, a, j = (
        float((most[moving] / np.abs(way[moving])).min())
        for most in (limits.velocity, limits.acceleration, limits.jerk)
    )
    asked = ruckig.InputParameter(1)
    asked.target_position = [1.0]
    a = min(a, v / AT_ONCE)
    asked.max_velocity, asked.max_acceleration, asked.max_jerk = [v], [a], [min(j, a / AT_ONCE)]
    found = _ruckig.planned(asked)
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
    return joined(chain, parts, path.q[-1])


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
    cut = Cut(places, sizes, most)
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
