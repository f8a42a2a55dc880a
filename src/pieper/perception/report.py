"""The colour tracker of the report, step by step as it describes it, to measure others against: ``--method report``.

For each colour a Gaussian in HSV, the mean of the means and the mean of the covariances of its captures; a mask of the pixels within a
Mahalanobis distance; one erosion and two dilations; for red and blue the enclosing circle of the largest contour if its radius is in
the gate, for the others every contour whose radius is; positions cut to whole pixels; for red and blue a Kalman filter that predicts
in every frame and corrects when the marker was found. Where it was found, that place is reported, and where it was not, the prediction.

Its weaknesses are part of it. Hue is a number like any other, so a red on both sides of 0 has its mean in cyan, and its mask is empty or
everything; the spread between captures is lost; light that changes leaves the Gaussian behind; only the largest patch of a colour is
looked at; the filter starts at the corner of the image, counts frames instead of seconds, and predicts for ever.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.errors import VisionError
from pieper.perception.estimate import Estimate
from pieper.perception.opencv import opencv

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from pieper.perception.frame import Frame, Image
    from pieper.spatial._checks import FloatArray

THRESHOLD = 3.0
"""Mahalanobis distance, not squared, below which a pixel has a colour."""
ONE_GATE, MANY_GATE = (9.0, 15.5), (8.0, 15.2)
"""Radii [px] of the single markers and of those of which there are several; the ends are not in it."""
_PROCESS, _MEASUREMENT = 0.03, 1.0  # variances of the filter [px^2], [(px/frame)^2]
_PURPOSE = "the report's pipeline"


@dataclass(frozen=True, eq=False)
class ReportColor:
    """A Gaussian in OpenCV's HSV: hue 0 to 179, saturation and value 0 to 255.

    Attributes
    ----------
    name : str
        Of the colour.
    mean : (3,) array
        Mean of the captures' means.
    covariance : (3, 3) array
        Mean of the captures' covariances.
    threshold : float
        Mahalanobis distance below which a pixel has the colour; not squared.
    single : bool
        One marker, with a filter, as the report's red and blue; otherwise every patch, as its green.
    captures : tuple of ((3,) array, (3, 3) array)
        Mean and covariance of each capture, which the report prints.
    """

    name: str
    mean: FloatArray
    covariance: FloatArray
    threshold: float = THRESHOLD
    single: bool = True
    captures: tuple[tuple[FloatArray, FloatArray], ...] = ()

    @classmethod
    def learn(
        cls, name: str, regions: Sequence[Image], *, threshold: float = THRESHOLD, single: bool = True
    ) -> ReportColor:
        """Learn a colour from regions of frames, one for each capture.

        Parameters
        ----------
        name : str
            Of the colour.
        regions : sequence of (height, width, 3) uint8 arrays
            Blue, green, red; all pixels of the rectangle count, its corners too.
        threshold, single
            As the attributes.

        Returns
        -------
        ReportColor
            Mean and covariance in HSV, as the report pools them.

        Raises
        ------
        VisionError
            There is no region, or one is empty, has fewer than four pixels, or is flat, so that its covariance is singular.
        """
        if not len(regions):
            raise VisionError(f"colour {name!r} needs at least one region, got none")
        captures = tuple(
            _moments(region, f"region {k} of colour {name!r}") for k, region in enumerate(regions, start=1)
        )
        mean = np.mean([m for m, _ in captures], axis=0)
        covariance = np.mean([c for _, c in captures], axis=0)
        if np.linalg.matrix_rank(covariance) < 3:
            raise VisionError(
                f"the regions of colour {name!r} are flat: their covariance in HSV is singular; choose larger ones with some grain"
            )
        return cls(name, mean, covariance, threshold, single, captures)

    def as_printed(self) -> str:
        """Return means and covariances of the captures and of the model in the report's words."""
        rows = [*self.captures, (self.mean, self.covariance)]
        return "\n".join(f"Media HSV: {mean}\nCovarianza HSV:\n{covariance}" for mean, covariance in rows)


