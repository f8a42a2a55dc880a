"""``pieper plot``: figures from files and from the iteration, what it prints, and what it refuses."""

import numpy as np
import pytest

import pieper
from pieper.motion import files
from pieper.motion.trajectory import Trajectory

SEED = "--from=-1.28,4.41,1.54,-1.16,-1.56,0"
ITERATION = ("--from-iteration", "--target", 0.5, -0.6, 0.2, "--orientation", "hold", SEED)


@pytest.fixture(autouse=True)
def no_screen(monkeypatch, tmp_path):
    import matplotlib as mpl

    mpl.use("Agg")
    monkeypatch.chdir(tmp_path)


@pytest.fixture(params=files.FORMATS)
def motion(request, tmp_path):
    """A file with a motion of the UR5e, its columns in another order than the joints of the arm."""
    arm = pieper.load("ur5e")
    q = np.outer([0.0, 1.0, -0.5], np.linspace(1.0, 0.2, 6))
    file = tmp_path / f"move{request.param}"
    files.write(Trajectory([0.0, 1.0, 2.5], q, dq=np.zeros_like(q), joint_names=arm.joint_names[::-1]), file)
    return file


def test_row_e7_on_the_command_line(pieper_command, tmp_path):
    result = pieper_command("plot", "path", "ur5e", *ITERATION, "--k1", 0.1, "--k1", 1, "--out", "e7.svg")
    assert result.code == 0
    assert result.out.splitlines() == [
        "k1 = 0.1: 62 points, at most 0.0101 m off the straight line",
        "k1 = 1: 5 points, at most 0.327 m off the straight line",
    ]
    assert result.err == "wrote e7.svg\n"
    assert (tmp_path / "e7.svg").read_text(encoding="utf-8").startswith("<?xml")


def test_row_b13_on_the_command_line(pieper_command):
    arguments = ("--from-iteration", "--target", 0.3, 0.3, 0.3, "--alpha", 0.06, "--iterations", 255)
    result = pieper_command("plot", "error", "mh12-report", *arguments, "--out", "b13.pdf")
    assert result.code == 0
    assert result.out == "TCP trajectory: 1.64e-07 m left after 255 steps\n"


def test_row_b17_on_the_command_line(pieper_command, tmp_path):
    for question in ("fk", "ik"):
        file = f"{question}.png"
        result = pieper_command(
            "plot", "compare", "mh12-report", "mh12", "--question", question, "--samples", 9, "--out", file
        )
        assert result.code == 0
        assert "joint_5_b = -joint_5_b_inverted: their axes are opposite" in result.out
        assert (tmp_path / file).read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("verb", ["path", "joints", "manipulability"])
def test_files_are_drawn(pieper_command, motion, tmp_path, verb):
    result = pieper_command(
        "plot", verb, "ur5e", "--trajectory", motion, "--deg", "--theme", "dark", "--out", "out.png"
    )
    assert result.code == 0, result.err
    assert (tmp_path / "out.png").stat().st_size > 10_000


def test_the_error_of_a_file_is_the_distance_to_the_target(pieper_command, motion):
    asked = ("plot", "error", "ur5e", "--trajectory", motion, "--out", "error.svg")
    assert pieper_command(*asked, "--target", 0.5, 0.2, 0.3).code == 0
    refused = pieper_command(*asked)
    assert refused.code == 2
    assert "--target X Y Z" in refused.err


def test_a_target_that_is_not_reached_is_drawn_and_code_1(pieper_command, tmp_path):
    arguments = ("--from-iteration", "--target", 5, 0, 0.2, "--k1", 0.1, "--iterations", 30, "--tolerance", 1e-3)
    result = pieper_command("plot", "path", "ur5e", *arguments, "--out", "far.png")
    assert result.code == 1
    assert "not reached, " in result.err
    assert (tmp_path / "far.png").exists()


