"""Joint vectors at the door: one check of shape, type and finiteness, in words."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pieper.errors import ArrayError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from pieper.model.chain import Chain

LARGEST = 1e15
"""Largest magnitude of a joint value [rad or m]; the kernels refuse more, and nothing overflows below it."""


def as_joints(chain: Chain, q: ArrayLike, *, name: str = "q") -> NDArray[np.float64]:
    """A C-contiguous float64 array of joint values, or an error that says what is wrong with them.

    Parameters
    ----------
    chain : Chain
    q : (..., n) array_like
        Joint values [rad or m].
    name : str
        What the message calls the argument.

    Returns
    -------
    (..., n) array

    Raises
    ------
    ArrayError
        Wrong last dimension, not real numbers, NaN, infinite, or beyond `LARGEST`.
    """
    try:
        array = np.asarray(q)
    except ValueError as cause:
        raise ArrayError(
            f"{name} must be an array of shape (..., {chain.dof}), got rows of different lengths"
        ) from cause
    if array.dtype.kind not in "fiu":
        if array.shape == () and not isinstance(q, (str, np.ndarray)):
            raise ArrayError(
                f"{name} must be real numbers, got {type(q).__name__}; give an array of shape (..., {chain.dof}) "
                f"in the order of the joints: {', '.join(chain.joint_names)}"
            )
        raise ArrayError(f"{name} must be real numbers, got dtype {array.dtype}")
    if array.ndim == 0 or array.shape[-1] != chain.dof:
        raise ArrayError(
            f"{name} must have shape (..., {chain.dof}), got {array.shape}; "
            f"the joints of {chain.name!r} are: {', '.join(chain.joint_names)}"
        )
    values = np.ascontiguousarray(array, dtype=np.float64)
    good = np.abs(values) <= LARGEST
    if not good.all():
        where = tuple(int(i) for i in np.argwhere(~good)[0])
        at = f"{name}[{', '.join(map(str, where))}] = {values[where]} (joint {chain.joint_names[where[-1]]!r})"
        if np.isfinite(values[where]):
            raise ArrayError(f"{name} must not exceed {LARGEST:g}, beyond which an angle has no digits left; got {at}")
        raise ArrayError(f"{name} must be finite, got {at}")
    return values


def as_out(out: object, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """`out` itself when results can be written into it, or an error that says why not."""
    if not isinstance(out, np.ndarray) or out.dtype != np.float64 or out.shape != shape:
        got = f"{out.dtype} array of shape {out.shape}" if isinstance(out, np.ndarray) else type(out).__name__
        raise ArrayError(f"out must be a float64 array of shape {shape}, got {got}")
    if not (out.flags.c_contiguous and out.flags.writeable):
        raise ArrayError(f"out must be C-contiguous and writeable; make it with np.empty({shape})")
    return out


def periodic_joints(chain: Chain) -> NDArray[np.bool_]:
    """(n,) mask of the joints that a whole turn brings back to where they were."""
    moves = chain.coupling != 0.0
    whole = np.all(~moves | (chain.is_revolute[:, None] & (chain.coupling == np.round(chain.coupling))), axis=0)
    return np.asarray(whole & moves.any(axis=0))


def without_turns(turning: NDArray[np.bool_] | bool, change: NDArray[np.float64]) -> NDArray[np.float64]:
    """Changes of joint values without whole turns: in [-pi, pi) for joints that turn, as they are for the others.

    Parameters
    ----------
    turning : (n,) bool array, or bool
        Which joints a whole turn brings back.
    change : (..., n) array
        [rad or m], a few turns at most; many turns cost digits, see `pieper.spatial.angle.wrap`.

    Returns
    -------
    (..., n) array
        [rad or m].

    Examples
    --------
    >>> without_turns(np.array([True, False]), np.array([6.0, 6.0])).round(3)
    array([-0.283,  6.   ])
    """
    return np.where(turning, np.remainder(change + np.pi, 2.0 * np.pi) - np.pi, change)
