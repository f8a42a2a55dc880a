"""Directions and orientations, spread evenly."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pieper.spatial.rotation import from_quaternion

if TYPE_CHECKING:
    from pieper.spatial._checks import FloatArray

_TURN = 2.0 * np.pi


def turns_about(axis: FloatArray, angles: FloatArray) -> FloatArray:
    """Rotations (m, 3, 3) about one unit axis."""
    quaternions = np.concatenate([np.sin(0.5 * angles)[:, None] * axis, np.cos(0.5 * angles)[:, None]], axis=-1)
    return from_quaternion(quaternions)


def pointing(axis: FloatArray, directions: FloatArray) -> FloatArray:
    """Some rotations (m, 3, 3) that take a unit axis to unit directions (m, 3): by half a turn about the middle of both."""
    middle = directions + axis
    size = np.linalg.norm(middle, axis=-1, keepdims=True)
    across = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    middle = np.where(size > 1e-6, middle / np.maximum(size, 1e-6), across / np.linalg.norm(across))
    return np.asarray(2.0 * middle[:, :, None] * middle[:, None, :] - np.eye(3))


def directions(samples: int) -> FloatArray:
    """(m, 3) directions on a Fibonacci spiral."""
    i = np.arange(samples) + 0.5
    z = 1.0 - 2.0 * i / samples
    turn = np.pi * (3.0 - np.sqrt(5.0)) * i
    r = np.sqrt(1.0 - z * z)
    return np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=-1)


def orientations(samples: int) -> FloatArray:
    """(m, 3, 3) rotations on a super-Fibonacci spiral (Alexa, CVPR 2022)."""
    s = np.arange(samples) + 0.5
    t = s / samples
    inner, outer = np.sqrt(t), np.sqrt(1.0 - t)
    a, b = _TURN * s / np.sqrt(2.0), _TURN * s / 1.533751168755204288118041
    return from_quaternion(
        np.stack([inner * np.sin(a), inner * np.cos(a), outer * np.sin(b), outer * np.cos(b)], axis=-1)
    )
