"""What ``--help`` says: on one screen, in parts; each verb with examples that run; each option with one name, one wording, one unit."""

from __future__ import annotations

import contextlib
import os
import re
import shlex
import shutil
from collections import defaultdict
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer.main

import pieper
import pieper.ros
from pieper.cli import doctor
from pieper.cli.main import app, main
from pieper.ros import nodes
from pieper.ros.launch import Launch
from tests.cli.test_ros import Network
from tests.ros.domains import new_domain

SCREEN = (40, 80)  # lines and columns
ROOT: Any = typer.main.get_command(app)


def verbs() -> dict[str, Any]:
    """Every verb by the words that name it."""

    def walk(command: Any, words: tuple[str, ...]) -> Any:
        for name, child in getattr(command, "commands", {}).items():
            if hasattr(child, "commands"):
                yield from walk(child, (*words, name))
            elif not child.hidden:
                yield " ".join((*words, name)), child

    return dict(walk(ROOT, ()))


VERBS = verbs()
GROUPS = ("", "plot", "ros")


def printed_help(words: str) -> str:
    """What the verb prints in a terminal of 80 columns."""
    command = ROOT
    context = typer.Context(command, info_name="pieper", terminal_width=SCREEN[1], max_content_width=SCREEN[1])
    for word in words.split():
        command = command.commands[word]
        context = typer.Context(
            command, info_name=word, parent=context, terminal_width=SCREEN[1], max_content_width=SCREEN[1]
        )
    return str(command.get_help(context))


def examples(words: str) -> list[str]:
    """The command lines under ``For example:``, each in one line."""
    _, found, rest = printed_help(words).partition("\n  For example:\n")
    text = rest.partition("\n\n")[0].replace("\\\n", " ")
    return [" ".join(line.split()) for line in text.splitlines()] if found else []


EXAMPLES = [(line, verb) for verb in VERBS for line in examples(verb)]


# On one screen


@pytest.mark.parametrize("group", GROUPS)
def test_the_verbs_of_a_group_fit_a_screen(group: str) -> None:
    lines = printed_help(group).splitlines()
    assert len(lines) <= SCREEN[0]
    assert max(map(len, lines)) <= SCREEN[1]


@pytest.mark.parametrize("group", GROUPS)
def test_every_verb_is_told_once_and_in_a_part(group: str) -> None:
    told = re.findall(r"^(?:\w[\w ]*?)? {2,}([a-z][\w-]*) {2,}\w.*\.$", printed_help(group), re.MULTILINE)
    command = ROOT
    for word in group.split():
        command = command.commands[word]
    assert sorted(told) == sorted(name for name, verb in command.commands.items() if not verb.hidden)
    assert all(verb.rich_help_panel for verb in command.commands.values() if not verb.hidden)


@pytest.mark.parametrize("verb", VERBS)
def test_help_is_80_columns_wide(verb: str) -> None:
    assert max(map(len, printed_help(verb).splitlines())) <= SCREEN[1]


# The options

OWN_MEANING = {
    "--to": {"convert": "the form an arm is brought to; elsewhere the end of a motion that has a --from"},
    "--field": {"ros echo": "as in ros2 topic echo"},
    "--rate": {"ros replay": "as in ros2 bag play"},
}
"""Options that mean something else in a verb, and why they keep their name."""


def options() -> dict[str, dict[str, Any]]:
    """Every option by its name and verb."""
    found: dict[str, dict[str, Any]] = defaultdict(dict)
    for verb, command in VERBS.items():
        for param in command.params:
            if param.param_type_name == "option":
                found[next(word for word in param.opts if word.startswith("--"))][verb] = param
    return dict(found)


OPTIONS = options()
EVERY = [(name, verb, param) for name, used in OPTIONS.items() for verb, param in used.items()]
SHARED = {
    name: {verb: param for verb, param in used.items() if verb not in OWN_MEANING.get(name, {})}
    for name, used in OPTIONS.items()
}


