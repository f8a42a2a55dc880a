"""Messages of the perception about what it was given: what was expected, what came, and what to do."""

from __future__ import annotations

import re

import numpy as np
import pytest

from pieper.errors import ArrayError, PieperError, VisionError

pytest.importorskip("cv2", reason="OpenCV is not installed")

from pieper.perception import color_page, field, hand_eye
from pieper.perception.adapt import LightAdaptation
from pieper.perception.board import Board
from pieper.perception.board_views import find_views
from pieper.perception.camera import Camera
from pieper.perception.color import ColorModel
from pieper.perception.color_regions import read_regions
from pieper.perception.metrics import Moment
from pieper.perception.pattern import Pattern, Patterns

COLORS = """format: pieper colors 1
colors:
  red: {mean: [0, 0, 0], covariance: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}
"""
MODEL = ColorModel(("red",), np.zeros((1, 3)), np.eye(3)[None])
SKEWED = [[400.0, 3.0, 160.0], [0.0, 400.0, 120.0], [0.0, 0.0, 1.0]]
CORNERS = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def written(path, text):
    path.write_text(text)
    return path


CASES = {
    "a time": (lambda _: LightAdaptation(MODEL, seconds=0.0), "seconds must be a time above 0 s, got 0"),
    "a bound": (lambda _: LightAdaptation(MODEL, most_light=0.5), "most_light must be at least 1, got 0.5"),
    "no images": (lambda _: find_views([], Board.parse("chessboard:9x6:0.025")), "give images, folders of images, or a video"),
    "a small board": (lambda _: Board.parse("chessboard:2x2:0.02"), "take 3 x 2 or more, or a ChArUco board"),
    "a skewed lens": (lambda _: Camera(SKEWED, [], (320, 240)), "got [[400.0, 3.0, 160.0], [0.0, 400.0, 120.0], [0.0, 0.0, 1.0]]"),
    "a distance": (lambda _: Moment([0], [0], [[-1.0]]), "distances must be 0 or more (infinity: never together), got -1.0"),
    "no size": (lambda _: field.from_points(CORNERS * [100, -100] + 200, CORNERS), "give image_size, its width and height in pixels"),
    "a bare robot": (lambda _: Patterns((Pattern("r", ()),)), "robot 'r' has no markers; give it one at least, or leave it out"),
    "words for poses": (lambda _: hand_eye.calibrate_hand_eye("here", "there"), "must be numbers of shape (n, 4, 4), got here"),
    "a mixture": (
        lambda path: ColorModel.load(
            written(path / "c.yaml", COLORS + "background: {weights: [0.9, 0.9], means: [], covariances: []}\n")
        ),
        "must be positive, with a sum of 1, got [0.9, 0.9], which sum to 1.8",
    ),
    "a flat colour": (
        lambda path: ColorModel.load(written(path / "c.yaml", COLORS.replace("[0, 0, 1]]", "[0, 0, 0]]"))),
        "got [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]]; learn the colours again",
    ),
    "half a pixel": (
        lambda path: read_regions(written(path / "r.yaml", "colors: {red: [[0, 1, 2, 3, 4], [0, 1.5, 2, 3, 4]]}\n")),
        "must be lists of whole numbers: frame, x, y, w, h; got [0.0, 1.5, 2.0, 3.0, 4.0]",
    ),
    "boxes": (lambda _: color_page._regions({"regions": 7}), "must be a list of at most 1000 boxes, got int"),
    "a box": (lambda _: color_page._regions({"regions": [{"x": 1}]}), "width and height, got {'x': 1}"),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_a_message_says_what_came_and_what_to_do(name, tmp_path):
    act, words = CASES[name]
    with pytest.raises(PieperError, match=re.escape(words)) as caught:
        act(tmp_path)
    assert isinstance(caught.value, (VisionError, ArrayError))
