"""From frames to estimates: segment, find the patterns, track, each step timed.

``frame -> blobs -> sightings -> estimates``
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from time import perf_counter
from typing import TYPE_CHECKING, Protocol

import numpy as np

from pieper.errors import PieperWarning, VisionError, unknown_name
from pieper.perception.color_table import ColorTable
from pieper.perception.field_view import PixelView
from pieper.perception.lone_marker import lone_markers
from pieper.perception.pattern import Patterns, load_patterns
from pieper.perception.pattern_finder import PatternFinder
from pieper.perception.segment import segment
from pieper.perception.track import Tracker, TrackerParameters

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from pieper.perception.blobs import Blobs
    from pieper.perception.estimate import Estimate
    from pieper.perception.field_view import View
    from pieper.perception.frame import Frame
    from pieper.perception.lone_marker import Follow
    from pieper.perception.sighting import Sighting

MOST_BLOBS = 500
"""Patches of colour that are looked at in a frame; thirty robots and a ball have some 150."""


class Colors(Protocol):
    """What compiles to a table: a `ColorModel`."""

    def table(self) -> ColorTable:
        """Return the table."""
        ...


class Adaptation(Protocol):
    """Colours that follow the light slowly; see `pieper.perception.adapt`."""

    @property
    def table(self) -> ColorTable:
        """The table to use for the next frame."""
        ...

    def update(self, frame: Frame, blobs: Blobs) -> object:
        """Learn from the markers of confirmed objects in a frame."""
        ...


@dataclass(frozen=True, eq=False)
class Step:
    """What one frame gave.

    Attributes
    ----------
    index : int
        Of the frame.
    time : float
        Of its capture [s].
    blobs : Blobs
        Patches of colour.
    sightings : tuple of Sighting
        What this frame alone says; `Sighting.blobs` are rows of `blobs`.
    estimates : tuple of Estimate
        What the tracker believes at `time`, in the order of the track numbers; a track that ends is in it once more, as ``"lost"``.
    milliseconds : mapping of str to float
        Wall time of ``"segment"``, ``"pattern"``, ``"track"``, ``"adapt"`` and ``"total"``.
    """

    index: int
    time: float
    blobs: Blobs
    sightings: tuple[Sighting, ...]
    estimates: tuple[Estimate, ...]
    milliseconds: Mapping[str, float]


class MarkerTracker:
    """Follows robots, a ball, or single coloured markers through the frames of one camera.

    Parameters
    ----------
    colors : ColorModel or ColorTable
        The colours.
    view : View
        Where pixels look; pixels themselves by default.
    patterns : Patterns, str or Path, optional
        Marker layouts, the name of a built-in one, or a YAML file. Without any, every colour is followed by itself as a ``"marker"``.
    ball : str, optional
        Colour of a ball, if the patterns do not have one.
    markers : "all", "largest", or a mapping of colours to these
        Without patterns: which patches of a colour are followed. A colour that a mapping leaves out is not followed.
    parameters : TrackerParameters, optional
        Of the tracker; by default those for the unit of the view.
    adaptation : Adaptation, optional
        Follows the light.
    area : (int, int or None), optional
        Least and greatest area of a patch [px]; by default 12 and no bound.
    within : (float, float, float, float), optional
        Least x and y, greatest x and y, in the unit of the view: patches elsewhere are clutter and are left out.

    Raises
    ------
    VisionError
        A pattern or the ball has a colour that the table does not have.

    Notes
    -----
    A frame of another size than the last: in pixels the tracks end and new ones begin, since no place of before means anything now; with
    a calibrated view it is refused, because the calibration is of one size. Of more than `MOST_BLOBS` patches the largest are looked at, with
    a warning. Time stamps that jump: see `Tracker.step`.
    """

    def __init__(
        self,
        colors: Colors | ColorTable,
        *,
        view: View | None = None,
        patterns: Patterns | str | Path | None = None,
        ball: str | None = None,
        markers: Follow | Mapping[str, Follow] = "all",
        parameters: TrackerParameters | None = None,
        adaptation: Adaptation | None = None,
        area: tuple[int, int | None] = (12, None),
        within: tuple[float, float, float, float] | None = None,
    ) -> None:
        self.table = colors if isinstance(colors, ColorTable) else colors.table()
        self.view: View = PixelView() if view is None else view
        self.patterns = load_patterns(patterns) if patterns is None or not isinstance(patterns, Patterns) else patterns
        if ball is not None:
            self.patterns = self.patterns.with_ball(ball)
        self.tracker = Tracker(parameters or TrackerParameters.of_unit(self.view.unit))
        self._finder = PatternFinder(self.patterns, self.view) if self.patterns else None
        missing = sorted(self.patterns.colors - set(self.table.names))
        if missing:
            raise VisionError(
                f"the patterns have the colours {', '.join(missing)}, which were not learnt; "
                f"the colours are: {', '.join(self.table.names)}"
            )
        self._markers = _per_color(markers, self.table.names)
        self.adaptation = adaptation
        self._area = area
        self._within = None if within is None else np.array(within, dtype=np.float64).reshape(2, 2)
        self._size: tuple[int, int] | None = None
        self._told = False

    def step(self, frame: Frame) -> Step:
        """Take one frame.

        Raises
        ------
        VisionError
            Its size is not that of the calibration, or its time is not a finite number.
        """
        self._check_size(frame.size)
        clock = _Clock()
        blobs = self._segment(frame)
        clock.lap("segment")
        sightings = self._sightings(blobs)
        clock.lap("pattern")
        estimates = self.tracker.step(frame.time, sightings)
        clock.lap("track")
        if self.adaptation is not None:
            rows = sorted({row for i in self.tracker.used for row in sightings[i].blobs})
            self.adaptation.update(frame, blobs.select(np.array(rows, dtype=np.int64)))
            clock.lap("adapt")
        return Step(frame.index, frame.time, blobs, sightings, estimates, clock.milliseconds())

    def predict(self, time: float) -> tuple[Estimate, ...]:
        """Return where everything will be, or was, at another time; see `Tracker.predict`."""
        return self.tracker.predict(time)

    def _segment(self, frame: Frame) -> Blobs:
        table = self.table if self.adaptation is None else self.adaptation.table
        least, most = self._area
        blobs = self._largest(segment(frame.image, table, min_area=least, max_area=most))
        if self._within is None or not len(blobs):
            return blobs
        places = self.view.to_field(blobs.centroid)  # NaN, beyond the horizon, is nowhere
        return blobs.select(((places >= self._within[0]) & (places <= self._within[1])).all(axis=-1))

    def _largest(self, blobs: Blobs) -> Blobs:
        """Those that a frame may have: what follows takes time and memory that grow with the square of their number."""
        if len(blobs) <= MOST_BLOBS:
            return blobs
        if not self._told:
            self._told = True
            warnings.warn(
                f"a frame has {len(blobs)} patches of colour, and the {MOST_BLOBS} largest are looked at; "
                "are the colours too wide, or is something else of those colours?",
                PieperWarning,
                stacklevel=2,
            )
        return blobs.select(np.sort(np.argsort(-blobs.area, kind="stable")[:MOST_BLOBS]))

    def _sightings(self, blobs: Blobs) -> tuple[Sighting, ...]:
        if self._finder is None:
            return lone_markers(blobs, self.view, self._markers)
        return self._finder.find(blobs)

    def _check_size(self, size: tuple[int, int]) -> None:
        camera = getattr(self.view, "camera", None)
        if camera is not None and tuple(camera.size) != size:
            wanted, got = (" x ".join(map(str, s)) for s in (camera.size, size))
            raise VisionError(
                f"the camera was calibrated at {wanted} pixels, and a frame has {got}; calibrate at that size"
            )
        if self._size is not None and self._size != size:
            before = " x ".join(map(str, self._size))
            self.tracker.restart(f"frames are now {size[0]} x {size[1]} pixels, before they were {before}")
            if self._finder is not None:
                self._finder.forget()
        self._size = size


class _Clock:
    """Wall time of the stages of a step."""

    def __init__(self) -> None:
        self._start = self._last = perf_counter()
        self._laps: dict[str, float] = {}

    def lap(self, stage: str) -> None:
        now = perf_counter()
        self._laps[stage] = 1e3 * (now - self._last)
        self._last = now

    def milliseconds(self) -> dict[str, float]:
        return {**self._laps, "total": 1e3 * (self._last - self._start)}


def _per_color(markers: Follow | Mapping[str, Follow], names: tuple[str, ...]) -> dict[str, Follow]:
    """What is followed of each colour."""
    if isinstance(markers, str):
        markers = dict.fromkeys(names, markers)
    for name, which in markers.items():
        if name not in names:
            raise unknown_name("colour", name, names)
        if which not in ("all", "largest"):
            raise VisionError(f"of a colour, 'all' or 'largest' is followed, got {which!r} for {name!r}")
    return dict(markers)
