"""How much of each pixel polygons cover, exactly: what an ideal camera with square pixels makes of a flat, sharp outline.

The area of a polygon to the left of each pixel's right side is a sum over its edges (Green's theorem). Each edge is cut where it
passes from one pixel to the next; a piece of height ``dy`` at the mean place ``x`` covers ``dy (1 - frac x)`` of its own pixel and
``dy`` of every pixel to the right of it, and a running sum along the rows adds that up. There is no sampling.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from pieper.spatial._checks import FloatArray

Patch = tuple[int, int, "NDArray[np.float32]"]
"""Left column, top row, and the covered share of the pixels from there."""


def coverage(polygons: Sequence[FloatArray], size: tuple[int, int]) -> list[Patch]:
    """Return the covered share of the pixels around each polygon.

    Parameters
    ----------
    polygons : sequence of (n, 2) arrays
        Corners in order, either way round [px]; pixel ``(i, j)`` is the square from ``i - 1/2`` to ``i + 1/2``.
    size : (int, int)
        Width and height of the image [px]; what lies outside is left out.

    Returns
    -------
    list of (left, top, share)
        One for each polygon; `share` is 0 to 1, ``(rows, columns)``, and empty for a polygon outside the image.

    Examples
    --------
    >>> square = np.array([[1.0, 0.5], [2.5, 0.5], [2.5, 1.5], [1.0, 1.5]])
    >>> left, top, share = coverage([square], (4, 4))[0]
    >>> left, top, share.tolist()
    (1, 1, [[0.5, 1.0]])
    """
    boxes = [_box(polygon, size) for polygon in polygons]
    seen = [k for k, (left, top, right, bottom) in enumerate(boxes) if right > left and bottom > top]
    patches: list[Patch] = [(left, top, np.zeros((0, 0), np.float32)) for left, top, _, _ in boxes]
    if not seen:
        return patches
    widths = np.array([boxes[k][2] - boxes[k][0] + 2 for k in seen])  # two columns that take what lies to the right
    heights = np.array([boxes[k][3] - boxes[k][1] for k in seen])
    begins = np.concatenate([[0], np.cumsum(widths * heights)])
    corners = [polygons[k] + 0.5 - boxes[k][:2] for k in seen]
    a = np.concatenate(corners)
    b = np.concatenate([np.roll(corner, -1, axis=0) for corner in corners])
    owner = np.repeat(np.arange(len(seen)), [len(corner) for corner in corners])
    start, end, edge = _cut(a, b)
    owner = owner[edge]
    limit = np.stack([widths - 2, heights], axis=1)[owner]
    start, end = np.clip(start, 0, limit), np.clip(end, 0, limit)
    middle = (start + end) / 2
    cell = np.minimum(middle.astype(np.int64), np.stack([limit[:, 0], limit[:, 1] - 1], axis=1))
    dy, into = end[:, 1] - start[:, 1], middle[:, 0] - cell[:, 0]
    at = begins[owner] + cell[:, 1] * widths[owner] + cell[:, 0]
    change = np.bincount(at, dy * (1 - into), begins[-1]) + np.bincount(at + 1, dy * into, begins[-1])
    share = np.abs(np.cumsum(change)).astype(np.float32)
    np.minimum(share, 1, out=share)
    for row, k in enumerate(seen):
        whole = share[begins[row] : begins[row + 1]].reshape(heights[row], widths[row])
        patches[k] = (boxes[k][0], boxes[k][1], whole[:, :-2])
    return patches


def _box(polygon: FloatArray, size: tuple[int, int]) -> tuple[int, int, int, int]:
    """Left, top, right, bottom of the pixels touched within the image; nothing where a corner is not known."""
    if not np.isfinite(polygon).all():
        return 0, 0, 0, 0
    low = np.floor(np.clip(polygon.min(axis=0) + 0.5, 0, size)).astype(int)
    high = np.ceil(np.clip(polygon.max(axis=0) + 0.5, 0, size)).astype(int)
    return int(low[0]), int(low[1]), int(high[0]), int(high[1])


def _cut(a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray, NDArray[np.int64]]:
    """Cut edges ``a -> b`` where they cross the sides of pixels; return the ends of the pieces, and whose piece each is."""
    step = b - a
    along, edge = [np.zeros(len(a)), np.ones(len(a))], [np.arange(len(a))] * 2
    for axis in (0, 1):
        low = np.ceil(np.minimum(a[:, axis], b[:, axis]))
        count = np.maximum(np.floor(np.maximum(a[:, axis], b[:, axis])) - low + 1, 0).astype(np.int64)
        count[step[:, axis] == 0] = 0
        which = np.repeat(np.arange(len(a)), count)
        number = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        along.append((low[which] + number - a[which, axis]) / step[which, axis])
        edge.append(which)
    t, whose = np.clip(np.concatenate(along), 0, 1), np.concatenate(edge)
    order = np.lexsort((t, whose))
    t, whose = t[order], whose[order]
    points = a[whose] + t[:, None] * step[whose]
    same = whose[1:] == whose[:-1]
    return points[:-1][same], points[1:][same], whose[1:][same]
