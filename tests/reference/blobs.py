"""Patches of one colour by SciPy's labelling and plain sums: slow and clear."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

TOUCHING = np.ones((3, 3), dtype=bool)  # by a side or a corner


@dataclass(frozen=True)
class Patch:
    """One blob and the pixels it is made of."""

    label: int
    pixels: np.ndarray
    """(n, 2) rows and columns."""

    @property
    def centroid(self) -> np.ndarray:
        """x, y."""
        return self.pixels[:, ::-1].mean(axis=0)

    @property
    def extent(self) -> list[int]:
        """Left, top, width, height."""
        top, left = self.pixels.min(axis=0)
        bottom, right = self.pixels.max(axis=0)
        return [int(left), int(top), int(right - left + 1), int(bottom - top + 1)]

    @property
    def circularity(self) -> float:
        """Area against that of the disc with the same second moments; each pixel is a square of side 1."""
        spread = self.pixels - self.pixels.mean(axis=0)
        return len(self.pixels) / (2 * np.pi * ((spread**2).sum() / len(self.pixels) + 2 / 12))


def labels_of(pixels: np.ndarray, labels: np.ndarray) -> np.ndarray:
    """The label of each pixel (h, w, 3), by the high bits of its three bytes."""
    bits = int(labels.shape[0]).bit_length() - 1
    cells = pixels.astype(int) // 2 ** (8 - bits)
    return labels[cells[..., 0], cells[..., 1], cells[..., 2]]


def patches(labels: np.ndarray, min_area: int, max_area: int) -> list[Patch]:
    """Of an image of labels (h, w), in the order of their first pixels."""
    found = []
    for label in np.unique(labels[labels > 0]):
        numbers, count = ndimage.label(labels == label, structure=TOUCHING)
        for k in range(1, count + 1):
            pixels = np.argwhere(numbers == k)
            if min_area <= len(pixels) <= max_area:
                found.append(Patch(int(label), pixels))
    return sorted(found, key=lambda patch: tuple(patch.pixels[0]))


def planes_of(image: np.ndarray, order: str) -> np.ndarray:
    """The three bytes of each pixel (h, w, 3) of an image with luma and chroma, as the formats are defined."""
    if order == "yuyv":
        out = np.empty((*image.shape[:2], 3), np.uint8)
        out[..., 0] = image[..., 0]
        for first in (0, 1):
            out[:, first::2, 1] = image[:, 0::2, 1]
            out[:, first::2, 2] = image[:, 1::2, 1]
        return out
    height, width = image.shape[0] * 2 // 3, image.shape[1]
    half = (height // 2, width // 2)
    flat = image[height:].reshape(-1)
    count = half[0] * half[1]
    u, v = (flat[:count], flat[count:]) if order == "i420" else (flat[0::2], flat[1::2])
    chroma = [np.kron(plane.reshape(half), np.ones((2, 2), np.uint8)) for plane in (u, v)]
    return np.stack([image[:height], *chroma], axis=-1)
