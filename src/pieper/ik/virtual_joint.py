"""Virtual joints: a target that leaves the tip free to turn is a whole pose for an arm with more joints.

A joint that turns the tip about its own origin changes no position, and one about a tool axis does not change where that axis
points. So

- position and one axis, on five joints, is the whole pose of an arm with a sixth joint about that axis through the tip, with
  any turn about it: ``T = T_arm(q_1 ... q_5) exp(s_virtual q_6)``;
- a position alone, on three joints, is the whole pose of an arm with three virtual joints that meet in the tip: a
  spherical wrist.

What solves six joints then finds every answer, and the virtual joints are dropped.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pieper.errors import ArrayError
from pieper.ik.closed_form import solve_closed_form
from pieper.ik.family import Family, find_family
from pieper.ik.general_6r import Flag, solve_general_6r
from pieper.ik.prepared import prepared
from pieper.model.chain import free_name

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

    from pieper.model.chain import Chain
    from pieper.spatial._checks import FloatArray


def add_virtual_joints(chain: Chain, axes_tip: ArrayLike) -> Chain:
    """The arm with more joints, which turn the tip about axes through its origin.

    Parameters
    ----------
    chain : Chain
        Any chain without mimic joints.
    axes_tip : (m, 3) array
        Their directions at zero in the tip frame, in the order from arm to tip; any length but 0.

    Returns
    -------
    Chain
        With the joints ``virtual_1`` ... ``virtual_m`` last, without limits; the same home pose.

    Raises
    ------
    ArrayError
        Wrong shape, a direction of length 0, or a chain with mimic joints.

    Examples
    --------
    >>> from pieper.kinematics.fk import fk
    >>> from pieper.model import catalog
    >>> arm = catalog.describe("youbot").chain()
    >>> longer = add_virtual_joints(arm, [[1.0, 0.0, 0.0]])
    >>> longer.joint_names[-2:]
    ('arm_joint_5', 'virtual_1')
    >>> q = [2.0, 1.3, -1.9, 2.4, 1.0]
    >>> bool(np.allclose(fk(longer, [*q, 0.7])[:3, 3], fk(arm, q)[:3, 3]))
    True
    """
    axes = np.asarray(axes_tip, dtype=np.float64)
    if axes.ndim != 2 or axes.shape[1] != 3:
        raise ArrayError(f"axes_tip must have shape (m, 3), got {axes.shape}")
    lengths = np.linalg.norm(axes, axis=1, keepdims=True)
    if not ((lengths > 0.0) & np.isfinite(lengths)).all():
        raise ArrayError(f"axes_tip must be finite and have a direction, got {axes.tolist()}")
    if chain.is_coupled:
        raise ArrayError(f"virtual joints are for chains without mimic joints; {chain.name!r} has some")
    directions = (axes / lengths) @ chain.home[:3, :3].T
    moments = np.cross(chain.home[:3, 3], directions)
    names = list(chain.joint_names)
    for i in range(len(axes)):
        names.append(free_name(f"virtual_{i + 1}", names))
    free = np.tile([-np.inf, np.inf], (len(axes), 1))
    return replace(
        chain,
        screws=np.vstack([chain.screws, np.hstack([moments, directions])]),
        limits=np.vstack([chain.limits, free]),
        joint_names=tuple(names),
        frames=(),
        max_velocity=np.append(chain.max_velocity, np.full(len(axes), np.inf)),
        max_effort=np.append(chain.max_effort, np.full(len(axes), np.inf)),
        coupling=np.eye(len(names)),
    )


class AllAnswers(NamedTuple):
    """Every answer of N whole poses."""

    q: FloatArray
    """(N, k, n): NaN where ``valid`` is False."""
    valid: NDArray[np.bool_]
    """(N, k)"""
    doubtful: NDArray[np.bool_]
    """(N): True where answers may be missing."""


@dataclass(frozen=True, eq=False)
class CompleteMethod:
    """What finds every answer of a whole pose of one arm: its closed form, or the general solver for six joints.

    Attributes
    ----------
    chain : Chain
    family : Family
    general : bool
        True when the general solver can take the arm.
    """

    chain: Chain
    family: Family
    general: bool

    @property
    def words(self) -> str:
        """The method in words."""
        return str(self.family) if self.family.complete else "the general solver for six joints"

    def solve(self, T: FloatArray, *, threads: int = 1) -> AllAnswers:
        """Every answer for poses (N, 4, 4), joint limits left aside."""
        if not self.family.complete:
            general = solve_general_6r(self.chain, T, threads=threads)
            return AllAnswers(general.q, general.valid, (general.flags & Flag.doubtful) != 0)
        closed = solve_closed_form(self.chain, self.family, T, threads=threads)
        if not (self.general and closed.doubtful.any()):
            return AllAnswers(closed.q, closed.valid, closed.doubtful)
        q, valid, doubtful = closed.q, closed.valid, closed.doubtful
        again = solve_general_6r(self.chain, T[doubtful], threads=threads)
        more = again.q.shape[-2] - q.shape[-2]
        q = np.pad(q, ((0, 0), (0, more), (0, 0)), constant_values=np.nan)
        valid = np.pad(valid, ((0, 0), (0, more)))
        q[doubtful], valid[doubtful] = again.q, again.valid
        doubtful = doubtful.copy()
        doubtful[doubtful] = (again.flags & Flag.doubtful) != 0
        return AllAnswers(q, valid, doubtful)


def complete_method(chain: Chain) -> CompleteMethod | None:
    """What finds every answer of a whole pose; None where nothing does. Made once for a chain.

    Examples
    --------
    >>> from pieper.model import catalog
    >>> print(complete_method(catalog.describe("ur5e").chain()).words)
    axes 2, 3 and 4 are parallel, and axes 5 and 6 meet: up to 8 answers (exact)
    >>> print(complete_method(catalog.describe("crx10ia").chain()).words)
    the general solver for six joints
    """
    return prepared(chain, "complete_method", None, lambda: _find_method(chain))


def _find_method(chain: Chain) -> CompleteMethod | None:
    family = family_of(chain)
    general = not chain.is_coupled and len(chain.screws) == 6 and bool(chain.is_revolute.all())
    return CompleteMethod(chain, family, general) if family.complete or general else None


def family_of(chain: Chain) -> Family:
    """`pieper.ik.family.find_family`, done once for a chain."""
    return prepared(chain, "family", None, lambda: find_family(chain))


def extended(chain: Chain, axes_tip: Sequence[Sequence[float]]) -> Chain:
    """`add_virtual_joints`, made once for a chain and its axes."""
    if not len(axes_tip):
        return chain
    key = tuple(float(number) for axis in axes_tip for number in axis)
    return prepared(chain, "virtual_joints", key, lambda: add_virtual_joints(chain, np.asarray(axes_tip)))
