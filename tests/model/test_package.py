"""Finding packages and meshes without ROS: every place, the order of the places, and what must not be found."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from pieper.model.package import find_package, package_of, resolve


def make(folder: Path, *, manifest: str | None = None) -> Path:
    """A package folder with one mesh."""
    (folder / "meshes").mkdir(parents=True)
    (folder / "meshes" / "link.stl").write_text("solid")
    if manifest is not None:
        (folder / "package.xml").write_text(f"<package format='2'><name> {manifest} </name></package>")
    return folder


@pytest.fixture(autouse=True)
def no_ros(monkeypatch):
    monkeypatch.delenv("ROS_PACKAGE_PATH", raising=False)
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)


def test_given_folders(tmp_path):
    arm = make(tmp_path / "src" / "repository" / "arm")
    assert find_package("arm", packages={"arm": arm}) == str(arm)
    assert find_package("leg", packages={"arm": arm}) is None
    for given in (arm, arm.parent, arm.parent.parent):
        assert find_package("arm", packages=[given]) == str(arm)
        assert find_package("arm", packages=str(given)) == str(arm)
    renamed = make(tmp_path / "checkout-of-arm2", manifest="arm2")
    assert find_package("arm2", packages=[renamed]) == str(renamed)
    assert find_package("arm2", packages=[tmp_path]) == str(renamed)
    assert find_package("arm", packages=[tmp_path / "nowhere"]) is None


def test_home_is_expanded(tmp_path, monkeypatch):
    arm = make(tmp_path / "ws" / "arm")
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("USERPROFILE", str(tmp_path))
    assert find_package("arm", packages=["~/ws"]) == str(arm)
    assert find_package("arm", packages={"arm": "~/ws/arm"}) == str(arm)


def test_ros_paths(tmp_path, monkeypatch):
    ros1 = make(tmp_path / "ros1" / "arm")
    ros2 = make(tmp_path / "ros2" / "share" / "leg")
    monkeypatch.setenv("ROS_PACKAGE_PATH", os.pathsep.join([str(tmp_path / "nowhere"), str(tmp_path / "ros1"), ""]))
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "ros2"))
    assert find_package("arm") == str(ros1)
    assert find_package("leg") == str(ros2)
    own = make(tmp_path / "own" / "arm")
    assert find_package("arm", packages=[tmp_path / "own"]) == str(own), "given folders come first"


def test_beside_the_file(tmp_path):
    arm = make(tmp_path / "repository" / "arm")
    hand = make(tmp_path / "repository" / "hand")
    file = arm / "urdf" / "arm.urdf"
    assert find_package("arm", beside=file) == str(arm)
    assert find_package("hand", beside=file) == str(hand)
    checkout = make(tmp_path / "checkout", manifest="named_inside")
    assert find_package("named_inside", beside=checkout / "urdf" / "a.urdf") == str(checkout)


def test_far_above_the_file_only_real_packages_count(tmp_path):
    make(tmp_path / "far")
    real = make(tmp_path / "real", manifest="real")
    file = tmp_path / "a" / "b" / "c" / "d" / "arm.urdf"
    assert find_package("far", beside=file) is None
    assert find_package("real", beside=file) == str(real)


@pytest.mark.parametrize("name", ["", ".", "..", "a/b", "../arm", "a\0b", "a b"])
def test_names_that_are_no_packages(name, tmp_path):
    make(tmp_path / "arm")
    assert find_package(name, packages=[tmp_path], beside=tmp_path / "arm" / "a.urdf") is None


def test_hidden_folders_are_no_packages(tmp_path):
    (tmp_path / ".ssh").mkdir()
    assert find_package(".ssh", beside=tmp_path / "arm.urdf") is None
    assert find_package(".ssh", packages=[tmp_path]) is None


def test_system_folders_are_no_packages():
    assert find_package("etc", beside="/home/someone/robots/arm/urdf/arm.urdf") is None


def test_resolve(tmp_path):
    arm = make(tmp_path / "arm")
    mesh = arm / "meshes" / "link.stl"
    (tmp_path / "secret.stl").write_text("solid")
    file = arm / "urdf" / "arm.urdf"
    file.parent.mkdir()
    for uri in (
        "package://arm/meshes/link.stl",
        "package://arm/urdf/../meshes/link.stl",
        "model://arm/meshes/link.stl",
        f"file://{mesh}",
        str(mesh),
        "../meshes/link.stl",
    ):
        assert resolve(uri, beside=file) == str(mesh), uri
    for uri in (
        "package://arm/meshes/other.stl",
        "package://arm",
        "package://arm/meshes",
        "package://arm/../secret.stl",
        "package://leg/meshes/link.stl",
        "https://example.org/link.stl",
        "link.stl",
        "a\0b",
        "",
        "x" * 10_000,
        "file://[",
    ):
        assert resolve(uri, beside=file) is None, uri
    assert resolve("meshes/link.stl") is None, "relative to nothing"


def test_package_of(tmp_path):
    arm = make(tmp_path / "arm", manifest="arm")
    assert package_of(arm / "urdf" / "deep" / "arm.xacro") == str(arm)
    assert package_of(arm) == str(arm)
    assert package_of(tmp_path) is None
