"""Laws of SO(3) and SE(3) that hold for every element: at random, within a hair of the identity, and near half a turn."""

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st

from pieper.spatial import pose, rotation, twist

GROUP = 1e-13  # a few products of 4x4 matrices with translations up to 10 m
TWIST = 1e-12  # a logarithm of those

COORDINATE = st.floats(-10.0, 10.0)
ANGLE = st.one_of(
    st.floats(-3.1, 3.1),
    st.sampled_from([0.0, 1e-300, 1e-12, 1e-8, 1e-4, 0.5, np.pi - 1e-4, np.pi - 1e-8, np.pi - 1e-12, np.pi]),
)
DIRECTION = st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda a: np.linalg.norm(a) > 1e-3)


@st.composite
def twists(draw: st.DrawFn) -> np.ndarray:
    axis = np.array(draw(DIRECTION))
    v = np.array(draw(st.tuples(COORDINATE, COORDINATE, COORDINATE)))
    return np.concatenate([v, axis / np.linalg.norm(axis) * draw(ANGLE)])


def close(a: np.ndarray, b: np.ndarray, tolerance: float = GROUP) -> None:
    np.testing.assert_allclose(a, b, rtol=0, atol=tolerance)


@given(twists(), twists(), twists())
def test_poses_are_a_group(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> None:
    A, B, C = twist.exp(np.stack([a, b, c]))
    close((A @ B) @ C, A @ (B @ C))
    close(A @ pose.inverse(A), np.eye(4))
    close(pose.inverse(A) @ A, np.eye(4))
    close(pose.inverse(A @ B), pose.inverse(B) @ pose.inverse(A))
    assert rotation.deviation((A @ B @ C)[:3, :3]) < GROUP


@given(twists())
@example(np.zeros(6))
@example(np.array([1.0, 2.0, 3.0, 0.0, 0.0, np.pi]))
@example(np.array([1.0, 2.0, 3.0, 0.0, -np.pi, 0.0]))
def test_exp_undoes_log(xi: np.ndarray) -> None:
    T = twist.exp(xi)
    back = twist.log(T)
    close(twist.exp(back), T)
    angle = np.linalg.norm(back[3:])
    assert angle <= np.pi + 1e-15
    if np.linalg.norm(xi[3:]) < np.pi - 1e-3:  # nearer, the linear part magnifies rounding of the axis
        close(back, xi, TWIST)


@given(twists(), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
def test_exp_along_one_twist_adds_up(xi: np.ndarray, s: float, t: float) -> None:
    close(twist.exp(s * xi) @ twist.exp(t * xi), twist.exp((s + t) * xi))
    close(pose.inverse(twist.exp(xi)), twist.exp(-xi))


@given(twists(), twists())
def test_adjoint_is_a_homomorphism_and_carries_twists(a: np.ndarray, b: np.ndarray) -> None:
    A, B = twist.exp(a), twist.exp(b)
    close(twist.adjoint(A @ B), twist.adjoint(A) @ twist.adjoint(B), 10 * GROUP)
    close(twist.adjoint(pose.inverse(A)) @ twist.adjoint(A), np.eye(6), 30 * GROUP)
    close(A @ B @ pose.inverse(A), twist.exp(twist.adjoint(A) @ b), 10 * GROUP)


@given(twists(), twists(), twists())
def test_the_bracket_is_antisymmetric_and_obeys_jacobi(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> None:
    def bracket(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return twist.ad(x) @ y

    close(bracket(a, b), -bracket(b, a))
    close(bracket(a, bracket(b, c)) + bracket(b, bracket(c, a)) + bracket(c, bracket(a, b)), np.zeros(6), TWIST)


@given(twists(), twists(), twists())
def test_distance_is_a_metric_and_the_same_from_every_frame(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> None:
    A, B, C = twist.exp(np.stack([a, b, c]))
    for i in (0, 1):
        assert abs(pose.distance(A, B)[i] - pose.distance(B, A)[i]) < GROUP
        assert pose.distance(A, C)[i] <= pose.distance(A, B)[i] + pose.distance(B, C)[i] + GROUP
        assert pose.distance(A, A)[i] < GROUP
        assert abs(pose.distance(C @ A, C @ B)[i] - pose.distance(A, B)[i]) < 10 * GROUP


@given(twists(), twists(), st.floats(0.0, 1.0))
def test_interpolation_runs_backwards_and_does_not_mind_the_frame(a: np.ndarray, b: np.ndarray, s: float) -> None:
    A, B = twist.exp(a), twist.exp(b)
    if rotation.distance(A[:3, :3], B[:3, :3]) > np.pi - 1e-3:
        return  # two ways are equally short
    forth = pose.interpolate(A, B, fraction=s)
    close(forth, pose.interpolate(B, A, fraction=1.0 - s), TWIST)
    close(A @ forth, pose.interpolate(A @ A, A @ B, fraction=s), 10 * TWIST)


@given(twists(), twists())
def test_rotations_multiply_alike_in_every_form(a: np.ndarray, b: np.ndarray) -> None:
    A, B = twist.exp(a)[:3, :3], twist.exp(b)[:3, :3]
    for write, read in (
        (rotation.from_quaternion, rotation.as_quaternion),
        (rotation.from_rotation_vector, rotation.as_rotation_vector),
        (rotation.from_rpy, rotation.as_rpy),
    ):
        close(write(read(A)) @ write(read(B)), A @ B)
        close(write(read(A @ B)), A @ B)
