"""Rotations in every usual form, over SciPy's ``Rotation``: plain arrays in, plain arrays out.

The form in the middle is the 3x3 matrix ``R_a_b``, which takes coordinates in frame b to frame a:
``from_x`` makes it, ``as_x`` reads it. Quaternions are ``xyzw`` (SciPy, ROS); angles are radians and lie in [0, pi];
``q`` and ``-q`` are one rotation. Euler sequences bear SciPy's names: lower case turns about the fixed axes
(extrinsic), upper case about the carried ones (intrinsic). All 24 are in `EULER_SEQUENCES`.

SciPy is imported by the functions that use it, not by this module.

References
----------
Shuster, A survey of attitude representations, J. Astronautical Sciences 41 (1993) 439-517.
Markley, Attitude determination using vector observations and the singular value decomposition,
J. Astronautical Sciences 36 (1988) 245-258.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pieper.errors import ArrayError
from pieper.spatial._checks import FloatArray, rotations, stack, together
from pieper.spatial.euler import (
    EULER_SEQUENCES,
    GimbalLock,
    as_euler,
    as_rpy,
    euler_factors,
    from_euler,
    from_rpy,
    gimbal_lock,
)
from pieper.spatial.quaternion import (
    as_quaternion,
    from_quaternion,
    matrix_from_unit_quaternion,
    matrix_of_turn,
    normalised,
    quaternion_angle,
    quaternion_from_matrix,
    rotation_vector_from_quaternion,
    unit_and_length,
)

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

__all__ = [
    "EULER_SEQUENCES", "GimbalLock", "angle", "as_axis_angle", "as_euler", "as_gibbs", "as_quaternion", "as_rotation_vector", "as_rpy",
    "deviation", "distance", "euler_factors", "from_axis_angle", "from_euler", "from_gibbs", "from_quaternion",
    "from_rotation_vector", "from_rpy", "gimbal_lock", "nearest",
]  # fmt: skip


# A cosine of the half angle below this is rounding: the half turn is exact and the Gibbs vector has no finite value.
_HALF_TURN = 1e-15


def from_rotation_vector(rotation_vector: ArrayLike) -> FloatArray:
    """Rotation matrix of ``axis * angle``.

    Parameters
    ----------
    rotation_vector : (..., 3) array
        Axis times angle [rad]; any length, the zero vector is the identity.

    Returns
    -------
    (..., 3, 3) array

    Raises
    ------
    ArrayError
        When the shape is wrong or a number is not finite.

    Examples
    --------
    >>> from_rotation_vector([0.0, 0.0, np.pi / 2]).round(12)
    array([[ 0., -1.,  0.],
           [ 1.,  0.,  0.],
           [ 0.,  0.,  1.]])
    """
    return matrix_of_turn(*unit_and_length(stack(rotation_vector, (3,), "rotation vector")))


def as_rotation_vector(R: ArrayLike) -> FloatArray:
    """``axis * angle`` of a rotation matrix, with the angle in [0, pi].

    The angle is ``2 atan2(|v|, w)`` of the quaternion, which loses nothing near 0 or near 180 degrees.

    Parameters
    ----------
    R : (..., 3, 3) array
        Rotation matrices.

    Returns
    -------
    (..., 3) array
        Rotation vectors [rad]; zero for the identity. At 180 degrees either sign of the axis is right, and the one whose
        first non-zero component is positive is returned where the matrix is a half turn exactly.

    Raises
    ------
    ArrayError
        When the shape is wrong, a number is not finite, or a matrix is no rotation (the deviation is told).

    Examples
    --------
    >>> as_rotation_vector([[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    array([0.        , 0.        , 1.57079633])
    """
    return rotation_vector_from_quaternion(as_quaternion(R))


def from_gibbs(gibbs: ArrayLike) -> FloatArray:
    """Rotation matrix of a Gibbs vector ``axis * tan(angle / 2)``, also named Rodrigues vector.

    Parameters
    ----------
    gibbs : (..., 3) array
        Gibbs vectors [-], finite: an infinite one has lost its axis.

    Returns
    -------
    (..., 3, 3) array

    Raises
    ------
    ArrayError
        When the shape is wrong or a number is not finite.

    Examples
    --------
    >>> from_gibbs([0.0, 0.0, 1.0])  # a quarter turn about z
    array([[ 0., -1.,  0.],
           [ 1.,  0.,  0.],
           [ 0.,  0.,  1.]])
    """
    vector = stack(gibbs, (3,), "Gibbs vector")
    quaternion = np.concatenate([vector, np.ones((*vector.shape[:-1], 1))], axis=-1)
    return matrix_from_unit_quaternion(normalised(quaternion, "Gibbs vector"))


def as_gibbs(R: ArrayLike) -> FloatArray:
    """Gibbs (Rodrigues) vector ``axis * tan(angle / 2)`` of a rotation matrix; infinite at 180 degrees.

    Parameters
    ----------
    R : (..., 3, 3) array
        Rotation matrices.

    Returns
    -------
    (..., 3) array
        Gibbs vectors [-]. At 180 degrees all three components are ``inf``, and the axis is lost: use
        `as_rotation_vector` or `as_axis_angle` there.

    Raises
    ------
    ArrayError
        When the shape is wrong, a number is not finite, or a matrix is no rotation (the deviation is told).

    Notes
    -----
    Near 180 degrees the relative error grows as ``1e-16 / (pi - angle)``, as the tangent does.

    Examples
    --------
    >>> as_gibbs([[0, -1, 0], [1, 0, 0], [0, 0, 1]]).round(12)
    array([0., 0., 1.])
    >>> as_gibbs([[-1, 0, 0], [0, -1, 0], [0, 0, 1]])
    array([inf, inf, inf])
    """
    quaternion = as_quaternion(R)
    w = quaternion[..., 3:]
    half_turn = w <= _HALF_TURN
    return np.where(half_turn, np.inf, quaternion[..., :3] / np.where(half_turn, 1.0, w))


def from_axis_angle(axis: ArrayLike, angle: ArrayLike) -> FloatArray:
    """Rotation matrix of a turn about an axis; the axis is normalised.

    Parameters
    ----------
    axis : (..., 3) array
        Axes [-], of any length; a zero axis goes with a zero angle only.
    angle : (...) array
        Angles [rad]; the leading axes of both broadcast.

    Returns
    -------
    (..., 3, 3) array

    Raises
    ------
    ArrayError
        When the shape is wrong, a number is not finite, or an axis is zero where its angle is not.

    Examples
    --------
    >>> from_axis_angle([0, 0, 5.0], np.pi).round(12) + 0.0
    array([[-1.,  0.,  0.],
           [ 0., -1.,  0.],
           [ 0.,  0.,  1.]])
    """
    direction, turn = stack(axis, (3,), "axis"), stack(angle, (), "angle")
    shape = together(axis=direction.shape[:-1], angle=turn.shape)
    direction, turn = np.broadcast_to(direction, (*shape, 3)), np.broadcast_to(turn, shape)
    zero = np.asarray(~direction.any(axis=-1))
    if (zero & (turn != 0.0)).any():
        raise ArrayError(
            "axis must not be zero where the angle is not zero; give it a direction, for example [0, 0, 1]"
        )
    return matrix_of_turn(unit_and_length(direction)[0], turn)


def as_axis_angle(R: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Unit axis and angle in [0, pi] of a rotation matrix.

    Parameters
    ----------
    R : (..., 3, 3) array
        Rotation matrices.

    Returns
    -------
    axis : (..., 3) array
        Unit axes [-]; (0, 0, 0) for the identity, which has none. At 180 degrees the sign is free, see
        `as_rotation_vector`.
    angle : (...) array
        Angles [rad].

    Raises
    ------
    ArrayError
        When the shape is wrong, a number is not finite, or a matrix is no rotation (the deviation is told).

    Examples
    --------
    >>> axis, theta = as_axis_angle([[-1, 0, 0], [0, -1, 0], [0, 0, 1]])
    >>> axis, float(theta)
    (array([0., 0., 1.]), 3.141592653589793)
    """
    quaternion = as_quaternion(R)
    axis, half_sine = unit_and_length(quaternion[..., :3])
    return axis, np.asarray(2.0 * np.arctan2(half_sine, quaternion[..., 3]))


def angle(R: ArrayLike) -> FloatArray:
    """Angle of a rotation, in [0, pi].

    Parameters
    ----------
    R : (..., 3, 3) array
        Rotation matrices.

    Returns
    -------
    (...) array
        Angles [rad].

    Raises
    ------
    ArrayError
        When the shape is wrong, a number is not finite, or a matrix is no rotation (the deviation is told).

    Examples
    --------
    >>> float(angle([[-1, 0, 0], [0, -1, 0], [0, 0, 1]]))
    3.141592653589793
    """
    return quaternion_angle(quaternion_from_matrix(rotations(R, "R")))


def distance(R: ArrayLike, other: ArrayLike) -> FloatArray:
    """Angle of the smallest turn that takes one rotation to the other, in [0, pi].

    Parameters
    ----------
    R, other : (..., 3, 3) arrays
        Rotation matrices; leading axes broadcast.

    Returns
    -------
    (...) array
        Angles [rad].

    Raises
    ------
    ArrayError
        When the shape is wrong, a number is not finite, or a matrix is no rotation (the deviation is told).

    Examples
    --------
    >>> float(distance(from_rpy([0, 0, 0.1]), from_rpy([0, 0, 0.4])).round(12))
    0.3
    """
    first, second = rotations(R, "R"), rotations(other, "other")
    together(R=first.shape[:-2], other=second.shape[:-2])
    return quaternion_angle(quaternion_from_matrix(np.swapaxes(first, -1, -2) @ second))


def deviation(matrix: ArrayLike) -> FloatArray:
    """How far a matrix is from a rotation: the largest entry of ``|M M^T - 1|``, infinite for a reflection.

    Parameters
    ----------
    matrix : (..., 3, 3) array

    Returns
    -------
    (...) array

    Raises
    ------
    ArrayError
        When the shape is wrong or a number is not finite.

    Examples
    --------
    >>> float(deviation(np.eye(3) * 1.001).round(9))
    0.002001
    """
    M = stack(matrix, (3, 3), "matrix")
    orthogonality = np.abs(M @ np.swapaxes(M, -1, -2) - np.eye(3)).max(axis=(-2, -1))
    return np.where(np.linalg.det(M) > 0.0, orthogonality, np.inf)


def nearest(matrix: ArrayLike) -> FloatArray:
    """Rotation nearest a matrix in the Frobenius norm; the repair for rounded or averaged matrices.

    With ``M = U S V^T`` it is ``U diag(1, 1, det(U V^T)) V^T`` (Markley 1988). Nothing in this package
    repairs a matrix unasked: `deviation` tells what the repair would hide.

    Parameters
    ----------
    matrix : (..., 3, 3) array

    Returns
    -------
    (..., 3, 3) array

    Raises
    ------
    ArrayError
        When the shape is wrong, a number is not finite, or no single rotation is nearest (rank below 2).

    Examples
    --------
    >>> float(deviation(nearest([[0.7071, -0.7071, 0], [0.7071, 0.7071, 0], [0, 0, 1]]))) < 1e-15
    True
    """
    M = stack(matrix, (3, 3), "matrix")
    U, S, Vt = np.linalg.svd(M)
    sign = np.where(np.linalg.det(U @ Vt) < 0.0, -1.0, 1.0)
    undetermined = S[..., 1] + sign * S[..., 2] <= 1e-12 * S[..., 0]
    if undetermined.any():
        first = tuple(int(i) for i in np.argwhere(undetermined)[0])
        raise ArrayError(
            f"matrix has no single nearest rotation; its singular values are {S[first].tolist()}, "
            "and the smaller two must not cancel or vanish"
        )
    U[..., :, 2] *= sign[..., None]
    R: FloatArray = U @ Vt
    return R
