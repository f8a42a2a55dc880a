"""Limits of joints, and the exact check of trajectories against dense samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from pieper.errors import ArrayError, MotionError
from pieper.model.chain import Chain
from pieper.motion.limits import ROUNDING, JointLimits
from pieper.motion.trajectory import Trajectory
from tests import robots
from tests.motion.random_trajectories import kinds, random_trajectory, seeds

TURN_AND_SLIDE = Chain(
    "crane",
    [[0.0, 0.0, 0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 1.0, 0.0, 0.0, 0.0]],
    np.eye(4),
    [[-1.0, 1.0], [0.0, 0.5]],
    ("turn", "lift"),
)


def test_defaults_where_the_description_gives_none():
    limits = JointLimits.of(TURN_AND_SLIDE)
    np.testing.assert_array_equal(limits.velocity, [1.0, 0.25])
    np.testing.assert_array_equal(limits.acceleration, [2.0, 0.5])


@pytest.mark.parametrize("name", robots.NAMES)
def test_what_is_given_lowers_and_never_raises(name):
    chain = robots.chain(name)
    own = JointLimits.of(chain)
    known = np.isfinite(chain.max_velocity)
    np.testing.assert_array_equal(own.velocity[known], chain.max_velocity[known])
    raised = JointLimits.of(chain, max_velocity=100.0, max_acceleration=7.0)
    np.testing.assert_array_equal(raised.velocity, np.where(known, chain.max_velocity, 100.0))
    np.testing.assert_array_equal(raised.acceleration, np.full(chain.dof, 7.0))
    lowered = JointLimits.of(chain, max_velocity=np.full(chain.dof, 0.1))
    np.testing.assert_array_equal(lowered.velocity, np.full(chain.dof, 0.1))


@pytest.mark.parametrize("name", ["max_velocity", "max_acceleration"])
@pytest.mark.parametrize(
    ("value", "message"),
    [
        (0.0, "must be above 0, got 0.0"),
        (-1.0, "must be above 0, got -1.0"),
        (np.inf, "must be finite, got inf"),
        (np.nan, "must be finite, got nan"),
        ([1.0, 1.0, 1.0], r"must be one number or have shape \(2,\), got \(3,\)"),
        ([[1.0, 1.0]], r"must be one number or have shape \(2,\), got \(1, 2\)"),
    ],
)
def test_limits_that_are_none_are_refused(name, value, message):
    with pytest.raises(ArrayError, match=f"{name} {message}"):
        JointLimits.of(TURN_AND_SLIDE, **{name: value})


def test_a_joint_described_as_unable_to_move_is_refused():
    with pytest.raises(
        ArrayError, match="velocity limit of joint 'lift' must be above 0, and the description of 'crane' gives 0"
    ):
        JointLimits.of(replace(TURN_AND_SLIDE, max_velocity=[1.0, 0.0]))


def test_joints_that_lead_others_have_the_limits_of_their_chain():
    mimicking = replace(
        TURN_AND_SLIDE,
        joint_names=("both",),
        limits=[[-1, 1]],
        coupling=[[1.0], [0.1]],
        max_velocity=np.empty(0),
        max_effort=np.empty(0),
    )
    np.testing.assert_array_equal(JointLimits.of(mimicking).velocity, [1.0])


def test_messages_name_joint_value_and_limits():
    limits = JointLimits.of(TURN_AND_SLIDE)
    with pytest.raises(MotionError, match=r"q: joint 'lift' at 0.6 m is outside its limits \[0, 0.5\] m"):
        limits.check_position([0.0, 0.6])
    with pytest.raises(MotionError, match=r"dq: joint 'turn' at -1.5 rad/s is faster than its limit of 1 rad/s"):
        limits.check_velocity([-1.5, 0.0])
    with pytest.raises(
        ArrayError, match=r"q must have shape \(..., 2\), got \(3,\); the joints of 'crane' are: turn, lift"
    ):
        limits.check_position([0.0, 0.0, 0.0])
    with pytest.raises(ArrayError, match=r"q must have shape \(2,\), got \(1, 2\)"):
        limits.check_position([[0.0, 0.0]])
    with pytest.raises(ArrayError, match=r"q must be finite, got q\[1\] = nan \(joint 'lift'\)"):
        limits.check_position([0.0, np.nan])
    with pytest.raises(ArrayError, match="must have 2 columns, one for each joint, got 1"):
        limits.check_trajectory(Trajectory([0.0], [[0.0]]))


@given(seeds, kinds, st.floats(0.3, 3.0), st.floats(0.3, 10.0))
def test_the_exact_check_agrees_with_dense_samples(seed, kind, width, speed):
    ours = random_trajectory(seed, kind)
    chain = replace(TURN_AND_SLIDE, limits=[[-width, width]] * 2)
    limits = JointLimits.of(chain, max_velocity=speed)
    q, dq, _ = ours.sample(np.linspace(ours.t[0], ours.t[-1], 2001))
    excess = max(np.abs(q).max() - width, np.abs(dq).max() - speed)
    assume(abs(excess) > 1e-2)  # samples 2 ms apart miss less than that of an extremum
    if excess > 0.0:
        with pytest.raises(MotionError, match=r"s of the trajectory: joint '(turn|lift)' at"):
            limits.check_trajectory(ours)
    else:
        limits.check_trajectory(ours)


@given(seeds)
def test_the_check_is_tight_at_an_extremum_between_points(seed):
    rng = np.random.default_rng(seed)
    height, width = rng.uniform(0.1, 1.0, 2)
    # q = 4 height u (1 - u): the cubic through two zeros that begins upwards and ends downwards
    dq = np.array([[4 * height / width], [-4 * height / width]])
    bump = Trajectory([0.0, width], [[0.0, 0.1], [0.0, 0.1]], np.hstack([dq, np.zeros((2, 1))]))
    for gap, refused in ((1e-7, False), (-1e-7, True)):
        chain = replace(TURN_AND_SLIDE, limits=[[-height - gap, height + gap], [0.0, 0.5]])
        limits = JointLimits.of(chain, max_velocity=1e3)
        if refused:
            with pytest.raises(MotionError, match=r"joint 'turn'.* is outside its limits"):
                limits.check_trajectory(bump)
        else:
            limits.check_trajectory(bump)
    exactly = JointLimits.of(TURN_AND_SLIDE, max_velocity=4 * height / width)
    exactly.check_trajectory(bump)
    with pytest.raises(MotionError, match=r"joint 'turn' at .* rad/s is faster than its limit of"):
        JointLimits.of(TURN_AND_SLIDE, max_velocity=4 * height / width * (1 - 1e-7)).check_trajectory(bump)


def test_the_first_fault_is_told():
    zigzag = Trajectory([0.0, 10.0, 20.0, 30.0], [[0.0, 0.0], [2.0, 0.0], [0.0, 0.0], [3.0, 0.0]])
    with pytest.raises(MotionError, match=r"at 10 s of the trajectory: joint 'turn' at 2 rad is outside"):
        JointLimits.of(TURN_AND_SLIDE).check_trajectory(zigzag)


def test_one_point_is_checked():
    limits = JointLimits.of(TURN_AND_SLIDE)
    limits.check_trajectory(Trajectory([0.0], [[1.0 + 0.5 * ROUNDING, 0.0]]))
    with pytest.raises(MotionError, match=r"the trajectory's only point: joint 'turn' at 1.1 rad is outside"):
        limits.check_trajectory(Trajectory([0.0], [[1.1, 0.0]]))


def test_an_arm_in_place_of_its_chain_is_told():
    class Arm:
        pass

    with pytest.raises(ArrayError, match=r"chain must be a Chain, as `arm.chain` is one, got Arm"):
        JointLimits.of(Arm())
