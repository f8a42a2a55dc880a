"""What ``--help`` says: on one screen, in parts; each verb with examples that run; each option with one name, one wording, one unit."""

from __future__ import annotations

import re
import shlex
from collections import defaultdict
from pathlib import Path
from typing import Any

import pytest

import pieper
import pieper.ros
from pieper.cli import doctor
from pieper.cli.main import main
from pieper.ros import nodes
from pieper.ros.launch import Launch
from tests.cli.kitchen import ROOT, SCREEN, Kitchen, examples, printed_help, verbs
from tests.cli.test_ros import Network
from tests.ros.domains import new_domain

VERBS = verbs()
GROUPS = ("", "plot", "ros")


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
