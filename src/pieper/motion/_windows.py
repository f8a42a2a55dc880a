"""Windows of a path, in which path speed, acceleration and jerk are bounded, and the largest speeds between them.

The equations are those of `pieper.motion.timing`: a window keeps every limit for the largest derivatives in it (`bounds`), and two passes
find the speeds between windows that can be reached and left again without acceleration there (`speeds_between`).
"""

from __future__ import annotations

import itertools
from math import sqrt
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pieper.motion._tip_motion import tip_jerk, twist_and_rate

if TYPE_CHECKING:
    from pieper.motion.limits import JointLimits, TcpLimits
    from pieper.spatial._checks import FloatArray

_SWEEPS = 2  # of joining windows
_SAFE = 1.0 - 1e-8  # of a limit: what is left to rounding
AT_ONCE = 2e-3
"""Full speed and full acceleration are come to in no less time [s], whatever the limits: rounding would show in the jerk."""


class Bounds(NamedTuple):
    """Of a window: its length, and the largest path speed, acceleration and jerk [by s of joint motion at the speed limits]."""

    length: float
    v: float
    a: float
    j: float


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
        twist, rate = twist_and_rate(limits.chain, q, d1, d2)
        third = tip_jerk(limits.chain, q, d1, d2, d3) if np.isfinite(tcp.jerk) else np.zeros((len(q), 3))
        rows = [
            np.stack([np.linalg.norm(values[:, :3], axis=1), np.linalg.norm(values[:, 3:], axis=1)])
            for values in (twist, rate)
        ]
        rows.append(np.stack([np.linalg.norm(third, axis=1), np.zeros(len(q))]))
        sizes = [np.concatenate(pair) for pair in zip(sizes, rows, strict=True)]
        tip = [[tcp.velocity, tcp.angular_velocity], [tcp.acceleration, tcp.angular_acceleration], [tcp.jerk, np.inf]]
        most = np.concatenate([most, np.array(tip)], axis=1)
    return sizes, most


class Cut:
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
    a = min(a, v / AT_ONCE)
    return Bounds(length, _SAFE * v, _SAFE * a, _SAFE * min(j, a / AT_ONCE))


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


def speeds_between(windows: list[Bounds]) -> list[float]:
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
    speeds, total = speeds_between(windows), 0.0
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
