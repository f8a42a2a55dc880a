"""Cartesian paths: their shape, their length, and what cannot be one."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pieper.errors import ArrayError, MotionError
from pieper.motion import path as paths
from pieper.spatial import pose, rotation

DIFFERENCE = 1e-5  # [m] step of the differences by which speeds are measured
SPEED_OFF = 1e-6  # of a central difference over 2e-5 m: its own error, and 1e-7 of the tables
TURN_OFF = 1e-7  # [rad] an angle from a rotation matrix near the identity has half the digits

seeds = st.integers(0, 10_000)


def random_poses(seed: int, count: int, turn: float = 0.8) -> np.ndarray:
    rng = np.random.default_rng(seed)
    T = pose.from_xyz_rpy(rng.uniform(-0.5, 0.5, (count, 3)), np.zeros((count, 3)))
    T[:, :3, :3] = rotation.from_rotation_vector(rng.uniform(-turn, turn, (count, 3)))
    return T


def some_paths(seed: int) -> list[paths.CartesianPath]:
    A, B, C, D = random_poses(seed, 4)
    about = paths.arc_about(A, B[:3, 3], C[:3, 3], 4.0)
    legs = [paths.line(A, B), paths.line(B, C), paths.arc_through(C, C[:3, 3] + [0.1, 0.2, 0.3], D)]
    return [*legs, about, paths.spline([A, B, C, D]), paths.join(legs, blend=0.04)]


@settings(max_examples=15)
@given(seeds)
def test_the_tip_moves_at_unit_speed_in_the_measure_of_the_length(seed):
    for path in some_paths(seed):
        s = np.linspace(DIFFERENCE, path.length - DIFFERENCE, 97)
        away = np.abs(s[:, None] - np.append(path.bounds, -1.0)).min(axis=1) > 2 * DIFFERENCE
        a, b = path.at(s[away] - DIFFERENCE), path.at(s[away] + DIFFERENCE)
        metres = np.linalg.norm(b[:, :3, 3] - a[:, :3, 3], axis=1)
        turned = rotation.as_rotation_vector(np.swapaxes(a[:, :3, :3], 1, 2) @ b[:, :3, :3])
        speed = np.hypot(metres, path.radius * np.linalg.norm(turned, axis=1)) / (2 * DIFFERENCE)
        np.testing.assert_allclose(speed, 1.0, rtol=0, atol=20 * SPEED_OFF)


@settings(max_examples=15)
@given(seeds)
def test_paths_begin_and_end_where_they_were_told_to(seed):
    A, B, C, D = random_poses(seed, 4)
    for path, ends in (
        (paths.line(A, B), (A, B)),
        (paths.arc_through(A, B[:3, 3], C), (A, C)),
        (paths.spline([A, B, C, D]), (A, D)),
        (paths.join([paths.line(A, B), paths.line(B, C)], blend=0.05), (A, C)),
    ):
        for found, wanted in zip((path.start, path.end), ends, strict=True):
            np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12)


@settings(max_examples=15)
@given(seeds)
def test_an_arc_lies_on_the_circle_through_its_three_points(seed):
    A, B, C = random_poses(seed, 3)
    path = paths.arc_through(A, B[:3, 3], C)
    p = path.at(np.linspace(0, path.length, 2001))[:, :3, 3]
    assert np.linalg.norm(p - B[:3, 3], axis=1).min() < path.length / 1000  # passes the point between
    # the circle by least squares: |p|^2 = 2 p c + k in its plane
    plane = np.linalg.svd(p - p.mean(axis=0))[2][:2]
    flat = (p - p.mean(axis=0)) @ plane.T
    c = np.linalg.lstsq(np.column_stack([2 * flat, np.ones(len(flat))]), (flat**2).sum(axis=1), rcond=None)[0]
    size = np.linalg.norm(flat - c[:2], axis=1)
    np.testing.assert_allclose(size, size.mean(), rtol=1e-9)


def test_slerp_on_a_line_is_that_of_scipy():
    from scipy.spatial.transform import Rotation, Slerp

    A, B = random_poses(3, 2)
    path = paths.line(A, B)
    share = np.linspace(0, 1, 11)
    expected = Slerp([0, 1], Rotation.from_matrix([A[:3, :3], B[:3, :3]]))(share).as_matrix()
    np.testing.assert_allclose(path.at(share * path.length)[:, :3, :3], expected, rtol=0, atol=1e-14)


@settings(max_examples=5)
@given(seeds)
def test_a_spline_passes_its_poses_without_jumps_of_acceleration(seed):
    Ts = random_poses(seed, 5)
    path = paths.spline(Ts)
    assert path.corners.size == 0
    piece = path.pieces[0]
    places = piece.lengths[:: len(piece.lengths) // (len(Ts) - 1)]
    np.testing.assert_allclose(path.at(places), Ts, rtol=0, atol=1e-12)
    h = 1e-5 * path.length
    for s in places[1:-1]:
        ahead, behind = piece.twists(s + h * np.arange(3.0)), piece.twists(s - h * np.arange(3.0))
        after, before = (np.array([-1.5, 2.0, -0.5]) @ values / h for values in (ahead, -behind))
        np.testing.assert_allclose(after, before, rtol=0, atol=1e-3 * (1.0 + np.abs(after).max()))


def test_a_full_circle_carries_or_keeps_the_orientation():
    T = pose.from_xyz_rpy([0.4, 0.0, 0.3], [0.1, 0.2, 0.3])
    carried = paths.arc_about(T, [0.0, 0.0, 0.0], [0, 0, 2.0], 2 * np.pi)
    fixed = paths.arc_about(T, [0.0, 0.0, 0.0], [0, 0, 2.0], 2 * np.pi, orientation="fixed")
    np.testing.assert_allclose(carried.end, T, atol=1e-12)
    half = carried.at(carried.length / 2)
    np.testing.assert_allclose(half, pose.from_xyz_rpy([0, 0, 0], [0, 0, np.pi]) @ T, atol=1e-12)
    np.testing.assert_allclose(fixed.at(fixed.length / 2)[:3, :3], T[:3, :3], atol=1e-15)
    back = paths.arc_about(T, [0.0, 0.0, 0.0], [0, 0, 1.0], -1.0)
    np.testing.assert_allclose(back.end, pose.from_xyz_rpy([0, 0, 0], [0, 0, -1.0]) @ T, atol=1e-12)


def test_corners_are_where_direction_or_curvature_jump():
    A, B, C = (pose.from_xyz_rpy(p, [0, 0, 0]) for p in ([0, 0, 0.0], [0.3, 0, 0], [0.3, 0.3, 0]))
    cornered = paths.join([paths.line(A, B), paths.line(B, C)])
    np.testing.assert_allclose(cornered.corners, [0.3])
    straight_on = paths.join([paths.line(A, B), paths.line(B, pose.from_xyz_rpy([0.6, 0, 0], [0, 0, 0]))])
    assert straight_on.corners.size == 0
    into_a_circle = paths.join(
        [paths.line(A, B), paths.arc_about(B, [0.3, 0.2, 0], [0, 0, 1], 1.0, orientation="fixed")]
    )
    np.testing.assert_allclose(into_a_circle.corners, [0.3])
    s, _ = cornered.sample(count=10)
    assert 0.3 in s.round(12)


def test_a_rounding_stays_in_the_triangle_of_its_corner():
    A, B, C = (
        pose.from_xyz_rpy(p, r)
        for p, r in (([0, 0, 0.0], [0, 0, 0]), ([0.3, 0, 0], [0, 0, 0.5]), ([0.3, 0.3, 0], [0.4, 0, 0.5]))
    )
    rounded = paths.join([paths.line(A, B), paths.line(B, C)], blend=0.05)
    assert rounded.corners.size == 0
    p = rounded.at(np.linspace(0, rounded.length, 500))[:, :3, 3]
    assert (p[:, 0] <= 0.3 + 1e-12).all()
    assert (p[:, 1] >= -1e-12).all()
    assert 1e-3 < np.linalg.norm(p - B[:3, 3], axis=1).min() < 0.05
    # twists against differences of poses, orientation included
    piece = rounded.pieces[1]
    places = np.linspace(0.1, 0.9, 9) * piece.length
    ahead, behind = piece.poses(places + 1e-6), piece.poses(places - 1e-6)
    turned = rotation.as_rotation_vector(ahead[:, :3, :3] @ np.swapaxes(behind[:, :3, :3], 1, 2)) / 2e-6
    np.testing.assert_allclose(piece.twists(places)[:, 3:], turned, atol=1e-6)


def test_a_path_of_no_length_is_one_pose():
    T = pose.from_xyz_rpy([0.1, 0.2, 0.3], [0.1, 0, 0])
    path = paths.line(T, T)
    assert path.length == 0.0
    s, Ts = path.sample(count=50)
    assert s.shape == (1,)
    np.testing.assert_array_equal(Ts[0], T)
    joined = paths.join([path, paths.line(T, pose.from_xyz_rpy([0.2, 0.2, 0.3], [0.1, 0, 0]))])
    assert len(joined.pieces) == 1


def test_what_is_no_path_is_refused_in_words():
    here = np.eye(4)
    half = pose.from_xyz_rpy([0.1, 0, 0], [np.pi, 0, 0])
    with pytest.raises(MotionError, match=r"half a turn apart .* put a pose between"):
        paths.line(here, half)
    with pytest.raises(MotionError, match="poses 1 and 2 of the spline are the same"):
        paths.spline(
            [here, pose.from_xyz_rpy([0.1, 0, 0], [0, 0, 0])] + 2 * [pose.from_xyz_rpy([0.1, 0, 0], [0, 0, 0])]
        )
    with pytest.raises(MotionError, match=r"not on one line.*use line, or arc_about"):
        paths.arc_through(here, [0.1, 0, 0], pose.from_xyz_rpy([0.2, 0, 0], [0, 0, 0]))
    with pytest.raises(MotionError, match=r"path 1 must begin where path 0 ends; they are 0.2 m"):
        paths.join(
            [paths.line(here, half @ half), paths.line(half @ half @ pose.from_xyz_rpy([0.2, 0, 0], [0, 0, 0]), here)]
        )
    with pytest.raises(ArrayError, match="axis must not be zero"):
        paths.arc_about(here, [1, 0, 0], [0, 0, 0], 1.0)
    with pytest.raises(ArrayError, match="must be finite"):
        paths.line(here, np.full((4, 4), np.nan))
    with pytest.raises(ArrayError, match="radius must be above 0"):
        paths.line(here, here, radius=0.0)
    with pytest.raises(ArrayError, match=r"from 0 to 0\.1 m along the path, got 0.2"):
        paths.line(here, pose.from_xyz_rpy([0.1, 0, 0], [0, 0, 0])).at(0.2)
    with pytest.raises(ArrayError, match="a count or a step"):
        paths.line(here, here).sample(count=3, step=0.1)


@pytest.mark.parametrize("how", [{"step": 1e-9}, {"count": 10**9}])
def test_more_poses_than_memory_holds_are_refused_by_name(how):
    T_goal = np.eye(4)
    T_goal[0, 3] = 1.0
    with pytest.raises(ArrayError, match="would be more than 1000000 poses; take a step of 1e-06 m or more"):
        paths.line(np.eye(4), T_goal).sample(**how)


def test_every_path_goes_to_another_process_and_back():
    for path in some_paths(3):
        copy = pickle.loads(pickle.dumps(path))
        s = np.linspace(0.0, path.length, 9)
        np.testing.assert_array_equal(copy.at(s), path.at(s))
        np.testing.assert_array_equal(copy.corners, path.corners)
