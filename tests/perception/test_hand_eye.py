"""Hand-eye calibration, against cameras whose place is known because it was made up."""

from __future__ import annotations

import re
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2
from scipy.stats import f as fisher

import pieper
from pieper.errors import PieperWarning, UnknownNameError, VisionError
from pieper.perception import hand_eye, hand_eye_forms
from pieper.perception.board import Board
from pieper.perception.board_views import BoardView
from pieper.perception.camera import Camera
from pieper.perception.capture_plan import plan_captures
from pieper.perception.hand_eye import board_pose, calibrate_hand_eye, calibrate_hand_eye_from_views
from pieper.spatial import pose, rotation
from tests.perception.board_scene import RayCaster

cv2 = pytest.importorskip("cv2", reason="OpenCV is not installed")

EXACT = 1e-9  # [m], [-] without noise
BOARD = Board.parse("charuco:5x4:0.04:0.03")
CAMERA = Camera([[420, 0, 200.3], [0, 422, 148.9], [0, 0, 1]], [-0.1, 0.02, 0, 0], (400, 300))


def made_up(count: int, seed: int, camera_on: str = "hand", *, noise=(0.0, 0.0), turn=0.4):
    """Camera, board, poses of the hand, and what the camera sees, with noise of position [m] and rotation [rad] in the board's frame."""
    rng = np.random.default_rng(seed)
    X = pose.from_position_rotation(rng.uniform(-0.2, 0.2, 3), rotation.from_rotation_vector(rng.normal(size=3)))
    ahead = [*rng.uniform(-0.3, 0.3, 2), rng.uniform(0.8, 1.6)]  # of the camera
    Y = X @ pose.from_position_rotation(ahead, rotation.from_rotation_vector(rng.normal(size=3)))
    hands = pose.from_position_rotation(
        rng.uniform(-0.4, 0.4, (count, 3)), rotation.from_rotation_vector(turn * rng.normal(size=(count, 3)))
    )
    A = hands if camera_on == "hand" else pose.inverse(hands)
    off = pose.from_position_rotation(
        noise[0] * rng.normal(size=(count, 3)), rotation.from_rotation_vector(noise[1] * rng.normal(size=(count, 3)))
    )
    return X, Y, hands, pose.inverse(A @ X) @ Y @ off


def away(T, truth):
    """Position [m] and rotation vector [rad] of an error, in the axes of the mount."""
    return np.concatenate([T[:3, 3] - truth[:3, 3], rotation.as_rotation_vector(T[:3, :3] @ truth[:3, :3].T)])


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10_000), count=st.sampled_from([3, 4, 7]), camera_on=st.sampled_from(["hand", "cell"]))
def test_without_noise_the_camera_is_found_exactly(seed, count, camera_on):
    X, Y, hands, seen = made_up(count, seed, camera_on)
    found = calibrate_hand_eye(hands, seen, camera_on=camera_on)
    assert abs(found.T_mount_camera - X).max() < EXACT
    assert abs(found.T_holder_target - Y).max() < EXACT
    assert found.used.all()
    assert found.position_residual.max() < EXACT
    assert found.rotation_residual.max() < EXACT
    names = {method.name for method in found.methods}
    assert {"pairs", "product"} <= names
    assert all(method.position_away < 1e-6 for method in found.methods if method.name in ("pairs", "product"))


def test_half_turns_of_the_hand_are_no_special_case():
    X, Y, _, _ = made_up(3, 5)
    turns = np.array([[0, 0, 0], [np.pi, 0, 0], [0, np.pi, 0], [0.4, 0.3, 0], [0, 0, np.pi]])
    hands = pose.from_position_rotation(
        np.random.default_rng(0).uniform(-0.3, 0.3, (5, 3)), rotation.from_rotation_vector(turns)
    )
    found = calibrate_hand_eye(hands, pose.inverse(hands @ X) @ Y)
    assert abs(found.T_mount_camera - X).max() < EXACT


