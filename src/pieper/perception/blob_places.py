"""Where blobs are on the field, at the height that is asked for."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from pieper.perception.blobs import Blobs
    from pieper.perception.field_view import View
    from pieper.perception.pattern_shape import Shape
    from pieper.spatial._checks import FloatArray

_PIXEL_FLOOR = 0.01  # px; error of a centroid that its covariance does not know of: the grid, light from one side
SIZES = (0.5, 1.7)  # radius of a blob over that of its marker
_COMPACT = 0.4  # least circularity of a marker: a bar of 2 to 1 has 0.76, of 5 to 1 0.37; lines of a field have less
_EQUAL = 1e-9  # relative difference of scores that is rounding


def placed(
    blobs: Blobs, view: View, height: float, rows: Any = slice(None)
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Places of blobs at a height, their covariances, and how many pixels a unit has there."""
    centroid = blobs.centroid[rows]
    covariance = blobs.covariance[rows] + np.eye(2) * _PIXEL_FLOOR**2
    if view.unit == "px":
        return centroid, covariance, np.ones(len(centroid))
    J = view.jacobian(centroid, height=height)
    with np.errstate(divide="ignore", invalid="ignore"):
        size = np.abs(J[:, 0, 0] * J[:, 1, 1] - J[:, 0, 1] * J[:, 1, 0]) ** -0.5
    return view.to_field(centroid, height=height), J @ covariance @ J.transpose(0, 2, 1), size


class Levels:
    """Places and covariances of the blobs of a frame at the heights that are asked for, each worked out once."""

    def __init__(self, blobs: Blobs, view: View) -> None:
        self.blobs, self._view = blobs, view
        self._known: dict[float, tuple[NDArray[np.complex128], FloatArray, FloatArray]] = {}

    def _at(self, height: float) -> tuple[NDArray[np.complex128], FloatArray, FloatArray]:
        if self._view.unit == "px":
            height = 0.0
        if height not in self._known:
            places, covariances, sizes = placed(self.blobs, self._view, height)
            self._known[height] = (places[:, 0] + 1j * places[:, 1], covariances, sizes)
        return self._known[height]

    def places(self, height: float) -> NDArray[np.complex128]:
        """``(k,)``, x as the real part."""
        return self._at(height)[0]

    def covariances(self, height: float) -> FloatArray:
        """``(k, 2, 2)``."""
        return self._at(height)[1]

    def pixels_per_unit(self, height: float) -> FloatArray:
        """How large a unit is in the image, at each blob."""
        return self._at(height)[2]

    def sized(self, shape: Shape, scale: float) -> NDArray[np.bool_]:
        """Which blobs have about the size of a marker of a shape."""
        compact = self.blobs.circularity >= _COMPACT
        if shape.radii.min() <= 0:
            return compact
        radius = self.radii(shape.heights[-1]) / scale
        return np.asarray(compact & (radius > SIZES[0] * shape.radii.min()) & (radius < SIZES[1] * shape.radii.max()))

    def radii(self, height: float) -> FloatArray:
        """Radii of discs of the areas of the blobs, in units."""
        return self.blobs.radius / self.pixels_per_unit(height)


def surest(score: FloatArray, place: FloatArray) -> int:
    """Index of the greatest score; of those that are equal up to rounding the uppermost, so that the order of blobs does not matter."""
    best = np.flatnonzero(score >= score.max() - _EQUAL * abs(score.max()))
    return int(best[np.lexsort((place[best, 0], place[best, 1]))[0]])
