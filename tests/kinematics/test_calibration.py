"""Kinematic calibration: screws from measured tips, over every robot, with noise, and with measurements that are of no use."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from pieper.arm import Arm
from pieper.errors import ArrayError, UnknownNameError
from pieper.kinematics.calibration import calibrate
from pieper.kinematics.fk import fk
from pieper.kinematics.screw_parameters import ScrewParameters
from pieper.model.chain import Chain
from pieper.model.poe import from_screws, prismatic, revolute
from pieper.spatial import pose
from tests.robots import NAMES, chain

RECOVERED = 1e-9  # [m, -] what a calibration without noise must come to; it comes to rounding, about 1e-14
COMPLETE = ("screws", "home")
GOLDEN = Path(__file__).parents[1] / "golden"
HALF_TURN_Z = np.diag([-1.0, -1.0, 1.0, 1.0])  # between the tool of the report and tool0


def built(arm: Chain, seed: int, size: float = 0.01) -> Chain:
    """The arm with every axis and the tip off by `size` [m, rad]."""
    model = ScrewParameters.of(arm, COMPLETE)
    return model.moved(np.random.default_rng(seed).normal(0.0, size, len(model.parameters))).chain()


def joints(arm: Chain, count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-2.0, 2.0, (count, arm.dof))


def slider() -> Chain:
    """Turning, sliding, turning, sliding, and a slide askew."""
    home = np.eye(4)
    home[:3, 3] = 0.7, 0.1, 0.3
    rows = [
        revolute([0, 0, 1], [0, 0, 0]),
        prismatic([1, 0, 0]),
        revolute([0, 1, 0], [0.4, 0, 0.3]),
        prismatic([0, 0, 1]),
        prismatic([0, 1, 1]),
    ]
    return from_screws(rows, home)


def coupled() -> Chain:
    """Two axes on one joint."""
    arm = chain("ur5e")
    coupling = np.delete(np.eye(6), 2, axis=1)
    coupling[2, 1] = -0.5
    keep = [0, 1, 3, 4, 5]
    return Chain(
        "coupled", arm.screws, arm.home, arm.limits[keep], tuple(arm.joint_names[i] for i in keep), coupling=coupling
    )


@pytest.mark.parametrize("positions_only", [False, True], ids=["poses", "positions"])
@pytest.mark.parametrize("name", NAMES)
def test_every_arm_is_recovered(name, positions_only):
    arm = chain(name)
    real = built(arm, 1)
    q, other = joints(arm, 40), joints(arm, 50, 1)
    T = fk(real, q)
    found = calibrate(arm, q, T[:, :3, 3] if positions_only else T)
    assert found.converged
    assert found.left_out.size == 0
    difference = np.abs(fk(found.chain, other) - fk(real, other))
    assert difference[:, :3, 3].max() < RECOVERED
    if not positions_only:
        assert difference.max() < RECOVERED
        np.testing.assert_allclose(found.chain.screws, real.screws, atol=RECOVERED)
        assert found.identifiability.complete
        assert len(found.change) == 4 * arm.dof + 6  # all of these arms turn


@given(seed=st.integers(0, 10**6), size=st.floats(1e-6, 0.05))
@settings(max_examples=15, deadline=None)
def test_any_change_of_screws_is_recovered(seed, size):
    for arm in (chain("kuka_kr210_robond"), slider(), coupled()):
        real = built(arm, seed, size)
        q, other = joints(arm, 40, seed), joints(arm, 20, seed + 1)
        found = calibrate(arm, q, fk(real, q))
        assert found.converged
        assert np.abs(fk(found.chain, other) - fk(real, other)).max() < RECOVERED


def test_sliding_joints_stay_sliding_and_count_two():
    arm = slider()
    found = calibrate(arm, joints(arm, 30), fk(built(arm, 3), joints(arm, 30)))
    assert np.array_equal(found.chain.is_revolute, arm.is_revolute)
    assert len(found.change) == 2 * 4 + 3 * 2 + 6
    assert not found.chain.screws[~arm.is_revolute, 3:].any()


def mh12_measured(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Joint values in the order and sense of the report, and the poses that the public model has there."""
    arm = chain("yaskawa_mh12", nominal=True).lock(joint_4_r=0.0)
    theta = np.random.default_rng(5).uniform(*arm.limits.T, (count, 5))
    return theta * [1, 1, 1, -1, 1], fk(arm, theta) @ HALF_TURN_Z


