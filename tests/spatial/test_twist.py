"""exp, log and adjoint of SE(3) against mpmath's matrix exponential; the group laws are in tests/laws."""

import subprocess
import sys

import mpmath
import numpy as np
import pytest
import scipy.linalg

from pieper.errors import ArrayError
from pieper.spatial import pose, rotation, twist
from pieper.spatial.quaternion import quaternion_from_matrix

ROUNDING = 4e-15  # a handful of double roundings on numbers of size 1 to 3
MAGNITUDES = (0.0, 1e-300, 1e-160, 1e-12, 1e-8, 1e-4, 0.1, 0.4999, 0.5, 0.5001, 1.0, 3.0)
NEAR_PI = (1e-3, 1e-6, 1e-9, 1e-12, 1e-15)


def twists(seed: int, angle: float, count: int = 12) -> np.ndarray:
    rng = np.random.default_rng(seed)
    w = rng.normal(size=(count, 3))
    w *= angle / np.linalg.norm(w, axis=-1, keepdims=True)
    return np.hstack([rng.normal(size=(count, 3)), w])


def mp_exp(xi: np.ndarray) -> np.ndarray:
    with mpmath.workdps(50):
        X = mpmath.matrix(4, 4)
        for i, row in enumerate(twist.hat(xi)):
            for j, value in enumerate(row):
                X[i, j] = mpmath.mpf(float(value))
        T = mpmath.expm(X, method="taylor")
        return np.array([[float(T[i, j]) for j in range(4)] for i in range(4)])


@pytest.mark.parametrize("angle", [*MAGNITUDES, *(np.pi - b for b in NEAR_PI), np.pi, 4.0, 2 * np.pi])
def test_exp_is_the_matrix_exponential(angle: float) -> None:
    for xi in twists(1, angle):
        np.testing.assert_allclose(twist.exp(xi), mp_exp(xi), rtol=0, atol=ROUNDING)


def test_exp_of_a_tiny_turn_keeps_it_to_the_last_digit() -> None:
    for angle in (1e-300, 1e-160, 1e-12, 1e-8):
        xi = twists(2, angle)
        T = twist.exp(xi)
        np.testing.assert_allclose(twist.log(T)[:, 3:], xi[:, 3:], rtol=1e-15)


@pytest.mark.parametrize("angle", MAGNITUDES)
def test_log_undoes_exp_near_zero(angle: float) -> None:
    xi = twists(3, angle)
    np.testing.assert_allclose(twist.log(twist.exp(xi)), xi, rtol=0, atol=2 * ROUNDING)


@pytest.mark.parametrize("below", NEAR_PI)
def test_log_undoes_exp_near_180_degrees(below: float) -> None:
    xi = twists(4, np.pi - below)
    back = twist.log(twist.exp(xi))
    np.testing.assert_allclose(twist.exp(back), twist.exp(xi), rtol=0, atol=ROUNDING)
    if below > 1e-14:  # nearer, the matrix no longer tells on which side of 180 degrees it is
        np.testing.assert_allclose(back, xi, rtol=0, atol=2 * ROUNDING)


