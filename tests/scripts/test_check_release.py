"""The files of a release are looked at before they are published."""

from __future__ import annotations

import io
import tarfile
import zipfile
from pathlib import Path

import pytest

import pieper
from scripts.check_release import IN_A_WHEEL, IN_THE_ARCHIVE, complaints

VERSION = pieper.__version__
PYTHONS = ("cp310-cp310", "cp311-cp311", "cp312-abi3")
PLATFORMS = (
    "manylinux_2_27_x86_64.manylinux_2_28_x86_64",
    "manylinux_2_27_aarch64.manylinux_2_28_aarch64",
    "macosx_11_0_x86_64",
    "macosx_11_0_arm64",
    "win_amd64",
)


def write_wheel(path: Path, *, without: str = "", more: str = "") -> None:
    module = "pieper/_native/kernels.abi3.so" if "abi3" in path.name else "pieper/_native/kernels.cp310-win_amd64.pyd"
    names = [*(name.format(version=VERSION) for name in IN_A_WHEEL), "pieper/__init__.py", module]
    with zipfile.ZipFile(path, "w") as wheel:
        for name in [*names, *filter(None, [more])]:
            if name != without:
                wheel.writestr(name, "")


@pytest.fixture
def release(tmp_path: Path) -> Path:
    """A folder with everything that a release has."""
    for python in PYTHONS:
        for platform in PLATFORMS:
            write_wheel(tmp_path / f"pieper-{VERSION}-{python}-{platform}.whl")
    with tarfile.open(tmp_path / f"pieper-{VERSION}.tar.gz", "w:gz") as archive:
        for name in IN_THE_ARCHIVE:
            archive.addfile(tarfile.TarInfo(f"pieper-{VERSION}/{name}"), io.BytesIO())
    return tmp_path


def test_a_whole_release(release) -> None:
    assert len(list(release.iterdir())) == 16
    assert complaints(release, f"v{VERSION}") == []


def test_another_tag(release) -> None:
    assert complaints(release, "v99.0") == [f"the tag is v99.0, and the version {VERSION}"]


@pytest.mark.parametrize("python", PYTHONS)
def test_a_wheel_that_is_missing(release, python) -> None:
    (release / f"pieper-{VERSION}-{python}-win_amd64.whl").unlink()
    assert complaints(release) == [f"0 wheels for {python} on Windows"]


def test_no_archive(release) -> None:
    (release / f"pieper-{VERSION}.tar.gz").unlink()
    assert complaints(release) == [f"no pieper-{VERSION}.tar.gz"]


@pytest.mark.parametrize("name", ["pieper-0.0.1.tar.gz", f"pieper-{VERSION}-cp312-cp312-win_amd64.whl", "notes.txt"])
def test_what_does_not_belong_here(release, name) -> None:
    (release / name).touch()
    assert complaints(release) == [f"{name} does not belong here"]


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"without": "pieper/py.typed"}, "no pieper/py.typed"),
        ({"without": "pieper/_native/kernels.abi3.so"}, "no compiled module"),
        ({"more": "tests/robots.py"}, "tests does not belong here"),
    ],
)
def test_what_is_in_a_wheel(release, change, complaint) -> None:
    name = f"pieper-{VERSION}-cp312-abi3-win_amd64.whl"
    write_wheel(release / name, **change)
    assert complaints(release) == [f"{name}: {complaint}"]
