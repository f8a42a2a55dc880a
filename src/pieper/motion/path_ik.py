"""One joint path for a path of poses, without a jump; or where it must break, and why.

Arms whose answers are all listed (closed forms, general six joints) are solved **by layers**: every answer of every pose in one call,
then the shortest admissible route through them. A step between two answers is admissible when no joint moves further than
`jump_bound` allows for the distance between the two poses, and one answer is the nearest of its layer to the other; its cost is the sum over the joints of the way divided by the speed limit.
Whole turns are undone along the route, and it is shifted by whole turns to where every joint stays within its limits; a route without
such a shift is no route. Where no route goes on, the arm is led across the gap in ever smaller steps; if that succeeds, the poses it went
through join the layers, else the place of the break is known to `precision`.

Arms with a joint to spare, targets that leave a direction free, and arms without a listing method are **tracked**: from each of
several starts (the given one, or the answers at the first pose: with seven joints 16 values of one of them) by iteration from
the joint values before, which moves the joints least. The first start that arrives is taken, else the one that comes farthest.

Near a straight wrist joints turn fast for little motion of the tip. That is a passage and no break: steps become smaller there, and
`pieper.motion.timing.time_path` slows down so that the speed limits hold.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np

from pieper.errors import ArrayError, unknown_name
from pieper.kinematics.joints import as_joints
from pieper.motion._path_question import GivenPoses, PathQuestion
from pieper.motion._path_search import PathSearch
from pieper.motion.joint_path import JointPath, PathBreak, jump_bound
from pieper.motion.limits import JointLimits

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from pieper.model.chain import Chain
    from pieper.motion.path import CartesianPath

__all__ = ["FINEST_PRECISION", "PRECISION", "JointPath", "PathBreak", "follow_path", "jump_bound"]

PRECISION = 1e-6
"""How exactly the place of a break is found unless something else is said [m of path length]."""

FINEST_PRECISION = 1e-9
"""No break is placed more exactly [m of path length]: beyond that rounding decides."""


def follow_path(
    chain: Chain,
    path: CartesianPath | ArrayLike,
    *,
    q_start: ArrayLike | None = None,
    branch: str | None = None,
    target: Literal["pose", "axis", "position"] = "pose",
    count: int | None = None,
    step: float | None = None,
    precision: float = PRECISION,
    max_velocity: ArrayLike | None = None,
) -> JointPath:
    """Joint values along a path of poses, on one branch of answers all the way.

    Parameters
    ----------
    chain : Chain
    path : CartesianPath or (m, 4, 4) array
        A path, which is sampled by `count` or `step`, or the poses themselves, ``T_base_tcp`` [m, -], between which the tip goes straight.
        Poses may be repeated.
    q_start : (n,) array, optional
        Where the arm is [rad or m]: the path begins at the answer nearest to it. When not given, the cheapest route is taken.
    branch : str, optional
        Words that the label of the first answer must have, as in ``"elbow up"``; for arms with labels.
    target : {"pose", "axis", "position"}
        What counts: the whole pose, position and z axis of the tip (arms with five joints), or the position.
    count, step
        How a path is sampled, see `CartesianPath.sample`.
    precision : float
        How exactly the place of a break is found [m], at least 1e-9.
    max_velocity : float or (n,) array, optional
        Speed limits by which joint ways are compared; see `pieper.motion.limits.JointLimits.of`.

    Returns
    -------
    JointPath
        A path that must break is a result: `JointPath.broken` tells where and why.

    Raises
    ------
    ArrayError
        Malformed poses, start or options.

    Examples
    --------
    >>> from pieper.kinematics.fk import fk
    >>> from pieper.model import catalog
    >>> from pieper.motion.path import line
    >>> arm = catalog.describe("ur5e").chain()
    >>> T = fk(arm, [0.3, -1.2, 1.4, -1.7, -1.5, 0.3])
    >>> T_goal = T.copy()
    >>> T_goal[:3, 3] += [0.2, -0.3, 0.1]
    >>> way = follow_path(arm, line(T, T_goal), q_start=[0.3, -1.2, 1.4, -1.7, -1.5, 0.3])
    >>> way.complete, way.branch[0], len(way.q)
    (True, 'front, elbow up, flip', 189)
    """
    if target not in ("pose", "axis", "position"):
        raise unknown_name("target", target, ("pose", "axis", "position"), "follow_path")
    if not (np.isfinite(precision) and precision >= FINEST_PRECISION):
        raise ArrayError(
            f"precision must be at least {FINEST_PRECISION:g} m, below which rounding says where a path breaks, got {precision!r}"
        )
    speeds = JointLimits.of(chain, max_velocity=max_velocity).velocity
    seed = None
    if q_start is not None:
        seed = as_joints(chain, q_start, name="q_start")
        if seed.ndim != 1:
            raise ArrayError(f"q_start must have shape ({chain.dof},), got {seed.shape}")
    asked = PathQuestion(chain, target, seed, branch, precision, speeds)
    return PathSearch(asked, GivenPoses.of(path, count, step)).run()
