"""What every verb has in common: quick help, exit codes, one sentence for an error, numbers below zero."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys

import pytest

import pieper
from pieper.cli import main as command

VERBS = ("robots", "info", "fk", "ik", "reach", "convert", "render", "plot", "doctor", "ros", "launch")
HEAVY = ("coal", "ompl", "numpy", "scipy", "sympy", "yaml", "mpmath", "xacrodoc", "matplotlib")


@pytest.mark.parametrize("arguments", [["--help"], ["--version"], *([verb, "--help"] for verb in VERBS)], ids=" ".join)
def test_help_imports_nothing_heavy(arguments: list[str]) -> None:
    code = (
        "import sys; from pieper.cli.main import main; code = main(sys.argv[1:]);"
        f"print('imported:', *(m for m in {HEAVY!r} if m in sys.modules)); sys.exit(code)"
    )
    result = subprocess.run(
        [sys.executable, "-W", "error", "-c", code, *arguments], capture_output=True, text=True, check=True, timeout=60
    )
    assert result.stdout.splitlines()[-1] == "imported:"
    assert not result.stderr


def test_module_is_the_command() -> None:
    result = subprocess.run(
        [sys.executable, "-m", "pieper", "--version"], capture_output=True, text=True, check=True, timeout=60
    )
    assert result.stdout == f"pieper {pieper.__version__}\n"


def test_without_arguments_it_helps(pieper_command) -> None:
    result = pieper_command()
    assert result.code == 0
    assert all(verb in result.out for verb in VERBS)
    assert not any(line.endswith("...") for line in result.out.splitlines()[1:]), "a summary is too long for its line"


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["fkk", "mh12"], "no verb 'fkk'; did you mean 'fk'?"),
        (["fk"], "Missing argument 'ARM'; see: pieper fk --help"),
        (["fk", "mh12", "0", "zero"], "see: pieper fk --help"),
        (
            ["fk", "mh12", "0.1,-0.2,3e-1"],
            "'Q1 Q2 ...': numbers stand apart here, as in 0.1 -0.2 3e-1, got 0.1,-0.2,3e-1; see: pieper fk --help",
        ),
        (["ik", "mh12", "0.3,0.3,0.3"], "'X': numbers stand apart here, as in 0.3 0.3 0.3, got 0.3,0.3,0.3"),
        (
            ["ik", "mh12", "--target", "1", "0", "0"],
            "--target; the target stands behind the arm, as X Y Z; see: pieper ik",
        ),
        (["reach", "mh12", "--target", "1", "0", "0"], "--target; the target stands behind the arm"),
        (["fk", "mh12", "--sede", "3"], "No such option: --sede"),
        (["fk", "mh12", "-x"], "No such option: -x"),
        (["fk", "mh12", "1", "2"], "yaskawa_mh12 has 6 joints (joint_1_s, "),
        (["fk", "mh12", "nan", "0", "0", "0", "0", "0"], "must be finite"),
        (["fk", "mh12", "-inf", "0", "0", "0", "0", "0"], "must be finite"),
        (["fk", "mh13", "1", "2"], "did you mean 'mh12'"),
        (["fk", "nowhere/arm.urdf", "1"], "nowhere/arm.urdf"),
        (["fk", "mh12", "0", "0", "0", "0", "0", "0", "--tip", "tool9"], "did you mean 'tool0'"),
        (["fk", "mh12", "0", "0", "0", "0", "0", "0", "--up-to", "link_7"], "link_6"),
        (["convert", "mh12", "--to", "dhh"], "Invalid value for '--to': 'dhh' is not one of 'dh'"),
        (["info", "."], ".: file: is a folder; name the URDF, xacro or JSON file in it"),
        (["ik", "mh12", "0", "0", "0", "--rpy", "1"], "Option '--rpy' requires 3 arguments; see: pieper"),
        (["ik", "panda", "0", "0", "0", "--redundancy", "nan"], "--redundancy must be a finite number, got 'nan'"),
        (["plan", "ur5e", "--to", "0,0,0,0,0,0", "--picture", "a.jpg"], "--picture must end in .png, got 'a.jpg'"),
        (["doctor", "--timeout", "0"], "Invalid value for '--timeout': it must be greater than or equal to 0.1"),
        (["workspace", "ur5e", "--show", "beauty"], "quantities are: dexterity"),
        (["ros", "call", "/x", "bad"], "'bad' is not the type of a service, as pieper_interfaces/srv/QuatToZYX"),
        (["ros", "record", "/pose", "--storage", "zip"], "no storage 'zip'; storages are: mcap, sqlite3"),
        (["ros", "replay", "nowhere"], "there is no bag at nowhere"),
    ],
    ids=" ".join,
)
def test_bad_input_is_one_sentence_and_code_2(pieper_command, arguments: list[str], complaint: str) -> None:
    result = pieper_command(*arguments)
    assert result.code == command.BAD_INPUT
    assert result.out == ""
    assert result.err.startswith("pieper: ")
    assert result.err.count("\n") == 1
    assert complaint in result.err


def test_numbers_below_zero_are_numbers(pieper_command) -> None:
    words = ["-0.1", "-.2", "-3e-1", "-1", "-0.", "+0.5"]
    result = pieper_command("fk", "mh12", *words, "--json")
    assert result.code == command.DONE
    assert result.json["q"] == [float(word) for word in words]


def test_a_crash_is_not_mistaken_for_an_answer(pieper_command, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object, **__: object) -> None:
        raise RuntimeError("broken")

    monkeypatch.setattr(pieper, "load", broken)
    result = pieper_command("fk", "mh12", 0)
    assert result.code == command.FAULT
    assert "RuntimeError: broken" in result.err
    assert "report" in result.err


def test_a_missing_extra_has_its_own_code(pieper_command, monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(*_: object, **__: object) -> None:
        raise pieper.errors.MissingExtraError("xacrodoc", "xacro", "reading xacro")

    monkeypatch.setattr(pieper, "load", missing)
    result = pieper_command("fk", "mh12", 0)
    assert result.code == command.MISSING_PACKAGE
    assert "pip install 'pieper[xacro]'" in result.err


def test_interrupted(pieper_command, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(pieper, "load", interrupted)
    result = pieper_command("fk", "mh12", 0)
    assert result.code == command.INTERRUPTED
    assert "pieper: interrupted" in result.err


@pytest.mark.skipif(os.name == "nt", reason="Windows has other signals")
def test_an_order_to_end_is_taken_as_ctrl_c(pieper_command, monkeypatch: pytest.MonkeyPatch) -> None:
    def ended(*_: object, **__: object) -> None:
        signal.raise_signal(signal.SIGTERM)

    monkeypatch.setattr(pieper, "load", ended)
    before = signal.getsignal(signal.SIGTERM)
    assert pieper_command("fk", "mh12", 0).code == command.INTERRUPTED
    assert signal.getsignal(signal.SIGTERM) is before


@pytest.mark.parametrize("module", ["typer", "pieper.cli.main", "numpy"])
def test_ctrl_c_while_modules_are_imported(module: str) -> None:
    code = f"""
