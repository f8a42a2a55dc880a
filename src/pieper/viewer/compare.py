"""Two models of an arm compared: where their tips are for the same joint values, and what joint values they give for the same pose.

`Comparison` is the logic, without a browser. Before two models can be compared it has to be said which joint is which, which way
each one turns, and how the tip frames lie to each other. The rules, all of which `Comparison.rules` tells in words:

Joints
    Those of the same name belong together, then those whose name begins with that of the other (``joint_5_b_inverted`` and
    ``joint_5_b``). Where no name is the same all are taken in their order, which needs the same number. A joint that the other
    model lacks stays at 0.
Signs
    The axes of two joints that belong together are compared in base axes with all joints at 0. Where they are opposite the
    value of the second is minus that of the first.
Tips
    The second tip frame is turned by quarter turns until it lies like the first with all joints at 0. What is left after that
    is a difference between the models.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from itertools import permutations, product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pieper.errors import ArrayError, PieperWarning
from pieper.ik import select
from pieper.kinematics.joints import as_joints
from pieper.spatial import rotation

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

    from pieper.arm import Arm
    from pieper.spatial._checks import FloatArray

_OPPOSITE = (
    -0.99
)  # cosine between two axes that are opposite; models of one arm agree far better, others are not compared
_QUARTER = 0.2  # [rad] a tip frame that quarter turns bring no nearer than this lies otherwise, and is left as it is
_SAMPLES = 2000
_GLANCES, _ONE_ARM = 100, 0.15  # poses, and how far tips of one arm are apart at most as a part of its reach
_AS_GOOD = (
    1e-3  # [m and rad together] a nearest pose on the branch of the arm may be worse by this than the best there is
)


class Difference(NamedTuple):
    """How far the tip of the second model is from that of the first."""

    offset: FloatArray
    """(..., 3) from the first tip to the second, in base axes [m]."""
    distance: FloatArray
    """(...) its length [m]."""
    angle: FloatArray
    """(...) the angle between the two tip frames [rad]."""


class Spread(NamedTuple):
    """Differences over many joint vectors within the limits of both models."""

    samples: int
    mean_distance: float
    """[m]"""
    largest_distance: float
    """[m]"""
    largest_angle: float
    """[rad]"""
    q: FloatArray
    """(n,) joint values of the first model where the distance is largest [rad or m]."""


class SolvedBoth(NamedTuple):
    """The joint values that both models give for one pose of the first tip."""

    q: FloatArray
    """(n,) of the first model [rad or m]; those that come nearest where the pose is out of its reach."""
    q_other: FloatArray
    """(n,) of the second in the same way, as values of the joints of the first."""
    missed: Difference
    """Where the first model says the tip is with `q_other`, from the pose that was asked for."""
    reason: str
    """What became of the pose, in words."""


@dataclass(frozen=True)
class Pair:
    """Two joints that belong together.

    Attributes
    ----------
    joint, other : int or None
        Places in the joint vectors of the two models; None for a joint that the other model lacks.
    sign : float
        The value of the other is this times that of the first.
    """

    joint: int | None
    other: int | None
    sign: float = 1.0


class Comparison:
    """Two models of one arm, joint by joint.

    Parameters
    ----------
    arm, other : Arm
        The first is the one that joint values are given for.
    signs : sequence of 1 and -1, optional
        One for each joint of `arm`, instead of the rule above.
    turn_tip : bool
        Whether the rule for tips holds; else the frames are compared as they are.
    names : tuple of 2 str, optional
        What the two are called in sentences; the names of the arms when not given, with a number where they are the same.

    Warns
    -----
    PieperWarning
        The tips are mostly further apart than models of one arm would have them, as those of two arms are.

    Raises
    ------
    ArrayError
        No joint has the same name and their numbers differ, or the signs are not 1 or -1 for every joint.

    Examples
    --------
    >>> import pieper
    >>> both = Comparison(pieper.load("mh12"), pieper.load("mh12-report"))
    >>> print(both.rules[2])
    joint_5_b_inverted = -joint_5_b: their axes are opposite
    >>> spread = both.spread(20000)
    >>> f"{spread.mean_distance:.2e} m, at most {spread.largest_distance:.2e} m and {spread.largest_angle:.2e} rad"
    '2.65e-04 m, at most 4.44e-04 m and 4.27e-04 rad'
    """

    def __init__(
        self,
        arm: Arm,
        other: Arm,
        *,
        signs: Sequence[float] | None = None,
        turn_tip: bool = True,
        names: tuple[str, str] | None = None,
    ) -> None:
        self.arm = arm
        self.other = other
        self.names = names or (arm.name, other.name if other.name != arm.name else f"{other.name} (2)")
        """What the two are called."""
        joints, by_name = _belonging(arm.joint_names, other.joint_names, "{!r} and {!r}".format(*self.names))
        given = None if signs is None else np.asarray(signs, dtype=np.float64)
        if given is not None and (given.shape != (arm.dof,) or not (np.abs(given) == 1.0).all()):
            raise ArrayError(
                f"signs must be {arm.dof} numbers 1 or -1, one for each joint of {self.names[0]!r}, got {signs!r}"
            )
        pairs = []
        for joint, its in joints:
            sign = 1.0
            if joint is not None and its is not None:
                opposite = _axis(arm, joint) @ _axis(other, its) < _OPPOSITE
                sign = float(given[joint]) if given is not None else -1.0 if opposite else 1.0
            pairs.append(Pair(joint, its, sign))
        self.pairs: tuple[Pair, ...] = tuple(pairs)
        """Which joint is which."""
        self.R_tip_other = np.eye(3)
        """(3, 3): how the second tip frame is turned before it is compared; ``R_base_other @ R_tip_other`` is."""
        apart = rotation.distance(arm.fk(self._zero)[:3, :3], self._tips(self._zero)[:3, :3])
        if turn_tip:
            R = other.fk(self.as_other(self._zero))[:3, :3].T @ arm.fk(self._zero)[:3, :3]
            turns = _quarter_turns()
            left = rotation.distance(turns, R)
            best = int(np.argmin(left))
            if left[best] < _QUARTER and left[best] < apart:
                self.R_tip_other = turns[best]
        doubt = self._doubt()
        if doubt:
            warnings.warn(doubt, PieperWarning, stacklevel=2)
        self.rules: tuple[str, ...] = (*self._rules(by_name, given is not None), *([doubt] if doubt else []))
        """How the models are compared, a sentence each."""

    # --- joint values

    def as_other(self, q: ArrayLike) -> FloatArray:
        """Joint values (..., n) of the first model as those of the second, (..., m) [rad or m]."""
        values = as_joints(self.arm.chain, q)
        made = np.zeros((*values.shape[:-1], self.other.dof))
        for pair in self.pairs:
            if pair.joint is not None and pair.other is not None:
                made[..., pair.other] = pair.sign * values[..., pair.joint]
        return made

    def from_other(self, q: ArrayLike) -> FloatArray:
        """Joint values (..., m) of the second model as those of the first, (..., n) [rad or m]."""
        values = as_joints(self.other.chain, q)
        made = np.zeros((*values.shape[:-1], self.arm.dof))
        for pair in self.pairs:
            if pair.joint is not None and pair.other is not None:
                made[..., pair.joint] = pair.sign * values[..., pair.other]
        return made

    def common(self, q: ArrayLike) -> FloatArray:
        """(..., n): `q` with the joints at 0 that the second model lacks; what can be compared [rad or m]."""
        values = as_joints(self.arm.chain, q).copy()
        for pair in self.pairs:
            if pair.joint is not None and pair.other is None:
                values[..., pair.joint] = 0.0
        return values

    # --- differences

    def difference(self, q: ArrayLike) -> Difference:
        """How far the tips are apart at joint values (..., n) of the first model [rad or m].

        A joint that the second model lacks is taken to be at 0 in both: otherwise its motion would count as a difference.
        """
        values = self.common(q)
        return _between(self.arm.fk(values), self._tips(values))

    def spread(self, count: int = _SAMPLES, *, seed: int = 0) -> Spread:
        """The differences over random joint vectors within the limits of both models, evenly drawn.

        A joint without limits is drawn from one whole turn, or from a metre.

        Raises
        ------
        ArrayError
            The count is below 1.
        """
        if count < 1:
            raise ArrayError(f"count must be at least 1, got {count}")
        q = self._random(count, seed=seed)
        found = self.difference(q)
        worst = int(np.argmax(found.distance))
        return Spread(
            count,
            float(found.distance.mean()),
            float(found.distance[worst]),
            float(found.angle.max()),
            self.common(q[worst]),
        )

    def solve(self, T_base_tip: ArrayLike, q: ArrayLike) -> SolvedBoth:
        """Inverse kinematics of both models for one pose, each the solution nearest to `q` within limits.

        Parameters
        ----------
        T_base_tip : (4, 4) array
            The pose of the first tip in the base frame [m, -].
        q : (n,) array
            Joint values of the first model to be near to [rad or m].

        Returns
        -------
        SolvedBoth
            The joint values of both, and how far they are apart.
        """
        here = as_joints(self.arm.chain, q)
        T = np.asarray(T_base_tip, dtype=np.float64)
        T_other = T.copy()
        T_other[:3, :3] = T[:3, :3] @ self.R_tip_other.T
        q_first, why = _solution(self.arm, T, here)
        q_second, why_not = _solution(self.other, T_other, self.as_other(here))
        as_first = self.from_other(q_second)
        said = [f"{name}: {reason}" for name, reason in zip(self.names, (why, why_not), strict=True) if reason]
        return SolvedBoth(q_first, as_first, _between(T, self.arm.fk(as_first)), "; ".join(said) or "reached by both")

    @property
    def limits(self) -> FloatArray:
        """(n, 2) limits that both models keep; a whole turn or a metre where there are none, 0 for joints that stay [rad or m]."""
        made = np.zeros((self.arm.dof, 2))
        for pair in self.pairs:
            if pair.joint is None or pair.other is None:
                continue
            mine, its = self.arm.limits[pair.joint], np.sort(pair.sign * self.other.limits[pair.other])
            both = np.array([max(mine[0], its[0]), min(mine[1], its[1])])
            turns = bool(self.arm.chain.is_revolute[self.arm.chain.coupling[:, pair.joint] != 0.0].all())
            wide = np.pi if turns else 0.5
            both = np.where(np.isfinite(both), both, [-wide, wide])
            made[pair.joint] = both if both[0] <= both[1] else mine
        return made

    # --- what the methods share

    def _random(self, count: int, *, seed: int) -> FloatArray:
        """(count, n) joint values within the limits of both."""
        lower, upper = self.limits.T
        return np.asarray(lower + (upper - lower) * np.random.default_rng(seed).random((count, self.arm.dof)))

    @property
    def _zero(self) -> FloatArray:
        return np.zeros(self.arm.dof)

    def _tips(self, q: FloatArray) -> FloatArray:
        """Poses of the second tip, turned, at joint values of the first model."""
        T = self.other.fk(self.as_other(q))
        T[..., :3, :3] = T[..., :3, :3] @ self.R_tip_other
        return T

    def _doubt(self) -> str:
        """What to say where the tips are so far apart that the models may be of two arms; mostly nothing."""
        apart = float(np.median(self.difference(self._random(_GLANCES, seed=0)).distance))
        steps = np.diff([frame.home[:3, 3] for frame in self.arm.chain.frames], axis=0)
        reach = float(np.linalg.norm(steps, axis=1).sum())
        if apart <= _ONE_ARM * reach:
            return ""
        return (
            f"{self.names[0]} and {self.names[1]} do not look like models of one arm: for the same joint values their tips are mostly "
            f"more than {apart:.2g} m apart; look whether the joints belong together, their zeros and the tip frames"
        )

    def _rules(self, by_name: bool, signs_given: bool) -> list[str]:
        names, others = self.arm.joint_names, self.other.joint_names
        said = ["joints belong together by name" if by_name else "joints belong together in their order"]
        for pair in self.pairs:
            if pair.other is None and pair.joint is not None:
                said.append(f"{names[pair.joint]} stays at 0: {self.names[1]} has no such joint")
            elif pair.joint is None and pair.other is not None:
                said.append(f"{others[pair.other]} of {self.names[1]} stays at 0: {self.names[0]} has no such joint")
            elif pair.joint is not None and pair.other is not None and pair.sign < 0.0:
                why = "as given" if signs_given else "their axes are opposite"
                said.append(f"{others[pair.other]} = -{names[pair.joint]}: {why}")
        if not np.array_equal(self.R_tip_other, np.eye(3)):
            axis, angle = rotation.as_axis_angle(self.R_tip_other)
            about = " ".join(f"{value + 0.0:.3g}" for value in axis)
            said.append(
                f"{self.other.tip} is turned by {np.degrees(angle):.0f} deg about ({about}) to lie like {self.arm.tip}"
            )
        return said


def _belonging(
    names: Sequence[str], others: Sequence[str], arms: str
) -> tuple[list[tuple[int | None, int | None]], bool]:
    """Which joint is which, in the order of the first, then those of the second that are left; and whether names told."""
    found: dict[int, int] = {}
    free = list(range(len(others)))
    for whole in (True, False):
        for i, name in enumerate(names):
            match = next((k for k in free if i not in found and _is_like(name, others[k], whole=whole)), None)
            if match is not None:
                found[i] = match
                free.remove(match)
        if not found:
            break  # without a single name in common, beginnings mean nothing
    by_name = bool(found)
    if not by_name:
        if len(names) != len(others):
            raise ArrayError(
                f"{arms} have no joint name in common and {len(names)} and {len(others)} joints; rename the joints of one, "
                "or lock those that the other lacks"
            )
        found, free = {i: i for i in range(len(names))}, []
    return [*((i, found.get(i)) for i in range(len(names))), *((None, k) for k in free)], by_name


def _is_like(name: str, other: str, *, whole: bool) -> bool:
    return name == other if whole else name.startswith(other) or other.startswith(name)


def _axis(arm: Arm, joint: int) -> FloatArray:
    """(3,) direction of the axis that a joint turns about or slides along with all joints at 0, in base axes; 0 for several."""
    axes = np.flatnonzero(arm.chain.coupling[:, joint])
    if len(axes) != 1:
        return np.zeros(3)
    screw = arm.chain.screws[axes[0]] * np.sign(arm.chain.coupling[axes[0], joint])
    return np.asarray(screw[3:] if screw[3:].any() else screw[:3])


def _quarter_turns() -> FloatArray:
    """(24, 3, 3): the rotations of a cube."""
    found = []
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            R = np.zeros((3, 3))
            R[np.arange(3), order] = signs
            if np.linalg.det(R) > 0.0:
                found.append(R)
    return np.array(found)


def _solution(arm: Arm, T: FloatArray, q: FloatArray) -> tuple[FloatArray, str]:
    """The solution within limits nearest to `q`, or else joint values that come nearest to the pose, and why."""
    answers = arm.ik(T, q)
    if answers.reached:
        return select.nearest(select.within_limits(answers), q), ""
    best = answers.nearest
    here = arm.ik(T, np.clip(q, *arm.limits.T), method="numeric", count=1, restarts=1).nearest  # of the same branch
    as_good = here.position_error + here.rotation_error < best.position_error + best.rotation_error + _AS_GOOD
    return np.asarray(here.q if as_good else best.q), answers.reason


def _between(T_first: FloatArray, T_second: FloatArray) -> Difference:
    offset = np.asarray(T_second[..., :3, 3] - T_first[..., :3, 3])
    return Difference(
        offset,
        np.asarray(np.linalg.norm(offset, axis=-1)),
        rotation.distance(T_first[..., :3, :3], T_second[..., :3, :3]),
    )
