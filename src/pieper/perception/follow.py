"""A source through a tracker, frame by frame, into tables, videos and whoever listens; it can be stopped and resumed.

Resuming: a table holds what the tracker said, not what it knew. So the frames of the last seconds before the end of the table are
tracked once more without being written, the tracker warms up on them, and a track that then stands where one of the table stood goes
on under its number; others get numbers after the last one given. When the warm-up covers everything from the first frame on, the file
becomes the one that an uninterrupted run would have written, to the last byte.
"""

from __future__ import annotations

import time
from collections import defaultdict
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np
from scipy.optimize import linear_sum_assignment

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from pieper.perception.blobs import Blobs
    from pieper.perception.estimate import Estimate
    from pieper.perception.frame import Frame
    from pieper.perception.output import TrackFile, TrackRow, TrackWriter
    from pieper.perception.overlay import Overlay
    from pieper.perception.sighting import Sighting
    from pieper.perception.source import Source
    from pieper.perception.stream import Stream
    from pieper.perception.video_file import VideoFile

_SAME = 13.8  # squared Mahalanobis distance; 99.9 % of chi-square with two degrees of freedom
_NEVER = 1e9


class Found(Protocol):
    """What a tracker makes of a frame; a `Step` is one."""

    @property
    def index(self) -> int:
        """Of the frame."""
        ...

    @property
    def time(self) -> float:
        """Of its capture [s]."""
        ...

    @property
    def blobs(self) -> Blobs:
        """Patches of colour."""
        ...

    @property
    def sightings(self) -> Sequence[Sighting]:
        """What this frame alone says."""
        ...

    @property
    def estimates(self) -> Sequence[Estimate]:
        """What is believed."""
        ...

    @property
    def milliseconds(self) -> Mapping[str, float]:
        """Wall time of each stage."""
        ...


class Follows(Protocol):
    """Takes frames, one after another; a `MarkerTracker` does."""

    def step(self, frame: Frame) -> Found:
        """Take one frame."""
        ...


@dataclass
class Summary:
    """What came of a run, kept up to date while it runs.

    Attributes
    ----------
    frames : int
        Tracked and written.
    dropped : int
        By the source, because they were not taken in time.
    seconds : float
        Wall time.
    tracks : set of int
        Numbers of all tracks.
    milliseconds : mapping of str to float
        Mean wall time of each stage.
    """

    frames: int = 0
    dropped: int = 0
    seconds: float = 0.0
    tracks: set[int] = field(default_factory=set)
    milliseconds: dict[str, float] = field(default_factory=lambda: defaultdict(float))

    @property
    def fps(self) -> float:
        """Frames per second of wall time."""
        return self.frames / self.seconds if self.seconds > 0 else 0.0


def follow(
    source: Source,
    tracker: Follows,
    *,
    tracks: TrackWriter | None = None,
    video: VideoFile | None = None,
    overlay: Overlay | None = None,
    stream: Stream[Found] | None = None,
    on_step: Callable[[Frame, Found], object] | None = None,
    resumed: Resumed | None = None,
    summary: Summary | None = None,
) -> Summary:
    """Track a source to its end.

    Parameters
    ----------
    source : Source
        See `open_source`; `Source.stop` ends the run after the frame it is at.
    tracker : MarkerTracker
        Or anything else with its `step`.
    tracks, video : TrackWriter, VideoFile, optional
        Where to write; whoever opened them closes them.
    overlay : Overlay, optional
        Draws the frames of the video.
    stream : Stream, optional
        Gets every step.
    on_step : callable, optional
        Gets every frame and its step, after they were written.
    resumed : Resumed, optional
        Where a table goes on; `source` must begin at its `start`.
    summary : Summary, optional
        To be kept up to date, for those who want to know while it runs, or after an error.

    Returns
    -------
    Summary
    """
    result = Summary() if summary is None else summary
    sums: dict[str, float] = defaultdict(float)
    begun = time.perf_counter()
    for frame in source:
        step = tracker.step(frame)
        if resumed is not None:
            if frame.index <= resumed.last:
                resumed.warm_up(frame.index, step.estimates)
                if overlay is not None and video is not None:
                    overlay.draw(frame, step)
                begun = time.perf_counter()
                continue
            step = _with_estimates(step, resumed.numbered(step.estimates))
        if tracks is not None:
            tracks.write(step.index, step.time, step.estimates)
        if video is not None:
            video.write(frame.image if overlay is None else overlay.draw(frame, step))
        if stream is not None:
            stream.publish(step)
        result.frames += 1
        result.dropped = source.dropped
        result.seconds = time.perf_counter() - begun
        result.tracks.update(e.track for e in step.estimates)
        for stage, spent in step.milliseconds.items():
            sums[stage] += spent
            result.milliseconds[stage] = sums[stage] / result.frames
        if on_step is not None:
            on_step(frame, step)
    result.dropped = source.dropped
    return result


