"""Inverse kinematics by iteration, for any chain: damped least squares from many starts at once.

The step is that of Levenberg and Marquardt with the damping of Chan and Lawrence::

    dq = J^T (J J^T + lambda I)^-1 e,        lambda = c |e|^2 / 2,

held to the joint limits. Joints that can make a whole turn iterate without limits and are brought back by whole turns.
Starts come from a table of poses made once per chain: those whose pose is nearest to the target go first, one per
vector lane, and a low-discrepancy sequence follows. Nothing is random: the same target gives the same answer, alone or
in a batch, on one thread or many. On a processor with wider or narrower vectors another of several answers may come first,
unless a seed leads to one.

References
----------
Chan, Lawrence, General inverse kinematics with the error damped pseudoinverse, Proc. ICRA (1988) 834-839.
Sugihara, Solvability-unconcerned inverse kinematics by the Levenberg-Marquardt method, IEEE Trans. Robotics 27 (2011).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.errors import ArrayError
from pieper.ik.question import seeds
from pieper.ik.solutions import IKSolutions, Nearest
from pieper.ik.target import Target
from pieper.spatial._checks import FloatArray, poses, whole_number

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from pieper.model.chain import Chain

MOST_AXES = 32
"""Axes that the compiled solver takes."""
MOST_ANSWERS = 1024
"""Most distinct answers that one call looks for."""

_DISTINCT = 1e-3  # [rad or m], the least difference of two answers in some joint
_RESTARTS_FOR_REACH = 64  # the nearest pose is the first of them, and three rows have few local minima
_WHOLE = Target(np.eye(4))


def solve_numeric(
    chain: Chain,
    target: ArrayLike | Target,
    *,
    seed: ArrayLike | None = None,
    position_tolerance: float = 1e-9,
    rotation_tolerance: float = 1e-9,
    restarts: int = 512,
    iterations: int = 40,
    count: int = 1,
    threads: int = 1,
) -> IKSolutions:
    """Joint values within limits that bring the tip to a target, found by iteration.

    Parameters
    ----------
    chain : Chain
        Up to 32 axes; prismatic and mimic joints included.
    target : (..., 4, 4) array or Target
        Poses ``T_base_tip`` of the tip in the base frame [m, -], or a `pieper.ik.target.Target` for some rows of one.
    seed : (..., n) array, optional
        Joint values to start from [rad or m], tried first and alone; leading axes broadcast to those of the target.
        Turning joints then end within half a turn of it, if their limits allow. Values outside limits are brought inside.
    position_tolerance, rotation_tolerance : float
        What counts as reached, measured at the pose of the answer [m] and [rad].
    restarts : int
        Starting points before giving up, the seed included.
    iterations : int
        Steps from one starting point at most.
    count : int
        Distinct answers to look for, those that differ by more than 1e-3 in some joint. ``k`` of the result.
    threads : int
        Number of threads for a batch.

    Returns
    -------
    IKSolutions
        ``complete`` is False: other answers may exist. A target that was not reached has no answer but a `nearest` pose.

    Raises
    ------
    ArrayError
        Wrong shape, not finite, not a rotation (the message tells the deviation and the index), a wrong number of joints in
        the seed, a tolerance that is not positive, or a chain without joints or with more than 32 axes.

    Notes
    -----
    That a target is out of reach is not proved: it means that every start came to rest elsewhere. Far from
    singular poses an answer is good to about 1e-14; at a singular one the error shrinks more slowly and stops below
    the tolerance.

    Examples
    --------
    >>> from pieper.kinematics.fk import fk
    >>> from pieper.model import catalog
    >>> arm = catalog.describe("ur5e").chain()
    >>> T = fk(arm, [0.1, -1.2, 1.4, -1.7, -1.5, 0.3])
    >>> answers = solve_numeric(arm, T, seed=[0.0, -1.0, 1.0, -1.5, -1.5, 0.0])
    >>> answers.q[0].round(9)
    array([ 0.1, -1.2,  1.4, -1.7, -1.5,  0.3])
    >>> bool(answers.position_error[0] < 1e-9)
    True
    """
    T: Any = target.T_base_tip if isinstance(target, Target) else target
    rows = target.rows if isinstance(target, Target) else _WHOLE.rows
    if not 0 < len(chain.screws) <= MOST_AXES:
        raise ArrayError(
            f"the numeric solver takes chains with 1 to {MOST_AXES} axes, {chain.name!r} has {len(chain.screws)}"
        )
    require_tolerances(position_tolerance, rotation_tolerance)
    if _is_positive(count) and count > MOST_ANSWERS:
        raise ArrayError(f"count must be at most {MOST_ANSWERS}, got {count}")
    options = (position_tolerance, rotation_tolerance, restarts, iterations, count, _DISTINCT, threads)
    try:
        result = chain.native.solve_numeric(T, seed, rows, *options)
    except TypeError:  # not plain arrays of the right shape: convert them, or say what is wrong
        require_counts(restarts=restarts, iterations=iterations, count=count, threads=threads)
        T = np.ascontiguousarray(poses(T, "T_base_tip"))
        seed = None if seed is None else seeds(chain, seed, T.shape[:-2])
        result = chain.native.solve_numeric(T, seed, rows, *options)
    q, position_error, rotation_error, valid, within_limits, near, near_position, near_rotation, status, missed = result
    out_of_reach = near_position
    if missed:
        whole = target if isinstance(target, Target) else _WHOLE
        out_of_reach = _out_of_reach(chain, np.asarray(T), whole, near, near_position, options)
    return IKSolutions(
        chain=chain,
        q=q,
        valid=valid,
        position_error=position_error,
        rotation_error=rotation_error,
        within_limits=within_limits,
        branch=np.full(valid.shape, -1, dtype=np.int8),
        status=status,
        complete=np.zeros(status.shape, dtype=bool),
        find_nearest=lambda _: Nearest(near, near_position, near_rotation, out_of_reach),
        position_tolerance=position_tolerance,
        rotation_tolerance=rotation_tolerance,
    )


def _out_of_reach(
    chain: Chain, T: FloatArray, target: Target, near: FloatArray, near_position: FloatArray, options: tuple[Any, ...]
) -> FloatArray:
    """The distance [m] that is left when the rotation rows are left out, for the targets that were missed; else NaN."""
    rows = target.position_rows
    if rows is None:
        return near_position if target.counts_position else np.full_like(near_position, np.nan)
    missed = ~np.isnan(near_position)
    position, rotation, restarts, iterations, _, distinct, threads = options
    fewer = min(restarts, _RESTARTS_FOR_REACH)
    free = chain.native.solve_numeric(
        T[missed], near[missed], rows, position, rotation, fewer, iterations, 1, distinct, threads
    )
    distance = np.full_like(near_position, np.nan)
    distance[missed] = np.where(free[3][..., 0], 0.0, free[6])
    return distance


def _is_positive(value: object) -> bool:
    return isinstance(value, (float, int, np.floating, np.integer)) and bool(0.0 < value < np.inf)


def require_tolerances(position: object, rotation: object) -> None:
    """Raises ArrayError unless both are positive numbers."""
    if not (_is_positive(position) and _is_positive(rotation)):
        raise ArrayError(f"tolerances must be positive numbers [m] and [rad], got {position!r} and {rotation!r}")


def require_counts(**counts: object) -> None:
    """Raises ArrayError, with the name of the argument, unless each is a whole number of at least 1."""
    for name, value in counts.items():
        whole_number(value, name)