def exact_screws() -> np.ndarray:
    """Row M1: q3 = (0.155, 0, 1.064), q4 = q5 = (0.795, 0, 1.264); axes z, y, y, y, x."""
    points = [[0, 0, 0.45], [0.155, 0, 0.45], [0.155, 0, 1.064], [0.795, 0, 1.264], [0.795, 0, 1.264]]
    axes = [[0, 0, 1], [0, 1, 0], [0, -1, 0], [0, 1, 0], [-1, 0, 0]]
    return revolute(np.array(axes, dtype=float), np.array(points, dtype=float))


@pytest.mark.parametrize("positions_only", [False, True], ids=["poses", "positions"])
def test_row_M5_drift_offsets_are_a_matter_of_calibration(positions_only):
    """Row M5: from the printed constants and poses of the public model the exact model comes out, and nothing is left to offset."""
    printed = chain("mh12-report")
    theta, T = mh12_measured(60)
    found = calibrate(printed, theta, T[:, :3, 3] if positions_only else T)
    other, T_other = mh12_measured(300)
    difference = np.abs(fk(found.chain, other) - T_other)
    assert difference[:, :3, 3].max() < RECOVERED
    np.testing.assert_allclose(found.chain.screws[:4], exact_screws()[:4], atol=RECOVERED)
    held = 1e-8 if positions_only else RECOVERED  # positions do not see where the last axis points: it stays as printed
    np.testing.assert_allclose(found.chain.screws[4], exact_screws()[4], atol=held)
    check = found.check(other, T_other[:, :3, 3])
    assert 2e-4 < np.mean(check.position_before) < 3e-4  # row M1: 2.6e-4 m in the mean
    if positions_only:
        assert found.identifiability.rank == 21
        said = " / ".join(found.identifiability.unseen)
        assert "axis of joint_6_t turned about y: the tip lies on the axis of joint_6_t" in said
        assert "frame tool turned about x, y and z: positions do not show the orientation of the tip" in said
    else:
        assert difference.max() < RECOVERED
        np.testing.assert_allclose(found.chain.home[:3, 3], [0.895, 0.0, 1.264], atol=RECOVERED)


def test_row_M5_golden_poses_of_the_report():
    """The ten poses of the source, of its printed and of exact constants, are enough."""
    cases = yaml.safe_load((GOLDEN / "mh12_seed.yaml").read_text())["five_joint_poe"]
    theta = np.array([case["theta"] for case in cases])
    T = pose.nearest(np.array([case["T_exact_constants"] for case in cases]))
    found = calibrate(chain("mh12-report"), theta, T)
    other, T_other = mh12_measured(100)
    assert np.abs(fk(found.chain, other) - T_other).max() < RECOVERED


def test_jacobian_is_that_of_differences():
    for arm in (chain("ur5e"), slider(), coupled()):
        model = ScrewParameters.of(built(arm, 2), ("screws", "home", "offsets", "base"))
        q = joints(arm, 4)
        T, moves = model.jacobian(q)
        h = 1e-6
        for column in range(moves.shape[2]):
            step = np.zeros(moves.shape[2])
            step[column] = h
            change = (model.moved(step).poses(q) - model.moved(-step).poses(q)) / (2.0 * h)
            v = moves[:, :3, column] + np.cross(moves[:, 3:, column], T[:, :3, 3])
            np.testing.assert_allclose(change[:, :3, 3], v, atol=1e-8)
            turned = change[:, :3, :3] @ np.swapaxes(T[:, :3, :3], 1, 2)
            w = np.stack([turned[:, 2, 1], turned[:, 0, 2], turned[:, 1, 0]], axis=-1)
            np.testing.assert_allclose(w, moves[:, 3:, column], atol=1e-8)


