"""Quaternions ``xyzw``: in and out of rotation matrices, and what is made of unit ones.

`from_quaternion` and `as_quaternion` check what they take; the other functions trust their arguments.
"""

from __future__ import annotations

from math import sqrt
from typing import TYPE_CHECKING

import numpy as np

from pieper.errors import ArrayError
from pieper.spatial._checks import FloatArray, rotations, stack

if TYPE_CHECKING:
    from numpy.typing import ArrayLike


_LARGEST = float(np.finfo(np.float64).max)


def from_quaternion(q: ArrayLike) -> FloatArray:
    """Rotation matrix of a quaternion; quaternions of other than unit length are normalised.

    ``R = 1 + 2 w hat(v) + 2 hat(v)^2`` for ``q = (v, w)`` of unit length (Shuster 1993, transposed, because he
    turns the axes); its upper middle element is ``2 (x y - z w)``.

    Parameters
    ----------
    q : (..., 4) array
        Quaternions ``xyzw`` [-], of any length but 0.

    Returns
    -------
    (..., 3, 3) array

    Raises
    ------
    ArrayError
        When the shape is wrong, a number is not finite, or a quaternion is zero.

    Examples
    --------
    >>> from_quaternion([0, 0, 1, 1])  # a quarter turn about z, not normalised
    array([[ 0., -1.,  0.],
           [ 1.,  0.,  0.],
           [ 0.,  0.,  1.]])
    """
    quaternion = normalised(stack(q, (4,), "quaternion xyzw"), "quaternion xyzw")
    return matrix_from_unit_quaternion(quaternion)


def as_quaternion(R: ArrayLike) -> FloatArray:
    """Unit quaternion ``xyzw`` of a rotation matrix, the one of the two with ``w >= 0``.

    Parameters
    ----------
    R : (..., 3, 3) array
        Rotation matrices.

    Returns
    -------
    (..., 4) array
        ``xyzw``; at 180 degrees, where ``w`` is 0, the first component that is not zero is positive.

    Raises
    ------
    ArrayError
        When the shape is wrong, a number is not finite, or a matrix is no rotation (the deviation is told).

    Examples
    --------
    >>> as_quaternion([[-1, 0, 0], [0, 1, 0], [0, 0, -1]])  # half a turn about y
    array([0., 1., 0., 0.])
    """
    return quaternion_from_matrix(rotations(R, "R"))


def quaternion_from_matrix(R: FloatArray) -> FloatArray:
    """Unit quaternion xyzw of each rotation matrix, with ``w >= 0`` (trusts its argument).

    Shepperd's choice: divide by the largest of the four components, so that nothing cancels at any angle.
    """
    if R.ndim == 2:
        return np.array(_quaternion_of_one(R.tolist()))  # the same arithmetic, a tenth of the time
    diagonal = np.stack([R[..., 0, 0], R[..., 1, 1], R[..., 2, 2]], axis=-1)
    trace = diagonal.sum(axis=-1)
    # the four rows are 4 x q, 4 y q, 4 z q and 4 w q: the outer product of the quaternion with itself
    outer = np.empty((*R.shape[:-2], 4, 4))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        outer[..., i, i] = 1.0 + 2.0 * diagonal[..., i] - trace
        outer[..., i, j] = outer[..., j, i] = R[..., j, i] + R[..., i, j]
        outer[..., i, 3] = outer[..., 3, i] = R[..., k, j] - R[..., j, k]
    outer[..., 3, 3] = 1.0 + trace
    largest = np.argmax(np.diagonal(outer, axis1=-2, axis2=-1), axis=-1)
    q = np.take_along_axis(outer, largest[..., None, None], axis=-2)[..., 0, :]
    return canonical(unit_and_length(q)[0])


