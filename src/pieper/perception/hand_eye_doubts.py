"""What poses of a hand-eye calibration tell of themselves: that some repeat others, and that the board is not as large as was said.

A board of another size, or a focal length that is off, makes all boards that are seen farther away by one factor s, which the motions of the
hand know, since they are in metres: with rotations known, ``A_i X B_i = Y`` is linear in the factor, too ::

    R_A t_X + s R_A R_X t_B - t_Y = -t_A
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pieper.spatial import pose

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from pieper.spatial._checks import FloatArray

REPEATED = 1e-4
"""Poses of the hand that differ by less tell the same [m] and [rad]: a tenth of a millimetre is what arms repeat themselves to."""

_LEAST_OFF = 0.01  # of the size of the board: less may be the lens or the arm
_SURE = 6.0  # standard deviations


class BoardScale(NamedTuple):
    """By which factor the board is farther away than it should be, and the standard deviation of that."""

    factor: float
    deviation: float

    @property
    def is_off(self) -> bool:
        """Whether the factor is not 1, by more than what chance and a lens could do."""
        return abs(self.factor - 1.0) > max(_LEAST_OFF, _SURE * self.deviation)


def first_alike(A: FloatArray) -> NDArray[np.int64]:
    """For each pose, (n, 4, 4), the number of the first one that it repeats; its own where it is new, (n,)."""
    first = np.arange(len(A))
    for k in range(1, len(A)):
        shift, turn = pose.distance(A[:k], A[k])
        same = np.flatnonzero((shift < REPEATED) & (turn < REPEATED))
        if len(same):
            first[k] = first[same[0]]
    return first


def repeats(first: NDArray[np.int64], labels: Sequence[str]) -> tuple[str, ...]:
    """The same in words; empty when every pose is new."""
    again = [f"{labels[k]} repeats {labels[earlier]}" for k, earlier in enumerate(first.tolist()) if k != earlier]
    if not again:
        return ()
    shown = ", ".join(again[:3]) + (f" and {len(again) - 3} more" if len(again) > 3 else "")
    return (f"{shown}: what is seen twice from one place counts as independent and is not; move the hand between",)


def board_scale(X: FloatArray, A: FloatArray, B: FloatArray) -> BoardScale:
    """The factor of the distances to the board, by linear least squares; with a deviation of infinity where nothing tells it."""
    n = len(A)
    R_A = A[:, :3, :3]
    arm = np.einsum("nij,jk,nk->ni", R_A, X[:3, :3], B[:, :3, 3])
    rows = np.concatenate([R_A, np.tile(-np.eye(3), (n, 1, 1)), arm[:, :, None]], axis=2).reshape(-1, 7)
    known = -A[:, :3, 3].reshape(-1)
    found, _, rank, _ = np.linalg.lstsq(rows, known, rcond=1e-9)
    free = 3 * n - 7
    if rank < 7 or free < 1:
        return BoardScale(1.0, float("inf"))
    left = rows @ found - known
    spread = np.linalg.inv(rows.T @ rows)[6, 6] * float(left @ left) / free
    return BoardScale(float(found[6]), float(np.sqrt(spread)))


def other_size(scale: BoardScale) -> tuple[str, ...]:
    """In words that the board is not as large as was said; empty when it may be."""
    if not scale.is_off:
        return ()
    percent = 100.0 * abs(scale.factor - 1.0)
    more = "larger" if scale.factor > 1.0 else "smaller"
    words = (
        f"the motions of the hand fit a board that is {percent:.1f} +- {100.0 * scale.deviation:.1g} % {more} than was said: measure a square of the "
        "print, and see that the poses are in metres and that the camera was calibrated with the same board"
    )
    return (words,)