def _with_estimates(step: Found, estimates: tuple[Estimate, ...]) -> Found:
    return step if tuple(step.estimates) == estimates else replace(step, estimates=estimates)  # type: ignore[type-var]


class Resumed:
    """Where a table goes on, and under which numbers.

    Parameters
    ----------
    kept : TrackFile
        What the table holds.
    warm_up : float
        Seconds before its end that are tracked again.
    first : int
        The frame with which the table began.

    Attributes
    ----------
    start : int
        The frame from which the source has to be read.
    last : int
        The last frame of the table.
    """

    def __init__(self, kept: TrackFile, *, warm_up: float, first: int = 0) -> None:
        self._first = first
        self.last = kept.frames[-1].index if kept.frames else first - 1
        recent = [f.index for f in kept.frames if f.time >= kept.frames[-1].time - warm_up]
        self.start = recent[0] if recent else first
        whole = not kept.frames or self.start <= kept.frames[0].index
        self._rows = [row for row in kept.frames[-1].rows if row.state != "lost"] if kept.frames else []
        self._next = max((row.track or 0 for frame in kept.frames for row in frame.rows), default=0) + 1
        self._number: dict[int, int] | None = None if whole else {}

    def warm_up(self, index: int, estimates: Iterable[Estimate]) -> None:
        """Take the estimates of a frame that the table has already."""
        if index == self.last and self._number is not None:
            self._number.update(_pairs(self._rows, list(estimates)))

    def numbered(self, estimates: Sequence[Estimate]) -> tuple[Estimate, ...]:
        """Return estimates under the numbers of the table."""
        if self._number is None:
            return tuple(estimates)
        for e in estimates:
            if e.track not in self._number:
                self._number[e.track] = self._next
                self._next += 1
        return tuple(replace(e, track=self._number[e.track]) for e in estimates)


def _pairs(rows: Sequence[TrackRow], estimates: Sequence[Estimate]) -> dict[int, int]:
    """Numbers of estimates to those of the rows where they stand."""
    if not rows or not estimates:
        return {}
    cost = np.full((len(estimates), len(rows)), _NEVER)
    for i, e in enumerate(estimates):
        for j, row in enumerate(rows):
            same = e.kind == row.kind and (e.name == row.name or e.name is None or row.name is None)
            if not same or None in (row.x, row.y, row.xx, row.yy):
                continue
            away = e.position - np.array([row.x, row.y], dtype=np.float64)
            P = e.covariance[:2, :2] + np.array([[row.xx, row.xy or 0.0], [row.xy or 0.0, row.yy]], dtype=np.float64)
            squared = float(away @ np.linalg.solve(P, away))
            cost[i, j] = squared if squared <= _SAME else _NEVER
    chosen = zip(*linear_sum_assignment(cost), strict=True)
    return {estimates[i].track: int(rows[j].track or 0) for i, j in chosen if cost[i, j] < _NEVER}
