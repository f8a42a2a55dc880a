"""What a shell is told when Tab is pressed: verbs, options, and the values that are known."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from pieper.cli import completion
from pieper.cli.main import main
from pieper.errors import UnknownNameError
from pieper.model import catalog

SHELLS = ("bash", "zsh", "fish")


@pytest.fixture
def offered(monkeypatch: pytest.MonkeyPatch, capsys: Any) -> Any:
    """What is offered behind what was typed, in the words of a shell."""

    def ask(typed: str, shell: str = "bash") -> str:
        monkeypatch.setenv("_PIEPER_COMPLETE", f"complete_{shell}")
        words = typed.split(" ")
        monkeypatch.setenv("COMP_WORDS", typed)
        monkeypatch.setenv("COMP_CWORD", str(len(words) - 1))
        monkeypatch.setenv("_TYPER_COMPLETE_ARGS", typed)
        monkeypatch.setenv("_TYPER_COMPLETE_FISH_ACTION", "get-args")
        with pytest.raises(SystemExit) as ended:
            main([])
        assert ended.value.code == 0
        said = capsys.readouterr()
        assert said.err == ""
        return str(said.out)

    return ask


@pytest.mark.parametrize("shell", SHELLS)
def test_verbs_are_offered(offered: Any, shell: str) -> None:
    told = offered("pieper calibrate-", shell)
    assert all(verb in told for verb in ("calibrate-arm", "calibrate-camera", "calibrate-field", "calibrate-hand-eye"))
    assert "render" not in told
    assert "learn-color\n" not in offered("pieper learn", shell), "a hidden verb"
    assert "inverse" in offered("pieper ros inv", shell)


@pytest.mark.parametrize("shell", SHELLS)
@pytest.mark.parametrize(
    "verb", ["fk", "reach", "view", "plot path", "ros inverse", "launch inverse --arm", "place ur5e"]
)
def test_robots_are_offered(offered: Any, shell: str, verb: str) -> None:
    told = offered(f"pieper {verb} mh", shell)
    assert "mh12" in told
    assert "mh12-report" in told
    assert "ur5e" not in told


@pytest.mark.parametrize(
    ("typed", "words"),
    [
        ("pieper synthesize re", {"report", "report-occlusion"}),
        ("pieper track film.mp4 --patterns ", {"report", "ssl", "vsss", "circles"}),
        ("pieper track film.mp4 --method ", {"pieper", "report"}),
        ("pieper calibrate-field a.png --lines ", {"vsss", "ssl-a", "ssl-b"}),
        ("pieper calibrate-hand-eye a.csv --camera-on ", {"hand", "cell"}),
        ("pieper convert ur5e --to l", {"latex"}),
        ("pieper render ur5e a.png --seen-from ", {"corner", "front", "back", "left", "right", "top"}),
        ("pieper render ur5e a.png --theme ", {"light", "dark"}),
        ("pieper pick --arm ", {"kr210", "ur10e", "mh12", "youbot"}),
        ("pieper pick --planner ", {"rrt", "direct"}),
        ("pieper workspace ur5e --show dex", {"dexterity"}),
        ("pieper view youbot --compare youbot:", {"youbot:full", "youbot:full_z_down", "youbot:simplified"}),
        ("pieper launch ", {"forward", "inverse", "ik"}),
        ("pieper launch --ur-type ur10", {"ur10", "ur10e"}),
        ("pieper ros echo /pose --qos ", {"default", "latched", "sensor"}),
        ("pieper ros echo /pose --backend ", {"rclpy", "bare"}),
        ("pieper ros record /pose --storage ", {"mcap", "sqlite3"}),
        ("pieper learn-colour film.mp4 --space ", {"log-chroma", "hsv"}),
        ("pieper calibrate-arm ur5e a.csv --free ", {"screws", "home", "offsets", "base"}),
        ("pieper fk ur5e --up", {"--up-to"}),
    ],
)
def test_values_are_offered(offered: Any, typed: str, words: set[str]) -> None:
    if "--arm kr" in typed or "track" in typed or "synthesize" in typed:
        pytest.importorskip("cv2", reason="OpenCV is not installed")
    told = set(offered(typed).split())
    assert told == words if not typed.endswith("dex") else words <= told


def test_the_colours_of_the_file_that_was_named(offered: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("cv2", reason="OpenCV is not installed")
    import numpy as np

    from pieper.perception.color import ColorModel

    monkeypatch.chdir(tmp_path)
    ColorModel(("orange", "blue"), np.array([[1.0, 2, 3], [3, 2, 1]]), [np.eye(3)] * 2).save("colors.yaml")
    assert offered("pieper track film.mp4 --colors colors.yaml --ball o").split() == ["orange"]
    assert offered("pieper track film.mp4 --colors nowhere.yaml --ball o").split() == []


@pytest.mark.parametrize("name", completion.pick_arms())
def test_an_arm_that_is_offered_for_picking_picks(name: str) -> None:
    from pieper.tasks.pick_tasks import task

    assert task(name).name


def test_what_is_offered_is_all_there_is() -> None:
    """The lists that a room does not keep in one place, against the words with which it refuses another name."""
    from pieper.perception import field_lines
    from pieper.tasks.pick_tasks import task

    for refuse, words in ((field_lines.lines, completion.field_lines()), (task, completion.pick_arms())):
        with pytest.raises(UnknownNameError) as refused:
            refuse("nothing like it")
        assert set(str(refused.value).rpartition("are: ")[2].split(", ")) - {"or a .yaml file"} == set(words)
    assert set(completion.robots()) == {*catalog.names(), *catalog.ALIASES}


def test_a_source_that_cannot_be_imported_offers_nothing() -> None:
    assert completion._words_of("pieper.nowhere", "NAMES")() == []


@pytest.mark.skipif(shutil.which("bash") is None, reason="there is no bash")
@pytest.mark.skipif(os.name == "nt", reason="bash of Windows has other paths")
def test_bash_itself_completes(tmp_path: Path) -> None:
    """The script that --show-completion prints, in a real bash."""
    program = tmp_path / "pieper"
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -m pieper "$@"\n')
    program.chmod(0o755)
    script = """
        eval "$(_PIEPER_COMPLETE=source_bash pieper)"
        COMP_WORDS=(pieper fk ur5) COMP_CWORD=2
        _pieper_completion pieper
        echo "${COMPREPLY[@]}"
    """
    environment = {**os.environ, "PATH": f"{tmp_path}:{os.environ['PATH']}"}
    result = subprocess.run(
        ["bash", "--norc", "-c", script], capture_output=True, text=True, check=True, timeout=120, env=environment
    )
    assert result.stderr == ""
    assert set(result.stdout.split()) == {"ur5", "ur5e"}
