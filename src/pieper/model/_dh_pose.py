"""One Denavit-Hartenberg row as a pose."""

from __future__ import annotations

from math import pi
from typing import TYPE_CHECKING

import numpy as np

from pieper.errors import ArrayError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from pieper.model._arrays import FloatArray


def standard_dh(a: ArrayLike, alpha: ArrayLike, d: ArrayLike, theta: ArrayLike) -> FloatArray:
    """Pose of a standard (distal) row, ``Rz(theta) Tz(d) Tx(a) Rx(alpha)``.

    Parameters
    ----------
    a, d : (...) arrays
        Lengths along x and z [m].
    alpha, theta : (...) arrays
        Angles about x and z [rad].

    Returns
    -------
    (..., 4, 4) array
        The arguments broadcast. Sine and cosine are exact at the doubles nearest to multiples of pi/2.

    Raises
    ------
    ArrayError
        An argument is not a finite number, or the shapes do not broadcast.

    References
    ----------
    Denavit, Hartenberg (1955).

    Examples
    --------
    >>> standard_dh(0.5, np.pi / 2, 0.1, 0.0)
    array([[ 1. ,  0. ,  0. ,  0.5],
           [ 0. ,  0. , -1. ,  0. ],
           [ 0. ,  1. ,  0. ,  0.1],
           [ 0. ,  0. ,  0. ,  1. ]])
    """
    a, alpha, d, theta = _numbers(a=a, alpha=alpha, d=d, theta=theta)
    return turn_z(theta, d) @ move_x(a, alpha, np.zeros_like(a))


def modified_dh(alpha: ArrayLike, a: ArrayLike, d: ArrayLike, theta: ArrayLike) -> FloatArray:
    """Pose of a modified (proximal, Craig) row, ``Rx(alpha) Tx(a) Rz(theta) Tz(d)``.

    The order of the arguments is the order in which Craig's tables print them: alpha_{i-1}, a_{i-1}, d_i, theta_i.

    Parameters
    ----------
    alpha, theta : (...) arrays
        Angles about x and z [rad].
    a, d : (...) arrays
        Lengths along x and z [m].

    Returns
    -------
    (..., 4, 4) array

    Raises
    ------
    ArrayError
        An argument is not a finite number, or the shapes do not broadcast.

    References
    ----------
    Craig, Introduction to Robotics, eq. 3.6.

    Examples
    --------
    >>> modified_dh(np.pi / 2, 0.5, 0.1, 0.0)
    array([[ 1. ,  0. ,  0. ,  0.5],
           [ 0. ,  0. , -1. , -0.1],
           [ 0. ,  1. ,  0. ,  0. ],
           [ 0. ,  0. ,  0. ,  1. ]])
    """
    alpha, a, d, theta = _numbers(alpha=alpha, a=a, d=d, theta=theta)
    return move_x(a, alpha, np.zeros_like(a)) @ turn_z(theta, d)


def hayati_dh(a: ArrayLike, alpha: ArrayLike, beta: ArrayLike, d: ArrayLike, theta: ArrayLike) -> FloatArray:
    """Pose of a Hayati row, ``Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta)``; with ``beta = 0`` a standard row.

    Parameters
    ----------
    a, d : (...) arrays
        Lengths along x and z [m].
    alpha, beta, theta : (...) arrays
        Angles about x, y and z [rad].

    Returns
    -------
    (..., 4, 4) array

    Raises
    ------
    ArrayError
        An argument is not a finite number, or the shapes do not broadcast.

    References
    ----------
    Hayati, Mirmirani (1985).

    Examples
    --------
    >>> hayati_dh(0.5, 0.0, 0.001, 0.0, 0.0)[:3, 2].round(6).tolist()
    [0.001, 0.0, 1.0]
    """
    a, alpha, beta, d, theta = _numbers(a=a, alpha=alpha, beta=beta, d=d, theta=theta)
    return turn_z(theta, d) @ move_x(a, alpha, beta)


def _numbers(**arguments: ArrayLike) -> list[FloatArray]:
    arrays = []
    for name, value in arguments.items():
        try:
            array = np.asarray(value, dtype=np.float64)
        except (TypeError, ValueError) as cause:
            raise ArrayError(f"{name} must be a number or an array of numbers, got {value!r}") from cause
        if not np.isfinite(array).all():
            raise ArrayError(f"{name} must be finite, got {array.tolist()}")
        arrays.append(array)
    try:
        return list(np.broadcast_arrays(*arrays))
    except ValueError as cause:
        shapes = ", ".join(f"{name} {array.shape}" for name, array in zip(arguments, arrays, strict=True))
        raise ArrayError(f"the arguments must broadcast to one shape, got {shapes}") from cause


def _sin_cos(angle: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Sine and cosine, exactly 0 and +-1 at the doubles nearest to multiples of pi/2."""
    angle = np.asarray(angle, dtype=np.float64)
    quarters = np.rint(angle / (0.5 * pi))
    exact = angle == quarters * (0.5 * pi)
    quadrant = np.where(exact, quarters, 0.0).astype(np.int64) % 4
    sine = np.where(exact, np.array([0.0, 1.0, 0.0, -1.0])[quadrant], np.sin(angle))
    cosine = np.where(exact, np.array([1.0, 0.0, -1.0, 0.0])[quadrant], np.cos(angle))
    return sine, cosine


def turn_z(theta: ArrayLike, d: ArrayLike) -> FloatArray:
    """Z = Rz(theta) Tz(d), (..., 4, 4)."""
    s, c = _sin_cos(theta)
    T = np.zeros((*s.shape, 4, 4))
    T[..., 0, 0], T[..., 0, 1] = c, -s
    T[..., 1, 0], T[..., 1, 1] = s, c
    T[..., 2, 2] = T[..., 3, 3] = 1.0
    T[..., 2, 3] = d
    return T


def move_x(a: ArrayLike, alpha: ArrayLike, beta: ArrayLike) -> FloatArray:
    """X = Tx(a) Rx(alpha) Ry(beta), (..., 4, 4)."""
    s, c = _sin_cos(alpha)
    sb, cb = _sin_cos(beta)
    T = np.zeros((*s.shape, 4, 4))
    T[..., 0, 0], T[..., 0, 2], T[..., 0, 3] = cb, sb, a
    T[..., 1, 0], T[..., 1, 1], T[..., 1, 2] = s * sb, c, -s * cb
    T[..., 2, 0], T[..., 2, 1], T[..., 2, 2] = -c * sb, s, c * cb
    T[..., 3, 3] = 1.0
    return T
