"""Poses: parts, inverse, distance, interpolation, repair."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from pieper.errors import ArrayError
from pieper.spatial import pose, rotation, twist

ROUNDING = 4e-15  # a handful of double roundings on numbers of size 1 to 3


def poses(seed: int, shape: tuple[int, ...] = (20,)) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return pose.from_position_rotation(
        rng.normal(size=(*shape, 3)), rotation.from_quaternion(rng.normal(size=(*shape, 4)))
    )


def test_parts_come_back_as_copies() -> None:
    T = poses(1)
    np.testing.assert_array_equal(pose.from_position_rotation(pose.position(T), pose.rotation(T)), T)
    before = T.copy()
    pose.position(T)[...] = 7.0
    pose.rotation(T)[...] = 7.0
    np.testing.assert_array_equal(T, before)


def test_from_xyz_rpy_is_what_urdf_means() -> None:
    T = pose.from_xyz_rpy([1.0, 2.0, 3.0], [0.1, 0.2, 0.3])
    np.testing.assert_allclose(T[:3, :3], Rotation.from_euler("xyz", [0.1, 0.2, 0.3]).as_matrix(), rtol=0, atol=1e-15)
    np.testing.assert_array_equal(T[:, 3], [1.0, 2.0, 3.0, 1.0])


def test_inverse() -> None:
    T = poses(2)
    np.testing.assert_allclose(T @ pose.inverse(T), np.broadcast_to(np.eye(4), T.shape), rtol=0, atol=ROUNDING)
    np.testing.assert_array_equal(pose.inverse(T)[:, 3], np.broadcast_to([0, 0, 0, 1.0], (20, 4)))
    np.testing.assert_allclose(pose.inverse(T), np.linalg.inv(T), rtol=0, atol=ROUNDING)


def test_transform_moves_points() -> None:
    T, p = poses(3), np.random.default_rng(3).normal(size=(20, 3))
    expected = np.einsum("nij,nj->ni", T, np.hstack([p, np.ones((20, 1))]))[:, :3]
    np.testing.assert_allclose(pose.transform(T, p), expected, rtol=0, atol=ROUNDING)
    assert pose.transform(T[0], np.zeros((5, 7, 3))).shape == (5, 7, 3)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-6, 1.0, np.pi - 1e-9, np.pi])
def test_distance_gives_metres_and_radians_apart(angle: float) -> None:
    T = poses(4)
    moved = pose.from_position_rotation(
        pose.position(T) + np.array([0.0, 0.03, 0.04]),
        pose.rotation(T) @ rotation.from_axis_angle([1.0, 1.0, -2.0], angle),
    )
    metres, radians = pose.distance(T, moved)
    np.testing.assert_allclose(metres, 0.05, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(radians, angle, rtol=0, atol=ROUNDING)
    assert all(x.max() < ROUNDING for x in pose.distance(T, T))


def test_screw_motion_has_a_constant_twist() -> None:
    start, end = poses(5), poses(6)
    s = np.linspace(0.0, 1.0, 11)[:, None]
    way = pose.interpolate(start, end, fraction=s)
    assert way.shape == (11, 20, 4, 4)
    np.testing.assert_allclose(way[0], start, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(way[-1], end, rtol=0, atol=4 * ROUNDING)
    steps = twist.log(pose.inverse(way[:-1]) @ way[1:])
    np.testing.assert_allclose(steps, np.broadcast_to(steps[0], steps.shape), rtol=0, atol=1e-13)


def test_straight_motion_is_a_line_and_a_slerp() -> None:
    start, end = poses(7, ()), poses(8, ())
    s = np.linspace(0.0, 1.0, 11)
    way = pose.interpolate(start, end, fraction=s, motion="straight")
    line = start[:3, 3] + s[:, None] * (end[:3, 3] - start[:3, 3])
    np.testing.assert_allclose(way[:, :3, 3], line, rtol=0, atol=ROUNDING)
    slerp = Slerp([0.0, 1.0], Rotation.from_matrix([start[:3, :3], end[:3, :3]]))
    np.testing.assert_allclose(way[:, :3, :3], slerp(s).as_matrix(), rtol=0, atol=ROUNDING)
    screw = pose.interpolate(start, end, fraction=s)
    np.testing.assert_allclose(way[:, :3, :3], screw[:, :3, :3], rtol=0, atol=ROUNDING)


@pytest.mark.parametrize("motion", ["screw", "straight"])
def test_interpolation_at_180_degrees_and_at_no_motion(motion: str) -> None:
    end = pose.from_position_rotation([1.0, 2.0, 3.0], np.diag([-1.0, -1.0, 1.0]))
    way = pose.interpolate(np.eye(4), end, fraction=[0.0, 0.5, 1.0], motion=motion)
    np.testing.assert_allclose(way[[0, 2]], [np.eye(4), end], rtol=0, atol=ROUNDING)
    assert abs(rotation.angle(way[1, :3, :3]) - np.pi / 2) < ROUNDING
    still = pose.interpolate(end, end, fraction=0.3, motion=motion)
    np.testing.assert_allclose(still, end, rtol=0, atol=ROUNDING)


def test_repair_on_request_only() -> None:
    T = np.round(poses(9, ()), 5)
    with pytest.raises(ArrayError, match=r"deviates from the identity by \d\.\d+e-0\d .*repair it with pose.nearest"):
        pose.inverse(T)
    repaired = pose.nearest(T)
    np.testing.assert_array_equal(repaired[:3, 3], T[:3, 3])
    assert rotation.deviation(repaired[:3, :3]) < ROUNDING
    assert pose.distance(repaired, poses(9, ()))[1] < 2e-5


@pytest.mark.parametrize("batch", [(), (1,), (3, 1, 2), (0,)], ids=str)
def test_batch_shapes(batch: tuple[int, ...]) -> None:
    T = poses(10, batch)
    assert T.shape == (*batch, 4, 4)
    assert pose.inverse(T).shape == (*batch, 4, 4)
    assert pose.nearest(T).shape == (*batch, 4, 4)
    assert pose.position(T).shape == (*batch, 3)
    assert pose.rotation(T).shape == (*batch, 3, 3)
    assert all(x.shape == batch for x in pose.distance(T, np.eye(4)))
    for motion in ("screw", "straight"):
        assert pose.interpolate(T, np.eye(4), fraction=0.5, motion=motion).shape == (*batch, 4, 4)
    assert pose.from_xyz_rpy(np.zeros((*batch, 3)), [0, 0, 0]).shape == (*batch, 4, 4)


def test_malformed_input_is_refused() -> None:
    with pytest.raises(ArrayError, match="motion must be 'screw' or 'straight', got 'arc'"):
        pose.interpolate(np.eye(4), np.eye(4), fraction=0.5, motion="arc")
    with pytest.raises(ArrayError, match=r"must broadcast, got shapes \(2,\), \(\) and \(3,\)"):
        pose.interpolate(np.stack([np.eye(4)] * 2), np.eye(4), fraction=[0.1, 0.2, 0.3])
    with pytest.raises(ArrayError, match=r"p and R must broadcast, got shapes \(2,\) and \(3,\)"):
        pose.from_position_rotation(np.zeros((2, 3)), np.stack([np.eye(3)] * 3))
    with pytest.raises(ArrayError, match=r"fraction must be finite, got nan"):
        pose.interpolate(np.eye(4), np.eye(4), fraction=np.nan)
    with pytest.raises(ArrayError, match=r"p must have shape \(\.\.\., 3\), got \(2,\)"):
        pose.transform(np.eye(4), [1.0, 2.0])


def test_shapes_that_do_not_fit_together_are_named() -> None:
    two, three = np.broadcast_to(np.eye(4), (2, 4, 4)), np.broadcast_to(np.eye(4), (3, 4, 4))
    with pytest.raises(ArrayError, match=r"leading axes of T and p must broadcast, got shapes \(2,\) and \(3,\)"):
        pose.transform(two, np.zeros((3, 3)))
    with pytest.raises(ArrayError, match=r"leading axes of T and other must broadcast, got shapes \(2,\) and \(3,\)"):
        pose.distance(two, three)
    with pytest.raises(ArrayError, match=r"leading axes of R and other must broadcast, got shapes \(2,\) and \(3,\)"):
        rotation.distance(two[:, :3, :3], three[:, :3, :3])
