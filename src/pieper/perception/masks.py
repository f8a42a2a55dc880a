"""Masks of colours, for people who want to look: one per colour, cleaned, all together, and the frame through them.

`segment` needs none of these. A mask is a ``(height, width)`` uint8 array, 255 where something is and 0 elsewhere, as OpenCV has them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.errors import ArrayError
from pieper.perception.opencv import opencv
from pieper.perception.segment import Order, color_image

if TYPE_CHECKING:
    from collections.abc import Mapping
    from typing import TypeAlias

    from numpy.typing import ArrayLike, NDArray

    from pieper.perception.color_table import ColorTable
    from pieper.perception.frame import Image

Mask: TypeAlias = "NDArray[np.uint8]"
"""Which pixels, ``(height, width)``: 255 where something is, 0 elsewhere."""


def color_masks(image: NDArray[np.uint8], table: ColorTable, *, order: Order = "bgr") -> dict[str, Mask]:
    """Return a mask for each colour.

    Parameters
    ----------
    image, table, order
        As `pieper.perception.segment.segment` takes them.

    Returns
    -------
    dict of str to (height, width) uint8 array
        By the colour's name. A pixel is in one mask at most.

    Raises
    ------
    ArrayError, UnknownNameError
        As `pieper.perception.segment.segment` does.
    """
    colors = color_image(image, table, order=order)
    return {name: _mask(colors == k + 1) for k, name in enumerate(table.names)}


def clean(mask: Mask, *, kernel: ArrayLike | None = None, erode: int = 1, dilate: int = 2) -> Mask:
    """Return a mask that was eroded, which takes away specks, then dilated, which gives the rest its size back and closes holes.

    Parameters
    ----------
    mask : (height, width) uint8 array
        Not 0 where something is.
    kernel : (rows, columns) array, optional
        Not 0 where the neighbours that count are, about its middle; 3 by 3 ones unless given.
    erode, dilate : int
        How often. More dilation than erosion makes patches grow: with the kernel of 3 by 3, by a pixel on each side for each time more.

    Returns
    -------
    (height, width) uint8 array

    Raises
    ------
    ArrayError
        The mask or the kernel has the wrong shape or type, or a count is negative.
    MissingExtraError
        OpenCV is not installed.
    """
    cells = np.ones((3, 3), np.uint8) if kernel is None else np.asarray(kernel)
    if cells.ndim != 2 or not cells.any():
        raise ArrayError(f"kernel must have shape (rows, columns) and a cell that is not 0, got {cells.shape}")
    if min(erode, dilate) < 0:
        raise ArrayError(f"erode and dilate must not be negative, got {erode} and {dilate}")
    cv2: Any = opencv("morphology of masks")
    near = (cells != 0).astype(np.uint8)
    out = _checked(mask)
    if out.size == 0:
        return out
    if erode:
        out = cv2.erode(out, near, iterations=erode)
    if dilate:
        out = cv2.dilate(out, near, iterations=dilate)
    return np.asarray(out, dtype=np.uint8)


def combined_mask(masks: Mapping[str, Mask]) -> Mask:
    """Return the union of masks: 255 where any of them is.

    Raises
    ------
    ArrayError
        There are none, or they differ in shape.

    Examples
    --------
    >>> left, right = np.array([[255, 0, 0]], np.uint8), np.array([[0, 0, 255]], np.uint8)
    >>> combined_mask({"red": left, "blue": right})
    array([[255,   0, 255]], dtype=uint8)
    """
    if not masks:
        raise ArrayError("masks must be at least one, got none")
    checked = [_checked(mask) for mask in masks.values()]
    shapes = {name: mask.shape for name, mask in zip(masks, checked, strict=True)}
    if len(set(shapes.values())) > 1:
        raise ArrayError(f"masks must have one shape, got {shapes}")
    together: Mask = np.bitwise_or.reduce(checked)
    return together


def masked_frame(image: Image, mask: Mask) -> Image:
    """Return the frame where the mask is, and black elsewhere.

    Parameters
    ----------
    image : (height, width, 3) uint8 array
        Pixels.
    mask : (height, width) uint8 array
        Not 0 where the frame is to be seen.

    Returns
    -------
    (height, width, 3) uint8 array

    Raises
    ------
    ArrayError
        The shapes do not belong together.

    Examples
    --------
    >>> masked_frame(np.full((1, 2, 3), 7, np.uint8), np.array([[0, 255]], np.uint8))
    array([[[0, 0, 0],
            [7, 7, 7]]], dtype=uint8)
    """
    where = _checked(mask)
    if image.shape != (*where.shape, 3):
        raise ArrayError(f"image must have shape {(*where.shape, 3)}, as the mask has {where.shape}, got {image.shape}")
    return np.bitwise_and(image, where[..., None])


def _mask(where: NDArray[np.bool_]) -> Mask:
    return np.where(where, np.uint8(255), np.uint8(0))


def _checked(mask: object) -> Mask:
    if not isinstance(mask, np.ndarray) or mask.ndim != 2 or mask.dtype not in (np.uint8, np.bool_):
        got = f"{mask.shape} of {mask.dtype}" if isinstance(mask, np.ndarray) else type(mask).__name__
        raise ArrayError(f"mask must be a (height, width) array of uint8, got {got}")
    return _mask(mask != 0)
