"""``pieper move``: motions into files, and what is said where there is none."""

from __future__ import annotations

import json

import numpy as np
import pytest

import pieper
from pieper.cli.main import main
from pieper.motion import files
from pieper.motion.limits import JointLimits
from pieper.motion.timing import usage

START = "0.3,-1.2,1.4,-1.7,-1.5,0.3"
LIMITS = ["--acceleration", "8", "--jerk", "80"]


def test_a_joint_move_goes_to_a_file_within_its_limits(tmp_path, capsys):
    file = tmp_path / "move.csv"
    assert main(["move", "ur5e", "--from", START, "--to", "0.8,-1,1.2,-1.7,-1.5,0.3", *LIMITS, "--out", str(file)]) == 0
    said = capsys.readouterr()
    assert "straight in joint space" in said.out
    assert f"wrote {file}" in said.err
    made = files.read(file)
    np.testing.assert_allclose(made.q[-1], [0.8, -1, 1.2, -1.7, -1.5, 0.3])
    chain = pieper.load("ur5e").chain
    assert max(usage(made, JointLimits.of(chain, max_acceleration=8, max_jerk=80))) <= 1 + 1e-6


def test_a_straight_line_keeps_the_tip_on_it(tmp_path):
    file = tmp_path / "move.npz"
    target = ["--target", "0.45", "-0.1", "0.5", "--straight", "--tip-velocity", "0.25", "--rate", "250"]
    assert main(["move", "ur5e", "--from", START, *target, "--out", str(file)]) == 0
    made, arm = files.read(file), pieper.load("ur5e")
    T = arm.fk(made.q)
    way = T[-1, :3, 3] - T[0, :3, 3]
    off = np.cross(T[:, :3, 3] - T[0, :3, 3], way / np.linalg.norm(way))
    assert np.linalg.norm(off, axis=1).max() < 1e-5
    np.testing.assert_allclose(T[-1, :3, 3], [0.45, -0.1, 0.5], atol=1e-9)
    np.testing.assert_allclose(T[:, :3, :3], np.broadcast_to(T[0, :3, :3], (len(T), 3, 3)), atol=1e-5)
    speed = np.linalg.norm(np.diff(T[:, :3, 3], axis=0), axis=1) / np.diff(made.t)
    assert speed.max() <= 0.25 * (1 + 1e-6)


def test_json_is_a_message_with_what_was_used(capsys):
    assert main(["move", "ur5e", "--from", START, "--target", "0.4", "-0.1", "0.5", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["reached"] is True
    assert said["trajectory"]["joint_names"] == list(pieper.load("ur5e").joint_names)
    assert said["limits_used"]["jerk"] <= 1 + 1e-6


def test_a_break_is_told_with_its_place(capsys):
    target = ["--target", "1.5", "-0.1", "0.5"]
    assert main(["move", "ur5e", "--from", START, *target, "--straight"]) == 1
    assert "not reached  at 0.2" in capsys.readouterr().out
    assert main(["move", "ur5e", "--from", START, *target, "--straight", "--json"]) == 1
    said = json.loads(capsys.readouterr().out)
    assert said["reached"] is False
    assert 0.27 < said["break"]["s"] < 0.29
    assert main(["move", "ur5e", "--from", START, *target]) == 1
    assert "out of reach" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "give one of --to"),
        (["--to", START, "--target", "1", "1", "1"], "give one of --to"),
        (["--to", START, "--rpy", "0", "0", "0"], "belong to --target"),
        (["--to", START, "--out", "move.txt"], "--out must end in .csv, .json, .npz"),
        (["--to", START, "--jerk", "0"], "max_jerk must be above 0"),
        (["--to", START, "--tip-velocity", "nan"], "limit velocity of the tip must be above 0"),
        (["--to", "0,0,4,0,0,0"], "outside its limits"),
        (["--to", START, "--rate", "0"], "rate must be above 0"),
        (["--to", START, "--rate", "nan"], "rate must be above 0"),
        (["--to", "nan,0,0,0,0,0"], "must be finite"),
        (["--to", "inf,0,0,0,0,0"], "must be finite"),
        (["--from", "nan,0,0,0,0,0", "--to", START], "must be finite"),
        (["--from", "9,0,0,0,0,0", "--to", START], "at 9 rad is outside its limits"),
        (["--target", "nan", "0", "0"], "must be finite"),
        (["--target", "inf", "0", "0", "--straight"], "must be finite"),
        (["--to", START, "--velocity", "0"], "max_velocity must be above 0"),
        (["--to", START, "--velocity", "inf"], "max_velocity must be finite"),
        (["--to", START, "--acceleration", "nan"], "max_acceleration must be finite"),
        (["--to", START, "--jerk", "inf"], "max_jerk must be finite"),
        (["--to", START, "--tip-velocity", "0"], "limit velocity of the tip must be above 0"),
        (["--target", "0.4", "0.3", "0.4", "--quat", "0", "0", "0", "0"], "quaternion xyzw must not be zero"),
    ],
)
def test_bad_input_is_refused(arguments, words, capsys):
    assert main(["move", "ur5e", *arguments]) == 2
    assert words in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize("way", [[], ["--straight"]])