def meaning(param: Any) -> str:
    """What the help says before the verb's own words."""
    return re.split(r"[.;:]|, or ", param.help)[0]


def test_an_option_means_the_same_everywhere() -> None:
    """What stands before the first semicolon, colon, full stop or alternative is the same; what follows is of the verb."""
    meanings = {name: {meaning(param) for param in used.values()} for name, used in SHARED.items()}
    assert {name: words for name, words in meanings.items() if len(words) > 1} == {}


def test_an_option_is_written_the_same_everywhere() -> None:
    for name, used in SHARED.items():
        written = {(param.metavar, tuple(param.opts), tuple(param.secondary_opts)) for param in used.values()}
        if name == "--out":  # a folder is one where many files are written
            written = {(None, *rest) for metavar, *rest in written if metavar in ("FILE", "FOLDER")}
        assert len(written) == 1, f"{name}: {written}"


def test_a_meaning_has_one_name() -> None:
    names: dict[str, set[str]] = defaultdict(set)
    for name, used in SHARED.items():
        for param in used.values():
            names[meaning(param)].add(name)
    twice = {words: found for words, found in names.items() if len(found) > 1}
    assert set(twice) <= {
        "Limit of every joint [rad/s^2 or m/s^2]",
        "Limit of the tip [m/s^2]",
        "Iteration",
        "A tool",
        "Of the base [m]",
        "The same",
        "Seven joints",
    }, twice


def test_an_option_says_what_it_takes() -> None:
    for name, verb, param in EVERY:
        assert param.help, f"{verb} {name}"
        assert param.help.endswith((".", "...")), f"{verb} {name}: {param.help}"
        assert param.is_flag or param.metavar, f"{verb}: a value without a word for it"
        assert not param.is_flag or not name.startswith("--no-"), f"{verb}: an option that says no when it is given"


def test_an_angle_has_its_unit() -> None:
    for name, verb, param in EVERY:
        if param.metavar in ("ROLL PITCH YAW", "Q1,Q2,...", "VALUE"):
            assert "rad" in param.help, f"{verb} {name}: {param.help}"
            assert "--deg" not in param.help or "--deg" in {o for p in VERBS[verb].params for o in p.opts}, verb


def test_a_length_has_its_unit() -> None:
    for name, verb, param in EVERY:
        if param.metavar in ("M", "X Y Z", "FROM TO") and name not in ("--axis", "--y", "--z"):
            assert "[m]" in param.help, f"{verb} {name}: {param.help}"


# The examples

SHORTENED = {
    "pieper view ur5e --solve": "stays open until Ctrl-C, which the test stands in for",
    "pieper launch inverse --arm mh12": "runs until Ctrl-C: ended once all nodes have been started",
    "pieper doctor": "looks at the core alone; its own tests look at everything",
    **{
        f"pieper ros {name}{'' if entry.needs == 'nothing' else ' mh12'}": "runs until Ctrl-C: ended after half a second"
        for name, entry in nodes.NODES.items()
    },
}
"""Examples that run as they stand, but are ended or look at less, and why. All others run to their end."""

NEEDS = {
    "pieper plan": ("coal", "ompl"),
    "pieper move": ("ruckig",),
    "pieper pick": ("mujoco",),
    "pieper render": ("mujoco",),
    "pieper view": ("viser",),
    "pieper plot": ("matplotlib",),
    "pieper workspace": ("zarr",),
    **dict.fromkeys(("pieper learn-colour", "pieper track", "pieper synthesize", "pieper evaluate"), ("cv2",)),
    **dict.fromkeys(("pieper calibrate-camera", "pieper calibrate-field", "pieper calibrate-hand-eye"), ("cv2",)),
    "pieper ros tracker": ("cv2",),
    "pieper ros record": ("rosbags",),
    "pieper ros replay": ("rosbags",),
    "pieper launch": ("cyclonedds",),
}
"""Packages without which an example cannot run; the job of CI that has them all runs them all."""


