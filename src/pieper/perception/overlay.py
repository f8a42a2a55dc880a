"""What the tracker saw and believes, drawn over the frame.

=============================  ==============================================================================================
patch of colour                circle of its area, name of its colour 10 px to the right
track that is seen             green tilted cross of 15 px at the filtered position, name, heading, trail, ellipse
track that is hidden           cross of 20 px at the predicted position, and in red ``NAME P(Ocuido)`` ("occluded")
=============================  ==============================================================================================
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.perception.field_view import PixelView
from pieper.perception.opencv import opencv

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from pieper.perception.blobs import Blobs
    from pieper.perception.estimate import Estimate
    from pieper.perception.field_view import View
    from pieper.perception.frame import Frame, Image
    from pieper.spatial._checks import FloatArray

Bgr = tuple[int, int, int]

DRAW_COLORS: dict[str, Bgr] = {
    "red": (0, 0, 255),
    "green": (0, 255, 0),
    "blue": (255, 0, 0),
    "yellow": (0, 255, 255),
    "orange": (0, 128, 255),
    "pink": (180, 105, 255),
    "magenta": (255, 0, 255),
    "purple": (200, 60, 130),
    "cyan": (255, 255, 0),
    "lime": (0, 255, 128),
    "white": (255, 255, 255),
}
"""Of the usual names; others get one of `_PALETTE`."""

_PALETTE: tuple[Bgr, ...] = (
    (60, 180, 255),
    (255, 160, 60),
    (120, 255, 160),
    (220, 120, 255),
    (255, 255, 140),
    (140, 220, 220),
)
_RED, _GREEN, _WHITE, _BLACK = (0, 0, 255), (0, 255, 0), (255, 255, 255), (0, 0, 0)
_HIDDEN_CROSS, _SEEN_CROSS = 20, 15  # px, as the source report has them
_LABEL_RIGHT, _FONT = 10, 0.4
_ABOVE = np.array([0.0, 12.0])  # px; the name of a track, so that it is not on that of its marker
_ARROW = 28.0  # px
_INSIDE_95 = 5.991  # of chi-square with two degrees of freedom
_SHIFT = 4  # OpenCV draws at sixteenths of a pixel
_LARGEST = 4000.0  # px; of an ellipse, and of places beside the image


class Overlay:
    """Draws steps over their frames, and remembers where each track was.

    Parameters
    ----------
    view : View
        From places to pixels; pixels themselves by default.
    colors : mapping of str to (int, int, int), optional
        Blue, green, red to draw each colour with; see `DRAW_COLORS` for the default.
    height : float or mapping of str to float
        Of the places of tracks above the field, for all or by kind [m].
    trail : int
        Length of a trail, in frames; 0 for none.
    """

    def __init__(
        self,
        view: View | None = None,
        *,
        colors: Mapping[str, Bgr] | None = None,
        height: float | Mapping[str, float] = 0.0,
        trail: int = 60,
    ) -> None:
        opencv("drawing over frames")
        self._view: View = PixelView() if view is None else view
        self._colors = dict(DRAW_COLORS, **(colors or {}))
        self._height = height
        self._length = trail
        self._trails: dict[int, deque[FloatArray]] = {}

    def draw(self, frame: Frame, step: Any) -> Image:
        """Return the frame with everything drawn over it; the frame itself stays as it is.

        Parameters
        ----------
        frame : Frame
        step : Step
            Its `blobs`, `sightings` and `estimates`.

        Returns
        -------
        (height, width, 3) uint8 array
            Blue, green, red.
        """
        image = frame.image.copy()
        draw_blobs(image, step.blobs, sorted({row for s in step.sightings for row in s.blobs}), self._colors)
        for estimate in step.estimates:
            if estimate.state == "lost":
                self._trails.pop(estimate.track, None)
                continue
            self._draw_track(image, estimate)
        for gone in self._trails.keys() - {e.track for e in step.estimates}:
            del self._trails[gone]
        return image

    def _draw_track(self, image: Image, estimate: Estimate) -> None:
        height = self._height if isinstance(self._height, (int, float)) else self._height.get(estimate.kind, 0.0)
        at = self._view.to_image(estimate.position, height=height)
        if not _drawable(at):
            return
        trail = self._trails.setdefault(estimate.track, deque(maxlen=max(self._length, 1)))
        trail.append(at)
        name = estimate.name or f"{estimate.kind} {estimate.track}"
        color = self._colors.get(estimate.name or "", _PALETTE[estimate.track % len(_PALETTE)])
        if self._length:
            _polyline(image, np.array(trail), color)
        covariance = _in_pixels(self._view, at, height, estimate.covariance[:2, :2])
        if covariance is not None:
            draw_ellipse(image, at, covariance, color)
        if estimate.heading is not None:
            ahead = np.array([np.cos(estimate.heading), np.sin(estimate.heading)])
            reach = 0.01 if self._view.unit == "m" else 1.0
            tip = self._view.to_image(estimate.position + reach * ahead, height=height) - at
            if _drawable(tip) and np.hypot(*tip) > 0:
                _arrow(image, at, at + tip * (_ARROW / np.hypot(*tip)), color)
        if estimate.state == "hidden":
            draw_hidden(image, at, name, color)
        else:
            draw_seen(image, at, name if estimate.kind != "marker" else "", color)


def draw_blobs(image: Image, blobs: Blobs, rows: Iterable[int], colors: Mapping[str, Bgr] = DRAW_COLORS) -> None:
    """Draw a circle around each of some blobs, and the name of its colour, into an image.

    Parameters
    ----------
    image : (height, width, 3) uint8 array
        Is drawn into.
    blobs : Blobs
    rows : iterable of int
        Which of them.
    colors : mapping of str to (int, int, int)
        Blue, green and red by the name of a colour.
    """
    cv2 = opencv("drawing over frames")
    for row in rows:
        name = blobs.names[int(blobs.color[row])]
        color = colors.get(name.lower(), colors.get(name, _PALETTE[int(blobs.color[row]) % len(_PALETTE)]))
        at = blobs.centroid[row]
        cv2.circle(image, _fixed(at), round(float(blobs.radius[row]) * 2**_SHIFT), color, 1, cv2.LINE_AA, _SHIFT)
        write(image, at, name, color)


def draw_seen(image: Image, at: FloatArray, name: str, color: Bgr = _WHITE) -> None:
    """Draw a track that is seen: a green tilted cross of 15 px, and its name.

    Parameters
    ----------
    image : (height, width, 3) uint8 array
        Is drawn into.
    at : (2,) array
        u and v [px].
    name : str
        Of the track.
    color : (int, int, int)
        Of the name: blue, green, red.
    """
    cv2 = opencv("drawing over frames")
    cv2.drawMarker(image, _whole(at), _GREEN, cv2.MARKER_TILTED_CROSS, _SEEN_CROSS, 1, cv2.LINE_AA)
    if name:
        write(image, at - _ABOVE, name, color)


def draw_hidden(image: Image, at: FloatArray, name: str, color: Bgr = _RED) -> None:
    """Draw a track that is hidden: a cross of 20 px where it should be, and in red that it is occluded.

    Parameters
    ----------
    image : (height, width, 3) uint8 array
        Is drawn into.
    at : (2,) array
        u and v [px].
    name : str
        Of the track.
    color : (int, int, int)
        Of the name: blue, green, red.
    """
    cv2 = opencv("drawing over frames")
    cv2.drawMarker(image, _whole(at), color, cv2.MARKER_CROSS, _HIDDEN_CROSS, 1)
    write(image, at, f"{name} P(Ocuido)", _RED)


def draw_ellipse(image: Image, at: FloatArray, covariance: FloatArray, color: Bgr) -> None:
    """Draw the ellipse that holds a place with 95 % probability; `covariance` is ``(2, 2)`` [px^2]."""
    cv2 = opencv("drawing over frames")
    values, vectors = np.linalg.eigh(covariance)
    axes = np.sqrt(np.maximum(values[::-1], 0.0) * _INSIDE_95)
    if not np.isfinite(axes).all() or axes[0] > _LARGEST:
        return
    angle = float(np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1])))
    lengths = tuple(round(float(a) * 2**_SHIFT) for a in axes)
    cv2.ellipse(image, _fixed(at), lengths, angle, 0.0, 360.0, color, 1, cv2.LINE_AA, _SHIFT)


def write(image: Image, at: FloatArray, text: str, color: Bgr) -> None:
    """Write a text 10 px to the right of a place, with a dark rim so that it is read on any ground.

    Parameters
    ----------
    image : (height, width, 3) uint8 array
        Is drawn into.
    at : (2,) array
        u and v [px].
    text : str
    color : (int, int, int)
        Blue, green, red.
    """
    cv2 = opencv("drawing over frames")
    plain = text.encode("ascii", "replace").decode()
    x, y = _whole(at)
    x += _LABEL_RIGHT
    for dx, dy, ink in ((-1, 0, _BLACK), (1, 0, _BLACK), (0, -1, _BLACK), (0, 1, _BLACK), (0, 0, color)):
        cv2.putText(image, plain, (x + dx, y + dy), cv2.FONT_HERSHEY_SIMPLEX, _FONT, ink, 1, cv2.LINE_AA)


def _in_pixels(view: View, at: FloatArray, height: float, covariance: FloatArray) -> FloatArray | None:
    """Carry a covariance from the field to the image."""
    if view.unit == "px":
        return covariance
    J = view.jacobian(at, height=height)
    if not np.isfinite(J).all() or abs(np.linalg.det(J)) < 1e-18:
        return None
    inverse = np.linalg.inv(J)
    return np.asarray(inverse @ covariance @ inverse.T)


def _polyline(image: Image, points: FloatArray, color: Bgr) -> None:
    cv2 = opencv("drawing over frames")
    fixed = np.round(points * 2**_SHIFT).astype(np.int32).reshape(-1, 1, 2)
    cv2.polylines(image, [fixed], False, color, 1, cv2.LINE_AA, _SHIFT)


def _arrow(image: Image, start: FloatArray, end: FloatArray, color: Bgr) -> None:
    cv2 = opencv("drawing over frames")
    for rim, width in ((_BLACK, 4), (color, 2)):
        cv2.arrowedLine(image, _whole(start), _whole(end), rim, width, cv2.LINE_AA, 0, 0.3)


def _drawable(at: FloatArray) -> bool:
    return bool(np.isfinite(at).all() and (np.abs(at) < 2 * _LARGEST).all())


def _whole(at: FloatArray) -> tuple[int, int]:
    return round(float(at[0])), round(float(at[1]))


def _fixed(at: FloatArray) -> tuple[int, int]:
    return round(float(at[0]) * 2**_SHIFT), round(float(at[1]) * 2**_SHIFT)
