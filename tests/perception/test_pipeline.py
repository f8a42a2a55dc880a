"""The whole way from rendered frames to estimates, and what the pipeline does with odd frames."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("cv2", reason="scenes are rendered with OpenCV")

from pieper.errors import PieperWarning, UnknownNameError, VisionError
from pieper.perception.color_table import ColorTable
from pieper.perception.field_view import PixelView
from pieper.perception.frame import Frame
from pieper.perception.pattern import Patterns
from pieper.perception.pipeline import MarkerTracker
from pieper.perception.scene_presets import preset
from pieper.perception.synthetic import Renderer
from tests.perception.paints import table_of


def tracked(name, frames, **options):
    """Steps and truths of a scene."""
    scene = preset(name).but(frames=frames)
    patterns = Patterns.of_scene(scene)
    tracker = MarkerTracker(table_of(patterns.colors), view=scene.view, patterns=patterns, **options)
    return [(tracker.step(frame), truth) for frame, truth in Renderer(scene)]


@pytest.mark.parametrize(
    ("name", "position", "heading"), [("clean", 0.5e-3, np.radians(0.5)), ("blur-light", 1.5e-3, np.radians(1.5))]
)
def test_ten_robots_within_the_pass_marks(name, position, heading):
    off, turned, found = [], [], 0
    steps = tracked(name, 40 if name == "clean" else 12)  # blur takes a second a frame to render
    for step, truth in steps:
        true = {thing.name: thing for thing in truth.objects}
        found += sum(s.name in true for s in step.sightings if s.kind == "robot")
        for e in step.estimates:
            if e.kind == "robot":
                off.append(e.position - true[e.name].position)
                turned.append(np.angle(np.exp(1j * (e.heading - true[e.name].heading))))
    assert found == 10 * len(steps)
    assert np.sqrt(np.mean(np.sum(np.square(off), axis=1))) <= position
    assert np.sqrt(np.mean(np.square(turned))) <= heading
    assert {len(step.estimates) for step, _ in steps[5:]} == {11}  # and the ball


def test_stages_are_timed_and_blobs_are_rows():
    (step, _), *_ = tracked("clean", 1)
    assert {"segment", "pattern", "track", "total"} == set(step.milliseconds)
    assert step.milliseconds["total"] == pytest.approx(sum(v for k, v in step.milliseconds.items() if k != "total"))
    for s in step.sightings:
        assert all(0 <= row < len(step.blobs) for row in s.blobs)


def test_without_patterns_or_calibration_every_marker_is_followed():
    scene = preset("report").but(frames=12)
    tracker = MarkerTracker(
        table_of(["red", "green", "blue"]), markers={"red": "largest", "blue": "largest", "green": "all"}
    )
    for frame, _ in Renderer(scene):
        step = tracker.step(frame)
    assert sorted(e.name for e in step.estimates) == ["blue", "green", "green", "red"]
    assert {e.kind for e in step.estimates} == {"marker"}
    truth = Renderer(scene).truth(11)
    for e in step.estimates:
        true = [m.image for m in truth.objects[0].markers if m.color == e.name]
        assert min(np.hypot(*(e.position - m)) for m in true) < 0.3  # px


def test_patterns_in_pixels_without_calibration():
    scene = preset("clean").but(frames=10)
    patterns = Patterns.of_scene(scene)
    tracker = MarkerTracker(table_of(patterns.colors), view=PixelView(), patterns=patterns)
    for frame, _ in Renderer(scene):
        step = tracker.step(frame)
    truth = Renderer(scene).truth(9)
    true = {thing.name: thing for thing in truth.objects}
    robots = [e for e in step.estimates if e.kind == "robot"]
    assert {e.name for e in robots} == {r.name for r in scene.robots}
    for e in robots:
        middle = scene.view.to_image(true[e.name].position, height=0.06)
        assert np.hypot(*(e.position - middle)) < 0.5  # px
        assert abs(np.angle(np.exp(1j * (e.heading + true[e.name].heading)))) < 0.03


def test_a_colour_that_was_not_learnt_is_named():
    scene = preset("clean")
    with pytest.raises(
        VisionError, match=r"the patterns have the colours blue, cyan.*which were not learnt; the colours are: red"
    ):
        MarkerTracker(table_of(["red"]), patterns=Patterns.of_scene(scene))
    with pytest.raises(UnknownNameError, match="no colour 'rde'"):
        MarkerTracker(table_of(["red"]), markers={"rde": "all"})
    with pytest.raises(VisionError, match="'all' or 'largest' is followed, got 'most'"):
        MarkerTracker(table_of(["red"]), markers={"red": "most"})


def test_frames_of_another_size_are_refused_with_a_calibration_and_start_anew_in_pixels():
    scene = preset("report").but(frames=8)
    frames = [frame for frame, _ in Renderer(scene)]
    small = Frame(np.ascontiguousarray(frames[0].image[:400, :500]), 8, frames[-1].time + 1 / 60)
    calibrated = MarkerTracker(table_of(["red", "green", "blue"]), view=scene.view, patterns="report")
    with pytest.raises(VisionError, match="calibrated at 640 x 480 pixels, and a frame has 500 x 400"):
        calibrated.step(small)
    free = MarkerTracker(table_of(["red", "green", "blue"]), patterns="report")
    for frame in frames:
        before = free.step(frame)
    assert len(before.estimates) == 1
    with pytest.warns(PieperWarning, match="frames are now 500 x 400 pixels"):
        after = free.step(small)
    assert [e.state for e in after.estimates] == ["lost"]


def test_an_empty_frame_is_no_error():
    tracker = MarkerTracker(table_of(["red", "green", "blue"]), patterns="report")
    step = tracker.step(Frame(np.zeros((48, 64, 3), np.uint8), 0, 0.0))
    assert (len(step.blobs), step.sightings, step.estimates) == (0, (), ())


@pytest.mark.parametrize("patterns", [None, "report"])
def test_a_frame_full_of_colour_is_cut_down_and_said_once(patterns):
    """A texture of two thousand patches, among them three large ones, which are kept."""
    labels = np.zeros((64, 64, 64), np.uint8)
    labels[:16, :16, 40:], labels[:16, 40:, :16], labels[40:, :16, :16] = 1, 2, 3
    image = np.zeros((352, 560, 3), np.uint8)
    for channel, (y, x) in enumerate([(0, 0), (0, 8), (8, 0)]):
        for dy in range(5):
            for dx in range(5):
                image[y + dy :: 16, x + dx :: 16, channel] = 255
    for channel, x in enumerate((100, 300, 500)):
        image[300:340, x - 10 : x + 50] = 0
        image[304:336, x : x + 40, channel] = 255
    tracker = MarkerTracker(ColorTable(("red", "green", "blue"), labels), patterns=patterns)
    with pytest.warns(PieperWarning, match=r"has \d+ patches of colour, and the 500 largest are looked at") as told:
        steps = [tracker.step(Frame(image, k, k / 30)) for k in range(3)]
    assert sum("largest" in str(warning.message) for warning in told) == 1
    assert len(steps[-1].blobs) == 500
    assert sorted(steps[-1].blobs.area.tolist())[-3:] == [32 * 40] * 3