def test_every_verb_has_an_example() -> None:
    assert [verb for verb in VERBS if not examples(verb)] == []
    for line, verb in EXAMPLES:
        assert line.startswith(f"pieper {verb}"), line


def test_nothing_is_shortened_that_is_not_there() -> None:
    assert set(SHORTENED) - {line for line, _ in EXAMPLES} <= {"pieper ros tracker mh12"}


MAKER = {
    "clean": "synthesize",
    "colors.yaml": "learn-colour",
    "tracks.csv": "track",
    "move.csv": "move",
    "lab1": "ros record",
}
"""The verb whose example makes what others read."""


class Kitchen:
    """Where the inputs of the examples are made, once: by the example of another verb, or by hand."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def lay(self, words: list[str], verb: str) -> None:
        """Put a copy of everything that an example reads into the present folder."""
        for before, word in pairwise(words):
            name = word.partition("/")[0]
            if before == "--out" or MAKER.get(name) == verb or Path(name).exists():
                continue
            if name in MAKER or hasattr(self, by_hand(name)):
                made = self.made(name)
                (shutil.copytree if made.is_dir() else shutil.copy)(made, name)

    def made(self, name: str) -> Path:
        """The input of that name, in a folder of its own."""
        folder = self.folder / f"for {name}"
        if not folder.exists():
            folder.mkdir()
            with inside(folder):
                if name in MAKER:
                    words = shlex.split(examples(MAKER[name])[0])[1:]
                    self.lay(words, MAKER[name])
                    assert main(words) == 0
                else:
                    getattr(self, by_hand(name))(folder)
        return folder / name

    def make_world_yaml(self, folder: Path) -> None:
        post = "obstacles:\n  - {name: post, box: [0.2, 0.1, 0.8], position: [0.55, 0, 0.4]}\n"
        (folder / "world.yaml").write_text(post)

    def make_task_csv(self, folder: Path) -> None:
        poses = "x,y,z,roll,pitch,yaw\n0.4,0.2,0.2,3.14159,0,0\n0.4,-0.1,0.3,3.14159,0,1.57\n"
        (folder / "task.csv").write_text(poses)

    def make_measured_csv(self, folder: Path) -> None:
        from pieper.kinematics.measurements import write_measurements
        from tests.kinematics.test_calibration import built, joints

        nominal = pieper.load("ur5e").chain
        q = joints(nominal, 60)
        write_measurements(folder / "measured.csv", nominal, q, pieper.load(built(nominal, 4, 0.003)).fk(q)[:, :3, 3])

    def make_pictures(self, folder: Path) -> None:
        import cv2

        from pieper.perception.board import Board
        from pieper.perception.camera import Camera
        from tests.perception.board_scene import RayCaster, looking_at

        lens = Camera([[330, 0, 161.7], [0, 332, 118.2], [0, 0, 1]], [-0.2, 0.05, 0, 0], (320, 240))
        board, rays = Board.parse("charuco:7x5:0.03:0.022"), RayCaster(lens, sides=3)
        (folder / "pictures").mkdir()
        rng = np.random.default_rng(0)
        for k in range(6):
            tilt, turn, roll = rng.uniform(-0.5, 0.5, 3)
            at = np.array(board.size) * rng.uniform(0.3, 0.7, 2)
            T = looking_at(at, distance=0.26, tilt=tilt, turn=turn, roll=roll)
            cv2.imwrite(str(folder / "pictures" / f"{k}.png"), rays.image(T, board.is_white, blur=0.5, noise=1, seed=k))

    def make_camera_yaml(self, folder: Path) -> None:
        from pieper.perception.calibration_file import save_camera
        from tests.perception.test_field import TRUE

        save_camera(folder / "camera.yaml", TRUE)

    def make_field_png(self, folder: Path) -> None:
        import cv2

        from pieper.perception import field_lines
        from tests.perception.board_scene import RayCaster
        from tests.perception.test_field import TRUE, VIEW

        lines = field_lines.lines("vsss")
        image = RayCaster(TRUE, sides=3).image(
            VIEW.T_camera_field, lambda p: 0.15 + 0.7 * lines.is_white(p), blur=0.6, noise=3
        )
        cv2.imwrite(str(folder / "field.png"), image)

    def make_captures_csv(self, folder: Path) -> None:
        from pieper.spatial import rotation
        from tests.perception.test_hand_eye import made_up

        _, _, hands, seen = made_up(8, 0)
        rows = ["x,y,z,qx,qy,qz,qw,camera_x,camera_y,camera_z,camera_qx,camera_qy,camera_qz,camera_qw"]
        for pair in zip(hands, seen, strict=True):
            numbers = [n for T in pair for n in (*T[:3, 3], *rotation.as_quaternion(T[:3, :3]))]
            rows.append(",".join(f"{n:.9g}" for n in numbers))
        (folder / "captures.csv").write_text("\n".join(rows) + "\n")


def by_hand(name: str) -> str:
    return "make_" + re.sub(r"\W", "_", name)


@contextlib.contextmanager
def inside(folder: Path) -> Iterator[None]:
    before = Path.cwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


@pytest.fixture(scope="module")
def kitchen(tmp_path_factory: pytest.TempPathFactory) -> Kitchen:
    return Kitchen(tmp_path_factory.mktemp("kitchen"))


class Speaking(Network):
    """A network on which somebody speaks, listens and serves; what would go on for ever is ended after a while."""

    def __init__(self) -> None:
        super().__init__()
        joints = self.test.publisher("joint_states", "sensor_msgs/msg/JointState")
        self.test.timer(0.1, lambda: joints.send(name=["a"], position=[0.5]))
        self.test.subscribe("target", "geometry_msgs/msg/Point", lambda _: None)
        self.server = nodes.NODES["rotations"].load()(self.bus("server"))


@pytest.mark.parametrize(("line", "verb"), EXAMPLES, ids=[line for line, _ in EXAMPLES])
def test_an_example_runs(
    line: str, verb: str, kitchen: Kitchen, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    for start, packages in NEEDS.items():
        if line.startswith(start):
            for package in packages:
                pytest.importorskip(package, reason=f"{package} is not installed")
    monkeypatch.chdir(tmp_path)
    network = Speaking()
    monkeypatch.setattr(pieper.ros, "open_bus", network.open_bus)
    words = shlex.split(line)[1:]
    kitchen.lay(words, verb)
    if line in SHORTENED:
        shorten(verb, network, monkeypatch)
    code = main(words)
    said = capsys.readouterr()
    assert code == 0, said.err
    for word in words[1:]:
        if re.fullmatch(r"\S+\.[a-z]\w+", word):
            assert Path(word).exists(), f"{word} is neither read nor written"


def shorten(verb: str, network: Speaking, monkeypatch: pytest.MonkeyPatch) -> None:
    """Arrange that what goes on for ever ends."""
    if verb == "view":
        from pieper.viewer.view import View

        monkeypatch.setattr(View, "wait", lambda _: None)
        monkeypatch.delenv("DISPLAY", raising=False)
    elif verb == "doctor":
        monkeypatch.setattr(doctor, "PROBES", {"core": doctor.PROBES["core"]})
        monkeypatch.setattr(doctor, "EXTRAS", {})
    elif verb == "launch":
        monkeypatch.setenv("ROS_DOMAIN_ID", str(new_domain()))
        say = Launch.say

        def ended_after_its_last_words(launch: Launch, text: str) -> None:
            say(launch, text)
            if text.startswith("to end all"):
                launch.stop()

        monkeypatch.setattr(Launch, "say", ended_after_its_last_words)
    else:
        network.stop_after(0.5)
