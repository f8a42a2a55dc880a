"""Arms with seven joints at a pose: every solution for a value of one joint, and the whole curves of solutions.

With one joint held, six are left, which `pieper.ik.closed_form` or `pieper.ik.general_6r` solves completely. Holding an
*end* joint changes the target only, not the arm: with ``T = exp(s_1 q_1) ... exp(s_7 q_7) M``

    exp(s_2 q_2) ... exp(s_7 q_7) M = exp(-s_1 q_1) T,
    exp(s_1 q_1) ... exp(s_6 q_6) M = T M^-1 exp(-s_7 q_7) M,

so that the six joints are examined once and solved for any number of values in one call. `prepare` chooses the end whose
rest has a closed form. Arms with a spherical shoulder and a spherical wrist also take the swivel angle of their
elbow, see `pieper.ik.swivel`; an inner joint is held when asked by name.

The solutions of a pose form curves: `pieper.ik.self_motion`, whose functions are found here too.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from typing import TYPE_CHECKING, TypeGuard

import numpy as np

from pieper.errors import ArrayError
from pieper.ik._six_of_seven import at_swivel_angles, sampled, solve_end, solve_inner
from pieper.ik.held_joint import Redundancy, RedundantSolutions, prepare
from pieper.ik.self_motion import SAMPLES_OF_SELF_MOTION, nearest_on_self_motion, self_motion, track_branches
from pieper.spatial._checks import FloatArray, poses, stack, together, whole_number

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from pieper.ik.swivel import Swivel
    from pieper.model.chain import Chain

__all__ = [
    "SAMPLES", "SAMPLES_OF_SELF_MOTION", "Redundancy", "RedundantSolutions",
    "fits", "nearest_on_self_motion", "prepare", "self_motion", "solve_redundant", "track_branches",
]  # fmt: skip

SAMPLES = 16
"""Values that are tried when none are given."""

_LIMIT_ROUNDING = 1e-12  # rad or m by which a value may be beyond its range


def fits(chain: Chain) -> bool:
    """True for arms that `solve_redundant` takes: seven joints, six of which are solved with one held."""
    try:
        prepare(chain)
    except ArrayError:
        return False
    return True


def solve_redundant(
    chain: Chain,
    T_base_tip: ArrayLike,
    *,
    values: ArrayLike | Mapping[str, ArrayLike] | None = None,
    samples: int = SAMPLES,
    swivel: Swivel | None = None,
    position_tolerance: float = 1e-9,
    rotation_tolerance: float = 1e-9,
    threads: int = 1,
) -> RedundantSolutions:
    """Every solution of an arm with seven joints for given values of one of them, or of its swivel angle.

    Parameters
    ----------
    chain : Chain
        Seven joints.
    T_base_tip : (..., 4, 4) array_like
        Poses of the tip in the base frame [m, -].
    values : (..., m) array_like or mapping, optional
        Values of the joint that `prepare` chose [rad or m]; leading axes broadcast with those of the poses. Or a mapping of one
        name to values: ``{"joint_3": 0.2}`` holds another joint, ``{"swivel": angles}`` gives swivel angles. A number is one value.
        Default: `samples` values, each in the middle of a part of the range of the joint.
    samples : int
        How many values are tried when none are given.
    swivel : Swivel, optional
        What swivel angles are counted from; the stereographic reference when not given.
    position_tolerance, rotation_tolerance : float
        What counts as a solution [m] and [rad].
    threads : int
        Number of threads for a batch.

    Returns
    -------
    RedundantSolutions
        For each value all solutions that there are; joint limits are left aside, but for the value itself.

    Raises
    ------
    ArrayError
        A pose or value is malformed, a value is outside the limits of its joint, or the arm has no swivel angle.
    UnknownNameError
        There is no joint of that name.

    Notes
    -----
    An inner joint changes the arm of the other six, which is then examined for each value anew: milliseconds instead of microseconds.

    Examples
    --------
    >>> from pieper.kinematics.fk import fk
    >>> from pieper.model import catalog
    >>> arm = catalog.describe("franka_panda").chain()
    >>> q = [0.1, -0.5, 0.2, -2.0, 0.3, 1.6, 0.7]
    >>> answers = solve_redundant(arm, fk(arm, q), values=0.7)
    >>> bool(abs(answers.q[answers.valid] - q).max(axis=1).min() < 1e-9)
    True
    >>> int(solve_redundant(arm, fk(arm, q)).valid.sum()) > 30
    True
    """
    redundancy = prepare(chain)
    threads = whole_number(threads, "threads")
    tolerances = np.array([position_tolerance, rotation_tolerance])
    if values is None:
        plan = sampled(redundancy, samples)
        if _is_plain(T_base_tip):  # the kernels look at the targets, which are poses only if these are
            try:
                return solve_end(redundancy, T_base_tip, *plan, tolerances, threads)
            except ArrayError:
                poses(T_base_tip, "T_base_tip")  # says it in terms of what came, if that is what is wrong
                raise
        return solve_end(redundancy, poses(T_base_tip, "T_base_tip"), *plan, tolerances, threads)
    T = poses(T_base_tip, "T_base_tip")
    name: str | None = None
    if isinstance(values, Mapping):
        if len(values) != 1:
            raise ArrayError(f"values must name one joint or 'swivel', got {len(values)} names: {', '.join(values)}")
        ((name, given),) = values.items()
    elif isinstance(values, str):
        raise ArrayError(
            f"values of the redundancy must be numbers, or a mapping of one name to numbers as {{{values!r}: 0.3}}, got {values!r}"
        )
    else:
        given = values
    words = "values" if name is None else f"values of {name!r}"
    array = stack(np.atleast_1d(stack(given, (), words)), ("m",), words)
    leading = together(T_base_tip=T.shape[:-2], values=array.shape[:-1])
    T = np.ascontiguousarray(np.broadcast_to(T, (*leading, 4, 4)))
    if name == "swivel":
        return at_swivel_angles(redundancy, T, array, swivel, tolerances)
    joint = redundancy.joint if name is None else chain.joint_index(name)
    _require_in_range(chain, joint, array)
    if joint != redundancy.joint:
        return solve_inner(redundancy, T, joint, array, tolerances, threads)
    transports = redundancy.transports(array)
    return solve_end(redundancy, T, array, transports, tolerances, threads)


def _is_plain(T: object) -> TypeGuard[FloatArray]:
    """True for finite float64 arrays of shape (..., 4, 4)."""
    if type(T) is not np.ndarray or T.dtype != np.float64 or T.shape[-2:] != (4, 4):
        return False
    return isfinite(T.sum()) if T.ndim == 2 else bool(np.isfinite(T).all())


def _require_in_range(chain: Chain, joint: int, values: FloatArray) -> None:
    lower, upper = chain.limits[joint]
    outside = (values < lower - _LIMIT_ROUNDING) | (values > upper + _LIMIT_ROUNDING)
    if outside.any():
        raise ArrayError(
            f"values of {chain.joint_names[joint]!r} must be within its limits, {lower:.6g} to {upper:.6g}, "
            f"got {values[outside].flat[0]:.6g}"
        )