def test_the_orientation_is_reached_too(pieper_command):
    arm = pieper.load("ur5e")
    T = arm.fk(np.array([-1.28, 4.41, 1.54, -1.16, -1.56, 0.0]) + 0.2)
    rpy = pieper.spatial.rotation.as_rpy(T[:3, :3])
    asked = ("plot", "error", "ur5e", "--from-iteration", "--target", *T[:3, 3], SEED, "--out", "both.svg")
    assert pieper_command(*asked, "--orientation", "reach", "--rpy", *rpy).code == 0
    for alone in (("--orientation", "reach"), ("--rpy", *rpy)):
        refused = pieper_command(*asked, *alone)
        assert refused.code == 2
        assert "belong together" in refused.err


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["pth"], "no figure 'pth'; did you mean 'path'?"),
        (["path", "ur5f", *ITERATION, "--out", "a.png"], "no robot 'ur5f'; did you mean"),
        (["path", "ur5e", *ITERATION, "--out", "a.jpg"], "written as .png, .pdf or .svg"),
        (["path", "ur5e", *ITERATION, "--out", "nowhere/a.png"], "nowhere: no such folder"),
        (["path", "ur5e", *ITERATION, "--out", "folder.png"], "folder.png: is a folder"),
        (["path", "ur5e", *ITERATION], "no screen to show a figure on; write it to a file with --out FILE"),
        (["path", "ur5e", "--out", "a.png"], "give one of --trajectory FILE and --from-iteration"),
        (["path", "ur5e", "--from-iteration", "--out", "a.png"], "needs a target: --target X Y Z"),
        (["path", "ur5e", *ITERATION, "--trajectory", "good.csv", "--out", "a.png"], "give one of --trajectory"),
        (["path", "ur5e", "--trajectory", "good.csv", "--trajectory", "good.csv", "--out", "a.png"], "given twice"),
        (["path", "ur5e", *ITERATION, "--k1", -1, "--out", "a.png"], "k1 must be a positive number"),
        (["path", "ur5e", *ITERATION, "--damping", "nan", "--out", "a.png"], "damping must be"),
        (["path", "ur5e", "--from-iteration", "--target", "nan", 0, 0, "--out", "a.png"], "finite"),
        (["path", "ur5e", "--trajectory", "missing.csv", "--out", "a.png"], "missing.csv: No such file"),
        (["path", "ur5e", "--trajectory", "empty.csv", "--out", "a.png"], "empty.csv: is empty"),
        (["path", "ur5e", "--trajectory", "names.csv", "--out", "a.png"], "names.csv: has no points"),
        (["path", "ur5e", "--trajectory", "nan.csv", "--out", "a.png"], "nan.csv: q must be finite, got nan"),
        (["path", "ur5e", "--trajectory", "other.csv", "--out", "a.png"], "other.csv: no joint 'elbow'"),
        (["path", "ur5e", "--trajectory", "few.csv", "--out", "a.png"], "few.csv: the trajectory must have 6 columns"),
        (["path", "ur5e", "--trajectory", "good.txt", "--out", "a.png"], "must end in .csv, .json, .npz"),
        (["joints", "ur5e", *ITERATION, "--k1", 0.1, "--k1", 1, "--out", "a.png"], "joints draws one motion, got 2"),
        (["compare", "ur5e", "panda", "--out", "a.png"], "no joint name in common"),
        (["compare", "ur5e", "ur5", "--samples", 1, "--out", "a.png"], "samples must be at least 2"),
        (["compare", "ur5e", "ur5", "--at", "1,2", "--out", "a.png"], "6 joints"),
        (["compare", "ur5e", "ur5", "--at", "a,b", "--out", "a.png"], "--at must be numbers"),
    ],
    ids=lambda value: " ".join(map(str, value))[:60] if isinstance(value, list) else "",
)
def test_bad_input_is_one_sentence_and_code_2(pieper_command, tmp_path, arguments, complaint):
    row = ", ".join("0.1" for _ in range(6))
    names = ", ".join(pieper.load("ur5e").joint_names)
    (tmp_path / "folder.png").mkdir()
    (tmp_path / "empty.csv").write_text("")
    (tmp_path / "names.csv").write_text(f"t, {names}\n")
    (tmp_path / "nan.csv").write_text(f"t, {names}\n0.0, nan{row[3:]}\n")
    (tmp_path / "other.csv").write_text("t, elbow\n0.0, 1.0\n")
    (tmp_path / "few.csv").write_text("t, 1, 2\n0.0, 1.0, 2.0\n")
    for good in ("good.csv", "good.txt"):
        (tmp_path / good).write_text(f"t, {names}\n0.0, {row}\n1.0, {row}\n")
    result = pieper_command("plot", *arguments)
    assert result.code == 2, result
    assert complaint in result.err
    assert result.err.count("\n") == 1
    assert not (tmp_path / "a.png").exists()


def test_without_arguments_it_helps(pieper_command):
    result = pieper_command("plot")
    assert result.code == 0
    assert all(verb in result.out for verb in ("path", "joints", "error", "manipulability", "compare"))


def test_without_matplotlib_the_extra_is_named(pieper_command, monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "matplotlib", None)
    result = pieper_command("plot", "path", "ur5e", *ITERATION, "--out", "a.png")
    assert result.code == 3
    assert "pip install 'pieper[plot]'" in result.err


def test_an_iteration_that_goes_astray_is_told(pieper_command):
    asked = ("--from-iteration", "--target", 0.5, -0.6, 0.2, "--alpha", 1e200, "--iterations", 40)
    result = pieper_command("plot", "path", "ur5e", *asked, "--out", "a.png")
    assert result.code == 2
    assert "q must not exceed 1e+15" in result.err
