"""The slow following of the light: what markers that are surely markers look like now moves the colour model, within bounds.

The light is one gain for each channel, the same for all colours and the background::

    log(value now) = log(value learned) + light + cast_channel + shift_colour

From each frame it is fitted by least squares to the confirmed markers, with small casts and shifts preferred, and followed with a time
constant. Markers that the model itself does not take for their colour tell nothing, and what the learned spread of a colour explains
is no change of the light: a robot that was learned in the glare and in the dark is still known there after an hour in the dark. The
light and the cast have bounds; a colour's own shift is at most a quarter of the way to the nearest other colour, so that no two of them
can meet.
"""

from __future__ import annotations

import logging
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pieper.errors import VisionError
from pieper.perception.color_space import NOISE, OFFSET, LogChroma

if TYPE_CHECKING:
    from pieper.perception.blobs import Blobs
    from pieper.perception.color import ColorModel
    from pieper.perception.color_table import ColorTable
    from pieper.perception.frame import Frame, Image
    from pieper.spatial._checks import FloatArray

_LOG = logging.getLogger(__name__)

_STEP = 0.02  # of a logarithm; the table is made anew when a colour moved further
_KEPT = 1000  # changes in the history
_PRIOR_CAST, _PRIOR_SHIFT = 0.1, 0.05  # standard deviations of what one frame is thought to show
_CORE = 0.6  # of a blob's radius: its rim is mixed with what is beside it
_ROUND = 0.6  # circularity below which a blob is the edge of something, or several things; a box of 2 to 1 has 0.76
_CLIPPED = 250  # grey level from which a channel may have been more
_MOST_STEP = 0.3  # of a logarithm that one frame may ask for
_KNOWN = 1.5  # Mahalanobis distance that the spread within and between captures explains


@dataclass(frozen=True, eq=False)
class LightChange:
    """One renewal of the table.

    Attributes
    ----------
    time : float
        Of the frame [s].
    light : float
        Against that of learning, 1 is the same.
    cast : (float, float, float)
        Of blue, green and red against their mean, 1 is none.
    shifts : (k, 3) array
        Of the colours' means beyond that, in log-chroma.
    """

    time: float
    light: float
    cast: tuple[float, float, float]
    shifts: FloatArray


