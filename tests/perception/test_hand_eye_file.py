"""Captures and calibrations on disk: what is read, and what is said of files that cannot be."""

from __future__ import annotations

import numpy as np
import pytest

import pieper
from pieper.errors import VisionError
from pieper.perception.hand_eye import calibrate_hand_eye
from pieper.perception.hand_eye_file import load_hand_eye, read_captures, save_hand_eye, write_captures
from pieper.spatial import rotation
from pieper.yaml_file import as_yaml, read_yaml
from tests.perception.test_hand_eye import made_up

ARM = pieper.load("ur5e")
HAND = "x,y,z,qx,qy,qz,qw"
SEEN = "camera_x,camera_y,camera_z,camera_qx,camera_qy,camera_qz,camera_qw"
EYE = "0,0,0,0,0,0,1"


def columns(Ts):
    return [[*T[:3, 3], *rotation.as_quaternion(T[:3, :3])] for T in Ts]


def written(path, text):
    path.write_text(text)
    return path


def test_a_calibration_comes_back(tmp_path):
    for camera_on in ("hand", "cell"):
        _, _, hands, seen = made_up(7, 1, camera_on, noise=(1e-3, 1e-3))
        found = calibrate_hand_eye(hands, seen, camera_on=camera_on)
        save_hand_eye(tmp_path / "h.yaml", found, sources=["poses.csv"])
        on, T_mount_camera, T_holder_target = load_hand_eye(tmp_path / "h.yaml")
        assert on == camera_on
        assert np.allclose(T_mount_camera, found.T_mount_camera, atol=1e-12)
        assert np.allclose(T_holder_target, found.T_holder_target, atol=1e-12)
        told = read_yaml(tmp_path / "h.yaml")
        assert told.section("residual").sections("poses")[0].boolean("used")
        assert "T_tcp_camera" in told if camera_on == "hand" else "T_base_camera" in told


def test_poses_from_csv_and_yaml_are_the_same(tmp_path):
    _, _, hands, seen = made_up(4, 2)
    rows = [",".join(map(repr, map(float, (*a, *b)))) for a, b in zip(columns(hands), columns(seen), strict=True)]
    from_csv = read_captures(written(tmp_path / "a.csv", f"{HAND},{SEEN}\n" + "\n".join(rows) + "\n\n"))
    sections = [{"T_base_tcp": a, "T_camera_target": b} for a, b in zip(hands, seen, strict=True)]
    from_yaml = read_captures(written(tmp_path / "a.yaml", as_yaml({"poses": sections})))
    for captures in (from_csv, from_yaml):
        assert np.allclose(captures.Ts_base_tcp, hands, atol=1e-9)
        assert np.allclose(captures.Ts_camera_target, seen, atol=1e-9)
        assert captures.names == ("pose 1", "pose 2", "pose 3", "pose 4")
        assert not captures.images


