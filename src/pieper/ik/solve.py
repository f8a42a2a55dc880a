"""Inverse kinematics: the one function to call. It takes the method that suits the arm."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pieper.ik.numeric import solve_numeric

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from pieper.ik.solutions import IKSolutions
    from pieper.ik.target import Target
    from pieper.model.chain import Chain


def solve(
    chain: Chain,
    target: ArrayLike | Target,
    *,
    seed: ArrayLike | None = None,
    position_tolerance: float = 1e-9,
    rotation_tolerance: float = 1e-9,
    restarts: int = 512,
    count: int = 1,
    threads: int = 1,
) -> IKSolutions:
    """Joint values that bring the tip to a target.

    Parameters
    ----------
    chain : Chain
    target : (..., 4, 4) array or Target
        Poses ``T_base_tip`` [m, -], or what `pieper.ik.target` makes of one: position only, position and one axis,
        chosen components.
    seed : (..., n) array, optional
        Joint values to start from [rad or m], tried first and alone: the answer that grows out of them wins.
    position_tolerance, rotation_tolerance : float
        What counts as reached [m] and [rad].
    restarts : int
        Starting points before giving up.
    count : int
        Distinct answers to look for, ``k`` of the result.
    threads : int
        Number of threads for a batch.

    Returns
    -------
    IKSolutions
        Out of reach is a result, with the nearest pose and its distance.

    Raises
    ------
    ArrayError
        The target or the seed is malformed.

    Notes
    -----
    Every chain is solved by `pieper.ik.numeric` so far, which finds answers within limits but does not list all.

    Examples
    --------
    >>> from pieper.ik.target import ignore_orientation
    >>> from pieper.model import catalog
    >>> arm = catalog.describe("mh12").chain()
    >>> print(solve(arm, ignore_orientation([3.0, 0.0, 0.45])).reason)
    out of reach by 1.46 m; the nearest pose found leaves 1.46 m
    """
    return solve_numeric(
        chain,
        target,
        seed=seed,
        position_tolerance=position_tolerance,
        rotation_tolerance=rotation_tolerance,
        restarts=restarts,
        count=count,
        threads=threads,
    )