def test_where_the_camera_is_in_the_base():
    X, _, hands, seen = made_up(5, 2)
    on_hand = calibrate_hand_eye(hands, seen)
    assert np.allclose(on_hand.T_base_camera(hands), hands @ X, atol=EXACT)
    with pytest.raises(VisionError, match="the camera is on the hand: give T_base_tcp"):
        on_hand.T_base_camera()
    X, _, hands, seen = made_up(5, 3, "cell")
    assert np.allclose(calibrate_hand_eye(hands, seen, camera_on="cell").T_base_camera(), X, atol=EXACT)


def test_the_uncertainty_is_honest():
    """Squared errors over the covariance are chi-square with six degrees of freedom, but for the noise that is itself estimated."""
    squares = []
    for seed in range(25):
        X, _, hands, seen = made_up(14, seed, noise=(1e-3, 2e-3))
        found = calibrate_hand_eye(hands, seen)
        error = away(found.T_mount_camera, X)
        squares.append(error @ np.linalg.solve(found.covariance, error))
    low, high = chi2.ppf([1e-3, 1 - 1e-3], 6 * len(squares))
    assert low < sum(squares) < 1.25 * high  # the estimated noise widens it: F(6, 36) has the mean 6.35
    assert np.mean(np.array(squares) < chi2.ppf(0.99, 6)) > 0.9


@pytest.mark.parametrize("camera_on", ["hand", "cell"])
def test_odd_poses_are_left_out_and_named(camera_on):
    X, _, hands, seen = made_up(13, 4, camera_on, noise=(5e-4, 1e-3))
    seen = seen.copy()
    seen[3, :3, 3] += [0.03, 0.0, 0.02]
    seen[9] = seen[9] @ pose.from_xyz_rpy([0, 0, 0], [0.1, 0, 0])
    hands[11] = hands[10]  # the arm had not moved yet
    names = [f"shot {k}" for k in range(13)]
    found = calibrate_hand_eye(hands, seen, camera_on=camera_on, names=names)
    assert np.flatnonzero(~found.used).tolist() == [3, 9, 11]
    assert [words.split(":")[0] for words in found.left_out] == ["shot 3", "shot 9", "shot 11"]
    assert re.search(r"shot 3: 3[567]", found.left_out[0])
    assert "mm" in found.left_out[0]
    assert abs(away(found.T_mount_camera, X)[:3]).max() < 5 * found.position_deviation.max()


def test_what_is_missing_is_said():
    _, _, hands, seen = made_up(6, 1, turn=0.03)
    few = calibrate_hand_eye(hands, seen)
    assert "add poses turned by 20 to 40 deg about" in few.missing[0]
    assert "4 more" in few.missing[1]
    assert not calibrate_hand_eye(*made_up(12, 1, turn=0.5)[2:]).missing
    report = few.report()
    assert "camera in the frame of the tcp" in report
    assert "missing" in report


def test_poses_that_repeat_others_are_named_and_not_counted():
    _, _, hands, seen = made_up(10, 4, noise=(1e-4, 1e-4))
    again = np.array([0, 1, 2, 3, 4, 5, 6, 7, 8, 2, 9, 2])
    with pytest.warns(PieperWarning, match="pose 10 repeats pose 3, pose 12 repeats pose 3: what is seen twice"):
        found = calibrate_hand_eye(hands[again], seen[again])
    assert found.missing == ()
    assert "doubt     pose 10 repeats pose 3" in found.report()
    with pytest.warns(PieperWarning, match="pose 10 repeats pose 3"):
        fewer = calibrate_hand_eye(hands[again[:-2]], seen[again[:-2]])
    assert "9 poses say little" in fewer.missing[0]  # of ten


