"""Inverse kinematics in closed form: every branch of a pose, in a fixed number of steps.

For arms with a spherical wrist or three parallel axes (see `pieper.ik.family`) the pose equation

    T_base_tip = exp(s_1 q_1) ... exp(s_n q_n) M

falls apart into problems with one unknown each. Nothing is iterated but for the last digits of arms whose numbers are rounded.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pieper.errors import ArrayError
from pieper.spatial._checks import FloatArray, poses

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from pieper.ik.family import Family
    from pieper.model.chain import Chain


class ClosedFormSolutions(NamedTuple):
    """All branches of every pose. The place of an answer is its branch; places that hold none are NaN.

    With eight branches, place ``b`` is ``front + elbow + wrist``: front 0 or 4 for the two answers of the first stage, elbow 0
    or 2, wrist 0 or 1. Along a path that keeps away from singular poses an answer keeps its place.
    """

    q: FloatArray
    """(..., 8, n) joint values in (-pi, pi] [rad]."""
    valid: NDArray[np.bool_]
    """(..., 8): True for answers within the tolerances."""
    position_error: FloatArray
    """(..., 8): measured at the pose that forward kinematics gives for the answer [m]."""
    rotation_error: FloatArray
    """(..., 8): the same for the rotation [rad]."""
    doubtful: NDArray[np.bool_]
    """(...): True where answers may be missing: an arm with rounded numbers beside a fold of its ideal; and where an answer missed the pose
    by more than the tolerance and less than 1e-5, because several folds come together or the pose is that far out of reach."""


def solve_closed_form(
    chain: Chain,
    family: Family,
    T_base_tip: ArrayLike,
    *,
    position_tolerance: float = 1e-9,
    rotation_tolerance: float = 1e-9,
    threads: int = 1,
) -> ClosedFormSolutions:
    """Joint values of every branch that brings the tip to a pose, joint limits left aside.

    Parameters
    ----------
    chain : Chain
        The arm.
    family : Family
        Its closed form, as `pieper.ik.family.find_family` gives it.
    T_base_tip : (..., 4, 4) array
        Poses of the tip in the base frame [m, -].
    position_tolerance, rotation_tolerance : float
        What counts as reached, measured on the arm itself [m] and [rad].
    threads : int
        Number of threads for a batch.

    Returns
    -------
    ClosedFormSolutions
        Nothing valid where a pose is out of reach.

    Raises
    ------
    ArrayError
        Wrong shape, not finite, not a rotation, or the family is none.

    Notes
    -----
    At a singular pose the answers form curves, of which each branch gives one point: with the wrist straight joint 4 is 0 or
    what rounding makes of it, and joint 6 follows. Branches that coincide are given once.

    Examples
    --------
    >>> from pieper.ik.family import find_family
    >>> from pieper.kinematics.fk import fk
    >>> from pieper.model import catalog
    >>> arm = catalog.describe("kuka_kr210_robond").chain()
    >>> answers = solve_closed_form(arm, find_family(arm), fk(arm, [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]))
    >>> int(answers.valid.sum())
    8
    >>> bool((abs(answers.q - [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]).max(axis=-1) < 1e-12).any())
    True
    """
    if not family.has_closed_form:
        raise ArrayError(f"chain {chain.name!r} has no closed form: {family.reason}")
    options = (position_tolerance, rotation_tolerance, threads)
    try:
        return ClosedFormSolutions._make(chain.native.solve_closed_form(family.native, T_base_tip, *options))
    except TypeError:  # not plain arrays of the right shape: convert them, or say what is wrong
        T = np.ascontiguousarray(poses(T_base_tip, "T_base_tip"))
        return ClosedFormSolutions._make(chain.native.solve_closed_form(family.native, T, *options))
