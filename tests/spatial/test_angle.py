"""Angles on the circle."""

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pieper.errors import ArrayError
from pieper.spatial import angle

ROUNDING = 1e-15  # three roundings of numbers no larger than 2 pi

ANGLES = st.floats(-1e8, 1e8)


@given(ANGLES)
def test_wrap_lies_in_the_interval_and_points_the_same_way(a: float) -> None:
    w = float(angle.wrap(a))
    assert -np.pi < w <= np.pi
    with mpmath.workdps(50):
        turns = (mpmath.mpf(a) - mpmath.mpf(w)) / (2 * mpmath.pi)
        assert abs(turns - mpmath.nint(turns)) < ROUNDING


@given(st.floats(-np.pi, np.pi, exclude_min=True))
def test_wrap_leaves_what_is_in_the_interval(a: float) -> None:
    assert float(angle.wrap(a)) == a


def test_wrap_at_the_ends() -> None:
    np.testing.assert_array_equal(angle.wrap([np.pi, -np.pi, 0.0]), [np.pi, np.pi, 0.0])


@given(ANGLES, ANGLES)
def test_difference_is_the_shortest_turn(a: float, b: float) -> None:
    d = float(angle.difference(a, b))
    assert -np.pi < d <= np.pi
    assert abs(np.exp(1j * (float(angle.wrap(b)) + d)) - np.exp(1j * float(angle.wrap(a)))) < 4 * ROUNDING


@given(st.floats(-100, 100), st.floats(-100, 100))
def test_nearest_is_a_copy_within_pi(a: float, to: float) -> None:
    n = float(angle.nearest(a, to))
    assert abs(n - to) <= np.pi + 1e-13
    assert abs((n - a) / (2 * np.pi) - round((n - a) / (2 * np.pi))) < 1e-14


@pytest.mark.parametrize("batch", [(), (1,), (3, 1, 2), (0,)], ids=str)
def test_batch_shapes(batch: tuple[int, ...]) -> None:
    a = np.full(batch, 4.0)
    assert angle.wrap(a).shape == batch
    assert angle.difference(a, 1.0).shape == batch
    assert angle.nearest(1.0, a).shape == batch


def test_refuses_what_is_no_angle() -> None:
    with pytest.raises(ArrayError, match=r"angle must be finite, got nan at index \(1,\)"):
        angle.wrap([0.0, np.nan])
    with pytest.raises(ArrayError, match="angle must be finite, got inf"):
        angle.wrap(np.inf)
    with pytest.raises(ArrayError, match="to must be an array of real numbers"):
        angle.nearest(0.0, "north")


@pytest.mark.parametrize("function", [angle.difference, angle.nearest])
def test_shapes_that_do_not_broadcast_are_refused(function) -> None:
    with pytest.raises(ArrayError, match=r"must broadcast, got shapes \(2,\) and \(3,\)"):
        function([1.0, 2.0], [1.0, 2.0, 3.0])
