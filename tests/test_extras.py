"""Extras: a package that is not there is named, with the extra that brings it, wherever it is needed."""

from __future__ import annotations

import ast
import json
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from packaging.requirements import Requirement

from pieper.cli.probes import EXTRAS, is_wanted

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src" / "pieper"
# Names that messages use, where they are not those to install.
INSTALLED_AS = {"opencv": "opencv-python-headless"}
# What is imported of the packages that extras bring, and of those that come with them.
MODULES = {module.partition(".")[0] for extra in EXTRAS.values() for module in extra.packages.values()}
MODULES |= {"xacro", "websockets", "mpl_toolkits", "rclpy"}


@cache
def requirements() -> dict[str, list[Requirement]]:
    """The requirements of each extra in pyproject.toml."""
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    table = text.partition("[project.optional-dependencies]\n")[2].partition("\n[")[0]
    table = re.sub(r"(^|\s)#.*", "", table)
    found = re.findall(r"^(\w+) = (\[.*?\]$)", table, re.MULTILINE | re.DOTALL)
    return {name: [Requirement(line) for line in ast.literal_eval(listed)] for name, listed in found}


def names(extra: str) -> set[str]:
    return {requirement.name.lower() for requirement in requirements()[extra]}


def test_all_is_all() -> None:
    (everything,) = requirements()["all"]
    assert everything.name == "pieper"
    assert everything.extras == set(requirements()) - {"all"}


def test_one_package_is_wanted_alike_everywhere() -> None:
    """Else all extras together might not resolve, and an extra would not be what the tests ran with."""
    group = (ROOT / "pyproject.toml").read_text(encoding="utf-8").partition("\ntest = [")[2].partition("\n]")[0]
    tested = {Requirement(line).name: Requirement(line) for line in re.findall(r'"([^"]+)"', group)}
    wanted: dict[str, set[str]] = {}
    for requirement in (r for name, extra in requirements().items() if name != "all" for r in extra):
        wanted.setdefault(requirement.name, set()).add(str(requirement))
        if "==" in str(requirement.specifier):
            assert str(tested[requirement.name]) == str(requirement)
    assert all(len(versions) == 1 for versions in wanted.values()), wanted


def test_doctor_knows_every_extra_and_its_packages() -> None:
    assert {name: set(extra.packages) for name, extra in EXTRAS.items()} == {
        name: names(name) for name in requirements() if name != "all"
    }


MACHINES = [
    {"python_version": f"3.{minor}", "platform_system": system, "platform_machine": machine, "extra": ""}
    for minor in range(10, 15)
    for system, machine in (
        ("Linux", "x86_64"), ("Linux", "aarch64"), ("Darwin", "x86_64"), ("Darwin", "arm64"), ("Windows", "AMD64"),
    )
]  # fmt: skip


@pytest.mark.parametrize("machine", MACHINES, ids=lambda machine: "-".join(machine.values()))
def test_doctor_knows_where_a_package_cannot_be_had(machine: dict[str, str]) -> None:
    version = tuple(map(int, machine["python_version"].split(".")))
    for requirement in (r for extra in requirements().values() for r in extra):
        wanted = requirement.marker is None or requirement.marker.evaluate(machine)
        assert is_wanted(requirement.name, version, machine["platform_system"], machine["platform_machine"]) == wanted


# --- every place that complains


def raises() -> Iterator[tuple[str, ast.Call]]:
    """Each ``raise MissingExtraError(...)`` and the function that it stands in, as ``room/file.py:function``."""
    for path in sorted(SOURCE.rglob("*.py")):
        stack: list[tuple[ast.AST, str]] = [(ast.parse(path.read_text(encoding="utf-8")), "<module>")]
        while stack:
            node, function = stack.pop()
            if isinstance(node, ast.FunctionDef):
                function = node.name
            call = node.exc if isinstance(node, ast.Raise) else None
            if isinstance(call, ast.Call) and getattr(call.func, "id", "") == "MissingExtraError":
                yield "/".join(path.parts[-2:]) + f":{function}", call
            stack += [(child, function) for child in ast.iter_child_nodes(node)]