def test_joint_values_and_images(tmp_path):
    q = np.array([[0.0, -1.2, 1.4, -1.7, -1.5, 0.3], [0.2, -1.0, 1.2, -1.7, -1.5, 0.3]])
    write_captures(tmp_path / "poses.csv", q, images=["a.png", "b.png"])
    captures = read_captures(tmp_path / "poses.csv", ARM)
    assert np.allclose(captures.Ts_base_tcp, ARM.fk(q))
    assert [path.name for path in captures.images] == ["a.png", "b.png"]
    assert np.allclose(captures.q, q)
    write_captures(tmp_path / "poses.csv", q)
    for name in ("1.png", "0.jpg"):
        (tmp_path / name).touch()
    captures = read_captures(tmp_path, ARM)
    assert [path.name for path in captures.images] == ["0.jpg", "1.png"]
    assert captures.names == ("0.jpg", "1.png")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "line 1: the file is empty"),
        (f"{HAND},image\n", "has no poses"),
        ("x,y,z,image\n0,0,0,a.png\n", "there is no column 'qx'"),
        ("a,q1\n", "column 'a' is not known; columns are name, q1 q2"),
        ("q1,q1\n", "column 'q1' is there twice"),
        ("q2,q1\n", "joint values are columns q1, q2, ... in order, got q2 q1"),
        ("q1,x\n", "needs columns q1 q2 ... or x y z qx qy qz qw, one of them"),
        ("name\n", "needs columns q1 q2 ... or x y z qx qy qz qw, one of them"),
        (f"{HAND},image\n0,0,0\n", "line 2: has 3 columns, and the first line has 8"),
        (f"{HAND},image\n0,0,nan,0,0,0,1,a.png\n", "line 2, z: must be a finite number, got 'nan'"),
        (f"{HAND},image\n0,0,0,0,0,0,2,a.png\n", "the quaternion qx qy qz qw must have length 1, got 2"),
        (f"{HAND}\n{EYE}\n", "line 2: needs an image or a T_camera_target, one of them"),
        (f"{HAND},image,{SEEN}\n{EYE},a.png,{EYE}\n", "line 2: needs an image or a T_camera_target, one of them"),
        (
            "q1,q2,q3,q4,q5,q6,image\n0,-68.8,80.2,-97.4,-85.9,17.2,a.png\n",
            "line 2: joint 'shoulder_lift_joint' at -68.8 is outside its limits",
        ),
        ("q1,image\n0.1,a.png\n", "ur5e has 6 joints, got 1 values"),
        ("q1,image\n\xff", "is no CSV file in UTF-8"),
    ],
)
def test_a_csv_that_cannot_be_read(tmp_path, text, words):
    path = tmp_path / "poses.csv"
    path.write_bytes(text.encode("latin-1"))
    with pytest.raises(VisionError) as error:
        read_captures(path, ARM)
    assert words in str(error.value)
    assert str(path) in str(error.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("poses: []", "has no poses"),
        ("shots: []", "no field 'shots'"),
        ("poses:\n- image: a.png", "line 2, poses[0]: needs q or T_base_tcp, one of them"),
        ("poses:\n- q: [0, 1]\n  image: a.png", "ur5e has 6 joints, got 2 values"),
        ("poses:\n- T_base_tcp: [[1,0,0,0],[0,1,0,0],[0,0,2,0],[0,0,0,1]]\n  image: a.png", "T_base_tcp: is no pose"),
        ("poses:\n- T_base_tcp: 3", "T_base_tcp"),
    ],
)
def test_a_yaml_that_cannot_be_read(tmp_path, text, words):
    with pytest.raises(VisionError) as error:
        read_captures(written(tmp_path / "poses.yaml", text), ARM)
    assert words in str(error.value)


def test_other_files_and_folders(tmp_path):
    with pytest.raises(VisionError, match=r"captures are a \.csv or a \.yaml file, or a folder"):
        read_captures(tmp_path / "poses.txt")
    with pytest.raises(VisionError, match=r"the folder has no poses\.csv or poses\.yaml"):
        read_captures(tmp_path)
    with pytest.raises(FileNotFoundError):
        read_captures(tmp_path / "none.csv")
    written(tmp_path / "poses.csv", "q1,q2,q3,q4,q5,q6\n0,0,0,0,0,0\n")
    with pytest.raises(VisionError, match=r"has 0 images, and poses\.csv has 1 poses"):
        read_captures(tmp_path, ARM)
    with pytest.raises(VisionError, match="tells joint values; say of which arm"):
        read_captures(tmp_path)
    (tmp_path / "a.csv").write_bytes(b"q1\n" + b"0\n" * 600_000)
    with pytest.raises(VisionError, match="is larger than"):
        read_captures(tmp_path / "a.csv", ARM)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("camera_on: foot", "camera_on: must be hand or cell, got 'foot'"),
        ("camera_on: hand", "T_tcp_camera: is missing"),
        ("format: pieper hand-eye 9\ncamera_on: hand", "must be 'pieper hand-eye 1', got 'pieper hand-eye 9'"),
        ("camera_on: cell\nT_base_camera: [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,2]]", "T_base_camera: is no pose"),
    ],
)
def test_a_calibration_that_cannot_be_read(tmp_path, text, words):
    with pytest.raises(VisionError) as error:
        load_hand_eye(written(tmp_path / "h.yaml", text))
    assert words in str(error.value)
