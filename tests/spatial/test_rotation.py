"""Rotation conversions against golden rows, mpmath and SciPy; tests named after rows D1 to D9 and R1 to R7 of the
list of deliverables and corrections that this package answers."""

import csv
import itertools
import warnings
from pathlib import Path

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from pieper.errors import ArrayError, UnknownNameError
from pieper.spatial import pose, rotation

GOLDEN = 1e-12  # the golden table is rounded to double; conversions add a few units in the last place
NEAR_LOCK = (
    1e-7  # angles near the lock: rounding of the matrix divided by the distance from the lock (1e-6 rad at least)
)
ROUNDING = 4e-15  # a handful of double roundings on numbers of size 1 to pi

TABLE = Path(__file__).parents[1] / "golden" / "rotations.csv"
ROWS = list(csv.DictReader(TABLE.read_text(encoding="utf-8").splitlines()))
BATCHES = ((), (1,), (3, 1, 2), (0,))

ANGLES_TO_TRY = (0.0, 1e-300, 1e-160, 1e-12, 1e-8, 1e-4, 0.3, 1.0, np.pi / 2, 3.0)
NEAR_PI = (1e-2, 1e-5, 1e-8, 1e-11, 1e-15, 0.0)


def quaternions(seed: int, shape: tuple[int, ...]) -> np.ndarray:
    q = np.random.default_rng(seed).normal(size=(*shape, 4))
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


def axes(seed: int, count: int) -> np.ndarray:
    a = np.random.default_rng(seed).normal(size=(count, 3))
    return np.vstack([np.eye(3), -np.eye(3), a / np.linalg.norm(a, axis=-1, keepdims=True)])


def values(row: dict[str, str], *names: str) -> np.ndarray:
    return np.array([float(row[name]) for name in names])


def up_to_sign(a: np.ndarray, b: np.ndarray) -> float:
    return min(np.abs(a - b).max(), np.abs(a + b).max())


def mp_matrix(axis: np.ndarray, angle) -> np.ndarray:
    """Rodrigues' formula with 50 digits, rounded to double; the axis is normalised with 50 digits too."""
    with mpmath.workdps(50):
        a = [mpmath.mpf(float(x)) for x in axis]
        length = mpmath.sqrt(sum(x * x for x in a))
        x, y, z = (v / length for v in a)
        c, s = mpmath.cos(angle), mpmath.sin(angle)
        u = 1 - c
        return np.array(
            [
                [float(c + u * x * x), float(u * x * y - s * z), float(u * x * z + s * y)],
                [float(u * x * y + s * z), float(c + u * y * y), float(u * y * z - s * x)],
                [float(u * x * z - s * y), float(u * y * z + s * x), float(c + u * z * z)],
            ]
        )


# ---------------------------------------------------------------- golden rows


def test_the_golden_table_is_whole() -> None:
    assert len(ROWS) == 106
    assert {row["valid"] for row in ROWS} == {"1"}


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row["case"])
def test_golden_row(row: dict[str, str]) -> None:
    R = rotation.from_quaternion(values(row, "qx", "qy", "qz", "qw"))
    half_turn = row["gibbs_x"] == "inf"
    expected = values(row, *(f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3))).reshape(3, 3)
    np.testing.assert_allclose(R, expected, rtol=0, atol=GOLDEN)

    axis, angle = rotation.as_axis_angle(R)
    assert abs(angle - float(row["angle"])) < GOLDEN
    vector, expected_vector = rotation.as_rotation_vector(R), values(row, "rotvec_x", "rotvec_y", "rotvec_z")
    expected_axis = values(row, "axis_x", "axis_y", "axis_z")
    gibbs, expected_gibbs = rotation.as_gibbs(R), values(row, "gibbs_x", "gibbs_y", "gibbs_z")
    if half_turn:
        assert up_to_sign(axis, expected_axis) < GOLDEN
        assert up_to_sign(vector, expected_vector) < GOLDEN
        assert np.isposinf(gibbs).all()
    else:
        np.testing.assert_allclose(axis, expected_axis, rtol=0, atol=GOLDEN)
        np.testing.assert_allclose(vector, expected_vector, rtol=0, atol=GOLDEN)
        spread = 1e-15 / np.cos(0.5 * angle) + GOLDEN  # the tangent magnifies the rounding of the matrix
        np.testing.assert_allclose(gibbs, expected_gibbs, rtol=0, atol=spread * max(1.0, np.abs(expected_gibbs).max()))

    zyx, expected_zyx = rotation.as_euler("ZYX", R), values(row, "z_yaw", "y_pitch", "x_roll")
    tolerance = NEAR_LOCK if "lock" in row["case"] else GOLDEN
    assert np.abs(np.angle(np.exp(1j * (zyx - expected_zyx)))).max() < tolerance
    np.testing.assert_allclose(rotation.from_euler("ZYX", zyx), R, rtol=0, atol=GOLDEN)
    assert bool(rotation.gimbal_lock("ZYX", R, tolerance=1e-9).locked) == (row["gimbal_lock"] == "1")


