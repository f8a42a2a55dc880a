"""Singular values of Jacobians: laws over random matrices and every robot, textbook arms, golden singular values, mpmath."""

from pathlib import Path

import mpmath
import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from pieper.errors import ArrayError
from pieper.kinematics import manipulability as m
from pieper.kinematics.jacobian import jacobian
from tests.robots import NAMES, chain

GOLDEN = yaml.safe_load((Path(__file__).parents[1] / "golden" / "jacobian.yaml").read_text(encoding="utf-8"))
REFERENCE = 1e-10  # stated with the golden rows
ROUNDING = 1e-13  # singular value decompositions of matrices of size 1 to 10

SHAPES = ((6, 6), (6, 7), (6, 5), (3, 6), (2, 2), (6, 1), (1, 6))
BATCHES = ((), (1,), (3, 1, 2), (0,))


def joints(name: str, count: int, seed: int = 0) -> np.ndarray:
    limits = chain(name).limits.clip(-np.pi, np.pi)
    return np.random.default_rng(seed).uniform(limits[:, 0], limits[:, 1], size=(count, len(limits)))


def planar(q2: float, first: float = 1.0, second: float = 0.5) -> np.ndarray:
    """Jacobian of two links in a plane at q1 = 0, rows x and y."""
    s, c = np.sin(q2), np.cos(q2)
    return np.array([[-second * s, -second * s], [first + second * c, second * c]])


# ---------------------------------------------------------------- pseudo-inverse, rank, null space


@pytest.mark.parametrize("shape", SHAPES, ids=str)
@pytest.mark.parametrize("batch", BATCHES, ids=str)
def test_pseudo_inverse_obeys_penrose(shape: tuple[int, int], batch: tuple[int, ...]) -> None:
    J = np.random.default_rng(1).normal(size=(*batch, *shape))
    P = m.pseudo_inverse(J)
    assert P.shape == (*batch, *shape[::-1])
    np.testing.assert_allclose(J @ P @ J, J, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(P @ J @ P, P, rtol=0, atol=1e-11)  # times the condition, up to 100 here
    for product in (J @ P, P @ J):
        np.testing.assert_allclose(product, np.swapaxes(product, -1, -2), rtol=0, atol=1e-11)


def test_pseudo_inverse_of_a_singular_matrix_is_bounded() -> None:
    J = planar(0.0)
    np.testing.assert_allclose(m.pseudo_inverse(J), np.linalg.pinv(J), rtol=0, atol=ROUNDING)
    np.testing.assert_array_equal(m.pseudo_inverse(np.zeros((2, 6, 7))), np.zeros((2, 7, 6)))


def test_the_cutoff_is_relative_and_inclusive() -> None:
    J = np.diag([4.0, 2.0, 1.0])
    np.testing.assert_array_equal(np.diag(m.pseudo_inverse(J, cutoff=0.25)), [0.25, 0.5, 0.0])
    np.testing.assert_array_equal(np.diag(m.pseudo_inverse(J, cutoff=0.24)), [0.25, 0.5, 1.0])
    assert m.rank(J, cutoff=0.25) == 2
    assert m.null_space(J, cutoff=0.25).shape == (3, 1)
    tiny = np.diag([1.0, 3 * 2.2e-16])  # the default is max(m, n) eps = 4.4e-16
    assert m.rank(tiny) == 2
    assert m.rank(np.diag([1.0, 4e-16])) == 1
    np.testing.assert_array_equal(m.rank(J * 1e-200), 3)


@pytest.mark.parametrize("batch", BATCHES, ids=str)
def test_null_space_is_orthonormal_and_moves_nothing(batch: tuple[int, ...]) -> None:
    J = np.random.default_rng(2).normal(size=(*batch, 6, 7))
    N = m.null_space(J)
    if 0 in batch:
        assert N.shape == (*batch, 7, 0)
        return
    assert N.shape == (*batch, 7, 1)
    np.testing.assert_allclose(J @ N, 0.0, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(np.swapaxes(N, -1, -2) @ N, np.ones((*batch, 1, 1)), rtol=0, atol=ROUNDING)
    projector = np.eye(7) - m.pseudo_inverse(J) @ J
    np.testing.assert_allclose(N @ np.swapaxes(N, -1, -2), projector, rtol=0, atol=1e-11)


def test_null_space_of_a_batch_pads_with_zeros() -> None:
    N = m.null_space([np.eye(3), np.diag([1.0, 1.0, 0.0]), np.zeros((3, 3))])
    assert N.shape == (3, 3, 3)
    np.testing.assert_array_equal(N[0], np.zeros((3, 3)))
    np.testing.assert_array_equal(np.abs(N[1]), [[0, 0, 0], [0, 0, 0], [1, 0, 0]])
    np.testing.assert_allclose(N[2] @ N[2].T, np.eye(3), rtol=0, atol=ROUNDING)
    assert m.null_space(np.eye(6)).shape == (6, 0)


# ---------------------------------------------------------------- manipulability and its kin


@pytest.mark.parametrize("row", GOLDEN, ids=lambda row: row["robot"])
def test_golden_singular_values(row: dict) -> None:
    J, s = np.array(row["J"]), np.array(row["singular_values"])
    assert m.distance_to_singularity(J) == pytest.approx(s[-1], abs=REFERENCE)
    assert m.manipulability(J) == pytest.approx(np.prod(s), rel=REFERENCE / s[-1])
    np.testing.assert_allclose(m.ellipsoid(J, part="all").lengths[: len(s)], s, rtol=0, atol=REFERENCE)
    if s[-1] > 1e-9:
        assert m.condition(J) == pytest.approx(s[0] / s[-1], rel=REFERENCE / s[-1])


@given(st.floats(-np.pi, np.pi))
def test_two_links_have_the_textbook_manipulability(q2: float) -> None:
    """Yoshikawa 1985, example of two links: l1 l2 |sin(q2)|."""
    assert m.manipulability(planar(q2)) == pytest.approx(0.5 * abs(np.sin(q2)), abs=1e-15)


@pytest.mark.parametrize("q2", [1e-3, 1e-6, 1e-9, 1e-12, 1e-14])
def test_manipulability_near_a_singularity_where_the_determinant_fails(q2: float) -> None:
    turned = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])  # q1 = 0.7, so that nothing is exact
    J = turned @ planar(q2)
    with mpmath.workdps(50):
        exact = float(mpmath.fabs(mpmath.det(mpmath.matrix(J.tolist()))))
    smallest = m.distance_to_singularity(J)
    assert m.manipulability(J) == pytest.approx(exact, rel=4e-16 * 1.6 / smallest + 1e-14)
    if q2 <= 1e-9:
        determinant = np.linalg.det(J @ J.T)
        lost = abs(np.sqrt(abs(determinant)) - exact) / exact
        assert lost > 1e-3 or determinant <= 0.0


