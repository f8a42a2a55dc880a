"""Which colour a pixel is, as a table over all pixels: what a colour model is compiled to, and what segmentation reads."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.errors import ArrayError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from pieper.perception.frame import Image

BITS = 6
"""Of each channel; 5 and 6 cost the same time, 7 leave the second-level cache of most processors."""


@dataclass(frozen=True, eq=False)
class ColorTable:
    """A colour for each cell of pixel values.

    Attributes
    ----------
    names : tuple of str
        The colours, in the order of their labels 1, 2, ...; label 0 is none of them.
    labels : (2**bits, 2**bits, 2**bits) uint8 array
        Label of a pixel, by the high bits of its blue, green and red.

    Examples
    --------
    >>> labels = np.zeros((64, 64, 64), np.uint8)
    >>> labels[:16, :16, 48:] = 1
    >>> table = ColorTable(("red",), labels)
    >>> table.classify(np.array([[[10, 20, 230], [90, 20, 230]]], np.uint8))
    array([[1, 0]], dtype=uint8)
    """

    names: tuple[str, ...]
    labels: NDArray[np.uint8]
    bits: int = field(init=False, default=BITS)

    def __post_init__(self) -> None:
        labels = np.array(self.labels, dtype=np.uint8, order="C")
        bits = max(int(labels.shape[0]).bit_length() - 1, 1) if labels.ndim == 3 else 0
        if labels.shape != (2**bits,) * 3 or not 1 <= bits <= 8:
            raise ArrayError(f"labels must have shape (64, 64, 64) or that of another power of two, got {labels.shape}")
        if labels.max(initial=0) > len(self.names):
            raise ArrayError(f"labels must be at most {len(self.names)}, the number of names, got {labels.max()}")
        labels.flags.writeable = False
        object.__setattr__(self, "names", tuple(self.names))
        object.__setattr__(self, "labels", labels)
        object.__setattr__(self, "bits", bits)

    def classify(self, image: Image) -> NDArray[np.uint8]:
        """Return the label of each pixel, ``(height, width)``, for people who want to look; `segment` does not need it."""
        cells: Any = image >> (8 - self.bits)
        labels: NDArray[np.uint8] = self.labels[cells[..., 0], cells[..., 1], cells[..., 2]]
        return labels
