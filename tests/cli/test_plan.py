"""``pieper plan``: the path, its files, and what it says when there is none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pieper
from pieper.motion import files

pytest.importorskip("coal")
pytest.importorskip("ompl")

START, GOAL = "1.2,-1.2,1.2,-1.6,-1.6,0", "-1.2,-1.2,1.2,-1.6,-1.6,0"
POST = "obstacles:\n  - {name: post, box: [0.2, 0.1, 0.8], position: [0.55, 0, 0.4]}\n"
ROUNDING = 1e-8


@pytest.fixture
def world(tmp_path: Path) -> Path:
    file = tmp_path / "world.yaml"
    file.write_text(POST)
    return file


def test_from_joints_to_joints(pieper_command, world: Path, tmp_path: Path) -> None:
    out = tmp_path / "move.csv"
    result = pieper_command("plan", "ur5e", "--world", world, "--from", START, "--to", GOAL, "--out", out)
    assert result.code == 0
    assert "found  path of " in result.out
    assert "at least 5 mm kept all along" in result.out
    move = files.read(out)
    np.testing.assert_allclose(move.q[0], [float(x) for x in START.split(",")])
    np.testing.assert_allclose(move.q[-1], [float(x) for x in GOAL.split(",")])


def test_json_to_a_pose_in_degrees(pieper_command, world: Path) -> None:
    result = pieper_command(
        "plan", "ur5e", "--world", world, "--from", "70,-70,70,-90,-90,0", "--target", 0.4, -0.3, 0.4,
        "--rpy", 180, 0, 0, "--deg", "--json", "--timeout", 60,
    )  # fmt: skip
    assert result.code == 0
    plan = result.json
    assert (plan["found"], plan["blocking"]) == (True, None)
    np.testing.assert_allclose(plan["q"][0], np.radians([70, -70, 70, -90, -90, 0]))
    np.testing.assert_allclose(pieper.load("ur5e").fk(plan["q"][-1])[:3, 3], [0.4, -0.3, 0.4], atol=ROUNDING)


def test_what_is_in_the_way_is_told_with_exit_code_1(pieper_command, world: Path) -> None:
    into = pieper_command("plan", "ur5e", "--world", world, "--from", START, "--to", "0,-1.2,1.2,0,0,0")
    assert into.code == 1
    assert "goal in collision" in into.out
    assert "mm inside post" in into.out
    late = pieper_command("plan", "ur5e", "--world", world, "--from", START, "--to", GOAL, "--timeout", 0, "--json")
    assert late.code == 1
    assert late.json["status"] == "no path in time"
    assert late.json["blocking"]["second"] == "post"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "either --to Q1,Q2,... or --target X Y Z"),
        (["--to", GOAL, "--target", 1, 0, 0], "either --to"),
        (["--to", GOAL, "--rpy", 0, 0, 0], "give --target X Y Z too"),
        (["--to", "1,2"], "needs as many values, got 2"),
        (["--to", "a,b"], "--to must be numbers separated by commas"),
        (["--to", GOAL, "--margin", -1], "margin must be a finite distance"),
        (["--to", GOAL, "--timeout", "nan"], "timeout must be a number of seconds"),
        (["--to", GOAL, "--world", "nowhere.yaml"], "nowhere.yaml: No such file"),
        (["--to", GOAL, "--margin", 10], "margin must be at most 0.1 of the reach of the arm"),
        (["--to", GOAL, "--out", "move.txt"], "must end in"),
        (["--to", GOAL, "--out", "nowhere/move.csv"], "nowhere: no such folder"),
        (["--to", "nan,0,0,0,0,0"], "goal must be finite"),
        (["--to", "inf,0,0,0,0,0"], "goal must be finite"),
        (["--target", "nan", 0, 0], "must be finite"),
        (["--to", GOAL, "--seed", -1], "seed must be a whole number"),
        (["--to", GOAL, "--velocity", 0], "max_velocity must be above 0"),
        (["--to", GOAL, "--velocity", "inf"], "max_velocity must be finite"),
        (["--to", GOAL, "--acceleration", "nan"], "max_acceleration must be finite"),
        (["--to", GOAL, "--jerk", -1], "max_jerk must be above 0"),
    ],
)
def test_bad_input(pieper_command, arguments: list[object], message: str) -> None:
    result = pieper_command("plan", "ur5e", "--from", START, *arguments)
    assert result.code == 2
    assert message in result.err


@pytest.mark.parametrize(
    ("start", "to", "status", "reason"),
    [
        ("0,-1.2,1.2,0,0,0", GOAL, "start in collision", "inside post"),
        (START, "0,-1.2,1.2,0,0,0", "goal in collision", "inside post"),
        ("9,-1.2,1.2,-1.6,-1.6,0", GOAL, "start out of limits", "'shoulder_pan_joint' at 9 is outside its limits"),
        (START, "9,-1.2,1.2,-1.6,-1.6,0", "goal out of limits", "'shoulder_pan_joint' at 9 is outside its limits"),
    ],
)
def test_why_there_is_no_motion(pieper_command, world: Path, tmp_path: Path, start, to, status, reason) -> None:
    out = tmp_path / "move.csv"
    result = pieper_command("plan", "ur5e", "--world", world, "--from", start, "--to", to, "--out", out, "--json")
    assert result.code == 1
    assert result.json["status"] == status
    assert reason in result.json["reason"]
    assert result.json["duration"] is None
    assert not out.exists()  # no motion, no file


def test_a_motion_of_nothing(pieper_command, world: Path, tmp_path: Path) -> None:
    out = tmp_path / "move.csv"
    result = pieper_command("plan", "ur5e", "--world", world, "--from", START, "--to", START, "--out", out, "--json")
    assert (result.code, result.json["duration"]) == (0, 0.0)
    assert files.read(out).duration == 0.0


def test_a_start_among_obstacles_that_overlap_it(pieper_command, tmp_path: Path) -> None:
    world = tmp_path / "w.yaml"
    world.write_text("obstacles:\n  - {name: ball, sphere: 0.5, position: [0, 0, 0.5]}\n")
    result = pieper_command("plan", "ur5e", "--world", world, "--from", START, "--to", GOAL)
    assert result.code == 1
    assert "start in collision" in result.out
    assert "inside ball" in result.out


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "obstacles:\n  - {name: a, box: [0.1, -0.1, 0.1]}\n",
            "w.yaml, line 2, obstacles[0].box: box 'a': size must be positive",
        ),
        (
            "obstacles:\n  - {name: a, box: [0.1, .nan, 0.1]}\n",
            "w.yaml, line 2, obstacles[0].box: must be a finite number",
        ),
        ("obstacles:\n  - {name: a, sphere: .inf}\n", "w.yaml, line 2, obstacles[0].sphere"),
        ("obstacles:\n  - {name: a, sphere: 1}\n  - {name: a, sphere: 1}\n", "'a'"),
        ("", "w.yaml, line 1: the file is empty"),
    ],
)
def test_worlds_that_are_none(pieper_command, tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "w.yaml").write_text(text)
    result = pieper_command("plan", "ur5e", "--to", GOAL, "--world", tmp_path / "w.yaml")
    assert result.code == 2
    assert message in result.err


def test_interrupted_in_the_middle_nothing_is_written(pieper_command, world: Path, tmp_path: Path, monkeypatch) -> None:
    from pieper.motion import planning

    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(planning, "search", interrupt)
    old = tmp_path / "move.csv"
    old.write_text("old")
    result = pieper_command("plan", "ur5e", "--world", world, "--from", START, "--to", GOAL, "--out", old)
    assert result.code == 130
    assert "interrupted" in result.err
    assert [path.read_text() for path in tmp_path.glob("*move*")] == ["old"]


def test_rounded_corners_are_quicker_than_rests(pieper_command, world: Path, tmp_path: Path) -> None:
    asked = ("plan", "ur5e", "--world", world, "--from", START, "--to", GOAL, "--json")
    rounded, resting = pieper_command(*asked).json, pieper_command(*asked, "--rest").json
    assert rounded["q"] == resting["q"]
    assert rounded["duration"] <= resting["duration"]
    slow = pieper_command(*asked, "--velocity", 0.2, "--out", tmp_path / "slow.json").json
    assert slow["duration"] > 2.0 * rounded["duration"]
    move = files.read(tmp_path / "slow.json")
    assert np.abs(move.sample(np.linspace(0.0, move.duration, 500)).dq).max() <= 0.2 * (1.0 + 1e-6)


def test_a_malformed_world(pieper_command, tmp_path: Path) -> None:
    (tmp_path / "w.yaml").write_text("obstacles:\n  - {name: c, cone: 1}\n")
    result = pieper_command("plan", "ur5e", "--to", GOAL, "--world", tmp_path / "w.yaml")
    assert result.code == 2
    assert "w.yaml, line 2, obstacles[0].cone: no field 'cone'" in result.err


def test_a_picture(pieper_command, world: Path, tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    file = tmp_path / "plan.png"
    result = pieper_command("plan", "ur5e", "--world", world, "--from", START, "--to", GOAL, "--picture", file)
    assert result.code == 0
    assert file.read_bytes().startswith(b"\x89PNG")