class LightAdaptation:
    """Follows the light with a colour model.

    Parameters
    ----------
    model : ColorModel
        As it was learned, in log-chroma.
    enabled : bool, optional
        If not, the table stays as it was learned, whatever is observed. By default a model in log-chroma follows the light, and one in
        HSV, which cannot, does not.
    seconds : float
        Time constant with which the light is followed [s]; that of a single colour is five times longer.
    most_light : float
        Factor by which the light may become less or more.
    most_cast : float
        Bound of the cast of a channel, as a logarithm.
    most_shift : float
        Bound of the shift of a single colour, as the length of a vector of logarithms.
    forget : float
        Time constant of the way back to what was learned while nothing is confirmed [s].
    every : float
        Least time between two tables [s].

    Attributes
    ----------
    model : ColorModel
        As it is now.
    table : ColorTable
        As it is now.
    history : deque of LightChange
        The last thousand changes; each is also logged.

    Raises
    ------
    VisionError
        The model is not in log-chroma, or a number is out of range.
    """

    def __init__(
        self,
        model: ColorModel,
        *,
        enabled: bool | None = None,
        seconds: float = 0.5,
        most_light: float = 4.0,
        most_cast: float = 0.35,
        most_shift: float = 0.2,
        forget: float = 60.0,
        every: float = 0.25,
    ) -> None:
        if enabled and model.space != LogChroma.name:
            raise VisionError(f"the light can be followed in {LogChroma.name} only, these colours are in {model.space}")
        for name, value, least in (
            ("every", every, 0.0),
            ("most_light", most_light, 1.0),
            ("most_cast", most_cast, 0.0),
            ("most_shift", most_shift, 0.0),
        ):
            if not value >= least:
                raise VisionError(f"{name} must be at least {least:g}, got {value:g}")
        for name, value in (("seconds", seconds), ("forget", forget)):
            if not value > 0.0:
                raise VisionError(f"{name} must be a time above 0 s, got {value:g}")
        self.enabled = model.space == LogChroma.name if enabled is None else enabled
        self.model, self._learned = model, model
        self.table: ColorTable = model.table()
        self.history: deque[LightChange] = deque(maxlen=_KEPT)
        self._renewals = 0
        self._seconds, self._forget, self._every = seconds, forget, every
        self._most_light, self._most_cast, self._most_shift = float(np.log(most_light)), most_cast, most_shift
        self._light, self._cast = 0.0, np.zeros(3)
        self._shifts = np.zeros((len(model.names), 3))
        self._made = self._means()
        self._time: float | None = None
        self._renewed = -np.inf

    @property
    def light(self) -> float:
        """The light against that of learning; 1 is the same."""
        return float(np.exp(self._light))

    @property
    def cast(self) -> tuple[float, float, float]:
        """Blue, green and red of the light against their mean; 1 is none."""
        b, g, r = np.exp(self._cast).tolist()
        return b, g, r

    def summary(self) -> str:
        """Return a sentence for people."""
        if not self.enabled:
            return "the light was not followed"
        b, g, r = self.cast
        return (
            f"light {self.light:.2f} of that learned, cast blue {b:.2f}, green {g:.2f}, red {r:.2f}; "
            f"the table was renewed {self._renewals} times"
        )

    def update(self, frame: Frame, blobs: Blobs) -> bool:
        """Take in a frame.

        Parameters
        ----------
        frame : Frame
            The image, and its time.
        blobs : Blobs
            Those that belong to confirmed tracks, and no others.

        Returns
        -------
        bool
            Whether `table` is a new one.
        """
        if not self.enabled:
            return False
        elapsed = 0.0 if self._time is None else frame.time - self._time
        dt = min(max(elapsed, 0.0), 1.0)  # a clock that jumps moves nothing far
        self._time = frame.time
        seen = self._seen(frame.image, blobs)
        if seen:
            self._follow(seen, dt)
        else:
            back = np.exp(-dt / self._forget)
            self._light, self._cast, self._shifts = self._light * back, self._cast * back, self._shifts * back
        return self._renew(frame.time)

    def reset(self) -> None:
        """Go back to what was learned."""
        self.model, self.table = self._learned, self._learned.table()
        self._light, self._cast, self._shifts = 0.0, np.zeros(3), np.zeros_like(self._shifts)
        self._made = self._means()
        self._time, self._renewed = None, -np.inf

    def _seen(self, image: Image, blobs: Blobs) -> dict[int, FloatArray]:
        """The pixel of each colour, ``(3,)``, as the median of its markers that still look like it."""
        height, width = image.shape[:2]
        found: dict[int, list[FloatArray]] = {}
        for i in range(len(blobs)):
            name = blobs.names[int(blobs.color[i])]
            good = blobs.circularity[i] >= _ROUND and np.isfinite(blobs.centroid[i]).all()
            if name not in self._learned.names or not good:
                continue
            k = self._learned.names.index(name)
            (u, v), r = blobs.centroid[i], max(_CORE * float(blobs.radius[i]) / np.sqrt(2), 0.5)
            left, right = max(int(np.ceil(u - r)), 0), min(int(np.floor(u + r)), width - 1)
            top, bottom = max(int(np.ceil(v - r)), 0), min(int(np.floor(v + r)), height - 1)
            patch = image[top : bottom + 1, left : right + 1].reshape(-1, 3)
            if not len(patch):
                continue
            own = self.table.classify(patch[None])[0] == k + 1
            if 2 * own.sum() > len(patch):
                found.setdefault(k, []).append(np.median(patch[own], axis=0))
        return {k: np.median(pixels, axis=0) for k, pixels in found.items()}

    def _follow(self, seen: dict[int, FloatArray], dt: float) -> None:
        rows = list(seen)
        now = np.array([seen[k] for k in rows])
        learned = np.maximum(np.exp(self._learned.means[rows]) - OFFSET, 1.0)
        away = np.log(np.maximum(now, 1.0) / learned)
        away *= self._unexplained(rows, np.log(now + OFFSET) - self._learned.means[rows])
        before = self._light + self._cast
        away = before + np.clip(away - before, -_MOST_STEP, _MOST_STEP)
        # The variance of each: what a colour does by itself, and the noise now and then; a channel at its end tells nothing.
        weight = 1.0 / (_PRIOR_SHIFT**2 + (NOISE / np.maximum(now, 1.0)) ** 2 + (NOISE / learned) ** 2)
        weight[now >= _CLIPPED] = 0.0
        weight[learned >= _CLIPPED] *= 0.1
        light, cast = _fit(away, weight)
        share = 1.0 - np.exp(-dt / self._seconds)
        self._light += share * (light - self._light)
        self._light = float(np.clip(self._light, -self._most_light, self._most_light))
        self._cast = self._cast + share * (cast - self._cast)
        self._cast = np.clip(self._cast - self._cast.mean(), -self._most_cast, self._most_cast)
        self._shift(rows, now, weight, 1.0 - np.exp(-dt / (5.0 * self._seconds)))

    def _shift(self, rows: list[int], now: FloatArray, weight: FloatArray, share: float) -> None:
        """Move each colour by what the light leaves over, and keep all of them apart."""
        lit = LogChroma().lit(self._learned.means, self._light + self._cast)
        left = np.log(now + OFFSET) - lit[rows]
        left *= self._unexplained(rows, left)
        trust = weight / (weight + 1.0 / _PRIOR_SHIFT**2)  # the noise of a dark channel is no shift
        self._shifts[rows] += share * (trust * left - self._shifts[rows])
        apart = np.linalg.norm(lit[:, None] - lit[None], axis=-1)
        np.fill_diagonal(apart, np.inf)
        most = np.minimum(self._most_shift, 0.25 * apart.min(axis=1))
        length = np.maximum(np.linalg.norm(self._shifts, axis=1), 1e-12)
        self._shifts *= np.minimum(1.0, most / length)[:, None]

    def _unexplained(self, rows: list[int], away: FloatArray) -> FloatArray:
        """The share of differences from the learned means, ``(k, 1)``, that the learned spread leaves over; all of a large one."""
        inverse = np.linalg.inv(self._learned.covariances[rows])
        d = np.sqrt(np.einsum("ki,kij,kj->k", away, inverse, away))
        return np.asarray(1.0 - (_KNOWN / np.maximum(d, _KNOWN)) ** 2)[:, None]

    def _means(self) -> FloatArray:
        return LogChroma().lit(self._learned.means, self._light + self._cast) + self._shifts

    def _renew(self, time: float) -> bool:
        means = self._means()
        if float(np.abs(means - self._made).max()) < _STEP or 0 <= time - self._renewed < self._every:
            return False
        self._made, self._renewed = means, time
        self.model = self._learned.relit(self._light + self._cast, self._shifts)
        self.table = self.model.table()
        self._renewals += 1
        self.history.append(LightChange(time, self.light, self.cast, self._shifts.copy()))
        _LOG.info(
            "t = %.3f s: light %.3f, blue %.3f, green %.3f, red %.3f of that learned", time, self.light, *self.cast
        )
        return True


def _fit(away: FloatArray, weight: FloatArray) -> tuple[float, FloatArray]:
    """Light and casts that explain logarithms of gains ``(k, 3)`` best: least squares, with a prior for small casts."""
    A = np.zeros((4, 4))
    b = np.zeros(4)
    for channel in range(3):
        w = weight[:, channel]
        row = np.zeros(4)
        row[[0, 1 + channel]] = 1.0
        A += w.sum() * np.outer(row, row)
        b += float(w @ away[:, channel]) * row
    A[[1, 2, 3], [1, 2, 3]] += 1.0 / _PRIOR_CAST**2
    A[0, 0] += 1e-3  # no weight at all: no light
    light, *cast = np.linalg.solve(A, b)
    return float(light), np.array(cast)
