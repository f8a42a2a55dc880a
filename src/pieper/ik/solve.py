"""Inverse kinematics: the one function to call. It takes the method that suits the arm."""

from __future__ import annotations

import inspect
from typing import TYPE_CHECKING, Any

from pieper.errors import unknown_name
from pieper.ik.prepared import prepared
from pieper.ik.solver import Solver
from pieper.model._chain_check import check_chain

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import ArrayLike

    from pieper.ik.solutions import IKSolutions
    from pieper.ik.target import Target
    from pieper.model.chain import Chain


def solver(chain: Chain) -> Solver:
    """The solver of a chain, made once (a few milliseconds) and kept with the chain, as long as that lives.

    Raises
    ------
    ArrayError
        What is given is no Chain.
    """
    check_chain(chain)
    return prepared(chain, "solver", None, lambda: Solver(chain))


def solve(chain: Chain, target: ArrayLike | Target, *, seed: ArrayLike | None = None, **options: Any) -> IKSolutions:
    """Joint values that bring the tip to a target: every solution where the arm allows it.

    Parameters
    ----------
    chain : Chain
    target : (..., 4, 4) array or Target
        Poses ``T_base_tip`` [m, -], or what `pieper.ik.target` makes of one: position only, position and one axis,
        chosen components.
    seed : (..., n) array, optional
        Joint values to be near to [rad or m]: answers are sorted by their distance from it, and joints that turn are given as
        the copy nearest to it. A solver that iterates starts there.
    redundancy : (..., m) array or mapping, optional
        Seven joints: values of the joint that `ik_info` names, ``{"joint_3": values}`` of another joint, or ``{"swivel": angles}``;
        every answer for each of them. See `pieper.ik.redundancy.solve_redundant`.
    samples : int
        Values to try where answers form curves and none are given (seven joints; targets that leave some freedom); 16 when not
        given.
    method : {"closed form", "general", "redundancy", "numeric"}, optional
        Instead of the one that suits the arm.
    count : int, optional
        Answers to return at most. All when not given; one from a solver that iterates.
    mode : {"fast", "checked", "complete"}
        How hard the general solver looks, see `pieper.ik.general_6r.solve_general_6r`.
    position_tolerance, rotation_tolerance : float
        What counts as reached [m] and [rad]; 1e-9 when not given.
    restarts : int
        Starting points before a solver that iterates gives up; 512 when not given.
    threads : int
        Number of threads for a batch; the answers do not depend on it.

    Returns
    -------
    IKSolutions
        Out of reach is a result, with the nearest pose and its distance. In a batch a target that is no pose has the
        status ``malformed``, and the others are solved.

    Raises
    ------
    ArrayError
        The target or the seed is malformed.
    UnknownNameError
        There is no such option.

    Notes
    -----
    The method follows from the joint axes: `pieper.ik.closed_form` where they have a structure that allows it, else
    `pieper.ik.general_6r` for six joints, `pieper.ik.redundancy` for seven, else `pieper.ik.numeric`, which finds some answers.
    What a closed form calls doubtful is solved a second time by the general solver. Targets of some rows go to
    `pieper.ik.partial` where it covers them; with ``count=1`` and no seed any answer will do, and iteration is quicker.

    Examples
    --------
    >>> from pieper.kinematics.fk import fk
    >>> from pieper.model import catalog
    >>> arm = catalog.describe("mh12").chain()
    >>> answers = solve(arm, fk(arm, [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]))
    >>> int(answers.count), bool(answers.complete)
    (4, True)
    >>> answers.labels[0], answers.q[0].round(6)
    ('front, elbow up, no flip', array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6]))
    >>> from pieper.ik.target import ignore_orientation
    >>> print(solve(arm, ignore_orientation([3.0, 0.0, 0.45])).reason)
    out of reach by 1.46 m; the nearest pose found leaves 1.46 m
    """
    try:
        return solver(chain).solve(target, seed, **options)
    except TypeError:
        _require_known(options)
        raise


def _require_known(options: Mapping[str, Any]) -> None:
    """Options of other packages, as ``q0`` or ``tol``, are told those that there are."""
    known = [name for name in inspect.signature(Solver.solve).parameters if name not in ("self", "target")]
    for name in options:
        if name not in known:
            raise unknown_name("option", name, known, "inverse kinematics")