import sys

class Interrupting:
    def find_spec(self, name, *_):
        if name == {module!r}:
            raise KeyboardInterrupt

sys.meta_path.insert(0, Interrupting())
from pieper.__main__ import main
sys.argv[1:] = ["fk", "mh12", "0", "0", "0", "0", "0", "0"]
sys.exit(main())
"""
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=60)
    assert (result.returncode, result.stdout, result.stderr) == (130, "", "pieper: interrupted\n")


def test_an_error_is_one_line_of_json_where_json_was_asked_for(pieper_command) -> None:
    result = pieper_command("fk", "mh13", 0, "--json")
    assert (result.code, result.out) == (command.BAD_INPUT, "")
    (line,) = result.err.splitlines()
    error = json.loads(line)
    assert error["error"].startswith("no robot 'mh13'; did you mean 'mh12'?")
    assert (error["kind"], error["exit_code"]) == ("UnknownNameError", command.BAD_INPUT)


def test_the_same_warning_is_told_once(pieper_command, tmp_path) -> None:
    """One mesh that three links lack: arm and ghosts are drawn from it."""
    mesh = '<visual><geometry><mesh filename="gone.stl"/></geometry></visual>'
    limit = '<origin xyz="0 0 0.3"/><axis xyz="0 1 0"/><limit lower="-1" upper="1" velocity="1" effort="1"/>'
    joints = "".join(
        f'<joint name="j{i}" type="revolute"><parent link="l{i}"/><child link="l{i + 1}"/>{limit}</joint>'
        for i in range(2)
    )
    file = tmp_path / "arm.urdf"
    file.write_text(
        f'<robot name="arm">{"".join(f"<link name=%sl{i}%s>{mesh}</link>" % (chr(34), chr(34)) for i in range(3))}{joints}</robot>'
    )
    pytest.importorskip("viser", reason="the viewer's extra is not installed")
    result = pieper_command("view", file, "--export", tmp_path / "arm.html")
    assert result.code == 0
    assert result.err.count("a shape made from the joints is drawn instead") == 1


@pytest.mark.skipif(os.name == "nt", reason="pipes close differently on Windows")
def test_a_closed_pipe_is_quiet() -> None:
    line = f"{sys.executable} -m pieper robots | head -n 1"
    result = subprocess.run(["bash", "-c", line], capture_output=True, text=True, check=True, timeout=60)
    assert result.stdout.startswith("name")
    assert not result.stderr


def test_warnings_are_one_line(pieper_command, tmp_path) -> None:
    urdf = tmp_path / "one.urdf"
    urdf.write_text(
        '<robot name="one"><link name="a"/><link name="b"><visual><geometry><mesh filename="gone.stl"/></geometry></visual>'
        '</link><joint name="j" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/></joint></robot>'
    )
    result = pieper_command("fk", urdf, 0.5)
    assert result.code == command.DONE
    assert "gone.stl" in result.err
    assert result.err.count("\n") == 1
    assert "Warning" not in result.err


def test_an_output_that_cannot_show_a_name(tmp_path) -> None:
    urdf = tmp_path / "arm.urdf"
    urdf.write_text(
        '<robot name="Grün"><link name="a"/><link name="b"/><joint name="j" type="continuous">'
        '<parent link="a"/><child link="b"/></joint></robot>',
        encoding="utf-8",
    )
    result = subprocess.run(
        [sys.executable, "-m", "pieper", "info", str(urdf)],
        capture_output=True,
        env={**os.environ, "PYTHONIOENCODING": "ascii"},
        timeout=60,
    )
    assert result.returncode == 2
    assert b"pieper: the output is ascii, which cannot show" in result.stderr
    assert b"PYTHONIOENCODING=utf-8" in result.stderr
