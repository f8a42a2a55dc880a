"""The quickest profile of a path through its windows, and the motion along the path by it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pieper.errors import MotionError
from pieper.motion import _ruckig
from pieper.motion._windows import speeds_between
from pieper.motion.trajectory import Trajectory

if TYPE_CHECKING:
    from pieper.motion._windows import Bounds
    from pieper.motion.limits import JointLimits
    from pieper.spatial._checks import FloatArray

_FINEST = 1e-3  # [s] least time between two points where one can be left out: below it, rounding shows in the jerk
_COARSEST = 0.01  # [s] most time between two points, or, of long motions,
_SPANS = 10_000  # this part of it
_LONGEST = 1e7  # [s] of motion along a path; far beyond it the times of its points cannot be told apart


class Profile(NamedTuple):
    """Path position and its derivatives over time; constant jerk between the points."""

    t: FloatArray
    x: FloatArray
    v: FloatArray
    a: FloatArray


def profile(windows: list[Bounds]) -> Profile:
    """The quickest motion through the windows from rest to rest, without acceleration between them.

    Raises
    ------
    MotionError
        It would take an absurdly long time.
    """
    speeds = speeds_between(windows)
    ruckig = _ruckig.module()
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
        found = _ruckig.planned(asked)
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
    return Profile(t[kept], x[kept], v[kept], a[kept])


def along(spline: Any, knots: FloatArray, profile: Profile, limits: JointLimits) -> Trajectory:
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
