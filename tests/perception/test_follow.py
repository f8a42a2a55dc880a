"""A source through a tracker: everybody gets every step, and a resumed table keeps its numbers."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from pieper.perception.estimate import Estimate
from pieper.perception.follow import Resumed, follow
from pieper.perception.output import TrackedFrame, TrackFile, TrackRow, create_tracks, read_tracks
from pieper.perception.source import open_source
from pieper.perception.stream import Stream


def estimate(track, x, y, *, name=None, kind="robot", time=0.0) -> Estimate:
    return Estimate(
        track, kind, name, time, np.array([x, y], float), 0.0, np.zeros(2), 0.0, np.eye(6), "seen", 0.0, 1.0
    )


def table(*rows, frames=10) -> TrackFile:
    """Ten frames at ten per second; the last has these rows."""
    made = [TrackedFrame(n, n / 10, ()) for n in range(frames - 1)]
    last = [
        TrackRow(frames - 1, (frames - 1) / 10, track, "robot", name, "seen", x, y, xx=1.0, xy=0.0, yy=1.0)
        for track, name, x, y in rows
    ]
    return TrackFile("px", "", (*made, TrackedFrame(frames - 1, (frames - 1) / 10, tuple(last))))


class FakeTracker:
    """Believes in one thing, at the number of the frame."""

    def step(self, frame):
        found = (estimate(1, float(frame.index), 0.0, time=frame.time),)
        return SimpleNamespace(
            index=frame.index, time=frame.time, blobs=(), sightings=(), estimates=found, milliseconds={"total": 2.0}
        )


def images(count):
    return [np.zeros((4, 4, 3), np.uint8)] * count


def test_every_step_reaches_the_table_the_stream_and_the_caller(tmp_path):
    stream, heard, called = Stream(), [], []
    stream.subscribe(heard.append)
    writer = create_tracks(tmp_path / "t.csv", unit="px")
    with open_source(images(5), fps=10) as source:
        summary = follow(
            source,
            FakeTracker(),
            tracks=writer,
            stream=stream,
            on_step=lambda frame, step: called.append((frame, step)),
        )
    writer.close()
    assert [step.index for step in heard] == [0, 1, 2, 3, 4]
    assert [(frame.index, step.index) for frame, step in called] == [(n, n) for n in range(5)]
    assert [f.rows[0].x for f in read_tracks(tmp_path / "t.csv").frames] == [0, 1, 2, 3, 4]
    assert (summary.frames, summary.dropped, summary.tracks, summary.milliseconds["total"]) == (5, 0, {1}, 2.0)
    assert summary.fps == pytest.approx(5 / summary.seconds)


def test_a_run_that_is_stopped_has_finished_its_frame(tmp_path):
    with open_source(images(100), fps=10) as source:
        summary = follow(source, FakeTracker(), on_step=lambda frame, _: source.stop() if frame.index == 6 else None)
    assert summary.frames == 7


def test_tracks_go_on_under_the_number_that_stands_where_they_are():
    resumed = Resumed(table((3, "a", 10, 10), (7, "b", 50, 50), (5, None, 90, 90)), warm_up=0.35)
    assert (resumed.start, resumed.last) == (6, 9)
    now = [
        estimate(1, 50.2, 49.9, name="b"),  # 7
        estimate(2, 200, 200, name="c"),  # nobody's
        estimate(3, 89, 90, name="d"),  # 5, whose name was not known
        estimate(4, 10, 10, name="e"),  # where 3 was, but it is another one
    ]
    for index in range(6, 10):
        resumed.warm_up(index, now)
    numbers = [e.track for e in resumed.numbered(now)]
    assert numbers == [7, 8, 5, 9]  # new ones after the last that was given
    assert [e.track for e in resumed.numbered([now[1], estimate(9, 0, 0)])] == [8, 10]


def test_a_warm_up_on_everything_keeps_the_numbers_of_the_tracker():
    resumed = Resumed(table((3, "a", 10, 10)), warm_up=100.0)
    assert resumed.start == 0
    resumed.warm_up(9, [estimate(1, 10, 10, name="a")])
    assert [e.track for e in resumed.numbered([estimate(1, 10, 10, name="a")])] == [1]


def test_a_table_without_frames_is_begun_again():
    resumed = Resumed(TrackFile("px", "", ()), warm_up=1.0, first=20)
    assert (resumed.start, resumed.last) == (20, 19)
    assert [e.track for e in resumed.numbered([estimate(1, 0, 0)])] == [1]