def _quaternion_of_one(rows: list[list[float]]) -> list[float]:
    (a, b, c), (d, e, f), (g, h, i) = rows
    trace = a + e + i
    squares = (1.0 + 2.0 * a - trace, 1.0 + 2.0 * e - trace, 1.0 + 2.0 * i - trace, 1.0 + trace)
    largest = max(squares)
    if largest == squares[0]:
        q = [squares[0], d + b, c + g, h - f]
    elif largest == squares[1]:
        q = [d + b, squares[1], h + f, c - g]
    elif largest == squares[2]:
        q = [g + c, h + f, squares[2], d - b]
    else:
        q = [h - f, c - g, d - b, squares[3]]
    x, y, z, w = (part / largest for part in q)
    length = sqrt(x * x + y * y + z * z + w * w)
    if (w or x or y or z) < 0.0:
        length = -length
    return [x / length + 0.0, y / length + 0.0, z / length + 0.0, w / length + 0.0]  # + 0.0 turns -0.0 into 0.0


def canonical(quaternion: FloatArray) -> FloatArray:
    """Of the quaternions ``q`` and ``-q``, (..., 4) xyzw, the one with ``w > 0``, or at ``w = 0`` with its first non-zero component positive."""
    x, y, z, w = (quaternion[..., i] for i in range(4))
    deciding = np.where(w != 0.0, w, np.where(x != 0.0, x, np.where(y != 0.0, y, z)))
    return np.where((deciding < 0.0)[..., None], -quaternion, quaternion) + 0.0  # + 0.0 turns -0.0 into 0.0


def rotation_vector_from_quaternion(quaternion: FloatArray) -> FloatArray:
    """Axis times angle [rad], angle in [0, pi], of unit quaternions xyzw with ``w >= 0`` (trusts its argument)."""
    u, half_sine = unit_and_length(quaternion[..., :3])
    return 2.0 * np.arctan2(half_sine, quaternion[..., 3])[..., None] * u


def unit_and_length(vector: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Direction (..., k) and Euclidean length (...) of vectors (..., k); the direction of a zero vector is zero.

    The squares of the components neither underflow nor overflow, and a length past the largest double is that double.
    """
    size = np.abs(vector).max(axis=-1, keepdims=True)
    scaled = vector / np.where(size > 0.0, size, 1.0)
    scaled_length = np.sqrt((scaled * scaled).sum(axis=-1, keepdims=True))
    unit = scaled / np.where(size > 0.0, scaled_length, 1.0)
    with np.errstate(over="ignore"):
        length = np.minimum(size * scaled_length, _LARGEST)
    return unit, length[..., 0]


def matrix_of_turn(axis: FloatArray, angle: FloatArray) -> FloatArray:
    """Rotation matrices of unit axes (or zero ones, for no turn) and angles."""
    half = 0.5 * angle[..., None]
    return matrix_from_unit_quaternion(np.concatenate([np.sin(half) * axis, np.cos(half)], axis=-1))


def matrix_from_unit_quaternion(quaternion: FloatArray) -> FloatArray:
    """Rotation matrices (..., 3, 3) of quaternions (..., 4) of length 1."""
    from scipy.spatial.transform import Rotation

    if quaternion.size == 0:
        return np.empty((*quaternion.shape[:-1], 3, 3))
    matrix: FloatArray = Rotation.from_quat(quaternion.reshape(-1, 4)).as_matrix()
    return matrix.reshape(*quaternion.shape[:-1], 3, 3)


def quaternion_angle(quaternion: FloatArray) -> FloatArray:
    """Angle (...) in [0, pi] of unit quaternions (..., 4) with ``w >= 0``."""
    return np.asarray(2.0 * np.arctan2(unit_and_length(quaternion[..., :3])[1], quaternion[..., 3]))


def normalised(vector: FloatArray, name: str) -> FloatArray:
    """Vectors (..., k) of length 1 along the last axis, (..., k).

    Raises
    ------
    ArrayError
        A vector is zero; the message calls it `name`.
    """
    if not vector.any(axis=-1).all():
        raise ArrayError(f"{name} must not be zero: it has no direction to normalise")
    return unit_and_length(vector)[0]
