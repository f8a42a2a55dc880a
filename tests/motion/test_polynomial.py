"""Extrema of polynomials against the roots that NumPy finds."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pieper.motion import polynomial

ROUNDING = 1e-12  # of values whose coefficients sum to at most 60
CLOSE = 1e-9  # an extremum beside another one is flat: both places have nearly its value

coefficients = st.integers(1, 6).flatmap(
    lambda size: arrays(np.float64, size, elements=st.integers(-20, 20).map(lambda half: half / 2))
)


@given(coefficients)
def test_extrema_are_found(c):
    values = polynomial.evaluate(c, polynomial.stationary(c))
    dense = np.polynomial.polynomial.polyval(np.linspace(0.0, 1.0, 501), c)
    assert values.min() <= dense.min() + ROUNDING
    assert values.max() >= dense.max() - ROUNDING
    derivative = np.trim_zeros(np.polynomial.polynomial.polyder(c), "b")
    roots = np.polynomial.polynomial.polyroots(derivative) if derivative.size else np.empty(0)
    inner = roots.real[(np.abs(roots.imag) < CLOSE) & (roots.real > 0.0) & (roots.real < 1.0)]
    for value in np.polynomial.polynomial.polyval(inner, c):
        assert values.min() - CLOSE <= value <= values.max() + CLOSE


@given(coefficients)
def test_bounds_hold(c):
    least, greatest = polynomial.bounds(c)
    values = polynomial.evaluate(c, np.linspace(0.0, 1.0, 101))
    assert least - ROUNDING <= values.min()
    assert values.max() <= greatest + ROUNDING


def test_a_stack_is_its_parts():
    c = np.random.default_rng(1).normal(size=(3, 2, 6))
    together = polynomial.stationary(c)
    assert together.shape == (3, 2, 6)
    for i in np.ndindex(3, 2):
        np.testing.assert_array_equal(together[i], polynomial.stationary(c[i]))