@settings(max_examples=10, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    factor=st.sampled_from([0.9, 0.97, 1.03, 1.1]),
    camera_on=st.sampled_from(["hand", "cell"]),
)
def test_a_board_of_another_size_is_noticed(seed, factor, camera_on):
    _, _, hands, seen = made_up(15, seed, camera_on, noise=(1e-4, 1e-4))
    assert calibrate_hand_eye(hands, seen, camera_on=camera_on).doubts == ()
    seen[:, :3, 3] *= factor  # a board that is larger than was said is taken to be nearer
    with pytest.warns(
        PieperWarning, match="the motions of the hand fit a board that is .* than was said: measure a square"
    ):
        found = calibrate_hand_eye(hands, seen, camera_on=camera_on)
    (words,) = found.doubts
    assert f"% {'larger' if factor < 1.0 else 'smaller'} than" in words
    measured = float(words.split("board that is ")[1].split(" +-")[0])
    assert measured == pytest.approx(100.0 * abs(1.0 / factor - 1.0), abs=0.2)


def test_noise_alone_is_no_board_of_another_size():
    for seed in range(20):
        _, _, hands, seen = made_up(8, seed, noise=(3e-3, 3e-3))
        assert calibrate_hand_eye(hands, seen).doubts == ()


def in_millimetres(Ts):
    return pose.from_position_rotation(1e3 * Ts[:, :3, 3], Ts[:, :3, :3])


def bad(change):
    _, _, hands, seen = made_up(6, 7)
    return change(hands, seen)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda h, s: (h[:2], s[:2]), "3 poses are needed, better 10, got 2"),
        (lambda h, s: (h[:5], s), "one Ts_camera_target for each of Ts_base_tcp, got 6 and 5"),
        (lambda h, s: (np.tile(h[0], (6, 1, 1)), np.tile(s[0], (6, 1, 1))), "the hand does not turn between the poses"),
        (lambda h, s: (pose.from_position_rotation(h[:, :3, 3], np.eye(3)), s), "shifts alone say nothing of where the camera is"),
        (lambda h, s: (np.where(np.arange(6)[:, None, None] == 2, np.nan, h), s), r"Ts_base_tcp\[2\] must be finite"),
        (lambda h, s: (h @ np.diag([1, 1, -1, 1]), s), r"Ts_base_tcp\[0\] is no pose: its axes are left-handed"),
        (lambda h, s: (in_millimetres(h), in_millimetres(s)), r"Ts_base_tcp: the hand is [345]\d\d(\.\d)? m away; .* if these are millimetres"),
        (lambda h, s: (h, in_millimetres(s)), r"Ts_camera_target: the board is 1?\d\d\d(\.\d)? m away"),
        (lambda h, s: (h, np.diag([1, -1, -1, 1]) @ s), r"the board is behind the camera in 6 of 6 poses.*OpenGL"),
        (lambda h, s: (h, s * 2.0), r"Ts_camera_target\[0\] is no pose"),
        (lambda h, s: (h[:, :3], s), r"Ts_base_tcp must have shape \(n, 4, 4\), got \(6, 3, 4\)"),
        (lambda h, s: (h, "seen"), r"Ts_camera_target must be numbers"),
        (lambda h, s: (h, pose.inverse(s)), "takes coordinates of the board into its frame, not back"),
        (lambda h, s: (pose.inverse(h), s), "with camera_on='cell', or with the inverse of Ts_camera_target, they agree"),
    ],
)  # fmt: skip
def test_bad_input_is_refused_in_words(change, words):
    with pytest.raises(VisionError, match=words):
        calibrate_hand_eye(*bad(change))


def test_turns_about_one_axis_are_not_enough():
    X, Y, hands, _ = made_up(6, 8)
    axis = np.array([0.0, 0.6, 0.8])
    hands[:, :3, :3] = rotation.from_rotation_vector(np.linspace(0, 2, 6)[:, None] * axis)
    with pytest.raises(
        VisionError, match=r"about one axis, \(0.00, 0.60, 0.80\) in the frame of the tip: where the camera is along it"
    ):
        calibrate_hand_eye(hands, pose.inverse(hands @ X) @ Y)


def test_poses_of_which_half_contradict_are_refused():
    _, _, hands, seen = made_up(9, 9)
    seen[:4, :3, 3] += np.random.default_rng(0).normal(size=(4, 3)) * 0.02
    with pytest.raises(
        VisionError, match=r"4 of 9 would have to be left out.* and is the camera on the hand, as was said"
    ):
        calibrate_hand_eye(hands, seen)
    with pytest.raises(UnknownNameError, match="camera_on"):
        calibrate_hand_eye(hands, seen, camera_on="foot")
    with pytest.raises(VisionError, match="a name for every pose, got 1 names and 9 poses"):
        calibrate_hand_eye(hands, seen, names=["one"])


