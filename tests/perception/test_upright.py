"""An upright cylinder from its outline, against outlines that are drawn from its true place."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pieper.errors import ArrayError
from pieper.perception.camera import Camera
from pieper.perception.upright import cylinder_outline, draw_upright, locate_upright
from pieper.sim.scene import SceneCamera

cv2 = pytest.importorskip("cv2", reason="OpenCV is not installed")

CAMERA = Camera([[600, 0, 320], [0, 605, 238], [0, 0, 1]], [-0.15, 0.03, 0.0, 0.0], (640, 480))
T = SceneCamera.looking("eye", [0.3, -1.4, 2.2], [0.4, 0.1, 0.2]).T_world_camera
SIZE = {"radius": 0.05, "length": 0.2}
HEIGHT = 0.15
PIXEL = 2.5 / 600  # [m] on the plane, about
FOUND = 0.5 * PIXEL  # [m] whole pixels, none of them cut, over a hundred of the rim; 0.35 was the worst of 300


def mask_of(*places, hide=None):
    """White where cylinders are, drawn four times as large and shrunk by majority."""
    large = np.zeros((4 * 480, 4 * 640), np.uint8)
    for p in places:
        outline = cylinder_outline(CAMERA, T, np.asarray(p), **SIZE)
        cv2.fillConvexPoly(large, np.round((outline + 0.5) * 4 * 16 - 8).astype(np.int32), 255, cv2.LINE_8, 4)
    mask = np.where(large.reshape(480, 4, 640, 4).mean(axis=(1, 3)) > 127, 255, 0).astype(np.uint8)
    if hide is not None:
        mask[hide] = 0
    return mask


def found(mask, **more):
    return locate_upright(mask, CAMERA, T, **SIZE, height=HEIGHT, **more)


@settings(max_examples=25, deadline=None)
@given(x=st.floats(0.0, 0.8), y=st.floats(-0.3, 0.5))
def test_the_place_is_found_to_a_fraction_of_a_pixel(x, y):
    p = np.array([x, y, HEIGHT + 0.1])
    seen = found(mask_of(p))
    assert seen is not None
    assert np.linalg.norm(seen.p_base - p) < FOUND
    assert seen.p_base[2] == pytest.approx(HEIGHT + 0.1)
    assert seen.agreement > 0.92


def test_the_middle_of_the_outline_is_not_the_middle_of_the_cylinder():
    """What is measured corrects this: a ray through the middle of the patch misses by far more than the errors above."""
    p = np.array([0.4, 0.3, HEIGHT + 0.1])
    v, u = np.nonzero(mask_of(p))
    middle = CAMERA.directions([u.mean(), v.mean()]) @ T[:3, :3].T
    naive = T[:3, 3] + (p[2] - T[2, 3]) / middle[2] * middle
    assert np.linalg.norm(naive - p) > 2 * FOUND


def test_glare_within_does_not_matter_and_specks_are_passed_over():
    p = np.array([0.4, 0.1, HEIGHT + 0.1])
    mask = mask_of(p)
    v, u = (int(np.median(part)) for part in np.nonzero(mask))
    mask[v - 3 : v + 3, u - 2 : u + 2] = 0
    mask[20:26, 30:36] = 255
    seen = found(mask)
    assert seen is not None
    assert np.linalg.norm(seen.p_base - p) < FOUND


def test_what_is_half_hidden_lying_or_something_else_is_not_seen():
    p = np.array([0.4, 0.1, HEIGHT + 0.1])
    v, u = np.nonzero(mask_of(p))
    assert found(mask_of(p, hide=np.s_[: int(np.median(v)), :])) is None
    assert found(mask_of(p, hide=np.s_[:, : int(np.median(u))])) is None
    assert found(np.zeros((480, 640), np.uint8)) is None
    board = np.zeros((480, 640), np.uint8)
    board[200:230, 150:450] = 255
    assert found(board) is None
    assert found(mask_of(p, hide=np.s_[: int(np.median(v)), :]), least_agreement=0.1) is not None


def test_of_two_patches_the_one_that_fits_is_taken():
    p = np.array([0.2, 0.3, HEIGHT + 0.1])
    mask = mask_of(p)
    mask[350:470, 400:600] = 255
    seen = found(mask)
    assert seen is not None
    assert np.linalg.norm(seen.p_base - p) < FOUND


def test_a_camera_that_looks_away_sees_nothing():
    up = T.copy()
    up[:3, 1:3] *= -1
    assert locate_upright(mask_of([0.4, 0.1, HEIGHT + 0.1]), CAMERA, up, **SIZE, height=HEIGHT) is None


def test_bad_input():
    mask = np.zeros((480, 640), np.uint8)
    with pytest.raises(ArrayError, match=r"mask must have shape \(480, 640\), as the camera's images, got \(10, 10\)"):
        found(mask[:10, :10])
    with pytest.raises(ArrayError, match=r"radius and length must be above 0 m, got 0\.0 and 0\.2"):
        locate_upright(mask, CAMERA, T, radius=0.0, length=0.2, height=0.0)


def test_what_was_seen_is_drawn():
    p = np.array([0.4, 0.1, HEIGHT + 0.1])
    mask = mask_of(p)
    seen = found(mask)
    image = np.full((480, 640, 3), 90, np.uint8)
    draw_upright(image, seen, (0, 0, 255))
    changed = (image != 90).any(axis=-1)
    v, u = np.nonzero(mask)
    assert changed[v.min() - 10 : v.max() + 11, u.min() - 10 : u.max() + 11].sum() == changed.sum() > 100
