"""From a frame to patches of colour, in one compiled pass.

Each pixel's label is looked up in a `ColorTable`; pixels of one label that touch by a side or a corner (8-connectivity) are a blob, found
by runs along the rows and a union-find over them; its moments are sums over its runs, in integers. Then the centroid is refined: a table cuts
the soft edge of a marker at some threshold, and what an edge pixel really has of the marker is measured from its colour.

With ``m`` the mean inside a blob, ``b`` the mean of what is around it, ``S`` the spread of both, and ``p`` a pixel of the edge::

    coverage = (p - b) . d,    d = S^-1 (m - b) / ((m - b)' S^-1 (m - b)),    centroid = sum coverage (x, y) / sum coverage

Fisher's direction ``d`` is across what differs within the surroundings, such as a robot and the carpet beside it. Whole pixels inside have
coverage 1, those away from the edge 0.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, get_args
from weakref import WeakKeyDictionary

import numpy as np

from pieper._native import kernels
from pieper.errors import ArrayError, UnknownNameError, unknown_name
from pieper.perception.blobs import Blobs

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from pieper.perception.color_table import ColorTable

Order = Literal["bgr", "rgb", "i420", "nv12", "yuyv"]
"""How the bytes of a frame lie: three to a pixel, or luma and chroma (BT.601, luma from 16 to 235) as OpenCV and video have them."""

MIN_AREA = 9
"""Pixels of the least blob that is reported unless another number is asked for: a disc 3.4 px wide."""

LARGEST_SIDE: int = kernels.largest_side
"""Rows or columns of a frame."""

_LAYOUTS = {
    "bgr": kernels.PixelLayout.packed,
    "rgb": kernels.PixelLayout.packed,
    "i420": kernels.PixelLayout.i420,
    "nv12": kernels.PixelLayout.nv12,
    "yuyv": kernels.PixelLayout.yuyv,
}
_SHAPES = {
    "bgr": "(height, width, 3)",
    "rgb": "(height, width, 3)",
    "i420": "(height * 3 / 2, width), height and width even",
    "nv12": "(height * 3 / 2, width), height and width even",
    "yuyv": "(height, width, 2), width even",
}
_look_ups: WeakKeyDictionary[ColorTable, dict[str, kernels.ColorLookUp]] = WeakKeyDictionary()


def segment(
    image: NDArray[np.uint8],
    table: ColorTable,
    *,
    order: Order = "bgr",
    min_area: int = MIN_AREA,
    max_area: int | None = None,
    refine: bool = True,
) -> Blobs:
    """Return the patches of colour in a frame.

    Parameters
    ----------
    image : (height, width, 3) uint8 array
        Pixels in the order given; ``"i420"`` and ``"nv12"`` are ``(height * 3 / 2, width)`` and ``"yuyv"`` is ``(height, width, 2)``, as OpenCV
        has them. Rows may lie at any stride, also backwards. A frame whose pixels do not lie side by side (every second column,
        mirrored columns, turned), or planes that do not follow each other, is copied first.
    table : ColorTable
        What colour a pixel is. For luma and chroma it is converted once, to a table of the same size over those, so that near
        the border between two colours a pixel can be another colour than after conversion to blue, green, red.
    order : "bgr", "rgb", "i420", "nv12" or "yuyv"
        Of the bytes. Shared chroma is taken for that of the middle of the two or four pixels; where it was sampled at the first of them, as many
        encoders do, a blob that differs from its surroundings by chroma alone is found up to 0.5 px to the right of (and below) its place.
    min_area, max_area : int
        Pixels of the least and the largest blob that is reported, both included; None for no largest.
    refine : bool
        Measure how much of each edge pixel a blob covers, and weigh by it; else the centroid is that of the pixels with the label, each counted
        as 1, exactly. Blobs of more than 240 px in width or height are not refined: there the edge hardly matters.

    Returns
    -------
    Blobs
        In the order in which their first pixels are met, row by row. `area` and `extent` are those of the pixels with the label. `covariance` is that
        of noise as it is measured around and inside each blob, if that is independent from pixel to pixel, and of
        the cut where the edge could not be measured. A blob that touches the border of the image may have part of itself outside: its
        covariance says so.

    Raises
    ------
    ArrayError
        The image has the wrong type or shape, or more than 32768 rows or columns.
    UnknownNameError
        There is no such order.

    Notes
    -----
    The interpreter lock is released. Circularity is ``n / (2 pi trace C)`` with the second moments ``C`` about the centroid of the n unit squares: 1
    for a disc, 0.955 for a square, less for everything longer or ragged.

    References
    ----------
    Fisher, "The use of multiple measurements in taxonomic problems", Annals of Eugenics 1936: the direction between two classes.

    Bruce, Balch, Veloso, "Fast and inexpensive color image segmentation for interactive robots", IROS 2000: table, runs and union-find.

    Examples
    --------
    A red square of 4 by 4 pixels on black:

    >>> from pieper.perception.color_table import ColorTable
    >>> labels = np.zeros((64, 64, 64), np.uint8)
    >>> labels[:16, :16, 48:] = 1
    >>> image = np.zeros((20, 30, 3), np.uint8)
    >>> image[5:9, 10:14] = (0, 0, 255)
    >>> blobs = segment(image, ColorTable(("red",), labels))
    >>> blobs.centroid, blobs.area, blobs.extent
    (array([[11.5,  6.5]]), array([16.]), array([[10,  5,  4,  4]]))
    """
    pixels, layout, look_up = _checked(image, table, order)
    least, most = _areas(min_area, max_area)
    color, centroid, covariance, area, extent, circularity, _ = look_up.segment(
        pixels, layout, least, most, bool(refine), False
    )
    return Blobs(table.names, color, centroid, covariance, area, extent, circularity)


def label_image(
    image: NDArray[np.uint8],
    table: ColorTable,
    *,
    order: Order = "bgr",
    min_area: int = MIN_AREA,
    max_area: int | None = None,
) -> NDArray[np.int32]:
    """Return which blob each pixel belongs to, for people who want to look.

    Parameters
    ----------
    image, table, order, min_area, max_area
        As `segment` takes them.

    Returns
    -------
    (height, width) int32 array
        0 for none, ``k + 1`` for row ``k`` of what `segment` returns.

    Raises
    ------
    ArrayError, UnknownNameError
        As `segment` does.
    """
    pixels, layout, look_up = _checked(image, table, order)
    numbers: NDArray[np.int32] = look_up.segment(pixels, layout, *_areas(min_area, max_area), False, True)[-1]
    return numbers


def color_image(image: NDArray[np.uint8], table: ColorTable, *, order: Order = "bgr") -> NDArray[np.uint8]:
    """Return the colour of each pixel, for people who want to look.

    Parameters
    ----------
    image, table, order
        As `segment` takes them.

    Returns
    -------
    (height, width) uint8 array
        0 for none, ``k + 1`` for ``table.names[k]``.

    Raises
    ------
    ArrayError, UnknownNameError
        As `segment` does.
    """
    pixels, layout, look_up = _checked(image, table, order)
    return look_up.classify(pixels, layout)


def luma_chroma_labels(table: ColorTable) -> NDArray[np.uint8]:
    """Return the labels of a table by luma and chroma.

    A cell has the label of the colour at its middle (BT.601, luma from 16 to 235), clipped to what blue, green and red can be.

    Returns
    -------
    (2**bits, 2**bits, 2**bits) uint8 array
        By the high bits of Y, U and V.
    """
    width = 2 ** (8 - table.bits)
    middle = np.arange(2**table.bits, dtype=np.float32) * width + (width - 1) / 2
    luma = np.float32(255 / 219) * (middle - 16)[:, None, None]
    u, v = (middle - 128)[None, :, None], (middle - 128)[None, None, :]
    shades = np.broadcast_arrays(luma + 2.01723 * u, luma - 0.39176 * u - 0.81297 * v, luma + 1.59603 * v)
    cells = [np.clip(np.rint(shade), 0, 255).astype(np.uint8) >> (8 - table.bits) for shade in shades]
    labels: NDArray[np.uint8] = table.labels[cells[0], cells[1], cells[2]]
    return labels


def _areas(min_area: int, max_area: int | None) -> tuple[int, int]:
    least, most = int(min_area), 2**62 if max_area is None else int(max_area)
    if least < 1 or most < least:
        raise ArrayError(
            f"areas must be 1 <= min_area <= max_area pixels, got min_area {min_area} and max_area {max_area}"
        )
    return least, min(most, 2**62)


def _checked(
    image: NDArray[np.uint8], table: ColorTable, order: str
) -> tuple[NDArray[np.uint8], kernels.PixelLayout, kernels.ColorLookUp]:
    if order not in _LAYOUTS:
        raise _unknown_order(order)
    if not isinstance(image, np.ndarray):
        raise ArrayError(f"image must be a NumPy array of shape {_SHAPES[order]}, got {type(image).__name__}")
    if image.dtype != np.uint8:
        hint = (
            "; scale 16 bits to 8 first, for example (image >> 8).astype(np.uint8)" if image.dtype == np.uint16 else ""
        )
        raise ArrayError(f"image must be uint8, got {image.dtype}{hint}")
    planar = order in ("i420", "nv12")
    fits = image.ndim == 2 if planar else image.ndim == 3 and image.shape[2] == (2 if order == "yuyv" else 3)
    if fits and planar:
        fits = image.shape[0] % 3 == 0 and image.shape[1] % 2 == 0
    if fits and order == "yuyv":
        fits = image.shape[1] % 2 == 0
    if not fits:
        gray = not planar and (image.ndim == 2 or (image.ndim == 3 and image.shape[2] == 1))
        hint = "; a grey frame has no colours to find" if gray else ""
        raise ArrayError(f"image must have shape {_SHAPES[order]} for order {order!r}, got {image.shape}{hint}")
    if max(image.shape[:2]) > LARGEST_SIDE:
        raise ArrayError(f"image must have at most {LARGEST_SIDE} rows and columns, got {image.shape}")
    step = image.strides[1:] == (3, 1) if image.ndim == 3 and order != "yuyv" else image.strides[1:] in ((2, 1), (1,))
    if not step or (order == "i420" and not image.flags.c_contiguous):
        image = np.ascontiguousarray(image)
    return image, _LAYOUTS[order], _look_up(table, order)


def _unknown_order(order: str) -> UnknownNameError:
    return unknown_name("order", str(order), get_args(Order))


def _look_up(table: ColorTable, order: str) -> kernels.ColorLookUp:
    """Prepare a table for the kernels, once for each order of bytes."""
    kind = order if order in ("bgr", "rgb") else "yuv"
    known = _look_ups.setdefault(table, {})
    if kind not in known:
        labels = luma_chroma_labels(table) if kind == "yuv" else table.labels
        known[kind] = kernels.ColorLookUp(np.ascontiguousarray(labels), kind == "rgb")
    return known[kind]
