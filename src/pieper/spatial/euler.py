"""Euler angles; roll, pitch and yaw; and the gimbal lock, in which three angles tell two.

Sequences bear SciPy's names: lower case turns about the fixed axes (extrinsic), upper case about the carried ones (intrinsic). All 24 are
in `EULER_SEQUENCES`.

References
----------
Bernardes, Viollet, Quaternion to Euler angles conversion: a direct, general and computationally efficient method,
PLoS ONE 17 (2022) e0276302.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pieper.errors import ArrayError, unknown_name
from pieper.spatial._checks import FloatArray, rotations, stack
from pieper.spatial._rpy import rpy_rows
from pieper.spatial.angle import wrap
from pieper.spatial.quaternion import as_quaternion, matrix_of_turn, quaternion_from_matrix

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

EULER_SEQUENCES: tuple[str, ...] = tuple(
    "".join(letters)
    for axes in ("xyz", "XYZ")
    for letters in ((a, b, c) for a in axes for b in axes for c in axes if a != b != c)
)
"""The 24 names of Euler conventions: 12 extrinsic (lower case), then 12 intrinsic (upper case)."""

# Nearer the lock than this, the outer angles one by one are rounding; to set one of them to 0 moves R by no more.
_LOCK_ROUNDING = 1e-14


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
    rows = rpy_rows(*(np.moveaxis(f(angles), -1, 0) for f in (np.cos, np.sin)))
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


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
    axes = (np.broadcast_to(np.eye(3)["xyz".index(x)], triple.shape) for x in sequence.lower())
    turns = [matrix_of_turn(axis, triple[..., i]) for i, axis in enumerate(axes)]
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
