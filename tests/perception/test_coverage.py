"""Covered shares of pixels against areas that are known otherwise."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pieper.perception.coverage import coverage
from pieper.perception.scene import circle

SAME = 1e-5  # float32 shares, some hundred of them added
SIZE = (40, 30)


def whole(polygon, size=SIZE):
    image = np.zeros((size[1], size[0]))
    left, top, share = coverage([polygon], size)[0]
    image[top : top + share.shape[0], left : left + share.shape[1]] = share
    return image


def test_every_pixel_against_the_polygon_clipped_to_it():
    """Sutherland and Hodgman's clipping, pixel by pixel."""
    random = np.random.default_rng(1)
    for _ in range(12):
        angle = np.sort(random.uniform(0, 2 * np.pi, 7))
        polygon = np.stack([20 + 30 * np.cos(angle), 15 + 22 * np.sin(angle)], axis=-1)  # partly outside
        image = whole(polygon)
        for row in range(SIZE[1]):
            for column in range(SIZE[0]):
                assert image[row, column] == pytest.approx(clipped(polygon, column, row), abs=SAME)


def clipped(polygon, column, row):
    corners = [tuple(p) for p in polygon]
    for axis, limit, sign in ((0, column - 0.5, 1), (0, column + 0.5, -1), (1, row - 0.5, 1), (1, row + 0.5, -1)):
        kept = []
        for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
            da, db = sign * (a[axis] - limit), sign * (b[axis] - limit)
            if da >= 0:
                kept.append(a)
            if da * db < 0:
                t = da / (da - db)
                kept.append((a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])))
        corners = kept
    if not corners:
        return 0.0
    x, y = np.array(corners).T
    return abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2


@given(st.floats(12, 26), st.floats(12, 16), st.floats(2, 11))
def test_a_disc_keeps_its_area_and_its_centre(x, y, radius):
    image = whole(circle(radius, 64) + np.array([x, y]))
    assert image.sum() == pytest.approx(np.pi * radius**2, rel=SAME)
    rows, columns = np.mgrid[: SIZE[1], : SIZE[0]]
    centre = np.array([(image * columns).sum(), (image * rows).sum()]) / image.sum()
    # What whole pixels leave of the centre of a sharp edge; it falls with the radius to the power 3/2.
    assert centre == pytest.approx([x, y], abs=0.05 / radius**1.5)


@given(st.floats(-20, 60), st.floats(-20, 50), st.floats(0.1, 15))
def test_what_is_cut_off_is_what_lies_outside(x, y, radius):
    disc = circle(radius) + np.array([x, y])
    wide = whole(disc + 40, (140, 130))
    assert whole(disc) == pytest.approx(wide[40:70, 40:80], abs=SAME)


def test_many_at_once_are_as_each_alone():
    random = np.random.default_rng(2)
    polygons = [circle(random.uniform(1, 9), 20) + random.uniform(-5, 40, 2) for _ in range(20)]
    polygons.append(np.array([[1.0, np.nan], [2, 3], [4, 1]]))
    for polygon, (left, top, share) in zip(polygons, coverage(polygons, SIZE), strict=True):
        alone = coverage([polygon], SIZE)[0]
        assert (left, top) == alone[:2]
        assert share == pytest.approx(alone[2], abs=1e-6)  # float64 sums that begin elsewhere
    assert coverage([], SIZE) == []


def test_the_way_round_does_not_matter():
    polygon = circle(7.3) + np.array([14.2, 12.9])
    assert whole(polygon[::-1]) == pytest.approx(whole(polygon), abs=SAME)
