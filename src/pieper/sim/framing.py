"""Where the eye of a picture is, so that all arms fit into it while they move."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FIELD_OF_VIEW = float(np.radians(30.0))  # up and down; a lens of 80 mm
_MARGIN = 1.12

FloatArray = NDArray[np.float64]


class Camera(NamedTuple):
    """Where the eye is, and its right, up and ahead."""

    eye: FloatArray
    right: FloatArray
    up: FloatArray
    ahead: FloatArray

    def pixel(self, point: FloatArray, size: tuple[int, int]) -> tuple[float, float]:
        """Where a point appears, from the left and from the top."""
        seen = point - self.eye
        f = 0.5 * size[1] / np.tan(0.5 * FIELD_OF_VIEW) / float(seen @ self.ahead)
        return 0.5 * size[0] + f * float(seen @ self.right), 0.5 * size[1] - f * float(seen @ self.up)


def fitted_camera(points: FloatArray, center: FloatArray, view: tuple[float, float], size: tuple[int, int]) -> Camera:
    """The nearest camera in a direction that sees all the points."""
    azimuth, elevation = view
    back = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    up = np.cross(back, right)
    half = np.tan(0.5 * FIELD_OF_VIEW) / _MARGIN * np.array([size[0] / size[1], 1.0])
    flat = (points - center) @ np.column_stack([right, up, back])
    # |x - x0| <= half_x (d - z) for every point: two bounds on each of x0 and y0 and the least d that leaves room between them
    sums, differences = flat[:, :2] / half + flat[:, 2:], -flat[:, :2] / half + flat[:, 2:]
    distances = 0.5 * (sums.max(axis=0) + differences.max(axis=0))
    distance = float(distances.max())
    shift = 0.5 * half * (sums.max(axis=0) - differences.max(axis=0))
    eye = center + right * shift[0] + up * shift[1] + back * max(distance, 1e-3)
    return Camera(eye, right, up, -back)


def grid_width(size: float) -> float:
    """A round width [m] of the squares of a grid under something of that size [m]: 1, 2 or 5 times a power of ten.

    >>> grid_width(2.3), grid_width(0.4)
    (0.5, 0.1)
    """
    wanted = size / 5.0
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(max((factor * power for factor in (1.0, 2.0, 5.0) if factor * power <= wanted * 1.1), default=power))
