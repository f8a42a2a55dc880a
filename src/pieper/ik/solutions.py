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
    from collections.abc import Callable, Iterator, Mapping

    from numpy.typing import ArrayLike

    from pieper.ik.curve import SolutionCurve
    from pieper.ik.target import Target
    from pieper.model.chain import Chain

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

EXACT = 1e-10
"""An answer with errors up to this [m and rad] is called exact: what rounding leaves, near singular poses too."""


class Status(IntEnum):
    """How a target ended."""

    reached = kernels.AnswerStatus.reached.value
    """At least one answer is inside the joint limits."""
    unreachable = kernels.AnswerStatus.unreachable.value
    """No answer. Where the method is complete there is none; else every start came to rest elsewhere."""
    not_converged = kernels.NumericStatus.not_converged.value
    """No answer, and the nearest pose found was still getting nearer when the solver stopped."""
    outside_limits = kernels.AnswerStatus.outside_limits.value
    """There are answers, but each violates a joint limit."""
    malformed = 4
    """The target of this row of a batch is no pose: `IKSolutions.reasons` tells what is wrong with it."""


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


@dataclass(eq=False, slots=True, repr=False)
class IKSolutions:
    """Up to k answers for every target, each judged by itself.

    Answers inside the joint limits come first; among them the one nearest to the seed or, without a seed, the one of the
    lowest branch. Each joint that turns is given as the copy nearest to the seed (or to the middle of its limits) that its
    limits allow; `copies` lists the others.

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
    branch : (..., k) int array
        Number of the branch, an index into ``branch_names``; -1 where branches have no names. See `labels`.
    status : (...) int array
        A `Status` for every target.
    complete : (...) bool array
        True where every isolated answer that there is has been listed.
    find_nearest : callable
        Finds the nearest poses of these answers. Called once, by `nearest`.
    position_tolerance, rotation_tolerance : float
        What `valid` was judged by [m] and [rad].
    branch_names : tuple of str
        What the branches are called, as in ``"front, elbow up, no flip"``; empty where they have no names.
    free : int
        Number of directions in which answers can be moved without leaving the target: 0 for isolated answers, else the answers
        are samples. See `curves`, also for poses at which single answers can be moved.
    malformed : mapping or None
        What is wrong with the targets of status `Status.malformed`, by index.
    target : Target or None
        The rows that count, where those are not all six.
    """

    chain: Chain
    q: FloatArray
    valid: BoolArray
    position_error: FloatArray
    rotation_error: FloatArray
    within_limits: BoolArray
    branch: NDArray[np.int8]
    status: NDArray[np.int8]
    complete: BoolArray
    find_nearest: Callable[[IKSolutions], Nearest]
    position_tolerance: float
    rotation_tolerance: float
    branch_names: tuple[str, ...] = ()
    free: int = 0
    malformed: Mapping[tuple[int, ...], str] | None = None
    target: Target | None = None
    _nearest: Nearest | None = None

    @property
    def nearest(self) -> Nearest:
        """The nearest poses within limits, for targets that were not reached. Never among the answers; found when first asked for."""
        if self._nearest is None:
            self._nearest = self.find_nearest(self)
        return self._nearest

    @property
    def labels(self) -> NDArray[Any]:
        """(..., k) object array: the branch of each answer in words, ``""`` where it has none."""
        names = np.array([*self.branch_names, ""], dtype=object)
        return np.asarray(names[self.branch])

    @property
    def limit_margin(self) -> FloatArray:
        """(..., k): how far the joint nearest to one of its limits is away from it [rad or m]; negative outside, NaN where invalid."""
        lower, upper = self.chain.limits.T
        return np.asarray(np.minimum(self.q - lower, upper - self.q).min(axis=-1))

    @property
    def exact(self) -> BoolArray:
        """(..., k): True for answers whose errors are those of rounding, up to `EXACT`; loose tolerances admit others."""
        return np.asarray(self.valid & (self.position_error <= EXACT) & (self.rotation_error <= EXACT))

    @property
    def reached(self) -> BoolArray:
        """(...): True for targets with an answer inside the joint limits, which is then the first one."""
        return np.asarray(self.within_limits.any(axis=-1))

    @property
    def count(self) -> NDArray[np.int64]:
        """(...): number of valid answers, inside limits or not."""
        return np.asarray(self.valid.sum(axis=-1))

    @property
    def reason(self) -> str:
        """What became of the target, in words; for one target, see `reasons` for a batch.

        Raises
        ------
        ArrayError
            There is more than one target.
        """
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
        if status is Status.malformed:
            return (self.malformed or {})[index]
        if status is Status.reached:
            if not self.valid[index].any():
                return "reached, but no answer is left: those that there were have been sorted out"
            best = int(np.argmax(self.valid[index]))
            position, rotation = self.position_error[index][best], self.rotation_error[index][best]
            return f"reached: {_left(float(position), float(rotation))} left"
        if status is Status.outside_limits and not self.valid[index].any():
            return "reachable, but no answer is left: those that there were have been sorted out"
        if status is Status.outside_limits:
            return f"reachable, but every solution violates {self._violation(index)}"
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

    def _violation(self, index: tuple[int, ...]) -> str:
        """The joint that every answer violates, or else the least violation of all."""
        lower, upper = self.chain.limits.T
        q = self.q[index][self.valid[index]]
        excess = np.maximum(lower - q, q - upper)
        always = np.flatnonzero((excess > 0.0).all(axis=0))
        if always.size:
            joint = int(always[np.argmax(excess[:, always].min(axis=0))])
            return f"{self.chain.joint_names[joint]}: nearest limit {self._amount(joint, float(excess[:, joint].min()))} away"
        worst = excess.max(axis=1)
        answer = int(np.argmin(worst))
        joint = int(np.argmax(excess[answer]))
        return f"a limit; the least is {self.chain.joint_names[joint]} by {self._amount(joint, float(worst[answer]))}"

    def _amount(self, joint: int, value: float) -> str:
        turns = (self.chain.coupling[:, joint] != 0.0) & self.chain.is_revolute
        return f"{np.degrees(value):.3g} deg" if turns.any() else f"{value:.3g} m"

    def curves(self) -> list[SolutionCurve]:
        """The curves of solutions that pass through the answers; for one target.

        Most poses of six joints have none. With a straight wrist, or the wrist above axis 1, two joints can turn against each
        other; each answer is then a point of a curve, which tells its free direction and, in words, the coupling. Arms with
        seven joints and targets that leave one direction free have curves everywhere.

        Returns
        -------
        list of SolutionCurve
            One for each curve, not for each answer; see `pieper.ik.curve.follow`.

        Raises
        ------
        ArrayError
            For a batch, or where the solutions form surfaces.

        Examples
        --------
        >>> from pieper.ik.solve import solve
        >>> from pieper.kinematics.fk import fk
        >>> from pieper.model import catalog
        >>> arm = catalog.describe("kuka_kr210_robond").chain()
        >>> answers = solve(arm, fk(arm, [0.1, 0.2, 0.3, 0.4, 0.0, 0.6]))
        >>> answers.curves()[0].coupling
        'joint_4 + joint_6 = const'
        """
        from pieper.ik.curve import follow
        from pieper.kinematics.fk import fk

        if self.status.ndim:
            raise ArrayError(f"curves are for one target; this holds a batch of shape {self.status.shape}")
        found: list[SolutionCurve] = []
        for q in self.q[self.valid]:
            if any(bool(curve.contains(q)) for curve in found):
                continue
            wanted = fk(self.chain, q) if self.target is None else self.target
            curve = follow(self.chain, wanted, q)
            if curve is not None:
                found.append(curve)
        return found

    def copies(self, *, seed: ArrayLike | None = None) -> Iterator[FloatArray]:
        """Every copy of every answer by whole turns that is inside the limits, nearest first; for one target.

        Parameters
        ----------
        seed : (n,) array, optional
            Joint values to be near to [rad or m]; the middle of the limits when not given.

        Yields
        ------
        (n,) array
            Joint values [rad or m]. Joints without limits are given once, as the copy nearest to the seed.

        Raises
        ------
        ArrayError
            For a batch, or a malformed seed.

        Notes
        -----
        Made one at a time: an arm whose six joints can turn twice has 64 copies of each answer.

        Examples
        --------
        >>> from pieper.ik.solve import solve
        >>> from pieper.kinematics.fk import fk
        >>> from pieper.model import catalog
        >>> arm = catalog.describe("ur5e").chain()
        >>> answers = solve(arm, fk(arm, [0.1, -1.2, 1.4, -1.7, -1.5, 0.3]))
        >>> sum(1 for _ in answers.copies())
        256
        """
        from pieper.ik.copies import copies_of

        if self.status.ndim:
            raise ArrayError(f"copies are for one target; this holds a batch of shape {self.status.shape}")
        return copies_of(self.chain, self.q[self.valid], seed)

    def __bool__(self) -> bool:
        """Refused: answers that reach nothing are answers too, and ``if answers:`` would hold for them."""
        raise ArrayError(
            f"the answers have no truth value; ask answers.reached, which is True or False for each target, got {self}"
        )

    def __repr__(self) -> str:
        return f"IKSolutions({self.chain.name!r}, {self.valid.shape[-1]} places, {self})"

    def __str__(self) -> str:
        if self.status.ndim:
            return f"{int(self.reached.sum())} of {self.status.size} targets reached"
        return self.reason


def _left(position: float, rotation: float) -> str:
    """Both errors in words; an angle of exactly 0 is one that does not count."""
    return f"{position:.3g} m" + (f" and {rotation:.3g} rad" if rotation != 0.0 else "")
