"""Arrays of the frozen records in this room."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pieper.errors import ArrayError

FloatArray = NDArray[np.float64]


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


def identity() -> FloatArray:
    return np.eye(4)