def test_a_move_of_nothing_is_a_point(way, tmp_path):
    file = tmp_path / "move.csv"
    assert main(["move", "ur5e", "--from", START, "--to", START, "--rate", "100", "--out", str(file), *way]) == 0
    made = files.read(file)
    assert (made.duration, len(made.t)) == (0.0, 1)


def test_an_arm_with_a_straight_wrist_is_told_how_to_begin(capsys):
    assert main(["move", "kr210", "--target", "2.0", "0.3", "1.6", "--straight", "--json"]) == 1
    said = json.loads(capsys.readouterr().out)
    assert said["break"]["reason"] == "singularity"
    start = ",".join(map(str, said["break"]["start"]))
    assert main(["move", "kr210", "--from", start, "--target", "2.0", "0.3", "1.6", "--straight"]) == 0


@pytest.mark.parametrize("way", [[], ["--straight"]])
@pytest.mark.parametrize(("name", "start"), [("so101", "0,0,0.3,0.4,0.2"), ("youbot", "3,1.5,-1,1.8,3")])
def test_an_arm_with_five_joints_goes_to_a_position(name, start, way, tmp_path):
    file = tmp_path / "move.csv"
    arm = pieper.load(name)
    q = np.array([float(value) for value in start.split(",")])
    p = arm.fk(q + np.array([0.15, 0.15, -0.1, 0.05, 0.0]))[:3, 3]
    where = [f"{value:.4f}" for value in p]
    assert main(["move", name, "--from", start, "--target", *where, "--out", str(file), *way]) == 0
    made = files.read(file)
    at = arm.fk(made.sample(np.linspace(0.0, made.duration, 50)).q)[:, :3, 3]
    np.testing.assert_allclose(at[-1], np.array(where, dtype=float), rtol=0, atol=1e-8)
    if way:
        along = (at[-1] - at[0]) / np.linalg.norm(at[-1] - at[0])
        aside = np.cross(at - at[0], along)
        np.testing.assert_allclose(aside, 0.0, atol=1e-6)


def test_an_arm_with_five_joints_goes_to_a_position_and_an_axis(tmp_path):
    file = tmp_path / "move.csv"
    arm = pieper.load("so101")
    T = arm.fk([0.15, 0.15, 0.45, 0.55, 0.35])
    target = ["--target", *map(repr, T[:3, 3].tolist()), "--axis", *map(repr, T[:3, 2].tolist())]
    assert main(["move", "so101", "--from", "0,0,0.3,0.4,0.2", *target, "--out", str(file)]) == 0
    end = arm.fk(files.read(file).q[-1])
    np.testing.assert_allclose(end[:3, 2:], T[:3, 2:], rtol=0, atol=1e-8)


def test_a_plot_is_drawn(tmp_path):
    pytest.importorskip("matplotlib", reason="the extra plot is not installed")
    file = tmp_path / "move.png"
    assert main(["move", "ur5e", "--from", START, "--to", "0,-1,1,0,0,0", "--figure", str(file)]) == 0
    assert file.read_bytes().startswith(b"\x89PNG")
