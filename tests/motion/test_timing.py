"""Timing: limits held everywhere, and Ruckig never asked over the network."""

from __future__ import annotations

import itertools
import json
import re
from pathlib import Path

import numpy as np
import pytest
import ruckig
from hypothesis import given, settings
from hypothesis import strategies as st

import pieper
from pieper.arm import Arm
from pieper.errors import ArrayError, MissingExtraError, MotionError
from pieper.kinematics.fk import fk
from pieper.motion import _retiming, files
from pieper.motion.limits import JointLimits
from pieper.motion.path import arc_through, join, line, spline
from pieper.motion.path_ik import follow_path
from pieper.motion.timing import TcpLimits, time_path, time_waypoints, usage
from pieper.motion.trajectory import Trajectory
from pieper.spatial import pose
from tests import robots

HELD = 1.0 + 1e-6  # of a limit, at every sample
STRAIGHT = 1e-9  # [rad] off the line between way points
HOME = np.array([0.3, -1.2, 1.4, -1.7, -1.5, 0.3])
LIMITS = {"max_velocity": 2.0, "max_acceleration": 8.0, "max_jerk": 80.0}

chains = st.sampled_from(robots.NAMES).map(robots.chain)


def held(move, limits: JointLimits, tcp: TcpLimits | None = None, count: int = 4001) -> None:
    """Every sample of a grid that knows nothing of the points: velocities and accelerations as they are, jerk by differences too."""
    t = np.linspace(move.t[0], move.t[-1], count)
    q, dq, ddq = move.sample(t)
    assert (np.abs(dq) <= limits.velocity * HELD).all()
    assert (np.abs(ddq) <= limits.acceleration * HELD).all()
    jerk = np.diff(ddq, axis=0) / np.diff(t)[:, None]  # the mean over a step: at most the largest in it
    assert (np.abs(jerk) <= limits.jerk * HELD + 1e-9).all()
    assert (q >= limits.chain.limits[:, 0]).all()
    assert (q <= limits.chain.limits[:, 1]).all()
    if tcp is not None:
        p = fk(limits.chain, q)[:, :3, 3]
        speed = np.linalg.norm(np.diff(p, axis=0), axis=1) / np.diff(t)
        assert speed.max() <= tcp.velocity * HELD
        middle = 0.5 * (t[1:] + t[:-1])
        state = move.sample(middle)
        arm = Arm(limits.chain)
        J, dJ = arm.jacobian(state.q), arm.jacobian_rate(state.q, state.dq)
        rate = (J @ state.ddq[..., None] + dJ @ state.dq[..., None])[:, :3, 0]
        assert np.linalg.norm(rate, axis=1).max() <= tcp.acceleration * HELD


@settings(max_examples=12, deadline=None)
@given(chains, st.integers(0, 1000))
def test_way_points_are_joined_straight_within_limits(chain, seed):
    rng = np.random.default_rng(seed)
    lower, upper = np.clip(chain.limits, -3.0, 3.0).T
    points = rng.uniform(lower, upper, (3, chain.dof))
    move = time_waypoints(chain, points, **LIMITS)
    limits = JointLimits.of(chain, **LIMITS)
    held(move, limits, count=1501)
    t = np.linspace(0, move.duration, 501)
    q = move.sample(t).q
    off = np.full(len(t), np.inf)
    for a, b in itertools.pairwise(points):
        way = (b - a) / np.linalg.norm(b - a)
        off = np.minimum(off, np.linalg.norm((q - a) - ((q - a) @ way)[:, None] * way, axis=1))
    assert off.max() < STRAIGHT
    at_middle = int(np.argmin(np.abs(move.q - points[1]).sum(axis=1)))
    np.testing.assert_array_equal(move.q[at_middle], points[1])
    assert not move.dq[at_middle].any()
    use = usage(move, limits)
    assert max(use.velocity, use.acceleration, use.jerk) == pytest.approx(1.0, abs=1e-6)  # none quicker on this line


def test_a_move_takes_the_time_of_its_closed_form():
    # 2 rad at 2 rad/s, 8 rad/s^2, 80 rad/s^3: 0.1 + 0.15 + 0.1 s up and down with 0.35 rad each, and 1.3 rad at full speed
    move = time_waypoints(robots.chain("ur5e"), [HOME, HOME + np.array([2.0, 0, 0, 0, 0, 0])], **LIMITS)
    assert move.duration == pytest.approx(0.7 + 1.3 / 2.0, abs=1e-6)