def test_sigma_is_honest():
    """What is left has the chi-square of the noise, and tips are off by what the covariance says."""
    arm, sigma = chain("ur5e"), 1e-4
    real = built(arm, 4, 0.003)
    rng = np.random.default_rng(6)
    squares, freedom, shares = 0.0, 0, []
    for seed in range(25):
        q, other = joints(arm, 45, seed), joints(arm, 40, 1000 + seed)
        measured = fk(real, q)[:, :3, 3] + rng.normal(0.0, sigma, (45, 3))
        found = calibrate(arm, q, measured, position_sigma=sigma)
        squares, freedom = squares + found.chi_square, freedom + found.degrees_of_freedom
        check = found.check(other, fk(real, other)[:, :3, 3])
        shares.append(np.sum(check.position_error**2) / np.sum(check.position_sigma**2))
    assert abs(squares - freedom) < 4.0 * np.sqrt(2.0 * freedom)  # four standard deviations of chi-square
    assert 0.75 < np.mean(shares) < 1.3  # 25 fits of 27 numbers: +-5 % of one standard deviation


def test_sigma_of_parameters_is_the_scatter_of_repeated_fits():
    arm, sigma = chain("kuka_kr210_robond"), (2e-4, 1e-4)
    real, q = built(arm, 4, 0.003), joints(arm, 30)
    rng = np.random.default_rng(7)
    changes = []
    for _ in range(40):
        T = fk(real, q)
        T[:, :3, 3] += rng.normal(0.0, sigma[0], (30, 3))
        turn = pose.from_xyz_rpy(np.zeros((30, 3)), rng.normal(0.0, sigma[1], (30, 3)))
        found = calibrate(arm, q, T @ turn, position_sigma=sigma[0], rotation_sigma=sigma[1])
        changes.append(found.change)
    ratio = np.std(changes, axis=0) / found.identifiability.sigma
    assert 0.6 < ratio.min() < ratio.max() < 1.5  # 40 repetitions: 11 % of one standard deviation, 30 parameters


def test_scatter_is_taken_from_the_residuals_when_it_is_not_given():
    arm = chain("ur5e")
    q = joints(arm, 60)
    noise = np.random.default_rng(3).normal(0.0, 2e-4, (60, 3))
    found = calibrate(arm, q, fk(built(arm, 5), q)[:, :3, 3] + noise)
    assert found.noise == pytest.approx(2e-4, rel=0.2)
    assert np.isnan(found.probability)
    given = calibrate(arm, q, fk(built(arm, 5), q)[:, :3, 3] + noise, position_sigma=found.noise)
    np.testing.assert_allclose(found.identifiability.sigma, given.identifiability.sigma, rtol=1e-6)


def test_outliers_are_left_out_and_named():
    arm = chain("ur5e")
    real, q = built(arm, 4), joints(arm, 60)
    measured = fk(real, q)[:, :3, 3] + np.random.default_rng(1).normal(0.0, 1e-4, (60, 3))
    measured[[3, 17, 40]] += [0.01, 0.0, -0.005]
    found = calibrate(arm, q, measured)
    assert found.left_out.tolist() == [3, 17, 40]
    assert np.linalg.norm(found.residuals[3]) > 5e-3
    kept = calibrate(arm, q, measured, leave_out=False)
    assert kept.left_out.size == 0
    other = joints(arm, 40, 9)
    errors = [np.linalg.norm(fk(c.chain, other)[:, :3, 3] - fk(real, other)[:, :3, 3], axis=1) for c in (found, kept)]
    assert np.median(errors[0]) < 0.2 * np.median(errors[1])


def test_held_out_poses_are_predicted():
    arm = chain("yaskawa_mh12")
    real, q = built(arm, 4), joints(arm, 80)
    found = calibrate(arm, q[:60], fk(real, q[:60]))
    check = found.check(q[60:], fk(real, q[60:]))
    assert check.position_error.max() < RECOVERED
    assert check.rotation_error.max() < RECOVERED
    assert check.position_before.min() > 1e-3
    assert check.rotation_before.min() > 1e-3