def test_manipulability_is_the_root_of_the_determinant() -> None:
    J = np.random.default_rng(3).normal(size=(50, 6, 7))
    expected = np.sqrt(np.linalg.det(J @ np.swapaxes(J, -1, -2)))
    np.testing.assert_allclose(m.manipulability(J), expected, rtol=1e-10)
    slim = J[:, :, :4]  # fewer joints than rows: the volume of what it can do
    expected = np.sqrt(np.linalg.det(np.swapaxes(slim, -1, -2) @ slim))
    np.testing.assert_allclose(m.manipulability(slim), expected, rtol=1e-10)


def test_condition_is_infinite_at_a_singularity() -> None:
    assert m.condition(planar(0.0)) == np.inf
    assert m.condition(np.zeros((6, 6))) == np.inf
    assert m.condition(np.eye(6)) == 1.0
    np.testing.assert_allclose(m.condition([planar(0.7)] * 2), np.linalg.cond(planar(0.7)), rtol=1e-14)


def test_distance_to_singularity_is_the_distance_to_the_nearest_singular_matrix() -> None:
    J = np.random.default_rng(4).normal(size=(6, 7))
    distance = m.distance_to_singularity(J)
    U, s, Vt = np.linalg.svd(J, full_matrices=False)
    assert m.rank(J - s[-1] * np.outer(U[:, -1], Vt[-1]), cutoff=1e-13) == 5
    rng = np.random.default_rng(5)
    for _ in range(100):
        change = rng.normal(size=J.shape)
        change *= 0.999 * distance / np.linalg.norm(change, 2)
        assert m.rank(J + change, cutoff=1e-13) == 6