# ---------------------------------------------------------------- D1: what a rotation preserves


@pytest.mark.parametrize("make", ["quaternion", "rotation_vector", "gibbs", "rpy", "euler"])
def test_D1_columns_are_orthonormal_and_right_handed(make: str) -> None:
    rng = np.random.default_rng(1)
    R = {
        "quaternion": lambda: rotation.from_quaternion(rng.normal(size=(200, 4)) * 7.0),
        "rotation_vector": lambda: rotation.from_rotation_vector(rng.normal(size=(200, 3)) * 3.0),
        "gibbs": lambda: rotation.from_gibbs(rng.normal(size=(200, 3)) * 10.0 ** rng.integers(-9, 9, size=(200, 1))),
        "rpy": lambda: rotation.from_rpy(rng.uniform(-7, 7, size=(200, 3))),
        "euler": lambda: rotation.from_euler("YZY", rng.uniform(-7, 7, size=(200, 3))),
    }[make]()
    assert rotation.deviation(R).max() < ROUNDING
    np.testing.assert_allclose(np.linalg.det(R), 1.0, rtol=0, atol=ROUNDING)


def test_D1_dot_product_length_and_distance_are_kept() -> None:
    """D1 and R6: in three dimensions, and with |R (p1 - p2)| = |p1 - p2|."""
    rng = np.random.default_rng(2)
    R = rotation.from_quaternion(quaternions(2, (500,)))
    a, b = rng.normal(size=(2, 500, 3))
    Ra, Rb = (R @ a[..., None])[..., 0], (R @ b[..., None])[..., 0]
    np.testing.assert_allclose((Ra * Rb).sum(-1), (a * b).sum(-1), rtol=0, atol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(Ra, axis=-1), np.linalg.norm(a, axis=-1), rtol=1e-15 * 4)
    np.testing.assert_allclose(np.linalg.norm(Ra - Rb, axis=-1), np.linalg.norm(a - b, axis=-1), rtol=1e-15 * 4)


# ---------------------------------------------------------------- D2 and R5: Euler sequences and gimbal lock


def elementary(letter: str, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return {
        "x": np.array([[1, 0, 0], [0, c, -s], [0, s, c]]),
        "y": np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]),
        "z": np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]),
    }[letter.lower()]


def test_D2_there_are_24_sequences_and_scipy_knows_them_all() -> None:
    assert len(set(rotation.EULER_SEQUENCES)) == 24
    for sequence in rotation.EULER_SEQUENCES:
        Rotation.from_euler(sequence, [0.1, 0.2, 0.3])


@pytest.mark.parametrize("sequence", rotation.EULER_SEQUENCES)
def test_D2_every_sequence_multiplies_in_the_stated_order(sequence: str) -> None:
    angles = (0.3, -0.8, 1.9)
    A, B, C = (elementary(x, t) for x, t in zip(sequence, angles, strict=True))
    expected = A @ B @ C if sequence.isupper() else C @ B @ A
    np.testing.assert_allclose(rotation.from_euler(sequence, angles), expected, rtol=0, atol=ROUNDING)
    factors = rotation.euler_factors(sequence, angles)
    np.testing.assert_allclose(factors[0] @ factors[1] @ factors[2], expected, rtol=0, atol=ROUNDING)


