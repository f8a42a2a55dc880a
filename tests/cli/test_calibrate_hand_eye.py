"""``pieper calibrate-hand-eye``: plan, capture, calibrate, add; and what it says when it does not work."""

from __future__ import annotations

import numpy as np
import pytest

import pieper
from pieper.perception.calibration_file import save_camera
from pieper.perception.hand_eye_file import load_hand_eye, read_captures
from pieper.spatial import pose
from pieper.yaml_file import write_yaml
from tests.perception.board_scene import RayCaster
from tests.perception.test_hand_eye import BOARD, CAMERA, made_up

cv2 = pytest.importorskip("cv2", reason="OpenCV is not installed")

ARM = pieper.load("ur5e")
TRUE = pose.from_xyz_rpy([0.04, -0.02, 0.05], [0.1, 0.0, 0.3])
BOARD_AT = pose.from_xyz_rpy([-0.5, -0.1, 0.02], [np.pi, 0.0, 0.5])
NEAR = 2e-3  # [m] from 9 small pictures


@pytest.fixture
def lens(tmp_path):
    save_camera(tmp_path / "camera.yaml", CAMERA)
    return ["--arm", "ur5e", "--camera", tmp_path / "camera.yaml", "--board", BOARD]


def rough(path):
    write_yaml(
        path,
        {
            "camera_on": "hand",
            "T_tcp_camera": TRUE @ pose.from_xyz_rpy([0.02, 0.0, -0.02], [0.05, 0, 0]),
            "T_base_target": BOARD_AT @ pose.from_xyz_rpy([0.0, 0.02, 0.0], [0, 0, 0.05]),
        },
    )
    return path


def test_plan_capture_calibrate_and_add(pieper_command, lens, tmp_path):
    folder = tmp_path / "captures"
    folder.mkdir()
    planned = pieper_command(
        "calibrate-hand-eye",
        *lens,
        "--plan",
        folder / "poses.csv",
        "--count",
        9,
        "--guess",
        rough(tmp_path / "rough.yaml"),
    )
    assert planned.code == 0, planned.err
    assert "9 poses of" in planned.out
    captures = read_captures(folder / "poses.csv", ARM)
    rays = RayCaster(CAMERA, sides=3)
    for path, T_base_tcp in zip(captures.images, captures.Ts_base_tcp, strict=True):
        seen = pose.inverse(T_base_tcp @ TRUE) @ BOARD_AT
        cv2.imwrite(str(path), rays.image(seen, BOARD.is_white, blur=0.4))
    out = tmp_path / "hand_eye.yaml"
    result = pieper_command(
        "calibrate-hand-eye", folder, *lens, "--out", out, "--plan", tmp_path / "more.csv", "--count", 3
    )
    assert result.code == 0, result.err
    assert "camera in the frame of the tcp" in result.out
    assert "px RMS over their corners" in result.out
    on, T, T_board = load_hand_eye(out)
    assert on == "hand"
    assert np.linalg.norm(T[:3, 3] - TRUE[:3, 3]) < NEAR
    assert np.linalg.norm(T_board[:3, 3] - BOARD_AT[:3, 3]) < NEAR
    assert len(read_captures(tmp_path / "more.csv", ARM).images) == 3


def pairs(path, count=8, camera_on="cell"):
    X, _, hands, seen = made_up(count, 3, camera_on)
    write_yaml(path, {"poses": [{"T_base_tcp": a, "T_camera_target": b} for a, b in zip(hands, seen, strict=True)]})
    return X


def test_pairs_of_poses_are_enough(pieper_command, tmp_path):
    X = pairs(tmp_path / "pairs.yaml")
    out = tmp_path / "hand_eye.yaml"
    result = pieper_command("calibrate-hand-eye", tmp_path / "pairs.yaml", "--camera-on", "cell", "--out", out)
    assert result.code == 0, result.err
    assert "camera in the frame of the base" in result.out
    on, T, _ = load_hand_eye(out)
    assert on == "cell"
    assert abs(T - X).max() < 1e-9


def test_what_cannot_be_calibrated(pieper_command, lens, tmp_path):
    pairs(tmp_path / "pairs.yaml")
    pairs(tmp_path / "two.yaml", 2)
    (tmp_path / "images.csv").write_text("x,y,z,qx,qy,qz,qw,image\n0,0,0,0,0,0,1,a.png\n")
    cv2.imwrite(str(tmp_path / "a.png"), np.full((30, 40, 3), 90, np.uint8))
    out = tmp_path / "hand_eye.yaml"
    for arguments, words in (
        ([], "give captures to calibrate from, or --plan FILE to plan them"),
        ([tmp_path / "pairs.yaml", "--camera-on", "foot"], "--camera-on must be hand or cell, got 'foot'"),
        ([tmp_path / "pairs.yaml", "--camera-on", "hand"], "with camera_on='cell', or with the inverse of"),
        ([tmp_path / "two.yaml"], "3 poses are needed"),
        ([tmp_path / "none.yaml"], "none.yaml"),
        ([tmp_path / "images.csv"], "give the lens with --camera"),
        ([tmp_path / "images.csv", *lens], "the image is 40 x 30 pixels and the camera is calibrated for 400 x 300"),
        (["--plan", tmp_path / "p.txt"], "--plan writes a .csv"),
        (["--plan", tmp_path / "p.csv"], "a plan needs the arm and the lens: give --arm and --camera"),
        (["--plan", tmp_path / "p.csv", *lens], "about where camera and board are: give --guess FILE, or captures"),
    ):
        result = pieper_command("calibrate-hand-eye", *arguments, "--out", out)
        assert result.code == 2, arguments
        assert words in result.err
        assert not out.exists()
    result = pieper_command("calibrate-hand-eye", tmp_path / "pairs.yaml", "--out", tmp_path / "pairs.yaml")
    assert "is what is read; it would be lost" in result.err