def test_E3_the_move_of_the_ur_report_within_every_limit():
    chain = robots.chain("ur5e")
    goal = [-1.28, 4.41, 1.54, -1.16, -1.56, 0.0]
    move = time_waypoints(chain, [np.zeros(6), goal], **LIMITS)
    held(move, JointLimits.of(chain, **LIMITS))
    np.testing.assert_array_equal(move.q[-1], goal)


def pathology(chain):
    T = fk(chain, HOME)
    B, C = T.copy(), T.copy()
    B[:3, 3] += [0.1, -0.2, 0.1]
    C[:3, 3] += [0.2, -0.1, -0.1]
    C[:3, :3] = C[:3, :3] @ pose.from_xyz_rpy([0, 0, 0], [0.3, 0.2, -0.4])[:3, :3]
    return {
        "line": line(T, B),
        "arc": arc_through(T, B[:3, 3], C),
        "spline": spline([T, B, C]),
        "corner": join([line(T, B), line(B, C)]),
        "rounded": join([line(T, B), line(B, C)], blend=0.05),
    }


@pytest.mark.parametrize("kind", ["line", "arc", "spline", "corner", "rounded"])
@pytest.mark.parametrize("tcp", [None, TcpLimits(0.25, 1.0, 10.0)])
def test_limits_hold_at_every_sample_along_a_path(kind, tcp):
    chain = robots.chain("ur5e")
    path = pathology(chain)[kind]
    way = follow_path(chain, path, q_start=HOME, step=0.005)
    move = time_path(way, tcp=tcp, **LIMITS)
    limits = JointLimits.of(chain, **LIMITS)
    held(move, limits, tcp)
    use = usage(move, limits, tcp)
    assert 0.99 < max(use) <= HELD  # and one of them is used up
    # the tip keeps to the path: every point of the motion is near one of it
    p = fk(chain, move.sample(np.linspace(0, move.duration, 60)).q)[:, :3, 3]
    fine = path.at(np.linspace(0, path.length, 6000))[:, :3, 3]
    assert np.linalg.norm(p[:, None] - fine, axis=2).min(axis=1).max() < 1e-4
    np.testing.assert_allclose(move.q[[0, -1]], way.q[[0, -1]], atol=1e-12)
    if kind == "corner":
        at = int(np.argmin(np.abs(move.q - way.q[np.searchsorted(way.s, path.corners[0] - 1e-9)]).sum(axis=1)))
        assert not move.dq[at].any()


def test_a_straight_wrist_slows_the_path_down_and_nothing_jumps():
    chain = robots.chain("kuka_kr210_robond")
    A, B = fk(chain, [0.0, 0.2, -0.3, 0.0, 0.3, 0.0]), fk(chain, [0.0, 0.3, -0.2, 0.0, -0.3, 0.0])
    B[1, 3] += 0.01
    way = follow_path(chain, line(A, B), step=0.005)
    move = time_path(way, **LIMITS)
    held(move, JointLimits.of(chain, **LIMITS))
    t = np.linspace(0, move.duration, 2001)
    q, dq, _ = move.sample(t)
    J = Arm(chain).jacobian(q)
    speed = np.linalg.norm((J @ dq[..., None])[:, :3, 0], axis=1)
    bent = np.abs(q[:, 4])
    inner = slice(200, -200)
    assert speed[inner][np.argmin(bent[inner])] < 0.5 * speed.max()  # slowest where the wrist is straight


def test_a_turn_about_one_axis_takes_the_least_time():
    chain = robots.chain("ur5e")
    q = HOME + np.linspace(0, 1, 200)[:, None] * np.array([1.0, 0, 0, 0, 0, 0])
    way = follow_path(chain, fk(chain, q), q_start=HOME)
    assert time_path(way, **LIMITS).duration == pytest.approx(
        time_waypoints(chain, q[[0, -1]], **LIMITS).duration, rel=1e-4
    )


def test_a_motion_of_nothing_takes_no_time():
    chain = robots.chain("ur5e")
    assert time_waypoints(chain, [HOME, HOME, HOME]).duration == 0.0
    way = follow_path(chain, np.tile(fk(chain, HOME), (3, 1, 1)), q_start=HOME)
    assert time_path(way).duration == 0.0