@pytest.mark.parametrize("sequence", rotation.EULER_SEQUENCES)
def test_D2_every_sequence_reads_back_as_scipy_reads_it(sequence: str) -> None:
    R = rotation.from_quaternion(quaternions(3, (300,)))
    angles = rotation.as_euler(sequence, R)
    np.testing.assert_allclose(rotation.from_euler(sequence, angles), R, rtol=0, atol=ROUNDING)
    expected = Rotation.from_matrix(R).as_euler(sequence)
    # both divide the rounding by the distance from the lock, 1e-3 rad at least in this sample
    assert np.abs(np.angle(np.exp(1j * (angles - expected)))).max() < 1e-12
    proper = sequence[0] == sequence[2]
    low, high = (0.0, np.pi) if proper else (-np.pi / 2, np.pi / 2)
    assert ((low <= angles[:, 1]) & (angles[:, 1] <= high)).all()
    assert (np.abs(angles) <= np.pi).all()


def locks(sequence: str) -> tuple[float, float]:
    return (0.0, np.pi) if sequence[0] == sequence[2] else (np.pi / 2, -np.pi / 2)


@pytest.mark.parametrize("sequence", rotation.EULER_SEQUENCES)
@pytest.mark.parametrize("away", [0.0, 1e-15, 1e-12, 1e-9, 3e-8, 1e-7, 1e-4])
def test_D2_near_the_lock_the_rotation_is_still_exact(sequence: str, away: float) -> None:
    for lock, side in itertools.product(locks(sequence), (-1, 1)):
        R = rotation.from_euler(sequence, [0.7, lock + side * away, -1.9])
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            back = rotation.from_euler(sequence, rotation.as_euler(sequence, R))
        np.testing.assert_allclose(back, R, rtol=0, atol=2.5e-14)  # in the lock itself, a margin of 1e-14 is set to 0


@pytest.mark.parametrize("sequence", rotation.EULER_SEQUENCES)
def test_D2_only_the_sum_or_the_difference_is_determined_in_the_lock(sequence: str) -> None:
    first, third = 0.7, -1.9
    for lock in locks(sequence):
        R = rotation.from_euler(sequence, [first, lock, third])
        report = rotation.gimbal_lock(sequence, R)
        assert report.locked
        assert report.margin < 1e-15
        assert report.angles[2] == 0.0
        kept = {"sum": first + third, "difference": first - third}[str(report.determined)]
        assert abs(np.angle(np.exp(1j * (report.value - kept)))) < ROUNDING
        sign = 1.0 if report.determined == "sum" else -1.0
        for turn in (0.5, -2.0):  # other angles, same rotation ...
            other = rotation.from_euler(sequence, [first + turn, lock, third - sign * turn])
            np.testing.assert_allclose(other, R, rtol=0, atol=ROUNDING)
            np.testing.assert_allclose(
                rotation.from_euler(sequence, report.alternatives(turn)), R, rtol=0, atol=ROUNDING
            )
            wrong = rotation.from_euler(sequence, [first + turn, lock, third + sign * turn])
            assert np.abs(wrong - R).max() > 0.1  # ... and the other combination is another rotation
        A, B, C = report.factors
        np.testing.assert_allclose(A @ B @ C, R, rtol=0, atol=ROUNDING)