@dataclass(frozen=True)
class Patch:
    """A circle that was found, or that a filter predicts.

    Attributes
    ----------
    color : str
        Its colour.
    x, y : int
        Centre, cut to whole pixels.
    radius : float
        [px]; 0 of a prediction.
    occluded : bool
        Not found, but predicted.
    """

    color: str
    x: int
    y: int
    radius: float
    occluded: bool = False

    @property
    def label(self) -> str:
        """What the report writes beside it."""
        return f"{self.color} P(Ocuido)" if self.occluded else self.color


def _moments(region: Image, what: str) -> tuple[FloatArray, FloatArray]:
    if region.ndim != 3 or region.shape[2] != 3 or region.shape[0] * region.shape[1] < 4:
        raise VisionError(f"{what} must have at least four pixels of three channels, got shape {region.shape}")
    cv2 = opencv(_PURPOSE)
    hsv = cv2.cvtColor(np.ascontiguousarray(region), cv2.COLOR_BGR2HSV).reshape(-1, 3).astype(np.float64)
    return hsv.mean(axis=0), np.cov(hsv, rowvar=False)


def gaussian_mask(hsv: Image, mean: FloatArray, covariance: FloatArray, threshold: float) -> NDArray[np.uint8]:
    """Return 255 where the Mahalanobis distance of a pixel is below a threshold, 0 elsewhere.

    ``sqrt((p - mean)' covariance^-1 (p - mean)) < threshold``

    Parameters
    ----------
    hsv : (height, width, 3) uint8 array
        Hue from 0 to 179.
    mean : (3,) array
        Of the colour.
    covariance : (3, 3) array
        Of the colour.
    threshold : float
        A distance, not its square.

    Returns
    -------
    (height, width) uint8 array

    Examples
    --------
    >>> hsv = np.array([[[10, 100, 100], [16, 100, 100]]], np.uint8)
    >>> gaussian_mask(hsv, np.array([10.0, 100, 100]), np.diag([4.0, 9.0, 9.0]), 3.0)
    array([[255, 0]], dtype=uint8)
    """
    away = hsv.reshape(-1, 3).astype(np.float64) - mean
    squared = np.einsum("ij,jk,ik->i", away, np.linalg.inv(covariance), away)
    near = np.sqrt(squared) < threshold
    return np.asarray(near.reshape(hsv.shape[:2]), dtype=np.uint8) * np.uint8(255)


class _Filter:
    """Place and velocity in pixels and frames; starts at the corner of the image, sure of it."""

    def __init__(self) -> None:
        self.F = np.eye(4) + np.diag([1.0, 1.0], 2)
        self.state = np.zeros(4)
        self.P = np.zeros((4, 4))

    def predict(self) -> None:
        self.state = self.F @ self.state
        self.P = self.F @ self.P @ self.F.T + _PROCESS * np.eye(4)

    def correct(self, x: float, y: float) -> None:
        K = self.P[:, :2] @ np.linalg.inv(self.P[:2, :2] + _MEASUREMENT * np.eye(2))
        self.state = self.state + K @ (np.array([x, y]) - self.state[:2])
        self.P = self.P - K @ self.P[:2]