def test_a_joint_that_stood_still_is_named_and_its_axis_kept():
    arm = chain("ur5e")
    q = joints(arm, 40)
    q[:, 3] = 0.0
    found = calibrate(arm, q, fk(built(arm, 4), q))
    assert found.identifiability.rank == 26
    assert any("wrist_1_joint stood still in every measurement" in words for words in found.identifiability.unseen)
    at = [p.of == "wrist_1_joint" for p in found.identifiability.parameters]
    assert np.isinf(found.identifiability.sigma[at]).all()
    np.testing.assert_allclose(found.change[at], 0.0, atol=1e-12)


def test_offsets_alone():
    arm = chain("ur5e")
    off = np.array([0.01, -0.02, 0.03, 0.004, -0.005, 0.006])
    q = joints(arm, 20)
    found = calibrate(arm, q, fk(arm, q + off), free=["offsets"])
    np.testing.assert_allclose(found.offsets, off, atol=RECOVERED)
    np.testing.assert_allclose(fk(found.chain, q), fk(arm, q + off), atol=RECOVERED)
    blind = calibrate(arm, q, fk(arm, q + off)[:, :3, 3], free=["offsets"])
    assert blind.identifiability.rank == 5
    assert "wrist_3_joint turned about its own axis does not move the tip's position" in blind.identifiability.unseen[0]


def test_offsets_and_screws_are_one_too_many():
    arm = chain("ur5e")
    q = joints(arm, 60)
    found = calibrate(arm, q, fk(built(arm, 4), q), free=["screws", "home", "offsets"])
    assert found.identifiability.rank == 30
    assert all("the zero of a joint is the same as" in words for words in found.identifiability.unseen)
    np.testing.assert_allclose(fk(found.chain, q), fk(built(arm, 4), q), atol=RECOVERED)


@pytest.mark.parametrize("free", [("base",), ("base", "screws", "home")])
def test_measurements_in_a_frame_of_their_own(free):
    arm = chain("ur5e")
    real = arm if free == ("base",) else built(arm, 4)
    T_tracker_base = pose.from_xyz_rpy([3.0, -2.0, 0.5], [0.3, -2.0, 2.5])
    q = joints(arm, 40)
    found = calibrate(arm, q, T_tracker_base @ fk(real, q), free=free)
    assert found.converged
    np.testing.assert_allclose(fk(found.chain, q), T_tracker_base @ fk(real, q), atol=RECOVERED)
    np.testing.assert_allclose(found.T_frame_base, T_tracker_base, atol=1e-8 if free == ("base",) else 0.1)
    assert found.chain.base == "measured"


def test_frames_on_the_way_go_with_their_axes():
    arm = chain("yaskawa_mh12")
    real = built(arm, 4)
    q = joints(arm, 40)
    found = calibrate(arm, q, fk(real, q)).chain
    assert [f.name for f in found.frames] == [f.name for f in arm.frames]
    for frame in arm.frames:
        moved = found.frame(frame.name).home
        assert np.linalg.norm(moved[:3, 3] - frame.home[:3, 3]) < 0.1
    np.testing.assert_allclose(fk(found, q[0], up_to=found.tip), fk(found, q[0]), atol=1e-12)


def test_the_calibrated_arm_is_solved():
    arm = chain("ur5e")
    q = joints(arm, 40)
    found = Arm(calibrate(arm, q, fk(built(arm, 4, 0.002), q)).chain)
    answers = found.ik(found.fk(q[0]))
    assert np.nanmin(np.abs(answers.q - q[0]).max(axis=-1)) < 1e-6