def test_D2_YZY_extrinsic_matrix_and_lock() -> None:
    """R5: Ry(alpha) Rz(beta) Ry(gamma) turns about fixed axes in the order gamma, beta, alpha; it locks at 0 and pi."""
    alpha, beta, gamma = 0.4, 0.9, -1.3
    product = elementary("y", alpha) @ elementary("z", beta) @ elementary("y", gamma)
    np.testing.assert_allclose(rotation.from_euler("YZY", [alpha, beta, gamma]), product, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(rotation.from_euler("yzy", [gamma, beta, alpha]), product, rtol=0, atol=ROUNDING)
    assert not rotation.gimbal_lock("yzy", product).locked

    at_zero = rotation.gimbal_lock("yzy", rotation.from_euler("yzy", [gamma, 0.0, alpha]))
    assert (bool(at_zero.locked), str(at_zero.determined)) == (True, "sum")
    assert abs(at_zero.value - (alpha + gamma)) < ROUNDING
    np.testing.assert_allclose(
        rotation.from_euler("yzy", [gamma, 0.0, alpha]), elementary("y", alpha + gamma), rtol=0, atol=ROUNDING
    )
    at_pi = rotation.gimbal_lock("yzy", rotation.from_euler("yzy", [gamma, np.pi, alpha]))
    assert (bool(at_pi.locked), str(at_pi.determined)) == (True, "difference")
    assert abs(at_pi.value - (gamma - alpha)) < ROUNDING
    assert not rotation.gimbal_lock("yzy", rotation.from_euler("yzy", [gamma, np.pi / 2, alpha])).locked


def test_D2_XYZ_intrinsic_matrix_and_lock() -> None:
    alpha, beta, gamma = 0.4, 0.9, -1.3
    product = elementary("x", alpha) @ elementary("y", beta) @ elementary("z", gamma)
    np.testing.assert_allclose(rotation.from_euler("XYZ", [alpha, beta, gamma]), product, rtol=0, atol=ROUNDING)
    for beta, determined, value in (
        (np.pi / 2, "sum", alpha + gamma),
        (-np.pi / 2, "difference", alpha - gamma),
    ):
        report = rotation.gimbal_lock("XYZ", rotation.from_euler("XYZ", [alpha, beta, gamma]))
        assert (bool(report.locked), str(report.determined)) == (True, determined)
        assert abs(report.value - value) < ROUNDING
    assert not rotation.gimbal_lock("XYZ", rotation.from_euler("XYZ", [alpha, 0.0, gamma])).locked
    assert not rotation.gimbal_lock("XYZ", rotation.from_euler("XYZ", [alpha, np.pi, gamma])).locked


@pytest.mark.parametrize("angle", [*ANGLES_TO_TRY, *(np.pi - gap for gap in NEAR_PI)])
def test_quaternions_and_rotation_vectors_are_those_of_scipy(angle: float) -> None:
    turns = Rotation.from_rotvec(angle * axes(3, 200))
    R = turns.as_matrix()
    expected = Rotation.from_matrix(R)
    for ours, theirs in zip(rotation.as_quaternion(R), expected.as_quat(canonical=True), strict=True):
        assert up_to_sign(ours, theirs) <= ROUNDING
        assert ours[3] >= 0.0
    for ours, theirs in zip(rotation.as_rotation_vector(R), expected.as_rotvec(), strict=True):
        off = up_to_sign(ours, theirs) if angle > 3.1 else np.abs(ours - theirs).max()
        assert off <= ROUNDING


def test_D2_another_sequence_is_free_where_one_is_locked() -> None:
    """R5: neither a fourth gimbal nor quaternions are the only way out."""
    R = rotation.from_euler("XYZ", [0.4, np.pi / 2, -1.3])
    assert rotation.gimbal_lock("XYZ", R).locked
    assert not rotation.gimbal_lock("ZYZ", R).locked
    np.testing.assert_allclose(rotation.from_quaternion(rotation.as_quaternion(R)), R, rtol=0, atol=ROUNDING)


def test_gimbal_lock_report_in_words_and_batches() -> None:
    free, locked = rotation.from_euler("XYZ", [0.4, 0.2, 0.1]), rotation.from_euler("XYZ", [0.25, np.pi / 2, 0.5])
    assert "no gimbal lock" in str(rotation.gimbal_lock("XYZ", free))
    assert "only first + third = 0.75 rad" in str(rotation.gimbal_lock("XYZ", locked))
    both = rotation.gimbal_lock("XYZ", np.stack([free, locked]))
    assert str(both) == "XYZ: 1 of 2 rotations in gimbal lock"
    assert both.determined.tolist() == ["both", "sum"]
    assert np.isnan(both.value[0])
    moved = both.alternatives(0.1)
    np.testing.assert_array_equal(moved[0], both.angles[0])
    assert abs(moved[1, 0] - both.angles[1, 0] - 0.1) < ROUNDING
    with pytest.raises(ArrayError, match=r"tolerance must be 0 or more radians, got nan"):
        rotation.gimbal_lock("XYZ", free, tolerance=float("nan"))


def test_lock_tolerance_is_the_distance_of_the_middle_angle() -> None:
    for sequence in rotation.EULER_SEQUENCES:
        for lock in locks(sequence):
            inward = -1.0 if lock > 0 else 1.0
            R = rotation.from_euler(sequence, [0.2, lock + inward * 1e-5, 0.3])
            report = rotation.gimbal_lock(sequence, R, tolerance=1e-4)
            assert abs(report.margin - 1e-5) < 1e-14
            assert report.locked
            assert not rotation.gimbal_lock(sequence, R, tolerance=1e-6).locked


# ---------------------------------------------------------------- D3 and R1: quaternion to matrix


def test_D3_R1_quaternion_matrix_element_by_element() -> None:
    for x, y, z, w in quaternions(4, (50,)):
        expected = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
        np.testing.assert_allclose(rotation.from_quaternion([x, y, z, w]), expected, rtol=0, atol=ROUNDING)


@pytest.mark.parametrize("length", [1e-300, 5e-324, 1e-160, 1e-3, 1.7, 1e160, 1e300])
def test_D3_quaternions_of_any_length_are_normalised(length: float) -> None:
    expected = rotation.from_quaternion([0.0, 0.0, 1.0, 1.0])
    np.testing.assert_allclose(rotation.from_quaternion([0.0, 0.0, length, length]), expected, rtol=0, atol=ROUNDING)


# ---------------------------------------------------------------- D4 and R2: ZYX angles


def test_D4_R2_pitch_is_an_arc_sine_and_is_clamped_at_the_lock() -> None:
    q = quaternions(5, (500,))
    x, y, z, w = q.T
    angles = rotation.as_euler("ZYX", rotation.from_quaternion(q))
    np.testing.assert_allclose(angles[:, 1], np.arcsin(np.clip(2 * (w * y - z * x), -1, 1)), rtol=0, atol=1e-12)
    np.testing.assert_allclose(
        angles[:, 0], np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)), rtol=0, atol=1e-12
    )
    np.testing.assert_allclose(
        angles[:, 2], np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)), rtol=0, atol=1e-12
    )
    beyond = np.array([0.0, 1.0, 0.0, 1.0]) * (1.0 + 1e-15)  # 2 (w y - z x) may exceed 1 by rounding
    assert rotation.as_euler("ZYX", rotation.from_quaternion(beyond))[1] == pytest.approx(np.pi / 2, abs=1e-15)


