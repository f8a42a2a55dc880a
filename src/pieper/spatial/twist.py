"""Twists and screws: exponential, logarithm and adjoint of SE(3), in NumPy alone.

A twist is a 6-vector with its *linear part first*, ``(v, w)``, in metres and radians (or per second). Poses are
``T_a_b``: coordinates in b to coordinates in a. Where a source writes ``(w, v)``, its formulas are turned round here.

References
----------
Murray, Li, Sastry, A Mathematical Introduction to Robotic Manipulation (1994), chapter 2 and appendix A.
Lynch, Park, Modern Robotics (2017), chapter 3 (angular part first there).
Shepperd, Quaternion from rotation matrix, J. Guidance and Control 1 (1978) 223-224.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pieper.errors import ArrayError
from pieper.spatial._checks import FloatArray, poses, stack
from pieper.spatial.quaternion import quaternion_from_matrix, unit_and_length

if TYPE_CHECKING:
    from numpy.typing import ArrayLike


def hat(vector: ArrayLike) -> FloatArray:
    """Matrix form of a rotation vector, ``(..., 3)``, or of a twist, ``(..., 6)``.

    ``hat(w) @ p = w x p``, and for a twist ``hat((v, w)) = [[hat(w), v], [0, 0]]`` (Murray, Li, Sastry, sections 2.2, 2.3).

    Parameters
    ----------
    vector : (..., 3) or (..., 6) array
        Rotation vector [rad] or twist, linear part first [m, rad].

    Returns
    -------
    (..., 3, 3) or (..., 4, 4) array

    Raises
    ------
    ArrayError
        When the last axis is neither 3 nor 6 long, or a number is not finite.

    Examples
    --------
    >>> hat([1.0, 2.0, 3.0])
    array([[ 0., -3.,  2.],
           [ 3.,  0., -1.],
           [-2.,  1.,  0.]])
    """
    x = stack(vector, ("n",), "vector")
    if x.shape[-1] == 3:
        return _skew(x)
    if x.shape[-1] != 6:
        raise ArrayError(f"vector must have shape (..., 3) or (..., 6), got {x.shape}")
    matrix = np.zeros((*x.shape[:-1], 4, 4))
    matrix[..., :3, :3] = _skew(x[..., 3:])
    matrix[..., :3, 3] = x[..., :3]
    return matrix


def vee(matrix: ArrayLike) -> FloatArray:
    """Vector of a matrix that `hat` made; the inverse of `hat`.

    Parameters
    ----------
    matrix : (..., 3, 3) or (..., 4, 4) array
        Its 3x3 block is antisymmetric, its fourth row zero.

    Returns
    -------
    (..., 3) or (..., 6) array
        Rotation vector, or twist with the linear part first.

    Raises
    ------
    ArrayError
        When the shape is wrong or the matrix is not of that form to 1e-9 of its size.

    Examples
    --------
    >>> vee(hat([0.1, 0.0, 0.0, 0.0, 0.0, 2.0]))
    array([0.1, 0. , 0. , 0. , 0. , 2. ])
    """
    X = stack(matrix, ("n", "n"), "matrix")
    if X.shape[-2:] not in ((3, 3), (4, 4)):
        raise ArrayError(f"matrix must have shape (..., 3, 3) or (..., 4, 4), got {X.shape}")
    W = X[..., :3, :3]
    size = np.abs(X).max(initial=1.0)
    symmetric = np.abs(W + np.swapaxes(W, -1, -2)).max(initial=0.0)
    last_row = np.abs(X[..., 3:, :]).max(initial=0.0)
    if max(symmetric, last_row) > 1e-9 * size:
        raise ArrayError(
            f"matrix must be antisymmetric with a zero fourth row; its symmetric part is {symmetric / 2:.3g} "
            f"and its fourth row {last_row:.3g}; for a pose use twist.log"
        )
    w = 0.5 * np.stack([W[..., 2, 1] - W[..., 1, 2], W[..., 0, 2] - W[..., 2, 0], W[..., 1, 0] - W[..., 0, 1]], axis=-1)
    return w if X.shape[-1] == 3 else np.concatenate([X[..., :3, 3], w], axis=-1)


def exp(twist: ArrayLike) -> FloatArray:
    """Pose reached by following a twist for unit time, ``T = exp(hat(twist))``.

    With ``w = x u``, u of unit length (Murray, Li, Sastry, sections 2.2 and 2.3):
    ``R = cos(x) + sin(x) hat(u) + (1 - cos(x)) u u^T`` and
    ``p = (1 + (1 - cos(x))/x hat(u) + (1 - sin(x)/x) hat(u)^2) v``.

    Parameters
    ----------
    twist : (..., 6) array
        Linear part first [m, rad]. For a screw axis, the axis times its angle.

    Returns
    -------
    (..., 4, 4) array
        Exact to rounding at every angle, however small: ``1 - cos(x)`` is computed as ``2 sin(x/2)^2``.

    Raises
    ------
    ArrayError
        When the shape is wrong or a number is not finite.

    Examples
    --------
    A quarter turn about the vertical line through (1, 0, 0) takes the origin to (1, -1, 0):

    >>> T = exp(np.array([0.0, -1.0, 0.0, 0.0, 0.0, 1.0]) * np.pi / 2)
    >>> np.round(T[:3, 3], 12)
    array([ 1., -1.,  0.])
    """
    xi = stack(twist, (6,), "twist")
    v = xi[..., :3]
    u, x = unit_and_length(xi[..., 3:])
    half_sine = np.sin(0.5 * x)
    versine = 2.0 * half_sine * half_sine
    turns = x > 0.0
    divisor = np.where(turns, x, 1.0)
    excess = np.where(turns, 1.0 - np.sin(x) / divisor, 0.0)
    T = np.zeros((*xi.shape[:-1], 4, 4))
    T[..., :3, :3] = (
        np.sin(x)[..., None, None] * _skew(u) + versine[..., None, None] * u[..., :, None] * u[..., None, :]
    )
    for i in range(3):
        T[..., i, i] += np.cos(x)
    u_v = np.cross(u, v)
    T[..., :3, 3] = v + (versine / divisor)[..., None] * u_v + excess[..., None] * np.cross(u, u_v)
    T[..., 3, 3] = 1.0
    return T


def log(T: ArrayLike) -> FloatArray:
    """Twist that reaches a pose in unit time, with an angle in [0, pi]; the inverse of `exp`.

    The rotation vector comes from the quaternion by ``2 atan2(|v|, w)``, which is exact near 0 and near pi, and
    ``v = (1 - hat(w)/2 + (1 - (x/2) cot(x/2)) hat(u)^2) p`` with ``w = x u`` (Modern Robotics, eq. 3.92).

    Parameters
    ----------
    T : (..., 4, 4) array
        Pose ``T_a_b`` [m, -].

    Returns
    -------
    (..., 6) array
        Linear part first [m, rad], in frame a (or b: the twist of ``T`` is the same in both).

    Raises
    ------
    ArrayError
        When the shape is wrong, a number is not finite, or the block is not a rotation (the deviation is told).

    Notes
    -----
    At an angle of pi two twists reach the pose. Of the two axes the one whose first non-zero component is positive
    is returned; at pi within rounding that choice may go either way.

    Examples
    --------
    >>> T = np.array([[-1.0, 0, 0, 0], [0, -1, 0, 0], [0, 0, 1, 0.5], [0, 0, 0, 1]])
    >>> log(T)
    array([0.        , 0.        , 0.5       , 0.        , 0.        ,
           3.14159265])
    """
    pose = poses(T, "T")
    p = pose[..., :3, 3]
    quaternion = quaternion_from_matrix(pose[..., :3, :3])
    u, half_sine = unit_and_length(quaternion[..., :3])
    half_angle = np.arctan2(half_sine, quaternion[..., 3])
    turns = half_sine > 0.0
    cotangent = np.where(turns, half_angle * quaternion[..., 3] / np.where(turns, half_sine, 1.0), 1.0)
    u_p = np.cross(u, p)
    v = p - half_angle[..., None] * u_p + (1.0 - cotangent)[..., None] * np.cross(u, u_p)
    return np.concatenate([v, 2.0 * half_angle[..., None] * u], axis=-1)


def adjoint(T: ArrayLike) -> FloatArray:
    """Matrix that takes a twist from frame b to frame a: ``twist_a = adjoint(T_a_b) @ twist_b``.

    ``Ad(T) = [[R, hat(p) R], [0, R]]`` for the linear part first (Murray, Li, Sastry, section 2.4).

    Parameters
    ----------
    T : (..., 4, 4) array
        Pose ``T_a_b`` [m, -].

    Returns
    -------
    (..., 6, 6) array

    Raises
    ------
    ArrayError
        When the shape is wrong or a number is not finite.

    Examples
    --------
    A turn about an axis 2 m away along x moves the origin sideways:

    >>> T = np.eye(4)
    >>> T[0, 3] = 2.0
    >>> adjoint(T) @ [0, 0, 0, 0, 0, 1]
    array([ 0., -2.,  0.,  0.,  0.,  1.])
    """
    pose = stack(T, (4, 4), "T")
    R = pose[..., :3, :3]
    A = np.zeros((*pose.shape[:-2], 6, 6))
    A[..., :3, :3] = R
    A[..., 3:, 3:] = R
    A[..., :3, 3:] = _skew(pose[..., :3, 3]) @ R
    return A


def ad(twist: ArrayLike) -> FloatArray:
    """Matrix of the Lie bracket: ``ad(a) @ b = vee(hat(a) hat(b) - hat(b) hat(a))``, and ``exp(ad(a)) = adjoint(exp(a))``.

    ``ad((v, w)) = [[hat(w), hat(v)], [0, hat(w)]]`` for the linear part first.

    Parameters
    ----------
    twist : (..., 6) array
        Linear part first [m, rad].

    Returns
    -------
    (..., 6, 6) array

    Raises
    ------
    ArrayError
        When the shape is wrong or a number is not finite.

    Examples
    --------
    Two axes that meet at right angles: their bracket is the third one.

    >>> ad([0, 0, 0, 1, 0, 0]) @ [0, 0, 0, 0, 1, 0]
    array([0., 0., 0., 0., 0., 1.])
    """
    xi = stack(twist, (6,), "twist")
    W = _skew(xi[..., 3:])
    A = np.zeros((*xi.shape[:-1], 6, 6))
    A[..., :3, :3] = W
    A[..., 3:, 3:] = W
    A[..., :3, 3:] = _skew(xi[..., :3])
    return A


def _skew(w: FloatArray) -> FloatArray:
    W = np.zeros((*w.shape[:-1], 3, 3))
    W[..., 2, 1], W[..., 0, 2], W[..., 1, 0] = w[..., 0], w[..., 1], w[..., 2]
    W[..., 1, 2], W[..., 2, 0], W[..., 0, 1] = -w[..., 0], -w[..., 1], -w[..., 2]
    return W
