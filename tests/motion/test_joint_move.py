"""Minimum-jerk moves of every robot."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pieper.errors import ArrayError, MotionError
from pieper.model.chain import Chain
from pieper.motion.joint_move import joint_move
from pieper.motion.limits import JointLimits
from tests import robots

ROUNDING = 1e-12  # relative to limits and moves of order 1 to 10

chains = st.sampled_from(robots.NAMES).map(robots.chain)
seeds = st.integers(0, 10_000)


def random_joints(chain: Chain, rng: np.random.Generator, count: int) -> np.ndarray:
    lower, upper = np.clip(chain.limits, -6.0, 6.0).T
    return rng.uniform(lower, upper, (count, chain.dof))


@given(chains, seeds)
def test_limits_are_held_and_one_is_reached(chain, seed):
    rng = np.random.default_rng(seed)
    start, goal = random_joints(chain, rng, 2)
    speed, acceleration = rng.uniform(0.1, 5.0, 2)
    limits = JointLimits.of(chain, max_velocity=speed, max_acceleration=acceleration)
    move = joint_move(chain, start, goal, max_velocity=speed, max_acceleration=acceleration)
    shares = [0.5, (3 - np.sqrt(3)) / 6, (3 + np.sqrt(3)) / 6, *np.linspace(0.0, 1.0, 101)]
    q, dq, ddq = move.sample(move.duration * np.array(shares))
    assert (np.abs(dq) <= limits.velocity * (1 + ROUNDING)).all()
    assert (np.abs(ddq) <= limits.acceleration * (1 + ROUNDING)).all()
    use = max((np.abs(dq) / limits.velocity).max(), (np.abs(ddq) / limits.acceleration).max())
    assert use == pytest.approx(1.0, abs=ROUNDING)  # so no shorter duration holds them
    assert (q >= np.minimum(start, goal) - ROUNDING).all()
    assert (q <= np.maximum(start, goal) + ROUNDING).all()
    limits.check_trajectory(move)


@given(chains, seeds)
def test_it_starts_and_arrives_exactly_at_rest(chain, seed):
    start, goal = random_joints(chain, np.random.default_rng(seed), 2)
    move = joint_move(chain, start, goal)
    assert move.t[0] == 0.0
    assert move.joint_names == chain.joint_names
    q, dq, ddq = move.sample([0.0, move.duration])
    np.testing.assert_array_equal(q, [start, goal])
    assert not dq.any()
    assert not ddq.any()


@given(seeds)
def test_its_interpolation_is_the_minimum_jerk_polynomial(seed):
    chain = robots.chain("ur5e")
    start, goal = random_joints(chain, np.random.default_rng(seed), 2)
    move = joint_move(chain, start, goal)
    u = np.linspace(0.0, 1.0, 51)
    s = 10 * u**3 - 15 * u**4 + 6 * u**5  # Flash and Hogan 1985
    expected = start + (goal - start) * s[:, None]
    np.testing.assert_allclose(move.sample(u * move.duration).q, expected, rtol=0, atol=ROUNDING)


def test_a_move_to_where_the_arm_is_takes_no_time():
    move = joint_move(robots.chain("puma560"), np.full(6, 0.3), np.full(6, 0.3))
    assert move.duration == 0.0
    np.testing.assert_array_equal(move.sample(5.0).q, np.full(6, 0.3))


@pytest.mark.parametrize("length", [5e-324, 1e-300, 1e-20])
def test_a_tiny_move_arrives(length):
    move = joint_move(robots.chain("ur5e"), np.zeros(6), np.full(6, length))
    assert move.duration >= 1e-9
    np.testing.assert_array_equal(move.sample(move.duration).q, np.full(6, length))
    JointLimits.of(robots.chain("ur5e")).check_trajectory(move)


def test_what_cannot_be_is_refused():
    chain = robots.chain("ur5e")
    with pytest.raises(
        MotionError, match=r"q_goal: joint 'elbow_joint' at 4 rad is outside its limits \[-3.14159265, 3.14159265\] rad"
    ):
        joint_move(chain, np.zeros(6), [0, 0, 4, 0, 0, 0])
    with pytest.raises(MotionError, match="q_start: joint 'elbow_joint'"):
        joint_move(chain, [0, 0, 4, 0, 0, 0], np.zeros(6))
    with pytest.raises(ArrayError, match=r"q_goal must have shape \(..., 6\), got \(5,\)"):
        joint_move(chain, np.zeros(6), np.zeros(5))
    with pytest.raises(ArrayError, match="max_acceleration must be above 0"):
        joint_move(chain, np.zeros(6), np.zeros(6), max_acceleration=0.0)