def test_rpy_is_ZYX_backwards() -> None:
    rpy = np.random.default_rng(6).uniform(-1.5, 1.5, size=(3, 1, 2, 3))
    R = rotation.from_rpy(rpy)
    np.testing.assert_allclose(R, rotation.from_euler("ZYX", rpy[..., ::-1]), rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(R, rotation.from_euler("xyz", rpy), rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(rotation.as_rpy(R), rpy, rtol=0, atol=1e-13)
    roll, _, yaw = rotation.as_rpy(rotation.from_rpy([0.7, np.pi / 2, 0.3]))
    assert (roll, yaw) == pytest.approx((0.0, -0.4), abs=ROUNDING)


# ---------------------------------------------------------------- D5 and R3: rotation vector and Gibbs vector


@pytest.mark.parametrize("angle", ANGLES_TO_TRY)
def test_D5_R3_rotation_vector_near_zero_keeps_angle_and_axis(angle: float) -> None:
    for axis in axes(7, 20):
        vector = axis * angle
        R = rotation.from_rotation_vector(vector)
        np.testing.assert_allclose(R, mp_matrix(axis, mpmath.mpf(float(angle))), rtol=0, atol=ROUNDING)
        np.testing.assert_allclose(rotation.as_rotation_vector(R), vector, rtol=4e-16 * 4, atol=angle * ROUNDING)


@pytest.mark.parametrize("below", NEAR_PI)
def test_D5_R3_rotation_vector_near_180_degrees(below: float) -> None:
    for axis in axes(8, 30):
        with mpmath.workdps(50):
            R = mp_matrix(axis, mpmath.pi - mpmath.mpf(below))
        vector = rotation.as_rotation_vector(R)
        expected = axis / np.linalg.norm(axis) * (np.pi - below)
        error = up_to_sign(vector, expected) if below < 1e-14 else np.abs(vector - expected).max()
        assert error < ROUNDING
        assert np.linalg.norm(vector) <= np.pi * (1 + 4e-16)


def test_D5_R3_zero_rotation_gives_a_zero_vector_and_half_turns_give_pi() -> None:
    np.testing.assert_array_equal(rotation.as_rotation_vector(np.eye(3)), [0.0, 0.0, 0.0])
    for axis in np.eye(3):
        R = 2.0 * np.outer(axis, axis) - np.eye(3)
        np.testing.assert_array_equal(rotation.as_rotation_vector(R), axis * np.pi)


def test_D5_gibbs_vector_is_the_tangent_of_half_the_angle_and_infinite_at_180_degrees() -> None:
    axis = np.array([0.6, 0.0, -0.8])
    for angle in (1e-9, 0.5, 2.0, 3.1):
        R = rotation.from_rotation_vector(axis * angle)
        expected = axis * np.tan(0.5 * angle)
        np.testing.assert_allclose(rotation.as_gibbs(R), expected, rtol=0, atol=1e-12)
        np.testing.assert_allclose(rotation.from_gibbs(expected), R, rtol=0, atol=ROUNDING)
    for a in axes(9, 10):
        assert np.isposinf(rotation.as_gibbs(rotation.from_axis_angle(a, np.pi))).all()
    with pytest.raises(ArrayError, match="Gibbs vector must be finite, got inf"):
        rotation.from_gibbs([np.inf, 0.0, 0.0])


@pytest.mark.parametrize("length", [1e-300, 1e-8, 1e8, 1e300])
def test_D5_gibbs_vectors_of_any_length_are_taken(length: float) -> None:
    R = rotation.from_gibbs([0.0, length, 0.0])
    assert rotation.deviation(R) < ROUNDING
    np.testing.assert_allclose(
        rotation.as_rotation_vector(R), [0.0, 2.0 * np.arctan(length), 0.0], rtol=0, atol=ROUNDING
    )


# ---------------------------------------------------------------- D6: what is refused, what is the same


def test_D6_q_and_minus_q_are_one_rotation_in_every_form() -> None:
    q = np.concatenate([quaternions(10, (200,)), [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0.6, -0.8, 0], [0, 0, 0, 1]]])
    plus, minus = rotation.from_quaternion(q), rotation.from_quaternion(-q)
    np.testing.assert_array_equal(plus, minus)
    back = rotation.as_quaternion(minus)
    assert (back[:, 3] >= 0.0).all()
    assert np.abs(np.where((q * back).sum(-1, keepdims=True) < 0, -q, q) - back).max() < ROUNDING
    for read in (rotation.as_rotation_vector, rotation.as_gibbs, rotation.as_rpy, rotation.angle):
        np.testing.assert_array_equal(read(plus), read(minus))


@pytest.mark.parametrize(
    ("q", "message"),
    [
        ([0.0, 0.0, 0.0, 0.0], "quaternion xyzw must not be zero"),
        ([0.0, np.nan, 0.0, 1.0], r"quaternion xyzw must be finite, got nan at index \(1,\)"),
        ([0.0, 0.0, np.inf, 1.0], r"quaternion xyzw must be finite, got inf at index \(2,\)"),
        ([0.0, 0.0, 1.0], r"quaternion xyzw must have shape \(\.\.\., 4\), got \(3,\)"),
        (1.0, r"quaternion xyzw must have shape \(\.\.\., 4\), got \(\)"),
        ("0 0 0 1", "quaternion xyzw must be an array of real numbers"),
        ([0.0, 0.0, 1.0, 1.0j], "quaternion xyzw must be an array of real numbers"),
        ([[0.0, 0.0, 0.0, 1.0], [0.0, 1.0]], "quaternion xyzw must be an array of real numbers"),
        ([None, 0.0, 0.0, 1.0], "quaternion xyzw must be finite, got nan"),
        ([[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 0.0, 0.0]], "quaternion xyzw must not be zero"),
    ],
)
def test_D6_zero_nan_and_malformed_quaternions_are_refused(q: object, message: str) -> None:
    with pytest.raises(ArrayError, match=message):
        rotation.from_quaternion(q)


def test_malformed_matrices_are_refused_with_the_measured_deviation() -> None:
    rounded = np.round(rotation.from_rpy([0.1, 0.2, 0.3]), 4)
    with pytest.raises(
        ArrayError, match=r"R R\^T deviates from the identity by .*e-05.*repair it with rotation.nearest"
    ):
        rotation.as_quaternion(rounded)
    with pytest.raises(ArrayError, match="determinant is -1"):
        rotation.as_rotation_vector(-np.eye(3))
    with pytest.raises(ArrayError, match=r"R must have shape \(\.\.\., 3, 3\), got \(4, 4\)"):
        rotation.as_quaternion(np.eye(4))
    with pytest.raises(ArrayError, match=r"at index \(1,\)"):
        rotation.as_quaternion([np.eye(3), np.eye(3) * 1.1])
    with pytest.raises(ArrayError, match="must be a rotation"):
        rotation.as_quaternion(np.eye(3) * 1e200)
    with pytest.raises(UnknownNameError, match=r"no Euler sequence 'XYX '; did you mean 'XYX'"):
        rotation.as_euler("XYX ", np.eye(3))
    for name in ("xYz", "xxy", "xy", "abc", "", "XYZX"):
        with pytest.raises(UnknownNameError, match="no Euler sequence"):
            rotation.from_euler(name, [0.0, 0.0, 0.0])


def test_axis_angle() -> None:
    np.testing.assert_allclose(
        rotation.from_axis_angle([[0, 0, 3.0], [0, 0, 0]], [np.pi / 2, 0.0]),
        [elementary("z", np.pi / 2), np.eye(3)],
        rtol=0,
        atol=ROUNDING,
    )
    axis, angle = rotation.as_axis_angle(np.eye(3))
    np.testing.assert_array_equal(axis, [0, 0, 0])
    assert angle == 0.0
    np.testing.assert_array_equal(rotation.from_axis_angle(axis, angle), np.eye(3))
    assert rotation.from_axis_angle(np.eye(3), np.zeros((4, 1))).shape == (4, 3, 3, 3)
    with pytest.raises(
        ArrayError,
        match=r"axis must not be zero where the angle is not zero; give it a direction, for example \[0, 0, 1\]",
    ):
        rotation.from_axis_angle([0, 0, 0], 0.1)
    with pytest.raises(ArrayError, match=r"axis and angle must broadcast, got shapes \(2,\) and \(3,\)"):
        rotation.from_axis_angle(np.eye(3)[:2], [1.0, 2.0, 3.0])


# ---------------------------------------------------------------- D9 and R4: matrix to quaternion


@pytest.mark.parametrize("angle", [*ANGLES_TO_TRY, *(np.pi - b for b in NEAR_PI)])
def test_D9_R4_matrix_to_quaternion_from_zero_to_180_degrees(angle: float) -> None:
    for axis in axes(11, 30):
        T = pose.from_position_rotation([1.0, 2.0, 3.0], mp_matrix(axis, mpmath.mpf(float(angle))))
        q = rotation.as_quaternion(pose.rotation(T))
        unit = axis / np.linalg.norm(axis)
        expected = np.array([*(np.sin(0.5 * angle) * unit), np.cos(0.5 * angle)])
        assert up_to_sign(q, expected) < ROUNDING
        if angle < 3.0 and angle > 0.0:  # a tiny turn keeps its axis: relative accuracy
            np.testing.assert_allclose(q[:3], expected[:3], rtol=0, atol=1e-15 * 4 * angle)


def test_D9_R4_half_turns_about_every_axis() -> None:
    a = axes(12, 200)
    R = 2.0 * a[:, :, None] * a[:, None, :] - np.eye(3)  # symmetric: the antisymmetric part says nothing
    q = rotation.as_quaternion(R)
    assert np.isfinite(q).all()
    assert max(up_to_sign(x[:3], y) for x, y in zip(q, a, strict=True)) < ROUNDING
    np.testing.assert_allclose(rotation.from_quaternion(q), R, rtol=0, atol=ROUNDING)


# ---------------------------------------------------------------- R7: singular values and eigenvectors


def test_R7_singular_vectors_are_orthonormal_and_eigenvectors_need_not_be() -> None:
    matrix = np.array([[1.0, 1.0], [0.0, 2.0]])
    U, s, Vt = np.linalg.svd(matrix)
    assert (s >= 0.0).all()
    np.testing.assert_allclose(U.T @ U, np.eye(2), rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(Vt @ Vt.T, np.eye(2), rtol=0, atol=ROUNDING)
    _, eigenvectors = np.linalg.eig(matrix)
    assert abs(eigenvectors[:, 0] @ eigenvectors[:, 1]) == pytest.approx(np.sqrt(0.5))
    turn = elementary("z", 0.3)[:2, :2]
    assert np.iscomplex(np.linalg.eigvals(turn)).all()  # a rotation of the plane has no real eigenvector at all,
    np.testing.assert_allclose(np.linalg.svd(turn)[1], 1.0, rtol=0, atol=ROUNDING)  # and singular values 1


# ---------------------------------------------------------------- repair, distance, batches


def test_nearest_rotation_repairs_and_is_the_nearest() -> None:
    rng = np.random.default_rng(13)
    R = rotation.from_quaternion(quaternions(13, (50,)))
    noisy = R + rng.normal(size=R.shape) * 1e-3
    repaired = rotation.nearest(noisy)
    assert rotation.deviation(noisy).max() > 1e-4
    assert rotation.deviation(repaired).max() < ROUNDING
    best = np.linalg.norm(noisy - repaired, axis=(-2, -1))
    for _ in range(20):
        other = repaired @ rotation.from_rotation_vector(rng.normal(size=(50, 3)) * 1e-3)
        assert (np.linalg.norm(noisy - other, axis=(-2, -1)) > best).all()
    np.testing.assert_allclose(rotation.nearest(R), R, rtol=0, atol=ROUNDING)
    assert rotation.deviation(-np.eye(3)) == np.inf
    assert np.linalg.det(rotation.nearest(np.diag([1.0, 1.0, -0.5]))) > 0.0
    with pytest.raises(ArrayError, match="no single nearest rotation; its singular values are"):
        rotation.nearest(np.zeros((3, 3)))
    with pytest.raises(ArrayError, match="no single nearest rotation"):
        rotation.nearest(-np.eye(3))


def test_distance_is_the_angle_between() -> None:
    R = rotation.from_quaternion(quaternions(14, (100,)))
    for angle in (0.0, 1e-9, 1.0, np.pi - 1e-9, np.pi):
        turned = R @ rotation.from_axis_angle([1.0, -2.0, 0.5], angle)
        np.testing.assert_allclose(rotation.distance(R, turned), angle, rtol=0, atol=ROUNDING)
        np.testing.assert_allclose(rotation.distance(turned, R), angle, rtol=0, atol=ROUNDING)


@pytest.mark.parametrize("batch", BATCHES, ids=str)
def test_batch_shapes(batch: tuple[int, ...]) -> None:
    q = quaternions(15, batch)
    R = rotation.from_quaternion(q)
    assert R.shape == (*batch, 3, 3)
    assert rotation.as_quaternion(R).shape == (*batch, 4)
    for write, read in (
        (rotation.from_rotation_vector, rotation.as_rotation_vector),
        (rotation.from_gibbs, rotation.as_gibbs),
        (rotation.from_rpy, rotation.as_rpy),
        (lambda e: rotation.from_euler("zxz", e), lambda r: rotation.as_euler("zxz", r)),
        (lambda v: rotation.from_axis_angle(*v), rotation.as_axis_angle),
    ):
        parts = read(R)
        first = parts if isinstance(parts, np.ndarray) else parts[0]
        assert first.shape == (*batch, 3)
        back = write(parts)
        assert back.shape == (*batch, 3, 3)
        np.testing.assert_allclose(back, R, rtol=0, atol=1e-14)
    assert rotation.angle(R).shape == batch
    assert rotation.distance(R, np.eye(3)).shape == batch
    assert rotation.nearest(R).shape == (*batch, 3, 3)
    report = rotation.gimbal_lock("XYX", R)
    assert (report.locked.shape, report.value.shape, report.factors.shape) == (batch, batch, (*batch, 3, 3, 3))


@given(st.lists(st.floats(-1e3, 1e3), min_size=4, max_size=4).filter(lambda q: max(map(abs, q)) > 1e-200))
def test_every_form_gives_the_rotation_back(q: list[float]) -> None:
    R = rotation.from_quaternion(q)
    assert rotation.deviation(R) < ROUNDING
    forms = [
        rotation.from_quaternion(rotation.as_quaternion(R)),
        rotation.from_rotation_vector(rotation.as_rotation_vector(R)),
        rotation.from_axis_angle(*rotation.as_axis_angle(R)),
        rotation.from_rpy(rotation.as_rpy(R)),
        *(rotation.from_euler(s, rotation.as_euler(s, R)) for s in ("ZYX", "yzy", "xzy", "XYX")),
    ]
    for back in forms:
        np.testing.assert_allclose(back, R, rtol=0, atol=2.5e-14)  # 1e-14 rad is set to 0 in a lock
    gibbs = rotation.as_gibbs(R)
    assert np.isinf(gibbs).all() or np.abs(rotation.from_gibbs(gibbs) - R).max() < ROUNDING


@given(
    st.one_of(
        st.text(),
        st.none(),
        st.lists(st.floats() | st.integers() | st.text() | st.none(), max_size=5),
        st.complex_numbers(),
    )
)
def test_whatever_comes_in_a_rotation_or_an_array_error_comes_out(value: object) -> None:
    for function in (rotation.from_quaternion, rotation.from_rotation_vector, rotation.from_gibbs, rotation.from_rpy):
        try:
            R = function(value)
        except ArrayError:
            continue
        assert rotation.deviation(R).max(initial=0.0) < 1e-9
