"""Trajectories against SciPy's interpolation, and laws of their derivatives."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import BPoly, CubicHermiteSpline

from pieper.errors import ArrayError, UnknownNameError
from pieper.motion.trajectory import Trajectory, one_after_another
from tests.motion.random_trajectories import KINDS, kinds, random_trajectory, seeds

# Numbers of order 1 over segments of at least 0.1 s: dividing by the length twice makes accelerations of order 1e3.
ROUNDING_Q, ROUNDING_DQ, ROUNDING_DDQ = 1e-13, 1e-11, 1e-9
DIFFERENCE = 1e-5  # [s]; step of the finite differences, whose error is step^2 times the third derivative, at most 1e5


def times(trajectory: Trajectory, count: int = 57) -> np.ndarray:
    return np.linspace(trajectory.t[0], trajectory.t[-1], count)


@given(seeds)
def test_cubic_is_scipys(seed):
    ours = random_trajectory(seed, "cubic")
    theirs = CubicHermiteSpline(ours.t, ours.q, ours.dq)
    q, dq, ddq = ours.sample(times(ours)[:-1])
    np.testing.assert_allclose(q, theirs(times(ours)[:-1]), rtol=0, atol=ROUNDING_Q)
    np.testing.assert_allclose(dq, theirs(times(ours)[:-1], 1), rtol=0, atol=ROUNDING_DQ)
    np.testing.assert_allclose(ddq, theirs(times(ours)[:-1], 2), rtol=0, atol=ROUNDING_DDQ)


@given(seeds)
def test_quintic_is_scipys(seed):
    ours = random_trajectory(seed, "quintic")
    theirs = BPoly.from_derivatives(ours.t, np.stack([ours.q, ours.dq, ours.ddq], axis=1))
    q, dq, ddq = ours.sample(times(ours)[:-1])
    np.testing.assert_allclose(q, theirs(times(ours)[:-1]), rtol=0, atol=1e-12)  # Bernstein coefficients round more
    np.testing.assert_allclose(dq, theirs.derivative(1)(times(ours)[:-1]), rtol=0, atol=ROUNDING_DQ)
    np.testing.assert_allclose(ddq, theirs.derivative(2)(times(ours)[:-1]), rtol=0, atol=ROUNDING_DDQ)


@given(seeds)
def test_linear_is_numpys(seed):
    ours = random_trajectory(seed, "linear")
    for joint in range(ours.dof):
        theirs = np.interp(times(ours), ours.t, ours.q[:, joint])
        np.testing.assert_allclose(ours.sample(times(ours)).q[:, joint], theirs, rtol=0, atol=ROUNDING_Q)


@given(seeds, kinds)
def test_points_are_met_exactly(seed, kind):
    ours = random_trajectory(seed, kind)
    q, dq, ddq = ours.sample(ours.t)
    np.testing.assert_array_equal(q, ours.q)
    if ours.dq is not None:
        np.testing.assert_allclose(dq, ours.dq, rtol=0, atol=1e-15)
    if ours.ddq is not None:
        np.testing.assert_allclose(ddq, ours.ddq, rtol=0, atol=1e-14)


@given(seeds, kinds, st.floats(0.0, 1.0))
def test_derivatives_are_finite_differences(seed, kind, share):
    ours = random_trajectory(seed, kind)
    k = int(share * (len(ours.t) - 1.0001))
    t = ours.t[k] + 2 * DIFFERENCE + share * (ours.t[k + 1] - ours.t[k] - 4 * DIFFERENCE)  # within a segment
    before, after, here = ours.sample(t - DIFFERENCE), ours.sample(t + DIFFERENCE), ours.sample(t)
    np.testing.assert_allclose((after.q - before.q) / (2 * DIFFERENCE), here.dq, rtol=0, atol=1e-5)
    np.testing.assert_allclose((after.dq - before.dq) / (2 * DIFFERENCE), here.ddq, rtol=0, atol=1e-2)


@given(seeds, kinds)
def test_before_and_after_the_joints_rest(seed, kind):
    ours = random_trajectory(seed, kind)
    q, dq, ddq = ours.sample([ours.t[0] - 1.0, ours.t[-1] + 1.0])
    np.testing.assert_array_equal(q, ours.q[[0, -1]])
    assert not dq.any()
    assert not ddq.any()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("shape", [(), (1,), (3, 1, 2)])
def test_any_leading_axes(kind, shape):
    ours = random_trajectory(3, kind)
    t = np.random.default_rng(4).uniform(ours.t[0] - 0.1, ours.t[-1] + 0.1, shape)
    together = ours.sample(t)
    for values in together:
        assert values.shape == (*shape, 2)
    for i in np.ndindex(shape):
        for values, alone in zip(together, ours.sample(t[i]), strict=True):
            np.testing.assert_array_equal(values[i], alone)


def test_one_point_is_a_rest():
    point = Trajectory([2.0], [[0.1, 0.2]])
    assert point.duration == 0.0
    np.testing.assert_array_equal(point.sample([1.0, 2.0, 3.0]).q, [[0.1, 0.2]] * 3)
    assert not point.sample([1.0, 2.0, 3.0]).dq.any()


def test_no_times_no_samples():
    assert random_trajectory(1, "cubic").sample(np.empty((0, 2))).q.shape == (0, 2, 2)


def test_arrays_are_copies_and_read_only():
    q = np.zeros((2, 1))
    ours = Trajectory([0.0, 1.0], q)
    q[:] = 5.0
    assert not ours.q.any()
    for values in (ours.t, ours.q, pickle.loads(pickle.dumps(ours)).q):
        with pytest.raises(ValueError, match="read-only"):
            values[0] = 1.0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"t": []}, r"t must have shape \(m,\) with at least one time, got \(0,\)"),
        ({"t": [[0.0, 1.0]]}, r"t must have shape \(m,\) with at least one time, got \(1, 2\)"),
        ({"t": [0.0, np.nan]}, r"t must be finite, got nan at index \(1,\)"),
        ({"t": [0.0, 0.0]}, r"t must be strictly increasing \[s\], got t\[0\] = 0.0 and t\[1\] = 0.0; sort the points"),
        ({"t": [1.0, 0.0]}, "strictly increasing"),
        ({"t": "now"}, "t must be an array of real numbers"),
        ({"q": [[0.0, 0.0]]}, r"q must have shape \(m, n\) with m = 2 rows, one for each time, got \(1, 2\)"),
        ({"q": [0.0, 0.0]}, r"q must have shape \(m, n\).* got \(2,\)"),
        ({"q": [[0.0, np.inf], [0.0, 0.0]]}, r"q must be finite, got inf at index \(0, 1\)"),
        ({"dq": [[0.0], [0.0]]}, r"dq must have the shape of q, \(2, 2\), got \(2, 1\); leave it out if unknown"),
        ({"dq": [[0.0, 0.0], [0.0, np.nan]]}, r"dq must be finite, got nan at index \(1, 1\)"),
        ({"ddq": np.zeros((2, 2))}, "ddq needs dq: .*; give both or neither"),
        ({"joint_names": ("a",)}, "joint_names must be 2 different names, one for each column of q, got 1: a"),
        ({"joint_names": ("a", "a")}, "joint_names must be 2 different names"),
        ({"t": [0.0, 1e-200]}, "points 0 and 1 must be joined by finite velocities and accelerations; .* too short"),
        ({"q": [[-1e308, 0.0], [1e308, 0.0]]}, "points 0 and 1 must be joined by finite"),
    ],
)
def test_what_is_malformed_is_refused(arguments, message):
    good = {"t": [0.0, 1.0], "q": [[0.0, 0.0], [1.0, 1.0]]}
    with pytest.raises(ArrayError, match=message):
        Trajectory(**{**good, **arguments})


def test_a_time_that_is_not_finite_is_refused():
    with pytest.raises(ArrayError, match="t must be finite, got nan"):
        random_trajectory(1, "cubic").sample(np.nan)


def test_another_order_of_joints_is_the_same_motion():
    ours = random_trajectory(5, "quintic", joints=3)
    named = Trajectory(ours.t, ours.q, ours.dq, ours.ddq, ("a", "b", "c"))
    turned = named.in_order(["c", "a", "b"])
    assert turned.joint_names == ("c", "a", "b")
    for values, before in zip(turned.sample(times(ours)), named.sample(times(ours)), strict=True):
        np.testing.assert_array_equal(values, before[:, [2, 0, 1]])
    assert ours.in_order("xyz").joint_names == ("x", "y", "z")


@pytest.mark.parametrize(
    ("names", "error", "message"),
    [
        (("elbow", "wrist"), UnknownNameError, "no joint 'elbo'; did you mean 'elbow'"),
        (("elbo", "hand", "wrist"), ArrayError, "must move all joints of the arm; it lacks hand, wrist"),
    ],
)
def test_other_joints_are_refused(names, error, message):
    with pytest.raises(error, match=message):
        Trajectory([0.0], [[0.0]], joint_names=("elbo",)).in_order(names)


def test_a_number_of_columns_that_does_not_fit_is_refused():
    with pytest.raises(ArrayError, match="must have 2 columns, one for each of a, b, got 1"):
        Trajectory([0.0], [[0.0]]).in_order(["a", "b"])


def test_motions_one_after_another_rest_between():
    rest = np.zeros((2, 1))
    one = Trajectory([0.0, 1.0], [[0.0], [1.0]], rest, rest)
    two = Trajectory([0.0, 2.0], [[1.0], [-1.0]], rest, rest)
    both = one_after_another([one, two])
    assert both.duration == 3.0
    q, dq, _ = both.sample([0.5, 1.0, 2.0, 3.0])
    np.testing.assert_allclose(q[:, 0], [0.5, 1.0, 0.0, -1.0], atol=1e-12)
    assert dq[1] == 0.0


def test_motions_that_do_not_meet_are_refused():
    rest = np.zeros((2, 1))
    one = Trajectory([0.0, 1.0], [[0.0], [1.0]], rest, rest)
    with pytest.raises(ArrayError, match="motion 1 must begin where the one before ends"):
        one_after_another([one, one])
    with pytest.raises(ArrayError, match="motion 0 must give velocities and accelerations"):
        one_after_another([Trajectory([0.0, 1.0], [[0.0], [1.0]])])
    with pytest.raises(ArrayError, match="at least one motion, got none"):
        one_after_another([])