def test_what_cannot_be_timed_is_refused_in_words():
    chain = robots.chain("ur5e")
    T = fk(chain, HOME)
    far = T.copy()
    far[0, 3] += 2.0
    with pytest.raises(MotionError, match="must reach its end to be timed; it breaks: at"):
        time_path(follow_path(chain, line(T, far), step=0.05))
    with pytest.raises(MotionError, match="waypoint 1: joint 'elbow_joint' at 4 rad is outside its limits"):
        time_waypoints(chain, [HOME, [0, 0, 4.0, 0, 0, 0]])
    with pytest.raises(ArrayError, match="max_jerk must be above 0"):
        time_waypoints(chain, [HOME, HOME + 1], max_jerk=0.0)
    with pytest.raises(ArrayError, match="max_velocity must be finite"):
        time_waypoints(chain, [HOME, HOME + 1], max_velocity=np.inf)
    with pytest.raises(ArrayError, match="limit velocity of the tip must be above 0"):
        TcpLimits(velocity=float("nan"))


def test_a_slow_tip_takes_long_and_few_points():
    chain = robots.chain("ur5e")
    q = [0.3, -1.2, 1.4, -1.7, -1.5, 0.3]
    T = fk(chain, q)
    T_goal = T.copy()
    T_goal[1, 3] -= 0.1
    way = follow_path(chain, line(T, T_goal), q_start=q, step=0.02)
    slow = TcpLimits(velocity=1e-6)
    move = time_path(way, tcp=slow)
    assert 1e5 < move.duration < 2e5
    assert len(move.t) < 20_000  # not one every 0.01 s
    assert max(usage(move, JointLimits.of(chain), slow)) <= HELD
    with pytest.raises(MotionError, match=r"would take .* s, more than 1e\+07 s: a limit of the joints or of the tip"):
        time_path(way, tcp=TcpLimits(velocity=1e-12))


def test_a_motion_that_cannot_be_made_to_hold_its_limits_is_refused(monkeypatch):
    chain = robots.chain("ur5e")
    quick = Trajectory([0.0, 0.1], [np.zeros(6), np.ones(6)], np.zeros((2, 6)), np.zeros((2, 6)))
    limits = JointLimits.of(chain)
    assert max(usage(_retiming.held(quick, limits, None), limits)) <= HELD
    monkeypatch.setattr(_retiming, "_TRIALS", 0)
    with pytest.raises(MotionError, match="a limit is so small that rounding exceeds it: raise the smallest"):
        _retiming.held(quick, limits, None)


@pytest.mark.parametrize("limit", ["max_jerk", "max_acceleration"])
def test_a_limit_that_is_as_good_as_none_makes_no_motion_slower(limit):
    chain = robots.chain("ur5e")
    q = np.array([0.3, -1.2, 1.4, -1.7, -1.5, 0.3])
    T = fk(chain, q)
    T_goal = T.copy()
    T_goal[:2, 3] += [0.1, -0.2]
    way = follow_path(chain, line(T, T_goal), q_start=q)
    for make in (lambda **most: time_path(way, **most), lambda **most: time_waypoints(chain, [q, q + 0.1], **most)):
        before = make(**{limit: 1e3}).duration
        for most in (1e4, 1e6, 1e9, 1e12):
            move = make(**{limit: most})
            assert move.duration <= before + 0.01, most
            assert max(usage(move, JointLimits.of(chain, **{limit: most}))) <= HELD


@pytest.mark.parametrize("value", [None, "fast", np.nan, -1.0, [1.0, 2.0]])
def test_a_limit_of_the_tip_that_is_no_number_above_zero_is_refused(value):
    with pytest.raises(ArrayError, match="the limit velocity of the tip must be above 0, got"):
        TcpLimits(velocity=value)


def test_a_missing_ruckig_is_named(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "ruckig", None)
    with pytest.raises(MissingExtraError, match=r"ruckig is not installed; .* pip install 'pieper\[plan\]'"):
        time_waypoints(robots.chain("ur5e"), [HOME, HOME + 0.1])


