"""The kinematic simulator: laws over every robot, and what it refuses."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pieper.errors import ArrayError, MotionError, PieperError, UnknownNameError
from pieper.model.chain import Chain
from pieper.motion.joint_move import joint_move
from pieper.motion.limits import ROUNDING as LIMIT_ROUNDING
from pieper.motion.trajectory import Trajectory
from pieper.sim.kinematic import KinematicSimulator
from tests import robots

ROUNDING = 1e-9  # of positions up to 100 rad after hundreds of sums of times
FINITE_DIFFERENCE = 1e-6  # steps of 1e-4 s, rates of change of the velocity up to 1e2 rad/s^3

chains = st.sampled_from(robots.NAMES).map(robots.chain)
seeds = st.integers(0, 10_000)


def random_joints(chain: Chain, rng: np.random.Generator) -> np.ndarray:
    lower, upper = np.clip(chain.limits, -6.0, 6.0).T
    return rng.uniform(lower, upper)


def order(robot: KinematicSimulator, rng: np.random.Generator) -> None:
    """One of everything that can be asked of a simulator."""
    which = rng.integers(5)
    if which == 0:
        robot.command(random_joints(robot.chain, rng))
    elif which == 1:
        robot.command_velocity(rng.uniform(-1.0, 1.0, robot.chain.dof) * robot.limits.velocity)
    elif which == 2:
        robot.follow(joint_move(robot.chain, robot.read().q, random_joints(robot.chain, rng)))
    elif which == 3:
        goal = random_joints(robot.chain, rng)
        t = 2.0 * np.max(np.abs(goal - robot.read().q) / robot.limits.velocity) + 1e-3
        robot.follow(Trajectory([t, t + 1.0], [goal, goal]))
    else:
        robot.stop()


@settings(max_examples=200)
@given(chains, seeds)
def test_limits_are_never_broken_and_positions_never_jump(chain, seed):
    rng = np.random.default_rng(seed)
    robot = KinematicSimulator(chain, q=random_joints(chain, rng))
    lower, upper = chain.limits.T
    before = robot.read()
    for _ in range(8):
        order(robot, rng)
        np.testing.assert_array_equal(robot.read().q, before.q)  # nothing moves without time
        for dt in rng.exponential(0.2, 8):
            state = robot.step(dt)
            assert ((lower <= state.q) & (state.q <= upper)).all()
            assert (np.abs(state.dq) <= robot.limits.velocity).all()
            furthest = robot.limits.velocity * dt * (1 + LIMIT_ROUNDING) + ROUNDING
            assert (np.abs(state.q - before.q) <= furthest).all()
            before = state
    robot.stop()
    assert not robot.read().dq.any()
    np.testing.assert_array_equal(robot.step(1.0).q, before.q)


@given(chains, seeds)
def test_steps_of_any_size_give_the_same_path(chain, seed):
    starts = random_joints(chain, np.random.default_rng(seed))
    fine, coarse = KinematicSimulator(chain, q=starts), KinematicSimulator(chain, q=starts)
    for turn in range(4):
        order(fine, np.random.default_rng(seed + turn))
        order(coarse, np.random.default_rng(seed + turn))
        for _ in range(64):
            fine.step(1 / 192)
        state = coarse.step(1 / 3)
        np.testing.assert_allclose(fine.read().q, state.q, rtol=0, atol=ROUNDING)
        assert fine.time == pytest.approx(coarse.time, abs=ROUNDING)
        # start again from the same numbers, since an order depends on where the arm is
        coarse, fine = (KinematicSimulator(chain, q=state.q) for _ in range(2))


@given(chains, seeds)
def test_velocities_are_finite_differences_of_positions(chain, seed):
    rng = np.random.default_rng(seed)
    robot = KinematicSimulator(chain, q=random_joints(chain, rng))
    robot.follow(joint_move(chain, robot.read().q, random_joints(chain, rng), max_velocity=1.0, max_acceleration=2.0))
    robot.step(rng.uniform(0.0, 1.0))
    before, here, after = robot.read(), robot.step(1e-4), robot.step(1e-4)
    if robot.is_moving:
        np.testing.assert_allclose((after.q - before.q) / 2e-4, here.dq, rtol=0, atol=FINITE_DIFFERENCE)


@given(chains, seeds)
def test_a_command_arrives_exactly_and_no_sooner_than_it_can(chain, seed):
    rng = np.random.default_rng(seed)
    robot = KinematicSimulator(chain, q=random_joints(chain, rng))
    here, goal = robot.read().q, random_joints(chain, rng)
    least = float(np.max(np.abs(goal - here) / robot.limits.velocity))
    robot.command(goal)
    halfway = robot.step(0.5 * least)
    np.testing.assert_allclose(halfway.q, 0.5 * (here + goal), rtol=0, atol=ROUNDING)
    assert robot.is_moving
    assert (np.abs(halfway.dq) / robot.limits.velocity).max() == pytest.approx(1.0)  # one joint at its limit
    state = robot.step(0.5 * least * (1 + 1e-9))
    np.testing.assert_array_equal(state.q, goal)
    assert not state.dq.any()
    assert not robot.is_moving


@given(chains, seeds)
def test_a_followed_move_arrives_exactly(chain, seed):
    rng = np.random.default_rng(seed)
    robot = KinematicSimulator(chain, q=random_joints(chain, rng))
    robot.step(rng.uniform(0.0, 5.0))  # times of a trajectory count from when it is given
    goal = random_joints(chain, rng)
    move = joint_move(chain, robot.read().q, goal)
    robot.follow(move)
    u = rng.uniform(0.1, 0.9)
    np.testing.assert_allclose(robot.step(u * move.duration).q, move.sample(u * move.duration).q, rtol=0, atol=ROUNDING)
    state = robot.step((1 - u) * move.duration * (1 + 1e-9))
    np.testing.assert_array_equal(state.q, goal)
    assert not state.dq.any()
    assert not robot.is_moving


@given(chains, seeds)
def test_a_velocity_stops_each_joint_at_its_own_limit(chain, seed):
    rng = np.random.default_rng(seed)
    robot = KinematicSimulator(chain, q=random_joints(chain, rng))
    here = robot.read().q
    dq = rng.uniform(-1.0, 1.0, chain.dof) * robot.limits.velocity
    robot.command_velocity(dq)
    np.testing.assert_array_equal(robot.read().dq, dq)
    state = robot.step(1.0)
    expected = np.clip(here + dq, *chain.limits.T)
    np.testing.assert_array_equal(state.q, expected)
    np.testing.assert_array_equal(state.dq, np.where(expected == here + dq, dq, 0.0))
    state = robot.step(1e5)
    limited = np.isfinite(chain.limits).all(axis=1)
    assert not state.dq[limited].any()
    assert robot.is_moving == (not limited.all())
    robot.command_velocity(-dq)  # and away from the limit again
    np.testing.assert_array_equal(robot.read().dq, -dq)


@pytest.mark.parametrize("name", robots.NAMES)
def test_it_begins_at_rest_within_limits_nearest_to_zero(name):
    chain = robots.chain(name)
    state = KinematicSimulator(chain).read()
    np.testing.assert_array_equal(state.q, np.clip(0.0, *chain.limits.T))
    assert state.time == 0.0
    assert not state.dq.any()


def test_joints_by_name():
    robot = KinematicSimulator(robots.chain("ur5e"), q={"elbow_joint": 1.0})
    robot.command({"wrist_1_joint": 0.5, "shoulder_pan_joint": -0.5})
    np.testing.assert_array_equal(robot.step(10.0).q, [-0.5, 0.0, 1.0, 0.5, 0.0, 0.0])
    robot.command_velocity({"elbow_joint": -0.5})
    np.testing.assert_allclose(robot.step(1.0).q, [-0.5, 0.0, 0.5, 0.5, 0.0, 0.0])


def test_mimic_joints_are_commanded_by_the_joint_that_leads():
    two_axes = Chain(
        "gripper arm",
        [[0.0, 0.0, 0.0, 0.0, 0.0, 1.0], [0.0, -1.0, 0.0, 0.0, 0.0, 1.0]],
        np.eye(4),
        [[-1.0, 1.0]],
        ("lead",),
        coupling=[[1.0], [-2.0]],
        max_velocity=[0.5],
    )
    robot = KinematicSimulator(two_axes)
    robot.command({"lead": 1.0})
    np.testing.assert_allclose(robot.step(1.0).q, [0.5])


def test_a_trajectory_in_another_order_of_joints():
    chain = robots.chain("ur5e")
    goal = 0.1 * np.arange(6)
    move = joint_move(chain, np.zeros(6), goal)
    backwards = Trajectory(move.t, move.q[:, ::-1], move.dq, move.ddq, move.joint_names[::-1])
    robot = KinematicSimulator(chain)
    robot.follow(backwards)
    np.testing.assert_array_equal(robot.step(10.0).q, goal)


def test_a_first_point_after_now_is_joined_to_where_the_arm_is():
    robot = KinematicSimulator(robots.chain("ur5e"))
    robot.command_velocity([0.5, 0, 0, 0, 0, 0])
    robot.step(1.0)
    robot.follow(Trajectory([2.0], [np.full(6, 1.0)], np.zeros((1, 6))))
    np.testing.assert_allclose(robot.read().dq, [0.5, 0, 0, 0, 0, 0])  # no jump of the velocity either
    # Hermite: half way from 0.5 rad at 0.5 rad/s to 1 rad at rest, in 2 s
    np.testing.assert_allclose(robot.step(1.0).q[0], 0.5 * 0.5 + 0.5 * 1.0 + 2.0 * 0.5 / 8, rtol=0, atol=ROUNDING)
    np.testing.assert_array_equal(robot.step(1.0).q, np.full(6, 1.0))


def test_a_small_gap_at_the_start_is_taken_up_without_a_jump():
    robot = KinematicSimulator(robots.chain("ur5e"), q=np.full(6, 0.005))
    robot.follow(joint_move(robots.chain("ur5e"), np.zeros(6), np.full(6, 0.5)))
    np.testing.assert_array_equal(robot.read().q, np.full(6, 0.005))
    np.testing.assert_array_equal(robot.step(10.0).q, np.full(6, 0.5))


@pytest.mark.parametrize("verb", ["command", "command_velocity", "follow", "stop"])
def test_what_is_asked_last_runs(verb):
    chain = robots.chain("ur5e")
    robot = KinematicSimulator(chain)
    robot.follow(joint_move(chain, np.zeros(6), np.full(6, 1.0)))
    here = robot.step(0.3).q
    ask = {
        "command": lambda: robot.command(np.zeros(6)),
        "command_velocity": lambda: robot.command_velocity(np.full(6, -0.1)),
        "follow": lambda: robot.follow(joint_move(chain, here, np.zeros(6))),
        "stop": robot.stop,
    }
    ask[verb]()
    later = robot.step(0.1).q
    assert (later <= here).all() if verb != "stop" else (later == here).all()


BAD = {
    "wrong length": (lambda r: r.command(np.zeros(5)), ArrayError, r"q must have shape \(..., 6\), got \(5,\)"),
    "a batch": (lambda r: r.command(np.zeros((2, 6))), ArrayError, r"q must have shape \(6,\), got \(2, 6\)"),
    "empty": (lambda r: r.command([]), ArrayError, r"got \(0,\)"),
    "text": (lambda r: r.command(["a"] * 6), ArrayError, "q must be real numbers"),
    "NaN": (
        lambda r: r.command([0, 0, np.nan, 0, 0, 0]),
        ArrayError,
        r"q must be finite, got q\[2\] = nan \(joint 'elbow_joint'\)",
    ),
    "infinite": (lambda r: r.command({"elbow_joint": np.inf}), ArrayError, "q must be finite"),
    "no number": (
        lambda r: r.command({"elbow_joint": None}),
        ArrayError,
        "q of joint 'elbow_joint' must be a number, got None",
    ),
    "out of limits": (
        lambda r: r.command([0, 0, 3.2, 0, 0, 0]),
        MotionError,
        r"q: joint 'elbow_joint' at 3.2 rad is outside its limits \[-3.14159265, 3.14159265\] rad",
    ),
    "unknown": (
        lambda r: r.command({"elbow_joint": 0.1, "elbo": 1.0}),
        UnknownNameError,
        "no joint 'elbo'.*did you mean 'elbow_joint'",
    ),
    "too fast": (
        lambda r: r.command_velocity([0, 0, 0, 9.0, 0, 0]),
        MotionError,
        "dq: joint 'wrist_1_joint' at 9 rad/s is faster than its limit of 3.14159265 rad/s",
    ),
    "velocity NaN": (lambda r: r.command_velocity(np.full(6, np.nan)), ArrayError, "dq must be finite"),
    "velocity unknown": (lambda r: r.command_velocity({"x": 1.0}), UnknownNameError, "no joint 'x'"),
    "starts elsewhere": (
        lambda r: r.follow(Trajectory([0.0, 9.0], [np.full(6, 1.0), np.zeros(6)])),
        MotionError,
        "must begin where the arm is, within 0.01: joint '.*' is at .* and the trajectory begins at 1; plan it from where",
    ),
    "before now": (
        lambda r: r.follow(Trajectory([-1.0, 9.0], np.zeros((2, 6)))),
        ArrayError,
        "must not be before 0, got -1.0 s",
    ),
    "too soon": (
        lambda r: r.follow(Trajectory([0.01], [np.full(6, 1.0)])),
        MotionError,
        "at 0 s of the trajectory: joint 'shoulder_pan_joint' at .* rad/s is faster than its limit",
    ),
    "out between points": (
        lambda r: r.follow(
            Trajectory([2.0, 4.0], [[0, 0, 3.0, 0, 0, 0]] * 2, [[0, 0, 1.0, 0, 0, 0], [0, 0, -1.0, 0, 0, 0]])
        ),
        MotionError,
        "joint 'elbow_joint' at .* rad is outside its limits",
    ),
    "too fast between points": (
        lambda r: r.follow(Trajectory([2.0, 3.0], [np.zeros(6), np.full(6, 3.0)], np.zeros((2, 6)))),
        MotionError,
        "at 2.* s of the trajectory: joint 'shoulder_pan_joint' at .* rad/s is faster",
    ),
    "other joints": (
        lambda r: r.follow(Trajectory([1.0], [[0.0]], joint_names=("gripper",))),
        UnknownNameError,
        "no joint 'gripper'",
    ),
    "joints missing": (
        lambda r: r.follow(Trajectory([1.0], [[0.0]], joint_names=("elbow_joint",))),
        ArrayError,
        "it lacks shoulder_pan",
    ),
    "columns": (lambda r: r.follow(Trajectory([1.0], [[0.0]])), ArrayError, "must have 6 columns"),
    "back in time": (lambda r: r.step(-0.1), ArrayError, r"dt must be from 0 to 1e\+06 s, got -0.1"),
    "time NaN": (lambda r: r.step(np.nan), ArrayError, "dt must be from 0"),
    "for ever": (lambda r: r.step(np.inf), ArrayError, "dt must be from 0"),
    "no time": (lambda r: r.step("soon"), ArrayError, "dt must be a number of seconds, got 'soon'"),
}


@pytest.mark.parametrize("fault", BAD)
def test_what_is_refused_changes_nothing(fault):
    ask, error, message = BAD[fault]
    chain = robots.chain("ur5e")
    robot, untouched = KinematicSimulator(chain), KinematicSimulator(chain)
    for one in (robot, untouched):
        one.follow(joint_move(chain, np.zeros(6), np.full(6, 0.5), max_velocity=0.5))
        one.step(0.2)
    with pytest.raises(error, match=message) as caught:
        ask(robot)
    assert isinstance(caught.value, PieperError)
    for dt in (0.0, 0.1, 5.0):
        state, expected = robot.step(dt), untouched.step(dt)
        assert state.time == expected.time
        np.testing.assert_array_equal(state.q, expected.q)
        np.testing.assert_array_equal(state.dq, expected.dq)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"q": [0, 0, 4, 0, 0, 0]}, MotionError, "q: joint 'elbow_joint' at 4 rad is outside"),
        ({"q": {"x": 0.0}}, UnknownNameError, "no joint 'x'"),
        ({"max_velocity": 0.0}, ArrayError, "max_velocity must be above 0"),
    ],
)
def test_no_simulator_of_what_cannot_be(arguments, error, message):
    with pytest.raises(error, match=message):
        KinematicSimulator(robots.chain("ur5e"), **arguments)


def test_a_state_cannot_be_written_to():
    state = KinematicSimulator(robots.chain("ur5e")).read()
    for values in (state.q, state.dq):
        with pytest.raises(ValueError, match="read-only"):
            values[0] = 1.0
