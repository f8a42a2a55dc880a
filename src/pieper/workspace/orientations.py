"""Evenly spread orientations: the same for the same number and seed, on every machine."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pieper.spatial.rotation import from_quaternion
from pieper.workspace.grid import whole

if TYPE_CHECKING:
    from pieper.spatial._checks import FloatArray

_TURN = 2.0 * np.pi
_PHI = np.sqrt(2.0)
_PSI = 1.533751168755204288118041
"""The positive root of psi^4 = psi + 4, with sqrt(2) the pair that Alexa found best."""


def spread_rotations(count: int, *, seed: int = 0) -> FloatArray:
    """Rotations (count, 3, 3) along a super-Fibonacci spiral, which fills SO(3) evenly for any number.

    Parameters
    ----------
    count : int
    seed : int
        0 for the spiral as it is; another number turns all of it at random, to see what depends on the choice.

    Returns
    -------
    (count, 3, 3) array

    References
    ----------
    Alexa, Super-Fibonacci spirals: fast, low-discrepancy sampling of SO(3), CVPR 2022, algorithm 1.

    Examples
    --------
    The mean of evenly spread rotations is nearly zero.

    >>> bool(np.abs(spread_rotations(200).mean(axis=0)).max() < 0.01)
    True
    """
    n = whole(count, "orientations")
    s = np.arange(n) + 0.5
    inner, outer = np.sqrt(s / n), np.sqrt(1.0 - s / n)
    a, b = _TURN * s / _PHI, _TURN * s / _PSI
    R = from_quaternion(np.stack([inner * np.sin(a), inner * np.cos(a), outer * np.sin(b), outer * np.cos(b)], axis=-1))
    return R if seed == 0 else np.asarray(_random_rotation(seed) @ R)


def spread_directions(count: int, *, seed: int = 0) -> FloatArray:
    """Unit vectors (count, 3) along a Fibonacci spiral on the sphere.

    >>> spread_directions(2).round(3)[:, 2]
    array([ 0.5, -0.5])
    """
    n = whole(count, "orientations")
    i = np.arange(n) + 0.5
    z = 1.0 - 2.0 * i / n
    turn = np.pi * (3.0 - np.sqrt(5.0)) * i
    r = np.sqrt(1.0 - z * z)
    directions = np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=-1)
    return directions if seed == 0 else np.asarray(directions @ _random_rotation(seed).T)


def spread_turns(count: int, axis: FloatArray, *, seed: int = 0) -> FloatArray:
    """Rotations (count, 3, 3) about one unit axis, at even angles.

    Parameters
    ----------
    count : int
    axis : (3,) array
        Of unit length.
    seed : int
        0 for turns that begin at none; another number turns all of them at random.

    Returns
    -------
    (count, 3, 3) array

    Examples
    --------
    >>> spread_turns(4, np.array([0.0, 0.0, 1.0]))[1].round(6) + 0.0
    array([[ 0., -1.,  0.],
           [ 1.,  0.,  0.],
           [ 0.,  0.,  1.]])
    """
    n = whole(count, "orientations")
    start = 0.0 if seed == 0 else np.random.default_rng(seed).random()
    half = 0.5 * _TURN / n * (np.arange(n) + start)
    return from_quaternion(np.concatenate([np.sin(half)[:, None] * axis, np.cos(half)[:, None]], axis=-1))


def _random_rotation(seed: int) -> FloatArray:
    quaternion = np.random.default_rng(seed).standard_normal(4)
    return np.asarray(from_quaternion(quaternion / np.linalg.norm(quaternion)))