def test_the_solvers_of_opencv_are_asked_where_it_has_them(monkeypatch):
    """Its Python package 5.0.0 has only their names: there, stand-ins that get and give what the real ones do."""
    _, Y, hands, seen = made_up(8, 10)
    if not hasattr(cv2, "calibrateHandEye"):

        def stacked(R, t):
            return pose.from_position_rotation(np.array(t), np.array(R))

        def eye(R_hand, t_hand, R_seen, t_seen, method):
            T, _ = hand_eye_forms.by_pairs(stacked(R_hand, t_hand), stacked(R_seen, t_seen))
            return T[:3, :3], T[:3, 3:]

        def world(R_seen, t_seen, R_base, t_base, method):
            T, U = (
                pose.inverse(M)
                for M in hand_eye_forms.by_product(pose.inverse(stacked(R_base, t_base)), stacked(R_seen, t_seen))
            )
            if method == cv2.CALIB_ROBOT_WORLD_HAND_EYE_LI:
                raise cv2.error("no")
            return U[:3, :3], U[:3, 3:], T[:3, :3], T[:3, 3:]

        there = SimpleNamespace(**{name: getattr(cv2, name) for name in dir(cv2) if name.startswith("CALIB_")})
        there.calibrateHandEye, there.calibrateRobotWorldHandEye = eye, world
        monkeypatch.setattr(hand_eye_forms, "opencv", lambda purpose: there)
    found = calibrate_hand_eye(hands, seen)
    assert {"OpenCV Tsai", "OpenCV Park", "OpenCV Daniilidis", "OpenCV Shah"} <= {m.name for m in found.methods}
    for method in found.methods:
        assert method.position_away < 1e-6, method.name
        assert method.rotation_away < 1e-6, method.name
    assert abs(found.T_holder_target - Y).max() < EXACT


# --- from images


def pictured(camera_on: str, seed: int = 0, count: int = 12, noise=1.0):
    """Exact pictures of a board from planned poses of a UR5e, and the truth."""
    arm = pieper.load("ur5e")
    q = np.array([0.0, -1.3, 1.5, -1.7, -1.5, 0.0])
    if camera_on == "hand":
        X, Y = (
            pose.from_xyz_rpy([0.04, -0.02, 0.05], [0.1, 0.0, 0.3]),
            pose.from_xyz_rpy([-0.5, -0.1, 0.02], [np.pi, 0.0, 0.5]),
        )
    else:
        X, Y = (
            pose.from_xyz_rpy([-1.0, -0.2, 0.6], [-1.8, 0.0, -1.5]),
            pose.from_xyz_rpy([-0.1, 0.08, 0.03], [np.pi, 0.0, 0.1]),
        )
    plan = plan_captures(
        arm, CAMERA, BOARD, camera_on=camera_on, T_mount_camera=X, T_holder_target=Y, count=count, q_near=q, seed=seed
    )
    rays = RayCaster(CAMERA, sides=3)
    views, hands = [], []
    for k, (T_base_tcp, T) in enumerate(zip(plan.Ts_base_tcp, plan.Ts_camera_target, strict=True)):
        found = BOARD.find(rays.image(T, BOARD.is_white, noise=noise, blur=0.4, seed=k))
        if found is not None:
            views.append(BoardView(f"{k}.png", *found))
            hands.append(T_base_tcp)
    return X, Y, np.array(hands), views


