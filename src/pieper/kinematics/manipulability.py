"""What the singular values of a Jacobian tell: pseudo-inverse, null space, manipulability, distance to singularity.

Every function takes a Jacobian as a plain array, linear rows first, and any leading axes. With ``J = U diag(s) V^T``
(Golub and Van Loan), the joint velocity ``V[:, i]`` moves the tip by ``s[i] U[:, i]``; the columns of ``U`` and of ``V`` are
orthonormal and no singular value is negative.

Rows in metres and rows in radians do not compare. Where a number mixes them, `characteristic_length` says how many
metres of motion count as one radian: the linear rows are divided by it. The default of 1 m leaves the numbers of the
Jacobian as they are.

References
----------
Yoshikawa, Manipulability of robotic mechanisms, Int. J. Robotics Research 4(2) (1985) 3-9.
Golub, Van Loan, Matrix Computations, 4th ed. (2013), sections 2.4 and 5.5.
Angeles, Fundamentals of Robotic Mechanical Systems, 4th ed. (2014), chapter 5 (characteristic length).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from pieper.errors import ArrayError
from pieper.spatial._checks import FloatArray, stack

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

_PRECISION = float(np.finfo(np.float64).eps)


def pseudo_inverse(J: ArrayLike, *, cutoff: float | None = None) -> FloatArray:
    """Moore-Penrose inverse of a Jacobian, ``J^+ = V diag(1/s) U^T``, small singular values left out.

    Cut-off rule: a singular value counts as zero, and its direction is left alone, when
    ``s[i] <= cutoff * max(s)``. The default cutoff is ``max(m, n) * 2.2e-16``, the rounding error of the values
    themselves; a larger one, such as 1e-3, gives up directions in which the joints would have to race.

    Parameters
    ----------
    J : (..., m, n) array
        Jacobians.
    cutoff : float, optional
        Relative cut-off in [0, 1) [-].

    Returns
    -------
    (..., n, m) array
        ``pseudo_inverse(J) @ v`` is the shortest joint velocity among those whose tip velocity is nearest `v`.

    Raises
    ------
    ArrayError
        When the shape is wrong, a number is not finite, or the cutoff is outside [0, 1).

    Examples
    --------
    >>> pseudo_inverse([[2.0, 0.0, 0.0], [0.0, 0.0, 4.0]])
    array([[0.5 , 0.  ],
           [0.  , 0.  ],
           [0.  , 0.25]])
    """
    jacobian = stack(J, ("m", "n"), "J")
    U, s, Vt = np.linalg.svd(jacobian, full_matrices=False)
    kept = _nonzero(s, jacobian.shape[-2:], cutoff)
    reciprocal = np.where(kept, 1.0 / np.where(kept, s, 1.0), 0.0)
    inverse: FloatArray = np.swapaxes(Vt, -1, -2) @ (reciprocal[..., None] * np.swapaxes(U, -1, -2))
    return inverse


def rank(J: ArrayLike, *, cutoff: float | None = None) -> NDArray[np.int64]:
    """Number of singular values above the cut-off; the rule is that of `pseudo_inverse`.

    Parameters
    ----------
    J : (..., m, n) array
        Jacobians.
    cutoff : float, optional
        Relative cut-off in [0, 1) [-].

    Returns
    -------
    (...) int array

    Raises
    ------
    ArrayError
        When the shape is wrong, a number is not finite, or the cutoff is outside [0, 1).

    Examples
    --------
    >>> int(rank([[1.0, 1.0], [1.0, 1.0]]))
    1
    """
    jacobian = stack(J, ("m", "n"), "J")
    s = _singular_values(jacobian)
    return np.asarray(_nonzero(s, jacobian.shape[-2:], cutoff).sum(axis=-1), dtype=np.int64)


def null_space(J: ArrayLike, *, cutoff: float | None = None) -> FloatArray:
    """Joint motions that leave the tip where it is: an orthonormal basis N with ``J N = 0``.

    Parameters
    ----------
    J : (..., m, n) array
        Jacobians.
    cutoff : float, optional
        Relative cut-off in [0, 1) [-]; the rule is that of `pseudo_inverse`.

    Returns
    -------
    (..., n, k) array
        Basis vectors as columns. k is the largest nullity in the batch; a Jacobian with fewer has columns of zeros at the
        end, so that ``N @ z`` is a self-motion for any z, and ``N @ N^T`` projects onto the self-motions.

    Raises
    ------
    ArrayError
        When the shape is wrong, a number is not finite, or the cutoff is outside [0, 1).

    Examples
    --------
    Two joints about one axis: turning one forth and the other back moves nothing.

    >>> N = null_space([[0.0, 0.0], [1.0, 1.0]])
    >>> np.abs(N[:, 0]).round(6)
    array([0.707107, 0.707107])
    """
    jacobian = stack(J, ("m", "n"), "J")
    n = jacobian.shape[-1]
    _, s, Vt = np.linalg.svd(jacobian, full_matrices=True)
    ranks = _nonzero(s, jacobian.shape[-2:], cutoff).sum(axis=-1)
    k = int(np.max(n - ranks, initial=0))
    # the columns of V from the last one backwards; beyond its own nullity a Jacobian gets zeros
    backwards = np.swapaxes(Vt, -1, -2)[..., ::-1][..., :k]
    inside = np.arange(k) < (n - ranks)[..., None]
    return np.where(inside[..., None, :], backwards, 0.0)


def manipulability(J: ArrayLike, *, characteristic_length: float = 1.0) -> FloatArray:
    """Yoshikawa's measure ``sqrt(det(J J^T))``, computed as the product of the singular values (Yoshikawa 1985).

    The product keeps its relative accuracy near a singularity to ``1e-16 max(s) / min(s)``. The determinant squares that
    error, and may come out negative.

    Parameters
    ----------
    J : (..., m, n) array
        Jacobians; six rows, or the rows that matter, for example the linear three.
    characteristic_length : float
        Metres that count as one radian [m]; only for six rows.

    Returns
    -------
    (...) array
        Zero at a singularity. With fewer joints than rows it is the product of the n singular values,
        ``sqrt(det(J^T J))``: Yoshikawa's own measure would be 0 in every pose of such an arm.

    Raises
    ------
    ArrayError
        When the shape is wrong, a number is not finite, or the length is not positive or given for other than six rows.

    Notes
    -----
    Its unit depends on the rows and joints, and its value on the size of the arm: compare poses of one arm, not arms.

    Examples
    --------
    Two links of 1 m and 0.5 m in a plane, elbow at 90 degrees: the product of the lengths.

    >>> float(manipulability([[-0.5, -0.5], [1.0, 0.0]]).round(12))
    0.5
    """
    jacobian = _weighed(J, characteristic_length)
    return np.asarray(_singular_values(jacobian).prod(axis=-1))


def condition(J: ArrayLike, *, characteristic_length: float = 1.0) -> FloatArray:
    """Condition number, largest over smallest singular value: 1 where the arm moves alike in all directions.

    Parameters
    ----------
    J : (..., m, n) array
        Jacobians.
    characteristic_length : float
        Metres that count as one radian [m]; only for six rows.

    Returns
    -------
    (...) array
        From 1 to infinity; infinite where the smallest singular value is zero to rounding.

    Raises
    ------
    ArrayError
        When the shape is wrong, a number is not finite, or the length is not positive or given for other than six rows.

    Examples
    --------
    >>> float(condition([[3.0, 0.0], [0.0, 1.5]]))
    2.0
    """
    jacobian = _weighed(J, characteristic_length)
    s = _singular_values(jacobian)
    regular = _nonzero(s, jacobian.shape[-2:], None)[..., -1]
    return np.where(regular, s[..., 0] / np.where(regular, s[..., -1], 1.0), np.inf)


def distance_to_singularity(J: ArrayLike, *, characteristic_length: float = 1.0) -> FloatArray:
    """Smallest singular value: how little the Jacobian has to change, in the 2-norm, to lose a rank.

    That this is the distance to the nearest singular matrix is the theorem of Eckart and Young (Golub, Van Loan, theorem
    2.4.8). It is not a joint angle.

    Parameters
    ----------
    J : (..., m, n) array
        Jacobians.
    characteristic_length : float
        Metres that count as one radian [m]; only for six rows.

    Returns
    -------
    (...) array
        Tool speed per joint speed in the worst direction [-]: radians per radian, where the characteristic length counts
        as one.

    Raises
    ------
    ArrayError
        When the shape is wrong, a number is not finite, or the length is not positive or given for other than six rows.

    Examples
    --------
    >>> float(distance_to_singularity([[3.0, 0.0], [0.0, 1e-3]]))
    0.001
    """
    jacobian = _weighed(J, characteristic_length)
    return np.asarray(_singular_values(jacobian)[..., -1])


@dataclass(frozen=True, eq=False)
class Ellipsoid:
    """Velocities that joint velocities of unit length give. Made by `ellipsoid`.

    Attributes
    ----------
    axes : (..., r, r) array
        Principal directions as columns, orthonormal, longest first, in the frame of the Jacobian.
    lengths : (..., r) array
        Half axes [m/s or rad/s per unit joint velocity]; 0 where the direction is lost.
    """

    axes: FloatArray
    lengths: FloatArray

    @property
    def volume(self) -> FloatArray:
        """(...) product of the half axes; the volume of the ellipsoid but for the constant of the unit ball."""
        return np.asarray(self.lengths.prod(axis=-1))


def ellipsoid(J: ArrayLike, *, part: Literal["linear", "angular", "all"] = "linear") -> Ellipsoid:
    """Manipulability ellipsoid: where joint velocities of unit length can take the tip (Yoshikawa 1985).

    The set ``{J dq : |dq| <= 1}`` has its axes along the columns of U and the singular values for half axes. Linear
    and angular velocity make two ellipsoids: one over both would depend on the unit of length.

    Parameters
    ----------
    J : (..., 6, n) array
        Jacobians, linear rows first. With ``part="all"`` any (..., m, n).
    part : {"linear", "angular", "all"}
        The first three rows, the last three, or all rows as they are.

    Returns
    -------
    Ellipsoid
        Each axis with its largest component positive.

    Raises
    ------
    ArrayError
        When the shape is wrong, a number is not finite, or the part has another name.

    Examples
    --------
    >>> J = np.diag([3.0, 1.0, 2.0, 1.0, 1.0, 1.0])
    >>> e = ellipsoid(J)
    >>> e.lengths
    array([3., 2., 1.])
    >>> e.axes[:, 1]
    array([0., 0., 1.])
    """
    if part == "all":
        rows = stack(J, ("m", "n"), "J")
    elif part in ("linear", "angular"):
        jacobian = stack(J, (6, "n"), "J")
        rows = jacobian[..., :3, :] if part == "linear" else jacobian[..., 3:, :]
    else:
        raise ArrayError(f"part must be 'linear', 'angular' or 'all', got {part!r}")
    U, s, _ = np.linalg.svd(rows, full_matrices=True)
    lengths = np.zeros(rows.shape[:-1])
    lengths[..., : s.shape[-1]] = s
    return Ellipsoid(axes=_largest_positive(U), lengths=lengths)


@dataclass(frozen=True, eq=False)
class Singularity:
    """How near an arm is to a singularity, and which joints bring it there. Made by `singularity`.

    Attributes
    ----------
    near : (...) bool array
        True where the distance is below the threshold.
    distance : (...) array
        Smallest singular value [-], see `distance_to_singularity`.
    joint_motion : (..., n) array
        Unit joint velocity that moves the tip least, ``V[:, -1]``; its largest component is positive.
    tip_motion : (..., m) array
        Unit tip velocity that is lost, ``U[:, -1]``, weighed: its linear part times the characteristic length is in
        metres. Its largest component is positive.
    participation : (..., n) array
        Share of each joint in the (nearly) lost directions, from 0 to 1: the root of the sum of squares of its components
        over all the directions whose singular value is below the threshold, or over the last one when none is.
    lost : (...) int array
        How many directions are below the threshold.
    joint_names : tuple of n str
    """

    near: NDArray[np.bool_]
    distance: FloatArray
    joint_motion: FloatArray
    tip_motion: FloatArray
    participation: FloatArray
    lost: NDArray[np.int64]
    joint_names: tuple[str, ...]

    def joints(self, *, share: float = 0.2) -> list[str]:
        """Names of the joints with at least that participation, the strongest first; for one pose, not a batch.

        Raises
        ------
        ArrayError
            The report is of a batch.
        """
        if self.participation.ndim != 1:
            raise ArrayError(
                "joints() is for one pose; this report holds a batch of shape "
                f"{self.distance.shape}: use participation instead"
            )
        order = np.argsort(-self.participation, kind="stable")
        return [self.joint_names[i] for i in order if self.participation[i] >= share]

    def __str__(self) -> str:
        if self.distance.ndim > 0:
            return f"{int(self.near.sum())} of {self.near.size} poses are near a singularity"
        if not self.near:
            return f"not near a singularity: smallest singular value {float(self.distance):.3g}"
        names = self.joints()
        moves = ", ".join(
            f"{name} {float(self.joint_motion[self.joint_names.index(name)]):+.2f}"
            for name in names
            if abs(self.joint_motion[self.joint_names.index(name)]) >= 0.005
        )
        directions = "one direction" if self.lost == 1 else f"{int(self.lost)} directions"
        return (
            f"near a singularity: smallest singular value {float(self.distance):.3g}, {directions} of tip motion nearly lost; "
            f"caused by {', '.join(names)} (joint motion that hardly moves the tip: {moves})"
        )


def singularity(
    J: ArrayLike,
    *,
    characteristic_length: float = 1.0,
    threshold: float = 0.01,
    joint_names: Sequence[str] | None = None,
) -> Singularity:
    """Report on the nearest singularity: how far, which joints cause it, which tip motion is lost.

    The right singular vector of the smallest singular value is the joint motion with the least effect: where it is exactly
    singular those joints move against each other and the tip stands still. The left one is the tip motion
    that the joints cannot make.

    Parameters
    ----------
    J : (..., m, n) array
        Jacobians.
    characteristic_length : float
        Metres that count as one radian [m]; only for six rows.
    threshold : float
        Smallest singular value that still counts as regular [-].
    joint_names : sequence of n str, optional
        Names for the report; ``joint_1`` ... when not given.

    Returns
    -------
    Singularity

    Raises
    ------
    ArrayError
        When the shape is wrong, a number is not finite, the length or threshold is not positive, or the number of
        names is not n.

    Notes
    -----
    For an arm with more joints than rows the free self-motions, which are no singularity, are not counted: see
    `null_space`. For one with fewer joints than rows, the tip motions that it can never make are not counted either,
    only those that it loses in this pose. Where several directions are lost at once the single vectors are not determined, their
    span is; then `participation` is what to read.

    Examples
    --------
    A planar arm of two links, stretched out: the elbow has no say in the direction of the arm.

    >>> report = singularity([[0.0, 0.0], [1.5, 0.5]], joint_names=["shoulder", "elbow"])
    >>> float(report.distance.round(12)), report.joint_motion.round(4)
    (0.0, array([-0.3162,  0.9487]))
    >>> report.tip_motion
    array([1., 0.])
    """
    jacobian = _weighed(J, characteristic_length)
    n = jacobian.shape[-1]
    if not threshold > 0.0:
        raise ArrayError(f"threshold must be positive, got {threshold!r}")
    names = tuple(f"joint_{i + 1}" for i in range(n)) if joint_names is None else tuple(joint_names)
    if len(names) != n:
        raise ArrayError(f"joint_names must hold {n} names, one for each column of J, got {len(names)}")
    U, s, Vt = np.linalg.svd(jacobian, full_matrices=False)
    below = s < threshold
    counted = below.copy()
    counted[..., -1] = True
    participation: FloatArray = np.sqrt(((Vt * Vt) * counted[..., None]).sum(axis=-2))
    last = slice(-1, None)
    return Singularity(
        near=np.asarray(below[..., -1]),
        distance=np.asarray(s[..., -1]),
        joint_motion=_largest_positive(np.swapaxes(Vt, -1, -2)[..., last])[..., 0],
        tip_motion=_largest_positive(U[..., last])[..., 0],
        participation=participation,
        lost=np.asarray(below.sum(axis=-1), dtype=np.int64),
        joint_names=names,
    )


def _singular_values(jacobian: FloatArray) -> FloatArray:
    """From the largest to the smallest, ``(..., min(m, n))``."""
    return np.asarray(np.linalg.svd(jacobian, compute_uv=False), dtype=np.float64)


def _nonzero(s: FloatArray, shape: tuple[int, ...], cutoff: float | None) -> NDArray[np.bool_]:
    """Which singular values are above the cut-off; none of them when all are 0."""
    if cutoff is None:
        cutoff = max(shape) * _PRECISION
    elif not 0.0 <= cutoff < 1.0:
        raise ArrayError(f"cutoff must be relative to the largest singular value, from 0 up to below 1, got {cutoff!r}")
    above: NDArray[np.bool_] = s > cutoff * s[..., :1]
    return above


def _weighed(J: ArrayLike, characteristic_length: float) -> FloatArray:
    """The Jacobian with its three linear rows divided by the characteristic length."""
    jacobian = stack(J, ("m", "n"), "J")
    if characteristic_length == 1.0:
        return jacobian
    if not 0.0 < characteristic_length < np.inf:
        raise ArrayError(f"characteristic_length must be a positive number of metres, got {characteristic_length!r}")
    if jacobian.shape[-2] != 6:
        raise ArrayError(
            f"characteristic_length weighs metres against radians and needs J of shape (..., 6, n), got {jacobian.shape}"
        )
    weight = np.array([1.0 / characteristic_length] * 3 + [1.0] * 3)
    weighed: FloatArray = jacobian * weight[:, None]
    return weighed


def _largest_positive(columns: FloatArray) -> FloatArray:
    """Each column with the sign that makes its component of largest size positive."""
    largest = np.argmax(np.abs(columns), axis=-2)[..., None, :]
    sign = np.where(np.take_along_axis(columns, largest, axis=-2) < 0.0, -1.0, 1.0)
    return np.asarray(columns * sign, dtype=np.float64) + 0.0  # + 0.0 turns -0.0 into 0.0
