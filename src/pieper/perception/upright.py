"""Where an upright cylinder of known size stands on a plane of known height, from its outline in one image.

One camera is enough: the height is that of the plane, so two numbers remain, and the middle of the outline tells two. A cylinder's middle
is not where the middle of its outline is, for the near side looks larger; so the outline that a cylinder would have is drawn in numbers, and
the cylinder is moved until the middles agree (Newton's method). How well the two outlines then cover each other says whether what was seen is that
cylinder, whole: what is hidden in part, has fallen over, or is something else does not fit.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.errors import ArrayError
from pieper.perception.opencv import opencv
from pieper.perception.overlay import draw_seen

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from pieper.perception.camera import Camera
    from pieper.perception.frame import Image
    from pieper.spatial._checks import FloatArray

LEAST_AGREEMENT = 0.82
"""Shared area of the outlines over that of both together, below which the thing counts as not seen."""

SMALLEST = 60
"""Pixels of a patch that is looked at."""

_RIM = 48  # points around each end
_TURNS, _NEAR, _STEP = 8, 1e-6, 1e-3  # of Newton, [m]
_PATCHES = 4
_SHIFT = 4  # OpenCV draws at sixteenths of a pixel


@dataclass(frozen=True, eq=False)
class Upright:
    """A cylinder that was found.

    Attributes
    ----------
    p_base : (3,) array
        Its middle [m].
    agreement : float
        Shared area of the outlines over that of both together; 1 is perfect.
    seen, expected : (k, 2) arrays
        Outline of the patch in the image, and of a cylinder that stands there [px].
    """

    p_base: FloatArray
    agreement: float
    seen: FloatArray
    expected: FloatArray


def locate_upright(
    mask: NDArray[np.uint8],
    camera: Camera,
    T_base_camera: ArrayLike,
    *,
    radius: float,
    length: float,
    height: float,
    least_agreement: float = LEAST_AGREEMENT,
) -> Upright | None:
    """Find a cylinder that stands upright on a plane.

    Parameters
    ----------
    mask : (height, width) uint8 array
        Not 0 where a pixel has the colour of the cylinder, as `pieper.perception.masks.color_masks` makes it.
    camera : Camera
    T_base_camera : (4, 4) array
        Where it is, z of the base up [m, -].
    radius, length : float
        Of the cylinder [m].
    height : float
        Of the plane, in the frame of the base [m].
    least_agreement : float
        See `LEAST_AGREEMENT`.

    Returns
    -------
    Upright or None
        The patch that agrees best; None when none does.

    Raises
    ------
    ArrayError
        The mask is not as large as the camera's images, or a size is not positive.

    Examples
    --------
    A camera 2 m above the plane that looks down:

    >>> from pieper.perception.camera import Camera
    >>> camera = Camera([[600, 0, 319.5], [0, 600, 239.5], [0, 0, 1]], [], (640, 480))
    >>> T = np.array([[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 2.0], [0, 0, 0, 1]])
    >>> v, u = np.mgrid[:480, :640]
    >>> disc = np.uint8(255 * (np.hypot(u - 319.5, v - 239.5) < 50.0))
    >>> found = locate_upright(disc, camera, T, radius=0.15, length=0.2, height=0.0)
    >>> found.p_base.round(3) + 0.0, found.agreement > 0.95
    (array([0. , 0. , 0.1]), True)
    """
    T = np.asarray(T_base_camera, dtype=np.float64)
    if mask.shape != camera.size[::-1]:
        raise ArrayError(f"mask must have shape {camera.size[::-1]}, as the camera's images, got {mask.shape}")
    if not (radius > 0.0 and length > 0.0):
        raise ArrayError(f"radius and length must be above 0 m, got {radius} and {length}")
    best: Upright | None = None
    for seen in _outlines(mask):
        found = _stood(seen, camera, T, radius, length, height)
        if found is not None and found.agreement >= max(least_agreement, best.agreement if best else 0.0):
            best = found
    return best


def cylinder_outline(
    camera: Camera, T_base_camera: FloatArray, p_base: FloatArray, radius: float, length: float
) -> FloatArray:
    """Return the outline of an upright cylinder about `p_base`, ``(k, 2)`` [px]; NaN when it is not all before the camera."""
    turn = np.linspace(0.0, 2.0 * np.pi, _RIM, endpoint=False)
    rim = np.stack([radius * np.cos(turn), radius * np.sin(turn), np.full(_RIM, 0.5 * length)], axis=1)
    p = np.concatenate([rim, rim * (1.0, 1.0, -1.0)]) + p_base
    uv = camera.project((p - T_base_camera[:3, 3]) @ T_base_camera[:3, :3])
    return _hull(uv) if np.isfinite(uv).all() else np.full((3, 2), np.nan)


def _outlines(mask: NDArray[np.uint8]) -> list[FloatArray]:
    """Convex outlines of the largest patches: glare within does not matter."""
    cv2 = opencv("finding a cylinder")
    whole = cv2.morphologyEx((mask != 0).astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    count, labels, stats, _ = cv2.connectedComponentsWithStats(whole, connectivity=8)
    areas = stats[1:count, cv2.CC_STAT_AREA]
    found = []
    for row in np.argsort(-areas)[:_PATCHES]:
        if areas[row] < SMALLEST:
            break
        left, top, width, height, _ = stats[row + 1]
        v, u = np.nonzero(labels[top : top + height, left : left + width] == row + 1)
        centres = np.stack([u + left, v + top], axis=1).astype(np.float64)
        corners = np.concatenate([centres + half for half in ((-0.5, -0.5), (0.5, -0.5), (-0.5, 0.5), (0.5, 0.5))])
        found.append(_hull(corners))
    return found


def _stood(
    seen: FloatArray, camera: Camera, T: FloatArray, radius: float, length: float, height: float
) -> Upright | None:
    goal = _middle(seen)
    z = height + 0.5 * length
    ray = T[:3, :3] @ camera.directions(goal)
    if not np.isfinite(ray).all() or abs(ray[2]) < 1e-9:
        return None
    along = (z - T[2, 3]) / ray[2]
    if along <= 0.0:
        return None
    p = T[:3, 3] + along * ray
    for _ in range(_TURNS):
        places = p + _STEP * np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
        here, ahead, aside = (_middle(cylinder_outline(camera, T, place, radius, length)) for place in places)
        J = np.stack([ahead - here, aside - here], axis=1) / _STEP
        if not np.isfinite(J).all() or abs(np.linalg.det(J)) < 1e-6:
            return None
        step = np.linalg.solve(J, goal - here)
        p = p + np.append(step, 0.0)
        if np.abs(step).max() < _NEAR:
            break
    expected = cylinder_outline(camera, T, p, radius, length)
    return Upright(p, _agreement(seen, expected), seen, expected) if np.isfinite(expected).all() else None


def _hull(uv: FloatArray) -> FloatArray:
    cv2: Any = opencv("finding a cylinder")
    return np.asarray(cv2.convexHull(uv.astype(np.float32))[:, 0], dtype=np.float64)


def _middle(polygon: FloatArray) -> FloatArray:
    """Centroid of the area of a polygon, ``(2,)``."""
    start = polygon[0]
    a = polygon - start
    b = np.roll(a, -1, axis=0)
    cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return np.asarray(start + (cross[:, None] * (a + b)).sum(axis=0) / (3.0 * cross.sum()))


def _area(polygon: FloatArray) -> float:
    a, b = polygon, np.roll(polygon, -1, axis=0)
    return abs(float((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum())) / 2.0


def _agreement(one: FloatArray, other: FloatArray) -> float:
    cv2 = opencv("finding a cylinder")
    shared, _ = cv2.intersectConvexConvex(one.astype(np.float32), other.astype(np.float32))
    return float(shared / max(_area(one) + _area(other) - shared, 1e-9))


def draw_upright(image: Image, found: Upright, color: tuple[int, int, int] = (255, 255, 255)) -> None:
    """Draw what was seen into an image (blue, green, red): the outline of the patch in black, that of a cylinder there, and a cross at its middle.

    Parameters
    ----------
    image : (height, width, 3) array of uint8
        Blue, green, red; it is drawn into.
    found : Upright
        From `locate_upright`.
    color : (int, int, int)
        Of the cylinder and the cross: blue, green, red.
    """
    cv2 = opencv("drawing over frames")
    for outline, ink, width in (
        (found.expected, (255, 255, 255), 5),
        (found.seen, (0, 0, 0), 3),
        (found.expected, color, 2),
    ):
        fixed = np.round(outline * 2**_SHIFT).astype(np.int32).reshape(-1, 1, 2)
        cv2.polylines(image, [fixed], True, ink, width, cv2.LINE_AA, _SHIFT)
    draw_seen(image, _middle(found.expected), "")