@pytest.mark.parametrize("camera_on", ["hand", "cell"])
def test_pictures_of_a_board_from_planned_poses(camera_on):
    X, _, hands, views = pictured(camera_on)
    assert len(views) >= 10
    found = calibrate_hand_eye_from_views(hands, views, BOARD, CAMERA, camera_on=camera_on)
    assert found.pixel_rms < 0.1
    assert np.linalg.norm(found.T_mount_camera[:3, 3] - X[:3, 3]) < 1e-3
    error = away(found.T_mount_camera, X)
    assert error @ np.linalg.solve(found.covariance, error) < chi2.ppf(1 - 1e-4, 6)
    from_poses = calibrate_hand_eye(hands, [board_pose(view, BOARD, CAMERA) for view in views], camera_on=camera_on)
    assert np.linalg.norm(from_poses.T_mount_camera[:3, 3] - X[:3, 3]) < 5e-3


def corners(T, count=None):
    uv = CAMERA.project(BOARD.corners @ T[:3, :2].T + T[:3, 3])
    return np.arange(len(uv)), uv


def test_corners_say_who_is_odd():
    X, Y, hands, _ = made_up(10, 11)
    rng = np.random.default_rng(0)
    X = pose.from_xyz_rpy([0.0, 0.0, 0.1], [0.0, 0.0, 0.0])
    middle = np.array([0.1, 0.08, 0.0])
    turns = rotation.from_rotation_vector(rng.uniform(-0.4, 0.4, (10, 3)))
    seen = pose.from_position_rotation(
        np.array([0, 0, 0.4]) + rng.uniform(-0.03, 0.03, (10, 3)) - turns @ middle, turns
    )
    hands = Y @ pose.inverse(seen) @ pose.inverse(X)
    views = [BoardView(f"{k}.png", *corners(T)) for k, T in enumerate(seen)]
    views[4] = BoardView("4.png", views[4].ids, views[4].uv + np.array([6.0, 0.0]))
    found = calibrate_hand_eye_from_views(hands, views, BOARD, CAMERA)
    assert np.flatnonzero(~found.used).tolist() == [4]
    assert found.left_out[0].startswith("4.png: ")
    assert "px RMS off" in found.left_out[0]
    assert abs(found.T_mount_camera - X).max() < 1e-6
    with pytest.raises(VisionError, match="a view for every pose, got 9 views and 10 poses"):
        calibrate_hand_eye_from_views(hands, views[:9], BOARD, CAMERA)


def test_the_uncertainty_from_corners_knows_errors_of_the_robot():
    """Squared errors over a covariance from 14 poses are Hotelling's T2 with 13 degrees of freedom, when the robot errs by more than the corners do."""
    limit = 6 * 13 / 8 * fisher.ppf(0.99, 6, 8)
    X, Y = pose.from_xyz_rpy([0.02, 0.0, 0.1], [0.0, 0.2, 0.0]), pose.from_xyz_rpy([0.5, 0.0, 0.0], [np.pi, 0.0, 0.0])
    squares = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        turns = rotation.from_rotation_vector(rng.uniform(-0.6, 0.6, (14, 3)))
        places = np.array([0.0, 0.0, 0.45]) + rng.uniform(-0.03, 0.03, (14, 3)) - turns @ np.array([0.1, 0.08, 0.0])
        seen = pose.from_position_rotation(places, turns)
        off = pose.from_position_rotation(
            3e-4 * rng.normal(size=(14, 3)), rotation.from_rotation_vector(1e-3 * rng.normal(size=(14, 3)))
        )
        views = [BoardView(f"{k}.png", *corners(T)) for k, T in enumerate(seen)]
        found = calibrate_hand_eye_from_views(Y @ pose.inverse(seen) @ pose.inverse(X) @ off, views, BOARD, CAMERA)
        error = away(found.T_mount_camera, X)
        squares.append(error @ np.linalg.solve(found.covariance, error))
    assert sum(square > limit for square in squares) <= 1
    assert np.median(squares) > 1.0


