"""Tracks against the truth: what is counted, and what is not."""

import numpy as np
import pytest

from pieper.errors import VisionError
from pieper.perception import pass_marks, scene_presets, synthetic_board
from pieper.perception.estimate import Estimate
from pieper.perception.evaluate import evaluate, tracked
from pieper.perception.synthetic import Renderer
from pieper.perception.truth import TrueMarker, TrueObject, Truth

FRAMES = 20


def thing(name, x, y, *, kind="robot", heading=0.3, visible=1.0):
    marker = TrueMarker("red", np.array([100 * x, 100 * y]), visible)
    robot = kind == "robot"
    return TrueObject(
        name,
        kind,
        np.array([x, y]),
        heading if robot else None,
        np.zeros(2),
        0.0 if robot else None,
        visible,
        (marker,),
    )


def estimate(track, name, x, y, *, kind="robot", heading=0.3, state="seen", sigma=1e-3):
    n = 6 if heading is not None else 4
    return Estimate(
        track, kind, name, 0.0, np.array([x, y]), heading, np.zeros(2), None if heading is None else 0.0, np.eye(n) * sigma**2,
        state, 0.0, 1.0,
    )  # fmt: skip


def measure(things, estimates, **options):
    """Both functions of the number of the frame."""
    truths = [Truth(k, k / 30, tuple(things(k))) for k in range(FRAMES)]
    unit = options.pop("unit", "m")
    return evaluate(truths, tracked([(k, k / 30, estimates(k)) for k in range(FRAMES)], unit=unit), **options)


def two(_):
    return [thing("a", 0.0, 0.0), thing("b", 1.0, 0.0)]


def test_the_truth_itself_is_perfect():
    result = measure(two, lambda _: [estimate(1, "a", 0, 0), estimate(2, "b", 1, 0)])
    assert result.position.largest == result.heading.largest == result.velocity.largest == 0
    assert result.clear.mota == result.identity.idf1 == result.hota.hota == result.named == 1
    assert (result.position.count, result.hidden.count) == (2 * FRAMES, 0)


def test_errors_are_those_that_were_put_in():
    result = measure(
        two, lambda _: [estimate(1, "a", 0.003, 0.004, heading=0.3 + 0.01 + 2 * np.pi), estimate(2, "b", 1, 0)]
    )
    assert result.position.rms == pytest.approx(0.005 / np.sqrt(2))
    assert result.position.largest == pytest.approx(0.005)
    assert result.heading.largest == pytest.approx(0.01)
    assert result.nees.mean == pytest.approx(25 / 2 / 2)


def test_swapped_names_and_swapped_tracks_are_told_apart():
    renamed = measure(two, lambda k: [estimate(1, "ab"[k >= 10], 0, 0), estimate(2, "ba"[k >= 10], 1, 0)])
    assert (renamed.named, renamed.clear.switches, renamed.identity.idf1) == (0.5, 0, 1)
    switched = measure(two, lambda k: [estimate(1 + (k >= 10), "a", 0, 0), estimate(2 - (k >= 10), "b", 1, 0)])
    assert (switched.named, switched.clear.switches, switched.identity.idf1) == (1, 2, 0.5)


def test_a_thing_that_is_hidden_need_not_be_found_and_its_prediction_is_not_false():
    def things(k):
        return [thing("a", 0.01 * k, 0, visible=0.0 if k >= 10 else 1.0)]

    found = measure(things, lambda k: [estimate(1, "a", 0.01 * k + 0.002, 0, state="hidden" if k >= 10 else "seen")])
    assert (found.clear.found, found.clear.false, found.clear.missed) == (10, 0, 0)
    assert (found.position.count, found.hidden.count) == (10, 10)
    assert found.hidden.rms == pytest.approx(0.002)
    given_up = measure(things, lambda k: [estimate(1, "a", 0.01 * k, 0)] if k < 10 else [])
    assert given_up.clear.missed == 0


def test_a_prediction_of_a_hidden_thing_that_is_far_off_is_still_told():
    def things(_):
        return [thing("a", 0, 0, visible=0.0)]

    result = measure(things, lambda _: [estimate(1, "a", 0.5, 0, state="hidden")])
    assert result.hidden.largest == pytest.approx(0.5)
    assert result.clear.false == FRAMES


def test_lost_tracks_do_not_count_and_frames_that_are_not_there_are_missed():
    result = measure(two, lambda _: [estimate(1, "a", 0, 0), estimate(2, "b", 1, 0, state="lost")])
    assert (result.clear.found, result.clear.false, result.clear.missed) == (FRAMES, 0, FRAMES)
    truths = [Truth(k, k / 30, tuple(two(k))) for k in range(10)]
    half = evaluate(
        truths, tracked([(k, k / 30, [estimate(1, "a", 0, 0), estimate(2, "b", 1, 0)]) for k in range(0, 10, 2)])
    )
    assert half.frames_without == 5
    assert half.clear.recall == 0.5


