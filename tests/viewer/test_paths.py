"""Motions that are played, without a browser."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pieper
from pieper.errors import ArrayError, UnknownNameError
from pieper.ik.iteration import iterate
from pieper.motion.joint_move import joint_move
from pieper.motion.trajectory import Trajectory
from pieper.viewer.paths import Player, Track, straightness

GOLDEN = Path(__file__).parents[1] / "golden"
Q_START = [-1.28, 4.41, 1.54, -1.16, -1.56, 0.0]
arm = pieper.load("ur5e")


def steps(k1):
    return list(iterate(arm.chain, [0.5, -0.6, 0.2], Q_START, orientation="hold", k1=k1, position_stop=1e-3))


@pytest.mark.parametrize(("k1", "count", "off"), [(1.0, 4, 0.327), (0.1, 61, 0.0101)])
def test_row_e7_the_path_of_an_iteration_and_how_straight_it_is(k1, count, off):
    """Row E7: with k1=0.1 the path stays within 0.0101 m of the straight line, with k1=1 it strays by 0.327 m."""
    track = Track.from_steps(arm, steps(k1))
    assert len(track.times) == count + 1
    assert track.straightness == pytest.approx(off, rel=5e-3)
    assert track.summary.startswith(f"{count} steps; the tip goes ")


def test_row_e6_the_trace_is_that_of_the_reference():
    """Rows E4 to E6: the tip after each step, as computed elsewhere."""
    with (GOLDEN / "ur5e_path_k1_0.1.csv").open() as file:
        rows = list(csv.reader(line for line in file if not line.startswith("#")))
    expected = np.array([[float(value) for value in row[1:4]] for row in rows if row[0].isdigit()])
    track = Track.from_steps(arm, steps(0.1))
    tips = track.tips(track.times)
    assert len(expected) >= 61
    np.testing.assert_allclose(tips[: len(expected)], expected, atol=1e-9)


def test_steps_are_met_in_time_and_joints_go_straight_between():
    made = steps(0.1)
    track = Track.from_steps(arm, made, seconds=0.5)
    np.testing.assert_allclose(track.at(0.5 * 7), made[7].q, atol=1e-12)
    np.testing.assert_allclose(track.at(0.5 * 7.5), 0.5 * (made[7].q + made[8].q), atol=1e-12)
    assert track.duration == pytest.approx(30.5)
    plot = track.error_plot()
    np.testing.assert_allclose(plot.y[0], [step.norm for step in made])


def test_a_trajectory_that_begins_late_is_played_from_its_beginning():
    move = Trajectory([5.0, 6.0, 8.0], [[0.0] * 6, [0.1] * 6, [0.5] * 6])
    track = Track.of(arm, move)
    assert track.duration == 3.0
    np.testing.assert_allclose(track.at(2.0), np.full(6, 0.3))
    np.testing.assert_allclose(track.at(-1.0), np.zeros(6))
    np.testing.assert_allclose(track.at(9.0), np.full(6, 0.5))
    assert track.error_plot() is None


def test_columns_go_to_their_joints():
    names = tuple(reversed(arm.joint_names))
    track = Track.of(arm, Trajectory([0.0], [[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]], joint_names=names))
    np.testing.assert_array_equal(track.at(0.0), [6.0, 5.0, 4.0, 3.0, 2.0, 1.0])
    with pytest.raises(UnknownNameError, match="no joint 'wing'"):
        Track.of(arm, Trajectory([0.0], [[1.0] * 6], joint_names=("wing", *names[1:])))
    with pytest.raises(ArrayError, match="must have 6 columns"):
        Track.of(arm, Trajectory([0.0], [[1.0] * 5]))
    with pytest.raises(ArrayError, match="at least one step"):
        Track.from_steps(arm, [])
    with pytest.raises(ArrayError, match="seconds must be a positive time"):
        Track.from_steps(arm, steps(1.0), seconds=0.0)


def test_plots_have_the_values_of_the_motion():
    move = joint_move(arm.chain, [0.0, -1.0, 1.0, 0.0, 0.0, 0.0], [1.0, -1.5, 0.5, 0.3, 0.2, 2.0])
    track = Track.of(arm, move)
    joints, tip = track.joint_plot(), track.tip_plot()
    assert joints.names == arm.joint_names
    assert joints.y_label == "deg"
    assert tip.names == ("x", "y", "z")
    k = len(joints.x) // 3
    q = track.at(float(joints.x[k]))
    np.testing.assert_allclose(np.radians(joints.y[:, k]), q, atol=1e-12)
    np.testing.assert_allclose(tip.y[:, k], arm.fk(q)[:3, 3], atol=1e-12)
    assert joints.x[-1] == pytest.approx(track.duration)


def test_points_of_long_trajectories_are_thinned_out():
    t = np.linspace(0.0, 10.0, 100_000)
    track = Track.of(arm, Trajectory(t, np.sin(t)[:, None] * np.ones(6)))
    assert len(track.times) < 1000
    assert len(track.joint_plot().x) <= 300


def player(*durations, **options):
    made = [Track.of(arm, Trajectory([0.0, d], [[0.0] * 6, [d] * 6])) for d in durations]
    return Player(made, **options)


def test_several_at_once_keep_one_clock_and_the_shorter_waits():
    both = player(1.0, 3.0)
    assert both.duration == 3.0
    both.seek(2.0)
    short, long = both.poses()
    np.testing.assert_allclose(short, np.ones(6))
    np.testing.assert_allclose(long, np.full(6, 2.0))


def test_play_pause_seek_and_the_end():
    one = player(2.0, loop=False, speed=0.5)
    assert one.advance(1.0) == 0.0  # it does not run yet
    one.play()
    assert one.advance(1.0) == 0.5
    one.pause()
    assert one.advance(1.0) == 0.5
    assert one.seek(1.9) == 1.9
    assert one.seek(7.0) == 2.0
    assert one.seek(-1.0) == 0.0
    assert one.seek(float("nan")) == 0.0
    one.seek(1.9)
    one.play()
    assert one.advance(1.0) == 2.0
    assert not one.playing
    one.play()
    assert one.time == 0.0
    assert one.playing
    with pytest.raises(ArrayError, match="speed must be a positive number"):
        one.speed = float("nan")


def test_a_motion_of_one_point_and_no_motion_at_all_rest():
    for still in (Player([]), Player([Track.of(arm, Trajectory([0.0], [[0.0] * 6]))])):
        still.play()
        assert still.duration == 0.0
        assert not still.playing
        assert still.advance(1.0) == 0.0
    assert Track.of(arm, Trajectory([0.0], [[0.0] * 6])).straightness == 0.0


@given(st.lists(st.floats(allow_nan=True, min_value=None), max_size=20), st.booleans())
def test_the_clock_never_leaves_the_motion(times, loop):
    one = player(2.0, loop=loop)
    one.play()
    for time in times:
        one.advance(abs(time))
        assert 0.0 <= one.time <= 2.0


def test_straightness_of_a_bend():
    assert straightness(np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [1.0, 0.0, 0.0]])) == 1.0  # beyond the end counts
    assert straightness(np.array([[0.0, 0.0, 0.0], [0.0, 3.0, 4.0], [0.0, 0.0, 0.0]])) == 5.0  # there and back