def test_characteristic_length_weighs_the_linear_rows() -> None:
    J = np.random.default_rng(6).normal(size=(4, 6, 6))
    weighed = J * np.array([2.0, 2.0, 2.0, 1.0, 1.0, 1.0])[:, None]
    for function in (m.manipulability, m.condition, m.distance_to_singularity):
        np.testing.assert_allclose(function(J, characteristic_length=0.5), function(weighed), rtol=1e-12)
    report = m.singularity(J, characteristic_length=0.5)
    np.testing.assert_allclose(report.distance, m.distance_to_singularity(weighed), rtol=1e-12)
    # the same arm drawn in millimetres, with the length in millimetres, is as far from a singularity
    millimetres = J * np.array([1e3, 1e3, 1e3, 1.0, 1.0, 1.0])[:, None]
    np.testing.assert_allclose(
        m.condition(millimetres, characteristic_length=500.0), m.condition(J, characteristic_length=0.5), rtol=1e-10
    )


# ---------------------------------------------------------------- ellipsoid


def test_ellipsoid_of_two_links() -> None:
    e = m.ellipsoid(planar(np.pi / 2), part="all")
    U, s, _ = np.linalg.svd(planar(np.pi / 2))
    np.testing.assert_allclose(e.lengths, s)
    np.testing.assert_allclose(np.abs(e.axes), np.abs(U), rtol=0, atol=ROUNDING)
    assert e.volume == pytest.approx(0.5)


@pytest.mark.parametrize("name", NAMES)
def test_ellipsoids_hold_every_velocity_of_unit_joint_speed(name: str) -> None:
    q = joints(name, 5)
    J = jacobian(chain(name), q)
    dq = np.random.default_rng(7).normal(size=(200, 1, J.shape[-1], 1))
    dq /= np.linalg.norm(dq, axis=-2, keepdims=True)
    for part, rows in (("linear", slice(0, 3)), ("angular", slice(3, 6))):
        e = m.ellipsoid(J, part=part)
        assert (e.axes.shape, e.lengths.shape, e.volume.shape) == ((5, 3, 3), (5, 3), (5,))
        np.testing.assert_allclose(np.swapaxes(e.axes, -1, -2) @ e.axes, np.tile(np.eye(3), (5, 1, 1)), atol=ROUNDING)
        # the matrix of the ellipsoid is J J^T, and no velocity lies outside
        A = e.axes * e.lengths[:, None, :] ** 2 @ np.swapaxes(e.axes, -1, -2)
        np.testing.assert_allclose(A, J[:, rows] @ np.swapaxes(J[:, rows], -1, -2), rtol=0, atol=1e-12)
        along = np.swapaxes(e.axes, -1, -2) @ (J[:, rows] @ dq)
        inside = ((along[..., 0] / np.maximum(e.lengths, 1e-12)) ** 2)[:, (e.lengths > 1e-9).all(axis=-1)]
        assert (inside.sum(-1) <= 1.0 + 1e-9).all()


def test_ellipsoid_of_an_arm_with_two_joints_is_flat() -> None:
    J = np.random.default_rng(8).normal(size=(6, 2))
    e = m.ellipsoid(J)
    assert e.axes.shape == (3, 3)
    assert e.lengths[2] == 0.0
    assert e.volume == 0.0


# ---------------------------------------------------------------- which joints cause it


def test_wrist_singularity_names_its_two_joints() -> None:
    """UR5e with wrist_2 at 0: the axes of shoulder_lift, elbow, wrist_1 and wrist_3 are parallel."""
    arm = chain("ur5e", True)
    report = m.singularity(jacobian(arm, [0.3, -1.2, 1.4, -0.7, 0.0, 0.4]), joint_names=arm.joint_names)
    assert report.near
    assert report.lost == 1
    assert report.distance < 1e-12
    assert set(report.joints(share=0.01)) == {arm.joint_names[i] for i in (1, 2, 3, 5)}
    assert "near a singularity: smallest singular value" in str(report)
    assert all(name in str(report) for name in report.joints())
    regular = m.singularity(jacobian(arm, [0.3, -1.2, 1.4, -0.7, 1.2, 0.4]), joint_names=arm.joint_names)
    assert not regular.near
    assert str(regular).startswith("not near a singularity")


def test_spherical_wrist_turns_joint_4_against_joint_6() -> None:
    arm = chain("yaskawa_mh12", True)
    report = m.singularity(jacobian(arm, [0.3, 0.2, -0.4, 0.5, 0.0, 0.4]), joint_names=arm.joint_names)
    assert report.joints() == [arm.joint_names[3], arm.joint_names[5]] or report.joints() == [
        arm.joint_names[5],
        arm.joint_names[3],
    ]
    np.testing.assert_allclose(report.participation[[3, 5]], np.sqrt(0.5), rtol=0, atol=1e-9)
    # 5e-5 rad away the same joints are named
    near = m.singularity(jacobian(arm, [0.3, 0.2, -0.4, 0.5, 5e-5, 0.4]), joint_names=arm.joint_names)
    assert set(near.joints()) == set(report.joints())


