"""One image of a video or a camera."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]
"""Pixels, ``(height, width, 3)``, blue green red as OpenCV has them."""


@dataclass(frozen=True, eq=False)
class Frame:
    """An image, its number and the time at which it was captured.

    Attributes
    ----------
    image : (height, width, 3) uint8 array
        Blue, green, red. The centre of the top left pixel is at (0, 0), x goes right and y down.
    index : int
        Number in its source, from 0; numbers of frames that were dropped are missing.
    time : float
        Of capture [s], on the clock of its source: from 0 in a file, time since the epoch of a camera.
    """

    image: Image
    index: int
    time: float

    @property
    def size(self) -> tuple[int, int]:
        """Width and height [px]."""
        shape: Any = self.image.shape
        return int(shape[1]), int(shape[0])
