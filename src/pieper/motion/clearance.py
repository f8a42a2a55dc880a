"""Distances between segments, and between segments and boxes, for any number of them at once.

A capsule is the set of points within its radius of a segment, so that these give the distance of a capsule from boxes and other capsules:
exactly while it is positive. A box may be swept by a ball too, which makes it a capsule or a ball where it has no width.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from pieper.model.chain import FloatArray

_PARALLEL = 1e-12  # squared sine below which two segments count as parallel; both answers are then within rounding


def segment_to_box(a: FloatArray, b: FloatArray, half: FloatArray) -> FloatArray:
    """Distances [m] of segments from boxes that are centred on their frames.

    Along the segment ``x(t) = a + t (b - a)`` the squared distance from a box is convex, and its derivative is piecewise linear with corners
    where a coordinate passes a face. So the derivative at these corners and both ends brackets its zero, and is straight between.

    Parameters
    ----------
    a, b : (k, 3) arrays
        Ends in the frames of the boxes [m].
    half : (k, 3) array
        Half the edge lengths [m], 0 included.

    Returns
    -------
    (k,) array
        0 where they meet.

    Examples
    --------
    >>> segment_to_box(np.array([[2.0, -1.0, 0.0]]), np.array([[2.0, 5.0, 0.0]]), np.ones((1, 3)))
    array([1.])
    """
    a, b, half = (np.ascontiguousarray(np.broadcast_to(x, a.shape).T) for x in (a, b, half))  # (3, k): quick along k
    d = b - a
    still = d == 0.0
    inverse = 1.0 / np.where(still, 1.0, d)
    inverse[still] = 0.0
    t = np.empty((8, a.shape[1]))
    t[:2] = [[0.0], [1.0]]
    np.multiply(-half - a, inverse, out=t[2:5])
    np.multiply(half - a, inverse, out=t[5:])
    np.maximum(t, 0.0, out=t)
    np.minimum(t, 1.0, out=t)
    slope = np.zeros_like(t)
    for axis in range(3):
        x = t * d[axis]
        x += a[axis]
        x -= np.minimum(np.maximum(x, -half[axis]), half[axis])
        x *= d[axis]
        slope += x
    falling, rising = slope <= 0.0, slope >= 0.0
    t_low, t_high = np.where(falling, t, 0.0).max(axis=0), np.where(rising, t, 1.0).min(axis=0)
    s_low, s_high = np.where(falling, slope, -np.inf).max(axis=0), np.where(rising, slope, np.inf).min(axis=0)
    bracketed = (s_low > -np.inf) & (s_high < np.inf) & (s_high > s_low)
    share = np.where(bracketed, -s_low, 0.0) / np.where(bracketed, s_high - s_low, 1.0)
    best = t_low + share * np.where(bracketed, t_high - t_low, 0.0)
    p = a + best * d
    p -= np.minimum(np.maximum(p, -half), half)
    p *= p
    return np.asarray(np.sqrt(p[0] + p[1] + p[2]))


def segment_to_segment(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> FloatArray:
    """Distances [m] of segments a-b from segments c-d; points count as segments.

    Parameters
    ----------
    a, b, c, d : (k, 3) arrays
        Ends [m].

    References
    ----------
    Ericson 2005, Real-Time Collision Detection, section 5.1.9.

    Examples
    --------
    >>> O, x, y = np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0]]), np.array([[0.0, 1.0, 0.0]])
    >>> segment_to_segment(O, x, x + y, y)
    array([1.])
    """
    u, v, w = b - a, d - c, a - c
    uu, vv, uv = (np.einsum("ki,ki->k", *pair) for pair in ((u, u), (v, v), (u, v)))
    uw, vw = np.einsum("ki,ki->k", u, w), np.einsum("ki,ki->k", v, w)
    determinant = uu * vv - uv * uv
    crossing = determinant > _PARALLEL * uu * vv
    s = np.where(crossing, np.clip((uv * vw - uw * vv) / np.where(crossing, determinant, 1.0), 0.0, 1.0), 0.0)
    t = np.clip((uv * s + vw) / np.where(vv > 0.0, vv, 1.0), 0.0, 1.0)
    s = np.clip((uv * t - uw) / np.where(uu > 0.0, uu, 1.0), 0.0, 1.0)
    gap = w + s[:, None] * u - t[:, None] * v
    return np.asarray(np.sqrt(np.einsum("ki,ki->k", gap, gap)))
