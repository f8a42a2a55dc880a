"""All solutions of any arm with six joints, revolute or one of them prismatic, from one trigonometric polynomial of degree 8.

The loop closure ``Rz(q1) C1 ... Rz(q6) C6 = T`` is reduced by the elimination of Raghavan and Roth to a 12x12 determinant
in one remaining joint angle t. Sampled on the circle it is exactly

    det(t) = c_0 + sum over k = 1 ... 8 of A_k cos(k t) + B_k sin(k t),

so its real roots, at most 16, are all the values that this joint can take. Nothing is derived or generated for an arm:
`prepare` measures its twelve forms (which joint remains, and the direction of the loop) on some hundred poses and keeps
the best. A prismatic joint has its displacement and the square of it where others have cosine and sine; it never remains. The
derivation is in ``docs/derivations/general_6r.md``.

References
----------
Raghavan, Roth, Inverse kinematics of the general 6R manipulator and related linkages, J. Mechanical Design 115 (1993).
Manocha, Canny, Efficient inverse kinematics for general 6R manipulators, IEEE Trans. Robotics and Automation 10 (1994).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntFlag
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pieper._native import kernels
from pieper.errors import ArrayError, unknown_name
from pieper.ik.prepared import prepared
from pieper.spatial._checks import FloatArray, poses, whole_number

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from pieper.model.chain import Chain

BoolArray = NDArray[np.bool_]

MOST_SOLUTIONS = 16
"""No arm with six revolute joints has more isolated solutions (Primrose 1986), nor has one with a slide among them."""

MODES = ("fast", "checked", "complete")


class Flag(IntFlag):
    """What happened on the way to the solutions of one target.

    The lower ones are those of the first form; those up to `many_requests` made another form run.
    """

    noise = 1
    """Harmonics that cannot be there are."""
    parity = 2
    """An odd number of simple roots."""
    lost = 4
    """A simple root led to no solution."""
    overflow = 8
    """A list was full."""
    unclean = 16
    """A simple root where the matrix is regular."""
    third = 32
    """Three or more solutions at one angle, of which fewer than four were found."""
    many_requests = 64
    """Much of the circle was sampled again."""
    request = 128
    """Some of the circle was sampled again."""
    twins = 256
    """Two solutions at one angle."""
    some_requests = 512
    """A good part of the circle was sampled again; where nothing was found then, or `near_twins`, another form ran."""
    near_twins = 1024
    """Nearly two solutions at one angle."""
    near_fold = 2048
    """A solution next to a singular pose; another one was looked for to both sides of it."""
    second_form = 4096
    third_form = 8192
    last_resort = 16384
    """Targets nearby were solved, and their solutions continued to this one."""
    doubtful = 32768
    """Every form had doubts, or a solution is singular: one may be missing, as where solutions form curves."""
    singular = 65536
    """A solution at a singular pose: the end of two that have met, or a member of a curve of solutions."""


@dataclass(frozen=True, eq=False)
class General6R:
    """An arm prepared for the general solver.

    Attributes
    ----------
    native : NativeGeneral6R
        Its constants in compiled form.
    """

    native: kernels.NativeGeneral6R

    @property
    def remaining_joints(self) -> tuple[int, ...]:
        """The joints, counted from 0, whose angle is solved for first: in the first form, in the second, in the third."""
        used = sorted((report.rank, report.remaining_joint) for report in self.native.reports if report.rank >= 0)
        return tuple(joint for _, joint in used)


@dataclass(frozen=True, eq=False)
class GeneralSolutions:
    """Up to 16 solutions for every target.

    Attributes
    ----------
    q : (..., 16, 6) array
        Joint angles [rad] in (-pi, pi] and displacements [m], sorted; NaN where ``valid`` is False. Joint limits are not
        looked at.
    valid : (..., 16) bool array
    position_error, rotation_error : (..., 16) arrays
        Measured at the pose that forward kinematics gives [m] and [rad].
    flags : (...) int array
        A `Flag` for every target.
    """

    q: FloatArray
    valid: BoolArray
    position_error: FloatArray
    rotation_error: FloatArray
    flags: NDArray[np.int32]

    @property
    def count(self) -> NDArray[np.int64]:
        """(...): number of solutions."""
        return np.asarray(self.valid.sum(axis=-1))


def fits(chain: Chain) -> bool:
    """True when the general solver takes this arm."""
    return not chain.is_coupled and len(chain.screws) == 6 and int(chain.is_revolute.sum()) >= 5


def prepare(chain: Chain) -> General6R:
    """The constants of an arm, measured and kept as long as the chain lives; a few milliseconds the first time.

    Raises
    ------
    ArrayError
        The chain has not six joints, or more than one prismatic one, or mimic joints.

    Examples
    --------
    >>> from pieper.model import catalog
    >>> prepare(catalog.describe("ur5e").chain()).remaining_joints
    (1,)
    """
    return prepared(chain, "general 6R", None, lambda: _make(chain))


def _make(chain: Chain) -> General6R:
    if not fits(chain):
        turning = int(chain.is_revolute.sum())
        raise ArrayError(
            f"the general solver takes six joints, all revolute or one of them prismatic, without mimic joints; "
            f"{chain.name!r} has {len(chain.screws)} axes, {turning} of them revolute"
            f"{', and mimic joints' if chain.is_coupled else ''}: use the numeric solver"
        )
    return General6R(kernels.NativeGeneral6R(chain.native))


def solve_general_6r(
    chain: Chain, T_base_tip: ArrayLike, *, mode: str = "checked", threads: int = 1
) -> GeneralSolutions:
    """All joint values of an arm with six joints that bring its tip to a pose.

    Parameters
    ----------
    chain : Chain
        Six revolute joints, or five and a prismatic one at any place; any geometry.
    T_base_tip : (..., 4, 4) array
        Poses of the tip in the base frame [m, -].
    mode : str
        ``"fast"``: a second form runs only where the first one has a doubt. ``"checked"``: also where it had to sample part
        of the circle again, or found two solutions at one angle, unless they coincide by the structure of the arm. ``"complete"``: always.
    threads : int
        Number of threads for a batch; the answers do not depend on it.

    Returns
    -------
    GeneralSolutions

    Raises
    ------
    ArrayError
        Wrong shape, not finite, not a rotation, another kind of arm, or an unknown mode.

    Notes
    -----
    Where solutions form curves (a stretched wrist), up to 16 members are returned, and `Flag.doubtful` is set. Two solutions
    closer than 1e-6 rad, or than the square root of what rounding leaves, count as one. On arms whose solutions form curves
    everywhere (four parallel axes, coincident axes) every answer is doubtful.

    Examples
    --------
    >>> from pieper.kinematics.fk import fk
    >>> from pieper.model import catalog
    >>> arm = catalog.describe("crx10ia").chain()
    >>> T = fk(arm, [0.1, -0.4, 0.3, 0.5, 0.9, -0.2])
    >>> answers = solve_general_6r(arm, T)
    >>> int(answers.count)
    8
    >>> bool(abs(answers.q[answers.valid] - [0.1, -0.4, 0.3, 0.5, 0.9, -0.2]).max(axis=1).min() < 1e-9)
    True
    """
    if mode not in MODES:
        raise unknown_name("mode", mode, MODES, "the general solver")
    native = prepare(chain).native
    chosen = kernels.GeneralMode[mode]
    try:
        q, position_error, rotation_error, valid, flags = native.solve(T_base_tip, chosen, threads)
    except TypeError:  # not plain arrays of the right shape: convert them, or say what is wrong
        workers = whole_number(threads, "threads")
        T = np.ascontiguousarray(poses(T_base_tip, "T_base_tip"))
        q, position_error, rotation_error, valid, flags = native.solve(T, chosen, workers)
    return GeneralSolutions(q, valid, position_error, rotation_error, flags)
