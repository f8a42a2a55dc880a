"""Joint values along a path of poses, and where they must break: what `pieper.motion.path_ik` finds."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np

from pieper.kinematics.jacobian import jacobian
from pieper.motion.path import METRES_PER_RADIAN

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from pieper.model.chain import Chain
    from pieper.spatial._checks import FloatArray

Reason = Literal["limit", "singularity", "unreachable", "branch"]

LARGEST_STEP, SMALLEST_BOUND, FULL_STEP = 0.5, 0.1, 0.02
"""A joint may move 0.5 rad [or m] between poses 0.02 m apart or more, in proportion less between nearer ones, but always 0.1 rad."""


def jump_bound(distance: ArrayLike) -> FloatArray:
    """How far a joint may move between poses that are `distance` (...) [m] of path length apart: (...) [rad or m].

    >>> jump_bound([0.0, 0.008, 1.0])
    array([0.1, 0.2, 0.5])
    """
    return np.asarray(np.clip(np.asarray(distance) / FULL_STEP * LARGEST_STEP, SMALLEST_BOUND, LARGEST_STEP))


@dataclass(frozen=True)
class PathBreak:
    """Where a joint path must end before its poses do.

    Attributes
    ----------
    s : float
        Length up to which it goes [m], to `precision`.
    index : int
        The last of the given poses that it reaches; -1 where the first one is missed already.
    reason : {"limit", "singularity", "unreachable", "branch"}
        A joint at its limit; the branch ends where it meets another one; the pose is out of reach; or other answers are there, and to
        reach them a joint would have to jump.
    message : str
        The same in words, with the joint or the direction.
    precision : float
        [m]
    start : (n,) array or None
        Where the path breaks at once because the arm stands in a singularity, as with a straight wrist: joint values at the same pose from
        which it goes on, if there are any [rad or m].
    """

    s: float
    index: int
    reason: Reason
    message: str
    precision: float
    start: FloatArray | None = None

    def __str__(self) -> str:
        return self.message


@dataclass(frozen=True, eq=False)
class JointPath:
    """Joint values for poses one behind the other, up to the last pose or to a break.

    Attributes
    ----------
    chain : Chain
    s : (m,) array
        Lengths [m], not decreasing.
    q : (m, n) array
        Joint values [rad or m], within the limits, turns undone.
    given : (m,) bool array
        Which rows belong to poses that were asked for; the others were added where steps had to be smaller.
    corners : (c,) array
        Lengths at which a move has to come to rest [m].
    branch : tuple of m str
        Labels of the answers, ``""`` where the arm has none.
    broken : PathBreak or None
        Why the path ends early.
    method : {"layers", "tracked"}
    """

    chain: Chain
    s: FloatArray
    q: FloatArray
    given: NDArray[np.bool_]
    corners: FloatArray
    branch: tuple[str, ...]
    broken: PathBreak | None
    method: Literal["layers", "tracked"]

    @property
    def complete(self) -> bool:
        """Whether every pose is reached."""
        return self.broken is None

    @cached_property
    def margin(self) -> FloatArray:
        """(m,): how far the joint nearest to one of its limits is away from it [rad or m]; infinite without limits."""
        lower, upper = self.chain.limits.T
        return np.asarray(np.minimum(self.q - lower, upper - self.q).min(axis=1))

    @cached_property
    def sensitivity(self) -> FloatArray:
        """(m,): joint motion for motion of the tip in the worst direction [rad/m], a radian of the tip counted as 0.1 m.

        The inverse of the least singular value of the Jacobian; infinite where it is singular. Found when first asked for.
        """
        if not len(self.q):
            return np.empty(0)
        J = jacobian(self.chain, self.q) * np.array([1.0] * 3 + [METRES_PER_RADIAN] * 3)[:, None]
        least = np.linalg.svd(J, compute_uv=False)[:, min(6, self.chain.dof) - 1]
        with np.errstate(divide="ignore"):
            return np.asarray(1.0 / least)

    def __repr__(self) -> str:
        end = "complete" if self.broken is None else f"broken: {self.broken.message}"
        return f"JointPath({self.chain.name!r}, {len(self.q)} poses, {end})"
