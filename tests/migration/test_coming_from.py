"""Every line of docs/guides/coming_from.md, run with the real package: what is written there and here agrees as it says."""

from __future__ import annotations

import importlib.metadata
import re
import warnings
from typing import Any

import numpy as np
import pytest

import pieper
from tests.migration.page import OURS_ALONE, PAGE, Line, sections, value_of
from tests.migration.relations import RELATIONS, SAME

SECTIONS = sections()
PACKAGES = {  # by heading: what has to be installed
    "ikpy": ["ikpy"],
    "kinpy": ["kinpy"],
    "Robotics Toolbox": ["roboticstoolbox-python", "spatialmath-python"],
    "spatialmath": ["spatialmath-python"],
    "Pinocchio": ["pin", "coal"],
    "EAIK": ["EAIK"],
    "ssik": ["ssik"],
    "MoveIt": ["rosbags", "coal", "ompl", "ruckig"],  # what our side needs; see the page
}
LINES = [line for section in SECTIONS.values() for line in section.lines if line.is_tested]


def pinned(package: str) -> str | None:
    """The version of a package in the group `peers` of pyproject.toml."""
    text = (PAGE.parents[2] / "pyproject.toml").read_text(encoding="utf-8")
    group = re.search(r"^peers = \[(.*?)^\]", text, re.MULTILINE | re.DOTALL)
    assert group is not None
    found = re.search(rf'"{re.escape(package)}==([^"]+)"', group[1])
    return None if found is None else found[1]


@pytest.mark.parametrize("name", PACKAGES)
def test_the_page_names_the_version_that_is_pinned(name: str) -> None:
    told = re.match(r"\s*(\d[\w.]*\d)\. ", SECTIONS[name].text)
    assert (None if told is None else told[1]) == pinned(PACKAGES[name][0])


def test_every_section_with_a_table_is_known_and_every_relation_is_used() -> None:
    assert {name for name, section in SECTIONS.items() if section.lines} == set(PACKAGES)
    assert {line.relation for line in LINES} == set(RELATIONS)
    assert all(len(section.lines) >= 8 for section in SECTIONS.values() if section.lines)


def test_a_line_that_does_not_agree_fails() -> None:
    arm, other = pieper.load("ur5e"), pieper.load("ur10e")
    answers = np.zeros((2, 6))
    for name, theirs, ours in [
        ("same", [1.0, 2.0], [1.0, 2.1]),
        ("same", ["a"], ("b",)),
        ("same", True, False),
        ("same or negated", [1.0, 0.0], [0.9, 0.1]),
        ("same arm", arm, other),
        ("same set", answers[:1], answers),
        ("same set", answers + 0.1, answers),
        ("same sets", [answers + 0.1], answers[None]),
        ("same rows", answers + 6.283185307179586, answers),
        ("among", answers[0] + 0.1, answers),
        ("same position", answers[0], answers[0] + 0.1),
        ("same tool axis", answers[0], answers[0] + 0.1),
        ("same shape", answers, answers[0]),
        ("no worse", 0.1, 0.2),
        ("both run", None, 1.0),
        ("ours runs", "not run", None),
    ]:
        with pytest.raises(AssertionError):
            RELATIONS[name](theirs, ours, arm, SAME)


def missing(packages: list[str]) -> list[str]:
    found = []
    for package in packages:
        try:
            importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            found.append(package)
    return found


class Told:
    """What both sides of every line of a section gave, run once from top to bottom."""

    def __init__(self, name: str) -> None:
        setup = "\n".join(code for language, code in SECTIONS[""].blocks if language == "python")
        theirs: dict[str, Any] = {}
        exec(compile(setup, "the code at the top", "exec"), theirs)
        ours = dict(theirs)
        for language, code in SECTIONS[name].blocks:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # those of the other package
                exec(compile(code, f"the code of {name}", "exec"), theirs)
            if language == "python":
                exec(compile(code, f"the code of {name}", "exec"), ours)
        self.arm = ours["arm"]
        self.values: dict[int, Any] = {}
        for line in SECTIONS[name].lines:
            if line.is_tested:
                self.values[line.number] = self._of(line, theirs, ours)

    def _of(self, line: Line, theirs: dict[str, Any], ours: dict[str, Any]) -> Any:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                there = "not run" if line.relation == OURS_ALONE else value_of(line.theirs, theirs, f"{line}, there")
            return there, value_of(line.ours, ours, f"{line}, here")
        except Exception as error:  # noqa: BLE001  # told by the test of this line
            return error


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> Any:
    sections_told: dict[str, Told] = {}
    patch = pytest.MonkeyPatch()
    patch.chdir(tmp_path_factory.mktemp("migration"))
    patch.setenv("MPLBACKEND", "Agg")

    def of(name: str) -> Told:
        if name not in sections_told:
            sections_told[name] = Told(name)
        return sections_told[name]

    yield of
    patch.undo()


@pytest.mark.parametrize("line", LINES, ids=str)
def test_line(line: Line, told: Any) -> None:
    lacking = missing(PACKAGES[line.section])
    if lacking:
        pytest.skip(f"{', '.join(lacking)}: not installed; nox -s peers has it")
    given = told(line.section).values[line.number]
    if isinstance(given, Exception):
        raise AssertionError(f"{line.theirs}\n{line.ours}") from given
    tolerance = SAME if line.tolerance is None else line.tolerance
    RELATIONS[line.relation](*given, told(line.section).arm, tolerance)