RAISES = list(raises())
SITES = sorted({site for site, _ in RAISES})


def test_there_are_places() -> None:
    assert len(SITES) >= 20


@pytest.mark.parametrize(("site", "call"), RAISES, ids=[f"{site}-{k}" for k, (site, _) in enumerate(RAISES)])
def test_the_package_is_one_of_the_extra_that_is_named(site: str, call: ast.Call) -> None:
    package, extra = call.args[:2]
    if isinstance(package, ast.Constant) and isinstance(extra, ast.Constant):
        name = str(package.value).lower()
        assert INSTALLED_AS.get(name, name) in names(str(extra.value)), site


class Case(NamedTuple):
    """A piece of Python that needs a package, which is not there."""

    code: str
    package: str
    extra: str


ARM = "import pieper; arm = pieper.load('mh12'); q = [0.0] * 6; "
POSE = "from pieper.model import symbolic; pose = symbolic.end_effector(pieper.load('mh12').chain); "
MAP = (
    f"{ARM}from pieper.workspace.boundary import boundary; from pieper.workspace.export import export\n"
    "from pieper.workspace.survey import survey\nfrom pieper.workspace.run import run\n"
    "found = run(survey(arm, voxel=0.5, orientations=1))\n"
)
COMMAND = "from without_packages import command; command"