def test_two_lost_directions_share_their_joints() -> None:
    report = m.singularity(np.diag([1.0, 1e-5, 1e-6]))
    assert report.lost == 2
    np.testing.assert_allclose(report.participation, [0.0, 1.0, 1.0], rtol=0, atol=ROUNDING)
    assert report.joints() == ["joint_2", "joint_3"]
    assert "2 directions" in str(report)


@pytest.mark.parametrize("name", NAMES)
def test_singularity_report_means_what_it_says_on_every_robot(name: str) -> None:
    J = jacobian(chain(name), joints(name, 20, seed=9))
    report = m.singularity(J, joint_names=chain(name).joint_names)
    moved = (J @ report.joint_motion[..., None])[..., 0]
    np.testing.assert_allclose(np.linalg.norm(moved, axis=-1), report.distance, rtol=0, atol=ROUNDING)
    seen = (np.swapaxes(J, -1, -2) @ report.tip_motion[..., None])[..., 0]
    np.testing.assert_allclose(np.linalg.norm(seen, axis=-1), report.distance, rtol=0, atol=ROUNDING)
    assert (np.abs(report.joint_motion).max(axis=-1) == report.joint_motion.max(axis=-1)).all()
    assert str(report) == f"{int(report.near.sum())} of 20 poses are near a singularity"


@pytest.mark.parametrize("batch", BATCHES, ids=str)
def test_batch_shapes_and_parts(batch: tuple[int, ...]) -> None:
    J = np.random.default_rng(10).normal(size=(*batch, 6, 7))
    for function in (m.manipulability, m.condition, m.distance_to_singularity, m.rank):
        whole = function(J)
        assert whole.shape == batch
        for i in np.ndindex(batch):
            assert whole[i] == pytest.approx(function(J[i]), rel=1e-12)
    report = m.singularity(J)
    assert (report.distance.shape, report.lost.shape) == (batch, batch)
    assert (report.joint_motion.shape, report.tip_motion.shape) == ((*batch, 7), (*batch, 6))
    assert report.participation.shape == (*batch, 7)
    assert m.ellipsoid(J).axes.shape == (*batch, 3, 3)


# ---------------------------------------------------------------- bad input


def test_malformed_input_is_refused() -> None:
    J = np.eye(6)
    for function in (m.pseudo_inverse, m.rank, m.null_space, m.manipulability, m.condition, m.singularity):
        with pytest.raises(ArrayError, match=r"J must have shape \(\.\.\., m, n\), got \(6,\)"):
            function(np.zeros(6))
        with pytest.raises(ArrayError, match=r"J must have shape \(\.\.\., m, n\), got \(6, 0\)"):
            function(np.zeros((6, 0)))
        with pytest.raises(ArrayError, match=r"J must be finite, got nan at index \(0, 0\)"):
            function(np.full((2, 2), np.nan))
    for cutoff in (-0.1, 1.0, float("nan")):
        with pytest.raises(ArrayError, match="cutoff must be relative to the largest singular value"):
            m.pseudo_inverse(J, cutoff=cutoff)
    for length in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(ArrayError, match="characteristic_length must be a positive number of metres"):
            m.condition(J, characteristic_length=length)
    with pytest.raises(ArrayError, match=r"needs J of shape \(\.\.\., 6, n\), got \(3, 6\)"):
        m.condition(J[:3], characteristic_length=0.5)
    with pytest.raises(ArrayError, match="part must be 'linear', 'angular' or 'all', got 'both'"):
        m.ellipsoid(J, part="both")
    with pytest.raises(ArrayError, match=r"J must have shape \(\.\.\., 6, n\), got \(3, 6\)"):
        m.ellipsoid(J[:3])
    with pytest.raises(ArrayError, match="joint_names must hold 6 names, one for each column of J, got 2"):
        m.singularity(J, joint_names=["a", "b"])
    with pytest.raises(ArrayError, match="threshold must be positive"):
        m.singularity(J, threshold=0.0)
    with pytest.raises(ArrayError, match=r"joints\(\) is for one pose"):
        m.singularity([J, J]).joints()
