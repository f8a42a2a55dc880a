"""Poses as homogeneous 4x4 arrays ``T_a_b``, which take coordinates in frame b to frame a; compose them with ``@``.

NumPy alone. Position is in metres; distances between poses are given in metres and radians apart, because one number
over both hides which of them is wrong.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np

from pieper.errors import ArrayError
from pieper.spatial import rotation as _rotation
from pieper.spatial._checks import FloatArray, poses, rotations, stack, together
from pieper.spatial.quaternion import quaternion_from_matrix, rotation_vector_from_quaternion
from pieper.spatial.twist import exp, log

if TYPE_CHECKING:
    from numpy.typing import ArrayLike


def from_position_rotation(p: ArrayLike, R: ArrayLike) -> FloatArray:
    """Pose from a position and a rotation matrix.

    Parameters
    ----------
    p : (..., 3) array
        Origin of b in frame a [m].
    R : (..., 3, 3) array
        Rotation ``R_a_b``; leading axes of both broadcast.

    Returns
    -------
    (..., 4, 4) array

    Raises
    ------
    ArrayError
        When a shape is wrong, a number is not finite, or R is no rotation (the deviation is told).

    Examples
    --------
    >>> from_position_rotation([0.1, 0.2, 0.3], np.eye(3))
    array([[1. , 0. , 0. , 0.1],
           [0. , 1. , 0. , 0.2],
           [0. , 0. , 1. , 0.3],
           [0. , 0. , 0. , 1. ]])
    """
    point, matrix = stack(p, (3,), "p"), rotations(R, "R")
    return _assemble(together(p=point.shape[:-1], R=matrix.shape[:-2]), point, matrix)


def from_xyz_rpy(xyz: ArrayLike, rpy: ArrayLike) -> FloatArray:
    """Pose from a position and roll, pitch, yaw, the ``origin`` of a URDF: ``R = Rz(yaw) Ry(pitch) Rx(roll)``.

    Parameters
    ----------
    xyz : (..., 3) array
        Position [m].
    rpy : (..., 3) array
        ``[roll, pitch, yaw]`` [rad].

    Returns
    -------
    (..., 4, 4) array

    Raises
    ------
    ArrayError
        When a shape is wrong or a number is not finite.

    Examples
    --------
    >>> from_xyz_rpy([0, 0, 1], [0, 0, np.pi / 2]).round(12)[:2]
    array([[ 0., -1.,  0.,  0.],
           [ 1.,  0.,  0.,  0.]])
    """
    return from_position_rotation(xyz, _rotation.from_rpy(rpy))


def position(T: ArrayLike) -> FloatArray:
    """Position part of a pose, a copy.

    Parameters
    ----------
    T : (..., 4, 4) array
        Pose ``T_a_b`` [m, -].

    Returns
    -------
    (..., 3) array
        Origin of b in frame a [m].

    Raises
    ------
    ArrayError
        When the shape is wrong or a number is not finite.

    Examples
    --------
    >>> position(from_xyz_rpy([0.1, 0.2, 0.3], [0, 0, 0]))
    array([0.1, 0.2, 0.3])
    """
    return stack(T, (4, 4), "T")[..., :3, 3].copy()


def rotation(T: ArrayLike) -> FloatArray:
    """Rotation part of a pose, a copy.

    Parameters
    ----------
    T : (..., 4, 4) array
        Pose ``T_a_b`` [m, -].

    Returns
    -------
    (..., 3, 3) array
        ``R_a_b``.

    Raises
    ------
    ArrayError
        When the shape is wrong or a number is not finite.

    Examples
    --------
    >>> rotation(np.eye(4))[0]
    array([1., 0., 0.])
    """
    return stack(T, (4, 4), "T")[..., :3, :3].copy()


def inverse(T: ArrayLike) -> FloatArray:
    """Inverse pose, ``T_b_a`` of ``T_a_b``: ``[[R^T, -R^T p], [0, 1]]``.

    Parameters
    ----------
    T : (..., 4, 4) array
        Pose ``T_a_b`` [m, -].

    Returns
    -------
    (..., 4, 4) array

    Raises
    ------
    ArrayError
        When the shape is wrong, a number is not finite, or the block is no rotation (the deviation is told).

    Examples
    --------
    >>> inverse(from_xyz_rpy([1, 2, 3], [0, 0, 0]))[:3, 3]
    array([-1., -2., -3.])
    """
    return _inverse(poses(T, "T"))


def transform(T: ArrayLike, p: ArrayLike) -> FloatArray:
    """Points in frame b to frame a: ``p_a = R p_b + p``.

    Parameters
    ----------
    T : (..., 4, 4) array
        Pose ``T_a_b`` [m, -].
    p : (..., 3) array
        Points ``p_b`` [m]; leading axes of both broadcast.

    Returns
    -------
    (..., 3) array
        Points ``p_a`` [m].

    Raises
    ------
    ArrayError
        When a shape is wrong or a number is not finite.

    Examples
    --------
    >>> transform(from_xyz_rpy([1, 0, 0], [0, 0, np.pi / 2]), [1.0, 0.0, 0.0]).round(12)
    array([1., 1., 0.])
    """
    pose, point = stack(T, (4, 4), "T"), stack(p, (3,), "p")
    together(T=pose.shape[:-2], p=point.shape[:-1])
    moved: FloatArray = (pose[..., :3, :3] @ point[..., None])[..., 0] + pose[..., :3, 3]
    return moved


def distance(T: ArrayLike, other: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """How far two poses are apart, metres and radians separately.

    Parameters
    ----------
    T, other : (..., 4, 4) arrays
        Poses in one frame [m, -]; leading axes broadcast.

    Returns
    -------
    metres : (...) array
        Distance of the origins [m].
    radians : (...) array
        Angle of the smallest turn from one to the other, in [0, pi] [rad].

    Raises
    ------
    ArrayError
        When a shape is wrong, a number is not finite, or a block is no rotation (the deviation is told).

    Examples
    --------
    >>> metres, radians = distance(np.eye(4), from_xyz_rpy([0, 0.3, 0.4], [0, 0, 0.2]))
    >>> float(metres.round(12)), float(radians.round(12))
    (0.5, 0.2)
    """
    first, second = poses(T, "T"), poses(other, "other")
    together(T=first.shape[:-2], other=second.shape[:-2])
    metres: FloatArray = np.linalg.norm(first[..., :3, 3] - second[..., :3, 3], axis=-1)
    return np.asarray(metres), _rotation.distance(first[..., :3, :3], second[..., :3, :3])


def interpolate(
    T_start: ArrayLike, T_end: ArrayLike, *, fraction: ArrayLike, motion: Literal["screw", "straight"] = "screw"
) -> FloatArray:
    """Pose on the way from one pose to another.

    ``"screw"``: ``T(s) = T_start exp(s log(T_start^-1 T_end))``, the constant-twist motion, on a helix.
    ``"straight"``: the origin on a straight line, the rotation about one axis at constant rate (slerp).

    Parameters
    ----------
    T_start, T_end : (..., 4, 4) arrays
        Poses in one frame [m, -].
    fraction : (...) array
        0 at the start, 1 at the end; values outside go beyond. Broadcasts with the leading axes of the poses, so that
        for two poses a vector of m fractions gives (m, 4, 4).
    motion : {"screw", "straight"}
        Which way to take; the rotation is the same on both.

    Returns
    -------
    (..., 4, 4) array

    Raises
    ------
    ArrayError
        When a shape is wrong, a number is not finite, a block is no rotation, or the motion has another name.

    Notes
    -----
    Where the two rotations are 180 degrees apart two ways are equally short, and one of them is taken.

    Examples
    --------
    >>> T_end = from_xyz_rpy([1, 0, 0], [0, 0, np.pi / 2])
    >>> position(interpolate(np.eye(4), T_end, fraction=0.5, motion="straight"))
    array([0.5, 0. , 0. ])
    >>> position(interpolate(np.eye(4), T_end, fraction=0.5)).round(4)
    array([ 0.5   , -0.2071,  0.    ])
    """
    start, end, s = poses(T_start, "T_start"), poses(T_end, "T_end"), stack(fraction, (), "fraction")
    shape = together(T_start=start.shape[:-2], T_end=end.shape[:-2], fraction=s.shape)
    if motion == "screw":
        between: FloatArray = start @ exp(log(_inverse(start) @ end) * s[..., None])
        return between
    if motion == "straight":
        R = np.swapaxes(start[..., :3, :3], -1, -2) @ end[..., :3, :3]
        turn = np.zeros((*R.shape[:-2], 6))
        turn[..., 3:] = rotation_vector_from_quaternion(quaternion_from_matrix(R))
        p = start[..., :3, 3] * (1.0 - s[..., None]) + end[..., :3, 3] * s[..., None]
        return _assemble(shape, p, start[..., :3, :3] @ exp(turn * s[..., None])[..., :3, :3])
    raise ArrayError(f"motion must be 'screw' or 'straight', got {motion!r}")


def nearest(T: ArrayLike) -> FloatArray:
    """Pose with the nearest rotation in place of a rounded 3x3 block; see `pieper.spatial.rotation.nearest`.

    Parameters
    ----------
    T : (..., 4, 4) array
        Nearly a pose [m, -]; the last row is not looked at.

    Returns
    -------
    (..., 4, 4) array

    Raises
    ------
    ArrayError
        When the shape is wrong, a number is not finite, or no single rotation is nearest.

    Examples
    --------
    >>> T = np.eye(4)
    >>> T[0, 0] = 0.9999
    >>> float(nearest(T)[0, 0])
    1.0
    """
    pose = stack(T, (4, 4), "T")
    return _assemble(pose.shape[:-2], pose[..., :3, 3], _rotation.nearest(pose[..., :3, :3]))


def _assemble(shape: tuple[int, ...], p: FloatArray, R: FloatArray) -> FloatArray:
    T = np.zeros((*shape, 4, 4))
    T[..., :3, :3] = R
    T[..., :3, 3] = p
    T[..., 3, 3] = 1.0
    return T


def _inverse(T: FloatArray) -> FloatArray:
    Rt = np.swapaxes(T[..., :3, :3], -1, -2)
    return _assemble(T.shape[:-2], -(Rt @ T[..., :3, 3:])[..., 0], Rt)
