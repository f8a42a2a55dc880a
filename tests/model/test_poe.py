"""Screws and home pose, in and out."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pieper.errors import ArrayError
from pieper.model.poe import as_screws, from_screws, prismatic, revolute, swap_order
from pieper.spatial.twist import exp
from tests.model.test_dh import SEEDS, STEPS, random_arm
from tests.reference.product_of_exponentials import fk
from tests.robots import NAMES, chain

EXACT = 1e-12  # [m, rad]: one change of frame of an arm of a few metres


@pytest.mark.parametrize("frame", ["space", "body"])
@pytest.mark.parametrize("angular_first", [False, True])
@pytest.mark.parametrize("name", NAMES)
def test_round_trip_of_every_robot(name, frame, angular_first):
    arm = chain(name)
    screws, home = as_screws(arm, frame=frame, angular_first=angular_first)
    back = from_screws(
        screws, home, frame=frame, angular_first=angular_first, name=arm.name, joint_names=arm.joint_names,
        limits=arm.limits, base=arm.base, tip=arm.tip,
    )  # fmt: skip
    np.testing.assert_allclose(back.screws, arm.screws, atol=EXACT)
    assert np.array_equal(back.home, arm.home)
    assert np.array_equal(back.limits, arm.limits)
    assert (back.name, back.joint_names, back.base, back.tip) == (arm.name, arm.joint_names, arm.base, arm.tip)


@settings(max_examples=100, deadline=None)
@given(st.lists(st.tuples(STEPS, st.booleans()), min_size=0, max_size=6), SEEDS)
def test_body_screws_give_the_same_poses(steps, seed):
    """M exp([B_1] q_1) ... exp([B_n] q_n), Modern Robotics eq. 4.16, sliding joints included."""
    arm = random_arm(steps, seed)
    screws, home = as_screws(arm, frame="body")
    q = np.random.default_rng(seed).uniform(-3, 3, arm.dof)
    T = home
    for screw, angle in zip(screws, q, strict=True):
        T = T @ exp(screw * angle)
    np.testing.assert_allclose(T, fk(arm, q), atol=1e-11)
    back = from_screws(screws, home, frame="body")
    np.testing.assert_allclose(back.screws, arm.screws, atol=1e-11)


@given(SEEDS)
def test_the_axis_of_a_revolute_screw_stays_where_it_is(seed):
    axis, point = np.random.default_rng(seed).normal(size=(2, 3))
    T = exp(revolute(axis, point) * 1.3)
    for along in (0.0, 0.7):
        p = np.append(point + along * axis, 1.0)
        np.testing.assert_allclose(T @ p, p, atol=1e-14)
    moved = exp(prismatic(axis) * 0.4)
    np.testing.assert_allclose(moved[:3, 3], 0.4 * axis / np.linalg.norm(axis), atol=1e-15)
    assert np.array_equal(moved[:3, :3], np.eye(3))


@pytest.mark.parametrize("shape", [(), (1,), (3, 1, 2)])
def test_any_leading_axes(shape):
    axis, point = np.random.default_rng(0).normal(size=(2, *shape, 3))
    screws = revolute(axis, point)
    assert screws.shape == (*shape, 6)
    assert prismatic(axis).shape == (*shape, 6)
    for index in np.ndindex(shape):
        assert np.array_equal(screws[index], revolute(axis[index], point[index]))
        assert np.array_equal(prismatic(axis)[index], prismatic(axis[index]))
    assert np.array_equal(swap_order(swap_order(screws)), screws)
    assert revolute([0, 0, 1], point).shape == (*shape, 6)
    assert revolute(axis, [0, 0, 0]).shape == (*shape, 6)


def test_modern_robotics_order():
    """The UR5 of Modern Robotics, example 4.5: S_2 = (0, 1, 0, -H1, 0, 0) with H1 = 89 mm."""
    screw = revolute([0, 1, 0], [0, 0, 0.089])
    assert swap_order(screw).tolist() == [0.0, 1.0, 0.0, -0.089, 0.0, 0.0]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: revolute([0, 0, 0], [0, 0, 0]), "axis must not be zero"),
        (lambda: prismatic([0, 0]), r"axis must have shape \(..., 3\), got \(2,\)"),
        (lambda: revolute([0, 0, 1], [0, np.nan, 0]), "point must be finite"),
        (lambda: revolute("z", [0, 0, 0]), "axis must be numbers, got 'z'"),
        (lambda: swap_order([1, 2, 3]), r"screws must have shape \(..., 6\), got \(3,\)"),
        (lambda: from_screws([[0, 0, 1, 0, 0]], np.eye(4)), r"screws must have shape \(n, 6\), got \(1, 5\)"),
        (lambda: from_screws([0, 0, 0, 0, 0, 1], np.eye(4)), r"screws must have shape \(n, 6\), got \(6,\)"),
        (lambda: from_screws([[0, 0, 0, 0, 0, 2]], np.eye(4)), r"screw 0 needs \|w\| = 1"),
        (lambda: from_screws([[0, 0, 1, 0, 0, 1]], np.eye(4)), "screw 0 has pitch 1 m/rad"),
        (lambda: from_screws([[0, 0, 0, 0, 0, 1]], np.eye(3)), r"home must have shape \(4, 4\), got \(3, 3\)"),
        (lambda: from_screws([[0, 0, 0, 0, 0, 1]], np.eye(3), frame="body"), r"home must have shape \(4, 4\)"),
        (
            lambda: from_screws([[0, 0, 0, 0, 0, 1]], np.eye(4), frame="tool"),
            "frame must be 'space' or 'body', got 'tool'",
        ),
        (lambda: as_screws(chain("ur5e"), frame="tool"), "frame must be 'space' or 'body', got 'tool'"),
    ],
)
def test_malformed_input(call, message):
    with pytest.raises(ArrayError, match=message):
        call()
