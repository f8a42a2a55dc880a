"""What a solver is asked, checked and made plain: poses and seeds as arrays, and which rows of a batch are no poses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pieper.errors import ArrayError
from pieper.kinematics.joints import as_joints
from pieper.spatial import _checks

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from pieper.model.chain import Chain
    from pieper.spatial._checks import FloatArray


_INSTEAD = {
    (3,): "for a position alone: pieper.ik.target.ignore_orientation",
    (3, 3): "a pose has a position too: pieper.spatial.pose.from_position_rotation",
    (7,): "make a pose of position and quaternion x, y, z, w with pieper.spatial.pose and .rotation",
}
"""What to do with a target of a shape that means something elsewhere."""


@dataclass(frozen=True, eq=False)
class Question:
    """Poses to reach and where to start from.

    Attributes
    ----------
    T_base_tip : (..., 4, 4) array
        C-contiguous poses [m, -]; rows that are no poses hold the home pose instead.
    seed : (..., n) array or None
        C-contiguous joint values [rad or m] with the same leading axes.
    malformed : dict
        What is wrong with the rows that are no poses, by index.
    """

    T_base_tip: FloatArray
    seed: FloatArray | None
    malformed: dict[tuple[int, ...], str]


def ask(chain: Chain, T_base_tip: ArrayLike, seed: ArrayLike | None = None) -> Question:
    """Checks poses and a seed.

    A single pose that is none is an error; in a batch it becomes an entry of `Question.malformed`.

    Raises
    ------
    ArrayError
        Wrong shape, no numbers, a single pose that is not finite or not a rotation, or a seed that does not fit.
    """
    malformed: dict[tuple[int, ...], str] = {}
    try:
        T = _checks.poses(T_base_tip, "T_base_tip")
    except ArrayError:
        T = _numbers(T_base_tip)
        if T.ndim < 3 or T.shape[-2:] != (4, 4):
            instead = _INSTEAD.get(T.shape)
            if instead is not None:
                raise ArrayError(f"T_base_tip must have shape (..., 4, 4), got {T.shape}; {instead}") from None
            raise
        T = T.copy()
        for index in np.ndindex(T.shape[:-2]):
            wrong = _what_is_wrong(T[index])
            if wrong:
                malformed[index] = f"row {', '.join(map(str, index))} of the batch is no pose: {wrong}"
                T[index] = chain.home
    T = np.ascontiguousarray(T)
    return Question(T, None if seed is None else seeds(chain, seed, T.shape[:-2]), malformed)


def seeds(chain: Chain, seed: ArrayLike, leading: tuple[int, ...]) -> FloatArray:
    """Seeds as an array with the leading axes of the targets."""
    values = as_joints(chain, seed, name="seed")
    try:
        return np.ascontiguousarray(np.broadcast_to(values, (*leading, chain.dof)))
    except ValueError:
        raise ArrayError(
            f"seed must have shape (..., {chain.dof}) with leading axes that broadcast to {leading}, got {values.shape}"
        ) from None


def _what_is_wrong(T: FloatArray) -> str:
    try:
        _checks.poses(T, "T_base_tip")
    except ArrayError as error:
        return str(error)
    return ""


def _numbers(value: ArrayLike) -> NDArray[np.float64]:
    try:
        raw = np.asarray(value)
        return np.asarray(raw, dtype=np.float64) if raw.dtype.kind in "biufO" else np.empty(0)
    except (TypeError, ValueError, OverflowError):
        return np.empty(0)