def test_no_code_names_the_way_points_that_ruckig_sends_away():
    # with these set, Ruckig asks a server in the network
    for file in Path(pieper.__file__).parent.rglob("*.py"):
        text = file.read_text(encoding="utf-8")
        for word in ("intermediate_positions", "per_section_", "filter_intermediate", "max_number_of_waypoints"):
            assert word not in text, f"{file} names {word}"
        assert "ruckig" not in text or not re.search(r"setattr\(|__setattr__|vars\(|exec\(|eval\(", text), (
            f"{file} knows Ruckig and sets attributes by names that cannot be read here"
        )


def test_ruckig_is_asked_from_state_to_state_only(monkeypatch):
    asked = []

    class Watched(ruckig.Ruckig):
        def __init__(self, *arguments):
            assert len(arguments) <= 2  # a third one would be a number of way points
            super().__init__(*arguments)

        def calculate(self, question, answer):
            assert not question.intermediate_positions
            asked.append(question)
            return super().calculate(question, answer)

    monkeypatch.setattr(ruckig, "Ruckig", Watched)
    chain = robots.chain("ur5e")
    time_waypoints(chain, [HOME, HOME + 0.2, HOME - 0.1])
    time_path(follow_path(chain, pathology(chain)["rounded"], q_start=HOME, step=0.02))
    assert len(asked) > 3


def test_no_motion_is_planned_over_the_network(monkeypatch):
    """Nothing is sent: with every socket refused in Python, and Ruckig's own client failing if it were asked, motions come out."""
    import socket

    def refused(*arguments, **named):
        raise AssertionError("a motion opened a socket")

    for name in ("socket", "create_connection", "getaddrinfo", "socketpair"):
        monkeypatch.setattr(socket, name, refused)
    chain = robots.chain("ur5e")
    assert time_waypoints(chain, [HOME, HOME + 0.2, HOME - 0.1], tcp=TcpLimits(0.3)).duration > 0.0
    assert time_path(follow_path(chain, pathology(chain)["corner"], q_start=HOME, step=0.02)).duration > 0.0


@pytest.mark.skipif(
    __import__("sys").platform != "linux", reason="threads and sockets of the process are read from /proc"
)
def test_ruckig_opens_no_socket_of_its_own():
    """Ruckig is compiled, so what Python refuses does not bind it: the system is asked which sockets the process has opened and when."""
    import subprocess
    import sys

    code = """
import os, resource
import numpy as np
from pieper.model import catalog
from pieper.motion.timing import time_waypoints
chain = catalog.describe("ur5e").chain()
q = np.array([0.3, -1.2, 1.4, -1.7, -1.5, 0.3])
time_waypoints(chain, [q, q + 0.1])  # everything is loaded
held = os.listdir("/proc/self/fd")
resource.setrlimit(resource.RLIMIT_NOFILE, (len(held) - 1, len(held) - 1))  # from here on nothing can be opened
assert time_waypoints(chain, [q, q + 0.2, q - 0.1]).duration > 0.0
try:
    __import__("socket").socket()
except OSError as error:
    print("no socket could be opened:", error)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "no socket could be opened" in done.stdout
    assert "cloud" not in (done.stdout + done.stderr).lower()


def test_trajectories_go_to_files_and_messages_and_any_rate(tmp_path):
    chain = robots.chain("ur5e")
    move = time_waypoints(chain, [HOME, HOME + 0.2], **LIMITS)
    for suffix in files.FORMATS:
        files.write(move, tmp_path / f"move{suffix}")
        again = files.read(tmp_path / f"move{suffix}")
        np.testing.assert_array_equal(again.q, move.q)
        np.testing.assert_array_equal(again.ddq, move.ddq)
    even = move.at_rate(500.0)
    assert np.diff(even.t)[:-1] == pytest.approx(0.002)
    assert even.t[-1] == move.t[-1]
    np.testing.assert_allclose(even.sample(even.t).q, move.sample(even.t).q, atol=1e-12)
    message = json.loads(json.dumps(even.as_message()))
    assert message["joint_names"] == list(chain.joint_names)
    last = message["points"][-1]
    time = last["time_from_start"]["sec"] + 1e-9 * last["time_from_start"]["nanosec"]
    assert time == pytest.approx(move.duration, abs=1e-9)
    assert last["positions"] == move.q[-1].tolist()
    with pytest.raises(ArrayError, match="rate must be above 0"):
        move.at_rate(0.0)