class ReportTracker:
    """The report's tracker; call `update` with one frame after the other.

    Parameters
    ----------
    colors : sequence of ReportColor
        With distinct names.
    kernel : (int, int)
        Size of the rectangle that erodes once and dilates twice [px].

    Attributes
    ----------
    masks : mapping of str to (height, width) uint8 array
        Of the last frame, after erosion and dilation.
    patches : tuple of Patch
        Of the last frame; nothing of an earlier one stays.
    """

    def __init__(self, colors: Sequence[ReportColor], *, kernel: tuple[int, int] = (5, 5)) -> None:
        names = [color.name for color in colors]
        if len(set(names)) < len(names):
            raise VisionError(f"colours must have distinct names, got {names}")
        self.colors = tuple(colors)
        self.kernel = np.ones(kernel, np.uint8)
        self.masks: Mapping[str, NDArray[np.uint8]] = {}
        self.patches: tuple[Patch, ...] = ()
        self._filters = {color.name: _Filter() for color in colors if color.single}
        self._first: dict[str, float] = {}
        self._last: dict[str, float] = {}

    def find(self, image: Image) -> tuple[Patch, ...]:
        """Return the circles in an image, red and blue at most once each; without the filters."""
        cv2 = opencv(_PURPOSE)
        hsv = cv2.cvtColor(image, cv2.COLOR_BGR2HSV)
        masks, patches = {}, []
        for color in self.colors:
            mask = gaussian_mask(hsv, color.mean, color.covariance, color.threshold)
            mask = cv2.dilate(cv2.erode(mask, self.kernel, iterations=1), self.kernel, iterations=2)
            masks[color.name] = mask
            contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
            if color.single and contours:
                contours = [max(contours, key=cv2.contourArea)]
            low, high = ONE_GATE if color.single else MANY_GATE
            for contour in contours:
                (x, y), radius = cv2.minEnclosingCircle(contour)
                if low < radius < high:
                    patches.append(Patch(color.name, int(x), int(y), float(radius)))
        self.masks = masks
        return tuple(patches)

    def update(self, frame: Frame) -> list[Estimate]:
        """Return what the report would show of a frame, in pixels.

        Returns
        -------
        list of Estimate
            For each single colour its place as found, or as predicted if it was not; it begins at the corner of the image. For the
            others each patch, numbered afresh in each frame because the report does not follow them.
        """
        found = self.find(frame.image)
        shown: list[Patch] = []
        estimates = []
        for color in self.colors:
            mine = [patch for patch in found if patch.color == color.name]
            if not color.single:
                shown.extend(mine)
                continue
            kalman = self._filters[color.name]
            kalman.predict()
            if mine:
                kalman.correct(mine[0].x, mine[0].y)
                self._first.setdefault(color.name, frame.time)
                self._last[color.name] = frame.time
            else:
                mine = [Patch(color.name, int(kalman.state[0]), int(kalman.state[1]), 0.0, occluded=True)]
            shown.append(mine[0])
        singles = [color.name for color in self.colors if color.single]
        count = len(singles)
        for patch in shown:
            if patch.color in singles:
                estimates.append(self._estimate(patch, 1 + singles.index(patch.color), frame.time))
            else:
                count += 1
                estimates.append(self._estimate(patch, count, frame.time))
        self.patches = tuple(shown)
        return estimates

    def _estimate(self, patch: Patch, track: int, time: float) -> Estimate:
        kalman = self._filters.get(patch.color)
        velocity = np.zeros(2) if kalman is None else kalman.state[2:].copy()
        covariance = np.eye(4) if kalman is None else kalman.P.copy()
        return Estimate(
            track=track,
            kind="marker",
            name=patch.color,
            time=time,
            position=np.array([patch.x, patch.y], dtype=np.float64),
            heading=None,
            velocity=velocity,
            turn_rate=None,
            covariance=covariance,
            state="hidden" if patch.occluded else "seen",
            unseen=time - self._last.get(patch.color, time) if patch.occluded else 0.0,
            age=time - self._first.get(patch.color, time),
        )

    def combined(self) -> NDArray[np.uint8]:
        """Return the union (height, width) of the masks of the last frame, which must have been one."""
        return np.asarray(np.bitwise_or.reduce(list(self.masks.values())))

    def drawn(self, image: Image) -> Image:
        """Return a copy of the last frame's image with what the report draws on it."""
        cv2 = opencv(_PURPOSE)
        out: Any = image.copy()
        for patch in self.patches:
            at = (patch.x, patch.y)
            if patch.occluded:
                cv2.drawMarker(out, at, _RED, cv2.MARKER_CROSS, 20, 2)
                cv2.putText(out, patch.label, (patch.x + 10, patch.y), cv2.FONT_HERSHEY_SIMPLEX, 0.4, _RED, 1)
                continue
            cv2.circle(out, at, int(patch.radius), _YELLOW, 2)
            cv2.putText(out, patch.label, (patch.x + 10, patch.y), cv2.FONT_HERSHEY_SIMPLEX, 0.4, _YELLOW, 1)
            if patch.color in self._filters:
                state = self._filters[patch.color].state
                cv2.drawMarker(out, (int(state[0]), int(state[1])), _GREEN, cv2.MARKER_TILTED_CROSS, 15, 1)
        marked: Image = out
        return marked


_RED, _GREEN, _YELLOW = (0, 0, 255), (0, 255, 0), (0, 255, 255)