def test_a_ball_is_no_robot():
    def things(_):
        return [thing("ball", 0, 0, kind="ball")]

    assert measure(things, lambda _: [estimate(1, "a", 0, 0)]).clear.found == 0
    assert measure(things, lambda _: [estimate(1, "ball", 0, 0, kind="ball", heading=None)]).clear.found == FRAMES


def test_in_pixels_markers_are_compared_by_their_colour():
    def said(name):
        return lambda _: [
            estimate(1, name, 3.0, 4.0, kind="marker", heading=None),
            estimate(2, name, 100, 0, kind="marker", heading=None),
        ]

    result = measure(two, said("red"), unit="px")
    assert result.position.largest == pytest.approx(5)
    assert result.clear.recall == 1
    assert measure(two, said("blue"), unit="px").clear.found == 0
    with pytest.raises(VisionError, match="in pixels, where only markers"):
        measure(two, lambda _: [estimate(1, "a", 0, 0)], unit="px")


def test_truth_of_other_frames_is_refused():
    with pytest.raises(VisionError, match="no frame is in both: 1 frames of truth, 1 of tracks"):
        evaluate([Truth(7, 0.0, ())], tracked([(3, 0.0, [])]))
    with pytest.raises(VisionError, match="reach must be positive"):
        measure(two, lambda _: [], reach=-1.0)


def test_everything_that_is_told_is_json():
    data = measure(two, lambda _: []).as_data()
    assert data["position"] == {"count": 0, "rms": None, "p95": None, "largest": None}
    assert data["clear"]["recall"] == 0
    assert data["identity"]["idf1"] == 0
    assert data["named"] is None


def test_A15_a_robots_position_has_a_number_on_a_film_in_which_it_is_hidden():
    """Seen: half a millimetre. Wholly hidden for half a second: 15 mm, and the same track before and after."""
    result = pass_marks.hidden_for_half_a_second(scene_presets.preset("occlusion"))
    assert result["seconds"] >= 0.5
    assert result["largest"] < 15e-3
    assert result["kept"]
    assert result["seen_rms"] < 0.5e-3
    assert result["seen_heading_rms"] < np.radians(0.5)


def test_false_and_missed_sightings_are_as_many_as_asked():
    scene = scene_presets.preset("crossing")
    random = np.random.default_rng(5)
    robots = [pass_marks.Sighting("robot", robot.name, np.zeros(2), 0.0, np.eye(3)) for robot in scene.robots]
    counts = [len(pass_marks.spoiled(robots, scene, random)) for _ in range(2000)]
    assert np.mean(counts) == pytest.approx(10 * (0.8 + 0.05), abs=0.15)  # 4 standard deviations of the mean


def test_colours_are_learnt_in_the_light_of_the_first_frame():
    scene = scene_presets.preset("light-ramp").but(frames=4)
    model = pass_marks.learned(scene)
    frame, truth = Renderer(scene)[0]
    table = model.table()
    labels = table.classify(frame.image)
    for marker in truth.objects[0].markers:
        u, v = np.rint(marker.image).astype(int)
        assert table.names[labels[v, u] - 1] == marker.color


def test_a_mark_is_reached_at_its_limit_and_not_by_what_is_unknown():
    assert pass_marks.Mark("it", "mm", 1.0, 1.0).reached
    assert pass_marks.Mark("it", "mm", 1.0, 1.0, at_least=True).reached
    assert not pass_marks.Mark("it", "mm", float("nan"), 1.0).reached
    assert not pass_marks.Mark("it", "share", 0.98, 0.99, at_least=True).reached
    assert pass_marks.Mark("it", "share", 0.98, 0.99, at_least=True).must == ">= 99.0%"
    assert pass_marks.as_data([pass_marks.Mark("it", "mm", 1.0, 2.0)])[0]["reached"]


def test_a_board_is_drawn_where_the_camera_sees_it():
    """The corners between its squares, found in the picture, against their projection."""
    import cv2

    from pieper.perception.board import Board

    board = Board.parse("chessboard:7x5:0.04")
    camera = scene_presets.preset("lens").view.camera
    eye = synthetic_board.BoardCamera(camera, board)
    until = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 50, 1e-4)
    for pose in synthetic_board.board_poses(board, 2):
        corners = np.column_stack([board.corners, np.zeros(len(board.corners))])
        pixels = camera.project(corners @ pose[:3, :3].T + pose[:3, 3])
        gray = np.ascontiguousarray(eye.picture(pose, noise=0.0)[..., 0])
        start = np.array(pixels[:, None], np.float32, order="C")
        away = cv2.cornerSubPix(gray, start, (4, 4), (-1, -1), until)[:, 0] - pixels
        assert np.sqrt(np.mean(away**2)) < 0.05  # what OpenCV's gradients make of edges of one pixel
