"""A configuration in which an arm is easy to look at: bent, upright, its tip in front of it, far from singular poses.

At zero most arms are stretched out or folded, their joints hidden behind each other and their pictures alike.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pieper.kinematics.fk import fk_frames
from pieper.kinematics.jacobian import manipulability

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from pieper.model.chain import Chain

_CANDIDATES = 3000
_WIDEST = 2.0  # [rad] from the middle of the limits: no joint is turned round
_FARTHEST = 0.5  # [m] the same for joints that slide without limits
_DECIMALS = 2  # so that the values can be printed and typed


def stance(chain: Chain, *, seed: int = 0) -> NDArray[np.float64]:
    """Joint values within the limits that show the arm well, rounded to 0.01.

    The best of a few thousand random ones: manipulability, tip in front, links near the vertical plane through the first
    axis, and nothing below the base.

    Parameters
    ----------
    chain : Chain
    seed : int
        The same seed gives the same values.

    Returns
    -------
    (n,) array
        Joint values [rad or m].

    Examples
    --------
    >>> from pieper.model import catalog
    >>> chain = catalog.describe("ur5e").chain()
    >>> q = stance(chain)
    >>> bool(((q > chain.limits[:, 0]) & (q < chain.limits[:, 1])).all())
    True
    """
    lower, upper = _window(chain)
    rng = np.random.default_rng(seed)
    q = lower + (upper - lower) * rng.random((_CANDIDATES, chain.dof))
    q = np.clip(q.round(_DECIMALS), lower, upper)
    if not chain.dof:
        return np.zeros(0)
    points = fk_frames(chain, q)[..., :3, 3]
    size = max(float(np.abs(points).max()), np.finfo(np.float64).tiny)
    x, y, z = np.moveaxis(points / size, -1, 0)
    freedom = np.asarray(manipulability(chain, q))
    score = freedom / max(float(freedom.max()), np.finfo(np.float64).tiny)
    score += 1.0 * x[:, -1] - 1.5 * np.abs(y).mean(axis=1) + 0.8 * z.max(axis=1)
    score -= 4.0 * np.maximum(0.0, 0.15 - z[:, -1]) + 4.0 * np.maximum(0.0, -z).max(axis=1)
    return np.asarray(q[int(np.argmax(score))])


def _window(chain: Chain) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where the candidates are: the limits, or what lies near their middle where they are wide."""
    turns = np.array([bool(chain.is_revolute[axes].all()) for axes in (chain.coupling != 0.0).T], dtype=bool)
    widest = np.where(turns, _WIDEST, _FARTHEST)
    lower, upper = chain.limits.T
    with np.errstate(invalid="ignore"):
        middle = 0.5 * (lower + upper)
    one_sided = np.where(np.isfinite(lower), lower + widest, np.where(np.isfinite(upper), upper - widest, 0.0))
    middle = np.where(np.isfinite(middle), middle, one_sided)
    return np.maximum(lower, middle - widest), np.minimum(upper, middle + widest)
