"""How far the tip of an arm gets within its joint limits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pieper.kinematics.fk import fk
from pieper.kinematics.joints import LARGEST

if TYPE_CHECKING:
    from collections.abc import Callable

    from pieper.model.chain import Chain

FloatArray = NDArray[np.float64]

_SAMPLES = 8192
_KEPT = 16  # the best samples, each of which is moved uphill
_TRIES = 32
_ROUNDS = 100
_SHRINK = 0.87  # 0.87^100 = 9e-7 of the joint range in the last round: reach is flat there, or at a limit


@dataclass(frozen=True, eq=False)
class Reach:
    """The farthest places of the tip that were found.

    Attributes
    ----------
    from_base : float
        Distance from the origin of the base frame [m].
    from_first_axis : float
        Distance from the axis of the first joint [m]; NaN where that joint slides, or there is none.
    q_from_base, q_from_first_axis : (n,) arrays
        Joint values that get there [rad or m].
    """

    from_base: float
    from_first_axis: float
    q_from_base: FloatArray
    q_from_first_axis: FloatArray


def reach(chain: Chain, *, seed: int = 0) -> Reach:
    """The greatest distance of the tip from the base and from the first axis, within the joint limits.

    Random configurations, the best of which are moved uphill by shrinking random steps. A lower bound, therefore, and for
    arms of up to seven joints equal to the true reach to about a micrometre.

    Parameters
    ----------
    chain : Chain
        Joints that turn without limits are searched over one turn.
    seed : int
        The same seed gives the same answer.

    Returns
    -------
    Reach
        Infinite where a sliding joint has no limits.

    Examples
    --------
    A planar arm of two links, 0.5 m and 0.3 m:

    >>> from pieper.model.chain import Chain
    >>> home = np.eye(4)
    >>> home[0, 3] = 0.8
    >>> screws = [[0, 0, 0, 0, 0, 1], [0, -0.5, 0, 0, 0, 1]]
    >>> planar = Chain("planar", screws, home, [[-3, 3], [0.5 * np.pi, 3]], ("shoulder", "elbow"))
    >>> round(reach(planar).from_base, 6)  # the elbow cannot stretch: sqrt(0.5^2 + 0.3^2)
    0.583095
    """
    rng = np.random.default_rng(seed)
    lower, upper = _searched(chain)
    if not np.isfinite(upper - lower).all():
        nowhere = np.full(chain.dof, np.nan)
        return Reach(np.inf, np.inf, nowhere, nowhere)

    q_base = _farthest(chain, lower, upper, rng, lambda p: np.linalg.norm(p, axis=-1))
    v, w = chain.screws[0].reshape(2, 3) if len(chain.screws) else np.zeros((2, 3))
    if w.any():
        point = np.cross(w, v)
        q_axis = _farthest(chain, lower, upper, rng, lambda p: np.linalg.norm(np.cross(p - point, w), axis=-1))
        from_axis = float(np.linalg.norm(np.cross(fk(chain, q_axis)[:3, 3] - point, w)))
    else:
        q_axis, from_axis = np.full(chain.dof, np.nan), float("nan")
    return Reach(float(np.linalg.norm(fk(chain, q_base)[:3, 3])), from_axis, q_base, q_axis)


def extent(chain: Chain, *, seed: int = 0) -> FloatArray:
    """The box that holds every position of the tip within the joint limits: (2, 3) least and greatest x, y and z [m].

    Found as `reach` is: a box from inside, therefore, to about a micrometre. Infinite where a sliding joint has no limits.

    Examples
    --------
    The planar arm of `reach`, 0.5 m and 0.3 m, with a shoulder that turns from 0 to a quarter turn:

    >>> from pieper.model.chain import Chain
    >>> home = np.eye(4)
    >>> home[0, 3] = 0.8
    >>> screws = [[0, 0, 0, 0, 0, 1], [0, -0.5, 0, 0, 0, 1]]
    >>> planar = Chain("planar", screws, home, [[0, 0.5 * np.pi], [0, 0]], ("shoulder", "elbow"))
    >>> extent(planar).round(5) + 0.0
    array([[0. , 0. , 0. ],
           [0.8, 0.8, 0. ]])
    """
    rng = np.random.default_rng(seed)
    lower, upper = _searched(chain)
    if not np.isfinite(upper - lower).all():
        return np.array([[-np.inf] * 3, [np.inf] * 3])
    box = np.empty((2, 3))
    for axis in range(3):
        for row, sign in enumerate((-1.0, 1.0)):
            q = _farthest(chain, lower, upper, rng, lambda p, sign=sign, axis=axis: sign * p[..., axis])  # type: ignore[misc]
            box[row, axis] = fk(chain, q)[axis, 3]
    return box


def _searched(chain: Chain) -> tuple[FloatArray, FloatArray]:
    """Limits, with one turn for joints that turn without end; limits that no joint value may reach are none."""
    limits = np.where(np.abs(chain.limits) > LARGEST, np.copysign(np.inf, chain.limits), chain.limits)
    lower, upper = limits.T.copy()
    for axis, revolute in enumerate(chain.is_revolute):
        if revolute:
            endless = (chain.coupling[axis] != 0.0) & ~np.isfinite(limits).all(axis=1)
            lower[endless], upper[endless] = -np.pi, np.pi
    return lower, upper


def _farthest(
    chain: Chain,
    lower: FloatArray,
    upper: FloatArray,
    rng: np.random.Generator,
    distance: Callable[[FloatArray], FloatArray],
) -> FloatArray:
    """(n,) joint values for which `distance` of the tip's position is greatest."""
    q = rng.uniform(lower, upper, (_SAMPLES, chain.dof))
    best = q[np.argsort(distance(fk(chain, q)[:, :3, 3]))[-_KEPT:]]
    step = 0.25 * (upper - lower)
    for _ in range(_ROUNDS):
        move = rng.standard_normal((_TRIES, _KEPT, chain.dof))
        move *= rng.random(move.shape) < 0.5  # some joints stay, so that the others can climb along a limit
        tried = np.clip(best + step * move, lower, upper)
        tried[0] = best
        winners = np.argmax(distance(fk(chain, tried)[..., :3, 3]), axis=0)
        best = tried[winners, np.arange(_KEPT)]
        step = step * _SHRINK
    return np.asarray(best[np.argmax(distance(fk(chain, best)[:, :3, 3]))])
