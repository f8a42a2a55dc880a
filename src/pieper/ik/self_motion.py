"""Self-motion: the curves of all solutions of a pose, along which an arm with seven joints moves while its tip stays.

`self_motion` follows all curves that pass through a sampled solution, `nearest_on_self_motion` finds their point nearest to where the arm is,
and `track_branches` tells which of the sampled solutions belong together.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pieper.errors import ArrayError
from pieper.ik._six_of_seven import at_swivel_angles, sampled, solve_end
from pieper.ik.curve import NearestPoint, SolutionCurve, crossing, follow
from pieper.ik.held_joint import prepare
from pieper.ik.numeric import solve_numeric
from pieper.ik.target import pose
from pieper.kinematics.joints import as_joints
from pieper.spatial._checks import poses

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from pieper.ik.held_joint import RedundantSolutions
    from pieper.model.chain import Chain
    from pieper.spatial._checks import FloatArray

SAMPLES_OF_SELF_MOTION = 64
"""Values that are tried where none are given."""

_TURN = 2.0 * np.pi
_TOLERANCES = np.array([1e-9, 1e-9])
_SAME = 1e-6  # rad or m: solutions no farther apart are one
_SOLVES = 1e-8  # m or -: how well a joint vector has to meet a pose to be taken for a solution
_REGULAR = 1e-3  # least singular value of the Jacobian of a pose that is far enough from singular ones
_MOST_CURVES = 64
_ITERATED = 256  # solutions that iteration adds to the sampled ones, from starts all over the joint space


def self_motion(
    chain: Chain,
    T_base_tip: ArrayLike,
    *,
    also: ArrayLike | None = None,
    samples: int = SAMPLES_OF_SELF_MOTION,
    step: float = 0.1,
) -> list[SolutionCurve]:
    """The curves of all solutions of a pose, of an arm with seven joints.

    Every solution for `samples` values of a joint, a whole turn round, is on some curve, and so are those that iteration finds from all
    over the joint space. Each curve is followed once, through folds, with joint limits left aside: `SolutionCurve.intervals` are its
    parts inside them. Curves that cross one of these are followed too.

    Parameters
    ----------
    chain : Chain
        Seven joints.
    T_base_tip : (4, 4) array_like
        Pose of the tip in the base frame [m, -].
    also : (n,) array_like, optional
        Joint values [rad or m] whose curve is to be among them, if they are a solution.
    samples : int
        Values of the joint that `prepare` chose, and of the swivel angle where there is one.
    step : float
        Largest distance between points of a curve.

    Returns
    -------
    list of SolutionCurve
        Longest first; empty when the pose is out of reach.

    Raises
    ------
    ArrayError
        Another kind of arm, or a malformed pose.

    Notes
    -----
    A curve can be missed when all of it falls between two neighbouring values of the sampled joint, ``2 pi / samples`` apart (0.1 rad by
    default), and iteration does not arrive on it: a short one, near a pose where it shrinks to a point. Joints that slide stay
    within their limits, and a curve that leaves them ends there.

    Examples
    --------
    >>> from pieper.kinematics.fk import fk
    >>> from pieper.model import catalog
    >>> arm = catalog.describe("kuka_iiwa14").chain()
    >>> curves = self_motion(arm, fk(arm, [0.1, 0.5, 0.2, -1.2, 0.3, 0.9, 0.4]))
    >>> len(curves), all(curve.closed for curve in curves)
    (8, True)
    """
    redundancy = prepare(chain)
    T = poses(T_base_tip, "T_base_tip")
    if T.shape != (4, 4):
        raise ArrayError(f"self-motion is that of one pose, of shape (4, 4), got {T.shape}")
    answers = solve_end(redundancy, T, *sampled(redundancy, samples, limited=False), _TOLERANCES, 1)
    left = answers.q[answers.valid]
    if redundancy.swivel is not None:
        angles: FloatArray = (np.arange(samples, dtype=float) + 0.5) * (_TURN / samples) - np.pi
        answers = at_swivel_angles(redundancy, T, angles, None, _TOLERANCES)
        left = np.concatenate([left, answers.q[answers.valid]])
    found = solve_numeric(redundancy.without_limits, T, count=_ITERATED, restarts=2 * _ITERATED)
    started = found.q[found.valid]
    least = np.linalg.svd(chain.native.jacobian(started), compute_uv=False)[:, -1]
    left = np.concatenate([left, started[least > _REGULAR]])  # near singular poses iteration stops beside a curve
    if also is not None:
        here = as_joints(chain, also, name="also")
        if here.ndim != 1:
            raise ArrayError(f"also must have shape ({chain.dof},), got {here.shape}")
        if np.abs(chain.native.fk(here) - T).max() < _SOLVES:
            left = np.concatenate([here[None], left])
    target = pose(T)
    curves: list[SolutionCurve] = []
    while len(left) and len(curves) < _MOST_CURVES:
        curve = follow(chain, target, left[0], step=step)
        left = left[1:]
        if curve is not None:
            curves.append(curve)
            left = left[~curve.contains(left, tolerance=_SAME)]
            for point in crossing(curve):
                if not any(known.contains(point, tolerance=_SAME) for known in curves):
                    left = np.concatenate([left, point[None]])
    return sorted(curves, key=lambda curve: -curve.length)


def nearest_on_self_motion(
    chain: Chain,
    T_base_tip: ArrayLike,
    seed: ArrayLike,
    *,
    within_limits: bool = True,
    samples: int = SAMPLES_OF_SELF_MOTION,
) -> NearestPoint:
    """The solution of a pose that is nearest to a joint vector, among all that there are and not only sampled ones.

    Parameters
    ----------
    chain : Chain
        Seven joints.
    T_base_tip : (4, 4) array_like
        Pose of the tip in the base frame [m, -].
    seed : (n,) array_like
        Joint values [rad or m].
    within_limits : bool
        Whether the solution has to be inside the joint limits.
    samples : int
        As for `self_motion`, on whose curves it looks.

    Returns
    -------
    NearestPoint
        NaN, and an infinite distance, where the pose is out of reach or has no solution within limits.

    Raises
    ------
    ArrayError
        As `self_motion`, or the seed is malformed.

    Examples
    --------
    >>> from pieper.kinematics.fk import fk
    >>> from pieper.model import catalog
    >>> arm = catalog.describe("franka_panda").chain()
    >>> q = [0.1, -0.5, 0.2, -2.0, 0.3, 1.6, 0.7]
    >>> nearest_on_self_motion(arm, fk(arm, q), q).q.round(6)
    array([ 0.1, -0.5,  0.2, -2. ,  0.3,  1.6,  0.7])
    """
    best = NearestPoint(np.full(chain.dof, np.nan), np.nan, np.inf)
    for curve in self_motion(chain, T_base_tip, also=seed, samples=samples):
        best = min(best, curve.nearest(seed, within_limits=within_limits), key=lambda point: point.distance)
    return best


def track_branches(solutions: RedundantSolutions, curves: list[SolutionCurve]) -> NDArray[np.int64]:
    """Which solutions of one pose for several values of a joint belong to one branch.

    Along a branch the value rises or falls and the other joints follow it; at a fold it turns back and another branch begins. Two
    solutions for neighbouring values belong to one branch when a curve leads from one to the other without a fold between.

    Parameters
    ----------
    solutions : RedundantSolutions
        Those of one pose for values of one joint.
    curves : list of SolutionCurve
        The curves of the same pose, as `self_motion` gives them.

    Returns
    -------
    (m k,) int array
        Number of the branch of each place, from 0; -1 for empty places and solutions on none of the curves.

    Raises
    ------
    ArrayError
        The solutions are those of several poses, or of swivel angles.

    Examples
    --------
    >>> from pieper.kinematics.fk import fk
    >>> from pieper.ik.redundancy import prepare, solve_redundant
    >>> from pieper.model import catalog
    >>> arm = catalog.describe("kuka_iiwa14").chain()
    >>> T = fk(arm, [0.1, 0.5, 0.2, -1.2, 0.3, 0.9, 0.4])
    >>> answers = solve_redundant(arm, T)
    >>> branch = track_branches(answers, self_motion(arm, T))
    >>> answers.q[branch == 0][:, prepare(arm).joint].round(2)
    array([0.19, 0.57, 0.95])
    """
    if solutions.value.ndim != 1:
        raise ArrayError(
            f"branches are those of one pose; these solutions have leading axes {solutions.value.shape[:-1]}"
        )
    branch = np.full(solutions.valid.shape, -1)
    left = solutions.valid.copy()
    if not left.any():
        return branch
    held = np.flatnonzero((solutions.q[left] == solutions.value[left, None]).all(axis=0))
    if not len(held):
        raise ArrayError(
            "branches are followed along values of one joint, and these solutions are not; solve with `samples`, or name a joint"
        )
    gap = 1.001 * float(np.diff(np.unique(solutions.value)).max(initial=0.0))
    count = 0
    for curve in curves:
        tried = np.flatnonzero(left)
        places = curve.place(solutions.q[tried], tolerance=_SAME)
        on, places = tried[~np.isnan(places)], places[~np.isnan(places)]
        if not len(on):
            continue
        left[on] = False
        order = np.argsort(places, kind="stable")
        on, places = on[order], places[order]
        runs = np.split(np.arange(len(on)), np.flatnonzero(~_joined(curve, int(held[0]), places, gap)[:-1]) + 1)
        if len(runs) > 1 and _joined(curve, int(held[0]), places, gap)[-1]:  # the curve began in the middle of a branch
            runs[0] = np.concatenate([runs.pop(), runs[0]])
        for run in runs:
            branch[on[run]] = count
            count += 1
    return branch


def _joined(curve: SolutionCurve, joint: int, places: FloatArray, gap: float) -> NDArray[np.bool_]:
    """(k,): whether the joint goes on from each place to the next, and from the last to the first, by no more than a gap
    between values and without turning back.
    """
    after = np.append(places[1:], places[0] + curve.length)
    change = (
        curve.at(np.where(curve.closed, after, np.minimum(after, curve.length)))[:, joint] - curve.at(places)[:, joint]
    )
    way = np.sign(change)
    joined = (np.abs(change) <= gap) & (way != 0.0)
    joined[-1] &= curve.closed
    along = np.concatenate([curve.s, curve.s + curve.length])
    tangents = np.concatenate([curve.tangents[:, joint]] * 2)
    for i in np.flatnonzero(joined):
        between = (along > places[i]) & (along < after[i])
        joined[i] = bool((tangents[between] * way[i] > 0.0).all())
    return np.asarray(joined)
