"""Arrays of the frozen records in this room."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pieper.errors import ArrayError

FloatArray = NDArray[np.float64]

ROTATION_TOLERANCE = 1e-9
"""By how much a rotation may deviate from one: ten typed digits pass, a typing error does not."""


def frozen(value: ArrayLike, shape: tuple[int, ...], name: str) -> FloatArray:
    """A read-only float64 copy of `value` with the given shape."""
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as cause:
        raise ArrayError(f"{name} must be numbers of shape {shape}, got {value!r}") from cause
    if array.shape != shape:
        raise ArrayError(f"{name} must have shape {shape}, got {array.shape}")
    array.setflags(write=False)
    return array


def pose_fault(T: FloatArray) -> str | None:
    """Why a (4, 4) array is no pose, as words that go on after its name; None for one whose rotation is orthonormal to 1e-9."""
    R = T[:3, :3]
    deviation = float(np.abs(R @ R.T - np.eye(3)).max())
    determinant = float(np.linalg.det(R))
    if not deviation <= ROTATION_TOLERANCE or determinant < 0.0:
        return (
            f"must be a pose: its 3x3 block deviates from a rotation by {deviation:.3g} (determinant {determinant:.3g}); "
            "orthonormalise it first"
        )
    if T[3].tolist() != [0.0, 0.0, 0.0, 1.0]:
        return f"must have the last row 0 0 0 1, got {T[3].tolist()}"
    return None


def identity() -> FloatArray:
    return np.eye(4)
