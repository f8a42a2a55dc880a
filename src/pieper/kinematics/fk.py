"""Forward kinematics: where the tip, and every frame on the way to it, are.

    T_base_tip(q) = exp([S_1] q_1) ... exp([S_n] q_n) home          (Modern Robotics, eq. 4.14)

The compiled kernels run the same product along frames that sit on the axes (one turn about z per joint), several
configurations per instruction.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pieper.kinematics.joints import as_joints, as_out
from pieper.spatial._checks import whole_number

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

    from pieper.model.chain import Chain


def fk(
    chain: Chain,
    q: ArrayLike,
    *,
    up_to: str | int | None = None,
    out: NDArray[np.float64] | None = None,
    threads: int = 1,
) -> NDArray[np.float64]:
    """Pose of the tip, or of one frame on the way to it, for any number of configurations.

    Parameters
    ----------
    chain : Chain
    q : (..., n) array_like
        Joint values [rad or m].
    up_to : str or int, optional
        A frame of the chain by name, or a joint count: 0 is the base, i the link that the first i axes move.
        All n joint values are given all the same. Default: the tip.
    out : (..., 4, 4) float64 array, optional
        Where to write the result; saves the allocation, which costs as much as the arithmetic for large batches.
    threads : int
        Number of threads for large batches.

    Returns
    -------
    (..., 4, 4) array
        ``T_base_tip`` [m, -].

    Raises
    ------
    ArrayError
        `q` or `out` has the wrong shape or type, or `q` is not finite.
    UnknownNameError
        `up_to` is not a frame of the chain.

    Examples
    --------
    >>> from pieper.model import catalog
    >>> arm = catalog.describe("mh12", nominal=True).chain()
    >>> fk(arm, [0.0, 0.0, 0.0, 0.0, 0.0, 0.0])[:3, 3].round(6) + 0.0
    array([0.895, 0.   , 1.264])
    >>> fk(arm, [0.0, 0.0, 0.0, 0.0, 0.0, 0.0], up_to="link_3_u")[:3, 3].round(6) + 0.0
    array([0.155, 0.   , 1.064])
    """
    if up_to is not None:
        T = _frame_poses(chain, q, [up_to])[..., 0, :, :]
        if out is None:
            return T
        as_out(out, T.shape)[...] = T
        return out
    try:
        return chain.native.fk(q, out, threads)
    except TypeError:  # not plain float64 of the right shape: convert it, or say what is wrong
        values = as_joints(chain, q)
        if out is not None:
            as_out(out, (*values.shape[:-1], 4, 4))
        return chain.native.fk(values, out, whole_number(threads, "threads"))


def fk_frames(chain: Chain, q: ArrayLike, *, frames: Sequence[str | int] | None = None) -> NDArray[np.float64]:
    """Poses of several frames of the chain at once.

    Parameters
    ----------
    chain : Chain
    q : (..., n) array_like
        Joint values [rad or m].
    frames : sequence of str or int, optional
        Frames by name or joint count. Default: every frame in ``chain.frames``, base first, tip last.

    Returns
    -------
    (..., k, 4, 4) array
        One pose per frame, in the base frame [m, -].
    """
    return _frame_poses(chain, q, [f.name for f in chain.frames] if frames is None else frames)


def _frame_poses(chain: Chain, q: ArrayLike, which: Sequence[str | int]) -> NDArray[np.float64]:
    frames = [chain.frame(w) for w in which]
    homes = np.array([f.home for f in frames]).reshape(-1, 4, 4)
    return chain.native.link_poses(as_joints(chain, q), [f.after for f in frames], homes)
