"""Connected patches of one colour in one frame."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from pieper.spatial._checks import FloatArray


@dataclass(frozen=True, eq=False)
class Blobs:
    """Patches of pixels, one row each, in the order in which their first pixel is met row by row.

    Attributes
    ----------
    names : tuple of str
        The colours.
    color : (k,) int array
        Index into `names`.
    centroid : (k, 2) array
        Centre [px], to a fraction of a pixel; the centre of the top left pixel is (0, 0).
    covariance : (k, 2, 2) array
        Of the centroid [px^2]: how well it is known.
    area : (k,) array
        Pixels.
    extent : (k, 4) int array
        Left, top, width, height [px].
    circularity : (k,) array
        1 for a disc, less for what is longer or ragged: area against that of the disc with the same second moments.
    """

    names: tuple[str, ...]
    color: NDArray[np.int64]
    centroid: FloatArray
    covariance: FloatArray
    area: FloatArray
    extent: NDArray[np.int64]
    circularity: FloatArray

    def __len__(self) -> int:
        return len(self.color)

    @property
    def radius(self) -> FloatArray:
        """Of the disc of the same area, ``(k,)`` [px]."""
        return np.sqrt(self.area / np.pi)

    def select(self, which: Any) -> Blobs:
        """Return some of them, by a mask or by indices."""
        rows = {f.name: getattr(self, f.name)[which] for f in fields(self) if f.name != "names"}
        return Blobs(names=self.names, **rows)

    def of(self, name: str) -> Blobs:
        """Return those of one colour; none if the name is not among `names`."""
        return self.select(self.color == (self.names.index(name) if name in self.names else -1))
