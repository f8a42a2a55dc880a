"""Hand-eye calibration: from where to look, what the camera saw, where it is, and which poses were no good."""

import numpy as np

import pieper
from pieper.errors import MissingExtraError, VisionError
from pieper.perception.board import Board
from pieper.perception.camera import Camera
from pieper.perception.capture_plan import plan_captures
from pieper.perception.hand_eye import calibrate_hand_eye
from pieper.spatial import pose, rotation

arm = pieper.load("ur5e")
camera = Camera(np.array([[900, 0, 639.5], [0, 900, 479.5], [0, 0, 1]]), np.zeros(0), (1280, 960))
T_tcp_camera = pose.from_xyz_rpy([0.05, 0.0, 0.04], [0.0, 0.0, 1.55])  # the truth, which a calibration has to find
T_base_board = pose.from_xyz_rpy([-0.5, 0.1, 0.0], [np.pi, 0.0, 0.4])
ruler = pose.from_xyz_rpy([0.02, -0.01, 0.01], [0.05, -0.03, 0.02])  # how far off a first guess is

try:
    board = Board.parse("charuco:7x5:0.03:0.022")
    plan = plan_captures(
        arm,
        camera,
        board,
        camera_on="hand",
        T_mount_camera=T_tcp_camera @ ruler,
        T_holder_target=T_base_board,
        count=12,
    )
    print(
        f"the arm reaches {plan.reached} of {plan.tried} places; with these {len(plan.q)} the camera will be known to"
    )
    print(f"  about {1e3 * plan.position_deviation:.2f} mm and {np.degrees(plan.rotation_deviation):.3f} deg")

    # what the camera sees from there, with 0.5 mm and 0.1 deg of noise; once somebody kicked the board
    rng = np.random.default_rng(0)
    turns = rotation.from_rotation_vector(rng.normal(0.0, np.radians(0.1), (12, 3)))
    noise = pose.from_position_rotation(rng.normal(0.0, 5e-4, (12, 3)), turns)
    Ts_camera_board = pose.inverse(plan.Ts_base_tcp @ T_tcp_camera) @ T_base_board @ noise
    Ts_camera_board[7, :3, 3] += 0.02  # m

    found = calibrate_hand_eye(plan.Ts_base_tcp, Ts_camera_board, camera_on="hand")
    print(found.report())
    position, turn = pose.distance(found.T_mount_camera, T_tcp_camera)
    print(f"off the truth by {1e3 * position:.2f} mm and {np.degrees(turn):.3f} deg")

    calibrate_hand_eye(plan.Ts_base_tcp[:1].repeat(5, axis=0), Ts_camera_board[:1].repeat(5, axis=0))
except MissingExtraError as reason:
    print(f"not calibrated: {reason}")
except VisionError as reason:
    print(f"five times the same pose: {reason}")
