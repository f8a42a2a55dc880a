"""Cameras: pixels as OpenCV makes them, directions that give them back, and NaN where a polynomial says nothing of a lens."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pieper.errors import ArrayError
from pieper.perception.camera import Camera
from pieper.perception.field_view import FieldView
from tests.perception.board_scene import overhead

SAME_PIXEL = 1e-8  # px: two orders of rounding above 1000 * 1e-16, for polynomials near their fold
SAME_PLACE = 1e-9  # m: a pixel of 1e-8 at a glancing ray
SLOPE = 1e-4  # relative, of a central difference over 1e-3 px

coefficient = st.floats(-0.4, 0.4)
small = st.floats(-0.02, 0.02)


@st.composite
def cameras(draw):
    count = draw(st.sampled_from([0, 4, 5, 8, 12]))
    kinds = [coefficient, coefficient, small, small, *[coefficient] * 4, *[small] * 4][:count]
    d = [draw(kind) for kind in kinds]
    fx, fy = draw(st.floats(200, 2000)), draw(st.floats(200, 2000))
    return Camera([[fx, 0, draw(st.floats(200, 440))], [0, fy, draw(st.floats(150, 330))], [0, 0, 1]], d, (640, 480))


points = st.lists(st.tuples(st.floats(-2, 2), st.floats(-2, 2), st.floats(0.5, 3)), min_size=1, max_size=8)


@settings(max_examples=40)
@given(cameras(), points)
def test_pixels_are_those_of_opencv(camera, p):
    p = np.array(p)
    got = camera.project(p)
    expected, _ = cv2.projectPoints(p, np.zeros(3), np.zeros(3), camera.matrix, camera.distortion)
    known = np.hypot(*(p[:, :2] / p[:, 2:]).T) <= camera.reach
    assert (np.isfinite(got).all(axis=1) == known).all()
    scale = np.maximum(np.abs(expected.reshape(-1, 2)[known]), 1.0)
    assert (np.abs(got[known] - expected.reshape(-1, 2)[known]) <= 1e-11 * scale + SAME_PIXEL).all()


@settings(max_examples=40)
@given(cameras(), points)
def test_directions_give_the_point_back(camera, p):
    p = np.array(p)
    uv = camera.project(p)
    known = np.isfinite(uv).all(axis=1)
    # A hair within the fold, where the slope of the lens is almost none and a direction says little.
    known &= np.hypot(*(p[:, :2] / p[:, 2:]).T) <= 0.99 * camera.reach
    back = camera.directions(uv[known])
    assert np.isfinite(back).all()
    np.testing.assert_allclose(back, p[known] / p[known, 2:], rtol=1e-6, atol=1e-8)


@settings(max_examples=40)
@given(cameras(), st.lists(st.tuples(st.floats(-3000, 3000), st.floats(-3000, 3000)), min_size=1, max_size=8))
def test_a_direction_is_right_or_nan(camera, uv):
    uv = np.array(uv)
    rays = camera.directions(uv)
    known = np.isfinite(rays).all(axis=1)
    assert np.isnan(rays[~known]).all()
    radius = np.hypot(*rays[known, :2].T)
    assert (radius <= camera.reach * (1 + 1e-9)).all()
    if camera.distortion.any():
        bent = camera._distorted(rays[known, :2]) * camera._focal + camera.matrix[:2, 2]
        assert (np.abs(bent - uv[known]) <= 1e-7 * (1 + radius[:, None] ** 2)).all()


def test_the_fold_of_a_barrel_is_where_it_stops_growing():
    camera = Camera([[500, 0, 320], [0, 500, 240], [0, 0, 1]], [-0.3, 0, 0, 0], (640, 480))
    assert camera.reach == pytest.approx(np.sqrt(1 / 0.9), rel=1e-8)  # 1 + 3 k1 r^2 = 0
    edge = 500 * camera.reach * (1 - 0.3 * camera.reach**2)  # the farthest pixel that the lens makes
    assert np.isfinite(camera.directions([320 + edge - 0.01, 240])).all()
    assert np.isnan(camera.directions([320 + edge + 0.01, 240])).all()
    assert np.isnan(camera.project([1.1, 0.0, 1.0])).all()
    assert np.isfinite(camera.project([1.0, 0.0, 1.0])).all()


def test_where_opencv_undistorts_wrongly_we_say_nan():
    camera = Camera([[500, 0, 320], [0, 500, 240], [0, 0, 1]], [-0.3, 0, 0, 0], (640, 480))
    beyond = np.array([[320 + 400.0, 240.0]])
    x = cv2.undistortPoints(beyond.reshape(-1, 1, 2), camera.matrix, camera.distortion).reshape(2)
    assert np.isfinite(x).all()  # an answer, and it does not give the pixel back:
    there, _ = cv2.projectPoints(np.array([[*x, 1.0]]), np.zeros(3), np.zeros(3), camera.matrix, camera.distortion)
    assert np.abs(there.reshape(2) - beyond[0]).max() > 1
    assert np.isnan(camera.directions(beyond)).all()


def test_a_camera_without_distortion_reaches_everywhere():
    camera = Camera([[500, 0, 320], [0, 500, 240], [0, 0, 1]], [], (640, 480))
    assert camera.reach == np.inf
    np.testing.assert_array_equal(camera.directions([320 + 5000, 240]), [10, 0, 1])


@pytest.mark.parametrize("shape", [(), (1,), (3, 1, 2)])
def test_shapes(shape):
    camera = Camera([[500, 0, 320], [0, 500, 240], [0, 0, 1]], [-0.3, 0.1, 0, 0], (640, 480))
    uv = np.full((*shape, 2), 300.0)
    assert camera.directions(uv).shape == (*shape, 3)
    assert camera.project(camera.directions(uv)).shape == (*shape, 2)
    assert camera.jacobian(np.zeros((*shape, 2))).shape == (*shape, 2, 2)


def test_malformed_cameras_are_refused():
    K = [[500, 0, 320], [0, 500, 240], [0, 0, 1]]
    with pytest.raises(ArrayError, match="distortion must be 0, 4, 5, 8 or 12 finite numbers, got 3"):
        Camera(K, [1, 2, 3], (640, 480))
    with pytest.raises(ArrayError, match="focal lengths must be positive"):
        Camera([[0, 0, 320], [0, 500, 240], [0, 0, 1]], [], (640, 480))


LENSES = {
    "none": [],
    "barrel": [-0.28, 0.09, 0.0008, -0.0005, -0.01],
    "pincushion": [0.2, 0.05, 0.001, 0.001],
    "rational": [0.3, 0.1, 0.001, -0.001, 0.01, 0.35, 0.1, 0.02],
    "prism": [-0.1, 0.02, 0, 0, 0, 0, 0, 0, 0.003, -0.002, 0.001, 0.004],
}


@pytest.fixture(params=LENSES)
def view(request):
    camera = Camera([[620, 0, 323.7], [0, 625, 236.2], [0, 0, 1]], LENSES[request.param], (640, 480))
    return FieldView(camera, overhead(1.9, tilt=0.3, turn=-0.2, yaw=0.1))


places = st.tuples(st.floats(-0.7, 0.7), st.floats(-0.6, 0.6))


@pytest.mark.parametrize("lens", LENSES)
@settings(max_examples=20)
@given(place=places, height=st.floats(-0.1, 0.5), tilt=st.floats(-0.4, 0.4))
def test_a_place_at_any_height_is_found_again(lens, place, height, tilt):
    camera = Camera([[620, 0, 323.7], [0, 625, 236.2], [0, 0, 1]], LENSES[lens], (640, 480))
    view = FieldView(camera, overhead(1.9, tilt=tilt, turn=0.1))
    uv = view.to_image(place, height=height)
    np.testing.assert_allclose(view.to_field(uv, height=height), place, atol=SAME_PLACE)


@given(place=places, height=st.floats(0.01, 0.3))
def test_the_parallax_is_height_over_height(place, height):
    """A marker seen as if on the floor is displaced by h / (H - h) of its way from the point below the camera."""
    camera = Camera([[620, 0, 323.7], [0, 625, 236.2], [0, 0, 1]], LENSES["barrel"], (640, 480))
    view = FieldView(camera, overhead(2.0))
    on_floor = view.to_field(view.to_image(place, height=height))
    np.testing.assert_allclose(on_floor - place, np.multiply(place, height / (2.0 - height)), atol=SAME_PLACE)


def test_derivatives_are_those_of_differences(view):
    uv = np.stack(np.meshgrid(np.linspace(150, 500, 6), np.linspace(120, 380, 5)), axis=-1)
    h, step = 0.15, 1e-3
    columns = [
        (view.to_field(uv + e, height=h) - view.to_field(uv - e, height=h)) / (2 * step) for e in np.eye(2) * step
    ]
    expected = np.stack(columns, axis=-1)
    np.testing.assert_allclose(view.jacobian(uv, height=h), expected, atol=SLOPE * np.abs(expected).max())


def test_what_a_lens_does_not_see_is_nan_on_the_field():
    camera = Camera([[500, 0, 320], [0, 500, 240], [0, 0, 1]], [-0.3, 0, 0, 0], (640, 480))
    view = FieldView(camera, overhead(2.0))
    beyond = [[320.0, 240.0], [320 + 400.0, 240.0]]
    assert np.isnan(view.to_field(beyond)).tolist() == [[False, False], [True, True]]
    assert np.isnan(view.jacobian(beyond)[1]).all()
    assert np.isfinite(view.jacobian(beyond)[0]).all()