def test_a_chessboard_that_was_found_upside_down_is_turned():
    board = Board.parse("chessboard:5x4:0.03")
    rng = np.random.default_rng(1)
    X, Y = pose.from_xyz_rpy([0.0, 0.0, 0.1], [0.0, 0.2, 0.0]), pose.from_xyz_rpy([0.5, 0.0, 0.0], [np.pi, 0.0, 0.0])
    turns = rotation.from_rotation_vector(rng.uniform(-0.5, 0.5, (10, 3)))
    seen = pose.from_position_rotation(
        np.array([0, 0, 0.5]) + rng.uniform(-0.03, 0.03, (10, 3)) - turns @ [0.09, 0.075, 0.0], turns
    )
    hands = Y @ pose.inverse(seen) @ pose.inverse(X)
    views = []
    for k, T in enumerate(seen):
        uv = CAMERA.project(board.corners @ T[:3, :2].T + T[:3, 3])
        views.append(BoardView(f"{k}.png", np.arange(len(uv)), uv[::-1] if k in (2, 7) else uv))
    found = calibrate_hand_eye_from_views(hands, views, board, CAMERA)
    assert found.used.all()
    assert abs(found.T_mount_camera - X).max() < 1e-6


# --- from where to look


@pytest.mark.parametrize("camera_on", ["hand", "cell"])
def test_a_plan_is_reachable_in_view_and_better_than_chance(camera_on):
    arm = pieper.load("ur5e")
    X, Y = (
        pose.from_xyz_rpy([0.04, 0.0, 0.05], [0.0, 0.0, 0.3]),
        pose.from_xyz_rpy([-0.5, -0.1, 0.02], [np.pi, 0.0, 0.5]),
    )
    if camera_on == "cell":
        X, Y = (
            pose.from_xyz_rpy([-1.0, -0.2, 0.6], [-1.8, 0.0, -1.5]),
            pose.from_xyz_rpy([-0.1, 0.08, 0.03], [np.pi, 0.0, 0.1]),
        )
    asked = []

    def usable(q):
        asked.append(q)
        return q[0] < 2.0

    plan = plan_captures(
        arm, CAMERA, BOARD, camera_on=camera_on, T_mount_camera=X, T_holder_target=Y, count=6, usable=usable, seed=3
    )
    assert asked
    assert (plan.q[:, 0] < 2.0).all()
    assert ((plan.q >= arm.limits[:, 0]) & (plan.q <= arm.limits[:, 1])).all()
    assert np.allclose(arm.fk(plan.q), plan.Ts_base_tcp, atol=1e-8)
    for T in plan.Ts_camera_target:
        _, uv = corners(T)
        assert ((uv > 0) & (uv < CAMERA.size)).all()
    found = calibrate_hand_eye(plan.Ts_base_tcp, plan.Ts_camera_target, camera_on=camera_on)
    assert abs(found.T_mount_camera - X).max() < EXACT
    assert found.turns[1] > hand_eye.ENOUGH_TURN
    more = plan_captures(
        arm,
        CAMERA,
        BOARD,
        camera_on=camera_on,
        T_mount_camera=X,
        T_holder_target=Y,
        count=3,
        have=plan.Ts_base_tcp,
        seed=4,
    )
    assert more.position_deviation < plan.position_deviation
    assert more.rotation_deviation < plan.rotation_deviation


def test_a_plan_that_cannot_be():
    arm = pieper.load("ur5e")
    far, eye = pose.from_xyz_rpy([5.0, 0.0, 0.0], [np.pi, 0.0, 0.0]), np.eye(4)
    with pytest.raises(
        VisionError,
        match=r"the arm reaches 0 of .* places from which the board would be seen, and 12 poses are asked for",
    ):
        plan_captures(arm, CAMERA, BOARD, camera_on="hand", T_mount_camera=eye, T_holder_target=far)
    with pytest.raises(VisionError, match="count must be 1 or more, got 0"):
        plan_captures(arm, CAMERA, BOARD, camera_on="hand", T_mount_camera=eye, T_holder_target=far, count=0)
    with pytest.raises(
        VisionError, match=r"T_mount_camera must be a finite pose of shape \(4, 4\), got shape \(3, 3\)"
    ):
        plan_captures(arm, CAMERA, BOARD, camera_on="hand", T_mount_camera=np.eye(3), T_holder_target=far)
    with pytest.raises(UnknownNameError, match="camera_on"):
        plan_captures(arm, CAMERA, BOARD, camera_on="foot", T_mount_camera=eye, T_holder_target=far)
