"""What measurements can tell about the parameters of an arm: rank, precision, and what they cannot see, in words.

With residuals divided by their standard deviations and parameters by their scale (1 rad, and the size of the arm), the singular values
of the Jacobian are the reciprocals of the standard deviations of the combinations of parameters that its right vectors name. A value of
zero is a combination that the measurements do not see at all.

References
----------
Golub, Van Loan, Matrix computations, section 5.5 (rank by singular values, QR with pivots).
Borm, Menq, Determination of optimal measurement configurations for robot calibration, IJRR 10 (1991), for the choice of poses; here the
determinant of the information is made large, one pose at a time.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from collections.abc import Sequence

    from pieper.kinematics.screw_parameters import Parameter

FloatArray = NDArray[np.float64]

SEEN = 0.05
"""A combination of parameters whose standard deviation is above this, as an angle or as a share of the arm, is held and not fitted."""

_ROUNDING = 1e-10  # of the largest singular value: less is zero but for rounding
_PART = 1e-3  # of the largest part of a direction: less is not told


@dataclass(frozen=True, eq=False)
class Identifiability:
    """What the measurements see.

    Attributes
    ----------
    parameters : tuple of Parameter
    rank : int
        How many combinations of them are seen.
    condition : float
        Largest singular value over the smallest that is seen: how evenly they are seen.
    sigma : (p,) array
        Standard deviation of each parameter to first order [m or rad]; infinite where it is not seen.
    unseen : tuple of str
        The combinations that are not seen, in words, and why where that is known.
    null_space : (p, p - rank) array
        The same as orthonormal columns, in scaled parameters.
    """

    parameters: tuple[Parameter, ...]
    rank: int
    condition: float
    sigma: FloatArray
    unseen: tuple[str, ...]
    null_space: FloatArray

    @property
    def complete(self) -> bool:
        """Whether every parameter is seen."""
        return self.rank == len(self.parameters)


@dataclass(frozen=True, eq=False)
class Seen:
    """A Jacobian taken apart: ``U diag(s) V^T`` of whitened residuals by scaled parameters, and how many of `s` are seen."""

    U: FloatArray
    s: FloatArray
    Vt: FloatArray
    rank: int
    tolerance: float


def take_apart(J: FloatArray, noise: float) -> Seen:
    """Singular values of a whitened, scaled Jacobian, (rows, p); `noise` is the scale of the whitened residuals, 0 when there is none."""
    U, s, Vt = np.linalg.svd(J, full_matrices=False)
    largest = float(s[0]) if s.size else 0.0
    tolerance = max(_ROUNDING * largest, noise / SEEN)
    return Seen(U, s, Vt, int(np.count_nonzero(s > tolerance)), tolerance)


def report(
    seen: Seen,
    parameters: Sequence[Parameter],
    scale: FloatArray,
    noise: float,
    *,
    positions_only: bool,
    still: Sequence[str],
) -> Identifiability:
    """Say what a Jacobian sees.

    Parameters
    ----------
    seen : Seen
    parameters : sequence of p Parameter
    scale : (p,) array
        What the columns were multiplied by [m or rad].
    noise : float
        Scale of the whitened residuals.
    positions_only : bool
    still : sequence of str
        Joints that stood still in all measurements.

    Returns
    -------
    Identifiability
    """
    rows = seen.Vt[: seen.rank]
    variance = np.sum((rows / seen.s[: seen.rank, None]) ** 2, axis=0)
    full = np.linalg.svd(rows, full_matrices=True)[2] if seen.rank else np.eye(len(parameters))
    null = full[seen.rank :].T
    lost = np.sqrt(np.sum(null**2, axis=1)) > _PART
    sigma = np.where(lost, np.inf, noise * np.sqrt(variance) * scale)
    condition = float(seen.s[0] / seen.s[seen.rank - 1]) if seen.rank else float("inf")
    words = tuple(_in_words(null, parameters, scale, positions_only, still))
    return Identifiability(tuple(parameters), seen.rank, condition, sigma, words, null)


def _in_words(
    null: FloatArray, parameters: Sequence[Parameter], scale: FloatArray, positions_only: bool, still: Sequence[str]
) -> list[str]:
    count = null.shape[1]
    if not count:
        return []
    said: list[str] = []
    turned: list[str] = []
    for direction in _sparse(null).T:
        parts = np.flatnonzero(np.abs(direction) > _PART * np.abs(direction).max())
        parts = parts[np.argsort(-np.abs(direction[parts]), kind="stable")]
        told = [parameters[int(i)] for i in parts]
        if positions_only and len(told) == 1 and told[0].kind == "home" and told[0].unit == "rad":
            turned.append(told[0].motion.removeprefix("turned about "))
            continue
        names = [p.name for p in told]
        text = names[0]
        if len(names) > 1:
            text += " together with " + ", ".join(names[1:4])
            if len(names) > 4:
                text += f" and {len(names) - 4} more"
        said.append(f"{text}: {_why(told, positions_only, still)}")
    if turned:
        frame = next(p.of for p in parameters if p.kind == "home")
        axes = " and ".join([", ".join(turned[:-1]), turned[-1]] if len(turned) > 1 else turned)
        said.append(f"frame {frame} turned about {axes}: positions do not show the orientation of the tip")
    return said


def _why(told: Sequence[Parameter], positions_only: bool, still: Sequence[str]) -> str:
    """The reason where it can be known, else that the measurements do not show it."""
    kinds = {p.kind for p in told}
    joints = {p.of.partition(" (axis")[0] for p in told if p.kind in ("screws", "offsets")}
    resting = sorted(joints & set(still))
    if resting:
        return f"{', '.join(resting)} stood still in every measurement"
    if kinds == {"offsets"} and len(told) == 1 and positions_only:
        return f"{told[0].of} turned about its own axis does not move the tip's position; measure poses, or a tip beside the axis"
    if "offsets" in kinds and kinds & {"screws", "home"}:
        return "the zero of a joint is the same as a change of the axes and the tip after it; free one of the two"
    if "base" in kinds and kinds - {"base"}:
        return "a base that stands elsewhere is the same as axes and a tip that do; free one of the two"
    if positions_only and len(joints) == 1 and kinds <= {"screws", "home"}:
        return (
            f"the tip lies on the axis of {next(iter(joints))}, or nearly so; measure poses, or a tip beside the axis"
        )
    return "these measurements do not tell them apart; measure more poses, farther apart"


def _sparse(null: FloatArray) -> FloatArray:
    """A basis of the same space in which each vector has one parameter to itself, by pivots."""
    from scipy.linalg import qr

    count = null.shape[1]
    pivots = qr(null.T, mode="r", pivoting=True)[1][:count]
    return np.asarray(null @ np.linalg.inv(null[pivots]))


def most_telling(information: FloatArray, candidates: FloatArray, count: int) -> NDArray[np.intp]:
    """Which measurements to add, one after the other, each the one that makes the determinant of the information largest.

    Parameters
    ----------
    information : (p, p) array
        ``J^T J`` of what was measured, whitened and scaled.
    candidates : (c, d, p) array
        Whitened, scaled Jacobians of measurements that could be made.
    count : int

    Returns
    -------
    (count,) array of indices
    """
    floor = SEEN**-2  # what is not seen counts as known to about SEEN
    P = np.linalg.inv(information + floor * np.eye(len(information)))
    chosen: list[int] = []
    for _ in range(count):
        JP = candidates @ P
        gain = np.linalg.slogdet(np.eye(candidates.shape[1]) + JP @ np.swapaxes(candidates, 1, 2))[1]
        gain[chosen] = -np.inf
        best = int(np.argmax(gain))
        chosen.append(best)
        J = candidates[best]
        PJ = P @ J.T
        P = P - PJ @ np.linalg.solve(np.eye(len(J)) + J @ PJ, PJ.T)
    return np.array(chosen, dtype=np.intp)