NOTHING = (
    Case("from pieper.model import xacro; xacro.expand('<robot/>')", "xacrodoc", "xacro"),
    Case(f"{ARM}{POSE}", "SymPy", "symbolic"),
    Case("from pieper.model import symbolic; symbolic.from_yaml('shape: [4, 4]')", "PyYAML", "symbolic"),
    Case("from pieper.ros import messages; messages.make('std_msgs/msg/String')", "rosbags", "ros"),
    Case("from pieper.ros import bags; bags.Bag('nowhere')", "rosbags", "ros"),
    Case("from pieper.ros import arguments; arguments.read_yaml('1', 'here')", "pyyaml", "ros"),
    Case("from pieper.ros.backends import open_bus; open_bus('n', backend='bare')", "cyclonedds", "ros"),
    Case("from pieper.cli.topics import read_fields; read_fields('{x: 1}')", "pyyaml", "ros"),
    Case("import pieper.viewer.server", "viser", "viewer"),
    Case("from pieper.viewer import mesh; mesh._read('arm.stl', 0, 0)", "trimesh", "viewer"),
    Case(f"{ARM}from pieper.viewer import plot; plot.path(arm.fk([q, q]))", "matplotlib", "plot"),
    Case(f"{ARM}from pieper.viewer import plot; plot.joints(arm, [q, q])", "matplotlib", "plot"),
    Case("from pieper.viewer import plot; plot.error([1.0, 0.1])", "matplotlib", "plot"),
    Case(f"{ARM}from pieper.viewer import plot; plot.manipulability(arm, [q, q])", "matplotlib", "plot"),
    Case(f"{ARM}from pieper.viewer import plot; plot.compare(arm, arm)", "matplotlib", "plot"),
    Case("from pieper.viewer import plot; plot.need_screen()", "matplotlib", "plot"),
    Case(f"{ARM}from pieper.sim.picture import Picture; p = Picture(); p.add_arm(arm, q); p.image()", "mujoco", "sim"),
    Case(f"{ARM}from pieper.sim.physics import MujocoSimulator; MujocoSimulator(arm)", "mujoco", "sim"),
    Case(f"{ARM}from pieper.sim.mujoco_arm import build_arm; build_arm(arm)", "mujoco", "sim"),
    Case("from pieper.sim import offscreen; offscreen.import_pillow()", "pillow", "sim"),
    Case("from pieper.sim import film; film._ffmpeg()", "imageio-ffmpeg", "sim"),
    Case("from pieper.perception.source import open_source; open_source('film.mp4')", "OpenCV", "perception"),
    Case("from pieper.perception.output import create_tracks; create_tracks('t.parquet', unit='m')", "PyArrow", "parquet"),
    Case("from pieper.perception.calibration_file import load_camera; load_camera('colors.yaml')", "PyYAML", "perception"),
    Case(f"{ARM}from pieper.motion.collision import CollisionModel; CollisionModel(arm)", "coal", "plan"),
    Case("from pieper.motion import ompl_search; ompl_search._ompl()", "ompl", "plan"),
    Case(f"{ARM}from pieper.motion.timing import time_waypoints; time_waypoints(arm.chain, [q, [0.1] * 6])", "ruckig", "plan"),
    Case("from pieper.motion.world import read_world; read_world('world.yaml')", "PyYAML", "plan"),
    Case("from pieper.motion.world import World, write_world; write_world('w.yaml', World(()))", "PyYAML", "plan"),
    Case("from pieper.tasks.pick_file import read_pick_task; read_pick_task('world.yaml')", "PyYAML", "sim"),
    Case("from pieper.workspace.store import open_store; open_store('map.zarr')", "zarr", "maps"),
    Case(f"{MAP}boundary(found)", "scikit-image", "maps"),
    Case(f"{MAP}export(found, 'map.h5')", "h5py", "maps"),
    Case("from pieper.workspace.run import Cluster; Cluster('tcp://127.0.0.1:1')", "distributed", "cluster"),
)  # fmt: skip
COMMANDS = {
    "fk arm.xacro 0": "xacro",
    "convert mh12 --to latex": "symbolic",
    "render mh12 arm.png": "sim",
    "view mh12 --no-browser": "viewer",
    "plot joints mh12 --trajectory motion.csv --out joints.png": "plot",
    "pick": "sim",
    "workspace mh12 --voxel 0.5 --orientations 1 --out map.zarr": "maps",
    "workspace mh12 --voxel 0.5 --orientations 1 --figure map.png": "plot",
    "track film.mp4 --colors colors.yaml": "perception",
    "learn-colour film.mp4 --roi red:0,0,0,9,9 --roi blue:0,9,9,9,9": "perception",
    "calibrate-camera film.mp4": "perception",
    "calibrate-field film.png --lines vsss": "perception",
    "synthesize clean": "perception",
    "plan mh12 --from 0,0,0,0,0,0 --to 0.1,0,0,0,0,0": "plan",
    "move mh12 --to 0.1,0,0,0,0,0 --out moved.csv": "plan",
    "ros forward mh12 --backend bare": "ros",
    "ros echo /target": "ros",
}
# What stands behind another package of the same extra, or of another one.
BEHIND = {
    "yaml": (
        Case(f"{ARM}{POSE}symbolic.as_yaml(pose)", "PyYAML", "symbolic"),
        Case("from pieper.cli.topics import read_fields; read_fields('{x: 1}')", "pyyaml", "ros"),
    ),
    "rosbags": (Case("from pieper.ros.backends import open_bus; open_bus('n', backend='bare')", "rosbags", "ros"),),
    "imageio_ffmpeg": (
        Case(
            "import numpy as np; from pieper.sim import film\n"
            "film.save_images(iter([np.zeros((16, 16, 3), np.uint8)]), 'film.mp4', count=1, fps=1.0, size=(16, 16))",
            "imageio-ffmpeg",
            "sim",
        ),
    ),
}  # fmt: skip


