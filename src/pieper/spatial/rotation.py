"""Rotations in every usual form, over SciPy's ``Rotation``: plain arrays in, plain arrays out.

The form in the middle is the 3x3 matrix ``R_a_b``, which takes coordinates in frame b to frame a:
``from_x`` makes it, ``as_x`` reads it. Quaternions are ``xyzw`` (SciPy, ROS); angles are radians and lie in [0, pi];
``q`` and ``-q`` are one rotation. Euler sequences bear SciPy's names: lower case turns about the fixed axes
(extrinsic), upper case about the carried ones (intrinsic). All 24 are in `EULER_SEQUENCES`.

SciPy is imported by the functions that use it, not by this module.

References
----------
Bernardes, Viollet, Quaternion to Euler angles conversion: a direct, general and computationally efficient method,
PLoS ONE 17 (2022) e0276302.
Shuster, A survey of attitude representations, J. Astronautical Sciences 41 (1993) 439-517.
Markley, Attitude determination using vector observations and the singular value decomposition,
J. Astronautical Sciences 36 (1988) 245-258.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pieper.errors import ArrayError, unknown_name
from pieper.spatial._checks import FloatArray, rotations, stack, together
from pieper.spatial.angle import wrap
from pieper.spatial.twist import quaternion_from_matrix, unit_and_length

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

EULER_SEQUENCES: tuple[str, ...] = tuple(
    "".join(letters)
    for axes in ("xyz", "XYZ")
    for letters in ((a, b, c) for a in axes for b in axes for c in axes if a != b != c)
)
"""The 24 names of Euler conventions: 12 extrinsic (lower case), then 12 intrinsic (upper case)."""

# A cosine of the half angle below this is rounding: the half turn is exact and the Gibbs vector has no finite value.
_HALF_TURN = 1e-15
# Nearer the lock than this, the outer angles one by one are rounding; to set one of them to 0 moves R by no more.
_LOCK_ROUNDING = 1e-14


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
    quaternion = _unit(stack(q, (4,), "quaternion xyzw"), "quaternion xyzw")
    return _matrix_from_unit_quaternion(quaternion)


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
    from scipy.spatial.transform import Rotation

    matrix = rotations(R, "R")
    if matrix.size == 0:
        return np.empty((*matrix.shape[:-2], 4))
    quaternion: FloatArray = Rotation.from_matrix(matrix.reshape(-1, 3, 3)).as_quat(canonical=True)
    return quaternion.reshape(*matrix.shape[:-2], 4) + 0.0  # + 0.0 turns -0.0 into 0.0


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
    return _matrix_of_turn(*unit_and_length(stack(rotation_vector, (3,), "rotation vector")))


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
    from scipy.spatial.transform import Rotation

    quaternion = as_quaternion(R)
    if quaternion.size == 0:
        return np.empty((*quaternion.shape[:-1], 3))
    vector: FloatArray = Rotation.from_quat(quaternion.reshape(-1, 4)).as_rotvec()
    return vector.reshape(*quaternion.shape[:-1], 3)


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
    return _matrix_from_unit_quaternion(_unit(quaternion, "Gibbs vector"))


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
    return _matrix_of_turn(unit_and_length(direction)[0], turn)


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


def from_euler(sequence: str, angles: ArrayLike) -> FloatArray:
    """Rotation matrix of three turns about coordinate axes.

    Upper case, intrinsic: ``ABC`` is ``R_A(first) R_B(second) R_C(third)``.
    Lower case, extrinsic: ``abc`` is ``R_c(third) R_b(second) R_a(first)``.

    Parameters
    ----------
    sequence : str
        One of `EULER_SEQUENCES`, for example ``"zyx"`` or ``"YZY"``.
    angles : (..., 3) array
        Angles [rad] in the order of the letters.

    Returns
    -------
    (..., 3, 3) array

    Raises
    ------
    UnknownNameError
        When there is no such sequence.
    ArrayError
        When the shape is wrong or a number is not finite.

    Examples
    --------
    >>> bool(np.abs(from_euler("ZYX", [0.1, 0.2, 0.3]) - from_euler("xyz", [0.3, 0.2, 0.1])).max() < 1e-15)
    True
    """
    from scipy.spatial.transform import Rotation

    _known(sequence)
    triple = stack(angles, (3,), "Euler angles")
    if triple.size == 0:
        return np.empty((*triple.shape[:-1], 3, 3))
    matrix: FloatArray = Rotation.from_euler(sequence, triple.reshape(-1, 3)).as_matrix()
    return matrix.reshape(*triple.shape, 3)


def as_euler(sequence: str, R: ArrayLike) -> FloatArray:
    """Euler angles of a rotation matrix, in the order of the letters.

    Sums and differences of the outer angles are read from the quaternion (Bernardes, Viollet 2022), so that
    ``from_euler(sequence, as_euler(sequence, R))`` is ``R`` to rounding everywhere, however near the lock. (SciPy sets
    the third angle to 0 as soon as the middle one is within 1e-7 rad of the lock, which moves the rotation by as much.)

    Parameters
    ----------
    sequence : str
        One of `EULER_SEQUENCES`.
    R : (..., 3, 3) array
        Rotation matrices.

    Returns
    -------
    (..., 3) array
        Angles [rad]: the outer ones in (-pi, pi], the middle one in [-pi/2, pi/2] when the three letters differ and in
        [0, pi] when the first is also the third. In gimbal lock (to rounding) the third is 0; see `gimbal_lock`.

    Raises
    ------
    UnknownNameError
        When there is no such sequence.
    ArrayError
        When the shape is wrong, a number is not finite, or a matrix is no rotation (the deviation is told).

    Examples
    --------
    >>> as_euler("ZYX", from_euler("ZYX", [0.1, 0.2, 0.3])).round(12)
    array([0.1, 0.2, 0.3])
    """
    _known(sequence)
    return _euler(sequence, as_quaternion(R)).angles


def from_rpy(rpy: ArrayLike) -> FloatArray:
    """Rotation matrix of roll, pitch, yaw as URDF defines them: ``R = Rz(yaw) Ry(pitch) Rx(roll)``. Needs NumPy alone.

    Parameters
    ----------
    rpy : (..., 3) array
        ``[roll, pitch, yaw]`` [rad].

    Returns
    -------
    (..., 3, 3) array

    Raises
    ------
    ArrayError
        When the shape is wrong or a number is not finite.

    Examples
    --------
    >>> from_rpy([0.0, 0.0, np.pi / 2]).round(12) + 0.0
    array([[ 0., -1.,  0.],
           [ 1.,  0.,  0.],
           [ 0.,  0.,  1.]])
    """
    angles = stack(rpy, (3,), "roll, pitch, yaw")
    (cr, cp, cy), (sr, sp, sy) = (np.moveaxis(f(angles), -1, 0) for f in (np.cos, np.sin))
    R = np.empty((*angles.shape[:-1], 3, 3))
    R[..., 0, 0], R[..., 0, 1], R[..., 0, 2] = cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr
    R[..., 1, 0], R[..., 1, 1], R[..., 1, 2] = sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr
    R[..., 2, 0], R[..., 2, 1], R[..., 2, 2] = -sp, cp * sr, cp * cr
    return R


def as_rpy(R: ArrayLike) -> FloatArray:
    """``[roll, pitch, yaw]`` of a rotation matrix, with ``R = Rz(yaw) Ry(pitch) Rx(roll)``. Needs NumPy alone.

    Parameters
    ----------
    R : (..., 3, 3) array
        Rotation matrices.

    Returns
    -------
    (..., 3) array
        Angles [rad], pitch in [-pi/2, pi/2]. In gimbal lock, at a pitch of 90 degrees either way, roll is 0 and yaw holds
        the whole turn.

    Raises
    ------
    ArrayError
        When the shape is wrong, a number is not finite, or a matrix is no rotation (the deviation is told).

    Examples
    --------
    >>> as_rpy(from_rpy([0.1, 0.2, 0.3])).round(12)
    array([0.1, 0.2, 0.3])
    """
    return _euler("ZYX", quaternion_from_matrix(rotations(R, "R"))).angles[..., ::-1]


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
    return _quaternion_angle(quaternion_from_matrix(rotations(R, "R")))


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
    return _quaternion_angle(quaternion_from_matrix(np.swapaxes(first, -1, -2) @ second))


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


def euler_factors(sequence: str, angles: ArrayLike) -> FloatArray:
    """The three elementary rotations of an Euler sequence, in the order in which they are multiplied.

    ``factors[0] @ factors[1] @ factors[2]`` is ``from_euler(sequence, angles)``: for ``"YZY"`` they are
    ``Ry(first), Rz(second), Ry(third)``, for the extrinsic ``"yzy"`` they are ``Ry(third), Rz(second), Ry(first)``.

    Parameters
    ----------
    sequence : str
        One of `EULER_SEQUENCES`.
    angles : (..., 3) array
        Angles [rad] in the order of the letters.

    Returns
    -------
    (..., 3, 3, 3) array
        Three matrices along axis -3.

    Raises
    ------
    UnknownNameError
        When there is no such sequence.
    ArrayError
        When the shape is wrong or a number is not finite.

    Examples
    --------
    >>> A, B, C = euler_factors("YZY", [0.5, 0.0, 0.2])
    >>> bool(np.abs(A @ B @ C - from_euler("YZY", [0.7, 0.0, 0.0])).max() < 1e-15)  # only the sum counts
    True
    """
    _known(sequence)
    triple = stack(angles, (3,), "Euler angles")
    turns = [from_axis_angle(np.eye(3)["xyz".index(x)], triple[..., i]) for i, x in enumerate(sequence.lower())]
    return np.stack(turns if sequence.isupper() else turns[::-1], axis=-3)


@dataclass(frozen=True, eq=False)
class GimbalLock:
    """What three Euler angles can and cannot tell about a rotation. Made by `gimbal_lock`.

    Attributes
    ----------
    sequence : str
        The Euler sequence.
    locked : (...) bool array
        True where the outer axes are parallel, within the tolerance.
    margin : (...) array
        How far the middle angle is from the nearest lock [rad].
    determined : (...) array of str
        ``"both"`` outer angles where not locked, else ``"sum"`` (first + third) or ``"difference"`` (first - third).
    value : (...) array
        That sum or difference in (-pi, pi] [rad]; NaN where not locked.
    angles : (..., 3) array
        One triple that gives the rotation [rad], as `as_euler` returns it.
    factors : (..., 3, 3, 3) array
        The three elementary matrices of that triple, whose product in order is the rotation.
    """

    sequence: str
    locked: NDArray[np.bool_]
    margin: FloatArray
    determined: NDArray[np.str_]
    value: FloatArray
    angles: FloatArray
    factors: FloatArray

    def alternatives(self, turn: ArrayLike) -> FloatArray:
        """(..., 3) other angles [rad] for the same rotation, the first one moved on by `turn` [rad].

        Where there is no lock the angles are returned unchanged; where there is one, the rotation stays the same to
        ``margin * turn``.
        """
        step = np.where(self.locked, stack(turn, (), "turn"), 0.0)
        third = np.where(self.determined == "sum", -step, step)
        return wrap(self.angles + np.stack([step, np.zeros_like(step), third], axis=-1))

    def __str__(self) -> str:
        if self.locked.ndim > 0:
            return f"{self.sequence}: {int(self.locked.sum())} of {self.locked.size} rotations in gimbal lock"
        if not self.locked:
            return f"{self.sequence}: no gimbal lock; the middle angle is {float(self.margin):.3g} rad away from it"
        sign = "+" if self.determined == "sum" else "-"
        return (
            f"{self.sequence}: gimbal lock ({float(self.margin):.3g} rad away); "
            f"only first {sign} third = {float(self.value):.6g} rad is determined"
        )


def gimbal_lock(sequence: str, R: ArrayLike, *, tolerance: float = 1e-6) -> GimbalLock:
    """Report on gimbal lock: is an Euler sequence locked at a rotation, and what is still determined.

    A sequence of three different letters locks where its middle angle is +90 or -90 degrees, a sequence like ``YZY``
    where it is 0 or 180 degrees: the first and the third axis are then parallel, and only the sum or the difference of
    their angles is determined. The rotation itself is as good as any other; another sequence, or a quaternion, has no
    trouble there.

    Parameters
    ----------
    sequence : str
        One of `EULER_SEQUENCES`.
    R : (..., 3, 3) array
        Rotation matrices.
    tolerance : float
        Distance of the middle angle from the lock that counts as locked [rad].

    Returns
    -------
    GimbalLock

    Raises
    ------
    UnknownNameError
        When there is no such sequence.
    ArrayError
        When the shape is wrong, a number is not finite, or a matrix is no rotation (the deviation is told).

    Examples
    --------
    >>> report = gimbal_lock("XYZ", from_euler("XYZ", [0.3, np.pi / 2, 0.4]))
    >>> bool(report.locked), str(report.determined), float(report.value.round(12))
    (True, 'sum', 0.7)
    """
    _known(sequence)
    if not tolerance >= 0.0:
        raise ArrayError(f"tolerance must be 0 or more radians, got {tolerance!r}")
    euler = _euler(sequence, as_quaternion(R))
    locked = np.asarray(euler.margin <= max(tolerance, _LOCK_ROUNDING))
    combination = np.where(euler.is_sum, "sum", "difference")
    return GimbalLock(
        sequence=sequence,
        locked=locked,
        margin=euler.margin,
        determined=np.where(locked, combination, "both"),
        value=np.where(locked, euler.combination, np.nan),
        angles=euler.angles,
        factors=euler_factors(sequence, euler.angles),
    )


@dataclass(frozen=True, eq=False)
class _Euler:
    angles: FloatArray  # (..., 3), in the order of the letters
    margin: FloatArray  # (...), distance of the middle angle from the nearest lock
    is_sum: NDArray[np.bool_]  # (...), whether the nearest lock determines the sum or the difference
    combination: FloatArray  # (...), that sum or difference


def _euler(sequence: str, quaternion: FloatArray) -> _Euler:
    """Euler angles by way of the sum and difference of the outer ones (Bernardes, Viollet 2022).

    For ``q = i(a) j(b) k(c)``, half angles a, b, c, and ``e`` the sign of the permutation (i, j, k):

    * three letters: ``w + q_j = (cos b + sin b) cos(a + e c)``, ``q_i + e q_k = (cos b + sin b) sin(a + e c)``, and
      with the signs of ``q_j``, ``q_k`` and ``c`` turned round ``(cos b - sin b) ... (a - e c)``;
    * first letter = third: ``w = cos b cos(a + c)``, ``q_i = cos b sin(a + c)``, ``q_j = sin b cos(a - c)``,
      ``e q_k = sin b sin(a - c)`` with k the axis left out.
    """
    letters = sequence.lower() if sequence.isupper() else sequence[::-1]
    i, j = "xyz".index(letters[0]), "xyz".index(letters[1])
    k = 3 - i - j
    e = 1.0 if (j - i) % 3 == 1 else -1.0
    proper = letters[0] == letters[2]
    w, x, y, z = quaternion[..., 3], quaternion[..., i], quaternion[..., j], e * quaternion[..., k]
    if proper:
        plus, minus = (w, x), (y, z)
    else:
        plus, minus = (w + y, x + z), (w - y, x - z)
    size_plus, size_minus = np.hypot(*plus), np.hypot(*minus)
    half_plus, half_minus = np.arctan2(plus[1], plus[0]), np.arctan2(minus[1], minus[0])
    sign = 1.0 if proper else e  # half_plus is half of (first + sign * third), in intrinsic order

    first, third = half_plus + half_minus, sign * (half_plus - half_minus)
    if proper:
        middle = 2.0 * np.arctan2(size_minus, size_plus)
    else:
        middle = np.arctan2(2.0 * (w * y + x * z), size_plus * size_minus)
    margin = 2.0 * np.arctan2(np.minimum(size_plus, size_minus), np.maximum(size_plus, size_minus))
    nearest_is_plus = size_plus >= size_minus
    is_sum = nearest_is_plus == (sign > 0.0)
    combination = 2.0 * np.where(nearest_is_plus, half_plus, half_minus)
    if not sequence.isupper():
        first, third = third, first
        combination = np.where(is_sum, combination, -combination)

    combination = wrap(combination)
    noise = margin <= _LOCK_ROUNDING
    first, third = np.where(noise, combination, wrap(first)), np.where(noise, 0.0, wrap(third))
    return _Euler(np.stack([first, middle, third], axis=-1), margin, np.asarray(is_sum), combination)


def _known(sequence: str) -> None:
    if sequence not in EULER_SEQUENCES:
        raise unknown_name("Euler sequence", str(sequence), EULER_SEQUENCES)


def _unit(vector: FloatArray, name: str) -> FloatArray:
    """Vectors of length 1 along the last axis."""
    if not vector.any(axis=-1).all():
        raise ArrayError(f"{name} must not be zero: it has no direction to normalise")
    return unit_and_length(vector)[0]


def _matrix_of_turn(axis: FloatArray, angle: FloatArray) -> FloatArray:
    """Rotation matrices of unit axes (or zero ones, for no turn) and angles."""
    half = 0.5 * angle[..., None]
    return _matrix_from_unit_quaternion(np.concatenate([np.sin(half) * axis, np.cos(half)], axis=-1))


def _matrix_from_unit_quaternion(quaternion: FloatArray) -> FloatArray:
    from scipy.spatial.transform import Rotation

    if quaternion.size == 0:
        return np.empty((*quaternion.shape[:-1], 3, 3))
    matrix: FloatArray = Rotation.from_quat(quaternion.reshape(-1, 4)).as_matrix()
    return matrix.reshape(*quaternion.shape[:-1], 3, 3)


def _quaternion_angle(quaternion: FloatArray) -> FloatArray:
    """Angle in [0, pi] of unit quaternions with ``w >= 0``."""
    return np.asarray(2.0 * np.arctan2(unit_and_length(quaternion[..., :3])[1], quaternion[..., 3]))