def test_log_at_exactly_180_degrees() -> None:
    rng = np.random.default_rng(5)
    a = rng.normal(size=(100, 3))
    a = np.vstack([np.eye(3), a / np.linalg.norm(a, axis=-1, keepdims=True)])
    T = np.tile(np.eye(4), (len(a), 1, 1))
    T[:, :3, :3] = 2.0 * a[:, :, None] * a[:, None, :] - np.eye(3)
    T[:, :3, 3] = rng.normal(size=(len(a), 3))
    xi = twist.log(T)
    np.testing.assert_allclose(np.linalg.norm(xi[:, 3:], axis=-1), np.pi, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(twist.exp(xi), T, rtol=0, atol=ROUNDING)
    np.testing.assert_array_equal(xi[:3, 3:], np.eye(3) * np.pi)


def test_log_agrees_with_scipy() -> None:
    for xi in twists(6, 2.0):
        np.testing.assert_allclose(twist.hat(xi), scipy.linalg.logm(twist.exp(xi)).real, rtol=0, atol=1e-13)
    w = twists(6, 3.1)[:, 3:]
    np.testing.assert_allclose(
        rotation.as_rotation_vector(twist.exp(np.hstack([w, w]))[:, :3, :3]), w, rtol=0, atol=ROUNDING
    )


def test_no_finite_angle_overflows() -> None:
    for angle in (1e8, 1e154, 1.7e308):
        T = twist.exp([1.0, 2.0, 3.0, angle, -angle, angle])
        assert rotation.deviation(T[:3, :3]) < ROUNDING
        np.testing.assert_allclose(
            T[:3, :3], rotation.from_rotation_vector([angle, -angle, angle]), rtol=0, atol=ROUNDING
        )
        assert np.linalg.norm(T[:3, 3]) < 4.0


def test_a_prismatic_joint_and_a_revolute_joint() -> None:
    slide = twist.exp([0.0, 0.3, 0.0, 0.0, 0.0, 0.0])
    np.testing.assert_array_equal(slide[:3, 3], [0.0, 0.3, 0.0])
    np.testing.assert_array_equal(slide[:3, :3], np.eye(3))
    point = np.array([1.0, 2.0, 0.0])  # a turn leaves the points of its axis where they are
    axis = np.array([0.0, 0.0, 1.0])
    T = twist.exp(np.r_[-np.cross(axis, point), axis] * 0.8)
    np.testing.assert_allclose(pose.transform(T, point), point, rtol=0, atol=ROUNDING)


def test_hat_and_vee() -> None:
    rng = np.random.default_rng(7)
    w, p, xi = rng.normal(size=3), rng.normal(size=3), rng.normal(size=6)
    np.testing.assert_allclose(twist.hat(w) @ p, np.cross(w, p), rtol=0, atol=ROUNDING)
    np.testing.assert_array_equal(twist.vee(twist.hat(w)), w)
    np.testing.assert_array_equal(twist.vee(twist.hat(xi)), xi)
    np.testing.assert_array_equal(twist.hat(xi)[:3, 3], xi[:3])
    with pytest.raises(ArrayError, match=r"vector must have shape \(\.\.\., 3\) or \(\.\.\., 6\), got \(4,\)"):
        twist.hat([1.0, 2.0, 3.0, 4.0])
    with pytest.raises(ArrayError, match=r"antisymmetric .* for a pose use twist\.log"):
        twist.vee(np.eye(4))
    with pytest.raises(ArrayError, match=r"got \(2, 2\)"):
        twist.vee(np.zeros((2, 2)))


def test_adjoint_carries_a_twist_to_another_frame() -> None:
    T = twist.exp(twists(8, 1.3))
    xi = twists(9, 0.7)
    carried = (twist.adjoint(T) @ xi[..., None])[..., 0]
    conjugate = T @ twist.hat(xi) @ pose.inverse(T)
    np.testing.assert_allclose(twist.hat(carried), conjugate, rtol=0, atol=2 * ROUNDING)


def test_ad_is_the_bracket_and_the_derivative_of_adjoint() -> None:
    a, b = twists(10, 0.9), twists(11, 1.4)
    bracket = twist.hat(a) @ twist.hat(b) - twist.hat(b) @ twist.hat(a)
    np.testing.assert_allclose(
        (twist.ad(a) @ b[..., None])[..., 0],
        np.concatenate([bracket[:, :3, 3], twist.vee(bracket[:, :3, :3])], axis=-1),
        rtol=0,
        atol=2 * ROUNDING,
    )
    for x in a:
        np.testing.assert_allclose(scipy.linalg.expm(twist.ad(x)), twist.adjoint(twist.exp(x)), rtol=0, atol=1e-14)


@pytest.mark.parametrize("batch", [(), (1,), (3, 1, 2), (0,)], ids=str)
def test_batch_shapes(batch: tuple[int, ...]) -> None:
    xi = np.random.default_rng(12).normal(size=(*batch, 6))
    T = twist.exp(xi)
    assert T.shape == (*batch, 4, 4)
    assert twist.log(T).shape == (*batch, 6)
    assert twist.adjoint(T).shape == (*batch, 6, 6)
    assert twist.ad(xi).shape == (*batch, 6, 6)
    assert twist.vee(twist.hat(xi)).shape == (*batch, 6)
    for i in np.ndindex(batch):
        np.testing.assert_allclose(T[i], twist.exp(xi[i]), rtol=0, atol=1e-15)
        np.testing.assert_allclose(twist.log(T)[i], twist.log(T[i]), rtol=0, atol=1e-15)


def test_malformed_input_is_refused() -> None:
    with pytest.raises(ArrayError, match=r"T must have shape \(\.\.\., 4, 4\), got \(3, 4\)"):
        twist.log(np.eye(4)[:3])
    with pytest.raises(ArrayError, match=r"twist must be finite, got nan at index \(0,\)"):
        twist.exp([np.nan, 0, 0, 0, 0, 0])
    with pytest.raises(ArrayError, match=r"the rotation block of T must be a rotation: .* repair it with pose.nearest"):
        twist.log(np.diag([1.0, 1.0, 1.001, 1.0]))
    with pytest.raises(ArrayError, match=r"T must have the last row 0 0 0 1, got \[0.0, 0.0, 0.0, 2.0\]"):
        twist.log(np.diag([1.0, 1.0, 1.0, 2.0]))


def test_twist_needs_numpy_alone() -> None:
    code = "import sys, pieper.spatial.twist, pieper.spatial.pose; sys.exit(any(m.split('.')[0] == 'scipy' for m in sys.modules))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("angle", [*MAGNITUDES, *(np.pi - b for b in NEAR_PI), np.pi])
def test_the_quaternion_of_one_matrix_is_that_of_many(angle: float) -> None:
    Rs = twist.exp(twists(3, angle, count=50))[:, :3, :3]
    Rs = np.concatenate([Rs, Rs @ np.diag([1.0, -1.0, -1.0]), Rs @ np.diag([-1.0, 1.0, -1.0]), [np.eye(3)]])
    many = quaternion_from_matrix(Rs)
    one = np.array([quaternion_from_matrix(R) for R in Rs])
    np.testing.assert_array_equal(one, many)
