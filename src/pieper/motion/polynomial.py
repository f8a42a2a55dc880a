"""Many small polynomials at once, over ``0 <= u <= 1``.

Coefficients are stacked along the last axis in ascending order, ``p(u) = c[..., 0] + c[..., 1] u + ... + c[..., d] u^d``.
What comes in is trusted: `pieper.motion.trajectory` has checked it.
"""

from __future__ import annotations

from functools import cache
from math import comb
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from pieper.model.chain import FloatArray

_PIECES = 8  # of the interval, for quick bounds
_BISECTIONS = 54  # halves an interval of length 1 down to the spacing of doubles near 1


def evaluate(c: FloatArray, u: FloatArray) -> FloatArray:
    """Values at `u` by Horner's rule: (..., d + 1) and (...) -> (...)."""
    value = c[..., -1] + 0.0 * u
    for i in range(c.shape[-1] - 2, -1, -1):
        value = value * u + c[..., i]
    return np.asarray(value)


def differentiate(c: FloatArray) -> FloatArray:
    """Coefficients of the derivative by u, (..., d + 1) -> (..., d); of a constant the constant 0, (..., 1)."""
    if c.shape[-1] == 1:
        return np.zeros_like(c)
    return np.asarray(c[..., 1:] * np.arange(1, c.shape[-1]))


def bounds(c: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A lower and an upper bound over the interval, quick and a little loose.

    On each eighth of the interval a polynomial stays among its Bernstein coefficients there.

    >>> bounds(np.array([0.0, 4.0, -4.0]))  # 4 u (1 - u), from 0 to 1
    (array(0.), array(1.))
    """
    hull = c @ _bernstein(c.shape[-1] - 1).T
    return np.asarray(hull.min(axis=-1)), np.asarray(hull.max(axis=-1))


def stationary(c: FloatArray) -> FloatArray:
    """Places that include both ends and every extremum in the interval: (..., d + 1) -> (..., d + 1), two of a constant.

    Their number is fixed; where there are fewer extrema the rest lie anywhere in the interval, so that the least and the greatest value
    at these places are those of the polynomial.

    >>> stationary(np.array([0.0, 4.0, -4.0]))
    array([0. , 0.5, 1. ])
    """
    inner = _sign_changes(differentiate(c))
    ends = np.broadcast_to([0.0, 1.0], (*c.shape[:-1], 2))
    return np.concatenate([ends[..., :1], inner, ends[..., 1:]], axis=-1)


@cache
def _bernstein(degree: int) -> FloatArray:
    """From ascending coefficients to the Bernstein coefficients on every piece of the interval.

    On the piece from s to s + h, with ``u = s + h v``, the coefficient of v^i is ``a_i = sum_k C(k, i) s^(k-i) h^i c_k``; and
    ``b_j = sum_i C(j, i) / C(degree, i) a_i``.
    """
    places = range(degree + 1)
    bernstein = np.array([[comb(j, i) / comb(degree, i) for i in places] for j in places])
    h = 1.0 / _PIECES
    pieces = [
        np.array([[comb(k, i) * (piece * h) ** max(k - i, 0) * h**i for k in places] for i in places])
        for piece in range(_PIECES)
    ]
    return np.concatenate([bernstein @ shifted for shifted in pieces])


def _sign_changes(c: FloatArray) -> FloatArray:
    """(..., d) places in ascending order, one in each stretch where the polynomial is monotonic; its sign changes are among them.

    Between two stationary points a polynomial is monotonic, so bisection finds its one sign change there if there is one; the stationary
    points are the sign changes of the derivative, and so on down to a straight line. Nothing depends on the leading coefficients.
    """
    degree = c.shape[-1] - 1
    if degree == 0:
        return np.empty((*c.shape[:-1], 0))
    edges = stationary(c)
    low, high = edges[..., :-1], edges[..., 1:]
    c = c[..., None, :]
    below = evaluate(c, low) < 0.0
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        same = (evaluate(c, middle) < 0.0) == below
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    return np.asarray(0.5 * (low + high))
