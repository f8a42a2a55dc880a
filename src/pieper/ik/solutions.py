"""What a solver gives back: answers that carry their own errors, and the nearest pose where there is none."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pieper._native import kernels
from pieper.errors import ArrayError

if TYPE_CHECKING:
    from pieper.model.chain import Chain

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

EXACT = 1e-10
"""An answer with errors up to this [m and rad] is called exact: what rounding leaves, near singular poses too."""


class Status(IntEnum):
    """How a target ended."""

    reached = kernels.NumericStatus.reached.value
    """At least one answer is valid."""
    unreachable = kernels.NumericStatus.unreachable.value
    """No answer: every start came to rest elsewhere, and `IKSolutions.nearest` is the best of them."""
    not_converged = kernels.NumericStatus.not_converged.value
    """No answer, and the nearest pose found was still getting nearer when the solver stopped."""


@dataclass(frozen=True, eq=False)
class Nearest:
    """The nearest pose for targets that were not reached; NaN for those that were.

    Attributes
    ----------
    q : (..., n) array
        Joint values [rad or m], within limits.
    position_error : (...) array
        Distance that is left [m].
    rotation_error : (...) array
        Angle that is left [rad].
    out_of_reach : (...) array
        Distance that is left when the orientation is free [m]: by so much the position itself is out of reach.
    """

    q: FloatArray
    position_error: FloatArray
    rotation_error: FloatArray
    out_of_reach: FloatArray


@dataclass(frozen=True, eq=False)
class IKSolutions:
    """Up to k answers for every target, each judged by itself.

    Attributes
    ----------
    chain : Chain
        The arm.
    q : (..., k, n) array
        Joint values [rad or m]; NaN where ``valid`` is False.
    valid : (..., k) bool array
        True for an answer that meets the target within the tolerances.
    position_error, rotation_error : (..., k) arrays
        Measured at the pose that forward kinematics gives for the answer, over the rows that count [m] and [rad].
    within_limits : (..., k) bool array
        True for a valid answer inside the joint limits.
    status : (...) int array
        A `Status` for every target.
    nearest : Nearest
        The nearest pose where there is no answer. Never among the answers.
    complete : bool
        True when the method lists every answer that there is; a numeric solver finds some.
    position_tolerance, rotation_tolerance : float
        What `valid` was judged by [m] and [rad].
    """

    chain: Chain
    q: FloatArray
    valid: BoolArray
    position_error: FloatArray
    rotation_error: FloatArray
    within_limits: BoolArray
    status: NDArray[np.int8]
    nearest: Nearest
    complete: bool
    position_tolerance: float
    rotation_tolerance: float

    @property
    def exact(self) -> BoolArray:
        """(..., k): True for answers whose errors are those of rounding, up to `EXACT`; loose tolerances admit others."""
        return np.asarray(self.valid & (self.position_error <= EXACT) & (self.rotation_error <= EXACT))

    @property
    def reached(self) -> BoolArray:
        """(...): True for targets with a valid answer."""
        return np.asarray(self.valid.any(axis=-1))

    @property
    def count(self) -> NDArray[np.int64]:
        """(...): number of valid answers."""
        return np.asarray(self.valid.sum(axis=-1))

    @property
    def reason(self) -> str:
        """What became of the target, in words; for one target, see `reasons` for a batch."""
        if self.status.ndim:
            raise ArrayError(f"reason is for one target; this holds a batch of shape {self.status.shape}: use reasons")
        return str(self.reasons[()])

    @property
    def reasons(self) -> NDArray[Any]:
        """(...) object array: what became of each target, in words."""
        words = np.empty(self.status.shape, dtype=object)
        for index in np.ndindex(self.status.shape):
            words[index] = self._reason(index)
        return words

    def _reason(self, index: tuple[int, ...]) -> str:
        status = Status(int(self.status[index]))
        if status is Status.reached:
            if not self.valid[index].any():
                return "reached, but no answer is left: those that there were have been sorted out"
            best = int(np.argmax(self.valid[index]))
            position, rotation = self.position_error[index][best], self.rotation_error[index][best]
            return f"reached: {_left(float(position), float(rotation))} left"
        near = self.nearest
        position, rotation = float(near.position_error[index]), float(near.rotation_error[index])
        left = f"the nearest pose found leaves {_left(position, rotation)}"
        out = float(near.out_of_reach[index])
        if status is Status.not_converged:
            far = f", and the position is out of reach by {out:.3g} m" if out > self.position_tolerance else ""
            return f"not converged: {left} and was still getting nearer{far}"
        if out > self.position_tolerance:
            return f"out of reach by {out:.3g} m; {left}"
        if not np.isnan(out):
            return f"the position is within reach, but not with this orientation; {left}"
        return f"out of reach; {left}"

    def __str__(self) -> str:
        if self.status.ndim:
            return f"{int(self.reached.sum())} of {self.status.size} targets reached"
        return self.reason


def _left(position: float, rotation: float) -> str:
    """Both errors in words; an angle of exactly 0 is one that does not count."""
    return f"{position:.3g} m" + (f" and {rotation:.3g} rad" if rotation != 0.0 else "")