def ask(packages: set[str], cases: list[str], folder: Path) -> list[dict[str, Any]]:
    """What each case raises where these packages are not there."""
    said = subprocess.run(
        [sys.executable, "-W", "ignore", str(Path(__file__).with_name("without_packages.py"))],
        input=json.dumps([sorted(packages), cases]),
        cwd=folder,
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    )
    return [json.loads(line) for line in said.stdout.splitlines() if line.startswith("{")]


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Files that commands take before they find out what is missing."""
    place: Path = tmp_path_factory.mktemp("without")
    (place / "motion.csv").write_text(
        "t,joint_1_s,joint_2_l,joint_3_u,joint_4_r,joint_5_b,joint_6_t\n0,0,0,0,0,0,0\n1,0,0,0,0,0,0\n",
        encoding="utf-8",
    )
    (place / "arm.xacro").write_text(
        '<robot name="a" xmlns:xacro="http://ros.org/wiki/xacro"><link name="l"/></robot>', encoding="utf-8"
    )
    for name in ("colors.yaml", "world.yaml", "film.mp4", "film.png", "arm.stl"):
        (place / name).write_bytes(b"")
    return place


@pytest.fixture(scope="module")
def without_any(folder) -> dict[str, dict[str, Any]]:
    """What is raised where no extra is installed."""
    codes = [case.code for case in NOTHING]
    commands = [f"{COMMAND}{tuple(line.split(' '))!r}" for line in COMMANDS]
    return dict(zip([*codes, *COMMANDS], ask(MODULES, [*codes, *commands], folder), strict=True))


def check(case: Case, answer: dict[str, Any]) -> None:
    assert answer["type"] == "MissingExtraError", answer["message"]
    assert (answer["package"], answer["extra"]) == (case.package, case.extra)
    assert answer["message"].startswith(f"{case.package} is not installed; ")
    assert answer["message"].endswith(f"needs it: pip install 'pieper[{case.extra}]'")


@pytest.mark.parametrize("case", NOTHING, ids=lambda case: case.code[-60:])
def test_without_extras_each_names_itself(without_any, case: Case) -> None:
    check(case, without_any[case.code])


@pytest.mark.parametrize("line", COMMANDS)
def test_without_extras_each_command_names_one(without_any, line: str) -> None:
    message = without_any[line]["message"]
    assert message.startswith("exit code 3: pieper: ")
    assert message.endswith(f"needs it: pip install 'pieper[{COMMANDS[line]}]'")
    assert message.count("\n") == 0


@pytest.fixture(scope="module")
def behind(folder) -> dict[str, list[dict[str, Any]]]:
    """What is raised where one package alone is missing."""
    return {package: ask({package}, [case.code for case in cases], folder) for package, cases in BEHIND.items()}


@pytest.mark.parametrize("package", BEHIND)
def test_behind_another_package(behind, package: str) -> None:
    if package == "rosbags":
        pytest.importorskip("cyclonedds", reason="cyclonedds, the first to be missed, is not installed")
    for case, answer in zip(BEHIND[package], behind[package], strict=True):
        check(case, answer)


def test_every_place_was_reached(without_any, behind) -> None:
    answers = [*without_any.values(), *(answer for some in behind.values() for answer in some)]
    reached = {answer["site"] for answer in answers if answer["type"] == "MissingExtraError"}
    assert set(SITES) - reached == set(), "give each of these a case above"


def test_without_rclpy_the_other_backend_is_named(folder) -> None:
    (answer,) = ask({"rclpy"}, ["from pieper.ros.rcl import RclWire; RclWire('n', namespace='/')"], folder)
    assert answer["type"] == "MissingLibraryError"
    assert "source your ROS 2 first" in answer["message"]
    assert "PIEPER_ROS_BACKEND=bare" in answer["message"]


# --- every place that imports


def test_no_package_of_an_extra_is_imported_when_pieper_is(folder) -> None:
    """Rooms whose whole purpose is one package complain when they are imported; all others can be."""
    modules = [".".join(p.relative_to(SOURCE.parent).with_suffix("").parts) for p in sorted(SOURCE.rglob("*.py"))]
    named = [m.removesuffix(".__init__") for m in modules if not m.endswith("__main__")]
    answers = ask(MODULES, [f"import {m}" for m in named], folder)
    complain = {m for m, answer in zip(named, answers, strict=True) if answer["type"]}
    assert {answer["type"] for answer in answers} <= {"", "MissingExtraError"}
    assert {m.split(".")[1] for m in complain} == {"ros", "tasks", "viewer"}
    assert all(m.startswith(("pieper.ros.bare", "pieper.tasks.pick_view", "pieper.viewer.")) for m in complain)
