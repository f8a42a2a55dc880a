"""``pieper pick``: exit codes, the stages and the count that are printed, the log, films, and Ctrl-C."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys

import pytest

from pieper.cli.main import main

pytest.importorskip("mujoco", reason="mujoco is not installed")


def said(capsys):
    out = capsys.readouterr()
    return out.out, out.err


def test_a_cycle_with_its_stages_and_the_count(capsys):
    assert main(["pick", "--cycles", "1", "--seed", "7"]) == 0
    out, _ = said(capsys)
    lines = out.splitlines()
    assert sum("SUCCEEDED" in line for line in lines) == 9
    assert lines[-1].startswith("1 of 1 placed")


def test_quiet_prints_the_count_alone_and_the_log_goes_on(capsys, tmp_path):
    file = str(tmp_path / "log.jsonl")
    line = ["pick", "--arm", "ur10e", "--quiet", "--log", file]
    assert main([*line, "--cycles", "1"]) == 0
    out, _ = said(capsys)
    assert len(out.splitlines()) == 1
    assert main([*line, "--cycles", "2"]) == 0
    out, _ = said(capsys)
    assert "1 cycles are in" in out
    assert out.splitlines()[-1].startswith("2 of 2 placed")
    records = [json.loads(record) for record in (tmp_path / "log.jsonl").read_text().splitlines()]
    assert [record["number"] for record in records] == [1, 2]
    assert {stage["outcome"] for record in records for stage in record["stages"]} == {"SUCCEEDED"}
    assert main([*line, "--cycles", "2", "--seed", "1"]) == 2
    assert "with seed 0, not of 'ur10e' with seed 1" in said(capsys)[1]


def test_what_is_not_placed_is_an_exit_code(capsys, monkeypatch):
    from dataclasses import replace

    from pieper.tasks import pick_tasks

    slippery = pick_tasks.task("ur10e")
    things = tuple(replace(thing, friction=0.0) if thing.moves else thing for thing in slippery.scene.objects)
    monkeypatch.setattr(
        pick_tasks, "task", lambda name: replace(slippery, attempts=1, scene=replace(slippery.scene, objects=things))
    )
    assert main(["pick", "--cycles", "1", "--quiet"]) == 1
    assert said(capsys)[0].splitlines()[-1] == "0 of 1 placed"


@pytest.mark.parametrize(
    ("typed", "code", "words"),
    [
        (["--arm", "kr211"], 2, "no pick task 'kr211'"),
        (["--cycles", "0"], 2, "--cycles must be 1 or more, got 0"),
        (["--seed", "-1"], 2, "--seed must be 0 or more"),
        (["--record", "film.avi"], 2, "a film must end in"),
        (["--planner", "prm"], 2, "no planner 'prm'; planners are: rrt, direct"),
        (["--arm", "mh12", "--task", "mine.yaml"], 2, "give one of them"),
        (["--task", "not there.yaml"], 2, "not there.yaml: No such file"),
        (["--record", "film.mp4", "--size", "wide"], 2, "--size must be width x height"),
        (["--record", "film.mp4", "--speed", "0"], 2, "speed must be a positive number"),
        (["--record", "no folder/film.mp4"], 2, "no folder: no such folder"),
        (["--record", "film.gif", "--fps", "80"], 2, "a GIF film shows at most 50 frames per second"),
        (["--record", "film.mp4", "--size", "4x4"], 2, "size must be from 16 x 16 to 1920 x 1440 pixels"),
        (["--log", "no folder/log.jsonl"], 2, "no folder: no such folder"),
    ],
)
def test_bad_input_is_said_before_anything_moves(capsys, typed, code, words):
    assert main(["pick", *typed]) == code
    out, err = said(capsys)
    assert words in err
    assert "SUCCEEDED" not in out


@pytest.mark.skipif(sys.platform != "linux", reason="screens are found by DISPLAY on Linux")
def test_a_window_needs_a_screen(capsys, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    assert main(["pick", "--cycles", "1", "--window"]) == 3
    assert "--record FILE" in said(capsys)[1]


def test_a_task_is_written_changed_and_run(capsys, tmp_path):
    file = tmp_path / "mine.yaml"
    assert main(["pick", "--arm", "mh12", "--write-task", str(file)]) == 0
    assert "pieper pick --task" in said(capsys)[0]
    file.write_text(file.read_text().replace("name: mh12", "name: mine").replace("mass: 0.25", "mass: 0.4"))
    assert main(["pick", "--task", str(file), "--cycles", "1"]) == 0
    out, _ = said(capsys)
    assert "1 of 1 placed" in out
    log = str(tmp_path / "log.jsonl")
    assert main(["pick", "--task", str(file), "--cycles", "1", "--quiet", "--log", log]) == 0
    film = tmp_path / "film.gif"
    assert main(["pick", "--task", str(file), "--cycles", "1", "--log", log, "--record", str(film)]) == 0
    assert f"nothing to film: {film} is not written" in " ".join(said(capsys)[0].split())
    file.write_text(file.read_text().replace("mass: 0.4", "mass: 0.5"))
    assert main(["pick", "--task", str(file), "--cycles", "2", "--log", log]) == 2
    assert "line 1 is of the task 'mine' as it was before it was changed" in said(capsys)[1]
    file.write_text(file.read_text().replace("mass: 0.5", "mass: heavy"))
    assert main(["pick", "--task", str(file), "--log", str(file)]) == 2
    assert "it would be lost, so name another file" in said(capsys)[1]
    assert main(["pick", "--task", str(file), "--cycles", "1"]) == 2
    assert f"{file}, line 16, targets.mass: must be a number, got 'heavy'" in said(capsys)[1]


def test_without_the_planner_the_command_says_so(capsys, monkeypatch):
    monkeypatch.setattr("pieper.tasks.pick.is_there", lambda: False)
    assert main(["pick", "--arm", "mh12", "--cycles", "1"]) == 0
    assert "pip install 'pieper[plan]'" in said(capsys)[0]
    assert main(["pick", "--arm", "mh12", "--cycles", "1", "--planner", "direct"]) == 0
    assert "pip install" not in said(capsys)[0]


@pytest.mark.skipif(sys.platform == "win32", reason="interrupts are signals elsewhere")
def test_ctrl_c_keeps_what_was_done(tmp_path):
    log = tmp_path / "log.jsonl"
    command = [sys.executable, "-m", "pieper", "pick", "--cycles", "500", "--log", str(log)]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env={**os.environ}
    ) as run:
        for line in run.stdout:
            if "cycle 2" in line and "move " in line:
                run.send_signal(signal.SIGINT)
                break
        out, err = run.communicate(timeout=60)
    assert run.returncode == 130
    assert "1 of 500 placed" in out
    assert "goes on after cycle 1" in out
    assert "interrupted" in err
    assert "FAILED  cancelled" in out
    assert len(log.read_text().splitlines()) == 1


@pytest.mark.skipif(sys.platform == "win32", reason="orders to end are signals elsewhere")
@pytest.mark.usefixtures("can_draw")
def test_an_order_to_end_does_not_wait_for_a_film(tmp_path):
    film = tmp_path / "film.gif"
    command = [
        sys.executable,
        "-m",
        "pieper",
        "pick",
        "--arm",
        "mh12",
        "--cycles",
        "500",
        "--record",
        str(film),
        "--fps",
        "5",
    ]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as run:
        for line in run.stdout:
            if "move " in line:
                run.send_signal(signal.SIGTERM)
                break
        out, err = run.communicate(timeout=60)
    assert run.returncode == 130
    assert f"asked to end: {film} is not written" in out
    assert "interrupted" in err
    assert not list(tmp_path.iterdir())


@pytest.mark.usefixtures("can_draw")
def test_by_sight(capsys, tmp_path):
    pytest.importorskip("cv2", reason="OpenCV is not installed")
    film = tmp_path / "see.gif"
    line = ["pick", "--see", "--arm", "ur10e", "--cycles", "1", "--seed", "3", "--record", str(film)]
    assert main([*line, "--size", "160x120", "--fps", "2"]) == 0
    out, _ = said(capsys)
    lines = out.splitlines()
    assert lines[0].startswith("camera at (0.6")
    assert "px RMS" in lines[0]
    assert sum("red can" in line and "SUCCEEDED" in line for line in lines) == 9
    assert lines[-1].startswith("1 of 1 placed")
    assert film.stat().st_size > 1000
    assert main(["pick", "--see", "--arm", "youbot"]) == 2
    assert "no see-and-reach task 'youbot'; see-and-reach tasks are: kr210, ur10e" in said(capsys)[1]
