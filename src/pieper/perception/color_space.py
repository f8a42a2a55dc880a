"""Coordinates in which the pixels of one colour lie close together, and how sure a pixel is of its own.

Two of them. In ``log-chroma`` a pixel is ``log(value + 16)`` of each channel: light that is brighter or dimmer moves all colours along
nearly one direction, a colour cast along another, and there is nothing that wraps. The offset keeps the noise of a dark channel from
becoming most of the logarithm. ``hsv`` is the space of OpenCV, with a hue that is a circle.

A dark channel tells little: its logarithm changes by ``sigma / (value + 16)`` with the noise. That variance is a part of every distance.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from pieper.errors import unknown_name
from pieper.perception.opencv import opencv

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from pieper.spatial._checks import FloatArray

NOISE = 4.0
"""Standard deviation of a channel that is always allowed for [grey levels]: noise of the sensor, compression, and the cells of the table."""

OFFSET = 16.0
"""Added to a channel before its logarithm [grey levels]."""

_LOGARITHM = np.log(np.arange(256) + OFFSET)


class Space(Protocol):
    """Coordinates of pixels; all arrays are ``(..., 3)``."""

    name: str

    def of(self, bgr: NDArray[Any]) -> FloatArray:
        """Coordinates of pixels."""
        ...

    def minus(self, x: FloatArray, mean: FloatArray) -> FloatArray:
        """Difference of coordinates, the short way round."""
        ...

    def mean(self, x: FloatArray) -> FloatArray:
        """Mean of coordinates ``(n, 3)``."""
        ...

    def noise(self, bgr: NDArray[Any]) -> FloatArray:
        """Variances of the coordinates of pixels that come from the noise of their channels."""
        ...

    def spread(self, mean: FloatArray, light: float, cast: float) -> FloatArray:
        """Covariance ``(3, 3)`` that changes of light and of its colour bring, both as standard deviations of a logarithm."""
        ...


class LogChroma:
    """Logarithms of blue, green and red."""

    name = "log-chroma"

    def of(self, bgr: NDArray[Any]) -> FloatArray:
        """``log(value + 16)`` of each channel."""
        return np.asarray(_LOGARITHM[bgr] if bgr.dtype == np.uint8 else np.log(bgr + OFFSET))

    def minus(self, x: FloatArray, mean: FloatArray) -> FloatArray:
        """Plain difference."""
        return x - mean

    def mean(self, x: FloatArray) -> FloatArray:
        """Plain mean."""
        return np.asarray(x.mean(axis=0))

    def noise(self, bgr: NDArray[Any]) -> FloatArray:
        """``(sigma / (value + 16))^2``."""
        return np.asarray((NOISE / (bgr + OFFSET)) ** 2)

    def spread(self, mean: FloatArray, light: float, cast: float) -> FloatArray:
        """Light along ``value / (value + 16)``, the derivative of a coordinate by the logarithm of the light; cast in each channel."""
        slope = np.clip(1.0 - OFFSET * np.exp(-mean), 0.0, 1.0)
        return light**2 * np.outer(slope, slope) + cast**2 * np.diag(slope**2)

    def lit(self, mean: FloatArray, gain: FloatArray) -> FloatArray:
        """Return where coordinates ``(..., 3)`` go when the logarithm of the light of each channel grows by `gain` ``(3,)``."""
        return np.asarray(np.log(np.maximum(np.exp(mean) - OFFSET, 0.0) * np.exp(gain) + OFFSET))


class Hsv:
    """Hue in [0, 180), saturation and value in [0, 255], as OpenCV has them."""

    name = "hsv"

    def of(self, bgr: NDArray[Any]) -> FloatArray:
        """As OpenCV converts, without rounding."""
        cv2 = opencv("HSV")
        flat = np.ascontiguousarray(bgr, dtype=np.float32).reshape(-1, 1, 3) / np.float32(255.0)
        hsv = cv2.cvtColor(flat, cv2.COLOR_BGR2HSV) if len(flat) else flat
        return np.asarray(hsv.reshape(bgr.shape).astype(np.float64) * [0.5, 255.0, 255.0])

    def minus(self, x: FloatArray, mean: FloatArray) -> FloatArray:
        """Difference with the hue in [-90, 90)."""
        difference = x - mean
        difference[..., 0] = (difference[..., 0] + 90.0) % 180.0 - 90.0
        return difference

    def mean(self, x: FloatArray) -> FloatArray:
        """Mean with a hue that is the direction of the mean vector on the circle, then the mean about it."""
        angle = x[:, 0] * (np.pi / 90.0)
        about = np.array([np.arctan2(np.sin(angle).mean(), np.cos(angle).mean()) * (90.0 / np.pi), 0.0, 0.0])
        mean = about + self.minus(x, about).mean(axis=0)
        mean[0] = mean[0] % 180.0 % 180.0  # twice: a hair below 0 becomes 180 first
        return np.asarray(mean)

    def noise(self, bgr: NDArray[Any]) -> FloatArray:
        """Hue ``30 sigma / chroma``, saturation ``255 sigma / value``, value ``sigma``."""
        high = bgr.max(axis=-1).astype(np.float64)
        chroma = np.maximum(high - bgr.min(axis=-1), 1.0)
        hue = np.minimum(30.0 * NOISE / chroma, 52.0)  # no hue at all: the deviation of the whole circle
        saturation = np.minimum(255.0 * NOISE / np.maximum(high, 1.0), 74.0)
        return np.stack([hue**2, saturation**2, np.full_like(high, NOISE**2)], axis=-1)

    def spread(self, mean: FloatArray, light: float, cast: float) -> FloatArray:
        """Light in the value; cast in the hue, where the saturation is high by a sixth of the circle for each unit, and in the saturation."""
        return np.diag([(30.0 * cast) ** 2, (255.0 * cast) ** 2, (light * max(mean[2], 32.0)) ** 2])


SPACES: dict[str, Space] = {space.name: space for space in (LogChroma(), Hsv())}


def space_named(name: str) -> Space:
    """Return the space of that name.

    Raises
    ------
    UnknownNameError
        There is none.
    """
    if name not in SPACES:
        raise unknown_name("space", name, SPACES)
    return SPACES[name]


def hsv_statistics(bgr: NDArray[np.uint8]) -> tuple[FloatArray, FloatArray]:
    """Return mean and covariance of pixels in OpenCV's 8-bit HSV, with a hue that wraps.

    Parameters
    ----------
    bgr : (n, 3) uint8 array
        Pixels, at least one.

    Returns
    -------
    mean : (3,) array
        Hue in [0, 180), saturation, value.
    covariance : (3, 3) array
        About that mean, divided by n.

    Examples
    --------
    Two reds, on either side of the place where hue wraps:

    >>> hsv_statistics(np.array([[0, 20, 255], [20, 0, 255]], np.uint8))[0]
    array([  0., 255., 255.])
    """
    cv2 = opencv("HSV")
    x = cv2.cvtColor(np.ascontiguousarray(bgr).reshape(-1, 1, 3), cv2.COLOR_BGR2HSV).reshape(-1, 3).astype(np.float64)
    space = SPACES["hsv"]
    mean = space.mean(x)
    away = space.minus(x, mean)
    return mean, away.T @ away / len(away)


def pooled(means: FloatArray, covariances: FloatArray, space: Space) -> tuple[FloatArray, FloatArray]:
    """Return mean and covariance of several captures together: within them and between them.

    ``mean = E[m_i]``, ``covariance = E[C_i] + E[(m_i - mean)(m_i - mean)^T]`` (law of total covariance), each capture counting the same.

    Parameters
    ----------
    means, covariances : (n, 3) and (n, 3, 3) arrays
    space : Space
        How means differ.
    """
    mean = space.mean(means)
    away = space.minus(means, mean)
    return mean, covariances.mean(axis=0) + away.T @ away / len(away)
