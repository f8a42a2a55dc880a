"""Angles on the circle: wrapping, shortest difference, and the copy of an angle that lies nearest a given one."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pieper.spatial._checks import FloatArray, stack, together

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

_TURN = 2.0 * np.pi
_TURN_REST = 2.4492935982947064e-16  # 2 pi minus its double, so that many turns do not add up its rounding


def wrap(angle: ArrayLike) -> FloatArray:
    """The same direction as an angle in (-pi, pi].

    Parameters
    ----------
    angle : (...) array
        Angles [rad].

    Returns
    -------
    (...) array
        Angles in (-pi, pi] with the same sine and cosine; an angle already there is returned unchanged.

    Raises
    ------
    ArrayError
        When a number is not finite.

    Examples
    --------
    >>> wrap([3.5, -np.pi, 0.25])
    array([-2.78318531,  3.14159265,  0.25      ])
    """
    return _wrap(stack(angle, (), "angle"))


def difference(angle: ArrayLike, other: ArrayLike) -> FloatArray:
    """Shortest signed turn from `other` to `angle`, in (-pi, pi].

    Parameters
    ----------
    angle, other : (...) arrays
        Angles [rad]; their shapes broadcast.

    Returns
    -------
    (...) array
        ``wrap(angle - other)`` [rad].

    Raises
    ------
    ArrayError
        When a number is not finite, or the shapes do not broadcast.

    Examples
    --------
    >>> float(difference(3.0, -3.0).round(6))
    -0.283185
    """
    a, b = stack(angle, (), "angle"), stack(other, (), "other")
    together(angle=a.shape, other=b.shape)
    return _wrap(_wrap(a) - _wrap(b))


def nearest(angle: ArrayLike, to: ArrayLike) -> FloatArray:
    """Of the copies ``angle + 2 pi k`` the one nearest `to`; what a joint that can turn further than pi needs.

    Parameters
    ----------
    angle, to : (...) arrays
        Angles [rad]; their shapes broadcast.

    Returns
    -------
    (...) array
        Angles [rad] within pi of `to`.

    Raises
    ------
    ArrayError
        When a number is not finite, or the shapes do not broadcast.

    Examples
    --------
    >>> float(nearest(2.705, -3.5).round(6))
    -3.578185
    """
    a, b = stack(angle, (), "angle"), stack(to, (), "to")
    together(angle=a.shape, to=b.shape)
    copy: FloatArray = a - _TURN * np.round((a - b) / _TURN)
    return copy


def _wrap(angle: FloatArray) -> FloatArray:
    rest = np.fmod(angle, _TURN)  # exact
    turns = np.round((angle - rest) / _TURN)
    rest = np.fmod(rest - turns * _TURN_REST, _TURN)
    rest = np.where(rest > np.pi, rest - _TURN, rest)
    return np.where(rest <= -np.pi, rest + _TURN, rest)