def test_poses_to_add_are_better_than_others():
    """Added poses shrink the volume of what the parameters may be more than the best of many random ones."""
    arm = chain("ur5e")
    real = built(arm, 4, 0.003)
    q = 0.3 * joints(arm, 15)  # close together: badly seen
    sigma = {"position_sigma": 1e-4, "rotation_sigma": 1e-4}
    found = calibrate(arm, q, fk(real, q), **sigma)

    def volume(more: np.ndarray) -> float:
        whole = np.vstack([q, more])
        return float(np.linalg.slogdet(calibrate(arm, whole, fk(real, whole), **sigma).covariance)[1])

    candidates = joints(arm, 100, 1)
    chosen = volume(found.poses_to_add(4, candidates=candidates))
    assert chosen < min(volume(candidates[4 * k : 4 * k + 4]) for k in range(25))
    assert found.poses_to_add(4, candidates=joints(arm, 10)).shape == (4, 6)
    np.testing.assert_array_equal(found.poses_to_add(3), found.poses_to_add(3))


def test_poses_to_add_without_noise():
    arm = chain("ur5e")
    q = joints(arm, 30)
    found = calibrate(arm, q, fk(arm, q))
    assert np.isfinite(found.poses_to_add(3)).all()


UR5E = chain("ur5e")
Q = joints(UR5E, 20)
P = fk(UR5E, Q)[:, :3, 3]


@pytest.mark.parametrize(
    ("q", "measured", "options", "complaint"),
    [
        (Q[:5], P[:5], {}, "5 positions give 15 numbers for 30 parameters; measure at least 10, better 30, or free less"),
        (Q[:2], fk(UR5E, Q[:2]), {}, "2 poses give 12 numbers for 30 parameters"),
        (Q[:0], P[:0], {}, "q and measured must hold at least one measurement, better some thirty, got none"),
        (np.tile(Q[0], (20, 1)), P, {}, "all 20 measurements have the same joint values; move the arm"),
        (Q, np.tile(P[0], (20, 1)), {}, "all 20 measurements are the same"),
        (np.where(Q[3, 2] == Q, np.nan, Q), P, {}, "q must be finite, got q[3, 2] = nan (joint 'elbow_joint')"),
        (Q, np.where(P[3, 1] == P, np.inf, P), {}, "measured must be finite, got inf at index (3, 1)"),
        (Q[:, :5], P, {}, "q must have shape (..., 6), got (20, 5)"),
        (Q[0], P, {}, "q must have shape (k, 6), one row a measurement, got (6,)"),
        (Q, P[:, :2], {}, "measured must have shape (..., 3), got (20, 2)"),
        (Q, P[0], {}, "measured must have shape (k, 3) for positions or (k, 4, 4) for poses, got (3,)"),
        (Q, P[:19], {}, "q and measured must have as many rows, got 20 and 19"),
        (Q, 1000.0 * P, {}, "they must be in metres, not in millimetres"),
        (Q, 2.0 * fk(UR5E, Q), {}, "measured must have the last row 0 0 0 1"),
        (Q, P, {"rotation_sigma": 1e-3}, "rotation_sigma goes with measured poses"),
        (Q, fk(UR5E, Q), {"position_sigma": 1e-3}, "measured poses need both position_sigma [m] and rotation_sigma [rad]"),
        (Q, P, {"position_sigma": 0.0}, "position_sigma must be above zero, got 0.0"),
        (Q, P, {"position_sigma": np.ones(7)}, "position_sigma must be one number, or have shape (20,) or (20, 3), got (7,)"),
        (Q, P, {"free": []}, "free must name what may change, some of screws, home, offsets, base, got none"),
    ],
)  # fmt: skip
def test_measurements_of_no_use(q, measured, options, complaint):
    with pytest.raises(ArrayError) as caught:
        calibrate(UR5E, q, measured, **options)
    assert complaint in str(caught.value)


def test_a_set_that_is_not_there():
    with pytest.raises(UnknownNameError, match="did you mean 'screws'"):
        calibrate(UR5E, Q, P, free=["screw"])


def test_a_wrong_arm_is_seen_in_what_is_left():
    """Measurements of another arm do not fit, whatever the screws: noise far above what was stated."""
    q = joints(UR5E, 40)
    found = calibrate(UR5E, q, np.random.default_rng(0).uniform(-0.5, 0.5, (40, 3)), position_sigma=1e-4)
    assert found.noise > 100.0
    assert found.probability < 1e-6
