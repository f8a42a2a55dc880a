"""Streaming control: limits in every cycle, no jump to another branch, and rest whenever it is asked for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pieper.errors import ArrayError, MotionError
from pieper.ik.solve import solve
from pieper.kinematics.fk import fk
from pieper.kinematics.jacobian import jacobian
from pieper.motion.limits import JointLimits
from pieper.motion.path import line
from pieper.motion.servo import Servo
from pieper.spatial import pose
from tests import robots

HELD = 1.0 + 1e-6
HOME = np.array([0.3, -1.2, 1.4, -1.7, -1.5, 0.3])
CYCLE = 0.002
ON_PATH = 3e-5  # [m] behind a motion that accelerates by 0.5 m/s^2: accelerations are not fed forward

chains = st.sampled_from(robots.NAMES).map(robots.chain)


def limits_of(chain) -> JointLimits:
    return JointLimits.of(chain, max_velocity=2.0, max_acceleration=8.0, max_jerk=200.0)


def run(servo: Servo, targets) -> tuple[np.ndarray, np.ndarray]:
    """Joint values (m, n) and accelerations; every cycle held against every limit, jerk by differences."""
    limits = servo.limits
    before, q = servo.ddq, []
    lower, upper = limits.chain.limits.T
    held = []
    for target in targets:
        was = servo.q
        command = servo.step(target)
        assert (np.abs(command.dq) <= limits.velocity * HELD).all()
        assert (np.abs(servo.ddq) <= limits.acceleration * HELD).all()
        assert (np.abs(servo.ddq - before) / CYCLE <= limits.jerk * HELD).all()
        assert (command.q >= lower).all()
        assert (command.q <= upper).all()
        assert (np.abs(command.q - was) <= limits.velocity * CYCLE * HELD).all()
        before = servo.ddq
        q.append(command.q)
        held.append(servo.held)
    return np.array(q), np.array([h is not None for h in held])


def brake(servo: Servo) -> None:
    servo.stop()
    for _ in range(3000):
        if servo.at_rest:
            return
        run(servo, [None])
    raise AssertionError("never came to rest")


def smooth(path, seconds: float):
    share = 0.5 * (1 - np.cos(np.linspace(0, np.pi, int(seconds / CYCLE))))
    return path.at(share * path.length)


def test_E3_a_stream_of_poses_is_followed_to_the_last_pose():
    chain = robots.chain("ur5e")
    T = fk(chain, HOME)
    goal = T.copy()
    goal[:3, 3] += [0.2, -0.3, 0.1]
    Ts = smooth(line(T, goal), 3.0)
    servo = Servo(chain, limits_of(chain), q=HOME)
    q, held = run(servo, Ts)
    assert not held.any()
    np.testing.assert_allclose(fk(chain, q)[:, :3, 3], Ts[:, :3, 3], rtol=0, atol=ON_PATH)
    run(servo, [goal] * 100)
    np.testing.assert_allclose(fk(chain, servo.q), goal, rtol=0, atol=1e-8)
    assert servo.at_rest


@settings(max_examples=8, deadline=None)
@given(chains, st.integers(0, 1000), st.integers(1, 120))
def test_any_twist_is_made_within_limits_and_stopped_at_any_moment(chain, seed, cycles):
    rng = np.random.default_rng(seed)
    lower, upper = np.clip(chain.limits, -2.5, 2.5).T
    servo = Servo(chain, limits_of(chain), q=rng.uniform(lower, upper))
    for twist in rng.uniform(-3, 3, (3, 6)):
        run(servo, [twist] * cycles)
    brake(servo)


@settings(max_examples=6, deadline=None)
@given(chains, st.integers(0, 1000))
def test_any_stream_is_followed_within_limits(chain, seed):
    rng = np.random.default_rng(seed)
    lower, upper = np.clip(chain.limits, -3.0, 3.0).T
    servo = Servo(chain, limits_of(chain), q=rng.uniform(lower, upper))
    for _ in range(6):
        far = fk(chain, rng.uniform(lower, upper))
        near = fk(chain, np.clip(servo.q + rng.uniform(-0.1, 0.1, chain.dof), *chain.limits.T))
        run(servo, [far] * 20 + [near] * 20 + [rng.uniform(-4, 4, 6)] * 20)
    brake(servo)


def toward(chain, q: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """A gentle twist that asks the joints to go from q towards a goal."""
    way = goal - q
    return jacobian(chain, q) @ (0.05 * way / np.abs(way).max())


@pytest.mark.parametrize("name", robots.NAMES)
def test_an_arm_moves_also_where_zero_is_no_joint_value_of_it(name):
    chain = robots.chain(name)
    lower, upper = np.clip(chain.limits, -2.5, 2.5).T
    q = lower + np.random.default_rng(1).uniform(0.3, 0.7, chain.dof) * (upper - lower)
    servo = Servo(chain, q=q)  # slow to brake: the limits are near everywhere
    run(servo, [toward(chain, q, 0.5 * (lower + upper))] * 50)
    assert np.abs(servo.q - q).max() > 1e-4


@pytest.mark.parametrize("end", [0, 1])
@pytest.mark.parametrize("name", ["ur5e", "franka_panda", "kuka_kr210_robond"])
def test_an_arm_with_a_joint_at_its_limit_leaves_it_and_moves_the_others(name, end):
    chain = robots.chain(name)
    lower, upper = np.clip(chain.limits, -2.5, 2.5).T
    q = lower + np.random.default_rng(2).uniform(0.3, 0.7, chain.dof) * (upper - lower)
    q[1] = chain.limits[1, end]
    inwards = 0.5 * (lower + upper) - q
    servo = Servo(chain, limits_of(chain), q=q)
    run(servo, [jacobian(chain, q)[:, 1] * 0.05 * np.sign(inwards[1])] * 50)
    assert abs(servo.q[1] - q[1]) > 1e-4
    others = q.copy()
    others[0] += 0.05 * np.sign(inwards[0])
    servo = Servo(chain, limits_of(chain), q=q)
    run(servo, [fk(chain, q), *[fk(chain, others)] * 300])
    np.testing.assert_allclose(servo.q, others, rtol=0, atol=2e-6)


def test_a_joint_that_cannot_move_does_not_hold_the_others():
    chain = robots.chain("ur5e")
    limits = chain.limits.copy()
    limits[5] = HOME[5]
    stiff = replace(chain, limits=limits)
    others = HOME + 0.05 * np.eye(6)[0]
    servo = Servo(stiff, limits_of(stiff), q=HOME)
    run(servo, [fk(chain, HOME), *[fk(chain, others)] * 300])
    np.testing.assert_allclose(servo.q, others, rtol=0, atol=2e-6)


@pytest.mark.parametrize("limit", ["max_jerk", "max_acceleration"])
@pytest.mark.parametrize("most", [1e5, 1e6, 1e9, 1e12])
def test_limits_as_good_as_none_do_not_end_a_stream(limit, most):
    chain = robots.chain("ur5e")
    servo = Servo(chain, JointLimits.of(chain, **{limit: most}), q=HOME)
    T = fk(chain, HOME)
    for _ in range(200):
        T[0, 3] -= 2e-4
        run(servo, [T])
    np.testing.assert_allclose(fk(chain, servo.q), T, rtol=0, atol=1e-5)
    run(servo, [np.array([0, 0, 0.1, 0, 0, 0])] * 100)
    brake(servo)


@pytest.mark.parametrize("limit", ["max_jerk", "max_acceleration"])
def test_a_joint_limit_is_kept_with_limits_as_good_as_none(limit):
    chain = robots.chain("kuka_kr210_robond")
    q = np.zeros(6)
    q[0] = chain.limits[0, 1] - 0.02
    servo = Servo(chain, JointLimits.of(chain, **{limit: 1e9}), q=q)
    run(servo, [jacobian(chain, q)[:, 0] * 3.0] * 300)  # held against the limits in every cycle
    assert servo.held is not None
    brake(servo)


def test_a_cycle_without_an_answer_brakes_and_says_so():
    chain = robots.chain("ur5e")
    servo = Servo(chain, limits_of(chain), q=HOME)
    up = np.array([0, 0, 0.1, 0, 0, 0])
    run(servo, [up] * 100)

    class Broken:
        def reset(self):
            pass

        def update(self, asked, out):
            raise ValueError("-101 is not a valid Result.")

    working = servo._ruckig
    servo._ruckig = Broken()
    for target in (up, fk(chain, HOME)):
        run(servo, [target])
        assert servo.held is not None
        assert servo.held.message == "no motion within the limits was found for this cycle; the arm brakes"
    servo._ruckig = working
    run(servo, [up] * 10)
    assert servo.held is None


def test_a_twist_moves_the_tip_with_it():
    chain = robots.chain("ur5e")
    servo = Servo(chain, limits_of(chain), q=HOME)
    twist = np.array([0.05, -0.03, 0.08, 0.1, 0.0, -0.2])
    run(servo, [twist] * 200)
    np.testing.assert_allclose(jacobian(chain, servo.q) @ servo.dq, twist, atol=2e-3)
    assert servo.held is None
    run(servo, [50.0 * twist] * 200)
    assert servo.held is not None
    assert servo.held.reason == "limit"
    assert "times as fast as its limit" in servo.held.message
    made = jacobian(chain, servo.q) @ servo.dq
    cosine = made[:3] @ twist[:3] / np.linalg.norm(made[:3]) / np.linalg.norm(twist[:3])
    assert cosine > 0.95  # slowed down together: the direction stays


def test_a_joint_limit_is_met_at_rest():
    chain = robots.chain("kuka_kr210_robond")
    servo = Servo(chain, limits_of(chain), q=np.zeros(6))
    reasons = set()
    for _ in range(1500):
        run(servo, [jacobian(chain, servo.q)[:, 0] * 1.5])
        if servo.held is not None:
            reasons.add((servo.held.reason, servo.held.message))
    assert ("limit", "joint 'joint_1' brakes before its limit") in reasons
    assert servo.q[0] > chain.limits[0, 1] - 0.2
    brake(servo)


def test_a_far_pose_is_gone_to_on_the_same_branch():
    chain = robots.chain("ur5e")
    servo = Servo(chain, limits_of(chain), q=HOME)
    T = fk(chain, HOME)
    away = pose.from_xyz_rpy([0, 0, 0], [0, 0, 1.5]) @ T
    before = solve(chain, T, seed=HOME).labels[0]
    q, _ = run(servo, [T] * 3 + [away] * 1500)
    np.testing.assert_allclose(fk(chain, q[-1]), away, atol=1e-8)
    assert solve(chain, away, seed=q[-1]).labels[0] == before


def test_another_branch_is_never_taken_in_silence():
    chain = robots.chain("kuka_kr210_robond")
    start = np.array([0.1, 0.2, -0.3, 0.4, 0.5, 0.6])
    label = solve(chain, fk(chain, start), seed=start).labels[0]
    rng = np.random.default_rng(1)
    refused = 0
    for T in fk(chain, rng.uniform(*chain.limits.T, (200, 6))):
        answers = solve(chain, T, seed=start)
        if label in answers.labels[answers.within_limits] or not answers.reached:
            continue
        servo = Servo(chain, limits_of(chain), q=start)
        q, held = run(servo, [fk(chain, start)] * 2 + [T] * 20)
        assert held[2:].all()
        assert servo.held.reason in ("branch", "singularity")
        assert "would have to jump" in servo.held.message
        assert np.abs(q - start).max() < 1e-5
        refused += 1
        if refused == 5:
            break
    assert refused == 5


@pytest.mark.parametrize("name", ["kuka_kr210_robond", "ur5e"])
def test_a_straight_wrist_is_passed_within_limits(name):
    chain = robots.chain(name)
    q = np.array([0.0, 0.2, -0.3, 0.0, 0.25, 0.0]) if "kuka" in name else HOME * [1, 1, 1, 1, -0.1 / 1.5, 1]
    T = fk(chain, q)
    other = q.copy()
    other[4] *= -1
    goal = fk(chain, other)
    goal[1, 3] += 2e-3  # past the singularity, not through it
    servo = Servo(chain, limits_of(chain), q=q)
    run(servo, smooth(line(T, goal), 2.0))
    brake(servo)


def test_held_says_why():
    chain = robots.chain("ur5e")
    servo = Servo(chain, limits_of(chain), q=HOME)
    far = pose.from_xyz_rpy([3.0, 0.0, 0.0], [0, 0, 0])
    for target, reason, word in (
        (far, "unreachable", "out of reach"),
        (np.full((4, 4), np.nan), "malformed", "must be finite"),
        (np.full(6, np.nan), "malformed", "finite numbers"),
        (np.array([np.inf, 0, 0, 0, 0, 0]), "malformed", "finite numbers"),
    ):
        q, held = run(servo, [target] * 3)
        assert held.all()
        assert servo.held.reason == reason
        assert word in servo.held.message
        np.testing.assert_allclose(q, np.tile(HOME, (3, 1)), atol=1e-9)
    run(servo, [fk(chain, HOME)])
    assert servo.held is None


def test_a_singular_arm_says_so():
    chain = robots.chain("ur5e")
    servo = Servo(chain, limits_of(chain), q=[0.3, -1.2, 0.0, -1.7, -1.5, 0.3])  # stretched out
    run(servo, [np.array([0.1, 0, 0, 0, 0, 0])] * 3)
    assert servo.held is not None
    assert servo.held.reason == "singularity"


@pytest.mark.parametrize("name", ["panda", "crx10ia", "youbot"])
def test_arms_without_a_closed_form_follow_too(name):
    import pieper

    chain = pieper.load(name).chain
    middle = np.clip(chain.limits, -3.0, 3.0).mean(axis=1) + 0.1
    by = np.linspace(0, 0.05, 150)[:, None] * np.ones(chain.dof)
    Ts = fk(chain, middle + by)
    servo = Servo(chain, limits_of(chain), q=middle)
    _, held = run(servo, Ts)
    assert not held.any()
    run(servo, [Ts[-1]] * 300)
    np.testing.assert_allclose(fk(chain, servo.q), Ts[-1], rtol=0, atol=1e-6)


def test_malformed_questions_are_refused():
    chain = robots.chain("ur5e")
    with pytest.raises(MotionError, match="outside its limits"):
        Servo(chain, q=[0, 0, 4.0, 0, 0, 0])
    with pytest.raises(ArrayError, match=r"rate must be above 0 \[Hz\], got 0"):
        Servo(chain, q=HOME, rate=0)
    with pytest.raises(ArrayError, match=r"target must be a pose \(4, 4\) or a twist \(6,\), got \(3,\)"):
        Servo(chain, q=HOME).step(np.zeros(3))
    with pytest.raises(ArrayError, match="limits must be those of the joints"):
        Servo(chain, limits_of(robots.chain("franka_panda")), q=HOME)
