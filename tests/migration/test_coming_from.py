"""Every line of docs/guides/coming_from.md, run with the real package: what is written there and here agrees as it says."""

from __future__ import annotations

import importlib.metadata
import warnings
from typing import Any

import pytest

from tests.migration.page import OURS_ALONE, Line, sections, value_of
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
    "MoveIt": ["rosbags"],  # what brings the types of messages; see the page
}
LINES = [line for section in SECTIONS.values() for line in section.lines if line.is_tested]


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
