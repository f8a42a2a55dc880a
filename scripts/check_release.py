"""Whether a folder holds the files of a release, all of them and no others: ``python scripts/check_release.py dist --tag v1.2.3``.

A wheel for every Python and platform of [tool.cibuildwheel], the source archive, one version, that of the tag; and in every wheel what it needs.
"""

from __future__ import annotations

import argparse
import re
import sys
import tarfile
import zipfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
PYTHONS = ("cp310-cp310", "cp311-cp311", "cp312-abi3")
PLATFORMS = {
    "Linux x86-64": r"manylinux[\w.]*_x86_64",
    "Linux aarch64": r"manylinux[\w.]*_aarch64",
    "macOS Intel": r"macosx_\w+_x86_64",
    "macOS Apple silicon": r"macosx_\w+_arm64",
    "Windows": r"win_amd64",
}
# One of each kind of file that is no Python: without it something does not work.
IN_A_WHEEL = (
    "pieper/py.typed",
    "pieper/_native/kernels.pyi",
    "pieper/model/robots/ur5e.json",
    "pieper/perception/patterns/report.yaml",
    "pieper/perception/color_page.html",
    "pieper/ros/interfaces/pieper_interfaces/srv/CalculateIK.srv",
    "pieper/ros/interfaces/moveit_msgs/msg/RobotState.msg",
    "pieper-{version}.dist-info/licenses/LICENSE",
    "pieper-{version}.dist-info/entry_points.txt",
)
IN_THE_ARCHIVE = (
    "LICENSE",
    "README.md",
    "pyproject.toml",
    "CMakeLists.txt",
    "native/CMakeLists.txt",
    "PKG-INFO",
    "tests/robots.py",
)


def complaints(folder: Path, tag: str = "") -> list[str]:
    """What is wrong with the files in a folder; empty when nothing is."""
    text = (ROOT / "src/pieper/_version.py").read_text(encoding="utf-8")
    (version,) = re.findall(r'^__version__ = "([^"]+)"$', text, re.MULTILINE)
    names = {path.name for path in folder.iterdir()}
    wrong = [] if not tag or tag == f"v{version}" else [f"the tag is {tag}, and the version {version}"]
    for python in PYTHONS:
        for platform, pattern in PLATFORMS.items():
            found = {n for n in names if re.fullmatch(rf"pieper-{re.escape(version)}-{python}-{pattern}\.whl", n)}
            if len(found) != 1:
                wrong.append(f"{len(found)} wheels for {python} on {platform}")
            wrong += [f"{name}: {word}" for name in found for word in in_a_wheel(folder / name, version)]
            names -= found
    archive = f"pieper-{version}.tar.gz"
    wrong += in_the_archive(folder / archive, version) if archive in names else [f"no {archive}"]
    return wrong + [f"{name} does not belong here" for name in sorted(names - {archive})]


def in_a_wheel(path: Path, version: str) -> list[str]:
    """What a wheel lacks, and what it has too much."""
    with zipfile.ZipFile(path) as wheel:
        inside = set(wheel.namelist())
    wrong = [f"no {name.format(version=version)}" for name in IN_A_WHEEL if name.format(version=version) not in inside]
    if not any(re.fullmatch(r"pieper/_native/kernels\.[\w.-]*(so|pyd)", name) for name in inside):
        wrong.append("no compiled module")
    tops = {name.partition("/")[0] for name in inside} - {"pieper", f"pieper-{version}.dist-info", "pieper.libs"}
    return wrong + [f"{name} does not belong here" for name in sorted(tops)]


def in_the_archive(path: Path, version: str) -> list[str]:
    """What the source archive lacks."""
    with tarfile.open(path) as archive:
        inside = set(archive.getnames())
    return [f"{path.name}: no {name}" for name in IN_THE_ARCHIVE if f"pieper-{version}/{name}" not in inside]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--tag", default="", help="that of the release, such as v1.2.3")
    asked = parser.parse_args()
    wrong = complaints(asked.folder, asked.tag)
    for complaint in wrong:
        print(complaint, file=sys.stderr)
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
